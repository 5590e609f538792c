"""Tooth stiffnesses of ISO 6336-1, method B."""

import equinox as eqx
import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Scalar


class IsoStiffness(eqx.Module):
    r"""Stiffnesses of ISO 6336-1 method B, per face width in the transverse plane.

    **Fields:**

    - `theoretical`: $c'_{th}$ [N/m2].
    - `single`: $c'$ [N/m2].
    - `mesh`: $c_{\gamma\alpha}$, the mean mesh stiffness for the dynamic factor [N/m2].
    - `face`: $c_{\gamma\beta}$, the mean mesh stiffness for the face load factor [N/m2].
    """

    theoretical: Scalar
    single: Scalar
    mesh: Scalar
    face: Scalar


# ISO 6336-1 table 9: C1..C9 [mm um/N], with x2 squared in the last.
_ISO = (0.04723, 0.15551, 0.25791, -0.00635, -0.11654, -0.00193, -0.24188, 0.00529, 0.00182)
_ISO_MEASURED = 0.8  # C_M, ratio of measured to theoretical stiffness
_ISO_YOUNG = 206e9  # steel, for which the series was fitted [Pa]
_ISO_LOAD = 100e3  # below this line load the stiffness falls off [N/m]


@compiled
def iso_stiffness(pair: GearPair, line_load: Scalar) -> IsoStiffness:
    r"""ISO 6336-1 method B for solid discs, with the basic rack's factor $C_B$.

    The standard fits it for $x_1 \ge x_2$, $-0.5 \le x_1 + x_2 \le 2$, helix angles up to 30
    degrees and $\varepsilon_\alpha \ge 1.2$; outside it is extrapolated (theory 3.10, theory 3.11).

    **Arguments:**

    - `pair`: the gears.
    - `line_load`: $F_t K_A / b$ [N/m]; below 100 N/mm the single stiffness falls as its
        fourth root.

    **Returns:**

    The standard's four stiffnesses.
    """
    spread = jnp.cos(pair.base_helix_angle) ** 2 * jnp.cos(pair.helix_angle)
    first, second = 1.0 / (pair.teeth / spread)
    x1, x2 = pair.of_bodies("profile_shift")
    terms = (1.0, first, second, x1, x1 * first, x2, x2 * second, x1**2, x2**2)
    flexibility = sum(c * term for c, term in zip(_ISO, terms, strict=True))
    young = jnp.stack([pair.pinion.material.young, pair.wheel.material.young])
    steel = 2.0 * young[0] * young[1] / (young[0] + young[1]) / _ISO_YOUNG
    theoretical = 1e9 * steel / flexibility
    dedendum = jnp.mean(pair.of_bodies("dedendum"))
    rack = 1.0 + 0.5 * (1.2 - dedendum)
    rack *= 1.0 - 0.02 * (20.0 - jnp.rad2deg(pair.pressure_angle))
    low = jnp.minimum(line_load / _ISO_LOAD, 1.0) ** 0.25
    single = theoretical * _ISO_MEASURED * rack * jnp.cos(pair.helix_angle) * low
    ratio = pair.path_of_contact / pair.transverse_base_pitch
    mesh = single * (0.75 * ratio + 0.25)
    return IsoStiffness(theoretical=theoretical, single=single, mesh=mesh, face=0.85 * mesh)
