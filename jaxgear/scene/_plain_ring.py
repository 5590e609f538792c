"""Condensed bodies under teeth of finite elements, which bring a plain ring of their own."""

import dataclasses
import math
from collections.abc import Callable

from fem_prep import Fineness, GearBody
from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._flexible import FlexibleBody
from jaxgear._units import mm
from jaxgear.scene._bodies import BodyPlan, Drawn, PlannedSeat
from jaxgear.scene._body_build import built_body
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._root_correction import root_correction
from jaxgear.scene._schema import GEARS
from jaxgear.scene._tables import MeshKeys


def without_plain_ring(
    mesh: MeshKeys,
    bore: float | None,
    plan: BodyPlan,
    flexible: FlexibleBody,
    pair: GearPair,
    grid: MeshGrid,
    tell: Callable[[str], None],
) -> FlexibleBody:
    """A body in mesh by what it gives beyond the plain ring that its teeth's elements stand on.

    The ring is condensed as the body is, with rim elements of the same size and teeth that stand on
    it in the same way, and is held at its bore: what teeth do to the rim near their roots is then
    the same in both, and only the teeth's elements say it.

    **Arguments:**

    - `mesh`: with `tooth = "elements"`.
    - `bore`: of the gear, where the plain ring is held [mm].
    - `plan`: of the body.
    - `flexible`: the body in mesh.
    - `pair`: the gears.
    - `grid`: of the mesh.
    - `tell`: told what begins.

    **Returns:**

    The body, its flexibility less that of the ring.

    **Raises:**

    - `InputError` if the body was not drawn by its measures, or if it is to vibrate.
    """
    if not isinstance(plan.source, Drawn):
        raise InputError(
            f'mesh.tooth = "elements": the {plan.gear}\'s body must be drawn by [{plan.gear}.body.'
            "web], so that a plain ring of like elements can be set against it; it was read from a "
            'file. Write mesh.tooth = "sliced".'
        )
    if flexible.modes is not None:
        raise InputError(
            f'mesh.tooth = "elements": the {plan.gear}\'s condensed body carries such teeth in '
            'statics only, for the ring under them has no modes. Write mesh.tooth = "sliced" for '
            "what is in motion, or make the body rigid."
        )
    ring = dataclasses.replace(
        plan,
        source=Drawn(*_ring(bore or 0.0, plan.source)),
        seats=(PlannedSeat("gear", "bore", 0.0, False),),
        torque_seat="gear",
        teeth=None,
        method="guyan",
        modes=0,
        rotating=False,
        compares_seats=False,
    )
    built = built_body(ring, lambda step: tell(f"{plan.gear}: plain ring: {step}"))
    index = GEARS.index(plan.gear)
    points, axial = mesh.root_points, mesh.connection
    with in_keys(plan.gear):
        local = None
        if mesh.root_correction:
            local = root_correction(
                built.body, plan.material, pair, index, grid, points=points, axial=axial
            )
        own = flexible_body(
            built.body, pair, index, grid, gear_seat="gear", points=points, axial=axial, local=local
        )
    return dataclasses.replace(flexible, flexibility=flexible.flexibility - own.flexibility)


def _ring(bore: float, source: Drawn) -> tuple[GearBody, Fineness]:
    """The ring, and elements as large as those of the body's rim."""
    body, fineness = source.body, source.fineness
    ring = GearBody(body.rim_outer, body.rim_width, bore * mm)
    if body.web is None:
        return ring, fineness
    arc = math.pi * body.rim_outer / fineness.sectors
    rim = 0.5 * (body.rim_outer - body.web.rim_inner)
    count = fineness.rim_radial or max(2, round(rim / arc))
    across = math.ceil(0.5 * (body.rim_outer - ring.bore) / (rim / count))
    return ring, dataclasses.replace(fineness, web_radial=across)
