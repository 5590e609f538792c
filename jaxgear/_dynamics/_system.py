r"""Bodies, shafts, bearings and a mesh in time: $M\ddot q + (C + \Omega_1 G)\dot q + Kq = F - Vg$.

The motion $q$ is a perturbation about rigid rotation at the speed $\Omega_1$ of the pinion. The
mesh presses with $g(t, m)$ on its few coordinates $m = V^Tq - Bg$. A gear pair turns freely as a
whole: that one rotation is held by a spring and a damper, which loads that balance never stretch.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg

from jaxgear._checks import require
from jaxgear._compiled import lasting_rare
from jaxgear._dynamics._bodies import (
    BodyPlace,
    TurningTerms,
)
from jaxgear._dynamics._damping import per_mass
from jaxgear._dynamics._table import MeshTable, repeated
from jaxgear._dynamics._types import (
    FreeMotions,
    Matrix,
    ModeMatrix,
    ModeValues,
    ModeVectors,
    States,
    StepPlaces,
    Vector,
    Vectors,
)
from jaxgear._solve._cycle import MeshCycle
from jaxgear._types import CoordinateMatrix, Scalar, as_scalar


class DynamicSystem(eqx.Module):
    r"""A linear structure and a mesh in time (theory 8.1).

    **Fields:**

    - `mass`: $M$ [kg, kg m, kg m2].
    - `damping`: $C$ [N s/m, N s, N m s].
    - `stiffness`: $K$ without the mesh; positive definite together with `mean` [N/m, N, N m].
    - `gyroscopic`: $G$, per speed of the pinion, or `None` [kg, kg m, kg m2].
    - `vectors`: $V$, mesh coordinates per motion [-, m].
    - `load`: $F$, constant [N, N m].
    - `bow`: $B$, what bodies give between their nodes per mesh load, or `None`: nothing
        [m/N, 1/N, 1/(N m)].
    - `mean`: mean mesh stiffness on the mesh coordinates, beside condensed bodies with which their
        modes give as much as over the cycle on the mean (theory 8.5) [N/m, N, N m].
    - `table`: the cells over one cycle.
    - `cell_damping`: $\eta$ of closed cells, which press with $k(\Delta + \eta W\dot n)$, $n$ the
        nodes' mesh coordinates, or `None`; not together with `bow` [s].
    - `force`: static mesh force along the normal [N].
    - `transmission`: transmission error per motion [-, m].
    - `rest`: mesh coordinates at vanishing speed, in the middle of each step [m, rad].
    - `free`: motions that only the artificial spring holds, of unit modal mass
        [kg^-1/2, kg^-1/2 m^-1].
    - `teeth`: of the pinion.
    - `back`: whether the back flanks are in the mesh too; the second half of its coordinates is
        then theirs.
    - `turning`: what condensed bodies bring as they turn, or `None`: there are none.
    - `teeth_part`: part of `mean` whose strain is in the teeth, or `None`: all. The rest is what
        condensed bodies give beside the motions that they vibrate by [N/m, N, N m].
    """

    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    gyroscopic: Matrix | None
    vectors: Vectors
    load: Vector
    bow: CoordinateMatrix | None
    mean: CoordinateMatrix
    table: MeshTable
    cell_damping: Scalar | None
    force: Scalar
    transmission: Vector
    rest: StepPlaces
    free: FreeMotions
    teeth: int = eqx.field(static=True)
    back: bool = eqx.field(static=True, default=False)
    turning: TurningTerms | None = None
    teeth_part: CoordinateMatrix | None = None

    @property
    def teeth_stiffness(self) -> Matrix:
        """Mean stiffness of the teeth in it, on all degrees of freedom [N/m, N, N m]."""
        if self.teeth_part is None:
            return self.mesh_stiffness
        return self.vectors @ self.teeth_part @ self.vectors.T

    @property
    def mesh_stiffness(self) -> Matrix:
        """Mean mesh stiffness on all degrees of freedom [N/m, N, N m]."""
        return self.vectors @ self.mean @ self.vectors.T

    @property
    def whole_stiffness(self) -> Matrix:
        """Stiffness of the structure with the mean mesh in it [N/m, N, N m]."""
        return self.stiffness + self.mesh_stiffness

    def stiffness_at(self, speed: Scalar) -> Matrix:
        """Stiffness with the mean mesh in it at a speed of the pinion [N/m, N, N m]."""
        if self.turning is None:
            return self.whole_stiffness
        return self.whole_stiffness + self.turning.stiffness_at(speed)

    def rates_at(self, speed: Scalar) -> Matrix:
        """Damping and gyroscopic forces at a speed of the pinion [N s/m, N s, N m s]."""
        matrix = self.damping
        if self.gyroscopic is not None:
            matrix = matrix + speed * self.gyroscopic
        return matrix

    def load_at(self, speed: Scalar) -> Vector:
        """Constant load at a speed of the pinion [N, N m]."""
        return self.load if self.turning is None else self.load + speed**2 * self.turning.load

    def over(self, cycles: int) -> "DynamicSystem":
        """The same system, its table gone through so many times."""
        return eqx.tree_at(lambda s: s.table, self, repeated(self.table, cycles))

    def mesh_period(self, speed: Scalar) -> Scalar:
        """Duration of one mesh period at a speed of the pinion [rad/s]; in [s]."""
        return 2.0 * jnp.pi / (self.teeth * speed)


class ModalBasis(eqx.Module):
    r"""Natural modes of a system with the mean mesh stiffness, $\Phi^TM\Phi = I$.

    **Fields:**

    - `square`: $\omega^2$ of each mode [rad2/s2].
    - `shape`: $\Phi$ [kg^-1/2, kg^-1/2 m^-1].
    - `damping`: $2\xi\omega$ of each mode [1/s].
    - `mesh`: $\Phi^TV$ [kg^-1/2].
    - `load`: $\Phi^TF$ [N kg^-1/2].
    """

    square: ModeValues
    shape: ModeMatrix
    damping: ModeValues
    mesh: ModeVectors
    load: ModeValues

    @property
    def swing(self) -> States:
        r"""Weights $(\omega, 1)$ that make displacement and velocity comparable [1/s, -]."""
        return jnp.stack([jnp.sqrt(self.square), jnp.ones_like(self.square)])


def modal_basis(system: DynamicSystem) -> ModalBasis:
    """Find all natural modes.

    **Arguments:**

    - `system`: with damping that its modes do not exchange, as of every `AbstractDamping`.

    **Returns:**

    The modes. Where two of one frequency and damping meet, their derivatives do not exist and are
    NaN. Responses by harmonic balance do not pass through them.

    **Raises:**

    - `ValueError` if modes exchange damping; while JAX traces, the damping is NaN instead.
    """
    modes, exchanged = _modal_basis(system)
    require(
        exchanged <= _LEAST_MIXED,
        "The damping matrix exchanges energy between modes: up to {got:.3g} of their own. Build it "
        "with `RayleighDamping` or `ModalDamping`.",
        got=exchanged,
    )
    return modes


@lasting_rare
def _modal_basis(system: DynamicSystem) -> tuple[ModalBasis, Scalar]:
    """The modes, and the largest energy that damping exchanges between two, over their own [-]."""
    lower = jnp.linalg.cholesky(system.mass)
    stiffness = per_mass(lower, system.whole_stiffness)
    damping = per_mass(lower, system.damping)
    # Both have the same vectors, if the modes exchange no damping; where frequencies meet, the
    # damping tells their modes apart.
    total = jnp.trace(damping)
    share = 0.1 * jnp.trace(stiffness) / jnp.where(total > 0.0, total, 1.0)
    _, vectors = jnp.linalg.eigh(stiffness + share * damping)
    shape = jax.scipy.linalg.solve_triangular(lower, vectors, lower=True, trans=1)
    square = jnp.sum(vectors * (stiffness @ vectors), axis=0)
    modal = vectors.T @ damping @ vectors
    diagonal = jnp.diagonal(modal)
    exchanged = jnp.maximum(_mixed(modal), _mixed(vectors.T @ stiffness @ vectors))
    modes = ModalBasis(
        square=square,
        shape=shape,
        # While JAX traces, nobody is told: no number is then better than a wrong one.
        damping=jnp.where(exchanged <= _LEAST_MIXED, diagonal, jnp.nan),
        mesh=shape.T @ system.vectors,
        load=shape.T @ system.load,
    )
    return modes, exchanged


# So much between modes, relative to their own, does no harm. And so much of the largest is
# rounding: the hold of the free rotation may be a million times as fast as all others.
_LEAST_MIXED, _NOISE = 1e-5, 1e-13


def _mixed(matrix: Matrix) -> Scalar:
    """Largest entry off the diagonal, relative to the diagonal entries that it ties together."""
    own = jnp.abs(jnp.diagonal(matrix))
    noise = _NOISE * jnp.sum(own)
    size = jnp.sqrt(own[:, None] * own[None, :]) + noise
    off = jnp.abs(matrix - jnp.diag(jnp.diagonal(matrix))) - noise
    return jnp.max(jnp.maximum(off, 0.0) / jnp.where(size > 0.0, size, 1.0))


class PairDynamics(eqx.Module):
    """A gear pair in time, with the quasi-static cycle that it starts from.

    **Fields:**

    - `system`: what moves.
    - `cycle`: its states at vanishing speed.
    - `dofs`: which degrees of freedom of the structure move; beyond its size, modes of condensed
        bodies.
    - `bodies`: condensed ones, where their seats and modes are.
    - `left_out`: part of the motion of condensed bodies under loads on the flanks that mesh
        coordinates leave out, root of its kinetic energy; statics has all of it [-].
    """

    system: DynamicSystem
    cycle: MeshCycle
    dofs: tuple[int, ...] = eqx.field(static=True)
    bodies: tuple[BodyPlace, ...] = ()
    left_out: Scalar = eqx.field(converter=as_scalar, default=0.0)
