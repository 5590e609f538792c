"""What a sweep has found, to have it again: the way down meets what the way up has met.

And a way that is halved comes to the response at its end that was too far for one step.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxgear._dynamics._sweep_types import SweepPoint
from jaxgear._dynamics._types import Terms
from jaxgear._types import Scalar

# Approaches that differ by less than this, relative to their swing, are those of one response.
SAME = 1e-6

# So many numbers of motion are kept, 40 megabytes, or those of the last few responses: of a long
# cycle each has tens of megabytes.
_NUMBERS, _LEAST = 5_000_000, 4


@dataclass
class FoundResponse:
    """A response: its approach in mid-steps [m] and its harmonics [m, rad].

    And, as long as they are known and kept, its largest multipliers, the response itself, and what
    others have measured of it.
    """

    approach: np.ndarray
    terms: Terms
    point: SweepPoint | None
    multipliers: np.ndarray | None = None
    numbers: Any = None


class FoundResponses:
    """Settled responses by speed and number of cycles."""

    def __init__(self):
        self.all: dict[tuple[float, int], list[FoundResponse]] = {}
        self.whole: list[FoundResponse] = []

    def at(self, speed: Scalar, multiple: int) -> list[FoundResponse]:
        """Those at a speed of the pinion [rad/s] over so many cycles."""
        return self.all.get((float(speed), multiple), [])

    def same(self, point: SweepPoint) -> FoundResponse | None:
        """The one that a response is, if it was found before."""
        approach = np.asarray(point.orbit.place)[:, 0]
        for each in self.at(point.orbit.speed, point.multiple):
            if np.abs(each.approach - approach).max() <= SAME * np.ptp(approach):
                return each
        return None

    def keep(self, point: SweepPoint, terms: Terms) -> None:
        """Keep a response with its harmonics, unless it is known."""
        if self.same(point) is not None:
            return
        each = FoundResponse(np.asarray(point.orbit.place)[:, 0].copy(), terms, point)
        key = float(point.orbit.speed), point.multiple
        self.all.setdefault(key, []).append(each)
        self.whole.append(each)
        most = max(_LEAST, _NUMBERS // point.orbit.motion.size)
        while len(self.whole) > most:
            self.whole.pop(0).point = None
