"""Condensed bodies that vibrate, with all of their grid: what their nodes do."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy

import fem_prep
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._dynamic import forces_in_motion
from jaxgear._response._waves import BodyMotion, Circle, circle_of
from jaxgear._response._whole_motion import WholeBody, beyond_in_steps
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._body_modes import BodyBasis
from jaxgear._system._held_body import held_answers
from jaxgear.scene._body_build import BuiltBody
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import damping_of
from jaxgear.study._hybrid import Moving, radius_of
from jaxgear.study._progress import say

# Nodes on one circle, over the radius.
SAME_CIRCLE = 1e-4


@dataclasses.dataclass(frozen=True, eq=False)
class MovingBody:
    """A condensed body that vibrates, and all of its grid.

    **Fields:**

    - `gear`: `pinion` or `wheel`.
    - `built`: the body.
    - `basis`: its motions, as the pair in motion has them.
    - `natural`: natural modes of which these are combinations.
    - `teeth`: of the gear.
    - `gear_seat`: number of the seat against which waves are told.
    - `heat_load`: on its coordinates per free strain of hub and rim, shape `[2, dof]`; no rows:
        it cannot warm [N, N m].
    """

    gear: str
    built: BuiltBody
    basis: BodyBasis
    natural: BodyBasis
    teeth: int
    gear_seat: int = 0
    heat_load: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def index(self) -> int:
        """0 for the pinion, 1 for the wheel."""
        return GEARS.index(self.gear)

    @property
    def motions(self) -> np.ndarray:
        """Motion of its coordinates per coordinate of `WholeModes.motion`, `[dof, coordinate]`."""
        return self.natural.motions

    @property
    def radius(self) -> float:
        """Of the rim [m]."""
        return float(np.median(radius_of(self.built.body.rim_nodes)))

    @property
    def has_grid(self) -> bool:
        """Whether more is known of it than its rim and its seats."""
        return len(self.built.body.nodes) > 0

    @property
    def nodes(self) -> np.ndarray:
        """Places of all nodes that can be looked at, shape `[node, 3]` [m]."""
        return self.built.body.nodes if self.has_grid else self.built.body.rim_nodes

    @functools.cached_property
    def _rim(self) -> np.ndarray:
        """Which rim node each node is, or -1."""
        # Of each rim node its place in the grid, whatever order either is in.
        places = self.built.body.rim_nodes
        _, where = scipy.spatial.KDTree(self.nodes).query(places)
        found = np.full(len(self.nodes), -1)
        found[where] = np.arange(len(places))
        return found

    @property
    def _held(self) -> fem_prep.FixedInterface:
        with in_keys(self.gear):
            return self.built.held(lambda step: say(f"{self.gear}: {step}"))

    def left_out(self, load: np.ndarray) -> np.ndarray:
        """Static answers to loads, the seats held, less what of them is in the modes.

        **Arguments:**

        - `load`: on the coordinates, shape `[dof, column]` [N, N m].

        **Returns:**

        Coordinates, shape `[dof, column]` [m, rad].
        """
        return self.basis.left_out(held_answers(self.built.body, load.T), load.T).T

    def rows(self, chosen: np.ndarray) -> np.ndarray:
        """Displacements per coordinate of a motion, of the nodes with these numbers.

        Along x, y, z of the body, shape `[node, 3, coordinate]` [-, m, kg^-1/2]. Those of the rim
        are coordinates of the condensed body; all others follow by its grid, which is then
        factorised again.
        """
        rim = self._rim[chosen]
        if np.all(rim >= 0):
            return self.motions[3 * rim[:, None] + np.arange(3)]
        return self.coordinate_rows(chosen) @ self.motions

    def coordinate_rows(self, chosen: np.ndarray) -> np.ndarray:
        """The same per coordinate of the condensed body, shape `[node, 3, dof]` [-, m]."""
        body, rim = self.built.body, self._rim[chosen]
        result = np.zeros((len(chosen), 3, body.dofs))
        outside, inside = np.flatnonzero(rim >= 0), np.flatnonzero(rim < 0)
        for way in range(3):
            result[outside, way, 3 * rim[outside] + way] = 1.0
        if inside.size:
            result[inside] = fem_prep.displacement_rows(self._held, body, chosen[inside])
        return result

    def field(self, motions: np.ndarray) -> np.ndarray:
        """Displacements of all nodes in motions of the condensed body, `[column, node, 3]` [m]."""
        if not self.has_grid:
            count = 3 * len(self.nodes)
            return motions[:count].T.reshape(-1, len(self.nodes), 3)
        return fem_prep.recovered_displacements(self._held, self.built.body, motions)

    def shape(self, motion: BodyMotion, order: float | int) -> np.ndarray:
        """Operating deflection shape of one order of the gear's rotation, against its seat.

        Complex amplitude of all nodes along x, y, z of the body, shape `[node, 3]` [m].
        """
        own = motion.on_body(order)
        whole = self.motions @ own
        real, imaginary = self.field(np.stack([np.real(whole), np.imag(whole)], axis=1))
        return real + 1j * imaginary - self.with_seat(self.nodes) @ own[self.seat]

    @property
    def seat(self) -> slice:
        """Coordinates of the gear's seat, in a `BodyMotion`."""
        return slice(6 * self.gear_seat, 6 * self.gear_seat + 6)

    def with_seat(self, places: np.ndarray) -> np.ndarray:
        """Displacements of places that move as one with the gear's seat, per motion of it.

        Along x, y, z of the body, shape `[place, 3, 6]` [-, m].
        """
        rigid = fem_prep.rigid_motions(places - self.built.body.seat_points[self.gear_seat])
        return rigid.reshape(-1, 3, 6)

    def circle(self, chosen: np.ndarray, *, against_seat: bool = False) -> Circle:
        """The circle of some nodes; their motion may be told against the gear's seat."""
        rows = self.rows(chosen)
        if against_seat:
            rows[:, :, self.seat] -= self.with_seat(self.nodes[chosen])
        return circle_of(angle_of(self.nodes[chosen]), rows)

    def rim_circles(self) -> list[Circle]:
        """Circles of the rim: at both ends and in the middle, of those with the most nodes.

        Against the gear's seat: what the gear does as a whole is no wave in it.
        """
        heights = np.round(self.built.body.rim_nodes[:, 2] / (SAME_CIRCLE * self.radius))
        each, count = np.unique(heights, return_counts=True)
        full = each[count == count.max()]
        rim = np.flatnonzero(self._rim >= 0)
        own = np.round(self.nodes[rim, 2] / (SAME_CIRCLE * self.radius))
        places = sorted({0, len(full) // 2, len(full) - 1})
        return [self.circle(rim[own == full[place]], against_seat=True) for place in places]


def angle_of(places: np.ndarray) -> np.ndarray:
    """Angles of places about Z, from x [rad]."""
    return np.arctan2(places[:, 1], places[:, 0])


def moving_bodies(
    bodies: Mapping[str, Any], gears: Mapping[str, GearKeys]
) -> Mapping[str, MovingBody]:
    """The condensed bodies of a scene, made to move, by gear."""
    found = {}
    for gear, mesh_body in bodies.items():
        sectors = mesh_body.built.body.facts.get("sectors", 1)
        teeth, seat = gears[gear].teeth, mesh_body.flexible.gear_seat
        basis, _ = mesh_body.basis.under_teeth(teeth, sectors)
        natural = basis if mesh_body.made_of is None else mesh_body.made_of
        heated, dofs = mesh_body.heated, mesh_body.built.body.dofs
        load = np.zeros((0, dofs)) if heated is None else heated.load
        found[gear] = MovingBody(gear, mesh_body.built, basis, natural, teeth, seat, load)
    return found


# --- In a response


def whole_body(scene: Scene, body: MovingBody) -> WholeBody:
    """A scene's body on the natural modes of which its shapes are combinations."""
    own = scene.bodies[body.gear]
    return WholeBody(
        flexible=own.of_modes,
        into=own.into,
        shape_waves=body.basis.waves,
        damping=damping_of(scene.damping),
        rotating=scene.model.gyroscopic,
    )


def moving_in(
    scene: Scene, pair: PairDynamics, orbit: Orbit, law: AbstractContactLaw, body: MovingBody
) -> Moving:
    """Seats, and natural modes beyond rest, of a body in a steady response, step by step."""
    found = beyond_in_steps(whole_body(scene, body), pair, orbit, law, body.index)
    seats = body.natural.following.shape[1]
    return Moving(found[:, :seats], found[:, seats:], body.natural)


def cycle_in_motion(pair: PairDynamics, orbit: Orbit, law: AbstractContactLaw) -> MeshCycle:
    """The cells of a pair under the forces of a steady response, as long as that takes to repeat.

    Only forces and lines are those of the response.
    """
    cycle, lines = pair.cycle, pair.cycle.cells.lines
    force = forces_in_motion(pair, orbit, law)
    times = len(force) // len(lines.phase)
    again = lambda x: jnp.concatenate([x] * times)
    of = lambda one, *names: {
        name: None if getattr(one, name) is None else again(getattr(one, name)) for name in names
    }
    ahead = np.repeat(lines.periods * np.arange(float(times)), len(lines.phase))
    longer = dataclasses.replace(
        lines,
        phase=again(lines.phase) + ahead,
        weight=again(lines.weight) / times,
        kept=None,
        periods=lines.periods * times,
        **of(lines, "tooth", "roll", "fraction"),
    )
    names = "line_stiffness", "stiffness", "coupling", "arm", "seat_arms", "growth", "spread"
    cells = dataclasses.replace(cycle.cells, lines=longer, **of(cycle.cells, *names))
    rest = of(cycle, "approach", "load", "overlap", "converged", "steps")
    return dataclasses.replace(cycle, cells=cells, force=force, **rest)
