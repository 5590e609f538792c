"""Tables of a scene that say what the gears are: pair, bodies, shafts, flanks.

Units are those of the file (the suffix of the key); nothing is converted here. Depths are material
removed, so they are never negative; slopes are positive where material is added. Keys of a table
that is not there are `None`.
"""

from typing import Literal

from jaxgear.scene._body_tables import LENGTH, BodyKeys, SupportKeys
from jaxgear.scene._table import AbstractKeys, key, real

Foundation = Literal["weber", "sainsot", "ring", "none"]
Shape = Literal["linear", "parabolic"]

YOUNG = "[0.1, 2000]. The key is in gigapascals; steel has 206"
DENSITY = "[100, 30000]. The key is in kg/m^3; steel has 7850"
TORQUE = (
    "(0, inf). It is a size: the flank that carries, drive or coast, is said by the sign of "
    "pair.torque_pinion_Nm"
)
DEPTH = "[0, inf). A depth is material removed, so it is positive where the flank is cut back"
EXTENT = (
    "(0, 1]. An extent is a fraction of the path of contact eps_alpha p_bt, from 0 to 1; a value "
    "above 1 looks as if millimetres were given: divide by geometry.path_of_contact_mm in "
    "summary.json"
)
FACE_EXTENT = (
    "(0, 1]. This extent is a fraction of the face width, from 0 to 1; a value above 1 looks as if "
    "millimetres were given: divide by face_width_mm"
)
BEARING = "[0, inf). Leave the key out where the bearing does not hold the shaft"
SHAPE = key(
    "how its depth grows from where it begins: in proportion, or with the square", default="linear"
)
PLACE = "[0, inf). Positions are measured from the first end of the shaft"


class MaterialKeys(AbstractKeys):
    """Material of both gears: `[material]`."""

    young_GPa: float = real("Young's modulus", YOUNG, 206.0)
    poisson: float = real("Poisson's ratio", "[0, 0.5)", 0.3)
    density_kg_m3: float = real("mass density", DENSITY, 7850.0)


class PairKeys(AbstractKeys):
    """What both gears share: `[pair]`."""

    module_mm: float = real("normal module", "[0.01, 200]. The key is in millimetres")
    pressure_angle_deg: float = real(
        "normal pressure angle", "[5, 45). The key is in degrees", 20.0
    )
    helix_angle_deg: float = real(
        "helix angle at the reference cylinder; positive: a right-hand pinion",
        "[-45, 45]. The key is in degrees",
        0.0,
    )
    torque_pinion_Nm: float = real(
        "torque on the pinion; negative: it drives backwards, with its coast flanks; 0: rigid "
        "gears without load, for `jaxgear run` alone"
    )
    power_kW: float | None = real(
        "power on the pinion, which with speed_rpm gives its torque",
        TORQUE,
        instead_of="torque_pinion_Nm",
    )
    speed_rpm: float | None = real(
        "speed of the pinion, at which power_kW is transmitted; sweeps have their own",
        "(0, 1000000]. The key is in revolutions per minute",
    )
    centre_distance_mm: float | None = real(
        "working centre distance; default: the zero-backlash one from the profile shifts",
        "(0, inf). Leave the key out for the centre distance without backlash",
    )
    misalignment_inclination_um: float = real(
        "misalignment over the face width in the plane of the axes", default=0.0
    )
    misalignment_deviation_um: float = real(
        "misalignment over the face width in the plane perpendicular to that of the axes",
        default=0.0,
    )

    @property
    def sense(self) -> int:
        """1 where the drive flanks carry, -1 where the coast flanks do."""
        return -1 if self.torque_pinion_Nm < 0.0 else 1


class OwnMaterialKeys(AbstractKeys):
    """A gear's own material: `[pinion.material]`."""

    young_GPa: float | None = real("Young's modulus", YOUNG)
    poisson: float | None = real("Poisson's ratio", "[0, 0.5)")
    density_kg_m3: float | None = real("mass density", DENSITY)


class SegmentKeys(AbstractKeys):
    """One section of a shaft."""

    length_mm: float = real("length of the segment", LENGTH)
    outer_mm: float = real("outer diameter", LENGTH)
    inner_mm: float = real("inner diameter; 0: solid", "[0, inf)", 0.0)


class BearingKeys(AbstractKeys):
    """One bearing of a shaft."""

    at_mm: float = real("position of the bearing", PLACE)
    radial_N_m: float | None = real("radial stiffness of the bearing", BEARING)
    radial_S_N_m: float | None = real("radial stiffness, along S only", BEARING)
    radial_T_N_m: float | None = real("radial stiffness, along T only", BEARING)
    axial_N_m: float | None = real("axial stiffness of the bearing", BEARING)
    tilt_Nm_rad: float | None = real("tilt stiffness of the bearing", BEARING)
    tilt_S_Nm_rad: float | None = real("tilt stiffness, about S only", BEARING)
    tilt_T_Nm_rad: float | None = real("tilt stiffness, about T only", BEARING)


