"""How many shapes a condensed body needs in motion: few speeds, all coordinates beside fewer.

    python benchmarks/bench_shapes.py SCENE KIND:COUNT[:MESH] ... [--speeds V ...] [--relief UM ...]
    python benchmarks/bench_shapes.py SCENE scene --estimate [--speeds V ...] [--relief UM ...]
    python benchmarks/bench_shapes.py --table [--chart docs/pictures/shapes.png]

Each model of an example scene, as `natural:100` or `excited:200` (0: all coordinates of the body)
with the scene's own number of mesh coordinates or `MESH` of them, or as `scene`, with all as the
scene has it, is brought to its steady response at each speed by harmonic balance. Its largest mesh
force, RMS of transmission error, largest bearing force and, with `--probes`, RMS of what two nodes
of the wheel do along the axis, at the end of its rim and in the middle of its web, between two
holes, and of the waves of two and of six and more nodal diameters around its rim, go to
`shapes.json`, with processor seconds. With `--estimate` what a sweep would say of the errors is
there too [%], by the modes of which the shapes are made (theory 11.9). The table compares all with
the model of most coordinates at the same speed and relief. All coordinates of the accessory wheel
(2,895) take minutes of a processor to be set up and half a one for each speed. A wheel with holes
repeats after many mesh periods: take few harmonics, by `--set`.
"""

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from timing import begin, peak

FLANKS = "flank.pinion.tip_relief.depth_um", "flank.wheel.tip_relief.depth_um"
NUMBERS = {
    "force": "largest mesh force",
    "te_rms": "RMS of TE",
    "bearing": "bearing force",
    "rim_um": "rim axial",
    "web_um": "web axial",
    "waves_um": "waves",
    "short_waves_um": "short waves",
}


def main() -> None:
    """Measure what is asked for, or print the table of what was measured."""
    parser = argparse.ArgumentParser(description="How many shapes a condensed body needs.")
    parser.add_argument("scene", nargs="?")
    parser.add_argument("models", nargs="*", metavar="KIND:COUNT[:MESH]")
    parser.add_argument("--speeds", type=float, nargs="+", default=[400.0, 900.0, 1400.0, 1900.0])
    parser.add_argument("--relief", type=float, nargs="+", default=[0.0, 10.0])
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="of the scene")
    parser.add_argument("--probes", action="store_true", help="on rim and web of the wheel")
    parser.add_argument("--estimate", action="store_true", help="errors, without a reference")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--chart", type=Path, help="error against processor time, as a picture")
    parser.add_argument("--file", type=Path, default=Path(__file__).with_name("shapes.json"))
    options = parser.parse_args()
    begin(options.file.parent)
    path = options.file
    for model in options.models:
        for rows in measured(model, options):
            known = json.loads(path.read_text("utf-8")) if path.exists() else {}
            path.write_text(json.dumps(known | rows, indent=1) + "\n", encoding="utf-8")
    if options.table or options.chart:
        found = compared(json.loads(path.read_text("utf-8")))
        for line in found:
            print(line.words)
        if options.chart:
            chart(found, options.chart)


def measured(model: str, options: argparse.Namespace):
    """Numbers of each response with one model, as they are found."""
    import equinox as eqx
    import jax
    import jax.numpy as jnp
    import numpy as np

    import jaxgear as jg
    from jaxgear import harmonic_balance_problem
    from jaxgear.study._built import BuiltScene
    from jaxgear.study._dynamics import dynamics_of

    name = options.scene
    names = "shapes", "coordinates", "mesh_coordinates"
    given = [] if model == "scene" else model.split(":")
    told = [f"model.{x}={y}" for x, y in zip(names, given, strict=False)]
    scene = jg.example_scene(name, [*told, *options.set, "sweep.pinion_speed_rad_s=[1.0]"])
    scene, seconds = on_processor(lambda: jg.with_bodies(scene, moving=True))
    print(f"{name} {model}: bodies {seconds:.1f} s, {peak():.0f} MB", file=sys.stderr, flush=True)
    built = BuiltScene(scene)
    grid = built.grid_in_motion
    make: Any = eqx.filter_jit(lambda model: dynamics_of(model, grid, scene))
    make = make.lower(built.model).compile()
    method = jg.HarmonicBalance(harmonics=scene.sweep.harmonics)
    for relief in options.relief:
        relieved = jg.model_of(scene.replace(dict.fromkeys(FLANKS, relief)))
        pair, building = on_processor(lambda model=relieved: make(model))
        balance, preparing = on_processor(
            lambda pair=pair: harmonic_balance_problem(method, pair.system)
        )
        looked = looked_at(built, pair) if options.probes else None
        about = estimator(built, pair, method) if options.estimate else None
        size = pair.system.mass.shape[0]
        told = f"{building:.1f} s, {preparing:.1f} s, {peak():.0f} MB"
        print(f"  {relief:g} um: {size} degrees of freedom, {told}", file=sys.stderr, flush=True)
        solve = jax.jit(lambda balance, speed: method.solve(balance, speed)[0])
        solve = solve.lower(balance, jnp.asarray(1.0)).compile()
        for speed in options.speeds:
            at = jnp.asarray(float(speed))
            orbit, taken = on_processor(lambda at=at, b=balance, s=solve: s(b, at))
            loads = np.asarray(jg.bearing_loads(pair, orbit))[..., :3]
            error = jg.dynamic_transmission_error(pair.system, orbit)
            row = {
                "force": float(jg.dynamic_ratio(pair.system, orbit)),
                "te_rms": 1e6 * float(jg.orbit_rms(pair.system, error)),
                "bearing": float(np.linalg.norm(loads, axis=-1).max()),
                "settled": bool(orbit.settled),
                "dofs": size,
                "processor_s": taken,
            }
            if looked is not None:
                row |= shown(looked, pair, orbit, scene.sweep.orders)
            if about is not None:
                row |= about(speed, orbit)
            print(f"    {speed:g} rad/s: {row}", file=sys.stderr, flush=True)
            yield {f"{name} {model} {relief:g} {speed:g}": row}


