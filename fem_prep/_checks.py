"""What a body must be, said kindly, and how long work tells how far it is."""

import contextlib
import string
from collections.abc import Callable, Mapping
from math import pi
from typing import Any

Progress = Callable[[str], contextlib.AbstractContextManager[None]]
"""Called with what begins; the context lasts as long as it does."""

# What a number in SI is divided by, where a rule says so after its format.
_UNITS = {"mm": 1e-3, "cm3": 1e-6, "deg": pi / 180.0}
_NO_NAMES: Mapping[str, str] = {}


class BodyError(ValueError):
    """A gear body that cannot be, or is not what it claims; the message says what to do.

    **Fields:**

    - `rule`: what must hold and what was given. With `given` it is a format string: a number in SI
        is written as `{width:.4g/mm}`, and a field that the reader can change as `{Web.angle}`.
    - `given`: what fills it, in SI; without it the rule is plain text.
    - `remedy`: what to do, where the rule does not say it.
    """

    def __init__(self, rule: str, given: Mapping[str, Any] | None = None, remedy: str = ""):
        self.rule, self.given, self.remedy = rule, given, remedy
        super().__init__(self.worded())

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields that the rule is about, such as `Web.angle`."""
        parts = string.Formatter().parse(self.rule) if self.given is not None else ()
        return tuple(name for _, name, _, _ in parts if name and _is_field(name, self.given or {}))

    def worded(self, names: Mapping[str, str] = _NO_NAMES, remedy: str | None = None) -> str:
        """The message, in a reader's own words.

        **Arguments:**

        - `names`: that the reader knows fields by; others keep theirs.
        - `remedy`: in place of the error's own.

        **Returns:**

        Rule and remedy.
        """
        rule = self.rule
        if self.given is not None:
            rule = _Words(names).vformat(rule, (), self.given)
        remedy = self.remedy if remedy is None else remedy
        return f"{rule} {remedy}" if remedy else rule


def _is_field(name: str, given: Mapping[str, Any]) -> bool:
    return name.partition(".")[0] not in given


class _Words(string.Formatter):
    """Numbers in the units that a rule asks for, and fields by the names of a reader."""

    def __init__(self, names: Mapping[str, str]):
        self._names = names

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        if _is_field(field_name, kwargs):
            return f"`{self._names.get(field_name, field_name)}`", field_name
        return super().get_field(field_name, args, kwargs)

    def format_field(self, value: Any, format_spec: str) -> str:
        number, _, unit = format_spec.partition("/")
        return format(value / _UNITS[unit] if unit else value, number)


def require(ok: object, rule: str, *, remedy: str = "", **given: object) -> None:
    """Raise `BodyError` unless `ok`.

    **Arguments:**

    - `ok`: what must hold.
    - `rule`: a format string: what must hold, what was given, what to do.
    - `remedy`: what to do, where whoever words the error may know better.
    - `given`: what fills the rule, in SI.

    **Raises:**

    - `BodyError` if `ok` is false.
    """
    if not ok:
        raise BodyError(rule, given, remedy)


def silent(step: str) -> contextlib.AbstractContextManager[None]:
    """Progress that nobody watches."""
    del step
    return contextlib.nullcontext()
