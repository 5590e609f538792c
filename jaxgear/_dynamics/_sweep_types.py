"""What a speed sweep is asked, and what it finds at one speed."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from jaxgear._checks import require
from jaxgear._dynamics._floquet import STABLE
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import TimeStepping
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._shooting import Shooting

Direction = Literal["up", "down", "cold"]
# Those of a sweep that come to the same response.
Ways = tuple[Direction, ...]


@dataclass(frozen=True)
class SweepPoint:
    """The response at one speed of a sweep.

    `multiple` is the number of cycles that `orbit` covers; it repeats after these if it has
    settled. `multipliers` are the largest of Floquet's; a march has none, for what it settles on is
    stable.
    """

    orbit: Orbit
    multiple: int
    multipliers: np.ndarray

    @property
    def settled(self) -> bool:
        """Whether the response repeats."""
        return bool(self.orbit.settled)

    @property
    def stable(self) -> bool:
        """Whether it has settled, and a machine stays on it."""
        return self.settled and bool(np.abs(self.multipliers).max(initial=0.0) <= STABLE)


@dataclass(frozen=True)
class SweepSettings:
    """How a sweep goes about it.

    `method` is that of the whole sweep, and has its contact law. With harmonic balance, what its
    Newton's method cannot follow is looked for by `shooting`, after `cycles` of time stepping from
    the last motion; a speed without a periodic response keeps the last `kept` of them.
    """

    method: HarmonicBalance | Shooting | TimeStepping = field(default_factory=HarmonicBalance)
    shooting: Shooting = field(default_factory=lambda: Shooting(warm_up=0, most_steps=10))
    cycles: int = 100
    kept: int = 10

    def __post_init__(self):
        require(
            self.cycles >= 1 and self.kept >= 1,
            "`SweepSettings.cycles` and `kept` must be at least 1, got {cycles} and {kept}.",
            cycles=self.cycles,
            kept=self.kept,
        )
        require(
            self.method.multiple == 1,
            "A sweep finds by itself after how many cycles a response repeats: leave `multiple` of "
            "its method at 1, got {got}.",
            got=self.method.multiple,
        )
