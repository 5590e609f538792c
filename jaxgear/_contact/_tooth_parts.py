"""The compliance of a tooth pair by its parts, which feel a load along the face differently far."""

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._contact._face_coupling import STRIP, FaceCoupling
from jaxgear._contact._foundation import AbstractFoundation, WeberFoundation, axial_shear
from jaxgear._contact._hertz import hertz_contact
from jaxgear._contact._shared_body import SharedBody, of_gears
from jaxgear._contact._tooth import (
    beam_compliance,
    penetration_compliance,
    tooth_load,
)
from jaxgear._geometry._gear import Material
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._profile import ToothSection, tooth_section, transverse_section
from jaxgear._types import Bodies, Reals, Scalar

if TYPE_CHECKING:
    OfGears = Array
    FaceLengths = Array
    LostEnds = Array
    Ends = Array
else:
    OfGears = Float[Array, "body *point"]
    FaceLengths = Float[Array, "3"]
    LostEnds = Float[Array, "body 3"]
    Ends = Float[Array, "body 2"]


class ToothParts(eqx.Module):
    r"""Compliances of the teeth of both gears at points of the path, under an even load.

    **Fields:**

    - `beam`, `root`, `rest`: as of `TeethOnBodies` [m2/N].
    - `penetration`: of each flank by the other [m2/N].
    - `longest`: $t_1$ in each flank, see `FaceCoupling` [m].
    - `shortest`: $t_0$ of the contact [m].
    - `per_log`: compliance of a flank per natural logarithm of length [m2/N].
    - `end_image`: by how much each contact's image in either end exceeds that of symmetry [-].
    - `shift`: of the middle of each tooth against its flank, along the normal, as a length of
        contact line [m].
    - `lost`: of beam, root and body at either end of each gear, as lengths of contact line [m].
    - `lengths`: decay lengths of beam, root and body along the contact line [m].
    """

    beam: OfGears
    root: OfGears
    rest: OfGears
    penetration: OfGears
    longest: OfGears
    shortest: Reals
    per_log: Bodies
    end_image: Ends
    shift: Bodies
    lost: LostEnds
    lengths: FaceLengths


class BareTeeth(NamedTuple):
    """Teeth of both gears as cantilevers that press into each other, in their virtual sections.

    **Fields:**

    - `sections`: of both.
    - `angle`: roll angles of the loaded points [rad].
    - `beam`: compliance of the cantilevers [m2/N].
    - `plane`: of an elastic half-plane under each of them [m2/N].
    - `penetration`: of the flanks [m2/N].
    - `depth`: from the flank to the middle of the tooth, along the normal [m].
    - `half_width`: of the contact [m].
    """

    sections: tuple[ToothSection, ToothSection]
    angle: OfGears
    beam: OfGears
    plane: OfGears
    penetration: OfGears
    depth: OfGears
    half_width: Reals


def teeth_in_contact(pair: GearPair, roll: Reals, line_load: Scalar) -> BareTeeth:
    """Evaluate the teeth of both gears without their bodies.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    The teeth.
    """
    half_width = hertz_contact(pair, roll).half_width(line_load)
    first, second = (tooth_section(pair, gear) for gear in (pair.pinion, pair.wheel))
    # The virtual gear keeps the normal radius of curvature, its own roll length.
    to_normal = 1.0 / jnp.cos(pair.base_helix_angle)
    rolls = ((roll, first), (pair.tangent_length - roll, second))
    angle = jnp.stack([own * to_normal / section.base_radius for own, section in rolls])

    def tooth(section: ToothSection, material: Material, angle: Reals) -> tuple[Reals, ...]:
        depth = tooth_load(section, angle).depth
        beam = beam_compliance(section, material, angle)
        plane = WeberFoundation()(section, material, angle)
        return beam, plane, penetration_compliance(material, depth, half_width), depth

    beam, plane, penetration, depth = _of_both(pair, tooth, (first, second), angle)
    return BareTeeth((first, second), angle, beam, plane, penetration, depth, half_width)


def _of_both(
    pair: GearPair,
    function: Callable[[ToothSection, Material, Reals], Any],
    sections: tuple[ToothSection, ToothSection],
    angle: OfGears,
) -> Any:
    """A function of the teeth of both gears at once: half the program to compile."""
    # Their bores are not for teeth.
    teeth = [dataclasses.replace(section, radius_ratio=None) for section in sections]
    materials = of_gears(pair.pinion.material, pair.wheel.material)
    return jax.vmap(function)(of_gears(*teeth), materials, angle)


class TeethOnBodies(NamedTuple):
    """Teeth of both gears and what their bodies give near each, per length of contact line.

    **Fields:**

    - `teeth`: by themselves.
    - `beam`: of each tooth as a cantilever [m2/N].
    - `root`: what is near a tooth's root of all that its body gives [m2/N].
    - `rest`: what the body of a tooth gives besides, where it does not couple teeth; else, and
        negative, what a body that does has in it already of `root` [m2/N].
    """

    teeth: BareTeeth
    beam: OfGears
    root: OfGears
    rest: OfGears

    @property
    def own(self) -> Array:
        """What a pair gives that no other pair in mesh feels [m2/N]."""
        return jnp.sum(self.beam + self.root + self.rest + self.teeth.penetration, axis=0)


