"""Features of a sweep: peaks, leaps from branch to branch, folds; plain NumPy."""

import numpy as np

# Directions of a sweep in words.
WAYS = {"up": "speed rising", "down": "speed falling", "cold": "each speed by itself"}
# A sweep of so few speeds shows each: no step of it is a leap.
FEW = 60
# A step between neighbouring speeds is a leap if it is this share of the axis, and so many times
# larger than the steps on either side.
_LEAP, _STANDS_OUT = 0.05, 4.0
# More leaps say no more.
_LEAPS = 6


def prominent(values: np.ndarray, least: float) -> list[int]:
    """Inner maxima that stand so high above the higher of the lowest values on their two sides.

    A side ends where something is higher. `scipy.signal.find_peaks` takes a second to import.

    **Arguments:**

    - `values`: shape `[place]`.
    - `least`: prominence, in the unit of the values.

    **Returns:**

    Their places; of equal values side by side the first.
    """

    def lowest(side: np.ndarray, top: float) -> float:
        higher = np.flatnonzero(side > top)
        return float(np.min(side[: higher[0]] if higher.size else side))

    return [
        place
        for place, top in enumerate(values[1:-1], start=1)
        if values[place - 1] < top >= values[place + 1]
        and top - max(lowest(values[place::-1], top), lowest(values[place:], top)) >= least
    ]


def leaps(values: np.ndarray, shown: np.ndarray, height: float) -> np.ndarray:
    """Steps between neighbours that leap from one branch of responses to another.

    **Arguments:**

    - `values`: over rising speed, shape `[speed]`.
    - `shown`: which of them count, the same shape.
    - `height`: of the axis on which a leap is seen, in the unit of the values.

    **Returns:**

    Places of the values before the leaps, the largest leap first.
    """
    step = np.abs(np.diff(np.where(shown, values, np.nan)))
    around = np.concatenate([[np.nan] * 2, step, [np.nan] * 2])
    beside = np.stack([around[:-4], around[1:-3], around[3:-1], around[4:]])
    usual = np.max(np.where(np.isfinite(beside), beside, 0.0), axis=0)
    known = np.count_nonzero(np.isfinite(beside), axis=0) >= 2
    found = np.nonzero(known & (step > _LEAP * height) & (step > _STANDS_OUT * usual))[0]
    return found[np.argsort(-step[found], kind="stable")][:_LEAPS]


def fold_places(speed: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Points of a branch of responses where its speed turns round.

    **Arguments:**

    - `speed`: along the branch, shape `[point]` [rad/s].
    - `piece`: number of the piece that each point is of, the same shape.

    **Returns:**

    The places of the folds.
    """
    ahead = np.where(np.diff(piece) == 0, np.diff(speed), 0.0)
    return np.nonzero(ahead[1:] * ahead[:-1] < 0.0)[0] + 1
