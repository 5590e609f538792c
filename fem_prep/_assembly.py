r"""Stiffness, mass and the loads and matrices of rotation of a grid of 20-node bricks.

The displacement of node $a$ along axis $i$ is number $3a + i$. Geometry and displacements share
their shape functions, so rigid motions are in the elements' space and strain nothing. scikit-fem
gives the element and the quadrature; its own loop over pairs of shape functions takes 20 times as
long as the products of small matrices below.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array, eye_array, kron

from ._brick import gauss_points, jacobians, shape_functions
from ._checks import require
from ._grid import Grid

# Bricks treated at a time: what they need stays below some 100 MB.
_CHUNK = 2000

# Powers that are integrated exactly: 27 points. Eight would leave spurious motions.
_ORDER = 5


@dataclass(frozen=True)
class Material:
    """A linear elastic isotropic material.

    **Fields:**

    - `young`: Young's modulus [Pa].
    - `poisson`: Poisson's ratio [-].
    - `density`: [kg/m3].

    **Raises:**

    - `BodyError` if one of them cannot be, or is in another unit.
    """

    young: float = 206e9
    poisson: float = 0.3
    density: float = 7850.0

    def __post_init__(self):
        require(
            1e8 <= self.young <= 1e16,
            "Young's modulus must lie between 1e8 and 1e16 Pa, got {got:.6g}. Give it in pascals: "
            "steel has 2.06e11.",
            got=self.young,
        )
        require(
            -1 < self.poisson < 0.5,
            "Poisson's ratio must lie between -1 and 0.5, without the ends, got {got:.6g}.",
            got=self.poisson,
        )
        require(
            10 <= self.density <= 1e5,
            "The density must lie between 10 and 1e5 kg/m3, got {got:.6g}. Give it in kg/m3: steel "
            "has 7850.",
            got=self.density,
        )

    @property
    def lame(self) -> tuple[float, float]:
        r"""Lame's parameters $\lambda$, $\mu$ [Pa]."""
        shear = self.young / (2 * (1 + self.poisson))
        return 2 * shear * self.poisson / (1 - 2 * self.poisson), shear


@dataclass(frozen=True)
class _Pattern:
    """Where the blocks of two nodes of one element go in a sparse matrix.

    **Fields:**

    - `indptr`: first block of each row, and their number.
    - `indices`: column of each block.
    - `slot`: number of the block of nodes a and b of an element, shape `[element, a, b]`.
    """

    indptr: np.ndarray
    indices: np.ndarray
    slot: np.ndarray

    def gather(self, blocks: np.ndarray) -> np.ndarray:
        """Sum what elements bring to each pair of nodes, `[element, a, b]` to `[block]`."""
        return np.bincount(self.slot.ravel(), blocks.ravel(), minlength=len(self.indices))

    def blocks(self, of: np.ndarray) -> csr_array:
        """The matrix of blocks, `[block, 3, 3]`, as one of numbers."""
        # Its shape said, as no element may reach the last nodes.
        shape = (3 * (len(self.indptr) - 1),) * 2
        return bsr_array((of, self.indices, self.indptr), shape=shape).tocsr()

    def isotropic(self, of: np.ndarray) -> csr_array:
        """The matrix that does the same, `[block]`, along every axis."""
        # Without the zeros between axes: products with it are the larger part of what modes cost.
        alone = csr_array((of, self.indices, self.indptr), shape=(len(self.indptr) - 1,) * 2)
        return csr_array(kron(alone, eye_array(3), format="csr"))


def _pattern(elements: np.ndarray, nodes: int) -> _Pattern:
    per = elements.shape[1]
    rows = np.repeat(elements, per, axis=1).ravel()
    columns = np.tile(elements, (1, per)).ravel()
    keys, slot = np.unique(rows * nodes + columns, return_inverse=True)
    indptr = np.searchsorted(keys, np.arange(nodes + 1) * nodes)
    # Short numbers: long ones would be as large as the matrices' own, and the libraries keep them.
    indptr, columns = (each.astype(np.int32) for each in (indptr, keys % nodes))
    return _Pattern(indptr, columns, slot.reshape(-1, per, per))


def _integration(grid: Grid) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
    """Integration over the bricks, some at a time.

    **Returns:**

    Which bricks; weights `[brick, point]` [m3]; values `[point, 20]`; gradients of the shape
    functions `[brick, point, 20, 3]` [1/m].
    """
    places, share = gauss_points(_ORDER)
    values, slopes = shape_functions(places)
    for start in range(0, len(grid.bricks), _CHUNK):
        part = slice(start, min(start + _CHUNK, len(grid.bricks)))
        jacobian = jacobians(grid.nodes[grid.bricks[part]], slopes)
        scale = np.linalg.det(jacobian)
        require(
            np.all(scale > 0),
            "Every brick must have a positive volume at each of its Gauss points; {count} of "
            "{all} have not. Their nodes are in the wrong order, or the grid is folded: check the "
            "elements' numbering.",
            count=int(np.sum(np.any(scale <= 0, axis=1))),
            all=len(jacobian),
        )
        gradients = np.einsum("qai,eqij->eqaj", slopes, np.linalg.inv(jacobian), optimize=True)
        yield part, scale * share, values, gradients


