"""Shaded pictures of finite element surfaces, point by point.

Every face is sampled more finely than the picture has pixels, and of the samples on a pixel the
nearest one is seen. So surfaces may interpenetrate, bend and be of any number of faces.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

# Where the viewer stands, and the light: X, Y, Z of the body.
VIEW = np.array([0.62, 0.42, 0.66])
_LIGHT = np.array([0.3, 0.55, 0.8])
_DARK = 0.6  # a face that the light does not reach, over one that it falls on squarely
_FINER = 2  # samples are gathered on a grid so much finer than the picture
_DENSE = 1.45  # samples for each of its pixels, along one direction; enough on a diagonal too
_LINE = 0.55  # half the width of an element's edge [pixels]
_SAMPLES = 400_000  # at a time


@dataclass(frozen=True)
class Rendered:
    """A picture of a surface.

    **Fields:**

    - `image`: colours and opacity, from above, shape `[row, column, 4]`.
    - `extent`: left, right, bottom, top, about the projection of the origin [m].
    """

    image: np.ndarray
    extent: tuple[float, float, float, float]


def frame() -> np.ndarray:
    """The viewer's axes as columns: to the right, upwards, and towards the viewer."""
    toward = VIEW / np.linalg.norm(VIEW)
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward], axis=1)


