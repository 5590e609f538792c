"""What flexible gear bodies change in a mesh, beside what Guilbert (2017) found.

    python benchmarks/hybrid_trends.py [--only NAME ...] [--out DIR] [--list]

One table for each finding, over a few web geometries: the drawings of the thesis are not in its
text, so that these are trends and not its numbers. Under each table stands which of its statements
hold. Every body takes most of a minute the first time and comes from the cache after that; all of
them together a quarter of an hour. Writes `hybrid_trends.json`.
"""

import argparse
import functools
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# Before NumPy is imported: bodies take several times as long on threads that wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
from jaxgear._response._factors import face_load
from jaxgear._response._loads import hertz_pressure, line_load
from jaxgear._response._transmission import cycle_rms, transmission_error
from jaxgear._solve._cycle import MeshCycle, corrected_cycle, mesh_cycle, prepare_mesh
from jaxgear._system._body_tables import teeth_on_lines
from jaxgear._system._model import PairModel
from jaxgear._system._structure import bearing_motion
from jaxgear.scene._build import grid_of, model_of
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.scene._scene import Scene, ready_scene
from jaxgear.study._statics import headline

um, mm, MPa, deg = 1e-6, 1e-3, 1e6, math.pi / 180.0
# Of a rigid body, and of a rigid shaft of beams: times steel's.
STIFF_GPA = 4e5
# What gives under the teeth of the thesis's rigid gears; by itself a ready scene takes the ring.
THESIS = "mesh.foundation=weber"
LAW = jg.ExactContact()


@dataclass
class Finding:
    """A table, and what it says.

    **Fields:**

    - `title`: what it is of.
    - `thesis`: what the thesis says.
    - `columns`: names, with units.
    - `rows`: one list for each row.
    - `holds`: statements, and whether they do.
    """

    title: str
    thesis: str
    columns: list[str]
    rows: list[list[Any]] = field(default_factory=list)
    holds: dict[str, bool] = field(default_factory=dict)

    def told(self) -> str:
        """The table as text."""
        cells = [self.columns, *([_cell(x) for x in row] for row in self.rows)]
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        lines = [f"\n{self.title}", f"  thesis: {self.thesis}"]
        for row in cells:
            first = f"  {row[0]:<{widths[0]}}"
            rest = zip(row[1:], widths[1:], strict=True)
            lines.append("  ".join([first, *(f"{text:>{width}}" for text, width in rest)]))
        lines += [f"  {'yes' if ok else 'NO ':<3} {what}" for what, ok in self.holds.items()]
        return "\n".join(lines)


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    return "-" if value is None else f"{value:.4g}"


# --- Solving


@dataclass(frozen=True)
class Solved:
    """A pair's settled mesh cycle, and what is read from it.

    **Fields:**

    - `model`, `grid`, `cycle`: what was solved.
    - `error`: transmission error at each phase [um].
    - `crest`: largest line load at each slice [N/mm].
    - `face`: mean load at each slice [N/mm].
    - `heights`: of the slices from mid-face [mm].
    - `numbers`: of the summary.
    - `bearings`: mean load along S and T of each bearing, the pinion's first [N].
    """

    model: PairModel
    grid: jg.MeshGrid
    cycle: MeshCycle
    error: np.ndarray
    crest: np.ndarray
    face: np.ndarray
    heights: np.ndarray
    numbers: dict[str, float]
    bearings: np.ndarray

    @property
    def mean(self) -> float:
        """Mean of the transmission error [um]."""
        return self.numbers["te_mean_um"]

    @property
    def rms(self) -> float:
        """RMS of its fluctuation [um]."""
        return self.numbers["te_rms_um"]

    @property
    def highest(self) -> float:
        """Where across the face the line load is largest [mm]."""
        return float(self.heights[int(np.argmax(self.crest))])

    @property
    def centre(self) -> float:
        """Centre of the load across the face, over half the face [-]."""
        half = 0.5 * float(self.model.pair.face_width) / mm
        return float(self.heights @ self.face / self.face.sum() / half)

    @property
    def edges(self) -> tuple[float, float]:
        """Mean load at the left and the right end of the face, over its mean [-]."""
        relative = self.face / self.face.mean()
        return float(relative[0]), float(relative[-1])


