"""Motion of a condensed body by its waves, as seen from the body and from the ground."""

import functools
import math
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._pair import GearPair
from jaxgear._response._spectrum import SAME_ORDER, Spectrum, fitted_harmonics
from jaxgear._system._body_modes import seat_waves
from jaxgear._types import Reals


@dataclass(frozen=True)
class BodyMotion:
    r"""Motion of a turning condensed body in a steady response.

    Its coordinates are seats and modes.

    **Fields:**

    - `amplitudes`: $a_m$, in coordinates that stand still in space, complex, shape
        `[harmonic, coordinate]` [m, rad, m kg^1/2]; or those of several such motions, side by side.
    - `waves`: wave number of each coordinate of one, of the second of a pair below zero, as of
        `BodyBasis`.
    - `teeth`: $Z$ of the gear.
    - `periods`: $P$, mesh periods after which the response repeats.
    - `speed`: of the gear about +Z [rad/s].
    - `angle`: $\theta_0$, of the body's x from S where the cycle begins [rad].
    """

    amplitudes: np.ndarray
    waves: np.ndarray
    teeth: int
    periods: int
    speed: float
    angle: float

    @property
    def sense(self) -> int:
        """1 if the gear turns about +Z, -1 if it turns about -Z."""
        return 1 if self.speed > 0.0 else -1

    @property
    def standing(self) -> Spectrum:
        """The coordinates that stand still in space."""
        order = np.arange(len(self.amplitudes)) * self.teeth / self.periods
        return Spectrum(order, self.amplitudes)

    def on_body(self, order: float | int) -> np.ndarray:
        r"""Amplitude of one order of the coordinates as the body has them, $z = D(-\theta)x$.

        **Arguments:**

        - `order`: of the gear's rotation [-].

        **Returns:**

        Complex, shape `[coordinate]`; zero if there is no such order.
        """
        waves, vectors, own = self.turned
        found = np.zeros(len(waves), dtype=complex)
        wanted = round(order * self.periods)
        if abs(wanted - order * self.periods) > SAME_ORDER * self.periods:
            return found
        for wave in np.unique(waves):
            number, chosen = self.numbers(int(wave)), waves == wave
            ahead, back = (own[number == each][:, chosen].sum(axis=0) for each in (wanted, -wanted))
            found += vectors[:, chosen] @ ahead + (vectors[:, chosen] @ back).conj()
        # Of order 0 both are the same.
        return found if wanted else 0.5 * found

    @functools.cached_property
    def turned(self) -> tuple[np.ndarray, scipy.sparse.csr_array, np.ndarray]:
        r"""Motions that turn by a phase, $\lambda$ and $v$ of `phases_of_waves`, as they are.

        The last are their amplitudes on the body where the cycle begins, `[harmonic, vector]`.
        """
        waves, vectors = phases_of_waves(self.waves)
        motions = self.amplitudes.shape[1] // len(self.waves)
        if motions > 1:
            each = scipy.sparse.eye_array(motions)
            waves, vectors = np.tile(waves, motions), scipy.sparse.kron(each, vectors, "csr")
        own = (self.amplitudes @ vectors.conj()) * np.exp(-1j * waves * self.angle)
        return waves, vectors, own

    def numbers(self, wave: int | np.ndarray) -> np.ndarray:
        r"""$P$ times the order of each harmonic of what turns by $-\lambda\theta$."""
        harmonic = np.arange(len(self.amplitudes))
        return harmonic * self.teeth - self.sense * wave * self.periods

    def collected(self, number: np.ndarray, values: np.ndarray) -> Spectrum:
        """A spectrum of terms at so many parts of an order, which may be negative."""
        back = number < 0
        values = np.where(back.reshape(-1, *[1] * (values.ndim - 1)), values.conj(), values)
        order, place = np.unique(np.abs(number), return_inverse=True)
        total = np.zeros((len(order), *values.shape[1:]), dtype=complex)
        np.add.at(total, place, values)
        # Of what does not move only the real part is there.
        if order[0] == 0:
            total[0] = np.real(total[0])
        return Spectrum(order / self.periods, total)


def phases_of_waves(numbers: np.ndarray) -> tuple[np.ndarray, scipy.sparse.csr_array]:
    r"""Motions that a turn changes by a phase only: $e^{\theta J}v = e^{i\lambda\theta}v$.

    **Arguments:**

    - `numbers`: wave number of each coordinate, of the second of a pair below zero, which tell $J$
        (`turning_of_waves`), shape `[coordinate]`.

    **Returns:**

    Whole numbers $\lambda$, shape `[vector]` [-], and the vectors, unitary together, each of one
    coordinate or two, shape `[coordinate, vector]` [-].
    """
    size, second = len(numbers), np.flatnonzero(numbers < 0)
    first = second - 1
    waves, own = np.zeros(size, dtype=int), np.ones(size, dtype=complex)
    waves[first], waves[second] = -numbers[second], numbers[second]
    root = math.sqrt(0.5)
    own[first], own[second] = root, 1j * root
    beside = np.full(first.size, root, dtype=complex)
    every = np.arange(size)
    values = np.concatenate([own, -1j * beside, beside])
    places = np.concatenate([every, second, first]), np.concatenate([every, first, second])
    return waves, scipy.sparse.csr_array((values, places), shape=(size, size))


