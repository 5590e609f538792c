"""What teeth that are coupled along their face cost, beside slices on their own.

    python benchmarks/bench_face.py [cycle helical sweep elements] [--quick] [--out DIR]

The accessory pair on its rings: a mesh cycle by either law, 20 slices, three line-load updates; the
same of a helical pair (`power`); the pair with a condensed wheel (`accessory-h1`) at many speeds,
by either; teeth of finite elements, condensed anew and in a cycle. `--quick` takes fewer speeds and
leaves the elements out. Machines differ and are noisy: compare the ratios, which are of processor
time. Writes `face.json`.
"""

import functools
import os
import tempfile
import time
from collections.abc import Callable
from typing import Any

from bench_wheels import Cost, row
from timing import in_parts

LAWS = ("none", "coupled")
# Rows of flank corrections [um], under which cells come out of contact or do not.
FLANKS = {"even": (0.0, 0.0), "crowned": (10.0, 0.0), "sloped": (0.0, 20.0)}
UPDATES = "mesh.line_load_updates=3"


def main() -> None:
    """Run the parts asked for and print their tables."""
    parts = {"cycle": cycles, "helical": helical, "sweep": sweeps, "elements": elements}
    in_parts("What coupled teeth cost.", "fewer speeds, no elements", "face.json", parts)


def _least(*functions: Callable, repeats: int = 60) -> list[Cost]:
    """Least times of functions that are compiled in their first call; in turn, as loads change."""
    import jax

    compiling, runs = [], [[] for _ in functions]
    for function in functions:
        start = time.perf_counter()
        jax.block_until_ready(function())
        compiling.append(time.perf_counter() - start)
    for _ in range(repeats):
        for function, own in zip(functions, runs, strict=True):
            wall, processor = time.perf_counter(), time.process_time()
            jax.block_until_ready(function())
            own.append((time.perf_counter() - wall, time.process_time() - processor))
    least = ((min(each) for each in zip(*own, strict=True)) for own in runs)
    return [Cost(first, *rest) for first, rest in zip(compiling, least, strict=True)]


def _cycle_of(*settings: str, pair: str = "accessory") -> Callable:
    """A mesh cycle of a ready pair."""
    import jaxgear as jg

    scene = jg.with_bodies(jg.example_scene(pair, [UPDATES, *settings]))
    model = jg.model_of(scene)
    grid = jg.grid_of(scene, model)
    return lambda: jg.mesh_cycle(model, grid)


def cycles(*, quick: bool) -> dict[str, Any]:
    """Statics by both laws."""
    del quick
    report = {}
    for name, (crowning, slope) in FLANKS.items():
        flanks = [f"flank.wheel.crowning_um={crowning}", f"flank.wheel.helix_slope_um={slope}"]
        costs = _least(*(_cycle_of(f"mesh.face_coupling={law}", *flanks) for law in LAWS))
        report[name] = _pair(f"mesh cycle, {name}", costs)
    return report


def helical(*, quick: bool) -> dict[str, Any]:
    """Statics of a helical pair by both laws."""
    del quick
    costs = _least(*(_cycle_of(f"mesh.face_coupling={law}", pair="power") for law in LAWS))
    return _pair("mesh cycle, helical", costs)


def sweeps(*, quick: bool) -> dict[str, Any]:
    """A condensed wheel in motion, speed by speed, by both laws."""
    import jax.numpy as jnp
    import numpy as np

    import jaxgear as jg
    from jaxgear import steady_states
    from jaxgear.study._dynamics import dynamics_of

    speeds = np.linspace(100.0, 2000.0, 20 if quick else 100)
    runs = []
    for law in LAWS:
        settings = [
            UPDATES,
            f"mesh.face_coupling={law}",
            "sweep.pinion_speed_rad_s=[100.0, 2000.0]",
        ]
        scene = jg.with_bodies(jg.example_scene("accessory-h1", settings), moving=True)
        model = jg.model_of(scene)
        grid = jg.grid_of(scene, model, scene.sweep.steps)
        system = dynamics_of(model, grid, scene).system
        runs.append(functools.partial(steady_states, system, jnp.asarray(speeds)))
    return _pair(f"{speeds.size} speeds of H1", _least(*runs, repeats=2))


def elements(*, quick: bool) -> dict[str, Any]:
    """Teeth of finite elements: condensed into an empty cache, and a cycle beside the law's."""
    if quick:
        return {}
    import jaxgear as jg

    own = os.environ.get("JAXGEAR_CACHE")
    with tempfile.TemporaryDirectory() as empty:
        os.environ["JAXGEAR_CACHE"] = empty
        start, processor = time.perf_counter(), time.process_time()
        jg.with_bodies(jg.example_scene("accessory", ["mesh.tooth=elements"]))
        offline = Cost(0.0, time.perf_counter() - start, time.process_time() - processor)
        row("teeth of both gears, condensed", offline)
        costs = _least(*map(_cycle_of, ("mesh.face_coupling=coupled", "mesh.tooth=elements")))
    if own is None:
        del os.environ["JAXGEAR_CACHE"]
    else:
        os.environ["JAXGEAR_CACHE"] = own
    found = _pair("mesh cycle", costs, names=("law", "elements"))
    return {"offline": offline._asdict()} | found


def _pair(name: str, costs: list[Cost], names: tuple[str, str] = LAWS) -> dict[str, Any]:
    """Print both rows and their ratio."""
    ratio = costs[1].processor / costs[0].processor
    for each, cost in zip(names, costs, strict=True):
        note = f"ratio {ratio:.2f}" if each == names[1] else ""
        row(f"{name}, {each}", cost, 1e3, "ms", note)
    return {"ratio": ratio} | dict(zip(names, (cost._asdict() for cost in costs), strict=True))


if __name__ == "__main__":
    main()
