"""Every key of the scene file as data: kind, unit, default, bounds, and what this version models.

Units are those of the file (the suffix of the key); nothing is converted here. Depths are material
removed, so they are never negative; slopes are positive where material is added.
"""

import dataclasses
import difflib
import enum
import json
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, Literal


class Presence(enum.Enum):
    """What the absence of a key means when it has no default value.

    `REQUIRED`: a mistake, as soon as the key's table is there (the tables of `ALWAYS` must be).
    `OPTIONAL`: the key stays absent.
    """

    REQUIRED = "required"
    OPTIONAL = "optional"


REQUIRED = Presence.REQUIRED
OPTIONAL = Presence.OPTIONAL

Kind = Literal["float", "int", "text", "bool", "floats", "texts"]

GEARS = ("pinion", "wheel")
# Tables that every scene has, and tables that ask for work, which are written out only if given.
ALWAYS = ("", "pair", *GEARS)
ON_REQUEST = (
    "model",
    "damping",
    "sweep",
    "modes",
    "map",
    "optimise",
    "robust",
    "sizing",
    "compare",
)
# Tables whose keys are paths of other keys, quoted or as nested tables.
BY_PATH = (
    "optimise.bounds",
    "optimise.ties",
    "sizing.amounts",
    "robust.scatter",
    "robust.even",
)

_NOUNS: Mapping[Kind, tuple[str, str]] = {
    "float": ("a number", ""),
    "int": ("an integer", ""),
    "text": ("text in quotes", ""),
    "bool": ("true or false", ""),
    "floats": ("a list of numbers", ", each"),
    "texts": ("a list of texts in quotes", ", each"),
}

# Longest suffix first: `_N_mm_um` also ends in `_um`.
_UNITS = {
    "_N_mm_um": "N/(mm um)",
    "_kg_m3": "kg/m^3",
    "_kg_m2": "kg m^2",
    "_Nm_rad": "N m/rad",
    "_rad_s": "rad/s",
    "_R_1_s": "1/s",
    "_R_s": "s",
    "_GPa": "GPa",
    "_MPa": "MPa",
    "_N_mm": "N/mm",
    "_deg": "degrees",
    "_rpm": "rpm",
    "_N_m": "N/m",
    "_Nm": "N m",
    "_mm": "mm",
    "_um": "um",
    "_kg": "kg",
    "_kW": "kW",
    "_Hz": "Hz",
    "_N": "N",
}


@dataclasses.dataclass(frozen=True)
class Key:
    """One key of the scene file.

    **Fields:**

    - `path`: dotted path; `[]` stands for any row of a list of tables, and at the end, in bounds,
        for any entry of a list of numbers.
    - `kind`: the type of the value.
    - `doc`: one line for the user.
    - `default`: the value when absent, or `REQUIRED`, or `OPTIONAL`.
    - `above`, `below`: exclusive bounds of each number, in the file's unit.
    - `at_least`, `at_most`: inclusive bounds of each number, in the file's unit.
    - `length`: number of entries of a list, where it is fixed.
    - `choices`: the texts allowed; empty for any.
    - `pattern`: regular expression that a text must match in full.
    - `applies_if`: another key and the value of it that makes this one count.
    - `default_if`: another key and the value of it with which the default is filled in.
    - `instead_of`: the key that this one may be given in place of, and that follows from it.
    - `differentiable`: whether the static model has a derivative with respect to it; of a list,
        with respect to each entry.
    - `remedy`: what to do when a value is out of bounds.
    """

    path: str
    kind: Kind
    doc: str
    default: object = OPTIONAL
    above: int | float | None = None
    below: int | float | None = None
    at_least: int | float | None = None
    at_most: int | float | None = None
    length: int | None = None
    choices: tuple[str, ...] = ()
    pattern: str = ""
    applies_if: tuple[str, str] | None = None
    default_if: tuple[str, str] | None = None
    instead_of: str = ""
    differentiable: bool = False
    remedy: str = ""

    @property
    def table(self) -> str:
        """Dotted path of the table that holds the key."""
        return self.path.rpartition(".")[0]

    @property
    def unit(self) -> str:
        """Unit of the value, read off the key's name; empty for a plain number."""
        for part in reversed(self.path.split(".")):
            for suffix, unit in _UNITS.items():
                if part.removesuffix("[]").endswith(suffix):
                    return unit
        return ""

    @property
    def allowed(self) -> str:
        """What a value must be, in words."""
        noun, each = _NOUNS[self.kind]
        if self.choices:
            return ("" if self.kind == "text" else noun + each + " ") + one_of(self.choices)
        if self.length is not None:
            noun = f"a list of {self.length} numbers"
        bounds = [
            f"{sign} {bound:g}"
            for sign, bound in zip(
                (">", ">=", "<", "<="),
                (self.above, self.at_least, self.below, self.at_most),
                strict=True,
            )
            if bound is not None
        ]
        if self.at_least is not None and self.at_least == self.at_most:
            bounds = [f"equal to {self.at_least:g}"]
        text = noun + (each + " " if bounds and each else " " if bounds else "")
        return text + " and ".join(bounds) + (f" [{self.unit}]" if self.unit else "")

    def read(self, value: object) -> object:
        """Return the value in its canonical type, or raise `ValueError` saying what is wrong."""
        if self.kind not in ("floats", "texts"):
            return self._read_one(value, value)
        if not isinstance(value, list):
            brackets = isinstance(value, str if self.kind == "texts" else int | float)
            raise self._wrong(value, f". Write [{show(value)}]" if brackets else "")
        if not value or self.length not in (None, len(value)):
            raise self._wrong(value)
        return [self._read_one(entry, value) for entry in value]

    def _read_one(self, entry: object, value: object) -> object:
        """Read one number or text; `value` is the whole of what was given, for the message."""
        if self.kind == "bool" and isinstance(entry, bool):
            return entry
        if self.kind in ("text", "texts") and isinstance(entry, str):
            if self.choices and entry not in self.choices:
                near = difflib.get_close_matches(entry, self.choices, 1)
                raise self._wrong(value, f", did you mean {show(near[0])}?" if near else "")
            if self.pattern and not re.fullmatch(self.pattern, entry):
                raise self._wrong(value, f". {self.remedy}")
            return entry
        if (
            self.kind not in ("int", "float", "floats")
            or isinstance(entry, bool)
            or not isinstance(entry, int if self.kind == "int" else int | float)
        ):
            raise self._wrong(value, self._type_hint(entry))
        try:
            number = float(entry)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self._wrong(value, ". It must be finite")
        if (
            (self.above is not None and number <= self.above)
            or (self.at_least is not None and number < self.at_least)
            or (self.below is not None and number >= self.below)
            or (self.at_most is not None and number > self.at_most)
        ):
            raise self._wrong(value, f". {self.remedy}" if self.remedy else "")
        return entry if self.kind == "int" else number

    def _wrong(self, value: object, hint: str = "") -> ValueError:
        return ValueError(f"got {show(value)}, must be {self.allowed}{hint}")

    def _type_hint(self, entry: object) -> str:
        """Return what to write instead of a number in quotes or a whole number with a point."""
        if self.kind == "int" and isinstance(entry, float) and entry.is_integer():
            return f". Write {entry:.0f}"
        if self.kind in ("int", "float") and isinstance(entry, str):
            try:
                return f". Write {float(entry):g}, without the quotes"
            except ValueError:
                return ""
        return ""


