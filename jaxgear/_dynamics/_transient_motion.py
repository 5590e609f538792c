"""Equations of motion of a pair whose speed and torque change."""

from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array, Float

from jaxgear._dynamics._bodies import TurningTerms
from jaxgear._dynamics._cell_forces import cell_forces, mesh_load
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._schedule import Pieces, Schedule, pieces_of
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._table import MeshTable, place_shares
from jaxgear._dynamics._types import FreeMotions, Matrix, Vector, Vectors
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._solve._coordinates import on_coordinates
from jaxgear._types import CoordinateMatrix, Coordinates, Scalar

if TYPE_CHECKING:
    Axes = Array
    AxisCoordinates = Array
    AxisMatrix = Array
    AxisValues = Array
    AxisState = Array
else:
    Axes = Float[Array, "dof axis"]
    AxisCoordinates = Float[Array, "axis coordinate"]
    AxisMatrix = Float[Array, "axis axis"]
    AxisValues = Float[Array, "axis"]
    AxisState = Float[Array, "2 axis"]

# --- The equations of motion


class _Axes(eqx.Module):
    r"""What moves with inertia, and what follows without.

    **Fields:**

    - `shape`: $\Phi$, motion of each degree of freedom along each axis, $\Phi^TM\Phi = I$ but for
        motions that nothing holds [kg^-1/2, kg^-1/2 m^-1].
    - `follow`: motion of what is left out per load on it, or `None` [m/N].
    """

    shape: Axes
    follow: Matrix | None


def _axes(mass: Matrix, stiffness: Matrix, free: FreeMotions, kept: int | None) -> _Axes:
    """All motions but the free ones, or the slowest natural modes among them."""
    lower = jnp.linalg.cholesky(mass)
    held = lower.T @ free
    clear = jnp.eye(mass.shape[0]) - held @ held.T
    shape = jax.scipy.linalg.solve_triangular(lower, clear, lower=True, trans=1)
    if kept is None:
        # No eigenvectors: their derivatives do not exist where two frequencies meet.
        return _Axes(shape=shape, follow=None)
    square, modes = jnp.linalg.eigh(shape.T @ stiffness @ shape)
    first, last = free.shape[1], free.shape[1] + kept
    fast = shape @ modes[:, last:]
    return _Axes(shape=shape @ modes[:, first:last], follow=(fast / square[None, last:]) @ fast.T)


class TransientChoices(eqx.Module):
    """What selects a program.

    **Fields:**

    - `kept`: natural modes that move with inertia, or `None` for all.
    - `dense`: whether every step is kept.
    - `progress`: whether a meter is shown.
    - `most_steps`: before an integration is given up.
    """

    kept: int | None = eqx.field(static=True)
    dense: bool = eqx.field(static=True)
    progress: bool = eqx.field(static=True)
    most_steps: int = eqx.field(static=True)


