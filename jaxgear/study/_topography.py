"""Flanks of a scene as grids, as software of grinding machines and gear checkers takes them."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxgear._flank._deviations import Flanks
from jaxgear._flank._measured import diameter_of_profile_place, roll_of_profile_place
from jaxgear._geometry._pair import GearPair
from jaxgear._units import mm, um
from jaxgear.scene._schema import GEARS

_PROFILE, _FACE = 41, 25


class Topography(NamedTuple):
    """One flank's deviation from the involute helicoid on a grid; all teeth have the same.

    **Fields:**

    - `roll_length_mm`: of each row, from the base tangent point, from start of active profile to
        tip.
    - `diameter_mm`: of each row.
    - `face_mm`: of each column, from mid-face towards +Z.
    - `deviation_um`: along the flank normal, positive where material is added.
    """

    roll_length_mm: np.ndarray
    diameter_mm: np.ndarray
    face_mm: np.ndarray
    deviation_um: np.ndarray


def flank_topography(pair: GearPair, flanks: Flanks, gear: str) -> Topography:
    """The flank of a gear, modifications, measured deviations and tolerance grade together.

    **Arguments:**

    - `pair`: the gears.
    - `flanks`: their deviations.
    - `gear`: "pinion" or "wheel".
    """
    index, deviation = GEARS.index(gear), getattr(flanks, gear)
    profile, face = jnp.linspace(0.0, 1.0, _PROFILE), jnp.linspace(-1.0, 1.0, _FACE)
    grid = jnp.meshgrid(profile, face, indexing="ij")
    half = 0.5 * getattr(pair, gear).face_width / mm
    return Topography(
        np.asarray(roll_of_profile_place(pair, index, profile)) / mm,
        np.asarray(diameter_of_profile_place(pair, index, profile)) / mm,
        half * np.asarray(face),
        np.asarray(deviation(*grid)) / um,
    )


def topography_rows(found: Topography) -> str:
    """A flank as CSV, a line for each point, as `flank.GEAR.topography_csv` reads it.

    **Arguments:**

    - `found`: the flank.
    """
    head = (
        "# Deviation along the flank normal, positive where material is added; face_mm from\n"
        "# mid-face towards +Z; roll_length_mm from the base tangent point, sqrt(r^2 - r_b^2).\n"
    )
    points = (
        f"{roll:.10g},{face:.10g},{value:.10g}\n"
        for roll, row in zip(found.roll_length_mm, found.deviation_um, strict=True)
        for face, value in zip(found.face_mm, row, strict=True)
    )
    return f"{head}roll_length_mm,face_mm,deviation_um\n{''.join(points)}"


def topography_grid(found: Topography) -> str:
    """A flank as a CSV matrix: a row for each diameter, a column for each place across the face.

    **Arguments:**

    - `found`: the flank.
    """
    names = [f"deviation_um_at_face_{face:.6g}_mm" for face in found.face_mm]
    lines = [",".join(["roll_length_mm", "diameter_mm", *names])]
    rows = np.c_[found.roll_length_mm, found.diameter_mm, found.deviation_um]
    lines += [",".join(f"{value:.10g}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"
