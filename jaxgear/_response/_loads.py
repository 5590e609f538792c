"""Stiffness, loads and pressures on the contact lines.

Line load and pressure belong to slices whose middle lies on the path of contact; a slice that
is less than half in contact carries force, but has no place on the flank. Beyond the path, where
tip corners may touch, the pressure is that of the corner's rounding where its radius is known, else
that of the cylinders at the end of the path.
"""

import jax
import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._contact._coupling import share_with_body
from jaxgear._contact._hertz import at_known_corner, corner_contact
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._solve._cycle import MeshCycle
from jaxgear._types import LineGrid, LinePhases, Phases, Scalar


@compiled
def mesh_stiffness(cycle: MeshCycle) -> Phases:
    """Force per approach of the cells in contact at each phase [N/m], along the normal.

    Sum of their stiffnesses or, where bodies couple them, the stiffness of all together; of
    condensed bodies with their seats held.
    """
    closed = jnp.where(cycle.overlap > 0.0, cycle.cells.stiffness, 0.0)
    if cycle.cells.coupling is None:
        return jnp.sum(closed, axis=1)
    shared = jax.vmap(share_with_body)(cycle.cells.coupling, closed, closed[:, :, None])
    return jnp.sum(shared, axis=(1, 2))


@compiled
def line_load(cycle: MeshCycle, law: AbstractContactLaw) -> LineGrid:
    """Load per length of contact line at each slice.

    **Arguments:**

    - `cycle`: the settled states.
    - `law`: with which they were found.

    **Returns:**

    Line load [N/m].
    """
    lines = cycle.cells.lines
    compression = law.compression(cycle.overlap).reshape(lines.roll.shape)
    return jnp.where(lines.fraction >= 0.5, cycle.cells.line_stiffness * compression, 0.0)


@compiled
def hertz_pressure(pair: GearPair, cycle: MeshCycle, law: AbstractContactLaw) -> LineGrid:
    """Largest Hertzian pressure across the contact band at each slice (theory 3.7, theory 3.14).

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.
    - `law`: with which they were found.

    **Returns:**

    Pressure [Pa].
    """
    return corner_contact(pair, cycle.cells.lines.roll).pressure(line_load(cycle, law))


# Share of the face beside an end of the path that `pressure_off_ends` leaves out.
_BESIDE_ENDS = 0.1


@compiled
def pressure_off_ends(pair: GearPair, cycle: MeshCycle, law: AbstractContactLaw) -> Scalar:
    """Largest pressure but where helical teeth come into contact or leave it.

    There a tooth bears on a corner of the line, and of slices that feel each other the load grows
    without bound as they get finer, unless relief takes it off. Left out are cells that are less
    than a tenth of the face from an end of the path, none of spur teeth.

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.
    - `law`: with which they were found.

    **Returns:**

    The pressure [Pa].
    """
    lead = _BESIDE_ENDS * pair.face_width * jnp.abs(jnp.tan(pair.base_helix_angle))
    beside = lambda end: jnp.abs(cycle.cells.lines.roll - end) < lead
    at_ends = beside(pair.path_start) | beside(pair.path_end)
    return jnp.max(jnp.where(at_ends, 0.0, hertz_pressure(pair, cycle, law)))


@compiled
def corner_pressure(pair: GearPair, cycle: MeshCycle, law: AbstractContactLaw) -> LineGrid:
    """Pressure of tip corners whose radius is known, beyond the path (theory 3.14).

    **Arguments:**

    - `pair`: the gears.
    - `cycle`: the settled states.
    - `law`: with which they were found.

    **Returns:**

    Pressure; zero where no such corner touches [Pa].
    """
    known = at_known_corner(pair, cycle.cells.lines.roll)
    return jnp.where(known, hertz_pressure(pair, cycle, law), 0.0)


@compiled
def load_sharing(cycle: MeshCycle) -> LinePhases:
    """Share of the mesh force on each contact line at each phase [-]; sums to 1."""
    force = cycle.force.reshape(cycle.cells.lines.roll.shape)
    per_line = jnp.sum(force, axis=2)
    return per_line / jnp.sum(per_line, axis=1, keepdims=True)
