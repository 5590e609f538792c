r"""Shooting: Newton's method for a march that comes back to where it set out, and its stability.

In every step the mesh ties the modes together through its few coordinates only, so that the
derivative of a cycle by its start, the monodromy matrix, is a product of steps that each cost a few
columns. Its eigenvalues, Floquet's multipliers, tell how a disturbance of the orbit grows in a
cycle: beyond 1 in size the orbit is there, but no machine stays on it. One leaves through +1 at a
fold, through -1 where the period doubles.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._dynamics._march import March, cycle, march_of, quasi_static_start
from jaxgear._dynamics._orbit import AbstractMethod, Orbit, carries
from jaxgear._dynamics._steppers import AbstractStepper, Exponential
from jaxgear._dynamics._system import DynamicSystem, ModalBasis, modal_basis
from jaxgear._dynamics._table import (
    END,
    MIDDLE,
    START,
    mean_tangent,
    mesh_at,
    mesh_load,
    repeated,
)
from jaxgear._dynamics._types import Start, StepMatrices, StepPlaces
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import Flag, Reals, Scalar

# Derivatives of the state of all modes by its start, both parts; each flattened.
Monodromy = Float[Array, "state state"]


class Shooting(AbstractMethod):
    """March to the end of the cycle, correct the start, and march again.

    **Fields:**

    - `stepper`: rule for one step, with its load in mid-step.
    - `law`: exact or smooth contact.
    - `multiple`: cycles after which the response repeats; 2 finds sub-harmonic responses.
    - `warm_up`: cycles to march before the first correction.
    - `tolerance`: change of the state over the response at which it counts as settled, relative
        [-].
    - `most_steps`: corrections after which the method gives up.
    """

    stepper: AbstractStepper = eqx.field(default_factory=Exponential)
    law: AbstractContactLaw = eqx.field(default_factory=ExactContact)
    multiple: int = eqx.field(static=True, default=1)
    warm_up: int = eqx.field(static=True, default=20)
    tolerance: float = eqx.field(static=True, default=1e-9)
    most_steps: int = eqx.field(static=True, default=25)

    def __check_init__(self):
        require(
            self.stepper.carries == 2 and self.stepper.at == 0.5,
            "`Shooting.stepper` must take its load in mid-step: `Midpoint` or `Exponential`.",
        )

    def orbit(self, system: DynamicSystem, speed: Scalar, start: Start | None = None) -> Orbit:
        """Find the response at one speed; see `AbstractMethod`.

        There are no derivatives: those of the same response are to be had from `HarmonicBalance`.
        """
        start = quasi_static_start(system) if start is None else start
        system = eqx.tree_at(lambda s: s.table, system, repeated(system.table, self.multiple))
        modes = modal_basis(system)
        march = march_of(self.stepper, self.law, system, modes, speed)
        swing = jnp.stack([jnp.sqrt(modes.square), jnp.ones_like(modes.square)])

        def over(state: Reals):
            """State at the end, relative change, and what is kept of each step."""
            begun = eqx.tree_at(lambda c: c.state, march.begin(start), state)
            ended, kept = cycle(march, begun, system.table)
            change = jnp.sqrt(jnp.sum((swing * (ended.state - state)) ** 2))
            size = jnp.sqrt(jnp.sum((swing * ended.state) ** 2))
            return ended, change / size, kept

        def correct(search):
            state, _, steps = search
            ended, error, (place, _, _) = over(state)
            matrix = _monodromy(march, _tangents(march, place))
            # In units of energy, rows and columns are of one size.
            weights = swing.reshape(-1)
            gap = (ended.state - state).reshape(-1) * weights
            scaled = weights[:, None] * matrix / weights[None, :]
            moved = jnp.linalg.solve(jnp.eye(gap.size) - scaled, gap) / weights
            settled = error <= self.tolerance
            new = jnp.where(settled, state, state + moved.reshape(state.shape))
            return new, error, steps + 1.0

        def unsettled(search) -> Flag:
            return ~(search[1] <= self.tolerance) & (search[2] < self.most_steps)

        warm, _ = jax.lax.scan(
            lambda c, _: (cycle(march, c, system.table)[0], None),
            march.begin(start),
            length=self.warm_up,
        )
        first = warm.state, jnp.asarray(jnp.inf), jnp.zeros(())
        state, _, steps = jax.lax.while_loop(unsettled, correct, first)
        _, error, (place, load, ended) = over(state)
        begun = jnp.concatenate([state[None], ended[:-1]])
        middle = 0.5 * (begun[:, 0] + ended[:, 0])
        return Orbit(
            speed=speed,
            place=place,
            load=load,
            motion=middle @ modes.shape.T,
            start=state @ modes.shape.T,
            residual=error,
            settled=(error <= self.tolerance) & carries(system, load),
            steps=steps,
        )


def monodromy(
    system: DynamicSystem,
    modes: ModalBasis,
    orbit: Orbit,
    *,
    stepper: AbstractStepper = Exponential(),
    law: AbstractContactLaw = ExactContact(),
) -> Monodromy:
    """Derivative of the state at the end of a response by that at its start.

    A cell that closes within a step counts for the part of the step in which it is closed: what is
    found converges with the square of the step, where the derivative of the steps themselves
    has the error of a whole step wherever contact changes.

    **Arguments:**

    - `system`: what moves.
    - `modes`: its natural modes.
    - `orbit`: of this system, by any method, over one or more cycles.
    - `stepper`: `Midpoint` or, exact in the linear part, `Exponential`.
    - `law`: contact law whose tangent stiffness counts.

    **Returns:**

    A square matrix on displacements of all modes, then velocities, of unit modal mass.
    """
    multiple = orbit.place.shape[0] // len(system.table.kinds)
    system = eqx.tree_at(lambda s: s.table, system, repeated(system.table, multiple))
    march = march_of(stepper, law, system, modes, orbit.speed)
    if not isinstance(law, ExactContact):
        return _monodromy(march, _tangents(march, orbit.place))
    places = jnp.concatenate([orbit.place[-1:], orbit.place, orbit.place[:1]])
    ends = 0.5 * (places[:-1] + places[1:])
    start, middle, end = (mesh_at(system.table, part) for part in (START, MIDDLE, END))
    mean = jax.vmap(mean_tangent)(start, middle, end, ends[:-1], ends[1:])
    return _monodromy(march, mean)


def multipliers(monodromies: Array, modes: ModalBasis) -> np.ndarray:
    """Floquet's multipliers, the eigenvalues of monodromy matrices, largest first.

    This is not for tracing: no platform but the CPU finds eigenvalues of such matrices.

    **Arguments:**

    - `monodromies`: one, or many on leading axes.
    - `modes`: of the system: scaled by its frequencies, eigenvalues lose fewer digits.

    **Returns:**

    The multipliers on the last axis [-].
    """
    swing = np.sqrt(np.asarray(modes.square))
    weights = np.concatenate([swing, np.ones_like(swing)])
    scaled = np.asarray(monodromies) * weights[:, None] / weights[None, :]
    found = np.linalg.eigvals(scaled)
    order = np.argsort(-np.abs(found), axis=-1)
    return np.take_along_axis(found, order, axis=-1)


def _tangents(march: March, places: StepPlaces) -> StepMatrices:
    """Tangent stiffness of the mesh in each step [N/m, N, N m]."""
    meshes = march.meshes[0]
    return jax.vmap(lambda mesh, place: mesh_load(mesh, place, march.law)[1])(meshes, places)


def _monodromy(march: March, tangents: StepMatrices) -> Monodromy:
    """Product of the derivatives of all steps."""
    modes, mean = march.modes, march.system.mean
    size = modes.square.size
    damping = march.system.cell_damping

    def gains(rule, tangent):
        """Excess load per change of the nodes' mesh coordinates, and of their rates."""
        # g = T (n - B g) and, with damping, + eta T n'; n and n' are those under the load.
        whole = (
            tangent
            if march.system.bow is None
            else jnp.linalg.solve(jnp.eye(mean.shape[0]) + tangent @ march.system.bow, tangent)
        )
        excess = whole - mean
        if damping is None:
            closed = jnp.eye(mean.shape[0]) + excess @ rule.own
            return jnp.linalg.solve(closed, excess), None
        closed = jnp.eye(mean.shape[0]) + excess @ rule.own + damping * whole @ rule.brakes
        both = jnp.linalg.solve(closed, jnp.concatenate([excess, damping * whole], axis=1))
        return both[:, : mean.shape[0]], both[:, mean.shape[0] :]

    each = [jax.vmap(lambda t, r=rule: gains(r, t))(tangents) for rule in march.rules]

    def step(columns: Reals, x):
        kind, gain = x
        rule, (by_place, by_rate) = march.rules[0], gain[0]
        for number, other in enumerate(march.rules[1:], 1):
            pick = lambda a, b, k=number: jnp.where(kind == k, b, a)
            rule = jax.tree.map(pick, rule, other)
            by_place = pick(by_place, gain[number][0])
            by_rate = None if by_rate is None else pick(by_rate, gain[number][1])
        near = jnp.sum(rule.near[:, :, None] * columns, axis=0)
        rate = jnp.sum(rule.rate[:, :, None] * columns, axis=0)
        turned = None if rule.whirl is None else rule.whirl @ rate
        if turned is not None:
            near = near - rule.near_load[:, None] * turned
            rate = rate - rule.rate_load[:, None] * turned
        excess = by_place @ (modes.mesh.T @ near)
        if by_rate is not None:
            excess = excess + by_rate @ (modes.mesh.T @ rate)
        pushed = -rule.pushes @ excess
        if turned is not None:
            pushed = pushed - turned
        ended = jnp.sum(rule.state[:, :, :, None] * columns[None], axis=1)
        return ended + rule.load[:, :, None] * pushed[None], None

    start = jnp.eye(2 * size).reshape(2, size, 2 * size)
    kinds = jnp.asarray(march.system.table.kinds)
    ended, _ = jax.lax.scan(step, start, (kinds, each))
    return ended.reshape(2 * size, 2 * size)
