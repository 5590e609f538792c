r"""What a structure answers to loads of the mesh that swing: its receptance (theory 9.1).

The dynamic stiffness $Z(s) = s^2M + s(C + \Omega_1G) + K$, the mean mesh in $K$, is inverted with
natural modes if there are no gyroscopic terms. With them it is solved for at each of few
frequencies. Of many, as of a cycle of many mesh periods, its poles cost less: in the natural modes
$\Phi$ of the structure at rest, with $y = (\omega z, \dot z)$ whose squares are energies,
$\dot y = Ay + (0, \Phi^Tf)$ and $A = X\Lambda X^{-1}$, so that
$Z^{-1}(s) = \Phi\omega^{-1}X_1(s - \Lambda)^{-1}(X^{-1})_2\Phi^T$ (Meirovitch 1974). But for
damping and forces that follow the turning, $A$ is skew, and its vectors are orthogonal.
"""

import dataclasses
from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._dynamics._system import DynamicSystem, ModalBasis
from jaxgear._dynamics._types import Matrix, Poles, Receptances, Responses, Vectors, Waves
from jaxgear._types import Flag, Reals, Scalar


class AbstractAnswers(eqx.Module):
    """Motion of a structure under loads on its mesh coordinates.

    **Fields:**

    - `mean`: of all degrees of freedom per constant load [m/N, rad/N, rad/(N m)].
    - `beside`: motion of all under other periodic loads, at each frequency, or `None` [m, rad].
    """

    mean: eqx.AbstractVar[Vectors]
    beside: eqx.AbstractVar[Waves | None]

    @abstractmethod
    def receptance(self) -> Receptances:
        """Motion of the mesh coordinates per load at each frequency [m/N, 1/N, 1/(N m)]."""

    @abstractmethod
    def waves(self, load: Waves) -> Waves:
        """Motion of all degrees of freedom.

        **Arguments:**

        - `load`: on the mesh coordinates at each frequency [N, N m].

        **Returns:**

        Motion at each frequency [m, rad].
        """

    def motion(self, load: Reals) -> Reals:
        """Motion of all degrees of freedom.

        **Arguments:**

        - `load`: on the mesh coordinates: mean, cosines and sines, in rows [N, N m].

        **Returns:**

        Mean, cosines and sines of the motion, in rows [m, rad].
        """
        count = load.shape[0] // 2
        cosines, sines = load[1 : count + 1], load[count + 1 :]
        waves = self.waves(jax.lax.complex(cosines, -sines))
        mean = self.mean @ load[0]
        return jnp.concatenate([mean[None], jnp.real(waves), -jnp.imag(waves)])


class SolvedAnswers(AbstractAnswers):
    """Answers that are solved for at each frequency.

    **Fields:**

    - `mean`, `beside`: as of `AbstractAnswers` [m/N, rad/N, rad/(N m)], [m, rad].
    - `responses`: motion per mesh load at each frequency [m/N, rad/N, rad/(N m)].
    - `vectors`: of the system [-, m].
    """

    mean: Vectors
    beside: Waves | None
    responses: Responses
    vectors: Vectors

    def receptance(self) -> Receptances:
        return jnp.einsum("da,hdb->hab", self.vectors.astype(complex), self.responses)

    def waves(self, load: Waves) -> Waves:
        return jnp.einsum("hdc,hc->hd", self.responses, load)


class DynamicStiffness(eqx.Module):
    """Z of a structure at one speed.

    **Fields:**

    - `mass`: of the system [kg, kg m, kg m2].
    - `rates`: damping and gyroscopic forces [N s/m, N s, N m s].
    - `stiffness`: with the mean mesh in it [N/m, N, N m].
    """

    mass: Matrix
    rates: Matrix
    stiffness: Matrix

    def at(self, frequency: Scalar) -> Waves:
        """The matrix at a frequency [N/m, N, N m]."""
        s = jax.lax.complex(jnp.zeros(()), frequency)
        mass, rates, stiffness = (
            x.astype(complex) for x in (self.mass, self.rates, self.stiffness)
        )
        return s * s * mass + s * rates + stiffness


