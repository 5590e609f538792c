r"""What a turning condensed body shows: to gauges that ride on it, and to probes fixed in space.

Seats and modes of a body are known in coordinates that stand still in space, periodic with the
mesh: $x(\psi) = \Re\sum_m a_m e^{imZ\psi/P}$, where $\psi$ is the angle by which the gear has
turned since the cycle began, $Z$ its teeth and $P$ the mesh periods after which the response
repeats. On the body this is $z = D(-\theta)x$, $\theta = \theta_0 \pm \psi$: a wave of $k$ nodal
diameters appears at the orders $hZ \mp k$ of the gear's rotation, upper sign forward (physics A9).
A probe that stands still in space looks at other nodes all the time, and turns this back: it shows
the orders $hZ$ only, if the body is the same under each tooth.

Nothing is sampled in time: all spectra are exact sums over the harmonics of the mesh. Everything
here is plain NumPy, for what has been solved.
"""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxgear._checks import require
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._pair import GearPair

DIRECTIONS = ("radial", "tangential", "axial")

# Harmonics are fitted up to where the longest step is this part of their period: two are the least
# that tell a harmonic at all.
_RESOLVED = 0.4
# What a row of a body says of waves that it cannot have, by rounding, relative to its largest.
_NOISE = 1e-9


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
        found = np.flatnonzero(np.abs(self.order - order) < _SAME_ORDER)
        return np.asarray(self.amplitude[found].sum(axis=0))

    def strongest(self, low: float = 0.0, high: float = math.inf) -> float:
        """The order of the largest amplitude, of the largest entry if there are several [-].

        **Arguments:**

        - `low`, `high`: orders above the first and up to the second are considered [-].
        """
        size = self.size.reshape(len(self.order), -1).max(axis=1)
        considered = (self.order > low + _SAME_ORDER) & (self.order <= high + _SAME_ORDER)
        require(bool(considered.any()), "There is no order between {a:g} and {b:g}.", a=low, b=high)
        return float(self.order[np.argmax(np.where(considered, size, -1.0))])

    def _over(self, low: float) -> np.ndarray:
        return (self.order > low + _SAME_ORDER).reshape(-1, *[1] * (self.amplitude.ndim - 1))


# Orders are multiples of one over the mesh periods of a cycle, of which there are some hundreds.
_SAME_ORDER = 1e-6


