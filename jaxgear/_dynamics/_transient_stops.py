"""Where an integration must stop: at jumps of the mesh, and within the reach of the tables."""

from typing import Any, cast

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import PyTree

from jaxgear._dynamics._transient_motion import MovingPair, is_near
from jaxgear._types import Scalar

EPSILON = float(np.finfo(float).eps)


# --- Steps of the integrator


class Stops(eqx.Module):
    """Where the right-hand side is not smooth: edges of the table, knots of what is prescribed.

    **Fields:**

    - `motion`: knows both.
    """

    motion: MovingPair

    def after(self, time: Scalar) -> Scalar:
        """The first such place behind a time [s]."""
        motion, table = self.motion, self.motion.table
        phase = motion.phase(time)
        # A place that has been reached but for rounding lies behind.
        slack = 16.0 * EPSILON * (1.0 + phase)
        cycle = jnp.floor((phase + slack) / table.periods) * table.periods
        local = jnp.maximum(phase - cycle, 0.0) + slack
        i = jnp.clip(jnp.searchsorted(table.edges, local, side="right"), 1, table.edges.size - 1)
        stop = motion.speed.when(motion.began + (cycle + table.edges[i]) / motion.turn)
        for knots in (motion.speed.knots, motion.ratio.knots):
            ahead = knots > time * (1.0 + 4.0 * EPSILON)
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


class StopAtJumps(diffrax.AbstractAdaptiveStepSizeController[Any, Any]):
    """Shortens the steps of another controller so that none crosses a jump.

    As `diffrax.ClipStepSizeController`, but a jump is computed when it comes near: a run through
    a million of them holds no list.

    **Fields:**

    - `controller`: proposes the steps.
    - `stops`: knows the jumps.
    """

    controller: diffrax.PIDController
    stops: Stops

    def __init__(self, controller: diffrax.PIDController, stops: Stops):
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
        """As the controller's."""
        return eqx.tree_at(lambda s: s.controller, self, self.controller.wrap(direction))

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order) -> Any:
        """The end of the first step [s], and the state."""
        end, inner = self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)
        stop = self.stops.after(jnp.asarray(t0))
        return jnp.minimum(end, stop), _StopsState(inner, jnp.asarray(end - t0), stop)

    def adapt_step_size(
        self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state
    ):
        """The next step, as the controller wishes, but not beyond the next stop."""
        state = controller_state
        keep, start, end, _, inner, result = self.controller.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, state.inner
        )
        # A step that a stop had cut short says little about how long the next may be.
        cut = jnp.logical_not(end - start < 0.99 * self.controller.factormax * (t1 - t0))
        wish = jnp.where(keep & cut, jnp.maximum(end - start, state.wish), end - start)
        arrived = keep & (t1 >= state.stop)
        stop = jnp.where(arrived, self.stops.after(jnp.asarray(start)), state.stop)
        # Equal parts of the way to the stop, rather than a rest that is too short.
        way = stop - start
        parts = jnp.clip(jnp.ceil(jax.lax.stop_gradient(way / wish)), 1.0, _MANY)
        end = jnp.minimum(start + jnp.where(parts < _MANY, way / parts, wish), stop)
        # Comparisons with NaN are false, so that one is found too.
        least = 64.0 * EPSILON * t0 + 1e-12 / self.stops.motion.rate
        lost = jnp.logical_not(keep) & ~(wish > least)
        result = diffrax.RESULTS.where(lost, diffrax.RESULTS.dt_min_reached, result)
        return keep, start, end, arrived, _StopsState(inner, wish, stop), result


class Within(diffrax.AbstractAdaptiveSolver[Any], diffrax.AbstractWrappedSolver[Any]):
    """Shows a solver, at all stages of a step, the piece of the table that the step lies in.

    Stages at the end of a step, or beyond it as Kvaerno's have, would see the next piece.

    **Fields:**

    - `solver`: does the steps.
    """

    solver: diffrax.AbstractSolver  # ty: ignore[incompatible-attribute-override]

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
        """As the solver's."""
        return self.solver.order(terms)

    def error_order(self, terms):
        """As the solver's."""
        return self.solver.error_order(terms)

    def init(self, terms, t0, t1, y0, args):
        """As the solver's, within its piece of the table."""
        return self.solver.init(terms, t0, t1, y0, is_near(args, t0, t1))

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step, within its piece of the table."""
        near = is_near(args, t0, t1)
        return self.solver.step(terms, t0, t1, y0, near, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        """The vector field at the beginning of a step."""
        return self.solver.func(terms, t0, y0, is_near(args, t0, t0))
