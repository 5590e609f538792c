r"""Natural frequencies and modes with the mean mesh stiffness, and where their energy is.

Where two frequencies meet, no mode has a derivative, and no mode of its own either: every mixture
of the two is one. What is said of such modes is therefore said of all that meet together, which
does not depend on the mixture, and they are marked as `crossing`.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._dynamics._bodies import with_modes
from jaxgear._dynamics._damping import per_mass, without_hold
from jaxgear._dynamics._spectrum import meeting, spectrum_of
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._types import FreeMotions, Matrix, ModeMatrix, Speeds
from jaxgear._system._gear_body import BODIES
from jaxgear._system._structure import Structure

if TYPE_CHECKING:
    ModeNumbers = Array
    PartModes = Array
    CriticalSpeeds = Array
    FlagPerMode = Array
    Campbell = np.ndarray
else:
    ModeNumbers = Float[Array, "mode"]
    PartModes = Float[Array, "part mode"]
    CriticalSpeeds = Float[Array, "mode harmonic"]
    FlagPerMode = Bool[Array, "mode"]
    Campbell = Float[np.ndarray, "speed mode"]

# Relative distance of two frequencies below which they count as one.
_MEET = 1e-6

# Share of the largest entry below which a matrix counts as antisymmetric.
_ROUNDING = 1e-9


class Modes(eqx.Module):
    r"""Natural modes by rising frequency, without the motions that nothing holds (theory 8.3).

    Derivatives are those of $\omega^2$: $\varphi^T(dK - \omega^2 dM)\varphi$; where modes meet,
    each is given the mean of these over them. Shares and ratios of modes that meet are those of all
    their energy together, with the derivatives of that. Shapes have derivatives too, but those
    of modes that meet are infinite or NaN.

    **Fields:**

    - `frequency`: [Hz].
    - `shape`: $\varphi$, with $\varphi^TM\varphi = 1$ [1/kg^0.5, 1/(m kg^0.5)].
    - `mesh`: share of the mean mesh stiffness in the strain energy [-].
    - `parts`: shares of the parts of the structure that were named [-].
    - `damping_ratio`: $\varphi^TC\varphi/2\omega$ [-], or `None` if no damping was given.
    - `crossing`: whether the mode meets another.
    - `names`: of the parts.
    """

    frequency: ModeNumbers
    shape: ModeMatrix
    mesh: ModeNumbers
    parts: PartModes
    damping_ratio: ModeNumbers | None
    crossing: FlagPerMode
    names: tuple[str, ...] = eqx.field(static=True)

    def share(self, name: str) -> ModeNumbers:
        """Share of a part in the strain energy of each mode [-].

        **Arguments:**

        - `name`: "mesh", or one of `names`.

        **Raises:**

        - `ValueError` if there is no such part.
        """
        known = ("mesh", *self.names)
        require(
            name in known,
            "The strain energy was split into {known}, got `{name}`.",
            known=", ".join(known),
            name=name,
        )
        return self.mesh if name == "mesh" else self.parts[self.names.index(name)]


def modes(
    mass: Matrix,
    stiffness: Matrix,
    mesh: Matrix,
    free: FreeMotions,
    parts: Sequence[tuple[str, Matrix]] = (),
    damping: Matrix | None = None,
    *,
    meet: float = _MEET,
) -> Modes:
    r"""Find all modes of a system, apart from those that only an artificial spring holds.

    **Arguments:**

    - `mass`: $M$, positive definite [kg, kg m, kg m2].
    - `stiffness`: $\bar K$ with the mean mesh stiffness, and with springs that hold the free
        motions, of whatever stiffness; positive definite [N/m, N, N m].
    - `mesh`: part of the mean mesh stiffness in it [N/m, N, N m].
    - `free`: motions that nothing else holds, as columns of unit modal mass, or no columns
        [1/kg^0.5, 1/(m kg^0.5)].
    - `parts`: names and stiffnesses of parts of the structure [N/m, N, N m].
    - `damping`: $C$, or `None` [N s/m, N s, N m s].
    - `meet`: distance of two frequencies, relative to them, below which they are one [-].

    **Returns:**

    The modes; the shares of the mesh and of all parts of a structure sum to one.

    **Raises:**

    - `ValueError` if `meet` is not between 0 and 0.1.
    """
    return _modes(mass, stiffness, mesh, free, tuple(parts), damping, meet=_checked(meet))


def _checked(meet: float) -> float:
    """A distance of two frequencies that can be one."""
    require(
        0.0 <= meet < 0.1,
        "`meet` must be at least 0 and below 0.1, got {got:.6g}. It is the distance of two "
        "frequencies that count as one, relative to them.",
        got=meet,
    )
    return meet


@compiled
def _modes(
    mass: Matrix,
    stiffness: Matrix,
    mesh: Matrix,
    free: FreeMotions,
    parts: tuple[tuple[str, Matrix], ...],
    damping: Matrix | None,
    *,
    meet: float,
) -> Modes:
    """See `modes`."""
    names = tuple(name for name, _ in parts)
    root = jnp.linalg.cholesky(mass)
    held = per_mass(root, without_hold(stiffness, free))
    # Free motions go above all others, from where they are cut off.
    at_rest = root.T @ free
    above = 2.0 * jnp.sqrt(jnp.sum(held**2))
    given = [held, per_mass(root, mesh), *(per_mass(root, part) for _, part in parts)]
    if damping is not None:
        given.append(per_mass(root, damping))
    count = mass.shape[0] - free.shape[1]
    values, vectors, forms = spectrum_of(
        held + above * (at_rest @ at_rest.T), jnp.stack(given), count, meet
    )
    square = forms[0]
    shares = forms[1 : 2 + len(names)] / square[None, :]
    return Modes(
        frequency=jnp.sqrt(values) / (2.0 * jnp.pi),
        shape=jax.scipy.linalg.solve_triangular(root, vectors, lower=True, trans=1),
        mesh=shares[0],
        parts=shares[1:],
        damping_ratio=None if damping is None else 0.5 * forms[-1] / jnp.sqrt(square),
        crossing=meeting(values, meet),
        names=names,
    )


def pair_modes(dynamics: PairDynamics, *, meet: float = _MEET) -> Modes:
    """Modes of a gear pair, with the shares of both shafts and of their bearings (theory 8.2).

    **Arguments:**

    - `dynamics`: the pair.
    - `meet`: distance of two frequencies, relative to them, below which they are one [-].

    **Returns:**

    The modes; their parts are those of `stiffness_parts`.

    **Raises:**

    - `ValueError` if `meet` is not between 0 and 0.1.
    """
    return _pair_modes(dynamics, meet=_checked(meet))


@compiled
def _pair_modes(dynamics: PairDynamics, *, meet: float) -> Modes:
    """See `pair_modes`."""
    system, parts = dynamics.system, dict(gear_parts(dynamics))
    # Two condensed bodies have half each of what they give beside their modes.
    for body in dynamics.bodies:
        beside = system.mesh_stiffness - system.teeth_stiffness
        parts[f"{BODIES[body.index]} shaft"] += beside / len(dynamics.bodies)
    return _modes(
        system.mass,
        system.whole_stiffness,
        system.teeth_stiffness,
        system.free,
        tuple(parts.items()),
        system.damping,
        meet=meet,
    )


def gear_parts(dynamics: PairDynamics) -> tuple[tuple[str, Matrix], ...]:
    """Split the stiffness of a pair without its mesh, over the degrees of freedom that move.

    **Arguments:**

    - `dynamics`: the pair.

    **Returns:**

    Names and matrices as of `stiffness_parts`; a condensed body is part of its shaft.
    """
    dofs = np.asarray(dynamics.dofs)
    structure = dynamics.cycle.system.structure
    parts = []
    for name, part in stiffness_parts(structure):
        whole = with_modes(part, int(max(dofs)) + 1)
        for body in dynamics.bodies:
            # A condensed body contains its shaft.
            if name == f"{BODIES[body.index]} shaft":
                for own, square in (
                    (body.mode_dofs, body.square),
                    (body.residual_dofs, body.residual),
                ):
                    whole = whole.at[own, own].add(square)
        parts.append((name, whole[dofs[:, None], dofs[None, :]]))
    return tuple(parts)


def stiffness_parts(structure: Structure) -> tuple[tuple[str, Matrix], ...]:
    """Split the stiffness of a structure into its parts, over all its degrees of freedom.

    A beam body belongs to its shaft, springs of a `Support` are bearings, and so is what a housing
    brings. Where it ties the bearings of both shafts to each other, either gear gets the work that
    its own bearings do.

    **Arguments:**

    - `structure`: bodies, shafts, bearings.

    **Returns:**

    Names and matrices: "pinion shaft", "wheel shaft", "pinion bearings", "wheel bearings". They sum
    to the structure's stiffness.
    """
    mapped = structure.map
    first = np.asarray(mapped.bearings, dtype=int)[:, None]
    along = (first + np.arange(3)).ravel()
    about = (first + np.arange(3, 5)).ravel()
    seats = jnp.zeros_like(structure.stiffness)
    seats = seats.at[along[:, None], along[None, :]].add(structure.bearing_stiffness)
    seats = seats.at[about, about].add(structure.bearing_tilt.ravel())
    pinion = np.arange(mapped.size) < mapped.sizes[0]
    shafts, bearings = [], []
    for own in (pinion, ~pinion):
        rows = jnp.asarray(own, dtype=float)
        block = structure.stiffness * (rows[:, None] * rows[None, :])
        if not own[along].any():
            shafts.append(jnp.zeros_like(block))
            bearings.append(block)
            continue
        inside = rows[:, None] * rows[None, :]
        shafts.append((structure.stiffness - seats) * inside)
        bearings.append(0.5 * (rows[:, None] + rows[None, :]) * seats)
    names = ("pinion shaft", "wheel shaft", "pinion bearings", "wheel bearings")
    return tuple(zip(names, (*shafts, *bearings), strict=True))


def critical_speeds(
    frequency: ModeNumbers, teeth: int, harmonics: Sequence[int] = (1,)
) -> CriticalSpeeds:
    r"""Speeds of the pinion at which a mesh harmonic meets a natural frequency.

    $h z_1\Omega_1 = \omega$; gyroscopic effects are not considered (theory 8.8, theory 8.9).

    **Arguments:**

    - `frequency`: natural frequencies [Hz].
    - `teeth`: $z_1$ of the pinion.
    - `harmonics`: orders $h$ of the mesh frequency.

    **Returns:**

    $\Omega_1$ [rad/s].

    **Raises:**

    - `ValueError` unless there are teeth, and harmonics, all of at least order one.
    """
    require(
        teeth >= 1 and len(harmonics) > 0 and min(harmonics) >= 1,
        "Critical speeds need teeth, and harmonics from 1 on, got {teeth} teeth and the harmonics "
        "{harmonics}.",
        teeth=teeth,
        harmonics=tuple(harmonics),
    )
    orders = teeth * np.asarray(harmonics, dtype=float)
    return 2.0 * jnp.pi * frequency[:, None] / orders[None, :]


def rotating_frequencies(
    mass: Matrix,
    stiffness: Matrix,
    gyroscopic: Matrix,
    free: FreeMotions,
    speeds: Speeds,
    softening: Matrix | None = None,
) -> Campbell:
    r"""Natural frequencies of the undamped turning system
    $M\ddot q + \Omega_1 G\dot q + (\bar K + \Omega_1^2S)q$ (theory 8.8).

    Over the modes of its stiffness it is $\dot x = Ax$ with $A$ antisymmetric, so that its
    frequencies are the eigenvalues of a Hermitian matrix: real, and found to the last digit. It
    runs on the host, and has no derivatives. Seen from space: waves of condensed bodies have there
    the frequency on the body plus or minus their number times its speed.

    **Arguments:**

    - `mass`, `stiffness`, `free`: as of `modes`.
    - `gyroscopic`: $G$, antisymmetric, per speed of the pinion; free motions must not feel it
        [kg, kg m, kg m2].
    - `speeds`: $\Omega_1$ of the pinion [rad/s].
    - `softening`: $S$, stiffness per square of the speed, of turning bodies, or `None` [kg].

    **Returns:**

    Frequencies at each speed, rising; NaN where rotation has taken the stiffness away [Hz].

    **Raises:**

    - `ValueError` if the gyroscopic matrix is not antisymmetric.
    """
    whirling = np.asarray(gyroscopic)
    uneven = np.abs(whirling + whirling.T).max()
    largest = np.abs(whirling).max()
    require(
        uneven <= _ROUNDING * largest,
        "A gyroscopic matrix must be antisymmetric, got entries up to {largest:.3g} that miss "
        "their mirror image by {uneven:.3g}.",
        largest=largest,
        uneven=uneven,
    )
    count = mass.shape[0] - free.shape[1]
    found = np.full((np.asarray(speeds).size, count), np.nan)
    at_rest = None
    for i, speed in enumerate(np.asarray(speeds)):
        if at_rest is None or softening is not None:
            added = 0.0 if softening is None else speed**2 * softening
            at_rest = _modes_at_rest(mass, stiffness + added, free)
        angular = 2.0 * np.pi * np.asarray(at_rest.frequency)
        if not np.isfinite(angular).all():
            continue
        shape = np.asarray(at_rest.shape)
        whirl = shape.T @ whirling @ shape
        flow = np.zeros((2 * count, 2 * count))
        flow[:count, count:] = np.diag(angular)
        flow[count:, :count] = -np.diag(angular)
        flow[count:, count:] = -0.5 * speed * (whirl - whirl.T)
        # They come in pairs of either sign.
        found[i] = np.linalg.eigvalsh(1j * flow)[count:]
    return found / (2.0 * np.pi)


@jax.jit
def _modes_at_rest(mass: Matrix, stiffness: Matrix, free: FreeMotions) -> Modes:
    return modes(mass, stiffness, jnp.zeros_like(stiffness), free)
