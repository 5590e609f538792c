"""What a reader must know first: limits, convergence, how good the model is, remarks."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

Level = Literal["bad", "look", "good", "plain"]
# Worst first, and the word that says so without a colour.
WORDS: Mapping[Level, str] = {
    "bad": "Wrong",
    "look": "Look at",
    "good": "In order",
    "plain": "Note",
}

# A condensed body is one when its natural frequencies are those of its elements.
_SAME_BODY = 0.01


class Verdict(NamedTuple):
    """One sentence on the results.

    **Fields:**

    - `level`: how bad it is.
    - `text`: the sentence.
    """

    level: Level
    text: str


def verdicts(summary: Mapping[str, Any]) -> list[Verdict]:
    """All that is to be said of a command's numbers, the worst first.

    **Arguments:**

    - `summary`: as `summary.json` has it.
    """
    found = [
        *_limits(summary),
        *_convergence(summary),
        *_safety(summary),
        *_motion(summary.get("sweep", {})),
        *_designs(summary.get("study", {})),
        *_derivatives(summary.get("check_grad", {})),
        *_bodies(summary.get("bodies", ())),
        *_comparison(summary.get("compare", {})),
        *_gain(summary.get("optimise", {})),
        *(Verdict("look", note) for note in summary.get("notes", ())),
    ]
    order = list(WORDS)
    return sorted(found, key=lambda each: order.index(each.level))


def _tables(value: Any, path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Every table of a summary with its path."""
    if isinstance(value, Mapping):
        yield path, value
        for key, each in value.items():
            yield from _tables(each, f"{path}.{key}" if path else key)


def _limits(summary: Mapping[str, Any]) -> Iterator[Verdict]:
    for path, found in _tables(summary):
        rows = found.get("limits", ())
        for row in rows if isinstance(rows, list) else ():
            level: Level = "good" if row["kept"] else "bad"
            text = f"{path}: {row['name']} is {row['found']:.5g}, at most {row['most']:.5g} asked."
            yield Verdict(level, text)


def _convergence(summary: Mapping[str, Any]) -> Iterator[Verdict]:
    for path, found in _tables(summary):
        if "converged" not in found:
            continue
        if found["converged"]:
            yield Verdict("good", f"The search {path} has converged.")
        else:
            why = found.get("reason", "no reason is given")
            yield Verdict("bad", f"The search {path} has not converged: {why}.")
        if bounds := found.get("at_bounds"):
            yield Verdict("look", f"{path} ends at bounds of {', '.join(map(str, bounds))}.")


def _safety(summary: Mapping[str, Any]) -> Iterator[Verdict]:
    for path, found in _tables(summary):
        for key, value in found.items():
            if "safety" in key and isinstance(value, int | float):
                level: Level = "good" if value >= 1.0 else "bad"
                yield Verdict(level, f"{path}: {key} is {value:.4g}.")


def _motion(sweep: Mapping[str, Any]) -> Iterator[Verdict]:
    if "unsettled_count" in sweep:
        count = sweep["unsettled_count"]
        if count:
            yield Verdict("bad", f"{count} points of the sweep have not converged.")
        else:
            yield Verdict("good", "All points of the sweep have converged.")
    for key, what in (("jumps", "jumps"), ("bistable", "ranges with two steady responses")):
        if sweep.get(key):
            yield Verdict("look", f"The sweep has {len(sweep[key])} {what}.")


def _designs(study: Mapping[str, Any]) -> Iterator[Verdict]:
    if not study:
        return
    if study["failed"]:
        yield Verdict("look", f"Designs that failed: {study['failed']}. The table has the reasons.")
    missing = study["designs"] - study["computed"]
    if missing:
        yield Verdict("look", f"{missing} of {study['designs']} designs are not computed yet.")
    elif not study["failed"]:
        yield Verdict("good", f"All {study['designs']} designs are computed.")


def _derivatives(found: Mapping[str, Any]) -> Iterator[Verdict]:
    if not found:
        return
    verdicts = found["verdicts"]
    if verdicts["WRONG"]:
        words = "derivatives disagree with central differences."
        yield Verdict("bad", f"{verdicts['WRONG']} {words}")
    else:
        yield Verdict("good", f"{verdicts['ok']} derivatives agree with central differences.")


def _bodies(bodies: Any) -> Iterator[Verdict]:
    for body in bodies:
        error = body.get("largest_free_frequency_error")
        if error is not None:
            level: Level = "good" if error <= _SAME_BODY else "bad"
            words = "the natural frequencies of the free body are those of its elements within"
            yield Verdict(level, f"{body['name']}: {words} {100 * error:.2g} %.")


def _comparison(found: Mapping[str, Any]) -> Iterator[Verdict]:
    if words := found.get("words"):
        yield Verdict("plain", words)


def _gain(found: Mapping[str, Any]) -> Iterator[Verdict]:
    """What a search has made of each response, of those that it has changed."""
    before, after = found.get("before", {}), found.get("after", {})
    moved = [
        f"{name} from {value:.4g} to {after[name]:.4g}"
        for name, value in before.items()
        if name in after and name != "objective" and f"{value:.4g}" != f"{after[name]:.4g}"
    ]
    if moved:
        yield Verdict("plain", f"The search takes {', '.join(moved)}.")
