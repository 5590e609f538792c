"""All that a run says of its condensed bodies: how they give under their teeth, and where."""

import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from fem_prep import Grid, ReducedBody, rim_rows, surface_mass
from jaxgear._solve._cycle import MeshCycle
from jaxgear._units import um
from jaxgear.scene._body_build import BuiltBody
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._mesh_bodies import MeshBody
from jaxgear.scene._schema import GEARS
from jaxgear.scene._tables import MeshKeys
from jaxgear.study._hybrid import DIRECTIONS, BodyUnderTeeth, along_radius, radius_of
from jaxgear.study._result import Summary
from jaxgear.study._statics import Statics


@dataclasses.dataclass(frozen=True)
class BodyField:
    """Displacements of a body, in its own frame.

    **Fields:**

    - `what`: does it: "mesh", "rotation" or "heat".
    - `words`: where that is, for a title.
    - `motion`: its coordinates, shape `[dof]` [m, rad].
    - `rim`: against the gear's seat, shape `[rim, 3]` [m].
    - `turn`: angle of the body's x from S, about Z [rad].
    - `field`: the whole grid against that seat, shape `[node, 3]` [m].
    """

    what: str
    words: str
    motion: np.ndarray
    rim: np.ndarray
    turn: float
    field: np.ndarray

    @property
    def largest(self) -> float:
        """Largest displacement of any node [m]."""
        return float(np.linalg.norm(self.field, axis=1).max())


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
    numbers: Summary
    fields: tuple[BodyField, ...]

    @property
    def grid(self) -> Grid:
        """The body's grid, with its rim as a set."""
        view = self.built.view
        sets = {} if view is None else {"rim": view.sets["rim"]}
        return Grid(self.built.body.nodes, self.built.body.bricks, MappingProxyType(sets))


def body_answers(
    mesh: MeshKeys,
    bodies: Mapping[str, MeshBody],
    statics: Statics,
    tell: Callable[[str], None] = lambda step: None,
) -> list[BodyAnswer]:
    """How the condensed bodies of a scene give over its solved cycle, the pinion's first.

    What begins is told.
    """
    return [
        _body_answer(
            body_under_teeth(mesh, gear, bodies[gear], statics),
            gear,
            bodies[gear].built,
            statics.cycle,
            lambda step, gear=gear: tell(f"{gear}: {step}"),
        )
        for gear in GEARS
        if gear in bodies
    ]


def body_under_teeth(mesh: MeshKeys, gear: str, body: MeshBody, statics: Statics) -> BodyUnderTeeth:
    """A condensed body of a scene in its solved cycle, to be looked at in any mesh period."""
    return BodyUnderTeeth(
        body,
        GEARS.index(gear),
        statics.model,
        statics.grid,
        statics.cycle,
        points=mesh.root_points,
        axial=mesh.connection,
    )


def _body_answer(
    under: BodyUnderTeeth,
    gear: str,
    built: BuiltBody,
    cycle: MeshCycle,
    tell: Callable[[str], None],
) -> BodyAnswer:
    tell("motion under its teeth")
    body, worst, fit = built.body, worst_phase(cycle), rim_rows(built.body)
    roots, largest, web, unknown = [], [], [], np.zeros((0, 3))
    shown: BodyField | None = None
    lines = cycle.cells.lines
    for period in range(lines.periods):
        found = under.under_mesh(period)
        rim = under.against_seat(found.motion)
        roots.append(found.on_feet(rim)[:, :, :3])
        largest.append(np.abs(along_radius(body.rim_nodes, rim)).max(axis=1))
        web.append(rim.reshape(len(rim), -1) @ fit.T)
        if worst // under.phases == period:
            at = worst % under.phases
            words = f"the mesh at phase {float(lines.phase[worst]):.3f}"
            turn = float(found.turn[at])
            shown = BodyField("mesh", words, found.motion[at], rim[at], turn, unknown)
    assert shown is not None
    cases = [shown]
    if under.spin:
        grown = under.against_seat(under.rotation[None])[0]
        words = f"rotation at {under.spin:.5g} rad/s"
        cases.append(BodyField("rotation", words, under.rotation, grown, shown.turn, unknown))
    if under.heated is not None:
        grown = under.against_seat(under.warmth[None])[0]
        cases.append(BodyField("heat", "heat", under.warmth, grown, shown.turn, unknown))
    fields: tuple[BodyField, ...] = ()
    if len(body.nodes):
        tell("the whole grid")
        fields = _on_grid(under, built, cases)
    over_rim, over_web = np.concatenate(largest), np.concatenate(web)
    return BodyAnswer(
        gear=gear,
        built=built,
        roots=np.concatenate(roots).reshape(*lines.roll.shape, 3),
        rim=over_rim,
        web=over_web,
        numbers={
            "largest_load_at_phase": float(lines.phase[worst]),
            **_numbers(under, over_rim, np.abs(over_web), cases, fields),
        },
        fields=fields,
    )


