"""What can be wrong with [robust] that is seen from the scene alone."""

import math
from collections.abc import Iterator, Mapping, Set

from jaxgear.scene._schema import GEARS, shapes_body, show

_TABLES = ("robust.scatter", "robust.even")
_OVER_SPEEDS = ("dynamic_ratio", "bearing_force")


def scattered_key(path: str) -> str:
    """The key that a key of [robust.scatter] or [robust.even] is about; empty for others.

    **Arguments:**

    - `path`: dotted path.
    """
    for table in _TABLES:
        if path.startswith(f"{table}."):
            return path.removeprefix(f"{table}.")
    return ""


def robust_mistakes(
    values: Mapping[str, object], seen: Set[str], *, faulty: bool
) -> Iterator[tuple[str, str]]:
    """Yield the path and the message of every mistake.

    **Arguments:**

    - `values`: of the scene, by path.
    - `seen`: tables and keys that were given.
    - `faulty`: whether a key of [robust] has been refused already.
    """
    if "optimise" not in seen:
        yield (
            "robust",
            "there is no table [optimise], whose optimum it could make robust. Add one, or remove "
            "[robust]",
        )
        return
    for name in _OVER_SPEEDS:
        weighted = f"optimise.minimise.{name}" in values
        if weighted or values.get("optimise.minimise") == name:
            yield (
                "robust",
                f"is for responses of the mesh cycle, but optimise.minimise looks at {name}, whose "
                "sweep would be repeated for every gear of the sample. Minimise te_rms, or remove "
                "[robust]",
            )
    yield from _counts(values)
    keys = [path for path in values if scattered_key(path)]
    if not keys and not faulty and "robust.accuracy_grade" not in seen:
        yield (
            "robust",
            "nothing scatters. Give robust.accuracy_grade, or standard deviations such as "
            '[robust.scatter] "pair.misalignment_inclination_um" = 5.0',
        )
    condensed = [gear for gear in GEARS if values.get(f"{gear}.body.kind") == "condensed"]
    for path in keys:
        key = scattered_key(path)
        if path.startswith("robust.even.") and f"robust.scatter.{key}" in values:
            yield path, f"is in [robust.scatter] too, as {key}. Keep one"
        if any(shapes_body(key, gear) for gear in condensed):
            yield (
                path,
                f"got {show(values[path])}, but a condensed body is made from {key}: its finite "
                "elements do not follow. Let flanks, misalignment, torque or bearing stiffnesses "
                "scatter, or make the body rigid",
            )


def _counts(values: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    """Numbers of samples, which must be powers of two and reach beyond the quantile."""
    for path in ("robust.samples", "robust.fresh_samples"):
        count = values.get(path)
        if not isinstance(count, int):
            continue
        below = 2 ** (count.bit_length() - 1)
        if count != below:
            yield (
                path,
                f"got {count}, must be a power of two, with which Sobol's points are even. Write "
                f"{below} or {2 * below}",
            )
            continue
        share = values.get("robust.share")
        if values.get("robust.measure") == "quantile" and isinstance(share, float):
            rarer = min(share, 1.0 - share)
            if rarer * count < 1.0:
                needed = 2 ** (math.ceil(1.0 / rarer) - 1).bit_length()
                yield (
                    path,
                    f"got {count}, of which not one gear is expected beyond a share of "
                    f"{share:g}. Write {needed} or more, or take a share less extreme",
                )
