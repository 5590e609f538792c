"""Stresses of condensed bodies over a mesh cycle: maps, a file for ParaView, and their summary."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import scipy
import xarray as xr

from fem_prep import (
    FixedInterface,
    Grid,
    nodal_stress,
    surface,
    swelling_stress,
    von_mises,
    write_vtu,
)
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._response._stress_cycle import StressRange, along_cylinder, images_of, stress_range
from jaxgear._solve._cycle import MeshCycle
from jaxgear._units import MPa, deg, mm
from jaxgear.scene._body_build import BuiltBody
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._mesh_bodies import MeshBody
from jaxgear.scene._tables import MeshKeys
from jaxgear.study._body_answers import body_under_teeth, worst_phase
from jaxgear.study._body_surfaces import FACE, section
from jaxgear.study._built import BuiltScene
from jaxgear.study._hybrid import BodyUnderTeeth, radius_of
from jaxgear.study._moving_body import cycle_in_motion, moving_bodies, moving_in
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry, dataset_of, entries_over
from jaxgear.study._statics import Statics

# Times of a cycle at which stresses are found: so many in a mesh period, and in all.
_IN_PERIOD, _IN_ALL = 16, 64


@dataclasses.dataclass(frozen=True)
class StressMap:
    """Stresses of a condensed body over a cycle of its mesh.

    **Fields:**

    - `built`: the body.
    - `words`: where it is shown, for a title.
    - `stress`: there, along x, y, z of the body, shape `[node, 6]` [Pa].
    - `turn`: of the body's x from S there, about Z [rad].
    - `range`: over one of its revolutions.
    - `covered`: share of that revolution that the cycle says something of [-].
    - `told`: nodes of which the summary tells: not those of elements that bear teeth, where their
        forces stand, or that a seat holds, shape `[node]`.
    """

    built: BuiltBody
    words: str
    stress: np.ndarray
    turn: float
    range: StressRange
    covered: float
    told: np.ndarray

    @property
    def grid(self) -> Grid:
        """The body's grid."""
        return Grid(self.built.body.nodes, self.built.body.bricks, MappingProxyType({}))


def stress_maps(
    mesh: MeshKeys,
    bodies: Mapping[str, MeshBody],
    statics: Statics,
    tell: Callable[[str], None] = lambda step: None,
) -> Mapping[str, StressMap]:
    """Stresses of the condensed bodies of a scene over its solved cycle, by gear; begins are told.

    Bodies without a grid have none.
    """
    found = {}
    for gear, body in bodies.items():
        if len(body.built.body.nodes):
            say = lambda step, gear=gear: tell(f"{gear}: {step}")
            found[gear] = _stress_map(mesh, gear, body, statics, say)
    return found


def moving_stress_maps(
    built: BuiltScene,
    pair: PairDynamics,
    orbit: Orbit,
    tell: Callable[[str], None] = lambda step: None,
) -> Mapping[str, StressMap]:
    """Stresses of the condensed bodies of a scene over a steady response; begins are told.

    Bodies without a grid have none. What moves on modes has its inertia, what they leave out
    follows the loads at once.
    """
    scene, found = built.scene, {}
    cycle, grid = cycle_in_motion(pair, orbit, built.law), built.grid_in_motion
    grows = orbit.speed if scene.sweep.centrifugal else 0.0 * orbit.speed
    model = dataclasses.replace(built.model, speed=grows)
    for gear, body in moving_bodies(scene.bodies, scene.gears).items():
        if not body.has_grid:
            continue
        own: MeshBody = scene.bodies[gear]
        under = BodyUnderTeeth(
            own,
            body.index,
            model,
            grid,
            cycle,
            points=scene.mesh.root_points,
            axial=scene.mesh.connection,
            moving=moving_in(scene, pair, orbit, built.law, body),
        )
        say = lambda step, gear=gear: tell(f"{gear}: {step}")
        words = f"pinion at {float(orbit.speed):.5g} rad/s, "
        found[gear] = _map_of(under, gear, own, cycle, say, words)
    return found


