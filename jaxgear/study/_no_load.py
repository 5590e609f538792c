"""A run without load: the transmission error of rigid gears, their kinematic error.

Nothing gives, so bodies, shafts and bearings have no part in it, and what follows from a load has
no meaning: stiffness, pressure, sharing, motion.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr

import jaxgear as jg
from jaxgear._checks import require
from jaxgear._geometry._lines import MeshGrid
from jaxgear._kept_programs import called
from jaxgear._response._transmission import harmonics_of_phases
from jaxgear._types import CellGrid, Harmonics, LinePhases, Phases, as_scalar
from jaxgear._units import mm
from jaxgear.scene._build import couples_on_pinion, misalignment_of, pair_grid
from jaxgear.scene._build_pair import flanks_of, pair_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._tables import MeshKeys
from jaxgear.study._drawing import drawing_summary
from jaxgear.study._head import names_of
from jaxgear.study._pair_dataset import axes_dataset, modification_dataset, pair_dataset
from jaxgear.study._ranks import Idle
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._results import dataset_of, harmonics_resolved, over
from jaxgear.study._statics_summary import geometry_summary


class _Unloaded(NamedTuple):
    """Cells and their gaps, and transmission errors: of all pairs together, and of each alone [m].

    The error of a pair that touches nowhere is infinite.
    """

    cells: jg.MeshCells
    gap: CellGrid
    error: Phases
    alone: LinePhases
    harmonics: Harmonics


def no_load(scene: Scene) -> Result:
    """Transmission error of a scene's rigid gears over a cycle, at torque 0.

    **Arguments:**

    - `scene`: its torque on the pinion is zero.

    **Returns:**

    The dataset of the cycle, groups `pair`, `axes`, `modification`; the summary.

    **Raises:**

    - `ValueError` if the gears are impossible, or couples on the pinion's shaft load the mesh.
    """
    couples = couples_on_pinion(scene.pinion.shaft)
    require(
        couples == 0.0,
        "pair.torque_pinion_Nm is 0, but couples about Z on pinion.shaft.loads, {couples:g} N m, "
        "load the mesh. Give a torque, or take the couples out.",
        couples=couples,
    )
    pair = pair_of(scene)
    flanks = flanks_of(scene, pair)
    # No load says how far beyond the path corners may touch: as far as is looked for at all.
    condensed, others = bool(scene.condensed), scene.map.torques_Nm
    grid = pair_grid(scene.mesh, pair, as_scalar(jnp.inf), others, condensed=condensed)
    found = called(_unloaded, pair, flanks, misalignment_of(scene.pair, 1), grid)
    cycle = _cycle_dataset(pair, found)
    groups = {
        "": cycle,
        "pair": pair_dataset(pair),
        "axes": axes_dataset(pair),
        "modification": modification_dataset({"given": (pair, flanks)}),
    }
    # What only a load makes.
    of_loads = {
        "sweep": scene.sweep.is_given,
        "sizing": scene.sizing.is_given,
        "optimise": scene.optimise.is_given,
        "gauges": bool(scene.gauges),
        "probes": bool(scene.probes),
    }
    summary = {
        **names_of(scene.name, scene.cite),
        "model": {
            "pinion": "rigid",
            "wheel": "rigid",
            "slices": scene.mesh.slices,
            "phases": grid.phases,
        },
        "geometry": geometry_summary(pair) | drawing_summary(scene.gears, pair),
        "static": _numbers(cycle),
        "notes": list(_notes(of_loads, scene.mesh)),
    }
    return Result(scene, summary, {name: titled(it, scene.title) for name, it in groups.items()})


def _unloaded(
    pair: jg.GearPair, flanks: jg.Flanks, misalignment: jg.Misalignment, grid: MeshGrid
) -> _Unloaded:
    # Any stiffness: of it only that a cell may touch is looked at.
    cells = jg.mesh_cells(pair, grid, jg.ConstantStiffness(1.0), as_scalar(1.0))
    gap = jg.mesh_gap(pair, cells.lines, flanks, misalignment)
    error = jg.unloaded_transmission_error(pair, cells, gap)
    touching = jnp.where(cells.stiffness > 0.0, gap, jnp.inf)
    least = jnp.min(touching.reshape(cells.lines.roll.shape), axis=2)
    count = harmonics_resolved(cells.lines)
    return _Unloaded(
        cells=cells,
        gap=gap,
        error=error,
        alone=least / jnp.cos(pair.base_helix_angle),
        harmonics=harmonics_of_phases(cells.lines, error, count),
    )


def _cycle_dataset(pair: jg.GearPair, found: _Unloaded) -> xr.Dataset:
    lines = found.cells.lines
    place = (lines.roll - pair.path_start) / pair.path_of_contact
    alone = np.asarray(found.alone)
    alone = np.where(np.isfinite(alone), alone, np.nan)
    orders = np.arange(1, found.harmonics.size + 1)
    error = "transmission error of rigid gears without load"
    return dataset_of(
        over("phase", unloaded_te_um=(found.error, error))
        | over(
            "harmonic",
            unloaded_te_harmonic_um=(
                found.harmonics,
                f"amplitude of a mesh harmonic of the {error}",
            ),
        )
        | over("phase line", pair_te_um=(alone, f"{error}, of one tooth pair by itself"))
        | over(
            "phase line slice",
            roll_mm=(lines.roll, "roll length from the pinion's base tangent point"),
            profile_position=(place, "place on the path of contact, 0 start to 1 end"),
            fraction=(lines.fraction, "part of the slice that may touch"),
            gap_um=(np.asarray(found.gap).reshape(lines.roll.shape), "gap along the normal"),
        ),
        **over(
            "phase",
            phase=(lines.phase, "position in the cycle, in mesh periods"),
            weight=(lines.weight, "share of the cycle"),
        ),
        **over("phase line", tooth_pair=(lines.tooth, "number of the tooth pair, by entry")),
        **over(
            "slice",
            face_position_mm=(lines.face_position, "position from mid-face along the axes"),
        ),
        **over("harmonic", harmonic=(orders, "order of the mesh frequency")),
    ).assign_attrs(torque_pinion_Nm=0.0, face_width_mm=float(pair.face_width / mm))


def _numbers(cycle: xr.Dataset) -> Summary:
    """The `static` part of the summary: all of it that needs no load."""
    error, weight = cycle["unloaded_te_um"].values, cycle["weight"].values
    mean = float(weight @ error)
    return {
        "te_unloaded_mean_um": mean,
        "te_unloaded_rms_um": float(np.sqrt(weight @ (error - mean) ** 2)),
        "te_unloaded_peak_to_peak_um": float(np.ptp(error)),
    }


def _notes(of_loads: Mapping[str, bool], mesh: MeshKeys) -> Iterator[str]:
    """Remarks, of tables that only a load makes and whether they are given, and of the mesh."""
    yield (
        "pair.torque_pinion_Nm is 0: the gears are rigid and touch at one point. Stiffness, "
        "pressures, bearings and motion need a torque."
    )
    if left := [name for name, given in of_loads.items() if given]:
        yield Idle(f"Without load {', '.join(f'[{name}]' for name in left)} does nothing.")
    if mesh.tip_contact is False:
        yield Idle(
            "Tip corners that touch first, beyond the path, are not looked for: write "
            "mesh.tip_contact = true where reliefs are short and pitch errors large."
        )
