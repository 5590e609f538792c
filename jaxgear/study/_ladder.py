"""Which rung of a ladder suffices: chosen with a margin, and tried where it was not chosen.

A rung is a line of a summary: its `name`, its `family`, its `time_s`, and `error`, by response, at
the points by which it is chosen. Those in motion are judged by `error_95` instead: a median would
leave out the resonances. A rung `beyond` the scene is another physical model, never recommended.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Summary = dict[str, Any]
# Errors at held-out points, by response.
HeldOut = Callable[[Summary], Mapping[str, float | None]]

# Share of the tolerance that a rung may use up at the points by which it is chosen. Of quasi-static
# cycles, errors of the size of the tolerance were up to 1.3 times as large at torques and flanks
# held out: of the accessory pair on 16 phases 1.5 % and 1.9 % in the mean mesh stiffness [-].
MARGIN = 0.75
# Of the speeds that count, so many must be settled, for a rung to be recommended [-].
MOST = 0.9

# Times of which the longer is so many times the shorter, or less, count as equal: so much may other
# work on the machine change the shortest of several runs [-].
NEAR = 1.25

# What can be compared, in words.
QUANTITIES = {
    "dynamic_ratio": "largest mesh force",
    "te_rms": "RMS of transmission error",
    "te_mean": "mean transmission error",
    "te_peak_to_peak": "peak to peak of transmission error",
    "max_line_load": "largest line load",
    "max_pressure": "largest pressure",
    "mesh_stiffness_mean": "mean mesh stiffness",
}


@dataclass(frozen=True)
class Choice:
    """What was found of a ladder.

    **Fields:**

    - `row`: line of the recommended rung, or `None`.
    - `failed`: names of cheaper ones that were good, until they were tried elsewhere.
    - `best`: line of the rung with the smallest of its largest errors.
    """

    row: Summary | None
    failed: tuple[str, ...]
    best: Summary


def worst(errors: Mapping[str, float | None], responses: Sequence[str]) -> float:
    """The largest of some errors; infinite if one of them is none [-]."""
    values = [errors.get(name) for name in responses]
    return max(np.inf if x is None or not np.isfinite(x) else float(x) for x in values)


def judged_by(row: Mapping[str, Any]) -> Mapping[str, float | None]:
    """The errors by which a rung is chosen."""
    return row.get("error_95", row["error"])


def is_good(row: Summary, tolerance: float, responses: Sequence[str] | None = None) -> bool:
    """Whether a rung's errors are small enough, at enough speeds.

    **Arguments:**

    - `row`: its line.
    - `tolerance`: of the errors [-].
    - `responses`: those that count; all by default.
    """
    errors = judged_by(row)
    enough = min(row.get("same_branch_share", 1.0), row.get("settled_share", 1.0)) >= MOST
    return enough and worst(errors, responses or tuple(errors)) <= tolerance


def cheapest(
    rows: Sequence[Summary], tolerance: float, responses: Sequence[str] | None = None
) -> Summary | None:
    """The fastest rung that is good enough, if there is one; arguments as for `is_good`."""
    good = [row for row in rows if is_good(row, tolerance, responses)]
    return next(iter(by_time(good, responses)), None)


def by_time(rows: Sequence[Summary], responses: Sequence[str] | None = None) -> list[Summary]:
    """Rungs from the fastest to the slowest; of those as fast as each other the best is first.

    **Arguments:**

    - `rows`: lines of the rungs.
    - `responses`: whose errors count; all by default.
    """
    found: list[list[Summary]] = []
    for row in sorted(rows, key=lambda row: row["time_s"]):
        if found and row["time_s"] <= NEAR * found[-1][0]["time_s"]:
            found[-1].append(row)
        else:
            found.append([row])
    size = lambda row: worst(judged_by(row), responses or tuple(judged_by(row)))
    return [row for group in found for row in sorted(group, key=size)]


def choose(
    rows: Sequence[Summary],
    tolerance: float,
    responses: Sequence[str],
    held_out: HeldOut,
    extras: Sequence[str] = (),
) -> Choice:
    """The cheapest rung that is within the tolerance where it is chosen, and elsewhere.

    **Arguments:**

    - `rows`: lines of the rungs.
    - `tolerance`: of the errors; three quarters of it are allowed where a rung is chosen [-].
    - `responses`: that count.
    - `held_out`: largest errors of a rung at other points; asked for as few rungs as will do.
    - `extras`: further responses that must hold at those points, and by which none is chosen.

    **Returns:**

    The rung, and what was passed over.
    """
    able = [row for row in rows if not row.get("beyond")]
    good = [row for row in able if is_good(row, MARGIN * tolerance, responses)]
    failed: list[str] = []
    found = None
    for row in by_time(good, responses):
        errors = held_out(row)
        # What is measured there besides, such as load factors, counts if all responses do.
        if worst(errors, (*responses, *extras)) <= tolerance:
            found = row
            break
        failed.append(row["name"])
    return Choice(found, tuple(failed), min(able, key=lambda row: worst(judged_by(row), responses)))


def for_each(
    rows: Sequence[Summary], tolerance: float, responses: Sequence[str], held_out: HeldOut
) -> dict[str, str | None]:
    """Name of the cheapest rung for each response by itself; arguments as for `choose`."""
    chosen = {name: choose(rows, tolerance, (name,), held_out).row for name in responses}
    return {name: None if row is None else row["name"] for name, row in chosen.items()}


def cheapest_of_families(
    rows: Sequence[Summary], allowed: float, responses: Sequence[str]
) -> list[Summary]:
    """Of each family the cheapest rung that is good and faster than the scene itself.

    **Arguments:**

    - `rows`: that of the scene first.
    - `allowed`: error of each rung [-].
    - `responses`: that count.
    """
    own, found = rows[0], []
    for family in dict.fromkeys(row["family"] for row in rows[1:] if not row.get("beyond")):
        best = cheapest([row for row in rows if row["family"] == family], allowed, responses)
        if best is not None and best is not own and NEAR * best["time_s"] < own["time_s"]:
            found.append(best)
    return found


def words_of(
    choice: Choice, own: Summary, tolerance: float, responses: Sequence[str], *, judged: str
) -> str:
    """A sentence or two that say what suffices.

    **Arguments:**

    - `choice`: what was found.
    - `own`: line of the scene itself.
    - `tolerance`: of the errors [-].
    - `responses`: that count.
    - `judged`: what the errors are, such as "errors".

    **Returns:**

    The sentences.
    """
    percent = lambda x: "no number" if not np.isfinite(x) else f"{100.0 * x:.2g} %"
    said = lambda row: ", ".join(
        f"{percent(worst(judged_by(row), (name,)))} in the {QUANTITIES[name]}" for name in responses
    )
    passed = ""
    if choice.failed:
        names = ", ".join(f'"{name}"' for name in choice.failed)
        passed = f" Cheaper, but off at points not used to choose: {names}."
    found, best = choice.row, choice.best
    if found is None:
        return (
            f"No rung is within {100 * tolerance:g} % with a margin, and at points not used to "
            f'choose it: the scene needs more. The best there is, "{best["name"]}", has {judged} '
            f"of {said(best)}, in {best['time_s']:.2g} s.{passed}"
        )
    beside = ""
    if found["name"] != own["name"]:
        beside = f", where the scene itself takes {own['time_s']:.2g} s"
        if not is_good(own, tolerance, responses):
            beside += " and is not within the tolerance"
    apart = found.get("held_out")
    tried = (
        f" (at points not used to choose it at most {percent(worst(apart, responses))})"
        if apart
        else ""
    )
    return (
        f'"{found["name"]}" suffices for {100 * tolerance:g} %: {judged} of {said(found)}{tried}, '
        f"in {found['time_s']:.2g} s{beside}.{passed}"
    )


def columns_of(rows: Sequence[Summary]) -> dict[str, np.ndarray]:
    """The rungs as a table, a column for each number; what is not known is None."""
    flat = [
        {key: value for key, value in row.items() if not isinstance(value, Mapping)}
        | {
            f"{kind}_{name}": value
            for kind in ("error", "error_95", "held_out")
            for name, value in row.get(kind, {}).items()
        }
        for row in rows
    ]
    names = dict.fromkeys(key for row in flat for key in row)
    return {key: np.asarray([row.get(key) for row in flat], dtype=object) for key in names}
