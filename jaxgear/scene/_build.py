"""From the scene's file units to the library's SI: the only place where they meet.

Every function here can be traced by JAX: real values of the scene may be tracers, so that a
response can be differentiated by any real key of the file.
"""

from collections.abc import Callable
from typing import Any

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
from jaxgear._contact._foundation import (
    AbstractFoundation,
    NoFoundation,
    RingFoundation,
    SainsotFoundation,
    WeberFoundation,
)
from jaxgear._flank._deviations import (
    AbstractFlankDeviation,
    Bias,
    Crowning,
    EllipticalCrowning,
    EndRelief,
    Flanks,
    HelixSlope,
    ProfileCrowning,
    ProfileSlope,
    RootRelief,
    Superposed,
    TipRelief,
)
from jaxgear._flank._indexing import Indexing
from jaxgear._flank._tolerances import GradeWaveform, deviation_of_grade, pitch_error_of_grade
from jaxgear._geometry._backlash import check_backlash
from jaxgear._geometry._gear import Gear, Material
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
from jaxgear._units import GPa, N_per_mm_um, deg, mm, um
from jaxgear.scene._files import (
    check_covers,
    deviation_of_table,
    read_matrix,
    read_profile,
    read_topography,
)
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS

# A number of a scene in SI: in NumPy, or traced.
Number = Scalar | float


def model_of(scene: Scene) -> PairModel:
    """Build the model that a scene describes.

    **Arguments:**

    - `scene`: checked against the schema; its real values may be traced.

    **Returns:**

    The model, in SI.

    **Raises:**

    - `ValueError` if the gears are impossible, or if a condensed body has not been built or cannot
        follow what is traced.
    """
    pair = pair_of(scene)
    mounts = [_mount(scene, name) for name in GEARS]
    return PairModel(
        pair=pair,
        torque=_real(scene, "pair.torque_pinion_Nm"),
        flanks=flanks_of(scene, pair),
        compliance=_compliance(scene),
        pinion_support=mounts[0],
        wheel_support=mounts[1],
        misalignment=Misalignment(
            inclination=_real(scene, "pair.misalignment_inclination_um") * um,
            deviation=_real(scene, "pair.misalignment_deviation_um") * um,
        ),
        pinion_body=_body(scene, pair, "pinion", mounts[0]),
        wheel_body=_body(scene, pair, "wheel", mounts[1]),
        housing=_housing(scene),
        speed=_real(scene, key) if scene.get(key := "mesh.pinion_speed_rad_s") is not None else 0.0,
    )


def flanks_of(scene: Scene, pair: GearPair) -> Flanks:
    """The flank deviations of a scene.

    **Arguments:**

    - `scene`: checked against the schema.
    - `pair`: its gears, for what is given in millimetres on the flank or as a grade.

    **Returns:**

    The deviations, in SI.

    **Raises:**

    - `ValueError` if a file of measured deviations is unreadable or does not cover its flank.
    """
    return Flanks(
        pinion=_flank(scene, pair, "pinion"),
        wheel=_flank(scene, pair, "wheel"),
        pinion_indexing=_indexing(scene, pair, "pinion"),
        wheel_indexing=_indexing(scene, pair, "wheel"),
    )


def grid_of(scene: Scene, model: PairModel) -> MeshGrid:
    """Choose the grid that a scene asks for, for its model or one close to it."""
    return pair_grid(scene, model.pair, model.mesh_torque)


def pair_grid(scene: Scene, pair: GearPair, torque: Scalar) -> MeshGrid:
    """As `grid_of`, of the pair alone under a torque on the mesh."""
    return mesh_grid(
        pair,
        phases=scene["mesh.phases"],
        slices=scene["mesh.slices"],
        periods=scene["mesh.periods"],
        beyond=_tip_window(scene, pair, torque) if scene["mesh.tip_contact"] else 0.0,
        # Condensed bodies do not follow the face anyway, and every line costs.
        fixed_face=bool(scene.condensed),
    )