def show(value: object) -> str:
    """Write a value much as the file has it, cut to a readable length."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)
    if isinstance(value, list):
        text = "[" + ", ".join(show(entry) for entry in value) + "]"
    return text if len(text) <= 80 else text[:77] + "..."


def one_of(values: Iterable[object]) -> str:
    """List the values that may be written."""
    shown = [show(value) for value in values]
    return shown[0] if len(shown) == 1 else "one of " + ", ".join(shown)


_TORQUE = (
    "The pinion drives; with no load there is no contact state to solve. To load the other flank "
    "mirror the pair: change the sign of the helix angle and swap the flank data"
)
_DEPTH = "A depth is material removed, so it is positive where the flank is cut back"
_EXTENT = (
    "An extent is a fraction of the path of contact eps_alpha p_bt, from 0 to 1; a value above 1 "
    "looks as if millimetres were given: divide by geometry.path_of_contact_mm in summary.json"
)
_FACE_EXTENT = (
    "This extent is a fraction of the face width, from 0 to 1; a value above 1 looks as if "
    "millimetres were given: divide by face_width_mm"
)
_SUPPORT = "Leave the key out where the support is rigid"
_BEARING = "Leave the key out where the bearing does not hold the shaft"
_ALONG = "Positions are measured from the first end of the shaft"


def _number(path: str, doc: str, default: object = OPTIONAL, **fields: Any) -> Key:
    return Key(path, "float", doc, default, **fields)


def _variable(path: str, doc: str, default: object = OPTIONAL, **fields: Any) -> Key:
    """Return a number that the static model can be differentiated by."""
    return Key(path, "float", doc, default, differentiable=True, **fields)


def _variables(path: str, doc: str, default: object = OPTIONAL, **fields: Any) -> Key:
    """Return a list of numbers that the static model can be differentiated by."""
    return Key(path, "floats", doc, default, differentiable=True, **fields)


def _count(path: str, doc: str, default: object = OPTIONAL, **fields: Any) -> Key:
    return Key(path, "int", doc, default, **fields)


def _text(path: str, doc: str, default: object = OPTIONAL, **fields: Any) -> Key:
    return Key(path, "text", doc, default, **fields)


def _material(table: str, young: object, poisson: object, density: object) -> tuple[Key, ...]:
    gpa = "The key is in gigapascals; steel has 206"
    dense = "The key is in kg/m^3; steel has 7850"
    return (
        _variable(
            f"{table}.young_GPa",
            "Young's modulus",
            young,
            at_least=0.1,
            at_most=2000.0,
            remedy=gpa,
        ),
        _variable(f"{table}.poisson", "Poisson's ratio", poisson, at_least=0.0, below=0.5),
        _variable(
            f"{table}.density_kg_m3",
            "mass density",
            density,
            at_least=100.0,
            at_most=30_000.0,
            remedy=dense,
        ),
    )


_GENERAL = (
    _count(
        "schema",
        "version of the scene format",
        REQUIRED,
        at_least=1,
        at_most=1,
        remedy="This version of jaxgear reads scene format 1",
    ),
    _text(
        "name",
        "name of the scene and of its results folder; default: the file's name",
        pattern=r"(?!\.{1,2}$)[^/\\\x00-\x1f\x7f]+",
        remedy="It names a folder: no slashes, and not empty",
    ),
    _text("cite", "where the data come from; printed with every result", ""),
    *_material("material", 206.0, 0.3, 7850.0),
)

_PAIR = (
    _variable(
        "pair.module_mm",
        "normal module",
        REQUIRED,
        at_least=0.01,
        at_most=200.0,
        remedy="The key is in millimetres",
    ),
    _variable(
        "pair.pressure_angle_deg",
        "normal pressure angle",
        20.0,
        at_least=5.0,
        below=45.0,
        remedy="The key is in degrees",
    ),
    _variable(
        "pair.helix_angle_deg",
        "helix angle at the reference cylinder; positive: a right-hand pinion",
        0.0,
        at_least=-45.0,
        at_most=45.0,
        remedy="The key is in degrees",
    ),
    _variable(
        "pair.torque_pinion_Nm", "driving torque on the pinion", REQUIRED, above=0.0, remedy=_TORQUE
    ),
    _variable(
        "pair.power_kW",
        "power on the pinion, which with speed_rpm gives its torque",
        above=0.0,
        remedy=_TORQUE,
        instead_of="pair.torque_pinion_Nm",
    ),
    _variable(
        "pair.speed_rpm",
        "speed of the pinion, at which power_kW is transmitted; sweeps have their own",
        above=0.0,
        at_most=1e6,
        remedy="The key is in revolutions per minute",
    ),
    _variable(
        "pair.centre_distance_mm",
        "working centre distance; default: the zero-backlash one from the profile shifts",
        above=0.0,
        remedy="Leave the key out for the centre distance without backlash",
    ),
    _variable(
        "pair.misalignment_inclination_um",
        "misalignment over the face width in the plane of the axes",
        0.0,
    ),
    _variable(
        "pair.misalignment_deviation_um",
        "misalignment over the face width in the plane perpendicular to that of the axes",
        0.0,
    ),
)

_FOUNDATIONS: dict[str, Any] = {"choices": ("weber", "sainsot", "ring", "none")}


def _gear(gear: str) -> tuple[Key, ...]:
    """Keys of one gear: teeth, material, supports, body and shaft."""
    stiffness: dict[str, Any] = {"above": 0.0, "remedy": _SUPPORT}
    return (
        _count(f"{gear}.teeth", "number of teeth", REQUIRED, at_least=5, at_most=10_000),
        _variable(
            f"{gear}.profile_shift", "profile shift coefficient x", 0.0, at_least=-5.0, at_most=5.0
        ),
        *_thickness(gear),
        _variable(f"{gear}.addendum_coeff", "addendum over module", 1.0, above=0.0, at_most=5.0),
        _variable(
            f"{gear}.tip_diameter_mm",
            "tip diameter as on the drawing, any tip shortening in it",
            above=0.0,
            remedy="The key is in millimetres",
            instead_of=f"{gear}.addendum_coeff",
        ),
        _variable(f"{gear}.dedendum_coeff", "dedendum over module", 1.25, above=0.0, at_most=5.0),
        _variable(
            f"{gear}.root_diameter_mm",
            "root diameter",
            above=0.0,
            remedy="The key is in millimetres",
            instead_of=f"{gear}.dedendum_coeff",
        ),
        _variable(
            f"{gear}.fillet_radius_coeff",
            "tip radius of the rack that cuts the fillet, over module; where 0.38 does not fit the "
            "rack at this pressure angle, the largest that does",
            0.38,
            at_least=0.0,
            at_most=1.0,
        ),
        _variable(
            f"{gear}.tip_shortening_coeff",
            "tip shortening k over module; 0 for tables that give tip radii directly",
            0.0,
            at_least=0.0,
            at_most=1.0,
        ),
        _variable(
            f"{gear}.face_width_mm",
            "face width",
            REQUIRED,
            at_least=0.1,
            at_most=2000.0,
            remedy="The key is in millimetres",
        ),
        _variable(
            f"{gear}.bore_mm",
            "diameter of the bore, where the body is held; 0: none; default, where the foundation "
            "is the ring: that of the shaft, or 0.4 of the root diameter",
            at_least=0.0,
        ),
        _number(
            f"{gear}.thickness_allowance_um",
            "how much thinner the tooth is made at the reference cylinder, in the normal section; "
            "where a gear has it, back flanks touch once the backlash is used up",
            at_least=0.0,
            remedy="An allowance is what is taken off the tooth, so it is not negative",
        ),
        _text(f"{gear}.foundation", "foundation of this gear's teeth", **_FOUNDATIONS),
        *_material(f"{gear}.material", OPTIONAL, OPTIONAL, OPTIONAL),
        _variable(f"{gear}.support.radial_N_m", "radial stiffness of the support", **stiffness),
        _variable(f"{gear}.support.radial_S_N_m", "radial stiffness, along S only", **stiffness),
        _variable(f"{gear}.support.radial_T_N_m", "radial stiffness, along T only", **stiffness),
        _variable(f"{gear}.support.axial_N_m", "axial stiffness of the support", **stiffness),
        _variable(f"{gear}.support.tilt_Nm_rad", "tilt stiffness of the support", **stiffness),
        *_body(f"{gear}.body"),
        *_shaft(f"{gear}.shaft"),
    )


def _thickness(gear: str) -> tuple[Key, ...]:
    """Keys of what a gear checker measures of one gear, in place of its profile shift."""
    size: dict[str, Any] = {"above": 0.0, "remedy": "The key is in millimetres"}
    shift = f"{gear}.profile_shift"
    return (
        _variable(
            f"{gear}.span_mm",
            "span W_k over span_teeth teeth as they are made, thickness_allowance_um in it",
            instead_of=shift,
            **size,
        ),
        _count(
            f"{gear}.span_teeth",
            "number of teeth k that a span is measured over; alone: that of the summary",
            at_least=1,
            at_most=10_000,
        ),
        _variable(
            f"{gear}.over_balls_mm",
            "measure M_dK over two balls of ball_mm in opposite spaces, both in one transverse "
            "plane, thickness_allowance_um in it",
            instead_of=shift,
            **size,
        ),
        _number(
            f"{gear}.ball_mm",
            "diameter of a ball of over_balls_mm; alone: that of the summary",
            **size,
        ),
    )


def _body(table: str) -> tuple[Key, ...]:
    """Keys of one gear's body."""
    return (
        _text(
            f"{table}.kind",
            "gear body: rigid; beam: in one piece with its shaft; condensed: finite elements",
            "rigid",
            choices=("rigid", "beam", "condensed"),
        ),
        _number(
            f"{table}.mass_kg",
            "mass of the body; default: of a disc from bore to root circle",
            above=0.0,
        ),
        _number(
            f"{table}.inertia_kg_m2",
            "polar moment of inertia of the body; default: of that disc",
            above=0.0,
        ),
        _number(
            f"{table}.transverse_inertia_kg_m2",
            "transverse moment of inertia, about a diameter at mid-face",
            above=0.0,
        ),
        *_web(f"{table}.web"),
        *_condensed(table),
        *_fineness(f"{table}.fineness"),
    )


