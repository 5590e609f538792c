r"""One time step of a natural mode, by various rules.

Each rule is linear: of the mode $\ddot y + d\,\dot y + \omega^2y = u$ it makes the state at the end
of the step from that at its start and the load $u$, which is taken at one instant of the step. All
that time stepping needs of a rule is what it makes of unit states and of a unit load.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._types import Reals, Scalar

# Displacement, velocity, and acceleration for rules that carry it.
State = tuple[Reals, ...]


class AbstractStepper(eqx.Module):
    """A rule for one time step. All its numbers are fixed when it is built.

    Where nothing else is said, the load is that of mid-step (`at`: 0 where the step starts, 1 where
    it ends), and the state of a mode is displacement and velocity.
    """

    @property
    def at(self) -> float:
        """Instant of the load within the step [-]."""
        return 0.5

    @property
    def carries(self) -> int:
        """Number of parts of a mode's state."""
        return 2

    @property
    def refreshes(self) -> bool:
        """Whether a step starts with the acceleration on its own side of a jump."""
        return False

    @abc.abstractmethod
    def advance(
        self, state: State, load: Reals, square: Reals, damping: Reals, step: Scalar
    ) -> tuple[State, Reals, Reals]:
        r"""Advance modes by one step.

        **Arguments:**

        - `state`: displacement, velocity and, where carried, acceleration of each mode.
        - `load`: $u$ of each mode at the instant `at`.
        - `square`: $\omega^2$ of each mode [rad2/s2].
        - `damping`: $d = 2\xi\omega$ of each mode [1/s].
        - `step`: length of the step [s].

        **Returns:**

        The state at the end; displacement and velocity at the instant of the load.
        """


class Midpoint(AbstractStepper):
    """Implicit midpoint rule: the load is that of the mean displacement, in mid-step (theory 8.10).

    It is Newmark's rule of constant average acceleration with the load in the middle, where the
    cells of a step are known without jumps. Second order, no numerical damping; with contact
    averaged over the step it conserves energy.
    """

    def advance(self, state, load, square, damping, step):
        """Advance modes by one step; see `AbstractStepper`."""
        place, speed = state
        whole = 2.0 + step * damping + 0.5 * step**2 * square
        middle = (2.0 * speed - step * square * place + step * load) / whole
        ended = place + step * middle, 2.0 * middle - speed
        return ended, place + 0.5 * step * middle, middle


class Exponential(AbstractStepper):
    """Exact for the linear modes, with the load of mid-step held over the step (theory 8.11).

    The linear part knows no phase error and no limit of the step, so that few steps suffice where
    modes are light and contact is smooth. Second order in the load.
    """

    def advance(self, state, load, square, damping, step):
        """Advance modes by one step; see `AbstractStepper`."""
        place, speed = state
        half = 0.5 * damping
        rest = square - half**2
        # Between swinging and creeping modes, where both forms are 0/0, a series.
        near = jnp.abs(rest) * step**2 < 1e-6
        root = jnp.sqrt(jnp.where(near, 1.0, jnp.abs(rest)))
        fade, angle = jnp.exp(-half * step), root * step
        slow, fast = jnp.exp((root - half) * step), jnp.exp(-(root + half) * step)
        swings = rest > 0.0
        even = jnp.where(swings, fade * jnp.cos(angle), 0.5 * (slow + fast))
        odd = jnp.where(swings, fade * jnp.sin(angle), 0.5 * (slow - fast)) / root
        turn = rest * step**2
        even = jnp.where(near, fade * (1.0 - turn / 2.0 + turn**2 / 24.0), even)
        odd = jnp.where(near, fade * step * (1.0 - turn / 6.0 + turn**2 / 120.0), odd)
        static = load / square
        away = place - static
        ended = (
            static + (even + half * odd) * away + odd * speed,
            (even - half * odd) * speed - square * odd * away,
        )
        return ended, 0.5 * (place + ended[0]), 0.5 * (speed + ended[1])


class Weights(NamedTuple):
    r"""Numbers of a rule of Newmark's family: $\alpha_m$, $\alpha_f$, $\beta$, $\gamma$ [-]."""

    inertia: float
    forces: float
    beta: float
    gamma: float