def worst_phase(cycle: MeshCycle) -> int:
    """The phase of the largest force on a slice of full length, at which bodies are shown."""
    force = np.asarray(cycle.force).reshape(cycle.cells.lines.roll.shape)
    full = np.asarray(cycle.cells.lines.fraction) >= 0.5
    return int(np.argmax(np.where(full, force, 0.0).max(axis=(1, 2))))


def _on_grid(
    under: BodyUnderTeeth, built: BuiltBody, cases: list[BodyField]
) -> tuple[BodyField, ...]:
    """What loads a body, with its whole grid."""
    motions = np.stack([case.motion for case in cases])
    speeds = np.asarray([under.spin if case.what == "rotation" else 0.0 for case in cases])
    fields = whole_motion(built, motions, speeds) - under.seat_field(motions, built.body.nodes)
    fields += np.stack([(case.what == "heat") * under.warm_inside for case in cases])
    whole = zip(cases, fields, strict=True)
    return tuple(dataclasses.replace(case, field=field) for case, field in whole)


def whole_motion(built: BuiltBody, motions: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Displacements of all nodes of a body's grid, shape `[row, node, 3]` [m].

    They follow from its condensed coordinates under loads on rim and seats, shape `[row, dof]`
    [m, rad], and the speed of rotation that loads the inside too, shape `[row]` [rad/s].
    """
    with in_keys(built.plan.gear):
        held = built.held()
        full = held.full
        inside = held.followed(motions[:, : built.body.boundary_dofs].T)
        if np.any(speeds):
            inside = inside + held.loaded(full.centrifugal_load[:, None] * speeds**2)
        return full.on_nodes(inside)


def _numbers(
    under: BodyUnderTeeth,
    rim: np.ndarray,
    web: np.ndarray,
    cases: list[BodyField],
    fields: tuple[BodyField, ...],
) -> Summary:
    """The largest of all phases, and of all nodes where they are known."""
    body = under.body
    radius = float(np.median(radius_of(body.rim_nodes)))
    along = lambda key, values: {
        f"{key}_{name}_um": float(x) for name, x in zip(DIRECTIONS, values / um, strict=True)
    }
    numbers = along("rim", rim.max(axis=0)) | {
        "web_shift_um": float(radius_of(web).max() / um),
        "web_axial_um": float(web[:, 2].max() / um),
        "web_tilt_urad": float(radius_of(web[:, 3:]).max() * 1e6),
        "web_wind_up_um": float(web[:, 5].max() * radius / um),
    }
    for case in cases[1:]:
        name = {"rotation": "growth", "heat": "heat_growth"}[case.what]
        if case.what == "rotation":
            numbers["speed_rad_s"] = under.spin
        numbers[f"{name}_mean_radial_um"] = mean_growth(body, case.rim) / um
        numbers |= along(name, np.abs(along_radius(body.rim_nodes, case.rim)).max(axis=0))
    keys = {
        "mesh": "body_deflection_um",
        "rotation": "body_growth_um",
        "heat": "body_heat_growth_um",
    }
    return numbers | {keys[each.what]: each.largest / um for each in fields}


def mean_growth(body: ReducedBody, moved: np.ndarray) -> float:
    """Mean radial displacement of a rim that moves so, `[rim, 3]`, by its area; outwards positive.

    In metres, as the motion [m].
    """
    outward = body.rim_nodes * np.array([1.0, 1.0, 0.0])
    outward = (outward / radius_of(body.rim_nodes)[:, None]).ravel()
    area = surface_mass(body.rim_nodes, body.rim_faces) @ outward
    return float(area @ moved.ravel() / (area @ outward))