def start_angle(pair: GearPair, index: int) -> float:
    """Angle of a body's x from S, about Z, where the cycle begins: tooth 0 enters at mid-face.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.

    **Returns:**

    The angle [rad].
    """
    roll = float(pair.path_start)
    own = roll if index == 0 else float(pair.tangent_length) - roll
    middle = own / float(pair.base_radius[index]) - float(pair.half_thickness_at_base[index])
    return middle - float(pair.working_pressure_angle) + (0.0 if index == 0 else math.pi)


def body_motion(
    dynamics: PairDynamics,
    orbit: Orbit,
    index: int,
    harmonics: int | None = None,
    *,
    angle: float | None = None,
) -> BodyMotion:
    """Motion of a condensed body in a steady response: seats and modes, by harmonics of the mesh.

    The steps of a cycle are not all of one length; the harmonics are those that fit the motion in
    the middles of the steps best, in the mean over time. A response by harmonic balance they meet.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response at one speed.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `harmonics`: of the mesh frequency; by default as many as the steps resolve well.
    - `angle`: `start_angle` of that gear, where it is known already [rad].

    **Returns:**

    The motion.

    **Raises:**

    - `ValueError` if that gear is not condensed, or the steps do not resolve the harmonics.
    """
    name = ("pinion", "wheel")[index]
    place = next((each for each in dynamics.bodies if each.index == index), None)
    require(
        place is not None, "The {name} has no condensed body: there are no waves in it.", name=name
    )
    assert place is not None
    system = dynamics.system
    motion = np.asarray(orbit.motion)
    whole = np.zeros((len(motion), max(dynamics.dofs) + 1))
    whole[:, list(dynamics.dofs)] = motion
    table = system.table
    periods = len(motion) // len(table.kinds) * table.periods
    pair = dynamics.cycle.system.pair
    chosen = np.r_[list(place.seats), place.mode_dofs]
    return BodyMotion(
        amplitudes=fitted_harmonics(whole[:, chosen], table.period_lengths, harmonics),
        waves=np.r_[seat_waves(len(place.seats)), np.asarray(place.waves, dtype=int)],
        teeth=(pair.pinion, pair.wheel)[index].teeth,
        periods=periods,
        speed=place.speed * float(orbit.speed),
        angle=start_angle(pair, index) if angle is None else angle,
    )


@compiled
def beyond_rest(dynamics: PairDynamics, orbit: Orbit) -> Orbit:
    r"""A response whose modes and residual shapes do only what they do not do at rest.

    Of each of these $q$ what is left is $q - f/\omega^2$, with the load $f$ that acts on it at that
    moment. The part at rest is that of the body as a whole, which its static answers have without
    any choice of modes: mode acceleration (Craig and Kurdila 2006; theory 11.7).

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response.

    **Returns:**

    The response.
    """
    system = dynamics.system
    load = system.load_at(orbit.speed)[None] - orbit.load @ system.vectors.T
    return _without(dynamics, orbit, load)


@compiled
def driven_by_mesh(dynamics: PairDynamics, orbit: Orbit) -> Orbit:
    """A response without what rotation and heat do to modes and residual shapes at rest.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response.

    **Returns:**

    The response.
    """
    return _without(dynamics, orbit, dynamics.system.load_at(orbit.speed)[None])


def _without(dynamics: PairDynamics, orbit: Orbit, load: Reals) -> Orbit:
    """A response without what loads give modes and residual shapes at rest."""
    give = jnp.zeros(max(dynamics.dofs) + 1)
    for body in dynamics.bodies:
        give = give.at[body.mode_dofs].set(1.0 / body.square)
        give = give.at[body.residual_dofs].set(1.0 / body.residual)
    motion = orbit.motion - load * give[None, np.asarray(dynamics.dofs)]
    return eqx.tree_at(lambda each: each.motion, orbit, motion)


# --- Gauges that turn with the body


def rotating_spectrum(motion: BodyMotion, rows: np.ndarray) -> Spectrum:
    r"""What gauges that turn with a body show.

    **Arguments:**

    - `motion`: of the body.
    - `rows`: of each gauge per coordinate of that motion, shape `[..., coordinate]`
        [-, m, kg^-1/2].

    **Returns:**

    Spectrum by orders of the gear's rotation, amplitude shape `[order, ...]` [m].
    """
    waves, vectors, own = motion.turned
    # Of the rows first: of all coordinates there are far more.
    flat = rows.reshape(-1, rows.shape[-1]) @ vectors
    number, values = [], []
    for wave in np.unique(waves):
        number.append(motion.numbers(int(wave)))
        values.append(own[:, waves == wave] @ flat[:, waves == wave].T)
    found = motion.collected(np.concatenate(number), np.concatenate(values))
    return Spectrum(found.order, found.amplitude.reshape(-1, *rows.shape[:-1]))