def assemble(grid: Grid, material: Material) -> tuple[csr_array, csr_array]:
    r"""Stiffness and consistent mass matrix of a grid (theory 6.6).

    $K_{ai,bj} = \int \lambda N_{a,i} N_{b,j} + \mu N_{a,j} N_{b,i} + \mu \delta_{ij} N_{a,k}
    N_{b,k}$ and $M_{ai,bj} = \delta_{ij} \int \rho N_a N_b$, by 27 Gauss points.

    **Arguments:**

    - `grid`: the grid.
    - `material`: its material.

    **Returns:**

    Stiffness [N/m] and mass [kg], shape `[3 node, 3 node]`.

    **Raises:**

    - `BodyError` if a brick is inverted.
    """
    pattern = _pattern(grid.bricks, len(grid.nodes))
    dilatation, shear = material.lame
    stiffness = np.zeros((len(pattern.indices), 3, 3))
    mass = np.zeros(len(pattern.indices))
    for part, weights, values, gradients in _integration(grid):
        here = _Pattern(pattern.indptr, pattern.indices, pattern.slot[part])
        flat = gradients.reshape(*weights.shape, 60)
        products = (np.swapaxes(flat * weights[..., None], 1, 2) @ flat).reshape(-1, 20, 3, 20, 3)
        trace = shear * np.einsum("eakbk->eab", products)
        for i in range(3):
            for j in range(3):
                both = dilatation * products[:, :, i, :, j] + shear * products[:, :, j, :, i]
                stiffness[:, i, j] += here.gather(both + trace if i == j else both)
        inertia = np.einsum("eq,qa,qb->eab", weights, values, values, optimize=True)
        mass += here.gather(material.density * inertia)
    return pattern.blocks(stiffness), pattern.isotropic(mass)


def conduction(grid: Grid) -> csr_array:
    r"""Matrix of heat flow of unit conductivity, $\int \nabla N_a \cdot \nabla N_b$.

    **Arguments:**

    - `grid`: the grid.

    **Returns:**

    Shape `[node, node]` [m].
    """
    pattern = _pattern(grid.bricks, len(grid.nodes))
    total = np.zeros(len(pattern.indices))
    for part, weights, _, gradients in _integration(grid):
        here = _Pattern(pattern.indptr, pattern.indices, pattern.slot[part])
        blocks = np.einsum("eq,eqai,eqbi->eab", weights, gradients, gradients, optimize=True)
        total += here.gather(blocks)
    return csr_array((total, pattern.indices, pattern.indptr), shape=(len(grid.nodes),) * 2)


def swelling_load(grid: Grid, material: Material, swelling: np.ndarray) -> np.ndarray:
    r"""Load that strains a body as a free swelling $e$ of its parts would.

    $f_{ai} = \int (3\lambda + 2\mu) e N_{a,i}$: by heat $e = \alpha \Delta T$ (Timoshenko,
    Goodier, Theory of Elasticity, section 153: Duhamel's analogy).

    **Arguments:**

    - `grid`: the grid.
    - `material`: its material.
    - `swelling`: free strain at every node, the same along all axes, shape `[node]` [-].

    **Returns:**

    Shape `[3 node]` [N].
    """
    dilatation, shear = material.lame
    load = np.zeros_like(grid.nodes)
    for part, weights, values, gradients in _integration(grid):
        pressure = (3 * dilatation + 2 * shear) * (swelling[grid.bricks[part]] @ values.T) * weights
        pushed = np.einsum("eq,eqai->eai", pressure, gradients, optimize=True)
        np.add.at(load, grid.bricks[part], pushed)
    return load.ravel()


def order(matrix: csr_array) -> int:
    """Number of rows of a sparse matrix."""
    return matrix.indptr.size - 1


def volume(grid: Grid) -> float:
    """Volume of a grid [m3]."""
    return float(sum(weights.sum() for _, weights, _, _ in _integration(grid)))


