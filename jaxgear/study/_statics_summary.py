"""What a summary says of a pair's geometry, its bearings and supports."""

import jax
import numpy as np

from jaxgear._geometry._pair import GearPair, pair_facts
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft
from jaxgear._system._support import Support
from jaxgear._units import deg, mm, um
from jaxgear.scene._schema import GEARS
from jaxgear.study._result import Summary
from jaxgear.study._statics import Statics

_OF_GEARS = (
    *("reference_radius", "base_radius", "tip_radius", "root_radius", "form_radius"),
    *("working_pitch_radius", "tip_thickness", "root_clearance"),
)


def geometry_summary(pair: GearPair) -> Summary:
    """The `geometry` part of the summary, but for what follows from the contact."""
    facts = jax.tree.map(np.asarray, pair_facts(pair))
    pitch, path = facts.transverse_base_pitch, facts.path_of_contact
    lengths = {
        "centre_distance_mm": facts.working_centre_distance,
        "base_pitch_mm": pitch,
        "path_of_contact_mm": path,
        # From the wheel's tip A to the inner single contact point B, the pitch point C, the outer
        # single contact point D and the pinion's tip E.
        "path_AB_mm": path - pitch if pitch < path < 2.0 * pitch else np.nan,
        "path_AC_mm": facts.pitch_point - facts.path_start,
        "path_AD_mm": pitch if pitch < path < 2.0 * pitch else np.nan,
        "path_AE_mm": path,
        "common_face_width_mm": facts.face_width,
        "backlash_mm": facts.backlash,
    }
    lengths |= {
        f"{name}_{gear}_mm": getattr(facts, name)[body]
        for body, gear in enumerate(GEARS)
        for name in _OF_GEARS
    }
    angles = ("working_pressure_angle", "transverse_pressure_angle", "base_helix_angle")
    ratios = ("profile_contact_ratio", "overlap_ratio", "total_contact_ratio")
    return (
        {key: float(value / mm) for key, value in lengths.items()}
        | {f"{name}_deg": float(getattr(facts, name) / deg) for name in angles}
        | {name: float(getattr(facts, name)) for name in ratios}
        | {"full_tip_shortening_coeff": float(facts.full_tip_shortening)}
    )


def bearings_of(model: PairModel) -> list[tuple[str, int]]:
    """Gear and number of each bearing in the order of the scene, the pinion's first."""
    return [
        (gear, index)
        for gear, mount in zip(GEARS, (model.pinion_support, model.wheel_support), strict=True)
        if isinstance(mount, Shaft)
        for index in range(len(mount.bearings))
    ]


def mounts_summary(statics: Statics) -> Summary:
    """Mean displacement and load of bearings, and of the gears that have none.

    `bearings`, the pinion's first, in the order of the scene; `supports`, the springs at a gear's
    centre. A load is what shaft or gear puts on it.
    """
    model = statics.model
    motion, wrench, bearings = map(np.asarray, statics.mounts)
    mounts = zip(GEARS, (model.pinion_support, model.wheel_support), motion, wrench, strict=True)
    return {
        "bearings": [
            {
                "gear": gear,
                "index": index,
                **_mount_row(displacement, load[:3]),
                "moment_Nm": dict(zip("ST", load[3:].tolist(), strict=True)),
            }
            for (gear, index), displacement, load in zip(bearings_of(model), *bearings, strict=True)
        ],
        "supports": [
            {"gear": gear, **_mount_row(moved, load[:3])}
            for gear, mount, moved, load in mounts
            if isinstance(mount, Support)
        ],
    }


def _mount_row(motion: np.ndarray, force: np.ndarray) -> Summary:
    return {
        "displacement_um": dict(zip("STZ", (motion[:3] / um).tolist(), strict=True)),
        "tilt_urad": dict(zip("ST", (1e6 * motion[3:5]).tolist(), strict=True)),
        "load_N": dict(zip("STZ", force.tolist(), strict=True)),
    }
