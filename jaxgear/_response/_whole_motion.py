r"""What all of a condensed body does in a response, of which its shapes are a part.

A response is found on few shapes, loaded by few mesh coordinates. Once the forces of the cells are
known, all of the body follows from them (theory 11.8):

$$u = T s + K_s^{-1}f + X(z - \omega^{-2}X^Tf)$$

with the seats $s$, the forces $f$ on the feet, and the natural modes $X$ of which the shapes are
combinations: their motion $z$ answers to all of these forces, and to what moves the shapes besides.
The second term is that of statics; the others are here.
"""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from jaxgear._dynamics._bodies import LEAST_TURNING
from jaxgear._dynamics._damping import AbstractDamping
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._types import StepCells
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._body_motion import (
    BodyMotion,
    body_motion,
    driven_by_mesh,
    phases_of_waves,
    start_angle,
)
from jaxgear._response._dynamic import forces_in_motion
from jaxgear._response._spectrum import fitted_harmonics, values_in_steps
from jaxgear._system._body_modes import BodyModes, seat_waves
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import mode_loads


class _Wave(NamedTuple):
    """Natural modes that turn by one phase, and the seats and shapes that do.

    **Fields:**

    - `number`: $\\lambda$ of `phases_of_waves` [-].
    - `modes`, `shapes`, `seats`: which of all such motions they are.
    - `into`: the shapes by the modes, `[mode, shape]` [-].
    - `stiffness`, `rates`: of the modes alone, $\\omega^2$ and what damps them [rad2/s2, rad/s].
    - `turns`: whether the inertia of modes, then seats turns with the body.
    - `damped`: whether the damping of the modes does.
    - `mass`, `coriolis`, `softening`: on the modes, by modes and seats,
        `[mode, mode_and_seat]` [kg^1/2, -]; without terms of rotation the last two are zero.
    """

    number: int
    modes: np.ndarray
    shapes: np.ndarray
    seats: np.ndarray
    into: np.ndarray
    stiffness: np.ndarray
    rates: np.ndarray
    turns: np.ndarray
    damped: np.ndarray
    mass: np.ndarray
    coriolis: np.ndarray
    softening: np.ndarray

    def dynamic_stiffness(self, still: np.ndarray, speed: float) -> np.ndarray:
        r"""Loads on the modes by motions of modes and seats, `[harmonic, mode, mode_and_seat]`.

        **Arguments:**

        - `still`: frequency of each harmonic in space, shape `[harmonic]` [rad/s].
        - `speed`: of the body about +Z [rad/s].
        """
        on_body = still - self.number * speed
        count = len(self.modes)
        rate = 1j * np.where(self.turns, on_body[:, None], still[:, None])
        found = (rate[:, :count, None] * rate[:, None, :]) * self.mass
        found += (speed * 1j * on_body)[:, None, None] * self.coriolis + speed**2 * self.softening
        damped = 1j * np.where(self.damped, on_body[:, None], still[:, None]) * self.rates
        own = np.arange(count)
        found[:, own, own] += self.stiffness + damped
        return found

    def on_seats(self, still: np.ndarray, speed: float) -> np.ndarray:
        """Loads on the seats by motions of modes, `[harmonic, seat, mode]`: their inertia.

        Arguments as of `dynamic_stiffness`.
        """
        on_body, count = still - self.number * speed, len(self.modes)
        rate = 1j * np.where(self.turns, on_body[:, None], still[:, None])
        mass, coriolis, softening = (
            x[:, count:].conj().T for x in (self.mass, self.coriolis, self.softening)
        )
        found = (rate[:, count:, None] * rate[:, None, :count]) * mass
        return found - (speed * 1j * on_body)[:, None, None] * coriolis + speed**2 * softening


