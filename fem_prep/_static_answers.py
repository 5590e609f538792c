"""What a body answers to loads: growth by rotation, and deflection under a tooth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array, diags_array

from ._answers import Report, inertia_of
from ._artefact import ReducedBody, inertia_relief, rigid_motions, self_equilibrated
from ._assembly import surface_mass
from ._checks import require


@dataclass(frozen=True)
class Springs:
    """What holds a body while its condensed model is compared with the full one.

    Every seat stands on springs; one more stands for the mesh, between tooth 0 and the ground.

    **Fields:**

    - `radial`: of a seat, along x and along y [N/m].
    - `axial`: of a seat [N/m].
    - `tilt`: of a seat, about x and about y [N m/rad].
    - `turn`: of a seat, about z: weak, as shafts turn freely [N m/rad].
    - `mesh`: along the line of action [N/m].
    - `pressure_angle`: between the line of action and the tangent at tooth 0 [rad].

    **Raises:**

    - `BodyError` if one is not positive.
    """

    radial: float = 1e8
    axial: float = 1e8
    tilt: float = 1e4
    turn: float = 1e3
    mesh: float = 2e8
    pressure_angle: float = math.radians(20.0)

    def __post_init__(self):
        weakest = min(*self.seat, self.mesh)
        require(
            weakest > 0,
            "Springs must be positive, got {got:.4g}: a body that floats has no first mode.",
            got=weakest,
        )

    @property
    def seat(self) -> np.ndarray:
        """Stiffness along the six coordinates of a seat, shape `[6]` [SI]."""
        sides = [self.radial, self.radial, self.axial]
        return np.array([*sides, self.tilt, self.tilt, self.turn])

    @property
    def line_of_action(self) -> np.ndarray:
        """Direction of the force on tooth 0, into the body, shape `[3]` [-]."""
        return np.array([-math.sin(self.pressure_angle), math.cos(self.pressure_angle), 0.0])


def growth(reduced: ReducedBody) -> np.ndarray:
    """Motion of the rim under centrifugal load of unit speed, `[3 rim]` [m s2/rad2].

    The body floats: what of the load is not balanced accelerates it. Motion is told relative to
    the mean motion of the rim.
    """
    load = self_equilibrated(reduced.centrifugal_load, reduced.mass, reduced.rigid_motions)
    return off_mean(reduced, inertia_relief(reduced, load)[: reduced.rim_nodes.size])


def off_mean(reduced: ReducedBody, motion: np.ndarray) -> np.ndarray:
    """Motion of the rim relative to its own mean motion, `[3 rim]` or `[3 rim, column]`."""
    return motion - rigid_motions(reduced.rim_nodes) @ (rim_rows(reduced) @ motion)


def _rim_area(reduced: ReducedBody) -> csr_array:
    """Weights of the rim's nodes: those of its area, or all the same if faces are not known."""
    if len(reduced.rim_faces):
        return surface_mass(reduced.rim_nodes, reduced.rim_faces)
    return csr_array(diags_array(np.ones(reduced.rim_nodes.size)))


def rim_rows(reduced: ReducedBody) -> np.ndarray:
    """Rows that give the mean translation and rotation of the rim, `[6, 3 rim]`."""
    area, rigid = _rim_area(reduced), rigid_motions(reduced.rim_nodes)
    return np.linalg.solve(inertia_of(area, rigid), (area @ rigid).T)


def growth_report(reduced: ReducedBody, grown: np.ndarray, speeds: Sequence[float]) -> Report:
    """Radial growth of the rim at some speeds: mean by area, and that of both edges.

    **Arguments:**

    - `reduced`: the condensed body.
    - `grown`: motion of its rim at unit speed, see `growth`.
    - `speeds`: [rad/s].

    **Returns:**

    Growth by speed; left is the edge of the smallest z.
    """
    x, y, z = reduced.rim_nodes.T
    outward = np.stack([x, y, 0 * z], axis=1) / np.hypot(x, y)[:, None]
    area = _rim_area(reduced) @ outward.ravel()
    radial = np.einsum("ij,ij->i", grown.reshape(-1, 3), outward)
    near = 1e-6 * np.ptp(z)
    places = {
        "": float(area @ grown / (area @ outward.ravel())),
        "_left": float(radial[z <= z.min() + near].mean()),
        "_right": float(radial[z >= z.max() - near].mean()),
    }
    return {
        f"centrifugal_growth{place}_um_at_rad_s": {
            f"{speed:g}": 1e6 * each * float(speed) ** 2 for speed in speeds
        }
        for place, each in places.items()
    }


