r"""What a turning condensed body shows: to gauges that ride on it, and to probes fixed in space.

Seats and modes of a body are known in coordinates that stand still in space, periodic with the
mesh: $x(\psi) = \Re\sum_m a_m e^{imZ\psi/P}$, where $\psi$ is the angle by which the gear has
turned since the cycle began, $Z$ its teeth and $P$ the mesh periods after which the response
repeats. On the body this is $z = D(-\theta)x$, $\theta = \theta_0 \pm \psi$: a wave of $k$ nodal
diameters appears at the orders $hZ \mp k$ of the gear's rotation, upper sign forward (thesis eq.
3.9, its signs corrected). A probe that stands still in space looks at other nodes all the time, and
turns this back: it shows the orders $hZ$ only, if the body is the same under each tooth.

Nothing is sampled in time: all spectra are exact sums over the harmonics of the mesh. Everything
here is plain NumPy, for what has been solved.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse

from jaxgear._checks import require
from jaxgear._response._body_motion import BodyMotion
from jaxgear._response._spectrum import RESOLVED, SAME_ORDER, Spectrum

DIRECTIONS = ("radial", "tangential", "axial")

# What a row of a body says of waves that it cannot have, by rounding, relative to its largest.
_NOISE = 1e-9


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
        inside = (spectrum.order > max(low, 0.0) + SAME_ORDER) & (
            spectrum.order <= high + SAME_ORDER
        )
        sums.append(np.sqrt(0.5 * np.sum(spectrum.size[inside] ** 2, axis=0)))
    return np.stack(sums)


# --- Circles of nodes, and probes that stand still in space


@dataclass(frozen=True)
class Circle:
    r"""How a circle of a body moves, by waves around it: $\Re\sum_n c_n x\,e^{in\varphi}$.

    **Fields:**

    - `number`: $n$, rising through both signs, shape `[wave]`.
    - `rows`: $c_n$, along radius, tangent and axis per coordinate of a `BodyMotion`, complex,
        shape `[wave, direction, coordinate]` [-, m, kg^-1/2].
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
    """The waves around a circle of nodes: of their displacements.

    **Arguments:**

    - `angles`: of the nodes about Z, from the body's x, in any order, shape `[node]` [rad].
    - `rows`: of the nodes along x, y, z per coordinate of a `BodyMotion`, shape
        `[node, 3, coordinate]` [-, m, kg^-1/2].

    **Returns:**

    The circle, with as many waves as its nodes tell apart.

    **Raises:**

    - `ValueError` if there are fewer than three nodes, or they are too far apart to tell any.
    """
    return circle_around(angles, along_directions(angles, rows))


def circle_around(angles: np.ndarray, rows: np.ndarray) -> Circle:
    """The waves around a circle of nodes: of whatever turns with them.

    **Arguments:**

    - `angles`: of the nodes about Z, from the body's x, in any order, shape `[node]` [rad].
    - `rows`: of what is told of each node in its own directions per coordinate, shape
        `[node, ..., coordinate]` [any unit].

    **Returns:**

    The circle, with as many waves as its nodes tell apart.

    **Raises:**

    - `ValueError` if there are fewer than three nodes, or they are too far apart to tell any.
    """
    ordered = np.sort(np.mod(angles, 2.0 * np.pi))
    gap = float(np.diff(np.r_[ordered, ordered[0] + 2.0 * np.pi]).max()) if len(angles) else 7.0
    even = gap * len(angles) < 2.0 * np.pi * (1.0 + 1e-6)
    most = (len(angles) - 1) // 2 if even else int(2.0 * RESOLVED * np.pi / gap)
    require(
        most >= 1,
        "A circle needs three or more nodes all around, got {got}, up to {gap:.3g} degrees apart.",
        got=len(angles),
        gap=math.degrees(gap),
    )
    number = np.arange(-most, most + 1)
    waves = np.exp(1j * np.multiply.outer(angles, number))
    fit = waves.conj().T / len(angles) if even else np.linalg.pinv(waves)
    return Circle(number, np.tensordot(fit, rows, axes=1))


def _terms(motion: BodyMotion, circle: Circle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r"""Parts of a circle's motion: $\lambda$ of each, its waves around, and its amplitudes.

    The amplitudes are on the body where the cycle begins, `[harmonic, part, direction]`.
    """
    waves, vectors, own = motion.turned
    flat = circle.rows.reshape(-1, circle.rows.shape[2])
    rows = (flat @ vectors).reshape(circle.rows.shape)
    scale = abs(vectors).T @ np.abs(flat).max(axis=0)
    # Of equal sectors a vector shows in few waves. Vectors of one phase are one part.
    place, vector = np.nonzero((np.abs(rows) > _NOISE * scale).any(axis=1))
    count = len(circle.number)
    parts, part = np.unique(waves[vector] * count + place, return_inverse=True)
    size, found = (len(waves), len(parts)), []
    for direction in range(rows.shape[1]):
        values = rows[place, direction, vector]
        found.append(own @ scipy.sparse.csr_array((values, (vector, part)), shape=size))
    return parts // count, circle.number[parts % count], np.stack(found, axis=2)


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
    wave, around, own = _terms(motion, circle)
    where = np.exp(1j * around * (angle - motion.angle))[:, None]
    number = motion.numbers((wave + around)[:, None]).T.ravel()
    return motion.collected(number, (own * where).reshape(-1, own.shape[2]))


def seen_passing(
    angles: np.ndarray, angle: float, readings: np.ndarray, turn: np.ndarray
) -> np.ndarray:
    """What stands still and looks at a circle of nodes shows of what these read.

    **Arguments:**

    - `angles`: of the nodes about Z, from the body's x, shape `[node]` [rad].
    - `angle`: of what stands still, from S [rad].
    - `readings`: of the nodes, in their own directions, shape `[step, node, ...]`.
    - `turn`: of the body's x from S, shape `[step]` [rad].

    **Returns:**

    Shape `[step, ...]`.
    """
    around = circle_around(angles, np.moveaxis(readings, 1, 0))
    waves = np.exp(1j * np.multiply.outer(around.number, angle - turn))
    return np.real(np.einsum("np,np...->p...", waves, around.rows))


# --- Waves that travel around the body


@dataclass(frozen=True)
class Waves:
    r"""Waves on a circle of a body, by orders: $\Re\sum a_{on} e^{i(o\psi - n\vartheta)}$.

    The angle $\vartheta$ counts from the body's x in the sense of rotation. So a wave of positive
    $n$ travels forward, one of negative $n$ backward, as seen from the body (thesis eq. 3.6); of
    order 0 none travels, and $n$ is not negative.

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
        chosen = (self.order > low + SAME_ORDER) & (np.abs(self.diameters) <= most)
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
        at = np.flatnonzero(np.abs(self.order - order) < SAME_ORDER)
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
    wave, around, own = _terms(motion, circle)
    order = motion.numbers(wave[:, None]).T.ravel()
    lobes = np.broadcast_to(-motion.sense * around, own.shape[:2]).ravel()
    amplitude = own.reshape(-1, own.shape[2])
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