@dataclasses.dataclass(frozen=True, eq=False)
class WholeBody:
    """A condensed body on the natural modes of which its shapes are combinations.

    **Fields:**

    - `flexible`: its tables, with the natural modes.
    - `into`: the shapes by these, orthonormal, shape `[mode, shape]`, or `None`: they are these
        [-].
    - `shape_waves`: wave numbers of the shapes.
    - `damping`: of the body, which turns with its waves.
    - `rotating`: whether it was set in motion with its terms of rotation.
    """

    flexible: FlexibleBody
    into: np.ndarray | None
    shape_waves: np.ndarray
    damping: AbstractDamping
    rotating: bool

    @property
    def modes(self) -> BodyModes:
        """The natural modes."""
        assert self.flexible.modes is not None
        return self.flexible.modes

    @property
    def waves(self) -> np.ndarray:
        """Wave numbers of its seats and modes, as of a `BodyMotion`."""
        return np.r_[seat_waves(self.modes.seat_dofs), np.asarray(self.modes.waves, dtype=int)]

    @functools.cached_property
    def by_wave(self) -> list[_Wave]:
        """Its modes, apart by the phases with which they turn."""
        modes, count = self.modes, self.modes.seat_dofs
        numbers, vectors = phases_of_waves(np.asarray(modes.waves))
        of_seats, at_seats = phases_of_waves(seat_waves(count))
        of_shapes, at_shapes = phases_of_waves(self.shape_waves)
        both = scipy.sparse.block_diag([vectors, at_seats], "csr")
        turned = vectors.conj().T
        into = turned @ (np.eye(len(numbers)) if self.into is None else self.into) @ at_shapes
        order = np.r_[count : modes.size, :count]
        on_modes = lambda x: turned @ np.asarray(x)[count : modes.size][:, order] @ both
        mass = on_modes(modes.mass)
        coriolis, softening = np.zeros_like(mass), np.zeros_like(mass)
        if self.rotating:
            coriolis, softening = on_modes(modes.coriolis), on_modes(modes.softening)
        square, rates = np.asarray(modes.square), self._rates()
        damped = np.asarray(modes.diameters) >= LEAST_TURNING
        turns = self.rotating | np.r_[damped, np.zeros(count, dtype=bool)]
        found = []
        for number in np.unique(numbers):
            # Both of a pair have one frequency, and stand beside each other.
            own, ours, near = (
                np.flatnonzero(each == number) for each in (numbers, of_shapes, of_seats)
            )
            columns = np.r_[own, len(numbers) + near]
            at, among = np.ix_(own, columns), np.ix_(own, ours)
            alone = square[own], rates[own], turns[columns], damped[own]
            matrices = mass[at], coriolis[at], softening[at]
            found.append(_Wave(int(number), own, ours, near, into[among], *alone, *matrices))
        return found

    def _rates(self) -> np.ndarray:
        """Damping of each mode by itself [rad/s]."""
        one = jnp.ones((1, 1))
        of_mode = lambda square: self.damping.matrix(one, square * one, 0.0 * one)[0, 0]
        return np.asarray(jax.vmap(of_mode)(self.modes.square))


class WholeModes(NamedTuple):
    """What natural modes of a body do in a steady response, in space.

    **Fields:**

    - `motion`: of its seats, then natural modes.
    - `at_rest`: what the forces of the cells would have these modes do at rest,
        `[harmonic, mode]` [m kg^1/2].
    - `frequency`: of the harmonics [rad/s].
    """

    motion: BodyMotion
    at_rest: np.ndarray
    frequency: np.ndarray

    @property
    def seats(self) -> np.ndarray:
        """Motion of its seats, `[harmonic, seat]` [m, rad]."""
        return self.motion.amplitudes[:, : -self.at_rest.shape[1]]

    @property
    def modes(self) -> np.ndarray:
        """Motion of its natural modes, `[harmonic, mode]` [m kg^1/2]."""
        return self.motion.amplitudes[:, -self.at_rest.shape[1] :]

    @property
    def beyond(self) -> BodyMotion:
        """Seats, and natural modes beyond what they do at rest."""
        amplitudes = np.concatenate([self.seats, self.modes - self.at_rest], axis=1)
        return dataclasses.replace(self.motion, amplitudes=amplitudes)


