r"""Modes of a pair with condensed bodies as it turns: followed over speed, and where the mesh meets
them.

They are found in coordinates that stand still in space. A wave of $n$ nodal diameters of a body
that turns with $\Omega$ has from there the frequency $\omega + n\Omega$ if it runs forward, with
the body, and $\omega - n\Omega$ if it runs backward, $\omega$ being that on the body (physics A9).
The mesh stands still as well, so that its harmonic $h$ meets the wave at
$hz_1\Omega_1 = \omega \pm n\Omega$, which is the order $hz \mp n$ on the body.

All of this runs on the host and has no derivatives.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Array, Float, Int

from jaxgear._checks import require
from jaxgear._dynamics._modes import Modes, gear_parts
from jaxgear._dynamics._system import PairDynamics
from jaxgear._system._structure import BODIES

if TYPE_CHECKING:
    PinionSpeeds = np.ndarray
    Branches = np.ndarray
    BranchNumbers = np.ndarray
    ModeNumbers = Array
    ModeIntegers = np.ndarray
    ModeReals = np.ndarray
else:
    PinionSpeeds = Float[np.ndarray, "speed"]
    Branches = Float[np.ndarray, "speed mode"]
    BranchNumbers = Int[np.ndarray, "speed mode"]
    ModeIntegers = Int[np.ndarray, "mode"]
    ModeReals = Float[np.ndarray, "mode"]

# Of the energy of a wave: a larger share in one direction makes it one that runs there.
_RUNS = 0.6


class _Wave(NamedTuple):
    """Degrees of freedom of one gear that move with one number of nodal diameters.

    **Fields:**

    - `gear`: 0 for the pinion, 1 for the wheel.
    - `diameters`: $n$.
    - `dofs`: all of them, among those that move.
    - `pairs`: first and second of each pair that a turn of the gear mixes, as places in `dofs`.
    - `number`: with which the pairs turn, $n$ as far as the sectors of the body tell it apart.
    - `forward`: 1 if waves that run about +Z run with the gear, else -1.
    - `turned`: -1 if the sectors show the wave as running the other way, else 1.
    - `speed`: of the gear about +Z over the pinion's.
    """

    gear: int
    diameters: int
    dofs: np.ndarray
    pairs: np.ndarray
    number: int
    forward: int
    turned: int
    speed: float


class WaveContent(eqx.Module):
    """Which waves modes are made of, by kinetic energy.

    **Fields:**

    - `gear`: that which has the leading wave: 0 the pinion, 1 the wheel [-].
    - `diameters`: nodal diameters of the leading wave [-].
    - `share`: of the leading wave in the energy [-].
    - `own`: share of the leading wave's gear [-].
    - `forward`: of the leading wave's energy, what runs forward less what runs backward [-].
    - `mesh`: share of the mean mesh in the strain energy [-].
    """

    gear: ModeIntegers
    diameters: ModeIntegers
    share: ModeReals
    own: ModeReals
    forward: ModeReals
    mesh: ModeReals


class TurningModes(eqx.Module):
    """Modes of a pair followed over its speed; the one at rest gives each its number.

    **Fields:**

    - `speeds`: of the pinion [rad/s].
    - `frequency`: in coordinates that stand still [Hz]; negative where the gear has overtaken a
        wave that ran backward.
    - `space`: strongest frequency seen from space [Hz]. It differs where holes or spokes let waves
        be told apart only up to their number.
    - `body`: on the gear of the leading wave [Hz]; NaN where it is seen there at two frequencies,
        standing still in space.
    - `gear`, `diameters`: of the leading wave [-].
    - `direction`: 1 forward, -1 backward, 0 none: it has no diameters, or stands still in space; 2
        both: it stands still on the body [-].
    - `share`: of the leading wave in the kinetic energy [-].
    - `mesh`: share of the mean mesh in the strain energy [-].
    - `likeness`: square of the overlap with the mode at the speed before [-].
    - `teeth`: of both gears.
    """

    speeds: PinionSpeeds
    frequency: Branches
    space: Branches
    body: Branches
    gear: BranchNumbers
    diameters: BranchNumbers
    direction: BranchNumbers
    share: Branches
    mesh: Branches
    likeness: Branches
    teeth: tuple[int, int] = eqx.field(static=True)

    @property
    def ratio(self) -> np.ndarray:
        """Speed of either gear over the pinion's, without sign [-]."""
        return self.teeth[0] / np.asarray(self.teeth, dtype=float)

    def first(self, count: int) -> "TurningModes":
        """The modes that are the first at rest.

        **Arguments:**

        - `count`: of them.
        """
        names = ("frequency", "space", "body", "gear", "diameters", "direction", "share", "mesh")
        names += ("likeness",)
        few = [getattr(self, name)[:, :count] for name in names]
        return eqx.tree_at(lambda s: [getattr(s, name) for name in names], self, few)


