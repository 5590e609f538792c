"""What a robust objective costs: a quantile over gears as they are made, with its gradient.

    python benchmarks/bench_robust.py [--quick] [--out DIR]

The rigid accessory pair of the example scene with tip relief that is to serve gears of class 6 that
are misaligned, with and without scatter of the torque; on the scene's own mesh, and on coarser
ones. The aim is 0.5 s for 256 gears on two cores, compile apart. Machines differ and are noisy:
compare ratios within one table. Writes `robust.json`.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

from timing import begin, line, peak, timed

_DEPTHS = [f"flank.{gear}.tip_relief.depth_um" for gear in ("pinion", "wheel")]
_SCATTER = [
    'robust.scatter."pair.misalignment_inclination_um"=5.0',
    *(f'robust.scatter."{depth}"=1.5' for depth in _DEPTHS),
    "robust.accuracy_grade=6",
]
_TORQUE = 'robust.scatter."pair.torque_pinion_Nm"=4.0'
# Phases and slices: the scene's own, and coarser ones.
_MESHES = ((64, 20), (64, 5), (32, 5), (32, 1))


def main() -> None:
    """Run all and print the table."""
    parser = argparse.ArgumentParser(description="What a robust objective costs.")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--quick", action="store_true", help="the coarsest mesh, few gears")
    options = parser.parse_args()
    begin(options.out)
    report = robust(quick=options.quick) | {"peak_memory_MB": peak()}
    print(f"{'peak memory':<58} {report['peak_memory_MB']:8.0f} MB")
    (options.out / "robust.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"\nwritten to {options.out}")


def robust(*, quick: bool = False) -> dict[str, Any]:
    """Time the quantile of the variance with its gradient in depth and extent.

    **Arguments:**

    - `quick`: the coarsest mesh and few gears only.

    **Returns:**

    Seconds and values, by mesh and by what scatters.
    """
    count, meshes = (32, ((16, 2),)) if quick else (256, _MESHES)
    report: dict[str, Any] = {"gears": count}
    for phases, slices in meshes:
        first = (phases, slices) == meshes[0]
        for name, more in {"flanks": [], "torque": [_TORQUE]}.items():
            if name == "flanks" or first:
                key = f"{phases}x{slices}_{name}"
                report[key] = _one(phases, slices, count, [*_SCATTER, *more])
    if not quick:
        batches = {f"batch_{size}_s": _batched(size) for size in (8, 32)}
        report |= batches
    return report


def _case(phases: int, slices: int, count: int, settings: list[str]):
    """Scatter, grid, law and members of the accessory scene."""
    import numpy as np

    import jaxgear as jg
    import optimise
    from jaxgear.scene._build import smooth_law_of
    from jaxgear.study._built import BuiltScene
    from jaxgear.study._design import design_space
    from jaxgear.study._objectives import prepared_mesh
    from jaxgear.study._robust import members_of
    from jaxgear.study._scatter import scatter_of

    scene = jg.example_scene(
        "accessory", [f"mesh.phases={phases}", f"mesh.slices={slices}", *settings]
    )
    vary = tuple(scene.value("optimise.vary"))
    space = design_space(BuiltScene(scene), vary, symmetric=True, deflection=10.0)
    scatter = scatter_of(space, space.base.pair, np.arange(1))
    grid = jg.grid_of(scene, space.base)
    prepared = prepared_mesh(space, grid)
    start = time.perf_counter()
    members = members_of(scatter, optimise.sample(scatter.quantities, count), grid, prepared)
    return scatter, grid, smooth_law_of(scene.mesh), members, time.perf_counter() - start


def _one(phases: int, slices: int, count: int, settings: list[str]) -> dict[str, float]:
    import jax.numpy as jnp

    import optimise
    from jaxgear.study._robust import judge_of

    scatter, grid, law, members, preparing = _case(phases, slices, count, settings)
    judge = judge_of(scatter, grid, law)
    measure = optimise.Quantile(0.95, 0.1)
    at = jnp.asarray([12.0, 0.25])
    value = lambda x, who: measure(optimise.responses_of(judge, x, who)[:, 0])
    what = "flanks and torque" if any("torque" in each for each in settings) else "flanks"
    title = f"{phases} phases, {slices} slices, {count} gears, {what}"
    compiling, alone, _ = timed(value, at, members, repeats=5)
    line(f"{title}: value", compiling, alone)
    compiling, both, found = timed(
        optimise.population_statistics(judge, [measure]), at, members, repeats=5
    )
    number, slope = float(found[0][0]), [float(x) for x in found[1][0]]
    note = f"RMS {number**0.5:.4f} um, slopes {slope[0]:.4f} um2/um, {slope[1]:.2f} um2"
    line("  with its gradient", compiling, both, note)
    if scatter.same_mesh is False:
        print(f"  preparing the gears, once, with compiling {preparing:6.1f} s", flush=True)
    return {
        "value_s": alone,
        "gradient_s": both,
        "compile_s": compiling,
        "prepare_with_compiling_s": preparing,
        "quantile_um2": number,
        "depth_slope": slope[0],
        "extent_slope": slope[1],
    }


def _batched(size: int) -> float:
    """Seconds with as many gears at once, by differentiating all of them together."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    import optimise
    from jaxgear.study._robust import judge_of

    scatter, grid, law, members, _ = _case(64, 20, 256, _SCATTER)
    judge = judge_of(scatter, grid, law)
    value = optimise.over_samples(
        lambda x, drawn: judge(x, drawn, members.shared)[0],
        np.asarray(members.deviations),
        optimise.Quantile(0.95, 0.1),
        batch=size,
    )
    compiling, seconds, _ = timed(jax.value_and_grad(value), jnp.asarray([12.0, 0.25]), repeats=3)
    line(f"  64 phases, 20 slices, {size} gears at once", compiling, seconds)
    return seconds


if __name__ == "__main__":
    main()
