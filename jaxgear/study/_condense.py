"""Condensed bodies of a scene, built, and how good they are."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from fem_prep import Grid, content_hash, surface, write_body, write_vtu
from jaxgear._units import GPa, mm
from jaxgear.scene._bodies import BodyPlan, Drawn, Matrices, OwnGrid, body_plan, even_sectors
from jaxgear.scene._body_build import BuiltBody, built_body
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._tables import SweepKeys
from jaxgear.study._body_surfaces import opened, section
from jaxgear.study._dynamics import fastest
from jaxgear.study._head import names_of, study
from jaxgear.study._progress import narration
from jaxgear.study._ranks import Doubtful, Idle
from jaxgear.study._result import Result, Summary
from jaxgear.study._results import Entry, dataset_of, entries_over

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
# Frequencies of a pair differ by less than that; holes may part them.
_TWINS = 1e-3
# How many mode shapes are drawn.
_DRAWN = 9


@study
def condense(scene: Scene) -> Result:
    """Build the condensed bodies of a scene, from the cache where they are known.

    **Arguments:**

    - `scene`: checked against the schema, with a condensed body.

    **Returns:**

    A dataset for each gear, such as `wheel_body`: free modes and what of the grid is seen; the
    summary, with a health report of each body; and as files each body, and its grid with mode
    shapes for ParaView.

    **Raises:**

    - `ValueError` if a body cannot be.
    """
    # All plans before any long work: a mistake in the second costs no wait.
    plans = [body_plan(scene, gear) for gear in scene.condensed]
    bodies, remarks, datasets, files = [], [], {}, {}
    for plan in plans:
        with narration(plan.gear) as tell:
            found = built_body(plan, tell)
            file = {"file": f"{plan.name}.body.npz", "content_hash": content_hash(found.body)}
            bodies.append(
                body_summary(found, fastest_of(scene.sweep, scene.gears, plan.gear)) | file
            )
            remarks += [*found.warnings, *body_remarks(scene.gear(plan.gear), found)]
            datasets[f"{plan.gear}_body"] = body_dataset(found)
            files |= _files(found, datasets[f"{plan.gear}_body"])
    summary = names_of(scene.name, scene.cite) | {"bodies": bodies, "notes": remarks}
    return Result(scene, summary, datasets, files)


def _files(found: BuiltBody, dataset: xr.Dataset) -> Mapping[str, Callable[[Path], None]]:
    """The body, and where it has a grid this with mode shapes for ParaView."""

    def keep(path: Path) -> None:
        write_body(path, found.body)

    files: dict[str, Callable[[Path], None]] = {f"{found.plan.name}.body.npz": keep}
    if found.view is not None:
        labels = dataset["label"].values
        fields = {
            f"mode {mode + 1:02d}: {labels[mode].replace(chr(10), ', ')}": shape
            for mode, shape in enumerate(found.view.shapes)
        }
        files[f"{found.body.name}.vtu"] = partial(write_vtu, grid=_grid(found), fields=fields)
    return files


# --- The summary


def fastest_of(asked: SweepKeys, gears: Mapping[str, GearKeys], gear: str) -> float:
    """The speed of a gear up to which a scene is swept; 0 if it is not [rad/s]."""
    return fastest(asked) * gears["pinion"].teeth / gears[gear].teeth


def body_summary(found: BuiltBody, speed: float) -> Summary:
    """What is known of a body: its health, and how it came about.

    Its growth is told at a speed of its gear too, unless that is 0 [rad/s].
    """
    plan = found.plan
    health: Summary = dict(found.health)
    for key in [key for key in health if key.endswith("_um_at_rad_s")]:
        if speed and health[key]:
            known, growth = max((float(name), each) for name, each in health[key].items())
            # A new mapping: the old one is the body's own and goes into its file.
            health[key] = health[key] | {f"{speed:g}": growth * (speed / known) ** 2}
    of_matrices = isinstance(plan.source, Matrices)
    return {
        "name": plan.name,
        "gear": plan.gear,
        "source": _source(plan),
        "torque_seat": plan.torque_seat,
        **({} if of_matrices else {"young_GPa": plan.material.young / GPa}),
        **health,
        "from_cache": found.from_cache,
        "seconds": found.seconds,
        "build_seconds": found.build_seconds,
        "peak_memory_MB": found.peak_memory,
        "cache_key": found.key,
    }


def _source(plan: BodyPlan) -> str:
    match plan.source:
        case Drawn(body=drawn):
            return "solid" if drawn.web is None else "web"
        case OwnGrid(path=path):
            return str(path)
        case Matrices(paths=paths):
            return ", ".join(map(str, paths))


def body_remarks(own: GearKeys, found: BuiltBody) -> Iterator[str]:
    """What a reader of a body's results should not miss."""
    plan, gear = found.plan, found.plan.gear
    for warning in found.health["warnings"]:
        yield Doubtful(f"The {gear}'s body: {warning}")
    if isinstance(plan.source, Drawn) and plan.source.fineness.sectors % plan.teeth_count:
        even = even_sectors(plan.source.body, plan.teeth_count)
        yield (
            f"The {gear}'s grid has {plan.source.fineness.sectors} elements around for "
            f"{plan.teeth_count} teeth: not every tooth stands on the same piece of rim. With "
            f"{gear}.body.fineness.sectors = {even} every tooth would."
        )
    idle = ["inertia_kg_m2", "transverse_inertia_kg_m2"]
    if isinstance(plan.source, Matrices):
        yield from _on_matrices(found, len(own.shaft.bearings))
        # Nodes of the inside that the matrices still have are condensed here, with so many modes.
        modes = plan.modes and not found.body.facts.get("modes_of_interior_nodes")
        for key in own.body.written(*_NOT_OF_MATRICES, *(["modes"] if modes else [])):
            yield f"{gear}.body.{key} does nothing: the matrices were condensed elsewhere."
    else:
        idle.append("mass_kg")
    for key in own.body.written(*idle):
        yield Idle(f"{gear}.body.{key} does nothing: a condensed body has its own.")


