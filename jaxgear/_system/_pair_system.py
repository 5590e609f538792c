r"""Two rigid gears, turning and, where they are supported, yielding at their centres.

The wheel holds its rotation, the pinion is driven by a torque. Every other motion is
linear elastic, so what the bodies contribute to the mesh is a flexibility of the mesh coordinates.
"""

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._wrench import structure_vectors
from jaxgear._types import (
    CoordinateGrid,
    CoordinateMatrix,
    Coordinates,
    DofCoordinates,
    DofGrid,
    Dofs,
    Scalar,
    as_optional_scalar,
    as_scalar,
)


class Support(eqx.Module):
    """Linear springs at a gear's centre; `None` is a rigid direction.

    **Fields:**

    - `radial_s`: stiffness along S, from pinion to wheel [N/m].
    - `radial_t`: stiffness along T [N/m].
    - `axial`: stiffness along the axis [N/m].
    - `tilt`: stiffness about S and about T [N m/rad].

    **Raises:**

    - `ValueError` unless every stiffness is positive.
    """

    radial_s: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)
    radial_t: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)
    axial: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)
    tilt: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)

    def __check_init__(self):
        for name in ("radial_s", "radial_t", "axial", "tilt"):
            stiffness = getattr(self, name)
            require(
                stiffness is None or stiffness > 0.0,
                "`Support." + name + "` must be positive, got {got}. Use `None` for a rigid one.",
                got=stiffness,
            )

    @property
    def flexibility(self) -> Dofs:
        """Motion per load in S, T, Z and about them, none about Z itself [m/N, rad/(N m)]."""
        order = (self.radial_s, self.radial_t, self.axial, self.tilt, self.tilt, None)
        return jnp.stack([jnp.zeros(()) if k is None else 1.0 / k for k in order])


class PairSystem(eqx.Module):
    r"""A pair of rigid bodies as the mesh sees it.

    **Fields:**

    - `vectors`: approach and tilt per motion of the bodies, from `structure_vectors` [-, 1/m].
    - `flexibility`: motion of each degree of freedom under its own load [m/N, rad/(N m)].
    - `direction`: mesh coordinates per approach by rotation [-].
    - `force`: normal mesh force that balances the torque, $C_1/(r_{b1}\cos\beta_b)$ [N].
    """

    vectors: DofCoordinates
    flexibility: Dofs
    direction: Coordinates
    force: Scalar

    @property
    def mesh_flexibility(self) -> CoordinateMatrix:
        """Mesh coordinates that the bodies give up per mesh load [m/N, 1/N, 1/(N m)]."""
        return self.vectors.T @ (self.flexibility[:, None] * self.vectors)

    def displacement(self, load: CoordinateGrid) -> DofGrid:
        """Motion of the bodies under mesh loads, apart from the driving rotation.

        **Arguments:**

        - `load`: resultant [N] and moment [N m] of the cell forces at each phase.

        **Returns:**

        Motion of each degree of freedom at each phase [m, rad].
        """
        return -(load @ self.vectors.T) * self.flexibility[None, :]


def pair_system(
    pair: GearPair,
    torque: Scalar,
    pinion_support: Support = Support(),
    wheel_support: Support = Support(),
) -> PairSystem:
    """Assemble two rigid gears under a torque.

    **Arguments:**

    - `pair`: the gears.
    - `torque`: on the pinion, positive; reacted at the wheel [N m].
    - `pinion_support`: springs at its centre; by default it only turns.
    - `wheel_support`: springs at its centre; by default it only turns.

    **Returns:**

    The system.

    **Raises:**

    - `ValueError` unless the torque is positive.
    """
    torque = as_scalar(torque)
    require(
        torque > 0.0,
        "The pinion's torque must be positive, got {got:.6g} N m: it drives, and without load no "
        "contact state exists. To load the other flanks, change the sign of the helix angle.",
        got=torque,
    )
    return PairSystem(
        vectors=structure_vectors(pair),
        flexibility=jnp.concatenate([pinion_support.flexibility, wheel_support.flexibility]),
        direction=jnp.asarray([1.0, 0.0]),
        force=torque / (pair.base_radius[0] * jnp.cos(pair.base_helix_angle)),
    )
