"""What heat does to the condensed bodies of a scene.

It is kept beside the body in the cache, as it does not depend on the temperatures.
"""

import dataclasses
import zipfile
from collections.abc import Callable

import numpy as np

from fem_prep import HeatedBody, heated_body
from jaxgear._checks import require
from jaxgear._units import mm
from jaxgear.scene._bodies import Drawn
from jaxgear.scene._body_build import BuiltBody
from jaxgear.scene._body_tables import TemperatureKeys
from jaxgear.scene._body_view import keep_beside, view_folder
from jaxgear.scene._body_words import in_keys


def heat_of(
    built: BuiltBody, keys: TemperatureKeys, tell: Callable[[str], None]
) -> HeatedBody | None:
    """What heat does to a body whose temperatures are given, from the cache if it is there.

    **Arguments:**

    - `built`: the body.
    - `keys`: its temperatures.
    - `tell`: told what begins.

    **Returns:**

    It, or `None` where none are given.

    **Raises:**

    - `ValueError` if the body came without a grid, or its hub reaches nothing or the rim.
    """
    if not keys.is_given:
        return None
    require(
        len(built.body.nodes) > 0,
        "{gear}.body.temperature: heat needs the grid of a condensed body, and of its matrices "
        "only rim and seats are known. Give the grid, or leave temperatures out.",
        gear=built.plan.gear,
    )
    radius = _hub_radius(built, keys)
    name = f"{built.key}-heat-{round(radius / 1e-9):d}"
    found = _read(name, built)
    if found is None:
        tell("heat of hub and rim")
        with in_keys(built.plan.gear):
            found = heated_body(built.held(tell), built.body, radius)
        keep_beside(built.key, name, dataclasses.asdict(found))
    return found


def _hub_radius(built: BuiltBody, keys: TemperatureKeys) -> float:
    """Radius of what has the temperature of the hub [m]."""
    source = built.plan.source
    if keys.hub_diameter_mm is not None:
        return 0.5 * keys.hub_diameter_mm * mm
    if isinstance(source, Drawn) and source.body.web is not None:
        return 0.5 * source.body.web.hub_outer
    assert built.view is not None
    seats = [nodes for name, nodes in built.view.sets.items() if name.startswith("seat:")]
    x, y, _ = built.body.nodes[np.concatenate(seats)].T
    return float(np.hypot(x, y).max())


def _read(name: str, built: BuiltBody) -> HeatedBody | None:
    folder = view_folder()
    if folder is None:
        return None
    fields = dataclasses.fields(HeatedBody)
    try:
        with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
            found = HeatedBody(**{each.name: file[each.name] for each in fields})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    nodes = len(built.body.nodes)
    shapes = found.strain.shape, found.load.shape, found.inside.shape
    return found if shapes == ((2, nodes), (2, built.body.dofs), (2, nodes, 3)) else None
