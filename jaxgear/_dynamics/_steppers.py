r"""One time step of a natural mode, by various rules.

Each rule is linear: of the mode $\ddot y + d\,\dot y + \omega^2y = u$ it makes the state at the end
of the step from that at its start and the load $u$, which is taken at one instant of the step. All
that a march needs of a rule is what it makes of unit states and of a unit load.
"""

import abc

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
    """Implicit midpoint rule: the load is that of the mean displacement, in mid-step.

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
    """Exact for the linear modes, with the load of mid-step held over the step.

    The linear part knows no phase error and no limit of the step, so that few steps suffice where
    modes are light and contact is smooth. Second order in the load.
    """

    def advance(self, state, load, square, damping, step):
        """Advance modes by one step; see `AbstractStepper`."""
        place, speed = state
        half = 0.5 * damping
        rest = square - half**2
        swings = rest > 0.0
        frequency = jnp.sqrt(jnp.where(swings, rest, 1.0))
        decay = jnp.sqrt(jnp.where(swings, 1.0, jnp.maximum(-rest, 1e-300)))
        # exp(-a t) times cos and sin(w t)/w, or their hyperbolic kin written without overflow.
        fade = jnp.exp(-half * step)
        slow, fast = jnp.exp((decay - half) * step), jnp.exp(-(decay + half) * step)
        angle = frequency * step
        even = jnp.where(swings, fade * jnp.cos(angle), 0.5 * (slow + fast))
        odd = jnp.where(swings, fade * jnp.sin(angle) / frequency, 0.5 * (slow - fast) / decay)
        static = load / square
        away = place - static
        ended = (
            static + (even + half * odd) * away + odd * speed,
            (even - half * odd) * speed - square * odd * away,
        )
        return ended, 0.5 * (place + ended[0]), 0.5 * (speed + ended[1])


class GeneralizedAlpha(AbstractStepper):
    r"""Chung and Hulbert's generalised-$\alpha$ method, J. Appl. Mech. 60 (1993) 371.

    Newmark's rules $y_1 = y_0 + h\dot y_0 + h^2[(\frac12-\beta)\ddot y_0 + \beta\ddot y_1]$,
    $\dot y_1 = \dot y_0 + h[(1-\gamma)\ddot y_0 + \gamma\ddot y_1]$ with the balance taken between
    the ends of the step: inertia at $1-\alpha_m$, the rest at $1-\alpha_f$. Contact is evaluated at
    that instant and place.

    **Fields:**

    - `inertia`: $\alpha_m$ [-].
    - `forces`: $\alpha_f$ [-].
    - `beta`, `gamma`: of Newmark's rules [-].
    """

    inertia: float = eqx.field(static=True)
    forces: float = eqx.field(static=True)
    beta: float = eqx.field(static=True)
    gamma: float = eqx.field(static=True)

    def __init__(self, radius: float = 0.8):
        r"""The method with a given damping of infinitely fast modes.

        **Arguments:**

        - `radius`: $\rho_\infty$, what one step leaves of an infinitely fast mode, 0 to 1 [-].

        **Raises:**

        - `ValueError` if the radius is out of range.
        """
        require(
            0.0 <= radius <= 1.0,
            "`GeneralizedAlpha.radius` must be 0 to 1, got {got:.6g}.",
            got=radius,
        )
        self._set((2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0))

    def _set(self, inertia: float, forces: float) -> None:
        self.inertia, self.forces = inertia, forces
        self.beta = 0.25 * (1.0 - inertia + forces) ** 2
        self.gamma = 0.5 - inertia + forces

    @property
    def at(self) -> float:
        """Instant of the balance of forces within the step [-]."""
        return 1.0 - self.forces

    @property
    def carries(self) -> int:
        """Three: the acceleration too."""
        return 3

    def advance(self, state, load, square, damping, step):
        """Advance modes by one step; see `AbstractStepper`."""
        place, speed, acceleration = state
        share = 1.0 - self.forces
        # At the instant of the balance, apart from what the new acceleration adds.
        near = place + share * (step * speed + step**2 * (0.5 - self.beta) * acceleration)
        rate = speed + share * step * (1.0 - self.gamma) * acceleration
        by_place, by_rate = share * step**2 * self.beta, share * step * self.gamma
        whole = (1.0 - self.inertia) + by_rate * damping + by_place * square
        pull = load - self.inertia * acceleration - damping * rate - square * near
        new = pull / whole
        mixed = (0.5 - self.beta) * acceleration + self.beta * new
        ended = (
            place + step * speed + step**2 * mixed,
            speed + step * ((1.0 - self.gamma) * acceleration + self.gamma * new),
            new,
        )
        return ended, near + by_place * new, rate + by_rate * new


class HilberHughesTaylor(GeneralizedAlpha):
    """The HHT-alpha method, Earthq. Eng. Struct. Dyn. 5 (1977) 283."""

    def __init__(self, alpha: float = -0.05):
        r"""The method with its usual parameter.

        **Arguments:**

        - `alpha`: $\alpha$ of the original paper, -1/3 to 0; more negative damps fast modes more
            [-].

        **Raises:**

        - `ValueError` if it is out of range.
        """
        require(
            -1.0 / 3.0 <= alpha <= 0.0,
            "`HilberHughesTaylor.alpha` must be -1/3 to 0, got {got:.6g}.",
            got=alpha,
        )
        self._set(0.0, -alpha)


class Newmark(GeneralizedAlpha):
    r"""Newmark's method as in the thesis (section 3.3), by default $\beta = 1/4$, $\gamma = 1/2$.

    Where stiffness jumps between two steps, the acceleration with which a step starts is that on
    its own side of the jump.
    """

    def __init__(self, beta: float = 0.25, gamma: float = 0.5):
        r"""The method with its two parameters.

        **Arguments:**

        - `beta`, `gamma`: $\beta$ and $\gamma$, positive; the method is unconditionally stable for
            $2\beta \ge \gamma \ge 1/2$ [-].

        **Raises:**

        - `ValueError` unless both are positive.
        """
        require(
            beta > 0.0 and gamma > 0.0,
            "`Newmark.beta` and `gamma` must be positive, got {beta:.6g} and {gamma:.6g}.",
            beta=beta,
            gamma=gamma,
        )
        self._set(0.0, 0.0)
        self.beta, self.gamma = beta, gamma

    @property
    def refreshes(self) -> bool:
        """Whether a step starts with the acceleration on its own side of a jump."""
        return True
