r"""Mesh cells: pieces of contact lines, with the stiffness and the gap of each.

All directions are normal to the flank. A cell's gap is the material removed there by both
gears, counted from the nominal involutes: one reference for the whole cycle, so it adds no
inertia later and no maximum whose ties would split a gradient at zero relief.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._contact._compliance import AbstractCompliance
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._lines import ContactLines, MeshGrid, contact_lines
from jaxgear._geometry._pair import GearPair
from jaxgear._types import CellGrid, LineGrid, Reals, Scalar, as_scalar


class Misalignment(eqx.Module):
    """How far the wheel's axis is out of parallel, over the common face width.

    As gear standards do, each transverse slice of the wheel is shifted in its own plane; the axial
    motion that a tilt gives a helical tooth is left out.

    **Fields:**

    - `inclination`: shift towards +S (away from the pinion) of the wheel at the right end of the
        face relative to the left one, in the plane of the axes [m].
    - `deviation`: the same towards +T, square to that plane [m].
    """

    inclination: Scalar = eqx.field(converter=as_scalar, default=0.0)
    deviation: Scalar = eqx.field(converter=as_scalar, default=0.0)


class MeshCells(eqx.Module):
    r"""The cells of one mesh period: what does not depend on flank corrections.

    **Fields:**

    - `lines`: where the cells are.
    - `line_stiffness`: $k'$ of one tooth pair per length of contact line, at each slice [N/m2].
    - `stiffness`: of each cell, its active fraction included [N/m].
    - `arm`: $\lambda$, place of each cell along its contact line, from the foot of the pitch
        point at mid-face [m].
    """

    lines: ContactLines
    line_stiffness: LineGrid
    stiffness: CellGrid
    arm: CellGrid


def nominal_line_load(pair: GearPair, torque: Scalar) -> Scalar:
    r"""Mean load per length of one contact line, $F_n\cos\beta_b/b$ [N/m].

    **Arguments:**

    - `pair`: the gears.
    - `torque`: on the pinion [N m].

    **Returns:**

    The line load at which secant stiffnesses are taken [N/m].
    """
    return torque / pair.base_radius[0] / pair.face_width


def mesh_cells(
    pair: GearPair, grid: MeshGrid, compliance: AbstractCompliance, line_load: Scalar
) -> MeshCells:
    r"""Divide the contact lines of one mesh period into cells.

    **Arguments:**

    - `pair`: the gears.
    - `grid`: phases, lines and slices.
    - `compliance`: of one tooth pair.
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    Position and stiffness of each cell, $k = k'\,\Delta l$ times its active fraction.
    """
    lines = contact_lines(pair, grid)
    line_stiffness = _along_path(pair, compliance, line_load, lines.roll)
    stiffness = line_stiffness * lines.fraction * lines.length
    helix = pair.base_helix_angle
    across = lines.face_position[None, None, :] * jnp.cos(helix)
    arm = across + (lines.roll - pair.pitch_point) * jnp.sin(helix)
    return MeshCells(
        lines=lines,
        line_stiffness=line_stiffness,
        stiffness=stiffness.reshape(grid.phases, grid.cells),
        arm=arm.reshape(grid.phases, grid.cells),
    )


def mesh_gap(
    pair: GearPair, lines: ContactLines, flanks: Flanks, misalignment: Misalignment
) -> CellGrid:
    """Gap of each cell when the nominal flanks would just touch everywhere.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: where the cells are.
    - `flanks`: deviations of both gears.
    - `misalignment`: of the two axes.

    **Returns:**

    Gap along the normal, positive where material is missing [m].
    """
    pinion, wheel = flank_coordinates(pair, lines)
    added = flanks.pinion(*pinion) + flanks.wheel(*wheel)
    angle = pair.working_pressure_angle
    apart = misalignment.inclination * jnp.sin(angle) + misalignment.deviation * jnp.cos(angle)
    apart *= jnp.cos(pair.base_helix_angle) / pair.face_width
    gap = apart * lines.face_position[None, None, :] - added
    return gap.reshape(lines.phase.size, -1)


def flank_coordinates(
    pair: GearPair, lines: ContactLines
) -> tuple[tuple[LineGrid, LineGrid], tuple[LineGrid, LineGrid]]:
    """Where each cell lies on the two flanks, in the coordinates of flank deviations.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: where the cells are.

    **Returns:**

    `profile` and `face` on the pinion, then on the wheel [-].
    """
    place = (lines.roll - pair.path_start) / pair.path_of_contact
    z = jnp.broadcast_to(lines.face_position[None, None, :], place.shape)
    pinion = place, z / (0.5 * pair.pinion.face_width)
    return pinion, (1.0 - place, z / (0.5 * pair.wheel.face_width))


# Degree of the polynomial through the stiffness along the path. Where a load begins to cross
# the tooth below its root chord the stiffness has a kink, within 3e-4 of which it stays;
# elsewhere it is met to 1e-5.
_DEGREE = 32


def _along_path(
    pair: GearPair, compliance: AbstractCompliance, line_load: Scalar, roll: Reals
) -> Reals:
    """Stiffness at many positions, from a Chebyshev interpolant over the path of contact."""
    nodes = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    middle = 0.5 * (pair.path_start + pair.path_end)
    half = 0.5 * pair.path_of_contact
    values = 1.0 / compliance(pair, middle + half * jnp.asarray(nodes), line_load)
    transform = np.cos(np.outer(np.arange(_DEGREE + 1), np.arccos(nodes))) * 2.0 / (_DEGREE + 1)
    transform[0] *= 0.5
    coefficients = jnp.asarray(transform) @ values
    # The middle of a cell that is only partly in contact may lie beyond the end of the path.
    x = jnp.clip((roll - middle) / half, -1.0, 1.0)

    def clenshaw(carry: tuple[Reals, Reals], coefficient: Scalar):
        last, before = carry
        return (2.0 * x * last - before + coefficient, last), None

    zero = jnp.zeros_like(x)
    (last, before), _ = jax.lax.scan(clenshaw, (zero, zero), coefficients[:0:-1])
    return x * last - before + coefficients[0]
