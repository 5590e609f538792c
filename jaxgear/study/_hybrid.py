"""What only models with condensed bodies say: how bodies give under their teeth, and where.

The contact solution knows forces of cells and motions of seats. With them every body is loaded once
more, in its own frame, at each phase: what its rim and all of its grid do follows without any
further assumption. Motions are told against the seat at which the gear's torque acts, so that
bearings, the shaft's bending up to there and the rigid turn of the gear are no part of them.
"""

import dataclasses
from collections.abc import Callable, Iterator
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array

from fem_prep import Grid, ReducedBody, hold, rigid_motions, rim_rows, surface_mass
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._roots import Axial, Feet, RimSurface, feet
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._flexible import foot_weights, root_patches, teeth_on_lines
from jaxgear._system._model import PairModel
from jaxgear._types import Reals
from jaxgear._units import um
from jaxgear.scene._body_build import BuiltBody, Steps, full_of
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._mesh_bodies import MeshBody
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._statics import Statics

DIRECTIONS = ("radial", "tangential", "axial")


# --- One body under the loads of its teeth


class BodyUnderTeeth:
    """A condensed body in a solved cycle.

    **Fields:**

    - `body`: the condensed body.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `gear_seat`: number of the seat against which motions are told.
    - `spin`: speed of this gear [rad/s].
    - `rotation`: coordinates of the body under rotation alone, shape `[dof]` [m, rad].
    """

    def __init__(
        self,
        mesh_body: MeshBody,
        index: int,
        model: PairModel,
        grid: MeshGrid,
        cycle: MeshCycle,
        *,
        points: int,
        axial: Axial,
    ):
        self.body: ReducedBody = mesh_body.built.body
        self.index = index
        self.gear_seat = mesh_body.flexible.gear_seat
        teeth = (model.pair.pinion.teeth, model.pair.wheel.teeth)
        self.spin = float(model.speed) * teeth[0] / teeth[index]
        self._components = list(mesh_body.flexible.components)
        self._pair, self._grid, self._cycle = model.pair, grid, cycle
        self._points, self._teeth = points, teeth[index]
        self._axial: Axial = axial
        self._rim = 3 * len(self.body.rim_nodes)
        self._seats = np.arange(self._rim, self._rim + 6 * len(self.body.seats))
        self._inner = np.setdiff1d(np.arange(self.body.dofs), self._seats)
        stiffness = self.body.stiffness
        self._joined = stiffness[np.ix_(self._inner, self._seats)]
        inside = stiffness[np.ix_(self._inner, self._inner)]
        self._factor = scipy.linalg.cho_factor(
            inside, lower=True, overwrite_a=True, check_finite=False
        )
        own = _own_nodes(cycle, index, len(self.body.seats))
        by_rotation = np.zeros(cycle.system.structure.map.size)
        if self.spin:
            by_rotation = np.asarray(_rotation_offset(model, cycle))
        still = np.asarray(_displacement(cycle)) - by_rotation
        self._seat_motion = still[:, own]
        self.rotation = self._follow(
            self.spin**2 * self.body.centrifugal_load[None], by_rotation[None, own]
        )[0]

    def _follow(self, load: np.ndarray, seats: np.ndarray) -> np.ndarray:
        """Coordinates under loads on all but the seats, whose motions are given: rows of each."""
        right = load[:, self._inner] - seats @ self._joined.T
        motion = np.zeros((len(load), self.body.dofs))
        motion[:, self._seats] = seats
        motion[:, self._inner] = scipy.linalg.cho_solve(
            self._factor, right.T, overwrite_b=True, check_finite=False
        ).T
        return motion

    @property
    def phases(self) -> int:
        """Phases in one mesh period."""
        return self._cycle.approach.size // self._cycle.cells.lines.periods

    def feet_of(self, period: int) -> tuple[Feet, np.ndarray]:
        """Feet of the teeth in mesh in one period, line by line, and their angles in the body."""
        teeth = teeth_on_lines(self.index, self._grid, period + 1)[period] % self._teeth
        patches = root_patches(
            self._pair, self.index, self._grid, teeth, points=self._points, axial=self._axial
        )
        surface = RimSurface(self.body.rim_nodes, self.body.rim_faces)
        return feet(surface, patches), patches.angles.ravel()

    def under_mesh(self, period: int) -> "PeriodMotion":
        """The body at all phases of one mesh period, by the loads on gears, none of rotation."""
        at = slice(period * self.phases, (period + 1) * self.phases)
        found, angles = self.feet_of(period)
        lines = self._cycle.cells.lines
        weights, fixed = _weights(
            self._pair,
            self.index,
            jnp.asarray(found.centres),
            lines.roll[at],
            lines.face_position,
        )
        # What closes a cell is pushed back by its force.
        force = -np.asarray(weights) * np.asarray(self._cycle.force[at])[:, :, None]
        kept = np.zeros_like(force)
        kept[:, :, self._components] = force[:, :, self._components]
        load = np.zeros((self.phases, self.body.dofs))
        load[:, : self._rim] = kept.reshape(self.phases, -1) @ found.rows
        turn = np.asarray(fixed)[:, 0] - angles[0]
        motion = self._follow(load, _turned(self._seat_motion[at], -turn))
        return PeriodMotion(motion, load, turn, found, np.asarray(weights))

    def against_seat(self, motion: np.ndarray) -> np.ndarray:
        """Displacement of the rim without the rigid motion of the gear's seat.

        **Arguments:**

        - `motion`: coordinates of the body, shape `[row, dof]` [m, rad].

        **Returns:**

        Along x, y, z of the body, shape `[row, rim, 3]` [m].
        """
        rim = motion[:, : self._rim].reshape(len(motion), -1, 3)
        return rim - self.seat_field(motion, self.body.rim_nodes)

    def seat_field(self, motion: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Displacements of places that move as one with the gear's seat, `[row, place, 3]` [m]."""
        first = self._rim + 6 * self.gear_seat
        rigid = rigid_motions(places - self.body.seat_points[self.gear_seat])
        return (motion[:, first : first + 6] @ rigid.T).reshape(len(motion), -1, 3)


@dataclasses.dataclass(frozen=True)
class PeriodMotion:
    """A body at the phases of one mesh period, in its own frame.

    **Fields:**

    - `motion`: its coordinates, shape `[phase, dof]` [m, rad].
    - `load`: on them, those of the seats left out, shape `[phase, dof]` [N].
    - `turn`: angle of the body's x from S, about Z, shape `[phase]` [rad].
    - `feet`: of the teeth in mesh, line by line.
    - `weights`: approach of each cell per motion of its foot, shape `[phase, cell, 6]` [-, m].
    """

    motion: np.ndarray
    load: np.ndarray
    turn: np.ndarray
    feet: Feet
    weights: np.ndarray

    def on_feet(self, rim: np.ndarray) -> np.ndarray:
        """Motions of feet in their own frames from those of the rim.

        **Arguments:**

        - `rim`: displacement along x, y, z of the body, shape `[phase, rim, 3]` [m].

        **Returns:**

        Along and about radius, tangent and axis, shape `[phase, cell, 6]` [m, rad].
        """
        return (self.feet.rows @ rim.reshape(len(rim), -1).T).T.reshape(len(rim), -1, 6)


@eqx.filter_jit
def _weights(
    pair: GearPair, index: int, centres: Reals, roll: Reals, face_position: Reals
) -> tuple[Array, Array]:
    weights, angle = foot_weights(pair, index, centres, roll, face_position)
    return jnp.stack(weights, axis=-1), angle


@eqx.filter_jit
def _displacement(cycle: MeshCycle) -> Array:
    return cycle.system.displacement(cycle.load)


@eqx.filter_jit
def _rotation_offset(model: PairModel, cycle: MeshCycle) -> Array:
    """Motion of the structure by rotation alone: it is linear in its loads."""
    return cycle.system.statics.offset - model.system(speed=0.0).statics.offset


def _own_nodes(cycle: MeshCycle, index: int, seats: int) -> np.ndarray:
    """Degrees of freedom of the structure that are the seats of a body."""
    first = cycle.system.structure.map.loaded[index]
    assert len(first) == seats
    return (np.asarray(first)[:, None] + np.arange(6)).ravel()


def _turned(vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Vectors that follow each other in rows, turned about Z by an angle for each row."""
    x, y, z = np.moveaxis(vectors.reshape(len(vectors), -1, 3), 2, 0)
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turned = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=2)
    return turned.reshape(vectors.shape)


def along_radius(places: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Radial, tangential and axial parts of vectors.

    **Arguments:**

    - `places`: where they are, shape `[place, 3]` [m].
    - `vectors`: along x, y, z, shape `[..., place, 3]`.

    **Returns:**

    The same shape.
    """
    radius = np.maximum(np.hypot(places[:, 0], places[:, 1]), 1e-12)
    x, y = places[:, 0] / radius, places[:, 1] / radius
    radial = x * vectors[..., 0] + y * vectors[..., 1]
    tangential = x * vectors[..., 1] - y * vectors[..., 0]
    return np.stack([radial, tangential, vectors[..., 2]], axis=-1)


# --- All that a run says of its condensed bodies


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
        points=scene["mesh.root_points"],
        axial=scene["mesh.connection"],
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
    numbers = _numbers(under, answer, statics, fields, float(np.median(_radius(body.rim_nodes))))
    return dataclasses.replace(answer, numbers=numbers, fields=fields)


def worst_phase(cycle: MeshCycle) -> int:
    """The phase of the largest force on a slice of full length, at which bodies are shown."""
    force = np.asarray(cycle.force).reshape(cycle.cells.lines.roll.shape)
    full = np.asarray(cycle.cells.lines.fraction) >= 0.5
    return int(np.argmax(np.where(full, force, 0.0).max(axis=(1, 2))))


def _radius(places: np.ndarray) -> np.ndarray:
    return np.hypot(places[:, 0], places[:, 1])


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
    outward = (outward / _radius(body.rim_nodes)[:, None]).ravel()
    area = surface_mass(body.rim_nodes, body.rim_faces) @ outward
    return float(area @ moved.ravel() / (area @ outward))