# Not kept: a body's matrices take up to 300 MB.
def scene_of(name: str, *settings: str) -> Scene:
    """A ready scene with its bodies.

    Statics of rim and seats, rotation too, is exact without any modes of the inside, and bodies
    without them are made in a fraction of the time.
    """
    scene = ready_scene(name, [THESIS, *settings])
    less = ("interface=guyan", "modes=0", "compare_seats=false")
    quick = [
        f"{gear}.body.{each}"
        for gear in ("pinion", "wheel")
        for each in less
        if scene.value(f"{gear}.body.kind") == "condensed"
    ]
    return with_bodies(ready_scene(name, [THESIS, *settings, *quick]))


@functools.cache
def solved(name: str, *settings: str) -> Solved:
    """A ready scene with changes, solved."""
    scene = scene_of(name, *settings)
    model = model_of(scene)
    return solved_model(model, grid_of(scene, model))


def solved_model(model: PairModel, grid: jg.MeshGrid) -> Solved:
    """A model, solved."""
    cycle, numbers, crest, face, error, bearings = _solve(model, grid)
    assert bool(jnp.all(cycle.converged)), "the contact was not solved at some phase"
    return Solved(
        model=model,
        grid=grid,
        cycle=cycle,
        error=np.asarray(error) / um,
        crest=np.asarray(crest) * mm,
        face=np.asarray(face) * mm,
        heights=np.asarray(cycle.cells.lines.face_position) / mm,
        numbers={key: float(value) for key, value in numbers.items()},
        bearings=np.asarray(bearings),
    )


@jax.jit
def _solve(model: PairModel, grid: jg.MeshGrid):
    cycle = mesh_cycle(model, grid, law=LAW, throw=False)
    crest = jnp.max(line_load(cycle, LAW), axis=(0, 1))
    mean = (cycle.cells.lines.weight @ cycle.load)[None, :]
    motion = bearing_motion(cycle.system.structure, cycle.system.displacement(mean)[0])
    return (
        cycle,
        headline(model, cycle, LAW),
        crest,
        face_load(model.pair, cycle),
        transmission_error(model.pair, cycle),
        motion.load[:, :2],
    )


@jax.jit
def _variances(model: PairModel, grid: jg.MeshGrid, depths, extent):
    """Variance of the transmission error over the depth of a symmetric relief [m2]."""
    prepared = prepare_mesh(model, grid)

    def at(depth):
        relief = jg.TipRelief(depth, extent)
        relieved = eqx.tree_at(lambda m: m.flanks, model, jg.Flanks(relief, relief))
        cycle = corrected_cycle(prepared, relieved, law=LAW)
        return cycle_rms(cycle, transmission_error(model.pair, cycle)) ** 2

    # One after the other: see the library's note on batches of factorisations.
    return jax.lax.map(at, depths)


def best_depth(scene: Scene, extent: float, most: float) -> tuple[float, float, float]:
    """The depth of relief with the least RMS at an extent.

    **Arguments:**

    - `scene`: with its bodies.
    - `extent`: of both gears' relief [-].
    - `most`: largest depth [um].

    **Returns:**

    The depth, RMS there and RMS without relief [um].
    """
    model = model_of(scene)
    # Plain flanks, so that all scenes of one kind share a compiled program.
    model = eqx.tree_at(lambda m: m.flanks, model, jg.Flanks())
    depths = np.linspace(0.0, most, 41)
    grid = grid_of(scene, model)
    found = np.asarray(_variances(model, grid, jnp.asarray(depths * um), jnp.asarray(extent)))
    found = found / um**2
    at = int(np.clip(np.argmin(found), 1, len(depths) - 2))
    # The variance is a parabola of the depth, as long as no other teeth come into contact.
    a, b, c = np.polyfit(depths[at - 1 : at + 2], found[at - 1 : at + 2], 2)
    best = float(np.clip(-0.5 * b / a, depths[at - 1], depths[at + 1]))
    least = max(float(np.polyval([a, b, c], best)), 0.0)
    return best, math.sqrt(least), math.sqrt(float(found[0]))


