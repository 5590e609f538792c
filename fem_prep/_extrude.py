"""A plane grid drawn out along the axis."""

import numpy as np


def extruded_grid(quads: np.ndarray, low, high) -> np.ndarray:
    """Bricks between two heights over quadrilaterals.

    **Arguments:**

    - `quads`: places seen along the axis, shape `[quad, 8, 2]` [m].
    - `low`, `high`: heights of all nodes or of each, shape `[quad, 8]` [m].

    **Returns:**

    Places of the nodes of the bricks, shape `[quad, 20, 3]` [m].
    """
    bottom, top = (
        np.concatenate([quads, np.broadcast_to(z, quads.shape[:2])[..., None]], axis=-1)
        for z in (low, high)
    )
    upright = (bottom[:, :4] + top[:, :4]) / 2
    parts = [bottom[:, :4], top[:, :4], bottom[:, 4:], top[:, 4:], upright]
    return np.concatenate(parts, axis=1)
