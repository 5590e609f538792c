"""Which fidelity level suffices: chosen with a margin, and tried where it was not chosen.

A level is a line of a summary here: its `name`, its `time_s`, and `error`, by response, at the
points by which it is chosen. Those in motion are judged by `error_95` instead: a median would
leave out the resonances. A level `beyond` the scene is another physical model, never recommended.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from jaxgear.study._fidelity._level import AXES, RESPONSES, Level
from jaxgear.study._result import Summary

# Share of the tolerance that a level may use up at the points by which it is chosen. Of
# quasi-static cycles, errors of the size of the tolerance were up to 1.3 times as large at torques
# and flanks held out: of the accessory pair on 16 phases 1.5 % and 1.9 % in the mean mesh
# stiffness [-].
MARGIN = 0.75
# Of the speeds that count, so many must be converged, for a level to be recommended [-].
MOST = 0.9
# Times of which the longer is so many times the shorter, or less, count as equal: so much may other
# work on the machine change the shortest of several runs [-].
NEAR = 1.25

# Errors at held-out points, by response.
HeldOut = Callable[[Summary], Mapping[str, float | None]]


class Choice(NamedTuple):
    """What was chosen of a hierarchy.

    **Fields:**

    - `line`: of the recommended level, or `None`.
    - `failed`: names of cheaper ones that were good, until they were tried elsewhere.
    - `best`: line of the level with the smallest of its largest errors.
    """

    line: Summary | None
    failed: tuple[str, ...]
    best: Summary

    @property
    def name(self) -> str | None:
        """Of the recommended level."""
        return None if self.line is None else self.line["name"]


def worst(errors: Mapping[str, float | None], responses: Sequence[str]) -> float:
    """The largest of some errors; infinite if one of them is none [-]."""
    values = [errors.get(name) for name in responses]
    return max(np.inf if x is None or not np.isfinite(x) else float(x) for x in values)


def judged_by(line: Mapping[str, Any]) -> Mapping[str, float | None]:
    """The errors by which a level is chosen."""
    return line.get("error_95", line["error"])


def is_good(line: Summary, tolerance: float, responses: Sequence[str]) -> bool:
    """Whether the errors of responses are small enough, at enough speeds."""
    enough = min(line.get("same_branch_share", 1.0), line.get("settled_share", 1.0)) >= MOST
    return enough and worst(judged_by(line), responses) <= tolerance


def by_time(lines: Sequence[Summary], responses: Sequence[str]) -> list[Summary]:
    """From the fastest to the slowest; of those as fast as each other the most exact is first."""
    groups: list[list[Summary]] = []
    for line in sorted(lines, key=lambda line: line["time_s"]):
        if groups and line["time_s"] <= NEAR * groups[-1][0]["time_s"]:
            groups[-1].append(line)
        else:
            groups.append([line])
    size = lambda line: worst(judged_by(line), responses)
    return [line for group in groups for line in sorted(group, key=size)]


def choose(
    lines: Sequence[Summary],
    tolerance: float,
    responses: Sequence[str],
    held_out: HeldOut,
    extras: Sequence[str] = (),
) -> Choice:
    """The cheapest level that is within the tolerance where it is chosen, and elsewhere.

    Three quarters of it are allowed where a level is chosen, by some responses; all of it at other
    points, for `extras` too. Of as few levels as will do it is asked how far off they are there.
    """
    able = [line for line in lines if not line.get("beyond")]
    good = [line for line in able if is_good(line, MARGIN * tolerance, responses)]
    best = min(able, key=lambda line: worst(judged_by(line), responses))
    failed: list[str] = []
    for line in by_time(good, responses):
        # What is measured there besides, such as load factors, counts if all responses do.
        if worst(held_out(line), (*responses, *extras)) <= tolerance:
            return Choice(line, tuple(failed), best)
        failed.append(line["name"])
    return Choice(None, tuple(failed), best)


def combined(
    levels: Sequence[Level],
    lines: Mapping[str, Summary],
    own: Level,
    allowed: float,
    responses: Sequence[str],
) -> Level | None:
    """All together that alone is good enough and faster than the scene itself, `own`.

    The cheapest level of each axis, of those with errors up to `allowed`, in one; `None` if fewer
    than two axes have such a one.
    """
    parts: list[Level] = []
    for axis in AXES:
        if axis in ("modes", "mesh coordinates") and any(
            lines[part.name].get("modes") == 0 for part in parts
        ):
            # Rigid bodies have none to leave out.
            continue
        along = {x.name: x for x in levels if x.axis == axis and not x.beyond}
        good = [lines[name] for name in along if is_good(lines[name], allowed, responses)]
        best = next(iter(by_time(good, responses)), None)
        if best is not None and NEAR * best["time_s"] < lines[own.name]["time_s"]:
            parts.append(along[best["name"]])
    if len(parts) < 2:
        return None
    changes = {key: value for part in parts for key, value in part.changes.items()}
    name = ", ".join(part.name for part in parts)
    return parts[-1]._replace(
        name=name, family="together", axis="", changes=MappingProxyType(changes)
    )


def words_of(
    choice: Choice, own: Summary, tolerance: float, responses: Sequence[str], judged: str
) -> str:
    """A sentence or two that say what suffices.

    The line of the scene itself is `own`; what the errors are `judged`, such as "largest errors".
    """
    percent = lambda x: "no number" if not np.isfinite(x) else f"{100.0 * x:.2g} %"
    said = lambda line: ", ".join(
        f"{percent(worst(judged_by(line), (name,)))} in the {RESPONSES[name].words}"
        for name in responses
    )
    passed = ""
    if choice.failed:
        names = ", ".join(f'"{name}"' for name in choice.failed)
        passed = f" Cheaper, but off at points not used to choose: {names}."
    found, best = choice.line, choice.best
    if found is None:
        return (
            f"No level is within {100 * tolerance:g} % with a margin, and at points not used to "
            f'choose it: the scene needs more. The best there is, "{best["name"]}", has {judged} '
            f"of {said(best)}, in {best['time_s']:.2g} s.{passed}"
        )
    beside, tried = "", ""
    if found["name"] != own["name"]:
        beside = f", where the scene itself takes {own['time_s']:.2g} s"
        if not is_good(own, tolerance, responses):
            beside += " and is not within the tolerance"
    if apart := found.get("held_out"):
        tried = f" (at points not used to choose it at most {percent(worst(apart, responses))})"
    return (
        f'"{found["name"]}" suffices for {100 * tolerance:g} %: {judged} of {said(found)}{tried}, '
        f"in {found['time_s']:.2g} s{beside}.{passed}"
    )