# --- Scenes


def web(gear: str = "wheel", /, **measures: float) -> list[str]:
    """Settings of a web."""
    return [f"{gear}.body.web.{key}={value}" for key, value in measures.items()]


def rigid_body(gear: str) -> str:
    """Setting that makes a condensed body rigid."""
    return f"{gear}.body.young_GPa={STIFF_GPA:g}"


def helical(base_helix: float) -> list[str]:
    """Settings of the accessory pair with a helix, the rim as thick as without."""
    if base_helix == 0.0:
        return []
    helix = math.asin(math.sin(base_helix * deg) / math.cos(25.0 * deg)) / deg
    settings = [f"pair.helix_angle_deg={helix:.6f}"]
    thickness = 0.5 * (126.863 - 118.0)
    root = float(model_of(ready_scene("accessory", settings)).pair.root_radius[1]) / mm
    return [*settings, *web(rim_inner_mm=round(2.0 * (root - thickness), 3))]


def only_pair(settings: Sequence[str]) -> list[str]:
    """What of settings a scene with rigid bodies takes."""
    return [each for each in settings if ".body." not in each]


def with_rigid_shaft(model: PairModel, *gears: str) -> PairModel:
    """A model whose shafts of some gears do not bend; their teeth stay as they are."""
    for gear in gears:
        where: Callable[[PairModel], Any] = lambda m, g=gear: (
            getattr(m, f"{g}_support").material.young
        )
        model = eqx.tree_at(where, model, where(model) * (STIFF_GPA / 206.0))
    return model


# --- Findings


def transmission() -> Finding:
    """Tab. III-4: mean and RMS of the transmission error."""
    found = Finding(
        "Transmission error of the accessory pair (Tab. III-4, Fig. III-8)",
        "RMS 2.92 um initial; H1 2.36 rigid, 2.33 flexible; H2 1.79 rigid, 1.80 flexible; "
        "mean from 19 to 41 um",
        ["model", "mean um", "RMS um", "peak to peak um", "RMS over initial"],
    )
    none = "wheel.foundation=none"
    cases = {
        "rigid bodies, own foundations": ("accessory",),
        "  without the wheel's": ("accessory", none),
        "  without both": ("accessory", "mesh.foundation=none"),
        "H1 rigidified": ("accessory-h1", rigid_body("wheel")),
        "H1, web 5 mm": ("accessory-h1", *web(web_thickness_mm=5.0)),
        "H1, web 3 mm": ("accessory-h1",),
        "H1, web 2 mm": ("accessory-h1", *web(web_thickness_mm=2.0)),
        "H2 rigidified": ("accessory-h2", rigid_body("pinion"), rigid_body("wheel")),
        "H2, solid pinion": ("accessory-h2",),
        "H2, webbed pinion": ("accessory-h2", *WEBBED),
    }
    all_of = {name: solved(*case) for name, case in cases.items()}
    initial = all_of["rigid bodies, own foundations"]
    for name, each in all_of.items():
        peak = each.numbers["te_peak_to_peak_um"]
        found.rows.append([name, each.mean, each.rms, peak, each.rms / initial.rms])
    h1 = [all_of[f"H1, web {t} mm"] for t in (5, 3, 2)]
    h2 = all_of["H2, solid pinion"]
    bare, barer = all_of["  without the wheel's"], all_of["  without both"]
    found.holds = {
        "a flexible wheel raises the mean over the rigid pair with its foundations": all(
            each.mean > initial.mean for each in h1
        ),
        "... and more, the thinner its web": h1[0].mean < h1[1].mean < h1[2].mean,
        "a flexible pinion as well raises it further": h2.mean > h1[1].mean,
        "a webbed pinion raises it further": all_of["H2, webbed pinion"].mean > h2.mean,
        "RMS falls from the initial model to H1 flexible": h1[1].rms < initial.rms,
        "RMS falls from H1 to H2, both flexible": h2.rms < h1[1].rms,
        "RMS of H1 hardly depends on the web (within 5 %)": np.ptp([x.rms for x in h1])
        < 0.05 * h1[1].rms,
        "RMS of H1: flexible within 2 % of rigidified, as the thesis has it": abs(
            h1[1].rms / all_of["H1 rigidified"].rms - 1.0
        )
        < 0.02,
        "RMS of H1 flexible lies above the rigid pair without the wheel's foundation": h1[1].rms
        > bare.rms,
        "RMS of H2 flexible lies above the rigid pair without foundations": h2.rms > barer.rms,
    }
    return found


