"""Axes, hand of the helix, senses of rotation and forces of a pair, as places and directions.

Axes: S from the pinion's centre to the wheel's, Z along the axes, T = Z x S. The pinion turns
about +Z and drives. A right-hand tooth turns with the fingers of a right hand whose thumb runs
along Z.
"""

import numpy as np

from jaxgear._geometry._pair import GearPair
from jaxgear._units import mm
from jaxgear.plot._tables import Columns, _facts


def axes_columns(pair: GearPair) -> Columns:
    """The data of `axes`: where each arrow is, and its direction as a unit vector.

    Tooth traces are those on the side of +T, torques what drive and load put on the gears, forces
    what the mesh puts on them.
    """
    facts = _facts(pair)
    angle, base_helix = (float(facts[x]) for x in ("working_pressure_angle", "base_helix_angle"))
    helix, distance = float(pair.helix_angle), float(facts["working_centre_distance"])
    radii = facts["reference_radius"]
    along = np.array([np.sin(angle), np.cos(angle), 0.0])
    normal = np.cos(base_helix) * along - [0.0, 0.0, np.sin(base_helix)]
    pitch_point = np.array([float(facts["working_pitch_radius"][0]), 0.0, 0.0])
    middle, other, up = np.zeros(3), np.array([distance, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    side = np.array([0.0, 1.0, 0.0])
    # On the pinion's side of +T a tooth that turns about +Z with Z moves towards -S.
    trace = np.array([-np.sin(helix), 0.0, np.cos(helix)])
    rows = {
        "rotation of the pinion": (middle, up),
        "rotation of the wheel": (other, -up),
        "torque on the pinion": (middle, up),
        "torque on the wheel": (other, up),
        "tooth trace of the pinion": (middle + radii[0] * side, trace),
        "tooth trace of the wheel": (other + radii[1] * side, trace * [-1.0, 1.0, 1.0]),
        "path of contact": (pitch_point, along),
        "force on the pinion": (pitch_point, -normal),
        "force on the wheel": (pitch_point, normal),
    }
    places, directions = (np.stack(each) for each in zip(*rows.values(), strict=True))
    return (
        {"arrow": np.asarray(list(rows))}
        | {f"{axis}_mm": places[:, i] / mm for i, axis in enumerate("STZ")}
        | {f"along_{axis}": directions[:, i] for i, axis in enumerate("STZ")}
    )
