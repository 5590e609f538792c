"""Motion of a condensed body by its waves, as seen from the body and from the ground."""

import functools
import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse

from jaxgear._checks import require
from jaxgear._dynamics._bodies import BodyPlace
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_modes import turning_of_waves

# Harmonics are fitted up to where the longest step is this part of their period: two are the least
# that tell a harmonic at all.
RESOLVED = 0.4


@dataclass(frozen=True)
class Spectrum:
    r"""Something real by orders of a gear's rotation: $\Re\sum_o a_o e^{io\psi}$.

    **Fields:**

    - `order`: $o$, not negative, rising, shape `[order]` [-].
    - `amplitude`: $a_o$, complex, peak, shape `[order, ...]` [unit of what it is].
    """

    order: np.ndarray
    amplitude: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """Peak amplitudes; of order 0 the mean without its sign."""
        return np.abs(self.amplitude)

    @property
    def mean_square(self) -> np.ndarray:
        """Mean square about the mean, by Parseval [square of the unit]."""
        square = np.where(self._over(0.0), self.size, 0.0) ** 2
        return np.asarray(0.5 * np.sum(square, axis=0))

    def at(self, angle: np.ndarray) -> np.ndarray:
        """Values where the gear has turned by so much since the cycle began.

        **Arguments:**

        - `angle`: $\\psi$, positive, shape `[step]` [rad].

        **Returns:**

        Shape `[step, ...]`.
        """
        moved = np.flatnonzero(np.abs(self.amplitude).reshape(len(self.order), -1).any(axis=1))
        turned = np.exp(1j * np.multiply.outer(np.asarray(angle), self.order[moved]))
        return np.real(np.tensordot(turned, self.amplitude[moved], axes=1))

    def near(self, order: float | int) -> np.ndarray:
        """Amplitude at one order, zero where there is none; as `amplitude`, without its first axis.

        **Arguments:**

        - `order`: wanted [-].
        """
        found = np.flatnonzero(np.abs(self.order - order) < SAME_ORDER)
        return np.asarray(self.amplitude[found].sum(axis=0))

    def strongest(self, low: float = 0.0, high: float = math.inf) -> float:
        """The order of the largest amplitude, of the largest entry if there are several [-].

        **Arguments:**

        - `low`, `high`: orders above the first and up to the second are considered [-].
        """
        size = self.size.reshape(len(self.order), -1).max(axis=1)
        considered = (self.order > low + SAME_ORDER) & (self.order <= high + SAME_ORDER)
        require(bool(considered.any()), "There is no order between {a:g} and {b:g}.", a=low, b=high)
        return float(self.order[np.argmax(np.where(considered, size, -1.0))])

    def _over(self, low: float) -> np.ndarray:
        return (self.order > low + SAME_ORDER).reshape(-1, *[1] * (self.amplitude.ndim - 1))


# Orders are multiples of one over the mesh periods of a cycle, of which there are some hundreds.
SAME_ORDER = 1e-6


@dataclass(frozen=True)
class BodyMotion:
    r"""Motion of a turning condensed body in a steady response.

    Its coordinates are seats and modes, and parts of its residual shapes: of each wave, and each
    shape, a pair that turns as modes of that wave do.

    **Fields:**

    - `amplitudes`: $a_m$, in coordinates that stand still in space, complex, shape
        `[harmonic, coordinate]` [m, rad, m kg^1/2].
    - `turning`: $J$ of the coordinates: how they change per turn of the body, shape
        `[coordinate, coordinate]` [-].
    - `teeth`: $Z$ of the gear.
    - `periods`: $P$, mesh periods after which the response repeats.
    - `speed`: of the gear about +Z [rad/s].
    - `angle`: $\theta_0$, of the body's x from S where the cycle begins [rad].
    """

    amplitudes: np.ndarray
    turning: np.ndarray
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
        r"""Motions that turn by a phase, $\lambda$ and $v$ of `waves_of_turning`, as they are.

        The last are their amplitudes on the body where the cycle begins, `[harmonic, vector]`.
        """
        waves, vectors = waves_of_turning(self.turning)
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


