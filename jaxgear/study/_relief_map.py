"""The study `relief_map`: the Master Curve on a map of depth and extent of tip relief.

Depths are in um, the unit of their keys, from the file to the summary: only the model has metres.
"""

from typing import Any

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array

import optimise
from jaxgear._checks import InputError
from jaxgear._interface._laws import ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._types import as_reals
from jaxgear._units import um
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._design import DesignSpace, design_space, round_up
from jaxgear.study._evaluations import (
    Task,
    objectives_at,
    side_by_side,
    sloped_deviations,
    sloped_objective,
)
from jaxgear.study._head import head, study
from jaxgear.study._progress import built_scene, progress
from jaxgear.study._records import records
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._running import timed
from jaxgear.study._search import by_gradient, descent, unless_beaten
from jaxgear.study._statics import (
    SolverFailure,
    Statics,
    geometry_summary,
    smoothing_bias,
    solve_statics,
    torques_of,
)

_RELIEF_KEYS = ("flank.pinion.tip_relief.depth_um", "flank.pinion.tip_relief.extent")


@study
def relief_map(scene: Scene) -> Result:
    """Master Curve map of symmetric tip relief, with closed form and the optimiser's path.

    **Arguments:**

    - `scene`: checked against the schema. Its tip reliefs count as linear: so is the closed form.

    **Returns:**

    Groups `relief_...` and `smoothing_bias`, and the summary.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    linear = {f"flank.{gear}.tip_relief.shape": "linear" for gear in GEARS}
    scene = built_scene(scene.replace(linear))
    statics = solve_statics(scene)
    deflection = float(statics.numbers["single_pair_deflection_um"])
    space = design_space(
        scene, statics.model, _RELIEF_KEYS, symmetric=True, deflection=deflection, tied=False
    )
    depth, extent = _axes(scene, deflection)
    task, closed = _task(space, statics), _ClosedForm(statics)
    chart, valley = _mapped(task, depth, extent)
    found, restarted = _descended(task, space, valley)
    deepest = float(depth[-1])
    curve = _traced(task, extent[::-1], float(valley.depth[-1]), deepest)
    datasets = {
        "relief_map": _chart_dataset(chart),
        "relief_valley": records("place", _valley_columns(valley, closed)),
        "relief_search": records("evaluation", _path_columns(found.path)),
        "relief_curve": records("place", _curve_columns(curve, closed, deepest)),
    }
    if scene.get("map.torques_Nm") is not None:
        datasets["relief_torques"] = _family(space, extent[::-1], float(valley.depth[-1]), deepest)
    # Relief of one and a half deflections parts the teeth at the ends of the path.
    relieved = np.asarray([1.5 * deflection, 0.3])
    datasets["smoothing_bias"] = _bias(space, statics, relieved)
    # As many points as in a column of the map, which is compiled.
    best = _te_rms(task, np.tile(found.point, (depth.size, 1)))[0]
    summary = head(scene, statics)
    summary["master_curve"] = {
        "depth_um": found.point[0],
        "extent": found.point[1],
        "te_rms_um": float(best),
        "closed_form_depth_um": closed.depth(found.point[1]),
        "single_pair_deflection_um": deflection,
        "evaluations": found.evaluations,
        "gradient_evaluations": found.gradient_evaluations,
        "converged": found.converged,
        "restarted_from_grid": restarted,
    } | _curves_summary(datasets)
    bias = datasets["smoothing_bias"]
    names = ("width_um", "te_mean_bias_um", "te_rms_bias_relative")
    summary["smoothing_bias"] = {name: bias[name].values for name in names}
    apart = ", tip relief that parts the teeth"
    every = {
        name: titled(each, scene, apart if name == "smoothing_bias" else "")
        for name, each in datasets.items()
    }
    return Result(scene, summary, every)


class _ClosedForm:
    """The closed form of the Master Curve with the statics of one torque, in um."""

    def __init__(self, statics: Statics):
        ratio = geometry_summary(statics)["profile_contact_ratio"]
        # Of a tooth pair, less what the next one feels of it.
        own = float(statics.numbers["unshared_deflection_um"])
        self._numbers = as_reals(ratio), as_reals(own)

    def depth(self, extent: Any) -> np.ndarray:
        """Depth at some extents [um]."""
        return np.asarray(_closed_form_depth(as_reals(extent), *self._numbers))


_closed_form_depth = jax.jit(optimise.master_curve_depth)


def _axes(scene: Scene, deflection: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths [um] and extents of the map."""
    first, last = scene["map.depth_um.from"], scene.get("map.depth_um.to")
    if last is None:
        last = round_up(max(3.0 * deflection, 2.0 * first))
    extents = scene["map.extent.from"], scene["map.extent.to"]
    for name, low, high in (("depth_um", first, last), ("extent", *extents)):
        if not low < high:
            raise InputError(f"map.{name} must rise, got from = {low:g}, to = {high:g}.")
    depth = np.linspace(first, last, scene["map.depth_um.points"])
    return depth, np.linspace(*extents, scene["map.extent.points"])