WEBBED = web("pinion", hub_outer_mm=36.0, web_thickness_mm=3.5, rim_inner_mm=56.0)


def rigidified() -> Finding:
    """Rigidified hybrids against rigid bodies without foundations, on stiff shafts."""
    found = Finding(
        "Rigidified bodies against rigid ones without their foundation, on as stiff shafts",
        "all models give similar results; largest difference of the line load 3.5 %",
        ["pair", "young GPa", "mean um", "mean %", "RMS %", "load %", "bearings %"],
    )
    cases = [
        ("accessory", "h1", ("wheel",), STIFF_GPA),
        ("accessory", "h1", ("wheel",), 10.0 * STIFF_GPA),
        ("accessory", "h2", ("pinion", "wheel"), STIFF_GPA),
        ("power", "h1", ("wheel",), STIFF_GPA),
        ("power", "h2", ("pinion", "wheel"), STIFF_GPA),
    ]
    within: dict[tuple[str, str, float], float] = {}
    for name, kind, gears, young in cases:
        stiff = [f"{gear}.body.young_GPa={young:g}" for gear in gears]
        hybrid = solved(f"{name}-{kind}", *stiff)
        scene = ready_scene(name, [THESIS, *(f"{gear}.foundation=none" for gear in gears)])
        model = with_rigid_shaft(model_of(scene), *gears)
        rigid = solved_model(model, grid_of(scene, model))
        off = [
            hybrid.mean / rigid.mean - 1.0,
            hybrid.rms / rigid.rms - 1.0,
            np.abs(hybrid.crest - rigid.crest).max() / rigid.crest.max(),
            np.abs(hybrid.bearings - rigid.bearings).max() / np.abs(rigid.bearings).max(),
        ]
        within[name, kind, young] = float(np.abs(off).max())
        label = f"{name} {kind.upper()}"
        found.rows.append([label, young, hybrid.mean, *(100.0 * float(each) for each in off)])
    for (name, kind, young), worst in within.items():
        if young == STIFF_GPA:
            found.holds[f"{name} {kind.upper()} within 1 %"] = worst < 0.01
    return found


def master_curve() -> Finding:
    """Fig. III-9, IV-2 and IV-16: where the best relief lies."""
    found = Finding(
        "Depth of the best symmetric tip relief at given extents (Fig. III-9, IV-2, IV-16)",
        "stays on the rigid pair's Master Curve with a centred straight web and spur teeth; moves "
        "to deeper relief with helical teeth, and with a webbed pinion",
        ["pair", "extent", "rigid um", "flexible um", "ratio", "RMS least", "RMS plain"],
    )
    spur = {
        "spur, web 5 mm": ("accessory-h1", web(web_thickness_mm=5.0)),
        "spur, web 3 mm": ("accessory-h1", []),
        "spur, web 2 mm": ("accessory-h1", web(web_thickness_mm=2.0)),
    }
    others = {
        "spur, H2": ("accessory-h2", []),
        "spur, H2, webbed pinion": ("accessory-h2", WEBBED),
        "base helix 10 deg": ("accessory-h1", helical(10.0)),
        "base helix 20 deg": ("accessory-h1", helical(20.0)),
    }
    ratios: dict[str, list[float]] = {}
    for label, (name, settings) in (spur | others).items():
        scene = scene_of(name, *settings)
        rigid = ready_scene("accessory", [THESIS, *only_pair(settings)])
        for extent in (0.2, 0.25, 0.29):
            own = best_depth(rigid, extent, 60.0)
            depth, least, plain = best_depth(scene, extent, 60.0)
            ratios.setdefault(label, []).append(depth / own[0])
            found.rows.append([label, extent, own[0], depth, depth / own[0], least, plain])
    stays = all(abs(ratio - 1.0) < 0.1 for label in spur for ratio in ratios[label])
    found.holds = {
        "spur, centred straight web: the depth stays within 10 % of the rigid pair's": stays,
        **{
            f"{label}: deeper than the rigid pair's at every extent": min(ratios[label]) > 1.0
            for label in others
            if label != "spur, H2"
        },
        "webbed pinion: deeper than with a solid one": all(
            a > b
            for a, b in zip(ratios["spur, H2, webbed pinion"], ratios["spur, H2"], strict=True)
        ),
    }
    return found


