"""The scene of one's own pair as text, with a comment where a number was not given."""

from string import Template

from jaxgear.scene._own_pair import (
    ADDENDUM,
    AXIAL,
    DEDENDUM,
    FILLET,
    K_FACTOR,
    TORSION,
    Wanted,
    face_width,
    fillet_radius,
    pinion_torque,
    rounded,
    sizes,
    tip_shortening,
)
from jaxgear.scene._scene import READY
from jaxgear.scene._schema import GEARS

# Where the comments begin that stand behind keys.
_COLUMN = 38


def scene_text(wanted: Wanted) -> str:
    """Write the scene of a pair in TOML, with a comment where a number was not given."""
    gears, face = sizes(wanted), face_width(wanted)
    length = rounded(face + 2.0 * max(gear.shaft for gear in gears))
    fillet, short = fillet_radius(wanted.pressure_angle), tip_shortening(wanted)
    rpm = wanted.rpm or 3000.0
    fields: dict[str, object] = {
        "name": wanted.name,
        "module": float(wanted.module),
        "pressure_angle": float(wanted.pressure_angle),
        "helix": float(wanted.helix),
        "hand": "positive: a right-hand pinion" if wanted.helix else "spur",
        "load": _load(wanted),
        "addendum": ADDENDUM,
        "dedendum": DEDENDUM,
        "fillet": float(fillet),
        "room": "ISO 53, profile A" if fillet == FILLET else "the largest that fits this rack",
        "shortening": float(short),
        "short": "keeps the clearance" if short else "",
        "face": float(face),
        "width": "" if wanted.face else "assumed: ten modules, at most the pinion's diameter",
        "torsion": f"{TORSION:g}",
        "length": float(length),
        "middle": 0.5 * length,
        "crowning": "\ncrowning_um = 0.0" if wanted.helix else "",
        "vary_crowning": '\n    "flank.pinion.crowning_um",' if wanted.helix else "",
        "slowest": float(rounded(0.1 * rpm)),
        "fastest": float(rounded(1.5 * rpm)),
    }
    for name, gear in zip(GEARS, gears, strict=True):
        fields |= {
            f"{name}_teeth": gear.teeth,
            f"{name}_shift": float(gear.shift),
            f"{name}_shaft": float(gear.shaft),
            f"{name}_radial": _power_of_ten(gear.bearing),
            f"{name}_axial": _power_of_ten(AXIAL * gear.bearing),
        }
    text = Template((READY / "own_pair.template").read_text(encoding="utf-8")).substitute(fields)
    return "\n".join(map(_aligned, text.split("\n")))


def _load(wanted: Wanted) -> str:
    """The lines of the torque, given as such or by power and speed."""
    speed = "" if wanted.rpm is None else f"speed_rpm = {float(wanted.rpm)}"
    if wanted.power is not None and speed:
        return f"power_kW = {1e-3 * wanted.power}\n{speed} # of the pinion, which drives"
    rule = f"assumed: a K factor of {K_FACTOR:g} N/mm2, moderate (Dudley)"
    said = "the pinion drives" if wanted.torque else rule
    return f"torque_pinion_Nm = {float(pinion_torque(wanted))} # {said}\n{speed}".strip()


def _power_of_ten(value: float) -> str:
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def _aligned(line: str) -> str:
    """A line with the comment behind its key in the column of all, or without an empty one."""
    key, mark, comment = line.partition(" # ")
    if not mark or line.startswith("#"):
        return line
    return f"{key:<{_COLUMN}}# {comment}" if comment.strip() else key