def _stressed(
    grid: Grid, material: Material, displacement: np.ndarray
) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Stresses of a displacement, some bricks at a time.

    **Returns:**

    Which bricks; stresses times weights, `[brick, point, 3, 3]` [N m]; gradients of the shape
    functions, `[brick, point, 20, 3]` [1/m].
    """
    dilatation, shear = material.lame
    for part, weights, _, gradients in _integration(grid):
        slopes = np.einsum(
            "eai,eqaj->eqij", displacement[grid.bricks[part]], gradients, optimize=True
        )
        spread = np.trace(slopes, axis1=2, axis2=3)[..., None, None]
        stress = dilatation * spread * np.eye(3) + shear * (slopes + np.swapaxes(slopes, 2, 3))
        yield part, stress * weights[..., None, None], gradients


def stress_stiffening(grid: Grid, material: Material, displacement: np.ndarray) -> csr_array:
    r"""Stiffness by stresses that are there already (geometric stiffness, theory 6.9).

    $K_\sigma = \int \nabla N_a \cdot \sigma \nabla N_b$ along every axis, with the stress of a
    given displacement: the work of that stress on the second-order part of Green's strain.

    **Arguments:**

    - `grid`: the grid.
    - `material`: its material.
    - `displacement`: that strains it, shape `[node, 3]` [m]; of unit speed: [m s2].

    **Returns:**

    The stiffness, shape `[3 node, 3 node]` [N/m]; of unit speed: [kg].
    """
    pattern = _pattern(grid.bricks, len(grid.nodes))
    total = np.zeros(len(pattern.indices))
    for part, stress, gradients in _stressed(grid, material, displacement):
        here = _Pattern(pattern.indptr, pattern.indices, pattern.slot[part])
        pulled = gradients @ stress
        total += here.gather(np.einsum("eqai,eqbi->eab", pulled, gradients, optimize=True))
    return pattern.isotropic(total)


def internal_forces(grid: Grid, material: Material, displacement: np.ndarray) -> np.ndarray:
    r"""Forces on the nodes that hold a displacement, $K u$ without the matrix.

    **Arguments:**

    - `grid`: the grid.
    - `material`: its material.
    - `displacement`: shape `[node, 3]` [m].

    **Returns:**

    Shape `[node, 3]` [N].
    """
    forces = np.zeros_like(grid.nodes)
    for part, stress, gradients in _stressed(grid, material, displacement):
        pulled = np.einsum("eqai,eqij->eaj", gradients, stress, optimize=True)
        np.add.at(forces, grid.bricks[part], pulled)
    return forces


def surface_mass(nodes: np.ndarray, faces: np.ndarray) -> csr_array:
    """Consistent mass matrix of a skin of unit mass per area on 8-node faces.

    **Arguments:**

    - `nodes`: coordinates, shape `[node, 3]` [m].
    - `faces`: four corners of every face, then the middles that follow them, `[face, 8]`.

    **Returns:**

    Shape `[3 node, 3 node]` [m2].
    """
    places, share = np.polynomial.legendre.leggauss(3)
    x, y = (axis.ravel() for axis in np.meshgrid(places, places, indexing="ij"))
    values, along_x, along_y = _face_functions(x, y)
    tangents = [
        np.einsum("qa,fai->fqi", along, nodes[faces], optimize=True) for along in (along_x, along_y)
    ]
    area = np.linalg.norm(np.cross(*tangents), axis=2) * np.outer(share, share).ravel()
    pattern = _pattern(faces, len(nodes))
    blocks = np.einsum("fq,qa,qb->fab", area, values, values, optimize=True)
    return pattern.isotropic(pattern.gather(blocks))


def _face_functions(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eight-node shape functions and their slopes on the square from -1 to 1, `[point, 8]`."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    x, y = x[:, None], y[:, None]
    p, q = corners[:, 0], corners[:, 1]
    value = (1 + p * x) * (1 + q * y) * (p * x + q * y - 1) / 4
    by_x = p * (1 + q * y) * (2 * p * x + q * y) / 4
    by_y = q * (1 + p * x) * (2 * q * y + p * x) / 4
    s, t = np.array([-1, 1]), np.array([1, -1])
    # Middles in order: below, right, above, left.
    along = (1 - x**2) * (1 + s * y) / 2
    up = (1 - y**2) * (1 + t * x) / 2
    middle = np.stack([along[:, 0], up[:, 0], along[:, 1], up[:, 1]], axis=1)
    m_x, n_x = -x * (1 + s * y), t * (1 - y**2) / 2
    m_y, n_y = s * (1 - x**2) / 2, -y * (1 + t * x)
    middle_x = np.stack([m_x[:, 0], n_x[:, 0], m_x[:, 1], n_x[:, 1]], axis=1)
    middle_y = np.stack([m_y[:, 0], n_y[:, 0], m_y[:, 1], n_y[:, 1]], axis=1)
    return (
        np.concatenate([value, middle], axis=1),
        np.concatenate([by_x, middle_x], axis=1),
        np.concatenate([by_y, middle_y], axis=1),
    )


def across(mass: csr_array) -> csr_array:
    r"""Mass that moves in the plane of rotation, $M_\perp$: rows and columns along z are zero."""
    plane = np.tile([1.0, 1.0, 0.0], order(mass) // 3)
    return csr_array(mass.multiply(plane).multiply(plane[:, None]))


def coriolis(mass: csr_array) -> csr_array:
    r"""Coriolis matrix of unit speed about z, $2 \int \rho N^T \hat{z} \times N$ [kg].

    The mass must be that of an isotropic density, the same along each axis. It is that of the
    acceleration $2\Omega\hat z\times\dot u$ in axes that turn with the body.
    """
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    along = csr_array(mass[::3, ::3])
    return csr_array(kron(along, 2 * turn, format="csr"))


def centrifugal_load(mass: csr_array, nodes: np.ndarray) -> np.ndarray:
    r"""Load of unit speed about z, $M X_\perp$ [kg m], exact as places and motions share shapes.

    **Arguments:**

    - `mass`: consistent mass matrix [kg].
    - `nodes`: coordinates, shape `[node, 3]` [m].
    """
    return mass @ (nodes * [1.0, 1.0, 0.0]).ravel()
