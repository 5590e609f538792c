"""The scene of one's own pair as text, with a comment where a number was not given."""

from jaxgear.scene._own_pair import (
    ADDENDUM,
    AXIAL,
    DEDENDUM,
    FILLET,
    K_FACTOR,
    TORSION,
    Sizes,
    Wanted,
    face_width,
    fillet_radius,
    pinion_torque,
    rounded,
    sizes,
    tip_shortening,
)
from jaxgear.scene._schema import GEARS


def scene_text(wanted: Wanted) -> str:
    """Write the scene of a pair, with a comment where a number was not given.

    **Arguments:**

    - `wanted`: what is known.

    **Returns:**

    TOML, in the scene format.
    """
    pinion, wheel = sizes(wanted)
    length = rounded(face_width(wanted) + 2.0 * max(pinion.shaft, wheel.shaft))
    sections = [
        _head(wanted),
        _pair(wanted),
        *(_gear(n, g, wanted, length) for n, g in zip(GEARS, (pinion, wheel), strict=True)),
        _flanks(wanted),
        _MESH,
        _search(wanted),
        _sweep(wanted),
    ]
    return "\n".join(sections)


def _toml(value: float) -> str:
    return repr(float(value))


def _power_of_ten(value: float) -> str:
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def _head(wanted: Wanted) -> str:
    file = f"{wanted.name}.toml"
    return f"""\
# A pair of {wanted.teeth[0]} and {wanted.teeth[1]} teeth.
#
#   jaxgear run {file}    transmission error, contact, and the best tip relief
#   jaxgear keys PATTERN    what a key means, its unit, default and bounds
#
# Every length, angle and torque carries its unit in its key. What was not given is marked
# "assumed", with the rule of thumb; change it to what you know. Strength is not checked.

schema = 1
name = "{wanted.name}"
cite = "own pair; what is marked as assumed follows rules of thumb"

[material]                            # assumed: steel
young_GPa = 206.0
poisson = 0.3
density_kg_m3 = 7850.0
"""


def _pair(wanted: Wanted) -> str:
    lines = [
        "[pair]",
        f"module_mm = {_toml(wanted.module)}",
        f"pressure_angle_deg = {_toml(wanted.pressure_angle)}",
        f"helix_angle_deg = {_toml(wanted.helix)}".ljust(38)
        + ("# positive: a right-hand pinion" if wanted.helix else "# spur"),
    ]
    if wanted.power is not None and wanted.rpm is not None:
        lines += [
            f"power_kW = {_toml(1e-3 * wanted.power)}",
            f"speed_rpm = {_toml(wanted.rpm)}".ljust(38) + "# of the pinion, which drives",
        ]
    else:
        torque = f"torque_pinion_Nm = {_toml(pinion_torque(wanted))}".ljust(38)
        rule = f"assumed: a K factor of {K_FACTOR:g} N/mm2, moderate (Dudley)"
        lines += [torque + ("# the pinion drives" if wanted.torque else f"# {rule}")]
        lines += [f"speed_rpm = {_toml(wanted.rpm)}"] if wanted.rpm is not None else []
    lines += ["# centre_distance_mm is left out: the one without backlash", ""]
    return "\n".join(lines)


def _gear(name: str, gear: Sizes, wanted: Wanted, length: float) -> str:
    face, bearing = face_width(wanted), _power_of_ten(gear.bearing)
    width = "" if wanted.face else "# assumed: ten modules, at most the pinion's diameter"
    fillet = fillet_radius(wanted.pressure_angle)
    room = "ISO 53, profile A" if fillet == FILLET else "the largest that fits this rack"
    short = tip_shortening(wanted)
    rows = [
        (f"[{name}]", ""),
        (f"teeth = {gear.teeth}", ""),
        (f"profile_shift = {_toml(gear.shift)}", "assumed: balanced, no undercut (BS PD 6457)"),
        (f"addendum_coeff = {ADDENDUM}", "assumed: ISO 53, profile A"),
        (f"dedendum_coeff = {DEDENDUM}", "assumed, as above"),
        (f"fillet_radius_coeff = {_toml(fillet)}", f"assumed: {room}"),
        (f"tip_shortening_coeff = {_toml(short)}", "keeps the clearance" if short else ""),
        (f"face_width_mm = {_toml(face)}", width.removeprefix("# ")),
        (f"bore_mm = {_toml(gear.shaft)}", "assumed: the seat on its shaft"),
        ("", ""),
        (f"[{name}.shaft]", f"assumed: {TORSION:g} N/mm2 of torsion, half of what the ASME code"),
        (
            "# allows, within what the gear leaves; bearings at its ends, a diameter off the face",
            "",
        ),
        (f"gear_at_mm = {_toml(0.5 * length)}", "mid-face, from the left (-Z) end"),
    ]
    lines = [f"{text:<38}# {said}" if said else text for text, said in rows]
    axial = _power_of_ten(AXIAL * gear.bearing)
    return "\n".join([
        *lines,
        f"segments = [ {{ length_mm = {_toml(length)}, outer_mm = {_toml(gear.shaft)} }} ]",
        "bearings = [".ljust(38) + "# assumed: ball bearings (Kraemer 1993), axially a fifth",
        f"    {{ at_mm = 0.0, radial_N_m = {bearing}, axial_N_m = {axial} }},",
        f"    {{ at_mm = {_toml(length)}, radial_N_m = {bearing} }},",
        "]",
        "",
    ])  # fmt: skip


def _flanks(wanted: Wanted) -> str:
    crowned = "\ncrowning_um = 0.0" if wanted.helix else ""
    relief = 'tip_relief = { depth_um = 0.0, extent = 0.25, shape = "linear" }'
    return f"""\
# Plain flanks. A depth is material removed; an extent is a fraction of the path of contact.
[flank.pinion]
{relief}{crowned}

[flank.wheel]
{relief}{crowned}
"""


_MESH = """\
[mesh]
stiffness = "weber-banaschek"
foundation = "ring"                   # bodies wind up between bore and teeth
slices = 20                           # across the face
phases = 64                           # positions in one mesh period
contact = "exact"
"""


def _search(wanted: Wanted) -> str:
    vary = ["tip_relief.depth_um", "tip_relief.extent", *(["crowning_um"] if wanted.helix else [])]
    named = "".join(f'    "flank.pinion.{key}",\n' for key in vary)
    return f"""\
[optimise]
vary = [
{named}]
symmetric = true                      # the wheel gets the pinion's correction
minimise = "te_rms"                   # te_rms | te_peak_to_peak | max_pressure | a table of weights
"""


def _sweep(wanted: Wanted) -> str:
    rpm = wanted.rpm or 3000.0
    low, high = rounded(0.1 * rpm), rounded(1.5 * rpm)
    speeds = f"{{ from = {_toml(low)}, to = {_toml(high)}, points = 200 }}"
    return f"""\
# Without the # these lines make `jaxgear sweep` work, and `jaxgear run` sweep too.
# [sweep]
# pinion_speed_rpm = {speeds}
# direction = "both"                    # up | down | both | cold
"""
