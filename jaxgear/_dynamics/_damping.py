r"""Viscous damping of the averaged system: a constant matrix $C$ in $M\ddot q + C\dot q + \bar Kq$.

It is built from the system whose mesh has its mean stiffness, and stays what it is while teeth come
and go.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._compiled import in_numpy
from jaxgear._dynamics._types import FreeMotions, Matrix
from jaxgear._types import Scalar, as_scalar

# What rounding leaves of a number that should be zero, in units of the last digit of the largest
# that it was computed from.
_NOISE = 1e3


class AbstractDamping(eqx.Module):
    """How vibration dies out."""

    @abc.abstractmethod
    def matrix(self, mass: Matrix, stiffness: Matrix, mesh: Matrix) -> Matrix:
        r"""Assemble the damping matrix.

        Motions that nothing holds must be held here by a spring of no meaning; `damping_matrix`
        does so, and takes out what it brings in.

        **Arguments:**

        - `mass`: $M$, positive definite [kg, kg m, kg m2].
        - `stiffness`: $\bar K$, mean mesh stiffness included, positive definite
            [N/m, N/rad, N m/rad].
        - `mesh`: part of the mean mesh stiffness in it [N/m, N/rad, N m/rad].

        **Returns:**

        $C$, symmetric [N s/m, N s, N m s].
        """


class RayleighDamping(AbstractDamping):
    r"""$C = a_R M + b_R\bar K$ (Guilbert 2017, eq. 2.34), a ratio of $a_R/2\omega + b_R\omega/2$.

    The second part grows with frequency: it soon damps mesh harmonics too much (theory 8.4).

    **Fields:**

    - `mass_factor`: $a_R$ [1/s].
    - `stiffness_factor`: $b_R$ [s].

    **Raises:**

    - `ValueError` if a factor is negative.
    """

    mass_factor: Scalar = eqx.field(converter=as_scalar)
    stiffness_factor: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        for name, unit in (("mass_factor", "1/s"), ("stiffness_factor", "s")):
            require(
                in_numpy(getattr(self, name)) >= 0.0,
                "`RayleighDamping." + name + "` must not be negative, got {got:.6g} " + unit + ". "
                "A negative one feeds vibration.",
                got=getattr(self, name),
            )

    def matrix(self, mass: Matrix, stiffness: Matrix, mesh: Matrix) -> Matrix:
        del mesh
        return self.mass_factor * mass + self.stiffness_factor * stiffness


class ModalDamping(AbstractDamping):
    r"""A ratio for each mode, by where its strain energy is (Guilbert 2017, eq. 2.36, theory 8.5).

    $C = \sum_i 2\xi_i\omega_i(M\varphi_i)(M\varphi_i)^T$ over all modes, where
    $\xi_i = \xi_m e_i + \xi_s(1 - e_i)$ and
    $e_i = \varphi_i^T\bar K_m\varphi_i/\varphi_i^T\bar K\varphi_i$ is the mesh's share.

    Derivatives are those of this matrix, also where frequencies coincide, as long as the mesh
    loads none of the modes that share one, as with bearings equally stiff all round. Where it does,
    the modes, and with them $C$, change at a stroke: there is no derivative, and the one given is
    NaN.

    **Fields:**

    - `mesh`: $\xi_m$, ratio of a mode with all its energy in the mesh [-].
    - `structure`: $\xi_s$, ratio of a mode that leaves the mesh alone [-].

    **Raises:**

    - `ValueError` unless both ratios are at least 0 and below 1.
    """

    mesh: Scalar = eqx.field(converter=as_scalar, default=0.07)
    structure: Scalar = eqx.field(converter=as_scalar, default=0.02)

    def __check_init__(self):
        for name in ("mesh", "structure"):
            ratio = getattr(self, name)
            require(
                (in_numpy(ratio) >= 0.0) & (in_numpy(ratio) < 1.0),
                "`ModalDamping." + name + "` must be at least 0 and below 1, got {got:.6g}. It is "
                "a ratio to critical damping: write 0.02 for 2 %.",
                got=ratio,
            )

    def matrix(self, mass: Matrix, stiffness: Matrix, mesh: Matrix) -> Matrix:
        root = jnp.linalg.cholesky(mass)
        damped = _composite(
            per_mass(root, stiffness), per_mass(root, mesh), self.mesh, self.structure
        )
        return root @ damped @ root.T


def damping_matrix(
    damping: AbstractDamping, mass: Matrix, stiffness: Matrix, mesh: Matrix, free: FreeMotions
) -> Matrix:
    r"""Damping of all motions but those that nothing holds, whatever holds these in `stiffness`.

    A spring of no meaning must not give its mode the frequency of another: two modes that meet are
    any mixture of each other, and share their damping. Here free motions are held above all others.

    **Arguments:**

    - `damping`: of the other motions.
    - `mass`: $M$, positive definite [kg, kg m, kg m2].
    - `stiffness`: $\bar K$ with the mean mesh stiffness, and with springs that hold the free
        motions, of whatever stiffness; positive definite [N/m, N/rad, N m/rad].
    - `mesh`: part of the mean mesh stiffness in it [N/m, N/rad, N m/rad].
    - `free`: $R$, motions that nothing else holds, as columns with $R^TMR = I$, or no columns
        [1/kg^0.5, 1/(m kg^0.5)].

    **Returns:**

    $C$, symmetric, with $CR = 0$ [N s/m, N s, N m s].
    """
    if free.shape[1] == 0:
        return damping.matrix(mass, stiffness, mesh)
    loose = without_hold(stiffness, free)
    momentum = mass @ free
    # Twice the Frobenius norm is above every eigenvalue.
    above = 2.0 * jnp.linalg.norm(per_mass(jnp.linalg.cholesky(mass), loose))
    held = loose + above * (momentum @ momentum.T)
    return free_of(damping.matrix(mass, held, mesh), mass, free)


def free_of(damping: Matrix, mass: Matrix, free: FreeMotions) -> Matrix:
    r"""Take the damping of free motions out: $C \to (I - MRR^T)\,C\,(I - RR^TM)$.

    **Arguments:**

    - `damping`: $C$ [N s/m, N s, N m s].
    - `mass`: $M$ [kg, kg m, kg m2].
    - `free`: $R$, motions that nothing holds, as columns with $R^TMR = I$
        [1/kg^0.5, 1/(m kg^0.5)].

    **Returns:**

    The matrix that lets these motions run on [N s/m, N s, N m s].
    """
    others = jnp.eye(mass.shape[0]) - free @ (free.T @ mass)
    return others.T @ damping @ others


def without_hold(stiffness: Matrix, free: FreeMotions) -> Matrix:
    r"""Take out the springs that hold the free motions, whatever else they hold.

    $K - KR\,(R^TKR)^{-1}R^TK$, which is $K$ without them as long as there are no more springs than
    free motions.

    **Arguments:**

    - `stiffness`: $K$, positive definite on the free motions [N/m, N/rad, N m/rad].
    - `free`: $R$, motions that only these springs hold, as columns, or no columns
        [1/kg^0.5, 1/(m kg^0.5)].

    **Returns:**

    The stiffness without them, zero on the free motions [N/m, N/rad, N m/rad].
    """
    if free.shape[1] == 0:
        return stiffness
    pushed = stiffness @ free
    left = stiffness - pushed @ jnp.linalg.solve(free.T @ pushed, pushed.T)
    return 0.5 * (left + left.T)


def per_mass(root: Matrix, matrix: Matrix) -> Matrix:
    r"""$L^{-1}KL^{-T}$: a symmetric matrix over motions of unit mass.

    **Arguments:**

    - `root`: $L$, lower Cholesky factor of the mass matrix $LL^T$ [kg^0.5, m kg^0.5].
    - `matrix`: $K$, symmetric [N/m, N/rad, N m/rad].

    **Returns:**

    The matrix, symmetric to the last digit [rad2/s2].
    """
    half = jax.scipy.linalg.solve_triangular(root, matrix, lower=True)
    whole = jax.scipy.linalg.solve_triangular(root, half.T, lower=True)
    return 0.5 * (whole + whole.T)


# With A = L^-1 K L^-T, its eigenvectors v and B = L^-1 K_m L^-T the damping is
# 2 xi_s A^(1/2) + 2 (xi_m - xi_s) sum g v v^T, where g = v.B v / omega. The first part is a
# function of a matrix, and smooth. Only the second needs vectors, of modes that the mesh loads.
@jax.custom_jvp
def _composite(
    stiffness: Matrix, mesh: Matrix, mesh_ratio: Scalar, structure_ratio: Scalar
) -> Matrix:
    """Damping over motions of unit mass [rad/s], from stiffnesses over such motions."""
    speed, vectors, loaded = _modal(stiffness, mesh)
    in_mesh = jnp.diagonal(loaded) / speed
    rate = 2.0 * (structure_ratio * (speed - in_mesh) + mesh_ratio * in_mesh)
    return (vectors * rate[None, :]) @ vectors.T


@_composite.defjvp
def _composite_jvp(primals: tuple[Array, ...], tangents: tuple[Array, ...]) -> tuple[Array, Array]:
    stiffness, mesh, mesh_ratio, structure_ratio = primals
    speed, vectors, loaded = _modal(stiffness, mesh)
    stiffness_dot, mesh_dot = (vectors.T @ dot @ vectors for dot in tangents[:2])
    mesh_ratio_dot, structure_ratio_dot = tangents[2:]
    energy = jnp.diagonal(loaded)
    in_mesh = energy / speed
    rate = 2.0 * (structure_ratio * (speed - in_mesh) + mesh_ratio * in_mesh)
    damped = (vectors * rate[None, :]) @ vectors.T

    surplus = mesh_ratio - structure_ratio
    total = speed[:, None] + speed[None, :]
    alone = (energy <= _NOISE * jnp.finfo(energy.dtype).eps * jnp.trace(mesh)) | (surplus == 0.0)
    inverse_gap = _inverse_gap(speed, alone)
    steepness = (in_mesh[:, None] - in_mesh[None, :]) * inverse_gap
    turning = 2.0 * jnp.sum(loaded * inverse_gap * stiffness_dot, axis=1)
    own = jnp.diagonal(stiffness_dot)
    own_dot = (jnp.diagonal(mesh_dot) + turning - 0.5 * energy * own / speed**2) / speed
    in_mesh_dot = steepness * stiffness_dot + jnp.diag(own_dot)
    ratio_dot = structure_ratio_dot * (speed - in_mesh) + mesh_ratio_dot * in_mesh
    damped_dot = 2.0 * (
        structure_ratio * stiffness_dot / total + surplus * in_mesh_dot + jnp.diag(ratio_dot)
    )
    return damped, vectors @ damped_dot @ vectors.T


def _modal(stiffness: Array, mesh: Array) -> tuple[Array, Array, Array]:
    """Natural angular frequencies, modes, and the mesh's stiffness between modes."""
    values, vectors = jnp.linalg.eigh(stiffness)
    return jnp.sqrt(values), vectors, vectors.T @ mesh @ vectors


def _inverse_gap(speed: Array, alone: Array) -> Array:
    """One over the difference of two modes' squared frequencies.

    Zero between two modes that the mesh leaves alone; NaN between modes that cannot be told apart
    though it loads one of them.
    """
    gap = (speed[:, None] - speed[None, :]) * (speed[:, None] + speed[None, :])
    skipped = (alone[:, None] & alone[None, :]) | jnp.eye(speed.size, dtype=bool)
    merged = jnp.abs(gap) <= _NOISE * jnp.finfo(speed.dtype).eps * speed[-1] ** 2
    return jnp.where(skipped, 0.0, jnp.where(merged, jnp.nan, 1.0 / jnp.where(merged, 1.0, gap)))
