r"""Shapes of a condensed body that the mesh excites, in place of modes that it leaves alone.

Of the natural modes of a thin wheel in the range of the mesh's harmonics few move the flanks. Modes
of one wave number may be combined without a turn of the body noticing: $z = Qy$ the columns of
$Q$ orthonormal over the complex amplitudes of their pairs. The combinations kept are the first
singular vectors of the modes' answers to loads on the flanks, and to motion of the seats, at
frequencies all over the range, less the static ones, which every reduction has (Besselink et al.,
J. Sound Vib. 332 (2013), on Krylov and balanced reduction). Combined again so that stiffness is
diagonal, they are used like natural modes.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxgear._geometry._lines import ContactLines, MeshGrid, contact_lines
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_in_mesh import BodyInMesh
from jaxgear._system._body_modes import BodyBasis, whole_pairs
from jaxgear._system._mode_combinations import Combinations
from jaxgear._system._residual_shapes import beside, residual_shapes

# Frequencies at which answers are looked at, up to the highest of the modes; their damping ratio;
# positions in a mesh period.
_FREQUENCIES, _RATIO, _POSITIONS = 60, 0.02, 8

# Natural modes of which so many times fewer shapes are made: what is beyond them follows without
# inertia. With 800 in all the largest mesh force of the accessory wheel is 0.4 % off.
CANDIDATES = 6

# Residual shapes: as many as mesh coordinates tell combinations apart. Twice as many change the
# largest mesh force by 0.01 %. Those of modes beyond the candidates hardly move the flanks, but the
# rim's end: without them it is up to 2.5 % off. They are apart, for 12 of all modes would mix what
# has inertia with what has none: of the power wheel the largest mesh force then is 1 % off, so 0.8.
_RESIDUAL, _BEYOND = 12, 4

# Motion of the seats as part of what the modes give: bearings give less than a thin web. With ten
# times as much the largest mesh force of the accessory pair changes by 0.1 %.
_SEATS = 0.1


class _Shape(NamedTuple):
    """A shape without a partner, or a pair of them.

    **Fields:**

    - `square`: of its angular frequency [rad2/s2].
    - `columns`: combinations of modes, one or two.
    - `wave`: wave number.
    - `diameters`: nodal diameters.
    """

    square: float
    columns: list[np.ndarray]
    wave: int
    diameters: int


def excited_shapes(
    basis: BodyBasis, body: BodyInMesh, pair: GearPair, index: int, grid: MeshGrid, count: int
) -> Combinations | None:
    """The shapes of a body that its mesh excites. Call it outside of `jit`, as `flexible_body`.

    Some are the lowest natural modes, the others combinations of higher ones. Residual shapes, of
    all modes, come to them.

    **Arguments:**

    - `basis`: all natural modes, or many, as they repeat under the teeth.
    - `body`: in mesh.
    - `pair`: the gears.
    - `index`: 0 if it is the pinion's, 1 if it is the wheel's.
    - `grid`: slices, lines and periods of the cycle.
    - `count`: number of shapes, one less where a pair would be parted; 0 are all.

    **Returns:**

    These shapes as combinations of the modes, by rising frequency, and residual shapes; or `None`
    if the basis has no more than so many.
    """
    if count == 0 or count >= len(basis.square):
        return None
    lowest = natural_among(count, basis.waves)
    shapes = _natural(basis, lowest)
    loads, answers = _loads(pair, index, body, basis, grid), []
    inertia = _inertia(basis, body, loads, float(pair.base_radius[index]))
    end = whole_pairs(min(CANDIDATES * count, len(basis.waves)), basis.waves)
    for first, second in _alike(basis, lowest, end):
        pressed, carried = (_on_modes(each, first, second) for each in (loads, inertia))
        found = _answers(pressed, carried, basis.square[first], alone=not second.size)
        answers.append((first, second, *found))
    for (first, second, found, _), kept in zip(
        answers, _strongest(answers, count - lowest), strict=True
    ):
        shapes += _combined(basis, found[:, :kept], first, second)
    shapes.sort(key=lambda shape: shape.square)
    each = lambda values: np.array(
        [x for shape in shapes for x in values(shape)[: len(shape.columns)]]
    )
    into = np.stack([column for shape in shapes for column in shape.columns], axis=1)
    of_modes = basis.square, basis.waves, basis.diameters, into, loads
    within = np.arange(len(basis.square)) < end
    residual = (
        residual_shapes(*of_modes, among, number)
        for among, number in ((within, _RESIDUAL), (~within, _BEYOND))
    )
    return Combinations(
        into=into,
        square=each(lambda shape: [shape.square] * 2),
        waves=each(lambda shape: [shape.wave, -shape.wave]),
        diameters=each(lambda shape: [shape.diameters] * 2),
        residual=beside(*residual),
    )


def natural_among(count: int, waves: np.ndarray) -> int:
    """How many of so many shapes are the lowest natural modes: a quarter, and no pair is parted.

    With an eighth RMS of TE of the power wheel is up to 5 % off above 2300 rad/s, so 1 %.

    **Arguments:**

    - `count`: number of shapes.
    - `waves`: wave numbers by rising frequency, of the second of a pair below zero.
    """
    return whole_pairs(count // 4, waves)


def _natural(basis: BodyBasis, count: int) -> list[_Shape]:
    """The lowest modes as they are."""
    unit, found = np.eye(len(basis.square))[:, :count], []
    for number in np.flatnonzero(basis.waves[:count] >= 0):
        paired = number + 1 < count and basis.waves[number + 1] < 0
        columns = [unit[:, number + i] for i in range(1 + paired)]
        square, wave, around = (x[number] for x in (basis.square, basis.waves, basis.diameters))
        found.append(_Shape(float(square), columns, int(wave), int(around)))
    return found


def _alike(basis: BodyBasis, lowest: int, end: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Numbers of the higher modes of each wave number and number of nodal diameters.

    With partners they are two arrays of one length, without them the second is empty.
    """
    first = lowest + np.flatnonzero(basis.waves[lowest:end] >= 0)
    paired = np.append(basis.waves[1:] < 0, False)[first]
    kinds = np.stack([basis.waves[first], basis.diameters[first], paired], axis=1)
    each, of_kind = np.unique(kinds, axis=0, return_inverse=True)
    found = []
    for kind, (_, _, both) in enumerate(each):
        alike = first[of_kind.ravel() == kind]
        found.append((alike, alike + 1 if both else alike[:0]))
    return found


