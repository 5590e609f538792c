"""REXS files (Reusable Engineering EXchange Standard, rexs.info): components and their relations.

Versions 1.0 to 2.0 as XML (.rexs), JSON (.rexsj) or either in a ZIP archive (.rexsz), told apart
by what is in the file. Nothing is unpacked to the disc, fetched, or expanded.

Numbers stay decimal until they are in their unit, so that a length in micrometres comes back from
a file in millimetres to the last digit.
"""

import io
import json
import math
import struct
import xml.etree.ElementTree as ET
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

from jaxgear._checks import InputError, require

# What one of a unit is in mm, degrees, N, N m, N/m, N m/rad, rpm, MPa, kg/dm^3.
_UNITS = {
    "mm": Decimal(1),
    "m": Decimal(1000),
    "mum": Decimal("0.001"),
    "°": Decimal(1),
    "deg": Decimal(1),
    "rad": Decimal(180.0 / math.pi),
    "none": Decimal(1),
    "": Decimal(1),
    "N": Decimal(1),
    "kN": Decimal(1000),
    "N m": Decimal(1),
    "kN m": Decimal(1000),
    "N / m": Decimal(1),
    "N / mm": Decimal(1000),
    "N / mum": Decimal(1000000),
    "N mm / rad": Decimal("0.001"),
    "N m / rad": Decimal(1),
    "1 / min": Decimal(1),
    "N / mm^2": Decimal(1),
    "MPa": Decimal(1),
    "kg / dm^3": Decimal(1),
}
# Far above any gearbox, and far below what would stop a computer [bytes].
_LARGEST, _ENTRIES = 64_000_000, 1000
_SUFFIXES = (".rexs", ".rexsj")


class Component(NamedTuple):
    """A component of a file.

    **Fields:**

    - `kind`: its type, as the REXS database names it.
    - `name`: for messages.
    - `attributes`: text and unit of each plain attribute.
    """

    kind: str
    name: str
    attributes: Mapping[str, tuple[str, str]]

    def decimal(self, name: str) -> Decimal | None:
        """An attribute in its unit among mm, degrees, N, N m, N/m, N m/rad, rpm, MPa, kg/dm^3.

        `None` where it is left out.

        **Raises:**

        - `InputError` if it is no finite number, or its unit is not known.
        """
        text, unit = self.attributes.get(name, ("", ""))
        if not text:
            return None
        try:
            value = Decimal(text) * _UNITS[unit]
        except (KeyError, ArithmeticError):
            raise InputError(
                f"{self.kind} {self.name}: {name} must be a number in a unit that is known, got "
                f"{text} in {unit}."
            ) from None
        message = "{name} must be finite, got {text}."
        require(value.is_finite() and math.isfinite(value), message, name=name, text=text)
        return value

    def number(self, name: str, scale: int = 0) -> float | None:
        """The same as a float, times ten to the power of `scale`."""
        value = self.decimal(name)
        return None if value is None else float(value.scaleb(scale))

    def needed(self, name: str) -> Decimal:
        """The same as a decimal, refused where it is left out."""
        value = self.decimal(name)
        if value is None:
            raise InputError(f"{self.kind} {self.name}: {name} is missing, without which no scene.")
        return value


class Relation(NamedTuple):
    """Who belongs to whom.

    **Fields:**

    - `kind`: its type, as the REXS database names it.
    - `roles`: identifiers of components, by the role that they play.
    """

    kind: str
    roles: Mapping[str, str]


class RexsModel(NamedTuple):
    """What a file holds.

    **Fields:**

    - `version`: of REXS.
    - `application`: that wrote it.
    - `parts`: components, by identifier.
    - `relations`: in their order.
    - `cases`: of each load case, by identifier, the attributes that it gives components.
    """

    version: str
    application: str
    parts: Mapping[str, Component]
    relations: tuple[Relation, ...]
    cases: Mapping[str, Mapping[str, Component]]

    def those(self, kind: str, **roles: str) -> Iterator[Mapping[str, str]]:
        """Relations of a kind in which some roles are played by given components."""
        for each in self.relations:
            if each.kind == kind and all(each.roles.get(role) == of for role, of in roles.items()):
                yield each.roles

    def related(self, relation: str, role: str, kind: str, **roles: str) -> list[Component]:
        """Components of a kind that play a role in relations to given ones."""
        ids = [found.get(role, "") for found in self.those(relation, **roles)]
        return [self.parts[each] for each in ids if self.is_a(each, kind)]

    def is_a(self, part: str, kind: str) -> bool:
        """Whether there is such a component, and of this kind."""
        return part in self.parts and self.parts[part].kind == kind

    def under(self, case: str) -> "RexsModel":
        """The model under one of its load cases."""
        parts = dict(self.parts)
        for each, given in self.cases[case].items():
            if each in parts:
                merged = {**parts[each].attributes, **given.attributes}
                parts[each] = parts[each]._replace(attributes=merged)
        return self._replace(parts=parts)


