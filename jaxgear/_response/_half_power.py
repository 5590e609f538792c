r"""What damping a response shows: half-power bandwidths, and Rayleigh coefficients from them.

A resonance is as wide as it is damped: between the frequencies at which the amplitude is
$1/\sqrt2$ of the peak's, $\Delta f_i/f_i = 2\xi_i$ (Guilbert 2017, eq. 3.10). Everything here is
plain NumPy, for curves that have been computed or measured.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from jaxgear._checks import InputError, require
from jaxgear._dynamics._damping import RayleighDamping

# So many samples must be above half the power of a peak: fewer say nothing of its shape.
_LEAST = 3
# Of a peak's height: as good as nothing.
_ZERO = 1e-6


@dataclass(frozen=True)
class Resonance:
    r"""One peak of a response, as its half-power bandwidth shows it.

    **Fields:**

    - `frequency`: of the peak, the natural frequency up to $\xi^2$ [Hz].
    - `damping_ratio`: $\xi = \Delta f/2f$ [-].
    - `amplitude`: at the peak, in the unit of the curve.
    - `lower`, `upper`: ends of the bandwidth [Hz].
    """

    frequency: float
    damping_ratio: float
    amplitude: float
    lower: float
    upper: float

    @property
    def amplification(self) -> float:
        r"""$Q = 1/2\xi$ [-]."""
        return 0.5 / self.damping_ratio


def resonances(
    frequency: np.ndarray, amplitude: np.ndarray, *, prominence: float = 0.1, throw: bool = True
) -> tuple[Resonance, ...]:
    r"""Find the peaks of a response, and how damped each is by its half-power bandwidth.

    Between samples $1/A^2$ is a parabola over $f^2$, which is exact for the displacement of one
    degree of freedom under a harmonic force. For that displacement the ratio found is
    $\xi(1 + 2\xi^2 + \ldots)$ and the frequency $f_0(1 - \xi^2 - \ldots)$. Modes less than
    several bandwidths apart add to each other, and their ratios are those of the sum; two that make
    one peak are read as one (theory 8.6).

    **Arguments:**

    - `frequency`: rising, positive, shape `[sample]` [Hz].
    - `amplitude`: of what vibrates, not negative, in any unit, shape `[sample]`. A mean that does
        not vibrate, such as the 1 of a dynamic ratio, must be taken off.
    - `prominence`: a peak stands out of its surroundings by this part of its height [-].
    - `throw`: whether to raise where a peak cannot be measured; else it is left out.

    **Returns:**

    The peaks, by rising frequency.

    **Raises:**

    - `ValueError` if the curve makes no sense, has no peak or, with `throw`, if a half-power point
        of a peak lies outside the curve, if two peaks overlap, or if one has too few samples.
    """
    frequency, amplitude = (np.asarray(x, dtype=float) for x in (frequency, amplitude))
    _check_curve(frequency, amplitude)
    tops = np.array(list(_peaks(amplitude, prominence)), dtype=int)
    require(
        tops.size > 0,
        "The response has no peak between {low:.6g} and {high:.6g} Hz that stands out by "
        "{prominence:g} of its height. Widen the range, or lower `prominence`.",
        low=frequency[0],
        high=frequency[-1],
        prominence=prominence,
    )
    found = []
    for top in tops:
        try:
            found.append(_resonance(frequency, amplitude, int(top), tops))
        except InputError:
            if throw:
                raise
    return tuple(found)


def rayleigh_damping(measured: Sequence[Resonance], *, with_mass: bool = True) -> RayleighDamping:
    r"""Rayleigh coefficients by least squares from $\xi_i = a_R/2\omega_i + b_R\omega_i/2$.

    Neither may be negative: one that would be is zero, and the other is that of the best fit
    without it (Guilbert 2017, eq. 3.12 and 3.13, theory 8.6).

    **Arguments:**

    - `measured`: peaks with their frequencies and damping ratios.
    - `with_mass`: whether there is $a_R$; without it one peak is enough.

    **Returns:**

    The damping.

    **Raises:**

    - `ValueError` if there are too few peaks of different frequencies.
    """
    omega = 2.0 * math.pi * np.array([each.frequency for each in measured])
    ratio = np.array([each.damping_ratio for each in measured])
    need = 2 if with_mass else 1
    require(
        np.unique(omega).size >= need,
        "{need} peaks of different frequencies are needed, got {got}. Give more"
        + (", or write `with_mass=False`." if with_mass else "."),
        need=need,
        got=np.unique(omega).size,
    )
    # Columns of one size: the coefficients differ by many orders of magnitude.
    middle = math.exp(float(np.mean(np.log(omega))))
    parts = [0.5 * middle / omega, 0.5 * omega / middle]
    if not with_mass:
        parts = parts[1:]
    found, _ = scipy.optimize.nnls(np.stack(parts, axis=1), ratio)
    mass = float(found[0]) * middle if with_mass else 0.0
    return RayleighDamping(mass, float(found[-1]) / middle)


# --- One peak


def _check_curve(frequency: np.ndarray, amplitude: np.ndarray) -> None:
    require(
        frequency.ndim == 1 and frequency.shape == amplitude.shape and frequency.size >= _LEAST,
        "`frequency` and `amplitude` must be two lists of one length, at least {least}, got shapes "
        "{a} and {b}.",
        least=_LEAST,
        a=frequency.shape,
        b=amplitude.shape,
    )
    require(
        bool((np.diff(frequency) > 0.0).all() and frequency[0] > 0.0),
        "`frequency` must be positive and rise from sample to sample.",
    )
    require(
        bool(np.isfinite(amplitude).all() and (amplitude >= 0.0).all()),
        "`amplitude` must be finite and not negative: give the size of a complex response.",
    )


def _peaks(amplitude: np.ndarray, prominence: float) -> Iterator[int]:
    """Samples above both neighbours that stand out: on either side it is a long way up again."""
    inner = np.arange(1, amplitude.size - 1)
    above = (amplitude[inner] > amplitude[inner - 1]) & (amplitude[inner] >= amplitude[inner + 1])
    for top in inner[above]:
        higher = np.flatnonzero(amplitude > amplitude[top])
        first = int(higher[higher < top].max(initial=0))
        last = int(higher[higher > top].min(initial=amplitude.size - 1))
        around = max(amplitude[first:top].min(), amplitude[top : last + 1].min())
        if amplitude[top] - around >= prominence * amplitude[top]:
            yield int(top)


def _resonance(
    frequency: np.ndarray, amplitude: np.ndarray, top: int, tops: np.ndarray
) -> Resonance:
    square = frequency**2
    inverse = (amplitude[top] / np.maximum(amplitude, _ZERO * amplitude[top])) ** 2
    near = slice(top - 1, top + 2)
    at, least = _lowest(square[near], inverse[near])
    require(
        least > 0.0,
        "The peak at {at:.6g} Hz is sharper than its samples show. Give more of them there.",
        at=frequency[top],
    )
    ends = [_end(frequency, inverse, 2.0 * least, top, step, tops) for step in (-1, 1)]
    inside = int(np.sum((frequency >= ends[0]) & (frequency <= ends[1])))
    require(
        inside >= _LEAST,
        "Too few samples above half the power of the peak at {at:.6g} Hz: {inside}, at least "
        "{least} are needed.",
        at=frequency[top],
        inside=inside,
        least=_LEAST,
    )
    place = math.sqrt(at)
    size = float(amplitude[top]) / math.sqrt(least)
    return Resonance(place, 0.5 * (ends[1] - ends[0]) / place, size, ends[0], ends[1])


def _end(
    frequency: np.ndarray,
    inverse: np.ndarray,
    level: float,
    top: int,
    step: int,
    tops: np.ndarray,
) -> float:
    """Where the power falls to a half on one side of a peak [Hz]."""
    side = np.arange(top, -1, -1) if step < 0 else np.arange(top, frequency.size)
    below = np.flatnonzero(inverse[side] >= level)
    last = int(side[below[0]]) if below.size else int(side[-1])
    between = tops[(tops - top) * step > 0]
    between = between[(last - between) * step > 0]
    require(
        not between.size,
        "The peaks at {a:.6g} and {b:.6g} Hz overlap: between them the response does not fall to "
        "half the power of the one at {a:.6g} Hz, so its bandwidth is not its own.",
        a=frequency[top],
        b=frequency[between[0]] if between.size else 0.0,
    )
    require(
        bool(below.size),
        "The half-power point {side} the peak at {at:.6g} Hz is outside the curve, which ends at "
        "{end:.6g} Hz. Give more of the response there.",
        side="below" if step < 0 else "above",
        at=frequency[top],
        end=frequency[side[-1]],
    )
    require(
        last != top,
        "The peak at {at:.6g} Hz is sharper than its samples show. Give more of them there.",
        at=frequency[top],
    )
    # Towards the peak, where the curve is its own.
    places = last - step * np.arange(3)
    square = frequency[places] ** 2
    slope, bend = _bent(square, inverse[places])
    # As a parabola over the share of the way from the first of the samples to the second.
    span = square[1] - square[0]
    first, third = inverse[last] - level, span**2 * bend
    second = span * slope - third
    root = math.sqrt(max(second**2 - 4.0 * third * first, 0.0))
    return math.sqrt(square[0] + 2.0 * first / (root - second) * span)


def _bent(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Divided differences of three points: slope of the first two, and how it changes."""
    slope = (y[1] - y[0]) / (x[1] - x[0])
    return slope, ((y[2] - y[1]) / (x[2] - x[1]) - slope) / (x[2] - x[0])


def _lowest(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Place and value of the lowest point of a parabola through three, of which one is lowest."""
    slope, bend = _bent(x, y)
    if bend <= 0.0:
        return float(x[1]), float(y[1])
    at = 0.5 * (x[0] + x[1] - slope / bend)
    return float(at), float(y[0] + (at - x[0]) * (slope + (at - x[1]) * bend))
