"""The 20-node brick on its reference cube: shape functions and integration points.

The reference cube is [0, 1]^3. Nodes are in VTK's order, as in a `Grid`.
"""

import numpy as np
from skfem.element import ElementHexS2
from skfem.quadrature import get_quadrature

from ._grid import EDGES

_CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)

# Where the nodes of the reference brick are, shape `[20, 3]`.
REFERENCE_NODES = np.concatenate([_CORNERS, _CORNERS[EDGES[:, :2]].mean(axis=1)])


def _places(element: ElementHexS2) -> list[int]:
    """For each node in VTK's order its number in scikit-fem's."""
    distance = np.abs(element.doflocs[None] - REFERENCE_NODES[:, None]).sum(axis=2)
    return [int(place) for place in distance.argmin(axis=1)]


def shape_functions(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of the 20-node serendipity brick.

    **Arguments:**

    - `points`: places in the reference cube, shape `[point, 3]`, each coordinate 0 to 1.

    **Returns:**

    Values, shape `[point, 20]`, and derivatives by the reference coordinates, shape
    `[point, 20, 3]`.
    """
    element = ElementHexS2()
    columns = np.asarray(points, dtype=float).T
    both = [element.lbasis(columns, place) for place in _places(element)]
    values = np.stack([value for value, _ in both], axis=1)
    gradients = np.stack([gradient.T for _, gradient in both], axis=1)
    return values, gradients


def gauss_points(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Integration points of the reference cube.

    A product of two shape functions, or of two of their derivatives, has no power of a coordinate
    above 4. So 27 points (`order` 4 or 5) are exact for the mass and the stiffness of a straight
    brick, the usual full integration; 8 points (2 or 3) are the reduced one.

    **Arguments:**

    - `order`: highest power of one coordinate that is integrated exactly.

    **Returns:**

    Points, shape `[point, 3]`, and weights that add up to 1, shape `[point]`.
    """
    points, weights = get_quadrature(ElementHexS2, order)
    return points.T, weights


def jacobians(corners: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """Derivatives of place by the reference coordinates.

    **Arguments:**

    - `corners`: coordinates of the nodes of every brick, shape `[brick, 20, 3]` [m].
    - `gradients`: derivatives of the shape functions, shape `[point, 20, 3]`.

    **Returns:**

    The matrix dx_i / dxi_j at every point of every brick, shape `[brick, point, 3, 3]` [m].
    """
    return np.einsum("bni,pnj->bpij", corners, gradients, optimize=True)
