r"""Transients by adaptive integration: speed and torque change as they are told to.

A second implementation beside the marching methods, by other authors' integrators: it shares the
table of the mesh and nothing of the steppers. Rotation about the axes follows the prescribed speed,
so the bodies' own rotational inertia asks for no torque: what accelerates a drive is part of the
torque that the mesh carries, or is left out.

Motions are counted along axes that are orthonormal in the mass matrix, without those that nothing
holds. Mesh stiffness is constant within a step of the table and jumps between steps: an integrator
that steps over a jump loses its order, so that every step ends at the next jump at the latest.
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import scipy.linalg
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int, PyTree

from jaxgear._checks import InputError, require, require_float64
from jaxgear._dynamics._orbit import derivative_if
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._table import Mesh, MeshTable, cell_forces, mesh_load, place_shares
from jaxgear._dynamics._types import FreeMotions, Matrix, Start, Vector, Vectors
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._solve._coordinates import on_coordinates
from jaxgear._types import CoordinateMatrix, Coordinates, Flag, Reals, Scalar, as_reals

if TYPE_CHECKING:
    Knots = Array
    Times = Array
    TimeCoordinates = Array
    TimeDofs = Array
    Axes = Array
    AxisCoordinates = Array
    AxisMatrix = Array
    AxisValues = Array
    AxisState = Array
    Count = Array
else:
    Knots = Float[Array, "knot"]
    Times = Float[Array, "time"]
    TimeCoordinates = Float[Array, "time coordinate"]
    TimeDofs = Float[Array, "time dof"]
    Axes = Float[Array, "dof axis"]
    AxisCoordinates = Float[Array, "axis coordinate"]
    AxisMatrix = Float[Array, "axis axis"]
    AxisValues = Float[Array, "axis"]
    AxisState = Float[Array, "2 axis"]
    Count = Int[Array, ""]

_EPSILON = float(np.finfo(float).eps)


class TransientError(RuntimeError):
    """An integration stopped before its end; the message says where, and what to do."""


# --- What is prescribed


class Profile(eqx.Module):
    """A quantity that changes in straight lines between knots and is constant beyond them.

    Two knots at one time are a jump.

    **Fields:**

    - `times`: of the knots, none earlier than the one before [s].
    - `values`: there, in the unit of the quantity: [rad/s] for speeds, [-] for ratios.

    **Raises:**

    - `ValueError` unless there are two knots or more, in the order of time.
    """

    times: Knots = eqx.field(converter=as_reals)
    values: Knots = eqx.field(converter=as_reals)

    def __check_init__(self):
        require(
            self.times.ndim == 1 and self.times.shape == self.values.shape and self.times.size > 1,
            "`Profile` must have one value for each of two knots or more, got {times} times and "
            "{values} values.",
            times=self.times.size,
            values=self.values.size,
        )
        require(
            jnp.all(jnp.diff(self.times) >= 0.0) & jnp.all(jnp.isfinite(self.values)),
            "`Profile.times` must not go back and `Profile.values` must be finite, got {times} s "
            "with {values}. Sort the knots by time.",
            times=self.times,
            values=self.values,
        )

    def __call__(self, time: Scalar) -> Scalar:
        """The quantity at a time [s]; at a jump, that after it. In the unit of `values`."""
        return _pieces(self).at(time).value(time)

    def integral(self, time: Scalar) -> Scalar:
        """Its integral from the first knot to a time [s]; in [rad] for speeds."""
        return _pieces(self).at(time).integral(time)

    def when(self, integral: Scalar) -> Scalar:
        """When the integral of a quantity that is never negative reaches a value [s].

        Infinite if it never does; after a standstill at that value, its end.
        """
        return _pieces(self).when(integral)


class _Piece(eqx.Module):
    """One straight line of a profile, followed beyond its ends too.

    **Fields:**

    - `begin`: where it is known [s].
    - `start`: the quantity there [rad/s, -].
    - `slope`: its rate [rad/s2, 1/s].
    - `before`: its integral until there [rad, s].
    """

    begin: Reals
    start: Reals
    slope: Reals
    before: Reals

    def value(self, time: Scalar) -> Scalar:
        """The quantity [rad/s, -]."""
        return self.start + self.slope * (time - self.begin)

    def integral(self, time: Scalar) -> Scalar:
        """Its integral from the first knot [rad, s]."""
        past = time - self.begin
        return self.before + past * (self.start + 0.5 * self.slope * past)


class _Pieces(eqx.Module):
    """All lines of a profile: before the first knot, between knots, behind the last.

    **Fields:**

    - `knots`: that part them [s].
    - `lines`: one more than knots, on a leading axis.
    """

    knots: Knots
    lines: _Piece

    def at(self, time: Scalar) -> _Piece:
        """The line that a time lies on; at a knot, the later one."""
        i = jnp.searchsorted(self.knots, time, side="right", method="compare_all")
        return jax.tree.map(lambda x: x[i], self.lines)

    def when(self, integral: Scalar) -> Scalar:
        """As `Profile.when`."""
        sums = self.lines.before[1:]
        i = jnp.searchsorted(sums, integral, side="right", method="compare_all")
        line = jax.tree.map(lambda x: x[i], self.lines)
        missing = integral - line.before
        # Not the difference of two nearly equal numbers, at any slope and at a start from zero.
        square = jnp.maximum(line.start**2 + 2.0 * line.slope * missing, 0.0)
        root = jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
        fastest = line.start + root
        never = jnp.where(missing > 0.0, jnp.inf, 0.0)
        way = 2.0 * missing / jnp.where(fastest > 0.0, fastest, 1.0)
        return line.begin + jnp.where(fastest > 0.0, way, never)


def _pieces(profile: Profile) -> _Pieces:
    knots, values = profile.times, profile.values
    lengths = jnp.diff(knots)
    instant = lengths == 0.0
    slopes = jnp.where(instant, 0.0, jnp.diff(values) / jnp.where(instant, 1.0, lengths))
    sums = jnp.cumsum(0.5 * (values[1:] + values[:-1]) * lengths)
    none = jnp.zeros(1)
    lines = _Piece(
        begin=jnp.concatenate([knots[:1], knots]),
        start=jnp.concatenate([values[:1], values]),
        slope=jnp.concatenate([none, slopes, none]),
        before=jnp.concatenate([none, none, sums]),
    )
    return _Pieces(knots=knots, lines=lines)


def run_up(start: float | Scalar, end: float | Scalar, seconds: float | Scalar) -> Profile:
    """A speed that rises or falls at a constant rate, and stays.

    **Arguments:**

    - `start`, `end`: speeds of the pinion [rad/s].
    - `seconds`: how long the change takes [s].

    **Returns:**

    The profile; it begins at time zero.
    """
    return _through((0.0, seconds), (start, end))


def torque_step(
    before: float | Scalar,
    after: float | Scalar,
    at: float | Scalar,
    seconds: float | Scalar = 0.0,
) -> Profile:
    """A torque that changes once.

    **Arguments:**

    - `before`, `after`: torque over that of the system [-].
    - `at`: when the change begins [s].
    - `seconds`: how long it takes; zero is a jump [s].

    **Returns:**

    The profile.
    """
    end = jnp.asarray(at, dtype=float) + seconds
    return _through((at, end), (before, after))


def start_stop(
    speed: float | Scalar,
    up: float | Scalar,
    hold: float | Scalar,
    down: float | Scalar,
) -> Profile:
    """From standstill to a speed, and back to standstill.

    **Arguments:**

    - `speed`: of the pinion in between [rad/s].
    - `up`, `hold`, `down`: how long each part takes [s].

    **Returns:**

    The profile; it begins at time zero.
    """
    held = jnp.asarray(up, dtype=float) + hold
    return _through((0.0, up, held, held + down), (0.0, speed, speed, 0.0))


def _through(times: Sequence[float | Scalar], values: Sequence[float | Scalar]) -> Profile:
    """The profile through knots given one by one."""
    one = lambda x: jnp.asarray(x, dtype=float)
    return Profile(jnp.stack([one(x) for x in times]), jnp.stack([one(x) for x in values]))


def as_profile(given: Profile | float | Scalar) -> Profile:
    """A profile as it is, and a number as one that is constant.

    **Arguments:**

    - `given`: a profile or a real number.

    **Returns:**

    The profile.
    """
    return given if isinstance(given, Profile) else _through((0.0, 1.0), (given, given))


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


class _Choices(eqx.Module):
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


class _Motion(eqx.Module):
    r"""The equations of motion, $\ddot y + (\bar C + \Omega\bar G)\dot y + \bar K y = \bar F - g$.

    **Fields:**

    - `axes`: that are integrated along.
    - `stiffness`: with the mean mesh stiffness, along the axes [1/s2].
    - `damping`: along the axes [1/s].
    - `gyroscopic`: along the axes, per pinion speed, or `None` [-].
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
    speed: _Pieces
    ratio: _Pieces
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
        mesh = mesh_at_phase(self.table, at(time), within)
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
        ratio = self.ratio.at(near).value(time)
        pull = self.axes.shape.T @ (ratio * self.load) + self.mesh @ excess
        along, speed = state[0], self.rate * state[1]
        losing = self.damping @ speed
        if self.gyroscopic is not None:
            losing += self.speed.at(near).value(time) * (self.gyroscopic @ speed)
        acceleration = pull / self.length - self.stiffness @ along - losing
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
    return Mesh(
        stiffness=table.stiffness[i],
        gap=between(table.gap),
        arms=between(table.arms),
        coupling=None if table.coupling is None else table.coupling[i],
    )


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


