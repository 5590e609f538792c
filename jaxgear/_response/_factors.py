r"""How unevenly a mesh is loaded, and what growing gears do to its pressure angle.

The factors are those of ISO 6336-1, taken from calculated loads at vanishing speed. They judge;
an optimiser is better served by the smooth ones, since a maximum has kinks.
"""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._geometry._pair import GearPair
from jaxgear._smooth import smooth_maximum
from jaxgear._solve._cycle import MeshCycle
from jaxgear._types import Bodies, LinePhases, Scalar, Slices


@compiled
def face_load(pair: GearPair, cycle: MeshCycle) -> Slices:
    """Load per face width at each slice: its mean over the cycle, all contact lines together.

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.

    **Returns:**

    Normal load per axial width [N/m]; over the face it integrates to the mean mesh force.
    """
    force = _slice_force(cycle)
    return force * force.size / pair.face_width


@compiled
def face_load_factor(cycle: MeshCycle) -> Scalar:
    r"""$K_{H\beta}$ of ISO 6336-1: largest over mean load per face width, of `face_load`.

    The slices at the ends of the face count (theory 11.2).

    **Arguments:**

    - `cycle`: the settled states.

    **Returns:**

    The factor [-], 1 where the load is even across the face.
    """
    return jnp.max(_face_ratio(cycle))


@compiled
def smooth_face_load_factor(cycle: MeshCycle, width: Scalar) -> Scalar:
    """Differentiable `face_load_factor`; too large by `width log(slices)` at the most.

    **Arguments:**

    - `cycle`: the settled states.
    - `width`: of the smoothing, relative to the mean load [-].

    **Returns:**

    The factor [-].
    """
    return smooth_maximum(_face_ratio(cycle), width)


@compiled
def transverse_load_factor(pair: GearPair, cycle: MeshCycle) -> Scalar:
    r"""$K_{H\alpha}$: how unevenly the tooth pairs in contact share the load (theory 11.2).

    The largest over phases and pairs of a pair's mean line load, its force over its length on the
    path of contact, in units of the force of all over the length of all. It is 1 where pairs share
    by their lengths, so in single contact; a pair that relief keeps out of touch has its length all
    the same. Slices whose middle is beyond the path count nowhere.

    ISO 6336-1 compares with gears without deviations, so that their own uneven sharing is not
    counted; it is here. Where a helical pair enters or leaves, it touches at one end of the face:
    a load that is uneven across the face raises this factor too.

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.

    **Returns:**

    The factor [-].
    """
    return jnp.max(_sharing_ratio(pair, cycle))


@compiled
def smooth_transverse_load_factor(pair: GearPair, cycle: MeshCycle, width: Scalar) -> Scalar:
    """Differentiable `transverse_load_factor`; too large by `width log(phases lines)` at the most.

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.
    - `width`: of the smoothing, relative to an even line load [-].

    **Returns:**

    The factor [-].
    """
    return smooth_maximum(_sharing_ratio(pair, cycle), width)


@compiled
def pressure_angle_change(pair: GearPair, base_radius_change: Bodies) -> Bodies:
    r"""Change of the pressure angle at each gear's reference circle, which keeps its radius.

    From $\cos\alpha_t = r_b/r$ (the thesis's eq. 3.3): $-\cot\alpha_t\,\Delta r_b/r_b$ to the
    leading order (theory 11.4).

    **Arguments:**

    - `pair`: the gears before they grow.
    - `base_radius_change`: growth of each base radius, as by centrifugal load [m].

    **Returns:**

    Change of the transverse pressure angle of pinion and wheel [rad].
    """
    cosine = (pair.base_radius + base_radius_change) / pair.reference_radius
    return jnp.arccos(cosine) - pair.transverse_pressure_angle


@compiled
def working_pressure_angle_change(pair: GearPair, base_radius_change: Bodies) -> Scalar:
    r"""Change of the working pressure angle at a fixed centre distance (theory 11.4).

    From $\cos\alpha_{wt} = (r_{b1} + r_{b2})/a_w$. Where a gear grows as a whole, this is the
    angle that changes: its reference circle grows with its base circle.

    **Arguments:**

    - `pair`: the gears before they grow.
    - `base_radius_change`: growth of each base radius, as by centrifugal load [m].

    **Returns:**

    Change of the working pressure angle [rad].
    """
    cosine = jnp.sum(pair.base_radius + base_radius_change) / pair.working_centre_distance
    return jnp.arccos(cosine) - pair.working_pressure_angle


def _slice_force(cycle: MeshCycle) -> Slices:
    """Mean force on each slice over the cycle, all contact lines together [N]."""
    lines = cycle.cells.lines
    force = cycle.force.reshape(lines.roll.shape)
    return jnp.sum(lines.weight[:, None, None] * force, axis=(0, 1))


def _face_ratio(cycle: MeshCycle) -> Slices:
    """Load per face width at each slice over its mean across the face [-]."""
    force = _slice_force(cycle)
    return force / jnp.mean(force)


def _sharing_ratio(pair: GearPair, cycle: MeshCycle) -> LinePhases:
    """Mean line load of each tooth pair over that of all at its phase [-]; 0 beyond the path."""
    lines = cycle.cells.lines
    on_path = (lines.roll >= pair.path_start) & (lines.roll <= pair.path_end)
    force = cycle.force.reshape(lines.roll.shape)
    # Slices are equally long, so they measure the length in contact.
    length = jnp.sum(jnp.where(on_path, lines.fraction, 0.0), axis=2)
    force_share = _shares(jnp.sum(jnp.where(on_path, force, 0.0), axis=2))
    touches = length > 0.0
    return jnp.where(touches, force_share / jnp.where(touches, _shares(length), 1.0), 0.0)


def _shares(values: LinePhases) -> LinePhases:
    """Share of each line in the sum of all at its phase [-]; none where the sum is zero."""
    total = jnp.sum(values, axis=1, keepdims=True)
    return values / jnp.where(total > 0.0, total, 1.0)
