r"""Flank deviations that a tolerance class allows: ISO 1328-1:2013, formulas (5) to (12).

The standard gives magnitudes, in the transverse plane: profile and helix deviations along the
base tangent, pitch deviations along an arc. It gives no shapes. `GradeWaveform` is a choice of
shapes, to be argued about; `deviation_of_grade` turns both into flank deviations along the flank
normal. Classes of the edition of 1995 (0 to 12) are others, with other formulas.
"""

from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._flank._deviations import HelixSlope, ProfileSlope, ProfileWaviness, Superposed
from jaxgear._geometry._pair import GearPair, pair_facts
from jaxgear._types import Scalar, as_scalar
from jaxgear._units import deg, mm, um

if TYPE_CHECKING:
    Teeth = Array
else:
    Teeth = Float[Array, "tooth"]


class FlankTolerances(eqx.Module):
    r"""What a class of ISO 1328-1:2013 allows one gear, unrounded, in the transverse plane.

    **Fields:**

    - `single_pitch`: $f_{pT}$, of one pitch, along the reference circle [m].
    - `cumulative_pitch`: $F_{pT}$, total, along the reference circle [m].
    - `profile_slope`: $f_{H\alpha T}$ [m].
    - `profile_form`: $f_{f\alpha T}$ [m].
    - `profile`: $F_{\alpha T}$, total [m].
    - `helix_slope`: $f_{H\beta T}$ [m].
    - `helix_form`: $f_{f\beta T}$ [m].
    - `helix`: $F_{\beta T}$, total [m].
    """

    single_pitch: Scalar
    cumulative_pitch: Scalar
    profile_slope: Scalar
    profile_form: Scalar
    profile: Scalar
    helix_slope: Scalar
    helix_form: Scalar
    helix: Scalar


class GradeWaveform(eqx.Module):
    r"""The shapes, within a tolerance class, that a gear's deviations take.

    The profile form is a wave of `waves` periods from start of active profile to tip. With the
    default phase it is a cosine: it has zero mean and, fitted by a straight line, zero slope, so
    it is pure form, and the waves of two gears with as many of them add up. A sine would have a
    slope, and those of two gears of one class would cancel: `profile` runs the other way on the
    wheel. The wave reaches its full height at both ends, where it adds material.

    **Fields:**

    - `waves`: periods of the profile form over the path of contact [-].
    - `phase`: of the profile form at the start of active profile [rad]; 0 is a sine.
    - `profile_slope`: share of the slope tolerance that is used, signed as `ProfileSlope` [-].
    - `helix_slope`: share of the slope tolerance that is used, signed as `HelixSlope` [-].
    - `pitch_phase`: of the cumulative pitch error's sine at the first tooth [rad].
    """

    waves: Scalar = eqx.field(converter=as_scalar, default=3.0)
    phase: Scalar = eqx.field(converter=as_scalar, default=0.5 * np.pi)
    profile_slope: Scalar = eqx.field(converter=as_scalar, default=0.0)
    helix_slope: Scalar = eqx.field(converter=as_scalar, default=0.0)
    pitch_phase: Scalar = eqx.field(converter=as_scalar, default=0.0)


def flank_tolerances(
    pair: GearPair, gear_index: int, grade: Scalar | float | int
) -> FlankTolerances:
    r"""Tolerances of ISO 1328-1:2013 for one gear (theory 2.4).

    Each class is $\sqrt 2$ times the one before. Values are not rounded as the standard's are,
    and the class may be any real number between its first and last, so that both can be
    differentiated.

    **Arguments:**

    - `pair`: the gears.
    - `gear_index`: 0 is the pinion, 1 the wheel.
    - `grade`: flank tolerance class $A$, 1 to 11 [-].

    **Returns:**

    The tolerances [m].

    **Raises:**

    - `ValueError` if the class or the gear is outside the standard's range.
    """
    grade = as_scalar(grade)
    _check_range(pair, gear_index, grade)
    return _tolerances(pair, gear_index, grade)


@eqx.filter_jit
def _tolerances(pair: GearPair, gear_index: int, grade: Scalar) -> FlankTolerances:
    d = 2.0 * pair.reference_radius[gear_index] / mm
    b = pair.of_bodies("face_width")[gear_index] / mm
    m = pair.normal_module / mm
    step = 2.0 ** (0.5 * (grade - 5.0)) * um
    profile_slope = step * (0.4 * m + 0.001 * d + 4.0)
    profile_form = step * (0.55 * m + 5.0)
    helix_slope = step * (0.05 * jnp.sqrt(d) + 0.35 * jnp.sqrt(b) + 4.0)
    helix_form = step * (0.07 * jnp.sqrt(d) + 0.45 * jnp.sqrt(b) + 4.0)
    return FlankTolerances(
        single_pitch=step * (0.001 * d + 0.4 * m + 5.0),
        cumulative_pitch=step * (0.002 * d + 0.55 * jnp.sqrt(d) + 0.7 * m + 12.0),
        profile_slope=profile_slope,
        profile_form=profile_form,
        profile=jnp.hypot(profile_slope, profile_form),
        helix_slope=helix_slope,
        helix_form=helix_form,
        helix=jnp.hypot(helix_slope, helix_form),
    )