class StructurePoles(eqx.Module):
    r"""The dynamic stiffness inverted, $Z^{-1}(s) = P(s - \Lambda)^{-1}W$.

    **Fields:**

    - `values`: $\Lambda$ [1/s].
    - `place`: $P$, motion per pole [m, rad].
    - `weight`: $W$, of each force in a pole.
    - `apart`: whether the vectors of the poles are far enough from each other to be used.
    """

    values: Poles
    place: Waves
    weight: Waves
    apart: Flag

    def divisor(self, frequency: Reals) -> Waves:
        """s less each pole, at each frequency [1/s]."""
        s = jax.lax.complex(jnp.zeros_like(frequency), frequency)
        return s[:, None] - self.values[None, :]

    def transposed(self) -> "StructurePoles":
        """Of the transposed dynamic stiffness."""
        return StructurePoles(self.values, self.weight.T, self.place.T, self.apart)


class PoleAnswers(AbstractAnswers):
    """Answers by the poles of the structure.

    The poles are how it is solved for; derivatives are those of its solution.

    **Fields:**

    - `mean`, `beside`: as of `AbstractAnswers` [m/N, rad/N, rad/(N m)], [m, rad].
    - `stiffness`: dynamic, of the structure.
    - `poles`: of the structure.
    - `vectors`: of the system [-, m].
    - `frequency`: of each harmonic [rad/s].
    """

    mean: Vectors
    beside: Waves | None
    stiffness: DynamicStiffness
    poles: StructurePoles
    vectors: Vectors
    frequency: Reals

    def receptance(self) -> Receptances:
        return _receptance(self.poles, self.stiffness, self.vectors, self.frequency)

    def waves(self, load: Waves) -> Waves:
        return self.under(load @ self.vectors.T.astype(complex))

    def under(self, forces: Waves) -> Waves:
        """Motion under forces on all degrees of freedom at each frequency [m, rad]."""
        product = lambda waves: jax.lax.map(
            lambda each: self.stiffness.at(each[0]) @ each[1], (self.frequency, waves)
        )
        solve = lambda _, right: _solved(self, right, turned=False)
        turned = lambda _, right: _solved(self, right, turned=True)
        return jax.lax.custom_linear_solve(product, forces, solve, transpose_solve=turned)


def _solved(answers: PoleAnswers, right: Waves, *, turned: bool) -> Waves:
    """Motion under forces on all degrees of freedom; `turned`: of the transposed matrix."""
    poles = answers.poles.transposed() if turned else answers.poles

    def by_poles(right: Waves) -> Waves:
        return ((right @ poles.weight.T) / poles.divisor(answers.frequency)) @ poles.place.T

    def at(frequency: Scalar, right: Waves) -> Waves:
        matrix = answers.stiffness.at(frequency)
        return jnp.linalg.solve(matrix.T if turned else matrix, right)

    one_by_one = lambda right: jax.lax.map(lambda each: at(*each), (answers.frequency, right))
    return jax.lax.cond(poles.apart, by_poles, one_by_one, right)


@jax.custom_jvp
def _receptance(
    poles: StructurePoles, stiffness: DynamicStiffness, vectors: Vectors, frequency: Reals
) -> Receptances:
    """Motion of the mesh coordinates per load on them at each frequency."""
    columns = vectors.astype(complex)
    left, right = columns.T @ poles.place, poles.weight @ columns
    # One after the other: of all at once what is between them has gigabytes.
    by_poles = lambda: jax.lax.map(lambda f: (left / poles.divisor(f[None])) @ right, frequency)
    one_by_one = lambda: _receptance_by_solving(stiffness, vectors, frequency)
    return jax.lax.cond(poles.apart, by_poles, one_by_one)


def _receptance_by_solving(
    stiffness: DynamicStiffness, vectors: Vectors, frequency: Reals
) -> Receptances:
    """As `_receptance`, without poles."""
    rows = vectors.T.astype(complex)
    return jax.lax.map(lambda f: rows @ jnp.linalg.solve(stiffness.at(f), rows.T), frequency)