class MovingPair(eqx.Module):
    r"""The equations of motion, $\ddot y + (\bar C + \Omega\bar G)\dot y + \bar K y = \bar F - g$.

    With condensed bodies $\bar K$ and $\bar F$ change with the speed.

    **Fields:**

    - `axes`: that are integrated along.
    - `stiffness`: with the mean mesh stiffness, along the axes [1/s2].
    - `damping`: along the axes [1/s].
    - `gyroscopic`: along the axes, per pinion speed, or `None` [-].
    - `turning`: of condensed bodies along the axes, its `load` by degrees of freedom, or `None`.
    - `mesh`: mesh coordinates per axis [kg^-1/2].
    - `vectors`: mesh coordinates per degree of freedom [-, m].
    - `load`: on each degree of freedom [N, N m].
    - `mean`: mesh stiffness that `stiffness` holds [N/m, N, N m].
    - `bow`: of bodies, place lost per mesh load, or `None` [m/N, 1/N, 1/(N m)].
    - `share`: place per place along the axes, with what follows, or `None` [-].
    - `yielding`: place lost per mesh load, with what follows, or `None` [m/N, 1/N, 1/(N m)].
    - `table`: the mesh over a cycle.
    - `law`: of contact.
    - `cell_damping`: of closed cells, or `None` [s].
    - `speed`: of the pinion, over the time since the start [rad/s].
    - `ratio`: of the load, over the time since the start [-].
    - `began`: integral of the speed at the start [rad].
    - `turn`: mesh periods per turn of the pinion, over a radian [1/rad].
    - `length`: displacement along an axis that counts as one [m kg^1/2].
    - `rate`: velocity that counts as much as a displacement of one [1/s].
    """

    axes: _Axes
    stiffness: AxisMatrix
    damping: AxisMatrix
    gyroscopic: AxisMatrix | None
    turning: TurningTerms | None
    mesh: AxisCoordinates
    vectors: Vectors
    load: Vector
    mean: CoordinateMatrix
    bow: CoordinateMatrix | None
    share: CoordinateMatrix | None
    yielding: CoordinateMatrix | None
    table: MeshTable
    law: AbstractContactLaw
    cell_damping: Scalar | None
    speed: Pieces
    ratio: Pieces
    began: Scalar
    turn: Scalar
    length: Scalar
    rate: Scalar

    def phase(self, time: Scalar, near: Scalar | None = None) -> Scalar:
        """Mesh periods gone through since the start [-]."""
        line = self.speed.at(time if near is None else near)
        return self.turn * (line.integral(time) - self.began)

    def place_and_load(
        self, time: Scalar, state: AxisState, near: Scalar | None = None
    ) -> tuple[Coordinates, Coordinates]:
        """Mesh coordinates [m, rad] and the load of the mesh on them [N, N m].

        What jumps is taken from the piece in which `near` lies, by default `time`.
        """
        near = time if near is None else near
        line, ratio = self.speed.at(near), self.ratio.at(near)
        driven = self._driven(state[0] * self.length, ratio.value(time))
        at = lambda time: self.turn * (line.integral(time) - self.began)
        within = at(near)
        mesh = mesh_at_phase(self.table, at(time), within).at(line.value(time))
        place = driven
        if self.yielding is not None:
            place = _yielded_place(mesh, driven, self.yielding, self.law)
        if self.cell_damping is None:
            return place, on_coordinates(mesh.arms, cell_forces(mesh, place, self.law)[0])

        # Cells damp by the rates of the nodes, as in every other method.
        load, tangent = mesh_load(mesh, place, self.law)
        closing = self._driven(state[1] * self.length * self.rate, ratio.slope)
        return place, load + self.cell_damping * (tangent @ closing)

    def _driven(self, along: AxisValues, ratio: Scalar) -> Coordinates:
        """Mesh coordinates before the mesh makes anything yield."""
        place = self.mesh.T @ along
        if self.axes.follow is not None:
            place += ratio * (self.vectors.T @ (self.axes.follow @ self.load))
        return place if self.share is None else self.share @ place

    def excess(self, place: Coordinates, load: Coordinates) -> Coordinates:
        """What the mean mesh stiffness holds back more than the mesh does [N, N m]."""
        whole = place if self.bow is None else place + self.bow @ load
        return self.mean @ whole - load

    def slope(self, time: Scalar, state: AxisState, near: Scalar | None = None) -> AxisState:
        """Derivative of the state by time [1/s]; `near` as in `place_and_load`."""
        near = time if near is None else near
        excess = self.excess(*self.place_and_load(time, state, near))
        ratio, turns = self.ratio.at(near).value(time), self.speed.at(near).value(time)
        load, stiffness = ratio * self.load, self.stiffness
        if self.turning is not None:
            load = load + turns**2 * self.turning.load
            # The velocity on a body, $\dot x + \Omega Bx$, changes with the speed: $MB = G/2$.
            quicker = 0.5 * self.speed.at(near).slope * self.turning.gyroscopic
            stiffness = stiffness + self.turning.stiffness_at(turns) + quicker
        pull = self.axes.shape.T @ load + self.mesh @ excess
        along, speed = state[0], self.rate * state[1]
        losing = self.damping @ speed
        if self.gyroscopic is not None:
            losing += turns * (self.gyroscopic @ speed)
        acceleration = pull / self.length - stiffness @ along - losing
        return jnp.stack([speed, acceleration / self.rate])

    def motion(
        self, time: Scalar, state: AxisState, place: Coordinates, load: Coordinates
    ) -> Vector:
        """Motion of each degree of freedom [m, rad]."""
        moved = self.axes.shape @ (state[0] * self.length)
        if self.axes.follow is None:
            return moved
        ratio = self.ratio.at(time).value(time)
        left = ratio * self.load + self.vectors @ self.excess(place, load)
        return moved + self.axes.follow @ left


def mesh_at_phase(table: MeshTable, phase: Scalar, near: Scalar) -> Mesh:
    """The cells at any phase.

    **Arguments:**

    - `table`: of a cycle.
    - `phase`: mesh periods from the start of a cycle; later ones repeat [-].
    - `near`: a phase in the step that is followed, beyond its ends too [-].

    **Returns:**

    The cells. Stiffness is that of the step, the later one at the edge of two; gaps and arms lie on
    the parabola through its three places.
    """
    start = jnp.floor(near / table.periods) * table.periods
    steps = table.stiffness.shape[0]
    local = phase - start
    i = jnp.clip(jnp.searchsorted(table.edges, near - start, side="right") - 1, 0, steps - 1)
    part = (local - table.edges[i]) / (table.edges[i + 1] - table.edges[i])
    first, middle, last = place_shares(part)
    between = lambda x: first * x[0, i] + middle * x[1, i] + last * x[2, i]
    mesh = Mesh(
        stiffness=table.stiffness[i],
        gap=between(table.gap),
        arms=between(table.arms),
        coupling=None if table.coupling is None else table.coupling[i],
        growth=None if table.growth is None else between(table.growth),
    )
    return mesh if table.kept is None else mesh.among(table.kept[i])


