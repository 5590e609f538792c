"""The command `map`: the Master Curve on a map of depth and extent of tip relief."""

from functools import partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

import optimise
from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._cli._writing import finish
from jaxgear._interface._laws import ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._system._model import PairModel
from jaxgear._types import as_reals
from jaxgear._units import um
from jaxgear.plot import _curve_tables as curve_tables
from jaxgear.plot import _search_tables as search_tables
from jaxgear.plot._plots import curve_pictures, search_pictures
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._design import (
    DesignSpace,
    design_space,
    round_up,
)
from jaxgear.study._evaluations import (
    Task,
    objectives_at,
    side_by_side,
    sloped_deviations,
    sloped_objective,
)
from jaxgear.study._head import head
from jaxgear.study._optimising import descent, unless_beaten
from jaxgear.study._progress import built_scene, progress
from jaxgear.study._result import Summary, title_of
from jaxgear.study._running import timed
from jaxgear.study._search import (
    by_gradient,
)
from jaxgear.study._statics import (
    SolverFailure,
    Statics,
    geometry_summary,
    smoothing_bias,
    solve_statics,
    torques_of,
)


def map_relief(scene: Scene, folder: Folder) -> Summary:
    """Master Curve map of symmetric tip relief, with closed form and the optimiser's path.

    Arguments, results and errors as for `_commands.run`.
    """
    # The closed form, and so the map, is for linear relief.
    linear = {f"flank.{gear}.tip_relief.shape": "linear" for gear in GEARS}
    scene = built_scene(scene.replace(linear))
    statics = solve_statics(scene)
    summary = head(scene, statics)
    deflection = summary["static"]["single_pair_deflection_um"] * um
    space = design_space(
        scene, _RELIEF_KEYS, symmetric=True, deflection=deflection / um, tied=False
    )
    depth, extent = _map_axes(scene, deflection)
    task = _task(space, statics)
    exact = ExactContact()
    te_rms = optimise.Batched(
        lambda points: np.sqrt(timed(side_by_side, task, points / _UNITS, exact))
    )
    with progress(depth.size * extent.size, "map") as done:
        chart, valley = optimise.relief_map(te_rms, depth, extent, done=done)
    if not (np.isfinite(chart.value).all() and np.isfinite(valley.value).all()):
        raise SolverFailure("the contact was not solved at some point of the map")
    law = smooth_law_of(scene)
    search = by_gradient(
        space,
        optimise.Sloped(lambda x, width: timed(sloped_objective, task, x, width)),
        optimise.Batched(lambda points: timed(objectives_at, task, points, law)),
    )
    found = descent(search, space, space.start)
    lowest = int(np.argmin(valley.value))
    rival = np.asarray([valley.depth[lowest] / um, valley.extent[lowest]])
    best_on_grid = float(valley.value[lowest] ** 2)
    found, restarted = unless_beaten(found, rival, best_on_grid, search, space)
    curve = _traced(task, extent[::-1], float(valley.depth[-1]), float(depth[-1]))
    # As many points as in a column of the map, which is compiled.
    best = te_rms(np.tile(found.point * _UNITS, (depth.size, 1)))[0]
    ratio, own = summary["geometry"]["profile_contact_ratio"], _unshared(statics)
    closed = _closed_form(np.append(extent, found.point[1]), ratio, own)
    summary["master_curve"] = {
        "depth_um": found.point[0],
        "extent": found.point[1],
        "te_rms_um": float(best),
        "closed_form_depth_um": closed[-1],
        "single_pair_deflection_um": deflection / um,
        "evaluations": found.evaluations,
        "gradient_evaluations": found.gradient_evaluations,
        "converged": found.converged,
        "restarted_from_grid": restarted,
        **_valley_summary(valley, closed[:-1]),
        "traced": _traced_summary(curve, ratio, own, float(depth[-1])),
    }
    # Relief of one and a half deflections parts the teeth at the ends of the path.
    relieved = space.model(np.asarray([1.5 * deflection / um, 0.3]))
    summary["smoothing_bias"] = _draw_bias(scene, folder, relieved, statics.prepared)
    figure = partial(
        search_pictures.master_curve, chart, valley, closed[:-1], found.path, title_of(scene)
    )
    beside = search_tables.valley_columns(chart, valley, closed[:-1])
    save(figure, search_tables.master_curve_columns(chart), folder, "master_curve", valley=beside)
    traced = summary["master_curve"]["traced"]
    figure = partial(curve_pictures.traced_curve, traced, title_of(scene))
    save(figure, traced, folder, "master_curve_traced")
    if scene.get("map.torques_Nm") is not None:
        start, deepest = float(valley.depth[-1]), float(depth[-1])
        family = _family(space, extent[::-1], start, deepest)
        summary["master_curve"]["torques"] = family
        figure = partial(curve_pictures.family, chart, family, title_of(scene))
        save(figure, curve_tables.family_columns(family), folder, "master_curve_torques")
    return finish(scene, folder, summary)


# Depths are in metres in the library, and in um in the keys.
_UNITS = np.asarray([um, 1.0])