def looked_at(built, pair) -> Any:
    """The wheel with probes along its axis: at the end of its rim, and in the middle of its web."""
    import dataclasses

    from jaxgear.study._body_waves import wave_watch
    from jaxgear.study._probes import probe_at

    found = wave_watch(built, pair).looked["wheel"]
    body, web = found.body, built.scene.wheel.body.web
    end = float(body.built.body.rim_nodes[:, 2].min())
    middle = 0.25e-3 * (web.hub_outer_mm + web.rim_inner_mm)
    between = math.pi / web.holes if web.holes else 0.0
    places = {"rim_um": (body.radius, 0.0, end), "web_um": (middle, between, 0.0)}
    probes = tuple(probe_at(body, at, 2, turns=True, name=x) for x, at in places.items())
    return dataclasses.replace(found, probes=probes)


def shown(looked, pair, orbit, orders: int) -> dict[str, float]:
    """RMS of such probes, and of waves of the rim, above half the order of the teeth [um]."""
    import numpy as np

    import jaxgear as jg
    from jaxgear._response._waves import order_sums

    moved = looked.moved(pair, orbit, jg.ExactContact(), orders)
    spectra = looked.probe_spectra(pair, orbit, moved, orders)
    span = [looked.low, (orders + 0.5) * looked.body.teeth]
    named = zip(looked.probes, spectra, strict=True)
    found = {probe.name: 1e6 * float(order_sums(each, span)[0]) for probe, each in named}
    waves = looked.waves(moved.modes.motion).by_diameter(looked.most, looked.low)
    number = np.abs(np.arange(-looked.most, looked.most + 1))
    for name, least in (("waves_um", 2), ("short_waves_um", 6)):
        found[name] = 1e6 * float(np.linalg.norm(waves[number >= least]))
    return found


def estimator(built, pair, method) -> Callable[[float, Any], dict[str, float]]:
    """What tells of a response at a speed about how far off its numbers are [%]."""
    import dataclasses

    from jaxgear import harmonic_balance_problem
    from jaxgear._dynamics._table import ready_to_bear
    from jaxgear.study._body_waves import wave_watch
    from jaxgear.study._shape_check import Again, judging_bodies, least_error

    wholes = judging_bodies(built.scene, wave_watch(built, pair))
    if wholes is None:
        sys.exit("No more natural modes were found than the bodies move on.")
    table = ready_to_bear(pair.system.table)
    system = dataclasses.replace(pair.system, table=table)
    pair, orders = dataclasses.replace(pair, system=system), built.scene.sweep.orders
    balance = harmonic_balance_problem(method, system)
    again = Again(method, pair, balance, wholes, orders, least_error(pair))

    def about(speed: float, orbit: Any) -> dict[str, float]:
        own = again.read(again.pair, orbit)
        better = again.better(speed, own[0])
        named = zip(("about_force", "about_te_rms"), own, better, strict=True)
        return {name: 100.0 * (few / many - 1.0) for name, few, many in named}

    return about


def on_processor(work) -> tuple[Any, float]:
    """What some work gives, and the processor seconds that it takes."""
    import jax

    start = time.process_time()
    found = jax.block_until_ready(work())
    return found, time.process_time() - start


