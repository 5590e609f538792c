r"""Teeth of finite elements, condensed to what loads on their flanks do to flanks and roots.

Loads act normal to the flank, spread evenly over each row of elements from the form circle to the
tip, and in Legendre's polynomials along the face. Near a load elements are too large to show what
it does: there a body is a half-space, whose share on the same strips is known and is taken off.
What is left is smooth, and is met by few rows and polynomials; whoever uses it adds the half-space
again, under the true width of the contact.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ._assembly import Material
from ._checks import Progress, require, silent
from ._half_space import Strips, strip_compliance
from ._prism import (
    FaceWaves,
    elasticity,
    prism_stiffness,
    quad_functions,
    section_matrices,
    strain_rows,
)
from ._solvers import factorise
from ._tooth_section import ToothSection, ToothSizing, tooth_section
from ._tooth_shape import ToothedGear


@dataclass(frozen=True)
class ToothElements:
    r"""Condensed teeth of a gear on a ring that is held at its bore.

    Teeth are counted against the clock from the loaded one, 0; rows from the form circle up; waves
    are Legendre's polynomials of unit norm over the gear's own face width, $p_m(z)$ [m^-1/2]. A
    load $q(z) = \sum q_n p_n(z)$ per length [N/m] on row $j$ of tooth 0 moves row $i$ of tooth $d$
    by $\sum p_m(z) C_{d,im,jn} q_n$, both along their inward normals. On tooth 0 itself that is
    $C$ and the share of the half-space.

    **Fields:**

    - `name`: of the gear.
    - `face_width`: of the gear [m].
    - `base_radius`: of the gear [m].
    - `roll`: roll lengths of the ends of the rows, shape `[row + 1]` [m].
    - `compliance`: $C$, without the half-space's share on tooth 0,
        shape `[tooth, row, wave, row, wave]` [m2/N].
    - `root_places`: points on the surface of the gaps beside each tooth, first on the loaded side,
        from the tooth to mid-gap, in the section at mid-face, shape `[tooth, 2, point, 2]` [m].
    - `root_stress`: stress along the surface and square to the axis there, waves of it by waves of
        the load, shape `[tooth, 2, point, wave, row, wave]` [1/m].
    - `facts`: what else is known: measures, material, sizes, health.
    """

    name: str
    face_width: float
    base_radius: float
    roll: np.ndarray
    compliance: np.ndarray
    root_places: np.ndarray
    root_stress: np.ndarray
    facts: Mapping[str, object] = field(default_factory=dict)


# Unknowns that are factorised at once: they take some 4 GB.
MOST_UNKNOWNS = 100_000


def unknowns_of(gear: ToothedGear, teeth: int, sizing: ToothSizing) -> int:
    """Unknowns of a gear's teeth that are factorised at once.

    **Arguments:**

    - `gear`: its teeth and its ring.
    - `teeth`: that can be in mesh at once.
    - `sizing`: how finely they are divided.
    """
    section = tooth_section(gear, min(teeth, gear.teeth), sizing)
    count = _wave_count(gear, sizing)
    parts = _separate(gear, _kept_waves(gear, section, count), count)
    return max(len(part) for part, _ in parts)


def condense_teeth(
    gear: ToothedGear,
    material: Material,
    teeth: int,
    *,
    sizing: ToothSizing = ToothSizing(),
    progress: Progress = silent,
) -> ToothElements:
    """Condense the teeth of a gear.

    **Arguments:**

    - `gear`: its teeth and its ring.
    - `material`: of both.
    - `teeth`: that can be in mesh at once: the loaded one and those that follow it.
    - `sizing`: how finely they are divided.
    - `progress`: told what begins.

    **Returns:**

    The condensed teeth.

    **Raises:**

    - `BodyError` if teeth and ring cannot be divided, or if they have too many unknowns.
    """
    with progress("dividing the teeth"):
        section = tooth_section(gear, min(teeth, gear.teeth), sizing)
        waves = FaceWaves(gear.face_width, _wave_count(gear, sizing))
        matrices = section_matrices(section.nodes, section.quads, material, gear.twist)
    loads = _row_loads(gear, section)
    kept = _kept_waves(gear, section, waves.count)
    watched = np.unique(np.concatenate([section.flank.ravel(), section.root_quads.ravel()]))
    shape = (3 * len(section.nodes), waves.count)
    motion = np.zeros((3 * len(watched), waves.count, loads.shape[-1], waves.count))
    with progress("solving for loads on the flank"):
        for part, own in _separate(gear, kept, waves.count):
            require(
                len(part) <= MOST_UNKNOWNS,
                "Teeth may have {most:,} unknowns in one piece, which take some 4 GB, got {got:,}. "
                "Divide them more coarsely: `fitting_sizing` says how.",
                most=MOST_UNKNOWNS,
                got=len(part),
            )
            dof, wave = np.unravel_index(part, shape)
            factor = factorise(prism_stiffness(matrices, waves, part))
            right = loads[0, dof][:, :, None] * (wave[:, None] == own)[:, None, :]
            solved = factor.solve(right.reshape(len(part), -1)).reshape(right.shape)
            seen = np.flatnonzero(np.isin(dof // 3, watched))
            place = 3 * np.searchsorted(watched, dof[seen] // 3) + dof[seen] % 3
            motion[place[:, None], wave[seen][:, None], :, own] = np.moveaxis(solved[seen], 2, 1)
    seen = (3 * watched[:, None] + np.arange(3)).ravel()
    compliance = np.einsum("tuj,umin->tjmin", loads[:, seen], motion, optimize=True)
    asymmetry = _asymmetry(compliance[0])
    compliance[0] = 0.5 * (compliance[0] + np.transpose(compliance[0], (2, 3, 0, 1)))
    with progress("taking off the half-space"):
        compliance[0] -= strip_compliance(_strips(gear, section), waves, material)
    places, stress = _root_stress(gear, section, waves, material, (watched, motion))
    return ToothElements(
        name=f"{gear.teeth} teeth of module {gear.module * 1e3:.4g} mm",
        face_width=gear.face_width,
        base_radius=gear.base_radius,
        roll=section.roll,
        compliance=compliance,
        root_places=places,
        root_stress=stress,
        facts={
            "nodes_of_section": len(section.nodes),
            "unknowns": len(kept),
            "waves": waves.count,
            "asymmetry": asymmetry,
        },
    )


def _wave_count(gear: ToothedGear, sizing: ToothSizing) -> int:
    """Even, so that motions of three directions keep together."""
    return 2 * math.ceil((gear.face_width / gear.module + sizing.waves) / 2.0)


# What a wave of the load has left at a distance falls as exp(-n pi distance / width).
_NEAR, _FALL = 3.0, 1.5


def _kept_waves(gear: ToothedGear, section: ToothSection, count: int) -> np.ndarray:
    """Numbers of the motions that are kept, three that belong together one after the other."""
    away = np.maximum(section.away, 1e-3 * gear.module)
    wanted = 2.0 * np.ceil(0.5 * (_NEAR + _FALL * gear.face_width / away))
    waves = np.minimum(wanted, count).astype(int)
    waves[section.bore] = 0
    found = []
    for odd in (0, 1):
        # Along x and y one kind of waves, along z the other: without twist these keep apart.
        for node in np.flatnonzero(waves):
            even = np.arange(0, waves[node], 2)
            first = 3 * node * count
            own = np.stack([even + odd, count + even + odd, 2 * count + even + 1 - odd], axis=1)
            found.append(first + own.ravel())
    return np.concatenate(found)


def _separate(
    gear: ToothedGear, kept: np.ndarray, count: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Motions that are coupled, with the waves of the loads on them."""
    waves = np.arange(count)
    if gear.twist != 0.0:
        # Node by node: far fewer entries in the factor.
        order = np.argsort(kept // (3 * count), kind="stable")
        return [(kept[order], waves)]
    half = len(kept) // 2
    return [(kept[:half], waves[::2]), (kept[half:], waves[1::2])]


# --- Flanks


# Along a row, from 0 to 1, in both of its elements.
_EDGE_POINTS, _EDGE_WEIGHTS = np.polynomial.legendre.leggauss(4)
_EDGE_POINTS = np.concatenate([0.25 * (_EDGE_POINTS + 1.0), 0.25 * (_EDGE_POINTS + 3.0)])
_EDGE_WEIGHTS = np.tile(0.25 * _EDGE_WEIGHTS, 2)


def _row_loads(gear: ToothedGear, section: ToothSection) -> np.ndarray:
    """Forces of a unit load along the inward normal on each row, `[tooth, 3 node, row]`."""
    teeth, rows, _ = section.flank.shape
    ends = section.roll**2
    roll = np.sqrt(ends[:-1, None] + np.diff(ends)[:, None] * _EDGE_POINTS)
    # Squares of roll lengths are lengths along the flank, in which the load is even.
    p = _EDGE_POINTS % 0.5 * 2.0
    edge = np.stack([(1 - p) * (1 - 2 * p), 4 * p * (1 - p), p * (2 * p - 1)], axis=1)
    shapes = np.zeros((p.size, 5))
    shapes[: p.size // 2, :3], shapes[p.size // 2 :, 2:] = edge[: p.size // 2], edge[p.size // 2 :]
    result = np.zeros((teeth, len(section.nodes), 3, rows))
    tilt = gear.base_helix_angle
    for tooth in range(teeth):
        base = float(gear.half_angle(0.0)) - roll / gear.base_radius + tooth * gear.pitch_angle
        normal = np.stack(
            [
                math.cos(tilt) * np.sin(base),
                -math.cos(tilt) * np.cos(base),
                np.full_like(base, math.sin(tilt)),
            ],
            axis=-1,
        )
        forces = np.einsum("p,pa,ipc->iac", _EDGE_WEIGHTS, shapes, normal)
        for row in range(rows):
            result[tooth, section.flank[tooth, row], :, row] += forces[row]
    return result.reshape(teeth, -1, rows)


def _strips(gear: ToothedGear, section: ToothSection) -> Strips:
    """The rows as strips of a half-space."""
    middle = np.sqrt(0.5 * (section.roll[1:] ** 2 + section.roll[:-1] ** 2))
    radius = np.hypot(gear.base_radius, middle)
    return Strips(
        ends=section.roll**2 / (2.0 * gear.base_radius),
        slant=gear.twist * middle,
        stretch=np.hypot(1.0, gear.twist * radius),
    )


def _asymmetry(own: np.ndarray) -> float:
    """How far the compliance is from the reciprocity that it must have [-]."""
    flat = own.reshape(own.shape[0] * own.shape[1], -1)
    return float(np.abs(flat - flat.T).max() / np.abs(flat).max())


# --- Roots


def _root_stress(
    gear: ToothedGear,
    section: ToothSection,
    waves: FaceWaves,
    material: Material,
    solution: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Places on the surface of the gaps, and stress along it there by loads on the flank."""
    watched, motion = solution
    quads = section.root_quads.reshape(-1, 9)
    points = np.broadcast_to(section.root_points, (*section.root_points.shape[:3], 2, 2))
    points = points.reshape(len(quads), 2, 2)
    values, slopes = (
        part.reshape(len(quads), 2, *part.shape[1:])
        for part in quad_functions(points.reshape(-1, 2))
    )
    corners = section.nodes[quads]
    jacobian = np.einsum("eai,eqaj->eqij", corners, slopes)
    gradients = np.einsum("eqai,eqij->eqaj", slopes, np.linalg.inv(jacobian))
    places = np.einsum("eqa,eai->eqi", values, corners)
    first, second = strain_rows(values, gradients, places, gear.twist)
    # The direction in which the reference point's edge runs.
    along = np.einsum("eqij,eqj->eqi", jacobian, section.root_edges.reshape(len(quads), 1, 2))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    x, y = along[..., 0], along[..., 1]
    none = np.zeros_like(x)
    pulled = np.stack([x * x, y * y, none, 2.0 * x * y, none, none], axis=-1) @ elasticity(material)
    first, second = (np.einsum("eqs,eqsac->eqac", pulled, part) for part in (first, second))
    place = 3 * np.searchsorted(watched, quads)[:, :, None] + np.arange(3)
    # The slope of a wave is made of others.
    mixed, _ = waves.products
    stress = np.empty((len(quads), 2, *motion.shape[1:]))
    for number in range(len(quads)):
        moved = motion[place[number]]
        stress[number] = np.einsum("qac,acmjn->qmjn", first[number], moved, optimize=True)
        sloped = np.einsum("qac,aclin->qlin", second[number], moved, optimize=True)
        stress[number] += np.einsum("ml,qlin->qmin", mixed, sloped)
    shape = (*section.root_quads.shape[:2], -1)
    return places.reshape(*shape, 2), stress.reshape(*shape, *motion.shape[1:])
