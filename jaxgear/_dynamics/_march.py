r"""Marching in time: modes by a linear rule, contact by a few equations on the mesh coordinates.

In a step all modes obey their rule under the load $u = \Phi^T(F - V(g - \bar kn))$. At the instant
of the load the nodes are then at $n = c - S(g - \bar kn)$ with $S$ from the rule: the mesh load $g$
is the minimum of a convex energy, unilateral contact of few unknowns (physics A8.2), whatever the
number of modes. It is found by Newton's method from the load before.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._dynamics._orbit import (
    AbstractMethod,
    Orbit,
    bears_load,
    derivative_if,
    without_derivatives,
)
from jaxgear._dynamics._steppers import AbstractStepper, Midpoint, Newmark
from jaxgear._dynamics._system import DynamicSystem, ModalBasis, modal_basis
from jaxgear._dynamics._table import (
    END,
    MIDDLE,
    START,
    Mesh,
    MeshTable,
    forces_between_all,
    mean_load,
    mesh_at,
    mesh_load,
    mesh_within,
)
from jaxgear._dynamics._types import ModeValues, ModeVectors, Motion, Start, StepPlaces
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._solve._coordinates import small_solver
from jaxgear._types import CoordinateMatrix, Coordinates, Flag, Reals, Scalar


class History(eqx.Module):
    """What a march leaves of its last cycles.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `place`: mesh coordinates at the instant of each step's load [m, rad].
    - `load`: elastic load of the mesh on them [N, N m].
    - `motion`: of every degree of freedom at the end of each step [m, rad].
    - `velocity`: the same, its rate [m/s, rad/s].
    - `start`: motion and velocity where these cycles begin [m, rad, m/s, rad/s].
    - `drift`: change of the state over each cycle of the march, relative to its size [-].
    - `converged`: whether contact was solved in every step.
    """

    speed: Scalar
    place: StepPlaces
    load: StepPlaces
    motion: Motion
    velocity: Motion
    start: Start
    drift: Float[Array, "cycle"]
    converged: Flag

    @property
    def middle(self) -> Motion:
        """Motion in the middle of each step [m, rad]."""
        return 0.5 * (jnp.concatenate([self.start[:1], self.motion[:-1]]) + self.motion)


# A response that shrinks by less than this part in a cycle, or not at all, is taken to do so.
_LEAST_DECAY = 1e-3


class Marching(AbstractMethod):
    """March until the response repeats, as machines do: it ends on stable responses only.

    **Fields:**

    - `stepper`: rule for one step.
    - `law`: exact or smooth contact.
    - `cycles`: to march.
    - `multiple`: cycles after which the response must repeat; 2 for sub-harmonic responses.
    - `averaged`: whether exact contact is averaged over each step.
    - `tolerance`: distance from the settled response at which it counts as settled: the change of
        the state over the response, relative, as far as it goes on if it shrinks as it does, over
        the swing of the approach in its mean [-].
    """

    stepper: AbstractStepper = eqx.field(default_factory=Newmark)
    law: AbstractContactLaw = eqx.field(default_factory=ExactContact)
    cycles: int = eqx.field(static=True, default=200)
    multiple: int = eqx.field(static=True, default=1)
    averaged: bool = eqx.field(static=True, default=False)
    tolerance: float = eqx.field(static=True, default=1e-2)

    def __check_init__(self):
        require(
            self.cycles >= 2 * self.multiple and self.multiple >= 1,
            "`Marching.cycles` must be at least twice `multiple`, got {cycles} and {multiple}.",
            cycles=self.cycles,
            multiple=self.multiple,
        )

    def orbit(self, system: DynamicSystem, speed: Scalar, start: Start | None = None) -> Orbit:
        """Find the response at one speed; see `AbstractMethod`.

        What is given back is the last of the march, settled or not. It has no derivatives: those of
        the same response are to be had from `HarmonicBalance`.

        **Raises:**

        - `InputError` if it is differentiated.
        """
        start = quasi_static_start(system) if start is None else start
        system = system.over(self.multiple)
        history = march(
            system,
            speed,
            start,
            cycles=-(-self.cycles // self.multiple),
            stepper=self.stepper,
            law=self.law,
            averaged=self.averaged,
        )
        middle = history.middle
        nodes = middle @ system.vectors
        meshes = mesh_at(system.table, MIDDLE).at(speed)
        load, place, _ = jax.vmap(
            lambda mesh, nodes, near: load_at_nodes(system, self.law, mesh, nodes, near)
        )(meshes, nodes, history.load)
        # What is still to come if the change goes on shrinking as it does, over the swing.
        last, before = history.drift[-1], history.drift[-2]
        left = 1.0 - last / jnp.where(before > 0.0, before, 1.0)
        left = jnp.clip(left, _LEAST_DECAY, 1.0)
        approach = nodes[:, 0] - jnp.mean(nodes[:, 0])
        swing = jnp.sqrt(jnp.mean(approach**2) / jnp.mean(nodes[:, 0] ** 2))
        residual = last / (left * jnp.maximum(swing, 1e-9))
        # A derivative would be that of so many steps from the start: the response may have settled
        # where it has not, or was there from the beginning.
        return without_derivatives(
            "marching",
            Orbit(
                speed=speed,
                place=place,
                load=load,
                motion=middle,
                start=history.start,
                residual=residual,
                settled=(residual <= self.tolerance)
                & history.converged
                & bears_load(system, history.load),
                steps=jnp.asarray(float(history.drift.size * self.multiple)),
            ),
        )


def at_rest(system: DynamicSystem) -> Start:
    """The state without any motion: free of load, with all deflections to come.

    **Arguments:**

    - `system`: what moves.

    **Returns:**

    Motion and velocity, zero [m, rad, m/s, rad/s].
    """
    return jnp.zeros((2, system.load.size))


@compiled
def quasi_static_start(system: DynamicSystem) -> Start:
    """The state at vanishing speed where the cycle begins.

    **Arguments:**

    - `system`: what moves.

    **Returns:**

    Motion, and no velocity [m, rad, m/s, rad/s].
    """
    # The mean of the last and the first mid-step: the cycle's start lies between them.
    nodes = 0.5 * (system.rest[0] + system.rest[-1])
    first = mesh_at(system.table, START).at(jnp.zeros(()))
    first = jax.tree.map(lambda x: x[0], first)
    load = mesh_load(first, nodes, ExactContact())[0]
    # The same approach, with the structure at rest under a load that balances it; where a light
    # load leaves the flanks just apart there, under the force alone.
    pressed_on = load[0] > 1e-3 * system.force
    alone = jnp.zeros_like(load).at[0].set(system.force)
    scale = system.force / jnp.where(pressed_on, load[0], 1.0)
    load = jnp.where(pressed_on, load * scale, alone)
    if system.bow is not None:
        nodes = nodes + system.bow @ load
    excess = load - system.mean @ nodes
    motion = jnp.linalg.solve(system.whole_stiffness, system.load - system.vectors @ excess)
    return jnp.stack([motion, jnp.zeros_like(motion)])


class Rule(eqx.Module):
    r"""A stepper's rule for steps of one length, on all modes.

    **Fields:**

    - `step`: length of the step [s].
    - `state`: state at the end per state at the start, part by part [-, s, 1/s].
    - `load`: state at the end per modal load [s2, s, -].
    - `near`: displacement at the instant of the load per state at the start [-, s, s2].
    - `near_load`: the same per modal load [s2].
    - `rate`: velocity at the instant of the load per state at the start [1/s, -, s].
    - `rate_load`: the same per modal load [s].
    - `whirl`: $\Gamma$, modal load per velocity at the instant, what it brings about itself
        included, of gyroscopic forces; or `None` [1/s].
    - `stiffens`: the same per displacement, of turning bodies; or `None` [1/s2].
    - `steady`: modal load of the constant loads, $\Gamma$ considered [N kg^-1/2].
    - `pushes`: modal load per mesh load, $\Gamma$ considered [kg^-1/2].
    - `yields`: $H$, mesh coordinates given up per mesh load [m/N, 1/N, 1/(N m)].
    - `follows`: nodes' mesh coordinates per those that they would have with the mean mesh stiffness
        alone [-, m, 1/m].
    - `own`: $S$, nodes' mesh coordinates per excess load [m/N, 1/N, 1/(N m)].
    - `brakes`: their rates per excess load [m/(N s), 1/(N s), 1/(N m s)].
    """

    step: Scalar
    state: Reals
    load: Reals
    near: Reals
    near_load: Reals
    rate: Reals
    rate_load: Reals
    whirl: Reals | None
    stiffens: Reals | None
    steady: ModeValues
    pushes: ModeVectors
    yields: CoordinateMatrix
    follows: CoordinateMatrix
    own: CoordinateMatrix
    brakes: CoordinateMatrix


class Ties(eqx.Module):
    r"""Forces that tie modes together at one speed: gyroscopic ones, and those of turning bodies.

    **Fields:**

    - `whirl`: modal load lost per velocity, or `None` [1/s].
    - `stiffens`: the same per displacement, or `None` [1/s2].
    - `steady`: modal load of the constant loads [N kg^-1/2].
    """

    whirl: Reals | None
    stiffens: Reals | None
    steady: ModeValues


def ties_of(system: DynamicSystem, modes: ModalBasis, speed: Scalar) -> Ties:
    """Forces between the modes of a system at a speed of the pinion [rad/s]."""
    on_modes = lambda matrix: modes.shape.T @ matrix @ modes.shape
    whirl = None if system.gyroscopic is None else speed * on_modes(system.gyroscopic)
    if system.turning is None:
        return Ties(whirl, None, modes.load)
    stiffens = on_modes(system.turning.stiffness_at(speed))
    return Ties(whirl, stiffens, modes.shape.T @ system.load_at(speed))


def rule_of(
    stepper: AbstractStepper,
    system: DynamicSystem,
    modes: ModalBasis,
    step: Scalar,
    speed: Scalar,
) -> Rule:
    """Work out a stepper's rule by what it makes of unit states and a unit load.

    **Arguments:**

    - `stepper`: the rule.
    - `system`: what moves.
    - `modes`: of the system.
    - `step`: length of the step [s].
    - `speed`: of the pinion, for gyroscopic forces [rad/s].

    **Returns:**

    The rule.
    """
    # All states and the load at once: what is worked out once is compiled once.
    unit = jnp.eye(stepper.carries + 1)[:, :, None] * jnp.ones_like(modes.square)[None, None]

    def respond(case: Reals) -> tuple[Reals, Reals, Reals]:
        *state, load = case
        ended, near, rate = stepper.advance(tuple(state), load, modes.square, modes.damping, step)
        return jnp.stack(ended), near, rate

    ended, near, rate = jax.vmap(respond)(unit)
    ties, pushes = ties_of(system, modes, speed), modes.mesh
    whirl, stiffens, steady = ties.whirl, ties.stiffens, ties.steady
    if whirl is not None:
        # The load is F - V w - G v with v = v_0 + b u: solved for u, all are linear in v_0, and so
        # it is with forces by displacements.
        tied = jnp.eye(modes.square.size) + whirl * rate[-1][None, :]
        if stiffens is not None:
            tied = tied + stiffens * near[-1][None, :]
        answers = jnp.linalg.inv(tied)
        whirl, steady, pushes = answers @ whirl, answers @ steady, answers @ pushes
        stiffens = None if stiffens is None else answers @ stiffens
    on_mesh = lambda x: modes.mesh.T @ (x[:, None] * pushes)
    own, brakes = on_mesh(near[-1]), on_mesh(rate[-1])
    follows = jnp.linalg.inv(jnp.eye(own.shape[0]) - own @ system.mean)
    yields = follows @ own
    if system.bow is not None:
        yields = yields + system.bow
    return Rule(
        step=step,
        state=jnp.swapaxes(ended[:-1], 0, 1),
        load=ended[-1],
        near=near[:-1],
        near_load=near[-1],
        rate=rate[:-1],
        rate_load=rate[-1],
        whirl=whirl,
        stiffens=stiffens,
        steady=steady,
        pushes=pushes,
        yields=yields,
        follows=follows,
        own=own,
        brakes=brakes,
    )


class Pressing(eqx.Module):
    """The contact problem of one step: the mesh load $g$ at $m = c - Hg$.

    **Fields:**

    - `law`: exact or smooth contact.
    - `meshes`: the cells at the instant of the load or, averaged over the step, at its start,
        middle and end.
    - `begun`: mesh coordinates where the step starts, if contact is averaged [m, rad].
    - `place`: $c$, mesh coordinates without mesh load [m, rad].
    - `yields`: $H$ [m/N, 1/N, 1/(N m)].
    - `rate`: rates without mesh load [m/s, rad/s].
    - `brakes`: rates given up per mesh load [m/(N s), 1/(N s), 1/(N m s)].
    - `cell_damping`: of the system, or `None` [s].
    - `scale`: of the loads, the static mesh force [N].
    """

    law: AbstractContactLaw
    meshes: tuple[Mesh, ...]
    begun: Coordinates | None
    place: Coordinates
    yields: CoordinateMatrix
    rate: Coordinates
    brakes: CoordinateMatrix
    cell_damping: Scalar | None
    scale: Scalar


def _pushed(problem: Pressing, load: Coordinates) -> tuple[Coordinates, CoordinateMatrix]:
    """Load that the mesh would give back, and minus its derivative by `load`."""
    place = problem.place - _times(problem.yields, load)
    if problem.begun is not None:
        begin, middle, end = problem.meshes
        ended = 2.0 * place - problem.begun
        found, _, tangent = mean_load(begin, middle, end, problem.begun, ended)
        return found, 2.0 * _product(tangent, problem.yields)
    mesh, loss = problem.meshes[0], problem.cell_damping
    if loss is None:
        found, tangent = mesh_load(mesh, place, problem.law)
        return found, _product(tangent, problem.yields)

    def total(load: Coordinates) -> Coordinates:
        elastic, tangent = mesh_load(
            mesh, problem.place - _times(problem.yields, load), problem.law
        )
        rate = problem.rate - _times(problem.brakes, load)
        return elastic + loss * _times(tangent, rate)

    return total(load), -jax.jacfwd(total)(load)


def _times(matrix: CoordinateMatrix, place: Coordinates) -> Coordinates:
    return jnp.sum(matrix * place[None, :], axis=1)


def _product(first: CoordinateMatrix, second: CoordinateMatrix) -> CoordinateMatrix:
    return jnp.sum(first[:, :, None] * second[None, :, :], axis=1)


# Imbalance of a mesh load over the static force, steps to reach it, and the steps that are taken
# whole even if the imbalance rises.
CONTACT_TOLERANCE, _MOST_STEPS, _FREE_STEPS = 1e-11, 40, 6


@jax.custom_jvp
def pressed(problem: Pressing, first: Coordinates) -> tuple[Coordinates, Scalar]:
    """Solve the contact of one step, from a load close by.

    Derivatives are those of the solution, by the implicit function theorem; if it was not found,
    NaN.

    **Arguments:**

    - `problem`: the contact of the step.
    - `first`: a load to begin with [N, N m].

    **Returns:**

    The mesh load [N, N m], and what it is out of balance, over the static force [-].
    """
    coupling = problem.meshes[0].coupling
    held = problem.begun is None and problem.cell_damping is None
    if held and coupling is not None and coupling.ndim == 2:
        return _pressed_at_once(problem)
    weights = 1.0 / _load_scales(problem)

    def body(state):
        best, error, trial, steps = state
        found, slope = _pushed(problem, trial)
        missing = found - trial
        now = jnp.max(jnp.abs(missing) * weights)
        step = small_solver(jnp.eye(trial.size) + slope)(missing)
        better = (now < error) | (steps < _FREE_STEPS)
        point = jnp.where(better, trial + step, 0.5 * (best + trial))
        best = jnp.where(better, trial, best)
        return best, jnp.where(better, now, error), point, steps + 1

    def unfinished(state):
        return ~(state[1] <= CONTACT_TOLERANCE) & (state[3] < _MOST_STEPS)

    last = jax.lax.while_loop(unfinished, body, (first, jnp.asarray(jnp.inf), first, 0))
    return last[2], last[1]


def _pressed_at_once(problem: Pressing) -> tuple[Coordinates, Scalar]:
    """As `pressed`: where all cells are coupled, what the nodes give way is coupling as well."""
    mesh, law = problem.meshes[0], problem.law
    assert mesh.coupling is not None
    coupling = mesh.coupling + mesh.arms @ problem.yields @ mesh.arms.T
    free = mesh.arms @ problem.place - mesh.gap
    force = forces_between_all(law, mesh.stiffness, coupling, free)
    missing = mesh.stiffness * law.compression(free - coupling @ force) - force
    load, error = mesh.arms.T @ force, jnp.abs(mesh.arms.T @ missing) / _load_scales(problem)
    return load, jnp.max(error)


@pressed.defjvp
def _pressed_tangent(primals, tangents):
    problem, first = primals
    load, error = pressed(problem, first)
    _, slope = _pushed(problem, load)
    _, change = jax.jvp(lambda p: _pushed(p, load)[0], (problem,), (tangents[0],))
    moved = small_solver(jnp.eye(load.size) + slope)(change)
    moved = derivative_if(error <= CONTACT_TOLERANCE, moved)
    return (load, error), (moved, jnp.zeros_like(error))


def load_at_nodes(
    system: DynamicSystem,
    law: AbstractContactLaw,
    mesh: Mesh,
    nodes: Coordinates,
    near: Coordinates,
) -> tuple[Coordinates, Coordinates, Scalar]:
    """Elastic load of the mesh where the nodes are known: behind them bodies may still bow.

    **Arguments:**

    - `system`: what moves.
    - `law`: exact or smooth contact.
    - `mesh`: cells at one instant.
    - `nodes`: mesh coordinates of the nodes [m, rad].
    - `near`: a load to begin with [N, N m].

    **Returns:**

    The load [N, N m], the mesh coordinates of the cells [m, rad], and what the load is out of
    balance, over the static force [-].
    """
    if system.bow is None:
        return mesh_load(mesh, nodes, law)[0], nodes, jnp.zeros(())
    problem = Pressing(
        law=law,
        meshes=(mesh,),
        begun=None,
        place=nodes,
        yields=system.bow,
        rate=jnp.zeros_like(nodes),
        brakes=jnp.zeros_like(system.bow),
        cell_damping=None,
        scale=system.force,
    )
    load, error = pressed(problem, near)
    return load, nodes - _times(system.bow, load), error


def _load_scales(problem: Pressing) -> Coordinates:
    """Sizes of the mesh loads: the static force, and its moment at the cells' arms [N, N m]."""
    arms = problem.meshes[0].arms
    return problem.scale * jnp.maximum(jnp.max(jnp.abs(arms), axis=0), 1e-9)