class Line(NamedTuple):
    """Errors of a model over speeds against that of most coordinates [%], and its cost.

    **Fields:**

    - `case`: scene and relief.
    - `model`: kind and number of shapes.
    - `errors`: by number, over speeds.
    - `seconds`: of a processor for one speed, median.
    - `against`: degrees of freedom of what it is compared with.
    """

    case: str
    model: str
    errors: dict[str, Any]
    seconds: float
    against: tuple[int, ...]

    @property
    def words(self) -> str:
        """The line in words: errors at the median speed, at 95 % of the speeds and the worst."""
        told = ", ".join(
            f"{words} {' / '.join(f'{x:.2f}' for x in _spread(self.errors[key]))}"
            for key, words in NUMBERS.items()
            if key in self.errors
        )
        count = len(self.errors["force"])
        return (
            f"{self.case}, {self.model}: {told} %; {self.seconds:.2f} s a speed; {count} speeds "
            f"against {' and '.join(map(str, self.against))} degrees of freedom"
        )


def _spread(errors: list[float]) -> tuple[float, float, float]:
    """The median, what 95 % keep, and the largest."""
    kept = sorted(errors)[-(-95 * len(errors) // 100) - 1]
    return statistics.median(errors), kept, max(errors)


def compared(rows: dict[str, Any]) -> list[Line]:
    """All models against that of most coordinates at the same speed, scene and relief."""
    settled = {tuple(key.split()): row for key, row in rows.items() if row["settled"]}
    found = []
    for name, relief in dict.fromkeys((key[0], key[2]) for key in settled):
        own = {(k[1], k[3]): row for k, row in settled.items() if (k[0], k[2]) == (name, relief)}
        best: dict[str, Any] = {}
        for (_, speed), row in own.items():
            best[speed] = max(best.get(speed, row), row, key=lambda each: each["dofs"])
        for model in dict.fromkeys(model for model, _ in own):
            rows_of = {speed: row for (each, speed), row in own.items() if each == model}
            # A reference that is hardly richer says little.
            judged = [
                (row, best[speed])
                for speed, row in rows_of.items()
                if best[speed]["dofs"] > 1.5 * row["dofs"]
            ]
            if not judged:
                continue
            told = [key for key in NUMBERS if all(key in row for pair in judged for row in pair)]
            off = lambda key, row, by: 100.0 * abs(row[key] / by[key] - 1.0)
            found.append(
                Line(
                    case=f"{name}, {relief} um",
                    model=model,
                    errors={key: [off(key, *pair) for pair in judged] for key in told},
                    seconds=statistics.median(row["processor_s"] for row, _ in judged),
                    against=tuple(sorted({by["dofs"] for _, by in judged})),
                )
            )
    return found


def chart(lines: list[Line], path: Path) -> None:
    """Largest errors of mesh force and RMS of TE against processor time, by scene and relief."""
    import matplotlib.pyplot as plt
    import numpy as np
    from matplotlib.ticker import FixedLocator, NullLocator

    cases = sorted({line.case for line in lines})
    shown = "force", "te_rms"
    figure, axes = plt.subplots(
        2, len(cases), figsize=(3.0 * len(cases), 5.8), sharex=True, sharey=True, squeeze=False
    )
    for (row, column), axis in np.ndenumerate(axes):
        key, own = shown[row], [line for line in lines if line.case == cases[column]]
        for kind, marker in (("natural", "o-"), ("excited", "s"), ("scene", "r*")):
            some = sorted((x for x in own if x.model.startswith(kind)), key=lambda x: x.seconds)
            worst = [max(x.errors[key]) for x in some]
            label = "default" if kind == "scene" else kind
            axis.loglog([x.seconds for x in some], worst, marker, label=label)
            for x, error in zip(some, worst, strict=True):
                axis.annotate(
                    "".join(x.model.split(":")[1:2]),
                    (x.seconds, error),
                    xytext=(4, 4),
                    textcoords="offset points",
                    fontsize=8,
                )
        axis.grid(which="both", alpha=0.3)
        if row == 0:
            axis.set_title(cases[column], fontsize=9)
        else:
            axis.set_xlabel("processor time of a speed [s]", fontsize=8)
        if column == 0:
            axis.set_ylabel(f"largest error, {NUMBERS[key]} [%]", fontsize=8)
    plain = lambda value, _: f"{value:g}"
    for axis, places in (
        (axes[0][0].xaxis, [0.05, 0.2, 1.0, 5.0]),
        (axes[0][0].yaxis, [0.01, 0.1, 1, 10]),
    ):
        axis.set_major_locator(FixedLocator(places))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(plain)
    axes[0][0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    print(f"written to {path}")


if __name__ == "__main__":
    main()
