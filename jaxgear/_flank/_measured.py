r"""Flanks as tables: what a measuring machine, or another program, says about them.

A table is piecewise linear between its points, so it meets each of them, never overshoots, and
a point acts only between its neighbours; it has corners at its points, as a linear relief has.
Beyond its ends it stays at its last value. Positions and deviations are both differentiable.

A table in roll length or diameter becomes one in `profile` (see `_deviations`) through the
pair, since the path of contact, and with it the unit of `profile`, depends on both gears. Roll
lengths are counted from the base tangent point of the gear that carries the table.
"""

from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from jaxgear._checks import require
from jaxgear._flank._deviations import AbstractFlankDeviation
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Reals, Scalar, as_reals

if TYPE_CHECKING:
    ProfilePoints = Array
    FacePoints = Array
    PointGrid = Array
    Indices = Array
else:
    ProfilePoints = Float[Array, "profile_point"]
    FacePoints = Float[Array, "face_point"]
    PointGrid = Float[Array, "profile_point face_point"]
    Indices = Int[Array, "..."]


class MeasuredProfile(AbstractFlankDeviation):
    """A tabulated deviation along the profile, the same across the face.

    **Fields:**

    - `place`: of each point, as `profile` [-]; increasing.
    - `deviation`: at each point [m], positive where material is added.

    **Raises:**

    - `ValueError` if there are fewer than two points, or they are not increasing numbers.
    """

    place: ProfilePoints = eqx.field(converter=as_reals)
    deviation: ProfilePoints = eqx.field(converter=as_reals)

    def __check_init__(self):
        _check_points(self.place, "MeasuredProfile.place")
        _check_deviations(self.deviation, self.place.shape, "MeasuredProfile.deviation")

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del face
        i, along = _located(self.place, profile)
        return _between(self.deviation[i], self.deviation[i + 1], along)


class MeasuredTopography(AbstractFlankDeviation):
    """A deviation tabulated on a rectangular grid over the flank, bilinear between its points.

    **Fields:**

    - `place`: of each row, as `profile` [-]; increasing.
    - `face`: of each column, as `face` [-]; increasing.
    - `deviation`: at each row and column [m], positive where material is added.

    **Raises:**

    - `ValueError` if a direction has fewer than two points, or they are not increasing numbers.
    """

    place: ProfilePoints = eqx.field(converter=as_reals)
    face: FacePoints = eqx.field(converter=as_reals)
    deviation: PointGrid = eqx.field(converter=as_reals)

    def __check_init__(self):
        _check_points(self.place, "MeasuredTopography.place")
        _check_points(self.face, "MeasuredTopography.face")
        shape = self.place.shape + self.face.shape
        _check_deviations(self.deviation, shape, "MeasuredTopography.deviation")

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        i, along = _located(self.place, profile)
        j, across = _located(self.face, face)
        left = _between(self.deviation[i, j], self.deviation[i + 1, j], along)
        right = _between(self.deviation[i, j + 1], self.deviation[i + 1, j + 1], along)
        return _between(left, right, across)


def _located(points: Array, at: Reals) -> tuple[Indices, Reals]:
    """Index of the point before each place, and how far it is to the next one, within 0..1."""
    after = jnp.searchsorted(points, at, side="right")
    i = jnp.clip(after - 1, 0, points.size - 2)
    return i, jnp.clip((at - points[i]) / (points[i + 1] - points[i]), 0.0, 1.0)


def _between(first: Reals, second: Reals, share: Reals) -> Reals:
    return first + share * (second - first)


def _check_points(points: Array, name: str) -> None:
    require(
        points.ndim == 1 and points.size >= 2,
        "`" + name + "` must list at least two points, got an array of shape {got}.",
        got=points.shape,
    )
    if isinstance(points, Tracer):
        return
    steps = np.diff(np.asarray(points))
    require(
        bool(np.isfinite(points).all() and (steps > 0.0).all()),
        "`" + name + "` must increase from point to point, without NaN, got {got}. Sort the "
        "points, and keep one of each place.",
        got=np.asarray(points),
    )