def whole_modes(
    whole: WholeBody,
    dynamics: PairDynamics,
    orbit: Orbit,
    index: int,
    force: StepCells,
    harmonics: int,
    *,
    angle: float,
) -> WholeModes:
    r"""What natural modes do in a steady response that was found on shapes.

    **Arguments:**

    - `whole`: the body.
    - `dynamics`: the pair.
    - `orbit`: its response at one speed.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `force`: of all cells at each step, from `forces_in_motion` [N].
    - `harmonics`: of the mesh that are considered.
    - `angle`: `start_angle` of that gear [rad].

    **Returns:**

    Their motion. What stands still on the body, rotation and heat, is in it as the shapes have it.
    """
    (place,) = (each for each in dynamics.bodies if each.index == index)
    motion = body_motion(dynamics, orbit, index, angle=angle)
    kept = min(len(motion.amplitudes), harmonics * motion.periods + 1)
    seats, count = len(place.seats), len(place.waves)
    lines, gears = dynamics.cycle.cells.lines, dynamics.cycle.system.pair
    load = np.asarray(mode_loads(gears, index, whole.flexible, lines, force))
    own = np.flatnonzero(np.isin(dynamics.dofs, place.mode_dofs))
    pushed = np.asarray(orbit.load) @ np.asarray(dynamics.system.vectors)[own].T
    lengths = dynamics.system.table.period_lengths
    found = fitted_harmonics(np.concatenate([load, pushed], axis=1), lengths, None)[:kept]
    size = len(whole.modes.waves)
    pressed, pushed = found[:, :size], found[:, size:]
    moved = motion.amplitudes[:kept]
    shapes = moved[:, seats : seats + count]
    frequency = np.arange(kept) * motion.teeth / motion.periods * abs(motion.speed)
    if place.residual.size:
        beside = np.flatnonzero(np.isin(dynamics.dofs, place.residual_dofs))
        pushed = pushed + by_inertia(dynamics, orbit, own, beside, frequency)
    modes = _answered(whole, pressed, pushed, moved[:, :seats], shapes, frequency, motion.speed)
    amplitudes = np.concatenate([moved[:, :seats], modes], axis=1)
    motion = dataclasses.replace(motion, amplitudes=amplitudes, waves=whole.waves)
    return WholeModes(motion, pressed / np.asarray(whole.modes.square), frequency)


def beyond_in_steps(
    whole: WholeBody, dynamics: PairDynamics, orbit: Orbit, law: AbstractContactLaw, index: int
) -> np.ndarray:
    """Seats, and natural modes beyond what all loads give them at rest, in time.

    **Arguments:**

    - `whole`, `dynamics`, `orbit`, `index`: as of `whole_modes`.
    - `law`: with which the response was found.

    **Returns:**

    In the middles of its steps, in space, shape `[step, coordinate]` [m, rad, m kg^1/2].
    """
    angle = start_angle(dynamics.cycle.system.pair, index)
    force, driven = forces_in_motion(dynamics, orbit, law), driven_by_mesh(dynamics, orbit)
    every = len(orbit.motion)
    found = whole_modes(whole, dynamics, driven, index, force, every, angle=angle).beyond
    lengths = dynamics.system.table.period_lengths
    return values_in_steps(found.amplitudes, lengths, found.periods)


