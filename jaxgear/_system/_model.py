"""The whole input of an analysis in one value: gears, flanks, supports, load, stiffness."""

import equinox as eqx

from jaxgear._contact._cells import Misalignment
from jaxgear._contact._compliance import AbstractCompliance, WeberBanaschek
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._pair import GearPair
from jaxgear._system._pair_system import Support
from jaxgear._types import Scalar, as_scalar


class PairModel(eqx.Module):
    """Two rigid gears with real flanks, under a torque. Every real number is differentiable.

    **Fields:**

    - `pair`: nominal geometry.
    - `torque`: on the pinion, positive [N m].
    - `flanks`: deviations from the nominal flanks.
    - `compliance`: of one tooth pair.
    - `pinion_support`: springs at the pinion's centre.
    - `wheel_support`: springs at the wheel's centre.
    - `misalignment`: of the two axes.
    """

    pair: GearPair
    torque: Scalar = eqx.field(converter=as_scalar)
    flanks: Flanks = eqx.field(default_factory=Flanks)
    compliance: AbstractCompliance = eqx.field(default_factory=WeberBanaschek)
    pinion_support: Support = eqx.field(default_factory=Support)
    wheel_support: Support = eqx.field(default_factory=Support)
    misalignment: Misalignment = eqx.field(default_factory=Misalignment)
