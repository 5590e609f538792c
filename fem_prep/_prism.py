r"""Stiffness of a straight or twisted prism: nine-node elements by polynomials along the axis.

A helical gear is a section that turns evenly along the axis. Seen in axes that turn with it, its
stiffness does not depend on the place along the axis, so that section and axis separate: with the
motion $u = \sum N_a(x, y)\,p_m(z)\,u_{am}$ the stiffness is

$A_{00} \otimes 1 + A_{01} \otimes D + A_{01}^T \otimes D^T + A_{11} \otimes B$,

with $A$ of the section, $p_m$ Legendre's polynomials of unit norm over the face width,
$D_{mn} = \int p_m p_n'$ and $B_{mn} = \int p_m' p_n'$. A smooth load along the face is met to
many digits by few polynomials, and free ends are free. Far from the loads fewer suffice: these are
left out node by node, which leaves a smaller space of motions that are still continuous.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from skfem.element import ElementQuad2
from skfem.quadrature import get_quadrature

from ._assembly import Material
from ._checks import require

# Highest powers in the integrals of a section that is not distorted much; see `gauss_points`.
_ORDER = 5

_AXES = np.eye(3)
# Rows: strains xx, yy, zz, xy, yz, zx; columns: derivative of component c along axis d.
_STRAIN = np.zeros((6, 3, 3))
for _row, (_i, _j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]):
    _STRAIN[_row, _i, _j] = _STRAIN[_row, _j, _i] = 1.0


def quad_functions(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of the nine-node quadrilateral, nodes in rows of three.

    **Arguments:**

    - `points`: places in the reference square from 0 to 1, shape `[point, 2]`.

    **Returns:**

    Values, shape `[point, 9]`, and derivatives by the reference coordinates, `[point, 9, 2]`.
    """
    element = ElementQuad2()
    places = np.array([[0.5 * i, 0.5 * j] for i in range(3) for j in range(3)])
    distance = np.abs(element.doflocs[None] - places[:, None]).sum(axis=2)
    columns = np.asarray(points, dtype=float).T
    both = [element.lbasis(columns, int(number)) for number in distance.argmin(axis=1)]
    # A function that is linear along a side comes as one number.
    values = np.stack([np.broadcast_to(value, columns.shape[1:]) for value, _ in both], axis=1)
    slopes = [np.broadcast_to(slope, columns.shape) for _, slope in both]
    return values, np.stack([slope.T for slope in slopes], axis=1)