def _motion(
    system: DynamicSystem,
    law: AbstractContactLaw,
    speed: Profile,
    ratio: Profile,
    begin: Scalar,
    choices: _Choices,
) -> _Motion:
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
    approach = mesh[:, 0]
    inertia = 1.0 / (approach @ approach)
    since = lambda profile: _pieces(Profile(profile.times - begin, profile.values))
    return _Motion(
        axes=axes,
        stiffness=stiffness,
        damping=along(system.damping),
        gyroscopic=None if system.gyroscopic is None else along(system.gyroscopic),
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


# --- Steps of the integrator


class _Stops(eqx.Module):
    """Where the right-hand side is not smooth: edges of the table, knots of what is prescribed.

    **Fields:**

    - `motion`: knows both.
    """

    motion: _Motion

    def after(self, time: Scalar) -> Scalar:
        """The first such place behind a time [s]."""
        motion, table = self.motion, self.motion.table
        phase = motion.phase(time)
        # A place that has been reached but for rounding lies behind.
        slack = 16.0 * _EPSILON * (1.0 + phase)
        cycle = jnp.floor((phase + slack) / table.periods) * table.periods
        local = jnp.maximum(phase - cycle, 0.0) + slack
        i = jnp.clip(jnp.searchsorted(table.edges, local, side="right"), 1, table.edges.size - 1)
        stop = motion.speed.when(motion.began + (cycle + table.edges[i]) / motion.turn)
        for knots in (motion.speed.knots, motion.ratio.knots):
            ahead = knots > time * (1.0 + 4.0 * _EPSILON)
            stop = jnp.minimum(stop, jnp.min(jnp.where(ahead, knots, jnp.inf)))
        return jnp.maximum(stop, time)


class _StopsState(eqx.Module):
    """What the controller carries from step to step.

    **Fields:**

    - `inner`: state of the controller within [-].
    - `wish`: step that it would have taken without a stop [s].
    - `stop`: the next place that is not smooth [s].
    """

    inner: PyTree
    wish: Scalar
    stop: Scalar


# Steps that a stop further ahead than so many of them does not change.
_MANY = 1e6


class _StopAtJumps(diffrax.AbstractAdaptiveStepSizeController[Any, Any]):
    """Shortens the steps of another controller so that none crosses a jump.

    As `diffrax.ClipStepSizeController`, but a jump is computed when it comes near: a run through
    a million of them holds no list.

    **Fields:**

    - `controller`: proposes the steps.
    - `stops`: knows the jumps.
    """

    controller: diffrax.PIDController
    stops: _Stops

    def __init__(self, controller: diffrax.PIDController, stops: _Stops):
        self.controller = controller
        self.stops = stops

    @property
    def rtol(self):
        """Relative tolerance [-]."""
        return self.controller.rtol

    @property
    def atol(self):
        """Absolute tolerance [-]."""
        return self.controller.atol

    @property
    def norm(self):
        """How errors are measured."""
        return self.controller.norm

    def wrap(self, direction):
        return eqx.tree_at(lambda s: s.controller, self, self.controller.wrap(direction))

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order) -> Any:
        """The end of the first step [s], and the state."""
        end, inner = self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)
        stop = self.stops.after(jnp.asarray(t0))
        return jnp.minimum(end, stop), _StopsState(inner, jnp.asarray(end - t0), stop)

    def adapt_step_size(
        self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state
    ):
        state = controller_state
        keep, start, end, _, inner, result = self.controller.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, state.inner
        )
        # A step that a stop had cut short says little about how long the next may be.
        cut = ~(end - start < 0.99 * self.controller.factormax * (t1 - t0))
        wish = jnp.where(keep & cut, jnp.maximum(end - start, state.wish), end - start)
        arrived = keep & (t1 >= state.stop)
        stop = jnp.where(arrived, self.stops.after(jnp.asarray(start)), state.stop)
        # Equal parts of the way to the stop, rather than a rest that is too short.
        way = stop - start
        parts = jnp.clip(jnp.ceil(jax.lax.stop_gradient(way / wish)), 1.0, _MANY)
        end = jnp.minimum(start + jnp.where(parts < _MANY, way / parts, wish), stop)
        # Comparisons with NaN are false, so that one is found too.
        lost = ~keep & ~(wish > 64.0 * _EPSILON * t0 + 1e-12 / self.stops.motion.rate)
        result = diffrax.RESULTS.where(lost, diffrax.RESULTS.dt_min_reached, result)
        return keep, start, end, arrived, _StopsState(inner, wish, stop), result


