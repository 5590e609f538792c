r"""Roots of the slices of teeth on the rim of a condensed body.

A slice of a tooth stands on a patch of the rim, as wide as the tooth at its root. Its foot moves
as the rigid motion nearest to that of the patch, by least squares over points $X_q$ of weights
$w_q$ (their sum is 1), with $d_q = X_q - C$ and $C = \sum w_q X_q$:

$u = \sum w_q u_q, \quad \omega = J^{-1} \sum w_q\, d_q \times u_q, \quad
J = \sum w_q (|d_q|^2 I - d_q d_q^T)$.

What loads the foot then loads the patch by a linear stress, and no rigid motion of the body is lost
or made up. Two points across the root are the thesis's two-point connection (eq. 2.10 to 2.20) in
the form that keeps rigid motions (with eq. 2.16 exact): they are the two Gauss points of that
linear stress if they are $S_f/\sqrt 3$ apart. Along the axis the points are those of Simpson's rule
on every piece of a slice between two edges of elements: with displacements of the second degree
this is the mortar condition, weights [1 4 1]/6 (eq. 2.21 to 2.27). The rim's displacement at a
point is that of its 8-node element (eq. 2.28).
"""

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from jaxgear._checks import InputError
from jaxgear._units import mm

# Of an element: how far outside of it a point may be and still be taken as on its edge, and by
# rounding alone.
_EDGE, _ROUNDING = 1e-6, 1e-12
# Elements next to a point that are looked at, and how far outside of one it may be: the next one,
# in which most points are, then more. Beside elements of very different sizes the nearest middles
# may be those of others.
_CANDIDATES = (1, _ROUNDING), (9, _EDGE), (200, _EDGE)
# Steps to find a point in an element.
_STEPS = 12
# More levels of nodes than this are no layers of elements: slices are then cut evenly.
_MOST_LEVELS, _EVEN_PIECES = 200, 4

# Across a root: enough for a linear stress, however small the elements of the rim.
ROOT_POINTS = 12

Axial = Literal["mortar", "collocation"]


@dataclass(frozen=True)
class RimSurface:
    """The toothed surface of a condensed body.

    **Fields:**

    - `nodes`: places of the rim nodes, body frame, shape `[rim, 3]` [m].
    - `faces`: of its elements: four corners, then the middles that follow them, shape `[face, 8]`.
    """

    nodes: np.ndarray
    faces: np.ndarray

    @property
    def radius(self) -> float:
        """Of the surface [m]."""
        x, y, _ = self.nodes[self.faces[:, :4].ravel()].T
        return float(np.median(np.hypot(x, y)))


@dataclass(frozen=True)
class RootPatches:
    """The patches of the rim on which slices of teeth stand.

    **Fields:**

    - `angles`: of the middle of each patch about the axis, any shape `[...]` [rad].
    - `edges`: of the slices along the axis, shape `[slice + 1]` [m]; the last axis of `angles`
        counts slices.
    - `width`: of a tooth at its root, along the rim [m].
    - `points`: across a patch [-].
    - `axial`: "mortar", or "collocation" at the slices' middles.
    """

    angles: np.ndarray
    edges: np.ndarray
    width: float
    points: int = ROOT_POINTS
    axial: Axial = "mortar"


@dataclass(frozen=True)
class InterfaceMap:
    """How the feet of slices follow the rim.

    **Fields:**

    - `rows`: motion of every foot per displacement of the rim, six rows for each: translation
        and rotation along the radius, the tangent and the axis at the middle of its patch; shape
        `[6 foot, 3 rim]` [-, 1/m].
    - `centres`: place of every foot in the same frame, shape `[foot, 3]` [m].
    """

    rows: "scipy.sparse.csr_array"
    centres: np.ndarray


def interface_map(rim: RimSurface, patches: RootPatches) -> InterfaceMap:
    """Rows that give the motions of the feet of slices (theory 7.4, theory 7.5).

    **Arguments:**

    - `rim`: the toothed surface.
    - `patches`: where the slices stand, in any number.

    **Returns:**

    Rows and places, in the order of `patches.angles`, flattened.

    **Raises:**

    - `ValueError` if a patch is not on the rim.
    """
    across, weights_across = _across(patches)
    along, weights_along, owner = _along(patches, rim)
    slices = len(patches.edges) - 1
    angles = patches.angles.reshape(-1, slices)
    # Points: tooth, point along, point across.
    turned = angles[:, owner, None] + across / rim.radius
    heights = np.broadcast_to(along[:, None], turned.shape)
    weights = np.broadcast_to(weights_along[:, None] * weights_across, turned.shape)
    foot = np.arange(angles.shape[0])[:, None, None] * slices + owner[:, None]
    foot = np.broadcast_to(foot, turned.shape).ravel()
    columns, values = _shape_values(rim, turned.ravel(), heights.ravel())
    middle = angles.ravel()
    turn = _frames(middle)
    places = np.einsum("pn,pni->pi", values, rim.nodes[columns])
    local = np.einsum("pij,pj->pi", turn[foot], places)
    rows, centres = _nearest_motion(local, weights.ravel(), foot, len(middle))
    # Rows act on displacements in the foot's frame: turn them to those of the body.
    rows = np.einsum("paj,pji->pai", rows, turn[foot])
    entry = rows[:, :, None, :] * values[:, None, :, None]
    row = np.broadcast_to((6 * foot[:, None] + np.arange(6))[:, :, None, None], entry.shape)
    column = 3 * columns[:, None, :, None] + np.arange(3)
    column = np.broadcast_to(column, entry.shape)
    shape = (6 * len(middle), 3 * len(rim.nodes))
    matrix = scipy.sparse.coo_array((entry.ravel(), (row.ravel(), column.ravel())), shape)
    return InterfaceMap(scipy.sparse.csr_array(matrix), centres)


