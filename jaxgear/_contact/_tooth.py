r"""Compliance of one tooth and of a Hertzian contact, per length of contact line.

A line load $F'$ acts along the common normal. Every compliance here is secant, deflection
over line load [m2/N], in plane strain. Sources: Weber & Banaschek 1953 as in Guilbert 2017
eq. 1.1-1.3, corrected and for any Poisson's ratio (theory 3.1, theory 3.2, theory 3.8).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._compiled import compiled
from jaxgear._geometry._gear import Material
from jaxgear._geometry._profile import ToothSection
from jaxgear._types import Reals, Scalar


class ToothLoad(eqx.Module):
    r"""Where a normal load meets a tooth.

    **Fields:**

    - `angle`: $\alpha_p$, between the load and the perpendicular to the tooth's centreline [rad].
    - `height`: $Y_c$, where the load crosses the centreline, above the gear's centre [m].
    - `depth`: distance along the load from contact to centreline [m].
    """

    angle: Reals
    height: Reals
    depth: Reals


def tooth_load(section: ToothSection, roll_angle: Reals) -> ToothLoad:
    r"""Line of action of a normal load on an involute tooth.

    **Arguments:**

    - `section`: the tooth.
    - `roll_angle`: $\tan\alpha(r)$ of the loaded point [rad].

    **Returns:**

    The load's geometry, each field of the shape of `roll_angle`.
    """
    angle = jnp.arctan(roll_angle) - section.half_angle(roll_angle)
    return ToothLoad(
        angle=angle,
        height=section.base_radius / jnp.cos(angle),
        depth=section.base_radius * (roll_angle - jnp.tan(angle)),
    )


# Gauss-Legendre on [0, 1]. Fillet and flank are smooth in their own parameters: 16 points each
# leave less than 1e-10 of the integrals.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS

Curve = Callable[[Reals], tuple[Reals, Reals]]


def _parameter_at_height(curve: Curve, start: Scalar, height: Scalar) -> Scalar:
    """Where a monotone `curve` reaches `height`, by Newton; differentiated implicitly."""

    def excess(parameter: Scalar) -> Scalar:
        return curve(parameter)[1] - height

    def newton(function: Callable[[Scalar], Scalar], guess: Scalar) -> Scalar:
        def step(index: Array, parameter: Scalar) -> Scalar:
            del index
            value, slope = jax.jvp(function, (parameter,), (jnp.ones_like(parameter),))
            return parameter - value / slope

        return jax.lax.fori_loop(0, 8, step, guess)

    def divide(linear: Callable[[Scalar], Scalar], right: Scalar) -> Scalar:
        return right / linear(jnp.ones_like(right))

    return jax.lax.custom_root(excess, start, newton, divide)


def _integrals(
    curve: Curve, first: Scalar, last: Scalar, load_height: Scalar
) -> tuple[Scalar, Scalar]:
    """Integrals of (Y_c - y)^2/d^3 and of 1/d over height y, along `curve`."""
    parameter = first + (last - first) * jnp.asarray(_NODES)
    (half, y), (_, slope) = jax.jvp(curve, (parameter,), (jnp.ones_like(parameter),))
    thickness = 2.0 * half
    weight = (last - first) * slope * jnp.asarray(_WEIGHTS)
    return jnp.sum(weight * (load_height - y) ** 2 / thickness**3), jnp.sum(weight / thickness)


def _cantilever(
    section: ToothSection, roll_angle: Scalar, load_height: Scalar
) -> tuple[Scalar, Scalar]:
    """Bending and shear integrals from the root chord to the load's crossing [-]."""
    root_angle = jnp.asarray(0.5 * jnp.pi)
    begin_angle = section.pressure_angle
    root, junction = section.fillet(root_angle)[1], section.fillet(begin_angle)[1]
    # A load low on the flank crosses the centreline within the fillet, or below the chord,
    # where no cantilever is left.
    in_fillet = jnp.clip(load_height, root, junction)
    # The fillet leaves the root circle tangentially: its height is quadratic there, and Newton
    # starts where that parabola would put it.
    share = jnp.sqrt((in_fillet - root) / (junction - root))
    guess = root_angle - (root_angle - begin_angle) * share
    fillet_end = _parameter_at_height(section.fillet, guess, in_fillet)
    flank_end = _parameter_at_height(section.flank, roll_angle, jnp.maximum(load_height, junction))
    bending, shear = _integrals(section.fillet, root_angle, fillet_end, load_height)
    more = _integrals(section.flank, section.form_roll_angle, flank_end, load_height)
    return bending + more[0], shear + more[1]


