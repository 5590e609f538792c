r"""Backlash, and the contact lines of the back flanks on the other line of action.

Rotated by $\pi$ about the line of centres S, a pair becomes itself with drive and back flanks
exchanged: (S, T, Z) becomes (S, -T, -Z), the hand of the helix stays, and the gears turn the other
way. So back flanks are the drive flanks of the same pair running backwards, in coordinates turned
with them. Where they are at a phase follows from when a tooth and a gap lie on the line of centres.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np

from jaxgear._checks import require
from jaxgear._compiled import any_traced
from jaxgear._geometry._involute import involute
from jaxgear._geometry._lines import (
    ContactLines,
    MeshGrid,
    face_positions,
    lines_on_steps,
    overlap_ratio,
    profile_contact_ratio,
)
from jaxgear._geometry._pair import GearPair, pair_facts
from jaxgear._types import Phases, Scalar
from jaxgear._units import mm, um

_GEARS = ("pinion", "wheel")


def has_back_contact(pair: GearPair) -> bool:
    """Whether a tooth thickness allowance, be it zero, asks for contact of the back flanks."""
    return any(gear.thickness_allowance is not None for gear in (pair.pinion, pair.wheel))


def normal_backlash(pair: GearPair) -> Scalar:
    r"""Distance of the back flanks along the normal while the nominal drive flanks touch.

    $j_n = 2(r_{b1} + r_{b2})\,(\mathrm{inv}\,\alpha_{wt} - \mathrm{inv}\,\alpha_{w0})\cos\beta_b +
    (A_1 + A_2)\cos\alpha_n$: what the centre distance leaves beyond the one that the profile
    shifts give without backlash, at $\alpha_{w0}$, and the tooth thickness allowances
    $A$ (ISO 21771-1). The same for all teeth in contact, wherever they touch.

    **Arguments:**

    - `pair`: the gears; an allowance of `None` counts as zero.

    **Returns:**

    $j_n$ [m]. Negative where the teeth jam, which `check_backlash` refuses.
    """
    thinner = jnp.sum(pair.thickness_allowances) * jnp.cos(pair.pressure_angle)
    return _centre_backlash(pair) * jnp.cos(pair.base_helix_angle) + thinner


def _centre_backlash(pair: GearPair) -> Scalar:
    """What the centre distance leaves along the transverse line of action [m]."""
    given, tight = pair.working_pressure_angle, pair.zero_backlash_pressure_angle
    return 2.0 * jnp.sum(pair.base_radius) * (involute(given) - involute(tight))


def check_backlash(pair: GearPair) -> None:
    """Refuse back flanks that jam, and teeth that their allowances make pointed.

    Without allowances nothing is refused, and numbers that are traced are let through.

    **Arguments:**

    - `pair`: the gears.

    **Raises:**

    - `InputError` if the normal backlash is negative, or an allowance takes away a tooth's tip.
    """
    if not has_back_contact(pair) or any_traced(pair) or any_traced(facts := pair_facts(pair)):
        return
    allowances = [gear.thickness_allowance for gear in (pair.pinion, pair.wheel)]
    taken = [0.0 if x is None else float(x) for x in allowances]
    cosine = float(np.cos(pair.pressure_angle))
    along_path = np.cos(facts.working_pressure_angle) * np.cos(facts.base_helix_angle)
    from_centres = float(facts.backlash * along_path)
    backlash = from_centres + sum(taken) * cosine
    require(
        backlash > -_ROUNDED * float(pair.normal_module),
        "The back flanks overlap: the normal backlash is {got:.4g} um. Raise the tooth thickness "
        "allowances, which sum to {sum:.4g} um, to {least:.4g} um or more, or the centre distance "
        "of {centre:.6g} mm; without allowances the back flanks are left out.",
        got=backlash / um,
        sum=sum(taken) / um,
        least=-from_centres / cosine / um,
        centre=facts.working_centre_distance / mm,
    )
    for body, name in enumerate(_GEARS):
        # The same angle is taken off at all radii.
        at_tip = float(facts.tip_radius[body] / facts.reference_radius[body])
        most = float(facts.tip_thickness[body]) / at_tip * float(np.cos(pair.helix_angle))
        require(
            taken[body] < most,
            "A tooth thickness allowance of {got:.4g} um leaves nothing of the {name}'s teeth at "
            "their tips, where {most:.4g} um would make them pointed. The allowance is in metres: "
            "write `60.0 * jaxgear.um`.",
            got=taken[body] / um,
            name=name,
            most=most / um,
        )


_ROUNDED = 1e-9  # of the module: a centre distance that was computed to have no backlash


def mirror_point(pair: GearPair) -> Scalar:
    r"""Place on the line of action that back flanks count from: they are at $2X - x$.

    When a tooth of the pinion lies on the line of centres its drive flank is at
    $x = r_{b1}(\alpha_{wt} + \psi_{b1})$, with $\psi_{b1}$ half the angle of the nominal
    tooth at its base circle, and without backlash its back flank is at the same place of the other
    line of action. Apart by the backlash, the flanks of pinion and wheel pass places that differ by
    as much. Where they will touch depends on which gear moves; here the middle is taken, a quarter
    of $j_0 + a_2 - a_1$ further on, of the backlash of the centre distance and the allowances
    along the path. It is the same whichever gear is called the pinion, and at most half the
    backlash in error.

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    $X$, from $T_1$; any half base pitch may be added [m].
    """
    nominal = pair.base_radius[0] * (pair.working_pressure_angle + pair.half_thickness_at_base[0])
    along_path = jnp.cos(pair.pressure_angle) / jnp.cos(pair.base_helix_angle)
    pinion, wheel = pair.thickness_allowances * along_path
    return nominal + 0.25 * (_centre_backlash(pair) + wheel - pinion)


def back_lines(
    pair: GearPair, grid: MeshGrid, edges: Phases
) -> tuple[ContactLines, ContactLines, ContactLines]:
    """Place the contact lines of the back flanks on the steps of the drive flanks.

    In coordinates turned by half a revolution about the line of centres: rolls count from the
    pinion's base tangent point on the other line of action, heights along the axes the other way.
    Nothing aligns the steps with the events of these teeth; fractions are exact means all the same.
    A slice's tooth pairs are numbered for that slice alone, from the last one that entered.

    **Arguments:**

    - `pair`: the gears.
    - `grid`: lines and slices, as for the drive flanks.
    - `edges`: ends of the steps, counted as in `contact_lines`: from the entry of a drive flank
        into the path or into the window beyond it [-].

    **Returns:**

    The lines at the start, in the middle and at the end of each step; fractions are means over
    the step in all three.
    """
    pitch = pair.transverse_base_pitch
    mirror = 2.0 * (mirror_point(pair) - pair.path_start) / pitch + 2.0 * grid.beyond
    started, ended = mirror - edges[:-1, None], mirror - edges[1:, None]
    # The last pair of which a slice has seen anything by then.
    stretch = overlap_ratio(pair) / grid.slices
    across = face_positions(pair, grid) * jnp.tan(pair.base_helix_angle) / pitch
    entered = jnp.floor(started + across[None, :] + 0.5 * stretch) + grid.first_line
    middle = lines_on_steps(pair, grid, edges, ended - entered, started - entered)
    half_step = 0.5 * (started - ended)
    window = profile_contact_ratio(pair) + 2.0 * grid.beyond
    middle = dataclasses.replace(
        middle,
        complete=window + stretch + 2.0 * jnp.max(half_step) <= grid.lines,
    )
    half_path = half_step[:, :, None] * pitch
    return (
        dataclasses.replace(middle, phase=edges[:-1] - grid.beyond, roll=middle.roll + half_path),
        middle,
        dataclasses.replace(middle, phase=edges[1:] - grid.beyond, roll=middle.roll - half_path),
    )
