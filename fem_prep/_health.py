r"""The health of a condensed body: what it is, and how far it is from the full one.

Both bodies are asked the same questions in coordinates of the boundary: rim, then seats. The full
one is solved by one factor: of its stiffness on six supports, which carry nothing if loads balance
each other. Springs, and motions of the body as a whole, are added to that by the flexibility
method, so that the answer owes nothing to the condensation.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, vstack
from scipy.sparse.linalg import LinearOperator, eigsh

from ._artefact import ReducedBody, floating, rigid_motions
from ._assembly import order, surface_mass
from ._boundary import FullBody, dofs_of, full_body
from ._checks import Progress, require, silent
from ._condense import Held, hold, recovered
from ._fourier import NodalPattern, families, identify, symmetry_splitting
from ._modes import free_modes, reduced_modes
from ._quality import quality
from ._solvers import Factor, factorise
from ._web import Properties

# Modes are rigid if the square of their frequency is below this, over that of the highest one.
_RIGID = 1e-6

# What is not as it should be. Frequencies and statics: what the synthesis promises.
_MASS_OFF = 1e-3
_RIGID_ENERGY = 1e-8
_FREQUENCY_OFF = 1e-3
_STATIC_OFF = 1e-7
# Frequencies on springs that differ by more say that the coupling of the seats is a decision.
_COUPLING_OFF = 0.02
# Slender bricks stiffen thin webs, skew ones everything; both are fair well beyond what gears need.
_JACOBIAN, _ASPECT = 0.1, 25.0
# One element of 1.5 root thicknesses per tooth gives 4% less deflection under an even load than
# elements of 0.4, one of 0.75 gives 0.6% less; longer ones carry two teeth.
_LONG_ELEMENT = 2.0
_FEWEST_ACROSS = 2


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


def health_report(
    full: FullBody | None,
    held: Held | None,
    reduced: ReducedBody,
    *,
    exact: Solid | None = None,
    modes: FreeModes | None = None,
    free_frequency: Sequence[float] | np.ndarray | None = None,
    root_thickness: float | None = None,
    springs: Springs | None = None,
    speeds: Sequence[float] = (500.0, 1000.0, 1500.0),
    couplings: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """What a condensed body is, how far it is from the full one, and what is wrong with it.

    **Arguments:**

    - `full`: the body in all its unknowns; None, as for matrices from elsewhere: nothing is
        compared.
    - `held`: the same with its boundary held, as it was condensed; None: it is held again.
    - `reduced`: the condensed body.
    - `exact`: what its mass should be, if known.
    - `modes`: of the condensed body, if known.
    - `free_frequency`: elastic ones of the full body, rising, if known [Hz]. Without them those
        among the facts of the condensed body are taken, or they are sought, which takes long.
    - `root_thickness`: of a tooth, along the rim [m].
    - `springs`: on which the body is compared.
    - `speeds`: at which the growth of the rim is told [rad/s].
    - `couplings`: also compare rigid and averaging seats, which takes another factor.
    - `progress`: told what begins.

    **Returns:**

    Numbers, texts, and lists and mappings of them, by name; a unit is part of the name. The last
    one, `warnings`, says in sentences what is not as it should be.

    **Raises:**

    - `BodyError` if the condensed body has no mass.
    """
    require(
        reduced.mass.any(),
        "{name} must have a mass for its health to be told, and has none: matrices taken over for "
        "statics alone are not judged.",
        name=reduced.name,
    )
    springs = Springs() if springs is None else springs
    if modes is None:
        if full is not None and held is None:
            held = hold(full, progress=progress)
        modes = described_modes(reduced, held, count=modes_told(reduced), progress=progress)
    report = counts(full, reduced) | mass_properties(full, reduced, exact)
    report |= rigid_energies(full, reduced) | modes_report(modes)
    with progress("centrifugal growth and a tooth load"):
        grown = growth(reduced)
        report |= growth_report(reduced, grown, speeds)
        row = tooth_row(reduced, springs.line_of_action, root_thickness)
        bent = tooth_deflection(reduced, row, springs)
        if bent is not None:
            report |= _tooth_report(reduced, bent, row, springs)
    with progress("largest frequency"):
        report |= conditioning(reduced)
    if full is not None:
        free = reduced.facts.get("free_frequency_Hz") if free_frequency is None else free_frequency
        report |= free_error(full, modes, free, progress)
        report |= _compared(full, reduced, grown, bent, row, springs, couplings, progress)
        report |= brick_report(full)
    report |= rim_report(reduced, root_thickness)
    return report | {"warnings": verdicts(report)}


def modes_told(reduced: ReducedBody) -> int:
    """How many modes are told and compared: 40, if the body has so many; at least 10."""
    return min(40, max(10, _modes_kept(reduced)))


# --- What the body is


def counts(full: FullBody | None, reduced: ReducedBody) -> dict[str, Any]:
    """Sizes of the full and of the condensed body."""
    sizes: dict[str, Any] = {
        "name": reduced.name,
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
    that the grid leaves out count in all, but not in what is compared with the solid.
    """
    condensed = _inertia(reduced.mass, reduced.rigid_motions)
    total = condensed if full is None else _inertia(full.mass, full.rigid_motions)
    mass, centre, polar, transverse = _told(total)
    found: dict[str, Any] = {
        "mass_kg": mass,
        "centre_of_mass_mm": [float(1e3 * x) for x in centre],
        "polar_inertia_kg_m2": polar,
        "transverse_inertia_kg_m2": transverse,
        "unbalance_g_mm": float(1e6 * mass * np.hypot(*centre[:2])),
    }
    if full is not None:
        # Each of the six is measured by its own size, as units differ.
        size = np.sqrt(np.diag(total))
        off = np.abs(condensed - total) / np.outer(size, size)
        found["condensed_mass_deviation"] = float(off.max())
    if exact is not None:
        skin = np.zeros((6, 6)) if full is None else _teeth_inertia(full)
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