def junction(measures: dict[str, float]) -> float:
    """Middle of a web where it meets the rim, from mid-face [mm]."""
    lean = math.tan(measures.get("web_angle_deg", 0.0) * deg)
    reach = 0.25 * (measures["rim_inner_mm"] - measures["hub_outer_mm"])
    return measures.get("web_offset_mm", 0.0) + lean * reach


_POWER_WEB = {"hub_outer_mm": 64.0, "rim_inner_mm": 152.0}
_ACCESSORY_WEB = {"hub_outer_mm": 50.0, "rim_inner_mm": 118.0}
POWER_WEBS = {
    "leaning left": {"web_offset_mm": -2.0, "web_angle_deg": -30.0},
    "leaning right": {"web_offset_mm": 2.0, "web_angle_deg": 30.0},
    "straight, left": {"web_offset_mm": -10.0, "web_angle_deg": 0.0},
    "straight, centred": {"web_offset_mm": 0.0, "web_angle_deg": 0.0},
    "straight, right": {"web_offset_mm": 10.0, "web_angle_deg": 0.0},
}


def web_junction() -> Finding:
    """Fig. III-17: where the line load is largest."""
    found = Finding(
        "Where the line load is largest across the face (Fig. III-17)",
        "the position of the maximum load is just above the web-rim connection",
        [
            "pair, hand and web",
            "junction mm",
            "rigid at mm",
            "flexible at mm",
            "off a line at mm",
            "rigid N/mm",
            "flexible N/mm",
        ],
    )
    cases: list[tuple[str, str, list[str], dict[str, float]]] = [
        (f"power, {hand}, {label}", "power", settings, _POWER_WEB | measures)
        for hand, settings in (("right", []), ("left", ["pair.helix_angle_deg=-12"]))
        for label, measures in POWER_WEBS.items()
    ]
    cases += [
        (f"accessory, {at:g} mm off", "accessory", [], _ACCESSORY_WEB | {"web_offset_mm": at})
        for at in (0.0, 3.0)
    ]
    highest: dict[str, list[bool]] = {"power": [], "accessory": []}
    bulges: dict[str, list[bool]] = {"power": [], "accessory": []}
    raised = []
    for label, name, settings, measures in cases:
        rigid = solved(name, *settings)
        flexible = solved(f"{name}-h1", *settings, *web(**measures))
        at, near = junction(measures), 0.15 * float(rigid.model.pair.face_width) / mm
        # Thrust and shafts tilt the teeth: a straight line across the face is theirs.
        line = np.polyval(np.polyfit(flexible.heights, flexible.crest, 1), flexible.heights)
        bulge = float(flexible.heights[int(np.argmax(flexible.crest - line))])
        largest = float(rigid.crest.max()), float(flexible.crest.max())
        found.rows.append([label, at, rigid.highest, flexible.highest, bulge, *largest])
        highest[name].append(abs(flexible.highest - at) < near)
        bulges[name].append(abs(bulge - at) < near)
        raised.append(largest[1] > largest[0])
    found.holds = {
        "power: the maximum lies within 0.15 faces of the junction": all(highest["power"]),
        "power: off a straight line the load is largest there": all(bulges["power"]),
        "accessory: the maximum lies there": all(highest["accessory"]),
        "the maximum is higher than with rigid bodies": all(raised),
    }
    return found


