"""Tables of a scene as classes: how their keys are declared, listed by path, and given values.

`float | None` without a default is optional, `float` without one is required, `Literal[...]` lists
the choices.
"""

import dataclasses
import functools
import inspect
import itertools
import re
from abc import abstractmethod
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence, Set
from types import UnionType
from typing import (
    Any,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
)

from jaxgear.scene._key import OPTIONAL, REQUIRED, Key, Kind

# An interval, open or closed at either end, and what to do about a value out of it.
_RULE = re.compile(r"(?:([\[(])(\S+), (\S+)([\])])(?:\. |$))?(.*)")


class Declared(NamedTuple):
    """What `key` was told of a key, beside its annotation."""

    doc: str
    rule: str
    default: object
    more: dict[str, Any]


def key(doc: str, rule: str = "", default: object = ..., **more: Any) -> Any:
    """Declare a key of a table.

    **Arguments:**

    - `doc`: one line for the user.
    - `rule`: the interval of its numbers, such as `(0, 1]`, and behind a full stop the remedy.
    - `default`: none where it is left out.
    - `more`: other fields of `Key`; keys are named as within the table.
    """
    return Declared(doc, rule, default, more)


def real(doc: str, rule: str = "", default: object = ..., **more: Any) -> Any:
    """Declare a number, or a list of them, that the static model can be differentiated by."""
    return Declared(doc, rule, default, more | {"differentiable": True})


T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(key, real))
class AbstractKeys:
    """A table of the scene file, whose values do not change.

    Own classes, since every message needs the path, the unit and the remedy that stand in the
    schema anyway. Measured: pydantic gave the same 1,290 texts of single keys with 24 lines less,
    but took 0.12 s more of every command, and `--help` takes 0.15 s; msgspec stops at the first
    mistake; frozen dataclasses took 0.05 s to be made.

    **Fields:**

    - `is_given`: whether the user wrote it, even empty.
    - `given`: names of the keys and tables in it that the user wrote.
    """

    is_given: bool
    given: Set[str]

    @abstractmethod
    def __init__(self, **values: object) -> None: ...

    def __init_subclass__(cls) -> None:
        declare(cls)

    def written(self, *keys: str) -> list[str]:
        """Which of these keys the user wrote."""
        return [each for each in keys if each in self.given]

    @property
    def values(self) -> Mapping[str, Any]:
        """What it says, by attribute."""
        return {each.attribute: getattr(self, each.attribute) for each in slots_of(type(self))}


def declare(kind: type) -> None:
    """Make a class one of tables: its keys apart from it, its values set once."""
    declared = {name: each for name, each in vars(kind).items() if isinstance(each, Declared)}
    for name in declared:
        delattr(kind, name)
    for name, value in {
        "declared": declared,
        "__init__": _fill,
        "__setattr__": _refuse,
        "__repr__": lambda self: f"{type(self).__name__}({vars(self)})",
    }.items():
        setattr(kind, name, value)


def _fill(self: object, **values: object) -> None:
    vars(self).update(values)


def _refuse(self: object, name: str, value: object) -> None:
    raise AttributeError(f"{name}: a scene does not change; scene.replace makes another one")


class Slot(NamedTuple):
    """What an attribute of a table is in the file: a key, a table, or rows of tables.

    **Fields:**

    - `attribute`, `name`: in Python, where `from` is `from_`, and in the file.
    - `key`: the key, if it can be a value; its path and those it names are within the table.
    - `table`: the class of its table, or of each of its rows, if it can be one.
    - `rows`: whether it is a list of tables.
    """

    attribute: str
    name: str
    key: Key | None
    table: Any
    rows: bool


_KINDS: Mapping[Any, Kind] = {float: "float", int: "int", str: "text", bool: "bool"}


