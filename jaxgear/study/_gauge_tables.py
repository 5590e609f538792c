"""Gauges of a scene as a search reads them: stresses at their places, quasi-static."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from jaxgear._checks import require
from jaxgear._response._gauges import GaugeInfluences, gauge_influences
from jaxgear.scene._schema import GEARS
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.study._built import BuiltScene

if TYPE_CHECKING:
    from jaxgear.study._gauges import Gauge

# What [optimise] may name of gauges.
NAMES = ("max_gauge_stress", "gauge_stress_amplitude")
# Keys of what a body is, with which the tables of its gauges would change; but its temperatures.
_OF_BODIES = (".material.", ".body.")


def asked_of_gauges(asked: OptimiseKeys) -> list[str]:
    """Keys of [optimise] that name a stress at gauges."""
    keys = ["optimise.minimise"] if any(name in NAMES for name in asked.weights) else []
    limits = asked.limits.written(*(f"{name}_MPa" for name in NAMES))
    keys += [f"optimise.limits.{name}" for name in limits]
    return keys + (["optimise.pareto.against"] if asked.pareto.against in NAMES else [])


def gauge_tables(built: BuiltScene, varied: Iterable[str]) -> tuple[GaugeInfluences, ...]:
    """What the gauges of a scene read, body by body; none unless [optimise] asks for it.

    Of each gauge six components of the stress, then the normal stress along it.

    **Raises:**

    - `ValueError` if there is no gauge that turns with its body, or if a variable would change the
        stresses of a body otherwise than by its loads.
    """
    scene, found = built.scene, []
    keys = asked_of_gauges(scene.optimise)
    if not keys:
        return ()
    require(
        bool(scene.gauges) and bool(scene.bodies),
        "{key} names stress at gauges, which are on condensed bodies: give the scene a table "
        "[[gauges]], and its gear a condensed body.",
        key=keys[0],
    )
    for number, each in enumerate(scene.gauges):
        require(
            each.frame == "rotating",
            "gauges[{number}].frame: {key} is of gauges that turn with a body; one that stands "
            "still reads all places that pass. Leave frame out.",
            number=number,
            key=keys[0],
        )
    for key in varied:
        own = ".body.temperature." not in key and any(part in f".{key}" for part in _OF_BODIES)
        require(
            not own,
            "{key} is varied or scatters, with which the stresses of a body change in themselves: "
            "{asked} knows flanks, misalignment, bearings and temperatures. Leave one of them out.",
            key=key,
            asked=keys[0],
        )
    # For other scenes no finite elements are imported.
    from jaxgear.study._gauges import gauges_of

    for gear, body in scene.bodies.items():
        own = gauges_of(scene.gauges, scene.bodies, gear, body.built, body.heated)
        if own:
            found.append(_table(built, gear, own))
    return tuple(found)


def _table(built: BuiltScene, gear: str, gauges: tuple["Gauge", ...]) -> GaugeInfluences:
    mesh, body = built.scene.mesh, built.scene.bodies[gear]
    beside = lambda six, along: np.concatenate([six, along[:, 1:]], axis=1)
    parts = [
        (
            beside(each.stress.rows, each.rows),
            beside(each.stress.rotation, each.rotation),
            beside(each.warm, each.heat),
        )
        for each in gauges
    ]
    rows, rotation, heat = (np.concatenate(each) for each in zip(*parts, strict=True))
    return gauge_influences(
        body.built.body,
        rows.reshape(-1, rows.shape[2]),
        rotation.ravel(),
        built.model.pair,
        GEARS.index(gear),
        built.grid,
        components=body.flexible.components,
        points=mesh.root_points,
        axial=mesh.connection,
        heat=None if body.heated is None else (heat.reshape(-1, 2), body.heated.load),
    )
