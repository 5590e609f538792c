r"""What holds and damps a structure whose bodies turn freely about Z.

Damping of rigid bodies and beams is that of the modes of the whole, its mean mesh included. A
condensed body brings modes without end: the mesh's motion then is spread over ever more of them,
and what of its damping modes keep to themselves falls with their number. There structure and mesh
damp apart: the structure by its own modes without a mesh, the mesh by a damper in its teeth
(Kahraman & Singh 1990, $c = 2\xi\sqrt{km}$), so that no damping hangs on how many modes are kept.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxgear._dynamics._damping import AbstractDamping, alone_rates, damping_matrix
from jaxgear._dynamics._types import FreeMotions, Matrix, Vector, Vectors
from jaxgear._dynamics._waves import WaveGroup, hub_of
from jaxgear._types import CoordinateMatrix, Scalar


class Bare(NamedTuple):
    """A structure and its mean mesh, which nothing keeps from turning as a whole.

    **Fields:**

    - `mass`, `stiffness`: without the mesh.
    - `vectors`: mesh coordinates per motion [-, m].
    - `mean`: mean mesh stiffness on them [N/m, N, N m].
    - `rotations`: of either body alone, as columns; nothing but the mesh holds their difference.
    """

    mass: Matrix
    stiffness: Matrix
    vectors: Vectors
    mean: CoordinateMatrix
    rotations: FreeMotions

    @property
    def meshed(self) -> Matrix:
        """Mean mesh stiffness on all motions [N/m, N, N m]."""
        return self.vectors @ self.mean @ self.vectors.T

    @property
    def momentum(self) -> Vector:
        """Of the free rotation of unit modal mass."""
        free = self.free
        return self.mass @ free

    @property
    def free(self) -> Vector:
        """The free rotation of the whole, of unit modal mass."""
        both = jnp.sum(self.rotations, axis=1)
        return both / jnp.sqrt(both @ self.mass @ both)


class Held(NamedTuple):
    """A structure whose free rotation is held by a spring and a damper of no meaning.

    **Fields:**

    - `stiffness`, `damping`: of all motions.
    - `free`: the rotation, of unit modal mass, as a column.
    """

    stiffness: Matrix
    damping: Matrix
    free: FreeMotions


def mesh_damper(
    damping: AbstractDamping, bare: Bare, teeth: CoordinateMatrix, approach: Scalar
) -> CoordinateMatrix:
    """Damper in the mesh of a structure with condensed bodies.

    **Arguments:**

    - `damping`: of the structure.
    - `bare`: the structure; its first mesh coordinate is the approach of the gears.
    - `teeth`: part of the mean mesh stiffness whose energy is in the teeth [N/m, N, N m].
    - `approach`: mean force per approach [N/m].

    **Returns:**

    Mesh load per rate of its coordinates [N s/m, N s, N m s].
    """
    moved = bare.vectors[:, 0] @ bare.rotations
    inertia = jnp.sum(bare.rotations * (bare.mass @ bare.rotations), axis=0)
    frequency = jnp.sqrt(approach * jnp.sum(moved**2 / inertia))
    return damping.of_mesh(bare.mean, teeth, frequency)


def hold(bare: Bare, damping: AbstractDamping) -> Held:
    """Hold the free rotation of rigid bodies and beams, and damp the modes of the whole."""
    # The artificial spring is faster than any mode, so that it meets none: the trace is the sum of
    # all squared frequencies, of which there may be one.
    square = 4.0 * jnp.trace(jnp.linalg.solve(bare.mass, bare.stiffness + bare.meshed))
    held = jnp.outer(bare.momentum, bare.momentum)
    stiffness, free = bare.stiffness + square * held, bare.free[:, None]
    # A damper beside it, so that what rounding excites dies out.
    matrix = damping_matrix(damping, bare.mass, stiffness + bare.meshed, bare.meshed, free)
    return Held(stiffness, matrix + jnp.sqrt(square) * held, free)


def hold_apart(
    bare: Bare, damping: AbstractDamping, damper: CoordinateMatrix, groups: Sequence[WaveGroup]
) -> Held:
    """Hold the free rotation of a structure with condensed bodies, and damp it without its mesh.

    **Arguments:**

    - `bare`: the structure.
    - `damping`: of the structure without its mesh.
    - `damper`: in the mesh, on its coordinates.
    - `groups`: motions of its bodies by wave number; those that no seat ties to are modes.

    **Returns:**

    The structure, its damping with the damper in the mesh.
    """
    size = len(bare.mass)
    near = hub_of([group for group in groups if not group.joined], size)
    far = np.setdiff1d(np.arange(size), near)
    at = (near[:, None], near)
    mass, own = bare.mass[at], bare.stiffness[at]
    alone = jnp.diagonal(bare.stiffness)[far]
    meshed = bare.meshed
    square = 4.0 * (
        jnp.trace(jnp.linalg.solve(mass, own + meshed[at]))
        + jnp.sum(alone + jnp.diagonal(meshed)[far])
    )
    # Without the mesh each body turns freely.
    turns = bare.rotations[near]
    turns = turns / jnp.sqrt(jnp.sum(turns * (mass @ turns), axis=0))[None, :]
    moved = mass @ turns
    structure = damping_matrix(
        damping, mass, own + square * (moved @ moved.T), jnp.zeros_like(mass), turns
    )
    held = jnp.outer(bare.momentum, bare.momentum)
    # Of both rotations, what is not the free one: the gears against each other.
    structure = structure + damping.loose * (moved @ moved.T - held[at])
    rates = jnp.zeros((size, size)).at[at].set(structure)
    rates = rates.at[far, far].set(alone_rates(damping, alone))
    in_mesh = bare.vectors @ damper @ bare.vectors.T
    return Held(
        bare.stiffness + square * held,
        rates + in_mesh + jnp.sqrt(square) * held,
        bare.free[:, None],
    )
