"""Speed and torque as functions of time: pieces between given instants."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._types import Reals, Scalar, as_reals

if TYPE_CHECKING:
    Knots = Array
else:
    Knots = Float[Array, "knot"]

# --- What is prescribed


class Schedule(eqx.Module):
    """A quantity that changes in straight lines between knots and is constant beyond them.

    Two knots at one time are a jump.

    **Fields:**

    - `times`: of the knots, none earlier than the one before [s].
    - `values`: there, in the unit of the quantity: [rad/s] for speeds, [-] for ratios.

    **Raises:**

    - `ValueError` unless there are two knots or more, in the order of time.
    """

    times: Knots = eqx.field(converter=as_reals)
    values: Knots = eqx.field(converter=as_reals)

    def __check_init__(self):
        require(
            self.times.ndim == 1 and self.times.shape == self.values.shape and self.times.size > 1,
            "`Schedule` must have one value for each of two knots or more, got {times} times and "
            "{values} values.",
            times=self.times.size,
            values=self.values.size,
        )
        require(
            jnp.all(jnp.diff(self.times) >= 0.0) & jnp.all(jnp.isfinite(self.values)),
            "`Schedule.times` must not go back and `Schedule.values` must be finite, got {times} s "
            "with {values}. Sort the knots by time.",
            times=self.times,
            values=self.values,
        )

    def __call__(self, time: Scalar) -> Scalar:
        """The quantity at a time [s]; at a jump, that after it. In the unit of `values`."""
        return pieces_of(self).at(time).value(time)

    def integral(self, time: Scalar) -> Scalar:
        """Its integral from the first knot to a time [s]; in [rad] for speeds."""
        return pieces_of(self).at(time).integral(time)

    def when(self, integral: Scalar) -> Scalar:
        """When the integral of a quantity that is never negative reaches a value [s].

        Infinite if it never does; after a standstill at that value, its end.
        """
        return pieces_of(self).when(integral)


class _Piece(eqx.Module):
    """One straight line of a profile, followed beyond its ends too.

    **Fields:**

    - `begin`: where it is known [s].
    - `start`: the quantity there [rad/s, -].
    - `slope`: its rate [rad/s2, 1/s].
    - `before`: its integral until there [rad, s].
    """

    begin: Reals
    start: Reals
    slope: Reals
    before: Reals

    def value(self, time: Scalar) -> Scalar:
        """The quantity [rad/s, -]."""
        return self.start + self.slope * (time - self.begin)

    def integral(self, time: Scalar) -> Scalar:
        """Its integral from the first knot [rad, s]."""
        past = time - self.begin
        return self.before + past * (self.start + 0.5 * self.slope * past)


class Pieces(eqx.Module):
    """All lines of a profile: before the first knot, between knots, behind the last.

    **Fields:**

    - `knots`: that part them [s].
    - `lines`: one more than knots, on a leading axis.
    """

    knots: Knots
    lines: _Piece

    def at(self, time: Scalar) -> _Piece:
        """The line that a time lies on; at a knot, the later one."""
        i = jnp.searchsorted(self.knots, time, side="right", method="compare_all")
        return jax.tree.map(lambda x: x[i], self.lines)

    def when(self, integral: Scalar) -> Scalar:
        """As `Schedule.when`."""
        sums = self.lines.before[1:]
        i = jnp.searchsorted(sums, integral, side="right", method="compare_all")
        line = jax.tree.map(lambda x: x[i], self.lines)
        missing = integral - line.before
        # Not the difference of two nearly equal numbers, at any slope and at a start from zero.
        square = jnp.maximum(line.start**2 + 2.0 * line.slope * missing, 0.0)
        root = jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
        fastest = line.start + root
        never = jnp.where(missing > 0.0, jnp.inf, 0.0)
        way = 2.0 * missing / jnp.where(fastest > 0.0, fastest, 1.0)
        return line.begin + jnp.where(fastest > 0.0, way, never)


def pieces_of(profile: Schedule) -> Pieces:
    """Slopes and integrals of a profile, piece by piece."""
    knots, values = profile.times, profile.values
    lengths = jnp.diff(knots)
    instant = lengths == 0.0
    slopes = jnp.where(instant, 0.0, jnp.diff(values) / jnp.where(instant, 1.0, lengths))
    sums = jnp.cumsum(0.5 * (values[1:] + values[:-1]) * lengths)
    none = jnp.zeros(1)
    lines = _Piece(
        begin=jnp.concatenate([knots[:1], knots]),
        start=jnp.concatenate([values[:1], values]),
        slope=jnp.concatenate([none, slopes, none]),
        before=jnp.concatenate([none, none, sums]),
    )
    return Pieces(knots=knots, lines=lines)


def run_up(start: float | Scalar, end: float | Scalar, seconds: float | Scalar) -> Schedule:
    """A speed that rises or falls at a constant rate, and stays.

    **Arguments:**

    - `start`, `end`: speeds of the pinion [rad/s].
    - `seconds`: how long the change takes [s].

    **Returns:**

    The profile; it begins at time zero.
    """
    return _through((0.0, seconds), (start, end))


def torque_step(
    before: float | Scalar,
    after: float | Scalar,
    at: float | Scalar,
    seconds: float | Scalar = 0.0,
) -> Schedule:
    """A torque that changes once.

    **Arguments:**

    - `before`, `after`: torque over that of the system [-].
    - `at`: when the change begins [s].
    - `seconds`: how long it takes; zero is a jump [s].

    **Returns:**

    The profile.
    """
    end = jnp.asarray(at, dtype=float) + seconds
    return _through((at, end), (before, after))


def start_stop(
    speed: float | Scalar,
    up: float | Scalar,
    hold: float | Scalar,
    down: float | Scalar,
) -> Schedule:
    """From standstill to a speed, and back to standstill.

    **Arguments:**

    - `speed`: of the pinion in between [rad/s].
    - `up`, `hold`, `down`: how long each part takes [s].

    **Returns:**

    The profile; it begins at time zero.
    """
    held = jnp.asarray(up, dtype=float) + hold
    return _through((0.0, up, held, held + down), (0.0, speed, speed, 0.0))


def _through(times: Sequence[float | Scalar], values: Sequence[float | Scalar]) -> Schedule:
    """The profile through knots given one by one."""
    one = lambda x: jnp.asarray(x, dtype=float)
    return Schedule(jnp.stack([one(x) for x in times]), jnp.stack([one(x) for x in values]))


def as_profile(given: Schedule | float | Scalar) -> Schedule:
    """A profile as it is, and a number as one that is constant.

    **Arguments:**

    - `given`: a profile or a real number.

    **Returns:**

    The profile.
    """
    return given if isinstance(given, Schedule) else _through((0.0, 1.0), (given, given))
