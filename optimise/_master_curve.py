r"""The Master Curve: depth and extent of symmetric linear tip relief that keep the TE constant.

Closed form for thin slices of constant stiffness and a profile contact ratio between 1 and 2,
derived here (theory 5.6, theory 5.7; not the equation of Bruyere & Velex 2013), and the map
that it is laid on, computed with whatever stiffness the model has.
Depths may be in any unit of length that all arguments of a function share; [m] stands for it.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import jaxgear as jg
from optimise._record import Batched, ValueAndGradient, with_jacobian


def master_curve_depth(
    extent: Float[Array, "..."], contact_ratio: Float[Array, ""], deflection: Float[Array, ""]
) -> Float[Array, "..."]:
    r"""Depth of relief that makes the transmission error constant, for a given extent.

    With $\Gamma^* = (\varepsilon_\alpha-1)/\varepsilon_\alpha$: exactly, for
    $\Gamma^*/2 < \Gamma \le \Gamma^*$,
    $E = \delta\,\Gamma\varepsilon_\alpha / (1 - \varepsilon_\alpha(1 - 2\Gamma))$;
    beyond $\Gamma^*$ to the first harmonic, $E = \delta_m / [1 - \Gamma -
    \sin\pi(\varepsilon_\alpha-\lambda)\sin\pi\lambda /
    (\pi\lambda\sin\pi\varepsilon_\alpha)]$ with $\lambda = \Gamma\varepsilon_\alpha$, $\delta_m =
    \delta/\varepsilon_\alpha$. The same for spur and narrow-faced helical gears.

    Derived here: a pair with the TE $\delta$ begins to carry at $s^* = \lambda(1 - \delta/E)$, and
    two pairs carry $\delta$ together if the ramp of the one mirrors that of the next, so that their
    overlap $\varepsilon_\alpha - 1 - 2s^*$ is as long as the ramp, $\lambda - s^*$.

    **Arguments:**

    - `extent`: $\Gamma$ of both gears' tip relief [-].
    - `contact_ratio`: $\varepsilon_\alpha$ [-].
    - `deflection`: $\delta$ of a single tooth pair under the whole load [m].

    **Returns:**

    Depth [m]; NaN where no depth will do: $\Gamma \le \Gamma^*/2$, $\varepsilon_\alpha$ outside of
    (1, 2), or reliefs so long that they overlap. Beyond $\Gamma^*$ it was verified to 0.5.
    """
    ratio = contact_ratio
    longest = (ratio - 1.0) / ratio
    run = extent * ratio
    opening = 1.0 - ratio * (1.0 - 2.0 * extent)
    short = deflection * run / jnp.where(opening > 0.0, opening, jnp.nan)
    sines = jnp.sin(jnp.pi * (ratio - run)) * jnp.sin(jnp.pi * run)
    first_harmonic = 1.0 - extent - sines / (jnp.pi * run * jnp.sin(jnp.pi * ratio))
    long = deflection / ratio / jnp.where(first_harmonic > 0.0, first_harmonic, jnp.nan)
    depth = jnp.where(extent <= longest, short, long)
    return jnp.where((ratio > 1.0) & (ratio < 2.0), depth, jnp.nan)


class ReliefMap(eqx.Module):
    """A response over depth and extent of tip relief.

    **Fields:**

    - `depth`: of the rows [m].
    - `extent`: of the columns [-].
    - `value`: response at each depth and extent, in its own unit [-].
    """

    depth: np.ndarray
    extent: np.ndarray
    value: np.ndarray


class Valley(eqx.Module):
    """The best depth for each extent: the computed Master Curve.

    **Fields:**

    - `extent`: of the tip relief [-].
    - `depth`: that makes the response least [m].
    - `value`: of the response there, in its own unit [-].
    """

    extent: np.ndarray
    depth: np.ndarray
    value: np.ndarray


Response = Callable[[Array, Array], Array]


def relief_map(
    response: Response | Batched,
    depth: np.ndarray,
    extent: np.ndarray,
    *,
    done: Callable[[int], None] = lambda count: None,
) -> tuple[ReliefMap, Valley]:
    """Evaluate a response over a grid of depths and extents, and follow its valley.

    For each extent, nine depths between those next to the best row are looked at, nine between
    those next to the best of these, and the least three are joined by a parabola.

    **Arguments:**

    - `response`: of a depth [m] and an extent [-], traceable by JAX; or of many such points, always
        as many as there are depths.
    - `depth`: rows of the map [m].
    - `extent`: columns of the map [-].
    - `done`: told how many more points of the map are finished, for a progress bar.

    **Returns:**

    The map, and the best depth for each of its extents.
    """
    count = len(depth)
    # One shape for every call: it is compiled once.
    if isinstance(response, Batched):
        batch = response
    else:
        each = lambda point: response(point[0], point[1])
        batch = Batched(jax.jit(lambda points: jg.over_batch(each, points)))

    def evaluate(depths: np.ndarray, extents: np.ndarray) -> np.ndarray:
        padding = (0, -len(depths) % count)
        pairs = [np.pad(x, padding, mode="edge").reshape(-1, count) for x in (depths, extents)]
        values = [batch(np.stack(pair, axis=1)) for pair in zip(*pairs, strict=True)]
        return np.concatenate(values)[: len(depths)]

    columns = []
    for one in extent:
        columns.append(evaluate(depth, np.full(count, one)))
        done(count)
    fine, values = np.tile(depth, (len(extent), 1)), np.stack(columns)
    for _ in range(_ROUNDS):
        fine = _beside_least(fine, values)
        values = evaluate(fine.ravel(), np.repeat(extent, _FINE)).reshape(fine.shape)
    valley = np.array([_lowest(*each) for each in zip(fine, values, strict=True)])
    chart = ReliefMap(depth=depth, extent=extent, value=np.stack(columns, axis=1))
    return chart, Valley(extent=extent, depth=valley, value=evaluate(valley, extent))


# Depths that are looked at between neighbours of the best, and how often.
_FINE, _ROUNDS = 9, 2


def _beside_least(depth: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Depths between the neighbours of the best of each row."""
    # The least of depths that serve alike: rounding is not to choose among them.
    alike = 1e-9 * np.max(np.abs(value), axis=1, keepdims=True)
    best = np.argmax(value <= np.min(value, axis=1, keepdims=True) + alike, axis=1)
    row, last = np.arange(len(depth)), depth.shape[1] - 1
    ends = depth[row, np.maximum(best - 1, 0)], depth[row, np.minimum(best + 1, last)]
    return np.linspace(*ends, _FINE, axis=1)


