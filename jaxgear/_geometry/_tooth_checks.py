"""Teeth that cannot be cut, or that the other gear's teeth would hit."""

import numpy as np

from jaxgear._checks import require
from jaxgear._geometry._gear import Gear
from jaxgear._geometry._pair_facts import PairFacts
from jaxgear._units import mm

# Undercut that leaves the active flank whole is custom, not a mistake: 17 standard teeth at 20
# degrees lack 0.006 of profile shift. The tooth's shape is off by less than 1e-6 rad within it.
_HARMLESS_UNDERCUT = 0.02


def check_tooth(
    gears: tuple[Gear, Gear],
    facts: PairFacts,
    body: int,
    *,
    module: float,
    pressure_angle: float,
) -> None:
    """Refuse teeth of one gear that cannot be cut, or that the other gear's teeth would hit.

    **Arguments:**

    - `gears`: pinion and wheel.
    - `facts`: of the pair, in NumPy.
    - `body`: 0 for the pinion, 1 for the wheel.
    - `module`: normal module [m].
    - `pressure_angle`: normal pressure angle [rad].

    **Raises:**

    - `InputError` if teeth are pointed or undercut, if they interfere or bottom, or if the bore
        leaves no rim.
    """
    gear = gears[body]
    name, other = ("pinion", "wheel")[:: 1 - 2 * body]
    thickness, tip = facts.tip_thickness[body], facts.tip_radius[body]
    require(
        bool(thickness > 0.0),
        "The {name}'s teeth are pointed: thickness {got:.4g} mm at the tip diameter {tip:.6g} mm. "
        "Reduce its addendum or profile shift, or raise its tip shortening.",
        name=name,
        got=thickness / mm,
        tip=2.0 * tip / mm,
    )
    angle = pressure_angle
    dedendum, fillet = float(gear.dedendum), float(gear.fillet_radius)
    # The fillet is cut by the rack's tip: its two rounded corners must leave a land between them.
    land = 0.25 * np.pi - (dedendum - fillet) * np.tan(angle) - fillet / np.cos(angle)
    corner = (1.0 - np.sin(angle)) / np.cos(angle)
    require(
        bool(land >= -1e-9),
        "The {name}'s rack has a pointed tip: a fillet radius coefficient of {got:.4g} does not "
        "fit below its straight flanks. Use at most {limit:.4g}, or lower the dedendum.",
        name=name,
        got=fillet,
        limit=max(fillet + land / corner, 0.0),
    )
    form_roll, form_radius = facts.form_roll[body], facts.form_radius[body]
    missing_shift = -form_roll * np.sin(facts.transverse_pressure_angle)
    missing_shift /= module
    require(
        bool(missing_shift <= _HARMLESS_UNDERCUT),
        "The {name} is undercut: with {teeth} teeth the profile shift must be at least "
        "{limit:.4g}, got {got:.4g}. Raise the profile shift, the number of teeth or the "
        "pressure angle, or lower the dedendum.",
        name=name,
        teeth=gear.teeth,
        limit=float(gear.profile_shift) + missing_shift,
        got=float(gear.profile_shift),
    )
    start_roll = facts.tangent_length - facts.tip_roll[1 - body]
    require(
        bool(start_roll >= max(form_roll, 0.0)),
        "Interference: the {other}'s tip reaches the {name} at diameter {got:.6g} mm, below its "
        "form diameter {limit:.6g} mm where the involute ends. Lower the {other}'s addendum or "
        "raise its tip shortening, or raise the {name}'s dedendum or profile shift.",
        name=name,
        other=other,
        got=2.0 * np.hypot(facts.base_radius[body], max(start_roll, 0.0)) / mm,
        limit=2.0 * form_radius / mm,
    )
    _check_root(gear, facts, body)


def _check_root(gear: Gear, facts: PairFacts, body: int) -> None:
    """Refuse a root circle that the bore cuts, or the other gear's tip reaches."""
    name, other = ("pinion", "wheel")[:: 1 - 2 * body]
    bore, root = 0.0 if gear.bore is None else float(gear.bore), facts.root_radius[body]
    require(
        bool(bore < 2.0 * root),
        "The {name}'s bore of {got:.6g} mm must be smaller than its root diameter, {limit:.6g} mm.",
        name=name,
        got=bore / mm,
        limit=2.0 * root / mm,
    )
    clearance = facts.root_clearance[body]
    require(
        bool(clearance > 0.0),
        "The {other}'s tip touches the {name}'s root: clearance {got:.4g} mm. Raise the {name}'s "
        "dedendum or lower the {other}'s addendum.",
        name=name,
        other=other,
        got=clearance / mm,
    )