def bearing_loads() -> Finding:
    """Tab. III-6 to III-8: bearings of the power pair."""
    found = Finding(
        "Bearing loads of the power pair (Tab. III-7 and III-8)",
        "wheel, H1, S and T: rigid 798 4243, 1611 1931, 1095 656; flexible 756 4210, 1832 2173, "
        "915 446: the bearing close to the web takes more, the end of the shaft less",
        ["model", *(f"B{i} {axis}" for i in (1, 2, 3) for axis in "ST"), "pinion B1", "B2"],
    )
    cases = {
        "rigid bodies": ("power",),
        "H1 rigidified": ("power-h1", rigid_body("wheel")),
        **{
            f"H1, {label}": ("power-h1", *web(**measures)) for label, measures in POWER_WEBS.items()
        },
        "H2 rigidified": ("power-h2", rigid_body("pinion"), rigid_body("wheel")),
        "H2": ("power-h2",),
        "webbed pinion": ("power-webbed-pinion",),
    }
    all_of = {label: solved(*case) for label, case in cases.items()}
    size = {}
    for label, each in all_of.items():
        size[label] = np.linalg.norm(each.bearings, axis=1)
        pinion = size[label][:2]
        found.rows.append([label, *map(float, each.bearings[2:].ravel()), *map(float, pinion)])
    stiff, flexible = size["H1 rigidified"][2:], size["H1, leaning left"][2:]
    sums = [each.bearings[2:].sum(axis=0) for each in all_of.values()]
    whole = sums[0]
    found.holds = {
        "the loads of all models add up to the same": bool(
            np.abs(np.asarray(sums) - whole).max() < 1e-3 * np.linalg.norm(whole)
        ),
        "web leaning left: B2 takes more than with a rigid body": flexible[1] > stiff[1],
        "web leaning left: B3, at the end, takes less": flexible[2] < stiff[2],
        "B2 takes more with the web on its side than on the other": flexible[1]
        > size["H1, leaning right"][3],
        "... with straight webs too": size["H1, straight, left"][3]
        > size["H1, straight, right"][3],
    }
    return found


def helix() -> Finding:
    """Fig. IV-1: the load across the face of helical gears on a straight web."""
    found = Finding(
        "Load across the face with growing helix, straight centred web (Fig. IV-1)",
        "the contact is misaligned by the axial thrust, more as the helix grows; one edge is "
        "overloaded and the other unloaded",
        ["base helix deg", "model", "left edge", "right edge", "largest/mean", "centre"],
    )
    overload: dict[str, list[float]] = {"rigid": [], "flexible": []}
    for angle in (0.0, 10.0, 20.0):
        settings = helical(angle)
        pairs = {
            "rigid": solved("accessory", *only_pair(settings)),
            "flexible": solved("accessory-h1", *settings),
        }
        for label, each in pairs.items():
            factor = each.numbers["face_load_factor"]
            found.rows.append([angle, label, *each.edges, factor, each.centre])
            overload[label].append(each.centre)
    moved = np.abs(np.asarray(overload["flexible"]) - np.asarray(overload["rigid"]))
    last = found.rows[-1]
    found.holds = {
        "the web moves the centre of the load more, the larger the helix": bool(
            np.all(np.diff(moved) > 0.0)
        ),
        "at 20 deg one edge carries over 1.3 of the mean, the other under 0.7": max(last[2:4]) > 1.3
        and min(last[2:4]) < 0.7,
        "... and neither does with a rigid wheel": max(found.rows[-2][2:4]) < 1.3,
    }
    return found


