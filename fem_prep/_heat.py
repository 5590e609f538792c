r"""Heat in a condensed body: hub and rim at temperatures of their own, steady flow between.

Temperatures count from that at which the body has its nominal measures. In proportion to the free
strains $e = \alpha\Delta T$ of hub and rim are: the strain at every node, by steady conduction; the
load that strains a body so (Duhamel's analogy, theory 6.13); and the motion of all that is inside.
A rigid seat is a ring that grows with its own mean temperature: it does not hold a body from
growing.
"""

from dataclasses import dataclass

import numpy as np

from ._artefact import ReducedBody
from ._assembly import Material, conduction, internal_forces, swelling_load
from ._boundary import FullBody
from ._checks import require
from ._grid import Grid
from ._hold import FixedInterface, measured_coordinates
from ._solvers import factorise
from ._stress import StressRows, stress_matrix, swelling_stress

# Nodes on the hub's own radius are of the hub.
_ON_EDGE = 1e-6
PARTS = ("hub", "rim")


@dataclass(frozen=True)
class HeatedBody:
    r"""What heat does to a condensed body, per free strain of its hub and of its rim.

    With $s$ these two strains, the coordinates are loaded by $F s$, and a node moves by what
    follows from the boundary's motion and by $U s$.

    **Fields:**

    - `strain`: free strain at each node of the grid, shape `[2, node]` [-].
    - `load`: $F$ on the coordinates, shape `[2, dof]` [N, N m].
    - `inside`: $U$, motion of all nodes with rim and seats held, shape `[2, node, 3]` [m].
    """

    strain: np.ndarray
    load: np.ndarray
    inside: np.ndarray


def heated_body(held: FixedInterface, reduced: ReducedBody, hub_radius: float) -> HeatedBody:
    """Heat the hub and the rim of a condensed body, one after the other.

    **Arguments:**

    - `held`: the full body with its boundary held.
    - `reduced`: the condensed body.
    - `hub_radius`: what is no further from the axis has the temperature of the hub [m].

    **Returns:**

    What it does.

    **Raises:**

    - `BodyError` if no node is of the hub, or one of them is on the rim.
    """
    full = held.full
    strain = _flowing(full, hub_radius)
    growth = np.stack([_seat_growth(full, each) for each in strain])
    load = np.stack(
        [
            swelling_load(full.grid, full.material, each)
            - internal_forces(full.grid, full.material, grown).ravel()
            for each, grown in zip(strain, growth, strict=True)
        ]
    )
    on_coordinates, inside = measured_coordinates(held, reduced, load)
    return HeatedBody(
        strain=strain,
        load=on_coordinates,
        inside=full.on_nodes(inside.T) + growth,
    )


def _flowing(full: FullBody, hub_radius: float) -> np.ndarray:
    """Free strain at all nodes where that of hub or rim is one, by steady conduction, `[2, node]`.

    All other surfaces let no heat through. Both add up to one everywhere.
    """
    grid = full.grid
    hub = np.flatnonzero(grid.radius <= hub_radius * (1.0 + _ON_EDGE))
    require(
        len(hub) > 0 and not np.isin(full.rim, hub).any(),
        "The hub must reach beyond the smallest radius of the body, {least:.6g} mm, and not to "
        "its rim, {most:.6g} mm, got a radius of {got:.6g} mm. Give the diameter of what has the "
        "temperature of the hub.",
        least=1e3 * grid.radius.min(),
        most=1e3 * grid.radius[full.rim].min(),
        got=1e3 * hub_radius,
    )
    strain = np.zeros((len(grid.nodes), 2))
    strain[hub, 0] = strain[full.rim, 1] = 1.0
    known = np.union1d(hub, full.rim)
    free = np.setdiff1d(np.arange(len(grid.nodes)), known)
    if len(free):
        flow = conduction(grid)[free]
        factor = factorise(flow[:, free])
        strain[free] = factor.solve(-(flow[:, known] @ strain[known]))
    return strain.T


def _seat_growth(full: FullBody, strain: np.ndarray) -> np.ndarray:
    """Motion of the nodes of rigid seats that grow about their points, `[node, 3]` [m]."""
    growth = np.zeros_like(full.grid.nodes)
    for seat in full.seats:
        if not seat.averaging:
            away = full.grid.nodes[seat.nodes] - seat.point
            growth[seat.nodes] = strain[seat.nodes].mean() * away
    return growth


def heat_stress(
    heated: HeatedBody, reduced: ReducedBody, material: Material, rows: StressRows
) -> np.ndarray:
    r"""Stress by heat at some nodes that no coordinate of a condensed body says.

    With all coordinates $u$, those of the interior shapes too, the stress is $R u + \Sigma s$.

    **Arguments:**

    - `heated`: of the body.
    - `reduced`: the condensed body, with its grid.
    - `material`: of the body.
    - `rows`: of the nodes.

    **Returns:**

    $\Sigma$ per free strain of hub and rim, shape `[2, point, 6]` [Pa].
    """
    grid, nodes = Grid(reduced.nodes, reduced.bricks, {}), rows.nodes
    matrix = stress_matrix(grid, material, nodes)
    freed = np.stack([swelling_stress(grid, material, each, nodes) for each in heated.strain])
    moved = (matrix @ heated.inside.reshape(len(PARTS), -1).T).T.reshape(freed.shape)
    # Of the motion inside, interior shapes have taken a part already.
    outer = reduced.boundary_dofs
    taken = np.linalg.solve(reduced.stiffness[outer:, outer:], heated.load[:, outer:].T)
    return moved + freed - np.moveaxis(rows.rows[..., outer:] @ taken, 2, 0)
