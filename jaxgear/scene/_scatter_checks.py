"""What can be wrong with [robust] that is seen from the scene alone."""

import math
from collections.abc import Iterator, Mapping, Set

from jaxgear.scene._key import show
from jaxgear.scene._schema import GEARS, shapes_body
from jaxgear.scene._study_tables import RobustKeys
from jaxgear.scene._tables import PlainTables

_TABLES = ("robust.scatter", "robust.even")
_OVER_SPEEDS = ("dynamic_ratio", "bearing_force")


def scattered_key(path: str) -> str:
    """The key that a key of [robust.scatter] or [robust.even] is about; empty for others."""
    table = next((each for each in _TABLES if path.startswith(f"{each}.")), path)
    return path.removeprefix(table).removeprefix(".")


def robust_mistakes(
    tables: PlainTables, values: Mapping[str, object], given: Set[str], *, faulty: bool
) -> Iterator[tuple[str, str]]:
    """Yield the path and the message of every mistake."""
    if "optimise" not in given:
        yield (
            "robust",
            "there is no table [optimise], whose optimum it could make robust. Add one, or remove "
            "[robust]",
        )
        return
    minimised = tables.optimise.minimise
    for name in _OVER_SPEEDS:
        if minimised == name or getattr(minimised, name, None) is not None:
            yield (
                "robust",
                f"is for responses of the mesh cycle, but optimise.minimise looks at {name}, whose "
                "sweep would be repeated for every gear of the sample. Minimise te_rms, or remove "
                "[robust]",
            )
    yield from _counts(tables.robust)
    keys = [path for path in values if scattered_key(path)]
    if not keys and not faulty and "robust.accuracy_grade" not in given:
        yield (
            "robust",
            "nothing scatters. Give robust.accuracy_grade, or standard deviations such as "
            '[robust.scatter] "pair.misalignment_inclination_um" = 5.0',
        )
    condensed = [gear for gear in GEARS if tables.gear(gear).body.kind == "condensed"]
    for path in keys:
        key = scattered_key(path)
        if path.startswith("robust.even.") and key in tables.robust.scatter:
            yield path, f"is in [robust.scatter] too, as {key}. Keep one"
        if any(shapes_body(key, gear) for gear in condensed):
            yield (
                path,
                f"got {show(values[path])}, but a condensed body is made from {key}: its finite "
                "elements do not follow. Let flanks, misalignment, torque or bearing stiffnesses "
                "scatter, or make the body rigid",
            )


def _counts(robust: RobustKeys) -> Iterator[tuple[str, str]]:
    """Numbers of samples, which must be powers of two and reach beyond the quantile."""
    counts = {"samples": robust.samples, "fresh_samples": robust.fresh_samples}
    for key, count in counts.items():
        if count is None:
            continue
        below = 2 ** (count.bit_length() - 1)
        if count != below:
            yield (
                f"robust.{key}",
                f"got {count}, must be a power of two, with which Sobol's points are even. Write "
                f"{below} or {2 * below}",
            )
            continue
        if robust.measure == "quantile" and robust.share is not None:
            rarer = min(robust.share, 1.0 - robust.share)
            if rarer * count < 1.0:
                needed = 2 ** (math.ceil(1.0 / rarer) - 1).bit_length()
                yield (
                    f"robust.{key}",
                    f"got {count}, of which not one gear is expected beyond a share of "
                    f"{robust.share:g}. Write {needed} or more, or take a share less extreme",
                )
