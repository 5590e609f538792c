r"""Shooting: Newton's method for time steps that come back to where they set out.

It finds the very response that time stepping would end in, unstable ones too; its
matrix is the derivative of a whole cycle by its start.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._dynamics._march import cycle, quasi_static_start
from jaxgear._dynamics._march_step import march_of
from jaxgear._dynamics._orbit import AbstractMethod, Orbit, bears_load, without_derivatives
from jaxgear._dynamics._pressing import CONTACT_TOLERANCE
from jaxgear._dynamics._step_product import product_of_steps, tangents_of
from jaxgear._dynamics._steppers import AbstractStepper, Exponential
from jaxgear._dynamics._system import DynamicSystem, modal_basis
from jaxgear._dynamics._types import Start
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import Flag, Reals, Scalar


class Shooting(AbstractMethod):
    """Step to the end of the cycle, correct the start, and step again (theory 9.3).

    **Fields:**

    - `stepper`: rule for one step, with its load in mid-step.
    - `law`: exact or smooth contact.
    - `multiple`: cycles after which the response repeats; 2 finds sub-harmonic responses.
    - `warm_up`: cycles of time stepping before the first correction.
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

        **Raises:**

        - `InputError` if it is differentiated.
        """
        start = quasi_static_start(system) if start is None else start
        system = system.over(self.multiple)
        modes = modal_basis(system)
        march = march_of(self.stepper, self.law, system, modes, speed)
        swing = modes.swing

        def over(state: Reals):
            """What the cycle ends with, its relative change, and what is kept of each step."""
            begun = eqx.tree_at(lambda c: c.state, march.begin(start), state)
            ended, kept = cycle(march, begun, system.table)
            change = jnp.sqrt(jnp.sum((swing * (ended.state - state)) ** 2))
            size = jnp.sqrt(jnp.sum((swing * ended.state) ** 2))
            return ended, change / size, kept

        def correct(search):
            state, _, steps = search
            ended, error, (place, _, _) = over(state)
            matrix = product_of_steps(march, tangents_of(march, place))
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
        reached, error, (place, load, ended) = over(state)
        begun = jnp.concatenate([state[None], ended[:-1]])
        middle = 0.5 * (begun[:, 0] + ended[:, 0])
        # Through its corrections a derivative would be that of a start that no longer is corrected.
        return without_derivatives(
            "shooting",
            Orbit(
                speed=speed,
                place=place,
                load=load,
                motion=middle @ modes.shape.T,
                start=state @ modes.shape.T,
                residual=error,
                settled=(error <= self.tolerance)
                & (reached.error <= CONTACT_TOLERANCE)
                & bears_load(system, load),
                steps=steps,
            ),
        )
