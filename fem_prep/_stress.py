r"""Stresses of a body at nodes of its grid, from displacements or from condensed coordinates.

Strains are taken at the eight Gauss points of reduced integration, where those of a 20-node brick
are best (J. Barlow, Int. J. Numer. Methods Eng. 10, 1976, 243-251), go on to its nodes along
straight lines through these, and are averaged over the bricks of a node (E. Hinton, J. S. Campbell,
Int. J. Numer. Methods Eng. 8, 1974, 461-480). A stress that is linear within bricks is exact.

Components are xx, yy, zz, xy, yz, zx along the axes of the body, tension positive.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ._artefact import ReducedBody
from ._assembly import Material
from ._brick import REFERENCE_NODES, gauss_points, jacobians, shape_functions
from ._checks import require
from ._grid import Grid
from ._hold import FixedInterface, measured_coordinates

# Eight points.
_ORDER = 3
# Nodes treated at a time: their rows stay below some 100 MB.
_NODES = 4000
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


@dataclass(frozen=True)
class StressRows:
    r"""Stress at some nodes of a body from its condensed coordinates.

    $\sigma = R u + \Omega^2 \sigma_c$, with all coordinates $u$, those of the interior shapes too.

    **Fields:**

    - `nodes`: of the grid, shape `[point]`.
    - `places`: of these, shape `[point, 3]` [m].
    - `rows`: $R$, shape `[point, 6, dof]` [Pa/m, Pa/rad].
    - `rotation`: $\sigma_c$: what rotation adds that no coordinate says, per square of the speed,
        shape `[point, 6]` [Pa s2].
    """

    nodes: np.ndarray
    places: np.ndarray
    rows: np.ndarray
    rotation: np.ndarray


def stress_rows(held: FixedInterface, reduced: ReducedBody, nodes: np.ndarray) -> StressRows:
    r"""Stress at some nodes from the coordinates of a condensed body.

    Each row is a load on the full body whose boundary is held, by Betti's theorem: six columns are
    solved for at each node, however many coordinates there are.

    **Arguments:**

    - `held`: the full body with its boundary held.
    - `reduced`: the condensed body.
    - `nodes`: of the grid, shape `[point]`.

    **Returns:**

    The rows. At static loads on rim and seats, and under rotation, they give the stress of the full
    finite elements, by any method of condensation.

    **Raises:**

    - `BodyError` if there is no such node.
    """
    full = held.full
    matrix = stress_matrix(full.grid, full.material, nodes)
    rows, inside = measured_coordinates(held, reduced, matrix)
    # Of the load by rotation the interior shapes have taken a part already.
    outer = reduced.boundary_dofs
    taken = np.linalg.solve(
        reduced.stiffness[outer:, outer:], reduced.centrifugal_load[outer:, None]
    )
    rotation = inside @ full.centrifugal_load - rows[:, outer:] @ taken[:, 0]
    return StressRows(
        nodes=np.asarray(nodes),
        places=full.grid.nodes[nodes],
        rows=rows.reshape(-1, 6, reduced.dofs),
        rotation=rotation.reshape(-1, 6),
    )


def nodal_stress(
    grid: Grid,
    material: Material,
    displacement: np.ndarray,
    nodes: np.ndarray | None = None,
) -> np.ndarray:
    """Stress at nodes of a grid.

    **Arguments:**

    - `grid`: the grid.
    - `material`: its material.
    - `displacement`: of all nodes, shape `[column, node, 3]` [m].
    - `nodes`: where the stress is wanted; all by default, shape `[point]`.

    **Returns:**

    Shape `[column, point, 6]` [Pa].
    """
    nodes = np.arange(len(grid.nodes)) if nodes is None else nodes
    flat = displacement.reshape(len(displacement), -1).T
    parts = [
        stress_matrix(grid, material, nodes[start : start + _NODES]) @ flat
        for start in range(0, len(nodes), _NODES)
    ]
    found = np.concatenate(parts) if parts else np.zeros((0, len(displacement)))
    return np.moveaxis(found.reshape(-1, 6, len(displacement)), 2, 0)


def stress_matrix(grid: Grid, material: Material, nodes: np.ndarray) -> csr_array:
    """Stress at nodes from the displacements of all nodes.

    **Arguments:**

    - `grid`: the grid.
    - `material`: its material.
    - `nodes`: where the stress is wanted, shape `[point]`.

    **Returns:**

    Shape `[6 point, 3 node]` [Pa/m].

    **Raises:**

    - `BodyError` if there is no such node, or it belongs to no brick.
    """
    around = _around(grid, np.asarray(nodes, dtype=int))
    chosen, place = np.unique(around.brick, return_inverse=True)
    points, _ = gauss_points(_ORDER)
    _, slopes = shape_functions(points)
    jacobian = jacobians(grid.nodes[grid.bricks[chosen]], slopes)
    gradients = np.einsum("qai,eqij->eqaj", slopes, np.linalg.inv(jacobian), optimize=True)
    at = np.einsum("pq,pqaj->paj", around.weights(points), gradients[place], optimize=True)
    values = _stress_of(material, at)
    rows = 6 * around.point[:, None, None, None] + np.arange(6)[:, None, None]
    columns = 3 * grid.bricks[around.brick][:, None, :, None] + np.arange(3)
    rows, columns = (np.broadcast_to(each, values.shape).ravel() for each in (rows, columns))
    shape = (6 * len(nodes), grid.nodes.size)
    return csr_array((values.ravel(), (rows, columns)), shape=shape)


def swelling_stress(
    grid: Grid, material: Material, swelling: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    r"""Stress that a free swelling takes off that of the displacements, $-(3\lambda + 2\mu) e$.

    Taken at the same Gauss points as the strains, so that what swells freely has no stress.

    **Arguments:**

    - `grid`: the grid.
    - `material`: its material.
    - `swelling`: free strain at every node of the grid, shape `[node]` [-].
    - `nodes`: where the stress is wanted, shape `[point]`.

    **Returns:**

    Shape `[point, 6]` [Pa].
    """
    around = _around(grid, np.asarray(nodes, dtype=int))
    points, _ = gauss_points(_ORDER)
    values, _ = shape_functions(points)
    own = swelling[grid.bricks[around.brick]] @ values.T
    shown = np.bincount(
        around.point, (around.weights(points) * own).sum(axis=1), minlength=len(nodes)
    )
    dilatation, shear = material.lame
    push = -(3 * dilatation + 2 * shear) * shown
    return push[:, None] * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class _Around:
    """Bricks around some nodes: one entry for each brick of each node.

    **Fields:**

    - `brick`: which it is, shape `[entry]`.
    - `corner`: number of the node in it.
    - `point`: which of the nodes.
    """

    brick: np.ndarray
    corner: np.ndarray
    point: np.ndarray

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Of values at the points of a brick in the mean over the bricks, `[entry, point]`."""
        count = np.bincount(self.point)[self.point]
        return _onward(points)[self.corner] / count[:, None]


