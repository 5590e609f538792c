"""The command `condense`: builds the condensed bodies of a scene and says how good they are."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from fem_prep._body_file import content_hash, write_body
from fem_prep._files import write_vtu
from fem_prep._grid import Grid
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._cli._writing import finish
from jaxgear._units import GPa
from jaxgear._whole_file import write_dataset
from jaxgear.plot import _body_tables as body_tables
from jaxgear.plot._plots import body_pictures
from jaxgear.scene._bodies import (
    BodyPlan,
    Drawn,
    Matrices,
    OwnGrid,
    body_plan,
    even_sectors,
)
from jaxgear.scene._body_build import BuiltBody, built_body
from jaxgear.scene._scene import Scene
from jaxgear.study._head import names_of
from jaxgear.study._progress import narration
from jaxgear.study._ranks import Doubtful, Idle
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry

# Keys of a condensed body that change nothing about matrices from elsewhere.
_NOT_OF_MATRICES = (
    "interface",
    "young_GPa",
    "seat_coupling",
    "seat_width_mm",
    "compare_seats",
    "rotating_terms",
    "fineness",
)


def condense(scene: Scene, folder: Folder) -> Summary:
    """Build the condensed bodies of a scene, from the cache where they are known.

    Writes each body, its grid with mode shapes for ParaView, and its pictures.

    **Arguments:**

    - `scene`: checked against the schema, with a condensed body.
    - `folder`: for the results; exists.

    **Returns:**

    The summary that is also in `summary.json`.

    **Raises:**

    - `ValueError` if a body cannot be.
    """
    # All plans before any long work: a mistake in the second costs no wait.
    plans = [body_plan(scene, gear) for gear in scene.condensed]
    bodies, remarks, groups = [], [], {}
    for plan in plans:
        with narration(plan.gear) as tell:
            found = built_body(plan, tell)
            bodies.append(_body_summary(scene, found))
            tell("writing the body")
            file = f"{plan.name}.body.npz"
            write_body(folder / file, found.body)
            whole = {"file": str(folder.path / file), "content_hash": content_hash(found.body)}
            bodies[-1] |= whole
            tell("drawing")
            _draw(found, folder)
        remarks += [*found.warnings, *_remarks(scene, found)]
        groups[f"{plan.gear}_body"] = _dataset(found)
    write_dataset(xr.Dataset(), folder / "result.nc", groups)
    summary = names_of(scene) | {"bodies": bodies, "notes": remarks}
    return finish(scene, folder, summary)


# --- The summary


def _body_summary(scene: Scene, found: BuiltBody) -> Summary:
    """What is known of a body: its health, and how it came about."""
    plan = found.plan
    health: dict[str, Any] = dict(found.health)
    speed = _highest_speed(scene, plan.gear)
    for key in [key for key in health if key.endswith("_um_at_rad_s")]:
        if speed and health[key]:
            known, growth = max((float(name), each) for name, each in health[key].items())
            # A new mapping: the old one is the body's own and goes into its file.
            health[key] = health[key] | {f"{speed:g}": growth * (speed / known) ** 2}
    made: dict[str, Any] = {
        "name": plan.name,
        "gear": plan.gear,
        "source": _source(plan),
        "torque_seat": plan.torque_seat,
    }
    if not isinstance(plan.source, Matrices):
        made["young_GPa"] = plan.material.young / GPa
    cost = {
        "from_cache": found.from_cache,
        "seconds": found.seconds,
        "build_seconds": found.build_seconds,
        "peak_memory_MB": found.peak_memory,
        "cache_key": found.key,
    }
    return made | health | cost


def _source(plan: BodyPlan) -> str:
    match plan.source:
        case Drawn(body=drawn):
            return "solid" if drawn.web is None else "web"
        case OwnGrid(path=path):
            return str(path)
        case Matrices(paths=paths):
            return ", ".join(map(str, paths))


def _highest_speed(scene: Scene, gear: str) -> float | None:
    """Highest speed of a gear in a sweep [rad/s]."""
    listed = scene.get("sweep.pinion_speed_rad_s")
    highest = max(listed) if listed else scene.get("sweep.pinion_speed_rad_s.to")
    return highest and highest * scene["pinion.teeth"] / scene[f"{gear}.teeth"]


def _remarks(scene: Scene, found: BuiltBody) -> list[str]:
    """What a reader of the results should not miss."""
    plan, gear = found.plan, found.plan.gear
    remarks: list[str] = [
        Doubtful(f"The {gear}'s body: {warning}") for warning in found.health["warnings"]
    ]
    if isinstance(plan.source, Drawn) and plan.source.fineness.sectors % plan.teeth_count:
        even = even_sectors(plan.source.body, plan.teeth_count)
        remarks.append(
            f"The {gear}'s grid has {plan.source.fineness.sectors} elements around for "
            f"{plan.teeth_count} teeth: not every tooth stands on the same piece of rim. With "
            f"{gear}.body.fineness.sectors = {even} every tooth would."
        )
    if isinstance(plan.source, Matrices):
        remarks += _remarks_on_matrices(scene, found)
    unused = ["inertia_kg_m2", "transverse_inertia_kg_m2"]
    unused += [] if isinstance(plan.source, Matrices) else ["mass_kg"]
    for key in unused:
        if f"{gear}.body.{key}" in scene.given:
            words = f"{gear}.body.{key} does nothing: a condensed body has its own."
            remarks.append(Idle(words))
    return remarks


def _remarks_on_matrices(scene: Scene, found: BuiltBody) -> list[str]:
    """Seats that bearings will look for, teeth that matrices must hold, keys that do nothing."""
    plan, remarks = found.plan, []
    bearings = range(len(scene.rows(f"{plan.gear}.shaft.bearings")))
    wanted = [f"bearing[{i}]" for i in bearings] or ["gear"]
    if missing := [name for name in wanted if name not in found.body.seats]:
        seats = ", ".join(found.body.seats) or "none"
        remarks.append(
            f"The {plan.gear}'s matrices have no seat {' and '.join(missing)} for its bearings; "
            f"their seats are: {seats}."
        )
    if plan.teeth is not None:
        remarks.append(
            f"The {plan.gear}'s matrices must hold the mass of its teeth: none is added."
        )
    # Nodes of the inside that the matrices still have are condensed here, with so many modes.
    idle = plan.modes and not found.body.facts.get("modes_of_interior_nodes")
    for key in (*_NOT_OF_MATRICES, *(["modes"] if idle else [])):
        if f"{plan.gear}.body.{key}" in scene.given:
            remarks.append(
                f"{plan.gear}.body.{key} does nothing: the matrices were condensed elsewhere."
            )
    return remarks


def _dataset(found: BuiltBody) -> xr.Dataset:
    """The free modes of a body."""
    facts = found.health
    entries = {
        "frequency_Hz": ("free_frequency_Hz", "Hz", "natural frequency of the free body"),
        "nodal_diameter": ("nodal_diameter", "1", "number of nodal diameters"),
        "nodal_circle": ("nodal_circle", "1", "number of nodal circles"),
        "nodal_diameter_share": ("nodal_diameter_share", "1", "its share of the energy"),
        "kind": ("kind", "1", "direction of most motion"),
    }
    return xr.Dataset(
        {
            name: Entry(("mode",), np.asarray(facts[key]), unit, text).variable()
            for name, (key, unit, text) in entries.items()
            if key in facts
        },
        attrs={"gear": found.plan.gear, "body": found.body.name},
    )


# --- Files and pictures


def _draw(found: BuiltBody, folder: Folder) -> None:
    """Pictures of a body, and its grid with mode shapes for ParaView."""
    body, plan = found.body, found.plan
    modes = drawn_modes(found.health)
    title = f"{body.name}, free body"
    figure = partial(body_pictures.families, modes, title)
    save(figure, body_tables.families_columns(modes), folder, f"{plan.gear}_families")
    if found.view is None:
        return
    points = dict(zip(body.seats, body.seat_points, strict=True))
    labels = {seat.name: seat.label for seat in plan.seats}
    sets = {f"seat:{name}": found.view.sets[f"seat:{label}"] for name, label in labels.items()}
    grid = Grid(body.nodes, body.bricks, {"rim": found.view.sets["rim"], **sets})
    drawn = body_tables.DrawnBody(grid, points)
    size = f"{len(body.bricks):,} elements, {len(body.nodes):,} nodes"
    figure = partial(body_pictures.grid, drawn, f"{body.name}: {size}")
    save(figure, body_tables.grid_columns(drawn), folder, f"{plan.gear}_grid")
    shapes = found.view.shapes
    figure = partial(body_pictures.mode_shapes, drawn, modes, shapes, title)
    save(figure, body_tables.mode_shapes_columns(modes, shapes), folder, f"{plan.gear}_modes")
    fields = {
        f"mode {mode + 1:02d}: {modes.label(mode).replace(chr(10), ', ')}": shape
        for mode, shape in enumerate(shapes)
    }
    write_vtu(folder / f"{body.name}.vtu", grid, fields)


def drawn_modes(health: Mapping[str, Any]) -> body_tables.DrawnModes:
    """Free modes as a health report has them; without a grid circles are not known."""
    frequency = np.asarray(health["free_frequency_Hz"])
    circle = health.get("nodal_circle")
    return body_tables.DrawnModes(
        frequency_Hz=frequency,
        diameter=np.asarray(health["nodal_diameter"]),
        circle=None if circle is None else np.asarray(circle),
        share=np.asarray(health["nodal_diameter_share"]),
        kind=health["kind"],
    )
