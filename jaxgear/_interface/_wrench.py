r"""How gear bodies and mesh cells see each other: a few numbers, whatever the number of cells.

Axes: S from the pinion's centre to the wheel's, Z along the axes, T = Z x S. The outward normal
of the pinion's flank is $n_1 = \cos\beta_b \hat X - \sin\beta_b Z$ with
$\hat X = \sin\alpha_{wt} S + \cos\alpha_{wt} T$ (theory 7.1, theory 7.2). The approach of two
rigid bodies at a cell is $V_0\cdot X + \lambda\, V_1\cdot X$ with one arm $\lambda$ along the
contact line: the mesh coordinates are the normal approach at the pitch point and the tilt. Bodies
that bend take seven.
"""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._types import CellArmGrid, CellGrid, DofCoordinates, Reals


@compiled
def structure_vectors(pair: GearPair) -> DofCoordinates:
    """Approach and tilt that unit motions of the two bodies produce (thesis eq. 2.9).

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    Columns: approach [m per m or rad] and tilt [rad per m or rad]. Rows: translations S, T, Z and
    rotations about them, of the pinion's centre, then of the wheel's.
    """
    angle, helix = pair.working_pressure_angle, pair.base_helix_angle
    in_plane = jnp.cos(helix) * jnp.stack([jnp.sin(angle), jnp.cos(angle), jnp.zeros(())])
    normal = in_plane - jnp.sin(helix) * jnp.asarray([0.0, 0.0, 1.0])
    # The axis about which rotation only tilts the contact line: Y = Z x X.
    tilt_axis = jnp.stack([-jnp.cos(angle), jnp.sin(angle), jnp.zeros(())])
    towards = jnp.asarray([1.0, 0.0, 0.0])
    pinion_radius, wheel_radius = pair.working_pitch_radius
    none = jnp.zeros(3)
    approach = jnp.concatenate(
        [
            normal,
            jnp.cross(normal, -pinion_radius * towards),
            -normal,
            jnp.cross(-normal, wheel_radius * towards),
        ]
    )
    tilt = jnp.concatenate([none, tilt_axis, none, -tilt_axis])
    return jnp.stack([approach, tilt], axis=1)


def cell_arms(arm: CellGrid) -> CellArmGrid:
    r"""Rows $[1, \lambda]$ that turn mesh coordinates into the approach at each cell.

    **Arguments:**

    - `arm`: $\lambda$ of each cell [m].

    **Returns:**

    Weights of approach [-] and tilt [m] at each cell.
    """
    return jnp.stack([jnp.ones_like(arm), arm], axis=-1)


def beam_arms(pair: GearPair, lines: ContactLines) -> CellArmGrid:
    """Rows $[1, x, x^2, x^3, s, sx, sx^2]$ of `beam_basis` at each cell.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: where the cells are.

    **Returns:**

    Weights of the seven mesh coordinates at each cell [-].
    """
    roll = lines.roll
    basis = beam_basis(pair, lines.face_position[None, None, :], roll)
    stacked = jnp.stack([jnp.broadcast_to(column, roll.shape) for column in basis], axis=-1)
    return stacked.reshape(roll.shape[0], -1, len(basis))


def beam_basis(pair: GearPair, face_position: Reals, roll: Reals) -> list[Reals]:
    """The fields of approach on the base plane that gears on bending bodies can take.

    The axis of a bending body is a cubic across the face and its rotations are parabolas; those act
    on a point of the base plane with an arm that is linear along the path of contact, and only
    where the normal has an axial part.

    **Arguments:**

    - `pair`: the gears.
    - `face_position`: from mid-face [m].
    - `roll`: place on the path of contact, from $T_1$ [m].

    **Returns:**

    $1, x, x^2, x^3, s, sx, sx^2$, with $x$ the place over half the common face width and $s$ that
    from the pitch point over the base pitch [-].
    """
    x = face_position / (0.5 * pair.face_width)
    s = (roll - pair.pitch_point) / pair.transverse_base_pitch
    return [jnp.ones_like(x), x, x**2, x**3, s, s * x, s * x**2]