def rotation() -> Finding:
    """Fig. III-25, III-26 and IV-34: load by rotation, and what re-centres it."""
    found = Finding(
        "Load across the face with rotation (Fig. III-25, III-26, IV-32, IV-34)",
        "at 3000 rad/s the side away from the web is overloaded; 10 um of linear relief over 0.4 "
        "of the face on that side centre the load again",
        ["web", "speed rad/s", "relief", "left edge", "right edge", "centre", "largest N/mm"],
    )
    ends = {
        "right": "flank.pinion.end_relief.side=right",
        "left": "flank.pinion.end_relief.side=left",
    }
    cases: list[tuple[str, float, str]] = []
    for label in ("leaning left", "leaning right", "straight, centred"):
        cases += [(label, speed, "none") for speed in (0.0, 1100.0, 3000.0)]
    for label in ("leaning left", "leaning right"):
        cases += [(label, 3000.0, "end 5"), (label, 3000.0, "end 10"), (label, 3000.0, "crown 10")]
    all_of = {}
    for label, speed, relief in cases:
        far = "left" if label == "leaning right" else "right"
        settings = [*web(**POWER_WEBS[label]), f"mesh.pinion_speed_rad_s={speed:g}"]
        kind, _, depth = relief.partition(" ")
        if kind == "end":
            settings += [ends[far], f"flank.pinion.end_relief.depth_um={depth}"]
            settings += ["flank.pinion.end_relief.extent=0.4"]
        elif kind == "crown":
            settings.append(f"flank.pinion.crowning_um={depth}")
        each = all_of[label, speed, relief] = solved("power-h1", *settings)
        told = f"{relief} um, {far}" if kind == "end" else relief
        largest = float(each.crest.max())
        found.rows.append([label, speed, told, *each.edges, each.centre, largest])
    still, fast = (all_of["leaning left", speed, "none"] for speed in (0.0, 3000.0))
    mirrored = [all_of["leaning right", speed, "none"].centre for speed in (0.0, 3000.0)]
    level = [all_of["straight, centred", speed, "none"].centre for speed in (0.0, 3000.0)]
    eased = [all_of["leaning left", 3000.0, relief] for relief in ("end 5", "end 10", "crown 10")]
    found.holds = {
        "web leaning left: rotation moves the load to the right, away from the web": fast.centre
        > still.centre + 0.02,
        "web leaning right: to the left": mirrored[1] < mirrored[0] - 0.02,
        "straight centred web: hardly (less than a fifth of that)": abs(level[1] - level[0])
        < 0.2 * (fast.centre - still.centre),
        "the overload grows with the speed": all_of["leaning left", 1100.0, "none"].centre
        < fast.centre,
        "5 or 10 um of end relief bring the centre nearer to mid-face": min(
            abs(x.centre) for x in eased[:2]
        )
        < 0.5 * abs(fast.centre),
        "crowning takes the load off the edges": max(eased[2].edges) < max(fast.edges),
    }
    return found


HOLES = {
    "B": [],
    "A": web(hole_diameter_mm=29.0, hole_circle_mm=100.0),
    "C": web(second_holes=6, second_hole_diameter_mm=18.0, second_hole_circle_mm=88.0),
}


def holes(cases: Sequence[str] = ("B", "A", "C")) -> Finding:
    """Fig. IV-28 to IV-32: teeth above a hole and between holes."""
    found = Finding(
        "Teeth above a hole and between holes (Fig. IV-28 to IV-32)",
        "contact pressures above a hole are slightly better distributed; no real influence of the "
        "holes on tooth loading; the holes' passing shows at 6/68 of the mesh, most in case B",
        [
            "case",
            "speed rad/s",
            "tooth",
            "largest N/mm",
            "largest MPa",
            "largest/mean",
            "TE mean um",
            "TE RMS um",
            "passing um",
        ],
    )
    spread, passing, differs = {}, {}, []
    for case in cases:
        for speed in (0.0, 3000.0):
            settings = [*HOLES[case], f"mesh.pinion_speed_rad_s={speed:g}"]
            each = solved("power-holes", *settings)
            amplitude = 2.0 * float(np.abs(np.fft.rfft(each.error))[3]) / len(each.error)
            passing[case, speed] = amplitude
            rows = tooth_rows(each)
            for where, row in rows.items():
                found.rows.append([case, speed, where, *row, each.mean, each.rms, amplitude])
            spread[case, speed] = rows["above"][2] - rows["between"][2]
            differs.append(abs(rows["above"][1] / rows["between"][1] - 1.0))
    found.holds = {
        "pressures of the two differ by less than 10 %": max(differs) < 0.1,
        "at rest the load is more even above a hole": all(
            value < 0.0 for (_, speed), value in spread.items() if speed == 0.0
        ),
        "at 3000 rad/s too": all(
            value < 0.0 for (_, speed), value in spread.items() if speed > 0.0
        ),
    }
    if {"A", "B"} <= set(cases):
        found.holds["the holes' passing shows more in case B than in A"] = (
            passing["B", 0.0] > passing["A", 0.0]
        )
    if {"B", "C"} <= set(cases):
        found.holds["... and less in case C than in B"] = passing["C", 0.0] < passing["B", 0.0]
    return found