class CriticalSpeed(NamedTuple):
    """Where a harmonic of the mesh meets a mode.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `mode`: its number at rest, from 0.
    - `harmonic`: $h$ of the mesh.
    - `gear`: of the leading wave: 0 the pinion, 1 the wheel.
    - `diameters`: of the leading wave.
    - `direction`: 1 forward, -1 backward, 0 none.
    - `space`: frequency from space [Hz].
    - `body`: frequency on the gear, NaN if it has two there [Hz].
    - `mesh`: share of the mean mesh in the strain energy [-].
    """

    speed: float
    mode: int
    harmonic: int
    gear: int
    diameters: int
    direction: int
    space: float
    body: float
    mesh: float


def wave_content(
    dynamics: PairDynamics, shapes: np.ndarray, sectors: tuple[int, int] = (0, 0)
) -> WaveContent:
    """Find nodal diameters of modes.

    **Arguments:**

    - `dynamics`: the pair.
    - `shapes`: of its degrees of freedom, as columns; complex ones are motions that rotate in
        time as $e^{i\\omega t}$.
    - `sectors`: of both bodies, which show $n$ as `sectors` less $n$; 0: not known.

    **Returns:**

    The leading wave of each mode, bodies of which only a rigid motion is known included: they
    have 0 or 1 nodal diameters.
    """
    waves, system = _waves(dynamics, sectors), dynamics.system
    mass = np.asarray(system.mass)
    energy = np.stack([_energy(mass, wave.dofs, shapes) for wave in waves])
    lead = np.argmax(energy, axis=0)
    gear = np.array([wave.gear for wave in waves])
    every = np.arange(shapes.shape[1])
    total = energy.sum(axis=0)
    own = np.where(gear[:, None] == gear[lead][None, :], energy, 0.0).sum(axis=0)
    runs = np.stack([_runs(mass, wave, shapes) for wave in waves])
    meshed = np.asarray(system.vectors).T @ shapes
    strain = _form(np.asarray(system.whole_stiffness), shapes)
    return WaveContent(
        gear=gear[lead],
        diameters=np.array([wave.diameters for wave in waves])[lead],
        share=energy[lead, every] / total,
        own=own / total,
        forward=runs[lead, every],
        mesh=np.clip(_form(np.asarray(system.mean), meshed) / strain, 0.0, 1.0),
    )


def turning_modes(
    dynamics: PairDynamics, modes: Modes, speeds: np.ndarray, sectors: tuple[int, int] = (0, 0)
) -> TurningModes:
    r"""Follow all modes of a pair with condensed bodies over its speed.

    $M\ddot x + \Omega_1 G\dot x + (\bar K + \Omega_1^2 S)x = 0$, in the coordinates of the modes at
    rest. From each speed to the next a mode is the one whose displacements and velocities are most
    like it, weighed by their energy; so it passes through those that it does not couple with.

    **Arguments:**

    - `dynamics`: the pair.
    - `modes`: of it, at rest.
    - `speeds`: of the pinion, rising [rad/s].
    - `sectors`: of both bodies, as for `wave_content`.

    **Returns:**

    All modes. The free rotation of the pair, of constant angular momentum, is none of them.
    """
    shapes, omega = np.asarray(modes.shape), 2.0 * np.pi * np.asarray(modes.frequency)
    terms = _modal_terms(dynamics, shapes)
    rows: list[list[np.ndarray]] = []
    before, waves = None, _waves(dynamics, sectors)
    for speed in np.asarray(speeds, dtype=float):
        found, states = _states(omega, terms, speed)
        likeness = np.ones(omega.size)
        if before is not None:
            found, states, likeness = _followed(before, found, states)
        before = states
        content = wave_content(dynamics, shapes @ states[omega.size :], sectors)
        rows.append([found / (2.0 * np.pi), *_seen(waves, content, found, speed), likeness])
    names = ("frequency", "space", "body", "gear", "diameters", "direction", "share", "mesh")
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    teeth = dynamics.cycle.system.pair.teeth
    return TurningModes(
        speeds=np.asarray(speeds, dtype=float),
        **dict(zip((*names, "likeness"), columns, strict=True)),
        teeth=(int(teeth[0]), int(teeth[1])),
    )


