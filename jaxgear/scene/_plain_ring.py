"""Condensed bodies under teeth of finite elements, which bring a plain ring of their own."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from fem_prep import (
    MIN_RIM,
    GearBody,
    Grid,
    MeshSizing,
    Seat,
    ToothedGear,
    fixed_interface,
    full_body,
    ribbed_grids,
    symmetry,
)
from jaxgear._checks import InputError, require
from jaxgear._interface._roots import RimSurface, RootPatches, interface_map
from jaxgear._units import mm
from jaxgear.scene._bodies import BodyPlan, Drawn, ribbed_sectors
from jaxgear.scene._body_build import Steps
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._kept_compliance import kept_compliance
from jaxgear.scene._mesh_teeth import toothed_gear
from jaxgear.scene._tables import PlainTables

# Loads solved for at a time.
_COLUMNS = 240


def beyond_plain_ring(
    tables: PlainTables, plan: BodyPlan, tell: Callable[[str], None]
) -> Callable[[RootPatches], np.ndarray]:
    """What a body in mesh gives beyond the plain ring that its teeth's elements stand on.

    Both are solved anew with coarse teeth all around, whose ribs a thin rim is stiffened by, and
    with the same elements under the teeth: what these do to the rim near their roots is then the
    same in both, and only the teeth's own elements say it.

    **Arguments:**

    - `tables`: of a scene with `mesh.tooth = "elements"`.
    - `plan`: of the body.
    - `tell`: told what begins.

    **Returns:**

    A function of the feet: what they give more than on the ring, `[6 foot, 6 foot]`, in the
    body's frame, seats and bore held.

    **Raises:**

    - `InputError` if the body was not drawn by its measures, or if its rim is too thin.
    """
    source = plan.source
    if not isinstance(source, Drawn):
        raise InputError(
            f'mesh.tooth = "elements": the {plan.gear}\'s body must be drawn by [{plan.gear}.body.'
            "web], so that a plain ring of like elements can be set against it; it was read from a "
            'file. Write mesh.tooth = "sliced".'
        )
    gear = toothed_gear(tables, plan.gear)
    if source.body.web is not None:
        rim = 0.5 * (source.body.rim_outer - source.body.web.rim_inner)
        require(
            rim >= MIN_RIM * gear.module,
            "Under teeth of finite elements a condensed rim must be at least {least:g} modules "
            "thick, {want:.4g} mm, got {got:.4g} mm: a thinner one bends under a root as no ring "
            'does. Make {name}.body.web.rim_inner_mm smaller, or write mesh.tooth = "sliced".',
            least=MIN_RIM,
            want=MIN_RIM * gear.module / mm,
            got=rim / mm,
            name=plan.gear,
        )
    sectors = max(ribbed_sectors(source.body, gear.teeth), source.fineness.sectors)
    fineness = dataclasses.replace(source.fineness, sectors=sectors)

    made_from = {"body": source.body, "fineness": fineness, "gear": gear, "seats": plan.seats}

    def beyond(patches: RootPatches) -> np.ndarray:
        inputs = {**made_from, "material": plan.material, "patches": patches}
        find = lambda: _beyond(plan, source.body, fineness, gear, patches, tell)
        return kept_compliance({"beyond a ring": inputs}, find)

    return beyond


def _beyond(
    plan: BodyPlan,
    drawn: GearBody,
    fineness: MeshSizing,
    gear: ToothedGear,
    patches: RootPatches,
    tell: Callable[[str], None],
) -> np.ndarray:
    """What feet give more on the body than on the ring."""
    with in_keys(plan.gear):
        grids = ribbed_grids(drawn, fineness, gear)
        # Turns that leave both as they are.
        equal = math.gcd(gear.teeth, symmetry(drawn, fineness))
        own, ring = compliances(plan, grids, patches, equal, tell)
        return own - ring


def compliances(
    plan: BodyPlan,
    grids: tuple[tuple[Grid, np.ndarray], tuple[Grid, np.ndarray]],
    patches: RootPatches,
    equal: int,
    tell: Callable[[str], None],
    loaded: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """What feet give on a body with its seats held and on a ring with its bore held.

    **Arguments:**

    - `plan`: of the body.
    - `grids`: of both, with the faces of their rims, from `ribbed_grids`.
    - `patches`: the feet.
    - `equal`: turns that leave both as they are.
    - `tell`: told what begins.
    - `loaded`: which of the `6 foot` components are; by default all.

    **Returns:**

    Of each, `[6 foot, loaded]` in the frames of the feet.
    """
    body, ring = grids
    seats = [
        Seat(
            each.name,
            body[0].sets[f"seat:{each.label}"],
            np.array([0.0, 0.0, each.at]),
            each.averaging,
        )
        for each in plan.seats
    ]
    bore = [Seat("bore", ring[0].sets["seat:bore"], np.zeros(3), False)]
    told = lambda what: Steps(lambda step: tell(f"{plan.gear}: {what}: {step}"))
    kept = np.arange(6 * patches.angles.size) if loaded is None else loaded
    return (
        _give(body, seats, plan, patches, (equal, told("body on its seats")), kept),
        _give(ring, bore, plan, patches, (equal, told("plain ring")), kept),
    )


def _give(
    grid_and_faces: tuple[Grid, np.ndarray],
    seats: list[Seat],
    plan: BodyPlan,
    patches: RootPatches,
    how: tuple[int, Steps],
    loaded: np.ndarray,
) -> np.ndarray:
    """Compliance by loads on feet of a body of equal sectors, its seats held."""
    (grid, faces), (sectors, steps) = grid_and_faces, how
    full = full_body(plan.name, grid, plan.material, seats, progress=steps)
    none = np.zeros(0, dtype=int)
    full = dataclasses.replace(full, rim=none, rim_points=none, rim_faces=none.reshape(0, 8))
    held = fixed_interface(full, rotation=full.rotation(sectors), progress=steps)
    rows = interface_map(RimSurface(grid.nodes, faces), patches).rows
    every = (rows @ full.spread).T.tocsc()
    loads = every[:, loaded]
    with steps("loads on the feet"):
        parts = [
            every.T @ held.loaded(loads[:, start : start + _COLUMNS].toarray())
            for start in range(0, loads.shape[1], _COLUMNS)
        ]
    result = np.concatenate(parts, axis=1)
    own = result[loaded]
    result[loaded] = 0.5 * (own + own.T)
    return result