def _web(table: str) -> tuple[Key, ...]:
    """Keys of a body drawn by hub, web and rim."""
    size: dict[str, Any] = {"above": 0.0, "remedy": "The key is in millimetres"}
    many: dict[str, Any] = {"at_least": 0, "at_most": 100}
    return (
        _variable(f"{table}.hub_outer_mm", "outer diameter of the hub", REQUIRED, **size),
        _variable(f"{table}.web_thickness_mm", "thickness of the web", REQUIRED, **size),
        _variable(f"{table}.rim_inner_mm", "inner diameter of the rim", REQUIRED, **size),
        _variable(
            f"{table}.web_offset_mm",
            "axial offset of the web's middle from mid-face, half way between hub and rim",
        ),
        _variable(
            f"{table}.web_angle_deg",
            "cone angle of the web; positive: it rises along Z from hub to rim",
            at_least=-60.0,
            at_most=60.0,
            remedy="The key is in degrees; 0 is a flat web",
        ),
        _variable(f"{table}.hub_width_mm", "width of the hub; default: face_width_mm", **size),
        _count(f"{table}.holes", "number of holes on a circle", **many),
        _variable(f"{table}.hole_diameter_mm", "diameter of a hole", **size),
        _variable(f"{table}.hole_circle_mm", "diameter of the circle of their centres", **size),
        _variable(
            f"{table}.hole_angle_deg", "direction of the first hole, from tooth 0; default: 0"
        ),
        _count(f"{table}.second_holes", "number of holes of a second ring", **many),
        _variable(
            f"{table}.second_hole_diameter_mm",
            "diameter of a hole of the second ring; default: as in the first",
            **size,
        ),
        _variable(
            f"{table}.second_hole_circle_mm",
            "circle of the second ring; default: that of the first",
            **size,
        ),
        _variable(
            f"{table}.second_hole_angle_deg",
            "direction of the second ring's first hole; default: half way between two of the first",
        ),
    )