def tooth_rows(each: Solved) -> dict[str, list[float]]:
    """Of the wheel's teeth above a hole and between holes: largest line load and pressure.

    **Arguments:**

    - `each`: of a wheel with six holes, one above tooth 0, over half a revolution.

    **Returns:**

    Largest line load [N/mm] and pressure [MPa] on its way through the mesh, and the largest over
    the mean load across its face [-].
    """
    lines, pair = each.cycle.cells.lines, each.model.pair
    periods, teeth = lines.periods, pair.wheel.teeth
    load = np.asarray(jax.jit(line_load)(each.cycle, LAW)) * mm
    pressure = np.asarray(jax.jit(hertz_pressure)(pair, each.cycle, LAW)) / MPa
    force = np.asarray(each.cycle.force).reshape(load.shape)
    tooth = teeth_on_lines(1, each.grid, periods) % periods
    split = lambda x: x.reshape(periods, -1, *x.shape[1:])
    load, pressure, force = split(load), split(pressure), split(force)
    # Where a tooth stands between two holes: 0 above one, 30 between two.
    turn = np.arange(periods) * 360.0 / teeth
    apart = np.abs((turn + 30.0) % 60.0 - 30.0)
    rows = {}
    for where, chosen in (("above", apart < 6.0), ("between", apart > 24.0)):
        values = []
        for number in np.flatnonzero(chosen):
            period, line = np.nonzero(tooth == number)
            own = [x[period, :, line] for x in (load, pressure, force)]
            across = own[2].sum(axis=(0, 1))
            values.append([own[0].max(), own[1].max(), across.max() / across.mean()])
        rows[where] = [float(x) for x in np.mean(values, axis=0)]
    return rows


FINDINGS: dict[str, Callable[[], Finding]] = {
    "transmission": transmission,
    "rigidified": rigidified,
    "master-curve": master_curve,
    "web-junction": web_junction,
    "bearings": bearing_loads,
    "helix": helix,
    "rotation": rotation,
    "holes": holes,
}


def tell(findings: Mapping[str, Callable[[], Finding]], description: str, name: str) -> Path | None:
    """Print the tables that the command line asks for, and keep them in a file.

    **Arguments:**

    - `findings`: by name.
    - `description`: of the script.
    - `name`: of the file, without its ending.

    **Returns:**

    The folder of the file; `None` if nothing was asked for.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--only", nargs="*", choices=findings, metavar="NAME", help="some tables")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--list", action="store_true", help="print the names of the tables")
    options = parser.parse_args()
    if options.list:
        print("\n".join(findings))
        return None
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    report = {}
    for which in options.only or findings:
        start = time.perf_counter()
        found = findings[which]()
        print(found.told(), f"\n  ({time.perf_counter() - start:.0f} s)", flush=True)
        report[which] = {
            "title": found.title,
            "thesis": found.thesis,
            "columns": found.columns,
            "rows": found.rows,
            "holds": {what: bool(ok) for what, ok in found.holds.items()},
        }
        (options.out / f"{name}.json").write_text(json.dumps(report, indent=2) + "\n")
    print(f"\nwritten to {options.out}")
    return options.out


if __name__ == "__main__":
    tell(FINDINGS, "What flexible gear bodies change in a mesh.", "hybrid_trends")