def _task(space: DesignSpace, statics: Statics) -> Task:
    """The variance of the transmission error at the torque of the statics [um2]."""
    return Task(
        variation=space.variation,
        keys=space.moved,
        objective=optimise.TransmissionErrorVariance(),
        limited=(),
        torques=np.asarray([statics.model.torque]),
        grid=statics.grid,
        prepared=jax.tree.map(lambda x: np.asarray(x)[None], statics.prepared),
        worst=False,
        batched=True,
    )


def _te_rms(task: Task, points: np.ndarray) -> np.ndarray:
    """RMS of the transmission error at many depths and extents, exactly [um]."""
    return np.sqrt(timed(side_by_side, task, points, ExactContact()))


def _mapped(
    task: Task, depth: np.ndarray, extent: np.ndarray
) -> tuple[optimise.ReliefMap, optimise.Valley]:
    """The map and its valley, with exact contact."""
    te_rms = optimise.Batched(lambda points: _te_rms(task, points))
    with progress(depth.size * extent.size, "map") as done:
        chart, valley = optimise.relief_map(te_rms, depth, extent, done=done)
    if not (np.isfinite(chart.value).all() and np.isfinite(valley.value).all()):
        raise SolverFailure("the contact was not solved at some point of the map")
    return chart, valley


def _descended(
    task: Task, space: DesignSpace, valley: optimise.Valley
) -> tuple[optimise.SearchResult, bool]:
    """The best by gradient; says whether it was found from the best place of the map."""
    law = smooth_law_of(space.scene)
    search = by_gradient(
        space,
        optimise.Sloped(lambda x, width: timed(sloped_objective, task, x, width)),
        optimise.Batched(lambda points: timed(objectives_at, task, points, law)),
    )
    found = descent(search, space, space.start)
    lowest = int(np.argmin(valley.value))
    rival = np.asarray([valley.depth[lowest], valley.extent[lowest]])
    return unless_beaten(found, rival, float(valley.value[lowest] ** 2), search, space)


def _traced(task: Task, extent: np.ndarray, start: float, deepest: float) -> optimise.TracedCurve:
    """The best depth followed from the longest of extents to the shortest, exactly."""

    def deviations(point: Array) -> tuple[Array, Array]:
        return timed(sloped_deviations, task, np.asarray(point))

    with progress(extent.size, "Master Curve") as done:
        sloped = optimise.Sloped(deviations)
        return optimise.traced_curve(sloped, extent, start, deepest=deepest, done=done)


_EXTENT = "extent of the tip relief over the path of contact"
_DEPTH = "depth of the tip relief"
_RMS = "RMS of the transmission error"
_CLOSED = "depth of the closed form"


def _chart_dataset(chart: optimise.ReliefMap) -> xr.Dataset:
    both = ("depth", "extent")
    return xr.Dataset(
        {"te_rms_um": (both, chart.value, {"units": "um", "long_name": _RMS})},
        coords={
            "depth_um": ("depth", chart.depth, {"units": "um", "long_name": _DEPTH}),
            "extent": ("extent", chart.extent, {"units": "1", "long_name": _EXTENT}),
        },
    )