def critical_crossings(
    turning: TurningModes, harmonics: Sequence[int] = (1,)
) -> tuple[CriticalSpeed, ...]:
    r"""Speeds at which a harmonic of the mesh meets a mode seen from space.

    **Arguments:**

    - `turning`: modes over speed. Between speeds they are taken as straight.
    - `harmonics`: orders $h$ of the mesh.

    **Returns:**

    All crossings, by rising speed.

    **Raises:**

    - `ValueError` unless there are harmonics, all of at least order one.
    """
    require(
        len(harmonics) > 0 and min(harmonics) >= 1,
        "Critical speeds need harmonics of the mesh from 1 on, got {harmonics}.",
        harmonics=tuple(harmonics),
    )
    found = [
        crossing
        for mode, harmonic in itertools.product(range(turning.space.shape[1]), harmonics)
        for crossing in _crossings_of(turning, mode, harmonic)
    ]
    return tuple(sorted(found, key=lambda row: (row.speed, row.mode)))


class AloneModes(eqx.Module):
    """Modes of a gear on its bearings without mesh, and those in mesh that are most like them.

    **Fields:**

    - `frequency`: alone [Hz].
    - `diameters`: nodal diameters [-].
    - `in_mesh`: number of the mode in mesh, from 0 [-].
    - `likeness`: of both: kinetic energy of the mode in mesh in the alone mode, or in all of its
        frequency [-].
    """

    frequency: ModeReals
    diameters: ModeIntegers
    in_mesh: ModeIntegers
    likeness: ModeReals


def modes_alone(dynamics: PairDynamics, modes: Modes, gear: int) -> AloneModes:
    """Compare the modes of a gear alone with those in mesh (Guilbert 2017, Fig. III-19).

    **Arguments:**

    - `dynamics`: the pair.
    - `modes`: of it.
    - `gear`: 0 for the pinion, 1 for the wheel.

    **Returns:**

    All modes of the gear on its bearings, by rising frequency, without its free rotation.
    """
    own = np.flatnonzero(_gear_of(dynamics) == gear)
    mass = np.asarray(dynamics.system.mass)[np.ix_(own, own)]
    parts = [
        np.asarray(part) for name, part in gear_parts(dynamics) if name.startswith(BODIES[gear])
    ]
    stiffness = np.sum(parts, axis=0)[np.ix_(own, own)]
    # Rotation alone is free: a rigid motion of all its nodes.
    turn = np.asarray(dynamics.system.free)[own, 0]
    turn = turn / math.sqrt(turn @ mass @ turn)
    # It goes above all others, which then are the first.
    above = 2.0 * np.trace(np.linalg.solve(mass, stiffness))
    momentum = mass @ turn
    square, shapes = scipy.linalg.eigh(stiffness + above * np.outer(momentum, momentum), mass)
    square, shapes = square[:-1], shapes[:, :-1]
    whole = np.zeros((dynamics.system.mass.shape[0], square.size))
    whole[own] = shapes
    frequency = np.sqrt(np.clip(square, 0.0, None)) / (2.0 * np.pi)
    content = wave_content(dynamics, whole)
    same = np.cumsum(np.r_[False, np.diff(square) > _ONE_ALONE * square[1:]])
    meshed = np.asarray(modes.shape)[own]
    like = (shapes.T @ mass @ meshed) ** 2
    # Of modes of one frequency every mixture is one: what counts is their sum.
    like = np.stack([like[same == group].sum(axis=0) for group in range(same[-1] + 1)])[same]
    _, columns = scipy.optimize.linear_sum_assignment(-like)
    # Of two in mesh that go with one pair, the lower comes first.
    for group in range(same[-1] + 1):
        columns[same == group] = np.sort(columns[same == group])
    return AloneModes(
        frequency=frequency,
        diameters=content.diameters,
        in_mesh=columns,
        likeness=np.clip(like[np.arange(square.size), columns], 0.0, 1.0),
    )


