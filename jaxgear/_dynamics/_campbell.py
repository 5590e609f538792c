r"""Modes of a turning pair with condensed bodies over speed, and where the mesh meets them.

They are found in coordinates that stand still in space. A wave of $n$ nodal diameters of a body
that turns with $\Omega$ has from there the frequency $\omega + n\Omega$ if it runs forward, with
the body, and $\omega - n\Omega$ if it runs backward, $\omega$ being that on the body (thesis eq.
3.8, corrected). The mesh stands still as well, so that its harmonic $h$ meets the wave at
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
from jaxtyping import Float, Int

from jaxgear._checks import require
from jaxgear._dynamics._modes import Modes, gear_parts
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._wave_content import content_of, gear_of, wave_content, waves_of
from jaxgear._system._gear_body import BODIES

if TYPE_CHECKING:
    PinionSpeeds = np.ndarray
    Branches = np.ndarray
    BranchNumbers = np.ndarray
    ModeIntegers = np.ndarray
    ModeReals = np.ndarray
else:
    PinionSpeeds = Float[np.ndarray, "speed"]
    Branches = Float[np.ndarray, "speed mode"]
    BranchNumbers = Int[np.ndarray, "speed mode"]
    ModeIntegers = Int[np.ndarray, "mode"]
    ModeReals = Float[np.ndarray, "mode"]


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
    before, waves = None, waves_of(dynamics, sectors)
    for speed in np.asarray(speeds, dtype=float):
        found, states = _states(omega, terms, speed)
        likeness = np.ones(omega.size)
        if before is not None:
            found, states, likeness = _followed(before, found, states)
        before = states
        content = wave_content(dynamics, shapes @ states[omega.size :], sectors)
        rows.append([found / (2.0 * np.pi), *content_of(waves, content, found, speed), likeness])
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
    own = np.flatnonzero(gear_of(dynamics) == gear)
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