def _condensed(table: str) -> tuple[Key, ...]:
    """Keys of a condensed body: where it comes from, and what is kept of it."""
    only: dict[str, Any] = {"default_if": (f"{table}.kind", "condensed")}
    return (
        _text(f"{table}.grid", "a finite element grid of the user's own, instead of web"),
        _text(f"{table}.rim_set", "node set of body.grid on the rim, the cylinder under the teeth"),
        Key(
            f"{table}.seats",
            "texts",
            "node sets of body.grid for bearing seats, in their order; without shaft, of the bore",
        ),
        _text(f"{table}.torque_set", "node set of body.grid where the torque enters or leaves"),
        _number(
            f"{table}.grid_unit_mm",
            "length of the unit of body.grid; default: 1",
            above=0.0,
            remedy="A grid in metres has 1000, one in inches 25.4",
        ),
        *_superelement(f"{table}.superelement"),
        _text(
            f"{table}.interface",
            "how the inside is kept: herting, craig-bampton or guyan; with grid also the rim's set",
            "herting",
            **only,
        ),
        _count(
            f"{table}.modes",
            "number of modes of the inside that are kept",
            50,
            at_least=0,
            at_most=200,
            remedy="0 keeps the rim and the seats alone",
            **only,
        ),
        _variable(
            f"{table}.young_GPa",
            "Young's modulus of the body alone; a high one makes it rigid with its mass unchanged",
            at_least=0.1,
            at_most=1e7,
            remedy="The key is in gigapascals; steel has 206",
        ),
        _text(
            f"{table}.seat_coupling",
            "what ties a seat to its node: a rigid ring, or the average of its motion",
            "rigid",
            choices=("rigid", "averaging"),
            **only,
        ),
        _number(
            f"{table}.seat_width_mm",
            "length of shaft that a bearing holds; default: a third of the diameter there",
            above=0.0,
            remedy="The key is in millimetres",
        ),
        Key(
            f"{table}.compare_seats",
            "bool",
            "whether the health report compares rigid and averaging seats, which takes a while",
            True,
            **only,
        ),
        Key(
            f"{table}.teeth_mass",
            "bool",
            "whether the mass of the teeth is laid on the rim",
            True,
            **only,
        ),
        Key(
            f"{table}.rotating_terms",
            "bool",
            "whether Coriolis terms, spin softening and stress stiffening are condensed too",
            False,
            **only,
        ),
    )


def _superelement(key: str) -> tuple[Key, ...]:
    """Keys of matrices condensed by another program."""
    return (
        _text(key, "matrices condensed elsewhere (.mtx, .sti, .op4, .npz), instead of web"),
        _text(f"{key}_mass", "file of the superelement's mass matrix, where it has one of its own"),
        _text(f"{key}_nodes", "table of the superelement's nodes: columns node, x, y, z, role"),
        _text(f"{key}_faces", "faces of the superelement's rim: eight node numbers on a line"),
        _text(
            f"{key}_units",
            "units of all files of the superelement",
            choices=("m-kg-s", "mm-t-s", "mm-kg-ms", "in-lbf-s"),
        ),
        _number(
            f"{key}_mid_face_mm",
            "middle of the toothed face along the superelement's z; default: 0",
        ),
    )


def _fineness(table: str) -> tuple[Key, ...]:
    """Keys of the finite element grid of a drawn body: numbers of 20-node bricks."""
    few: dict[str, Any] = {"at_least": 1, "at_most": 50}
    return (
        _count(
            f"{table}.elements_per_tooth",
            "elements around, for each tooth; 1 unless said",
            **few,
        ),
        _count(
            f"{table}.sectors",
            "elements around, whatever the teeth; instead of elements_per_tooth",
            at_least=8,
            at_most=2000,
        ),
        _count(f"{table}.rim_across", "elements across the face of the rim", **few),
        _count(f"{table}.rim_deep", "elements through the rim", **few),
        _count(f"{table}.web_along", "elements along the web, from hub to rim", **few),
        _count(f"{table}.web_layers", "elements through the web", **few),
        _count(f"{table}.hub_deep", "elements through the hub", **few),
        _number(
            f"{table}.shaft_mm",
            "largest element along the shaft",
            above=0.0,
            remedy="The key is in millimetres",
        ),
    )


def _shaft(table: str) -> tuple[Key, ...]:
    """Keys of the shaft of one gear: its sections, bearings and loads."""
    place: dict[str, Any] = {"at_least": 0.0, "remedy": _ALONG}
    outer: dict[str, Any] = {"above": 0.0, "remedy": "The key is in millimetres"}
    stiffness: dict[str, Any] = {"at_least": 0.0, "remedy": _BEARING}
    segment, bearing, load = (f"{table}.{rows}[]" for rows in ("segments", "bearings", "loads"))
    return (
        _variable(f"{table}.gear_at_mm", "position of the gear's mid-face", REQUIRED, **place),
        _variable(f"{segment}.length_mm", "length of the segment", REQUIRED, **outer),
        _variable(f"{segment}.outer_mm", "outer diameter", REQUIRED, **outer),
        _variable(f"{segment}.inner_mm", "inner diameter; 0: solid", 0.0, at_least=0.0),
        _variable(f"{bearing}.at_mm", "position of the bearing", REQUIRED, **place),
        _variable(f"{bearing}.radial_N_m", "radial stiffness of the bearing", **stiffness),
        _variable(f"{bearing}.radial_S_N_m", "radial stiffness, along S only", **stiffness),
        _variable(f"{bearing}.radial_T_N_m", "radial stiffness, along T only", **stiffness),
        _variable(f"{bearing}.axial_N_m", "axial stiffness of the bearing", **stiffness),
        _variable(f"{bearing}.tilt_Nm_rad", "tilt stiffness of the bearing", **stiffness),
        _variable(f"{bearing}.tilt_S_Nm_rad", "tilt stiffness, about S only", **stiffness),
        _variable(f"{bearing}.tilt_T_Nm_rad", "tilt stiffness, about T only", **stiffness),
        _variable(
            f"{table}.torque_at_mm",
            "where the torque enters or leaves the shaft; default: at the gear",
            **place,
        ),
        _variable(
            f"{table}.shear_coeff",
            "shear coefficient of the sections; default: that of each ring section",
            above=0.0,
            at_most=1.0,
            remedy="It is the share of the section that carries shear; a solid shaft has about 0.9",
        ),
        _variable(f"{load}.at_mm", "position of a load", REQUIRED, **place),
        _count(
            f"{table}.divisions",
            "finite elements from one station to the next; default: 1, exact in statics",
            at_least=1,
            at_most=100,
        ),
        _variables(f"{load}.force_N", "force along S, T, Z", [0.0, 0.0, 0.0], length=3),
        _variables(f"{load}.moment_Nm", "moment about S, T, Z", [0.0, 0.0, 0.0], length=3),
    )


