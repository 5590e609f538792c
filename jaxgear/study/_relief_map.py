"""The study `relief_map`: the Master Curve on a map of depth and extent of tip relief.

Depths are in um, the unit of their keys, from the file to the summary: only the model has metres.
"""

from typing import Any

import jax
import numpy as np
import xarray as xr

import optimise
from jaxgear._checks import InputError
from jaxgear._interface._laws import ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._types import as_reals
from jaxgear._units import um
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._study_tables import MapKeys
from jaxgear.study._built import BuiltScene, built_scene
from jaxgear.study._design import DesignSpace, design_space, round_up
from jaxgear.study._evaluations import (
    Task,
    objectives_at,
    sloped_by,
    sloped_objective,
    sloped_residuals,
)
from jaxgear.study._head import head, study
from jaxgear.study._progress import progress
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._results import dataset_of, over, told
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
    built = built_scene(scene.replace(linear))
    scene, statics = built.scene, solve_statics(built)
    deflection = float(statics.numbers["single_pair_deflection_um"])
    space = design_space(built, _RELIEF_KEYS, symmetric=True, deflection=deflection, tied=False)
    depth, extent = _axes(scene.map, deflection)
    task, deepest = _task(space, statics), float(depth[-1])
    with progress(depth.size * extent.size, "map") as done:
        chart, valley = optimise.relief_map(_te_rms(task), depth, extent, done=done)
    if not (np.isfinite(chart.value).all() and np.isfinite(valley.value).all()):
        raise SolverFailure("the contact was not solved at some point of the map")
    found, restarted = _descended(task, space, valley)
    start = float(valley.depth[-1])
    datasets = {
        "relief_map": _chart_dataset(chart),
        "relief_valley": _valley_dataset(valley, statics),
        "relief_search": _path_dataset(found.path),
        "relief_curve": _traced(task, statics, extent[::-1], start, deepest),
    }
    if scene.map.torques_Nm is not None:
        datasets["relief_torques"] = _family(space, extent[::-1], start, deepest)
    # Relief of one and a half deflections parts the teeth at the ends of the path.
    relieved = np.asarray([1.5 * deflection, 0.3])
    bias = datasets["smoothing_bias"] = _bias(space, statics, relieved)
    # As many points as in a column of the map, which is compiled.
    best = _te_rms(task)(np.tile(found.point, (depth.size, 1)))[0]
    summary = head(built, statics)
    summary["master_curve"] = {
        "depth_um": found.point[0],
        "extent": found.point[1],
        "te_rms_um": float(best),
        "closed_form_depth_um": _closed_form(statics, found.point[1]),
        "single_pair_deflection_um": deflection,
        "evaluations": found.evaluations,
        "gradient_evaluations": found.gradient_evaluations,
        "converged": found.converged,
        "restarted_from_grid": restarted,
    } | _curves_summary(datasets)
    names = ("width_um", "te_mean_bias_um", "te_rms_bias_relative")
    summary["smoothing_bias"] = {name: bias[name].values for name in names}
    apart = {"smoothing_bias": ", tip relief that parts the teeth"}
    every = {
        name: titled(each, scene.title + apart.get(name, "")) for name, each in datasets.items()
    }
    return Result(scene, summary, every)


_depth_of = jax.jit(optimise.master_curve_depth)


def _closed_form(statics: Statics, extent: Any) -> np.ndarray:
    """Depths of the closed form of the Master Curve with the statics of one torque [um]."""
    ratio = geometry_summary(statics.model.pair)["profile_contact_ratio"]
    # Of a tooth pair, less what the next one feels of it.
    own = float(statics.numbers["unshared_deflection_um"])
    return np.asarray(_depth_of(as_reals(extent), as_reals(ratio), as_reals(own)))


