r"""What holds a gear: a shaft on bearings, or springs at its centre.

Whatever the mount, a gear body finds there nodes of six degrees of freedom, and the matrices
between them.
"""

import abc
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._geometry._gear import Material
from jaxgear._system._beam import Beam
from jaxgear._system._shaft_parts import Bearing, ShaftLoad
from jaxgear._types import Scalar, as_scalar

if TYPE_CHECKING:
    NodeDofs = Array
    MountMatrix = Array
else:
    NodeDofs = Float[Array, "6"]
    MountMatrix = Float[Array, "mount_dof mount_dof"]


class BodyPiece(NamedTuple):
    """The piece of shaft that a beam body is.

    **Fields:**

    - `width`: face width [m].
    - `outer`: diameter [m].
    - `material`: of the body.
    """

    width: Scalar
    outer: Scalar
    material: Material


class MountMatrices(eqx.Module):
    r"""A mount, or a body on it: $M\ddot q + \Omega G\dot q + Kq$, six degrees of freedom per node.

    **Fields:**

    - `stiffness`: $K$ [N/m, N/rad, N m/rad].
    - `mass`: $M$ [kg, kg m, kg m2].
    - `gyroscopic`: $G$, per spin speed about +Z [kg, kg m, kg m2].
    """

    stiffness: MountMatrix
    mass: MountMatrix
    gyroscopic: MountMatrix


class MountedNodes(NamedTuple):
    """Which node of a mounted body is what, by numbers from left to right.

    `places` names nodes, `count` is how many there are. `gear` are those whose rotation is the
    gear's, `loaded` those that its teeth load, `torque` those where its torque acts in equal parts,
    `bearings` that of each bearing. In the directions `rigid` the first node cannot move. `offsets`
    are how far each load of the mount is above its node, zero where there are none [m].
    """

    places: tuple[tuple[str, int], ...]
    count: int
    gear: tuple[int, ...]
    loaded: tuple[int, ...]
    torque: tuple[int, ...]
    bearings: tuple[int, ...] = ()
    rigid: tuple[int, ...] = ()
    offsets: tuple[Scalar, ...] = ()


class AbstractMount(eqx.Module):
    """A shaft on bearings, or the springs at a gear's centre.

    **Fields:**

    - `bearings`: of the shaft; springs at the centre have none.
    - `loads`: constant loads from outside on the shaft.
    """

    bearings: eqx.AbstractVar[tuple[Bearing, ...]]
    loads: eqx.AbstractVar[tuple[ShaftLoad, ...]]

    @property
    def couple(self) -> Scalar:
        """Sum of the couples about Z that come from outside [N m]."""
        if not self.loads:
            return as_scalar(0.0)
        return jnp.sum(jnp.stack([load.moment[2] for load in self.loads]))

    @property
    @abc.abstractmethod
    def nodes(self) -> MountedNodes:
        """Nodes of the mount, with a gear on it that is not condensed."""

    @property
    @abc.abstractmethod
    def length(self) -> Scalar:
        """Of the shaft, from end to end; zero without one [m]."""

    @property
    @abc.abstractmethod
    def bearing_heights(self) -> tuple[Scalar, ...]:
        """Height of each bearing from the gear's mid-face [m]."""

    @property
    @abc.abstractmethod
    def load_heights(self) -> tuple[Scalar, ...]:
        """Height of each load from the gear's mid-face [m]."""

    @property
    @abc.abstractmethod
    def diameter_at_gear(self) -> Scalar:
        """Outer diameter of the shaft under the gear's middle; zero without one [m]."""

    @property
    @abc.abstractmethod
    def springs(self) -> NodeDofs:
        """Stiffness of springs at the gear's centre, along and about S, T, Z [N/m, N m/rad]."""

    @abc.abstractmethod
    def matrices(self, piece: BodyPiece | None = None) -> MountMatrices:
        """Matrices of the mount without bearings.

        **Arguments:**

        - `piece`: of shaft that its gear's body is, if it is a beam.

        **Returns:**

        The matrices, nodes from left to right.
        """

    @abc.abstractmethod
    def body_beam(self, piece: BodyPiece) -> Beam:
        """A beam body as an element of the shaft.

        **Arguments:**

        - `piece`: of shaft that the body is.

        **Returns:**

        The beam between the two nodes of the gear: as long as the face is wide [m], of the body's
        material, with the shaft's hole and, if it has one, its shear coefficient.
        """

    @abc.abstractmethod
    def check_held(self, name: str) -> None:
        """Refuse a mount that is free to move, apart from its spin. Traced numbers are let through.

        **Arguments:**

        - `name`: whose it is, "pinion" or "wheel", for the message.

        **Raises:**

        - `InputError` if it can move as a rigid body.
        """
