"""From the scene's file units to the library's SI: here and in `_build_pair`, and nowhere else.

Every function here can be traced by JAX: what is moved of the scene may be tracers, so that a
response can be differentiated by any real key of the file.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from jaxgear._checks import InputError
from jaxgear._contact._cells import Misalignment
from jaxgear._contact._compliance import (
    AbstractCompliance,
    ConstantStiffness,
    Iso6336,
    WeberBanaschek,
)
from jaxgear._contact._face_coupling import FaceCoupling
from jaxgear._contact._foundation import (
    AbstractFoundation,
    NoFoundation,
    RingFoundation,
    SainsotFoundation,
    WeberFoundation,
)
from jaxgear._geometry._gear import Material
from jaxgear._geometry._lines import MeshGrid, mesh_grid
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._tip_contact import tip_separation
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._gear_body import AbstractGearBody, BeamBody, gear_disc
from jaxgear._system._housing import Housing
from jaxgear._system._model import PairModel
from jaxgear._system._scaled_body import scaled_body
from jaxgear._system._shaft import Shaft
from jaxgear._system._shaft_layout import ShaftLayout
from jaxgear._system._shaft_parts import Bearing, Segment, ShaftLoad
from jaxgear._system._support import Support
from jaxgear._types import Scalar
from jaxgear._units import GPa, N_per_mm_um, mm, um
from jaxgear.scene._body_heat import warmed
from jaxgear.scene._body_tables import BodyKeys
from jaxgear.scene._build_pair import flanks_of, material_of, pair_of, si
from jaxgear.scene._csv import read_matrix
from jaxgear.scene._gear_tables import BearingKeys, GearKeys, PairKeys, ShaftKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._tables import MeshKeys


def model_of(scene: Scene, changes: Mapping[str, object] = MappingProxyType({})) -> PairModel:
    """Build the model that a scene describes.

    **Arguments:**

    - `scene`: checked against the schema.
    - `changes`: path to value, in place of the scene's; real ones may be traced.

    **Returns:**

    The model, in SI. Where the torque is negative that of the pair's mirror image in the plane of
    the axes, whose drive flanks are the pair's coast flanks (theory 1.16): T and what turns about S
    and Z have the other sign in it.

    **Raises:**

    - `ValueError` if the gears are impossible, or if a condensed body has not been built or cannot
        follow what is traced.
    """
    scene = scene.replace(changes) if changes else scene
    pair, shared, folder = pair_of(scene), scene.pair, scene.path.parent
    plain, sense, teeth = scene.plain, scene.plain.pair.sense, None
    flanks = flanks_of(scene, pair)
    if scene.mesh.tooth == "elements":
        # For other scenes no finite elements are imported.
        from jaxgear.scene._mesh_teeth import teeth_in_mesh

        teeth = teeth_in_mesh(scene).in_mesh(scene.mesh.line_load_updates)
    # Which points share a node follows from the last numbers that were not traced.
    with jax.ensure_compile_time_eval():
        still = {name: (gear, material_of(plain, name)) for name, gear in plain.gears.items()}
    pinion, wheel = (
        _mount(gear, material_of(scene, name), still[name], sense)
        for name, gear in scene.gears.items()
    )
    bodies = {
        name: _condensed_body(scene, name)
        if name in scene.condensed
        else _body(gear.body, pair, name, mount)
        for (name, gear), mount in zip(scene.gears.items(), (pinion, wheel), strict=True)
    }
    housing, speed = scene.housing.stiffness_csv, scene.mesh.pinion_speed_rad_s
    return PairModel(
        pair=pair,
        torque=sense * si(shared.torque_pinion_Nm),
        flanks=flanks,
        compliance=teeth or _compliance(scene.mesh, scene.gears),
        misalignment=misalignment_of(shared, sense),
        housing=None if housing is None else _housing(read_matrix(housing, folder), sense),
        speed=0.0 if speed is None else si(speed),
        pinion_support=pinion,
        wheel_support=wheel,
        pinion_body=bodies["pinion"],
        wheel_body=bodies["wheel"],
    )


def _housing(stiffness: np.ndarray, sense: int) -> Housing:
    """A housing, whose T turns round where the pair is mirrored."""
    turned = np.tile([1.0, float(sense), 1.0], len(stiffness) // 3 + 1)[: len(stiffness)]
    return Housing(stiffness * turned[:, None] * turned if sense < 0 else stiffness)


def misalignment_of(pair: PairKeys, sense: int) -> Misalignment:
    """How far the axes of a scene are out of parallel, seen as its `sense` says."""
    return Misalignment(
        inclination=si(pair.misalignment_inclination_um, um),
        deviation=sense * si(pair.misalignment_deviation_um, um),
    )


def grid_of(scene: Scene, model: PairModel, phases: int | None = None) -> MeshGrid:
    """Choose the grid that a scene asks for.

    **Arguments:**

    - `scene`: checked against the schema.
    - `model`: of the scene, or one close to it.
    - `phases`: positions in one mesh period in place of the scene's, such as its time steps.
    """
    return pair_grid(
        scene.mesh,
        model.pair,
        model.mesh_torque,
        scene.map.torques_Nm,
        condensed=bool(scene.condensed),
        phases=phases,
    )


def pair_grid(
    mesh: MeshKeys,
    pair: GearPair,
    torque: Scalar,
    others: Sequence[float] | None,
    *,
    condensed: bool,
    phases: int | None = None,
) -> MeshGrid:
    """As `grid_of`, of the pair alone under a torque on the mesh, and at times others [N m]."""
    return mesh_grid(
        pair,
        phases=phases or mesh.phases,
        slices=mesh.slices,
        periods=mesh.periods,
        beyond=_tip_window(pair, torque, others) if mesh.tip_contact else 0.0,
        # What is condensed does not follow the face anyway, and every line costs.
        fixed_face=condensed or mesh.tooth == "elements",
    )


# A stiffness that few tooth pairs fall below [N/m2], and the highest torque of a Harris map over
# the scene's own.
_SOFT, _OVERLOAD = 10.0 * N_per_mm_um, 1.5


def _tip_window(pair: GearPair, torque: Scalar, others: Sequence[float] | None) -> float:
    """How far beyond the path tip corners may touch, in base pitches: as far as teeth can bend.

    A window is no smoothing: one that is wide enough changes nothing, and one that is not
    is refused once it is solved.
    """
    most = max(_OVERLOAD * float(torque), *(others or [0.0]))
    bend = most / (float(pair.base_radius[0]) * float(pair.face_width) * _SOFT)
    places = np.arange(0.1, 0.46, 0.05)
    early, late = np.asarray(jax.jit(_tip_gaps)(pair, jnp.asarray(places)))
    enough = np.minimum(early, late) > bend
    return float(places[int(np.argmax(enough))]) if enough.any() else float(places[-1])


def _tip_gaps(pair: GearPair, places: Array) -> Array:
    """Separation before and behind the path [m], at distances in base pitches."""
    away = places * pair.transverse_base_pitch
    return jnp.stack(
        [tip_separation(pair, pair.path_start - away), tip_separation(pair, pair.path_end + away)]
    )


def smooth_law_of(mesh: MeshKeys) -> SmoothContact:
    """The smooth contact law with the scene's width."""
    return SmoothContact(width=si(mesh.smoothing_um, um))


