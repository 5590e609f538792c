"""What a computation costs and how accurate it is, on the accessory pair and the power pair.

    make bench                     or   python benchmarks/bench.py [--out DIR] [--threads 2]

Times are medians of repeated runs after compiling, in one process; compile time stands beside
them. Machines differ and are noisy: compare ratios within one table. Writes `bench.json`,
`accuracy_against_time.png`, the error of the RMS of TE against the time of a mesh cycle, and
`foundations.png`, the same of the foundations against finite elements.
"""

import argparse
import json
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def main() -> None:
    """Run all benchmarks and print them."""
    parser = argparse.ArgumentParser(description="What a computation costs.")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--threads", type=int, default=2, help="processors to use")
    options = parser.parse_args()
    # Before NumPy and JAX are imported.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, allowed[: options.threads])
    import jax

    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    device = jax.devices()[0]
    report = {"device": f"{device.platform}: {device.device_kind}", "processors": options.threads}
    print(f"{report['device']}, {options.threads} processors, jax {jax.__version__}\n")
    report |= cycle_and_gradient() | shafts() | master_curve_map() | optimum()
    report["foundations"] = foundations(options.out)
    report["accuracy"] = accuracy_against_time(options.out)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    report["peak_memory_MB"] = peak / (1024.0**2 if sys.platform == "darwin" else 1024.0)
    print(f"{'peak memory':<58} {report['peak_memory_MB']:8.0f} MB")
    (options.out / "bench.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"\nwritten to {options.out}")


def timed(function: Callable, *arguments, repeats: int = 15) -> tuple[float, float, Any]:
    """Seconds to compile, median seconds to run, and the result."""
    import jax

    start = time.perf_counter()
    compiled = jax.jit(function).lower(*arguments).compile()
    compiling = time.perf_counter() - start
    result = jax.block_until_ready(compiled(*arguments))
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(compiled(*arguments))
        seconds.append(time.perf_counter() - start)
    return compiling, statistics.median(seconds), result


def line(name: str, compiling: float, seconds: float, note: str = "") -> None:
    """Print one row."""
    print(f"{name:<58} {1e3 * seconds:8.2f} ms   compile {compiling:5.1f} s   {note}")


def model_of(name: str, flank: Any = None):
    """A ready scene's model and grid, with corrections on both flanks."""
    import jaxgear as jg

    scene = jg.ready_scene(name)
    model = jg.model_of(scene)
    if flank is not None:
        import equinox as eqx

        model = eqx.tree_at(lambda m: m.flanks, model, jg.Flanks(flank, flank))
    return model, jg.grid_of(scene, model)


def cycle_and_gradient() -> dict:
    """A mesh cycle of 64 phases and 20 slices, alone and with its gradient in 6 parameters."""
    import jax
    import jax.numpy as jnp

    import jaxgear as jg

    report = {}
    laws = {"exact": jg.ExactContact(), "smooth": jg.SmoothContact(0.5 * jg.um)}
    for scene in ("accessory", "power"):
        model, grid = model_of(scene)
        for law_name, law in laws.items():

            def variance(x, model=model, grid=grid, law=law):
                pinion, wheel = (
                    jg.Superposed(
                        (jg.TipRelief(x[i] * jg.um, x[i + 1]), jg.Crowning(x[i + 2] * jg.um))
                    )
                    for i in (0, 3)
                )
                flanks = jg.Flanks(pinion, wheel)
                corrected = jg.PairModel(model.pair, model.torque, flanks, model.compliance)
                cycle = jg.mesh_cycle(corrected, grid, law=law, throw=False)
                error = jg.transmission_error(corrected.pair, cycle)
                return jg.cycle_variance(cycle, error) / jg.um**2

            x = jnp.asarray([12.0, 0.25, 3.0, 12.0, 0.25, 3.0])
            compiling, alone, _ = timed(variance, x, repeats=60)
            compiling_too, with_gradient, _ = timed(jax.value_and_grad(variance), x, repeats=60)
            ratio = with_gradient / alone
            line(f"mesh cycle, {scene}, {law_name} contact", compiling, alone)
            line("  with its gradient", compiling_too, with_gradient, f"{ratio:.2f} x alone")
            report[f"gradient_over_cycle_{scene}_{law_name}"] = ratio
            report[f"cycle_ms_{scene}_{law_name}"] = 1e3 * alone
    return report


def shafts() -> dict:
    """What shafts, bearings and a pinion that bends cost, over a pair that only turns."""
    import equinox as eqx

    import jaxgear as jg

    report = {}
    for name in ("accessory", "power"):
        rungs = {
            "that only turns": (jg.ready_scene(name), True),
            "on shafts and bearings": (jg.ready_scene(name), False),
            "the pinion a beam": (jg.ready_scene(name, ["pinion.body.kind=beam"]), False),
        }
        alone = None
        for rung, (scene, free) in rungs.items():
            model = jg.model_of(scene)
            if free:
                places = lambda m: (m.pinion_support, m.wheel_support)
                model = eqx.tree_at(places, model, (jg.Support(), jg.Support()))
            grid = jg.grid_of(scene, model)

            def mean(model, grid=grid):
                cycle = jg.mesh_cycle(model, grid, throw=False)
                return jg.cycle_mean(cycle, jg.transmission_error(model.pair, cycle)) / jg.um

            compiling, seconds, value = timed(mean, model, repeats=60)
            alone = seconds if alone is None else alone
            note = f"{seconds / alone:.2f} x the first; mean TE {float(value):.2f} um"
            line(f"mesh cycle, {name} pair {rung}", compiling, seconds, note)
            report[f"cycle_over_turning_{name}_{rung.replace(' ', '_')}"] = seconds / alone
    return report


# Mean and RMS of the transmission error [um] of the accessory pair at 80 N m, contact at the line
# loads found: plane-strain finite elements of both gears with all their teeth, clamped at bores of
# 30 and 40 mm. From `fe_transmission_error(..., load_updates=3)` of tests/verification.
_FINITE_ELEMENTS = (16.40, 1.916)


def foundations(folder: Path) -> list[dict]:
    """Error of the transmission error against finite elements, and time, over the foundations."""
    from matplotlib.figure import Figure

    import jaxgear as jg

    rows = []
    for name in ("none", "weber", "sainsot", "ring", "ring, load update"):
        settings = [f"mesh.foundation={name.partition(',')[0]}", "mesh.slices=1"]
        scene = jg.ready_scene(
            "accessory", [*settings, f"mesh.line_load_updates={int(',' in name)}"]
        )
        full = jg.model_of(scene)
        model = jg.PairModel(full.pair, full.torque, full.flanks, full.compliance)
        grid = jg.grid_of(scene, model)

        def numbers(model, grid=grid):
            cycle = jg.mesh_cycle(model, grid, throw=False)
            error = jg.transmission_error(model.pair, cycle) / jg.um
            return jg.cycle_mean(cycle, error), jg.cycle_rms(cycle, error)

        compiling, seconds, found = timed(numbers, model, repeats=60)
        mean, rms = (float(x) / y - 1.0 for x, y in zip(found, _FINITE_ELEMENTS, strict=True))
        note = f"against finite elements: mean {mean:+.1%}, RMS {rms:+.1%}"
        line(f"foundation: {name}", compiling, seconds, note)
        rows.append({"foundation": name, "ms": 1e3 * seconds, "mean": mean, "rms": rms})
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    for key, marker, label in (("rms", "o", "RMS of TE"), ("mean", "^", "mean TE")):
        axes.semilogy([r["ms"] for r in rows], [abs(r[key]) for r in rows], marker, label=label)
    for row in rows:
        axes.annotate(
            row["foundation"],
            (row["ms"], abs(row["rms"])),
            textcoords="offset points",
            xytext=(6, 4),
            fontsize=8,
        )
    axes.set_xlabel("time of a mesh cycle [ms]")
    axes.set_ylabel("relative error against finite elements [-]")
    axes.set_title("foundations, accessory pair, bores clamped")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(folder / "foundations.png", dpi=150)
    return rows


def relief_response(model, grid):
    """RMS of TE [um] over depth [m] and extent of symmetric tip relief, exact contact."""
    import equinox as eqx
    import jax

    import jaxgear as jg

    prepared = jax.jit(lambda m: jg.prepare_mesh(m, grid))(model)

    def te_rms(depth, extent):
        flank = jg.Superposed((jg.TipRelief(depth, extent),))
        relieved = eqx.tree_at(lambda m: m.flanks, model, jg.Flanks(flank, flank))
        cycle = jg.corrected_cycle(prepared, relieved)
        return jg.cycle_rms(cycle, jg.transmission_error(model.pair, cycle)) / jg.um

    return te_rms


def master_curve_map() -> dict:
    """The map of 50 x 50 reliefs, 64 phases, 20 slices, exact contact."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    import jaxgear as jg

    report = {}
    for scene in ("accessory", "power"):
        model, grid = model_of(scene)
        response = relief_response(model, grid)
        depth, extent = np.meshgrid(np.linspace(0.0, 40.0, 50) * jg.um, np.linspace(0.01, 0.5, 50))

        def chart(depths, extents, response=response):
            return jax.lax.map(
                lambda pair: response(*pair), (depths, extents), batch_size=len(depths) // 50
            )

        flat = jnp.asarray(depth.ravel()), jnp.asarray(extent.ravel())
        compiling, seconds, value = timed(chart, *flat, repeats=5)
        line(f"map 50 x 50, {scene}, exact contact", compiling, seconds)
        report[f"map_ms_{scene}"] = 1e3 * seconds
        report[f"map_least_um_{scene}"] = float(np.min(np.asarray(value)))
    return report


def optimum() -> dict:
    """Depth and extent from plain flanks: by gradient, and by differential evolution."""
    import equinox as eqx
    import jax
    import jax.numpy as jnp
    import numpy as np

    import jaxgear as jg
    import optimise

    model, grid = model_of("accessory")
    torques = model.torque[None]

    def relieved(x):
        flank = jg.Superposed((jg.TipRelief(x[0] * jg.um, x[1]),))
        return eqx.tree_at(lambda m: m.flanks, model, jg.Flanks(flank, flank))

    variance = optimise.over_torques(
        relieved,
        optimise.TransmissionErrorVariance(),
        torques,
        grid=grid,
        law=jg.SmoothContact(0.5 * jg.um),
        prepared=optimise.prepare_torques(model, torques, grid),
    )
    box = optimise.Box(lower=[0.0, 0.02], upper=[40.0, 0.5])
    start = np.asarray([0.0, 0.25])
    exact = relief_response(model, grid)
    compiling, once, _ = timed(jax.value_and_grad(variance), jnp.asarray(start))
    line("optimum, one evaluation with gradient", compiling, once)
    report: dict[str, Any] = {"optimum_gradient_evaluation_ms": 1e3 * once}
    for name, search in (
        ("L-BFGS-B", lambda: optimise.lbfgs(variance, start, box)),
        ("Adam (optax)", lambda: optimise.adam(variance, start, box)),
        ("differential evolution", lambda: optimise.differential_evolution(variance, box)),
    ):
        begin = time.perf_counter()
        found = search()
        seconds = time.perf_counter() - begin
        rms = float(exact(jnp.asarray(found.point[0] * jg.um), jnp.asarray(found.point[1])))
        note = f"{found.evaluations} evaluations, RMS {rms:.4f} um at {found.point.round(4)}"
        print(f"{'optimum, ' + name:<58} {seconds:8.2f} s with compiling   {note}")
        report[f"optimum_{name}"] = {
            "seconds_with_compiling": seconds,
            "evaluations": found.evaluations,
            "gradient_evaluations": found.gradient_evaluations,
            "te_rms_um": rms,
        }
    return report


def accuracy_against_time(folder: Path) -> list[dict]:
    """Error of the RMS of TE against the time of a cycle, over slices, phases and contact laws."""
    import jaxgear as jg

    rows = []
    reliefs = {
        "accessory": jg.Superposed((jg.TipRelief(12.0 * jg.um, 0.25), jg.Crowning(4.0 * jg.um))),
        "power": jg.Superposed((jg.TipRelief(8.0 * jg.um, 0.25), jg.Crowning(6.0 * jg.um))),
    }
    rungs = [(16, 5), (16, 20), (32, 10), (64, 1), (64, 5), (64, 20), (128, 20), (256, 40)]
    for scene, flank in reliefs.items():
        model, _ = model_of(scene, flank)

        _, _, finest = _timed_rms(model, 1024, 160, jg.ExactContact())
        for phases, slices in rungs:
            for name, law in (("exact", jg.ExactContact()), ("smooth", jg.SmoothContact(0.5e-6))):
                _, seconds, value = _timed_rms(model, phases, slices, law)
                rows.append(
                    {
                        "scene": scene,
                        "law": name,
                        "phases": phases,
                        "slices": slices,
                        "ms": 1e3 * seconds,
                        "relative_error": abs(float(value) / float(finest) - 1.0),
                    }
                )
        for row in rows:
            if row["scene"] == scene:
                print(
                    f"{scene}, {row['law']}, {row['phases']} phases x {row['slices']} slices".ljust(
                        58
                    )
                    + f" {row['ms']:8.2f} ms   relative error of RMS {row['relative_error']:.1e}"
                )
    _draw(rows, folder)
    return rows


def _timed_rms(model, phases: int, slices: int, law) -> tuple[float, float, Any]:
    """Time a mesh cycle that ends in the RMS of TE [um]."""
    import jaxgear as jg

    grid = jg.mesh_grid(model.pair, phases=phases, slices=slices)

    def value(model):
        cycle = jg.mesh_cycle(model, grid, law=law, throw=False)
        return jg.cycle_rms(cycle, jg.transmission_error(model.pair, cycle)) / jg.um

    return timed(value, model, repeats=30)


def _draw(rows: list[dict], folder: Path) -> None:
    """The picture of accuracy against time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, scene in zip(panels, ("accessory", "power"), strict=True):
        for law, marker in (("exact", "o"), ("smooth", "^")):
            chosen = [row for row in rows if row["scene"] == scene and row["law"] == law]
            axes.loglog(
                [row["ms"] for row in chosen],
                [row["relative_error"] for row in chosen],
                marker,
                label=f"{law} contact",
            )
        for row in rows:
            if row["scene"] == scene and row["law"] == "exact":
                axes.annotate(
                    f"{row['phases']}x{row['slices']}",
                    (row["ms"], row["relative_error"]),
                    textcoords="offset points",
                    xytext=(5, 4),
                    fontsize=7,
                )
        axes.set_title(f"{scene} pair; phases x slices")
        axes.set_xlabel("time of a mesh cycle [ms]")
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("relative error of the RMS of TE [-]")
    panels[0].legend()
    figure.savefig(folder / "accuracy_against_time.png", dpi=150)


if __name__ == "__main__":
    main()
