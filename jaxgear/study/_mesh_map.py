"""The mesh as a map: force over phase and approach, for programs that simulate whole drives.

Supports, bodies and teeth are in it, as in the mesh cycle; what moves at a simulated approach is
the relative turning of the two gears alone. Between phases and approaches it is to be interpolated.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import PchipInterpolator

from jaxgear._response._transmission import transmission_error
from jaxgear._solve._cycle import mesh_cycle
from jaxgear.scene._scene import Scene
from jaxgear.study._built import built_scene
from jaxgear.study._statics import require_solved

# Loads that are solved, over that of the scene: so dense that cubics between them are within 0.1 %.
_LIGHTEST, _HEAVIEST, _LOADS = 1e-3, 2.0, 33
# Approaches of the map.
_POINTS = 101


class MeshMap(NamedTuple):
    """Force of a mesh over phase and approach.

    **Fields:**

    - `phase`: in mesh periods, from 0 to `mesh.periods`, both in it [-].
    - `approach`: $r_{b1}\\theta_1 + r_{b2}\\theta_2$, transverse, positive where the pinion runs
        ahead [m].
    - `force`: along the transverse line of action, at each phase and approach [N].
    - `base_radius`: of both gears [m]; times it the force is the torque on a gear.
    """

    phase: np.ndarray
    approach: np.ndarray
    force: np.ndarray
    base_radius: np.ndarray


def mesh_map(scene: Scene) -> MeshMap:
    """Map the force of a scene's mesh, from where no flanks touch to twice its torque.

    Drive flanks alone: where they part the force is zero, whatever is behind.

    **Arguments:**

    - `scene`: checked against the schema.

    **Raises:**

    - `SolverFailure` if the contact was not solved at some load.
    - `ValueError` if the gears are impossible.
    """
    built = built_scene(scene)
    model, grid, law = built.model, built.grid, built.law
    loads = np.geomspace(_LIGHTEST, _HEAVIEST, _LOADS)
    torque, approach = float(model.torque), []
    for load in loads:
        loaded = eqx.tree_at(lambda it: it.torque, model, jnp.asarray(torque * load))
        cycle = mesh_cycle(loaded, grid, law=law, throw=False)
        require_solved(cycle.converged)
        approach.append(np.asarray(transmission_error(model.pair, cycle)))
    force = loads * float(model.mesh_torque) / float(model.pair.base_radius[0])
    # Shape [load, phase], the load that touches nothing before all others.
    solved = np.stack(approach)
    first = solved[0] - (solved[1] - solved[0]) * force[0] / (force[1] - force[0])
    solved, force = np.vstack([first, solved]), np.append(0.0, force)
    # At stiffer phases the heaviest load is below the last approach: the flank goes straight on.
    furthest = 1.05 * float(solved[-1].max())
    slope = (force[-1] - force[-2]) / (solved[-1] - solved[-2])
    solved = np.vstack([solved, np.full_like(first, furthest)])
    places = np.linspace(float(first.min()), furthest, _POINTS)
    values = []
    for own, steep in zip(solved.T, slope, strict=True):
        carried = np.append(force, force[-1] + steep * (furthest - own[-2]))
        found = PchipInterpolator(own, carried, extrapolate=True)(places)
        values.append(np.where(places > own[0], found, 0.0))
    phases = np.asarray(cycle.cells.lines.phase)
    # A cycle ends where it begins.
    ends = np.append(phases, phases[0] + grid.periods)
    radii = np.asarray(model.pair.base_radius)
    return MeshMap(ends, places, np.stack([*values, values[0]]), radii)


def modelica_table(name: str, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> str:
    """A table in the text format of Modelica's `CombiTable2Ds` and `CombiTable2Dv`.

    Its first row holds `columns` (input u2), its first column `rows` (input u1).

    **Arguments:**

    - `name`: `tableName` in Modelica.
    - `rows`, `columns`: where the values are, increasing.
    - `values`: of each row and column.
    """
    table = np.block([[np.zeros((1, 1)), columns[None]], [np.c_[rows], values]])
    lines = (" ".join(f"{value:.12g}" for value in row) for row in table)
    head = f"#1\ndouble {name}({table.shape[0]},{table.shape[1]})"
    return "\n".join([head, *lines]) + "\n"