def _relief(table: str, where: str, extent: float, fraction: str) -> tuple[Key, ...]:
    whole = "face width" if fraction == _FACE_EXTENT else "path of contact"
    return (
        _variable(f"{table}.depth_um", f"depth removed {where}", 0.0, at_least=0.0, remedy=_DEPTH),
        _variable(
            f"{table}.extent",
            f"length of the relief, as a fraction of the {whole}",
            extent,
            above=0.0,
            at_most=1.0,
            remedy=fraction,
        ),
        _text(
            f"{table}.shape",
            "how its depth grows from where it begins: in proportion, or with the square",
            "linear",
            choices=("linear", "parabolic"),
        ),
    )


def _flank(flank: str) -> tuple[Key, ...]:
    """Keys of the flank of one gear."""
    depth: dict[str, Any] = {"at_least": 0.0, "remedy": _DEPTH}
    return (
        *_relief(f"{flank}.tip_relief", "at the tip", 0.25, _EXTENT),
        *_relief(f"{flank}.root_relief", "at the start of active profile", 0.2, _EXTENT),
        _variable(
            f"{flank}.crowning_um",
            "parabolic crowning: depth removed at both ends of the face",
            0.0,
            **depth,
        ),
        _text(
            f"{flank}.end_relief.side",
            "end of the face that is relieved; left is the -Z end",
            "both",
            choices=("left", "right", "both"),
        ),
        *_relief(f"{flank}.end_relief", "at the end of the face", 0.2, _FACE_EXTENT),
        _variable(
            f"{flank}.helix_slope_um",
            "helix slope deviation over the face width; positive adds material",
            0.0,
        ),
        _variable(
            f"{flank}.profile_slope_um",
            "profile slope deviation over the path of contact; positive adds material at the tip",
            0.0,
        ),
        _variable(
            f"{flank}.profile_crowning_um",
            "parabolic profile crowning: depth removed at both ends of the profile",
            0.0,
            **depth,
        ),
        _variable(
            f"{flank}.elliptical_crowning_um",
            "elliptical crowning: depth removed at both ends of the face",
            0.0,
            **depth,
        ),
        _variable(
            f"{flank}.bias_um",
            "twist of the flank: added at two opposite corners, removed at the other two",
            0.0,
        ),
        _text(
            f"{flank}.profile_deviation_csv",
            "file of a profile deviation, the same all along the face; positive adds material",
        ),
        _text(
            f"{flank}.topography_csv", "file of a deviation over the flank; positive adds material"
        ),
        _variable(
            f"{flank}.accuracy_grade",
            "ISO 1328-1 tolerance grade, turned into a stated waveform; left out: a perfect flank",
            at_least=1.0,
            at_most=11.0,
            remedy="ISO 1328-1 has the grades 1, the finest, to 11",
        ),
        _count(
            f"{flank}.accuracy_waves",
            "waves of the grade's waveform over the profile",
            3,
            at_least=1,
        ),
        Key(
            f"{flank}.accuracy_slopes",
            "bool",
            "whether the grade's full tolerances of profile and helix slope are added",
            False,
        ),
        _variables(
            f"{flank}.pitch_error_um",
            "cumulative pitch error per tooth, positive adds material; one value: all teeth",
            [0.0],
        ),
        _variable(
            f"{flank}.eccentricity_um",
            "distance of the teeth's axis from that of rotation",
            0.0,
            at_least=0.0,
            remedy="It is a distance; its direction is eccentricity_angle_deg",
        ),
        _variable(
            f"{flank}.eccentricity_angle_deg",
            "direction of the offset at phase 0, from S about the gear's own sense of rotation",
            0.0,
        ),
    )


_HOUSING = (
    _text("housing.stiffness_csv", "file of the stiffness of the housing between the bearings"),
)


_MESH = (
    _count("mesh.periods", "mesh periods in one cycle", 1, at_least=1, at_most=10_000),
    _text(
        "mesh.stiffness",
        "stiffness of a tooth pair",
        "weber-banaschek",
        choices=("weber-banaschek", "iso6336", "constant"),
    ),
    _variable(
        "mesh.stiffness_N_mm_um",
        "stiffness of a tooth pair per length of contact line",
        REQUIRED,
        above=0.0,
        applies_if=("mesh.stiffness", "constant"),
    ),
    _text(
        "mesh.foundation",
        "elasticity of the body under a tooth; ring: an elastic ring, clamped at bore_mm, that "
        "couples the teeth in mesh; a gear with bore_mm = 0 or with a beam body takes weber",
        "ring",
        **_FOUNDATIONS,
    ),
    _count("mesh.slices", "slices across the face", 20, at_least=1, at_most=2000),
    _count("mesh.phases", "positions in one mesh period", 64, at_least=8, at_most=4096),
    _text("mesh.contact", "contact law", "exact", choices=("exact", "smooth")),
    _variable(
        "mesh.smoothing_um",
        "width of the smooth contact law",
        0.5,
        above=0.0,
        applies_if=("mesh.contact", "smooth"),
    ),
    _count(
        "mesh.line_load_updates",
        "updates of the contact stiffness by the line loads found",
        0,
        at_least=0,
        at_most=10,
    ),
    Key(
        "mesh.tip_contact",
        "bool",
        "contact of tip corners beyond the ends of the path",
        False,
    ),
    _number(
        "mesh.friction_coefficient",
        "coefficient of friction of the flanks, its mean over the path of contact; it says what "
        "sliding costs, and does not act back on the loads",
        0.05,
        at_least=0.0,
        below=1.0,
        remedy="Of oiled steel it is 0.02 to 0.08",
    ),
    _variable(
        "mesh.pinion_speed_rad_s",
        "speed of the pinion, whose rotation loads condensed bodies in the quasi-static cycle; "
        "default: at rest",
        at_least=0.0,
        at_most=1e5,
        remedy="The key is in rad/s",
    ),
    _text(
        "mesh.connection",
        "how slices stand on the rim of a condensed body: mortar, or collocation to compare with",
        "mortar",
        choices=("mortar", "collocation"),
    ),
    _count(
        "mesh.root_points",
        "points across the root of a tooth by which it stands on the rim of a condensed body; "
        "2: the thesis's two, if mesh.root_correction is false",
        12,
        at_least=2,
        at_most=24,
    ),
    Key(
        "mesh.root_correction",
        "bool",
        "whether what the rim's elements are too large to show of a root's give is added",
        True,
    ),
)

_RAYLEIGH = ("damping.kind", "rayleigh")
_SPEED = "At rest, the quasi-static cycle of `jaxgear run` is the response"