def _around(grid: Grid, nodes: np.ndarray) -> _Around:
    require(
        len(nodes) == 0 or (nodes.min() >= 0 and nodes.max() < len(grid.nodes)),
        "Stress is to be had at nodes of the grid, 0 to {last}, got {first} to {most}.",
        last=len(grid.nodes) - 1,
        first=nodes.min(initial=0),
        most=nodes.max(initial=0),
    )
    wanted = np.full(len(grid.nodes), -1)
    wanted[nodes] = np.arange(len(nodes))
    brick, corner = np.nonzero(wanted[grid.bricks] >= 0)
    point = wanted[grid.bricks[brick, corner]]
    require(
        len(np.unique(point)) == len(nodes),
        "Every node where stress is wanted must belong to a brick, and be named once.",
    )
    return _Around(brick, corner, point)


def _onward(points: np.ndarray) -> np.ndarray:
    """Values at the nodes of a brick from those at its eight points, along straight lines."""

    def terms(places: np.ndarray) -> np.ndarray:
        x, y, z = places.T
        return np.stack([x**0, x, y, z, x * y, y * z, z * x, x * y * z], axis=1)

    return terms(REFERENCE_NODES) @ np.linalg.inv(terms(points))


def _stress_of(material: Material, gradients: np.ndarray) -> np.ndarray:
    """Stress per displacement of the nodes of bricks, `[..., 20, 3]` to `[..., 6, 20, 3]`."""
    dilatation, shear = material.lame
    result = np.zeros((len(gradients), 6, *gradients.shape[1:]))
    for number, (i, j) in enumerate(_PAIRS):
        result[:, number, :, i] += shear * gradients[:, :, j]
        result[:, number, :, j] += shear * gradients[:, :, i]
        if i == j:
            result[:, number] += dilatation * gradients
    return result


def tensors(components: np.ndarray) -> np.ndarray:
    """Symmetric matrices of six components, shape `[..., 6]` to `[..., 3, 3]`."""
    return components[..., [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]


def von_mises(components: np.ndarray) -> np.ndarray:
    r"""Equivalent stress of von Mises, $\sqrt{3 s:s / 2}$ with $s$ the deviator.

    **Arguments:**

    - `components`: shape `[..., 6]` [Pa].

    **Returns:**

    Shape `[...]` [Pa].
    """
    normal, sheared = components[..., :3], components[..., 3:]
    deviator = normal - normal.mean(axis=-1, keepdims=True)
    square = (deviator**2).sum(axis=-1) + 2.0 * (sheared**2).sum(axis=-1)
    return np.sqrt(1.5 * square)
