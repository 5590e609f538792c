r"""Rack coefficients of an external gear from what its drawing says instead of them.

Tip and root diameters, the span over some teeth, the diametral measure over two balls: closed forms
of ISO 21771-1 (DIN 3960). They take plain numbers as well as arrays of JAX, traced ones too, and
plain numbers without importing JAX: a file of a gear is read with them. `_measures` goes the other
way.
"""

import math
from typing import Any

# A plain number, or a scalar array of JAX.
Real = Any


def addendum_of_tip(
    tip_diameter: Real,
    *,
    teeth: int,
    module: Real,
    helix_angle: Real = 0.0,
    profile_shift: Real = 0.0,
    tip_shortening: Real = 0.0,
) -> Real:
    r"""$h^*_{aP} = (d_a - d)/(2 m_n) - x + k$, with $d = z m_n/\cos\beta$.

    **Arguments:**

    - `tip_diameter`: $d_a$ [m].
    - `teeth`: number of teeth.
    - `module`: $m_n$ [m].
    - `helix_angle`: $\beta$ [rad].
    - `profile_shift`: $x$ [-].
    - `tip_shortening`: $k$ [-].

    **Returns:**

    The addendum coefficient [-].
    """
    d = teeth * module / _of(helix_angle).cos(helix_angle)
    return 0.5 * (tip_diameter - d) / module - profile_shift + tip_shortening


def dedendum_of_root(
    root_diameter: Real,
    *,
    teeth: int,
    module: Real,
    helix_angle: Real = 0.0,
    profile_shift: Real = 0.0,
) -> Real:
    r"""$h^*_{fP} = (d - d_f)/(2 m_n) + x$, with $d = z m_n/\cos\beta$.

    **Arguments:**

    - `root_diameter`: $d_f$ [m].
    - `teeth`, `module`, `helix_angle`, `profile_shift`: as of `addendum_of_tip`.

    **Returns:**

    The dedendum coefficient [-].
    """
    d = teeth * module / _of(helix_angle).cos(helix_angle)
    return 0.5 * (d - root_diameter) / module + profile_shift


def profile_shift_of_span(
    span: Real,
    spanned: int,
    *,
    teeth: int,
    module: Real,
    pressure_angle: Real,
    helix_angle: Real = 0.0,
    thickness_allowance: Real = 0.0,
) -> Real:
    r"""The profile shift of a gear by its base tangent length over some teeth (theory 1.11).

    $W_k = m_n\cos\alpha_n\,[(k - \tfrac12)\pi + z\,\mathrm{inv}\,\alpha_t] + 2 x m_n\sin\alpha_n -
    A_s\cos\alpha_n$, solved for $x$.

    **Arguments:**

    - `span`: $W_k$ of the teeth as they are made [m].
    - `spanned`: $k$, how many teeth it is measured over.
    - `teeth`: number of teeth.
    - `module`: $m_n$ [m].
    - `pressure_angle`: $\alpha_n$ [rad].
    - `helix_angle`: $\beta$ [rad].
    - `thickness_allowance`: $A_s$, by how much they are made thinner than $x$ says, at the
        reference cylinder in the normal section [m].

    **Returns:**

    $x$ [-].
    """
    xp = _of(span, module, pressure_angle, helix_angle, thickness_allowance)
    sine, cosine = xp.sin(pressure_angle), xp.cos(pressure_angle)
    at_reference = involute(transverse_angle(pressure_angle, helix_angle))
    without_shift = module * cosine * ((spanned - 0.5) * math.pi + teeth * at_reference)
    return (span - without_shift + thickness_allowance * cosine) / (2.0 * module * sine)


def profile_shift_of_balls(
    over_balls: Real,
    ball: Real,
    *,
    teeth: int,
    module: Real,
    pressure_angle: Real,
    helix_angle: Real = 0.0,
    thickness_allowance: Real = 0.0,
) -> Real:
    r"""The profile shift of a gear by its measure over two balls in opposite spaces (theory 1.12).

    The centres lie at $d_K = M_{dK} - D_M$, over $\cos(\pi/2z)$ with an odd number of teeth, where
    $\cos\alpha_{Kt} = d_b/d_K$; from $\mathrm{inv}\,\alpha_{Kt} = \mathrm{inv}\,\alpha_t +
    D_M/(z m_n\cos\alpha_n) - (\pi - s_n/m_n)/z$ follows the tooth thickness
    $s_n = m_n(\pi/2 + 2x\tan\alpha_n) - A_s$.

    **Arguments:**

    - `over_balls`: $M_{dK}$ of the teeth as they are made, the balls in one transverse plane [m].
    - `ball`: diameter $D_M$ of a ball [m].
    - `teeth`, `module`, `pressure_angle`, `helix_angle`, `thickness_allowance`: as of
        `profile_shift_of_span`.

    **Returns:**

    $x$ [-].

    **Raises:**

    - `ValueError`, of plain numbers, if the centres of the balls would lie within the base circle.
    """
    xp = _of(over_balls, ball, module, pressure_angle, helix_angle, thickness_allowance)
    angle = transverse_angle(pressure_angle, helix_angle)
    base = teeth * module / xp.cos(helix_angle) * xp.cos(angle)
    centres = (over_balls - ball) / opposite(teeth)
    at_centre = involute(xp.acos(base / centres))
    angular = at_centre - involute(angle) - ball / (teeth * module * xp.cos(pressure_angle))
    thickness = teeth * angular + math.pi + thickness_allowance / module
    return 0.5 * (thickness - 0.5 * math.pi) / xp.tan(pressure_angle)


def opposite(teeth: int) -> float:
    r"""Distance of two spaces as nearly opposite as can be, over the diameter of their middles.

    **Arguments:**

    - `teeth`: number of teeth.

    **Returns:**

    1, or $\cos(\pi/2z)$ with an odd number of teeth [-].
    """
    return math.cos(0.5 * math.pi / teeth) if teeth % 2 else 1.0


def transverse_angle(pressure_angle: Real, helix_angle: Real) -> Real:
    r"""The transverse pressure angle, $\tan\alpha_t = \tan\alpha_n/\cos\beta$.

    **Arguments:**

    - `pressure_angle`: $\alpha_n$ [rad].
    - `helix_angle`: $\beta$ [rad].

    **Returns:**

    $\alpha_t$ [rad].
    """
    xp = _of(pressure_angle, helix_angle)
    return xp.atan(xp.tan(pressure_angle) / xp.cos(helix_angle))


def involute(angle: Real) -> Real:
    r"""The involute function, $\mathrm{inv}\,\alpha = \tan\alpha - \alpha$.

    **Arguments:**

    - `angle`: $\alpha$ [rad].

    **Returns:**

    Its involute [rad].
    """
    return _of(angle).tan(angle) - angle


def _of(*numbers: Real) -> Any:
    """Functions for these numbers: those of JAX where one is an array."""
    if all(isinstance(number, int | float) for number in numbers):
        return math
    import jax.numpy as jnp

    return jnp