class AbstractNewmark(AbstractStepper):
    r"""Newmark's family, which carries the acceleration.

    $y_1 = y_0 + h\dot y_0 + h^2[(\frac12-\beta)\ddot y_0 + \beta\ddot y_1]$ and
    $\dot y_1 = \dot y_0 + h[(1-\gamma)\ddot y_0 + \gamma\ddot y_1]$, with the balance of forces
    between the ends of the step: inertia at $1-\alpha_m$, all else at $1-\alpha_f$, where contact
    is evaluated.
    """

    @property
    @abc.abstractmethod
    def weights(self) -> Weights:
        """The four numbers."""

    @property
    def at(self) -> float:
        """Instant of the balance of forces within the step [-]."""
        return 1.0 - self.weights.forces

    @property
    def carries(self) -> int:
        """Three: the acceleration too."""
        return 3

    def advance(self, state, load, square, damping, step):
        """Advance modes by one step; see `AbstractStepper`."""
        weights = self.weights
        place, speed, acceleration = state
        share = 1.0 - weights.forces
        # At the instant of the balance, apart from what the new acceleration adds.
        near = place + share * (step * speed + step**2 * (0.5 - weights.beta) * acceleration)
        rate = speed + share * step * (1.0 - weights.gamma) * acceleration
        by_place, by_rate = share * step**2 * weights.beta, share * step * weights.gamma
        whole = (1.0 - weights.inertia) + by_rate * damping + by_place * square
        pull = load - weights.inertia * acceleration - damping * rate - square * near
        new = pull / whole
        mixed = (0.5 - weights.beta) * acceleration + weights.beta * new
        ended = (
            place + step * speed + step**2 * mixed,
            speed + step * ((1.0 - weights.gamma) * acceleration + weights.gamma * new),
            new,
        )
        return ended, near + by_place * new, rate + by_rate * new


class GeneralizedAlpha(AbstractNewmark):
    r"""The generalised-$\alpha$ method of Chung and Hulbert, J. Appl. Mech. 60 (1993) 371.

    **Fields:**

    - `radius`: $\rho_\infty$, what one step leaves of an infinitely fast mode, 0 to 1 [-].

    **Raises:**

    - `ValueError` if the radius is out of range.
    """

    radius: float = eqx.field(static=True, default=0.8)

    def __check_init__(self):
        require(
            0.0 <= self.radius <= 1.0,
            "`GeneralizedAlpha.radius` must be 0 to 1, got {got:.6g}.",
            got=self.radius,
        )

    @property
    def weights(self) -> Weights:
        """The four numbers, of second order whatever the radius."""
        inertia = (2.0 * self.radius - 1.0) / (self.radius + 1.0)
        forces = self.radius / (self.radius + 1.0)
        return Weights(
            inertia, forces, 0.25 * (1.0 - inertia + forces) ** 2, 0.5 - inertia + forces
        )


class HilberHughesTaylor(AbstractNewmark):
    r"""The HHT-$\alpha$ method, Earthq. Eng. Struct. Dyn. 5 (1977) 283 (theory 8.10).

    **Fields:**

    - `alpha`: $\alpha$, -1/3 to 0; the more negative, the more fast modes are damped [-].

    **Raises:**

    - `ValueError` if it is out of range.
    """

    alpha: float = eqx.field(static=True, default=-0.05)

    def __check_init__(self):
        require(
            -1.0 / 3.0 <= self.alpha <= 0.0,
            "`HilberHughesTaylor.alpha` must be -1/3 to 0, got {got:.6g}.",
            got=self.alpha,
        )

    @property
    def weights(self) -> Weights:
        """The four numbers."""
        return Weights(0.0, -self.alpha, 0.25 * (1.0 - self.alpha) ** 2, 0.5 - self.alpha)


class Newmark(AbstractNewmark):
    r"""Newmark's method as in the thesis (section 3.3, theory 8.10).

    Where stiffness jumps between two steps, the acceleration with which a step starts is that on
    its own side of the jump. It is unconditionally stable for $2\beta \ge \gamma \ge 1/2$.

    **Fields:**

    - `beta`: $\beta$; 1/4 is the rule of constant average acceleration [-].
    - `gamma`: $\gamma$; 1/2 damps nothing [-].

    **Raises:**

    - `ValueError` unless both are positive.
    """

    beta: float = eqx.field(static=True, default=0.25)
    gamma: float = eqx.field(static=True, default=0.5)

    def __check_init__(self):
        require(
            self.beta > 0.0 and self.gamma > 0.0,
            "`Newmark.beta` and `Newmark.gamma` must be positive, got {beta:.6g} and {gamma:.6g}.",
            beta=self.beta,
            gamma=self.gamma,
        )

    @property
    def weights(self) -> Weights:
        """The four numbers: forces balance at the end of the step."""
        return Weights(0.0, 0.0, self.beta, self.gamma)

    @property
    def refreshes(self) -> bool:
        """Whether a step starts with the acceleration on its own side of a jump."""
        return True
