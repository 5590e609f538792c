"""One step in time: the rule of the modes, what ties them, and the step itself."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._dynamics._cell_forces import mesh_load
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._pressing import (
    Pressing,
    load_at_nodes,
    matrix_product,
    matrix_vector,
    pressed,
)
from jaxgear._dynamics._steppers import AbstractStepper
from jaxgear._dynamics._system import DynamicSystem, ModalBasis
from jaxgear._dynamics._table import END, MIDDLE, START, mesh_at, mesh_within
from jaxgear._dynamics._types import ModeValues, ModeVectors, Start
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import CoordinateMatrix, Coordinates, Reals, Scalar


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
            load = load + system.cell_damping * matrix_vector(tangent, modes.mesh.T @ velocity)
        excess = load - matrix_vector(system.mean, nodes)
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
        place = matrix_vector(rule.follows, free)
        brakes = rule.brakes
        if system.cell_damping is not None:
            # Rates answer to the excess load g - k n, and n to the load g.
            free_rate = free_rate + matrix_vector(brakes, matrix_vector(system.mean, place))
            node_yields = matrix_product(rule.follows, rule.own)
            brakes = brakes + matrix_product(brakes, matrix_product(system.mean, node_yields))
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
        nodes = place - matrix_vector(matrix_product(rule.follows, rule.own), load)
        met = place - matrix_vector(rule.yields, load)
        excess = load - matrix_vector(system.mean, nodes)
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
