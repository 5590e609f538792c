"""Remarks that a reader of results should not miss: where a model is outgrown, or sees nothing."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jaxgear._contact._sainsot import SAINSOT_RADIUS_RATIO
from jaxgear._geometry._pair import pair_facts
from jaxgear._system._gear_body import BeamBody
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft
from jaxgear._units import mm, um
from jaxgear.scene._gear_tables import FlanksKeys, GearKeys
from jaxgear.scene._schema import GEARS
from jaxgear.scene._tables import MeshKeys
from jaxgear.study._built import BuiltScene
from jaxgear.study._ranks import Doubtful, Idle
from jaxgear.study._statics import Numbers, Statics

# Fewer slices do not tell a tenth of the face.
_ENOUGH = 8
# Helix angle from which slices of teeth are told to be off [deg]; below, nobody compared them.
_HELICAL = 5.0


def notes(built: BuiltScene, statics: Statics) -> list[str]:
    """Remarks on a solved scene, a sentence or two each; none where there is nothing to say."""
    scene = built.scene
    return [
        *_on_teeth(scene.mesh, scene.gears),
        *_on_helical_teeth(scene.mesh, scene.pair.helix_angle_deg),
        *(_on_coarse_teeth(built.teeth.coarser()) if built.teeth else ()),
        *_on_roots(scene.mesh, scene.gears, statics.model),
        *_on_foundations(scene.mesh, scene.gears, statics.model),
        *_on_shafts(statics.model),
        *_on_bodies(scene.gears),
        *_on_unbalance(scene.gears, swept=scene.sweep.is_given),
        *_on_condensed(scene.mesh, scene.gears, scene.bodies),
        *_on_cycle(scene.mesh, scene.gears, scene.flank),
        *_on_results(scene.mesh.slices, statics),
    ]


def _on_teeth(mesh: MeshKeys, gears: Mapping[str, GearKeys]) -> Iterator[str]:
    """Keys of the mesh that this model of its teeth does not look at."""
    whole = mesh.tooth == "elements"
    asked = "face_coupling" in mesh.given and mesh.face_coupling == "coupled"
    if asked and (whole or mesh.stiffness != "weber-banaschek"):
        why = "elements of whole teeth feel all of their face" if whole else "no part of it spreads"
        yield Idle(f"mesh.face_coupling does nothing to this model of the teeth: {why}.")
    given = [name for name, each in {"mesh": mesh, **gears}.items() if "foundation" in each.given]
    if whole and given:
        yield Idle(
            f"{given[0]}.foundation does nothing: elements of whole teeth stand on rings of their "
            "own."
        )


def _on_helical_teeth(mesh: MeshKeys, helix_angle: float) -> Iterator[str]:
    """Slices of helical teeth, which finite elements do not confirm: docs/accuracy.md."""
    sliced = mesh.tooth == "sliced" and mesh.stiffness == "weber-banaschek"
    if not sliced or abs(helix_angle) < _HELICAL:
        return
    off = {
        "coupled": "mean transmission error 1 to 6 % low, its RMS up to 8 % off (25 % on a narrow "
        "face), pressures 7 to 9 % high",
        "none": "mean transmission error up to 8 % and its RMS up to 39 % off, pressures 16 to "
        "35 % low",
    }[mesh.face_coupling]
    yield (
        f"Slices of helical teeth are not those of finite elements: {off} at 15 and 30 degrees. "
        'mesh.tooth = "elements" shows what holds for these gears.'
    )


def _on_coarse_teeth(coarser: Iterable[tuple[str, float]]) -> Iterator[str]:
    """Teeth of elements that are larger than they should be, and what that costs [-]."""
    for gear, error in coarser:
        yield (
            f"The {gear}'s teeth are divided more coarsely than narrow spur teeth, so that "
            f"their unknowns fit 4 GB: deflections of the gear are off by up to "
            f"{100.0 * error:.2g} % of those by an even load."
        )


# Over the height of a tooth: from thinner rims on ISO 6336-3 has a rim factor.
_THIN_RIM = 1.2


def _on_roots(mesh: MeshKeys, gears: Mapping[str, GearKeys], model: PairModel) -> Iterator[str]:
    """Strengths without stresses, stresses without strengths, and rims that may bend."""
    has = {gear: each.root_strength_MPa is not None for gear, each in gears.items()}
    if not mesh.root_stress:
        for key in (f"{gear}.root_strength_MPa" for gear in GEARS if has[gear]):
            yield Idle(f"{key} does nothing: write mesh.root_stress = true for a safety.")
        return
    if lacking := [f"{gear}.root_strength_MPa" for gear in GEARS if not has[gear]]:
        yield (
            f"Root stress has no safety without {' and '.join(lacking)}: give the stress sigma_FG "
            "of ISO 6336-3 that the roots bear [MPa], with life, notch and size factors in it."
        )
    for place, gear in enumerate(GEARS):
        root, tip = float(model.pair.root_radius[place]), float(model.pair.tip_radius[place])
        rim = (root - 0.5 * mm * (gears[gear].bore_mm or 0.0)) / (tip - root)
        if rim < _THIN_RIM:
            yield Doubtful(
                f"The {gear}'s rim is {rim:.2g} tooth heights thick. The calculated root stress "
                "holds it at bore_mm; where it can bend, stress is higher, which is in the nominal "
                "one by the factor Y_B."
            )


def _on_foundations(
    mesh: MeshKeys, gears: Mapping[str, GearKeys], model: PairModel
) -> Iterator[str]:
    if mesh.tooth == "elements":
        return
    if mesh.stiffness != "weber-banaschek":
        if mesh.line_load_updates:
            yield Idle("mesh.line_load_updates does nothing to this mesh.stiffness.")
        return
    chosen = [gears[gear].foundation or mesh.foundation for gear in GEARS]
    if "sainsot" in chosen:
        yield Doubtful(
            "Sainsot's foundation is for single-pair stiffness only: it counts the wind-up of "
            "a body once per tooth pair, and the transmission error fluctuates far too much. "
            'Use mesh.foundation = "ring", which couples the teeth.'
        )
    least, most = SAINSOT_RADIUS_RATIO
    for gear, foundation, ratio in zip(GEARS, chosen, _radius_ratios(model), strict=True):
        if foundation == "sainsot" and not least <= ratio <= most:
            yield (
                f"Sainsot's fit holds for root circle over bore of {least:g} to {most:g}; the "
                f"{gear} has {ratio:.3g}."
            )
    yield from _under_beams(chosen, model)


# Root circle over bore: compared were tubes of 1.30 and 1.46, where Weber's half-planes are closer
# to bricks, and of 1.63, 1.94 and 3.5, where a ring is (docs/accuracy.md).
_TUBE = 1.55


def _under_beams(chosen: Sequence[str], model: PairModel) -> Iterator[str]:
    """Foundations of gears that are beams, as the same bodies in bricks judge them."""
    bodies = (model.pinion_body, model.wheel_body)
    mounts = (model.pinion_support, model.wheel_support)
    for gear, foundation, mount, body in zip(GEARS, chosen, mounts, bodies, strict=True):
        if not (isinstance(body, BeamBody) and isinstance(mount, Shaft)):
            continue
        outer, bore = float(body.outer), float(mount.body_beam(body.piece).inner)
        if foundation == "ring" and outer < _TUBE * bore:
            yield Doubtful(
                f"The {gear} is a beam, a tube of {outer / bore:.3g} diameters: on so thin ones a "
                "ring has 5 to 11 % less RMS of transmission error than bricks. Write "
                f'{gear}.foundation = "weber", which has 4 % less to 1 % more.'
            )
        if foundation == "weber" and outer >= _TUBE * bore > 0.0:
            yield (
                f"The {gear} is a beam on Weber's half-planes: so thick ones had 1 to 9 % less "
                "mean transmission error than bricks and 2 to 4 % more RMS, on a ring at most 2 % "
                f'less mean and 1 to 3 % less RMS. {gear}.foundation = "ring" and {gear}.bore_mm = '
                f"{bore / mm:g}, that of the shaft, give it one."
            )


def _radius_ratios(model: PairModel) -> list[float]:
    """Root circle over bore of both gears; infinite without a bore [-]."""
    radii = np.asarray(pair_facts(model.pair).root_radius)
    bores = [model.pair.pinion.bore, model.pair.wheel.bore]
    return [
        np.inf if bore is None else 2.0 * float(radius) / float(bore)
        for radius, bore in zip(radii, bores, strict=True)
    ]


def _on_shafts(model: PairModel) -> Iterator[str]:
    for name, gear, mount, body in zip(
        GEARS,
        (model.pair.pinion, model.pair.wheel),
        (model.pinion_support, model.wheel_support),
        (model.pinion_body, model.wheel_body),
        strict=True,
    ):
        if not isinstance(mount, Shaft):
            continue
        if isinstance(body, BeamBody):
            slender = float(body.width / body.outer)
            if slender < 0.5:
                yield f"The {name}'s body is {slender:.2g} as long as thick: a disc, not a beam."
            continue
        thick = float(mount.diameter_at_gear)
        if gear.bore is not None and thick > float(gear.bore):
            yield (
                f"{name}.bore_mm, where the body is held, lies within its shaft of {thick / mm:g} "
                "mm."
            )
        ends = float(mount.gear_at) + 0.5 * float(gear.face_width) * np.array([-1.0, 1.0])
        length = sum(float(segment.length) for segment in mount.segments)
        if ends[0] < -1e-9 or ends[1] > length + 1e-9:
            yield (
                f"The {name}'s face reaches from {ends[0] / mm:.4g} to {ends[1] / mm:.4g} mm, off "
                f"its shaft of {length / mm:.4g} mm."
            )


def _on_bodies(gears: Mapping[str, GearKeys]) -> Iterator[str]:
    """Keys of condensed bodies at gears that have none."""
    for gear, body in ((name, each.body) for name, each in gears.items()):
        whole = body.written("web", "grid", "superelement", "temperature")
        if whole and body.kind != "condensed":
            yield Idle(f'{gear}.body.{whole[0]} does nothing: {gear}.body.kind is "{body.kind}".')


def _on_unbalance(gears: Mapping[str, GearKeys], *, swept: bool) -> Iterator[str]:
    """Unbalance of a scene that is not swept: nothing else feels it."""
    given = [f"{name}.shaft.unbalance" for name, each in gears.items() if each.shaft.unbalance]
    if given and not swept:
        does = "does" if len(given) == 1 else "do"
        yield Idle(
            f"{' and '.join(given)} {does} nothing here: unbalance shakes the pair in `jaxgear "
            "sweep` alone. Give the scene a table [sweep]."
        )


# Keys of the mesh that speak to condensed bodies alone.
_OF_CONDENSED = (
    "pinion_speed_rad_s",
    "connection",
    "root_points",
    "root_motion",
    "root_correction",
)


def _on_condensed(
    mesh: MeshKeys, gears: Mapping[str, GearKeys], bodies: Mapping[str, Any]
) -> Iterator[str]:
    """What condensed bodies bring themselves, and how far the cycle shows them."""
    given = [f"mesh.{key}" for key in mesh.written(*_OF_CONDENSED)]
    if not bodies and given:
        yield Idle(f"{', '.join(given)}: no body is condensed, so it does nothing.")
    if bodies and mesh.stiffness == "constant":
        yield (
            "mesh.stiffness_N_mm_um is taken as that of teeth alone: condensed bodies bring their "
            "own give."
        )
    # One foundation for both gears still serves a gear whose body is not condensed.
    of_both = "foundation" in mesh.given and len(bodies) == len(GEARS)
    for gear, each in bodies.items():
        own = gear if "foundation" in gears[gear].given else "mesh" if of_both else ""
        if own:
            yield Idle(
                f"{own}.foundation does nothing to the {gear} in mesh: what gives under its teeth "
                "is its condensed body. It counts in the stiffness of a single pair and in "
                "the closed form of the Master Curve, which are those of rigid gears."
            )
        yield from _on_condensed_body(mesh, gear, gears[gear].teeth, each)


def _on_condensed_body(mesh: MeshKeys, gear: str, teeth: int, each: Any) -> Iterator[str]:
    body, family = each.built.body, each.family
    if family is not None:
        low, high = (float(family.parameters[end]) for end in (0, -1))
        yield (
            f"{each.follows} is varied: from {low:g} to {high:g} the {gear}'s body is "
            "interpolated between condensed ones, its tables off by at most "
            f"{100.0 * family.interpolation_error:.2g} % of those condensed to compare. "
            "Run the scene that is written to see the optimum's own body."
        )
    if mesh.root_correction and not len(body.bricks):
        yield (
            f"The {gear}'s matrices come without a grid: the part of a root's deflection "
            "that the elements of its rim are too large to show is not known, and not added."
        )
    if mesh.pinion_speed_rad_s and not body.centrifugal_load.any():
        yield f"The {gear}'s matrices know no load of rotation: it does not grow."
    repeats, periods = teeth // math.gcd(teeth, body.facts.get("sectors", 1)), mesh.periods
    if periods % repeats:
        yield (
            f"The {gear}'s body repeats after {repeats} teeth, of which {periods} are in the "
            f"cycle: make mesh.periods a multiple of {repeats} to see all of them; a response "
            f"is then over {repeats} mesh periods, and takes at least so many times as long as "
            "one over a single period."
        )


def _on_cycle(mesh: MeshKeys, gears: Mapping[str, GearKeys], flanks: FlanksKeys) -> Iterator[str]:
    periods = mesh.periods
    for gear in GEARS:
        flank, teeth = flanks.gear(gear), gears[gear].teeth
        keys = flank.written("pitch_error_um", "eccentricity_um")
        uneven = [f"flank.{gear}.{key}" for key in keys]
        if uneven and periods % teeth:
            yield (
                f"{' and '.join(uneven)}: {periods} mesh periods are no whole revolution of the "
                f"{gear}, so statistics and orders are those of a part of it. Make mesh.periods a "
                f"multiple of {teeth}."
            )
        if periods == 1 and flank.accuracy_grade is not None:
            yield f"One mesh period leaves out the pitch errors of flank.{gear}.accuracy_grade."
    unknown = [gear for gear in GEARS if gears[gear].tip_corner_radius_mm is None]
    if mesh.tip_contact and unknown:
        keys = " and ".join(f"{gear}.tip_corner_radius_mm" for gear in unknown)
        yield (
            "Beyond the ends of the path tip corners press on the flank: the pressures there are "
            "those of the cylinders at the end of the path, not of a corner, and that of a sharp "
            f"one is not known. Give {keys}."
        )
    for gear in GEARS:
        if "tip_corner_radius_mm" in gears[gear].given and not mesh.tip_contact:
            yield Idle(f"{gear}.tip_corner_radius_mm does nothing without mesh.tip_contact.")


def _on_results(slices: int, statics: Statics) -> Iterator[str]:
    module = float(statics.model.pair.normal_module)
    approach = float(statics.numbers["te_mean_um"]) * um
    if approach > 0.1 * module:
        yield Doubtful(
            f"Teeth, shafts and bearings deflect by {approach / mm:.3g} mm in all, more than "
            "a tenth of the module: contact no longer lies where the nominal gears have it. "
            "Check the stiffness of the bearings, in N/m."
        )
    factor = float(statics.numbers["face_load_factor"])
    mounts = (statics.model.pinion_support, statics.model.wheel_support)
    if slices == 1 and any(isinstance(mount, Shaft) for mount in mounts):
        yield Doubtful("One slice sees nothing of an uneven load across the face: use 20.")
    elif slices > 1 and factor > 0.5 * slices:
        yield Doubtful(
            f"The load is carried by {slices / factor:.2g} of {slices} slices: the face load "
            "factor and the pressures are as large as the slices let them be."
        )
    yield from _on_corners(slices, statics.numbers)


def _on_corners(slices: int, numbers: Numbers) -> Iterator[str]:
    """A largest pressure of helical teeth that is what slices make of it."""
    most, off = (float(numbers[f"max_pressure_{x}MPa"]) for x in ("", "off_ends_"))
    if slices >= _ENOUGH and off < 0.9 * most:
        yield Doubtful(
            f"The largest pressure, {most:.4g} MPa, as the largest line load, is where teeth come "
            "into contact or leave it over a corner: without relief there it grows as slices, now "
            f"{slices}, get finer. A tenth of the face from there and more it is {off:.4g} MPa at "
            "most. Relieve tips or ends."
        )
