"""Springs that hold a gear at its centre: the simplest of mounts."""

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import InputError, require
from jaxgear._compiled import in_numpy
from jaxgear._system._beam import Beam
from jaxgear._system._mount import AbstractMount, BodyPiece, MountedNodes, MountMatrices, NodeDofs
from jaxgear._system._shaft_parts import Bearing, ShaftLoad
from jaxgear._types import Scalar, as_optional_scalar


class Support(AbstractMount):
    """Linear springs at a gear's centre; `None` is a rigid direction.

    **Fields:**

    - `radial_s`: stiffness along S, from pinion to wheel [N/m].
    - `radial_t`: stiffness along T [N/m].
    - `axial`: stiffness along the axis [N/m].
    - `tilt`: stiffness about S and about T [N m/rad].
    - `bearings`, `loads`: none, which only a shaft has.

    **Raises:**

    - `ValueError` unless every stiffness is positive.
    """

    radial_s: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)
    radial_t: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)
    axial: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)
    tilt: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)
    bearings: tuple[Bearing, ...] = eqx.field(init=False, default=())
    loads: tuple[ShaftLoad, ...] = eqx.field(init=False, default=())

    def __check_init__(self):
        for name in ("radial_s", "radial_t", "axial", "tilt"):
            stiffness = getattr(self, name)
            require(
                stiffness is None or in_numpy(stiffness) > 0.0,
                "`Support." + name + "` must be positive, got {got}. Use `None` for a rigid one.",
                got=stiffness,
            )

    @property
    def _directions(self) -> tuple[Scalar | None, ...]:
        return self.radial_s, self.radial_t, self.axial, self.tilt, self.tilt

    @property
    def nodes(self) -> MountedNodes:
        rigid = tuple(k for k, spring in enumerate(self._directions) if spring is None)
        node = (0,)
        return MountedNodes((("gear", 0), ("torque", 0)), 1, node, node, node, rigid=rigid)

    @property
    def length(self) -> Scalar:
        return jnp.zeros(())

    @property
    def bearing_heights(self) -> tuple:
        return ()

    @property
    def load_heights(self) -> tuple:
        return ()

    @property
    def diameter_at_gear(self) -> Scalar:
        return jnp.zeros(())

    @property
    def springs(self) -> NodeDofs:
        # A rigid direction has no spring: it is not among the free degrees of freedom.
        springs = (jnp.zeros(()) if each is None else each for each in (*self._directions, None))
        return jnp.stack(list(springs))

    def matrices(self, piece: BodyPiece | None = None) -> MountMatrices:
        none = jnp.zeros((6, 6))
        return MountMatrices(jnp.diag(self.springs), none, none)

    def body_beam(self, piece: BodyPiece) -> Beam:
        raise InputError("A body that is a beam must be part of a shaft, not held by springs.")

    def check_held(self, name: str) -> None:
        pass
