"""The compliance of a tooth pair by its parts, which feel a load along the face differently far."""

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._contact._face_coupling import STRIP, FaceCoupling
from jaxgear._contact._foundation import AbstractFoundation
from jaxgear._contact._hertz import hertz_contact
from jaxgear._contact._shared_body import SharedBody
from jaxgear._contact._tooth import (
    beam_compliance,
    penetration_compliance,
    tooth_load,
)
from jaxgear._geometry._gear import Material
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._profile import ToothSection, tooth_section
from jaxgear._types import Bodies, Reals, Scalar

if TYPE_CHECKING:
    OfGears = Array
    FaceLengths = Array
else:
    OfGears = Float[Array, "body *point"]
    FaceLengths = Float[Array, "3"]


class ToothParts(eqx.Module):
    r"""Compliances of the teeth of both gears at points of the path, under an even load.

    **Fields:**

    - `beam`: of each tooth as a cantilever [m2/N].
    - `body`: of the body under a tooth, where it does not couple teeth [m2/N].
    - `root`: what is near a tooth's root of all that its body gives [m2/N].
    - `penetration`: of each flank by the other [m2/N].
    - `longest`: $t_1$ in each flank, see `FaceCoupling` [m].
    - `shortest`: $t_0$ of the contact [m].
    - `per_log`: compliance of a flank per natural logarithm of length [m2/N].
    - `end_image`: by how much each contact's image in a free end exceeds that of symmetry [-].
    - `lengths`: decay lengths of beam, root and body along the face [m].
    """

    beam: OfGears
    body: OfGears
    root: OfGears
    penetration: OfGears
    longest: OfGears
    shortest: Reals
    per_log: Bodies
    end_image: Bodies
    lengths: FaceLengths


class BareTeeth(NamedTuple):
    """Teeth of both gears as cantilevers that press into each other, in their virtual sections.

    **Fields:**

    - `sections`: of both.
    - `angle`: roll angles of the loaded points [rad].
    - `beam`: compliance of the cantilevers [m2/N].
    - `penetration`: of the flanks [m2/N].
    - `half_width`: of the contact [m].
    """

    sections: tuple[ToothSection, ToothSection]
    angle: OfGears
    beam: OfGears
    penetration: OfGears
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
    gears = (pair.pinion, pair.wheel)
    first, second = (tooth_section(pair, gear) for gear in gears)
    # The virtual gear keeps the normal radius of curvature, its own roll length.
    to_normal = 1.0 / jnp.cos(pair.base_helix_angle)
    rolls = ((roll, first), (pair.tangent_length - roll, second))
    angle = jnp.stack([own * to_normal / section.base_radius for own, section in rolls])

    def tooth(section: ToothSection, material: Material, angle: Reals) -> tuple[Reals, Reals]:
        depth = tooth_load(section, angle).depth
        beam = beam_compliance(section, material, angle)
        return beam, penetration_compliance(material, depth, half_width)

    # Both gears at once: half the program to compile. Their bores are not for teeth.
    teeth = [dataclasses.replace(section, radius_ratio=None) for section in (first, second)]
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), *teeth)
    materials = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(g.material for g in gears))
    beam, penetration = jax.vmap(tooth)(both, materials, angle)
    return BareTeeth((first, second), angle, beam, penetration, half_width)


def tooth_parts(
    pair: GearPair,
    foundations: tuple[AbstractFoundation, AbstractFoundation],
    bodies: tuple[SharedBody, ...],
    coupling: FaceCoupling,
    roll: Reals,
    line_load: Scalar,
) -> ToothParts:
    """Divide what a tooth pair gives into parts that reach along the face.

    **Arguments:**

    - `pair`: the gears.
    - `foundations`: of pinion and wheel.
    - `bodies`: those of them that couple teeth.
    - `coupling`: how far each part reaches.
    - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    The parts.
    """
    teeth = teeth_in_contact(pair, roll, line_load)
    wider = finite_widths(pair, coupling)
    shared = {each.gear: each.compliance(roll) for each in bodies}
    body, root = [], []
    for index, foundation in enumerate(foundations):
        section, angle = teeth.sections[index], teeth.angle[index]
        material = (pair.pinion, pair.wheel)[index].material
        if foundation.couples:
            given = shared[index] / wider[index]
            body.append(jnp.zeros_like(angle))
        else:
            given = foundation(section, material, angle)
            body.append(given)
        root.append(foundation.near_root(section, material, angle, given))
    wider = wider[:, None]
    poisson, young = (
        jnp.stack([getattr(gear.material, name) for gear in (pair.pinion, pair.wheel)])
        for name in ("poisson", "young")
    )
    per_log = 2.0 * (1.0 - poisson**2) / (jnp.pi * young)
    shortest = STRIP * teeth.half_width
    return ToothParts(
        beam=wider * teeth.beam,
        body=wider * jnp.stack(body),
        root=wider * jnp.stack(root),
        penetration=teeth.penetration,
        longest=shortest[None] * jnp.exp(teeth.penetration / per_log[:, None]),
        shortest=shortest,
        per_log=per_log,
        end_image=jax.vmap(coupling.end_image)(poisson),
        lengths=pair.normal_module * jnp.stack([coupling.beam, coupling.root, coupling.body]),
    )


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