class _Within(diffrax.AbstractAdaptiveSolver[Any], diffrax.AbstractWrappedSolver[Any]):
    """Shows a solver, at all stages of a step, the piece of the table that the step lies in.

    Stages at the end of a step, or beyond it as Kvaerno's have, would see the next piece.

    **Fields:**

    - `solver`: does the steps.
    """

    solver: diffrax.AbstractSolver

    @property
    def root_finder(self):
        """Of an implicit solver."""
        return cast(Any, self.solver).root_finder

    @property
    def scan_kind(self):
        """Of a Runge-Kutta solver; adjoints look for it."""
        return cast(Any, self.solver).scan_kind

    @property
    def term_structure(self):
        """As the solver's."""
        return self.solver.term_structure

    @property
    def interpolation_cls(self):
        """As the solver's."""
        return self.solver.interpolation_cls

    @property
    def term_compatible_contr_kwargs(self):
        """As the solver's."""
        return self.solver.term_compatible_contr_kwargs

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, _near(args, t0, t1))

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        near = _near(args, t0, t1)
        return self.solver.step(terms, t0, t1, y0, near, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.solver.func(terms, t0, y0, _near(args, t0, t0))


def _near(args: tuple[_Motion, Scalar], start, end) -> tuple[_Motion, Scalar]:
    """What the right-hand side is given during a step."""
    return args[0], start + 0.5 * (end - start)


def _slope(time, state, args: tuple[_Motion, Scalar]) -> AxisState:
    """The right-hand side as diffrax calls it."""
    motion, near = args
    return motion.slope(time, state, near)


# --- The result


class Transient(eqx.Module):
    r"""A motion in time.

    **Fields:**

    - `times`: at which it was asked for [s].
    - `phase`: mesh periods gone through since the start [-].
    - `speed`: of the pinion [rad/s].
    - `place`: mesh coordinates $m$ [m, rad].
    - `load`: of the mesh on them; the first is the total force of the drive flanks [N, N m].
    - `motion`: $q$ [m, rad].
    - `velocity`: $\dot q$; only of modes that move with inertia [m/s, rad/s].
    - `transmission_error`: on the base circles [m].
    - `complete`: whether the end was reached; if not, values after `reached` are NaN.
    - `reached`: the last time that was [s].
    - `steps`: accepted steps of the integrator [-].
    - `rejected`: steps that were too long [-].
    - `dense`: what `at` evaluates, or `None`.
    """

    times: Times
    phase: Times
    speed: Times
    place: TimeCoordinates
    load: TimeCoordinates
    motion: TimeDofs
    velocity: TimeDofs
    transmission_error: Times
    complete: Flag
    reached: Scalar
    steps: Count
    rejected: Count
    dense: "_Dense | None"

    def at(self, times: Times) -> "Transient":
        """The same motion at other times.

        **Arguments:**

        - `times`: within those of the transient [s].

        **Returns:**

        The motion there.

        **Raises:**

        - `ValueError` unless the transient was made with `dense=True`.
        """
        if self.dense is None:
            raise InputError(
                "`Transient.at` needs every step of the integrator: ask for `dense=True`, or give "
                "`transient` the times themselves."
            )
        return _at_times(self, self.dense, jnp.asarray(times, dtype=float))


class _Dense(eqx.Module):
    """A motion between the times that were asked for.

    **Fields:**

    - `motion`: its equations.
    - `path`: scaled state over time since the start [-].
    - `begin`: the start [s].
    - `transmission`: transmission error per motion [-, m].
    """

    motion: _Motion
    path: diffrax.DenseInterpolation
    begin: Scalar
    transmission: Vector


@eqx.filter_jit
def _at_times(given: Transient, dense: _Dense, times: Times) -> Transient:
    since = times - dense.begin
    states = jax.vmap(dense.path.evaluate)(since)
    known = (times >= dense.begin) & (times <= given.reached)
    states = reached_only(states, known, dense)
    return dataclasses.replace(
        given, times=times, **_observed(dense.motion, dense.transmission, since, states)
    )


def reached_only(
    states: Float[Array, "time 2 axis"], known: Bool[Array, " time"], given: PyTree
) -> Float[Array, "time 2 axis"]:
    """States at the times that were reached, NaN at others, and so are their derivatives.

    **Arguments:**

    - `states`: scaled, at each time [-].
    - `known`: whether a time was reached.
    - `given`: whatever they depend on: an integrator does not look at what it has not reached.

    **Returns:**

    The states [-].
    """
    numbers = jax.tree.leaves(eqx.filter(given, eqx.is_inexact_array))
    everything = jnp.full(known.shape, sum(jnp.sum(x) for x in numbers))
    lost = jnp.nan + derivative_if(jnp.asarray(False), everything)
    return jnp.where(known[:, None, None], states, lost[:, None, None])


def _observed(
    motion: _Motion, transmission: Vector, since: Times, states: Float[Array, "time 2 axis"]
) -> dict[str, Array]:
    """What a transient holds at each time."""

    def at(time: Scalar, state: AxisState) -> dict[str, Array]:
        place, load = motion.place_and_load(time, state)
        moved = motion.motion(time, state, place, load)
        return {
            "phase": motion.phase(time),
            "speed": motion.speed.at(time).value(time),
            "place": place,
            "load": load,
            "motion": moved,
            "velocity": motion.axes.shape @ (state[1] * motion.length * motion.rate),
            "transmission_error": transmission @ moved,
        }

    return jax.vmap(at)(since, states)


# --- The integration


def transient(
    system: DynamicSystem,
    speed: Profile | float | Scalar,
    torque_ratio: Profile | float | Scalar,
    start: Start,
    times: Times,
    *,
    law: AbstractContactLaw,
    rtol: float | Scalar,
    atol: float | Scalar,
    solver: str | diffrax.AbstractSolver = "tsit5",
    below: float | None = None,
    most_steps: int = 1_000_000,
    dense: bool = False,
    progress: bool = False,
    throw: bool = True,
    adjoint: diffrax.AbstractAdjoint = diffrax.RecursiveCheckpointAdjoint(),
) -> Transient:
    r"""Integrate a gear pair in time while its speed and its torque change.

    Gears turn at the prescribed speed, whatever the torque; the mesh starts at phase zero. The load
    is `torque_ratio` times that of the system: torques and their reaction scale together, and so
    do outside loads on shafts, which the system does not tell apart.

    Gradients go through every step, and are NaN beyond what was reached. In a long transient
    of a motion that jumps or is chaotic they grow without bounds, as they should; those of a
    settled response come from its periodic orbit.

    **Arguments:**

    - `system`: what moves.
    - `speed`: of the pinion over time, or a constant; not negative [rad/s].
    - `torque_ratio`: load over that of the system, over time, or a constant [-].
    - `start`: motion and velocity at the first time [m, rad; m/s, rad/s].
    - `times`: of the output; the first is the start, the last the end [s].
    - `law`: of contact. Smooth contact keeps the order of the integrator; exact contact costs more
        steps.
    - `rtol`: error of a step over the motion [-].
    - `atol`: error of a step over the static deflection of the mesh [-].
    - `solver`: explicit `"tsit5"`; implicit `"kvaerno5"`, for modes far above what is excited; or
        any solver of diffrax with an error estimate.
    - `below`: natural frequency above which modes follow without inertia [rad/s]; by default all
        have theirs. Derivatives then need modes of different frequencies, and a system that is
        not being traced.
    - `most_steps`: of the integrator, accepted or not.
    - `dense`: whether `Transient.at` can evaluate any time; holds `most_steps` steps in memory.
    - `progress`: whether a meter is shown.
    - `throw`: whether an integration that does not reach its end raises; if not, look at
        `complete`. Inside `jit`, `vmap` or `grad` it never raises.
    - `adjoint`: how derivatives are found; `diffrax.ForwardMode()` for forward mode.

    **Returns:**

    The motion at `times`.

    **Raises:**

    - `ValueError` in single precision, for speeds, torques or times that cannot be, or for
        condensed bodies, whose terms of rotation follow no run-up here.
    - `TransientError` if the end was not reached and `throw` is true.
    """
    require_float64()
    require(
        system.turning is None,
        "Transients are for rigid bodies and beams: march a system with condensed bodies at "
        "constant speeds (`march`).",
    )
    speed, torque_ratio = as_profile(speed), as_profile(torque_ratio)
    start, times = jnp.asarray(start, dtype=float), jnp.asarray(times, dtype=float)
    _check(system, speed, torque_ratio, start, times, most_steps)
    kept = None if below is None else _modes_below(system, below)
    choices = _Choices(
        kept=kept,
        dense=dense,
        progress=progress,
        most_steps=most_steps,
    )
    tolerance = (jnp.asarray(rtol, dtype=float), jnp.asarray(atol, dtype=float))
    integrator = _solver(solver)
    found, sound = _integrate(
        system, speed, torque_ratio, start, times, law, tolerance, integrator, adjoint, choices
    )
    if throw and not isinstance(found.complete, Tracer) and not bool(found.complete):
        raise TransientError(_what_happened(found, bool(sound), most_steps, times))
    return found


def _solver(given: str | diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """An integrator of diffrax by its name, or as it is."""
    if isinstance(given, diffrax.AbstractSolver):
        return given
    solvers = {"tsit5": diffrax.Tsit5, "kvaerno5": diffrax.Kvaerno5}
    require(
        given in solvers,
        '`solver` must be "tsit5", "kvaerno5" or a solver of diffrax, got {given!r}.',
        given=given,
    )
    return solvers[given]()


@eqx.filter_jit
def _integrate(
    system: DynamicSystem,
    speed: Profile,
    ratio: Profile,
    start: Start,
    times: Times,
    law: AbstractContactLaw,
    tolerance: tuple[Scalar, Scalar],
    solver: diffrax.AbstractSolver,
    adjoint: diffrax.AbstractAdjoint,
    choices: _Choices,
) -> tuple[Transient, Flag]:
    """The transient, and whether the forces where it ended are numbers."""
    begin = times[0]
    since = times - begin
    motion = _motion(system, law, speed, ratio, begin, choices)
    along = (start @ system.mass) @ motion.axes.shape
    first = along / jnp.stack([motion.length, motion.length * motion.rate])[:, None]
    steps = diffrax.PIDController(rtol=tolerance[0], atol=tolerance[1])
    meter = diffrax.TqdmProgressMeter() if choices.progress else diffrax.NoProgressMeter()
    samples, end = diffrax.SubSaveAt(ts=since), diffrax.SubSaveAt(t1=True)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(_slope),
        _Within(solver),
        t0=since[0],
        t1=since[-1],
        dt0=None,
        y0=first,
        args=(motion, since[0]),
        saveat=diffrax.SaveAt(subs=(samples, end), dense=choices.dense),
        stepsize_controller=_StopAtJumps(steps, _Stops(motion)),
        adjoint=adjoint,
        max_steps=choices.most_steps,
        progress_meter=meter,
        throw=False,
    )
    (_, ended), (states, last) = cast(Any, solution.ts), cast(Any, solution.ys)
    states = reached_only(states, since <= ended[0], (motion, first))
    stats = solution.stats
    found = Transient(
        times=times,
        complete=solution.result == diffrax.RESULTS.successful,
        reached=begin + ended[0],
        steps=jnp.asarray(stats["num_accepted_steps"]),
        rejected=jnp.asarray(stats["num_rejected_steps"]),
        dense=None
        if solution.interpolation is None
        else _Dense(motion, solution.interpolation, begin, system.transmission),
        **_observed(motion, system.transmission, since, states),
    )
    return found, jnp.all(jnp.isfinite(motion.slope(ended[0], last[0])))


def _modes_below(system: DynamicSystem, below: float) -> int:
    """Number of natural modes below a frequency, at least one."""
    whole = system.whole_stiffness
    require(
        not isinstance(whole, Tracer),
        "`below` chooses how many modes there are, which cannot be traced: leave it out inside "
        "`jit`, `vmap` and `grad` over masses or stiffness.",
    )
    require(below > 0.0, "`below` must be positive, got {got:.6g} rad/s.", got=below)
    square = scipy.linalg.eigvalsh(np.asarray(whole), np.asarray(system.mass))
    # Free motions have a frequency that means nothing.
    held = np.asarray(system.mass @ system.free)
    shapes = scipy.linalg.eigh(np.asarray(whole), np.asarray(system.mass))[1]
    free = np.sum((shapes.T @ held) ** 2, axis=1) > 0.5
    return max(1, int(np.sum((square < below**2) & ~free)))


def _check(
    system: DynamicSystem,
    speed: Profile,
    ratio: Profile,
    start: Start,
    times: Times,
    most_steps: int,
) -> None:
    """Refuse what cannot be integrated."""
    dofs = system.mass.shape[0]
    require(
        times.ndim == 1 and times.size > 1,
        "`times` must be a row of two times or more, the first and the last being start and end, "
        "got an array of shape {shape}.",
        shape=times.shape,
    )
    require(
        jnp.all(jnp.diff(times) > 0.0) & jnp.all(jnp.isfinite(times)),
        "`times` must rise from the start to the end, got {first:.6g} s to {last:.6g} s with a "
        "smallest difference of {least:.6g} s.",
        first=times[0],
        last=times[-1],
        least=jnp.min(jnp.diff(times)),
    )
    require(
        start.shape == (2, dofs),
        "`start` must hold motion and velocity of {dofs} degrees of freedom, got an array of "
        "shape {shape}. `at_rest` and `quasi_static_start` make one.",
        dofs=dofs,
        shape=start.shape,
    )
    require(
        jnp.all(speed.values >= 0.0),
        "`speed` must not be negative, got {got:.6g} rad/s. For the other sense of rotation, "
        "mirror the scene: exchange left and right flanks.",
        got=jnp.min(speed.values),
    )
    require(most_steps > 0, "`most_steps` must be positive, got {got}.", got=most_steps)
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((system, ratio)))
    if not traced and bool(jnp.any(ratio.values < 0.0)):
        require(
            _has_back_flank(system),
            "`torque_ratio` must not be negative without back flanks to carry it, got {got:.6g}: "
            "the gears would part for good. Give the pair backlash, or keep the torque's sign.",
            got=jnp.min(ratio.values),
        )


