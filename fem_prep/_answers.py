"""What a condensed body is, in numbers: mass, rigid motions, modes, growth, a tooth load.

Every function answers one question about a body, as a part of its health report.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array
from scipy.sparse.linalg import eigsh

from ._artefact import ReducedBody, rigid_motions
from ._assembly import surface_mass
from ._boundary import FullBody
from ._checks import Progress, silent
from ._fourier import NodalPattern, families, identify, symmetry_splitting
from ._hold import FixedInterface, recovered_displacements
from ._modes import operator_of, reduced_modes
from ._quality import quality
from ._web import Properties

# A health report or a part of it, as it is told to users: numbers, texts, and lists and mappings of
# them, by names of which a unit is part.
Report = dict[str, Any]

# Modes are rigid if the square of their frequency is below this, over that of the highest one.
_RIGID = 1e-6


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
    reduced: ReducedBody,
    held: FixedInterface | None = None,
    *,
    count: int = 40,
    progress: Progress = silent,
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
            motion = recovered_displacements(held, reduced, elastic)
        pattern = identify(points, motion, weights=weights)
    frequency = np.sqrt(square[rigid:]) / (2 * math.pi)
    return FreeModes(rigid, frequency, motion, pattern, whole=held is not None)


def reported_mode_count(reduced: ReducedBody) -> int:
    """How many modes are told and compared: 40, if the body has so many; at least 10."""
    return min(40, max(10, _modes_kept(reduced)))


def counts(full: FullBody | None, reduced: ReducedBody) -> Report:
    """Sizes of the full and of the condensed body."""
    sizes: Report = {
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


def mass_properties(full: FullBody | None, reduced: ReducedBody, exact: Solid | None) -> Report:
    """Mass, centre and inertias by rigid motions, and how far they are from what they should be.

    Inertias are about the middle of the toothed face, the transverse one the mean of both. Teeth
    that the grid leaves out count in all, but not in what is compared with the solid; what the
    skin that stands for them weighs is told beside what they weigh themselves.
    """
    condensed = inertia_of(reduced.mass, reduced.rigid_motions)
    total = condensed if full is None else inertia_of(full.mass, full.rigid_motions)
    mass, centre, polar, transverse = _told(total)
    found: Report = {
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


def rigid_energies(full: FullBody | None, reduced: ReducedBody) -> Report:
    r"""Energies of unit rigid motions, which should be none.

    Relative ones are over what the same displacements would store one by one,
    $\frac{1}{2} \sum K_{ii} r_i^2$. `rigid_body_residual` is $|K R| / (|K| |R|)$ by Frobenius.
    """
    energy, relative, residual = _rigid_energy(reduced.stiffness, reduced.rigid_motions)
    found: Report = {
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


def modes_report(modes: FreeModes) -> Report:
    """First free frequencies with nodal diameters, families, and pairs with their splitting."""
    pattern = modes.pattern
    found: Report = {
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


def conditioning(reduced: ReducedBody) -> Report:
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
        tol=1e-3,
        return_eigenvectors=False,
    )
    return {
        "mass_definite": True,
        "largest_frequency_Hz": float(math.sqrt(square[0]) / (2 * math.pi)),
        # Its last digits depend on where in memory the matrix lies, and this is hashed.
        "mass_condition": float(f"{1 / max(reciprocal, 1e-300):.12g}"),
    }


def brick_report(full: FullBody) -> Report:
    """How well shaped the bricks are."""
    found = quality(full.grid)
    return {
        "smallest_jacobian_ratio": found.smallest_jacobian_ratio,
        "largest_aspect_ratio": found.largest_aspect_ratio,
        "worst_brick_mm": [float(1e3 * x) for x in found.place],
    }


def rim_report(reduced: ReducedBody, root_thickness: float | None) -> Report:
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
    found: Report = {
        "rim_element_arc_mm": 1e3 * arc,
        "rim_element_axial_mm": 1e3 * axial,
        "rim_elements_across": float(np.ptp(z) / axial),
    }
    if root_thickness is not None:
        found["root_thickness_mm"] = 1e3 * float(root_thickness)
    return found
