"""Rigidified bodies in motion beside rigid ones."""

import functools

import equinox as eqx
import numpy as np

from jaxgear import (
    DynamicSystem,
    PairDynamics,
    PairModel,
    RigidBody,
    Scene,
    Shaft,
    example_scene,
    grid_of,
    model_of,
)
from jaxgear._system._shaft import node_heights
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import dynamics_of

from .finding import Finding
from .motion import COARSE, QUICK, SLOW, SPEEDS, Curve, at_speeds, moving, rigid, sweep
from .statics import THESIS, rigid_body, with_rigid_shaft


def carried(scene: Scene, model: PairModel, dynamics: PairDynamics, index: int) -> np.ndarray:
    """Mass of a gear with its shaft in rigid motions about its mid-face, shape `[6, 6]`."""
    gear = GEARS[index]
    mapped = dynamics.cycle.system.structure.map
    first = (0, mapped.sizes[0])[index]
    if gear in scene.bodies:
        heights = scene.bodies[gear].built.body.seat_points[:, 2]
        place = next(body for body in dynamics.bodies if body.index == index)
        numbers = np.asarray(place.seats).reshape(-1, 6)
    else:
        shaft = (model.pinion_support, model.wheel_support)[index]
        assert isinstance(shaft, Shaft)
        heights = np.asarray(node_heights(shaft)) - float(shaft.gear_at)
        numbers = first + np.arange(mapped.sizes[index]).reshape(-1, 6)
    motions = np.zeros((len(dynamics.dofs), 6))
    for height, own in zip(heights, numbers, strict=True):
        rigid_motion = np.eye(6)
        rigid_motion[0, 4], rigid_motion[1, 3] = height, -height
        motions[[dynamics.dofs.index(int(dof)) for dof in own]] = rigid_motion
    return motions.T @ np.asarray(dynamics.system.mass) @ motions


def as_rigid(
    name: str, masses: dict[str, np.ndarray], *settings: str, stiff: bool = True
) -> DynamicSystem:
    """The pair of an example scene, some gears without foundation and as heavy as bodies whose
    masses are given, their shafts stiff or as they are."""
    settings = (*settings, *(f"{gear}.foundation=none" for gear in masses))
    scene = example_scene(name, [*THESIS, *COARSE, *settings])
    model = with_rigid_shaft(model_of(scene), *masses) if stiff else model_of(scene)
    grid = grid_of(scene, model, scene.sweep.steps)
    make = eqx.filter_jit(lambda model: dynamics_of(model, grid, scene))
    where = lambda model: [getattr(model, f"{gear}_body") for gear in masses]
    diagonals = {gear: np.diagonal(mass) for gear, mass in masses.items()}
    none = dict.fromkeys(masses, np.zeros(6))
    for _ in range(2):
        # The second time without what the shaft has already.
        bodies = [RigidBody(*(diagonals[gear] - none[gear])[[0, 5, 3]].tolist()) for gear in masses]
        model = eqx.tree_at(where, model, bodies, is_leaf=lambda x: x is None)
        dynamics = make(model)
        own = {gear: carried(scene, model, dynamics, GEARS.index(gear)) for gear in masses}
        none = {gear: none[gear] + np.diagonal(own[gear]) - diagonals[gear] for gear in masses}
    for gear, mass in masses.items():
        size = np.sqrt(np.diagonal(mass))
        assert np.abs((own[gear] - mass) / size / size[:, None])[:, [0, 1, 2, 5]].max() < 0.02, gear
    return dynamics.system


RIGID = {
    "accessory H1": ("accessory", "h1", ("wheel",)),
    "accessory H2": ("accessory", "h2", ("pinion", "wheel")),
    "power H1": ("power", "h1", ("wheel",)),
}


@functools.cache
def stiffened(label: str) -> tuple[Curve, dict[str, np.ndarray]]:
    """The sweep of a rigidified hybrid, and the masses of its rigidified gears."""
    name, kind, gears = RIGID[label]
    stiff = [rigid_body(gear) for gear in gears]
    quick = [f"{gear}.body.{each}" for gear in gears for each in QUICK]
    each = moving(f"{name}-{kind}", *stiff, *quick)
    return sweep(each.system)[0], {
        gear: carried(each.scene, each.model, each.dynamics, GEARS.index(gear)) for gear in gears
    }


def rigidified() -> Finding:
    """Fig. III-10 and III-15: bodies and shafts 2000 times as stiff, against rigid ones."""
    found = Finding(
        "Sweeps of rigidified hybrids and of the rigid pair (Fig. III-10, III-15)",
        "all in good agreement, slight differences; a peak of the initial model near 1150 rad/s "
        "and some at low to medium speed belong to its shafts, which are beams",
        ["pair", "beside", "largest diff.", "at rad/s", "mean diff.", "peak rad/s", "its peak"],
    )
    off, plain = {}, {}
    for label, (name, _, _) in RIGID.items():
        own, masses = stiffened(label)
        others = {
            "as heavy, stiff shaft": sweep(as_rigid(name, masses))[0],
            "rigid pair as it is": Curve(SPEEDS, at_speeds(rigid(name), SPEEDS)),
        }
        for what, curve in others.items():
            apart = np.abs(own.ratio - curve.ratio)
            at = int(np.nanargmax(apart))
            found.rows.append([label, what, float(apart[at]), float(SPEEDS[at])])
            found.rows[-1] += [float(np.nanmean(apart)), own.main, curve.main]
            into = off if what.startswith("as heavy") else plain
            into[label] = float(apart[at])
    found.holds = {
        **{
            f"{label}: within 0.02 of the rigid pair as heavy, without foundation, on as stiff a "
            "shaft": most < 0.02
            for label, most in off.items()
        },
        **{
            f"{label}: within 0.2 of the rigid pair as it is": most < 0.2
            for label, most in plain.items()
        },
    }
    return found


def basis() -> Finding:
    """Fig. III-13: number of modes."""
    found = Finding(
        "Modes of the accessory wheel of 3 mm (Fig. III-13)",
        "most of the response curve is obtained with 10 of 100 modes",
        ["modes", "peak rad/s", "ratio there", "largest diff.", "at rad/s", "mean diff."],
    )
    curves = {
        count: sweep(
            moving("accessory-h1", "model.shapes=natural", f"model.coordinates={count}").system
        )[0]
        for count in (100, 50, 10)
    }
    best, most, mean = curves[100], {}, {}
    for count, curve in curves.items():
        apart = np.abs(curve.ratio / best.ratio - 1.0)
        at = int(np.nanargmax(apart))
        most[count], mean[count] = float(apart[at]), float(np.nanmean(apart))
        peak = float(np.nanmax(curve.ratio[curve.speed > SLOW]))
        found.rows.append([str(count), curve.main, peak, most[count], SPEEDS[at], mean[count]])
    found.holds = {
        "50 modes: the dynamic ratio within 3 % at every speed": most[50] < 0.03,
        "10 modes: within 3 % in the mean over speed": mean[10] < 0.03,
        "10 modes: within 10 % at every speed": most[10] < 0.1,
        "10 modes: the highest peak within 2 % of its speed": abs(curves[10].main / best.main - 1.0)
        < 0.02,
    }
    return found