def _check_deviations(deviation: Array, shape: tuple[int, ...], name: str) -> None:
    require(
        deviation.shape == shape,
        "`" + name + "` must have one value for each point, an array of shape {shape}, got {got}.",
        shape=shape,
        got=deviation.shape,
    )
    require(
        isinstance(deviation, Tracer) or bool(np.isfinite(deviation).all()),
        "`" + name + "` holds values that are not finite numbers. Remove those points.",
    )


# --- where a position lies on the flank


def _rolls(pair: GearPair, gear_index: int) -> tuple[Scalar, Scalar]:
    """Roll lengths of one gear at its start of active profile and at its tip [m]."""
    require(
        gear_index in (0, 1), "A gear is 0, the pinion, or 1, the wheel, got {got}.", got=gear_index
    )
    tips = pair.tip_roll
    return pair.tangent_length - tips[1 - gear_index], tips[gear_index]


@eqx.filter_jit
def profile_place_of_roll(pair: GearPair, gear_index: int, roll_length: Reals) -> Reals:
    r"""Where a roll length lies between start of active profile and tip.

    **Arguments:**

    - `pair`: the gears.
    - `gear_index`: 0 is the pinion, 1 the wheel.
    - `roll_length`: $\sqrt{r^2 - r_b^2}$ from the gear's own base tangent point [m].

    **Returns:**

    `profile` of the flank deviations [-].

    **Raises:**

    - `ValueError` if there is no such gear.
    """
    start, tip = _rolls(pair, gear_index)
    return (roll_length - start) / (tip - start)


@eqx.filter_jit
def profile_place_of_roll_angle(pair: GearPair, gear_index: int, roll_angle: Reals) -> Reals:
    """As `profile_place_of_roll`, of a roll angle: roll length over base radius [rad]."""
    return profile_place_of_roll(pair, gear_index, roll_angle * pair.base_radius[gear_index])


@eqx.filter_jit
def profile_place_of_diameter(pair: GearPair, gear_index: int, diameter: Reals) -> Reals:
    """As `profile_place_of_roll`, of a diameter [m]; NaN below the base circle."""
    base = pair.base_radius[gear_index]
    return profile_place_of_roll(pair, gear_index, jnp.sqrt((0.5 * diameter) ** 2 - base**2))


@eqx.filter_jit
def roll_of_profile_place(pair: GearPair, gear_index: int, place: Reals) -> Reals:
    """The roll length at a place: the inverse of `profile_place_of_roll` [m]."""
    start, tip = _rolls(pair, gear_index)
    return start + place * (tip - start)


@eqx.filter_jit
def roll_angle_of_profile_place(pair: GearPair, gear_index: int, place: Reals) -> Reals:
    """The roll angle at a place: the inverse of `profile_place_of_roll_angle` [rad]."""
    return roll_of_profile_place(pair, gear_index, place) / pair.base_radius[gear_index]


@eqx.filter_jit
def diameter_of_profile_place(pair: GearPair, gear_index: int, place: Reals) -> Reals:
    """The diameter at a place: the inverse of `profile_place_of_diameter` [m]."""
    roll = roll_of_profile_place(pair, gear_index, place)
    return 2.0 * jnp.sqrt(pair.base_radius[gear_index] ** 2 + roll**2)


@eqx.filter_jit
def face_place_of_position(pair: GearPair, gear_index: int, position: Reals) -> Reals:
    """Where a distance from mid-face lies on the face of one gear.

    **Arguments:**

    - `pair`: the gears.
    - `gear_index`: 0 is the pinion, 1 the wheel.
    - `position`: along +Z from mid-face [m].

    **Returns:**

    `face` of the flank deviations [-].
    """
    return position / (0.5 * pair.of_bodies("face_width")[gear_index])
