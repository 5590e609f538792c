"""Where across the face the load lies: its centre, and its ends."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import jaxgear as jg
from optimise._objectives import AbstractObjective, as_scalar


def loaded_maximum(
    values: Float[Array, "case ..."], width: Float[Array, ""]
) -> Float[Array, "..."]:
    r"""A smooth largest of loads, zero where there are none: $w \log(1 + \sum(e^{x/w} - 1))$.

    Never below the largest, and above it by at most $w \log n$ for $n$ loads; what carries nothing
    takes no part, where in `jaxgear.smooth_maximum` it adds to all others.

    **Arguments:**

    - `values`: not negative; the first axis is that of which the largest is taken [-].
    - `width`: of the smoothing, in their unit [-].

    **Returns:**

    The largest of each column, in the unit of the values.
    """
    count = values.shape[0]
    with_none = jnp.concatenate([values / width, jnp.zeros_like(values[:1])])
    weights = jnp.ones(count + 1).at[-1].set(1.0 - count)
    weights = weights.reshape(-1, *(1 for _ in values.shape[1:]))
    return width * jax.scipy.special.logsumexp(with_none, axis=0, b=weights)


def pressure_offset(
    pair: jg.GearPair,
    cycle: jg.MeshCycle,
    law: jg.AbstractContactLaw,
    width: Float[Array, ""],
) -> Float[Array, ""]:
    r"""Centre of the pressure across the face, from mid-face, over half the face width.

    $\sum_s \hat p_s z_s / \sum_s \hat p_s$ with $\hat p_s$ the largest pressure that slice $s$
    meets in the cycle, on any contact line: the shadow of the pressure map of a flank, as it is
    seen along the tooth's height.

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.
    - `law`: with which they were found.
    - `width`: of the smooth maximum over the cycle [Pa].

    **Returns:**

    The offset, -1 at the left (-Z) end and 1 at the right [-].
    """
    pressure = jg.hertz_pressure(pair, cycle, law)
    highest = loaded_maximum(pressure.reshape(-1, pressure.shape[2]), width)
    place = cycle.cells.lines.face_position / (0.5 * pair.face_width)
    return jnp.sum(highest * place) / jnp.sum(highest)


class PressureOffset(AbstractObjective):
    r"""Square of `pressure_offset`: how far the pressure across the face is from centred [-].

    A square, so that it is smooth where the pressure is centred. It is what a pressure map shows
    (Guilbert 2017, Fig. IV-34 and IV-47): the largest pressure of each slice over the cycle, not
    the mean load. The two differ where the ends of the face are loaded for a part of the cycle
    only, as in helical pairs. Half of a pressure that peaks at both ends is as centred as one that
    peaks in the middle: look at `EdgeLoad` or `LargestPressure` too. Of several variables it
    settles one; what else is asked of the others belongs beside it.

    **Fields:**

    - `width`: of the smooth maximum over the cycle [Pa].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=5.0 * jg.MPa)

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the squared offset [-]."""
        return pressure_offset(model.pair, cycle, law, self.width) ** 2


class EdgeLoad(AbstractObjective):
    """Largest line load on the outermost slices of the face, in N/mm, smoothed.

    Zero where the ends do not touch. A slice whose middle is beyond the path of contact has no
    line load. The finer the slices, the closer to the ends it looks.

    **Fields:**

    - `width`: of the smooth maximum [N/m].
    - `slices`: at either end.
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=1.0 / jg.mm)
    slices: int = eqx.field(static=True, default=1)

    def __check_init__(self):
        if self.slices < 1:
            raise ValueError(f"`EdgeLoad.slices` must be at least 1, got {self.slices}.")

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the line load [N/mm]."""
        del model
        load = jg.line_load(cycle, law)
        ends = load
        # Of few slices all are ends, and none counts twice.
        if 2 * self.slices < load.shape[2]:
            ends = jnp.concatenate([load[:, :, : self.slices], load[:, :, -self.slices :]], axis=2)
        return loaded_maximum(ends.ravel(), self.width) * jg.mm
