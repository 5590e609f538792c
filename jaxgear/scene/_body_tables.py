"""Tables of a gear's body: rigid, or condensed from a drawing, a grid or matrices."""

from typing import Any, Literal

from jaxgear.scene._table import AbstractKeys, key, real

LENGTH = "(0, inf). The key is in millimetres"
SPRING = "(0, inf). Leave the key out where the support is rigid"


def condensed(doc: str, rule: str = "", default: object = ..., **more: Any) -> Any:
    """A key that has its default only in a condensed body."""
    return key(doc, rule, default, default_if=("kind", "condensed"), **more)


class SupportKeys(AbstractKeys):
    """Springs at a gear's centre, in place of a shaft: `[pinion.support]`."""

    radial_N_m: float | None = real("radial stiffness of the support", SPRING)
    radial_S_N_m: float | None = real("radial stiffness, along S only", SPRING)
    radial_T_N_m: float | None = real("radial stiffness, along T only", SPRING)
    axial_N_m: float | None = real("axial stiffness of the support", SPRING)
    tilt_Nm_rad: float | None = real("tilt stiffness of the support", SPRING)


class WebKeys(AbstractKeys):
    """A body drawn by hub, web and rim: `[pinion.body.web]`."""

    hub_outer_mm: float = real("outer diameter of the hub", LENGTH)
    web_thickness_mm: float = real("thickness of the web", LENGTH)
    rim_inner_mm: float = real("inner diameter of the rim", LENGTH)
    web_offset_mm: float | None = real(
        "axial offset of the web's middle from mid-face, half way between hub and rim"
    )
    web_angle_deg: float | None = real(
        "cone angle of the web; positive: it rises along Z from hub to rim",
        "[-60, 60]. The key is in degrees; 0 is a flat web",
    )
    hub_width_mm: float | None = real("width of the hub; default: face_width_mm", LENGTH)
    holes: int | None = key("number of holes on a circle", "[0, 100]")
    hole_diameter_mm: float | None = real("diameter of a hole", LENGTH)
    hole_circle_mm: float | None = real("diameter of the circle of their centres", LENGTH)
    hole_angle_deg: float | None = real("direction of the first hole, from tooth 0; default: 0")
    second_holes: int | None = key("number of holes of a second ring", "[0, 100]")
    second_hole_diameter_mm: float | None = real(
        "diameter of a hole of the second ring; default: as in the first", LENGTH
    )
    second_hole_circle_mm: float | None = real(
        "circle of the second ring; default: that of the first", LENGTH
    )
    second_hole_angle_deg: float | None = real(
        "direction of the second ring's first hole; default: half way between two of the first"
    )


KELVIN = "[-300, 1500]. The key is a difference of temperatures in kelvin"


class TemperatureKeys(AbstractKeys):
    """Temperatures of a condensed body, heat flowing between: `[pinion.body.temperature]`."""

    hub_K: float = real(
        "temperature of the hub over that at which gears and centre distance are as given", KELVIN
    )
    rim_K: float = real("temperature of rim and teeth over the same", KELVIN)
    expansion_1_K: float | None = real(
        "coefficient of thermal expansion; default: 1.15e-5, steel's",
        "(0, 1e-4]. The key is in 1/K; steel has 1.15e-5",
    )
    hub_diameter_mm: float | None = key(
        "diameter within which the body has the temperature of the hub; default: "
        "web.hub_outer_mm, without web the largest diameter of its seats",
        LENGTH,
    )


class FinenessKeys(AbstractKeys):
    """Numbers of 20-node bricks of a drawn body: `[pinion.body.fineness]`."""

    elements_per_tooth: int | None = key(
        "elements around, for each tooth; 1 unless said", "[1, 50]"
    )
    sectors: int | None = key(
        "elements around, whatever the teeth; instead of elements_per_tooth", "[8, 2000]"
    )
    rim_across: int | None = key("elements across the face of the rim", "[1, 50]")
    rim_deep: int | None = key("elements through the rim", "[1, 50]")
    web_along: int | None = key("elements along the web, from hub to rim", "[1, 50]")
    web_layers: int | None = key("elements through the web", "[1, 50]")
    hub_deep: int | None = key("elements through the hub", "[1, 50]")
    shaft_mm: float | None = key("largest element along the shaft", LENGTH)


class BodyKeys(AbstractKeys):
    """The body of a gear, and what is kept of a condensed one: `[pinion.body]`."""

    kind: Literal["rigid", "beam", "condensed"] = key(
        "gear body: rigid; beam: in one piece with its shaft; condensed: finite elements",
        default="rigid",
    )
    mass_kg: float | None = key(
        "mass of the body; default: of a disc from bore to root circle", "(0, inf)"
    )
    inertia_kg_m2: float | None = key(
        "polar moment of inertia of the body; default: of that disc", "(0, inf)"
    )
    transverse_inertia_kg_m2: float | None = key(
        "transverse moment of inertia, about a diameter at mid-face", "(0, inf)"
    )
    web: WebKeys
    grid: str | None = key("a finite element grid of the user's own, instead of web")
    rim_set: str | None = key("node set of body.grid on the rim, the cylinder under the teeth")
    seats: list[str] | None = key(
        "node sets of body.grid for bearing seats, in their order; without shaft, of the bore"
    )
    torque_set: str | None = key("node set of body.grid where the torque enters or leaves")
    load_sets: list[str] | None = key(
        "node sets of body.grid where shaft.loads and then shaft.unbalance act, in their order; "
        "default: the nearest seat"
    )
    grid_unit_mm: float | None = key(
        "length of the unit of body.grid; default: 1",
        "(0, inf). A grid in metres has 1000, one in inches 25.4",
    )
    superelement: str | None = key(
        "matrices condensed elsewhere (.mtx, .sti, .op4, .npz), instead of web"
    )
    superelement_mass: str | None = key(
        "file of the superelement's mass matrix, where it has one of its own"
    )
    superelement_nodes: str | None = key(
        "table of the superelement's nodes: columns node, x, y, z, role"
    )
    superelement_faces: str | None = key(
        "faces of the superelement's rim: eight node numbers on a line"
    )
    superelement_units: Literal["m-kg-s", "mm-t-s", "mm-kg-ms", "in-lbf-s"] | None = key(
        "units of all files of the superelement"
    )
    superelement_mid_face_mm: float | None = key(
        "middle of the toothed face along the superelement's z; default: 0"
    )
    interface: str | None = condensed(
        "how the inside is kept: herting, craig-bampton or guyan; with grid also the rim's set",
        default="herting",
    )
    modes: int | None = condensed(
        "number of modes of the inside that are kept",
        "[0, 200]. 0 keeps the rim and the seats alone",
        50,
    )
    young_GPa: float | None = real(
        "Young's modulus of the body alone; a high one makes it rigid with its mass unchanged",
        "[0.1, 10000000.0]. The key is in gigapascals; steel has 206",
    )
    seat_coupling: Literal["rigid", "averaging"] | None = condensed(
        "what ties a seat to its node: a rigid ring, or the average of its motion", default="rigid"
    )
    seat_width_mm: float | None = key(
        "length of shaft that a bearing holds; default: a third of the diameter there", LENGTH
    )
    compare_seats: bool | None = condensed(
        "whether the health report compares rigid and averaging seats, which takes a while",
        default=True,
    )
    teeth_mass: bool | None = condensed(
        "whether the mass of the teeth is laid on the rim", default=True
    )
    rotating_terms: bool | None = condensed(
        "whether Coriolis terms, spin softening and stress stiffening are condensed too",
        default=False,
    )
    temperature: TemperatureKeys
    fineness: FinenessKeys