def _lowest(x: np.ndarray, y: np.ndarray) -> float:
    """Where the parabola through the least of `y` and its neighbours is lowest."""
    i = int(np.argmin(y))
    if i in (0, len(x) - 1):
        return float(x[i])
    step = x[1] - x[0]
    slope, bend = y[i + 1] - y[i - 1], y[i + 1] - 2.0 * y[i] + y[i - 1]
    return float(x[i] - 0.5 * step * slope / bend) if bend > 0.0 else float(x[i])


class TracedCurve(eqx.Module):
    r"""The computed Master Curve, followed along its extents, and how steep its sides are.

    **Fields:**

    - `extent`: of the tip relief [-].
    - `depth`: that makes the mean square least [m].
    - `rms`: of the deviations there [m].
    - `bend`: second derivative of the mean square by the depth, $2\,r_E\cdot r_E$: exact where the
        transmission error is piecewise linear in the depth, as with linear relief and exact
        contact [-].
    - `settled`: whether the depth was found to the tolerance [-].
    """

    extent: np.ndarray
    depth: np.ndarray
    rms: np.ndarray
    bend: np.ndarray
    settled: np.ndarray

    def margin(self, rms: float) -> np.ndarray:
        """How far the depth may be off until the RMS is so large.

        **Arguments:**

        - `rms`: allowed [m].

        **Returns:**

        The margin at each extent; zero where the RMS is larger all the same [m].
        """
        return np.sqrt(np.clip(rms**2 - self.rms**2, 0.0, None) / (0.5 * self.bend))


