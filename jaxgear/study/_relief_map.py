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
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._results import Entry, dataset_of
from jaxgear.study._running import timed
from jaxgear.study._search import by_gradient, descent, unless_beaten
from jaxgear.study._statics import SolverFailure, Statics, smoothing_bias, solve_statics, torques_of
from jaxgear.study._statics_summary import geometry_summary

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
        "relief_valley": _valley_dataset(valley, closed),
        "relief_search": _path_dataset(found.path),
        "relief_curve": _curve_dataset(curve, closed, deepest),
    }
    if scene.map.torques_Nm is not None:
        datasets["relief_torques"] = _family(space, extent[::-1], float(valley.depth[-1]), deepest)
    # Relief of one and a half deflections parts the teeth at the ends of the path.
    relieved = np.asarray([1.5 * deflection, 0.3])
    datasets["smoothing_bias"] = _bias(space, statics, relieved)
    # As many points as in a column of the map, which is compiled.
    best = _te_rms(task)(np.tile(found.point, (depth.size, 1)))[0]
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
    first, last = scene.map.depth_um.from_, scene.map.depth_um.to
    if last is None:
        last = round_up(max(3.0 * deflection, 2.0 * first))
    extents = scene.map.extent.from_, scene.map.extent.to
    for name, low, high in (("depth_um", first, last), ("extent", *extents)):
        if not low < high:
            raise InputError(f"map.{name} must rise, got from = {low:g}, to = {high:g}.")
    depth = np.linspace(first, last, scene.map.depth_um.points)
    return depth, np.linspace(*extents, scene.map.extent.points)


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


def _te_rms(task: Task) -> optimise.Batched:
    """RMS of the transmission error at many depths and extents, exactly [um]."""
    law = ExactContact()
    return optimise.Batched(lambda points: np.sqrt(timed(side_by_side, task, points, law)))


def _mapped(
    task: Task, depth: np.ndarray, extent: np.ndarray
) -> tuple[optimise.ReliefMap, optimise.Valley]:
    """The map and its valley, with exact contact."""
    with progress(depth.size * extent.size, "map") as done:
        chart, valley = optimise.relief_map(_te_rms(task), depth, extent, done=done)
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


_DEPTH, _CLOSED = "depth of the tip relief", "depth of the closed form"
_BEST = f"{_DEPTH} that makes the error least"
_RMS = "RMS of the transmission error"


def _extent(values: np.ndarray, dimension: str = "extent") -> Entry:
    words = "extent of the tip relief over the path of contact"
    return Entry((dimension,), values, "1", words)


def _chart_dataset(chart: optimise.ReliefMap) -> xr.Dataset:
    return dataset_of(
        {"te_rms_um": Entry(("depth", "extent"), chart.value, "um", _RMS)},
        depth_um=Entry(("depth",), chart.depth, "um", _DEPTH),
        extent=_extent(chart.extent),
    )


def _valley_dataset(valley: optimise.Valley, closed: _ClosedForm) -> xr.Dataset:
    along = ("extent",)
    found = {
        "depth_um": Entry(along, valley.depth, "um", _BEST),
        "te_rms_um": Entry(along, valley.value, "um", _RMS),
        "closed_form_depth_um": Entry(along, closed.depth(valley.extent), "um", _CLOSED),
    }
    return dataset_of(found, extent=_extent(valley.extent))


def _path_dataset(path: np.ndarray) -> xr.Dataset:
    depth, extent = path.T
    along = "evaluation"
    found = {"depth_um": Entry((along,), depth, "um", _DEPTH), "extent": _extent(extent, along)}
    return dataset_of(found)


def _curve_dataset(curve: optimise.TracedCurve, closed: _ClosedForm, deepest: float) -> xr.Dataset:
    """The traced curve where it is one, else NaN: found, and with less error than no relief."""
    kept = curve.settled & (curve.depth > 0.0) & (curve.depth <= deepest)
    along, steep = ("extent",), "RMS over error of depth, where the curve itself has none"
    values = {
        "depth_um": (curve.depth, "um", _BEST),
        "te_rms_um": (curve.rms, "um", _RMS),
        "te_rms_per_depth": (np.sqrt(0.5 * curve.bend), "um/um", steep),
        "closed_form_depth_um": (closed.depth(curve.extent), "um", _CLOSED),
    }
    found = {
        name: Entry(along, np.where(kept, each, np.nan), *about)
        for name, (each, *about) in values.items()
    }
    return dataset_of(found, extent=_extent(curve.extent))


def _family(space: DesignSpace, extent: np.ndarray, start: float, deepest: float) -> xr.Dataset:
    """The curve traced at each of `map.torques_Nm`."""
    own, curves, deflections = space.scene.pair.torque_pinion_Nm, [], []
    torques = torques_of(space.scene, "map")
    for torque in map(float, torques):
        statics = solve_statics(space.scene.replace({"pair.torque_pinion_Nm": torque}))
        # Deflections are nearly in proportion to the torque; and deeper is asked for by no one.
        near = min(start * torque / own, deepest)
        curve = _traced(_task(space, statics), extent, near, deepest)
        curves.append(_curve_dataset(curve, _ClosedForm(statics), deepest))
        deflections.append(float(statics.numbers["single_pair_deflection_um"]))
    of_pair = Entry(("torque",), deflections, "um", "deflection of a single tooth pair")
    return xr.concat(curves, "torque").assign_coords(
        torque_Nm=Entry(("torque",), torques, "N m", "torque on the pinion").variable(),
        single_pair_deflection_um=of_pair.variable(),
    )


def _bias(space: DesignSpace, statics: Statics, point: np.ndarray) -> xr.Dataset:
    """Smooth against exact contact on a flank whose ends are out of contact."""
    widths = np.geomspace(0.02, 5.0, 17)
    model = space.model(point)
    mean, rms, exact = (
        np.asarray(x) / um
        for x in timed(smoothing_bias, model, statics.prepared, um * widths, options=QUICKLY)
    )
    relative = rms / max(float(exact), 1e-12)
    along = ("width",)
    found = {
        "te_mean_bias_um": Entry(along, mean, "um", "bias of the mean transmission error"),
        "te_rms_bias_relative": Entry(along, relative, "1", f"bias of the {_RMS}, over itself"),
        "te_rms_um": Entry((), float(exact), "um", f"{_RMS} with exact contact"),
    }
    about = "width of the smooth contact"
    return dataset_of(found, width_um=Entry(along, widths, "um", about))


def _curves_summary(datasets: dict[str, xr.Dataset]) -> Summary:
    """Valley, curves and the best of the map, as the summary has them."""
    valley = datasets["relief_valley"]
    best = valley.isel(extent=int(np.argmin(valley["te_rms_um"].values)))
    names = ("depth_um", "extent", "te_rms_um")
    found: Summary = {
        "grid_best": {name: float(best[name]) for name in names},
        "valley": _columns_of(valley),
        "traced": _columns_of(datasets["relief_curve"]),
    }
    if (curves := datasets.get("relief_torques")) is not None:
        once = ("torque_Nm", "single_pair_deflection_um")
        each = [curves.isel(torque=place) for place in range(curves.sizes["torque"])]
        found["torques"] = [
            {name: float(own[name]) for name in once} | _columns_of(own) for own in each
        ]
    return found


def _columns_of(curve: xr.Dataset) -> dict[str, np.ndarray]:
    """Extents of a curve, and what is known there."""
    known = np.isfinite(curve["depth_um"].values)
    names = ("extent", *map(str, curve.data_vars))
    return {name: curve[name].values[known] for name in names}
