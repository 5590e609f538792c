"""What [optimise.pareto] asks for: one number of a design against another."""

import numpy as np
import xarray as xr

import optimise
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import ExactContact
from jaxgear._solve._cycle import PreparedMesh
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._schema import unit_of
from jaxgear.study._design import DesignSpace
from jaxgear.study._evaluations import responses_at, sloped_responses
from jaxgear.study._objectives import in_unit, limits_of, task_of, traded
from jaxgear.study._progress import progress
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._results import Entry, dataset_of
from jaxgear.study._running import timed


def front_result(space: DesignSpace, grid: MeshGrid, prepared: PreparedMesh | None) -> Result:
    """The front that a scene asks for: group `pareto`, and its part of the summary.

    Designs are found with smooth contact and re-checked exactly.
    """
    scene, smooth, exact = space.scene, smooth_law_of(space.scene.mesh), ExactContact()
    searched, judged = (
        task_of(space, grid, law, prepared, trading=True) for law in (smooth, exact)
    )
    with progress(scene.optimise.pareto.points, "front") as done:
        front = optimise.pareto_front(
            optimise.ValueAndGradient(lambda x: timed(sloped_responses, searched, x, smooth)),
            space.start,
            space.box,
            points=scene.optimise.pareto.points,
            limits=limits_of(scene.optimise),
            exact=lambda x: np.asarray(timed(responses_at, judged, np.asarray(x), exact)),
            most_evaluations=scene.optimise.max_evaluations,
            done=done,
        )
    dataset = _dataset(space, front)
    names = list(map(str, dataset.data_vars))
    summary: Summary = dict(zip(("minimise", "against"), names, strict=False))
    summary["evaluations"] = front.evaluations
    summary["designs"] = [
        {name: dataset[name].values[i] for name in names} for i in range(len(front.point))
    ]
    return Result(scene, {"pareto": summary, "notes": _notes(front)}, {"pareto": dataset})


def _dataset(space: DesignSpace, front: optimise.ParetoFront) -> xr.Dataset:
    """Both numbers of each design, what became of its search, and the variables."""
    along, found = ("design",), dict[str, Entry]()
    both = traded(space.scene.optimise)
    for (name, each), values in zip(both.items(), front.value.T, strict=True):
        # The offset is made small as its square, and told as such.
        label = "pressure_offset_squared" if name == "pressure_offset" else name
        found |= in_unit(label, along, values, each.unit, each.words)
    about = {
        "allowed": "largest second number that was allowed, in its unit",
        "kept": "whether the design is within what it was allowed",
        "settled": "whether its search stopped by itself",
        "dominated": "whether another design is as good in both numbers, and better in one",
    }
    found |= {name: Entry(along, getattr(front, name), "1", words) for name, words in about.items()}
    for key, values in zip(space.keys, front.point.T, strict=True):
        found[key] = Entry(along, values, unit_of(key), "variable of the search")
    found["reason"] = Entry(along, list(front.reason), "1", "why its search stopped")
    return titled(dataset_of(found), space.scene.title)


def _notes(front: optimise.ParetoFront) -> list[str]:
    """What a user must hear of designs that were not found."""
    found, count = [], len(front.point)
    lost = np.flatnonzero(~front.kept)
    if lost.size:
        told = "; ".join(f"number {i + 1}: {front.reason[i]}" for i in lost)
        found.append(
            f"optimise.pareto: {lost.size} of {count} designs are not within what they "
            f"were allowed, and do not count: {told}"
        )
    if early := np.count_nonzero(front.kept & ~front.settled):
        found.append(
            f"optimise.pareto: the searches of {early} of {count} designs did not "
            "converge; there may be better ones. Raise optimise.max_evaluations."
        )
    if unknown := np.count_nonzero(front.kept & np.isnan(front.value).any(axis=1)):
        found.append(
            f"optimise.pareto: the contact of {unknown} of {count} designs was not "
            "solved exactly; they do not count."
        )
    if len(front.front) == 1:
        found.append(
            "optimise.pareto: one design is best in both numbers; there is nothing to trade."
        )
    return found