def traced_curve(
    deviations: Callable[[Array, Array], Array] | ValueAndGradient,
    extent: np.ndarray,
    start: float,
    *,
    deepest: float = np.inf,
    most_steps: int = 30,
    tolerance: float = 1e-9,
    done: Callable[[int], None] = lambda count: None,
) -> TracedCurve:
    r"""Follow the best depth from one extent to the next.

    At each extent Gauss and Newton's steps $-r\cdot r_E / r_E\cdot r_E$, between places whose
    slopes point at each other once there are such; to the next extent along the tangent
    $dE/d\Gamma = -r_E\cdot r_\Gamma / r_E\cdot r_E$.

    **Arguments:**

    - `deviations`: $r$ of a depth [m] and an extent [-], whose squares sum to the mean square of
        the transmission error about its mean [m]; traceable by JAX. Or what has their derivatives
        too, of a point of both.
    - `extent`: in the order in which to go; begin where the curve is flat, at the longest.
    - `start`: depth to begin with at the first extent [m].
    - `deepest`: where the curve ends; so it does where depth has no effect [m].
    - `most_steps`: at each extent.
    - `tolerance`: of the last step, relative to the depth [-].
    - `done`: told how many more extents are finished, for a progress bar.

    **Returns:**

    The curve, in the order of the extents; NaN, and not settled, after its end.

    **Raises:**

    - `FloatingPointError` where the deviations are not finite.
    """
    if isinstance(deviations, ValueAndGradient):
        sloped = deviations
    else:
        sloped = with_jacobian(lambda point: deviations(point[0], point[1]))

    def at(depth: float, gamma: float) -> _Place:
        r, slopes = map(np.asarray, sloped(jnp.asarray(np.asarray([depth, gamma]), dtype=float)))
        found = _Place(depth, r, *slopes.T)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(slopes))):
            raise FloatingPointError(
                f"The deviations or their slopes are not finite at a relief of {depth:.6g}, in the "
                f"unit given, over {gamma:.6g} of the path."
            )
        return found

    rows, depth = [], float(start)
    for gamma, ahead in zip(extent, [*extent[1:], extent[-1]], strict=True):
        # What is deeper than this touches nothing, or is asked for by no one: there it ends.
        if not depth <= deepest:
            rows.append((np.nan, np.nan, np.nan, False))
            continue
        bottom = lambda depth, gamma=float(gamma): at(depth, gamma)
        found, settled = _bottom(bottom, depth, most_steps, tolerance)
        rows.append((found.depth, np.sqrt(found.square), 2.0 * found.bend, settled))
        # Half of it at the least: near the shortest extent the tangent overshoots.
        turn = found.by_depth @ found.by_extent
        slope = turn / found.bend if found.bend > 0.0 else np.nan
        depth = np.maximum(found.depth - slope * float(ahead - gamma), 0.5 * found.depth)
        done(1)
    columns = (np.asarray(column) for column in zip(*rows, strict=True))
    return TracedCurve(np.asarray(extent, dtype=float), *columns)


class _Place(NamedTuple):
    """Deviations at a depth, and how they change with the depth and with the extent."""

    depth: float
    deviations: np.ndarray
    by_depth: np.ndarray
    by_extent: np.ndarray

    @property
    def square(self) -> float:
        return float(self.deviations @ self.deviations)

    @property
    def slope(self) -> float:
        return float(self.deviations @ self.by_depth)

    @property
    def bend(self) -> float:
        return float(self.by_depth @ self.by_depth)


def _bottom(
    at: Callable[[float], _Place], depth: float, most_steps: int, tolerance: float
) -> tuple[_Place, bool]:
    """The place of least mean square, and whether it was found: a bottom, or a kink.

    Between two places whose slopes point at each other there is one of them.
    """
    here, ends, last = at(depth), {}, np.inf
    for _ in range(most_steps):
        if not here.bend > 0.0:
            return here, False
        step = -here.slope / here.bend
        if abs(step) <= tolerance * max(here.depth, abs(step) * tolerance):
            return here, True
        ends[step > 0.0] = here
        ahead = max(here.depth + step, 0.0)
        if len(ends) == 2:
            low, high = ends[True], ends[False]
            width, least = high.depth - low.depth, _KINK * high.depth
            lower = min(low, high, key=lambda each: each.square)
            kink = _meeting(low, high)
            if width <= least or abs(kink - lower.depth) <= least:
                return lower, True
            inside = [x for x in (ahead, kink) if low.depth + least < x < high.depth - least]
            ahead = inside[0] if inside and width < 0.5 * last else 0.5 * (low.depth + high.depth)
            last = width
        there = _better(at, here, ahead)
        if there is None:
            return here, False
        here = there
    return here, False


def _meeting(low: _Place, high: _Place) -> float:
    """Where the deviations that two places foresee are closest: at the kink between them."""
    turn = low.by_depth - high.by_depth
    apart = low.deviations - high.deviations
    apart = apart - low.by_depth * low.depth + high.by_depth * high.depth
    size = float(turn @ turn)
    return -float(apart @ turn) / size if size > 0.0 else np.nan


def _better(at: Callable[[float], _Place], here: _Place, ahead: float) -> _Place | None:
    """A place ahead, or on the way there, of less mean square or beyond the bottom."""
    for _ in range(_HALVINGS):
        there = at(ahead)
        if there.square < here.square or (there.slope * here.slope < 0.0 < there.bend):
            return there
        ahead = 0.5 * (here.depth + ahead)
    return None


# A step is halved so often. Depths of a bottom with a kink are told to this share.
_HALVINGS, _KINK = 12, 1e-8