def _axes(asked: MapKeys, deflection: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths [um] and extents of the map."""
    first, last = asked.depth_um.from_, asked.depth_um.to
    if last is None:
        last = round_up(max(3.0 * deflection, 2.0 * first))
    extents = asked.extent.from_, asked.extent.to
    for name, low, high in (("depth_um", first, last), ("extent", *extents)):
        if not low < high:
            raise InputError(f"map.{name} must rise, got from = {low:g}, to = {high:g}.")
    depth = np.linspace(first, last, asked.depth_um.points)
    return depth, np.linspace(*extents, asked.extent.points)


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
    return optimise.Batched(lambda points: np.sqrt(timed(objectives_at, task, points, law)))


def _descended(
    task: Task, space: DesignSpace, valley: optimise.Valley
) -> tuple[optimise.SearchResult, bool]:
    """The best by gradient; says whether it was found from the best place of the map."""
    law = smooth_law_of(space.scene.mesh)
    search = by_gradient(
        space,
        sloped_by(sloped_objective, task),
        optimise.Batched(lambda points: timed(objectives_at, task, points, law)),
    )
    found = descent(search, space, space.start)
    lowest = int(np.argmin(valley.value))
    rival = np.asarray([valley.depth[lowest], valley.extent[lowest]])
    return unless_beaten(found, rival, float(valley.value[lowest] ** 2), search, space)


_DEPTH, _CLOSED = "depth of the tip relief", "depth of the closed form"
_BEST = f"{_DEPTH} that makes the error least"
_RMS = "RMS of the transmission error"
_EXTENT = "extent of the tip relief over the path of contact"


def _chart_dataset(chart: optimise.ReliefMap) -> xr.Dataset:
    return dataset_of(
        told("depth extent", te_rms_um=(chart.value, _RMS)),
        **told("depth", depth_um=(chart.depth, _DEPTH)),
        **told("extent", extent=(chart.extent, _EXTENT)),
    )


def _valley_dataset(valley: optimise.Valley, statics: Statics) -> xr.Dataset:
    found = told(
        "extent",
        depth_um=(valley.depth, _BEST),
        te_rms_um=(valley.value, _RMS),
        closed_form_depth_um=(_closed_form(statics, valley.extent), _CLOSED),
    )
    return dataset_of(found, **told("extent", extent=(valley.extent, _EXTENT)))


def _path_dataset(path: np.ndarray) -> xr.Dataset:
    depth, extent = path.T
    return dataset_of(
        told("evaluation", depth_um=(depth, _DEPTH)),
        **told("evaluation", extent=(extent, _EXTENT)),
    )


def _traced(
    task: Task, statics: Statics, extent: np.ndarray, start: float, deepest: float
) -> xr.Dataset:
    """The best depth [um] followed from the longest of extents to the shortest, exactly.

    NaN where it is no curve: where it was not found, or with no less error than no relief.
    """
    sloped = optimise.ValueAndGradient(
        lambda x: timed(sloped_residuals, task, np.asarray(x), ExactContact())
    )
    with progress(extent.size, "Master Curve") as done:
        curve = optimise.traced_curve(sloped, extent, start, deepest=deepest, done=done)
    kept = curve.settled & (curve.depth > 0.0) & (curve.depth <= deepest)
    known = lambda values: np.where(kept, values, np.nan)
    steep = "RMS over error of depth, where the curve itself has none"
    found = told(
        "extent",
        depth_um=(known(curve.depth), _BEST),
        te_rms_um=(known(curve.rms), _RMS),
        te_rms_per_depth=(known(np.sqrt(0.5 * curve.bend)), steep),
        closed_form_depth_um=(known(_closed_form(statics, curve.extent)), _CLOSED),
    )
    found["te_rms_per_depth"] = found["te_rms_per_depth"]._replace(units="um/um")
    return dataset_of(found, **told("extent", extent=(curve.extent, _EXTENT)))


def _family(space: DesignSpace, extent: np.ndarray, start: float, deepest: float) -> xr.Dataset:
    """The curve traced at each of `map.torques_Nm`."""
    own, curves, deflections = abs(space.scene.pair.torque_pinion_Nm), [], []
    torques = torques_of(
        "map", space.scene.map.torques_Nm, space.scene.pair, space.scene.pinion.shaft
    )
    for torque in map(float, torques):
        loaded = {"pair.torque_pinion_Nm": space.scene.pair.sense * torque}
        statics = solve_statics(BuiltScene(space.scene.replace(loaded)))
        # Deflections are nearly in proportion to the torque; and deeper is asked for by no one.
        near = min(start * torque / own, deepest)
        curves.append(_traced(_task(space, statics), statics, extent, near, deepest))
        deflections.append(float(statics.numbers["single_pair_deflection_um"]))
    of_torques = told(
        "torque",
        torque_Nm=(torques, "torque on the pinion"),
        single_pair_deflection_um=(deflections, "deflection of a single tooth pair"),
    )
    coordinates = {name: each.variable() for name, each in of_torques.items()}
    return xr.concat(curves, "torque").assign_coords(coordinates)


def _bias(space: DesignSpace, statics: Statics, point: np.ndarray) -> xr.Dataset:
    """Smooth against exact contact on a flank whose ends are out of contact."""
    widths, model = um * np.geomspace(0.02, 5.0, 17), space.model(point)
    mean, rms, exact = (
        np.asarray(x)
        for x in timed(smoothing_bias, model, statics.prepared, widths, options=QUICKLY)
    )
    relative = rms / max(float(exact), 1e-18)
    return dataset_of(
        over(
            "width",
            te_mean_bias_um=(mean, "bias of the mean transmission error"),
            te_rms_bias_relative=(relative, f"bias of the {_RMS}, over itself"),
        )
        | over("", te_rms_um=(exact, f"{_RMS} with exact contact")),
        **over("width", width_um=(widths, "width of the smooth contact")),
    )


def _curves_summary(datasets: dict[str, xr.Dataset]) -> Summary:
    """Valley, curves and the best of the map, as the summary has them."""
    valley = datasets["relief_valley"]
    best = valley.isel(extent=int(np.argmin(valley["te_rms_um"].values)))
    names = ("depth_um", "extent", "te_rms_um")
    found: Summary = {
        "grid_best": {name: float(best[name]) for name in names},
        "valley": _known(valley),
        "traced": _known(datasets["relief_curve"]),
    }
    if (curves := datasets.get("relief_torques")) is not None:
        once = ("torque_Nm", "single_pair_deflection_um")
        each = [curves.isel(torque=place) for place in range(curves.sizes["torque"])]
        found["torques"] = [{name: float(own[name]) for name in once} | _known(own) for own in each]
    return found


def _known(curve: xr.Dataset) -> Summary:
    """Extents of a curve, and what is known there."""
    known = np.isfinite(curve["depth_um"].values)
    names = ("extent", *map(str, curve.data_vars))
    return {name: curve[name].values[known] for name in names}