def _on_matrices(found: BuiltBody, bearings: int) -> Iterator[str]:
    """Seats that so many bearings will look for, teeth that matrices must hold."""
    gear = found.plan.gear
    wanted = [f"bearing[{i}]" for i in range(bearings)] or ["gear"]
    if missing := [name for name in wanted if name not in found.body.seats]:
        seats = ", ".join(found.body.seats) or "none"
        yield (
            f"The {gear}'s matrices have no seat {' and '.join(missing)} for its bearings; "
            f"their seats are: {seats}."
        )
    if found.plan.teeth is not None:
        yield f"The {gear}'s matrices must hold the mass of its teeth: none is added."


# --- The dataset


def body_dataset(found: BuiltBody) -> xr.Dataset:
    """The free modes of a body and, where it has a grid, what of that is seen.

    A dataset over modes, nodes and faces, in the frame of the body: Z along the axis from mid-face,
    X towards the middle of tooth 0.
    """
    facts, body = found.health, found.body
    frequency, diameter, kind = (
        np.asarray(facts[key]) for key in ("free_frequency_Hz", "nodal_diameter", "kind")
    )
    rows = {
        "mode": (np.arange(1, len(frequency) + 1), "1", "number of the mode"),
        "frequency_Hz": (frequency, "Hz", "natural frequency of the free body"),
        "nodal_diameter": (diameter, "1", "number of nodal diameters"),
        "nodal_diameter_share": (facts["nodal_diameter_share"], "1", "its share of the energy"),
        "kind": (kind, "1", "direction of most motion"),
        "family": (_families(diameter, kind), "1", "family of the mode"),
    }
    counted = {"nodal diameter": diameter}
    if (circle := facts.get("nodal_circle")) is not None:
        rows["nodal_circle"] = circle, "1", "number of nodal circles"
        counted["circle"] = circle
    labels = [
        f"{frequency[mode]:.5g} Hz, {kind[mode]}\n"
        + ", ".join(f"{x[mode]} {what}{'' if x[mode] == 1 else 's'}" for what, x in counted.items())
        for mode in range(len(frequency))
    ]
    rows["label"] = labels, "1", "the mode in words"
    entries = dict(entries_over(("mode",), rows))
    about = {"gear": found.plan.gear, "body": body.name, "title": f"{body.name}, free body"}
    if found.view is not None:
        entries |= {**_seen(found), **_shapes(found, frequency, diameter, kind)}
        size = f"{len(body.bricks):,} elements, {len(body.nodes):,} nodes"
        about["grid_title"] = f"{body.name}: {size}"
    return dataset_of(entries).assign_attrs(about)


