"""Spectra by orders of a gear's rotation, and the harmonics that fit what is known step by step."""

import functools
import math
from dataclasses import dataclass

import numpy as np

from jaxgear._checks import require

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


def joined_spectra(one: Spectrum, other: Spectrum) -> Spectrum:
    """The sum of two spectra of things that have the same shape."""
    orders = np.concatenate([one.order, other.order])
    _, first, place = np.unique(
        np.round(orders / SAME_ORDER), return_index=True, return_inverse=True
    )
    total = np.zeros((len(first), *one.amplitude.shape[1:]), dtype=complex)
    np.add.at(total, place, np.concatenate([one.amplitude, other.amplitude]))
    return Spectrum(orders[first], total)


def spectrum_of_steps(values: np.ndarray, lengths: np.ndarray, teeth: int) -> Spectrum:
    """Spectrum, by orders of a gear's rotation, of what repeats after whole mesh periods.

    **Arguments:**

    - `values`: in the middles of steps, shape `[step, ...]`.
    - `lengths`: of the steps of a mesh period, of which there are as many as fit [-].
    - `teeth`: of the gear.

    **Returns:**

    The spectrum, with as many harmonics of the mesh as the steps resolve well.
    """
    amplitude = fitted_harmonics(values.reshape(len(values), -1), lengths, None)
    order = np.arange(len(amplitude)) * teeth * len(lengths) / len(values)
    return Spectrum(order, amplitude.reshape(len(order), *values.shape[1:]))


def fitted_harmonics(values: np.ndarray, lengths: np.ndarray, most: int | None) -> np.ndarray:
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
    fit = short = _fit(lengths.tobytes(), -count, count + 1)
    if periods % 2 == 0:
        short = _fit(lengths.tobytes(), -count, count)
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


def values_in_steps(amplitudes: np.ndarray, lengths: np.ndarray, periods: int) -> np.ndarray:
    """Values in the middles of steps, `[harmonic, c]` to `[step, c]`: `fitted_harmonics` undone.

    Of so many mesh periods, after which they repeat; steps are as there.
    """
    middles = np.cumsum(lengths) - 0.5 * lengths
    phase = (np.arange(periods)[:, None] + middles).ravel() / periods
    turned = np.exp(2j * np.pi * np.multiply.outer(phase, np.arange(len(amplitudes))))
    return np.real(turned @ amplitudes)


# A sweep asks for those of its few grids at each speed.
@functools.lru_cache(maxsize=16)
def _fit(lengths: bytes, first: int, end: int) -> np.ndarray:
    """Amplitudes of harmonics from the first to before the end, per value times root of length."""
    steps = np.frombuffer(lengths)
    middles, weight = np.cumsum(steps) - 0.5 * steps, np.sqrt(steps)[:, None]
    phase = 2j * np.pi * np.multiply.outer(middles, np.arange(first, end))
    return np.linalg.pinv(weight * np.exp(phase))