@dataclass(frozen=True)
class BodyMotion:
    r"""Seats and modes of a turning condensed body in a steady response.

    **Fields:**

    - `amplitudes`: $a_m$, in coordinates that stand still in space, complex, shape
        `[harmonic, seat dof and mode]` [m, rad, m kg^1/2].
    - `turning`: $J$ of the coordinates: how they change per turn of the body, shape
        `[seat dof and mode, seat dof and mode]` [-].
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
        """Seats and modes in coordinates that stand still in space."""
        order = np.arange(len(self.amplitudes)) * self.teeth / self.periods
        return Spectrum(order, self.amplitudes)

    @functools.cached_property
    def of_body(self) -> Spectrum:
        """Seats and modes as the body has them, $z = D(-\\theta)x$."""
        waves, vectors, own = self.turned
        number, values = [], []
        for wave in np.unique(waves):
            chosen = waves == wave
            number.append(self.numbers(int(wave)))
            values.append(own[:, chosen] @ vectors[:, chosen].T)
        return self.collected(np.concatenate(number), np.concatenate(values))

    @functools.cached_property
    def turned(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


def waves_of_turning(turning: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r"""Motions that a turn changes by a phase only: $e^{\theta J}v = e^{i\lambda\theta}v$.

    **Arguments:**

    - `turning`: $J$, blocks of two that turn into each other, shape `[coordinate, coordinate]` [-].

    **Returns:**

    Whole numbers $\lambda$, shape `[vector]` [-], and the vectors, unitary together, shape
    `[coordinate, vector]` [-].
    """
    size = len(turning)
    waves = np.zeros(size, dtype=int)
    vectors = np.eye(size, dtype=complex)
    for first, second in np.argwhere(np.triu(np.abs(turning) > 0.5)):
        number = round(float(turning[second, first]))
        waves[first], waves[second] = number, -number
        vectors[[first, second], first] = np.array([1.0, -1j]) / math.sqrt(2.0)
        vectors[[first, second], second] = np.array([1.0, 1j]) / math.sqrt(2.0)
    return waves, vectors


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
    """Seats and modes of a condensed body in a steady response, by harmonics of the mesh.

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
    modes = place.first + np.arange(np.asarray(place.square).size)
    table = system.table
    periods = len(motion) // len(table.kinds) * table.periods
    lengths = np.asarray(table.lengths)[: len(table.kinds) // table.periods]
    pair = dynamics.cycle.system.pair
    return BodyMotion(
        amplitudes=_harmonics(whole[:, np.r_[list(place.seats), modes]], lengths, harmonics),
        turning=np.asarray(place.turning),
        teeth=(pair.pinion, pair.wheel)[index].teeth,
        periods=periods,
        speed=place.speed * float(orbit.speed),
        angle=start_angle(pair, index) if angle is None else angle,
    )


def _harmonics(values: np.ndarray, lengths: np.ndarray, most: int | None) -> np.ndarray:
    """Complex amplitudes that fit values in the middles of steps, `[step, c]` to `[harmonic, c]`.

    Steps repeat their lengths in each of the mesh periods. From one period to the next a harmonic
    turns by a phase of its own: those of one phase are fitted together, by the same matrix.
    """
    middles = np.cumsum(lengths) - 0.5 * lengths
    limit = 0.5 / float(lengths.max())
    count = max(1, int(_RESOLVED / float(lengths.max()))) if most is None else most
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
    - `rows`: of each gauge per seat and mode, as of `BodyBasis.motions`, shape
        `[..., seat dof and mode]` [-, m, kg^-1/2].

    **Returns:**

    Spectrum by orders of the gear's rotation, amplitude shape `[order, ...]` [m].
    """
    own = motion.of_body
    return Spectrum(own.order, np.tensordot(own.amplitude, rows, axes=([1], [rows.ndim - 1])))


def along_directions(angles: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows along radius, tangent and axis from those along x, y, z.

    **Arguments:**

    - `angles`: of the nodes about Z, from x, shape `[node]` [rad].
    - `rows`: shape `[node, 3, ...]`.

    **Returns:**

    The same shape; the tangent is that of a turn about +Z.
    """
    shape = (-1, *[1] * (rows.ndim - 2))
    cosine, sine = np.cos(angles).reshape(shape), np.sin(angles).reshape(shape)
    x, y, z = rows[:, 0], rows[:, 1], rows[:, 2]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)