class Carried(eqx.Module):
    """What a march carries from step to step.

    **Fields:**

    - `state`: of each mode, part by part [kg^1/2 m, kg^1/2 m/s, kg^1/2 m/s2].
    - `load`: mesh load of the last step, to begin the next with [N, N m].
    - `place`: mesh coordinates at the end of the last step, if contact is averaged [m, rad].
    - `error`: largest imbalance of contact so far [-].
    """

    state: Reals
    load: Coordinates
    place: Coordinates | None
    error: Scalar


class March(eqx.Module):
    """A march at one speed, ready to step.

    **Fields:**

    - `system`, `modes`: what moves.
    - `stepper`: the rule's name.
    - `law`: exact or smooth contact.
    - `speed`: of the pinion [rad/s].
    - `ties`: what ties the modes together at this speed.
    - `rules`: the rule for each length of step.
    - `averaged`: whether contact is averaged over each step.
    """

    system: DynamicSystem
    modes: ModalBasis
    stepper: AbstractStepper
    law: AbstractContactLaw
    speed: Scalar
    ties: Ties
    rules: tuple[Rule, ...]
    averaged: bool = eqx.field(static=True)

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """The cells of all steps, where a step needs them."""
        table, at = self.system.table, self.stepper.at
        if self.averaged:
            found = [mesh_at(table, part) for part in (START, MIDDLE, END)]
        elif self.stepper.refreshes:
            found = [mesh_at(table, at), mesh_at(table, START)]
        else:
            found = [mesh_at(table, at) if at == MIDDLE else mesh_within(table, at)]
        return tuple(mesh.at(self.speed) for mesh in found)

    def begin(self, start: Start) -> Carried:
        """Set out from a motion and its velocity.

        **Arguments:**

        - `start`: motion and velocity [m, rad, m/s, rad/s].

        **Returns:**

        What the first step needs.
        """
        modes = self.modes
        onto = modes.shape.T @ self.system.mass
        state = [onto @ start[0], onto @ start[1]]
        rest = jnp.zeros(modes.mesh.shape[1]).at[0].set(self.system.force)
        first = mesh_at(self.system.table, START).at(self.speed)
        first = jax.tree.map(lambda x: x[0], first)
        if self.stepper.carries == 3:
            state.append(self._acceleration(first, state[0], state[1], rest))
        place = self._place(first, state[0], rest)[1] if self.averaged else None
        return Carried(jnp.stack(state), rest, place, jnp.zeros(()))

    def _place(
        self, mesh: Mesh, motion: Reals, near: Coordinates
    ) -> tuple[Coordinates, Coordinates, Coordinates]:
        """Mesh load at a given motion, the mesh coordinates and the nodes'."""
        nodes = self.modes.mesh.T @ motion
        load, place, _ = load_at_nodes(self.system, self.law, mesh, nodes, near)
        return load, place, nodes

    def _acceleration(self, mesh: Mesh, motion: Reals, velocity: Reals, near: Coordinates) -> Reals:
        """Acceleration of each mode under the loads of a motion."""
        modes, system = self.modes, self.system
        load, place, nodes = self._place(mesh, motion, near)
        if system.cell_damping is not None:
            tangent = mesh_load(mesh, place, self.law)[1]
            load = load + system.cell_damping * _times(tangent, modes.mesh.T @ velocity)
        excess = load - _times(system.mean, nodes)
        pull = self.ties.steady - modes.mesh @ excess
        if self.ties.whirl is not None:
            pull = pull - self.ties.whirl @ velocity
        if self.ties.stiffens is not None:
            pull = pull - self.ties.stiffens @ motion
        return pull - modes.damping * velocity - modes.square * motion

    def step(
        self, carried: Carried, kind: Array, meshes: tuple[Mesh, ...]
    ) -> tuple[Carried, tuple[Coordinates, Coordinates, Reals]]:
        """Take one step.

        **Arguments:**

        - `carried`: from the step before.
        - `kind`: which length the step has.
        - `meshes`: the cells where this step needs them.

        **Returns:**

        What the next step needs; mesh coordinates and elastic load at the instant of the load, and
        the state at the end.
        """
        system, modes = self.system, self.modes
        rule = self.rules[0]
        for number, other in enumerate(self.rules[1:], 1):
            rule = jax.tree.map(lambda a, b, k=number: jnp.where(kind == k, b, a), rule, other)
        state = carried.state
        if self.stepper.refreshes:
            fresh = self._acceleration(meshes[1], state[0], state[1], carried.load)
            state = state.at[2].set(fresh)
        rate, near = (jnp.sum(part * state, axis=0) for part in (rule.rate, rule.near))
        steady = rule.steady if rule.whirl is None else rule.steady - rule.whirl @ rate
        if rule.stiffens is not None:
            steady = steady - rule.stiffens @ near
        free = modes.mesh.T @ (near + rule.near_load * steady)
        free_rate = modes.mesh.T @ (rate + rule.rate_load * steady)
        place = _times(rule.follows, free)
        brakes = rule.brakes
        if system.cell_damping is not None:
            # Rates answer to the excess load g - k n, and n to the load g.
            free_rate = free_rate + _times(brakes, _times(system.mean, place))
            node_yields = _product(rule.follows, rule.own)
            brakes = brakes + _product(brakes, _product(system.mean, node_yields))
        problem = Pressing(
            law=self.law,
            meshes=meshes if self.averaged else meshes[:1],
            begun=carried.place if self.averaged else None,
            place=place,
            yields=rule.yields,
            rate=free_rate,
            brakes=brakes,
            cell_damping=system.cell_damping,
            scale=system.force,
        )
        load, error = pressed(problem, carried.load)
        nodes = place - _times(_product(rule.follows, rule.own), load)
        met = place - _times(rule.yields, load)
        excess = load - _times(system.mean, nodes)
        modal = steady - jnp.sum(rule.pushes * excess[None, :], axis=1)
        ended = jnp.sum(rule.state * state[None, :, :], axis=1) + rule.load * modal[None, :]
        elastic = load
        if system.cell_damping is not None:
            elastic = mesh_load(meshes[0], met, self.law)[0]
        ahead = Carried(
            state=ended,
            load=load,
            place=None if carried.place is None else 2.0 * met - carried.place,
            error=jnp.maximum(carried.error, error),
        )
        return ahead, (met, elastic, ended)


