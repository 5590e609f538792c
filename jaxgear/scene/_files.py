"""Measured flanks: CSV files with a header whose names carry the units.

A profile is a table of one coordinate, `roll_length_mm`, `diameter_mm` or `roll_angle_deg`, and
`deviation_um`; a topography has `face_mm`, from mid-face towards +Z, as well. Roll lengths and
angles are counted from the gear's own base tangent point; deviations are along the flank normal,
positive where material is added (a value measured in the transverse plane is cos(beta_b) times
as large along the normal). Lines that begin with `#` are comments. Whatever is wrong with a file
is an `InputError` that names the file and, where there is one, the line.
"""

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxgear._checks import InputError
from jaxgear._flank._deviations import AbstractFlankDeviation
from jaxgear._flank._measured import (
    MeasuredProfile,
    MeasuredTopography,
    diameter_of_profile_place,
    face_place_of_position,
    profile_place_of_diameter,
    profile_place_of_roll,
    profile_place_of_roll_angle,
    roll_angle_of_profile_place,
    roll_of_profile_place,
)
from jaxgear._geometry._pair import GearPair, pair_facts
from jaxgear._types import Reals
from jaxgear._units import deg, mm, um
from jaxgear.scene._csv import Cells, read_cells

_DEVIATION = "deviation_um"
_FACE = "face_mm"

# Each coordinate: its unit, the way to the place on the profile, and the way back.
_COORDINATES = {
    "roll_length_mm": (mm, profile_place_of_roll, roll_of_profile_place),
    "diameter_mm": (mm, profile_place_of_diameter, diameter_of_profile_place),
    "roll_angle_deg": (deg, profile_place_of_roll_angle, roll_angle_of_profile_place),
}

_COLUMNS = (*_COORDINATES, _FACE, _DEVIATION)

# What a column may be in by mistake, and by how much it must be multiplied to be right.
_SLIPS = {
    "roll_length_mm": {"metres": 1e3, "micrometres": 1e-3, "inches": 25.4},
    "diameter_mm": {"metres": 1e3, "radii": 2.0, "micrometres": 1e-3, "inches": 25.4},
    "roll_angle_deg": {"radians": 1.0 / deg},
}

# Measured flanks differ from an involute by 1 um to 200 um: a millimetre would be no gear, and a
# tenth of a micrometre is below what a machine resolves, but common in millimetres.
_LARGEST = 1000.0
_SMALLEST = 0.1

# How much of the path, or of the face, a table may leave out at either end.
_SHORT = 0.01

# How far past the tip a table may go, as a diameter over the tip diameter.
_PAST_TIP = 1.2


@dataclasses.dataclass(frozen=True)
class FlankTable:
    """A measured profile, or a topography on its rectangular grid, as its file gives it.

    **Fields:**

    - `path`: the file.
    - `coordinate`: name of its column of positions along the profile, unit included.
    - `position`: of each point, or of each row of the grid, increasing [in that unit].
    - `deviation`: at each point, or at each row and column [um].
    - `face`: of each column of the grid, from mid-face, increasing; `None` of a profile [mm].
    """

    path: Path
    coordinate: str
    position: np.ndarray
    deviation: np.ndarray
    face: np.ndarray | None = None


def read_profile(path: str | os.PathLike[str], folder: str | os.PathLike[str] = "") -> FlankTable:
    """Read a measured profile.

    **Raises:**

    - `InputError` if the file cannot be read, or its table cannot be a profile.
    """
    path = Path(folder) / path
    cells = read_cells(path, _COLUMNS, (_DEVIATION,))
    coordinate = _coordinate_of(path, cells)
    if _FACE in cells.names:
        raise InputError(
            f"{path}:{cells.header}: a profile has no column {_FACE}. Give the file as a "
            "topography, or remove the column and keep the points of one section."
        )
    if len(cells.lines) < 3:
        raise InputError(
            f"{path}: a profile needs at least 3 points between start of active profile and tip, "
            f"got {len(cells.lines)}."
        )
    position, deviation = cells.column(coordinate), cells.column(_DEVIATION)
    _check_order(path, cells.lines, coordinate, position)
    _check_size(path, deviation)
    return FlankTable(path, coordinate, position, deviation)