def elasticity(material: Material) -> np.ndarray:
    """Stresses xx, yy, zz, xy, yz, zx per strain, shape `[6, 6]` [Pa]."""
    dilatation, shear = material.lame
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = dilatation
    return matrix + shear * np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class FaceWaves:
    """Legendre's polynomials of unit norm over a width.

    **Fields:**

    - `width`: from end to end, the middle at zero [m].
    - `count`: of polynomials.
    """

    width: float
    count: int

    def at(self, z: np.ndarray, derivative: bool = False) -> np.ndarray:
        """Values, or slopes, shape `[place, wave]` [m^-1/2, m^-3/2]."""
        x = 2.0 * np.asarray(z) / self.width
        scale = np.sqrt((2.0 * np.arange(self.count) + 1.0) / self.width)
        values = np.polynomial.legendre.legvander(x, self.count - 1)
        if not derivative:
            return values * scale
        slopes = np.zeros_like(values)
        for m in range(1, self.count):
            below = slopes[..., m - 2] if m > 1 else 0.0
            slopes[..., m] = (2 * m - 1) * values[..., m - 1] + below
        return slopes * scale * (2.0 / self.width)

    def means(self, ends: np.ndarray) -> np.ndarray:
        """Means over intervals between given ends, shape `[interval, wave]` [m^-1/2]."""
        points, weights = np.polynomial.legendre.leggauss(self.count // 2 + 1)
        middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
        values = self.at(middle[:, None] + half[:, None] * points)
        return 0.5 * np.einsum("ipm,p->im", values, weights)

    @property
    def products(self) -> tuple[np.ndarray, np.ndarray]:
        """D and B: integrals of polynomial by slope, and of slope by slope [1/m, 1/m2]."""
        points, weights = np.polynomial.legendre.leggauss(self.count)
        z, weights = 0.5 * self.width * points, 0.5 * self.width * weights
        values, slopes = self.at(z), self.at(z, derivative=True)
        mixed, both = (part.T @ (weights[:, None] * slopes) for part in (values, slopes))
        return _without_rounding(mixed), _without_rounding(both)


def _without_rounding(matrix: np.ndarray) -> np.ndarray:
    return np.where(np.abs(matrix) > 1e-12 * np.abs(matrix).max(), matrix, 0.0)


def strain_rows(
    values: np.ndarray, gradients: np.ndarray, places: np.ndarray, twist: float
) -> tuple[np.ndarray, np.ndarray]:
    """Strains by nodal motions, those with a polynomial and those with its slope.

    Along the axis a twisted body's motion changes by the polynomial's slope, by what it changes
    along the circle, and as the axes turn.

    **Arguments:**

    - `values`: of the shape functions, shape `[..., 9]`.
    - `gradients`: by x and y, shape `[..., 9, 2]` [1/m].
    - `places`: in the section, shape `[..., 2]` [m].
    - `twist`: of the section [rad/m].

    **Returns:**

    Two matrices of shape `[..., 6, 9, 3]` [1/m, -].
    """
    x, y = places[..., None, 0], places[..., None, 1]
    around = x * gradients[..., 1] - y * gradients[..., 0]
    values = np.broadcast_to(values, around.shape)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    # Derivative of component i along axis d by the motion c of node a.
    slope = np.zeros((*around.shape, 3, 3, 3))
    slope[..., 0, :] = gradients[..., 0, None, None] * _AXES
    slope[..., 1, :] = gradients[..., 1, None, None] * _AXES
    slope[..., 2, :] = -twist * around[..., None, None] * _AXES
    slope[..., 2, :] += twist * values[..., None, None] * turned
    first = np.einsum("sid,...aidc->...sac", _STRAIN, slope)
    second = np.einsum("sic,...a->...sac", _STRAIN[:, :, 2, None] * _AXES, values)
    return first, second


def section_matrices(
    nodes: np.ndarray, quads: np.ndarray, material: Material, twist: float
) -> tuple[csr_array, csr_array, csr_array]:
    """Matrices of the section of a prism.

    **Arguments:**

    - `nodes`: shape `[node, 2]` [m].
    - `quads`: shape `[quad, 9]`.
    - `material`: of the body.
    - `twist`: of the section [rad/m].

    **Returns:**

    $A_{00}$, $A_{01}$, $A_{11}$ of three motions of each node, `[3 node, 3 node]` [Pa, N/m, N].

    **Raises:**

    - `BodyError` if an element is folded.
    """
    points, weights = get_quadrature(ElementQuad2, _ORDER)
    values, slopes = quad_functions(points.T)
    corners = nodes[quads]
    jacobian = np.einsum("eai,qaj->eqij", corners, slopes)
    scale = np.abs(np.linalg.det(jacobian))
    signs = np.sign(np.linalg.det(jacobian))
    require(
        bool(np.all(signs == signs[:, :1])),
        "A tooth's elements fold: this shape of tooth and ring cannot be divided as asked. Take "
        "other numbers of elements, or a standard fillet.",
    )
    gradients = np.einsum("qai,eqij->eqaj", slopes, np.linalg.inv(jacobian))
    places = np.einsum("qa,eai->eqi", values, corners)
    first, second = strain_rows(values, gradients, places, twist)
    stiff, area = elasticity(material), scale * weights
    dofs = (3 * quads[:, :, None] + np.arange(3)).reshape(len(quads), -1)
    rows, columns = np.repeat(dofs, 27, axis=1).ravel(), np.tile(dofs, (1, 27)).ravel()

    def gathered(left: np.ndarray, right: np.ndarray) -> csr_array:
        left, right = (part.reshape(*area.shape, 6, 27) for part in (left, right))
        pressed = np.einsum("st,eqtb->eqsb", stiff, right) * area[..., None, None]
        blocks = np.einsum("eqsa,eqsb->eab", left, pressed, optimize=True)
        matrix = coo_array((blocks.ravel(), (rows, columns)), shape=(3 * len(nodes),) * 2)
        return csr_array(matrix.tocsr())

    return gathered(first, first), gathered(first, second), gathered(second, second)


def prism_stiffness(
    matrices: tuple[csr_array, csr_array, csr_array], waves: FaceWaves, kept: np.ndarray
) -> csr_array:
    """Stiffness of a prism between the motions that are kept.

    **Arguments:**

    - `matrices`: of its section.
    - `waves`: along its axis.
    - `kept`: numbers of the motions, node by node, component by component, wave by wave.

    **Returns:**

    Shape `[kept, kept]` [N/m].
    """
    of_section, mixed, upright = matrices
    slope, both = waves.products
    crossed = _kept_product(mixed, slope, kept, waves.count)
    total = _kept_product(of_section, np.eye(waves.count), kept, waves.count)
    total = total + _kept_product(upright, both, kept, waves.count)
    return csr_array(total + crossed + crossed.T)


def _kept_product(plane: csr_array, axial: np.ndarray, kept: np.ndarray, count: int) -> csr_array:
    """Rows and columns of a Kronecker product, made a block of waves at a time."""
    place = np.full((plane.indptr.size - 1) * count, -1)
    place[kept] = np.arange(len(kept))
    entries = coo_array(plane)
    row, column = entries.coords
    parts = []
    for m, n in zip(*np.nonzero(axial), strict=True):
        i, j = place[row * count + m], place[column * count + n]
        inside = (i >= 0) & (j >= 0) & (entries.data != 0.0)
        parts.append((i[inside], j[inside], entries.data[inside] * axial[m, n]))
    i, j, data = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return csr_array(coo_array((data, (i, j)), shape=(len(kept),) * 2).tocsr())
