r"""Nominal tooth-root stress of ISO 6336-3:2019, method B, and what judges it.

$\sigma_{F0} = \frac{F_t}{b\,m_n} Y_F Y_S Y_\beta Y_B Y_{DT}$ with the load at the highest point of
single contact of the virtual spur gear and the section between the 30-degree tangents. Racks
without protuberance. Factors of application, speed and load distribution are for the user to add.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._geometry._involute import involute
from jaxgear._geometry._pair import GearPair, overlap_ratio, profile_contact_ratio
from jaxgear._types import Bodies, Reals, Scalar

# Of the implicit equation of the 30-degree tangent, a contraction by 2 G/z_n.
_ROUNDS = 40


class RootSection(eqx.Module):
    """The section between the 30-degree tangents of a virtual tooth, in modules.

    **Fields:**

    - `chord`: $s_{Fn}/m_n$ [-].
    - `lever`: $h_F/m_n$, from the chord to where the load crosses the centreline [-].
    - `radius`: $\rho_F/m_n$ of the fillet there [-].
    - `load_angle`: $\\alpha_F$ between the load and the perpendicular to the centreline [rad].
    - `pressure_angle`: $\\alpha_n$ [rad].
    """

    chord: Reals
    lever: Reals
    radius: Reals
    load_angle: Reals
    pressure_angle: Reals

    @property
    def form_factor(self) -> Reals:
        r"""$Y_F = \frac{6 h_F\cos\alpha_F/m_n}{(s_{Fn}/m_n)^2\cos\alpha_n}$ [-]."""
        moment = 6.0 * self.lever * jnp.cos(self.load_angle)
        return moment / (self.chord**2 * jnp.cos(self.pressure_angle))

    @property
    def stress_correction(self) -> Reals:
        r"""$Y_S = (1.2 + 0.13 L)\,q_s^{1/(1.21 + 2.3/L)}$, $L = s_{Fn}/h_F$ [-]."""
        slender = self.chord / self.lever
        notch = 0.5 * self.chord / self.radius
        return (1.2 + 0.13 * slender) * notch ** (1.0 / (1.21 + 2.3 / slender))


def root_section(
    teeth: Reals,
    pressure_angle: Reals,
    profile_shift: Reals,
    dedendum: Reals,
    fillet_radius: Reals,
    load_radius: Reals,
) -> RootSection:
    r"""The critical section of a rack-cut tooth, ISO 6336-3:2019, 6.2 (external gears).

    **Arguments:**

    - `teeth`: $z_n$ of the virtual gear [-].
    - `pressure_angle`: $\alpha_n$ [rad].
    - `profile_shift`, `dedendum`, `fillet_radius`: $x$, $h^*_{fP}$, $\rho^*_{fP}$ [-].
    - `load_radius`: at which the load meets the flank, $d_{en}/(2 m_n)$ [-].

    **Returns:**

    The section, its load included.
    """
    tangent = jnp.tan(pressure_angle)
    depth = fillet_radius - dedendum + profile_shift
    land = 0.25 * jnp.pi - dedendum * tangent
    land -= (1.0 - jnp.sin(pressure_angle)) * fillet_radius / jnp.cos(pressure_angle)
    shift = 2.0 / teeth * (0.5 * jnp.pi - land) - jnp.pi / 3.0

    def turned(index, angle: Reals) -> Reals:
        del index
        value = angle - 2.0 * depth / teeth * jnp.tan(angle) + shift
        slope = 1.0 - 2.0 * depth / teeth / jnp.cos(angle) ** 2
        return angle - value / slope

    angle = jax.lax.fori_loop(0, _ROUNDS, turned, jnp.full_like(shift, jnp.pi / 6.0))
    # Once more, for its derivative.
    angle = turned(0, jax.lax.stop_gradient(angle))
    reach = depth / jnp.cos(angle)
    chord = teeth * jnp.sin(jnp.pi / 3.0 - angle) + jnp.sqrt(3.0) * (reach - fillet_radius)
    curved = jnp.cos(angle) * (teeth * jnp.cos(angle) ** 2 - 2.0 * depth)
    base = 0.5 * teeth * jnp.cos(pressure_angle)
    at_load = jnp.arccos(base / load_radius)
    half = (0.5 * jnp.pi + 2.0 * tangent * profile_shift) / teeth
    half += involute(pressure_angle) - involute(at_load)
    load_angle = at_load - half
    crossing = 2.0 * load_radius * (jnp.cos(half) - jnp.sin(half) * jnp.tan(load_angle))
    below = teeth * jnp.cos(jnp.pi / 3.0 - angle) + reach - fillet_radius
    return RootSection(
        chord=chord,
        lever=0.5 * (crossing - below),
        radius=fillet_radius + 2.0 * depth**2 / curved,
        load_angle=load_angle,
        pressure_angle=pressure_angle,
    )


class NominalRootStress(eqx.Module):
    r"""The nominal root stress of both gears and its factors.

    **Fields:**

    - `stress`: $\sigma_{F0}$ [Pa].
    - `form_factor`: $Y_F$ [-].
    - `stress_correction`: $Y_S$ [-].
    - `helix_factor`: $Y_\beta$ [-].
    - `rim_factor`: $Y_B$ [-].
    - `deep_tooth_factor`: $Y_{DT}$ [-].
    """

    stress: Bodies
    form_factor: Bodies
    stress_correction: Bodies
    helix_factor: Scalar
    rim_factor: Bodies
    deep_tooth_factor: Scalar

    def safety(self, permissible: Bodies) -> Bodies:
        r"""$S_F = \sigma_{FG}/\sigma_{F0}$ for tooth-root limits $\sigma_{FG}$ [Pa] [-]."""
        return permissible / self.stress


@compiled
def nominal_root_stress(pair: GearPair, tangential: Scalar) -> NominalRootStress:
    r"""Nominal root stress of ISO 6336-3:2019, method B (theory 3.13).

    $Y_\beta = (1 - \min(\varepsilon_\beta, 1)\,\beta/120°)/\cos^3\beta$ with $\beta \le 30°$;
    $Y_B = 1.6\ln(2.242\,h_t/s_R)$, at least 1, of the rim $s_R$ between bore and root circle, held
    to that of $s_R = 0.5\,h_t$ below it; $Y_{DT}$ falls from 1 at $\varepsilon_{\alpha n} = 2.05$
    to 0.7 at 2.5, as for tolerance classes up to 4.

    **Arguments:**

    - `pair`: the gears; the loaded width is the common face.
    - `tangential`: $F_t$ at the reference circles [N].

    **Returns:**

    Stress and factors, pinion first.
    """
    base_helix = jnp.cos(pair.base_helix_angle)
    helix = jnp.cos(pair.helix_angle)
    teeth = pair.teeth / (base_helix**2 * helix)
    contact = profile_contact_ratio(pair) / base_helix**2
    cosine = jnp.cos(pair.pressure_angle)
    module = pair.normal_module
    tip = 0.5 * teeth + (pair.tip_radius - pair.reference_radius) / module
    base = 0.5 * teeth * cosine
    path = jnp.sqrt(tip**2 - base**2) - jnp.pi * cosine * jnp.maximum(contact - 1.0, 0.0)
    section = root_section(
        teeth,
        pair.pressure_angle,
        pair.of_bodies("profile_shift"),
        pair.of_bodies("dedendum"),
        pair.of_bodies("fillet_radius"),
        jnp.sqrt(path**2 + base**2),
    )
    degrees = jnp.minimum(jnp.rad2deg(jnp.abs(pair.helix_angle)), 30.0)
    overlap = jnp.minimum(overlap_ratio(pair), 1.0)
    helix_factor = (1.0 - overlap * degrees / 120.0) / helix**3
    deep = jnp.clip(2.366 - 0.666 * contact, 0.7, 1.0)
    rim = _rim_factor(pair)
    form, correction = section.form_factor, section.stress_correction
    nominal = tangential / (pair.face_width * module) * form * correction
    return NominalRootStress(
        stress=nominal * helix_factor * rim * deep,
        form_factor=form,
        stress_correction=correction,
        helix_factor=helix_factor,
        rim_factor=rim,
        deep_tooth_factor=deep,
    )


def _rim_factor(pair: GearPair) -> Bodies:
    factors = []
    for gear, tip, root in zip(
        (pair.pinion, pair.wheel), pair.tip_radius, pair.root_radius, strict=True
    ):
        if gear.bore is None:
            factors.append(jnp.ones(()))
            continue
        thick = (root - 0.5 * gear.bore) / (tip - root)
        factors.append(jnp.maximum(1.6 * jnp.log(2.242 / jnp.maximum(thick, 0.5)), 1.0))
    return jnp.stack(factors)
