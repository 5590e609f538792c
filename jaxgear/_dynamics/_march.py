r"""Marching in time: modes by a linear rule, contact by a few equations on the mesh coordinates.

In a step all modes obey their rule under the load $u = \Phi^T(F - V(g - \bar kn))$. At the instant
of the load the nodes are then at $n = c - S(g - \bar kn)$ with $S$ from the rule: the mesh load $g$
is the minimum of a convex energy, unilateral contact of few unknowns, whatever the number of
modes. It is found by Newton's method from the load before.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxgear._checks import require
from jaxgear._compiled import compiled, lasting, lasting_rare
from jaxgear._dynamics._cell_forces import mesh_load
from jaxgear._dynamics._march_step import Carried, March, march_of
from jaxgear._dynamics._orbit import AbstractMethod, Orbit, bears_load, without_derivatives
from jaxgear._dynamics._pressing import CONTACT_TOLERANCE, load_at_nodes
from jaxgear._dynamics._steppers import AbstractStepper, Midpoint, Newmark
from jaxgear._dynamics._system import DynamicSystem, ModalBasis, modal_basis
from jaxgear._dynamics._table import MIDDLE, START, MeshTable, mesh_at
from jaxgear._dynamics._types import Motion, Start, StepPlaces
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import Flag, Reals, Scalar


class TimeHistory(eqx.Module):
    """What time stepping leaves of its last cycles.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `place`: mesh coordinates at the instant of each step's load [m, rad].
    - `load`: elastic load of the mesh on them [N, N m].
    - `motion`: of every degree of freedom at the end of each step [m, rad].
    - `velocity`: the same, its rate [m/s, rad/s].
    - `start`: motion and velocity where these cycles begin [m, rad, m/s, rad/s].
    - `drift`: change of the state over each cycle, relative to its size [-].
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


class TimeStepping(AbstractMethod):
    """Step in time until the response repeats, as machines do: it ends on stable responses only.

    **Fields:**

    - `stepper`: rule for one step.
    - `law`: exact or smooth contact.
    - `cycles`: of time stepping.
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
            "`TimeStepping.cycles` must be at least twice `multiple`, got {cycles} and {multiple}.",
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
        history = time_history(
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


@lasting_rare
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


def time_history(
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
) -> TimeHistory:
    """Step in time over a number of cycles (theory 8.11, theory 8.12).

    **Arguments:**

    - `system`: what moves.
    - `speed`: of the pinion, positive [rad/s].
    - `start`: motion and velocity at the start of a cycle: `at_rest`, `quasi_static_start`, or the
        end of a time history at another speed [m, rad, m/s, rad/s].
    - `cycles`: of time stepping.
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
        "A time history keeps at least one of its cycles and not more than all: got keep = {keep} "
        "of {cycles}.",
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
) -> TimeHistory:
    """See `time_history`."""
    ready = march_of(stepper, law, system, modes, speed, averaged=averaged)

    def unseen(carried: Carried, _):
        ahead, (drift, _) = _seen_cycle(ready, carried)
        return ahead, drift

    begun, early = jax.lax.scan(unseen, ready.begin(start), length=cycles - keep)
    last, late, kept = _seen_cycles(ready, begun, keep)
    return _history(ready, begun, last, jnp.concatenate([early, late]), kept)


@lasting
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
) -> TimeHistory:
    """March over `times` as many cycles as are kept: one program for marches of all lengths.

    It has no derivatives in reverse mode.

    **Arguments:**

    - `system`, `speed`, `start`, `modes`, `law`, `stepper`: as of `time_history`.
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


def _history(march: March, begun: Carried, last: Carried, drift: Reals, kept) -> TimeHistory:
    """What a march leaves of the cycles that it keeps."""
    place, load, states = (x.reshape(-1, *x.shape[2:]) for x in kept)
    shape = march.modes.shape
    return TimeHistory(
        speed=march.speed,
        place=place,
        load=load,
        motion=states[:, 0] @ shape.T,
        velocity=states[:, 1] @ shape.T,
        start=begun.state[:2] @ shape.T,
        drift=drift,
        converged=last.error <= CONTACT_TOLERANCE,
    )
