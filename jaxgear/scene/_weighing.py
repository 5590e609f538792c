"""Two numbers against each other: how far off is impossible, how far odd, and what was meant."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from jaxgear.scene._key import show
from jaxgear.scene._schema import unit_of

# What a number may have been given in instead of the key's unit, and how many of that it is.
_MISTAKEN = {
    "mm": (("metres", 1e3), ("inches", 25.4)),
    "um": (("millimetres", 1e3), ("metres", 1e6)),
    "N m": (("N mm", 1e-3), ("kN m", 1e3)),
    "N/m": (("N/mm", 1e3), ("N/um", 1e6)),
    "rad/s": (("revolutions per minute", math.pi / 30.0),),
    "degrees": (("radians", 180.0 / math.pi),),
    "N/(mm um)": (("N/m^2", 1e-9), ("N/mm^2", 1e-3)),
    "kg/m^3": (("g/cm^3", 1e3),),
    "GPa": (("TPa", 1e3), ("MPa", 1e-3)),
    "kg": (("grams", 1e-3), ("tonnes", 1e3)),
    "kg m^2": (("kg mm^2", 1e-6), ("kg cm^2", 1e-4)),
}


class Slip(NamedTuple):
    """A number that does not go with others.

    **Fields:**

    - `path`: of its key.
    - `impossible`: whether it is a mistake, or merely odd.
    - `message`: what was given, what is the limit, what to do; of an odd one with its path.
    """

    path: str
    impossible: bool
    message: str


class Span(NamedTuple):
    """What a ratio may be.

    **Fields:**

    - `least`, `most`: beyond these it is impossible [-].
    - `low`, `high`: beyond these it is odd [-].
    """

    least: float
    low: float
    high: float
    most: float

    @property
    def inverse(self) -> "Span":
        """What the inverse ratio may be."""
        return Span(*(1.0 / bound for bound in reversed(self)))


def weigh(path: str, value: float | None, reference: float, span: Span, of: str) -> Iterator[Slip]:
    """Weigh a number against another one.

    **Arguments:**

    - `path`: of its key.
    - `value`: the number, in the key's unit; zero is let through, and none.
    - `reference`: what it is weighed against, in the same unit.
    - `span`: what their ratio may be.
    - `of`: the reference in words; empty where it says nothing.

    **Returns:**

    One slip, or none.
    """
    if not value or not reference > 0.0:
        return
    ratio = abs(value) / reference
    if span.low <= ratio <= span.high:
        return
    impossible = not span.least <= ratio <= span.most
    too_small = ratio < span.low
    lowest, highest = (span.least, span.most) if impossible else (span.low, span.high)
    bound = lowest if too_small else highest
    unit = unit_of(path)
    side = "at least" if too_small else "at most"
    that = of if bound == 1.0 or not of else f"{bound:.3g} times {of}"
    hint = advice(value, unit, span.low * reference, span.high * reference)
    limit = f"{bound * reference:.4g} {unit}".strip() + (" in size" if value < 0.0 else "")
    if impossible:
        message = f"got {show(value)}, must be {side} {limit}{that and f': {that}'}. {hint}"
    else:
        given = f"{path} = {value:.6g} {unit}".strip()
        message = f"{given} is odd: {side} {limit}{that and f', {that},'} is usual. {hint}"
    yield Slip(path, impossible, message)


def advice(value: float, unit: str, low: float, high: float) -> str:
    """Say which other unit would make a number usual."""
    for name, factor in _MISTAKEN.get(unit, ()):
        if low <= abs(value) * factor <= high:
            return f"If {value:.6g} is in {name}, write {value * factor:.6g}"
    return "Check the units"