def march_of(
    stepper: AbstractStepper,
    law: AbstractContactLaw,
    system: DynamicSystem,
    modes: ModalBasis,
    speed: Scalar,
    *,
    averaged: bool = False,
) -> March:
    """Prepare a march at one speed.

    **Arguments:**

    - `stepper`: rule for one step.
    - `law`: exact or smooth contact.
    - `system`: what moves.
    - `modes`: its natural modes.
    - `speed`: of the pinion [rad/s].
    - `averaged`: whether exact contact is averaged over each step; for rules whose load is in
        mid-step.

    **Returns:**

    The march.

    **Raises:**

    - `ValueError` if contact cannot be averaged with this rule or law.
    """
    require(
        not averaged or (stepper.at == MIDDLE and stepper.carries == 2),
        "Contact can be averaged over steps only where the load is in mid-step: use `Midpoint`.",
    )
    require(
        not averaged or (isinstance(law, ExactContact) and system.cell_damping is None),
        "Only exact contact without damping of its own can be averaged over steps.",
    )
    table = system.table
    lengths = table.lengths * system.mesh_period(speed)
    kinds = max(table.kinds) + 1
    steps = lengths[np.asarray([table.kinds.index(kind) for kind in range(kinds)])]
    every = jax.lax.map(lambda step: rule_of(stepper, system, modes, step, speed), steps)
    rules = tuple(jax.tree.map(lambda x, k=kind: x[k], every) for kind in range(kinds))
    ties = ties_of(system, modes, speed)
    return March(system, modes, stepper, law, speed, ties, rules, averaged)