# A stiffness that few tooth pairs fall below [N/m2], and the highest torque of a Harris map over
# the scene's own.
_SOFT, _OVERLOAD = 10.0 * N_per_mm_um, 1.5


def _tip_window(scene: Scene, pair: GearPair, torque: Scalar) -> float:
    """How far beyond the path tip corners may touch, in base pitches: as far as teeth can bend.

    A window is no smoothing: one that is wide enough changes nothing, and one that is not
    is refused once it is solved.
    """
    most = max([_OVERLOAD * float(torque), *scene.get("map.torques_Nm", [])])
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


def smooth_law_of(scene: Scene) -> SmoothContact:
    """The smooth contact law with the scene's width."""
    return SmoothContact(width=_real(scene, "mesh.smoothing_um") * um)


def law_of(scene: Scene) -> AbstractContactLaw:
    """The contact law that a scene asks for."""
    return ExactContact() if scene["mesh.contact"] == "exact" else smooth_law_of(scene)


def _real(scene: Scene, key: str) -> Number:
    return _plain(scene[key])


def _plain(value: Any) -> Number:
    """A number of a scene; in NumPy, whose arithmetic is not compiled, unless JAX traces it."""
    return value if isinstance(value, Tracer | jax.Array) else np.float64(value)


def pair_of(scene: Scene) -> GearPair:
    """The gears of a scene.

    **Arguments:**

    - `scene`: checked against the schema; its real values may be traced.

    **Returns:**

    The pair, in SI.

    **Raises:**

    - `ValueError` if the gears are impossible.
    """
    centre_distance = scene.get("pair.centre_distance_mm")
    pair = GearPair(
        pinion=_gear(scene, "pinion"),
        wheel=_gear(scene, "wheel"),
        normal_module=_real(scene, "pair.module_mm") * mm,
        pressure_angle=_real(scene, "pair.pressure_angle_deg") * deg,
        helix_angle=_real(scene, "pair.helix_angle_deg") * deg,
        centre_distance=None if centre_distance is None else centre_distance * mm,
    )
    check_backlash(pair)
    return pair


def _gear(scene: Scene, name: str) -> Gear:
    allowance = scene.get(f"{name}.thickness_allowance_um")
    # A bore of zero is none, which is a matter of the program and not of its numbers.
    has_bore = scene.get(f"{name}.bore_mm") is not None and scene.concrete(f"{name}.bore_mm") > 0.0
    return Gear(
        teeth=scene[f"{name}.teeth"],
        face_width=_real(scene, f"{name}.face_width_mm") * mm,
        profile_shift=_real(scene, f"{name}.profile_shift"),
        addendum=_real(scene, f"{name}.addendum_coeff"),
        dedendum=_real(scene, f"{name}.dedendum_coeff"),
        fillet_radius=_real(scene, f"{name}.fillet_radius_coeff"),
        tip_shortening=_real(scene, f"{name}.tip_shortening_coeff"),
        bore=_real(scene, f"{name}.bore_mm") * mm if has_bore else None,
        material=_material(scene, name),
        thickness_allowance=None if allowance is None else allowance * um,
    )


def _material(scene: Scene, name: str, read: Callable[[str], Any] | None = None) -> Material:
    def own(key: str) -> Number:
        path = f"{name}.material.{key}"
        path = path if path in scene.values else f"material.{key}"
        return _plain((read or scene.__getitem__)(path))

    return Material(
        young=own("young_GPa") * GPa, poisson=own("poisson"), density=own("density_kg_m3")
    )