def law_of(mesh: MeshKeys) -> AbstractContactLaw:
    """The contact law that a scene asks for."""
    return ExactContact() if mesh.contact == "exact" else smooth_law_of(mesh)


def _compliance(mesh: MeshKeys, gears: Mapping[str, GearKeys]) -> AbstractCompliance:
    match mesh.stiffness:
        case "constant":
            return ConstantStiffness(si(mesh.stiffness_N_mm_um, N_per_mm_um))
        case "iso6336":
            return Iso6336()
        case _:
            return WeberBanaschek(
                *(_foundation(mesh, gear) for gear in gears.values()),
                load_updates=mesh.line_load_updates,
                face_coupling=FaceCoupling() if mesh.face_coupling == "coupled" else None,
            )


_FOUNDATIONS = {
    "weber": WeberFoundation,
    "sainsot": SainsotFoundation,
    "ring": RingFoundation,
    "none": NoFoundation,
}


def _foundation(mesh: MeshKeys, gear: GearKeys) -> AbstractFoundation:
    """What gives under the teeth of a gear.

    Under those of a condensed body it counts in the figures of a single pair only. Unless said
    otherwise it is what is near a root: that a body winds up is common to all teeth in mesh.
    """
    unsaid = "foundation" not in gear.given | mesh.given
    if unsaid and gear.body.kind == "condensed":
        return WeberFoundation()
    return _FOUNDATIONS[gear.foundation or mesh.foundation]()


def _mount(
    gear: GearKeys, material: Material, plain: tuple[GearKeys, Material], sense: int
) -> Support | Shaft:
    """A gear's shaft on its bearings, or the springs at its centre."""
    if gear.shaft.gear_at_mm is None:
        springs = gear.support
        s, t = springs.radial_S_N_m, springs.radial_T_N_m
        return Support(
            radial_s=springs.radial_N_m if s is None else s,
            radial_t=springs.radial_N_m if t is None else t,
            axial=springs.axial_N_m,
            tilt=springs.tilt_Nm_rad,
        )
    with jax.ensure_compile_time_eval():
        layout = _shaft(*plain, None, sense).layout
    return _shaft(gear, material, layout, sense)


