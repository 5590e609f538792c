"""The condensed body, the one thing that is handed over, and its file.

Everything is SI: m, kg, s, N, rad. The body's frame turns with it: z along the axis, z = 0 in the
middle of the toothed face, x towards the middle of tooth 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ._checks import require

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Files of the first format have their matrices whole, and can be read.
FORMAT = 2
UNITS = "SI: m, kg, s, N, rad"


@dataclass(frozen=True)
class ReducedBody:
    r"""A gear body condensed on its rim and its seats, free in space (theory 6.9).

    Its coordinates are, in this order: three translations of every rim node; three translations
    and three rotations of every seat; amplitudes of interior shapes. The motion obeys
    $M \ddot u + \Omega G \dot u + (K + \Omega^2 (K_\sigma - M_\perp)) u = f + \Omega^2 f_c$, where
    the terms with $\Omega$ on the left are there on request only. $G$ holds the factor 2.

    **Fields:**

    - `name`: of the body.
    - `stiffness`: $K$, shape `[dof, dof]` [SI].
    - `mass`: $M$, shape `[dof, dof]` [SI].
    - `centrifugal_load`: $f_c$, load per square of the speed, shape `[dof]` [SI].
    - `rim_nodes`: places of the rim nodes, shape `[rim, 3]` [m].
    - `rim_faces`: nodes of the elements of the rim, counted among the rim nodes: four corners,
        seen from outside counter-clockwise, then the middles that follow them,
        shape `[face, 8]`; empty if not known.
    - `seats`: names of the seats.
    - `seat_points`: places of the seats' nodes, shape `[seat, 3]` [m].
    - `interior`: number of interior shapes.
    - `probes`: names of the probe nodes.
    - `probe_points`: places of the probe nodes, shape `[probe, 3]` [m].
    - `probe_rows`: displacements of the probe nodes from the coordinates,
        shape `[probe, 3, dof]` [SI].
    - `coriolis`: $G$, shape `[dof, dof]` [SI], or None.
    - `spin_softening`: $M_\perp$, shape `[dof, dof]` [SI], or None.
    - `stress_stiffening`: $K_\sigma$ per square of the speed, shape `[dof, dof]` [SI], or None.
    - `nodes`: nodes of the grid, shape `[node, 3]` [m]; empty if not known.
    - `bricks`: elements of the grid, shape `[brick, 20]`; empty if not known.
    - `interior_shapes`: displacements of the grid for each interior shape,
        shape `[interior, node, 3]` [SI]; empty if not known.
    - `facts`: what else is known, by name: material, teeth, method, health. Numbers, texts, and
        lists and mappings of them; a unit is part of the name.
    """

    name: str
    stiffness: np.ndarray
    mass: np.ndarray
    centrifugal_load: np.ndarray
    rim_nodes: np.ndarray
    rim_faces: np.ndarray
    seats: tuple[str, ...]
    seat_points: np.ndarray
    interior: int
    probes: tuple[str, ...] = ()
    probe_points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    probe_rows: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 0)))
    coriolis: np.ndarray | None = None
    spin_softening: np.ndarray | None = None
    stress_stiffening: np.ndarray | None = None
    nodes: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    bricks: np.ndarray = field(default_factory=lambda: np.zeros((0, 20), dtype=int))
    interior_shapes: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3)))
    facts: Mapping[str, object] = field(default_factory=dict)

    @property
    def dofs(self) -> int:
        """Number of coordinates."""
        return len(self.stiffness)

    @property
    def boundary_dofs(self) -> int:
        """Number of coordinates that are displacements of the rim or of a seat."""
        return 3 * len(self.rim_nodes) + 6 * len(self.seats)

    @property
    def dof_names(self) -> list[str]:
        """Name of every coordinate: `rim[12].x`, `seat.left.rz`, `interior[3]`."""
        rim = [f"rim[{node}].{axis}" for node in range(len(self.rim_nodes)) for axis in "xyz"]
        axes = ("x", "y", "z", "rx", "ry", "rz")
        seats = [f"seat.{seat}.{axis}" for seat in self.seats for axis in axes]
        return rim + seats + [f"interior[{shape}]" for shape in range(self.interior)]

    def seat_dofs(self, name: str) -> slice:
        """Where the six displacements of a seat are."""
        start = 3 * len(self.rim_nodes) + 6 * self.seats.index(name)
        return slice(start, start + 6)

    @property
    def rigid_motions(self) -> np.ndarray:
        """Translations along and rotations about x, y, z, shape `[dof, 6]` [m/m, m/rad]."""
        motions = np.zeros((self.dofs, 6))
        count = 3 * len(self.rim_nodes)
        motions[:count] = rigid_motions(self.rim_nodes)
        for seat, point in zip(self.seats, self.seat_points, strict=True):
            block = motions[self.seat_dofs(seat)]
            block[:3] = rigid_motions(point[None])
            block[3:, 3:] = np.eye(3)
        return motions


def rigid_motions(points: np.ndarray) -> np.ndarray:
    """Displacements of points under unit translations and rotations about the origin.

    **Arguments:**

    - `points`: shape `[point, 3]` [m].

    **Returns:**

    Shape `[3 point, 6]`: x, y, z of every point; translations, then rotations [m/m, m/rad].
    """
    motions = np.zeros((len(points), 3, 6))
    motions[:, :, :3] = np.eye(3)
    x, y, z = points.T
    motions[:, 1, 3], motions[:, 2, 3] = -z, y
    motions[:, 0, 4], motions[:, 2, 4] = z, -x
    motions[:, 0, 5], motions[:, 1, 5] = -y, x
    return motions.reshape(-1, 6)


def self_equilibrated(
    load: np.ndarray, mass: "np.ndarray | csr_array", rigid: np.ndarray
) -> np.ndarray:
    """A load less what the rigid acceleration it causes takes of it.

    **Arguments:**

    - `load`: shape `[dof]` [SI].
    - `mass`: shape `[dof, dof]` [SI].
    - `rigid`: rigid motions, `[dof, 6]` [SI].

    **Returns:**

    Shape `[dof]` [SI].
    """
    momenta = mass @ rigid
    return load - momenta @ np.linalg.solve(rigid.T @ momenta, rigid.T @ load)


def inertia_relief(body: ReducedBody, load: np.ndarray) -> np.ndarray:
    """Static motion of a free body under loads that balance each other.

    Its mean motion, weighted by mass, is none.

    **Arguments:**

    - `body`: the condensed body.
    - `load`: shape `[dof]` [SI].

    **Returns:**

    Motion, shape `[dof]` [SI].

    **Raises:**

    - `BodyError` if the loads do not balance: a free body has no static answer to them.
    """
    # Not needed to list what the cache holds, which is to be done in no time.
    import scipy.linalg

    rigid = body.rigid_motions
    momenta = body.mass @ rigid
    out_of_balance = np.linalg.norm(rigid.T @ load)
    size = np.linalg.norm(np.abs(rigid).T @ np.abs(load))
    require(
        out_of_balance <= 1e-8 * size,
        "The loads on a free body must balance; {part:.3g} of them do not. Hold the body by "
        "springs at its seats instead.",
        part=out_of_balance / max(size, 1e-300),
    )
    # Springs on the mean motion, about as stiff as the body, hold it and are not stretched.
    stiffness = np.trace(body.stiffness) / body.dofs
    springs = momenta * (stiffness / np.einsum("ij,ij->j", momenta, momenta))
    held = body.stiffness + springs @ momenta.T
    return scipy.linalg.solve(held, load, assume_a="pos", overwrite_a=True, check_finite=False)