@compiled
def beam_compliance(section: ToothSection, material: Material, roll_angle: Reals) -> Reals:
    r"""Weber-Banaschek bending, shear and compression of the tooth as a cantilever.

    $\frac{\cos^2\alpha_p}{E}\left[12(1-\nu^2)\int\frac{(Y_c-y)^2}{d^3}dy +
    (2.4(1+\nu) + (1-\nu^2)\tan^2\alpha_p)\int\frac{dy}{d}\right]$ with $d(y)$ the full
    thickness, from the root chord to the height $Y_c$ where the load crosses the centreline.

    **Arguments:**

    - `section`: the tooth.
    - `material`: its material.
    - `roll_angle`: of the loaded points [rad].

    **Returns:**

    Compliance at each point [m2/N].
    """
    load = tooth_load(section, roll_angle)
    bending, shear = jnp.vectorize(lambda roll, height: _cantilever(section, roll, height))(
        roll_angle, load.height
    )
    poisson = material.poisson
    stretch = 1.0 - poisson**2
    inner = 12.0 * stretch * bending
    inner += (2.4 * (1.0 + poisson) + stretch * jnp.tan(load.angle) ** 2) * shear
    return jnp.cos(load.angle) ** 2 / material.young * inner


class HertzContact(eqx.Module):
    r"""Two cylinders pressed together along a line, axes parallel, plane strain (theory 3.7).

    **Fields:**

    - `radius`: equivalent radius $\rho_{eq}$, $1/\rho_{eq} = 1/\rho_1 + 1/\rho_2$ [m].
    - `modulus`: contact modulus $E^*$, $1/E^* = \sum (1-\nu_i^2)/E_i$ [Pa].
    """

    radius: Reals
    modulus: Scalar

    def half_width(self, line_load: Reals) -> Reals:
        r"""$a_H = \sqrt{4 F' \rho_{eq} / (\pi E^*)}$ [m] under `line_load` [N/m]."""
        return jnp.sqrt(4.0 * line_load * self.radius / (jnp.pi * self.modulus))

    def pressure(self, line_load: Reals) -> Reals:
        r"""Pressure $p_0 = \sqrt{F' E^* / (\pi \rho_{eq})}$ [Pa] under `line_load` [N/m]."""
        # No load is no pressure; the floor (1e-9 Pa of pressure, about) keeps its slope finite.
        loaded = jnp.maximum(line_load, 1e-30)
        return jnp.where(
            line_load > 0.0, jnp.sqrt(loaded * self.modulus / (jnp.pi * self.radius)), 0.0
        )


def contact_modulus(first: Material, second: Material) -> Scalar:
    r"""$E^*$ of two materials [Pa]."""
    soft, hard = ((1.0 - m.poisson**2) / m.young for m in (first, second))
    return 1.0 / (soft + hard)


@compiled
def penetration_compliance(material: Material, depth: Reals, half_width: Reals) -> Reals:
    r"""One body's share of the contact deflection, over the line load (Weber's logarithm).

    $\frac{2(1-\nu^2)}{\pi E}\left[\ln\frac{2d}{a_H} - \frac{\nu}{2(1-\nu)}\right]$: approach of
    the contact and a point at depth $d$ below it (theory 3.8).

    **Arguments:**

    - `material`: of the body.
    - `depth`: $d$, from the surface to the tooth's centreline along the load [m].
    - `half_width`: $a_H$ of the contact [m].

    **Returns:**

    Secant compliance [m2/N].
    """
    poisson = material.poisson
    inner = jnp.log(2.0 * depth / half_width) - poisson / (2.0 * (1.0 - poisson))
    return 2.0 * (1.0 - poisson**2) / (jnp.pi * material.young) * inner
