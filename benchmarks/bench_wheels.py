"""What flexible wheels in rotation cost: sweeps, marches, a gradient.

    python benchmarks/bench_wheels.py [sweep march step gradient] [--quick] [--out DIR]

The accessory pair with a rigid pinion and a condensed wheel (`accessory-h1`), 100 modes of which
vibrate: speeds by harmonic balance with and without Floquet's multipliers, and which modes,
harmonics and steps are needed for 1 % of the largest mesh force; marching over wheel revolutions to
the same error; a step of a march, and the thesis's way beside it, with a dense matrix of all
coordinates factorised at every step; the gradient of 30 speeds in 6 parameters of the flanks.
`--quick` takes fewer speeds and settings. Machines differ and are noisy: compare ratios within one
table, of processor time where others use the machine. Adds to `wheels.json`.
"""

import functools
import itertools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from timing import in_parts

# Speeds of the pinion from slow to 14 kHz in mesh [rad/s]; wheel and pinion teeth.
SLOWEST, FASTEST, PERIODS = 100.0, 2000.0, 86
UM = 1e-6


def main() -> None:
    """Run the parts asked for and print their tables."""
    parts = {"sweep": sweeps, "march": marches, "step": steps, "gradient": gradient}
    in_parts(
        "What flexible wheels in rotation cost.", "fewer speeds and settings", "wheels.json", parts
    )


class Cost(NamedTuple):
    """Seconds to compile and to run, and seconds of all processors while it ran."""

    compiling: float
    seconds: float
    processor: float


def measured(function: Callable, *arguments, repeats: int = 3) -> tuple[Cost, Any]:
    """What a function costs, the least of several runs, and its result."""
    import equinox as eqx
    import jax

    start = time.perf_counter()
    program: Any = eqx.filter_jit(function)
    compiled = program.lower(*arguments).compile()
    compiling = time.perf_counter() - start
    runs, result = [], None
    for _ in range(repeats):
        wall, processor = time.perf_counter(), time.process_time()
        result = jax.block_until_ready(compiled(*arguments))
        runs.append((time.perf_counter() - wall, time.process_time() - processor))
    return Cost(compiling, *(min(each) for each in zip(*runs, strict=True))), result


def row(name: str, cost: Cost, per: float = 1.0, unit: str = "s", note: str = "") -> None:
    """Print one row, times multiplied by `per`."""
    print(
        f"{name:<52} {per * cost.seconds:10.4g} {unit:<3} {per * cost.processor:10.4g} {unit} of "
        f"processors   compile {cost.compiling:5.1f} s   {note}",
        flush=True,
    )


@functools.cache
def scene_of(coordinates: int, shapes: str = "natural"):
    """The scene with its bodies."""
    import jaxgear as jg

    settings = [
        # As the thesis has its rigid pinion.
        "mesh.foundation=weber",
        f"model.coordinates={coordinates}",
        f"model.shapes={shapes}",
        "sweep.pinion_speed_rad_s=[100.0, 2000.0]",
    ]
    return jg.with_bodies(jg.example_scene("accessory-h1", settings), moving=True)


@functools.cache
def maker_of(coordinates: int, steps: int, mesh: int, shapes: str):
    """What makes the pair in motion with corrected flanks of a model, and seconds to compile it."""
    import equinox as eqx
    from bench_hybrid import with_relief

    import jaxgear as jg
    from jaxgear.study._dynamics import dynamics_of

    scene = scene_of(coordinates, shapes)
    scene = scene.replace({"sweep.steps": steps, "model.mesh_coordinates": mesh})
    model = jg.model_of(scene)
    grid = jg.grid_of(scene, model, scene.sweep.steps)

    def relieved(depth: float):
        return with_relief(model, [depth * UM] * 2, [0.25] * 2, [0.0] * 2)

    start = time.perf_counter()
    make: Any = eqx.filter_jit(lambda m: dynamics_of(m, grid, scene))
    make = make.lower(relieved(0.0)).compile()
    return lambda depth: make(relieved(depth)), time.perf_counter() - start