def render(
    nodes: np.ndarray,
    faces: np.ndarray,
    colours: np.ndarray,
    *,
    flat: np.ndarray | None = None,
    edges: bool = False,
    pixels: int = 480,
) -> Rendered:
    """Draw a surface of 8-node faces in parallel projection.

    **Arguments:**

    - `nodes`: coordinates, shape `[node, 3]` [m].
    - `faces`: four corners, seen from outside counter-clockwise, then the middles that follow
        them, shape `[face, 8]`.
    - `colours`: red, green and blue from 0 to 1 at the nodes of each face, `[face, 8, 3]`.
    - `flat`: faces that the light does not shade.
    - `edges`: whether the edges of the faces are drawn.
    - `pixels`: of the longer side of the picture.
    """
    placed = nodes @ frame()
    used = placed[np.unique(faces)]
    low, high = used[:, :2].min(axis=0), used[:, :2].max(axis=0)
    scale = _FINER * pixels / float(np.max(high - low))
    shape = np.ceil((high - low) * scale / _FINER).astype(int) * _FINER + 2 * _FINER
    origin = low - _FINER / scale
    corners = ((placed - [*origin, 0.0]) * scale)[faces]
    shade, seen = _lit(corners)
    shade[np.zeros(len(faces), dtype=bool) if flat is None else flat] = 1.0
    corners, fill = corners[seen], np.clip(colours * shade[..., None], 0.0, 1.0)[seen]
    depth = np.full(shape[0] * shape[1], -np.inf)
    painted = np.zeros((shape[0] * shape[1], 3))
    spans = np.linalg.norm(np.diff(corners[:, [0, 1, 2, 3, 0], :2], axis=1), axis=2)
    counts = _rounded(np.maximum(spans[:, :2], spans[:, 2:]) * _DENSE)
    for count in np.unique(counts, axis=0):
        alike = np.flatnonzero((counts == count).all(axis=1))
        step = max(1, _SAMPLES // int(np.prod(count)))
        for part in np.split(alike, np.arange(step, len(alike), step)):
            points, colour = _sampled(corners[part], count), _sampled(fill[part], count)
            colour = _darkened(colour, spans[part], count) if edges else colour
            _gather(depth, painted, shape, points, colour)
    seen = np.isfinite(depth).reshape(*shape)
    image = _averaged(np.clip(painted, 0.0, 1.0).reshape(*shape, 3), seen)
    ends = origin + shape / scale
    return Rendered(image, (origin[0], ends[0], origin[1], ends[1]))


def _lit(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Light on the nodes of each face, `[face, 8]`, and which faces can be seen, `[face]`."""
    shape = _coefficients(corners)
    x, y = np.append(_NODES, [[0.0, 0.0]], axis=0).T
    along, up = (
        np.einsum("pi,fijc,pj->fpc", *factors, optimize=True)
        for factors in ((_slopes(x), shape, _powers(y)), (_powers(x), shape, _slopes(y)))
    )
    normal = np.cross(along, up)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
    light = normal @ (_LIGHT / np.linalg.norm(_LIGHT) @ frame())
    shade = _DARK + (1.0 - _DARK) * np.clip(light, 0.0, 1.0)
    return shade[:, :8], np.any(normal[..., 2] > 0.0, axis=1)


def _rounded(counts: np.ndarray) -> np.ndarray:
    """Whole numbers not below, few of them different."""
    steps = np.unique(np.round(2.0 ** np.arange(1.0, 12.0, 0.25)).astype(int))
    return steps[np.minimum(np.searchsorted(steps, counts), len(steps) - 1)]


def _sampled(at_nodes: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Values on a regular grid of points of each face, `[face, first, second, 3]`."""
    first, second = (_powers((2.0 * np.arange(n) + 1.0) / n - 1.0) for n in count)
    return np.einsum("ai,fijc,bj->fabc", first, _coefficients(at_nodes), second, optimize=True)


def _darkened(colours: np.ndarray, spans: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Colours, darker close to the edges of each face."""
    for axis in (0, 1):
        place = (np.arange(count[axis]) + 0.5) / count[axis]
        edge = np.minimum(place, 1.0 - place) * spans[:, axis, None]
        factor = np.where(edge < _LINE * _FINER, 0.72, 1.0)
        colours = colours * np.expand_dims(factor, (2 - axis, 3))
    return colours


def _gather(
    depth: np.ndarray, painted: np.ndarray, shape: np.ndarray, points: np.ndarray, colours: Any
) -> None:
    """Keep in every pixel the sample that is nearest to the viewer."""
    points, colours = points.reshape(-1, 3), colours.reshape(-1, 3)
    place = np.clip(points[:, :2].astype(int), 0, shape - 1)
    pixel = place[:, 0] * shape[1] + place[:, 1]
    np.maximum.at(depth, pixel, points[:, 2])
    nearest = np.flatnonzero(points[:, 2] == depth[pixel])
    painted[pixel[nearest]] = colours[nearest]


def _averaged(painted: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The picture in its own pixels, from above, with soft outlines."""
    columns, rows = (size // _FINER for size in seen.shape)
    blocks = (columns, _FINER, rows, _FINER)
    opacity = seen.reshape(blocks).mean(axis=(1, 3))
    total = (painted * seen[..., None]).reshape(*blocks, 3).sum(axis=(1, 3))
    colour = total / np.maximum(opacity * _FINER**2, 1.0)[..., None]
    return np.concatenate([colour, opacity[..., None]], axis=-1).transpose(1, 0, 2)[::-1]


# Places of the nodes of a face, and the powers of both coordinates that its shape functions span.
_NODES = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0.0]])
_POWERS = np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2], [2, 1], [1, 2]])
_TO_POWERS = np.linalg.inv(np.prod(_NODES[:, None] ** _POWERS, axis=2))


def _coefficients(at_nodes: np.ndarray) -> np.ndarray:
    """Polynomials through values at the nodes, by powers, `[face, 8, c]` to `[face, 3, 3, c]`."""
    result = np.zeros((len(at_nodes), 3, 3, at_nodes.shape[2]))
    result[:, _POWERS[:, 0], _POWERS[:, 1]] = _TO_POWERS @ at_nodes
    return result


def _powers(x: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(x), x, x**2], axis=1)


def _slopes(x: np.ndarray) -> np.ndarray:
    return np.stack([np.zeros_like(x), np.ones_like(x), 2.0 * x], axis=1)
