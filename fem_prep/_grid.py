"""The finite element grid of a gear body: 20-node bricks and named sets of nodes.

Lengths are in metres, the axis of the body is z, and the middle of the toothed face is z = 0. The
x axis points from the body's own axis towards the middle of tooth 0. Nodes of a brick are in the
order of VTK's quadratic hexahedron (meshio's `hexahedron20`): eight corners, then the middles of
the edges of the bottom, of the top, and of the uprights.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

# The faces of a brick, outward: four corners, then the middles of the edges that follow them.
FACES = np.array(
    [
        [0, 3, 2, 1, 11, 10, 9, 8],
        [4, 5, 6, 7, 12, 13, 14, 15],
        [0, 1, 5, 4, 8, 17, 12, 16],
        [1, 2, 6, 5, 9, 18, 13, 17],
        [2, 3, 7, 6, 10, 19, 14, 18],
        [3, 0, 4, 7, 11, 16, 15, 19],
    ]
)

# The edges of a brick: two corners and the node between them.
EDGES = np.array(
    [
        *([0, 1, 8], [1, 2, 9], [2, 3, 10], [3, 0, 11]),
        *([4, 5, 12], [5, 6, 13], [6, 7, 14], [7, 4, 15]),
        *([0, 4, 16], [1, 5, 17], [2, 6, 18], [3, 7, 19]),
    ]
)


@dataclass(frozen=True)
class Grid:
    """A finite element grid of 20-node bricks.

    **Fields:**

    - `nodes`: coordinates of the nodes, shape `[node, 3]` [m].
    - `bricks`: nodes of every element in VTK's order, shape `[brick, 20]`.
    - `sets`: named sets: indices of nodes.
    """

    nodes: np.ndarray
    bricks: np.ndarray
    sets: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def dofs(self) -> int:
        """Number of displacements."""
        return self.nodes.size

    @property
    def radius(self) -> np.ndarray:
        """Distance of every node from the axis [m]."""
        return np.hypot(self.nodes[:, 0], self.nodes[:, 1])


def merged(nodes: np.ndarray, bricks: np.ndarray, tolerance: float) -> tuple:
    """Make nodes one that lie at the same place.

    **Arguments:**

    - `nodes`: coordinates, shape `[node, 3]` [m].
    - `bricks`: nodes of every element, shape `[brick, 20]`.
    - `tolerance`: how far apart they may lie [m].

    **Returns:**

    The nodes that are left, and the bricks on them.
    """
    pairs = KDTree(nodes).query_pairs(tolerance, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(nodes),) * 2)
    _, label = connected_components(links, directed=False)
    used, first, place = np.unique(label[bricks], return_index=True, return_inverse=True)
    del used
    return nodes[bricks.ravel()[first]], place.reshape(bricks.shape)


def parts(grid: Grid) -> np.ndarray:
    """Number of the connected part that each brick belongs to, shape `[brick]`.

    Bricks that share a node are connected.
    """
    count = len(grid.bricks)
    rows = np.repeat(np.arange(count), grid.bricks.shape[1])
    shape = (count + len(grid.nodes),) * 2
    links = coo_array((np.ones(rows.size), (rows, count + grid.bricks.ravel())), shape=shape)
    _, label = connected_components(links, directed=False)
    return np.unique(label[:count], return_inverse=True)[1]


def surface(grid: Grid) -> np.ndarray:
    """Outer faces: those that belong to one brick only.

    **Returns:**

    Nodes of every face, outward: four corners, then the middles of the edges that follow them,
    shape `[face, 8]`.
    """
    faces = grid.bricks[:, FACES].reshape(-1, 8)
    corners = np.sort(faces[:, :4], axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def surface_of(grid: Grid, name: str) -> np.ndarray:
    """Outer faces of which all nodes belong to a set, shape `[face, 8]`."""
    inside = np.zeros(len(grid.nodes), dtype=bool)
    inside[grid.sets[name]] = True
    faces = surface(grid)
    return faces[inside[faces].all(axis=1)]
