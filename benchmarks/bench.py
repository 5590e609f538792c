"""What a computation costs and how accurate it is, on the accessory pair and the power pair.

    make bench                     or   python benchmarks/bench.py [--out DIR] [--threads 2]
                                        [--only statics | dynamics]

Times are medians of repeated runs after compiling, in one process; compile time stands beside
them. Machines differ and are noisy: compare ratios within one table. Writes `bench.json`,
`accuracy_against_time.png`, the error of the RMS of TE against the time of a mesh cycle, and
`foundations.png`, the same of the foundations against finite elements.
"""

import argparse
import functools
import json
import os
import time
from pathlib import Path
from typing import Any

from timing import line, one_thread, peak, timed


def main() -> None:
    """Run all benchmarks and print them."""
    parser = argparse.ArgumentParser(description="What a computation costs.")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--threads", type=int, default=2, help="processors to use")
    parser.add_argument("--only", choices=("statics", "dynamics"), help="one part")
    options = parser.parse_args()
    # Before NumPy and JAX are imported.
    one_thread()
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, allowed[: options.threads])
    import jax

    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    device = jax.devices()[0]
    report = {"device": f"{device.platform}: {device.device_kind}", "processors": options.threads}
    print(f"{report['device']}, {options.threads} processors, jax {jax.__version__}\n")
    if options.only != "dynamics":
        report |= cycle_and_gradient() | shafts() | master_curve_map() | optimum()
        report["foundations"] = foundations(options.out)
        report["accuracy"] = accuracy_against_time(options.out)
    if options.only != "statics":
        report["dynamics"] = dynamics()
    report["peak_memory_MB"] = peak()
    print(f"{'peak memory':<58} {report['peak_memory_MB']:8.0f} MB")
    (options.out / "bench.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"\nwritten to {options.out}")


def model_of(name: str, flank: Any = None):
    """An example scene's model and grid, with corrections on both flanks."""
    import jaxgear as jg

    scene = jg.example_scene(name)
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
            "that only turns": (jg.example_scene(name), True),
            "on shafts and bearings": (jg.example_scene(name), False),
            "the pinion a beam": (jg.example_scene(name, ["pinion.body.kind=beam"]), False),
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

    rows: list[dict[str, Any]] = []
    for name in ("none", "weber", "sainsot", "ring", "ring, load update"):
        settings = [f"mesh.foundation={name.partition(',')[0]}"]
        # In a plane, as the elements are.
        settings += ["mesh.face_coupling=none", "mesh.slices=1"]
        scene = jg.example_scene(
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


# Speeds that are marched together.
_BATCH = 30


def dynamics(count: int = 300, steps: int = 100) -> dict:
    """Steady responses of the accessory pair on its shafts at 300 speeds, and their gradient."""
    import jax
    import jax.numpy as jnp

    import jaxgear as jg
    from jaxgear import modal_basis, pair_dynamics

    model, _ = model_of("accessory")
    grid = jg.mesh_grid(model.pair, phases=steps, slices=20)
    speeds = jnp.linspace(50.0, 3000.0, count)
    compiling, seconds, pair = timed(lambda m: pair_dynamics(m, grid), model, repeats=5)
    system = pair.system
    line(f"pair in time, {system.load.size} dof, {steps} steps", compiling, seconds)
    modes = jax.jit(modal_basis)(system)
    report: dict[str, Any] = {"dofs": system.load.size, "speeds": count, "steps": steps}
    balance_ms, found = _balance_and_march(system, model, speeds)
    report |= found | {"balance_ms": balance_ms}
    report |= _floquet(system, modes, speeds)
    report |= _march_and_loops(system, modes, speeds)
    report |= _both_directions(system, speeds)
    report |= _dynamic_gradient(model, grid, speeds)
    return report


def _dynamic_numbers(system, orbits):
    """Largest mesh force over the static one, and RMS of the transmission error [um]."""
    import jax

    import jaxgear as jg
    from jaxgear import dynamic_ratio, dynamic_transmission_error, orbit_rms

    rms = lambda orbit: orbit_rms(system, dynamic_transmission_error(system, orbit)) / jg.um
    return jax.vmap(lambda orbit: (dynamic_ratio(system, orbit), rms(orbit)))(orbits)


def _balance_and_march(system, model, speeds) -> tuple[float, dict]:
    """Harmonic balance against marches, and the errors of both against finer shooting."""
    import jax
    import numpy as np

    import jaxgear as jg
    from jaxgear import (
        Exponential,
        HarmonicBalance,
        Newmark,
        Shooting,
        TimeStepping,
        pair_dynamics,
        steady_states,
    )

    def build(steps):
        grid = jg.mesh_grid(model.pair, phases=steps, slices=20)
        return jax.jit(lambda m: pair_dynamics(m, grid))(model).system

    # The reference knows every sixth speed.
    thinned = slice(3, None, 6)

    def solved(method, system, speeds, repeats):
        def numbers(system, speeds):
            orbits = steady_states(system, speeds, method)
            return _dynamic_numbers(system, orbits), orbits.settled

        return timed(numbers, system, speeds, repeats=repeats)

    _, _, (exact, good) = solved(Shooting(), build(800), speeds[thinned], 1)

    def errors(numbers):
        """Median and 95 % of the errors on the reference's branch, and its share of speeds."""
        ratio, rms = (
            np.abs(np.asarray(a)[thinned] / np.asarray(b) - 1.0)
            for a, b in zip(numbers, exact, strict=True)
        )
        same = np.asarray(good) & (ratio < 0.03) & (rms < 0.03)
        return {
            "ratio_median": float(np.median(ratio[same])),
            "ratio_95": float(np.quantile(ratio[same], 0.95)),
            "rms_median": float(np.median(rms[same])),
            "same_branch": float(np.mean(same)),
        }

    report: dict[str, Any] = {}
    balance_ms = 0.0
    fine = build(200)
    for name, method, on, repeats in (
        ("harmonic balance, H20", HarmonicBalance(), system, 7),
        ("march, Newmark, 100 cycles", TimeStepping(stepper=Newmark(), cycles=100), system, 1),
        ("march, exact, 100 cycles", TimeStepping(stepper=Exponential(), cycles=100), system, 1),
        ("march, Newmark, 200 steps, 400", TimeStepping(stepper=Newmark(), cycles=400), fine, 1),
        ("march, exact, 200 steps, 400", TimeStepping(stepper=Exponential(), cycles=400), fine, 1),
    ):
        compiling, seconds, (numbers, settled) = solved(method, on, speeds, repeats)
        found = errors(numbers) | {"ms": 1e3 * seconds, "settled": float(np.mean(settled))}
        balance_ms = balance_ms or found["ms"]
        found["over_balance"] = found["ms"] / balance_ms
        note = (
            f"{found['over_balance']:.0f} x   error {found['ratio_median']:.1e} of force, "
            f"{found['rms_median']:.1e} of TE, settled {found['settled']:.2f}"
        )
        line(f"{speeds.size} speeds, {name}", compiling, seconds, note)
        report[name] = found
    return balance_ms, report


def _floquet(system, modes, speeds) -> dict:
    """All speeds by harmonic balance, with the multipliers of each."""
    import jax
    import numpy as np

    from jaxgear import floquet_multipliers, monodromy, steady_states

    def matrices(system, modes, speeds):
        orbits = steady_states(system, speeds)
        return jax.lax.map(lambda orbit: monodromy(system, modes, orbit), orbits)

    compiling, seconds, found = timed(matrices, system, modes, speeds, repeats=3)
    start = time.perf_counter()
    largest = np.abs(floquet_multipliers(found, modes)[:, 0])
    eigenvalues = time.perf_counter() - start
    note = f"eigenvalues {1e3 * eigenvalues:.0f} ms of it, {np.sum(largest > 1.0)} unstable"
    line(f"{speeds.size} speeds with Floquet's multipliers", compiling, seconds + eigenvalues, note)
    return {"floquet_ms": 1e3 * (seconds + eigenvalues), "eigenvalues_ms": 1e3 * eigenvalues}


def _march_and_loops(system, modes, speeds) -> dict:
    """One step at one speed: batched, and by hand-written loops over the same modes and mesh."""
    import dynamics_loops as loops
    import jax
    import numpy as np

    from jaxgear import Newmark, quasi_static_start, time_history

    cycles, steps = 40, len(system.table.kinds)
    report, load = {}, None

    def batched(system, modes, speeds, size):
        start = quasi_static_start(system)
        one = lambda speed: time_history(
            system, speed, start, cycles=cycles, stepper=Newmark(), modes=modes
        )
        return jax.lax.map(lambda speed: one(speed).load, speeds, batch_size=size)

    # More speeds at once than the caches hold are slower again.
    for size in (speeds.size, _BATCH):
        compiling, seconds, load = timed(
            functools.partial(batched, size=size), system, modes, speeds, repeats=5
        )
        each = 1e6 * seconds / (cycles * steps * speeds.size)
        report[f"march_{size}_us"] = each
        name = f"a step of a march, {size} speeds batched"
        print(f"{name:<58} {each:8.2f} us   compile {compiling:5.1f} s")
    plain = lambda x: np.ascontiguousarray(np.asarray(x))
    table = system.table
    parts = modes.square, modes.damping, modes.mesh, modes.load, system.mean
    parts += table.edges, table.stiffness, table.gap, table.arms
    modal = loops.Modal(*map(plain, parts))
    # The same motion, to see that it is the same algorithm.
    last = speeds.size // 2
    frequency = system.teeth * float(speeds[last])
    start = plain(jax.jit(quasi_static_start)(system) @ (modes.shape.T @ system.mass).T)
    path = loops.numpy_march(modal, frequency, start, cycles)
    apart = np.max(np.abs(path.load[-steps:, 0] - plain(load)[last, :, 0])) / float(system.force)
    print(f"{'  its largest difference from the loop below':<58} {apart:8.1e} of the force")
    for name, microseconds, solves in loops.timings(modal, frequency, 400):
        note = f"{microseconds / each:.1f} x, {solves:.2f} Newton steps"
        print(f"{f'  {name}, one speed':<58} {microseconds:8.2f} us   {note}")
        report[f"{name}_us"] = microseconds
        report[f"{name}_over_march"] = microseconds / each
    if "numba_us" not in report:
        print("  numba is not installed: no comparison")
    return report | {"march_differs_from_loop": float(apart)}


def _both_directions(system, speeds) -> dict:
    """Up and down with Floquet and responses over two periods, and round the folds."""
    import numpy as np

    from jaxgear import continuation, sweep

    values = np.asarray(speeds)

    def whole():
        ways = [sweep(system, values, way) for way in ("up", "down")]
        return ways, continuation(system, float(values[0]), float(values[-1]))

    seconds = []
    for _ in range(2):
        start = time.perf_counter()
        (up, down), curve = whole()
        seconds.append(time.perf_counter() - start)
    points = [*up, *down]
    double = sum(point.multiple == 2 for point in points)
    lost = sum(not point.settled for point in points)
    note = f"{double} of period 2, {lost} unsettled, {curve.speed.size} points round the folds"
    line("both directions, round the folds", seconds[0] - seconds[1], seconds[1], note)
    return {"both_directions_s": seconds[1], "both_directions_first_s": seconds[0]}


def _dynamic_gradient(model, grid, speeds) -> dict:
    """Mean square of the mesh force's fluctuation over all speeds, in 6 parameters."""
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    import jaxgear as jg
    from jaxgear import orbit_variance, pair_dynamics, steady_states
    from jaxgear._response._dynamic import contact_force

    def objective(x):
        pinion, wheel = (
            jg.Superposed((jg.TipRelief(x[i] * jg.um, x[i + 1]), jg.Crowning(x[i + 2] * jg.um)))
            for i in (0, 3)
        )
        corrected = eqx.tree_at(lambda m: m.flanks, model, jg.Flanks(pinion, wheel))
        system = pair_dynamics(corrected, grid).system
        orbits = steady_states(system, speeds)
        force = lambda orbit: contact_force(system, orbit) / system.force
        return jnp.mean(jax.vmap(lambda orbit: orbit_variance(system, force(orbit)))(orbits))

    x = jnp.asarray([12.0, 0.25, 3.0, 12.0, 0.25, 3.0])
    compiling, alone, _ = timed(objective, x, repeats=5)
    compiling_too, both, (_, slope) = timed(jax.value_and_grad(objective), x, repeats=5)
    line(f"objective over {speeds.size} speeds", compiling, alone)
    line("  with its gradient", compiling_too, both, f"{both / alone:.2f} x alone")
    finite = bool(jnp.all(jnp.isfinite(slope)))
    return {"objective_ms": 1e3 * alone, "gradient_over_objective": both / alone, "finite": finite}


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