def _inertia(mass: np.ndarray | csr_array, rigid: np.ndarray) -> np.ndarray:
    return rigid.T @ (mass @ rigid)


def _told(inertia: np.ndarray) -> tuple[float, np.ndarray, float, float]:
    """Mass, centre, polar and mean transverse inertia, from the mass of six rigid motions."""
    mass = np.trace(inertia[:3, :3]) / 3
    centre = np.array([inertia[1, 5], inertia[2, 3], inertia[0, 4]]) / mass
    return float(mass), centre, float(inertia[5, 5]), float(inertia[3, 3] + inertia[4, 4]) / 2


def _teeth_inertia(full: FullBody) -> np.ndarray:
    """What teeth left out by the grid bring to the mass of six rigid motions."""
    if full.teeth is None:
        return np.zeros((6, 6))
    skin = surface_mass(full.grid.nodes, full.rim[full.rim_faces])
    whole = _inertia(skin, rigid_motions(full.grid.nodes))
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
    load = _balanced(reduced.centrifugal_load, reduced.mass, reduced.rigid_motions)
    return _off_mean(reduced, floating(reduced, load)[: reduced.rim_nodes.size])


def _balanced(load: np.ndarray, mass: np.ndarray | csr_array, rigid: np.ndarray) -> np.ndarray:
    """A load less that of the rigid acceleration it causes."""
    return load - mass @ (rigid @ np.linalg.solve(_inertia(mass, rigid), rigid.T @ load))


def _off_mean(reduced: ReducedBody, motion: np.ndarray) -> np.ndarray:
    """Motion of the rim relative to its own mean motion, `[3 rim]` or `[3 rim, column]`."""
    return motion - rigid_motions(reduced.rim_nodes) @ (_rim_rows(reduced) @ motion)


def _rim_area(reduced: ReducedBody) -> csr_array:
    """Weights of the rim's nodes: those of its area, or all the same if faces are not known."""
    if len(reduced.rim_faces):
        return surface_mass(reduced.rim_nodes, reduced.rim_faces)
    return csr_array(diags_array(np.ones(reduced.rim_nodes.size)))


def _rim_rows(reduced: ReducedBody) -> np.ndarray:
    """Rows that give the mean translation and rotation of the rim, `[6, 3 rim]`."""
    area, rigid = _rim_area(reduced), rigid_motions(reduced.rim_nodes)
    return np.linalg.solve(_inertia(area, rigid), (area @ rigid).T)


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