def _speeds(path: str, other: str = "") -> tuple[Key, ...]:
    """Keys of the speeds of a sweep in one unit, which may stand for those in another."""
    instead = lambda end: f"{other}{end}" if other else ""
    ends = [
        _number(
            f"{path}.{end}",
            f"{which} speed",
            REQUIRED,
            above=0.0,
            remedy=_SPEED,
            instead_of=instead(f".{end}"),
        )
        for end, which in (("from", "lowest"), ("to", "highest"))
    ]
    return (
        Key(
            path,
            "floats",
            "speeds of the pinion: a list, or a table with from, to and points",
            OPTIONAL if other else REQUIRED,
            above=0.0,
            instead_of=instead(""),
            remedy=_SPEED,
        ),
        *ends,
        _count(
            f"{path}.points",
            "number of speeds",
            REQUIRED,
            at_least=2,
            at_most=100_000,
            instead_of=instead(".points"),
        ),
    )


_DYNAMICS = (
    _count(
        "model.coordinates",
        "modes that each condensed body has in motion, the rest with their static part; 0: all, "
        "100 unless said",
        at_least=0,
    ),
    _count(
        "model.mesh_coordinates",
        "combinations of these that the mesh tells apart; 12 unless said",
        at_least=4,
        at_most=60,
    ),
    _text(
        "model.fidelity",
        "choice of the model; auto: run, map, optimise and sweep first compare models, and take "
        "the cheapest within compare.tolerance",
        "as given",
        choices=("as given", "auto"),
    ),
    Key(
        "model.gyroscopic",
        "bool",
        "whether gears and shafts that tilt while they spin feel it",
        False,
    ),
    _text("damping.kind", "kind of damping", "modal", choices=("modal", "rayleigh")),
    _number("damping.mesh", "damping ratio of the mesh", 0.07, at_least=0.0, below=1.0),
    _number("damping.structure", "damping ratio of the rest", 0.02, at_least=0.0, below=1.0),
    _number(
        "damping.a_R_1_s",
        "Rayleigh damping: factor of the mass matrix",
        REQUIRED,
        at_least=0.0,
        applies_if=_RAYLEIGH,
    ),
    _number(
        "damping.b_R_s",
        "Rayleigh damping: factor of the stiffness matrix",
        REQUIRED,
        at_least=0.0,
        applies_if=_RAYLEIGH,
    ),
    Key(
        "damping.active_mesh",
        "bool",
        "whether the mesh damps only while its teeth touch; for modal damping",
        False,
    ),
    *_speeds("sweep.pinion_speed_rad_s"),
    *_speeds("sweep.pinion_speed_rpm", "sweep.pinion_speed_rad_s"),
    _text(
        "sweep.direction",
        "speeds rising, falling, one after the other; cold: each by itself",
        "both",
        choices=("up", "down", "both", "cold"),
    ),
    _text(
        "sweep.method",
        "method of the sweep; auto: harmonic balance, but for cycles of many mesh periods newmark",
        "auto",
        choices=("auto", "newmark", "shooting", "harmonic"),
    ),
    Key("sweep.centrifugal", "bool", "whether condensed bodies grow with the speed", True),
    _count("sweep.steps", "time steps in one mesh period", 128, at_least=8, at_most=4096),
    _count(
        "sweep.harmonics",
        "harmonics of the mesh frequency in harmonic balance; fewer than half the steps",
        20,
        at_least=1,
        at_most=1000,
    ),
    _count(
        "sweep.cycles",
        "mesh periods to march before a response counts, in whole cycles and at least 4 of them",
        100,
        at_least=1,
        at_most=1_000_000,
    ),
    _count("sweep.orders", "orders of the mesh frequency written down", 8, at_least=1, at_most=200),
    Key(
        "sweep.continuation",
        "bool",
        "whether the branch is followed round its folds too; default: with direction = both",
    ),
    _count(
        "modes.count",
        "number of modes written down; default: 12, with condensed bodies 40, or all up to "
        "highest_Hz",
        at_least=1,
        at_most=10_000,
    ),
    _number("modes.highest_Hz", "highest natural frequency written down", above=0.0),
    _count("modes.harmonics", "mesh harmonics with critical speeds", 4, at_least=1, at_most=100),
)

_PROBES = (
    _text(
        "probes[].gear", "gear, with a condensed body, that is looked at", REQUIRED, choices=GEARS
    ),
    _text("probes[].name", "name in results; default: what is looked at"),
    _text(
        "probes[].frame",
        "whether the probe turns with the body, or stands still and sees it pass",
        "rotating",
        choices=("rotating", "fixed"),
    ),
    _text(
        "probes[].direction",
        "displacement that is read",
        "axial",
        choices=("radial", "tangential", "axial"),
    ),
    _number("probes[].radius_mm", "distance from the axis; default: the rim", above=0.0),
    _number(
        "probes[].angle_deg",
        "about Z; rotating: on the body, from the middle of tooth 0; fixed: in space, from S",
        0.0,
    ),
    _number("probes[].height_mm", "along Z from mid-face", 0.0),
    _text("probes[].node", "a node that was condensed with the body, by name, in place of a place"),
)

_TORQUES: dict[str, Any] = {"above": 0.0, "remedy": _TORQUE}
_POINTS: dict[str, Any] = {"at_least": 2, "at_most": 2000}
_WEIGHT: dict[str, Any] = {"at_least": 0.0}

_MAP = (
    _number("map.depth_um.from", "smallest depth", 0.0, at_least=0.0, remedy=_DEPTH),
    _number("map.depth_um.to", "largest depth; default: chosen by the program", above=0.0),
    _count("map.depth_um.points", "number of depths", 50, **_POINTS),
    _number("map.extent.from", "smallest extent", 0.01, above=0.0, at_most=1.0, remedy=_EXTENT),
    _number("map.extent.to", "largest extent", 0.5, above=0.0, at_most=1.0, remedy=_EXTENT),
    _count("map.extent.points", "number of extents", 50, **_POINTS),
    Key(
        "map.torques_Nm",
        "floats",
        "pinion torques of the Harris map, and of Master Curves",
        **_TORQUES,
    ),
)

# What can be made small, or traded.
_MINIMISED = (
    "te_rms",
    "te_peak_to_peak",
    "te_harmonics",
    "max_pressure",
    "face_load_factor",
    "pressure_offset",
    "dynamic_ratio",
    "bearing_force",
)