def _across(patches: RootPatches) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points across a root from its middle [m], and their weights."""
    places, weights = np.polynomial.legendre.leggauss(patches.points)
    return 0.5 * patches.width * places, 0.5 * weights


def _along(patches: RootPatches, rim: RimSurface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights of points along the axis, their weights within their slice, and their slice."""
    edges = patches.edges
    slices = len(edges) - 1
    if patches.axial == "collocation":
        # Two points a hair apart: a slope along the axis needs more than one.
        half = 0.5 * np.diff(edges)
        middles = 0.5 * (edges[1:] + edges[:-1])
        near = np.stack([middles - 1e-3 * half, middles + 1e-3 * half], axis=1)
        return near.ravel(), np.full(2 * slices, 0.5), np.repeat(np.arange(slices), 2)
    cuts = _cuts(edges, rim)
    low, high = cuts[:-1], cuts[1:]
    owner = np.clip(np.searchsorted(edges, 0.5 * (low + high)) - 1, 0, slices - 1)
    share = (high - low) / np.diff(edges)[owner]
    heights = np.stack([low, 0.5 * (low + high), high], axis=1)
    weights = share[:, None] * np.array([1.0, 4.0, 1.0]) / 6.0
    # At an edge of two elements either gives the same value: no point needs to choose a side.
    return heights.ravel(), weights.ravel(), np.repeat(owner, 3)


def _cuts(edges: np.ndarray, rim: RimSurface) -> np.ndarray:
    """Edges of slices and of elements along the axis."""
    size = np.ptp(edges)
    heights = rim.nodes[rim.faces[:, :4], 2].ravel()
    levels = heights[np.unique(np.round(heights / size, 9), return_index=True)[1]]
    if len(levels) > _MOST_LEVELS:
        pieces = [np.linspace(*pair, _EVEN_PIECES + 1) for pair in itertools.pairwise(edges)]
        return np.unique(np.concatenate(pieces))
    within = levels[(levels > edges[0]) & (levels < edges[-1])]
    cuts = np.sort(np.concatenate([edges, within]))
    keep = np.concatenate([[True], np.diff(cuts) > 1e-9 * size])
    return cuts[keep]