def _seat_rows(reduced: ReducedBody) -> np.ndarray:
    """Rows of the seats' coordinates on those of the boundary, `[6 seat, boundary]`."""
    seats = 6 * len(reduced.seats)
    return np.eye(seats, reduced.boundary_dofs, k=reduced.boundary_dofs - seats)


def _spring_rows(
    reduced: ReducedBody, row: np.ndarray, springs: Springs, *, mesh: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Rows that give the stretch of every spring, `[spring, boundary]`, and their stiffness."""
    rows, stiffness = _seat_rows(reduced), np.tile(springs.seat, len(reduced.seats))
    if not mesh:
        return rows, stiffness
    return np.vstack([rows, row]), np.append(stiffness, springs.mesh)


def _spring_matrix(
    reduced: ReducedBody, row: np.ndarray, springs: Springs, *, mesh: bool
) -> np.ndarray:
    """Stiffness of the springs on the coordinates of the condensed body, `[dof, dof]`."""
    rows, stiffness = _spring_rows(reduced, row, springs, mesh=mesh)
    matrix = np.zeros(reduced.stiffness.shape)
    outer = reduced.boundary_dofs
    matrix[:outer, :outer] = rows.T @ (stiffness[:, None] * rows)
    return matrix


def _tooth_load(reduced: ReducedBody, row: np.ndarray) -> np.ndarray:
    """A unit load on tooth 0, and on the first seat the torque that balances it."""
    load = row.copy()
    load[reduced.rim_nodes.size + 5] -= row @ reduced.rigid_motions[: reduced.boundary_dofs, 5]
    return load


def tooth_deflection(reduced: ReducedBody, row: np.ndarray, springs: Springs) -> np.ndarray | None:
    """Motion of the boundary under a unit load on tooth 0, the torque held at the first seat.

    **Arguments:**

    - `reduced`: the condensed body, its seats on springs.
    - `row`: where the load is, see `tooth_row`.
    - `springs`: those of the seats.

    **Returns:**

    Shape `[boundary]` [SI/N]; None if the body has no seats.
    """
    if not reduced.seats:
        return None
    outer = reduced.boundary_dofs
    stiffness = reduced.stiffness + _spring_matrix(reduced, row, springs, mesh=False)
    load = np.concatenate([_tooth_load(reduced, row), np.zeros(reduced.dofs - outer)])
    return scipy.linalg.solve(stiffness, load, assume_a="pos", check_finite=False)[:outer]


def _tooth_report(
    reduced: ReducedBody, bent: np.ndarray, row: np.ndarray, springs: Springs
) -> dict[str, Any]:
    rows, stiffness = _spring_rows(reduced, row, springs, mesh=False)
    # Work of load and torque, so the deflection is that against the turn of the first seat. Twice
    # the energies of all springs is what the seats give of it.
    whole = float(_tooth_load(reduced, row) @ bent)
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
    operator = _operator(reduced.dofs, dynamic)
    square = eigsh(
        operator,
        1,
        which="LA",
        v0=start,
        tol=1e-3,  # pyright: ignore[reportArgumentType]
        return_eigenvectors=False,
    )
    return {
        "mass_definite": True,
        "largest_frequency_Hz": float(math.sqrt(square[0]) / (2 * math.pi)),
        "mass_condition": float(1 / max(reciprocal, 1e-300)),
    }


def _operator(size: int, product: Callable[[np.ndarray], np.ndarray]) -> LinearOperator:
    return LinearOperator((size, size), matvec=product, dtype=np.float64)  # pyright: ignore[reportCallIssue]


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


# --- How far it is from the full body


@dataclass(frozen=True)
class _Grounded:
    """A full body on six supports that keep it from moving as a whole.

    **Fields:**

    - `full`: the body.
    - `boundary`: coordinates of the boundary from the unknowns, `[boundary, 3 point]` [SI].
    - `factor`: of the stiffness on the supports.
    - `rigid`: rigid motions, `[3 point, 6]` [SI].
    """

    full: FullBody
    boundary: csr_array
    factor: Factor
    rigid: np.ndarray

    def floating(self, load: np.ndarray) -> np.ndarray:
        """Motion of the boundary of the free body under balanced loads, but for rigid motions."""
        return self.boundary @ self.factor.solve(load)


def _grounded(full: FullBody, progress: Progress = silent) -> _Grounded:
    """Put a full body on six supports on the rim, each of one unknown."""
    x, y, z = full.grid.nodes[full.rim].T
    del z
    angle = np.arctan2(y, x)
    apart = [np.cos(angle - place).argmax() for place in (0.0, 2 * np.pi / 3, -2 * np.pi / 3)]
    first, second, third = (3 * full.rim_points[near] for near in apart)
    # Along z at three points; in the plane both ways at the first, and along y at the second.
    supports = np.array([first, first + 1, first + 2, second + 1, second + 2, third + 2])
    size = order(full.stiffness)
    ground = coo_array((full.stiffness.diagonal()[supports], (supports, supports)), (size, size))
    with progress(f"factorising {size} unknowns"):
        factor = factorise(csc_array(full.stiffness + ground))
    return _Grounded(full, _boundary_rows(full), factor, full.rigid_motions)


def _boundary_rows(full: FullBody) -> csr_array:
    """Rows that give rim and seats, averaging or not, from the unknowns."""
    size = 3 * full.points
    every = csr_array(diags_array(np.ones(size)))
    blocks = [every[dofs_of(full.rim_points)]]
    ring = size - 6 * sum(not seat.averaging for seat in full.seats)
    mean = 0
    for seat in full.seats:
        if seat.averaging:
            blocks.append(full.averages[mean : mean + 6])
            mean += 6
        else:
            blocks.append(every[ring : ring + 6])
            ring += 6
    return csr_array(vstack(blocks))


def _on_springs(
    body: _Grounded, rows: np.ndarray, stiffness: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    r"""A solver of a full body on springs between its boundary and the ground.

    Forces $y$ of the springs and rigid motions $q$ are such that loads balance,
    $R^T (f - P^T y) = 0$, and that $P u = S^{-1} y$, where $u = A^{-1} (f - P^T y) + R q$.

    **Arguments:**

    - `body`: the body on its supports.
    - `rows`: $P$, stretch of every spring, `[spring, boundary]`.
    - `stiffness`: $S$, of the springs, `[spring]`.

    **Returns:**

    Motion of all unknowns, `[3 point]`, of a load, `[3 point]`.
    """
    # Of unit stiffness all, lest units of length and angle mix.
    pull = body.boundary.T @ (np.sqrt(stiffness)[:, None] * rows).T
    flexible = body.factor.solve(pull)
    rigid = body.rigid / np.linalg.norm(pull.T @ body.rigid, axis=0)
    count = len(stiffness)
    joint = np.zeros((count + 6, count + 6))
    joint[:count, :count] = pull.T @ flexible + np.eye(count)
    joint[:count, count:] = -pull.T @ rigid
    joint[count:, :count] = joint[:count, count:].T
    inverse = np.linalg.inv(joint)

    def solve(load: np.ndarray) -> np.ndarray:
        answer = body.factor.solve(load)
        both = inverse @ np.concatenate([pull.T @ answer, -rigid.T @ load])
        return answer - flexible @ both[:count] + rigid @ both[count:]

    return solve


def _sprung_frequencies(
    body: _Grounded, solve: Callable[[np.ndarray], np.ndarray], count: int
) -> np.ndarray:
    """Lowest natural frequencies of a full body on springs, rising [Hz]."""
    full = body.full
    start = np.random.default_rng(0).standard_normal(order(full.stiffness))
    # Inverted about zero, so that of the first matrix only the size is used.
    square = eigsh(
        full.stiffness,
        count,
        M=full.mass,
        sigma=0.0,
        OPinv=_operator(len(start), solve),
        v0=start,
        return_eigenvectors=False,
    )
    return np.sqrt(np.sort(square)) / (2 * math.pi)


def free_error(
    full: FullBody, modes: FreeModes, free_frequency: object, progress: Progress = silent
) -> dict[str, Any]:
    """Error of free natural frequencies by truncation.

    **Arguments:**

    - `full`: the full body.
    - `modes`: of the condensed body.
    - `free_frequency`: of the full body, elastic ones, rising [Hz]; None or empty: not known.
    - `progress`: told what begins.

    **Returns:**

    Relative error of every mode, and the largest.
    """
    known = np.asarray([] if free_frequency is None else free_frequency, dtype=float)
    if not known.size:
        square, _ = free_modes(full, len(modes.frequency), progress=progress)
        known = np.sqrt(square) / (2 * math.pi)
    count = min(len(known), len(modes.frequency))
    return _frequency_error("free", modes.frequency[:count], known[:count])


def _frequency_error(name: str, found: np.ndarray, wanted: np.ndarray) -> dict[str, Any]:
    error = found / wanted - 1
    return {
        f"{name}_frequency_error": error.tolist(),
        f"largest_{name}_frequency_error": float(np.abs(error).max()),
    }


def _compared(
    full: FullBody,
    reduced: ReducedBody,
    grown: np.ndarray,
    bent: np.ndarray | None,
    row: np.ndarray,
    springs: Springs,
    couplings: bool,
    progress: Progress,
) -> dict[str, Any]:
    """Errors of growth, of deflection under a tooth load, and of frequencies on springs."""
    body = _grounded(full, progress)
    load = _balanced(full.centrifugal_load, full.mass, body.rigid)
    rim = reduced.rim_nodes.size
    found: dict[str, Any] = {
        "centrifugal_growth_error": _off(grown, _off_mean(reduced, body.floating(load)[:rim]))
    }
    if bent is None:
        return found
    with progress("a tooth load on the full body"):
        solve = _on_springs(body, *_spring_rows(reduced, row, springs, mesh=False))
        answer = body.boundary @ solve(body.boundary.T @ _tooth_load(reduced, row))
        found["tooth_deflection_error"] = _off(bent[:rim], answer[:rim])
    count = min(max(10, modes_told(reduced) // 2), reduced.dofs - 2)
    with progress(f"{count} modes on springs"):
        solve = _on_springs(body, *_spring_rows(reduced, row, springs, mesh=True))
        wanted = _sprung_frequencies(body, solve, count)
        matrix = _spring_matrix(reduced, row, springs, mesh=True)
        square, _ = reduced_modes(reduced, count, matrix)
        sprung = np.sqrt(square) / (2 * math.pi)
    found["sprung_frequency_Hz"] = sprung.tolist()
    found |= _frequency_error("sprung", sprung, wanted)
    if couplings:
        found |= _coupling_difference(body, wanted, reduced, row, springs, progress)
    return found


def _off(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


# --- Rigid and averaging seats


def seat_coupling_difference(
    full: FullBody,
    reduced: ReducedBody,
    *,
    springs: Springs | None = None,
    root_thickness: float | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """The same body with rigid seats (RBE2) made averaging ones (RBE3), and the other way round.

    **Arguments:**

    - `full`: the body.
    - `reduced`: the same, condensed.
    - `springs`: on which the body is compared.
    - `root_thickness`: of a tooth, along the rim [m].
    - `progress`: told what begins.

    **Returns:**

    By seat: how it is coupled, its flexibility against the mean motion of the rim, that with the
    other coupling, and the relative difference; each radial, axial, in tilt and in turn. And the
    relative difference of the first six frequencies on springs.
    """
    springs = Springs() if springs is None else springs
    body = _grounded(full, progress)
    row = tooth_row(reduced, springs.line_of_action, root_thickness)
    solve = _on_springs(body, *_spring_rows(reduced, row, springs, mesh=True))
    frequencies = _sprung_frequencies(body, solve, 6)
    return _coupling_difference(body, frequencies, reduced, row, springs, progress)


def _coupling_difference(
    body: _Grounded,
    frequencies: np.ndarray,
    reduced: ReducedBody,
    row: np.ndarray,
    springs: Springs,
    progress: Progress,
) -> dict[str, Any]:
    full = body.full
    seats = [replace(seat, averaging=not seat.averaging) for seat in full.seats]
    # No probes: they may be on seats that become rigid.
    other = full_body(
        full.name, full.grid, full.material, seats, teeth=full.teeth, progress=progress
    )
    changed = _grounded(other, progress)
    with progress("the other coupling of the seats"):
        solve = _on_springs(changed, *_spring_rows(reduced, row, springs, mesh=True))
        moved = _sprung_frequencies(changed, solve, 6)
        this, that = (_seat_flexibility(each, reduced) for each in (body, changed))
    names = ("radial_um_N", "axial_um_N", "tilt_urad_Nm", "turn_urad_Nm")
    told = []
    for seat, here, there in zip(full.seats, this, that, strict=True):
        told.append(
            {
                "name": seat.name,
                "coupling": "averaging" if seat.averaging else "rigid",
                "flexibility": dict(zip(names, (1e6 * here).tolist(), strict=True)),
                "other_flexibility": dict(zip(names, (1e6 * there).tolist(), strict=True)),
                "difference": dict(zip(names, (there / here - 1).tolist(), strict=True)),
            }
        )
    frequency = moved / frequencies[:6] - 1
    return {
        "seat_coupling": told,
        "coupling_frequency_difference": frequency.tolist(),
        "largest_coupling_frequency_difference": float(np.abs(frequency).max()),
    }


def _seat_flexibility(body: _Grounded, reduced: ReducedBody) -> np.ndarray:
    """Flexibility of every seat against the mean motion of the rim, `[seat, 4]` [SI].

    Radial, axial, tilt, turn; of the two in the plane and of the two tilts the means.
    """
    rim = reduced.rim_nodes.size
    seats = _seat_rows(reduced)
    mean = np.zeros((6, reduced.boundary_dofs))
    mean[:, :rim] = _rim_rows(reduced)
    # Loads on the seats, each balanced by what moves the rim as a whole.
    rows = seats - (seats @ reduced.rigid_motions[: reduced.boundary_dofs]) @ mean
    answer = body.floating(body.boundary.T @ rows.T)
    flexibility = np.einsum("ij,ji->i", rows, answer).reshape(-1, 6)
    groups = ([0, 1], [2], [3, 4], [5])
    return np.stack([flexibility[:, group].mean(axis=1) for group in groups], axis=1)


# --- What is wrong


def verdicts(report: Mapping[str, Any]) -> list[str]:
    """What of a health report is not as it should be, and what to do.

    **Arguments:**

    - `report`: see `health_report`; what it lacks is not judged.

    **Returns:**

    Sentences; none if all is well.
    """
    return [
        *_of_mass(report),
        *_of_rigid_motions(report),
        *_of_truncation(report),
        *_of_statics(report),
        *_of_seats(report),
        *_of_grid(report),
    ]


def _value(report: Mapping[str, Any], key: str, otherwise: float = 0.0) -> float:
    value = report.get(key, otherwise)
    return float(value) if isinstance(value, int | float) else otherwise


def _largest(report: Mapping[str, Any], key: str) -> float:
    values = report.get(key, [])
    return max(values) if isinstance(values, list) and values else 0.0


def _of_mass(report: Mapping[str, Any]) -> Iterator[str]:
    if report.get("mass_definite") is False:
        yield (
            "The condensed mass is not positive definite, so the body cannot be moved in time. "
            "Condense it again, or check the files that it came from."
        )
    off = {
        "mass": _value(report, "mass_deviation"),
        "polar inertia": _value(report, "polar_inertia_deviation"),
        "transverse inertia": _value(report, "transverse_inertia_deviation"),
    }
    name, worst = max(off.items(), key=lambda each: abs(each[1]))
    if abs(worst) > _MASS_OFF:
        cause = (
            "The grid is too coarse for its arcs, or not of this body, or the density is another "
            "one: refine it, or correct the density."
        )
        if not 0.1 < 1 + worst < 10:
            cause = "The units are wrong: check those of lengths and of the density."
        yield (
            f"The {name} is {_percent(worst)} {'above' if worst > 0 else 'below'} that of the "
            f"solid and should match it to {_percent(_MASS_OFF)}. {cause}"
        )
    if _value(report, "condensed_mass_deviation") > _RIGID_ENERGY:
        yield (
            "The condensed body does not weigh what the full one does: rigid motions differ by "
            f"{_value(report, 'condensed_mass_deviation'):.1e}, which should be rounding only. "
            "Condense it again."
        )


def _of_rigid_motions(report: Mapping[str, Any]) -> Iterator[str]:
    count = report.get("rigid_body_modes", 6)
    if count != 6:
        yield (
            f"The body has {count} rigid-body modes and must have six. More: parts that hang "
            "together by an edge, or not at all. Fewer: something holds it."
        )
    energy = max(
        _largest(report, "rigid_body_energy_relative"),
        _largest(report, "full_rigid_body_energy_relative"),
    )
    if energy > _RIGID_ENERGY:
        yield (
            f"Rigid motions store energy, {energy:.1e} of what their displacements would store "
            f"alone; it should be below {_RIGID_ENERGY:.0e}. Something holds the body, nodes are "
            "not where the matrices think, or the matrices were written with few digits."
        )


def _of_truncation(report: Mapping[str, Any]) -> Iterator[str]:
    for name, words in (("sprung", "on springs"), ("free", "of the free body")):
        error = _value(report, f"largest_{name}_frequency_error")
        if error > _FREQUENCY_OFF:
            method = report.get("method")
            remedy = "Keep more modes" + ("." if method == "herting" else ", or take Herting's.")
            yield (
                f"Natural frequencies {words} are up to {_percent(error)} off those of the full "
                f"body, and should match to {_percent(_FREQUENCY_OFF)}. {remedy}"
            )
            return


def _of_statics(report: Mapping[str, Any]) -> Iterator[str]:
    for key, what in (
        ("tooth_deflection_error", "deflection under a tooth load"),
        ("centrifugal_growth_error", "centrifugal growth"),
    ):
        error = _value(report, key)
        if error > _STATIC_OFF:
            yield (
                f"The {what} of the condensed body is {error:.1e} off that of the full one; it "
                f"should be exact but for rounding, {_STATIC_OFF:.0e}. Are there bricks much worse "
                "than the others, or springs much stiffer than the body?"
            )


def _of_seats(report: Mapping[str, Any]) -> Iterator[str]:
    difference = _value(report, "largest_coupling_frequency_difference")
    if difference > _COUPLING_OFF:
        yield (
            f"Frequencies on springs change by up to {_percent(difference)} between rigid seats "
            "and averaging ones. Take rigid ones where a ring or a hub grips the seat tightly, "
            "averaging ones where it is soft."
        )


def _of_grid(report: Mapping[str, Any]) -> Iterator[str]:
    ratio = _value(report, "smallest_jacobian_ratio", 1.0)
    slender = _value(report, "largest_aspect_ratio", 1.0)
    if ratio < _JACOBIAN:
        place = report.get("worst_brick_mm", [])
        where = ", ".join(f"{x:.3f}" for x in place) if isinstance(place, list) else ""
        yield (
            f"The worst brick, at {where} mm, is badly distorted: its Jacobian ratio is "
            f"{ratio:.3f} and should be above {_JACOBIAN:g}. Mesh that place more evenly."
        )
    if slender > _ASPECT:
        yield (
            f"A brick has edges of which one is {slender:.0f} times as long as another; above "
            f"{_ASPECT:g} stresses and bending get poor. Use more elements along it."
        )
    across = _value(report, "rim_elements_across", float(_FEWEST_ACROSS))
    if round(across) < _FEWEST_ACROSS:
        yield (
            f"The rim has {across:.0f} element across the toothed face and should have at least "
            f"{_FEWEST_ACROSS}, or loads along the face are smeared. Use more."
        )
    arc, root = _value(report, "rim_element_arc_mm"), _value(report, "root_thickness_mm")
    if root and arc > _LONG_ELEMENT * root:
        yield (
            f"An element of the rim is {arc:.2f} mm long around, {arc / root:.1f} times the "
            f"thickness of a tooth at its root, {root:.2f} mm. The body is too stiff under one "
            "tooth then: use at least one element per tooth."
        )


def _percent(part: float) -> str:
    return f"{100 * abs(part):.2g}%"
