"""A scene in steady motion at many speeds: peaks, jumps, ranges with two responses."""

import functools
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from jaxgear._checks import InputError
from jaxgear._dynamics._sweep_types import SweepPoint, Ways
from jaxgear._response._sweep_features import FEW, leaps, prominent
from jaxgear.scene._build import law_of
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._tables import SweepKeys
from jaxgear.study._built import BuiltScene, built_scene
from jaxgear.study._dynamics import (
    Dynamics,
    damping_summary,
    directions_of,
    method_name,
    require_damped,
    size_of,
    solve_dynamics,
    speeds_of,
    unknowns_of,
)
from jaxgear.study._head import head, study
from jaxgear.study._progress import narration, progress
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._sweep_dataset import orbit_dataset, sweep_dataset
from jaxgear.study._sweep_notes import sweep_notes
from jaxgear.study._sweeping import Sweep, Watch, alike, sweep_of


@study
def sweep(scene: Scene, seen: Watch | None = None) -> Result:
    """Steady responses over the speeds of [sweep], in its directions, and round their folds.

    **Arguments:**

    - `scene`: with a table [sweep].
    - `seen`: shown each response whole, with its directions and dynamic ratio.

    **Returns:**

    Datasets `sweep` and `orbit`, the response at the highest peak; of shafts with unbalance
    `unbalance`; of condensed bodies also `waves`, `flanks` and, of each gear, `shape_GEAR`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved, or a response is not a finite number.
    """
    built = built_scene(scene, moving=True)
    with narration("mesh cycle"):
        dynamics = solve_dynamics(built)
    result = sweep_result(built, dynamics, seen)
    before = head(built, dynamics.statics)
    summary = before | result.summary | {"notes": before["notes"] + result.summary["notes"]}
    return Result(built.scene, summary, result.datasets, result.files)


def sweep_result(built: BuiltScene, dynamics: Dynamics, seen: Watch | None = None) -> Result:
    """Sweep a pair in motion, as `sweep` does, with what was solved before.

    The parts `damping`, `sweep` and `notes` of the summary.
    """
    scene, watch, stresses = built.scene, None, None
    require_damped(scene.damping, dynamics)
    if dynamics.pair.bodies:
        from jaxgear.study._body_waves import wave_watch

        with narration("probes"):
            watch = wave_watch(built, dynamics.pair)
        if scene.gauges or scene.mesh.body_stress:
            from jaxgear.study import _swept_stress

            with narration("gauges"):
                stresses = _swept_stress.stress_watch(built, dynamics.pair)
    elif scene.probes or scene.gauges:
        table = "probes" if scene.probes else "gauges"
        raise InputError(f"{table}: they look at condensed bodies, of which this scene has none.")
    count = len(speeds_of(scene.sweep)) * len(directions_of(scene.sweep))
    with progress(count, "sweep") as done:
        watches = [each for each in (watch, stresses, seen) if each is not None]
        shown = functools.partial(_shown, watches) if watches else None
        found = sweep_of(law_of(scene.mesh), scene.sweep, dynamics, done, shown)
    check = None
    if watch is not None and scene.sweep.check_shapes:
        from jaxgear.study._shape_check import shape_check

        with narration("check of shapes"):
            check = shape_check(built, dynamics, watch, found)
    dataset, orbit = sweep_dataset(dynamics, found), orbit_dataset(dynamics, found)
    at_peak = f", {orbit.attrs['speed_rad_s']:.5g} rad/s"
    datasets = {
        "sweep": titled(dataset, scene.title),
        "orbit": titled(orbit, scene.title + at_peak),
    }
    summary = {
        "damping": damping_summary(scene.damping, dynamics),
        "sweep": _sweep_summary(scene.sweep, scene.gears, dynamics, found, dataset),
        "notes": sweep_notes(
            scene, found.unsettled, count, list(found.pieces_lost()), found.passed_over()
        ),
    }
    if any(gear.shaft.unbalance for gear in scene.gears.values()):
        from jaxgear.study._unbalance import shaken

        with narration("unbalance"):
            by_unbalance = shaken(built, dynamics.pair)
        datasets["unbalance"] = titled(by_unbalance.dataset, scene.title)
        summary["sweep"]["unbalance"] = by_unbalance.summary
        summary["notes"] += by_unbalance.notes
    if check is not None:
        summary["sweep"]["shapes"] = check.summary
        summary["notes"] += check.notes
    if watch is None:
        return Result(scene, summary, datasets)
    from jaxgear.study._waves_result import waves_seen

    with narration("waves"):
        waves = waves_seen(scene.title, watch, found)
    summary["sweep"]["waves"] = waves.summary
    files = dict(waves.files)
    if stresses is not None:
        from jaxgear.study import _swept_stress

        with narration("stresses") as tell:
            of_bodies = _swept_stress.swept_stress(built, stresses, found, tell)
        summary["sweep"] |= of_bodies.summary
        named = of_bodies.datasets.items()
        datasets |= {name: titled(each, scene.title) for name, each in named}
        files |= of_bodies.files
    return Result(scene, summary, datasets | waves.datasets, files)