def loads_on_seats(whole: WholeBody, found: WholeModes) -> np.ndarray:
    """Loads with which the inertia of a body's natural modes meets its seats, in space.

    **Arguments:**

    - `whole`: the body.
    - `found`: what its modes do.

    **Returns:**

    Shape `[harmonic, seat]`: on the left of the equations of motion [N, N m].
    """
    _, vectors = phases_of_waves(np.asarray(whole.modes.waves))
    _, at_seats = phases_of_waves(seat_waves(whole.modes.seat_dofs))
    turned = found.modes @ vectors.conj()
    loads = np.zeros(found.seats.shape, dtype=complex)
    for wave in whole.by_wave:
        if wave.seats.size:
            matrix = wave.on_seats(found.frequency, found.motion.speed)
            loads[:, wave.seats] = (matrix @ turned[:, wave.modes, None])[:, :, 0]
    return loads @ at_seats.T


def by_inertia(
    dynamics: PairDynamics,
    orbit: Orbit,
    on: np.ndarray,
    of: np.ndarray,
    frequency: np.ndarray,
) -> np.ndarray:
    """Loads on degrees of freedom of bodies by the inertia of others, and its terms of rotation.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response.
    - `on`, `of`: places among its degrees of freedom.
    - `frequency`: of its harmonics, from the zeroth [rad/s].

    **Returns:**

    Shape `[harmonic, on]`, on the left of the equations of motion.
    """
    system, at, speed = dynamics.system, np.ix_(on, of), float(orbit.speed)
    assert system.turning is not None
    assert system.gyroscopic is not None
    stiffens = np.asarray(system.turning.stiffness_at(orbit.speed))[at]
    rates, mass = speed * np.asarray(system.gyroscopic)[at], np.asarray(system.mass)[at]
    moved = fitted_harmonics(np.asarray(orbit.motion)[:, of], system.table.period_lengths, None)
    moved, s = moved[: len(frequency)], 1j * frequency[:, None]
    return moved @ stiffens.T + s * (moved @ rates.T) + s**2 * (moved @ mass.T)


# Entries of the matrices that are solved with at once: they stay in the processor's cache.
_AT_ONCE = 20_000


def _answered(
    whole: WholeBody,
    pressed: np.ndarray,
    pushed: np.ndarray,
    seats: np.ndarray,
    shapes: np.ndarray,
    frequency: np.ndarray,
    speed: float,
) -> np.ndarray:
    r"""Motion of natural modes, `[harmonic, mode]`, of which the shapes had a part.

    What moved the shapes, $Q$ of the modes, is their own dynamic stiffness $Q^TDQ$ times their
    motion $y$. Of that the mesh coordinates' part is taken out and that of all cells put in, hence
    $D(z - Qy) = f - Qf_y - (1 - QQ^T)(DQy + D_ss)$.
    """
    waves = np.asarray(whole.modes.waves)
    _, vectors = phases_of_waves(waves)
    _, at_shapes = phases_of_waves(whole.shape_waves)
    _, at_seats = phases_of_waves(seat_waves(whole.modes.seat_dofs))
    pressed, seats = pressed @ vectors.conj(), seats @ at_seats.conj()
    pushed, shapes = (each @ at_shapes.conj() for each in (pushed, shapes))
    found = np.zeros(pressed.shape, dtype=complex)
    for wave in whole.by_wave:
        count = len(wave.modes)
        parts = max(1, min(len(frequency), len(frequency) * count**2 // _AT_ONCE))
        for some in np.array_split(np.arange(len(frequency)), parts):
            matrix = wave.dynamic_stiffness(frequency[some], speed)
            given = shapes[np.ix_(some, wave.shapes)] @ wave.into.T
            known = np.concatenate([given, seats[np.ix_(some, wave.seats)]], axis=1)
            left = (matrix @ known[:, :, None])[:, :, 0]
            left -= (left @ wave.into.conj()) @ wave.into.T
            load = pressed[np.ix_(some, wave.modes)] - left
            load += pushed[np.ix_(some, wave.shapes)] @ wave.into.T
            answer = np.linalg.solve(matrix[:, :, :count], load[:, :, None])[:, :, 0]
            found[np.ix_(some, wave.modes)] = given + answer
    return found @ vectors.T
