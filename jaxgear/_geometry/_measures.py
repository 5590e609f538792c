r"""What a gear checker measures of tooth thickness: span over teeth and measure over balls.

Formulas: ISO 21771-1 (DIN 3960), external gears. $A_s$ is the tooth thickness allowance, which
counts; `_drawn` goes the other way, from a measure to the profile shift.
"""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._geometry._drawn import opposite
from jaxgear._geometry._involute import inverse_involute, involute
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Bodies


@compiled
def span_measure(pair: GearPair, spanned: Bodies) -> Bodies:
    r"""$W_k$, the base tangent length over some teeth of each gear, between parallel faces.

    $W_k = m_n\cos\alpha_n\,[(k - \tfrac12)\pi + z\,\mathrm{inv}\,\alpha_t] + 2 x m_n\sin\alpha_n -
    A_s\cos\alpha_n$ (theory 1.11).

    **Arguments:**

    - `pair`: the gears.
    - `spanned`: $k$ of each gear, as reals [-].

    **Returns:**

    $W_k$ [m].
    """
    cosine = jnp.cos(pair.pressure_angle)
    pitches = (spanned - 0.5) * jnp.pi + pair.teeth * involute(pair.transverse_pressure_angle)
    shifted = 2.0 * pair.of_bodies("profile_shift") * jnp.sin(pair.pressure_angle)
    return pair.normal_module * (cosine * pitches + shifted) - pair.thickness_allowances * cosine


@compiled
def span_radius(pair: GearPair, spanned: Bodies) -> Bodies:
    r"""Where the faces of a span touch: $r = \sqrt{r_b^2 + (W_k\cos\beta_b/2)^2}$ at mid-span.

    **Arguments:**

    - `pair`: the gears.
    - `spanned`: $k$ of each gear, as reals [-].

    **Returns:**

    Radius of the points of contact, which must lie on the involutes [m].
    """
    across = 0.5 * span_measure(pair, spanned) * jnp.cos(pair.base_helix_angle)
    return jnp.hypot(pair.base_radius, across)


@compiled
def usual_span(pair: GearPair) -> Bodies:
    r"""The number of teeth whose span is measured near $d + 2 x m_n$, midway up the teeth.

    $k = \frac{z}{\pi}\left[\frac{\tan\alpha_{vt}}{\cos^2\beta_b} - \frac{2x}{z}\tan\alpha_n -
    \mathrm{inv}\,\alpha_t\right] + \frac12$ at the V circle, rounded; at least 1.

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    $k$, whole, as reals [-].
    """
    shift = 2.0 * pair.of_bodies("profile_shift") * jnp.tan(pair.pressure_angle)
    pitches = pair.teeth * _v_roll(pair) / jnp.cos(pair.base_helix_angle) ** 2 - shift
    pitches -= pair.teeth * involute(pair.transverse_pressure_angle)
    return jnp.maximum(jnp.round(pitches / jnp.pi + 0.5), 1.0)


@compiled
def ball_measure(pair: GearPair, ball: Bodies) -> Bodies:
    r"""$M_{dK}$, the diametral measure over two balls in opposite spaces of each gear.

    $M_{dK} = d_K + D_M$, with an odd number of teeth $d_K\cos(\pi/2z) + D_M$, where $d_K =
    d_b/\cos\alpha_{Kt}$ and $\mathrm{inv}\,\alpha_{Kt} = \mathrm{inv}\,\alpha_t +
    D_M/(z m_n\cos\alpha_n) - (\pi - s_n/m_n)/z$ (theory 1.12).

    **Arguments:**

    - `pair`: the gears.
    - `ball`: diameter $D_M$ of a ball of each gear [m].

    **Returns:**

    $M_{dK}$, the balls in one transverse plane [m].
    """
    nearly = jnp.asarray([opposite(gear.teeth) for gear in (pair.pinion, pair.wheel)])
    return 2.0 * pair.base_radius / jnp.cos(_ball_angle(pair, ball)) * nearly + ball


@compiled
def ball_radius(pair: GearPair, ball: Bodies) -> Bodies:
    r"""Where balls touch the flanks: $\tan\alpha_{Mt} = \tan\alpha_{Kt} - D_M\cos\beta_b/d_b$.

    **Arguments:**

    - `pair`: the gears.
    - `ball`: diameter of a ball of each gear [m].

    **Returns:**

    Radius of the points of contact, which must lie on the involutes [m].
    """
    roll = 2.0 * pair.base_radius * jnp.tan(_ball_angle(pair, ball))
    roll = roll - ball * jnp.cos(pair.base_helix_angle)
    return jnp.hypot(pair.base_radius, 0.5 * roll)


@compiled
def usual_ball(pair: GearPair) -> Bodies:
    r"""The ball of each gear that touches at $d + 2 x m_n$, midway up the teeth.

    $\alpha_{Kt}$ at its centre solves $\tan\alpha_{Kt} - \tan\alpha_{vt} = \cos^2\beta_b\,
    (\mathrm{inv}\,\alpha_{Kt} + \eta)$, with $\eta$ half the angle of a space at the base circle:
    closed for spur gears, by Newton's method from there for helical ones.

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    Its diameter [m].
    """
    space, low, share = _half_space(pair), _v_roll(pair), jnp.cos(pair.base_helix_angle) ** 2
    angle = low + space
    for _ in range(_NEWTON):
        slope = 1.0 + (1.0 - share) * jnp.tan(angle) ** 2
        angle -= (jnp.tan(angle) - low - share * (involute(angle) + space)) / slope
    base_diameter = 2.0 * pair.base_radius * jnp.cos(pair.base_helix_angle)
    return base_diameter * (involute(angle) + space)


# Steps to the ball of a helical gear of 45 degrees; each doubles the digits, of which 3 are there.
_NEWTON = 5


def _ball_angle(pair: GearPair, ball: Bodies) -> Bodies:
    r"""$\alpha_{Kt}$, transverse pressure angle at the centres of balls [rad]."""
    along = ball / (pair.teeth * pair.normal_module * jnp.cos(pair.pressure_angle))
    return inverse_involute(along - _half_space(pair))


def _half_space(pair: GearPair) -> Bodies:
    r"""$\eta$, half the angle of a space at the base circle, transverse [rad]."""
    thinner = pair.thickness_allowances / pair.normal_module / pair.teeth
    return jnp.pi / pair.teeth - pair.half_thickness_at_base + thinner


def _v_roll(pair: GearPair) -> Bodies:
    r"""$\tan\alpha_{vt}$ at the V circle, $d + 2 x m_n$ [rad]."""
    v_radius = pair.reference_radius + pair.normal_module * pair.of_bodies("profile_shift")
    # A gear whose V circle lies within its base circle is measured close to that.
    return jnp.sqrt(jnp.maximum((v_radius / pair.base_radius) ** 2 - 1.0, 0.01))
