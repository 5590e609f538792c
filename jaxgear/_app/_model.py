"""From the scene's file units to the library's SI: the only place where they meet.

Every function here can be traced by JAX: real values of the scene may be tracers, so that a
response can be differentiated by any real key of the file.
"""

import jax.numpy as jnp

from jaxgear._app._scene import Scene
from jaxgear._contact._cells import Misalignment
from jaxgear._contact._compliance import (
    AbstractCompliance,
    ConstantStiffness,
    Iso6336,
    WeberBanaschek,
)
from jaxgear._contact._foundation import AbstractFoundation, NoFoundation, WeberFoundation
from jaxgear._flank._deviations import (
    Crowning,
    EndRelief,
    Flanks,
    HelixSlope,
    RootRelief,
    Superposed,
    TipRelief,
)
from jaxgear._geometry._gear import Gear, Material
from jaxgear._geometry._lines import MeshGrid, mesh_grid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._system._model import PairModel
from jaxgear._system._support import Support
from jaxgear._types import Scalar
from jaxgear._units import GPa, N_per_mm_um, deg, mm, um


def model_of(scene: Scene) -> PairModel:
    """Build the model that a scene describes.

    **Arguments:**

    - `scene`: checked against the schema; its real values may be traced.

    **Returns:**

    The model, in SI.

    **Raises:**

    - `ValueError` if the gears are impossible.
    """
    return PairModel(
        pair=_pair(scene),
        torque=_real(scene, "pair.torque_pinion_Nm"),
        flanks=flanks_of(scene),
        compliance=_compliance(scene),
        pinion_support=_support(scene, "pinion"),
        wheel_support=_support(scene, "wheel"),
        misalignment=Misalignment(
            inclination=_real(scene, "pair.misalignment_inclination_um") * um,
            deviation=_real(scene, "pair.misalignment_deviation_um") * um,
        ),
    )


def flanks_of(scene: Scene) -> Flanks:
    """The flank corrections of a scene."""
    return Flanks(pinion=_flank(scene, "pinion"), wheel=_flank(scene, "wheel"))


def grid_of(scene: Scene, model: PairModel) -> MeshGrid:
    """Choose the grid that a scene asks for, for its model or one close to it."""
    return mesh_grid(model.pair, phases=scene["mesh.phases"], slices=scene["mesh.slices"])


def smooth_law_of(scene: Scene) -> SmoothContact:
    """The smooth contact law with the scene's width."""
    return SmoothContact(width=_real(scene, "mesh.smoothing_um") * um)


def law_of(scene: Scene) -> AbstractContactLaw:
    """The contact law that a scene asks for."""
    return ExactContact() if scene["mesh.contact"] == "exact" else smooth_law_of(scene)


def _real(scene: Scene, key: str) -> Scalar:
    return jnp.asarray(scene[key], dtype=float)


def _pair(scene: Scene) -> GearPair:
    centre_distance = scene.get("pair.centre_distance_mm")
    return GearPair(
        pinion=_gear(scene, "pinion"),
        wheel=_gear(scene, "wheel"),
        normal_module=_real(scene, "pair.module_mm") * mm,
        pressure_angle=_real(scene, "pair.pressure_angle_deg") * deg,
        helix_angle=_real(scene, "pair.helix_angle_deg") * deg,
        centre_distance=None if centre_distance is None else centre_distance * mm,
    )


def _gear(scene: Scene, name: str) -> Gear:
    bore = scene.get(f"{name}.bore_mm")
    return Gear(
        teeth=scene[f"{name}.teeth"],
        face_width=_real(scene, f"{name}.face_width_mm") * mm,
        profile_shift=_real(scene, f"{name}.profile_shift"),
        addendum=_real(scene, f"{name}.addendum_coeff"),
        dedendum=_real(scene, f"{name}.dedendum_coeff"),
        fillet_radius=_real(scene, f"{name}.fillet_radius_coeff"),
        tip_shortening=_real(scene, f"{name}.tip_shortening_coeff"),
        bore=None if bore is None else bore * mm,
        material=_material(scene, name),
    )


def _material(scene: Scene, name: str) -> Material:
    def own(key: str) -> Scalar:
        path = f"{name}.material.{key}"
        return _real(scene, path if path in scene.values else f"material.{key}")

    return Material(
        young=own("young_GPa") * GPa, poisson=own("poisson"), density=own("density_kg_m3")
    )


def _flank(scene: Scene, name: str) -> Superposed:
    root = f"flank.{name}"
    side = scene[f"{root}.end_relief.side"]
    return Superposed(
        parts=(
            TipRelief(*_relief(scene, f"{root}.tip_relief")),
            RootRelief(*_relief(scene, f"{root}.root_relief")),
            EndRelief(
                *_relief(scene, f"{root}.end_relief"), left=side != "right", right=side != "left"
            ),
            Crowning(_real(scene, f"{root}.crowning_um") * um),
            HelixSlope(_real(scene, f"{root}.helix_slope_um") * um),
        )
    )


def _relief(scene: Scene, root: str) -> tuple[Scalar, Scalar, int]:
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
            return WeberBanaschek(_foundation(scene, "pinion"), _foundation(scene, "wheel"))


def _foundation(scene: Scene, name: str) -> AbstractFoundation:
    chosen = scene.get(f"{name}.foundation", scene["mesh.foundation"])
    return NoFoundation() if chosen == "none" else WeberFoundation()


def _support(scene: Scene, name: str) -> Support:
    root = f"{name}.support"
    radial = scene.get(f"{root}.radial_N_m")
    return Support(
        radial_s=scene.get(f"{root}.radial_S_N_m", radial),
        radial_t=scene.get(f"{root}.radial_T_N_m", radial),
        axial=scene.get(f"{root}.axial_N_m"),
        tilt=scene.get(f"{root}.tilt_Nm_rad"),
    )