def _families(diameter: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Number of each mode among those of its kind and nodal diameter; two make one pair."""
    seen: Counter[tuple[str, int]] = Counter()
    numbers = []
    for each in zip(kind.tolist(), diameter.tolist(), strict=True):
        numbers.append(1 + seen[each] // (2 if each[1] else 1))
        seen[each] += 1
    return np.asarray(numbers, dtype=int)


def _grid(found: BuiltBody) -> Grid:
    """The grid of a body; sets of its seats under the names that the body has for them."""
    assert found.view is not None
    known, seats = found.view.sets, found.plan.seats
    sets = {f"seat:{seat.name}": known[f"seat:{seat.label}"] for seat in seats}
    return Grid(found.body.nodes, found.body.bricks, {"rim": known["rim"], **sets})


def _seen(found: BuiltBody) -> Mapping[str, Entry]:
    """Surface, section, rim and seats."""
    grid, body = _grid(found), found.body
    faces, is_cut = opened(grid)
    part = np.full(len(grid.nodes), -1)
    for number, nodes in enumerate(grid.sets.values()):
        part[nodes] = number
    names = [name.removeprefix("seat:") for name in grid.sets]
    return {
        "node_mm": Entry(("node", "axis"), grid.nodes / mm, "mm", "X, Y, Z of the nodes"),
        "face": Entry(("face", "corner"), surface(grid), "1", "nodes of the outer faces"),
        "open_face": Entry(("open_face", "corner"), faces, "1", "the same, a wedge cut out"),
        "is_cut": Entry(("open_face",), is_cut, "1", "whether the cut has laid it open"),
        "section_mm": Entry(("element", "corner", "r_z"), section(grid) / mm, "mm", "section"),
        "part_of_node": Entry(("node",), part, "1", "number of the part, or -1"),
        "part": Entry(("part",), names, "1", "rim and seats that are sets of nodes"),
        "seat": Entry(("seat",), list(body.seats), "1", "seats"),
        "seat_mm": Entry(("seat", "axis"), body.seat_points / mm, "mm", "X, Y, Z of their nodes"),
    }


def _shapes(
    found: BuiltBody, frequency: np.ndarray, diameter: np.ndarray, kind: np.ndarray
) -> Mapping[str, Entry]:
    """The lowest modes; of the two of a pair, which differ by a turn, the first only."""
    assert found.view is not None
    chosen: list[int] = []
    for mode in range(len(found.view.shapes)):
        is_twin = any(
            diameter[mode] == diameter[other] > 0
            and kind[mode] == kind[other]
            and frequency[mode] < (1.0 + _TWINS) * frequency[other]
            for other in chosen
        )
        if not is_twin:
            chosen.append(mode)
    shapes = found.view.shapes[chosen[:_DRAWN]]
    numbers = np.asarray(chosen[:_DRAWN], dtype=int) + 1
    return {
        "shown": Entry(("shown",), numbers, "1", "numbers of the modes that are drawn"),
        "shape": Entry(("shown", "node", "axis"), shapes, "1", "their shapes"),
    }