_OPTIMISE = (
    Key("optimise.vary", "texts", "the keys that the optimiser may change", REQUIRED),
    Key("optimise.symmetric", "bool", "pinion and wheel get the same relief", False),
    _text(
        "optimise.minimise",
        "what to minimise; a table of weights is allowed too",
        "te_rms",
        choices=_MINIMISED,
    ),
    _number("optimise.minimise.te_rms", "weight of static.te_rms_um", **_WEIGHT),
    _number("optimise.minimise.te_peak_to_peak", "weight of static.te_peak_to_peak_um", **_WEIGHT),
    _number("optimise.minimise.te_harmonics", "weight of the chosen harmonics", **_WEIGHT),
    _number("optimise.minimise.max_pressure", "weight of static.max_pressure_MPa", **_WEIGHT),
    _number("optimise.minimise.face_load_factor", "weight of the face load factor", **_WEIGHT),
    _number(
        "optimise.minimise.pressure_offset",
        "weight of the squared offset of the pressure from mid-face, over half the face",
        **_WEIGHT,
    ),
    _number(
        "optimise.minimise.dynamic_ratio",
        "weight of the dynamic ratio over the speeds of [sweep]",
        **_WEIGHT,
    ),
    _number(
        "optimise.minimise.bearing_force",
        "weight of the RMS of the bearings' forces over the speeds of [sweep], in N",
        **_WEIGHT,
    ),
    Key(
        "optimise.harmonics",
        "floats",
        "mesh harmonics that te_harmonics counts; default: the first",
        at_least=1.0,
        at_most=1000.0,
    ),
    _number(
        "optimise.smoothing_ratio",
        "width of the smooth maximum of the dynamic ratio, in static mesh forces",
        0.02,
        above=0.0,
        at_most=1.0,
    ),
    _text(
        "optimise.over_speeds",
        "how the numbers of the speeds are combined",
        "mean",
        choices=("mean", "worst"),
    ),
    Key("optimise.torques_Nm", "floats", "pinion torques; default: that of the pair", **_TORQUES),
    _text("optimise.over", "how torques are combined", "mean", choices=("mean", "worst")),
    _text(
        "optimise.method",
        "method of the search; with [optimise.limits] SLSQP takes its place",
        "lbfgs",
        choices=("lbfgs", "adam", "least_squares"),
    ),
    _count(
        "optimise.starts",
        "searches, from the scene itself and from the best of 64 points in the bounds",
        1,
        at_least=1,
        at_most=64,
    ),
    _number("optimise.limits.max_pressure_MPa", "largest pressure allowed", above=0.0),
    _number(
        "optimise.limits.te_peak_to_peak_um",
        "largest peak to peak of the transmission error allowed",
        above=0.0,
    ),
    _number("optimise.limits.face_load_factor", "largest face load factor allowed", above=1.0),
    _number(
        "optimise.limits.edge_line_load_N_mm",
        "largest line load on the first and the last slice allowed",
        above=0.0,
    ),
    Key(
        "optimise.anneal_um",
        "floats",
        "widths of smooth contact to search with before mesh.smoothing_um, falling",
        above=0.0,
        at_most=1000.0,
    ),
    _count("optimise.max_evaluations", "most evaluations", 50, at_least=1, at_most=1_000_000),
    _text(
        "optimise.pareto.against",
        "what optimise.minimise is traded against, design by design: the largest over the "
        "torques; left out: nothing",
        choices=_MINIMISED,
    ),
    _count("optimise.pareto.points", "designs to look for", 7, at_least=2, at_most=200),
)


_ROBUST = (
    _text(
        "robust.measure",
        "what of the objective over the sample is minimised",
        "quantile",
        choices=("mean", "quantile"),
    ),
    _number(
        "robust.share",
        "share of the gears that stays below the quantile",
        0.95,
        above=0.0,
        below=1.0,
        remedy="It is a share, not a percentage: 0.95 for 95 %",
    ),
    _count(
        "robust.samples",
        "gears in the sample that is searched with; a power of two",
        256,
        at_least=8,
        at_most=65_536,
    ),
    _count(
        "robust.fresh_samples",
        "gears in the sample that judges the result; a power of two",
        1024,
        at_least=8,
        at_most=65_536,
    ),
    _count("robust.seed", "seed of the samples; the fresh ones have the next one", 0, at_least=0),
    _number(
        "robust.accuracy_grade",
        "ISO 1328-1 class whose profile, helix and pitch deviations both gears have at random; "
        "left out: none",
        at_least=1.0,
        at_most=11.0,
        remedy="Classes of ISO 1328-1:2013 lie between 1 and 11",
    ),
    _number(
        "robust.tolerance_deviations",
        "standard deviations of these that fit into their tolerance",
        3.0,
        above=0.0,
        at_most=10.0,
    ),
)

_SIZING = (
    Key("sizing.torques_Nm", "floats", "pinion torques; default: that of the pair", **_TORQUES),
    Key("sizing.symmetric", "bool", "pinion and wheel get the same amounts", True),
)


# What `compare` compares: of the quasi-static cycle, and in motion.
STATIC_RESPONSES = (
    "te_mean",
    "te_rms",
    "te_peak_to_peak",
    "max_line_load",
    "max_pressure",
    "mesh_stiffness_mean",
)
DYNAMIC_RESPONSES = ("dynamic_ratio", "te_rms", "te_mean")

_COMPARE = (
    _number(
        "compare.tolerance",
        "error that is good enough, relative",
        0.02,
        above=0.0,
        below=1.0,
        remedy="It is a share, not a percentage: 0.02 is 2 %",
    ),
    Key(
        "compare.responses",
        "texts",
        "responses that count for the recommendation; default: all",
        choices=tuple(dict.fromkeys((*STATIC_RESPONSES, *DYNAMIC_RESPONSES))),
    ),
)


def _bounds(key: Key) -> Key:
    """Return the key of `[optimise.bounds]` that limits a number, or an entry of a list."""
    path = f"{key.path}[]" if key.kind == "floats" else key.path
    return dataclasses.replace(
        key,
        path=f"optimise.bounds.{path}",
        kind="floats",
        doc=f"lowest and highest value of {path}",
        default=OPTIONAL,
        length=2,
        applies_if=None,
        instead_of="",
        differentiable=False,
    )


def _tie(key: Key) -> Key:
    """Return the key of `[optimise.ties]` that makes a number follow a variable."""
    path = f"{key.path}[]" if key.kind == "floats" else key.path
    return Key(f"optimise.ties.{path}", "text", f"the variable that {path} is equal to")


def _amounts(key: Key) -> Key:
    """Return the key of `[sizing.amounts]` that lists the values of another one to try."""
    return dataclasses.replace(
        key,
        path=f"sizing.amounts.{key.path}",
        kind="floats",
        doc=f"values of {key.path} to try",
        default=OPTIONAL,
        differentiable=False,
    )