def _shaft(gear: GearKeys, material: Material, layout: ShaftLayout | None, sense: int) -> Shaft:
    """The shaft of a gear, with nodes as laid out before, if it was."""
    shaft = gear.shaft
    vector = lambda entries, signs: jnp.stack(
        [sign * jnp.asarray(x, dtype=float) for x, sign in zip(entries, signs, strict=True)]
    )
    # A force is mirrored, a moment turns the other way round.
    forces, moments = (1, sense, 1), (sense, 1, sense)
    return Shaft(
        [
            Segment(si(each.length_mm, mm), si(each.outer_mm, mm), si(each.inner_mm, mm))
            for each in shaft.segments
        ],
        [_bearing(each) for each in shaft.bearings],
        gear_at=si(shaft.gear_at_mm, mm),
        torque_at=si(shaft.torque_at_mm, mm),
        loads=[
            ShaftLoad(
                si(each.at_mm, mm),
                vector(each.force_N, forces),
                vector(each.moment_Nm, moments),
            )
            for each in shaft.loads
        ]
        # No load in statics, but a node.
        + [ShaftLoad(si(each.at_mm, mm)) for each in shaft.unbalance],
        shear_coefficient=si(shaft.shear_coeff),
        material=material,
        body_width=si(gear.face_width_mm, mm) if gear.body.kind == "beam" else None,
        divisions=shaft.divisions or 1,
        layout=layout,
    )


def _bearing(row: BearingKeys) -> Bearing:
    """One bearing; what is not said of one direction is what is said of both, or nothing."""
    first = lambda *values: next((si(value) for value in values if value is not None), 0.0)
    return Bearing(
        si(row.at_mm, mm),
        first(row.radial_S_N_m, row.radial_N_m),
        first(row.radial_T_N_m, row.radial_N_m),
        first(row.axial_N_m),
        first(row.tilt_S_Nm_rad, row.tilt_Nm_rad),
        first(row.tilt_T_Nm_rad, row.tilt_Nm_rad),
    )


def shared_places(model: PairModel) -> dict[str, str]:
    """Keys of points on shafts that lie where another point does, and which one moves them."""
    found = {}
    for name, mount in zip(GEARS, (model.pinion_support, model.wheel_support), strict=True):
        if isinstance(mount, Shaft):
            guests, root = mount.layout.guests, f"{name}.shaft"
            keys = {
                "gear": "gear_at_mm",
                # Unless it is given it enters at the gear.
                **({} if mount.torque_at is None else {"torque": "torque_at_mm"}),
                **{f"bearing {i}": f"bearings[{i}].at_mm" for i in range(len(mount.bearings))},
                **{f"load {i}": f"loads[{i}].at_mm" for i in range(len(mount.loads))},
            }
            found |= {
                f"{root}.{key}": guests[point] for point, key in keys.items() if point in guests
            }
    return found


def _body(body: BodyKeys, pair: GearPair, name: str, mount: Support | Shaft) -> AbstractGearBody:
    """A gear's body; a rigid one is a disc from bore to root circle, but for what is given."""
    index = GEARS.index(name)
    if body.kind == "beam":
        gear, root = (pair.pinion, pair.wheel)[index], 2.0 * pair.root_radius[index]
        return BeamBody(width=gear.face_width, outer=root, material=gear.material)
    given = {
        "mass": body.mass_kg,
        "polar_inertia": body.inertia_kg_m2,
        "transverse_inertia": body.transverse_inertia_kg_m2,
    }
    return gear_disc(
        pair, index, mount, **{key: si(each) for key, each in given.items() if each is not None}
    )


def _condensed_body(scene: Scene, name: str) -> FlexibleBody:
    """The condensed body that was built for the scene, unless the scene has left it behind."""
    varied = [key for key in scene.moved if scene.remakes(key, name)]
    if varied:
        raise InputError(
            f"The {name}'s body is condensed finite elements, whose numbers do not follow "
            f"{', '.join(sorted(varied))}: there is no derivative. Vary keys of flanks, torque, "
            "bearing stiffnesses, misalignment, temperatures, Young's modulus or density, or make "
            "the body rigid."
        )
    if name not in scene.bodies:
        raise InputError(
            f"The {name}'s condensed body has not been built for this scene: use "
            "`with_bodies(scene)` first, and again after other changes than of flanks and loads."
        )
    # Shape and material are those that the scene now says, which may be traced.
    each = scene.bodies[name]
    body = each.flexible if each.family is None else each.family(scene.value(each.follows))
    own = scene.gear(name).body
    body = warmed(body, name, own.temperature)
    if own.superelement is not None:
        # Matrices made elsewhere are of a material that no key names.
        return body
    now, made = material_of(scene, name), each.built.plan.material
    young = now.young if own.young_GPa is None else si(own.young_GPa, GPa)
    stiffer, denser = young / made.young, now.density / made.density
    if all(not isinstance(x, Tracer) and float(x) == 1.0 for x in (stiffer, denser)):
        return body
    return scaled_body(body, young=stiffer, density=denser)


def couples_on_pinion(shaft: ShaftKeys, sense: int = 1) -> float:
    """Sum of the couples about Z on the pinion's shaft, which help its drive [N m]."""
    return sense * float(sum(load.moment_Nm[2] for load in shaft.loads))