def read_topography(
    path: str | os.PathLike[str], folder: str | os.PathLike[str] = ""
) -> FlankTable:
    """Read a measured topography: a line for each point of a rectangular grid.

    Each line carries both positions of its point, so lines may stand in any order; but each point
    of the grid must be there, and only once.

    **Raises:**

    - `InputError` if the file cannot be read, or its table cannot be a topography.
    """
    path = Path(folder) / path
    cells = read_cells(path, _COLUMNS, (_FACE, _DEVIATION))
    coordinate = _coordinate_of(path, cells)
    rows, face, values = (cells.column(name) for name in (coordinate, _FACE, _DEVIATION))
    position, across = np.unique(rows), np.unique(face)
    for name, found in ((coordinate, position), (_FACE, across)):
        if len(found) < 2:
            raise InputError(
                f"{path}: a topography needs at least 4 points, 2 or more along the profile and 2 "
                f"or more across the face; got {len(found)} different {name}. A single section is "
                "a profile: give it as one."
            )
    grid = np.full((len(position), len(across)), np.nan)
    line_of = np.zeros(grid.shape, dtype=int)
    for line, row, z, value in zip(cells.lines, rows, face, values, strict=True):
        at = np.searchsorted(position, row), np.searchsorted(across, z)
        if line_of[at]:
            raise InputError(
                f"{path}:{line}: the point {coordinate} = {row:g}, {_FACE} = {z:g} was given in "
                f"line {line_of[at]} already. Keep one of the two lines."
            )
        line_of[at], grid[at] = line, value
    missing = np.argwhere(line_of == 0)
    if len(missing):
        row, column = missing[0]
        raise InputError(
            f"{path}: the topography must be a full grid: {len(position)} values of {coordinate} "
            f"times {len(across)} of {_FACE} make {grid.size} points, got {len(values)}. The first "
            f"one missing is {coordinate} = {position[row]:g}, {_FACE} = {across[column]:g}. Add "
            "the missing points; where they are there, their coordinates must be written alike."
        )
    _check_size(path, values)
    return FlankTable(path, coordinate, position, grid, across)


def deviation_of_table(
    table: FlankTable, pair: GearPair, gear_index: int
) -> AbstractFlankDeviation:
    """Turn a table into a deviation of one gear's flank. The pair may be traced by JAX."""
    unit, place_of, _ = _COORDINATES[table.coordinate]
    place = place_of(pair, gear_index, jnp.asarray(table.position * unit))
    deviation = table.deviation * um
    if table.face is None:
        return MeasuredProfile(place, deviation)
    face = face_place_of_position(pair, gear_index, jnp.asarray(table.face * mm))
    return MeasuredTopography(place, face, deviation)


def check_covers(table: FlankTable, pair: GearPair, gear_index: int) -> None:
    """Refuse a table that is not of this gear, or leaves out part of its active flank.

    Says nothing about a pair that JAX is tracing.

    **Raises:**

    - `InputError` if positions cannot be on an involute of this gear, which finds wrong units, or
        if more than 1 % of the path of contact, or of the common face, is left out at one end.
    """
    limits = _limits(pair, gear_index)
    if any(isinstance(leaf, Tracer) for leaf in limits.values()):
        return
    # Adding zero turns a negative one round.
    bound = {name: np.asarray(leaf) + 0.0 for name, leaf in limits.items()}
    name = ("pinion", "wheel")[gear_index]
    _check_position(table, bound, name)
    most = 0.1 * float(pair.normal_module) / um
    if (largest := float(np.max(np.abs(table.deviation)))) > most:
        raise InputError(
            f"{table.path}: {_DEVIATION} reaches {largest:g}, more than a tenth of the module, "
            f"{most:g} um: it looks like nanometres. Convert it."
        )
    _check_reach(
        table.path,
        table.coordinate,
        table.position,
        bound[f"{table.coordinate}_active"],
        f"of the {name}'s active flank, from its start of active profile to its tip",
    )
    if table.face is not None:
        where = "of the common face of the two gears, counted from mid-face"
        _check_reach(table.path, _FACE, table.face, bound[f"{_FACE}_active"], where)


def _coordinate_of(path: Path, cells: Cells) -> str:
    """The one column that says where a point lies along the profile."""
    found = [name for name in cells.names if name in _COORDINATES]
    if len(found) != 1:
        raise InputError(
            f"{path}:{cells.header}: exactly one of the columns {', '.join(_COORDINATES)} must say "
            f"where a point lies along the profile, got {' and '.join(found) or 'none'}."
        )
    return found[0]