def _frames(angles: np.ndarray) -> np.ndarray:
    """Radius, tangent and axis at angles about the axis, rows of `[angle, 3, 3]`."""
    turn = np.zeros((len(angles), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angles)
    turn[:, 0, 1] = np.sin(angles)
    turn[:, 1, 0] = -np.sin(angles)
    turn[:, 2, 2] = 1.0
    return turn


def _nearest_motion(
    points: np.ndarray, weights: np.ndarray, foot: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the nearest rigid motion for each point, `[point, 6, 3]`, and the centres."""
    gather = scipy.sparse.csr_array((weights, (foot, np.arange(len(points)))), (count, len(points)))
    centres = gather @ points
    arm = points - centres[foot]
    square = np.einsum("pi,pi->p", arm, arm)[:, None, None] * np.eye(3)
    inertia = gather @ (square - arm[:, :, None] * arm[:, None, :]).reshape(-1, 9)
    crossed = np.zeros((len(points), 3, 3))
    x, y, z = arm.T
    crossed[:, 0, 1], crossed[:, 0, 2] = -z, y
    crossed[:, 1, 0], crossed[:, 1, 2] = z, -x
    crossed[:, 2, 0], crossed[:, 2, 1] = -y, x
    turning = np.linalg.solve(inertia.reshape(-1, 3, 3)[foot], crossed)
    rows = np.concatenate([np.broadcast_to(np.eye(3), turning.shape), turning], axis=1)
    return weights[:, None, None] * rows, centres


# --- Points on the surface


def _shape_values(
    rim: RimSurface, angles: np.ndarray, heights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes around points of the rim and their shares, shape `[point, 8]`.

    **Raises:**

    - `ValueError` if a point is on no element.
    """
    face, local = np.zeros(len(angles), dtype=int), np.full((len(angles), 2), np.inf)
    lost = np.ones(len(angles), dtype=bool)
    for candidates, edge in _CANDIDATES:
        face[lost], local[lost] = _places(rim, angles[lost], heights[lost], candidates)
        lost = np.abs(local).max(axis=1) > 1.0 + edge
        if not lost.any():
            break
    else:
        first = int(np.argmax(lost))
        low, high = (each(rim.nodes[rim.faces, 2]) for each in (np.min, np.max))
        raise InputError(
            f"The slices of the teeth must be attached to the rim: {int(lost.sum())} of "
            f"{len(lost)} points of their roots are not, the first at z = "
            f"{heights[first] / mm:.6g} mm and "
            f"{np.rad2deg(angles[first]) % 360.0:.4g} degrees around; the rim reaches from "
            f"{low / mm:.6g} to {high / mm:.6g} mm. Is the rim's set of nodes complete, and z = 0 "
            "in the middle of the face?"
        )
    return rim.faces[face], serendipity(np.clip(local, -1.0, 1.0))[0]


def _places(
    rim: RimSurface, angles: np.ndarray, heights: np.ndarray, candidates: int
) -> tuple[np.ndarray, np.ndarray]:
    """The element that each point is on, or least outside of, and its coordinates within it."""
    radius, corners = rim.radius, rim.nodes[rim.faces]
    middle = np.arctan2(*corners[:, :4, :2].mean(axis=1).T[::-1])
    # Elements unrolled about their own middles, so that none is cut by a full turn.
    within = lambda angle: (angle + np.pi) % (2.0 * np.pi) - np.pi
    own = within(np.arctan2(corners[..., 1], corners[..., 0]) - middle[:, None])
    unrolled = np.stack([radius * own, corners[..., 2]], axis=-1)
    # Heights in the measure in which elements are as long around as along the axis.
    around, along = np.median(np.ptp(unrolled[:, :4], axis=1), axis=0)
    squeezed = around / along
    on_cylinder = lambda angle, z: np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), squeezed * z], axis=-1
    )
    tree = scipy.spatial.KDTree(on_cylinder(middle, corners[:, :4, 2].mean(axis=1)))
    few = min(candidates, len(rim.faces))
    near = tree.query(on_cylinder(angles, heights), k=few)[1].reshape(len(angles), few)
    away = radius * within(angles[:, None] - middle[near])
    wanted = np.stack([away, np.broadcast_to(heights[:, None], away.shape)], axis=-1)
    local = _local_coordinates(unrolled[near].reshape(-1, 8, 2), wanted.reshape(-1, 2))
    local = local.reshape(*near.shape, 2)
    best = np.argmin(np.abs(local).max(axis=2), axis=1)
    rows = np.arange(len(angles))
    return near[rows, best], local[rows, best]


def _local_coordinates(corners: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Coordinates within elements of 8 nodes `[n, 8, 2]` of points `[n, 2]`, by Newton."""
    local = np.zeros_like(wanted)
    for _ in range(_STEPS):
        values, slopes = serendipity(local)
        off = np.einsum("pn,pni->pi", values, corners) - wanted
        jacobian = np.einsum("pnj,pni->pij", slopes, corners)
        step = _solved(jacobian, off)
        # Far from the element the map may fold: a bounded step cannot be lost there.
        local = np.clip(local - step, -3.0, 3.0)
        if np.abs(step).max() < 1e-13:
            break
    return local


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve many systems of two equations, `[n, 2, 2]` and `[n, 2]`."""
    (a, b), (c, d) = np.moveaxis(matrix, 0, 2)
    x, y = right.T
    return np.stack([d * x - b * y, a * y - c * x], axis=1) / (a * d - b * c)[:, None]


_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def serendipity(local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of the 8-node element (thesis eq. 2.28), and their slopes.

    **Arguments:**

    - `local`: coordinates within the element, -1 to 1, shape `[point, 2]`.

    **Returns:**

    Values, shape `[point, 8]`, and slopes, `[point, 8, 2]`; corners first, then the middles that
    follow them.
    """
    s, t = local[:, :1], local[:, 1:]
    a, b = _CORNERS.T
    sa, tb = 1.0 + s * a, 1.0 + t * b
    values, slopes = np.empty((len(s), 8)), np.empty((len(s), 8, 2))
    values[:, :4] = 0.25 * sa * tb * (s * a + t * b - 1.0)
    slopes[:, :4, 0] = 0.25 * a * tb * (2.0 * s * a + t * b)
    slopes[:, :4, 1] = 0.25 * b * sa * (s * a + 2.0 * t * b)
    # Middles: of the sides t = -1, s = 1, t = 1, s = -1.
    for node, side in ((4, -1.0), (6, 1.0)):
        values[:, node] = 0.5 * (1.0 - s[:, 0] ** 2) * (1.0 + side * t[:, 0])
        slopes[:, node, 0] = -s[:, 0] * (1.0 + side * t[:, 0])
        slopes[:, node, 1] = 0.5 * side * (1.0 - s[:, 0] ** 2)
    for node, side in ((5, 1.0), (7, -1.0)):
        values[:, node] = 0.5 * (1.0 - t[:, 0] ** 2) * (1.0 + side * s[:, 0])
        slopes[:, node, 0] = 0.5 * side * (1.0 - t[:, 0] ** 2)
        slopes[:, node, 1] = -t[:, 0] * (1.0 + side * s[:, 0])
    return values, slopes
