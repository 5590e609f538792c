r"""Condensation of a body on its rim and its seats.

The body follows its boundary $u_b$ statically, by constraint modes $T$, and adds to that shapes
$Y$ that leave the boundary where it is: $u = T u_b + Y q$. The stiffness has then no blocks
between both, whatever the shapes, $T^T K Y = 0$ (physics.md A6.2), and static answers at the
boundary are exact for loads anywhere. What methods differ in is $Y$ alone.

A seat that averages its nodes is a constraint $B u = u_s$, met by forces $B^T \lambda$.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from scipy.sparse import bsr_array, csr_array, lil_array

from ._artefact import ReducedBody, balanced, floating, rigid_motions
from ._assembly import (
    across,
    centrifugal_load,
    coriolis,
    internal_forces,
    order,
    stress_stiffening,
)
from ._boundary import FullBody, dofs_of
from ._checks import Progress, require, silent
from ._modes import free_modes, largest_rotation, lowest_modes, scale_of
from ._solvers import Factor, factorise
from ._symmetry import Rotation, Waves, waves_of

METHODS = ("herting", "craig-bampton", "guyan")
MOST_MODES = 200

# Shapes that others make up to this, in energy, are left out: they say nothing new.
_NEW = 1e-12

# Columns treated at a time; three axes each.
_COLUMNS = 510


@dataclass(frozen=True)
class Held:
    """A body whose boundary is held, ready to be loaded.

    **Fields:**

    - `full`: the body.
    - `rotation`: that leaves the body as it is, of which the factor makes use.
    - `inside`: unknowns that no coordinate of the boundary is.
    - `factor`: of their stiffness.
    - `forces`: answers to the forces of the averaging seats, `[inside, constraint]`.
    - `meeting`: flexibility of those seats, $B K_{ii}^{-1} B^T$, `[constraint, constraint]`.
    """

    full: FullBody
    rotation: Rotation
    inside: np.ndarray
    factor: Factor
    forces: np.ndarray
    meeting: np.ndarray

    @property
    def averages(self) -> csr_array:
        """Rows of the averaging seats on the inside."""
        return self.full.averages[:, self.inside]

    def loaded(self, load: np.ndarray, seats: np.ndarray | float = 0.0) -> np.ndarray:
        """Motion under loads, the rim and rigid seats held and the averaging seats prescribed.

        **Arguments:**

        - `load`: loads on all unknowns, shape `[3 point, column]`.
        - `seats`: motion of the averaging seats, `[constraint, column]`.

        **Returns:**

        Motion of all unknowns, shape `[3 point, column]`.
        """
        motion = np.zeros(load.shape)
        motion[self.inside] = self._answer(load[self.inside], seats)
        return motion

    def _answer(self, load: np.ndarray, seats: np.ndarray | float) -> np.ndarray:
        """The same for the unknowns inside, `[inside, column]`."""
        answer = self.factor.solve(load)
        if len(self.meeting):
            answer += self.forces @ np.linalg.solve(self.meeting, seats - self.averages @ answer)
        return answer

    def reaction(self, motion: np.ndarray) -> np.ndarray:
        """Forces on the boundary that hold a motion with no other load, `[boundary, column]`."""
        full, rows = self.full, self.averages
        rim, rings, averaging = _places(full)
        result = np.empty((len(rim) + len(rings) + len(averaging), motion.shape[1]))
        result[np.concatenate([rim, rings])] = _product(full.stiffness[full.held], motion)
        if len(averaging):
            # What is left inside are the forces of these seats, spread by their rows.
            left = _product(csr_array(rows @ full.stiffness[self.inside]), motion)
            result[averaging] = np.linalg.solve((rows @ rows.T).toarray(), left)
        return result

    def followed(self, boundary: np.ndarray) -> np.ndarray:
        """Static motion of all unknowns with the boundary.

        **Arguments:**

        - `boundary`: motion of the boundary, `[boundary, column]`: rim, then seats.

        **Returns:**

        Motion of all unknowns, shape `[3 point, column]`.
        """
        full = self.full
        rim, rings, averaging = _places(full)
        outer = boundary[np.concatenate([rim, rings])]
        pull = full.stiffness[full.held][:, self.inside].T
        motion = np.zeros((3 * full.points, boundary.shape[1]), order="F")
        motion[full.held] = outer
        for some in _blocks(boundary.shape[1]):
            seats = boundary[averaging, some]
            motion[self.inside, some] = self._answer(-(pull @ outer[:, some]), seats)
        return motion


def hold(full: FullBody, *, rotation: Rotation | None = None, progress: Progress = silent) -> Held:
    """Hold a body at its rim and its seats.

    **Arguments:**

    - `full`: the body.
    - `rotation`: a rotation that leaves the body as it is; the smallest one is sought without it.
    - `progress`: told what begins.

    **Returns:**

    The body with its boundary held.

    **Raises:**

    - `BodyError` if a part of it is still loose.
    """
    rotation = largest_rotation(full) if rotation is None else rotation
    points = np.setdiff1d(np.arange(full.points), full.held // 3)
    inside = dofs_of(points)
    with progress(f"factorising {len(inside)} unknowns"):
        stiffness = full.stiffness[inside][:, inside]
        factor = _factor(stiffness, waves_of(rotation.among(points)))
    rows = full.averages[:, inside]
    forces = factor.solve(rows.T.toarray()) if rows.shape[0] else np.zeros((len(inside), 0))
    return Held(full, rotation, inside, factor, forces, rows @ forces)


def _factor(matrix: csr_array, waves: Waves) -> Factor:
    """Factor of a matrix that does not change when the body turns: one of each number of waves."""
    factors = [factorise(each) for each in waves.matrices(matrix)]

    def solve(right: np.ndarray) -> np.ndarray:
        parts = waves.parts(right if right.ndim == 2 else right[:, None])
        answers = [factor.solve(part) for factor, part in zip(factors, parts, strict=True)]
        return waves.whole(answers).reshape(right.shape)

    return Factor(factors[0].solver, solve)


def _blocks(columns: int) -> Iterator[slice]:
    """Columns, some at a time: what is made of them on the way stays small."""
    for start in range(0, columns, _COLUMNS):
        yield slice(start, min(start + _COLUMNS, columns))


def _product(matrix: csr_array, motion: np.ndarray) -> np.ndarray:
    """A sparse matrix times many columns."""
    result = np.empty((order(matrix), motion.shape[1]))
    for some in _blocks(motion.shape[1]):
        result[:, some] = matrix @ motion[:, some]
    return result


def boundary_of(full: FullBody, motion: np.ndarray) -> np.ndarray:
    """Motion of the boundary in a motion of all unknowns, `[3 point, c]` to `[boundary, c]`."""
    rim, rings, averaging = _places(full)
    values = np.empty((len(rim) + len(rings) + len(averaging), motion.shape[1]))
    values[np.concatenate([rim, rings])] = motion[full.held]
    values[averaging] = full.averages @ motion
    return values


def _places(full: FullBody) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates of the rim, of rigid seats and of averaging seats."""
    rim = np.arange(3 * len(full.rim))
    starts = len(rim) + 6 * np.arange(len(full.seats))
    averaging = np.array([seat.averaging for seat in full.seats], dtype=bool)
    rings, means = (
        (starts[chosen][:, None] + np.arange(6)).ravel() for chosen in (~averaging, averaging)
    )
    return rim, rings, means


