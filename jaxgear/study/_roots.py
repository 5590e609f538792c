"""What a run says of the roots of the teeth: their stresses over a mesh cycle, and what they bear.

Beside the calculated stresses stand the nominal ones of ISO 6336-3, without factors of load.
"""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from jaxgear._contact._root_influence import Influences
from jaxgear._response._iso_root import NominalRootStress, nominal_root_stress
from jaxgear._response._root_stress import (
    RootStress,
    root_stress,
    slice_load,
)
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._model import PairModel
from jaxgear._units import MPa, mm
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._schema import GEARS
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry, dataset_of
from jaxgear.study._statics import Statics


class _Found(NamedTuple):
    """Stresses of a cycle, and along the fillets where those of each gear are largest."""

    stress: RootStress
    fillets: Array


@eqx.filter_jit
def _stresses(model: PairModel, cycle: MeshCycle, influences: Influences) -> _Found:
    pair, lines, load = model.pair, cycle.cells.lines, slice_load(cycle)
    stress = root_stress(pair, influences, lines, load)
    fillets = []
    for gear, influence in enumerate(influences):
        every = influence.along_fillets(pair, lines, load, gear)
        own = stress.drive[..., gear].ravel()
        fillets.append(every.reshape(own.size, 2, -1)[jnp.argmax(own)])
    return _Found(stress, jnp.stack(fillets))


def roots_dataset(model: PairModel, cycle: MeshCycle, influences: Influences) -> xr.Dataset:
    """The group `roots`.

    **Arguments:**

    - `model`: that was solved.
    - `cycle`: its settled states.
    - `influences`: of loads on the roots of its teeth.

    **Returns:**

    Stresses over phase, line, slice and gear; along the fillets and on the tooth's outline where
    they are largest.
    """
    found, lines = _stresses(model, cycle, influences), cycle.cells.lines
    over = ("phase", "line", "slice", "gear")
    along = ("gear", "fillet", "point")
    points = np.stack([np.asarray(each.point) for each in influences])
    outlines = np.stack([np.asarray(each.flank) for each in influences])
    cells = {
        "root_stress_MPa": (found.stress.drive / MPa, "MPa", "largest tensile stress of a root"),
        "root_compression_MPa": (
            found.stress.coast / MPa,
            "MPa",
            "largest compressive stress of a root, on the fillet behind the loaded flank's tooth",
        ),
        "root_place_mm": (
            found.stress.height / mm,
            "mm",
            "height of the largest tensile stress above the root circle",
        ),
    }
    variables = {name: Entry(over, *each) for name, each in cells.items()}
    variables |= {
        "fillet_stress_MPa": Entry(
            along, found.fillets / MPa, "MPa", "stress along the fillets at the largest of a gear"
        ),
        "fillet_half_thickness_mm": Entry(
            ("gear", "point"), points[..., 0] / mm, "mm", "half thickness of the tooth"
        ),
        "fillet_height_mm": Entry(
            ("gear", "point"), points[..., 1] / mm, "mm", "height above the gear's centre"
        ),
        "flank_half_thickness_mm": Entry(
            ("gear", "flank_point"), outlines[..., 0] / mm, "mm", "half thickness of the tooth"
        ),
        "flank_height_mm": Entry(
            ("gear", "flank_point"), outlines[..., 1] / mm, "mm", "height above the gear's centre"
        ),
    }
    return dataset_of(
        variables,
        phase=Entry(("phase",), lines.phase, "1", "position in the cycle, in mesh periods"),
        face_position_mm=Entry(
            ("slice",), np.asarray(lines.face_position) / mm, "mm", "position from mid-face"
        ),
        gear=Entry(("gear",), list(GEARS), "1", "gear"),
        fillet=Entry(("fillet",), ["drive", "coast"], "1", "fillet of the loaded flank, other one"),
    )


def roots_summary(gears: Mapping[str, GearKeys], statics: Statics, roots: xr.Dataset) -> Summary:
    """The `roots` part of the summary.

    **Arguments:**

    - `gears`: with their strengths.
    - `statics`: its solved mesh cycle.
    - `roots`: from `roots_dataset`.

    **Returns:**

    For each gear the largest stress, its place, the nominal stress and its factors, and safeties
    where the gear's `root_strength_MPa` is given.
    """
    nominal = nominal_root_stress(statics.model.pair, statics.standard["tangential_force_N"])
    return {
        gear: _of_gear(gear, each.root_strength_MPa, roots.sel(gear=gear), nominal)
        for gear, each in gears.items()
    }


def _of_gear(
    gear: str, strength: float | None, own: xr.Dataset, nominal: NominalRootStress
) -> Summary:
    index, stress = GEARS.index(gear), own["root_stress_MPa"]
    places = np.unravel_index(int(np.argmax(stress.values)), stress.shape)
    at = dict(zip(stress.dims, places, strict=True))
    largest = float(stress.values.max())
    told = {
        "max_root_stress_MPa": largest,
        "max_root_compression_MPa": float(own["root_compression_MPa"].values.min()),
        "phase": float(own["phase"].values[at["phase"]]),
        "face_position_mm": float(own["face_position_mm"].values[at["slice"]]),
        "height_above_root_circle_mm": float(own["root_place_mm"].values[places]),
        "nominal_root_stress_MPa": float(nominal.stress[index]) / MPa,
        "Y_F": float(nominal.form_factor[index]),
        "Y_S": float(nominal.stress_correction[index]),
        "Y_beta": float(nominal.helix_factor),
        "Y_B": float(nominal.rim_factor[index]),
        "Y_DT": float(nominal.deep_tooth_factor),
    }
    if strength is not None:
        told |= {
            "root_safety": strength / largest,
            "nominal_root_safety_S_F": strength / told["nominal_root_stress_MPa"],
        }
    return told


def moving_roots_summary(gears: Mapping[str, GearKeys], swept: xr.Dataset) -> Summary:
    """The `roots` part of the summary of a sweep.

    **Arguments:**

    - `gears`: with their strengths.
    - `swept`: the dataset of its sweep, with root stresses.

    **Returns:**

    For each gear the largest stress of the settled responses, where it is, over that at rest; and
    where the gear's `root_strength_MPa` is given, safety and the speeds that exceed it.
    """
    return {
        gear: _in_motion(each.root_strength_MPa, swept.sel(gear=gear))
        for gear, each in gears.items()
    }


def _in_motion(strength: float | None, own: xr.Dataset) -> Summary:
    settled = own["settled"].values.astype(bool)
    counts = settled if settled.any() else ~settled
    stress = np.where(counts, own["root_stress_MPa"].values, -np.inf)
    way, place = np.unravel_index(int(np.argmax(stress)), stress.shape)
    worst = float(stress[way, place])
    told = {
        "max_root_stress_MPa": worst,
        "max_root_compression_MPa": float(own["root_compression_MPa"].values[counts].min()),
        "pinion_speed_rad_s": float(own["speed"].values[place]),
        "direction": str(own["direction"].values[way]),
        "over_static": worst / float(own["static_root_stress_MPa"]),
    }
    if strength is not None:
        told["root_safety"] = strength / worst
        told["beyond_strength_rad_s"] = own["speed"].values[(stress > strength).any(axis=0)]
    return told
