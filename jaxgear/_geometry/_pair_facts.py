"""What is closed-form about a pair, by name."""

from typing import NamedTuple

from jaxgear._types import Bodies, Scalar


class PairFacts(NamedTuple):
    """Everything closed-form about a pair.

    Its fields are the properties of `GearPair` of the same names [m, rad], and the functions
    `profile_contact_ratio`, `overlap_ratio`, `total_contact_ratio`, `full_tip_shortening` [-].
    """

    reference_radius: Bodies
    base_radius: Bodies
    tip_radius: Bodies
    root_radius: Bodies
    form_radius: Bodies
    form_roll: Bodies
    tip_roll: Bodies
    working_pitch_radius: Bodies
    tip_thickness: Bodies
    half_thickness_at_base: Bodies
    root_clearance: Bodies
    working_centre_distance: Scalar
    zero_backlash_centre_distance: Scalar
    zero_backlash_pressure_angle: Scalar
    working_pressure_angle: Scalar
    transverse_pressure_angle: Scalar
    base_helix_angle: Scalar
    transverse_base_pitch: Scalar
    tangent_length: Scalar
    path_start: Scalar
    path_end: Scalar
    path_of_contact: Scalar
    pitch_point: Scalar
    face_width: Scalar
    backlash: Scalar
    profile_contact_ratio: Scalar
    overlap_ratio: Scalar
    total_contact_ratio: Scalar
    full_tip_shortening: Scalar