class _Builder(ET.TreeBuilder):
    """Builds a tree of a document without a type of its own: entities could grow without end."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise InputError("A REXS file has no DOCTYPE. Write it again without.")


def read_rexs(path: Path) -> RexsModel:
    """Read a REXS file: XML, JSON, or a ZIP archive of either.

    **Arguments:**

    - `path`: of the file.

    **Raises:**

    - `InputError` if it cannot be read, is too large, or is none of REXS.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
        if content.startswith(b"PK"):
            content = _unpacked(content)
        words = "has more than {most:g} MB: no gearbox. Is it a REXS file?"
        require(len(content) <= _LARGEST, words, most=_LARGEST / 1e6)
        if content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
            return _model_of_json(content)
        return _model_of_xml(content)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}.") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _unpacked(content: bytes) -> bytes:
    """The first REXS file of an archive, in memory, as far as the limit and one byte more."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            words = "the archive has {got} entries, of {most} at most."
            require(len(entries) <= _ENTRIES, words, got=len(entries), most=_ENTRIES)
            inside = [each for each in entries if each.filename.lower().endswith(_SUFFIXES)]
            require(inside, "the archive has no .rexs or .rexsj file in it.")
            with archive.open(inside[0]) as file:
                return file.read(_LARGEST + 1)
    except InputError:
        # A refusal from above, a ValueError too.
        raise
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        NotImplementedError,
        RuntimeError,
        # A place before the file's begin, or a name that is no text.
        ValueError,
        struct.error,
    ) as error:
        raise InputError(f"the archive cannot be read: {error}.") from None


def _model_of_xml(content: bytes) -> RexsModel:
    try:
        root = ET.fromstring(content, ET.XMLParser(target=_Builder()))
    except InputError:
        # The refusal of a DOCTYPE, a ValueError too.
        raise
    except (ET.ParseError, LookupError, ValueError) as error:
        raise InputError(f"not a REXS file: no XML: {error}.") from None
    # 2.0 may name a space.
    for each in root.iter():
        each.tag = each.tag.rpartition("}")[2] if isinstance(each.tag, str) else ""
    require(root.tag == "model", "not a REXS file: its root is {got}.", got=root.tag)
    return RexsModel(
        root.get("version", ""),
        root.get("applicationId", ""),
        {x.get("id", ""): _of_xml(x) for x in root.iterfind("components/component")},
        tuple(
            Relation(x.get("type", ""), {ref.get("role", ""): ref.get("id", "") for ref in x})
            for x in root.iterfind("relations/relation")
        ),
        {
            case.get("id", ""): {x.get("id", ""): _of_xml(x) for x in case.iterfind("component")}
            for case in root.iterfind("load_spectrum/load_case")
        },
    )


def _of_xml(element: ET.Element) -> Component:
    attributes = {
        each.get("id", ""): ((each.text or "").strip(), each.get("unit", "none"))
        for each in element.iterfind("attribute")
    }
    return Component(element.get("type", ""), element.get("name", ""), attributes)


def _model_of_json(content: bytes) -> RexsModel:
    try:
        root = json.loads(content, parse_float=str, parse_int=str, parse_constant=str)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not a REXS file: no JSON: {error}.") from None
    model = root.get("model")
    require(isinstance(model, dict), "not a REXS file: it has no model.")
    spectra = _objects(model, "load_spectrums") or _objects(model, "load_spectrum")
    return RexsModel(
        str(model.get("version", "")),
        str(model.get("applicationId", "")),
        _of_json(model),
        tuple(
            Relation(
                str(x.get("type", "")),
                {str(r.get("role", "")): str(r.get("id", "")) for r in _objects(x, "refs")},
            )
            for x in _objects(model, "relations")
        ),
        {
            str(case.get("id", "")): _of_json(case)
            for spectrum in spectra
            for case in _objects(spectrum, "load_cases")
        },
    )


def _objects(of: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    """A list of objects, or one alone; what is none of these is left out."""
    found = of.get(name)
    return [x for x in (found if isinstance(found, list) else [found]) if isinstance(x, dict)]


def _of_json(owner: Mapping[str, Any]) -> Mapping[str, Component]:
    """Components: the value of an attribute stands under the name of its type."""
    found = {}
    for each in _objects(owner, "components"):
        attributes = {}
        for x in _objects(each, "attributes"):
            values = [x[name] for name in x if name not in ("id", "unit")]
            plain = values[0] if values and isinstance(values[0], str) else ""
            attributes[str(x.get("id", ""))] = (plain.strip(), str(x.get("unit", "none")))
        named = (str(each.get("type", "")), str(each.get("name", "")))
        found[str(each.get("id", ""))] = Component(*named, attributes)
    return found


def plain_number(value: float, scale: int = 0) -> str:
    """A number times ten to the power of `scale`, as text from which it can be had back."""
    return str(Decimal(repr(float(value))).scaleb(scale))
