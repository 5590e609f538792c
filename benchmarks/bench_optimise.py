"""What searches by gradient cost, and how many evaluations others need for the same.

    python benchmarks/bench_optimise.py [two ten crowning baselines] [--quick] [--out DIR]

`two`: depth and extent of both gears' tip relief of the rigid accessory pair; `ten`: ten parameters
of its flanks over five torques; `crowning`: crowning of the power pair's gears for the least
pressure at 3000 rad/s, with a condensed wheel that grows (`power-h1`; built in a minute if it is
not in the cache); `baselines`: evaluations until differential evolution and CMA-ES are as good,
with two and ten parameters. Compiling is told apart. Machines differ and are noisy: compare ratios
within one table, and processor time where others use the machine. `--quick` takes coarse meshes.
Adds to `optimise.json`.
"""

import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from timing import in_parts

TWO = ("flank.pinion.tip_relief.depth_um", "flank.pinion.tip_relief.extent")
TEN = tuple(
    f"flank.{gear}.{key}"
    for gear in ("pinion", "wheel")
    for key in (
        "tip_relief.depth_um",
        "tip_relief.extent",
        "root_relief.depth_um",
        "crowning_um",
        "profile_crowning_um",
    )
)
TORQUES = [40.0, 55.0, 70.0, 85.0, 100.0]
QUICK = ("mesh.phases=24", "mesh.slices=4")


def main() -> None:
    """Run the parts asked for and print their tables."""
    parts = {"two": two, "ten": ten, "crowning": crowning, "baselines": baselines}
    in_parts("What searches by gradient cost.", "coarse meshes", "optimise.json", parts)


class Task(NamedTuple):
    """A scene's search, its variables, and the seconds that compiling took."""

    search: Any
    space: Any
    compiling: float


def task(name: str, settings: Sequence[str]) -> Task:
    """The search of an example scene with some settings, compiled."""
    from jaxgear import example_scene, with_bodies
    from jaxgear.study._built import BuiltScene
    from jaxgear.study._design import design_space
    from jaxgear.study._objectives import prepared_mesh
    from jaxgear.study._search import require_acting, search_of
    from jaxgear.study._statics import solve_statics

    # The thesis's foundation, on which searches have been measured from the first.
    scene = example_scene(name, ("mesh.foundation=weber", *settings))
    if scene.condensed:
        scene = with_bodies(scene)
    built = BuiltScene(scene)
    statics = solve_statics(built)
    space = design_space(
        built,
        tuple(scene.value("optimise.vary")),
        symmetric=scene.value("optimise.symmetric"),
        deflection=float(statics.numbers["single_pair_deflection_um"]),
    )
    prepared = prepared_mesh(space, statics.grid)
    search = search_of(space, statics.grid, prepared)
    start = time.perf_counter()
    require_acting(search, space)
    return Task(search, space, time.perf_counter() - start)


def told(name: str, made: Task) -> dict[str, Any]:
    """One search, timed, printed and as a row of the report."""
    wall, processor = time.perf_counter(), time.process_time()
    found = made.search.descend(made.space.start, lambda point, value: None)
    seconds, busy = time.perf_counter() - wall, time.process_time() - processor
    before, after = float(found.values[0]), float(found.value)
    print(
        f"{name:<44} {seconds:7.2f} s ({busy:.2f} s of processors)   "
        f"compile {made.compiling:5.1f} s   {found.evaluations} evaluations, "
        f"{before:.4g} -> {after:.4g}   {found.reason}",
        flush=True,
    )
    return {
        "seconds": seconds,
        "processor_s": busy,
        "compile_s": made.compiling,
        "evaluations": found.evaluations,
        "before": before,
        "after": after,
        "point": dict(zip(made.space.keys, found.point.tolist(), strict=True)),
    }


def _two(settings: Sequence[str]) -> Task:
    return task("accessory", (f"optimise.vary={list(TWO)}", *settings))


