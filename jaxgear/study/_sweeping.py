"""Sweeping a scene: the response at each speed, and the branch followed round its folds."""

import concurrent.futures
import contextvars
import dataclasses
import functools
import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._dynamics._continuation import Curve, continuation
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._sweep import Finder
from jaxgear._dynamics._sweep_types import Direction, SweepPoint, Ways
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._table import ready_to_bear
from jaxgear._dynamics._types import Terms
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._measured import Measured, measured
from jaxgear.scene._tables import SweepKeys
from jaxgear.study._dynamics import (
    Dynamics,
    directions_of,
    is_followed,
    settings_of,
    size_of,
    speeds_of,
)
from jaxgear.study._progress import say
from jaxgear.study._statics import SolverFailure

# Settled responses whose dynamic ratios differ by more than this, relative to them, are two.
_SAME = 1e-3


class Response(NamedTuple):
    """A response at one speed.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `settled`, `stable`: whether it repeats, and whether a machine stays on it.
    - `periods`: length of the series in mesh periods; if it has settled, it repeats after them.
    - `residual`: relative imbalance, or change over a cycle [-].
    - `multiplier`: size of the largest of Floquet's, or `None` where none is known [-].
    - `numbers`: of it, in SI.
    """

    speed: float
    settled: bool
    stable: bool
    periods: int
    residual: float
    multiplier: float | None
    numbers: Measured

    @property
    def dynamic_ratio(self) -> float:
        """Largest total contact force over the static one [-]."""
        return float(self.numbers.dynamic_ratio)

    @property
    def is_finite(self) -> bool:
        """Whether all of it are finite numbers."""
        return all(np.isfinite(x).all() for x in (self.residual, *self.numbers))

    def differs(self, other: "Response") -> bool:
        """Whether both have settled, on two branches."""
        apart = not alike(self.dynamic_ratio, other.dynamic_ratio)
        return self.settled and other.settled and apart


def alike(first: Any, second: Any) -> Any:
    """Whether dynamic ratios are those of one branch."""
    return np.abs(first - second) <= _SAME * np.maximum(first, second)


# Sees each response whole, with the directions that come to it and its dynamic ratio.
Watch = Callable[[Ways, SweepPoint, float], None]


def finder_of(law: AbstractContactLaw, asked: SweepKeys, moving: Dynamics) -> Finder:
    """What looks for the responses of a sweep, in all its directions."""
    return Finder(moving.pair.system, settings_of(law, asked, size_of(moving.pair)))


def swept(
    law: AbstractContactLaw,
    asked: SweepKeys,
    moving: Dynamics,
    finder: Finder,
    speeds: np.ndarray,
    direction: Direction,
    done: Callable[[int], None],
    watch: Watch | None = None,
) -> tuple[Response, ...]:
    """Sweep in one direction over rising speeds [rad/s]; keep what is shown of each response."""
    # Responses of many mesh periods are too long to keep them all until the end.
    found: list[Response] = []
    last = None
    for speed in speeds[::-1] if direction == "down" else speeds:
        point = finder.next(jnp.asarray(float(speed)), last)
        found.append(_response(law, asked, moving, finder, point))
        if watch is not None:
            watch((direction,), point, found[-1].dynamic_ratio)
        last = None if direction == "cold" else point
        done(1)
    return tuple(found[::-1] if direction == "down" else found)


def swept_along(
    law: AbstractContactLaw,
    asked: SweepKeys,
    moving: Dynamics,
    curve: Curve,
    speeds: np.ndarray,
    done: Callable[[int], None],
    watch: Watch | None = None,
) -> tuple[Response, ...] | None:
    """Sweep in both directions at once, over rising speeds [rad/s].

    A machine stays on a stable branch without folds, so both directions show the same if both begin
    on it. Each response is looked for from its neighbours on the branch: next to no work, where
    from the last speed resonances lie between.

    **Returns:**

    The responses, or `None` where one of them is not on the branch.
    """
    finder = finder_of(law, asked, moving)
    terms = _interpolated(curve, speeds)
    # As a machine would come to them from rest.
    ways, last = directions_of(asked), len(speeds) - 1
    ends = {place: finder.next(jnp.asarray(float(speeds[place])), None) for place in (0, last)}
    if not all(finder.is_beside(point, terms[place]) for place, point in ends.items()):
        return None
    found: list[Response] = []
    for place, speed in enumerate(speeds):
        point = ends.get(place) or finder.beside(jnp.asarray(float(speed)), terms[place])
        if point is None:
            done(-len(ways) * len(found))
            return None
        found.append(_response(law, asked, moving, finder, point))
        if watch is not None:
            watch(ways, point, found[-1].dynamic_ratio)
        done(len(ways))
    return tuple(found)


