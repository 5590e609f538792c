"""All that a run says of its condensed bodies: how they give under their teeth, and where."""

import dataclasses
from collections.abc import Callable, Iterator
from types import MappingProxyType
from typing import Any

import numpy as np

from fem_prep import Grid, ReducedBody, hold, rim_rows, surface_mass
from jaxgear._solve._cycle import MeshCycle
from jaxgear._units import um
from jaxgear.scene._body_build import BuiltBody, Steps, full_of
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._mesh_bodies import MeshBody
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._hybrid import DIRECTIONS, BodyUnderTeeth, along_radius, radius_of
from jaxgear.study._statics import Statics


@dataclasses.dataclass(frozen=True)
class BodyField:
    """Displacements of a body's grid, in its own frame.

    **Fields:**

    - `what`: does it: "mesh" or "rotation".
    - `words`: where that is, for a title.
    - `field`: against the gear's seat, shape `[node, 3]` [m].
    - `rim`: the same of the rim, shape `[rim, 3]` [m].
    - `turn`: angle of the body's x from S, about Z [rad].
    """

    what: str
    words: str
    field: np.ndarray
    rim: np.ndarray
    turn: float


@dataclasses.dataclass(frozen=True)
class BodyAnswer:
    """What a run says of one condensed body.

    **Fields:**

    - `gear`: `pinion` or `wheel`.
    - `built`: the body.
    - `roots`: motion of the feet of slices against the gear's seat, along radius, tangent and
        axis, as the body's grid has it, shape `[phase, line, slice, 3]` [m].
    - `rim`: largest radial, tangential and axial displacement of the rim against that seat,
        shape `[phase, 3]` [m].
    - `web`: mean rigid motion of the whole rim, by its area, against it, along and about x, y, z
        of the body, shape `[phase, 6]` [m, rad].
    - `numbers`: for the summary, the unit in each key.
    - `fields`: of the whole grid; none of a body without one.
    """

    gear: str
    built: BuiltBody
    roots: np.ndarray
    rim: np.ndarray
    web: np.ndarray
    numbers: dict[str, Any]
    fields: tuple[BodyField, ...]

    @property
    def grid(self) -> Grid:
        """The body's grid, with its rim as a set."""
        view = self.built.view
        sets = {} if view is None else {"rim": view.sets["rim"]}
        return Grid(self.built.body.nodes, self.built.body.bricks, MappingProxyType(sets))


def body_answers(
    scene: Scene, statics: Statics, tell: Callable[[str], None] = lambda step: None
) -> list[BodyAnswer]:
    """How the condensed bodies of a scene give over its cycle.

    **Arguments:**

    - `scene`: with its condensed bodies.
    - `statics`: its solved cycle.
    - `tell`: told what begins.

    **Returns:**

    An answer for each condensed body, the pinion's first.
    """
    return [
        _body_answer(scene, gear, scene.bodies[gear], statics, tell)
        for gear in GEARS
        if gear in scene.bodies
    ]


def body_under_teeth(scene: Scene, gear: str, statics: Statics) -> BodyUnderTeeth:
    """A condensed body of a scene in its solved cycle.

    **Arguments:**

    - `scene`: with its condensed bodies.
    - `gear`: `pinion` or `wheel`.
    - `statics`: its solved cycle.

    **Returns:**

    The body, ready to be looked at in any mesh period.
    """
    return BodyUnderTeeth(
        scene.bodies[gear],
        GEARS.index(gear),
        statics.model,
        statics.grid,
        statics.cycle,
        points=scene.mesh.root_points,
        axial=scene.mesh.connection,
    )


def _body_answer(
    scene: Scene, gear: str, mesh_body: MeshBody, statics: Statics, tell: Callable[[str], None]
) -> BodyAnswer:
    tell(f"{gear}: motion under its teeth")
    under, body = body_under_teeth(scene, gear, statics), mesh_body.built.body
    worst = worst_phase(statics.cycle)
    fit = rim_rows(body)
    roots, largest, web, shown = [], [], [], None
    for period in range(statics.cycle.cells.lines.periods):
        found = under.under_mesh(period)
        rim = under.against_seat(found.motion)
        roots.append(found.on_feet(rim)[:, :, :3])
        largest.append(np.abs(along_radius(body.rim_nodes, rim)).max(axis=1))
        web.append(rim.reshape(len(rim), -1) @ fit.T)
        if worst // under.phases == period:
            at = worst % under.phases
            shown = found.motion[at], rim[at], float(found.turn[at])
    assert shown is not None
    shape = statics.cycle.cells.lines.roll.shape
    answer = BodyAnswer(
        gear=gear,
        built=mesh_body.built,
        roots=np.concatenate(roots).reshape(*shape, 3),
        rim=np.concatenate(largest),
        web=np.concatenate(web),
        numbers={},
        fields=(),
    )
    fields = tuple(_fields(under, mesh_body.built, statics, shown, tell))
    numbers = _numbers(under, answer, statics, fields, float(np.median(radius_of(body.rim_nodes))))
    return dataclasses.replace(answer, numbers=numbers, fields=fields)