def _ten(settings: Sequence[str]) -> Task:
    roots = [
        f"flank.{gear}.root_relief={{ depth_um = 0.0, extent = 0.2 }}"
        for gear in ("pinion", "wheel")
    ]
    profile = [f"flank.{gear}.profile_crowning_um=0.0" for gear in ("pinion", "wheel")]
    return task(
        "accessory",
        (
            f"optimise.vary={list(TEN)}",
            "optimise.symmetric=false",
            f"optimise.torques_Nm={TORQUES}",
            "optimise.max_evaluations=200",
            *roots,
            *profile,
            *settings,
        ),
    )


def two(*, quick: bool) -> dict[str, Any]:
    """Two parameters, one torque, by every method."""
    methods = ("lbfgs", "least_squares")
    settings = QUICK if quick else ()
    return {
        method: told(
            f"accessory, 2 parameters, {method}", _two((f"optimise.method={method}", *settings))
        )
        for method in methods
    }


def ten(*, quick: bool) -> dict[str, Any]:
    """Ten parameters, five torques."""
    settings = QUICK if quick else ()
    return {
        method: told(
            f"accessory, 10 parameters, 5 torques, {method}",
            _ten((f"optimise.method={method}", *settings)),
        )
        for method in ("lbfgs", "least_squares")
    }


def crowning(*, quick: bool) -> dict[str, Any]:
    """Crowning for the least pressure at speed, on a wheel that grows."""
    settings = (
        'optimise.vary=["flank.pinion.crowning_um"]',
        'optimise.minimise="max_pressure"',
        "mesh.pinion_speed_rad_s=3000.0",
        *(("mesh.phases=16",) if quick else ()),
    )
    return told("power-h1, crowning at 3000 rad/s", task("power-h1", settings))


def baselines(*, quick: bool) -> dict[str, Any]:
    """Evaluations until searches without gradient have the value of the one with it."""
    most = 4000 if quick else 40_000
    # What is made small is a sum of squares: so is it searched.
    settings = ("optimise.method=least_squares", *QUICK)
    few = _beaten("2 parameters", _two(settings), 4000)
    return few | _beaten("10 parameters", _ten(settings), most)


def _beaten(name: str, made: Task, most: int) -> dict[str, Any]:
    """How many evaluations others need for what a search by gradient finds."""
    import optimise

    box, objective, population = made.space.box, made.search.objective, 15
    found = made.search.descend(made.space.start, lambda point, value: None)
    before, after = float(found.values[0]), float(found.value)
    # As good: within a hundredth of what the search has gained.
    goal = after + 0.01 * (before - after)
    ours = first(found.values, goal)
    others = {
        "differential evolution": lambda: optimise.differential_evolution(
            objective,
            box,
            population=population,
            most_generations=most // (population * len(box.lower)),
            tolerance=0.0,
        ),
        "CMA-ES": lambda: optimise.cma_es(objective, box, most_evaluations=most, tolerance=0.0),
    }
    rows: dict[str, Any] = {}
    for other, search in others.items():
        tried = search()
        theirs = first(tried.values, goal)
        times = theirs / ours if theirs else math.inf
        words = f"{times:.0f} times as many" if theirs else f"not as good in {tried.evaluations}"
        print(
            f"{name}, {other + ':':<24} {words}; by gradient {ours}; best {tried.value:.4g}, by "
            f"gradient {after:.4g}",
            flush=True,
        )
        rows[f"{name}, {other}"] = {
            "evaluations": theirs,
            "evaluations_by_gradient": ours,
            "best": tried.value,
            "best_by_gradient": after,
            "all_evaluations": tried.evaluations,
        }
    return rows


def first(values: Any, goal: float) -> int:
    """How many evaluations until a value is as good as the goal; 0 if none is."""
    return next((number for number, value in enumerate(values, 1) if value <= goal), 0)


if __name__ == "__main__":
    main()