def deviation_of_grade(
    pair: GearPair,
    gear_index: int,
    grade: Scalar | float | int,
    waveform: GradeWaveform | None = None,
) -> Superposed:
    r"""The deviation of a flank that just uses up its tolerance class, in the given shapes.

    A wave of peak-to-peak $f_{f\alpha T}$ and, if the waveform asks for them, straight slopes of
    $f_{H\alpha T}$ and $f_{H\beta T}$, each times $\cos\beta_b$ to be along the flank normal.
    There is no form deviation across the face. All teeth are alike; see `pitch_error_of_grade`.

    **Arguments:**

    - `pair`: the gears.
    - `gear_index`: 0 is the pinion, 1 the wheel.
    - `grade`: flank tolerance class $A$ of ISO 1328-1:2013, 1 to 11 [-].
    - `waveform`: the shapes; `GradeWaveform()` without it.

    **Returns:**

    The deviation.

    **Raises:**

    - `ValueError` if the class or the gear is outside the standard's range.
    """
    grade = as_scalar(grade)
    _check_range(pair, gear_index, grade)
    return _deviation(pair, gear_index, grade, GradeWaveform() if waveform is None else waveform)


@eqx.filter_jit
def _deviation(pair: GearPair, gear_index: int, grade: Scalar, shape: GradeWaveform) -> Superposed:
    allowed = _tolerances(pair, gear_index, grade)
    normal = jnp.cos(pair.base_helix_angle)
    return Superposed(
        parts=(
            ProfileWaviness(0.5 * normal * allowed.profile_form, shape.waves, shape.phase),
            ProfileSlope(normal * shape.profile_slope * allowed.profile_slope),
            HelixSlope(normal * shape.helix_slope * allowed.helix_slope),
        )
    )


def pitch_error_of_grade(
    pair: GearPair,
    gear_index: int,
    grade: Scalar | float | int,
    waveform: GradeWaveform | None = None,
) -> Teeth:
    r"""Cumulative pitch errors that just use up a tolerance class: one sine over a revolution.

    The sine has the peak-to-peak $F_{pT}$, so that the teeth, which sample it, stay within; its
    steps from tooth to tooth are $F_{pT} \sin(\pi/z)$ at most, far below $f_{pT}$. An arc along
    the reference circle is $\cos\alpha_n \cos\beta$ times as long along the flank normal.

    **Arguments:**

    - `pair`: the gears.
    - `gear_index`: 0 is the pinion, 1 the wheel.
    - `grade`: flank tolerance class $A$ of ISO 1328-1:2013, 1 to 11 [-].
    - `waveform`: the shapes; `GradeWaveform()` without it.

    **Returns:**

    The error of each tooth along the flank normal [m], positive where material is added; the
    sum over all teeth is zero.

    **Raises:**

    - `ValueError` if the class or the gear is outside the standard's range.
    """
    grade = as_scalar(grade)
    _check_range(pair, gear_index, grade)
    return _pitch_error(pair, gear_index, grade, GradeWaveform() if waveform is None else waveform)


@eqx.filter_jit
def _pitch_error(pair: GearPair, gear_index: int, grade: Scalar, shape: GradeWaveform) -> Teeth:
    amplitude = 0.5 * _tolerances(pair, gear_index, grade).cumulative_pitch
    amplitude *= jnp.cos(pair.pressure_angle) * jnp.cos(pair.helix_angle)
    teeth = (pair.pinion, pair.wheel)[gear_index].teeth
    turn = 2.0 * jnp.pi * jnp.arange(teeth, dtype=float) / teeth
    return amplitude * jnp.sin(turn + shape.pitch_phase)


def _check_range(pair: GearPair, gear_index: int, grade: Scalar) -> None:
    """Refuse what the standard does not cover: clause 1 forbids to extrapolate its formulas."""
    require(
        gear_index in (0, 1), "A gear is 0, the pinion, or 1, the wheel, got {got}.", got=gear_index
    )
    require(
        (grade >= 1.0) & (grade <= 11.0),
        "A tolerance class of ISO 1328-1:2013 lies between 1 and 11, got {got:.6g}.",
        got=grade,
    )
    gear, name = (pair.pinion, pair.wheel)[gear_index], ("pinion", "wheel")[gear_index]
    diameter = 2.0 * pair_facts(pair).reference_radius[gear_index]
    for what, value, unit, least, most in (
        ("number of teeth", gear.teeth, 1.0, 5.0, 1000.0),
        ("reference diameter [mm]", diameter, mm, 5.0, 15000.0),
        ("normal module [mm]", pair.normal_module, mm, 0.5, 70.0),
        ("face width [mm]", gear.face_width, mm, 4.0, 1200.0),
        ("helix angle [deg]", pair.helix_angle, deg, -45.0, 45.0),
    ):
        if isinstance(value, Tracer):
            continue
        # A length on the limit is within, whatever its last digit became in metres.
        given = float(value) / unit
        require(
            least - 1e-9 * abs(least) <= given <= most + 1e-9 * most,
            "ISO 1328-1:2013 has no tolerances for this {name}: its {what} must lie between "
            "{least:g} and {most:g}, got {given:.6g}. Give the deviations themselves instead of "
            "a class.",
            name=name,
            what=what,
            least=least,
            most=most,
            given=given,
        )
