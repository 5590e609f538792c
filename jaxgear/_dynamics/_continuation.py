r"""Branches of responses over speed, round their folds, by continuation in arc length.

Where a sweep jumps, the branch of responses folds back in speed and goes on, unstable. Harmonics
and speed are unknown together: a step along the tangent, then Newton's method in the plane across
it. Along the branch, $ds^2 = (\mathrm d\bar m/m_0)^2 + \overline{(\mathrm d\tilde m/m_v)^2} +
(\mathrm d\ln\Omega_1)^2$: the change of the mesh coordinates' mean in static deflections $m_0$, the
mean square over time of that of their vibration, and the relative change of speed, so that a
resonance takes as many steps at low speed as at high. Where a pair vibrates by less than half of
its static deflection, $m_v$ is twice what it vibrates by: else steps would pass over resonances
that are small beside the deflection.

Equations of exact contact at points in time have corners: close to a corner a fold lies within the
error of that discretisation, and has no derivative. Averaged or smooth contact has both.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Complex, Float

from jaxgear._checks import require
from jaxgear._dynamics._branch import joined_vector, parted_vector, sizes_of
from jaxgear._dynamics._floquet import STABLE
from jaxgear._dynamics._guide import (
    Events,
    Guide,
    LostError,
    Place,
    heading_of,
    hides_event,
    length_of,
)
from jaxgear._dynamics._harmonic import HarmonicBalance, harmonic_balance_problem
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._types import Terms

if TYPE_CHECKING:
    Places = np.ndarray
    PlaceTerms = np.ndarray
    PlaceMultipliers = np.ndarray
    FlagPlaces = np.ndarray
    Harmonics = np.ndarray
else:
    Places = Float[np.ndarray, "point"]
    PlaceTerms = Float[np.ndarray, "point coordinate term"]
    PlaceMultipliers = Complex[np.ndarray, "point"]
    FlagPlaces = Bool[np.ndarray, "point"]
    Harmonics = Float[np.ndarray, "coordinate term"]

# Why a branch ends: at an end of the range of speeds, where it began, at a branch that repeats
# after fewer cycles, where Newton's method fails at the smallest step, or after enough points.
End = Literal["began", "left", "returned", "joined", "lost", "most points", "not found"]


class CurvePoint(eqx.Module):
    """A response of interest on a branch.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `dynamic_ratio`: largest total contact force over the static one [-].
    - `terms`: harmonics of the mesh coordinates [m, rad].
    - `after`: index of the point of the branch that precedes it, -1 if there is none [-].
    """

    speed: float
    dynamic_ratio: float
    terms: Harmonics
    after: int


class Curve(eqx.Module):
    """Responses in their order along a branch, stable or not.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `dynamic_ratio`: largest total contact force over the static one [-].
    - `te_rms`: of the dynamic transmission error about its mean [m].
    - `terms`: harmonics of the mesh coordinates [m, rad].
    - `multiplier`: the largest of Floquet, over the whole response; NaN if not asked for [-].
    - `stable`: whether it is smaller than one; false if not asked for.
    - `folds`: where the branch turns back in speed.
    - `doublings`: where a multiplier passes through -1.
    - `tori`: where a pair of complex multipliers passes through the unit circle: beyond, the
        amplitude beats.
    - `ends`: why there is nothing before the first and after the last point.
    - `steps`: Newton's steps in all.
    """

    speed: Places
    dynamic_ratio: Places
    te_rms: Places
    terms: PlaceTerms
    multiplier: PlaceMultipliers
    stable: FlagPlaces
    folds: tuple[CurvePoint, ...]
    doublings: tuple[CurvePoint, ...]
    tori: tuple[CurvePoint, ...]
    ends: tuple[End, End] = eqx.field(static=True)
    steps: int = eqx.field(static=True)


# Steps halve below the first and grow above the second of these cosines of the turn they make, and
# a corrected point is not further aside than this part of its step.
_SHARP, _STRAIGHT, _ASIDE = 0.7, 0.93, 0.5
_FEW_NEWTON, _MANY_NEWTON = 4, 6
_SMALLEST_STEP = 1e-7

# Where a branch rises or falls in speed by at least this part of its length, the next point is
# first looked for at the speed where the tangent leads to: that asks the structure once.
_LEANS = 5e-3

# Steps above this are halved if two folds seem to hide in them.
_LOOKED_AT = 3e-3


class _Walk(NamedTuple):
    """The points in one direction, what lies between them, and why they end."""

    points: list[Place]
    folds: Events
    doublings: Events
    tori: Events
    end: End


def _ahead(
    guide: Guide, here: Place, step: float, span: tuple[float, float]
) -> tuple[Place | None, bool]:
    """The next point, and whether it is on the edge of the range."""
    measure = guide.measure_at(here)
    guess = here.unknowns + step / length_of(measure * here.tangent) * here.tangent
    low, high = span
    leaves = not low <= guess[-1] <= high
    if leaves:
        edge = low if guess[-1] < low else high
        guess = here.unknowns + (edge - here.unknowns[-1]) / here.tangent[-1] * here.tangent
        guess[-1] = edge
    follows = lambda ahead: ahead is not None and _follows(here, ahead, guess, measure)
    if leaves or abs(here.tangent[-1]) > _LEANS:
        ahead = guide.correct_at_speed(guess, here.tangent[-1])
        if follows(ahead):
            return ahead, leaves
    if leaves:
        return None, False
    ahead = guide.correct(guess, here.tangent, float(here.tangent @ guess))
    inside = ahead is not None and low <= ahead.unknowns[-1] <= high
    return (ahead, False) if inside and follows(ahead) else (None, False)


def _follows(here: Place, ahead: Place, guess: np.ndarray, measure: np.ndarray) -> bool:
    """Whether a point is the next one of a branch."""
    step = length_of(measure * (guess - here.unknowns))
    return (
        _turn(here, ahead, measure) >= _SHARP
        and length_of(measure * (ahead.unknowns - guess)) <= _ASIDE * step
        and not (step > _LOOKED_AT and hides_event(here, ahead))
    )


def _turn(here: Place, ahead: Place, measure: np.ndarray) -> float:
    """Cosine of the angle between the tangents of two points [-]."""
    first, second = measure * here.tangent, measure * ahead.tangent
    return float(first @ second) / (length_of(first) * length_of(second))


def _walk(
    guide: Guide,
    first: Place,
    span: tuple[float, float],
    steps: tuple[float, float],
    most_points: int,
    done: Callable[[int], None],
) -> _Walk:
    """Follow a branch from a point in the direction of its tangent."""
    step, largest = steps
    points, folds = [first], []
    heading = heading_of(first)

    def end(why: End) -> _Walk:
        seen, turns = guide.with_windows(guide.see_all(points), folds)
        doublings, tori = guide.changes(seen)
        return _Walk(seen, [(i, guide.see(x)) for i, x in turns], doublings, tori, why)

    while len(points) < most_points:
        here = points[-1]
        ahead, leaves = _ahead(guide, here, step, span)
        joint = fold = None
        try:
            if ahead is not None:
                joint = guide.joint(here, ahead)
                if joint is None and heading * heading_of(ahead) < 0.0:
                    fold = guide.fold(here, ahead) if heading_of(here) else here
        except LostError:
            ahead = None
        if ahead is None:
            step *= 0.5
            if step < _SMALLEST_STEP:
                return end("lost")
            continue
        if joint is not None:
            points.append(joint)
            done(1)
            return end("joined")
        heading = heading_of(ahead) or heading
        if fold is not None:
            folds.append((len(points) - 1, fold))
        back = len(points) > 2 and guide.passes(here, ahead, first)
        points.append(first if back else ahead)
        done(1)
        if back:
            return end("returned")
        if leaves:
            return end("left")
        turn = _turn(here, ahead, guide.measure_at(here))
        if ahead.steps <= _FEW_NEWTON and turn > _STRAIGHT:
            step = min(1.4 * step, largest)
        elif ahead.steps >= _MANY_NEWTON or turn < 0.5 * (_SHARP + _STRAIGHT):
            step *= 0.6
    return end("most points")


def continuation(
    system: DynamicSystem,
    start: float,
    stop: float,
    *,
    method: HarmonicBalance = HarmonicBalance(),
    near: Terms | None = None,
    at: float | None = None,
    first_step: float = 0.01,
    largest_step: float = 0.1,
    most_points: int = 1000,
    stability: bool = True,
    done: Callable[[int], None] = lambda count: None,
) -> Curve:
    """Follow a branch of responses over a range of speeds, round its folds (theory 9.4).

    **Arguments:**

    - `system`: what moves.
    - `start`, `stop`: speeds of the pinion, positive and different. The branch is followed from
        `start` towards `stop` until it leaves this range on either side [rad/s].
    - `method`: with `multiple` of 2, branches of sub-harmonic responses, from `near` one.
    - `near`: harmonics of the mesh coordinates to begin with, as of `fourier_coefficients`, or
        `None`: those of the quasi-static states [m, rad].
    - `at`: speed of `near`, if it is between `start` and `stop`: the branch is then followed both
        ways, and put together [rad/s].
    - `first_step`, `largest_step`: along the branch, as (9.4) [-].
    - `most_points`: in each direction.
    - `stability`: whether to find Floquet's multipliers.
    - `done`: told how many more points are found.

    **Returns:**

    The branch. It has no points where no response is found to begin with. At a fold of exact
    contact at points in time a multiplier is close to +1, not equal: multipliers are those of a
    time stepping with as many steps, which is another discretisation.

    **Raises:**

    - `ValueError` unless speeds and steps are as above.
    """
    require(
        start > 0.0 and stop > 0.0 and start != stop,
        "`continuation` needs two different positive speeds, got {start:.6g} and {stop:.6g} rad/s.",
        start=start,
        stop=stop,
    )
    require(
        _SMALLEST_STEP < first_step <= largest_step,
        "`first_step` must be positive and not above `largest_step`, got {first} and {largest}.",
        first=first_step,
        largest=largest_step,
    )
    at = start if at is None else at
    low, high = sorted((start, stop))
    require(
        low <= at <= high,
        "`at` must lie between `start` and `stop`, got {at:.6g} rad/s.",
        at=at,
    )
    balance = harmonic_balance_problem(method, system)
    guide = Guide(method, balance, stability=stability)
    near = balance.rest if near is None else near
    speed = jnp.asarray(float(at))
    begun = np.asarray(joined_once(balance, method.solve(balance, speed, near)[1], speed))
    way = np.sign(stop - start)
    first = guide.correct_at_speed(begun, way) if np.all(np.isfinite(begun)) else None
    if first is None:
        return _curve(guide, _Walk([], [], [], [], "not found"), "not found")
    done(1)
    span, steps = (float(np.log(low)), float(np.log(high))), (first_step, largest_step)
    onwards = _walk(guide, first, span, steps, most_points, done)
    if at == start or onwards.end == "returned":
        return _curve(guide, onwards, "returned" if onwards.end == "returned" else "began")
    behind = first._replace(tangent=-first.tangent)
    backwards = _walk(guide, behind, span, steps, most_points, done)
    return _curve(guide, _together(backwards, onwards), backwards.end)


def _together(backwards: _Walk, onwards: _Walk) -> _Walk:
    """One walk of two in opposite directions from one point."""
    count = len(backwards.points) - 1
    # What follows a point on the way back precedes it on the way forth.
    before = lambda events: [(count - 1 - index, point) for index, point in reversed(events)]
    after = lambda events: [(count + index, point) for index, point in events]
    return _Walk(
        points=[*reversed(backwards.points), *onwards.points[1:]],
        folds=before(backwards.folds) + after(onwards.folds),
        doublings=before(backwards.doublings) + after(onwards.doublings),
        tori=before(backwards.tori) + after(onwards.tori),
        end=onwards.end,
    )


joined_once = jax.jit(joined_vector)


def _curve(guide: Guide, walk: _Walk, begins: End) -> Curve:
    """What a walk has found."""
    points = walk.points
    sizes = np.asarray(sizes_of(guide.balance))

    def special(events: Events) -> tuple[CurvePoint, ...]:
        return tuple(special_point(guide, point, index) for index, point in events)

    column = lambda name: np.asarray([getattr(point, name) for point in points])
    unknowns = np.asarray([point.unknowns for point in points]).reshape(-1, sizes.size + 1)
    multiplier = column("multiplier").astype(complex)
    return Curve(
        speed=np.exp(unknowns[:, -1]),
        dynamic_ratio=column("ratio").astype(float),
        te_rms=column("te_rms").astype(float),
        terms=unknowns[:, :-1].reshape(-1, *sizes.shape) * sizes,
        multiplier=multiplier,
        stable=np.abs(multiplier) <= STABLE,
        folds=special(walk.folds),
        doublings=special(walk.doublings),
        tori=special(walk.tori),
        ends=(begins, walk.end),
        steps=guide.steps,
    )


def special_point(guide: Guide, point: Place, after: int) -> CurvePoint:
    """A point of a branch as users see it, and the number of the curve's point before it."""
    terms, speed = jax.device_get(parted_once(guide.balance, point.unknowns))
    return CurvePoint(float(speed), point.ratio, terms, after)


parted_once = jax.jit(parted_vector)