def cycle(march: March, carried: Carried, table: MeshTable):
    """March over one cycle.

    **Arguments:**

    - `march`: at one speed.
    - `carried`: from the cycle before.
    - `table`: of the cycle.

    **Returns:**

    What the next cycle needs, and what `March.step` gives of each step.
    """
    kinds = jnp.asarray(table.kinds)
    return jax.lax.scan(lambda c, x: march.step(c, *x), carried, (kinds, march.meshes))


def march(
    system: DynamicSystem,
    speed: Scalar,
    start: Start,
    *,
    cycles: int,
    keep: int = 1,
    stepper: AbstractStepper = Midpoint(),
    law: AbstractContactLaw = ExactContact(),
    averaged: bool = False,
    modes: ModalBasis | None = None,
) -> History:
    """March over a number of cycles.

    **Arguments:**

    - `system`: what moves.
    - `speed`: of the pinion, positive [rad/s].
    - `start`: motion and velocity at the start of a cycle: `at_rest`, `quasi_static_start`, or the
        end of a march at another speed [m, rad, m/s, rad/s].
    - `cycles`: to march.
    - `keep`: how many of the last of them to give back.
    - `stepper`: rule for one step.
    - `law`: exact or smooth contact.
    - `averaged`: whether exact contact is averaged over each step.
    - `modes`: of the system, if they are known already.

    **Returns:**

    The last cycles; look at `converged` and `drift`. Derivatives pass through all steps: near
    jumps of the response they grow without bound. Those of steady responses come from
    `HarmonicBalance`.

    **Raises:**

    - `ValueError` unless 1 <= keep <= cycles, or if contact cannot be averaged.
    """
    require(
        1 <= keep <= cycles,
        "A march keeps at least one of its cycles and not more than all: got keep = {keep} of "
        "{cycles}.",
        keep=keep,
        cycles=cycles,
    )
    modes = modal_basis(system) if modes is None else modes
    return _marched(
        system,
        jnp.asarray(speed, dtype=float),
        start,
        modes,
        law,
        cycles=cycles,
        keep=keep,
        stepper=stepper,
        averaged=averaged,
    )


