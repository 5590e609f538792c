"""Sections of condensed bodies through their axis, for pictures from the side."""

from types import MappingProxyType

import numpy as np

from jaxgear.scene._scene import Scene


def body_sections(scene: Scene) -> dict[str, np.ndarray]:
    """The elements of each condensed body in a cut along its axis.

    **Arguments:**

    - `scene`: with its bodies.

    **Returns:**

    Radius and Z around each element, shape `[element, 8, 2]` [m], by gear; bodies without a grid
    have none.
    """
    if not scene.bodies:
        return {}
    from fem_prep._grid import Grid
    from jaxgear.plot._body_tables import _section

    found = {}
    for gear, each in scene.bodies.items():
        body = each.built.body
        if len(body.bricks):
            found[gear] = _section(Grid(body.nodes, body.bricks, MappingProxyType({})))
    return found