# Newton's steps on a convex energy of few pieces; each opens or closes the cells that are wrong.
_MOST_YIELD_STEPS = 30


def _yielded_place(
    mesh: Mesh, driven: Coordinates, yielding: CoordinateMatrix, law: AbstractContactLaw
) -> Coordinates:
    """Solve $m + Y g(m) = d$ for the place; NaN if that fails, which an integrator refuses."""

    def missing(place: Coordinates) -> Coordinates:
        return driven - place - yielding @ mesh_load(mesh, place, law)[0]

    def newton(place: Coordinates) -> Coordinates:
        load, tangent = mesh_load(mesh, place, law)
        off = driven - place - yielding @ load
        return jnp.linalg.solve(jnp.eye(place.size) + yielding @ tangent, off)

    def search(function, start: Coordinates) -> Coordinates:
        del function
        scale = jnp.max(jnp.abs(start))

        def body(state):
            place, _, steps = state
            step = newton(place)
            return place + step, jnp.max(jnp.abs(step)) / scale, steps + 1

        def unfinished(state):
            return (state[1] > 1e-13) & (state[2] < _MOST_YIELD_STEPS)

        first = (start, jnp.asarray(jnp.inf), jnp.zeros((), dtype=int))
        place, change, _ = jax.lax.while_loop(unfinished, body, first)
        return jnp.where(change <= 1e-9, place, jnp.nan)

    def linear(function, right: Coordinates) -> Coordinates:
        return jnp.linalg.solve(jax.vmap(function)(jnp.eye(right.size)).T, right)

    return jax.lax.custom_root(missing, driven, search, linear)


def motion_of(
    system: DynamicSystem,
    law: AbstractContactLaw,
    speed: Schedule,
    ratio: Schedule,
    begin: Scalar,
    choices: TransientChoices,
) -> MovingPair:
    """The equations of motion of a system, with time counted from `begin`."""
    axes = _axes(system.mass, system.whole_stiffness, system.free, choices.kept)
    along = lambda matrix: axes.shape.T @ matrix @ axes.shape
    mesh = axes.shape.T @ system.vectors
    stiffness = along(system.whole_stiffness)
    share, yielding = None, system.bow
    if axes.follow is not None:
        follow = system.vectors.T @ axes.follow @ system.vectors
        share = jnp.linalg.inv(jnp.eye(system.mean.shape[0]) - follow @ system.mean)
        yielding = share @ follow + (0.0 if system.bow is None else system.bow)
    turning = system.turning
    if turning is not None:
        turning = TurningTerms(
            gyroscopic=along(turning.gyroscopic),
            circulatory=along(turning.circulatory),
            softening=along(turning.softening),
            load=turning.load,
        )
    approach = mesh[:, 0]
    inertia = 1.0 / (approach @ approach)
    since = lambda profile: pieces_of(Schedule(profile.times - begin, profile.values))
    return MovingPair(
        axes=axes,
        stiffness=stiffness,
        damping=along(system.damping),
        gyroscopic=None if system.gyroscopic is None else along(system.gyroscopic),
        turning=turning,
        mesh=mesh,
        vectors=system.vectors,
        load=system.load,
        mean=system.mean,
        bow=system.bow,
        share=share,
        yielding=yielding,
        table=system.table,
        law=law,
        cell_damping=system.cell_damping,
        speed=since(speed),
        ratio=since(ratio),
        began=speed.integral(begin),
        turn=jnp.asarray(system.teeth / (2.0 * np.pi)),
        length=system.force / system.mean[0, 0] * jnp.sqrt(inertia),
        rate=jnp.sqrt(inertia * (approach @ stiffness @ approach)),
    )


def is_near(args: tuple[MovingPair, Scalar], start, end) -> tuple[MovingPair, Scalar]:
    """What the right-hand side is given during a step."""
    return args[0], start + 0.5 * (end - start)


def slope_of(time, state, args: tuple[MovingPair, Scalar]) -> AxisState:
    """The right-hand side as diffrax calls it."""
    motion, near = args
    return motion.slope(time, state, near)