@dataclass(frozen=True)
class _Basis:
    """Shapes of the condensed coordinates, those of the rim for one sector only.

    What coordinates of the rim say to each other depends on how many sectors they are apart, if
    each is seen in the frame of its own sector.

    **Fields:**

    - `waves`: motions of the body by the number of their waves around.
    - `nodes`: rim nodes of every sector, each the image of the same before, `[sector, each]`.
    - `sector`: constraint modes of the rim nodes of the first sector, `[3 point, 3 each]`.
    - `others`: of seats, then interior shapes, `[3 point, other]`.
    """

    waves: Waves
    nodes: np.ndarray
    sector: np.ndarray
    others: np.ndarray

    @property
    def rim(self) -> int:
        """Number of coordinates of the rim."""
        return 3 * self.nodes.size

    @property
    def frames(self) -> csr_array:
        """Coordinates of the rim from the same, sector by sector, each in its own frame."""
        place = np.argsort(self.nodes.ravel())
        turns = self.waves.rotation.matrices[place // self.nodes.shape[1]]
        return bsr_array((turns, place, np.arange(len(place) + 1))).tocsr()

    def among_rim(self, apart: np.ndarray) -> np.ndarray:
        """The rim's block of a matrix.

        **Arguments:**

        - `apart`: of coordinates of a sector and of one that is so many ahead,
            `[sector, 3 each, 3 each]`.

        **Returns:**

        Shape `[rim, rim]`.
        """
        number, frames = np.arange(len(apart)), self.frames
        blocks = apart[(number - number[:, None]) % len(apart)]
        local = np.swapaxes(blocks, 1, 2).reshape(self.rim, self.rim)
        return frames @ (frames @ local.T).T

    def with_rim(self, apart: np.ndarray) -> np.ndarray:
        """Rows of the matrix from those of each sector, `[sector, row, 3 each]` to `[row, rim]`."""
        return (self.frames @ np.swapaxes(apart, 1, 2).reshape(self.rim, -1)).T

    def projected(self, matrix: csr_array, sign: float = 1.0) -> np.ndarray:
        """A matrix that does not change when the body turns, on the condensed coordinates.

        **Arguments:**

        - `matrix`: shape `[3 point, 3 point]`.
        - `sign`: 1: the matrix is symmetric; -1: skew.

        **Returns:**

        Shape `[dof, dof]`.
        """
        rim = self.rim
        result = np.zeros((rim + self.others.shape[1],) * 2)
        among, between = [], []
        shapes = (self.waves.parts(each) for each in (self.sector, self.others))
        numbers = zip(self.waves.weights, self.waves.matrices(matrix), *shapes, strict=True)
        for weight, each, sector, others in numbers:
            result[rim:, rim:] += weight * (others.conj().T @ (each @ others)).real
            for products, found in zip(
                (among, between), _products(each, sector, others, sign), strict=True
            ):
                products.append(found)
        result[:rim, :rim] = self.among_rim(self._apart(among))
        result[rim:, :rim] = self.with_rim(self._apart(between))
        result[:rim, rim:] = sign * result[rim:, :rim].T
        return (result + sign * result.T) / 2

    def _apart(self, products: Sequence[np.ndarray]) -> np.ndarray:
        """Products with the sector's shapes after turns by none, one, two sectors and so on.

        **Arguments:**

        - `products`: of amplitudes, one for every number of waves, `[row, column]`.

        **Returns:**

        Shape `[sector, row, column]`.
        """
        # Turning by one sector takes a wave back by its phase.
        sectors = self.waves.rotation.sectors
        return np.fft.irfft(np.conj(products), sectors, axis=0, norm="forward")

    def rows(self, points: np.ndarray) -> np.ndarray:
        """Motion of some points in every coordinate, `[3 point, dof]`."""
        rotation = self.waves.rotation
        source, before, apart = np.argsort(rotation.image), points, []
        for turn in rotation.matrices:
            apart.append(np.kron(np.eye(len(points)), turn) @ self.sector[dofs_of(before)])
            before = source[before]
        return np.concatenate(
            [self.with_rim(np.array(apart)), self.others[dofs_of(points)]], axis=1
        )

    def loaded(self, load: np.ndarray) -> np.ndarray:
        """A load that does not change when the body turns, on the condensed coordinates."""
        rim = self.frames @ np.tile(self.sector.T @ load, len(self.nodes))
        return np.concatenate([rim, self.others.T @ load])


def _products(
    matrix: csr_array, sector: np.ndarray, others: np.ndarray, sign: float
) -> tuple[np.ndarray, np.ndarray]:
    """Products of a sector's shapes with themselves, and of the others with them."""
    columns = sector.shape[1]
    among = np.zeros((columns, columns), dtype=sector.dtype)
    between = np.zeros((others.shape[1], columns), dtype=sector.dtype)
    # Without symmetry of rotation these are most of the work: half of the first will do.
    for some in _blocks(columns):
        moved = matrix @ sector[:, some]
        among[some.start :, some] = sector[:, some.start :].conj().T @ moved
        between[:, some] = others.conj().T @ moved
    return np.tril(among) + sign * np.tril(among, -1).conj().T, between


def _basis(full: FullBody, held: Held, rotation: Rotation, interior: np.ndarray) -> _Basis:
    """Constraint modes and interior shapes."""
    nodes = rotation.among(full.rim_points).orbits()
    boundary = 3 * len(full.rim) + 6 * len(full.seats)
    first = dofs_of(nodes[0])
    unit = np.zeros((boundary, len(first)))
    unit[first, np.arange(len(first))] = 1.0
    seats = np.eye(boundary)[:, 3 * len(full.rim) :]
    return _Basis(
        waves=waves_of(rotation),
        nodes=nodes,
        sector=held.followed(unit),
        others=np.concatenate([held.followed(seats), interior], axis=1),
    )


def _interior(
    full: FullBody, held: Held, method: str, modes: int, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Interior shapes of a method, `[3 point, shape]`, none of which moves the boundary.

    And the squares of the free frequencies that were found on the way [rad2/s2].
    """
    if method == "guyan":
        return np.zeros((3 * full.points, 0)), np.zeros(0)
    probes = np.zeros((3 * full.points, 3 * len(full.probe_points)))
    probes[dofs_of(full.probe_points), np.arange(probes.shape[1])] = 1.0
    loads = [full.centrifugal_load[:, None], probes]
    if method == "herting":
        # Inertia relief: what rigid accelerations of the body load it with.
        loads.append(full.mass @ full.rigid_motions)
    shapes = [held.loaded(np.concatenate(loads, axis=1))]
    square = np.zeros(0)
    if modes and method == "herting":
        square, free = free_modes(full, modes, rotation=held.rotation, progress=progress)
        shapes.append(free - held.followed(boundary_of(full, free)))
    elif modes:
        shapes.append(_fixed_modes(held, modes, progress))
    return _independent(full, np.concatenate(shapes, axis=1)), square


def _fixed_modes(held: Held, modes: int, progress: Progress) -> np.ndarray:
    """Modes of the body with its boundary held, `[3 point, mode]`."""
    full, inside = held.full, held.inside
    require(
        not len(held.meeting),
        "Craig-Bampton's modes are those of a body held at its seats, which seats that average "
        "are not. Make the seats rigid rings, or use Herting's modes.",
    )
    with progress(f"{modes} modes of the held body"):
        stiffness, mass = (each[inside][:, inside] for each in (full.stiffness, full.mass))
        rotation = held.rotation.among(inside[::3] // 3)
        _, shapes = lowest_modes(stiffness, mass, modes, scale_of(full), rotation)
    motion = np.zeros((3 * full.points, modes))
    motion[inside] = shapes
    return motion


def _independent(full: FullBody, shapes: np.ndarray) -> np.ndarray:
    """Modes in the space of some shapes, without those that others make up.

    Shapes come with units of their own, and inertia relief says nearly what the lowest modes say:
    all are scaled to unit energy, and combinations of none are left out.
    """
    energy = np.einsum("ij,ij->j", shapes, full.stiffness @ shapes)
    shapes = shapes[:, energy > 0] / np.sqrt(energy[energy > 0])
    if not shapes.shape[1]:
        return shapes
    weight, mixed = np.linalg.eigh(shapes.T @ (full.stiffness @ shapes))
    kept = weight > _NEW * weight[-1]
    shapes = shapes @ (mixed[:, kept] / np.sqrt(weight[kept]))
    # Of unit modal mass, and stiffest last.
    stiffness, mass = (shapes.T @ (each @ shapes) for each in (full.stiffness, full.mass))
    _, mixed = scipy.linalg.eigh(stiffness, mass)
    return shapes @ mixed


def condense(
    full: FullBody,
    *,
    method: str = "herting",
    modes: int = 50,
    rotating: bool = False,
    rotation: Rotation | None = None,
    held: Held | None = None,
    progress: Progress = silent,
) -> ReducedBody:
    r"""Condense a body on its rim and its seats.

    Interior shapes are, by method (physics.md A6):

    - "herting": modes of the free body less their static part, and the answers to rigid
      accelerations (inertia relief). Free frequencies of the modes kept are exact.
    - "craig-bampton": modes of the body held at its boundary.
    - "guyan": none; static condensation.

    Both of the first have the answers to centrifugal load and to unit loads on the probes too, so
    that these too move probes exactly in statics.

    **Arguments:**

    - `full`: the body.
    - `method`: see above.
    - `modes`: number of modes, 0 to 200.
    - `rotating`: also condense Coriolis forces, spin softening and stress stiffening.
    - `rotation`: a rotation that leaves the body as it is; the smallest one is sought without it.
        Only the columns of one sector are solved for.
    - `held`: the body with its boundary held, if that has been factorised already.
    - `progress`: told what begins.

    **Returns:**

    The condensed body.

    **Raises:**

    - `BodyError` if the method is unknown, if there are too many modes, or if the body has other
        than six rigid motions.
    """
    require(
        method in METHODS,
        "The method of condensation must be one of {known}, got {method!r}.",
        known=", ".join(METHODS),
        method=method,
    )
    require(
        0 <= modes <= MOST_MODES,
        "The number of modes must lie between 0 and {most}, got {modes}.",
        most=MOST_MODES,
        modes=modes,
    )
    held = hold(full, rotation=rotation, progress=progress) if held is None else held
    rotation = held.rotation if rotation is None else rotation
    interior, square = _interior(full, held, method, modes, progress)
    columns = 3 * len(full.rim) // rotation.sectors
    with progress(f"{columns} of {3 * len(full.rim)} columns of the rim"):
        basis = _basis(full, held, rotation, interior)
    with progress("stiffness and mass"):
        stiffness, mass = _stiffness(held, basis), basis.projected(full.mass)
    reduced = ReducedBody(
        name=full.name,
        stiffness=stiffness,
        mass=mass,
        centrifugal_load=basis.loaded(full.centrifugal_load),
        rim_nodes=full.grid.nodes[full.rim],
        rim_faces=full.rim_faces,
        seats=tuple(seat.name for seat in full.seats),
        seat_points=np.array([seat.point for seat in full.seats]).reshape(-1, 3),
        interior=interior.shape[1],
        probes=tuple(full.probes),
        probe_points=full.grid.nodes[list(full.probes.values())].reshape(-1, 3),
        probe_rows=basis.rows(full.probe_points).reshape(len(full.probes), 3, len(mass)),
        nodes=full.grid.nodes,
        bricks=full.grid.bricks,
        interior_shapes=full.on_nodes(interior),
        facts=_facts(full, method, modes, rotation, square),
    )
    if not rotating:
        return reduced
    with progress("terms of rotation"):
        return replace(reduced, **_rotating(held, basis, reduced))


def _rotating(held: Held, basis: _Basis, reduced: ReducedBody) -> dict[str, np.ndarray]:
    """Coriolis forces, spin softening, and stiffening by the stresses of the centrifugal load."""
    full = held.full
    # Of a body that is out of balance, what of the load accelerates it strains it too.
    outer = balanced(reduced.centrifugal_load, reduced.mass, reduced.rigid_motions)
    load = balanced(full.centrifugal_load, full.mass, full.rigid_motions)
    moved = floating(reduced, outer)[: reduced.boundary_dofs]
    # The boundary's motion is exact with any method, that of the inside by its own answer only.
    motion = held.followed(moved[:, None]) + held.loaded(load[:, None])
    strained = full.on_nodes(motion)[0]
    stiffening = full.across(stress_stiffening(full.grid, full.material, strained))
    return {
        "coriolis": basis.projected(full.across(coriolis(full.grid_mass)), sign=-1.0),
        "spin_softening": basis.projected(full.across(across(full.grid_mass))),
        "stress_stiffening": basis.projected(stiffening + _of_rings(full, strained)),
    }


def _of_rings(full: FullBody, strained: np.ndarray) -> csr_array:
    r"""What the forces in rigid seats, of unit speed, resist turns of the seats with.

    A ring that turns by $\theta$ moves its nodes by $\theta \times r + \theta \times (\theta
    \times r) / 2$. The forces $F$ that it puts on them work along the second part too: with
    $S = \sum F r^T$ they add $(S + S^T) / 2 - \mathrm{tr}(S) I$ to its stiffness. Without it a
    body that spins freely is not free to turn.
    """
    grid = full.grid
    rigid = rigid_motions(grid.nodes)
    load = balanced(centrifugal_load(full.grid_mass, grid.nodes), full.grid_mass, rigid)
    forces = internal_forces(grid, full.material, strained) - load.reshape(-1, 3)
    size = 3 * full.points
    result = lil_array((size, size))
    row = size - 6 * sum(not seat.averaging for seat in full.seats) + 3
    for seat in full.seats:
        if seat.averaging:
            continue
        product = forces[seat.nodes].T @ (grid.nodes[seat.nodes] - seat.point)
        turn = slice(row, row + 3)
        result[turn, turn] = (product + product.T) / 2 - np.trace(product) * np.eye(3)
        row += 6
    return csr_array(result)


def recovered(held: Held, reduced: ReducedBody, motion: np.ndarray) -> np.ndarray:
    """Motion of all nodes of the grid in motions of the condensed body.

    **Arguments:**

    - `held`: the full body with its boundary held.
    - `reduced`: the condensed body.
    - `motion`: coordinates, shape `[dof, column]` [SI].

    **Returns:**

    Shape `[column, node, 3]` [m].
    """
    outer = reduced.boundary_dofs
    shapes = np.tensordot(motion[outer:].T, reduced.interior_shapes, axes=1)
    return held.full.on_nodes(held.followed(motion[:outer])) + shapes


def _stiffness(held: Held, basis: _Basis) -> np.ndarray:
    """Condensed stiffness: forces on the boundary, and the energies of the interior shapes.

    Between both there is nothing (physics.md A6.2).
    """
    rim, seats = basis.rim, 6 * len(held.full.seats)
    result = np.zeros((rim + basis.others.shape[1],) * 2)
    columns = basis.sector.shape[1]
    apart = (basis.frames.T @ held.reaction(basis.sector)[:rim]).reshape(-1, columns, columns)
    result[:rim, :rim] = basis.among_rim(np.swapaxes(apart, 1, 2))
    forces = held.reaction(basis.others[:, :seats])
    result[: rim + seats, rim : rim + seats] = forces
    result[rim : rim + seats, :rim] = forces[:rim].T
    shapes = basis.others[:, seats:]
    result[rim + seats :, rim + seats :] = shapes.T @ (held.full.stiffness @ shapes)
    return (result + result.T) / 2


def _facts(
    full: FullBody, method: str, modes: int, rotation: Rotation, square: np.ndarray
) -> dict[str, object]:
    facts: dict[str, object] = {
        "method": method,
        "modes": modes,
        "sectors": rotation.sectors,
        "young_Pa": full.material.young,
        "poisson": full.material.poisson,
        "density_kg_m3": full.material.density,
        "seats_averaging": [seat.averaging for seat in full.seats],
        "free_frequency_Hz": (np.sqrt(square) / (2 * math.pi)).tolist(),
    }
    if full.teeth is not None:
        facts["teeth_mass_kg"] = full.teeth.mass
        facts["teeth_polar_inertia_kg_m2"] = full.teeth.polar_inertia
    return facts
