"""Seats of a body that turns on them: what they feel must be the same in every direction."""

import math

import numpy as np

from jaxgear._checks import require
from jaxgear._system._condensed import Condensed

# How far the stiffness between seats may depend on the direction, of its largest entry.
_UNEVEN = 1e-3


def same_all_round(matrix: np.ndarray, before: np.ndarray, body: Condensed) -> np.ndarray:
    """The stiffness between seats, the mean over all directions, and free in rigid motions.

    **Arguments:**

    - `matrix`: the stiffness, `[seat_dof, seat_dof]` [N/m, N, N m].
    - `before`: that of the seats with nothing else moving, whose diagonal makes units alike.
    - `body`: whose seats they are.

    **Returns:**

    The stiffness, `[seat_dof, seat_dof]` [N/m, N, N m].

    **Raises:**

    - `ValueError` if it depends on the direction.
    """
    turned = []
    for quarter in range(4):
        cosine, sine = (
            round(math.cos(quarter * math.pi / 2)),
            round(math.sin(quarter * math.pi / 2)),
        )
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        whole = np.kron(np.eye(len(matrix) // 3), turn)
        turned.append(whole @ matrix @ whole.T)
    mean = np.mean(turned, axis=0)
    # Translations and rotations are of different units: a diagonal of one makes them alike.
    scale = 1.0 / np.sqrt(np.diagonal(before))
    uneven = float(np.abs(scale[:, None] * (matrix - mean) * scale).max())
    require(
        uneven <= _UNEVEN,
        "The stiffness of a condensed body between its seats must be the same in every direction "
        "across the axis, as of three or more equal sectors; that of {name!r} differs by {got:.3g} "
        "of its own. Such a body would shake its bearings once a turn.",
        name=body.name,
        got=uneven,
    )
    rigid = np.zeros((len(matrix), 6))
    for number, point in enumerate(body.seat_points):
        x, y, z = point
        rows = slice(6 * number, 6 * number + 6)
        rigid[rows] = np.eye(6)
        rigid[6 * number : 6 * number + 3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    onto = np.linalg.qr(rigid / scale[:, None])[0]
    free = np.eye(len(matrix)) - onto @ onto.T
    scaled = free @ (scale[:, None] * mean * scale) @ free
    result = scaled / scale[:, None] / scale
    return 0.5 * (result + result.T)


def along_axis(load: np.ndarray) -> np.ndarray:
    """What of a load on seats stands still while the body turns: along and about the axis.

    **Arguments:**

    - `load`: shape `[seat_dof, ...]` [N, N m].

    **Returns:**

    The load, the rest zero.
    """
    kept = np.zeros_like(load)
    kept[2::3] = load[2::3]
    return kept
