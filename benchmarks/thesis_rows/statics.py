"""Example scenes with changes, solved at rest or with centrifugal load."""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
from jaxgear import (
    MeshCycle,
    PairModel,
    Scene,
    bearing_motion,
    corrected_cycle,
    cycle_rms,
    example_scene,
    face_load,
    grid_of,
    line_load,
    mesh_cycle,
    model_of,
    prepare_mesh,
    transmission_error,
)
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.study._statics import headline

um, mm, MPa, deg = 1e-6, 1e-3, 1e6, math.pi / 180.0
# Of a rigid body, and of a rigid shaft of beams: times steel's.
STIFF_GPA = 4e5
# What gives under the teeth of the thesis's rigid gears; by itself an example scene takes the ring.
THESIS = "mesh.foundation=weber", "mesh.face_coupling=none"
LAW = jg.ExactContact()


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
    """An example scene with its bodies.

    Statics of rim and seats, rotation too, is exact without any modes of the inside, and bodies
    without them are made in a fraction of the time.
    """
    scene = example_scene(name, [*THESIS, *settings])
    less = ("interface=guyan", "modes=0", "compare_seats=false")
    quick = [
        f"{gear}.body.{each}"
        for gear in ("pinion", "wheel")
        for each in less
        if scene.value(f"{gear}.body.kind") == "condensed"
    ]
    return with_bodies(example_scene(name, [*THESIS, *settings, *quick]))


@functools.cache
def solved(name: str, *settings: str) -> Solved:
    """An example scene with changes, solved."""
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
    root = float(model_of(example_scene("accessory", settings)).pair.root_radius[1]) / mm
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


WEBBED = web("pinion", hub_outer_mm=36.0, web_thickness_mm=3.5, rim_inner_mm=56.0)
POWER_WEBS = {
    "leaning left": {"web_offset_mm": -2.0, "web_angle_deg": -30.0},
    "leaning right": {"web_offset_mm": 2.0, "web_angle_deg": 30.0},
    "straight, left": {"web_offset_mm": -10.0, "web_angle_deg": 0.0},
    "straight, centred": {"web_offset_mm": 0.0, "web_angle_deg": 0.0},
    "straight, right": {"web_offset_mm": 10.0, "web_angle_deg": 0.0},
}
