"""What a drawing of a shaft consists of: segments, bearings, loads from outside."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._compiled import in_numpy
from jaxgear._types import Scalar, as_reals, as_scalar

if TYPE_CHECKING:
    Vector = Array
else:
    Vector = Float[Array, "direction"]


# A rigid motion counts as free when it is held by less than this, relative to the best held one.
_FREE = 1e-9


class Segment(eqx.Module):
    """A stretch of shaft of one section, a circular tube.

    **Fields:**

    - `length`: [m].
    - `outer`: outer diameter [m].
    - `inner`: inner diameter; zero is solid [m].

    **Raises:**

    - `ValueError` unless the length is positive and the inner diameter below the outer.
    """

    length: Scalar = eqx.field(converter=as_scalar)
    outer: Scalar = eqx.field(converter=as_scalar)
    inner: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __check_init__(self):
        require(
            in_numpy(self.length) > 0.0,
            "`Segment.length` must be positive, got {got:.6g} m. Leave the segment out if the "
            "shaft has none there.",
            got=self.length,
        )
        require(
            in_numpy(self.inner) >= 0.0,
            "`Segment.inner` must not be negative, got {got:.6g} m. Zero is a solid shaft.",
            got=self.inner,
        )
        require(
            in_numpy(self.outer) > in_numpy(self.inner),
            "`Segment.outer` must exceed `Segment.inner`, got {outer:.6g} m outside and "
            "{inner:.6g} m inside. Both are diameters in metres.",
            outer=self.outer,
            inner=self.inner,
        )


class Bearing(eqx.Module):
    """Linear springs between a shaft and its housing, or the ground. Zero is free.

    **Fields:**

    - `at`: height on the shaft [m].
    - `radial_s`: stiffness along S [N/m].
    - `radial_t`: stiffness along T [N/m].
    - `axial`: stiffness along Z [N/m].
    - `tilt_s`: stiffness against rotation about S [N m/rad].
    - `tilt_t`: stiffness against rotation about T [N m/rad].

    **Raises:**

    - `ValueError` if a stiffness is negative.
    """

    at: Scalar = eqx.field(converter=as_scalar)
    radial_s: Scalar = eqx.field(converter=as_scalar, default=0.0)
    radial_t: Scalar = eqx.field(converter=as_scalar, default=0.0)
    axial: Scalar = eqx.field(converter=as_scalar, default=0.0)
    tilt_s: Scalar = eqx.field(converter=as_scalar, default=0.0)
    tilt_t: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __check_init__(self):
        for name in ("radial_s", "radial_t", "axial", "tilt_s", "tilt_t"):
            stiffness = getattr(self, name)
            require(
                in_numpy(stiffness) >= 0.0,
                "`Bearing." + name + "` must not be negative, got {got:.6g}. Zero leaves that "
                "direction free.",
                got=stiffness,
            )

    @property
    def translation(self) -> Vector:
        """Stiffness along S, T, Z [N/m]."""
        return jnp.stack([self.radial_s, self.radial_t, self.axial])

    @property
    def tilt(self) -> Vector:
        """Stiffness against rotation about S and T [N m/rad]."""
        return jnp.stack([self.tilt_s, self.tilt_t])


class ShaftLoad(eqx.Module):
    """A constant load from outside, fixed in direction.

    **Fields:**

    - `at`: height on the shaft [m].
    - `force`: along S, T, Z [N].
    - `moment`: about S, T, Z [N m].

    **Raises:**

    - `ValueError` unless force and moment have three components each.
    """

    at: Scalar = eqx.field(converter=as_scalar)
    force: Vector = eqx.field(converter=as_reals, default=(0.0, 0.0, 0.0))
    moment: Vector = eqx.field(converter=as_reals, default=(0.0, 0.0, 0.0))

    def __check_init__(self):
        for name in ("force", "moment"):
            require(
                getattr(self, name).shape == (3,),
                "`ShaftLoad." + name + "` must have the three components S, T, Z, got an array of "
                "shape {got}.",
                got=getattr(self, name).shape,
            )


def check_bearings(bearings: Sequence[Bearing], length: float, whose: str) -> None:
    """Refuse bearings that leave a shaft free to move, apart from its spin.

    **Arguments:**

    - `bearings`: of the shaft, in plain numbers.
    - `length`: of the shaft [m].
    - `whose`: beginning of the message, "The pinion's shaft is free to ".

    **Raises:**

    - `InputError` if it can move as a rigid body.
    """
    values = [
        [float(x) for x in (b.at, b.radial_s, b.radial_t, b.axial, b.tilt_s, b.tilt_t)]
        for b in bearings
    ]
    at, radial_s, radial_t, axial, tilt_s, tilt_t = np.asarray(values).T
    # Heights from mid-shaft over its length, so that moving and tilting are of one size.
    arm = at / length - 0.5
    planes = [
        _plane_on_bearings(radial_s, arm, tilt_t / length**2),
        _plane_on_bearings(radial_t, -arm, tilt_s / length**2),
    ]
    limit = _FREE * max(axial.sum(), *(np.linalg.eigvalsh(plane)[-1] for plane in planes))
    require(
        bool(axial.sum() > limit),
        whose + "slide along Z. Give one of its bearings an axial stiffness, `axial_N_m`.",
    )
    for plane, along, about in zip(planes, "ST", "TS", strict=True):
        values, modes = np.linalg.eigh(plane)
        free = modes[:, values <= limit]
        require(
            not _moves(free),
            whose + f"move along {along}. Give its bearings a radial stiffness along {along}, "
            f"`radial_{along}_N_m`.",
        )
        require(
            free.size == 0,
            whose + f"tilt about {about}: only one place holds it along {along}. Add a second "
            "bearing elsewhere, or give one a tilt stiffness, `tilt_Nm_rad`.",
        )


def _plane_on_bearings(radial: np.ndarray, arm: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Stiffness against moving along an axis and tilting in its plane."""
    mixed = (radial * arm).sum()
    return np.array([[radial.sum(), mixed], [mixed, (radial * arm**2 + tilt).sum()]])


def _moves(free: np.ndarray) -> bool:
    """Whether the free motions of a plane include one without tilt."""
    return free.shape[1] == 2 or bool(np.any(np.abs(free[1]) < 1e-6))