# Closer than this, relatively, are one: squared frequencies of a gear alone; frequencies as it
# turns.
_ONE_ALONE, _MEETS = 1e-5, 1e-9


# --- Waves


def _gear_of(dynamics: PairDynamics) -> np.ndarray:
    """0 for degrees of freedom of the pinion, 1 for those of the wheel."""
    mapped = dynamics.cycle.system.structure.map
    numbers = np.asarray(dynamics.dofs)
    gear = (numbers >= mapped.sizes[0]).astype(int)
    for body in dynamics.bodies:
        gear[(numbers >= body.first) & (numbers < body.first + len(body.waves))] = body.index
    return gear


# Nodal diameters of displacements and rotations of a node along S, T, Z.
_NODE = np.array([1, 1, 0, 1, 1, 0])


def _waves(dynamics: PairDynamics, sectors: tuple[int, int]) -> list[_Wave]:
    """All groups of degrees of freedom of one gear and one number of nodal diameters."""
    numbers, gears = np.asarray(dynamics.dofs), _gear_of(dynamics)
    mapped = dynamics.cycle.system.structure.map
    rigid = numbers < mapped.size
    diameters = np.where(rigid, _NODE[numbers % 6], 0)
    # Of pairs the wave number, positive for the first and negative for the second.
    number = np.where(rigid & (_NODE[numbers % 6] == 1), np.where(numbers % 3 == 0, 1, -1), 0)
    teeth = dynamics.cycle.system.pair.teeth
    speed = [1.0, -teeth[0] / teeth[1]]
    for body in dynamics.bodies:
        own = (numbers >= body.first) & (numbers < body.first + len(body.waves))
        diameters[own], number[own] = body.diameters, body.waves
    found = []
    for gear, n in sorted(set(zip(gears.tolist(), diameters.tolist(), strict=True))):
        dofs = np.flatnonzero((gears == gear) & (diameters == n))
        signs = number[dofs]
        first = np.flatnonzero((signs[:-1] > 0) & (signs[1:] == -signs[:-1]))
        k = int(np.max(signs, initial=0)) if first.size else 0
        found.append(
            _Wave(
                gear=gear,
                diameters=n,
                dofs=dofs,
                pairs=np.stack([first, first + 1], axis=1),
                number=k,
                forward=1 if speed[gear] > 0.0 else -1,
                turned=_turned(n, k, sectors[gear]),
                speed=speed[gear],
            )
        )
    return found


def _turned(diameters: int, number: int, sectors: int) -> int:
    """-1 if sectors show so many diameters as a wave that runs the other way."""
    if diameters == number or number == 0:
        return 1
    return 1 if sectors and (diameters - number) % sectors == 0 else -1