@functools.cache
def pair_of(
    coordinates: int = 100,
    steps: int = 128,
    mesh: int = 12,
    relief: float = 0.0,
    shapes: str = "natural",
):
    """The pair in motion with a tip relief on both flanks [um], and what it cost."""
    import jax

    make, compiling = maker_of(coordinates, steps, mesh, shapes)
    start, processor = time.perf_counter(), time.process_time()
    dynamics = jax.block_until_ready(make(relief))
    cost = Cost(compiling, time.perf_counter() - start, time.process_time() - processor)
    return dynamics, cost


def peaks_of(system, orbits):
    """Largest mesh force of each response, over the static force [-]."""
    import numpy as np

    return np.asarray(orbits.load[..., 0]).max(axis=-1) / float(system.force)


# --- Speeds by harmonic balance

# Teeth without tip relief meet with a jump that excites modes of any frequency: the largest force
# converges slowly in their number. Both are shown [um].
RELIEFS = 20.0, 0.0
# Modes, steps in a mesh period, harmonics, mesh coordinates beside approach and tilt; shapes.
REFERENCE = 800, 128, 20, 12, "natural"
SETTINGS = (
    (200, 128, 20, 12, "excited"),
    (150, 128, 20, 12, "excited"),
    (400, 128, 20, 12, "natural"),
    (200, 128, 20, 12, "natural"),
    (100, 128, 20, 12, "natural"),
    (100, 128, 12, 12, "natural"),
    (100, 128, 20, 6, "natural"),
    (100, 64, 12, 12, "natural"),
    (10, 128, 20, 12, "natural"),
    (50, 128, 20, 12, "natural"),
    (100, 32, 12, 12, "natural"),
)


def sweeps(*, quick: bool) -> dict[str, Any]:
    """Many speeds, with and without multipliers, and the error of less and less."""
    import numpy as np

    from jaxgear import steady_states, sweep

    count = 60 if quick else 300
    speeds = np.linspace(SLOWEST, FASTEST, count)
    dynamics, built = pair_of()
    system = dynamics.system
    row("building the pair in motion", built)
    cold, orbits = measured(steady_states, system, speeds, repeats=1)
    settled = float(np.mean(np.asarray(orbits.settled)))
    row(f"{count} speeds, each by itself", cold, note=f"settled {settled:.3f}")
    report = {"build": built._asdict(), "speeds": count, "cold": cold._asdict()}
    report["settled"] = settled
    report["floquet"] = multipliers_of(system, orbits)
    report["needs"] = needs(quick=quick)
    start, processor = time.perf_counter(), time.process_time()
    some = speeds[::5]
    points = sweep(system, some)
    whole = Cost(0.0, time.perf_counter() - start, time.process_time() - processor)
    marched = sum(not point.settled for point in points)
    row(f"{some.size} speeds upwards, with Floquet and compiling", whole, note=f"{marched} marched")
    report |= {"up": whole._asdict(), "marched": marched}
    return report


def needs(*, quick: bool) -> list[dict[str, Any]]:
    """The error of the largest force with fewer modes, steps, harmonics and mesh coordinates."""
    import numpy as np

    from jaxgear import HarmonicBalance, steady_states

    chosen = np.linspace(SLOWEST, FASTEST, 20) + 13.0
    exact, rows = {}, []
    settings = (REFERENCE, *SETTINGS[: 4 if quick else None])
    for relief, setting in itertools.product(RELIEFS, settings):
        modes, steps, harmonics, mesh, shapes = setting
        system = pair_of(modes, steps, mesh, relief, shapes)[0].system
        method = HarmonicBalance(harmonics=harmonics)
        cost, orbits = measured(lambda s, v, m=method: steady_states(s, v, m), system, chosen)
        force, good = peaks_of(system, orbits), np.asarray(orbits.settled)
        best, fine = exact.setdefault(relief, (force, good))
        error = np.abs(force / best - 1.0)[good & fine]
        found = {
            "relief_um": relief,
            "modes": modes,
            "shapes": shapes,
            "steps": steps,
            "harmonics": harmonics,
            "mesh_coordinates": mesh,
            "coordinates": system.mass.shape[0],
            "error_median": float(np.median(error)),
            "error_90": float(np.quantile(error, 0.9)),
            "error_largest": float(error.max()),
            "compared": int(error.size),
            "ms_per_speed": 1e3 * cost.seconds / chosen.size,
            "processor_ms_per_speed": 1e3 * cost.processor / chosen.size,
            "force": force.tolist(),
        }
        rows.append(found)
        name = (
            f"{relief:.0f} um: {modes} {shapes}, {steps} steps, {harmonics} harmonics, {mesh} + 2"
        )
        note = (
            f"error {found['error_median']:.1e} median, {found['error_90']:.1e} at 90 %, "
            f"{found['error_largest']:.1e} largest of {error.size}"
        )
        row(name, cost, 1e3 / chosen.size, "ms", note)
    return rows


