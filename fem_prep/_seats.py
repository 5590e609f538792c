"""Seats: rings of nodes that bearings and the torque hold, rigid or in the mean."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_array, coo_array, csr_array

from ._artefact import rigid_motions
from ._checks import require
from ._grid import Grid

RIM = "rim"

# How far along z a seat's point may be from its nodes, over the size of the body, if they lie in a
# plane; and how far the middle of the nodes from the axis through it, over their mean distance.
_POINT_OFF, _AROUND = 0.02, 0.2


@dataclass(frozen=True)
class Seat:
    """Nodes that a bearing, or whatever holds the body, grips, and the one node that stands for it.

    **Fields:**

    - `name`: of the seat.
    - `nodes`: the nodes it grips.
    - `point`: place of its own node, shape `[3]` [m].
    - `averaging`: False: the nodes move as one rigid ring (RBE2), which stiffens the body; True:
        the seat's node moves as their weighted mean (RBE3), which does not.
    """

    name: str
    nodes: np.ndarray
    point: np.ndarray
    averaging: bool = False


def dofs_of(points: np.ndarray) -> np.ndarray:
    """Unknowns of points: three each."""
    return (3 * np.asarray(points)[:, None] + np.arange(3)).ravel()


def free_nodes(grid: Grid, seats: Sequence[Seat]) -> np.ndarray:
    """Nodes that move on their own: all but those of rigid rings."""
    free = np.ones(len(grid.nodes), dtype=bool)
    for seat in seats:
        if not seat.averaging:
            free[seat.nodes] = False
    return np.flatnonzero(free)


def check_seats(grid: Grid, seats: Sequence[Seat]) -> None:
    """Refuse seats that cannot hold a body; see `full_body`."""
    taken = {int(node): RIM for node in grid.sets[RIM]}
    require(
        len({seat.name for seat in seats}) == len(seats),
        "Seats must have names of their own, got {names}.",
        names=", ".join(seat.name for seat in seats),
    )
    for seat in seats:
        spans = np.ptp(grid.nodes[seat.nodes], axis=0) if len(seat.nodes) else np.zeros(3)
        flat = (
            np.linalg.svd(grid.nodes[seat.nodes] - grid.nodes[seat.nodes].mean(axis=0))[1]
            if (len(seat.nodes) > 2)
            else np.zeros(2)
        )
        require(
            len(seat.nodes) > 2 and flat[1] > 1e-6 * max(spans.max(), 1e-12),
            "The seat {name!r} must have at least three nodes that are not on one line, got "
            "{count}. Is it where the body has a surface, and wide enough to hold nodes?",
            name=seat.name,
            count=len(seat.nodes),
        )
        for node in seat.nodes:
            other = taken.setdefault(int(node), seat.name)
            require(
                other == seat.name,
                "A node can belong to one set only: one at {place} mm belongs to {first!r} and to "
                "{second!r}. Make one of them narrower.",
                place=", ".join(f"{1e3 * each:.3f}" for each in grid.nodes[node]),
                first=other,
                second=seat.name,
            )
    for seat in seats:
        _check_point(grid, seat)


def _check_point(grid: Grid, seat: Seat) -> None:
    """Refuse a seat's point far from its nodes: a lever arm would join them without a word."""
    nodes = grid.nodes[seat.nodes]
    low, high = nodes[:, 2].min(), nodes[:, 2].max()
    margin = max((high - low) / 2, _POINT_OFF * np.ptp(grid.nodes, axis=0).max())
    require(
        low - margin <= seat.point[2] <= high + margin,
        "The point of the seat {name!r} must lie near its nodes, got z = {at:.6g/mm} mm and nodes "
        "from {low:.6g/mm} to {high:.6g/mm} mm. Is the shaft drawn the other way round, or the "
        "order of the seats another?",
        name=seat.name,
        at=seat.point[2],
        low=low,
        high=high,
    )
    # Of a sector alone all is on one side, the rim too.
    sector = _beside(grid.nodes[grid.sets[RIM]], np.zeros(3)) > _AROUND
    require(
        sector or _beside(nodes, seat.point) <= _AROUND,
        "The nodes of the seat {name!r} must lie around its point, got the point at ({point}) mm "
        "and the middle of the nodes at ({middle}) mm. Take the nodes of the whole seat, all the "
        "way around.",
        name=seat.name,
        point=", ".join(f"{1e3 * each:.3f}" for each in seat.point),
        middle=", ".join(f"{1e3 * each:.3f}" for each in nodes.mean(axis=0)),
    )


def _beside(nodes: np.ndarray, point: np.ndarray) -> float:
    """How far the middle of nodes is from the axis through a point, over their mean distance."""
    off = nodes[:, :2] - point[:2]
    return float(np.hypot(*off.mean(axis=0)) / np.hypot(*off.T).mean())


def ring_rows(seat: Seat) -> np.ndarray:
    """Translation and rotation of a seat's own node in rigid motions of the body, `[6, 6]`."""
    rows = np.zeros((6, 6))
    rows[:3] = rigid_motions(seat.point[None])
    rows[3:, 3:] = np.eye(3)
    return rows


def spread_of(grid: Grid, seats: Sequence[Seat]) -> csr_array:
    """Displacements of all nodes from the unknowns: rigid rings follow their own node."""
    rigid = [seat for seat in seats if not seat.averaging]
    free = free_nodes(grid, seats)
    count = 3 * len(grid.nodes)
    rows = dofs_of(free)
    parts = [coo_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), (count, len(rows)))]
    for seat in rigid:
        motion = rigid_motions(grid.nodes[seat.nodes] - seat.point)
        rows = np.repeat(dofs_of(seat.nodes), 6)
        columns = np.tile(np.arange(6), len(motion))
        parts.append(coo_array((motion.ravel(), (rows, columns)), (count, 6)))
    spread = csr_array(block_array([parts]))
    spread.eliminate_zeros()
    # Short numbers, as in the matrices that it is multiplied with: one long factor makes all long.
    places = (spread.indices.astype(np.int32), spread.indptr.astype(np.int32))
    return csr_array((spread.data, *places), shape=spread.shape)


def averages_of(grid: Grid, seats: Sequence[Seat], mass: csr_array, spread: csr_array) -> csr_array:
    r"""Rows that give the weighted mean translation and rotation of the nodes of a seat.

    The rigid motion nearest to that of the nodes, by least squares: $B = (R^T w R)^{-1} R^T w$.
    Weights are what a unit acceleration of the body puts on each node, always positive here as
    rows of a consistent mass need not be: the diagonal.
    """
    blocks = []
    for seat in seats:
        if not seat.averaging:
            continue
        dofs = dofs_of(seat.nodes)
        weights = mass.diagonal()[dofs]
        motion = rigid_motions(grid.nodes[seat.nodes] - seat.point)
        rows = np.linalg.solve(motion.T @ (weights[:, None] * motion), motion.T * weights)
        places = (np.repeat(np.arange(6), len(dofs)), np.tile(dofs, 6))
        blocks.append(coo_array((rows.ravel(), places), (6, 3 * len(grid.nodes))))
    if not blocks:
        return csr_array((0, int(spread.indices.max()) + 1))
    return csr_array(csr_array(block_array([[each] for each in blocks])) @ spread)