@compiled
def _marched(
    system: DynamicSystem,
    speed: Scalar,
    start: Start,
    modes: ModalBasis,
    law: AbstractContactLaw,
    *,
    cycles: int,
    keep: int,
    stepper: AbstractStepper,
    averaged: bool,
) -> History:
    """See `march`."""
    ready = march_of(stepper, law, system, modes, speed, averaged=averaged)

    def unseen(carried: Carried, _):
        ahead, (drift, _) = _seen_cycle(ready, carried)
        return ahead, drift

    begun, early = jax.lax.scan(unseen, ready.begin(start), length=cycles - keep)
    last, late, kept = _seen_cycles(ready, begun, keep)
    return _history(ready, begun, last, jnp.concatenate([early, late]), kept)


@compiled
def march_on(
    system: DynamicSystem,
    speed: Scalar,
    start: Start,
    modes: ModalBasis,
    law: AbstractContactLaw,
    times: Int[Array, ""],
    *,
    keep: int,
    stepper: AbstractStepper,
) -> History:
    """March over `times` as many cycles as are kept: one program for marches of all lengths.

    It has no derivatives in reverse mode.

    **Arguments:**

    - `system`, `speed`, `start`, `modes`, `law`, `stepper`: as of `march`.
    - `times`: how often so many cycles are marched, at least once [-].
    - `keep`: how many cycles those are.

    **Returns:**

    The last of them, and their drift alone.
    """
    ready = march_of(stepper, law, system, modes, speed)
    first = ready.begin(start)
    shapes = jax.eval_shape(lambda: _seen_cycles(ready, first, keep)[1:])
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    def on(_, state):
        begun = state[1]
        last, drift, kept = _seen_cycles(ready, begun, keep)
        return begun, last, (drift, kept)

    begun, last, (drift, kept) = jax.lax.fori_loop(0, times, on, (first, first, nothing))
    return _history(ready, begun, last, drift, kept)


def _seen_cycle(march: March, carried: Carried):
    """A cycle, and by how much its end differs from its start, relative."""
    ahead, kept = cycle(march, carried, march.system.table)
    # The square root of the energy in the modes.
    size = lambda state: jnp.sqrt(jnp.sum((march.modes.swing * state[:2]) ** 2))
    return ahead, (size(ahead.state - carried.state) / size(ahead.state), kept)


def _seen_cycles(march: March, begun: Carried, count: int):
    """Some cycles: what the next one needs, their drift, and what is kept of each step."""
    last, (drift, kept) = jax.lax.scan(
        lambda carried, _: _seen_cycle(march, carried), begun, length=count
    )
    return last, drift, kept


def _history(march: March, begun: Carried, last: Carried, drift: Reals, kept) -> History:
    """What a march leaves of the cycles that it keeps."""
    place, load, states = (x.reshape(-1, *x.shape[2:]) for x in kept)
    shape = march.modes.shape
    return History(
        speed=march.speed,
        place=place,
        load=load,
        motion=states[:, 0] @ shape.T,
        velocity=states[:, 1] @ shape.T,
        start=begun.state[:2] @ shape.T,
        drift=drift,
        converged=last.error <= CONTACT_TOLERANCE,
    )
