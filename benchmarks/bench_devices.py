"""What a GPU gains: batches of the same computations on a CPU and on a GPU.

    JAX_PLATFORMS=cpu python benchmarks/bench_devices.py [cycles gradients ...] [--most 3]
    JAX_PLATFORMS=cuda python benchmarks/bench_devices.py

Mesh cycles of many reliefs and their gradients; steady states at many speeds of a pair and of a
pair with a condensed wheel, by harmonic balance and by marching; a gradient over speeds. Adds to
`devices.json`, under the device's name, the median seconds of a batch beside what was found; where
the file knows another device, the largest difference to it is told, over the largest number.
`devices.png` shows seconds per member over the size of a batch.
"""

import argparse
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from timing import begin, line, timed

# So many members of a batch are kept: they are what devices are compared by.
KEPT = 50
# Speeds of the pinion [rad/s].
SLOWEST, FASTEST = 100.0, 2000.0


class Part(NamedTuple):
    """A computation: what it makes of the inputs of all members, these by the size, and sizes."""

    name: str
    run: Callable
    inputs: Callable[[int], tuple]
    sizes: tuple[int, ...]


def main() -> None:
    """Run the parts asked for, print and draw them."""
    known = {each.__name__: each for each in (cycles, gradients, speeds, marches, wheels)}
    parser = argparse.ArgumentParser(description="What a GPU gains.")
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(known)}; all without")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    help_most = "seconds of a batch after which no larger one is tried"
    parser.add_argument("--most", type=float, default=3.0, help=help_most)
    options = parser.parse_args()
    begin(options.out)
    path = options.out / "devices.json"
    report: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    device = device_name()
    rows = report.setdefault(device, {})
    print(device)
    for name in options.parts or known:
        for part in known[name]():
            for size in part.sizes:
                compiling, seconds, found = timed(part.run, *part.inputs(size), enough=1.0)
                rows.setdefault(part.name, {})[str(size)] = {
                    "compile_s": compiling,
                    "seconds": seconds,
                    "found": [float(x) for x in found[:KEPT]],
                }
                line(f"{part.name}, {size}", compiling, seconds, differs(report, part.name, size))
                path.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
                if seconds > options.most:
                    break
    draw(report, options.out / "devices.png")
    print(f"written to {options.out}")


def device_name() -> str:
    """The device that JAX uses, and how many processors where it is a CPU."""
    import jax

    device = jax.devices()[0]
    if device.platform == "cpu":
        return f"CPU, {len(os.sched_getaffinity(0))} processors"
    return str(device.device_kind)


def differs(report: dict[str, Any], name: str, size: int) -> str:
    """How far apart the numbers of all devices are, over the largest number."""
    import numpy as np

    rows = [device.get(name, {}).get(str(size)) for device in report.values()]
    found = np.array([row["found"] for row in rows if row])
    apart = np.ptp(found, axis=0).max() / np.abs(found).max()
    return f"devices differ by {apart:.1e}" if len(found) > 1 else ""


def spread(size: int, low: float, high: float, step: float = 0.6180339887498949):
    """The first numbers of a sequence that fills a range evenly: a larger batch has them too."""
    import numpy as np

    return low + (high - low) * (step * np.arange(1, size + 1) % 1.0)


def reliefs(size: int) -> tuple:
    """Depths [m] and extents [-] of tip relief."""
    return spread(size, 0.0, 40e-6), spread(size, 0.01, 0.5, 0.7548776662466927)


# --- Mesh cycles


def cycles() -> Iterator[Part]:
    """RMS of the transmission error over a mesh cycle [um]."""
    from bench import model_of, relief_response

    from jaxgear import over_batch

    for scene in ("accessory", "power"):
        response = relief_response(*model_of(scene))

        def run(*inputs, response=response):
            return over_batch(lambda each: response(*each), inputs, on_cpu=50)

        yield Part(f"mesh cycle, {scene}", run, reliefs, (1, 50, 1000, 10000))


def gradients() -> Iterator[Part]:
    """The derivative of that by depth [um/um]."""
    import jax
    from bench import model_of, relief_response

    from jaxgear import over_batch

    for scene in ("accessory", "power"):
        response = relief_response(*model_of(scene))

        def run(*inputs, response=response):
            slopes = jax.grad(response, argnums=(0, 1))
            return 1e-6 * over_batch(lambda each: slopes(*each), inputs, on_cpu=50)[0]

        yield Part(f"its gradient, {scene}", run, reliefs, (1, 50, 1000, 10000))


# --- Steady states


def many_speeds(size: int) -> tuple:
    """Speeds of the pinion [rad/s]."""
    return (spread(size, SLOWEST, FASTEST),)


def largest_forces(system, method=None) -> Callable:
    """The largest mesh force at each speed, over the static one [-]."""
    from jaxgear import steady_states

    def run(speeds):
        return steady_states(system, speeds, method).load[..., 0].max(axis=-1) / system.force

    return run


def accessory_in_motion():
    """The accessory pair on its shafts, 64 steps in a mesh period."""
    import jax
    from bench import model_of

    import jaxgear as jg

    model, _ = model_of("accessory")
    grid = jg.mesh_grid(model.pair, phases=64, slices=20)
    return jax.jit(lambda m: jg.pair_dynamics(m, grid))(model).system


def speeds() -> Iterator[Part]:
    """A pair of rigid bodies on shafts, each speed by itself."""
    run = largest_forces(accessory_in_motion())
    yield Part("harmonic balance, accessory", run, many_speeds, (1, 30, 300, 3000))


def marches() -> Iterator[Part]:
    """The same by 50 mesh periods of marching."""
    from jaxgear import TimeStepping

    run = largest_forces(accessory_in_motion(), TimeStepping(cycles=50))
    yield Part("marching, accessory", run, many_speeds, (1, 30, 300, 3000))


def wheels() -> Iterator[Part]:
    """A condensed wheel on 250 shapes, and the derivative by speed [1/(100 rad/s)]."""
    import jax
    from bench_wheels import pair_of

    import jaxgear as jg

    dynamics, _ = pair_of(250, 64, 20, 0.0, "excited")
    run = largest_forces(dynamics.system)
    yield Part("harmonic balance, accessory-h1", run, many_speeds, (1, 30, 300))

    def softened(speed):
        """The largest force with a smoothed maximum [-]."""
        force = jg.steady_state(dynamics.system, speed).load[..., 0] / dynamics.system.force
        return 0.02 * jax.scipy.special.logsumexp(force / 0.02)

    def slopes(speeds):
        return 100.0 * jg.over_batch(jax.grad(softened), speeds)

    yield Part("its slope over speed, accessory-h1", slopes, many_speeds, (1, 30, 300))


def draw(report: dict[str, Any], path: Path) -> None:
    """Seconds per member over the size of a batch, a line for each device."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(name for rows in report.values() for name in rows))
    columns = 3
    lines = -(-len(names) // columns)
    figure = Figure(figsize=(3.6 * columns, 2.8 * lines), layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False)
    for axes, name in zip(grid.flat, names, strict=False):
        for device, rows in report.items():
            taken = {int(size): row["seconds"] for size, row in rows.get(name, {}).items()}
            each = [1e3 * seconds / size for size, seconds in taken.items()]
            axes.loglog(list(taken), each, "o-", ms=4, label=device)
        axes.set_title(name, fontsize=9)
        axes.grid(alpha=0.3)
    for axes in grid.flat[len(names) :]:
        axes.set_axis_off()
    figure.supxlabel("members of a batch [-]")
    figure.supylabel("time per member [ms]")
    grid.flat[0].legend(fontsize=8)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
