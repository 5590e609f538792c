"""Tables of a scene that say how its gears are computed and moved, and the whole file."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Literal

from jaxgear.scene._gear_tables import FlanksKeys, Foundation, GearKeys, MaterialKeys, PairKeys
from jaxgear.scene._key import OPTIONAL
from jaxgear.scene._study_tables import (
    CompareKeys,
    MapKeys,
    OptimiseKeys,
    RobustKeys,
    SizingKeys,
)
from jaxgear.scene._table import AbstractKeys, declare, key, real

GearName = Literal["pinion", "wheel"]

# Whether teeth feel a load along their face where a scene does not say.
FACE_COUPLING = "coupled"

SPEED = "(0, inf). At rest, the quasi-static cycle of `jaxgear run` is the response"


class HousingKeys(AbstractKeys):
    """What holds the bearings: `[housing]`."""

    stiffness_csv: str | None = key("file of the stiffness of the housing between the bearings")


class MeshKeys(AbstractKeys):
    """Contact, and how fine it is looked at: `[mesh]`."""

    periods: int = key("mesh periods in one cycle", "[1, 10000]", 1)
    stiffness: Literal["weber-banaschek", "iso6336", "constant"] = key(
        "stiffness of a tooth pair", default="weber-banaschek"
    )
    stiffness_N_mm_um: float = real(
        "stiffness of a tooth pair per length of contact line",
        "(0, inf)",
        applies_if=("stiffness", "constant"),
    )
    foundation: Foundation = key(
        "elasticity of the body under a tooth; ring: an elastic ring, clamped at bore_mm, that "
        "couples the teeth in mesh; a gear with bore_mm = 0 or with a beam body takes weber",
        default="ring",
    )
    tooth: Literal["sliced", "elements"] = key(
        "model of the teeth; elements: condensed finite elements of whole teeth on rings held at "
        "bore_mm, in place of mesh.stiffness and the foundations",
        default="sliced",
    )
    slices: int = key("slices across the face", "[1, 2000]", 20)
    face_coupling: Literal["coupled", "none"] = key(
        "whether a tooth of stiffness weber-banaschek feels a load along its face; coupled: beam, "
        "root, body and contact, each as far as it reaches, and gears of finite width; none: "
        "slices on their own, in plane strain",
        default=FACE_COUPLING,
    )
    phases: int = key("positions in one mesh period", "[8, 4096]", 64)
    contact: Literal["exact", "smooth"] = key("contact law", default="exact")
    smoothing_um: float = real(
        "width of the smooth contact law", "(0, inf)", 0.5, applies_if=("contact", "smooth")
    )
    line_load_updates: int = key(
        "updates of the contact stiffness by the line loads found", "[0, 10]", 0
    )
    body_stress: bool = key(
        "whether stresses of condensed bodies are found: maps over the cycle, files for ParaView",
        default=False,
    )
    root_stress: bool = key(
        "stress at the roots of the teeth, by boundary elements of their outlines and by ISO "
        "6336-3, in the results of a mesh cycle",
        default=False,
    )
    tip_contact: bool = key("contact of tip corners beyond the ends of the path", default=False)
    friction_coefficient: float = key(
        "coefficient of friction of the flanks, its mean over the path of contact; it says what "
        "sliding costs, and does not act back on the loads",
        "[0, 1). Of oiled steel it is 0.02 to 0.08",
        0.05,
    )
    pinion_speed_rad_s: float | None = real(
        "speed of the pinion, whose rotation loads condensed bodies in the quasi-static cycle; "
        "default: at rest",
        "[0, 100000]. The key is in rad/s",
    )
    connection: Literal["mortar", "collocation"] = key(
        "how slices are attached to the rim of a condensed body: mortar, or collocation to compare "
        "with",
        default="mortar",
    )
    root_points: int = key(
        "points across the root of a tooth by which it is attached to the rim of a condensed body; "
        "2: the thesis's two, if mesh.root_correction is false",
        "[2, 24]",
        12,
    )
    root_motion: Literal["rigid", "screw"] = key(
        "how slices of helical teeth follow the rim of a condensed body; rigid: in all six "
        "motions; screw: as the thesis has it, without rotation but that about the gear's axis",
        default="rigid",
    )
    root_correction: bool = key(
        "whether the part of a root's deflection that is too small for the rim's elements is added",
        default=True,
    )


class ModelKeys(AbstractKeys):
    """What is kept of bodies in motion: `[model]`."""

    coordinates: int | None = key(
        "shapes by which each condensed body vibrates, the rest with their static part; 0: all, "
        "200 unless said, of helical teeth or where a cycle has many mesh periods 250, of helical "
        "teeth on two condensed bodies 350; of natural modes 100, of helical teeth where holes "
        "pass by 800 unless shapes are said",
        "[0, inf)",
    )
    shapes: Literal["natural", "excited"] = key(
        "which these are; natural: the lowest natural modes, seats held; excited: a quarter are "
        "these, the others those combinations of higher ones that the mesh excites most, and 16 "
        "more give what all others give at rest; unless said natural for helical teeth where holes "
        "pass by, so that no two stand alike",
        default="excited",
    )
    mesh_coordinates: int | None = key(
        "combinations of these that the mesh tells apart; 8 unless said, of helical teeth 24; "
        "where a cycle has many mesh periods 16 and 28, of natural modes 16 and 100",
        "[4, 400]",
    )

    def shape_count(self, helix: float, periods: int, bodies: int) -> int:
        """Shapes by which each of the condensed bodies vibrates in so many mesh periods, 0: all.

        Spur teeth load a body of equal sectors in its plane alone, and excite fewer of its modes.
        """
        if self.coordinates is not None:
            return self.coordinates
        if self.shapes == "natural":
            return 100
        if helix and bodies > 1:
            return 350
        return 250 if helix or periods > 1 else 200

    def at_mesh(self, helix: float, periods: int) -> int:
        """Combinations of them that the mesh tells apart in a cycle of so many mesh periods.

        Leaning teeth are loaded all over, and where holes pass by, each tooth in another way.
        """
        if self.mesh_coordinates is not None:
            return self.mesh_coordinates
        if periods == 1:
            return 24 if helix else 8
        return (100 if self.shapes == "natural" else 28) if helix else 16

    fidelity: Literal["as given", "auto"] = key(
        "choice of the model; auto: run, map, optimise and sweep first compare models, and take "
        "the cheapest within compare.tolerance",
        default="as given",
    )
    gyroscopic: bool = key(
        "whether gears and shafts that tilt while they spin feel it", default=False
    )


class DampingKeys(AbstractKeys):
    """Damping: `[damping]`."""

    kind: Literal["modal", "rayleigh"] = key("kind of damping", default="modal")
    mesh: float = key("damping ratio of the mesh", "[0, 1)", 0.07)
    structure: float = key("damping ratio of the rest", "[0, 1)", 0.02)
    a_R_1_s: float = key(
        "Rayleigh damping: factor of the mass matrix", "[0, inf)", applies_if=("kind", "rayleigh")
    )
    b_R_s: float = key(
        "Rayleigh damping: factor of the stiffness matrix",
        "[0, inf)",
        applies_if=("kind", "rayleigh"),
    )
    active_mesh: bool = key(
        "whether the mesh damps only while its teeth touch; for modal damping", default=False
    )


class SpeedsKeys(AbstractKeys):
    """Speeds at even distances: `[sweep.pinion_speed_rad_s]`."""

    from_: float = key("lowest speed", SPEED)
    to: float = key("highest speed", SPEED)
    points: int = key("number of speeds", "[2, 100000]")


class SweepKeys(AbstractKeys):
    """A sweep over the speed: `[sweep]`."""

    pinion_speed_rad_s: list[float] | SpeedsKeys = key(
        "speeds of the pinion: a list, or a table with from, to and points", SPEED
    )
    pinion_speed_rpm: list[float] | SpeedsKeys | None = key(
        "speeds of the pinion: a list, or a table with from, to and points",
        SPEED,
        instead_of="pinion_speed_rad_s",
    )
    direction: Literal["up", "down", "both", "cold"] = key(
        "speeds rising, falling, one after the other; cold: each by itself", default="both"
    )
    method: Literal["auto", "newmark", "shooting", "harmonic"] = key(
        "method of the sweep; auto: harmonic balance, but newmark for cycles of so many mesh "
        "periods that it would have more than 100,000 unknowns",
        default="auto",
    )
    centrifugal: bool = key("whether condensed bodies grow with the speed", default=True)
    steps: int = key(
        "time steps in one mesh period; 64 by default where condensed bodies move through cycles "
        "of more than 20 mesh periods by harmonic balance",
        "[8, 4096]",
        128,
    )
    harmonics: int = key(
        "harmonics of the mesh frequency in harmonic balance; fewer than half the steps; 10 by "
        "default where these are 64",
        "[1, 1000]",
        20,
    )
    cycles: int = key(
        "mesh periods of time stepping before a response counts, in whole cycles and at least 4 "
        "of them",
        "[1, 1000000]",
        100,
    )
    orders: int = key("orders of the mesh frequency written down", "[1, 200]", 8)
    continuation: bool | None = key(
        "whether the branch is followed round its folds too; default: with direction = both, but "
        "for cycles of very many mesh periods"
    )
    check_shapes: bool = key(
        "whether responses at a few speeds are found again with what all natural modes, of which "
        "the shapes of condensed bodies are combinations, or twice as many show of the bodies' "
        "motion, to tell how far off they are",
        default=True,
    )


class ModesKeys(AbstractKeys):
    """Natural modes: `[modes]`."""

    count: int | None = key(
        "number of modes written down; default: 12, with condensed bodies 40, or all up to "
        "highest_Hz",
        "[1, 10000]",
    )
    highest_Hz: float | None = key("highest natural frequency written down", "(0, inf)")
    harmonics: int = key("mesh harmonics with critical speeds", "[1, 100]", 4)


class ProbeKeys(AbstractKeys):
    """A place on a body that is looked at: `[[probes]]`."""

    gear: GearName = key("gear, with a condensed body, that is looked at")
    name: str | None = key("name in results; default: what is looked at")
    frame: Literal["rotating", "fixed"] = key(
        "whether the probe turns with the body, or stands still and sees it pass",
        default="rotating",
    )
    direction: Literal["radial", "tangential", "axial"] = key(
        "displacement that is read", default="axial"
    )
    radius_mm: float | None = key("distance from the axis; default: the rim", "(0, inf)")
    angle_deg: float = key(
        "about Z; rotating: on the body, from the middle of tooth 0; fixed: in space, from S",
        default=0.0,
    )
    height_mm: float = key("along Z from mid-face", default=0.0)
    node: str | None = key("a node that was condensed with the body, by name, in place of a place")


class GaugeKeys(AbstractKeys):
    """A strain gauge on a condensed body: `[[gauges]]`."""

    gear: GearName = key("gear, with a condensed body, that carries the gauge")
    name: str | None = key("name in results; default: where it is")
    frame: Literal["rotating", "fixed"] = key(
        "whether the gauge turns with the body, or stands still and reads what passes it",
        default="rotating",
    )
    direction: Literal["radial", "tangential", "axial"] = key(
        "along which it is strained", default="radial"
    )
    turn_deg: float = key(
        "from that direction towards the next: radial, tangential, axial, radial", default=0.0
    )
    radius_mm: float = key("distance from the axis", "(0, inf)")
    angle_deg: float = key(
        "about Z; rotating: on the body, from the middle of tooth 0; fixed: in space, from S",
        default=0.0,
    )
    height_mm: float = key("along Z from mid-face", default=0.0)


class AbstractTables:
    """The whole file."""

    schema: int = key(
        "version of the scene format", "[1, 1]. This version of jaxgear reads scene format 1"
    )
    name: str = key(
        "name of the scene and of its results folder; default: the file's name",
        "It names a folder: no slashes, and not empty",
        OPTIONAL,
        pattern=r"(?!\.{1,2}$)[^/\\\x00-\x1f\x7f]+",
    )
    cite: str = key("where the data come from; printed with every result", default="")
    material: MaterialKeys
    pair: PairKeys
    pinion: GearKeys
    wheel: GearKeys
    flank: FlanksKeys
    housing: HousingKeys
    mesh: MeshKeys
    model: ModelKeys
    damping: DampingKeys
    sweep: SweepKeys
    modes: ModesKeys
    probes: tuple[ProbeKeys, ...]
    gauges: tuple[GaugeKeys, ...]
    map: MapKeys
    optimise: OptimiseKeys
    robust: RobustKeys
    sizing: SizingKeys
    compare: CompareKeys

    def gear(self, name: str) -> GearKeys:
        """The table of a gear, `pinion` or `wheel`."""
        return getattr(self, name)

    @property
    def gears(self) -> Mapping[str, GearKeys]:
        """The tables of both gears, by name."""
        return {"pinion": self.pinion, "wheel": self.wheel}

    @property
    @abstractmethod
    def plain(self) -> "PlainTables":
        """The tables with plain numbers alone: what is moved is as it was before."""


# Not as a decorator: a scene is made of more than its tables.
declare(AbstractTables)


class PlainTables(AbstractTables):
    """Tables by themselves."""

    @property
    def plain(self) -> "PlainTables":
        """The tables themselves."""
        return self
