"""A scene in steady motion at many speeds."""

from jaxgear._checks import InputError
from jaxgear.scene._scene import Scene
from jaxgear.study._dynamics import (
    Dynamics,
    damping_summary,
    directions_of,
    require_damped,
    solve_dynamics,
    speeds_of,
)
from jaxgear.study._head import head, study
from jaxgear.study._progress import built_scene, narration, progress
from jaxgear.study._result import Result, titled
from jaxgear.study._sweep_dataset import orbit_dataset, sweep_dataset
from jaxgear.study._sweep_notes import sweep_notes
from jaxgear.study._sweep_summary import sweep_summary
from jaxgear.study._sweeping import sweep_of


@study
def sweep(scene: Scene) -> Result:
    """Steady responses over the speeds of [sweep], in its directions, and round their folds.

    **Arguments:**

    - `scene`: with a table [sweep].

    **Returns:**

    Datasets `sweep` and `orbit`, the response at the highest peak; of condensed bodies also
    `waves`, `flanks` and, of each gear, `shape_GEAR`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved, or a response is not a finite number.
    """
    scene = built_scene(scene, moving=True)
    with narration("mesh cycle"):
        dynamics = solve_dynamics(scene)
    result = sweep_result(scene, dynamics)
    before = head(scene, dynamics.statics)
    summary = before | result.summary | {"notes": before["notes"] + result.summary["notes"]}
    return Result(scene, summary, result.datasets, result.files)


def sweep_result(scene: Scene, dynamics: Dynamics) -> Result:
    """Sweep a pair in motion, as `sweep` does, with what was solved before.

    The parts `damping`, `sweep` and `notes` of the summary.
    """
    require_damped(scene, dynamics)
    watch = _wave_watch(scene, dynamics)
    count = len(speeds_of(scene.sweep)) * len(directions_of(scene.sweep))
    with progress(count, "sweep") as done:
        found = sweep_of(scene, dynamics.pair, done, watch)
    dataset, orbit = sweep_dataset(dynamics, found), orbit_dataset(dynamics, found)
    at_peak = f", {orbit.attrs['speed_rad_s']:.5g} rad/s"
    datasets = {"sweep": titled(dataset, scene), "orbit": titled(orbit, scene, at_peak)}
    summary = {
        "damping": damping_summary(scene, dynamics),
        "sweep": sweep_summary(scene, dynamics, found, dataset),
        "notes": sweep_notes(scene, found.unsettled, count, list(found.pieces_lost())),
    }
    if watch is None:
        return Result(scene, summary, datasets)
    from jaxgear.study._waves_result import waves_result

    with narration("waves"):
        waves = waves_result(scene, watch, found)
    summary["sweep"] |= waves.summary
    return Result(scene, summary, datasets | dict(waves.datasets), waves.files)


def _wave_watch(scene: Scene, dynamics: Dynamics):
    """What looks at the waves of condensed bodies in a sweep; None where there are none."""
    if not dynamics.pair.bodies:
        if scene.rows("probes"):
            raise InputError("probes: they look at condensed bodies, of which this scene has none.")
        return None
    from jaxgear.study._body_waves import wave_watch

    with narration("probes"):
        return wave_watch(scene, dynamics.pair)