def _flank(scene: Scene, pair: GearPair, name: str) -> Superposed:
    root = f"flank.{name}"
    side = scene[f"{root}.end_relief.side"]
    amount = lambda key: _real(scene, f"{root}.{key}_um") * um
    return Superposed(
        parts=(
            TipRelief(*_relief(scene, f"{root}.tip_relief")),
            RootRelief(*_relief(scene, f"{root}.root_relief")),
            EndRelief(
                *_relief(scene, f"{root}.end_relief"), left=side != "right", right=side != "left"
            ),
            Crowning(amount("crowning")),
            EllipticalCrowning(amount("elliptical_crowning")),
            ProfileCrowning(amount("profile_crowning")),
            HelixSlope(amount("helix_slope")),
            ProfileSlope(amount("profile_slope")),
            Bias(amount("bias")),
            *_measured(scene, pair, name),
            *_graded(scene, pair, name),
        )
    )


def _measured(scene: Scene, pair: GearPair, name: str) -> list[AbstractFlankDeviation]:
    """Deviations that a scene gives as files."""
    found = []
    for key, read in (("profile_deviation_csv", read_profile), ("topography_csv", read_topography)):
        file = scene.get(f"flank.{name}.{key}")
        if file is not None:
            table = read(file, scene.path.parent)
            check_covers(table, pair, GEARS.index(name))
            found.append(deviation_of_table(table, pair, GEARS.index(name)))
    return found


def _graded(scene: Scene, pair: GearPair, name: str) -> list[AbstractFlankDeviation]:
    """Deviations that a scene gives as a tolerance grade."""
    if scene.get(f"flank.{name}.accuracy_grade") is None:
        return []
    grade = _real(scene, f"flank.{name}.accuracy_grade")
    return [deviation_of_grade(pair, GEARS.index(name), grade, _waveform(scene, name))]


def _waveform(scene: Scene, name: str) -> GradeWaveform:
    slope = 1.0 if scene[f"flank.{name}.accuracy_slopes"] else 0.0
    waves = float(scene[f"flank.{name}.accuracy_waves"])
    # Equal profile slopes cancel in mesh, for a pinion's tip meets the wheel's root; these add up.
    towards = 1.0 if name == "pinion" else -1.0
    return GradeWaveform(waves=waves, profile_slope=towards * slope, helix_slope=slope)


def _indexing(scene: Scene, pair: GearPair, name: str) -> Indexing | None:
    """Pitch errors and eccentricity, or `None` where the scene speaks of neither."""
    root = f"flank.{name}"
    # A grade's pitch errors are a wave over the revolution: one mesh period sees nothing of it.
    graded = scene.get(f"{root}.accuracy_grade") is not None and scene["mesh.periods"] > 1
    keys = ("pitch_error_um", "eccentricity_um", "eccentricity_angle_deg")
    if not graded and not any(f"{root}.{key}" in scene.given for key in keys):
        return None
    error = jnp.stack([jnp.asarray(x, dtype=float) for x in scene[f"{root}.pitch_error_um"]]) * um
    if graded:
        grade = _real(scene, f"{root}.accuracy_grade")
        error = error + pitch_error_of_grade(pair, GEARS.index(name), grade, _waveform(scene, name))
    return Indexing(
        pitch_error=error,
        eccentricity=_real(scene, f"{root}.eccentricity_um") * um,
        eccentricity_angle=_real(scene, f"{root}.eccentricity_angle_deg") * deg,
    )


def _relief(scene: Scene, root: str) -> tuple[Number, Number, int]:
    """Depth, extent and exponent of a relief."""
    exponent = {"linear": 1, "parabolic": 2}[scene[f"{root}.shape"]]
    return _real(scene, f"{root}.depth_um") * um, _real(scene, f"{root}.extent"), exponent


def _compliance(scene: Scene) -> AbstractCompliance:
    match scene["mesh.stiffness"]:
        case "constant":
            return ConstantStiffness(_real(scene, "mesh.stiffness_N_mm_um") * N_per_mm_um)
        case "iso6336":
            return Iso6336()
        case _:
            return WeberBanaschek(
                pinion_foundation=_foundation(scene, "pinion"),
                wheel_foundation=_foundation(scene, "wheel"),
                load_updates=scene["mesh.line_load_updates"],
            )


