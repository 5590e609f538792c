"""What only models with condensed bodies say: how bodies give under their teeth, and where.

The contact solution knows forces of cells and motions of seats. With them every body is loaded once
more, in its own frame, at each phase: what its rim and all of its grid do follows without any
further assumption. Motions are told against the seat at which the gear's torque acts, so that
bearings, the shaft's bending up to there and the rigid turn of the gear are no part of them.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array

from fem_prep import ReducedBody, rigid_motions
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._roots import Axial, InterfaceMap, RimSurface, interface_map
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._body_heat import no_strain
from jaxgear._system._body_modes import BodyBasis, wave_partners
from jaxgear._system._body_tables import root_patches, teeth_on_lines
from jaxgear._system._flexible import condensed
from jaxgear._system._foot_tables import foot_weights
from jaxgear._system._model import PairModel
from jaxgear._types import Reals
from jaxgear.scene._mesh_bodies import MeshBody

DIRECTIONS = ("radial", "tangential", "axial")


# --- One body under the loads of its teeth


@dataclasses.dataclass(frozen=True)
class Moving:
    """A condensed body in a steady response, in coordinates that stand still in space.

    **Fields:**

    - `seats`: their motion, shape `[step, 6 seat]` [m, rad].
    - `modes`: amplitudes beyond what their loads give at rest, shape `[step, mode]` [m kg^1/2].
    - `basis`: on which the body vibrates.
    """

    seats: np.ndarray
    modes: np.ndarray
    basis: BodyBasis

    def inertia(self, at: slice, turn: np.ndarray) -> np.ndarray:
        """Coordinates beyond the static answer to the loads, `[phase, dof]` [m, rad].

        **Arguments:**

        - `at`: which steps.
        - `turn`: of the body's x from S, shape `[phase]` [rad].
        """
        partner, number = wave_partners(self.basis.waves)
        by, modes = np.multiply.outer(turn, np.asarray(number)), self.modes[at]
        own = np.cos(by) * modes + np.sin(by) * modes[:, partner]
        return own @ self.basis.shapes.T


class BodyUnderTeeth:
    """A condensed body in a solved cycle.

    **Fields:**

    - `body`: the condensed body.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `gear_seat`: number of the seat against which motions are told.
    - `spin`: speed of this gear [rad/s].
    - `rotation`: coordinates of the body under rotation alone, shape `[dof]` [m, rad].
    - `heated`: what heat does to it, or `None`.
    - `strain`: free strains of hub and rim by heat, shape `[2]` [-].
    - `warmth`: coordinates of the body under heat alone, shape `[dof]` [m, rad].
    - `phases`: in one mesh period.
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
        moving: "Moving | None" = None,
    ):
        self.body: ReducedBody = mesh_body.built.body
        self.index = index
        self.gear_seat = mesh_body.flexible.gear_seat
        self.phases = cycle.approach.size // cycle.cells.lines.periods
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
        by_rotation = by_heat = np.zeros(cycle.system.structure.map.size)
        if self.spin and moving is None:
            by_rotation = np.asarray(_rotation_offset(model, cycle))
        self.heated, self.strain = mesh_body.heated, np.asarray(strain_of(model, index))
        load = np.zeros((2, self.body.dofs)) if self.heated is None else self.heated.load
        if any(each.heat is not None for _, each in condensed(model.bodies)):
            by_heat = np.asarray(_heat_offset(model))
        still = np.asarray(_displacement(cycle)) - by_rotation - by_heat
        # In motion the seats say all that moves them; without the load of rotation, which is not
        # in the cycle's structure then.
        own_seats = still[:, own] if moving is None else moving.seats - by_heat[own]
        self._seat_motion, self._moving = own_seats, moving
        spun, warm = self.spin**2 * self.body.centrifugal_load, self.strain @ load
        self.rotation = self._follow(spun[None], by_rotation[None, own])[0]
        self.warmth = self._follow(warm[None], by_heat[None, own])[0]

    @property
    def at_rest(self) -> np.ndarray:
        """Coordinates under rotation and heat, which stand still on the body, `[dof]` [m, rad]."""
        return self.rotation + self.warmth

    @property
    def warm_inside(self) -> np.ndarray:
        """Motion of the nodes of the grid by heat, rim and seats held, `[node, 3]` [m]."""
        if self.heated is None:
            return np.zeros_like(self.body.nodes)
        return np.tensordot(self.strain, self.heated.inside, axes=1)

    def _follow(self, load: np.ndarray, seats: np.ndarray) -> np.ndarray:
        """Coordinates under loads on all but the seats, whose motions are given: rows of each."""
        right = load[:, self._inner] - seats @ self._joined.T
        motion = np.zeros((len(load), self.body.dofs))
        motion[:, self._seats] = seats
        motion[:, self._inner] = scipy.linalg.cho_solve(
            self._factor, right.T, overwrite_b=True, check_finite=False
        ).T
        return motion

    def feet_of(self, period: int) -> tuple[InterfaceMap, np.ndarray]:
        """Feet of the teeth in mesh in one period, line by line, and their angles in the body."""
        teeth = teeth_on_lines(self.index, self._grid, period + 1)[period] % self._teeth
        patches = root_patches(
            self._pair, self.index, self._grid, teeth, points=self._points, axial=self._axial
        )
        surface = RimSurface(self.body.rim_nodes, self.body.rim_faces)
        return interface_map(surface, patches), patches.angles.ravel()

    def under_mesh(self, period: int) -> "PeriodMotion":
        """The body at all phases of one mesh period, by the loads on gears alone."""
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
        inertia = np.zeros((1, self.body.dofs))
        if self._moving is not None:
            inertia = self._moving.inertia(at, turn)
        return PeriodMotion(motion, load, turn, found, np.asarray(weights), inertia)

    def against_seat(self, motion: np.ndarray) -> np.ndarray:
        """The rim without the rigid motion of the gear's seat, `[row, rim, 3]` along x, y, z [m].

        Of coordinates of the body, shape `[row, dof]` [m, rad].
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
    - `inertia`: of the coordinates, what a body in motion has beyond its static answer, shape
        `[phase, dof]`, or one row of zeros [m, rad].
    """

    motion: np.ndarray
    load: np.ndarray
    turn: np.ndarray
    feet: InterfaceMap
    weights: np.ndarray
    inertia: np.ndarray

    def on_feet(self, rim: np.ndarray) -> np.ndarray:
        """Motions of feet along and about radius, tangent, axis, `[phase, cell, 6]` [m, rad].

        They follow from those of the rim along x, y, z of the body, shape `[phase, rim, 3]` [m].
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


@eqx.filter_jit
def _heat_offset(model: PairModel) -> Array:
    """Motion of the structure by heat alone."""
    warm = lambda m: [body.heat.strain for _, body in condensed(m.bodies) if body.heat is not None]
    cold = eqx.tree_at(warm, model, [jnp.zeros_like(each) for each in warm(model)])
    return model.system().statics.offset - cold.system().statics.offset


def strain_of(model: PairModel, index: int) -> Array:
    """Free strains of hub and rim of a condensed body; zero if it was made without heat [-].

    **Arguments:**

    - `model`: the pair.
    - `index`: 0 for the pinion, 1 for the wheel.
    """
    heat = dict(condensed(model.bodies))[index].heat
    return no_strain() if heat is None else heat.strain


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
    """Radial, tangential and axial parts of vectors at places `[place, 3]` [m], in their shape."""
    radius = np.maximum(radius_of(places), 1e-12)
    x, y = places[:, 0] / radius, places[:, 1] / radius
    radial = x * vectors[..., 0] + y * vectors[..., 1]
    tangential = x * vectors[..., 1] - y * vectors[..., 0]
    return np.stack([radial, tangential, vectors[..., 2]], axis=-1)


def radius_of(places: np.ndarray) -> np.ndarray:
    """Distance of places, shape `[place, 3]`, from the axis [m]."""
    return np.hypot(places[:, 0], places[:, 1])
