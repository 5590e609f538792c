"""Teeth of finite elements for a scene: condensed once, kept in the cache and in this process."""

import functools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import jax

from fem_prep import (
    Material,
    ToothedGear,
    ToothElements,
    cached,
    condense_teeth,
    fitting_sizing,
    key_of,
    read_teeth,
    write_teeth,
)
from jaxgear._checks import InputError
from jaxgear._contact._tooth_elements import ElementTeeth, ToothTables, tooth_tables
from jaxgear._geometry._pair import pair_facts
from jaxgear._units import GPa, deg, mm
from jaxgear.scene._assumed import usual_bore
from jaxgear.scene._body_build import Steps
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._build_pair import pair_of, si
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS, shapes_teeth
from jaxgear.scene._sizes import of_material
from jaxgear.scene._tables import MeshKeys, PlainTables


def _quiet(step: str) -> None:
    """Tell nobody what begins."""


class TeethInMesh(NamedTuple):
    """What the teeth of both gears are made from, and how many are in mesh at once.

    **Fields:**

    - `shapes`: teeth, ring and material of each gear.
    - `count`: of teeth, as many as the grid has contact lines.
    """

    shapes: tuple[tuple[ToothedGear, Material], ...]
    count: int

    def in_mesh(self, updates: int, tell: Callable[[str], None] = _quiet) -> ElementTeeth:
        """Their compliance in mesh, condensed where the cache does not know them.

        **Arguments:**

        - `updates`: of the line load, as of `ElementTeeth`.
        - `tell`: told what begins.
        """
        pinion, wheel = (
            _tables(gear, made_from, self.count, tell)
            for gear, made_from in zip(GEARS, self.shapes, strict=True)
        )
        return ElementTeeth(pinion=pinion, wheel=wheel, load_updates=updates)

    def condensed(self) -> list[tuple[ToothedGear, ToothElements]]:
        """The shapes of both gears' teeth, and what was condensed of them."""
        return [
            (shape, condensed_teeth(shape, material, self.count, _quiet))
            for shape, material in self.shapes
        ]

    def coarser(self) -> list[tuple[str, float]]:
        """Gears whose teeth are divided more coarsely than others are, and what that costs [-]."""
        found = [
            (gear, fitting_sizing(shape, self.count)[1])
            for gear, (shape, _) in zip(GEARS, self.shapes, strict=True)
        ]
        return [(gear, error) for gear, error in found if error > 0.0]


def teeth_in_mesh(scene: Scene) -> TeethInMesh:
    """What a scene's teeth of finite elements are made from.

    **Arguments:**

    - `scene`: with `mesh.tooth = "elements"`.

    **Raises:**

    - `InputError` if the scene's teeth cannot be finite elements, or cannot follow what is traced.
    """
    _refuse_moved(scene.moved)
    _check(scene.mesh, scene.plain.gears)
    shapes = tuple(_shape(scene.plain, gear) for gear in GEARS)
    still = replace(scene, moved=MappingProxyType({}))
    with jax.ensure_compile_time_eval():
        facts = pair_facts(pair_of(still))
        profile, half = float(facts.profile_contact_ratio), 0.5 * float(facts.overlap_ratio)
    beyond = 1.0 if scene.mesh.tip_contact else 0.0
    return TeethInMesh(shapes, math.floor(profile + half + beyond + 0.05) + math.ceil(half) + 1)


def _refuse_moved(moved: Iterable[str]) -> None:
    """Refuse keys that are traced and that condensed teeth do not follow."""
    if shaping := sorted(filter(shapes_teeth, moved)):
        raise InputError(
            'mesh.tooth = "elements": condensed teeth do not follow '
            f"{', '.join(shaping)}: there is no derivative. Vary keys of flanks, torque, bearings "
            'or misalignment, or write mesh.tooth = "sliced".'
        )


def _check(mesh: MeshKeys, gears: Mapping[str, GearKeys]) -> None:
    """Refuse what teeth of finite elements cannot be."""
    if mesh.stiffness != "weber-banaschek":
        raise InputError(
            'mesh.tooth = "elements" takes the place of mesh.stiffness = '
            f'"{mesh.stiffness}". Keep one.'
        )
    for gear, keys in gears.items():
        if keys.body.kind == "beam":
            raise InputError(
                f'mesh.tooth = "elements": the {gear}\'s body is a beam, and what the ring under '
                "the teeth winds up and bends would count twice, once in the teeth's elements and "
                f'once in the beam. Make {gear}.body.kind "rigid" or "condensed", or write '
                'mesh.tooth = "sliced".'
            )
        if not keys.bore_mm:
            raise InputError(
                'mesh.tooth = "elements": teeth of finite elements stand on a ring that is held '
                f"at its bore. Give {gear}.bore_mm a value > 0."
            )


def toothed_gear(tables: PlainTables, name: str) -> ToothedGear:
    """The teeth of a gear and the ring that they stand on."""
    return _shape(tables, name)[0]


def _shape(tables: PlainTables, name: str) -> tuple[ToothedGear, Material]:
    """What the teeth of a gear are made from."""
    gear, pair, sign = tables.gear(name), tables.pair, {"pinion": 1.0, "wheel": -1.0}[name]
    helix, module = pair.helix_angle_deg * deg, pair.module_mm * mm
    height = gear.addendum_coeff + gear.profile_shift - gear.tip_shortening_coeff
    keys = ("young_GPa", "poisson", "density_kg_m3")
    young, poisson, density = (float(si(of_material(tables, name, key))) for key in keys)
    # Teeth of elements have one; a drawn body with sliced teeth need not say it.
    bore = gear.bore_mm or usual_bore(tables, name)
    with in_keys(name):
        shape = ToothedGear(
            teeth=gear.teeth,
            module=module,
            pressure_angle=pair.pressure_angle_deg * deg,
            helix_angle=sign * helix,
            profile_shift=gear.profile_shift,
            dedendum=gear.dedendum_coeff,
            fillet_radius=gear.fillet_radius_coeff,
            tip_radius=0.5 * gear.teeth * module / math.cos(helix) + module * height,
            bore=bore * mm,
            face_width=gear.face_width_mm * mm,
        )
        return shape, Material(young * GPa, poisson, density)


def _tables(
    name: str, made_from: tuple[ToothedGear, Material], count: int, tell: Callable[[str], None]
) -> ToothTables:
    with in_keys(name):
        found = condensed_teeth(*made_from, count, lambda step: tell(f"{name}: {step}"))
    return tooth_tables(found.compliance, found.roll, found.face_width, made_from[1].young)


# What was condensed or read in this process: a scene's model is made many times.
@functools.lru_cache(maxsize=16)
def _kept(shape: ToothedGear, material: Material, count: int) -> list[ToothElements]:
    return []


def condensed_teeth(
    shape: ToothedGear, material: Material, count: int, tell: Callable[[str], None]
) -> ToothElements:
    """Condensed teeth of a gear, from the cache where they are known.

    **Arguments:**

    - `shape`: the gear.
    - `material`: of it.
    - `count`: of teeth that can be in mesh at once.
    - `tell`: told what begins.

    **Returns:**

    The teeth.
    """
    kept = _kept(shape, material, count)
    if not kept:
        sizing, _ = fitting_sizing(shape, count)
        key = key_of({"shape": shape, "material": material, "teeth": count, "sizing": sizing})
        build = lambda: condense_teeth(shape, material, count, sizing=sizing, progress=Steps(tell))
        kept.append(cached(key, build, (read_teeth, write_teeth))[0])
    return kept[0]