def teeth_on_bodies(
    pair: GearPair,
    foundations: tuple[AbstractFoundation, AbstractFoundation],
    bodies: tuple[SharedBody, ...],
    wider: Bodies,
    roll: Reals,
    line_load: Scalar,
) -> TeethOnBodies:
    r"""Evaluate teeth and what is near their roots (theory 3.16).

    Cantilever and root are those of the normal section, per length of tooth in place of contact
    line. A body that couples teeth is loaded in its transverse section and along its axis: near a
    root the half-plane of that section, and that of axial shear, make room for the normal one.

    **Arguments:**

    - `pair`: the gears.
    - `foundations`: of pinion and wheel.
    - `bodies`: those of them that couple teeth.
    - `wider`: factors on what the gears give in their sections [-].
    - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    The teeth.
    """
    teeth = teeth_in_contact(pair, roll, line_load)
    cosine, sine = jnp.cos(pair.base_helix_angle), jnp.sin(pair.base_helix_angle)
    along_tooth = jnp.cos(pair.helix_angle) / cosine
    couples = any(foundation.couples for foundation in foundations)
    across = _planes_across(pair, roll) if couples else teeth.plane
    root, rest = [], []
    for index, foundation in enumerate(foundations):
        section, angle, plane = teeth.sections[index], teeth.angle[index], teeth.plane[index]
        material = (pair.pinion, pair.wheel)[index].material
        shared = [each.compliance(roll) for each in bodies if each.gear == index]
        given = sum(shared, jnp.zeros_like(angle)) / (along_tooth * wider[index])
        if not foundation.couples:
            given = foundation(section, material, angle)
        near = foundation.near_root(plane, given)
        root.append(along_tooth * wider[index] * near)
        if not foundation.couples:
            rest.append(along_tooth * wider[index] * (given - near))
            continue
        seen = wider[index] * cosine * across[index] + sine**2 / cosine * axial_shear(material)
        rest.append(-near / plane * seen)
    beam = along_tooth * wider.reshape(2, *[1] * roll.ndim) * teeth.beam
    return TeethOnBodies(teeth, beam, jnp.stack(root), jnp.stack(rest))


def _planes_across(pair: GearPair, roll: Reals) -> OfGears:
    """What half-planes under the teeth of both gears give in their transverse sections [m2/N]."""
    sections = transverse_section(pair, pair.pinion), transverse_section(pair, pair.wheel)
    rolls = zip((roll, pair.tangent_length - roll), sections, strict=True)
    angle = jnp.stack([own / section.base_radius for own, section in rolls])
    return _of_both(pair, WeberFoundation(), sections, angle)


def tooth_parts(pair: GearPair, on_bodies: TeethOnBodies, coupling: FaceCoupling) -> ToothParts:
    """Divide what a tooth pair gives into parts that reach along the face.

    **Arguments:**

    - `pair`: the gears.
    - `on_bodies`: their teeth.
    - `coupling`: how far each part reaches.

    **Returns:**

    The parts.
    """
    teeth = on_bodies.teeth
    poisson, young = (
        jnp.stack([getattr(gear.material, name) for gear in (pair.pinion, pair.wheel)])
        for name in ("poisson", "young")
    )
    per_log = 2.0 * (1.0 - poisson**2) / (jnp.pi * young)
    shortest = STRIP * teeth.half_width
    # The pinion's flank leans over its second end, the wheel's over its first one.
    lean = jnp.stack([pair.base_helix_angle, -pair.base_helix_angle])
    angles = 0.5 * jnp.pi + lean[:, None] * jnp.asarray([[1.0, -1.0]])
    # Along the tooth, and along the axis: as lengths of contact line.
    cosine = jnp.cos(pair.base_helix_angle)
    along = jnp.stack([coupling.beam, coupling.root]) * jnp.cos(pair.helix_angle) / cosine
    lengths = jnp.concatenate([along, coupling.body[None] / cosine])
    return ToothParts(
        beam=on_bodies.beam,
        root=on_bodies.root,
        rest=on_bodies.rest,
        penetration=teeth.penetration,
        longest=shortest[None] * jnp.exp(teeth.penetration / per_log[:, None]),
        shortest=shortest,
        per_log=per_log,
        end_image=coupling.end_image(jnp.broadcast_to(poisson[:, None], (2, 2)), angles),
        shift=jnp.mean(teeth.depth, axis=-1) * jnp.tan(lean),
        lost=jnp.abs(jnp.tan(lean))[:, None] * _lost_ends(teeth),
        lengths=pair.normal_module * lengths,
    )


def _lost_ends(teeth: BareTeeth) -> Array:
    r"""What beam, root and body lose at an end of a tooth that is cut off at a slant of one [m].

    Over the slant a tooth is half to fully as thick. A beam bears as the third power of that, which
    comes to $\int_0^1(\frac{1 + s}{2})^3\mathrm ds = \frac{15}{32}$ of it, a root that turns as
    the second, $\frac{7}{12}$.
    """
    beam = 17.0 / 32.0 * jnp.mean(teeth.depth, axis=-1)
    half = jnp.stack([each.root_radius * each.root_half_angle for each in teeth.sections])
    return jnp.stack([beam, 5.0 / 12.0 * half, jnp.zeros(2)], axis=-1)


def finite_widths(pair: GearPair, coupling: FaceCoupling) -> Bodies:
    """How much more each gear gives than in plane strain, its contact apart [-].

    **Arguments:**

    - `pair`: the gears.
    - `coupling`: along the face.
    """
    widths = [
        coupling.finite_width(gear.face_width, pair.normal_module, gear.material.poisson)
        for gear in (pair.pinion, pair.wheel)
    ]
    return jnp.stack(widths)
