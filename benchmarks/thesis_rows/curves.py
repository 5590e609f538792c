"""Master Curves traced from rigid to flexible pairs, coarsely: 10 slices, 32 phases."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxgear as jg
import optimise
from jaxgear import Scene, example_scene, grid_of, model_of, nominal_line_load
from jaxgear.scene._mesh_bodies import with_bodies

from .finding import Finding
from .statics import THESIS, helical, only_pair, scene_of

um = 1e-6
COARSE = ("mesh.slices=10", "mesh.phases=32")
EXTENTS = np.linspace(0.40, 0.18, 12)
# What is asked for by no one [um].
DEEPEST = 80.0
LAW = jg.ExactContact()


class Traced(NamedTuple):
    """A curve, and the closed form beside it.

    `extent` [-], `depth` and `closed` [um], `rms` there [um], `steep`: RMS over error of depth [-].
    """

    extent: np.ndarray
    depth: np.ndarray
    rms: np.ndarray
    steep: np.ndarray
    closed: np.ndarray


@eqx.filter_jit
def _deviations(model: jg.PairModel, prepared: jg.PreparedMesh, depth, extent):
    relief = jg.TipRelief(depth, extent)
    relieved = eqx.tree_at(lambda m: m.flanks, model, jg.Flanks(relief, relief))
    cycle = jg.corrected_cycle(prepared, relieved, law=LAW)
    error = jg.transmission_error(model.pair, cycle)
    return jnp.sqrt(cycle.cells.lines.weight) * (error - jg.cycle_mean(cycle, error))


_prepared = eqx.filter_jit(jg.prepare_mesh)


@eqx.filter_jit
def _deflection(model: jg.PairModel):
    """Of a single tooth pair where it is stiffest [m]."""
    pair, load = model.pair, nominal_line_load(model.pair, model.mesh_torque)
    path = pair.path_start + jnp.linspace(0.0, 1.0, 129) * pair.path_of_contact
    return load * jnp.min(model.compliance(pair, path, load))


def traced(scene: Scene, torque: float | None = None) -> Traced:
    """The Master Curve of a scene.

    **Arguments:**

    - `scene`: with its bodies.
    - `torque`: instead of the scene's own [N m].
    """
    if torque is not None:
        scene = scene.replace({"pair.torque_pinion_Nm": torque})
    model = eqx.tree_at(lambda m: m.flanks, model_of(scene), jg.Flanks())
    grid = grid_of(scene, model)
    prepared = _prepared(model, grid)
    deflection = float(_deflection(model)) / um
    ratio = jnp.asarray(float(jg.profile_contact_ratio(model.pair)))
    closed = np.asarray(
        jax.jit(optimise.master_curve_depth)(jnp.asarray(EXTENTS), ratio, jnp.asarray(deflection))
    )
    curve = optimise.traced_curve(
        functools.partial(_deviations, model, prepared),
        EXTENTS,
        float(closed[0]) * um,
        deepest=DEEPEST * um,
    )
    kept = curve.settled & (curve.depth > 0.0)
    depth = np.where(kept, curve.depth, np.nan) / um
    return Traced(EXTENTS, depth, curve.rms / um, np.sqrt(0.5 * curve.bend), closed)


CASES: dict[str, tuple[str, list[str]]] = {
    "rigid": ("accessory", []),
    "H1, web 3 mm": ("accessory-h1", []),
    "H2": ("accessory-h2", []),
    "rigid, base helix 10 deg": ("accessory", ["10"]),
    "H1, base helix 10 deg": ("accessory-h1", ["10"]),
    "rigid, base helix 20 deg": ("accessory", ["20"]),
    "H1, base helix 20 deg": ("accessory-h1", ["20"]),
}


@functools.cache
def curve_of(label: str) -> Traced:
    """The curve of a case at the scene's own torque."""
    name, helix = CASES[label]
    settings = [*COARSE, *(helical(float(helix[0])) if helix else [])]
    if name == "accessory":
        return traced(example_scene(name, [*THESIS, *only_pair(settings)]))
    # Statics of rim and seats is exact whatever the body's modes are.
    return traced(scene_of(name, *settings) if helix else flexible(name))


def flexible(name: str) -> Scene:
    """An example scene with its bodies as they are."""
    return with_bodies(example_scene(name, [*THESIS, *COARSE]))


def _rows(found: Finding, label: str, curve: Traced) -> None:
    for i in range(0, len(curve.extent), 2):
        row = [curve.extent[i], curve.depth[i], curve.closed[i], curve.depth[i] / curve.closed[i]]
        row += [curve.rms[i], curve.steep[i]]
        found.rows.append([label, *(float(x) for x in row)])