def worst_phase(cycle: MeshCycle) -> int:
    """The phase of the largest force on a slice of full length, at which bodies are shown."""
    force = np.asarray(cycle.force).reshape(cycle.cells.lines.roll.shape)
    full = np.asarray(cycle.cells.lines.fraction) >= 0.5
    return int(np.argmax(np.where(full, force, 0.0).max(axis=(1, 2))))


def _fields(
    under: BodyUnderTeeth,
    built: BuiltBody,
    statics: Statics,
    shown: tuple[np.ndarray, np.ndarray, float],
    tell: Callable[[str], None],
) -> Iterator[BodyField]:
    """The whole grid under the mesh where the load is largest, and under rotation."""
    if not len(built.body.nodes):
        return
    tell(f"{built.plan.gear}: the whole grid")
    motion, rim, turn = shown
    phase = float(statics.cycle.cells.lines.phase[worst_phase(statics.cycle)])
    cases = [("mesh", f"the mesh at phase {phase:.3f}", motion, rim, 0.0)]
    if under.spin:
        grown = under.against_seat(under.rotation[None])[0]
        words = f"rotation at {under.spin:.5g} rad/s"
        cases.append(("rotation", words, under.rotation, grown, under.spin))
    motions = np.stack([each[2] for each in cases])
    fields = whole_motion(built, motions, np.asarray([each[4] for each in cases]))
    fields = fields - under.seat_field(motions, built.body.nodes)
    for (what, words, _, rim, _), field in zip(cases, fields, strict=True):
        yield BodyField(what, words, field, rim, turn)


def whole_motion(built: BuiltBody, motions: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Displacements of all nodes of a body's grid, from those of its rim and its seats.

    **Arguments:**

    - `built`: the body, with a grid.
    - `motions`: its condensed coordinates under loads on rim and seats, shape `[row, dof]`
        [m, rad].
    - `speeds`: of rotation that loads the inside too, shape `[row]` [rad/s].

    **Returns:**

    Shape `[row, node, 3]` [m].
    """
    with in_keys(built.plan.gear):
        full = full_of(built.plan, Steps(lambda step: None))
        held = hold(full)
        inside = held.followed(motions[:, : built.body.boundary_dofs].T)
        if np.any(speeds):
            inside = inside + held.loaded(full.centrifugal_load[:, None] * speeds**2)
        return full.on_nodes(inside)


def _numbers(
    under: BodyUnderTeeth,
    answer: BodyAnswer,
    statics: Statics,
    fields: tuple[BodyField, ...],
    radius: float,
) -> dict[str, Any]:
    """The largest of all phases, and of all nodes where they are known."""
    rim = dict(zip(DIRECTIONS, answer.rim.max(axis=0) / um, strict=True))
    web = np.abs(answer.web)
    phase = float(statics.cycle.cells.lines.phase[worst_phase(statics.cycle)])
    numbers: dict[str, Any] = {
        "largest_load_at_phase": phase,
        **{f"rim_{name}_um": float(value) for name, value in rim.items()},
        "web_shift_um": float(np.hypot(web[:, 0], web[:, 1]).max() / um),
        "web_axial_um": float(web[:, 2].max() / um),
        "web_tilt_urad": float(np.hypot(web[:, 3], web[:, 4]).max() * 1e6),
        "web_wind_up_um": float(web[:, 5].max() * radius / um),
    }
    if under.spin:
        grown = under.against_seat(under.rotation[None])[0]
        parts = along_radius(under.body.rim_nodes, grown)
        most = zip(DIRECTIONS, np.abs(parts).max(axis=0) / um, strict=True)
        numbers |= {
            "speed_rad_s": under.spin,
            "growth_mean_radial_um": mean_growth(under.body, grown) / um,
            **{f"growth_{name}_um": float(value) for name, value in most},
        }
    for field in fields:
        key = {"mesh": "body_deflection_um", "rotation": "body_growth_um"}[field.what]
        numbers[key] = float(np.linalg.norm(field.field, axis=1).max() / um)
    return numbers


def mean_growth(body: ReducedBody, moved: np.ndarray) -> float:
    """Mean radial displacement of a rim, by its area.

    **Arguments:**

    - `body`: the condensed body.
    - `moved`: displacement of its rim, shape `[rim, 3]` [m].

    **Returns:**

    Outwards positive [m].
    """
    outward = body.rim_nodes * np.array([1.0, 1.0, 0.0])
    outward = (outward / radius_of(body.rim_nodes)[:, None]).ravel()
    area = surface_mass(body.rim_nodes, body.rim_faces) @ outward
    return float(area @ moved.ravel() / (area @ outward))
