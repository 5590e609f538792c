"""What the teeth all around a condensed rim take from what it gives.

A condensed body carries the mass of its teeth and is drawn without them. A thin rim bends and tilts
as a ring with ribs, and is stiffer: the 3 mm web of the accessory wheel gives the pair 1.7 % less
and the RMS of transmission error is 3 % less. With $R$ a rim with coarse teeth and $S$ the same
elements without them, that is $(R - S)$ on the body less $(R - S)$ on a plain ring: what the rib of
a loaded tooth takes from its own root is in both, and belongs to the tooth, not to the rim. A body
that is the plain ring is changed by nothing.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from fem_prep import (
    GearBody,
    MeshSizing,
    ribbed_grids,
    symmetry,
)
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._roots import Axial
from jaxgear._system._body_tables import root_components, root_patches
from jaxgear.scene._bodies import BodyPlan, Drawn, ribbed_sectors
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._kept_compliance import kept_compliance
from jaxgear.scene._mesh_teeth import toothed_gear
from jaxgear.scene._plain_ring import compliances
from jaxgear.scene._tables import PlainTables

# Feet along the face: the effect of ribs is smooth, and slices lie between them.
_FEET = 4
# Fewest elements across the face; longer ones than a pitch are too long.
_ACROSS = 3


def rim_ribs(
    tables: PlainTables,
    plan: BodyPlan,
    pair: GearPair,
    grid: MeshGrid,
    tell: Callable[[str], None],
    *,
    points: int,
    axial: Axial,
) -> np.ndarray | None:
    """What cells on the lines of a mesh period give more for the ribs of their body's rim.

    Holes in the web are left out of it: they make the body differ from tooth to tooth, its ribs
    hardly.

    **Arguments:**

    - `tables`: of the scene.
    - `plan`: of the body.
    - `pair`: the gears.
    - `grid`: slices and lines.
    - `tell`: told what begins.
    - `points`, `axial`: of the connection of roots and rim.

    **Returns:**

    `[line, 6 slice, line, 6 slice]` in the frames of the feet, or `None` of a body that was not
    drawn, or has no web [m/N, 1/N, 1/(N m)].
    """
    source = plan.source
    if not isinstance(source, Drawn) or source.body.web is None:
        return None
    body = dataclasses.replace(source.body, web=dataclasses.replace(source.body.web, holes=()))
    gear, index = toothed_gear(tables, plan.gear), ("pinion", "wheel").index(plan.gear)
    sectors = ribbed_sectors(body, gear.teeth)
    fineness = _fineness(body, source.fineness, sectors, gear.teeth)
    few = dataclasses.replace(grid, slices=min(grid.slices, _FEET))
    teeth = np.arange(grid.lines)
    patches = root_patches(pair, index, few, teeth, points=points, axial=axial)
    components = root_components(pair, "rigid")
    rows = (6 * np.arange(few.cells)[:, None] + np.array(components)).ravel()
    loaded = rows[: few.slices * len(components)]

    def find() -> np.ndarray:
        equal = math.gcd(gear.teeth, symmetry(body, fineness))
        with in_keys(plan.gear):
            with_teeth, smooth = (
                compliances(
                    plan,
                    ribbed_grids(body, fineness, gear, teeth=ribs),
                    patches,
                    equal,
                    tell,
                    loaded,
                )
                for ribs in (True, False)
            )
        return (with_teeth[0] - smooth[0] - (with_teeth[1] - smooth[1]))[rows]

    made_from = {"body": body, "fineness": fineness, "gear": gear, "seats": plan.seats}
    inputs = {**made_from, "material": plan.material, "patches": patches}
    found = kept_compliance({"ribs of a rim": inputs}, find)
    between = np.kron(_hats(few.slices, grid.slices), np.eye(6)[:, list(components)])
    felt = between @ found.reshape(grid.lines, len(loaded), -1) @ between.T
    # A tooth further along the path is ahead on the pinion, behind on the wheel.
    ahead = np.subtract.outer(teeth, teeth) * (1, -1)[index]
    block = lambda steps: felt[steps] if steps >= 0 else felt[-steps].T
    return np.array([[block(steps) for steps in row] for row in ahead]).transpose(0, 2, 1, 3)


def _fineness(body: GearBody, given: MeshSizing, sectors: int, teeth: int) -> MeshSizing:
    """Elements about as long as a pitch: a difference of two grids that are alike needs no more."""
    assert body.web is not None
    pitch = math.pi * body.rim_outer / teeth
    parts = lambda length, least: max(least, math.ceil(length / pitch))
    return dataclasses.replace(
        given,
        sectors=sectors,
        rim_axial=parts(body.rim_width, _ACROSS),
        rim_radial=parts(0.5 * (body.rim_outer - body.web.rim_inner), 1),
        web_radial=parts(0.5 * (body.web.rim_inner - body.web.hub_outer), 4),
        hub_radial=1,
    )


def _hats(feet: int, slices: int) -> np.ndarray:
    """Linear interpolation from the middles of few slices to those of many, `[slice, foot]`."""
    if feet == slices:
        return np.eye(slices)
    place = (np.arange(slices) + 0.5) * feet / slices - 0.5
    first = np.clip(np.floor(place).astype(int), 0, feet - 2)
    weights, share = np.zeros((slices, feet)), place - first
    weights[np.arange(slices), first] = 1.0 - share
    weights[np.arange(slices), first + 1] = share
    return weights
