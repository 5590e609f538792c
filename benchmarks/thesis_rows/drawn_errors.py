"""Profile errors in place of the thesis's, which are a picture without numbers."""

import numpy as np

# From root to tip [-].
PLACES = np.linspace(0.0, 1.0, 41)


def profile_error(peak_to_peak: float, seed: int) -> np.ndarray:
    """A smooth profile error: one, two and three waves, the longer the larger.

    **Arguments:**

    - `peak_to_peak`: its size [m].
    - `seed`: of amplitudes and phases.

    **Returns:**

    The error from root to tip [m].
    """
    draw = np.random.default_rng(seed).uniform
    waves = [
        draw(0.5, 1.5) / n * np.cos(2.0 * np.pi * n * PLACES + draw(0.0, 2.0 * np.pi))
        for n in (1, 2, 3)
    ]
    error = np.sum(waves, axis=0)
    return peak_to_peak * (error - error.mean()) / np.ptp(error)