def _stress_map(
    mesh: MeshKeys, gear: str, body: MeshBody, statics: Statics, tell: Callable[[str], None]
) -> StressMap:
    under = body_under_teeth(mesh, gear, body, statics)
    return _map_of(under, gear, body, statics.cycle, tell)


def _map_of(
    under: BodyUnderTeeth,
    gear: str,
    body: MeshBody,
    cycle: MeshCycle,
    tell: Callable[[str], None],
    before: str = "",
) -> StressMap:
    """Of a body in a cycle at rest or in motion, with words before those of its phase."""
    lines, worst = cycle.cells.lines, worst_phase(cycle)
    sectors, teeth = body.built.body.facts.get("sectors", 1), body.built.plan.teeth_count
    assert isinstance(sectors, int)
    images = math.gcd(sectors, teeth)
    # After these the body stands under its teeth as before.
    periods = min(lines.periods, teeth // images)
    step = max(1, under.phases // _IN_PERIOD, under.phases * periods // _IN_ALL)
    motions, inertias, turns, shown, phase = [], [], [], 0, 0.0
    for period in range(periods):
        found = under.under_mesh(period)
        # The time of the largest load is one of those that are looked at.
        chosen = np.arange(worst % under.phases % step, under.phases, step)
        if worst // under.phases % periods == period:
            at = int(np.searchsorted(chosen, worst % under.phases))
            shown, phase = len(turns) + at, float(lines.phase[period * under.phases + chosen[at]])
        motions.append(found.motion[chosen] + under.at_rest)
        inertias.append(np.broadcast_to(found.inertia, found.motion.shape)[chosen])
        turns.extend(found.turn[chosen])
    with in_keys(gear):
        held = body.built.held(tell)
    tell("stresses over the cycle")
    stress = _stresses(held, under, np.concatenate(motions), np.concatenate(inertias))
    nodes = body.built.body.nodes
    return StressMap(
        built=body.built,
        words=f"{before}the mesh at phase {phase:.3f}",
        stress=stress[shown],
        turn=float(turns[shown]),
        range=stress_range(along_cylinder(nodes, stress), images_of(nodes, images)),
        covered=images * periods / teeth,
        told=_told(body.built),
    )


def _stresses(
    held: FixedInterface, under: BodyUnderTeeth, motions: np.ndarray, inertias: np.ndarray
) -> np.ndarray:
    """Of all nodes at some times, under rotation and heat too, `[time, node, 6]` [Pa].

    The inside follows statically, but for what inertia moves it by.
    """
    full, outer = held.full, under.body.boundary_dofs
    moved = held.followed((motions + inertias)[:, :outer].T)
    if under.spin:
        moved += under.spin**2 * held.loaded(full.centrifugal_load[:, None])
    field = full.on_nodes(moved) + under.warm_inside
    field += np.tensordot(inertias[:, outer:], under.body.interior_shapes, axes=1)
    stress = nodal_stress(full.grid, full.material, field)
    if under.heated is not None:
        nodes = np.arange(len(full.grid.nodes))
        free = under.strain @ under.heated.strain
        stress += swelling_stress(full.grid, full.material, free, nodes)
    return stress


def _told(built: BuiltBody) -> np.ndarray:
    """Nodes of which numbers are told."""
    assert built.view is not None
    told = np.ones(len(built.body.nodes), dtype=bool)
    for nodes in built.view.sets.values():
        told[built.body.bricks[np.isin(built.body.bricks, nodes).any(axis=1)]] = False
    return told


# --- Results


def stress_dataset(gear: str, found: StressMap) -> xr.Dataset:
    """The stresses at all nodes of a body's grid, and the elements of its section."""
    grid, values = found.grid, found.range
    cut = section(grid)
    towards = (0.0 if gear == "pinion" else np.pi) - found.turn
    over = "over a revolution"
    rows = {
        "von_mises_MPa": (von_mises(found.stress) / MPa, "MPa", f"von Mises, {found.words}"),
        "largest_von_mises_MPa": (values.equivalent / MPa, "MPa", f"largest von Mises {over}"),
        "largest_principal_MPa": (values.principal / MPa, "MPa", f"largest principal {over}"),
        "alternating_MPa": (values.alternating / MPa, "MPa", f"alternating stress {over}"),
        "told": (found.told, "1", "whether the summary tells of the node"),
    }
    around = [_around_section(grid.nodes, cut, each / MPa) for each in _shown(values)]
    words = ("largest principal stress", "alternating stress")
    sections = {
        name: (values, "MPa", f"{what} {over}, all around")
        for name, values, what in zip(
            ("section_principal_MPa", "section_alternating_MPa"), around, words, strict=True
        )
    }
    return dataset_of(
        {
            "place_mm": Entry(("node", "coordinate"), grid.nodes / mm, "mm", "place of a node"),
            "face": Entry(("face", "corner"), surface(grid), "1", FACE),
            "section_mm": Entry(("element", "corner", "r_z"), cut / mm, "mm", "section"),
            **entries_over(("node",), rows),
            **entries_over(("element",), sections),
            "mesh_angle_deg": Entry((), towards / deg, "deg", "where the mesh is, about Z from x"),
        },
        coordinate=Entry(("coordinate",), list("xyz"), "1", "axis of the body"),
    ).assign_attrs(gear=gear, under=found.words, covered=found.covered)


def _shown(values: StressRange) -> tuple[np.ndarray, np.ndarray]:
    return values.principal, values.alternating


def _around_section(nodes: np.ndarray, cut: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Largest value all around, in the mean over the nodes of each element of a section."""
    places = np.stack([radius_of(nodes), nodes[:, 2]], axis=1)
    near = 1e-6 * float(places[:, 0].max())
    _, ring = np.unique(np.round(places / near).astype(int), axis=0, return_inverse=True)
    largest = np.full(ring.max() + 1, -np.inf)
    np.maximum.at(largest, ring.ravel(), values)
    _, nearest = scipy.spatial.KDTree(places).query(cut.reshape(-1, 2))
    return largest[ring.ravel()[nearest]].reshape(cut.shape[:2]).mean(axis=1)


def stress_summary(found: Mapping[str, StressMap]) -> list[Summary]:
    """The largest stresses of each body, and where; away from teeth and seats."""
    return [
        {
            "gear": gear,
            **_largest("largest_principal", each, each.range.principal),
            **_largest("largest_von_mises", each, each.range.equivalent),
            **_largest("alternating", each, each.range.alternating),
            "share_of_revolution": each.covered,
        }
        for gear, each in found.items()
    ]


def _largest(name: str, found: StressMap, values: np.ndarray) -> Summary:
    node = int(np.argmax(np.where(found.told, values, -np.inf)))
    place = found.built.body.nodes[node]
    return {
        f"{name}_MPa": float(values[node] / MPa),
        f"{name}_at_radius_mm": float(np.hypot(place[0], place[1]) / mm),
        f"{name}_at_height_mm": float(place[2] / mm),
    }


def stress_writer(found: StressMap) -> Callable[[Path], None]:
    """A function that writes the grid with its stresses to a path, for ParaView."""
    values = found.range
    names = ("xx", "yy", "zz", "xy", "yz", "zx")
    at = {
        f"stress {name}, {found.words} [Pa]": found.stress[:, number]
        for number, name in enumerate(names)
    }
    fields = {
        "largest principal stress [Pa]": values.principal,
        "largest von Mises stress [Pa]": values.equivalent,
        "alternating stress [Pa]": values.alternating,
        **at,
    }
    return lambda path: write_vtu(path, found.grid, fields)