_FOUNDATIONS = {
    "weber": WeberFoundation,
    "sainsot": SainsotFoundation,
    "ring": RingFoundation,
    "none": NoFoundation,
}


def _foundation(scene: Scene, name: str) -> AbstractFoundation:
    """What gives under the teeth of a gear.

    Under those of a condensed body it counts in the figures of a single pair only. Unless said
    otherwise it is what is near a root: that a body winds up is common to all teeth in mesh.
    """
    unsaid = not {f"{name}.foundation", "mesh.foundation"} & set(scene.given)
    if unsaid and name in scene.condensed:
        return WeberFoundation()
    return _FOUNDATIONS[scene.get(f"{name}.foundation", scene["mesh.foundation"])]()


def _mount(scene: Scene, name: str) -> Support | Shaft:
    """A gear's shaft on its bearings, or the springs at its centre."""
    if scene.get(f"{name}.shaft.gear_at_mm") is None:
        return _support(scene, name)
    # Which points share a node follows from the last numbers that were not traced.
    with jax.ensure_compile_time_eval():
        layout = _shaft(scene, name, scene.concrete, None).layout
    return _shaft(scene, name, scene.__getitem__, layout)


def _shaft(
    scene: Scene, name: str, read: Callable[[str], Any], layout: ShaftLayout | None
) -> Shaft:
    """The shaft of a scene, its numbers read by `read`."""
    root = f"{name}.shaft"

    def number(key: str, unit: float, default: float | None = None) -> Number | None:
        if scene.get(key) is None:
            return default
        return _plain(read(key)) * unit

    def vector(key: str) -> Array:
        return jnp.stack([jnp.asarray(x, dtype=float) for x in read(key)])

    segments = [
        Segment(*(number(f"{row}.{key}_mm", mm, 0.0) for key in ("length", "outer", "inner")))
        for row in scene.rows(f"{root}.segments")
    ]
    bearings = [
        Bearing(
            number(f"{row}.at_mm", mm),
            *(
                number(f"{row}.{own}", 1.0, 0.0)
                if scene.get(f"{row}.{own}") is not None
                else number(f"{row}.{shared}", 1.0, 0.0)
                for own, shared in (
                    ("radial_S_N_m", "radial_N_m"),
                    ("radial_T_N_m", "radial_N_m"),
                    ("axial_N_m", "axial_N_m"),
                    ("tilt_S_Nm_rad", "tilt_Nm_rad"),
                    ("tilt_T_Nm_rad", "tilt_Nm_rad"),
                )
            ),
        )
        for row in scene.rows(f"{root}.bearings")
    ]
    loads = [
        ShaftLoad(number(f"{row}.at_mm", mm), vector(f"{row}.force_N"), vector(f"{row}.moment_Nm"))
        for row in scene.rows(f"{root}.loads")
    ]
    beam = scene[f"{name}.body.kind"] == "beam"
    return Shaft(
        segments,
        bearings,
        gear_at=number(f"{root}.gear_at_mm", mm),
        torque_at=number(f"{root}.torque_at_mm", mm),
        loads=loads,
        shear_coefficient=number(f"{root}.shear_coeff", 1.0),
        material=_material(scene, name, read),
        body_width=number(f"{name}.face_width_mm", mm) if beam else None,
        divisions=scene.get(f"{root}.divisions", 1),
        layout=layout,
    )


def shared_places(scene: Scene, model: PairModel) -> dict[str, str]:
    """Keys of points on shafts that lie where another point does, and which one moves them.

    **Arguments:**

    - `scene`: with or without shafts.
    - `model`: its model.

    **Returns:**

    The owner of the place, such as "bearing 0", under each key that has no effect by itself.
    """
    found = {}
    for name, mount in zip(GEARS, (model.pinion_support, model.wheel_support), strict=True):
        if isinstance(mount, Shaft):
            guests, root = mount.layout.guests, f"{name}.shaft"
            keys = {
                "gear": "gear_at_mm",
                "torque": "torque_at_mm",
                **{f"bearing {i}": f"bearings[{i}].at_mm" for i in range(len(mount.bearings))},
                **{f"load {i}": f"loads[{i}].at_mm" for i in range(len(mount.loads))},
            }
            found |= {
                f"{root}.{key}": guests[point] for point, key in keys.items() if point in guests
            }
    return {key: owner for key, owner in found.items() if scene.get(key) is not None}