COLUMNS = ["pair", "extent", "depth um", "closed um", "ratio", "RMS um", "RMS over error of depth"]


def bodies() -> Finding:
    """Fig. III-9, IV-2, IV-16: the curve from rigid to flexible."""
    found = Finding(
        "Master Curves traced at 80 N m (Fig. III-9, IV-2, IV-16)",
        "a centred straight web leaves the rigid pair's Master Curve; helical pairs lie deeper",
        COLUMNS,
    )
    curves = {label: curve_of(label) for label in CASES}
    for label, curve in curves.items():
        _rows(found, label, curve)
    over = lambda a, b: curves[a].depth / curves[b].depth - 1.0
    worst = lambda a, b: float(np.nanmax(np.abs(over(a, b))))
    closed = lambda a: float(np.nanmax(np.abs(curves[a].depth / curves[a].closed - 1.0)))
    found.holds = {
        "rigid: within 5 % of the closed form": closed("rigid") < 0.05,
        "H1, straight centred web: within 10 % of the rigid pair's": worst("H1, web 3 mm", "rigid")
        < 0.1,
        "... within 5 % from an extent of 0.22 on": float(
            np.max(np.abs(over("H1, web 3 mm", "rigid"))[EXTENTS > 0.21])
        )
        < 0.05,
        "... within 10 % of the closed form with its own deflection": closed("H1, web 3 mm") < 0.1,
        "H2: within 10 % of the rigid pair's": worst("H2", "rigid") < 0.1,
        **{
            f"base helix {angle} deg: H1 deeper than the rigid pair with that helix": bool(
                np.nanmin(over(f"H1, base helix {angle} deg", f"rigid, base helix {angle} deg"))
                > 0.0
            )
            for angle in (10, 20)
        },
        "H1: the more helix, the deeper": bool(
            np.nanmin(over("H1, base helix 20 deg", "H1, base helix 10 deg")) > 0.0
            and np.nanmin(over("H1, base helix 10 deg", "H1, web 3 mm")) > 0.0
        ),
    }
    return found


def torques() -> Finding:
    """The curve per torque: depth goes with it, and how forgiving it is stays."""
    found = Finding(
        "Master Curves of the accessory pair with a condensed wheel (H1), per torque",
        "(none; the closed form has depths in proportion to the deflection)",
        COLUMNS,
    )
    scene = flexible("accessory-h1")
    curves = {torque: traced(scene, torque) for torque in (40.0, 80.0, 120.0)}
    for torque, curve in curves.items():
        _rows(found, f"{torque:g} N m", curve)
    share = [curves[t].depth / curves[80.0].depth for t in (40.0, 120.0)]
    found.holds = {
        "depths in proportion to the torque, within 5 %": bool(
            np.nanmax(np.abs(share[0] / 0.5 - 1.0)) < 0.05
            and np.nanmax(np.abs(share[1] / 1.5 - 1.0)) < 0.05
        ),
        "an error of depth costs the same at each torque, within 5 %": bool(
            np.nanmax(np.abs(curves[40.0].steep / curves[120.0].steep - 1.0)) < 0.05
        ),
    }
    return found


def drawn_curves(curves: dict[str, Traced]) -> Figure:
    """Depths over extents, over the closed form's, and what an error of depth costs."""
    figure = Figure(figsize=(12.0, 4.6), layout="constrained")
    panels = figure.subplots(1, 3)
    for i, (label, curve) in enumerate(curves.items()):
        rows = curve.depth, curve.depth / curve.closed, curve.steep
        for axes, values in zip(panels, rows, strict=True):
            axes.plot(curve.extent, values, marker=".", ls=("-", "--")[i % 2], label=label)
    labels = (
        "best depth of the tip relief [µm]",
        "depth over the closed form's [-]",
        "RMS over error of depth [µm/µm]",
    )
    for axes, label in zip(panels, labels, strict=True):
        axes.set(xlabel="extent over the path of contact [-]", ylabel=label)
    panels[0].set_ylim(bottom=0.0)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle("accessory pair, 80 N m")
    return figure


def columns_of(curves: dict[str, Traced]) -> dict[str, np.ndarray]:
    """The curves as a table, one under the other."""
    labels = [label for label, curve in curves.items() for _ in curve.extent]
    names = Traced._fields
    values = {
        name: np.concatenate([getattr(each, name) for each in curves.values()]) for name in names
    }
    return {"pair": np.asarray(labels)} | values
