"""One key of a scene: its type, its bounds, and what is said of a value that is wrong."""

import dataclasses
import difflib
import enum
import json
import math
import operator
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

_NOUNS: Mapping[Kind, tuple[str, str]] = {
    "float": ("a number", ""),
    "int": ("an integer", ""),
    "text": ("text in quotes", ""),
    "bool": ("true or false", ""),
    "floats": ("a list of numbers", ", each"),
    "texts": ("a list of texts in quotes", ", each"),
}

_SIGNS = {">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le}

# Longest suffix first: `_N_mm_um` also ends in `_um`.
_UNITS = {
    "_N_mm_um": "N/(mm um)",
    "_kg_m3": "kg/m^3",
    "_kg_m2": "kg m^2",
    "_Nm_rad": "N m/rad",
    "_rad_s": "rad/s",
    "_R_1_s": "1/s",
    "_R_s": "s",
    "_gmm": "g mm",
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
    "_1_K": "1/K",
    "_K": "K",
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
    def _bounds(self) -> dict[str, float]:
        signs = {">": self.above, ">=": self.at_least, "<": self.below, "<=": self.at_most}
        return {sign: bound for sign, bound in signs.items() if bound is not None}

    def holds(self, number: float) -> bool:
        """Whether a number lies within the bounds."""
        return all(_SIGNS[sign](number, bound) for sign, bound in self._bounds.items())

    @property
    def allowed(self) -> str:
        """What a value must be, in words."""
        noun, each = _NOUNS[self.kind]
        if self.choices:
            return ("" if self.kind == "text" else noun + each + " ") + one_of(self.choices)
        if self.length is not None:
            noun = f"a list of {self.length} numbers"
        bounds = [f"{sign} {bound:g}" for sign, bound in self._bounds.items()]
        if self.at_least is not None and self.at_least == self.at_most:
            bounds = [f"equal to {self.at_least:g}"]
        text = noun + (each + " " if bounds and each else " " if bounds else "")
        return text + " and ".join(bounds) + (f" [{self.unit}]" if self.unit else "")

    def read(self, value: object) -> Any:
        """Return the value in its canonical type, or raise `ValueError` saying what is wrong."""
        if self.kind not in ("floats", "texts"):
            return self._read_one(value, value)
        if not isinstance(value, list):
            brackets = isinstance(value, str if self.kind == "texts" else int | float)
            raise self._wrong(value, f". Write [{show(value)}]" if brackets else "")
        if self.length not in (None, len(value)) or (not value and self.default != []):
            raise self._wrong(value)
        return [self._read_one(entry, value) for entry in value]

    def _read_one(self, entry: Any, value: object) -> object:
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
        numbers: Any = {"int": int, "float": int | float, "floats": int | float}.get(self.kind, ())
        if isinstance(entry, bool) or not isinstance(entry, numbers):
            raise self._wrong(value, self._type_hint(entry))
        try:
            number = float(entry)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self._wrong(value, ". It must be finite")
        if not self.holds(number):
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
