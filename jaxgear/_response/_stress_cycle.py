r"""What stresses of a turning body come to while it turns once.

A body that is the same under its teeth is loaded at each of them in turn: what a node feels over a
revolution is what all nodes that it turns into feel while one tooth passes. Stresses are six
components xx, yy, zz, xy, yz, zx. Everything here is plain NumPy, for what has been solved.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from jaxgear._checks import require

# How far a node may be from the place that another one turns into, over the radius.
_SAME = 1e-6


@dataclass(frozen=True)
class StressRange:
    r"""Stresses over a revolution, shape `[node]` each [Pa].

    **Fields:**

    - `principal`: the largest principal stress.
    - `equivalent`: the largest equivalent stress of von Mises.
    - `alternating`: half of the largest equivalent stress of the difference between two times,
        $\frac12\max_{t,t'}\sigma_{vM}(\sigma(t)-\sigma(t'))$: the amplitude of the stress range of
        ASME BPVC VIII-2, 5.5.3, whichever way principal axes turn.
    """

    principal: np.ndarray
    equivalent: np.ndarray
    alternating: np.ndarray


def images_of(nodes: np.ndarray, turns: int) -> np.ndarray:
    """Nodes that others come to by parts of a turn, those of one row into each other.

    **Arguments:**

    - `nodes`: places, shape `[node, 3]` [m].
    - `turns`: equal parts of a full turn, each of which leaves the nodes where some are.

    **Returns:**

    Shape `[row, turn]`; a node on the axis is a row of itself alone, many times over.

    **Raises:**

    - `ValueError` if the nodes are not the same after such a turn.
    """
    angle = 2.0 * np.pi / turns
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    distance, image = scipy.spatial.KDTree(nodes).query(nodes @ turn.T)
    size = float(np.hypot(nodes[:, 0], nodes[:, 1]).max())
    require(
        float(np.max(distance)) <= _SAME * size,
        "A body must be the same after each of {turns} parts of a turn, got nodes {off:.3g} of the "
        "radius beside each other.",
        turns=turns,
        off=float(np.max(distance)) / size,
    )
    rows = [np.arange(len(nodes))]
    for _ in range(turns - 1):
        rows.append(np.asarray(image)[rows[-1]])
    every = np.stack(rows, axis=1)
    return every[every.min(axis=1) == every[:, 0]]


def along_cylinder(nodes: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Stresses along radius, tangent and axis from those along x, y, z.

    **Arguments:**

    - `nodes`: places, shape `[node, 3]` [m].
    - `stress`: shape `[..., node, 6]` [Pa].

    **Returns:**

    The same shape: rr, tt, zz, rt, tz, zr [Pa].
    """
    angle = np.arctan2(nodes[:, 1], nodes[:, 0])
    c, s = np.cos(angle), np.sin(angle)
    xx, yy, zz, xy, yz, zx = np.moveaxis(stress, -1, 0)
    both = 2.0 * c * s * xy
    return np.stack(
        [
            c * c * xx + s * s * yy + both,
            s * s * xx + c * c * yy - both,
            zz,
            c * s * (yy - xx) + (c * c - s * s) * xy,
            c * yz - s * zx,
            s * yz + c * zx,
        ],
        axis=-1,
    )


def stress_range(stress: np.ndarray, images: np.ndarray) -> StressRange:
    """What stresses come to over a revolution.

    **Arguments:**

    - `stress`: along radius, tangent and axis while one part of the turn passes, shape
        `[time, node, 6]` [Pa].
    - `images`: nodes that turn into each other, from `images_of`.

    **Returns:**

    The stresses; nodes that turn into each other have the same.
    """
    result = np.zeros((3, stress.shape[1]))
    for row in images:
        own = stress[:, row].reshape(-1, 6)
        result[:, row] = _extremes(own)[:, None]
    return StressRange(*result)


def _extremes(own: np.ndarray) -> np.ndarray:
    """Largest principal and equivalent stress, and the alternating one, of `[time, 6]`."""
    principal = np.linalg.eigvalsh(own[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]])
    mean = own[:, :3].mean(axis=1, keepdims=True)
    # Vectors as long as the equivalent stress.
    vectors = np.sqrt(1.5) * np.concatenate([own[:, :3] - mean, np.sqrt(2.0) * own[:, 3:]], axis=1)
    return np.array(
        [principal.max(), np.linalg.norm(vectors, axis=1).max(), 0.5 * _diameter(vectors)]
    )


def _diameter(points: np.ndarray) -> float:
    """The largest distance between two of some points, `[point, axis]`."""
    reach = np.linalg.norm(points - points.mean(axis=0), axis=1)
    far = points[np.argmax(reach)]
    least = np.linalg.norm(points - far, axis=1).max()
    # Two points that are further apart are both at least so far from the middle.
    outer = points[reach >= (least - reach.max()) * (1.0 - 1e-12)]
    return float(scipy.spatial.distance.pdist(outer).max(initial=0.0))