class LoadKeys(AbstractKeys):
    """A load on a shaft."""

    at_mm: float = real("position of a load", PLACE)
    force_N: list[float] = real("force along S, T, Z", default=[0.0, 0.0, 0.0], length=3)
    moment_Nm: list[float] = real("moment about S, T, Z", default=[0.0, 0.0, 0.0], length=3)


class UnbalanceKeys(AbstractKeys):
    """A mass beside the axis of a shaft."""

    at_mm: float = real("position of an unbalance", PLACE)
    moment_gmm: float = real(
        "mass of an unbalance times its distance from the axis, by which `jaxgear sweep` shakes "
        "the pair at the shaft's rotation",
        "[0, inf). It is a size: its direction is angle_deg",
    )
    angle_deg: float = real(
        "direction of an unbalance at phase 0, from S about the shaft's own sense of rotation",
        default=0.0,
    )


class ShaftKeys(AbstractKeys):
    """The shaft of a gear: `[pinion.shaft]`."""

    gear_at_mm: float = real("position of the gear's mid-face", PLACE)
    segments: tuple[SegmentKeys, ...]
    bearings: tuple[BearingKeys, ...]
    torque_at_mm: float | None = real(
        "where the torque enters or leaves the shaft; default: at the gear", PLACE
    )
    shear_coeff: float | None = real(
        "shear coefficient of the sections; default: that of each ring section",
        "(0, 1]. It is the share of the section that carries shear; a solid shaft has about 0.9",
    )
    loads: tuple[LoadKeys, ...]
    unbalance: tuple[UnbalanceKeys, ...]
    divisions: int | None = key(
        "finite elements from one station to the next; default: 1, exact in statics", "[1, 100]"
    )

    @property
    def loaded_at_mm(self) -> list[float]:
        """Where loads, and behind them unbalances, act: places that have nodes of their own."""
        return [each.at_mm for each in (*self.loads, *self.unbalance)]


class GearKeys(AbstractKeys):
    """One gear: `[pinion]`, `[wheel]`."""

    teeth: int = key("number of teeth", "[5, 10000]")
    profile_shift: float = real("profile shift coefficient x", "[-5, 5]", 0.0)
    span_mm: float | None = real(
        "span W_k over span_teeth teeth as they are made, thickness_allowance_um in it",
        LENGTH,
        instead_of="profile_shift",
    )
    span_teeth: int | None = key(
        "number of teeth k that a span is measured over; alone: that of the summary", "[1, 10000]"
    )
    over_balls_mm: float | None = real(
        "measure M_dK over two balls of ball_mm in opposite spaces, both in one transverse plane, "
        "thickness_allowance_um in it",
        LENGTH,
        instead_of="profile_shift",
    )
    ball_mm: float | None = key(
        "diameter of a ball of over_balls_mm; alone: that of the summary", LENGTH
    )
    addendum_coeff: float = real("addendum over module", "(0, 5]", 1.0)
    tip_diameter_mm: float | None = real(
        "tip diameter as on the drawing, any tip shortening in it",
        LENGTH,
        instead_of="addendum_coeff",
    )
    dedendum_coeff: float = real("dedendum over module", "(0, 5]", 1.25)
    root_diameter_mm: float | None = real("root diameter", LENGTH, instead_of="dedendum_coeff")
    fillet_radius_coeff: float = real(
        "tip radius of the rack that cuts the fillet, over module; where 0.38 does not fit the "
        "rack at this pressure angle, the largest that does",
        "[0, 1]",
        0.38,
    )
    tip_shortening_coeff: float = real(
        "tip shortening k over module; 0 for tables that give tip radii directly", "[0, 1]", 0.0
    )
    face_width_mm: float = real("face width", "[0.1, 2000]. The key is in millimetres")
    bore_mm: float | None = real(
        "diameter of the bore, where the body is held; 0: none; default, where the foundation is "
        "the ring: that of the shaft, or 0.4 of the root diameter",
        "[0, inf)",
    )
    thickness_allowance_um: float | None = key(
        "how much thinner the tooth is made at the reference cylinder, in the normal section; "
        "where a gear has it, back flanks touch once the backlash is used up",
        "[0, inf). An allowance is what is taken off the tooth, so it is not negative",
    )
    tip_corner_radius_mm: float | None = real(
        "radius of the rounding between flank and tip, square to the edge, by which a corner "
        "presses with mesh.tip_contact; default: not known",
        "(0, 50]. The key is in millimetres; leave it out where the corner is sharp",
    )
    root_strength_MPa: float | None = key(
        "tooth-root stress that the gear bears, by which mesh.root_stress is judged: sigma_FG of "
        "ISO 6336-3, its life, notch and size factors in it",
        "(0, inf)",
    )
    foundation: Foundation | None = key("foundation of this gear's teeth")
    material: OwnMaterialKeys
    support: SupportKeys
    body: BodyKeys
    shaft: ShaftKeys