def tooth_row(
    reduced: ReducedBody, direction: np.ndarray, root_thickness: float | None = None
) -> np.ndarray:
    """Mean motion of the rim under tooth 0 along a direction; also a unit load spread there.

    Under the tooth are the elements of the rim nearest to the x axis, over all of the width, and
    those with their middles within the root of the tooth.

    **Arguments:**

    - `reduced`: the condensed body.
    - `direction`: shape `[3]` [-].
    - `root_thickness`: of a tooth, along the rim [m].

    **Returns:**

    A row on the coordinates of the boundary, `[boundary]` [-].
    """
    nodes, faces = reduced.rim_nodes, reduced.rim_faces
    radius = float(np.hypot(*nodes[:, :2].T).max())
    middles = nodes[faces].mean(axis=1) if len(faces) else nodes
    away = np.abs(np.arctan2(middles[:, 1], middles[:, 0]))
    reach = 0.0 if root_thickness is None else root_thickness / (2 * radius)
    under = away <= max(away.min() + 1e-6, reach)
    weights = np.where(under, 1.0, 0.0)
    if len(faces):
        weights = np.asarray(surface_mass(nodes, faces[under]).sum(axis=1))[::3]
    row = np.zeros(reduced.boundary_dofs)
    row[: nodes.size] = np.outer(weights / weights.sum(), direction).ravel()
    return row


def seat_rows(reduced: ReducedBody) -> np.ndarray:
    """Rows of the seats' coordinates on those of the boundary, `[6 seat, boundary]`."""
    seats = 6 * len(reduced.seats)
    return np.eye(seats, reduced.boundary_dofs, k=reduced.boundary_dofs - seats)


def spring_rows(
    reduced: ReducedBody, row: np.ndarray, springs: Springs, *, mesh: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Rows that give the stretch of every spring, `[spring, boundary]`, and their stiffness."""
    rows, stiffness = seat_rows(reduced), np.tile(springs.seat, len(reduced.seats))
    if not mesh:
        return rows, stiffness
    return np.vstack([rows, row]), np.append(stiffness, springs.mesh)


def spring_matrix(
    reduced: ReducedBody, row: np.ndarray, springs: Springs, *, mesh: bool
) -> np.ndarray:
    """Stiffness of the springs on the coordinates of the condensed body, `[dof, dof]`."""
    rows, stiffness = spring_rows(reduced, row, springs, mesh=mesh)
    matrix = np.zeros(reduced.stiffness.shape)
    outer = reduced.boundary_dofs
    matrix[:outer, :outer] = rows.T @ (stiffness[:, None] * rows)
    return matrix


def tooth_load(reduced: ReducedBody, row: np.ndarray, torque_seat: str | None = None) -> np.ndarray:
    """A unit load on tooth 0, and on a seat the torque that balances it.

    **Arguments:**

    - `reduced`: the condensed body.
    - `row`: where the load is, see `tooth_row`.
    - `torque_seat`: name of the seat where the torque leaves; the first one without it.

    **Returns:**

    Shape `[boundary]` [-].

    **Raises:**

    - `BodyError` if there is no such seat.
    """
    seat = torque_seat or reduced.seats[0]
    require(
        seat in reduced.seats,
        "The torque must leave at a seat of the body, got {seat!r}; its seats are {seats}.",
        seat=seat,
        seats=", ".join(reduced.seats),
    )
    turn = reduced.rim_nodes.size + 6 * reduced.seats.index(seat) + 5
    load = row.copy()
    load[turn] -= row @ reduced.rigid_motions[: reduced.boundary_dofs, 5]
    return load


def tooth_deflection(
    reduced: ReducedBody, row: np.ndarray, springs: Springs, torque_seat: str | None = None
) -> np.ndarray | None:
    """Motion of the boundary under a unit load on tooth 0, the torque held at a seat.

    **Arguments:**

    - `reduced`: the condensed body, its seats on springs.
    - `row`: where the load is, see `tooth_row`.
    - `springs`: those of the seats.
    - `torque_seat`: name of the seat where the torque leaves; the first one without it.

    **Returns:**

    Shape `[boundary]` [SI/N]; None if the body has no seats.

    **Raises:**

    - `BodyError` if there is no such seat.
    """
    if not reduced.seats:
        return None
    outer = reduced.boundary_dofs
    stiffness = reduced.stiffness + spring_matrix(reduced, row, springs, mesh=False)
    load = np.zeros(reduced.dofs)
    load[:outer] = tooth_load(reduced, row, torque_seat)
    return scipy.linalg.solve(stiffness, load, assume_a="pos", check_finite=False)[:outer]


def tooth_report(
    reduced: ReducedBody,
    bent: np.ndarray,
    row: np.ndarray,
    springs: Springs,
    torque_seat: str | None = None,
) -> Report:
    """Deflection under a tooth load, and the body's own share of it."""
    rows, stiffness = spring_rows(reduced, row, springs, mesh=False)
    # Work of load and torque, so the deflection is that against the turn of the torque's seat.
    # Twice the energies of all springs is what the seats give of it.
    whole = float(tooth_load(reduced, row, torque_seat) @ bent)
    given = float(stiffness @ (rows @ bent) ** 2)
    return {
        "tooth_deflection_um_N": 1e6 * whole,
        "tooth_deflection_of_body_um_N": 1e6 * (whole - given),
    }
