"""What a condensed body is, in numbers: mass, rigid motions, modes, growth, a tooth load.

Every function answers one question about a body, as numbers, texts, and lists and mappings of
them; a unit is part of a name.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import eigsh

from ._artefact import ReducedBody, balanced, floating, rigid_motions
from ._assembly import surface_mass
from ._boundary import FullBody
from ._checks import Progress, require, silent
from ._condense import Held, recovered
from ._fourier import NodalPattern, families, identify, symmetry_splitting
from ._modes import operator_of, reduced_modes
from ._quality import quality
from ._web import Properties

# Modes are rigid if the square of their frequency is below this, over that of the highest one.
_RIGID = 1e-6


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


@dataclass(frozen=True)
class Solid:
    """What is known of the mass of a body, without teeth that the grid leaves out.

    **Fields:**

    - `mass`: [kg].
    - `centre`: of mass, shape `[3]` [m].
    - `inertia`: tensor about the middle of the toothed face, shape `[3, 3]` [kg m2].
    """

    mass: float
    centre: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class FreeModes:
    """Modes of a free condensed body.

    **Fields:**

    - `rigid`: number of rigid ones.
    - `frequency`: of the elastic ones, rising, shape `[mode]` [Hz].
    - `shapes`: of the elastic ones, of unit modal mass, on the grid, or on the rim of a body
        without one, shape `[mode, node, 3]` [SI].
    - `pattern`: their nodal diameters and circles.
    - `whole`: whether shapes are those of the grid; circles mean nothing on the rim alone.
    """

    rigid: int
    frequency: np.ndarray
    shapes: np.ndarray
    pattern: NodalPattern
    whole: bool


def solid_of(properties: Properties, density: float) -> Solid:
    """Mass of a body by its exact volume.

    **Arguments:**

    - `properties`: moments of its volume.
    - `density`: [kg/m3].

    **Returns:**

    Its mass.
    """
    return Solid(
        density * properties.volume,
        properties.first / properties.volume,
        density * properties.inertia,
    )


def described_modes(
    reduced: ReducedBody, held: Held | None = None, *, count: int = 40, progress: Progress = silent
) -> FreeModes:
    """Lowest free modes of a condensed body, with nodal diameters and circles.

    **Arguments:**

    - `reduced`: the condensed body.
    - `held`: the full body with its boundary held; without it shapes are those of the rim alone.
    - `count`: number of elastic modes; fewer, if the body has not so many.
    - `progress`: told what begins.

    **Returns:**

    The modes.
    """
    with progress(f"{count} free modes of {reduced.dofs} coordinates"):
        square, shapes = reduced_modes(reduced, min(count + 6, reduced.dofs - 2))
    rigid = int(np.sum(square < _RIGID * square[-1]))
    elastic = shapes[:, rigid:]
    with progress("nodal diameters"):
        if held is None:
            points, weights = reduced.rim_nodes, None
            motion = elastic[: points.size].T.reshape(-1, *points.shape)
        else:
            points, weights = reduced.nodes, held.full.grid_mass.diagonal()[::3]
            motion = recovered(held, reduced, elastic)
        pattern = identify(points, motion, weights=weights)
    frequency = np.sqrt(square[rigid:]) / (2 * math.pi)
    return FreeModes(rigid, frequency, motion, pattern, whole=held is not None)


def modes_told(reduced: ReducedBody) -> int:
    """How many modes are told and compared: 40, if the body has so many; at least 10."""
    return min(40, max(10, _modes_kept(reduced)))


def counts(full: FullBody | None, reduced: ReducedBody) -> dict[str, Any]:
    """Sizes of the full and of the condensed body."""
    sizes: dict[str, Any] = {
        "rim_nodes": len(reduced.rim_nodes),
        "seats": list(reduced.seats),
        "boundary_dofs": reduced.boundary_dofs,
        "modes": _modes_kept(reduced),
        "interior_shapes": reduced.interior,
        "condensed_dofs": reduced.dofs,
    }
    if full is not None:
        sizes["nodes"] = len(full.grid.nodes)
        sizes["elements"] = len(full.grid.bricks)
        sizes["dofs"] = 3 * full.points
    known = ("method", "sectors")
    return sizes | {name: reduced.facts[name] for name in known if name in reduced.facts}


def _modes_kept(reduced: ReducedBody) -> int:
    kept = reduced.facts.get("modes", 0)
    return kept if isinstance(kept, int) and reduced.facts.get("method") != "guyan" else 0


def mass_properties(
    full: FullBody | None, reduced: ReducedBody, exact: Solid | None
) -> dict[str, Any]:
    """Mass, centre and inertias by rigid motions, and how far they are from what they should be.

    Inertias are about the middle of the toothed face, the transverse one the mean of both. Teeth
    that the grid leaves out count in all, but not in what is compared with the solid; what the
    skin that stands for them weighs is told beside what they weigh themselves.
    """
    condensed = inertia_of(reduced.mass, reduced.rigid_motions)
    total = condensed if full is None else inertia_of(full.mass, full.rigid_motions)
    mass, centre, polar, transverse = _told(total)
    found: dict[str, Any] = {
        "mass_kg": mass,
        "centre_of_mass_mm": [float(1e3 * x) for x in centre],
        "polar_inertia_kg_m2": polar,
        "transverse_inertia_about_mid_face_kg_m2": transverse,
        "unbalance_g_mm": float(1e6 * mass * np.hypot(*centre[:2])),
    }
    if full is not None:
        # Each of the six is measured by its own size, as units differ.
        size = np.sqrt(np.diag(total))
        off = np.abs(condensed - total) / np.outer(size, size)
        found["condensed_mass_deviation"] = float(off.max())
    skin = np.zeros((6, 6)) if full is None else _teeth_inertia(full)
    if full is not None and full.teeth is not None:
        found["teeth_mass_kg"] = float(full.teeth.mass)
        found["lumped_teeth_mass_kg"] = _told(skin)[0]
    if exact is not None:
        mass, centre, polar, transverse = _told(total - skin)
        expected = exact.inertia
        found["solid_mass_kg"] = float(exact.mass)
        found["mass_deviation"] = float(mass / exact.mass - 1)
        found["polar_inertia_deviation"] = float(polar / expected[2, 2] - 1)
        found["transverse_inertia_deviation"] = float(
            2 * transverse / (expected[0, 0] + expected[1, 1]) - 1
        )
        off = np.linalg.norm(centre - exact.centre)
        found["centre_of_mass_deviation_mm"] = float(1e3 * off)
    return found


def inertia_of(mass: np.ndarray | csr_array, rigid: np.ndarray) -> np.ndarray:
    """Mass and inertias by the six rigid motions, `[6, 6]` [SI]."""
    return rigid.T @ (mass @ rigid)


def _told(inertia: np.ndarray) -> tuple[float, np.ndarray, float, float]:
    """Mass, centre, polar and mean transverse inertia, from the mass of six rigid motions."""
    mass = np.trace(inertia[:3, :3]) / 3
    centre = np.array([inertia[1, 5], inertia[2, 3], inertia[0, 4]]) / mass
    return float(mass), centre, float(inertia[5, 5]), float(inertia[3, 3] + inertia[4, 4]) / 2


def _teeth_inertia(full: FullBody) -> np.ndarray:
    """What the skin in the place of teeth brings to the mass of six rigid motions."""
    if full.teeth is None:
        return np.zeros((6, 6))
    skin = surface_mass(full.grid.nodes, full.rim[full.rim_faces])
    whole = inertia_of(skin, rigid_motions(full.grid.nodes))
    return whole * (full.teeth.polar_inertia / whole[5, 5])


def rigid_energies(full: FullBody | None, reduced: ReducedBody) -> dict[str, Any]:
    r"""Energies of unit rigid motions, which should be none.

    Relative ones are over what the same displacements would store one by one,
    $\frac{1}{2} \sum K_{ii} r_i^2$. `rigid_body_residual` is $|K R| / (|K| |R|)$ by Frobenius.
    """
    energy, relative, residual = _rigid_energy(reduced.stiffness, reduced.rigid_motions)
    found: dict[str, Any] = {
        "rigid_body_energy_J": energy,
        "rigid_body_energy_relative": relative,
        "rigid_body_residual": residual,
    }
    if full is not None:
        energy, relative, residual = _rigid_energy(full.stiffness, full.rigid_motions)
        found["full_rigid_body_energy_relative"] = relative
        found["full_rigid_body_residual"] = residual
    return found


def _rigid_energy(
    stiffness: np.ndarray | csr_array, rigid: np.ndarray
) -> tuple[list[float], list[float], float]:
    forces = stiffness @ rigid
    energy = np.abs(np.einsum("ij,ij->j", rigid, forces)) / 2
    alone = stiffness.diagonal() @ rigid**2 / 2
    entries = stiffness if isinstance(stiffness, np.ndarray) else stiffness.data
    size = np.linalg.norm(entries) * np.linalg.norm(rigid)
    return energy.tolist(), (energy / alone).tolist(), float(np.linalg.norm(forces) / size)


def modes_report(modes: FreeModes) -> dict[str, Any]:
    """First free frequencies with nodal diameters, families, and pairs with their splitting."""
    pattern = modes.pattern
    found: dict[str, Any] = {
        "rigid_body_modes": modes.rigid,
        "free_frequency_Hz": modes.frequency.tolist(),
        "nodal_diameter": pattern.diameter.tolist(),
        "nodal_diameter_share": pattern.share.tolist(),
        "kind": list(pattern.kind),
    }
    if not modes.whole:
        return found
    found["nodal_circle"] = pattern.circle.tolist()
    found["families"] = [
        {
            "kind": family.kind,
            "nodal_circle": int(family.circle),
            "nodal_diameter": family.diameter.tolist(),
            "frequency_Hz": family.frequency.tolist(),
        }
        for family in families(pattern, modes.frequency)
    ]
    pairs = symmetry_splitting(pattern, modes.frequency)
    found["pairs"] = [{"modes": [i, j], "split": split} for i, j, split in pairs]
    return found


def growth(reduced: ReducedBody) -> np.ndarray:
    """Motion of the rim under centrifugal load of unit speed, `[3 rim]` [m s2/rad2].

    The body floats: what of the load is not balanced accelerates it. Motion is told relative to
    the mean motion of the rim.
    """
    load = balanced(reduced.centrifugal_load, reduced.mass, reduced.rigid_motions)
    return off_mean(reduced, floating(reduced, load)[: reduced.rim_nodes.size])


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


def growth_report(
    reduced: ReducedBody, grown: np.ndarray, speeds: Sequence[float]
) -> dict[str, Any]:
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
) -> dict[str, Any]:
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


def conditioning(reduced: ReducedBody) -> dict[str, Any]:
    """Largest natural frequency, and how near to singular the mass is.

    The condition number is that of the mass scaled to a unit diagonal, in the 1-norm: units do not
    count. Both are estimates, and are left out if the mass is not positive definite.
    """
    scale = 1 / np.sqrt(np.abs(reduced.mass.diagonal()))
    mass = reduced.mass * np.outer(scale, scale)
    size = np.abs(mass).sum(axis=0).max()
    try:
        lower = scipy.linalg.cholesky(mass, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return {"mass_definite": False}
    (estimate,) = scipy.linalg.get_lapack_funcs(("pocon",), (lower,))
    reciprocal, _ = estimate(lower, size, uplo="L")
    stiffness = reduced.stiffness * np.outer(scale, scale)

    def dynamic(vector: np.ndarray) -> np.ndarray:
        right = scipy.linalg.solve_triangular(
            lower, vector, trans=1, lower=True, check_finite=False
        )
        return scipy.linalg.solve_triangular(
            lower, stiffness @ right, lower=True, check_finite=False
        )

    start = np.random.default_rng(0).standard_normal(reduced.dofs)
    square = eigsh(
        operator_of(reduced.dofs, dynamic),
        1,
        which="LA",
        v0=start,
        tol=1e-3,  # pyright: ignore[reportArgumentType]
        return_eigenvectors=False,
    )
    return {
        "mass_definite": True,
        "largest_frequency_Hz": float(math.sqrt(square[0]) / (2 * math.pi)),
        # Its last digits depend on where in memory the matrix lies, and this is hashed.
        "mass_condition": float(f"{1 / max(reciprocal, 1e-300):.12g}"),
    }


def brick_report(full: FullBody) -> dict[str, Any]:
    """How well shaped the bricks are."""
    found = quality(full.grid)
    return {
        "smallest_jacobian_ratio": found.smallest_jacobian_ratio,
        "largest_aspect_ratio": found.largest_aspect_ratio,
        "worst_brick_mm": [float(1e3 * x) for x in found.place],
    }


def rim_report(reduced: ReducedBody, root_thickness: float | None) -> dict[str, Any]:
    """Size of the rim's elements, on which the flexibility under one tooth depends."""
    if not len(reduced.rim_faces):
        return {}
    x, y, z = reduced.rim_nodes.T
    corners = reduced.rim_faces[:, :4]
    angle = np.arctan2(y, x)[corners]
    # Angles from one corner on: elements across the cut at pi must not look long.
    turned = np.mod(angle - angle[:, :1] + math.pi, 2 * math.pi)
    arc = float(np.max(np.ptp(turned, axis=1)) * np.hypot(x, y).max())
    axial = float(np.max(np.ptp(z[corners], axis=1)))
    found: dict[str, Any] = {
        "rim_element_arc_mm": 1e3 * arc,
        "rim_element_axial_mm": 1e3 * axial,
        "rim_elements_across": float(np.ptp(z) / axial),
    }
    if root_thickness is not None:
        found["root_thickness_mm"] = 1e3 * float(root_thickness)
    return found