def _shown(watches: Sequence[Watch], ways: Ways, point: SweepPoint, ratio: float) -> None:
    """Show a response to all who look."""
    for watch in watches:
        watch(ways, point, ratio)


# A peak stands out by this much of the static force.
_PROMINENCE = 0.05
_LISTS = (
    *("dynamic_ratio", "te_rms_um", "pair_ratio", "contact_loss"),
    *("settled", "stable", "periods"),
)


def _sweep_summary(
    asked: SweepKeys,
    gears: Mapping[str, GearKeys],
    dynamics: Dynamics,
    sweep: Sweep,
    dataset: xr.Dataset,
) -> Summary:
    """The `sweep` part of the summary; lists are over `pinion_speed_rad_s`."""
    special = lambda name: sorted(
        point.speed for piece in sweep.curves for point in getattr(piece, name)
    )
    size = size_of(dynamics.pair)
    roots = {}
    if dynamics.statics.influences is not None:
        from jaxgear.study._roots import moving_roots_summary

        roots = {"roots": moving_roots_summary(gears, dataset)}
    return {
        "pinion_speed_rad_s": sweep.speeds,
        **{
            f"{name}_{way}": dataset[name].sel(direction=way).values
            for way in sweep.responses
            for name in _LISTS
        },
        **roots,
        "peaks": _peaks(dynamics, dataset),
        "jumps": _jumps(dataset),
        "bistable": _bistable(dataset),
        "folds_rad_s": special("folds"),
        "doublings_rad_s": special("doublings"),
        "tori_rad_s": special("tori"),
        "unsettled_count": sweep.unsettled,
        "method": method_name(asked, size),
        "steps": asked.steps,
        "unknowns": unknowns_of(asked, size),
        # Two threads find them, and either may be first.
        "seconds_with_compiling": dict(sorted(sweep.seconds.items())),
    }


def _settled(dataset: xr.Dataset, way: str) -> xr.Dataset:
    """The settled responses of a direction."""
    own = dataset.sel(direction=way)
    return own.isel(speed=own["settled"].values)


def _peaks(dynamics: Dynamics, dataset: xr.Dataset) -> list[Summary]:
    """Peaks of the dynamic ratio, the highest first, with the mesh order that is strongest there.

    A peak that rising and falling speeds share has the direction "both".
    """
    share = np.asarray(dynamics.modes.mesh)
    # Modes with some energy in the mesh, or that with most.
    excited = share >= min(0.01, float(share.max()))
    natural = np.asarray(dynamics.modes.frequency)[excited]
    found: list[Summary] = []
    for way in dataset["direction"].values:
        own = _settled(dataset, way)
        ratio = own["dynamic_ratio"].values
        for place in prominent(ratio, _PROMINENCE):
            here = own.isel(speed=int(place))
            speed, high = float(here["speed"]), float(ratio[place])
            twin = [row for row in found if row["speed_rad_s"] == speed]
            if twin and alike(twin[0]["dynamic_ratio"], high):
                twin[0]["direction"] = "both"
                continue
            strongest = int(np.argmax(here["mesh_force_order_N"].values))
            order = float(here["order"][strongest])
            frequency = order * int(dataset.attrs["teeth_pinion"]) * speed / (2.0 * np.pi)
            nearest = natural[np.argmin(np.abs(natural - frequency))]
            found.append(
                {
                    "speed_rad_s": speed,
                    "dynamic_ratio": high,
                    "direction": str(way),
                    "frequency_Hz": frequency,
                    "nearest_mode_Hz": float(nearest),
                    "mesh_order": order,
                }
            )
    return sorted(found, key=lambda row: -row["dynamic_ratio"])


def _jumps(dataset: xr.Dataset) -> list[Summary]:
    """Where a direction leaps between settled responses; none where each speed is shown."""
    found = []
    for way in dataset["direction"].values if dataset.sizes["speed"] > FEW else ():
        if way == "cold":
            continue
        own = _settled(dataset, way)
        speed, ratio = own["speed"].values, own["dynamic_ratio"].values
        height = float(np.max(ratio, initial=0.0))
        for place in np.sort(leaps(ratio, np.ones(ratio.size, bool), height)):
            before, after = (place + 1, place) if way == "down" else (place, place + 1)
            found.append(
                {
                    "direction": str(way),
                    "from_rad_s": float(speed[before]),
                    "to_rad_s": float(speed[after]),
                    "dynamic_ratio_before": float(ratio[before]),
                    "dynamic_ratio_after": float(ratio[after]),
                }
            )
    return found


def _bistable(dataset: xr.Dataset) -> list[Summary]:
    """Ranges of speed with two stable responses: one rising, another falling."""
    if set(dataset["direction"].values) != {"up", "down"}:
        return []
    up, down = (dataset["dynamic_ratio"].sel(direction=way).values for way in ("up", "down"))
    apart = dataset["settled"].values.all(axis=0) & ~alike(up, down)
    speed, found = dataset["speed"].values, []
    for two, places in itertools.groupby(range(len(speed)), key=lambda i: bool(apart[i])):
        own = list(places)
        if two:
            found.append({"from_rad_s": float(speed[own[0]]), "to_rad_s": float(speed[own[-1]])})
    return found