def multipliers_of(system, orbits) -> dict[str, float]:
    """What Floquet's multipliers of some responses cost for each, by all modes and by the slow."""
    import jax
    import numpy as np

    from jaxgear import modal_basis, monodromy, slow_modes
    from jaxgear._dynamics._floquet import leading_multipliers

    some = jax.tree.map(lambda x: x[:: max(1, len(x) // 20)], orbits)
    modes = jax.jit(modal_basis)(system)
    report, exact = {}, None
    for name, slow in (("all", slow_modes(modes, modes.square.size)), ("slow", slow_modes(modes))):
        matrices = lambda system, slow, orbits: jax.lax.map(
            lambda orbit: monodromy(system, slow.basis, orbit, follows=slow.follows), orbits
        )
        cost, found = measured(matrices, system, slow, some)
        start = time.process_time()
        largest = np.array([abs(leading_multipliers(each, slow.basis)[0]) for each in found])
        each, eigenvalues = len(largest), time.process_time() - start
        exact = largest if exact is None else exact
        error = float(np.nanmax(np.abs(largest - exact)))
        note = f"and {1e3 * eigenvalues / each:.0f} ms for eigenvalues; differs by {error:.1e}"
        row(f"Floquet's matrix, {slow.basis.square.size} modes", cost, 1e3 / each, "ms", note)
        report[name] = {
            "modes": slow.basis.square.size,
            "matrix_processor_ms": 1e3 * cost.processor / each,
            "eigenvalues_processor_ms": 1e3 * eigenvalues / each,
            "differs": error,
        }
    return report


# --- Marching


def marches(*, quick: bool) -> dict[str, Any]:
    """Whole revolutions of the wheel until the largest force is that of the periodic response."""
    import jax.numpy as jnp
    import numpy as np

    from jaxgear import (
        HarmonicBalance,
        Newmark,
        modal_basis,
        quasi_static_start,
        steady_state,
        time_history,
    )

    system, most = pair_of()[0].system, 2 if quick else 4
    cycles = most * PERIODS

    def over(system, speed):
        # Only what is needed of each period is kept.
        modes, start = modal_basis(system), quasi_static_start(system)
        history = time_history(
            system, speed, start, cycles=cycles, keep=cycles, stepper=Newmark(), modes=modes
        )
        return jnp.max(history.load[:, 0].reshape(cycles, -1), axis=1) / system.force

    report: dict[str, Any] = {"rows": []}
    for value in (600.0, 1500.0) if quick else (300.0, 600.0, 900.0, 1500.0):
        speed = jnp.asarray(value)
        balance = lambda s, v: steady_state(s, v, HarmonicBalance())
        alone, orbit = measured(balance, system, speed)
        exact = float(peaks_of(system, orbit))
        cost, peaks = measured(over, system, speed, repeats=1)
        apart = np.abs(np.asarray(peaks) / exact - 1.0)
        late = np.nonzero(apart > 0.01)[0]
        needed = int(late[-1]) + 2 if late.size else 1
        revolutions = -(-needed // PERIODS)
        each = cost.processor / most
        found = {
            "speed": value,
            "balance": alone._asdict(),
            "revolution_s": each,
            "revolutions": revolutions,
            "reached": needed <= cycles,
            "error_at_end": float(apart[-1]),
            "ratio": revolutions * each / alone.processor,
        }
        report["rows"].append(found)
        reached = f"{revolutions} revolutions" if found["reached"] else f"not within {most}"
        note = f"to 1 %: {reached}, {found['ratio']:.0f} x a balance; at the end {apart[-1]:.1e}"
        row(f"a revolution at {value:.0f} rad/s", cost, 1.0 / most, "s", note)
    return report


def steps(*, quick: bool) -> dict[str, Any]:
    """One step of a march, and the thesis's."""
    import jax.numpy as jnp

    from jaxgear import Exponential, Newmark, modal_basis, quasi_static_start, time_history

    report: dict[str, Any] = {}
    for modes in (100,) if quick else (100, 300):
        system = pair_of(modes)[0].system
        cycles = 8
        for name, stepper in (("Newmark", Newmark()), ("exact", Exponential())):

            def over(system, speed, stepper=stepper, cycles=cycles):
                start = quasi_static_start(system)
                basis = modal_basis(system)
                history = time_history(
                    system, speed, start, cycles=cycles, keep=1, stepper=stepper, modes=basis
                )
                return history.load, history.converged

            cost, (_, converged) = measured(over, system, jnp.asarray(700.0))
            count = cycles * len(system.table.kinds)
            size = system.mass.shape[0]
            report[f"{name}_{size}"] = {k: 1e6 * v / count for k, v in cost._asdict().items()}
            note = "" if bool(converged) else "contact not solved"
            row(f"a step, {name}, {size} coordinates", cost, 1e6 / count, "us", note)
    seconds, size = thesis_step()
    print(f"{f'a step, the thesis way, {size} coordinates':<52} {1e3 * seconds:10.4g} ms")
    return report | {"thesis_ms": 1e3 * seconds, "thesis_coordinates": size}


def thesis_step(count: int = 3) -> tuple[float, int]:
    """Processor seconds of a step with all coordinates of the wheel alone, and their number.

    The effective stiffness is built with the cells in contact and factorised at every step, once
    for all of Newton's iterations. Cells press on single nodes here: what counts is the size.
    """
    import numpy as np
    import scipy.linalg

    body = scene_of(100).bodies["wheel"].built.body
    mass, stiffness = np.asarray(body.mass), np.asarray(body.stiffness)
    step = 2.0 * np.pi / (45.0 * 700.0 * 128.0)
    constant = stiffness + 4.0 / step**2 * mass
    cells = 3 * np.arange(40)
    load = np.zeros(len(mass))
    start = time.process_time()
    for number in range(count):
        whole = constant.copy()
        whole[cells, cells] += 1e8 * (1.0 + number)
        load[cells] = 1.0
        factor = scipy.linalg.cho_factor(whole, overwrite_a=True, check_finite=False)
        motion = scipy.linalg.cho_solve(factor, load + mass @ load, check_finite=False)
        load = load + 1e-30 * motion
    return (time.process_time() - start) / count, len(mass)


# --- A gradient


def gradient(*, quick: bool) -> dict[str, Any]:
    """RMS over speeds of the largest force, smoothed, in depth, extent and crowning."""
    import jax
    import jax.numpy as jnp
    from bench_hybrid import with_relief

    import jaxgear as jg
    from jaxgear import steady_states
    from jaxgear.study._dynamics import dynamics_of

    scene = scene_of(200, "excited")
    model = jg.model_of(scene)
    grid = jg.grid_of(scene, model, scene.sweep.steps)
    speeds = jnp.linspace(SLOWEST, FASTEST, 6 if quick else 30)

    def objective(x):
        relieved = with_relief(model, x[:2] * UM, x[2:4], x[4:] * UM)
        system = dynamics_of(relieved, grid, scene).system
        force = steady_states(system, speeds).load[..., 0] / system.force
        largest = 0.02 * jax.scipy.special.logsumexp(force / 0.02, axis=1)
        return jnp.sqrt(jnp.mean(largest**2))

    x = jnp.asarray([12.0, 12.0, 0.25, 0.25, 3.0, 3.0])
    alone, value = measured(objective, x)
    row(f"{speeds.size} speeds, pair built anew", alone, note=f"value {float(value):.4f}")
    both, (_, slope) = measured(jax.value_and_grad(objective), x)
    ratio = both.processor / alone.processor
    row("  with the gradient in 6 parameters", both, note=f"{ratio:.2f} x")
    finite = bool(jnp.all(jnp.isfinite(slope)))
    return {
        "speeds": speeds.size,
        "value": alone._asdict(),
        "both": both._asdict(),
        "ratio": ratio,
        "finite": finite,
    }


if __name__ == "__main__":
    main()