def revolution(
    spectrum: Spectrum, samples: int, revolutions: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """A spectrum as a series over whole revolutions of the gear.

    **Arguments:**

    - `spectrum`: by orders of the gear's rotation.
    - `samples`: in each revolution.
    - `revolutions`: how many.

    **Returns:**

    Angle turned since the cycle began, shape `[sample]` [rad], and values, `[sample, ...]`.
    """
    angle = 2.0 * np.pi * np.arange(samples * revolutions) / samples
    return angle, spectrum.at(angle)


def band_stop(spectrum: Spectrum, bands: Sequence[tuple[float, float]]) -> Spectrum:
    """A spectrum without the orders in some bands.

    **Arguments:**

    - `spectrum`: to filter.
    - `bands`: lowest and highest order of each, both left out with all between [-].

    **Returns:**

    What is left; its phases are as they were.
    """
    kept = np.ones(len(spectrum.order), dtype=bool)
    for low, high in bands:
        kept &= (spectrum.order < low - _SAME_ORDER) | (spectrum.order > high + _SAME_ORDER)
    return Spectrum(spectrum.order[kept], spectrum.amplitude[kept])


def order_sums(spectrum: Spectrum, edges: Sequence[float] | np.ndarray) -> np.ndarray:
    """RMS of all orders in each of several bands, about the mean.

    **Arguments:**

    - `spectrum`: to sum up.
    - `edges`: of the bands, rising; an order on an edge belongs to the band below it [-].

    **Returns:**

    Shape `[band, ...]`, in the unit of the spectrum; order 0 is in none.
    """
    sums = []
    for low, high in itertools.pairwise(edges):
        inside = (spectrum.order > max(low, 0.0) + _SAME_ORDER) & (
            spectrum.order <= high + _SAME_ORDER
        )
        sums.append(np.sqrt(0.5 * np.sum(spectrum.size[inside] ** 2, axis=0)))
    return np.stack(sums)


# --- Circles of nodes, and probes that stand still in space


@dataclass(frozen=True)
class Circle:
    r"""How a circle of a body moves, by waves around it: $\Re\sum_n c_n x\,e^{in\varphi}$.

    **Fields:**

    - `number`: $n$, rising through both signs, shape `[wave]`.
    - `rows`: $c_n$, along radius, tangent and axis per seat and mode, complex, shape
        `[wave, direction, seat dof and mode]` [-, m, kg^-1/2].
    """

    number: np.ndarray
    rows: np.ndarray


def joined_circles(circles: Sequence[Circle], most: int) -> Circle:
    """Several circles in one, with three directions of each.

    **Arguments:**

    - `circles`: of one body.
    - `most`: largest number of waves around.

    **Returns:**

    The circle of all directions of the first, then of the second and so on.
    """
    number = np.arange(-most, most + 1)
    rows = [each.rows[np.searchsorted(each.number, number)] for each in circles]
    return Circle(number, np.concatenate(rows, axis=1))


def circle_of(angles: np.ndarray, rows: np.ndarray) -> Circle:
    """The waves around a circle of nodes.

    **Arguments:**

    - `angles`: of the nodes about Z, from the body's x, in any order, shape `[node]` [rad].
    - `rows`: of the nodes along x, y, z per seat and mode, shape `[node, 3, seat dof and mode]`
        [-, m, kg^-1/2].

    **Returns:**

    The circle, with as many waves as its nodes tell apart.

    **Raises:**

    - `ValueError` if there are fewer than three nodes, or they are too far apart to tell any.
    """
    ordered = np.sort(np.mod(angles, 2.0 * np.pi))
    gap = float(np.diff(np.r_[ordered, ordered[0] + 2.0 * np.pi]).max()) if len(angles) else 7.0
    even = gap * len(angles) < 2.0 * np.pi * (1.0 + 1e-6)
    most = (len(angles) - 1) // 2 if even else int(2.0 * _RESOLVED * np.pi / gap)
    require(
        most >= 1,
        "A circle needs three or more nodes all around, got {got}, up to {gap:.3g} degrees apart.",
        got=len(angles),
        gap=math.degrees(gap),
    )
    number = np.arange(-most, most + 1)
    waves = np.exp(1j * np.multiply.outer(angles, number))
    fit = waves.conj().T / len(angles) if even else np.linalg.pinv(waves)
    return Circle(number, np.tensordot(fit, along_directions(angles, rows), axes=1))


def _terms(motion: BodyMotion, circle: Circle) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    r"""Parts of a circle's motion at one $\lambda$: $\lambda$, its waves around, amplitudes.

    The amplitudes are on the body where the cycle begins, `[harmonic, wave, direction]`.
    """
    waves, vectors, own = motion.turned
    rows = circle.rows @ vectors
    scale = np.abs(vectors).T @ np.abs(circle.rows).max(axis=(0, 1))
    shown = (np.abs(rows) > _NOISE * scale).any(axis=1)
    for wave in np.unique(waves):
        chosen = waves == wave
        seen = shown[:, chosen].any(axis=1)
        if seen.any():
            part = rows[seen][:, :, chosen]
            values = own[:, chosen] @ part.reshape(-1, part.shape[2]).T
            yield int(wave), circle.number[seen], values.reshape(len(own), *part.shape[:2])


def fixed_spectrum(motion: BodyMotion, circle: Circle, angle: float) -> Spectrum:
    """What a displacement probe that stands still in space shows of what passes it.

    It reads the displacement of the point of the circle that would be at its angle if nothing
    moved but by rotation.

    **Arguments:**

    - `motion`: of the body.
    - `circle`: at which the probe looks.
    - `angle`: of the probe about Z, from S [rad].

    **Returns:**

    Spectrum by orders of the gear's rotation, amplitude along radius, tangent and axis,
    shape `[order, 3]` [m].
    """
    number, values = [], []
    for wave, around, own in _terms(motion, circle):
        where = np.exp(1j * around * (angle - motion.angle))[:, None]
        number.append(motion.numbers((wave + around)[:, None]).T.ravel())
        values.append((own * where).reshape(-1, own.shape[2]))
    return motion.collected(np.concatenate(number), np.concatenate(values))


# --- Waves that travel around the body


@dataclass(frozen=True)
class Waves:
    r"""Waves on a circle of a body, by orders: $\Re\sum a_{on} e^{i(o\psi - n\vartheta)}$.

    The angle $\vartheta$ counts from the body's x in the sense of rotation. So a wave of positive
    $n$ travels forward, one of negative $n$ backward, as seen from the body (physics A9); of order
    0 none travels, and $n$ is not negative.

    **Fields:**

    - `order`: $o$ of each wave, not negative, shape `[wave]` [-].
    - `diameters`: $n$, signed, shape `[wave]`.
    - `amplitude`: $a_{on}$ along radius, tangent and axis, complex, peak, shape
        `[wave, direction]` [m].
    - `speed`: of the gear, positive [rad/s].
    """

    order: np.ndarray
    diameters: np.ndarray
    amplitude: np.ndarray
    speed: float

    @property
    def size(self) -> np.ndarray:
        """Peak amplitudes, shape `[wave, direction]` [m]."""
        return np.abs(self.amplitude)

    @property
    def travel(self) -> np.ndarray:
        r"""Angular speed at which each wave travels around the body, $o\Omega/n$ [rad/s].

        Forward positive; infinite where the whole circle moves as one.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self.order * self.speed / self.diameters
        return np.where(self.diameters == 0, np.inf, found)

    def by_diameter(self, most: int, low: float = 0.0) -> np.ndarray:
        """RMS by nodal diameter and sense, over the circle and over time.

        **Arguments:**

        - `most`: largest number of nodal diameters.
        - `low`: orders above this one count [-].

        **Returns:**

        From the most backward to the most forward, shape `[2 most + 1, direction]` [m].
        """
        square = np.zeros((2 * most + 1, self.amplitude.shape[1]))
        chosen = (self.order > low + _SAME_ORDER) & (np.abs(self.diameters) <= most)
        np.add.at(square, self.diameters[chosen] + most, 0.5 * self.size[chosen] ** 2)
        return np.sqrt(square)

    def strongest(self, order: float | int) -> tuple[int, float]:
        """The wave that is most of an order.

        **Arguments:**

        - `order`: of the gear's rotation [-].

        **Returns:**

        Its signed nodal diameters, and its share of the mean square of that order, all directions
        together [-].
        """
        at = np.flatnonzero(np.abs(self.order - order) < _SAME_ORDER)
        require(at.size > 0, "There is no order {order:g}.", order=order)
        square = np.sum(self.size[at] ** 2, axis=1)
        best = int(np.argmax(square))
        return int(self.diameters[at[best]]), float(square[best] / max(square.sum(), 1e-300))


def waves_on_body(motion: BodyMotion, circle: Circle) -> Waves:
    """Identify the waves that travel around a circle of a body: a Fourier transform over both.

    **Arguments:**

    - `motion`: of the body.
    - `circle`: whose nodes are looked at; they tell apart fewer waves than half their number.

    **Returns:**

    All waves, by rising order, then diameters.
    """
    number, diameters, values = [], [], []
    for wave, around, own in _terms(motion, circle):
        order = np.broadcast_to(motion.numbers(wave)[:, None], own.shape[:2])
        lobes = np.broadcast_to(-motion.sense * around, own.shape[:2])
        number.append(order.ravel())
        diameters.append(lobes.ravel())
        values.append(own.reshape(-1, own.shape[2]))
    order, lobes, amplitude = map(np.concatenate, (number, diameters, values))
    # Of a negative order the same wave is that of the positive order and the other sign.
    back = (order < 0) | ((order == 0) & (lobes < 0))
    amplitude = np.where(back[:, None], amplitude.conj(), amplitude)
    order, lobes = np.abs(order), np.where(back, -lobes, lobes)
    each = 2 * int(np.abs(lobes).max(initial=0)) + 1
    keys, place = np.unique(order * each + lobes + each // 2, return_inverse=True)
    total = np.zeros((len(keys), amplitude.shape[1]), dtype=complex)
    np.add.at(total, place, amplitude)
    order, lobes = keys // each, keys % each - each // 2
    still = (order == 0) & (lobes == 0)
    total[still] = np.real(total[still])
    return Waves(order / motion.periods, lobes, total, abs(motion.speed))


def joined_waves(waves: Waves) -> Waves:
    """Waves around several circles as those of one: the root of the mean square of each.

    **Arguments:**

    - `waves`: of several circles in one, from `joined_circles`.

    **Returns:**

    Waves along radius, tangent and axis; their amplitudes have no phase.
    """
    size = waves.size.reshape(len(waves.order), -1, len(DIRECTIONS))
    return replace(waves, amplitude=np.sqrt(np.mean(size**2, axis=1)).astype(complex))