def _loads(
    pair: GearPair, index: int, body: BodyInMesh, basis: BodyBasis, grid: MeshGrid
) -> np.ndarray:
    """Loads on the modes by loads along each line in contact, `[load, mode]` [kg^-1/2]."""
    lines = contact_lines(pair, grid)
    return body.loads(pair, index, _some(lines, max(grid.phases // _POSITIONS, 1)), basis)


def _inertia(basis: BodyBasis, body: BodyInMesh, loads: np.ndarray, radius: float) -> np.ndarray:
    """Inertia of the modes as the body goes along with its seats, `[seat dof, mode]` [kg^1/2 m/N].

    Each seat moves, or tilts at the teeth, by a part of what the modes give under a load of 1 N.
    """
    count = basis.following.shape[1] // 6
    moved = np.tile([1.0, 1.0, 1.0, *[1.0 / radius] * 3], count)
    give = np.max(loads**2 @ (1.0 / basis.square))
    between = (basis.following.T @ body.condensed.mass) @ basis.shapes
    return _SEATS * give * moved[:, None] * between


def _some(lines: ContactLines, step: int) -> ContactLines:
    """Every so many positions of a cycle, if a mesh period is a multiple of them."""
    if (len(lines.phase) // lines.periods) % step:
        return lines
    names = ("phase", "weight", "tooth", "roll", "fraction")
    fewer = {name: getattr(lines, name)[::step] for name in names}
    return dataclasses.replace(lines, **fewer, kept=None)


def _on_modes(loads: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Loads on the amplitudes of some modes, complex where they have partners, `[mode, load]`.

    There are only as many as modes: those that span the same and weigh as much.
    """
    load = loads[:, first].T.astype(complex)
    if second.size:
        load += 1j * loads[:, second].T
    vectors, sizes, _ = np.linalg.svd(load, full_matrices=False)
    return vectors * sizes


def _answers(
    loads: np.ndarray, inertia: np.ndarray, square: np.ndarray, *, alone: bool
) -> tuple[np.ndarray, np.ndarray]:
    r"""Combinations by falling size of the answers of modes in all of the range, and these sizes.

    The answer to a load is $b/(\lambda - \omega^2)$ less its static part $b/\lambda$, that to the
    motion of a seat is $\omega^2m/(\lambda - \omega^2)$, both in units of strain energy. They count
    with the reciprocal of the frequency, as the spectrum of a jump does.
    """
    root = np.sqrt(square)[:, None]
    fastest, answers = root.max(), []
    for frequency in np.linspace(1.0, _FREQUENCIES, _FREQUENCIES) / _FREQUENCIES * fastest:
        dynamic = root**2 - frequency**2 + 2j * _RATIO * frequency * root
        answers += [frequency / (root * dynamic) * loads, frequency * root / dynamic * inertia]
    answers = np.concatenate(answers, axis=1)
    if alone:
        answers = np.concatenate([np.real(answers), np.imag(answers)], axis=1)
    shapes, sizes, _ = np.linalg.svd(answers, full_matrices=False)
    return shapes / root, sizes


def _strongest(answers: list, count: int) -> list[int]:
    """How many combinations of each wave are among so many that answer most."""
    every = sorted(
        ((size, which) for which, (*_, sizes) in enumerate(answers) for size in sizes), reverse=True
    )
    kept, left = [0] * len(answers), count
    for _, which in every:
        left -= 1 + bool(answers[which][1].size)
        if left < 0:
            break
        kept[which] += 1
    return kept


def _combined(
    basis: BodyBasis, found: np.ndarray, first: np.ndarray, second: np.ndarray
) -> list[_Shape]:
    """Shapes of unit mass and apart in stiffness from combinations of modes of one wave."""
    square, size = basis.square[first], len(basis.square)
    among = np.linalg.qr(found)[0]
    values, vectors = np.linalg.eigh(among.conj().T @ (square[:, None] * among))
    among = among @ vectors
    shapes = []
    for value, column in zip(values, among.T, strict=True):
        columns = [np.zeros(size) for _ in range(1 + bool(second.size))]
        columns[0][first] = np.real(column)
        if second.size:
            # Of z1 + i z2 = q (y1 + i y2).
            columns[0][second], columns[1][second] = np.imag(column), np.real(column)
            columns[1][first] = -np.imag(column)
        wave, around = int(basis.waves[first[0]]), int(basis.diameters[first[0]])
        shapes.append(_Shape(float(value), columns, wave, around))
    return shapes
