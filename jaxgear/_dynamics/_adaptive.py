"""Integration with adaptive steps, as a method of steady responses: another family to compare."""

import equinox as eqx
import jax.numpy as jnp

from jaxgear._dynamics._march import quasi_static_start
from jaxgear._dynamics._orbit import AbstractMethod, Orbit
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._transient import transient
from jaxgear._dynamics._types import Start
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import Scalar


class Adaptive(AbstractMethod):
    """Integrate with an adaptive step from one cycle to the next, and hope that it converges.

    **Fields:**

    - `law`: smooth contact, or exact.
    - `rtol`: error of a step over the motion, and over the static deflection [-].
    - `cycles`: to integrate.
    - `tolerance`: change of the motion over the last cycle at which it counts as converged,
        relative [-].
    - `multiple`: cycles after which the response repeats, always 1.
    """

    law: AbstractContactLaw = eqx.field(default_factory=ExactContact)
    rtol: float = eqx.field(static=True, default=1e-4)
    cycles: int = eqx.field(static=True, default=50)
    tolerance: float = eqx.field(static=True, default=1e-4)
    multiple: int = eqx.field(static=True, default=1)

    def orbit(self, system: DynamicSystem, speed: Scalar, start: Start | None = None) -> Orbit:
        """Find the response at one speed; see `AbstractMethod`."""
        start = quasi_static_start(system) if start is None else start
        middles = system.table.middles
        late = (self.cycles - 2.0) * system.table.periods
        shares = jnp.concatenate([late + middles, late + system.table.periods + middles])
        times = jnp.concatenate([jnp.zeros(1), shares * system.mesh_period(speed)])
        found = transient(
            system, speed, 1.0, start, times,
            law=self.law, rtol=self.rtol, atol=self.rtol, throw=False,
        )  # fmt: skip
        last = slice(-middles.size, None)
        error = found.transmission_error[1:].reshape(2, -1)
        residual = jnp.max(jnp.abs(error[1] - error[0])) / jnp.max(jnp.abs(error))
        return Orbit(
            speed=speed,
            place=found.place[last],
            load=found.load[last],
            motion=found.motion[last],
            start=start,
            residual=residual,
            settled=(residual <= self.tolerance) & found.complete,
            steps=(found.steps + found.rejected).astype(float),
        )