def _check_order(path: Path, lines: Sequence[int], name: str, position: np.ndarray) -> None:
    """Positions of a profile must increase: a row out of order is more often a typing error."""
    steps = np.diff(position)
    if (steps < 0.0).all():
        raise InputError(
            f"{path}: {name} must increase from line to line; here it decreases all the way. "
            "Reverse the lines."
        )
    for index in np.flatnonzero(steps <= 0.0)[:1]:
        before, after = position[index : index + 2]
        remedy = (
            f"was given in line {lines[index]} already. Keep one of the two lines."
            if before == after
            else f"comes after {before:g} in line {lines[index]}. Positions must increase: correct "
            "the number, or sort the lines."
        )
        raise InputError(f"{path}:{lines[index + 1]}: {name} = {after:g} {remedy}")


def _check_size(path: Path, deviation: np.ndarray) -> None:
    """Deviations that no gear has are in another unit."""
    spread, largest = float(np.ptp(deviation)), float(np.max(np.abs(deviation)))
    if spread > _LARGEST:
        raise InputError(
            f"{path}: {_DEVIATION} must be in micrometres, but its values span {spread:g}, more "
            f"than {_LARGEST:g}: they look like nanometres, or like positions. Convert them."
        )
    if 0.0 < largest < _SMALLEST:
        raise InputError(
            f"{path}: {_DEVIATION} must be in micrometres, but no value exceeds {largest:g} (less "
            f"than {_SMALLEST:g}): they look like millimetres. Multiply them by 1000."
        )


@eqx.filter_jit
def _limits(pair: GearPair, gear_index: int) -> dict[str, Reals]:
    """Positions in the units of the columns: the ends of the involute that a table may be on.

    Under `_active` the ends of what is in contact, first and last, and between them how far from
    each a table may begin or end.
    """
    facts = pair_facts(pair)
    base = facts.base_radius[gear_index]
    past = jnp.sqrt((_PAST_TIP * facts.tip_radius[gear_index]) ** 2 - base**2)
    involute = profile_place_of_roll(pair, gear_index, past * jnp.asarray([0.0, 1.0]))
    active = jnp.asarray([0.0, _SHORT, 1.0 - _SHORT, 1.0])
    found = {f"{_FACE}_active": facts.face_width * (active - 0.5) / mm}
    for name, (unit, _, position_of) in _COORDINATES.items():
        # Rounded, because what is zero at the base circle comes back as a last digit.
        found[name] = jnp.round(position_of(pair, gear_index, involute) / unit, 9)
        found[f"{name}_active"] = position_of(pair, gear_index, active) / unit
    return found


def _check_position(table: FlankTable, bound: dict[str, np.ndarray], name: str) -> None:
    """Refuse positions off the involute, and ones whose unit puts them off the active flank."""
    least, most = bound[table.coordinate]
    active = bound[f"{table.coordinate}_active"]
    middle = 0.5 * (active[0] + active[-1])

    def fits(factor: float) -> tuple[bool, bool]:
        """Whether all lies on the involute, and whether the middle of the active flank is in it."""
        first, last = factor * table.position[0], factor * table.position[-1]
        inside = first >= least - 1e-9 * most and last <= most
        return bool(inside), bool(first <= middle <= last)

    slips = [x for x, factor in _SLIPS[table.coordinate].items() if all(fits(factor))]
    on_involute, has_middle = fits(1.0)
    # On the involute but not on the active flank: what is missing says it better.
    if on_involute and (has_middle or not slips):
        return
    hint = (
        f"they look like {slips[0]}. Convert them." if slips else "is this the file of this gear?"
    )
    raise InputError(
        f"{table.path}: {table.coordinate} of the {name} must lie between {least:.6g}, its "
        f"base circle, and {most:.6g}, {_PAST_TIP:g} times its tip diameter, and its active flank "
        f"is {active[0]:.6g} to {active[-1]:.6g}; got {table.position[0]:.6g} to "
        f"{table.position[-1]:.6g}: {hint}"
    )


def _check_reach(
    path: Path, name: str, position: np.ndarray, active: np.ndarray, where: str
) -> None:
    """A table must reach both ends of what is in contact; nothing is invented beyond it."""
    first, begin, end, last = active
    missing = []
    if position[0] > begin:
        missing.append(f"{first:.6g} to {min(position[0], last):.6g}")
    if position[-1] < end:
        missing.append(f"{max(position[-1], first):.6g} to {last:.6g}")
    if missing:
        raise InputError(
            f"{path}: {name} must cover {first:.6g} to {last:.6g}, the whole {where}, within "
            f"{100.0 * _SHORT:g} %. Missing: {' and '.join(missing)}. Add points there."
        )