@functools.cache
def slots_of(table: Any) -> tuple[Slot, ...]:
    """What the attributes of a table are in the file; neither key nor table if paths of others."""
    found = []
    classes = (each for each in table.__mro__ if each is not AbstractKeys)
    forms = ChainMap(*map(inspect.get_annotations, classes))
    for attribute, form in forms.items():
        parts, declared = _parts(form), table.declared.get(attribute)
        rows = [get_args(part)[0] for part in parts if get_origin(part) is tuple]
        tables = [part for part in parts if hasattr(part, "declared")]
        name = attribute.removesuffix("_")
        key = _key_of(name, parts, declared) if declared else None
        found.append(Slot(attribute, name, key, next(iter(rows + tables), None), bool(rows)))
    return tuple(found)


def _key_of(name: str, parts: Sequence[Any], declared: Declared) -> Key:
    """The key that is declared by an annotation and by `key`."""
    lists = [each for part in parts if get_origin(part) is list for each in get_args(part)]
    forms = [each for form in lists or parts for each in _parts(form)]
    texts = [get_args(form) for form in forms if get_origin(form) is Literal]
    kind: Kind = "text" if texts else next(_KINDS[form] for form in forms if form in _KINDS)
    several: Mapping[Kind, Kind] = {"float": "floats", "text": "texts"}
    default = declared.default
    if default is ...:
        default = OPTIONAL if type(None) in parts else REQUIRED
    interval = _RULE.fullmatch(declared.rule)
    assert interval is not None
    opening, low, high, closing, remedy = interval.groups()
    bounds: dict[str, Any] = {
        {"(": "above", "[": "at_least", ")": "below", "]": "at_most"}[end]: float(bound)
        for end, bound in ((opening, low), (closing, high))
        if end and bound not in ("-inf", "inf")
    }
    return Key(
        path=name,
        kind=several[kind] if lists else kind,
        doc=declared.doc,
        default=default,
        choices=tuple(dict.fromkeys(itertools.chain(*texts))),
        remedy=remedy,
        **bounds,
        **declared.more,
    )


def _parts(form: Any) -> list[Any]:
    """What an annotation allows, one by one."""
    if get_origin(form) in (Union, UnionType):
        return [part for each in get_args(form) for part in _parts(each)]
    return [form]


def keys_of(table: type, prefix: str = "", instead_of: str = "") -> Iterator[Key]:
    """The keys of a table and of those in it, with their whole paths, in the order of the file.

    **Arguments:**

    - `table`: its class.
    - `prefix`: its path, and a point.
    - `instead_of`: the table that it may be given in place of, and a point.
    """
    inside = lambda where: where and (f"{prefix}{where[0]}", where[1])
    for slot in slots_of(table):
        key, other = slot.key, instead_of and f"{instead_of}{slot.name}"
        if key is not None:
            other = f"{prefix}{key.instead_of}" if key.instead_of else other
            yield dataclasses.replace(
                key,
                path=f"{prefix}{slot.name}",
                applies_if=inside(key.applies_if),
                default_if=inside(key.default_if),
                instead_of=other,
            )
        if slot.table is not None:
            rows = "[]" if slot.rows else ""
            yield from keys_of(slot.table, f"{prefix}{slot.name}{rows}.", other and f"{other}.")


def table_of(table: type[T], values: Mapping[str, Any], given: Set[str], prefix: str = "") -> T:
    """A table of values.

    **Arguments:**

    - `table`: its class.
    - `values`: by whole path; what is not there is `None`.
    - `given`: paths of what the user wrote: keys, tables, and rows of lists of tables.
    - `prefix`: its path, and a point.
    """
    found: dict[str, Any] = {}
    for attribute, name, key, inner, several in slots_of(table):
        path = f"{prefix}{name}"
        if inner is not None and several:
            places = itertools.takewhile(
                given.__contains__, (f"{path}[{i}]" for i in itertools.count())
            )
            found[attribute] = tuple(table_of(inner, values, given, f"{at}.") for at in places)
        elif inner is not None and path not in values:
            found[attribute] = table_of(inner, values, given, f"{path}.")
        elif key is None:
            below = (each for each in values if each.startswith(f"{path}."))
            found[attribute] = {each.removeprefix(f"{path}."): values[each] for each in below}
        else:
            found[attribute] = values.get(path)
    own = frozenset(each.name for each in slots_of(table) if f"{prefix}{each.name}" in given)
    found |= {"given": own, "is_given": prefix.rstrip(".") in given}
    return table(**found)
