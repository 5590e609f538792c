r"""Power that sliding flanks lose, and the efficiency of a mesh.

Friction is Coulomb's, with one coefficient for the whole path, and does not act back on the loads:
with coefficients of some hundredths they change by about as much. Losses of bearings, seals and of
oil that is churned and squeezed out of the mesh are not counted.
"""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._sliding import sliding_speed
from jaxgear._solve._cycle import MeshCycle
from jaxgear._types import Scalar, as_scalar


@compiled
def mesh_loss_factor(pair: GearPair, cycle: MeshCycle) -> Scalar:
    r"""Mean power that a mesh loses over coefficient of friction and power (theory 11.3).

    $H_{VL} = \overline{\sum F v_g}\,/\,\overline{\sum F}\,r_{b1}\omega_1\cos\beta_b$ over the cells
    of all contact lines and the phases of the cycle, with the loads of the model: the local tooth
    loss factor of Wimmer (TU Munich, 2006). With even loads it is `tooth_loss_factor`. It does not
    depend on the speed.

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.

    **Returns:**

    The factor [-].
    """
    lines = cycle.cells.lines
    force = lines.weight[:, None, None] * cycle.force.reshape(lines.roll.shape)
    sliding = jnp.abs(sliding_speed(pair, lines.roll, as_scalar(1.0)))
    arm = pair.base_radius[0] * jnp.cos(pair.base_helix_angle)
    return jnp.sum(force * sliding) / (jnp.sum(force) * arm)


@compiled
def mesh_efficiency(pair: GearPair, cycle: MeshCycle, friction_coefficient: Scalar) -> Scalar:
    r"""Share of the power that a mesh passes on, $\eta = 1 - \mu H_{VL}$ with `mesh_loss_factor`.

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.
    - `friction_coefficient`: $\mu$, its mean over the path: 0.02 to 0.08 of oiled steel [-].

    **Returns:**

    The efficiency [-].
    """
    return 1.0 - friction_coefficient * mesh_loss_factor(pair, cycle)
