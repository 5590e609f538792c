"""The whole input of an analysis in one value: gears, flanks, supports, load, stiffness."""

import equinox as eqx

from jaxgear._contact._cells import Misalignment
from jaxgear._contact._compliance import AbstractCompliance, WeberBanaschek
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._pair import GearPair
from jaxgear._system._flexible import condensed
from jaxgear._system._gear_body import BODIES, AbstractGearBody, check_shaft_within
from jaxgear._system._housing import Housing
from jaxgear._system._mount import AbstractMount
from jaxgear._system._pair_system import PairSystem, pair_system
from jaxgear._system._structure import check_torque, driving_torque
from jaxgear._system._support import Support
from jaxgear._types import Scalar, as_scalar


class PairModel(eqx.Module):
    """Two gears with real flanks, under a torque. Every real number is differentiable.

    **Fields:**

    - `pair`: nominal geometry.
    - `torque`: of the drive on the pinion's shaft, positive [N m].
    - `flanks`: deviations from the nominal flanks.
    - `compliance`: of one tooth pair; foundations of condensed bodies in it are not used.
    - `pinion_support`: the pinion's shaft on bearings, or springs at its centre.
    - `wheel_support`: the same of the wheel.
    - `misalignment`: of the two axes.
    - `pinion_body`: rigid, a beam or condensed; `None` is a rigid disc.
    - `wheel_body`: the same of the wheel.
    - `housing`: behind the bearings; `None` is rigid.
    - `speed`: of the pinion, whose rotation loads condensed bodies in statics [rad/s].

    **Raises:**

    - `ValueError` if the torque on the mesh is not positive, if a shaft is free to move or
        thicker than the gear on it, if a beam body is narrower than its gear, or if a condensed
        body cannot be held by its mount.
    """

    pair: GearPair
    torque: Scalar = eqx.field(converter=as_scalar)
    flanks: Flanks = eqx.field(default_factory=Flanks)
    compliance: AbstractCompliance = eqx.field(default_factory=WeberBanaschek)
    pinion_support: AbstractMount = eqx.field(default_factory=Support)
    wheel_support: AbstractMount = eqx.field(default_factory=Support)
    misalignment: Misalignment = eqx.field(default_factory=Misalignment)
    pinion_body: AbstractGearBody | None = None
    wheel_body: AbstractGearBody | None = None
    housing: Housing | None = None
    speed: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __check_init__(self):
        # Here, and not only where the structure is assembled: that is often traced, and silent.
        check_torque(self.pinion_support, self.torque)
        mounts = (self.pinion_support, self.wheel_support)
        for name, mount in zip(BODIES, mounts, strict=True):
            mount.check_held(name)
        for index, (name, mount) in enumerate(zip(BODIES, mounts, strict=True)):
            body = self.bodies[index]
            if body is None:
                check_shaft_within(name, mount, self.pair, index)
            else:
                body.check(name, mount, self.pair, index)

    @property
    def mesh_torque(self) -> Scalar:
        """Torque on the pinion that the mesh balances, couples on its shaft included [N m]."""
        return driving_torque(self.pinion_support, self.torque)

    @property
    def bodies(self) -> tuple[AbstractGearBody | None, AbstractGearBody | None]:
        """Bodies of pinion and wheel."""
        return self.pinion_body, self.wheel_body

    @property
    def tooth_compliance(self) -> AbstractCompliance:
        """Compliance of one tooth pair without what condensed bodies bring themselves."""
        return self.compliance.without(tuple(index for index, _ in condensed(self.bodies)))

    def system(self, *, speed: Scalar | float | None = None) -> PairSystem:
        """Assemble what carries the gears.

        **Arguments:**

        - `speed`: of the pinion, in place of the model's own [rad/s].

        **Returns:**

        The system.
        """
        return pair_system(
            self.pair,
            self.torque,
            self.pinion_support,
            self.wheel_support,
            pinion_body=self.pinion_body,
            wheel_body=self.wheel_body,
            housing=self.housing,
            speed=self.speed if speed is None else speed,
        )