def _has_back_flank(system: DynamicSystem) -> bool:
    """Whether the load opens some cell of the mesh."""
    push = system.vectors.T @ jnp.linalg.solve(system.mass, system.load)
    closing = np.asarray(system.table.arms @ push)
    return bool(np.any((closing < 0.0) & (np.asarray(system.table.stiffness) > 0.0)))


def _what_happened(found: Transient, sound: bool, most_steps: int, times: Times) -> str:
    """Where an integration stopped, and what to do."""
    reached, steps = float(found.reached), int(found.steps)
    speeds = np.asarray(found.speed)
    known = np.isfinite(np.asarray(found.transmission_error))
    speed = float(speeds[np.flatnonzero(known)[-1]]) if known.any() else float(speeds[0])
    where = (
        f"The transient stopped at {reached:.6g} s, on its way from {float(times[0]):.6g} s to "
        f"{float(times[-1]):.6g} s, with the pinion near {speed:.6g} rad/s"
    )
    if not sound:
        return (
            f"{where}: forces or motions there are not numbers. Look for NaN or infinity in "
            "`start`, in the profiles of speed and torque and in the table of the mesh; check the "
            "units of masses and stiffness."
        )
    if steps + int(found.rejected) >= most_steps:
        pace = (reached - float(times[0])) / max(steps, 1)
        return (
            f"{where}, after `most_steps` = {most_steps} steps of {pace:.3g} s on average. Raise "
            "`most_steps`, or shorten the run. If fast modes ask for such steps, let them follow "
            'without inertia (`below`) or integrate implicitly (`solver="kvaerno5"`); if not, '
            "loosen `rtol` and `atol`."
        )
    return (
        f"{where}: no step is short enough for the tolerances. Loosen `rtol` and `atol`, which "
        f"rounding does not let fall below about {_EPSILON:.0e}; with `ExactContact`, or a "
        "`SmoothContact.width` far below the static deflection, widen the contact; check that "
        "damping is not negative."
    )
