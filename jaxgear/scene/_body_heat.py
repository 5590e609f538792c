"""Temperatures of condensed bodies: from the keys of a scene to what heat does to a body.

What it does is kept beside the body in the cache, as it does not depend on the temperatures.
"""

import dataclasses
import zipfile
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fem_prep import HeatedBody, heated_body
from jaxgear._checks import InputError, require
from jaxgear._system._flexible import FlexibleBody
from jaxgear._units import mm
from jaxgear.scene._bodies import Drawn
from jaxgear.scene._body_build import BuiltBody, held_of
from jaxgear.scene._body_tables import TemperatureKeys
from jaxgear.scene._body_view import keep_beside, view_folder
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._build_pair import si

# Of steel, 1/K: DIN 3967, on backlash at other temperatures.
STEEL_EXPANSION = 1.15e-5


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
            found = heated_body(held_of(built.plan, tell), built.body, radius)
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


def free_strains(keys: TemperatureKeys) -> Array:
    r"""Free strains $\alpha\Delta T$ of hub and rim, `[2]`; none where none are given [-]."""
    if not keys.is_given:
        return jnp.zeros(2)
    expansion = STEEL_EXPANSION if keys.expansion_1_K is None else si(keys.expansion_1_K)
    return expansion * jnp.stack([si(keys.hub_K), si(keys.rim_K)])


def warmed(body: FlexibleBody, gear: str, keys: TemperatureKeys) -> FlexibleBody:
    """A condensed body at the temperatures of a scene, which may be traced.

    **Raises:**

    - `InputError` if it was put in mesh without any.
    """
    if not keys.is_given:
        return body
    if body.heat is None:
        raise InputError(
            f"{gear}.body.temperature: the {gear}'s condensed body was put in mesh without "
            "temperatures. Use `with_bodies(scene)` again, on the scene that has them."
        )
    return eqx.tree_at(lambda b: b.heat.strain, body, free_strains(keys))
