"""What is seen of a condensed body: its outside, cut open, and the section in the cut."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

import fem_prep

# The wedge left out of pictures, on the viewer's side [rad].
_WEDGE = (-0.06 * np.pi, 0.44 * np.pi)
# What the corners of a face are.
FACE = "nodes of each face: four corners, then the middles of the edges that follow them"
# A face of eight nodes as a polygon: corners and middles in turn.
_AROUND = [0, 4, 1, 5, 2, 6, 3, 7]


def opened(grid: "fem_prep.Grid") -> tuple[np.ndarray, np.ndarray]:
    """Outer faces with a wedge left out, `[face, 8]`, and which of them the cut has laid open."""
    middle = grid.nodes[grid.bricks[:, :8]].mean(axis=1)
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    left = grid.bricks[(angle < _WEDGE[0]) | (angle > _WEDGE[1])]
    kept = fem_prep.surface(fem_prep.Grid(grid.nodes, left))
    outside = {tuple(row) for row in np.sort(fem_prep.surface(grid)[:, :4], axis=1)}
    cut = [tuple(row) not in outside for row in np.sort(kept[:, :4], axis=1)]
    return kept, np.array(cut, dtype=bool)


def section(grid: "fem_prep.Grid") -> np.ndarray:
    """Faces of one side of the cut: radius and Z around each, shape `[element, 8, 2]` [m]."""
    kept, cut = opened(grid)
    faces = grid.nodes[kept[cut]][:, _AROUND]
    middle = faces.mean(axis=1)
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    near = np.abs(angle - _WEDGE[1]) < np.abs(angle - _WEDGE[0])
    return np.stack([np.hypot(faces[..., 0], faces[..., 1]), faces[..., 2]], axis=-1)[near]


def body_sections(bodies: Mapping[str, Any]) -> Mapping[str, np.ndarray]:
    """The elements of each condensed body with a grid in a cut along its axis, as `section`."""
    own = {gear: each.built.body for gear, each in bodies.items()}
    grid = lambda body: fem_prep.Grid(body.nodes, body.bricks, MappingProxyType({}))
    return {gear: section(grid(body)) for gear, body in own.items() if len(body.bricks)}