def _support(scene: Scene, name: str) -> Support:
    root = f"{name}.support"
    radial = scene.get(f"{root}.radial_N_m")
    return Support(
        radial_s=scene.get(f"{root}.radial_S_N_m", radial),
        radial_t=scene.get(f"{root}.radial_T_N_m", radial),
        axial=scene.get(f"{root}.axial_N_m"),
        tilt=scene.get(f"{root}.tilt_Nm_rad"),
    )


def _body(scene: Scene, pair: GearPair, name: str, mount: Support | Shaft) -> AbstractGearBody:
    """A gear's body; a rigid one is a disc from bore to root circle, but for what is given."""
    index = GEARS.index(name)
    if scene[f"{name}.body.kind"] == "condensed":
        return _condensed_body(scene, name)
    if scene[f"{name}.body.kind"] == "beam":
        gear, root = (pair.pinion, pair.wheel)[index], 2.0 * pair.root_radius[index]
        return BeamBody(width=gear.face_width, outer=root, material=gear.material)
    given = {
        field: _real(scene, f"{name}.body.{key}")
        for field, key in (
            ("mass", "mass_kg"),
            ("polar_inertia", "inertia_kg_m2"),
            ("transverse_inertia", "transverse_inertia_kg_m2"),
        )
        if scene.get(f"{name}.body.{key}") is not None
    }
    return gear_disc(pair, index, mount, **given)


def _condensed_body(scene: Scene, name: str) -> FlexibleBody:
    """The condensed body that was built for the scene, unless the scene has left it behind."""
    varied = [key for key in scene.known if scene.remakes(key, name)]
    if varied:
        raise InputError(
            f"The {name}'s body is condensed finite elements, whose numbers do not follow "
            f"{', '.join(sorted(varied))}: there is no derivative. Vary keys of flanks, torque, "
            "bearing stiffnesses, misalignment, Young's modulus or density, or make the body "
            "rigid."
        )
    if name not in scene.bodies:
        raise InputError(
            f"The {name}'s condensed body has not been built for this scene: use "
            "`with_bodies(scene)` first, and again after other changes than of flanks and loads."
        )
    return _of_its_material(scene, name, scene.bodies[name])


def _of_its_material(scene: Scene, name: str, each: Any) -> FlexibleBody:
    """A body of the shape and the material that the scene now says, which may be traced."""
    body = each.flexible if each.family is None else each.family(scene[each.follows])
    if scene.get(f"{name}.body.superelement") is not None:
        # Matrices made elsewhere are of a material that no key names.
        return body
    now, made = _material(scene, name), each.built.plan.material
    own = scene.get(f"{name}.body.young_GPa")
    stiffer = (now.young if own is None else jnp.asarray(own) * GPa) / made.young
    denser = now.density / made.density
    if all(not isinstance(x, Tracer) and float(x) == 1.0 for x in (stiffer, denser)):
        return body
    return scaled_body(body, young=stiffer, density=denser)


def _housing(scene: Scene) -> Housing | None:
    file = scene.get("housing.stiffness_csv")
    return None if file is None else Housing(read_matrix(file, scene.path.parent))


def couples_on_pinion(scene: Scene) -> float:
    """Sum of the couples about Z on the pinion's shaft, which help its drive [N m]."""
    rows = scene.rows("pinion.shaft.loads")
    return float(sum(scene[f"{row}.moment_Nm"][2] for row in rows))
