"""How the flanks slide along the path of contact, as columns with units."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._sliding import sliding_speed, specific_sliding
from jaxgear._kept_programs import called
from jaxgear._types import as_scalar
from jaxgear._units import mm
from jaxgear.plot._tables import Columns

_POINTS = 101


def sliding_columns(pair: GearPair) -> Columns:
    """The data of `sliding`, a row for each place on the path of contact."""
    return {name: np.asarray(values) for name, values in called(_slid, pair).items()}


def _slid(pair: GearPair) -> dict[str, Array]:
    roll = jnp.linspace(pair.path_start, pair.path_end, _POINTS)
    slides, specific = sliding_speed(pair, roll, as_scalar(1.0)), specific_sliding(pair, roll)
    rolls = jnp.stack([roll, pair.tangent_length - roll])
    diameter = 2.0 * jnp.hypot(pair.base_radius[:, None], rolls)
    return {
        "roll_mm": roll / mm,
        "diameter_pinion_mm": diameter[0] / mm,
        "diameter_wheel_mm": diameter[1] / mm,
        "specific_sliding_pinion": specific[0],
        "specific_sliding_wheel": specific[1],
        "sliding_over_pitch_line_speed": slides / pair.working_pitch_radius[0],
        "sliding_speed_per_pinion_speed_mm": slides / mm,
    }
