r"""The Master Curve: depth and extent of symmetric linear tip relief that keep the TE constant.

Closed form for thin slices of constant stiffness and a profile contact ratio between 1 and 2,
derived in physics A3.2 and A3.3 (not the printed equation of Bruyere & Velex 2013), and the map
that it is laid on, computed with whatever stiffness the model has.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


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
    response: Response,
    depth: np.ndarray,
    extent: np.ndarray,
    *,
    done: Callable[[int], None] = lambda count: None,
) -> tuple[ReliefMap, Valley]:
    """Evaluate a response over a grid of depths and extents, and follow its valley.

    For each extent, the depths next to the best row are searched on a grid as many times finer
    as the map has rows, whose least three points are then joined by a parabola.

    **Arguments:**

    - `response`: of a depth [m] and an extent [-], traceable by JAX.
    - `depth`: rows of the map [m].
    - `extent`: columns of the map [-].
    - `done`: told how many more points of the map are finished, for a progress bar.

    **Returns:**

    The map, and the best depth for each of its extents.
    """
    count = len(depth)
    # One shape for every call: it is compiled once.
    batch = jax.jit(jax.vmap(response))

    def evaluate(depths: np.ndarray, extents: np.ndarray) -> np.ndarray:
        padding = (0, -len(depths) % count)
        pairs = [np.pad(x, padding, mode="edge").reshape(-1, count) for x in (depths, extents)]
        values = [np.asarray(batch(*map(jnp.asarray, pair))) for pair in zip(*pairs, strict=True)]
        return np.concatenate(values)[: len(depths)]

    columns, best = [], []
    for one in extent:
        along = np.full(count, one)
        column = evaluate(depth, along)
        row = int(np.argmin(column))
        fine = np.linspace(depth[max(row - 1, 0)], depth[min(row + 1, count - 1)], count)
        columns.append(column)
        best.append(_lowest(fine, evaluate(fine, along)))
        done(count)
    chart = ReliefMap(depth=depth, extent=extent, value=np.stack(columns, axis=1))
    valley = np.asarray(best)
    return chart, Valley(extent=extent, depth=valley, value=evaluate(valley, extent))


def _lowest(x: np.ndarray, y: np.ndarray) -> float:
    """Where the parabola through the least of `y` and its neighbours is lowest."""
    i = int(np.argmin(y))
    if i in (0, len(x) - 1):
        return float(x[i])
    step = x[1] - x[0]
    slope, bend = y[i + 1] - y[i - 1], y[i + 1] - 2.0 * y[i] + y[i - 1]
    return float(x[i] - 0.5 * step * slope / bend) if bend > 0.0 else float(x[i])