def _interpolated(curve: Curve, speeds: np.ndarray) -> list[Terms]:
    """Harmonics of the mesh coordinates on a branch of rising speeds, of each speed [m, rad]."""
    columns = curve.terms.reshape(len(curve.speed), -1).T
    found = [np.interp(np.log(speeds), np.log(curve.speed), column) for column in columns]
    shape = curve.terms.shape[1:]
    return [jnp.asarray(values.reshape(shape)) for values in np.stack(found, axis=1)]


def is_plain(curves: tuple[Curve, ...]) -> bool:
    """Whether a branch that was followed from the lowest speed to the highest is one, and stable.

    Then nothing makes a machine leave it.
    """
    if len(curves) != 1:
        return False
    (piece,) = curves
    whole = piece.ends == ("began", "left")
    whole = whole and not (piece.folds or piece.doublings or piece.tori)
    return whole and bool(np.all(piece.stable) and np.all(np.diff(piece.speed) > 0.0))


def _response(
    law: AbstractContactLaw, asked: SweepKeys, moving: Dynamics, finder: Finder, point: SweepPoint
) -> Response:
    """What is kept of a response; what was found before is not measured again.

    **Raises:**

    - `SolverFailure` if it is not a finite number.
    """
    dynamics, speed = moving.pair, float(point.orbit.speed)
    influences = moving.statics.influences
    known = finder.found.same(point)
    numbers = None if known is None else known.numbers
    if numbers is None:
        numbers = jax.device_get(measured(dynamics, point.orbit, law, asked.orders, influences))
    if known is not None:
        known.numbers = numbers
    sizes = np.abs(point.multipliers)
    found = Response(
        speed=speed,
        settled=point.settled,
        stable=point.stable,
        periods=point.multiple * dynamics.system.table.periods,
        residual=float(point.orbit.residual),
        multiplier=float(sizes.max()) if sizes.size else None,
        numbers=numbers,
    )
    if not found.is_finite:
        raise SolverFailure(
            f"the response at {speed:.6g} rad/s is not a finite number. Raise sweep.steps, "
            f'write sweep.method = "{"shooting" if asked.method == "newmark" else "newmark"}", '
            "or leave this speed out."
        )
    return found


@dataclasses.dataclass(frozen=True)
class Sweep:
    """All that a sweep found.

    **Fields:**

    - `speeds`: of the pinion, rising [rad/s].
    - `responses`: of each direction, one for each speed.
    - `curves`: pieces of the branch that was followed round its folds.
    - `seconds`: that each part took, compilation included [s].
    """

    speeds: np.ndarray
    responses: dict[Direction, tuple[Response, ...]]
    curves: tuple[Curve, ...]
    seconds: dict[str, float]

    @property
    def main(self) -> Direction:
        """The direction with the highest peak, of settled responses if there are any."""
        # Rounding must not choose between directions that found the same.
        rank = lambda way: (self.highest(way)[0][0], round(self.highest(way)[0][1], 3))
        return max(self.responses, key=rank)

    def highest(self, way: Direction) -> tuple[tuple[bool, float], int]:
        """Whether it settled, dynamic ratio, and place of the highest response of a direction."""
        each = [(r.settled, r.dynamic_ratio) for r in self.responses[way]]
        best = max(range(len(each)), key=each.__getitem__)
        return each[best], best

    @property
    def unsettled(self) -> int:
        """Number of responses that did not settle."""
        return sum(not r.settled for own in self.responses.values() for r in own)

    def passed_over(self) -> list[tuple[float, float]]:
        """Ranges of speed, between two that were swept, in which a branch is unstable [rad/s]."""
        found: list[tuple[float, float]] = []
        for piece in self.curves:
            edges = {event.after: event.speed for event in (*piece.doublings, *piece.tori)}
            changes = np.flatnonzero(np.diff(piece.stable.astype(int)))
            for first, last in itertools.pairwise(changes):
                # Between folds a machine is on another branch, which the sweep shows.
                if not piece.stable[first] or first not in edges or last not in edges:
                    continue
                low, high = sorted((edges[first], edges[last]))
                if not np.any((self.speeds >= low) & (self.speeds <= high)):
                    found.append((low, high))
        return sorted(found)

    def pieces_lost(self) -> Iterator[str]:
        """Why a branch could not be followed to its end, if it could not."""
        for piece in self.curves:
            if piece.ends[1] in ("lost", "most points"):
                yield f"{piece.ends[1]} at {piece.speed[-1]:.5g} rad/s"