@_receptance.defjvp
def _receptance_tangent(primals, tangents):
    # Vectors of poles that meet have no derivatives; what they add up to has.
    _, change = jax.jvp(_receptance_by_solving, primals[1:], tangents[1:])
    return _receptance(*primals), change


# Vectors of poles that are so large, when inverted, take that many times rounding for an answer:
# of orthogonal ones 1, of those of helicopter gears at speed below 2.
_MOST_INVERTED = 1e3


def poles_of(stiffness: DynamicStiffness, modes: ModalBasis) -> StructurePoles:
    """Find the poles of a structure.

    **Arguments:**

    - `stiffness`: dynamic, at the speed.
    - `modes`: natural modes at rest.

    **Returns:**

    The poles, without derivatives.
    """
    stiffness, modes = jax.lax.stop_gradient((stiffness, modes))
    swing, shape = jnp.sqrt(modes.square), modes.shape
    none = jnp.zeros_like(shape)
    held, slowed = shape.T @ stiffness.stiffness @ shape, shape.T @ stiffness.rates @ shape
    matrix = jnp.block([[none, jnp.diag(swing)], [-held / swing[None, :], -slowed]])
    values, vectors = jnp.linalg.eig(matrix)
    inverse = jnp.linalg.inv(vectors)
    count = swing.size
    return StructurePoles(
        values=values,
        place=(shape / swing[None, :]).astype(complex) @ vectors[:count],
        weight=inverse[:, count:] @ shape.T.astype(complex),
        apart=jnp.max(jnp.linalg.norm(inverse, axis=1)) < _MOST_INVERTED,
    )


# Poles cost as much as solving at so many frequencies.
MOST_SOLVED = 100


def answers_of(
    system: DynamicSystem,
    modes: ModalBasis,
    frequency: Reals,
    speed: Scalar,
    mean: Vectors,
    beside: Waves | None = None,
) -> AbstractAnswers:
    """What the structure of a system answers to loads of the mesh.

    **Arguments:**

    - `system`: what moves.
    - `modes`: its natural modes.
    - `frequency`: of each harmonic [rad/s].
    - `speed`: of the pinion [rad/s].
    - `mean`: motion of all degrees of freedom per constant load [m/N, rad/N, rad/(N m)].
    - `beside`: other loads on all degrees of freedom at each frequency, or `None` [N, N m].

    **Returns:**

    The answers.
    """
    stiffness = DynamicStiffness(system.mass, system.rates_at(speed), system.stiffness_at(speed))
    vectors = system.vectors
    if system.gyroscopic is not None and frequency.size > MOST_SOLVED:
        poles = poles_of(stiffness, modes)
        answers = PoleAnswers(mean, None, stiffness, poles, vectors, frequency)
        if beside is None:
            return answers
        return dataclasses.replace(answers, beside=answers.under(beside))
    columns = vectors.astype(complex)

    def at(given: tuple[Scalar, Waves | None]) -> Waves:
        frequency, other = given
        loads = columns if other is None else jnp.column_stack([columns, other])
        matrix = stiffness.at(frequency)
        if system.gyroscopic is not None:
            return jnp.linalg.solve(matrix, loads)
        solve = lambda _, right: _by_natural_modes(modes, frequency, right)
        # The modes are how the system is solved; derivatives are those of its solution.
        product = lambda x: matrix @ x
        return jax.lax.custom_linear_solve(product, loads, solve, symmetric=True)

    # Large systems one by one: see `between_all_cells`.
    one_by_one = system.turning is not None
    given = frequency, beside
    found = jax.lax.map(at, given) if one_by_one else jax.vmap(at)(given)
    if beside is None:
        return SolvedAnswers(mean, None, found, vectors)
    return SolvedAnswers(mean, found[:, :, -1], found[:, :, :-1], vectors)


def _by_natural_modes(modes: ModalBasis, frequency: Scalar, right: Waves) -> Waves:
    """Motion under forces at a frequency, without gyroscopic terms."""
    shape = modes.shape.astype(complex)
    divisor = jax.lax.complex(modes.square - frequency**2, frequency * modes.damping)
    return shape @ ((shape.T @ right) / divisor[:, None])