def _form(matrix: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Of each shape its value of a quadratic form."""
    return np.real(np.sum(shapes.conj() * (matrix @ shapes), axis=0))


def _energy(mass: np.ndarray, dofs: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    return np.clip(_form(mass[np.ix_(dofs, dofs)], shapes[dofs]), 0.0, None)


def _runs(mass: np.ndarray, wave: _Wave, shapes: np.ndarray) -> np.ndarray:
    """Energy that runs with the gear less that which runs against it, over that of pairs."""
    if not len(wave.pairs):
        return np.zeros(shapes.shape[1])
    first, second = wave.dofs[wave.pairs.T]
    energies = []
    for way in (1.0, -1.0):
        # Of a motion exp(i omega t), the part (1, -i) of a pair turns about +Z.
        amplitude = 0.5 * (shapes[first] + 1j * way * shapes[second])
        part = np.zeros(shapes.shape, dtype=complex)
        part[first], part[second] = amplitude, -1j * way * amplitude
        energies.append(_energy(mass, wave.dofs, part))
    total = energies[0] + energies[1]
    balance = (energies[0] - energies[1]) / np.where(total > 0.0, total, 1.0)
    return wave.forward * wave.turned * balance


# --- Turning


class _Terms(NamedTuple):
    """In coordinates of the modes at rest: terms of the speed, and of its square."""

    whirl: np.ndarray
    softening: np.ndarray


def _modal_terms(dynamics: PairDynamics, shapes: np.ndarray) -> _Terms:
    system, count = dynamics.system, shapes.shape[1]
    whirl, softening = np.zeros((count, count)), np.zeros((count, count))
    if system.gyroscopic is not None:
        given = np.asarray(system.gyroscopic)
        whirl = shapes.T @ given @ shapes
        # The free rotation is as fast as its angular momentum, which stays, wants it.
        felt = shapes.T @ given @ np.asarray(system.free)
        softening = felt @ felt.T
    if system.turning is not None:
        softening = softening + shapes.T @ np.asarray(system.turning.softening) @ shapes
    return _Terms(0.5 * (whirl - whirl.T), 0.5 * (softening + softening.T))


def _states(omega: np.ndarray, terms: _Terms, speed: float) -> tuple[np.ndarray, np.ndarray]:
    r"""Frequencies [rad/s], rising, and states $(\omega_0 q, \dot q)$ of unit norm.

    Of the two frequencies $\pm\lambda$ of a mode, that of positive action. It is the positive one
    as long as rotation leaves all stiffnesses positive.
    """
    count = omega.size
    stiffness = np.diag(omega**2) + speed**2 * terms.softening
    try:
        root = np.linalg.cholesky(stiffness)
    except np.linalg.LinAlgError:
        return _states_with_overtaken(omega, terms, stiffness, speed)
    # Of (root.T q, q') the flow is antisymmetric.
    flow = np.zeros((2 * count, 2 * count))
    flow[:count, count:], flow[count:, :count] = root.T, -root
    flow[count:, count:] = -speed * terms.whirl
    values, vectors = scipy.linalg.eigh(-1j * flow, subset_by_index=(count, 2 * count - 1))
    rates = vectors[count:]
    return values, _unit(np.concatenate([omega[:, None] * rates / (1j * values), rates]))


def _states_with_overtaken(
    omega: np.ndarray, terms: _Terms, stiffness: np.ndarray, speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """As `_states` where a gear turns faster than a wave that ran backward."""
    count = omega.size
    flow = np.zeros((2 * count, 2 * count))
    flow[:count, count:] = np.eye(count)
    flow[count:, :count], flow[count:, count:] = -stiffness, -speed * terms.whirl
    values, vectors = np.linalg.eig(flow)
    turned = np.imag(values)
    moved = vectors[:count]
    felt = np.imag(np.sum(moved.conj() * (terms.whirl @ moved), axis=0))
    action = turned * np.sum(abs(moved) ** 2, axis=0) + 0.5 * speed * felt
    chosen = np.argsort(-action * abs(values))[:count]
    chosen = chosen[np.argsort(turned[chosen])]
    states = np.concatenate([omega[:, None] * moved, vectors[count:]])[:, chosen]
    return turned[chosen], _unit(states)


def _unit(states: np.ndarray) -> np.ndarray:
    return states / np.linalg.norm(states, axis=0)


def _followed(
    before: np.ndarray, found: np.ndarray, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies and states in the order of those before, and how like they are."""
    # Of states of one frequency every mixture is one: all of them together are like or not, and
    # that mixture is taken which is most like those before.
    same = np.cumsum(np.r_[False, np.diff(found) > _MEETS * abs(found[1:])])
    each = abs(before.conj().T @ states) ** 2
    like = np.stack([each[:, same == group].sum(axis=1) for group in range(same[-1] + 1)], axis=1)
    _, columns = scipy.optimize.linear_sum_assignment(-like[:, same])
    found, states, same = found[columns], states[:, columns], same[columns]
    for group in np.flatnonzero(np.bincount(same) > 1):
        mixed = same == group
        left, _, right = np.linalg.svd(states[:, mixed].conj().T @ before[:, mixed])
        states[:, mixed] = _unit(states[:, mixed] @ (left @ right))
    return found, states, abs(np.sum(before.conj() * states, axis=0)) ** 2


def _seen(
    waves: list[_Wave], content: WaveContent, omega: np.ndarray, speed: float
) -> tuple[np.ndarray, ...]:
    """Frequencies from space and on the gear, leading waves, directions, and two shares."""
    by_name = {(wave.gear, wave.diameters): wave for wave in waves}
    rows = []
    leads = zip(content.gear.tolist(), content.diameters.tolist(), strict=True)
    for lead, forward, value in zip(leads, content.forward, omega, strict=True):
        wave = by_name[lead]
        turn, n, k = abs(wave.speed) * speed, wave.diameters, wave.number
        if n == 0:
            rows.append((value, value, 0))
        elif k == 0:
            rows.append((value, value, 2))
        elif abs(forward) < 2.0 * _RUNS - 1.0:
            rows.append((value, math.nan, 0))
        else:
            way = 1 if forward > 0.0 else -1
            body = value - way * wave.turned * k * turn
            rows.append((body + way * n * turn, body, way))
    space, body, direction = (np.array(column) for column in zip(*rows, strict=True))
    hertz = 2.0 * np.pi
    found = (space / hertz, body / hertz, content.gear, content.diameters, direction)
    return (*found, content.share, content.mesh)


# --- Critical speeds


def _crossings_of(turning: TurningModes, mode: int, harmonic: int) -> Iterator[CriticalSpeed]:
    """Where one mode meets one harmonic."""
    speeds = turning.speeds
    order = harmonic * turning.teeth[0] / (2.0 * np.pi)
    for way in (1, -1):
        apart = _line(turning, mode, way) - order * speeds
        for i in np.flatnonzero(_whole_steps(turning, mode) & np.isfinite(apart[1:] * apart[:-1])):
            if not (apart[i] > 0.0 >= apart[i + 1] or apart[i] < 0.0 <= apart[i + 1]):
                continue
            part = apart[i] / (apart[i] - apart[i + 1])
            near = i + 1 if part > 0.5 else i
            gear, n = int(turning.gear[near, mode]), int(turning.diameters[near, mode])
            speed = float(speeds[i] + part * (speeds[i + 1] - speeds[i]))
            direction = int(turning.direction[near, mode])
            direction = way if direction == 2 else direction
            space = order * speed
            turned = direction * n * float(turning.ratio[gear]) * speed / (2.0 * np.pi)
            stands = direction == 0 and n > 0
            yield CriticalSpeed(
                speed=speed,
                mode=mode,
                harmonic=harmonic,
                gear=gear,
                diameters=n,
                direction=direction,
                space=space,
                body=math.nan if stands else space - turned,
                mesh=float(turning.mesh[near, mode]),
            )


def _line(turning: TurningModes, mode: int, way: int) -> np.ndarray:
    """Frequency of a mode from space; the second of two ways is only for one that has both."""
    both = turning.direction[:, mode] == 2
    n = turning.diameters[:, mode] * turning.ratio[turning.gear[:, mode]]
    shifted = turning.body[:, mode] + way * n * turning.speeds / (2.0 * np.pi)
    once = turning.space[:, mode] if way == 1 else np.full(both.shape, np.nan)
    return np.where(both, shifted, abs(once))


def _whole_steps(turning: TurningModes, mode: int) -> np.ndarray:
    """Steps of speed over which a mode is seen from space by the same wave."""
    leads = [x[:, mode] for x in (turning.gear, turning.diameters, turning.direction)]
    same = np.all([lead[1:] == lead[:-1] for lead in leads], axis=0)
    # Where all waves are told apart, the frequency from space does not depend on the leading one.
    space, own = turning.space[:, mode], turning.frequency[:, mode]
    plain = np.isclose(space, own, rtol=1e-9) & (turning.direction[:, mode] != 2)
    return same | (plain[1:] & plain[:-1])