def _scatter(key: Key, table: str, doc: str) -> Key:
    """Return the key of a table of [robust] that says how much a number, or an entry, scatters."""
    path = f"{key.path}[]" if key.kind == "floats" else key.path
    return Key(
        f"{table}.{path}",
        "float",
        f"{doc} of {path}",
        above=0.0,
        remedy="Leave the key out where nothing scatters",
    )


_PLAIN = (
    *_GENERAL,
    *_PAIR,
    *(key for gear in GEARS for key in _gear(gear)),
    *(key for gear in GEARS for key in _flank(f"flank.{gear}")),
    *_HOUSING,
    *_MESH,
    *_DYNAMICS,
    *_PROBES,
    *_MAP,
    *_OPTIMISE,
    *_ROBUST,
    *_SIZING,
    *_COMPARE,
)

_REAL = tuple(key for key in _PLAIN if key.differentiable)
_SIZED = tuple(key for key in _REAL if key.path.startswith("flank.") and key.kind == "float")

# Paths of the schema: `[]` for any row, and at the end for any entry of a list.
REAL_KEYS: tuple[str, ...] = tuple(
    f"{key.path}[]" if key.kind == "floats" else key.path for key in _REAL
)

KEYS: Mapping[str, Key] = {
    key.path: key
    for key in (
        *_PLAIN,
        *map(_bounds, _REAL),
        *map(_tie, _REAL),
        *map(_amounts, _SIZED),
        *(_scatter(key, "robust.scatter", "standard deviation") for key in _REAL),
        *(_scatter(key, "robust.even", "half width of the even scatter") for key in _REAL),
    )
}


# An index as it is written in a path: one spelling for each number.
_COUNT = r"(?:0|[1-9][0-9]*)"


def general(path: str) -> str:
    """Return the path in the schema: `[]` for every index."""
    return re.sub(rf"\[{_COUNT}\]", "[]", path)


# What of a scene condensed bodies are made from or for: these tables, and these keys of the gears.
_SHAPING_TABLES = ("material", "{gear}.material", "{gear}.body", "{gear}.web")
_SHAPING_KEYS = (
    "pair.module_mm",
    "pair.pressure_angle_deg",
    "pair.helix_angle_deg",
    "pinion.face_width_mm",
    "wheel.face_width_mm",
    "mesh.slices",
    "mesh.periods",
    "mesh.tip_contact",
    "mesh.connection",
    "mesh.root_points",
    "mesh.root_correction",
    *(
        f"{{gear}}.{key}"
        for key in (
            "teeth",
            "profile_shift",
            # The teeth's mass is on the rim.
            "addendum_coeff",
            "tip_shortening_coeff",
            "tip_diameter_mm",
            "dedendum_coeff",
            "root_diameter_mm",
            "span_mm",
            "span_teeth",
            "over_balls_mm",
            "ball_mm",
            "fillet_radius_coeff",
            "bore_mm",
            "shaft.gear_at_mm",
            "shaft.torque_at_mm",
        )
    ),
)


def shapes_body(key: str, gear: str) -> bool:
    """Say whether a condensed body would be another one if a key of the scene were.

    **Arguments:**

    - `key`: path of the key.
    - `gear`: `pinion` or `wheel`, whose body is condensed.
    """
    whole = {each.format(gear=gear) for each in _SHAPING_KEYS}
    tables = tuple(f"{each.format(gear=gear)}." for each in _SHAPING_TABLES)
    along = key.startswith(f"{gear}.shaft.segments") or (
        key.startswith(f"{gear}.shaft.bearings") and key.endswith(".at_mm")
    )
    return key in whole or key.startswith(tables) or along


def scales_body(key: str, gear: str) -> bool:
    """Say whether a condensed body follows a key of the scene by its scale, without being remade.

    **Arguments:**

    - `key`: path of the key.
    - `gear`: `pinion` or `wheel`, whose body is condensed.
    """
    table, _, name = key.rpartition(".")
    if name == "young_GPa" and table == f"{gear}.body":
        return True
    return table in ("material", f"{gear}.material") and name in ("young_GPa", "density_kg_m3")


def of_condensed(key: str, gear: str) -> bool:
    """Say whether a key of a gear's body acts only on one that is condensed.

    **Arguments:**

    - `key`: path of the key.
    - `gear`: `pinion` or `wheel`.
    """
    return key == f"{gear}.body.young_GPa" or key.startswith(f"{gear}.body.web.")


def split_entry(path: str) -> tuple[str, int | None]:
    """Split off the index at the end of the path of a row or an entry; `None` where is none.

    In `[optimise.bounds]` an index belongs to the name of the key.
    """
    found = re.fullmatch(rf"(.+)\[({_COUNT})\]", path)
    if not found or path.startswith(BY_PATH):
        return path, None
    return found[1], int(found[2])


def unit_of(path: str) -> str:
    """Return the unit of a number, or of an entry of a list; empty for a plain or unknown one."""
    known = general(path)
    key = KEYS.get(known) or KEYS.get(known.removesuffix("[]"))
    return key.unit if key else ""


def parents(path: str) -> list[str]:
    """Return the tables above a key, outermost first: `a.b.c` has `a` and `a.b`."""
    parts = path.split(".")
    return [".".join(parts[:end]) for end in range(1, len(parts))]


TABLES: frozenset[str] = frozenset(table for path in KEYS for table in parents(path))


def _likeness(tail: str, known: str) -> float:
    """Likeness of two names, 0 to 1; `tork` is compared with `torque` and `torque_pinion_Nm`."""
    words = known.split("_")
    heads = ["_".join(words[:end]) for end in range(1, len(words) + 1)]
    return max(difflib.SequenceMatcher(None, tail, head).ratio() for head in heads)


def nearest(path: str, known: Iterable[str]) -> str | None:
    """Return the known path that `path` was most likely meant to be, or `None`.

    A name like it in the same table comes first, then one like it in another table, then a path
    like it as a whole.
    """
    table, _, tail = path.rpartition(".")
    best: tuple[float, float, str] | None = None
    for candidate in known:
        home, _, name = candidate.rpartition(".")
        whole = difflib.SequenceMatcher(None, path, candidate).ratio()
        alike = _likeness(tail, name)
        if home == table and alike >= 0.6:
            # Slips of the pen come after the first letter.
            score = 2.0 + alike + 0.1 * (tail[:1] == name[:1])
        elif alike >= 0.8:
            score = 1.0 + alike
        elif whole >= 0.85:
            score = whole
        else:
            continue
        best = max(best, (score, whole, candidate)) if best else (score, whole, candidate)
    return best[2] if best else None