def waves_of_turning(turning: np.ndarray) -> tuple[np.ndarray, scipy.sparse.csr_array]:
    r"""Motions that a turn changes by a phase only: $e^{\theta J}v = e^{i\lambda\theta}v$.

    **Arguments:**

    - `turning`: $J$, blocks of two that turn into each other, shape `[coordinate, coordinate]` [-].

    **Returns:**

    Whole numbers $\lambda$, shape `[vector]` [-], and the vectors, unitary together, each of one
    coordinate or two, shape `[coordinate, vector]` [-].
    """
    size = len(turning)
    waves, own = np.zeros(size, dtype=int), np.ones(size, dtype=complex)
    first, second = np.nonzero(np.triu(np.abs(turning) > 0.5))
    waves[first] = np.round(turning[second, first]).astype(int)
    waves[second] = -waves[first]
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
    """Motion of a condensed body in a steady response, by harmonics of the mesh.

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
    lengths = np.asarray(table.lengths)[: len(table.kinds) // table.periods]
    pair = dynamics.cycle.system.pair
    chosen = np.r_[list(place.seats), place.mode_dofs, place.residual_dofs]
    amplitudes, turning = _by_parts(place, _harmonics(whole[:, chosen], lengths, harmonics))
    return BodyMotion(
        amplitudes=amplitudes,
        turning=turning,
        teeth=(pair.pinion, pair.wheel)[index].teeth,
        periods=periods,
        speed=place.speed * float(orbit.speed),
        angle=start_angle(pair, index) if angle is None else angle,
    )


def _by_parts(place: BodyPlace, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parts of residual shapes in place of these, `[harmonic, coordinate]`, and how all turn.

    In space each of its waves is as large as the shape, and their partners are not there.
    """
    turning, waves = np.asarray(place.turning), place.residual_waves
    size = len(turning)
    residual = found[:, size:]
    parts = np.zeros((len(found), len(waves), residual.shape[1], 2), dtype=complex)
    parts[..., 0] = residual[:, None, :]
    amplitudes = np.concatenate([found[:, :size], parts.reshape(len(found), -1)], axis=1)
    pairs = np.kron(np.repeat(waves, residual.shape[1]), np.array([1, -1]))
    return amplitudes, np.asarray(scipy.linalg.block_diag(turning, turning_of_waves(pairs)))


def _harmonics(values: np.ndarray, lengths: np.ndarray, most: int | None) -> np.ndarray:
    """Complex amplitudes that fit values in the middles of steps, `[step, c]` to `[harmonic, c]`.

    Steps repeat their lengths in each of the mesh periods. From one period to the next a harmonic
    turns by a phase of its own: those of one phase are fitted together, by the same matrix.
    """
    middles = np.cumsum(lengths) - 0.5 * lengths
    limit = 0.5 / float(lengths.max())
    count = max(1, int(RESOLVED / float(lengths.max()))) if most is None else most
    require(
        1 <= count < limit,
        "The time steps resolve fewer than {limit:.4g} harmonics of the mesh frequency, got "
        "{got}: raise the number of steps, or ask for fewer.",
        limit=limit,
        got=count,
    )
    periods = len(values) // len(lengths)
    series = values.reshape(periods, len(lengths), -1)
    phases = np.fft.fft(series, axis=0, norm="forward")
    weight = np.sqrt(lengths)[:, None]
    numbers = np.arange(-count, count + 1)
    fit = np.linalg.pinv(weight * np.exp(2j * np.pi * np.multiply.outer(middles, numbers)))
    short = fit
    if periods % 2 == 0:
        own = weight * np.exp(2j * np.pi * np.multiply.outer(middles, numbers[:-1]))
        short = np.linalg.pinv(own)
    found = np.zeros((count * periods + (periods + 1) // 2, series.shape[2]), dtype=complex)
    for residue in range(periods):
        phase = residue if 2 * residue <= periods else residue - periods
        back = np.exp(-2j * np.pi * phase * middles / periods)[:, None]
        half = 2 * phase == periods
        own = (short if half else fit) @ (weight * back * phases[residue])
        harmonic = phase + periods * (numbers[:-1] if half else numbers)
        kept = (harmonic >= 0) & (harmonic < len(found))
        found[harmonic[kept]] = own[kept]
    found[1:] *= 2.0
    found[0] = np.real(found[0])
    return found


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
