"""Springs that hold a gear at its centre: the simplest of mounts."""

import equinox as eqx

from jaxgear._checks import require
from jaxgear._compiled import in_numpy
from jaxgear._types import Scalar, as_optional_scalar


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
                stiffness is None or in_numpy(stiffness) > 0.0,
                "`Support." + name + "` must be positive, got {got}. Use `None` for a rigid one.",
                got=stiffness,
            )