def _task(space: DesignSpace, statics: Statics) -> Task:
    """The variance of the transmission error at the torque of the statics."""
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


_RELIEF_KEYS = ("flank.pinion.tip_relief.depth_um", "flank.pinion.tip_relief.extent")


def _map_axes(scene: Scene, deflection: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths [m] and extents of the map."""
    first, last = scene["map.depth_um.from"], scene.get("map.depth_um.to")
    if last is None:
        last = round_up(max(3.0 * deflection / um, 2.0 * first))
    extents = scene["map.extent.from"], scene["map.extent.to"]
    for name, low, high in (("depth_um", first, last), ("extent", *extents)):
        if not low < high:
            raise InputError(f"map.{name} must rise, got from = {low:g}, to = {high:g}.")
    depth = um * np.linspace(first, last, scene["map.depth_um.points"])
    return depth, np.linspace(*extents, scene["map.extent.points"])


def _family(
    space: DesignSpace,
    extent: np.ndarray,
    start: float,
    deepest: float,
) -> list[Summary]:
    """The curve traced at each of `map.torques_Nm`, beside the closed form at that torque."""
    own, found = space.scene["pair.torque_pinion_Nm"], []
    for torque in torques_of(space.scene, "map.torques_Nm"):
        scene = space.scene.replace({"pair.torque_pinion_Nm": float(torque)})
        statics = solve_statics(scene)
        # Deflections are nearly in proportion to the torque; and deeper is asked for by no one.
        near = min(start * float(torque) / own, deepest)
        curve = _traced(_task(space, statics), extent, near, deepest)
        deflection = float(statics.numbers["single_pair_deflection_um"])
        ratio = geometry_summary(statics)["profile_contact_ratio"]
        found.append(
            {"torque_Nm": float(torque), "single_pair_deflection_um": deflection}
            | _traced_summary(curve, ratio, _unshared(statics), deepest)
        )
    return found


def _traced(task: Task, extent: np.ndarray, start: float, deepest: float) -> optimise.TracedCurve:
    """The best depth followed from the longest of extents to the shortest, exactly."""

    def deviations(point: Array) -> tuple[Any, Any]:
        found, slopes = timed(sloped_deviations, task, np.asarray(point) / _UNITS)
        return as_reals(um * np.asarray(found)), as_reals(um * np.asarray(slopes) / _UNITS)

    with progress(extent.size, "Master Curve") as done:
        sloped = optimise.Sloped(deviations)
        return optimise.traced_curve(sloped, extent, start, deepest=deepest, done=done)


def _traced_summary(
    curve: optimise.TracedCurve, ratio: float, deflection: float, deepest: float
) -> dict[str, np.ndarray]:
    """The traced curve where it is one: found, and with less error than without relief."""
    kept = curve.settled & (curve.depth > 0.0) & (curve.depth <= deepest)
    return {
        "extent": curve.extent[kept],
        "depth_um": curve.depth[kept] / um,
        "te_rms_um": curve.rms[kept] / um,
        # RMS over error of depth, where the curve itself has none.
        "te_rms_per_depth": np.sqrt(0.5 * curve.bend[kept]),
        "closed_form_depth_um": _closed_form(curve.extent[kept], ratio, deflection),
    }


def _valley_summary(valley: optimise.Valley, closed: np.ndarray) -> Summary:
    """The best depth of each extent, and the best of all."""
    lowest = int(np.argmin(valley.value))
    return {
        "grid_best": {
            "depth_um": valley.depth[lowest] / um,
            "extent": valley.extent[lowest],
            "te_rms_um": valley.value[lowest],
        },
        "valley": {
            "extent": valley.extent,
            "depth_um": valley.depth / um,
            "te_rms_um": valley.value,
            "closed_form_depth_um": closed,
        },
    }


def _draw_bias(
    scene: Scene, folder: Folder, model: PairModel, prepared: PreparedMesh | None
) -> Summary:
    """Smooth against exact contact on a flank whose ends are out of contact."""
    assert prepared is not None
    widths = um * np.geomspace(0.02, 5.0, 17)
    mean, rms, exact = map(
        np.asarray, timed(smoothing_bias, model, prepared, widths, options=QUICKLY)
    )
    relative = rms / max(float(exact), 1e-12 * um)
    data = widths / um, mean / um, relative
    title = f"{title_of(scene)}, tip relief that parts the teeth"
    figure = partial(search_pictures.smoothing_bias, *data, float(exact) / um, title)
    save(figure, search_tables.smoothing_bias_columns(*data), folder, "smoothing_bias")
    return {"width_um": widths / um, "te_mean_bias_um": mean / um, "te_rms_bias_relative": relative}


def _unshared(statics: Statics) -> float:
    """Deflection of a tooth pair less what the next one feels of it [m]."""
    return um * float(statics.numbers["unshared_deflection_um"])


def _closed_form(extent: np.ndarray, ratio: float, deflection: float) -> np.ndarray:
    """Depth of the closed-form Master Curve [um]."""
    numbers = map(as_reals, (extent, ratio, deflection))
    return np.asarray(_closed_form_depth(*numbers)) / um


_closed_form_depth = jax.jit(optimise.master_curve_depth)