class TipReliefKeys(AbstractKeys):
    """Relief at the tip: `[flank.pinion.tip_relief]`."""

    depth_um: float = real("depth removed at the tip", DEPTH, 0.0)
    extent: float = real("length of the relief, as a fraction of the path of contact", EXTENT, 0.25)
    shape: Shape = SHAPE


class RootReliefKeys(AbstractKeys):
    """Relief at the start of active profile: `[flank.pinion.root_relief]`."""

    depth_um: float = real("depth removed at the start of active profile", DEPTH, 0.0)
    extent: float = real("length of the relief, as a fraction of the path of contact", EXTENT, 0.2)
    shape: Shape = SHAPE


class EndReliefKeys(AbstractKeys):
    """Relief at the ends of the face: `[flank.pinion.end_relief]`."""

    side: Literal["left", "right", "both"] = key(
        "end of the face that is relieved; left is the -Z end", default="both"
    )
    depth_um: float = real("depth removed at the end of the face", DEPTH, 0.0)
    extent: float = real("length of the relief, as a fraction of the face width", FACE_EXTENT, 0.2)
    shape: Shape = SHAPE


class FlankKeys(AbstractKeys):
    """The flanks of a gear: `[flank.pinion]`."""

    tip_relief: TipReliefKeys
    root_relief: RootReliefKeys
    crowning_um: float = real(
        "parabolic crowning: depth removed at both ends of the face", DEPTH, 0.0
    )
    end_relief: EndReliefKeys
    helix_slope_um: float = real(
        "helix slope deviation over the face width; positive adds material", default=0.0
    )
    profile_slope_um: float = real(
        "profile slope deviation over the path of contact; positive adds material at the tip",
        default=0.0,
    )
    profile_crowning_um: float = real(
        "parabolic profile crowning: depth removed at both ends of the profile", DEPTH, 0.0
    )
    elliptical_crowning_um: float = real(
        "elliptical crowning: depth removed at both ends of the face", DEPTH, 0.0
    )
    bias_um: float = real(
        "twist of the flank: added at two opposite corners, removed at the other two", default=0.0
    )
    profile_deviation_csv: str | None = key(
        "file of a profile deviation, the same all along the face; positive adds material"
    )
    topography_csv: str | None = key("file of a deviation over the flank; positive adds material")
    accuracy_grade: float | None = real(
        "ISO 1328-1 tolerance grade, turned into a stated waveform; left out: a perfect flank",
        "[1, 11]. ISO 1328-1 has the grades 1, the finest, to 11",
    )
    accuracy_waves: int = key("waves of the grade's waveform over the profile", "[1, inf)", 3)
    accuracy_slopes: bool = key(
        "whether the grade's full tolerances of profile and helix slope are added", default=False
    )
    pitch_error_um: list[float] = real(
        "cumulative pitch error per tooth, positive adds material; one value: all teeth",
        default=[0.0],
    )
    eccentricity_um: float = real(
        "distance of the teeth's axis from that of rotation",
        "[0, inf). It is a distance; its direction is eccentricity_angle_deg",
        0.0,
    )
    eccentricity_angle_deg: float = real(
        "direction of the offset at phase 0, from S about the gear's own sense of rotation",
        default=0.0,
    )


class FlanksKeys(AbstractKeys):
    """The flanks of both gears: `[flank]`."""

    pinion: FlankKeys
    wheel: FlankKeys
    pinion_coast: FlankKeys
    wheel_coast: FlankKeys

    def gear(self, name: str, sense: int = 1) -> FlankKeys:
        """The flanks of a gear, `pinion` or `wheel`, that carry.

        Those of the coast side, `sense` -1, are as those of the drive side unless they are given.
        """
        coast = self.coast(name)
        return coast if sense < 0 and coast.is_given else getattr(self, name)

    def coast(self, name: str) -> FlankKeys:
        """The coast flanks of a gear, `pinion` or `wheel`, as they are given."""
        return getattr(self, f"{name}_coast")