def _valley_columns(valley: optimise.Valley, closed: _ClosedForm) -> dict[str, Any]:
    return {
        "extent": (valley.extent, "1", _EXTENT),
        "depth_um": (valley.depth, "um", f"{_DEPTH} that makes the error least"),
        "te_rms_um": (valley.value, "um", _RMS),
        "closed_form_depth_um": (closed.depth(valley.extent), "um", _CLOSED),
    }


def _path_columns(path: np.ndarray) -> dict[str, Any]:
    return {"depth_um": (path[:, 0], "um", _DEPTH), "extent": (path[:, 1], "1", _EXTENT)}


def _curve_columns(
    curve: optimise.TracedCurve, closed: _ClosedForm, deepest: float
) -> dict[str, Any]:
    """The traced curve where it is one: found, and with less error than without relief."""
    kept = curve.settled & (curve.depth > 0.0) & (curve.depth <= deepest)
    extent = curve.extent[kept]
    steep = np.sqrt(0.5 * curve.bend[kept])
    return {
        "extent": (extent, "1", _EXTENT),
        "depth_um": (curve.depth[kept], "um", f"{_DEPTH} that makes the error least"),
        "te_rms_um": (curve.rms[kept], "um", _RMS),
        "te_rms_per_depth": (steep, "um/um", "RMS over error of depth, where there is no other"),
        "closed_form_depth_um": (closed.depth(extent), "um", _CLOSED),
    }


def _family(space: DesignSpace, extent: np.ndarray, start: float, deepest: float) -> xr.Dataset:
    """The curve traced at each of `map.torques_Nm`, one under the other."""
    own, parts = space.scene["pair.torque_pinion_Nm"], []
    for torque in torques_of(space.scene, "map.torques_Nm"):
        statics = solve_statics(space.scene.replace({"pair.torque_pinion_Nm": float(torque)}))
        # Deflections are nearly in proportion to the torque; and deeper is asked for by no one.
        near = min(start * float(torque) / own, deepest)
        curve = _traced(_task(space, statics), extent, near, deepest)
        found = _curve_columns(curve, _ClosedForm(statics), deepest)
        deflection = float(statics.numbers["single_pair_deflection_um"])
        count = len(found["extent"][0])
        told = {
            "torque_Nm": (np.full(count, torque), "N m", "torque on the pinion"),
            **found,
            "single_pair_deflection_um": (
                np.full(count, deflection),
                "um",
                "deflection of a single tooth pair",
            ),
        }
        parts.append(records("place", told))
    return xr.concat(parts, "place")


def _bias(space: DesignSpace, statics: Statics, point: np.ndarray) -> xr.Dataset:
    """Smooth against exact contact on a flank whose ends are out of contact."""
    widths = np.geomspace(0.02, 5.0, 17)
    model = space.model(point)
    mean, rms, exact = (
        np.asarray(x) / um
        for x in timed(smoothing_bias, model, statics.prepared, um * widths, options=QUICKLY)
    )
    relative = rms / max(float(exact), 1e-12)
    return records(
        "width",
        {
            "width_um": (widths, "um", "width of the smooth contact"),
            "te_mean_bias_um": (mean, "um", "bias of the mean transmission error"),
            "te_rms_bias_relative": (relative, "1", f"bias of the {_RMS}, over the exact one"),
            "te_rms_um": (float(exact), "um", f"{_RMS} with exact contact"),
        },
    )


def _curves_summary(datasets: dict[str, xr.Dataset]) -> Summary:
    """Valley, curves and the best of the map, as the summary has them."""
    plain = lambda each: {str(name): column.values for name, column in each.data_vars.items()}
    valley = datasets["relief_valley"]
    best = valley.isel(place=int(np.argmin(valley["te_rms_um"].values)))
    names = ("depth_um", "extent", "te_rms_um")
    found: Summary = {
        "grid_best": {name: float(best[name]) for name in names},
        "valley": plain(valley),
        "traced": plain(datasets["relief_curve"]),
    }
    if "relief_torques" in datasets:
        once = ("torque_Nm", "single_pair_deflection_um")
        found["torques"] = [
            {name: float(own[name][0]) for name in once} | plain(own.drop_vars(once))
            for _, own in datasets["relief_torques"].groupby("torque_Nm", restore_coord_dims=True)
        ]
    return found
