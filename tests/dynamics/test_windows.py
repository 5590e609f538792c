"""Windows of instability by the first order, against products of exponentials."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from helpers import assert_close

from jaxgear._dynamics._windows import MeshVariation, windows_of

# Squares of two frequencies, their gyroscopic tie, what the mesh sees of each, its harmonic and
# the factor from the frequency of the response to the pinion's speed.
SQUARES, WHIRL, SEEN = np.diag([1.0, 3.0]), 0.4 * np.array([[0.0, 1.0], [-1.0, 0.0]]), [1.0, 0.7]
RIPPLE, UNIT = 0.02, 0.25


def _case(damping: float, whirl: np.ndarray = WHIRL, order: int = 1) -> MeshVariation:
    excess = np.zeros((9, 1, 1), dtype=complex)
    excess[order] = 0.5 * RIPPLE
    rates = 2.0 * damping * np.sqrt(SQUARES) + whirl
    parts = rates, SQUARES, np.reshape(SEEN, (2, 1)), excess, UNIT
    return MeshVariation(*map(jnp.asarray, parts))


def _growth(case: MeshVariation, speed: float, steps: int = 200) -> float:
    """Rate of growth of a disturbance, by the product of the exponentials of short steps."""
    frequency = speed / UNIT
    rates, squares, seen, excess, _ = map(np.asarray, case)
    ripple = 2.0 * excess.real
    order = np.arange(len(ripple))
    whole = np.eye(4)
    for step in range(steps):
        now = np.sum(ripple[:, 0, 0] * np.cos(2.0 * np.pi * order * (step + 0.5) / steps))
        matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-squares - now * seen @ seen.T, -rates]])
        whole = scipy.linalg.expm(2.0 * np.pi / frequency / steps * matrix) @ whole
    return np.log(np.abs(np.linalg.eigvals(whole)).max()) * frequency / (2.0 * np.pi)


def test_two_vibrations_grow_at_the_mean_of_their_frequencies():
    case = _case(5e-4)
    still = np.block([[np.zeros((2, 2)), np.eye(2)], [-SQUARES, -case.rates]])
    first, second = np.sort(np.abs(np.linalg.eigvals(still).imag))[::2]
    expected = UNIT * np.sort([2.0 * first, first + second, 2.0 * second])
    assert_close(windows_of(case), expected, rtol=1e-12, atol=0.0)
    for speed in expected:
        assert _growth(case, speed) > 1e-4
        assert _growth(case, 1.01 * speed) < 0.0
    # The second harmonic does it at half the speed.
    assert_close(windows_of(_case(5e-4, order=2)), expected / 2.0, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("whirl", [0.0 * WHIRL, WHIRL], ids=["", "gyroscopic"])
def test_what_damping_forbids_is_not_looked_at(whirl):
    """At speeds that are given the response is nearly unstable, at all others far from it."""
    centres = windows_of(_case(1e-6, whirl))
    for damping in (1e-3, 3e-3, 6e-3, 1e-2):
        case = _case(damping, whirl)
        given, calm = windows_of(case), case._replace(excess=0.0 * case.excess)
        for speed in centres:
            # Of the damping, what the mesh takes away.
            share = 1.0 - _growth(case, speed) / _growth(calm, speed)
            near = np.any(np.abs(given / speed - 1.0) < 1e-4)
            assert near == (share > 0.7) or 0.6 < share < 0.8