def branches(
    method: HarmonicBalance,
    dynamics: PairDynamics,
    speeds: np.ndarray,
    done: Callable[[int], None],
) -> tuple[Curve, ...]:
    """Follow the branch of responses from the lowest speed to the highest, round its folds.

    Where it is lost on the way, what can be reached from the other end is a second piece. None
    where no response is found to begin with.
    """
    follow = lambda start, stop: continuation(
        dynamics.system, start, stop, method=method, done=done
    )
    low, high = float(speeds[0]), float(speeds[-1])
    pieces = [follow(low, high)]
    if not pieces[0].speed.size or pieces[0].ends[1] not in ("left", "most points"):
        pieces.append(follow(high, low))
    return tuple(piece for piece in pieces if piece.speed.size)


def sweep_of(
    law: AbstractContactLaw,
    asked: SweepKeys,
    moving: Dynamics,
    done: Callable[[int], None],
    watch: Watch | None = None,
) -> Sweep:
    """Sweep a pair in all directions that are asked for, and follow its branch."""
    ready = ready_to_bear(moving.pair.system.table)
    moving = eqx.tree_at(lambda each: each.pair.system.table, moving, ready)
    dynamics = moving.pair
    speeds, seconds = speeds_of(asked), {}
    method = settings_of(law, asked, size_of(dynamics)).method

    def clocked(name: str, work: Callable[[], Any]) -> Any:
        start = time.perf_counter()
        found = work()
        seconds[name] = time.perf_counter() - start
        return found

    def by_directions() -> dict[Direction, tuple[Response, ...]]:
        finder = finder_of(law, asked, moving)
        one = functools.partial(swept, law, asked, moving, finder, speeds)
        ways = directions_of(asked)
        return {way: clocked(way, functools.partial(one, way, done, watch)) for way in ways}

    followed = is_followed(asked, size_of(dynamics)) and len(speeds) > 1
    if not (followed and isinstance(method, HarmonicBalance)):
        return Sweep(speeds, by_directions(), (), seconds)

    def follow(done: Callable[[int], None]) -> tuple[Curve, ...]:
        return clocked("continuation", lambda: branches(method, dynamics, speeds, done))

    if not dynamics.bodies:
        curves, responses = _side_by_side(follow, by_directions)
        return Sweep(speeds, responses, curves, seconds)
    # Not side by side: two programs with products of matrices of some hundred rows, on two cores,
    # wait for each other's threads for ever (XLA for CPU, jaxlib 0.10).
    points = itertools.count(1)
    curves, both = follow(lambda _: say(f"point {next(points)} of the branch")), None
    say("")
    if asked.direction == "both" and is_plain(curves):
        along = functools.partial(swept_along, law, asked, moving, curves[0], speeds)
        both = clocked("up and down", lambda: along(done, watch))
    responses = by_directions() if both is None else dict.fromkeys(directions_of(asked), both)
    return Sweep(speeds, responses, curves, seconds)


def _side_by_side(
    follow: Callable[[Callable[[int], None]], tuple[Curve, ...]],
    by_directions: Callable[[], dict[Direction, tuple[Response, ...]]],
) -> tuple[tuple[Curve, ...], dict[Direction, tuple[Response, ...]]]:
    """The branch, and the responses in each direction.

    Most of the time goes into compiling, and both have programs of their own.
    """
    stopped = False

    def going_on(count: int) -> None:
        del count
        if stopped:
            raise InterruptedError

    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        context = contextvars.copy_context()
        curves = pool.submit(lambda: context.run(follow, going_on))
        try:
            responses = by_directions()
        except BaseException:
            stopped = True
            raise
    return curves.result(), responses
