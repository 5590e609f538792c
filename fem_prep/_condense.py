r"""Condensation of a body on its rim and its seats.

The body follows its boundary $u_b$ statically, by constraint modes $T$, and adds to that shapes $Y$
that leave the boundary where it is: $u = T u_b + Y q$. The stiffness has then no blocks between
both, whatever the shapes, $T^T K Y = 0$, as $T$ is in equilibrium inside, and static answers at the
boundary are exact for loads anywhere. What methods differ in is $Y$ alone.

A seat that averages its nodes is a constraint $B u = u_s$, met by forces $B^T \lambda$.
"""

import math
from dataclasses import replace

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array, lil_array

from ._artefact import ReducedBody, inertia_relief, rigid_motions, self_equilibrated
from ._assembly import across, centrifugal_load, coriolis, internal_forces, stress_stiffening
from ._basis import Basis, basis_of
from ._boundary import FullBody
from ._checks import Progress, require, silent
from ._equal_sectors import evened
from ._hold import FixedInterface, boundary_of, fixed_interface
from ._modes import free_modes, lowest_modes, scale_of
from ._seats import dofs_of
from ._sector_shapes import of_one_wave_each
from ._symmetry import Rotation

METHODS = ("herting", "craig-bampton", "guyan")
MOST_MODES = 200

# Shapes that others make up to this, in energy, are left out: they say nothing new.
_NEW = 1e-12


def _interior(
    full: FullBody, held: FixedInterface, method: str, modes: int, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Interior shapes of a method, `[3 point, shape]`, none of which moves the boundary.

    And the squares of the free frequencies that were found on the way [rad2/s2].
    """
    if method == "guyan":
        return np.zeros((3 * full.points, 0)), np.zeros(0)
    probes = np.zeros((3 * full.points, 3 * len(full.probe_points)))
    probes[dofs_of(full.probe_points), np.arange(probes.shape[1])] = 1.0
    loads = [full.centrifugal_load[:, None], probes]
    if method == "herting":
        # Inertia relief: what rigid accelerations of the body load it with.
        loads.append(full.mass @ full.rigid_motions)
    shapes = [held.loaded(np.concatenate(loads, axis=1))]
    square = np.zeros(0)
    if modes and method == "herting":
        square, free = free_modes(full, modes, rotation=held.rotation, progress=progress)
        shapes.append(free - held.followed(boundary_of(full, free)))
    elif modes:
        shapes.append(_fixed_modes(held, modes, progress))
    return _independent(full, np.concatenate(shapes, axis=1)), square


def _fixed_modes(held: FixedInterface, modes: int, progress: Progress) -> np.ndarray:
    """Modes of the body with its boundary held, `[3 point, mode]`."""
    full, inside = held.full, held.inside
    require(
        not len(held.meeting),
        "Craig-Bampton's modes are those of a body held at its seats, which seats that average "
        "are not. Make the seats rigid rings, or use Herting's modes.",
    )
    with progress(f"{modes} modes of the held body"):
        stiffness, mass = (each[inside][:, inside] for each in (full.stiffness, full.mass))
        rotation = held.rotation.among(inside[::3] // 3)
        _, shapes = lowest_modes(stiffness, mass, modes, scale_of(full), rotation)
    motion = np.zeros((3 * full.points, modes))
    motion[inside] = shapes
    return motion


def _independent(full: FullBody, shapes: np.ndarray) -> np.ndarray:
    """Modes in the space of some shapes, without those that others make up.

    Shapes come with units of their own, and inertia relief says nearly what the lowest modes say:
    all are scaled to unit energy, and combinations of none are left out.
    """
    energy = np.einsum("ij,ij->j", shapes, full.stiffness @ shapes)
    shapes = shapes[:, energy > 0] / np.sqrt(energy[energy > 0])
    if not shapes.shape[1]:
        return shapes
    weight, mixed = np.linalg.eigh(shapes.T @ (full.stiffness @ shapes))
    kept = weight > _NEW * weight[-1]
    shapes = shapes @ (mixed[:, kept] / np.sqrt(weight[kept]))
    # Of unit modal mass, and stiffest last.
    stiffness, mass = (shapes.T @ (each @ shapes) for each in (full.stiffness, full.mass))
    _, mixed = scipy.linalg.eigh(stiffness, mass)
    return shapes @ mixed


def condense(
    full: FullBody,
    *,
    method: str = "herting",
    modes: int = 50,
    rotating: bool = False,
    rotation: Rotation | None = None,
    held: FixedInterface | None = None,
    progress: Progress = silent,
) -> ReducedBody:
    r"""Condense a body on its rim and its seats (theory 6.7 to theory 6.12).

    Interior shapes are, by method:

    - "herting" (D. N. Herting, Finite Elem. Anal. Des. 1, 1985, 153-164; thesis eq. 2.4): modes of
      the free body less their static part, and the answers to rigid accelerations (inertia relief).
      Free frequencies of the modes kept are exact.
    - "craig-bampton": modes of the body held at its boundary.
    - "guyan": none; static condensation.

    Both of the first have the answers to centrifugal load and to unit loads on the probes too, so
    that these too move probes exactly in statics.

    **Arguments:**

    - `full`: the body.
    - `method`: see above.
    - `modes`: number of modes, 0 to 200.
    - `rotating`: also condense Coriolis forces, spin softening and stress stiffening.
    - `rotation`: a rotation that leaves the body as it is; the smallest one is sought without it.
        Only the columns of one sector are solved for.
    - `held`: the body with its boundary held, if that has been factorised already.
    - `progress`: told what begins.

    **Returns:**

    The condensed body.

    **Raises:**

    - `BodyError` if the method is unknown, if there are too many modes, or if the body has other
        than six rigid motions.
    """
    _check_method(method, modes)
    held = fixed_interface(full, rotation=rotation, progress=progress) if held is None else held
    rotation = held.rotation if rotation is None else rotation
    interior, square = _interior(full, held, method, modes, progress)
    columns = 3 * len(full.rim) // rotation.sectors
    with progress(f"{columns} of {3 * len(full.rim)} columns of the rim"):
        basis = basis_of(full, held, rotation, interior)
    with progress("stiffness and mass"):
        stiffness, mass = _stiffness(held, basis), basis.projected(full.mass)
    reduced = ReducedBody(
        name=full.name,
        stiffness=stiffness,
        mass=mass,
        centrifugal_load=basis.loaded(full.centrifugal_load),
        rim_nodes=full.grid.nodes[full.rim],
        rim_faces=full.rim_faces,
        seats=tuple(seat.name for seat in full.seats),
        seat_points=np.array([seat.point for seat in full.seats]).reshape(-1, 3),
        interior=interior.shape[1],
        probes=tuple(full.probes),
        probe_points=full.grid.nodes[list(full.probes.values())].reshape(-1, 3),
        probe_rows=basis.rows(full.probe_points).reshape(len(full.probes), 3, len(mass)),
        nodes=full.grid.nodes,
        bricks=full.grid.bricks,
        interior_shapes=full.on_nodes(interior),
        facts=_facts(full, method, modes, rotation, square),
    )
    if rotating:
        with progress("terms of rotation"):
            reduced = _rotating(held, basis, reduced)
    # All matrices are there twice next: what is not needed any more makes room.
    del basis, interior, stiffness, mass
    return of_one_wave_each(evened(reduced))


def _check_method(method: str, modes: int) -> None:
    require(
        method in METHODS,
        "The method of condensation must be one of {known}, got {method!r}.",
        known=", ".join(METHODS),
        method=method,
    )
    require(
        0 <= modes <= MOST_MODES,
        "The number of modes must lie between 0 and {most}, got {modes}.",
        most=MOST_MODES,
        modes=modes,
    )


def _rotating(held: FixedInterface, basis: Basis, reduced: ReducedBody) -> ReducedBody:
    """With Coriolis forces, spin softening, and stiffening by stresses of the centrifugal load."""
    full = held.full
    # Of a body that is out of balance, what of the load accelerates it strains it too.
    outer = self_equilibrated(reduced.centrifugal_load, reduced.mass, reduced.rigid_motions)
    load = self_equilibrated(full.centrifugal_load, full.mass, full.rigid_motions)
    moved = inertia_relief(reduced, outer)[: reduced.boundary_dofs]
    # The boundary's motion is exact with any method, that of the inside by its own answer only.
    motion = held.followed(moved[:, None]) + held.loaded(load[:, None])
    strained = full.on_nodes(motion)[0]
    stiffening = full.across(stress_stiffening(full.grid, full.material, strained))
    return replace(
        reduced,
        coriolis=basis.projected(full.across(coriolis(full.grid_mass)), sign=-1.0),
        spin_softening=basis.projected(full.across(across(full.grid_mass))),
        stress_stiffening=basis.projected(stiffening + _of_rings(full, strained)),
    )


def _of_rings(full: FullBody, strained: np.ndarray) -> csr_array:
    r"""What the forces in rigid seats, of unit speed, resist turns of the seats with.

    A ring that turns by $\theta$ moves its nodes by $\theta \times r + \theta \times (\theta
    \times r) / 2$. The forces $F$ that it puts on them work along the second part too: with
    $S = \sum F r^T$ they add $(S + S^T) / 2 - \mathrm{tr}(S) I$ to its stiffness. Without it a
    body that spins freely is not free to turn.
    """
    grid = full.grid
    rigid = rigid_motions(grid.nodes)
    load = self_equilibrated(centrifugal_load(full.grid_mass, grid.nodes), full.grid_mass, rigid)
    forces = internal_forces(grid, full.material, strained) - load.reshape(-1, 3)
    size = 3 * full.points
    result = lil_array((size, size))
    row = size - 6 * sum(not seat.averaging for seat in full.seats) + 3
    for seat in full.seats:
        if seat.averaging:
            continue
        product = forces[seat.nodes].T @ (grid.nodes[seat.nodes] - seat.point)
        turn = slice(row, row + 3)
        result[turn, turn] = (product + product.T) / 2 - np.trace(product) * np.eye(3)
        row += 6
    return csr_array(result)


def _stiffness(held: FixedInterface, basis: Basis) -> np.ndarray:
    """Condensed stiffness: forces on the boundary, and the energies of the interior shapes.

    Between both there is nothing: constraint modes leave no force inside.
    """
    rim, seats = basis.rim, 6 * len(held.full.seats)
    result = np.zeros((rim + basis.others.shape[1],) * 2)
    columns = basis.sector.shape[1]
    apart = (basis.frames.T @ held.reaction(basis.sector)[:rim]).reshape(-1, columns, columns)
    result[:rim, :rim] = basis.among_rim(np.swapaxes(apart, 1, 2))
    forces = held.reaction(basis.others[:, :seats])
    result[: rim + seats, rim : rim + seats] = forces
    result[rim : rim + seats, :rim] = forces[:rim].T
    shapes = basis.others[:, seats:]
    result[rim + seats :, rim + seats :] = shapes.T @ (held.full.stiffness @ shapes)
    return (result + result.T) / 2


def _facts(
    full: FullBody, method: str, modes: int, rotation: Rotation, square: np.ndarray
) -> dict[str, object]:
    facts: dict[str, object] = {
        "method": method,
        "modes": modes,
        "sectors": rotation.sectors,
        "young_Pa": full.material.young,
        "poisson": full.material.poisson,
        "density_kg_m3": full.material.density,
        "seats_averaging": [seat.averaging for seat in full.seats],
        "free_frequency_Hz": (np.sqrt(square) / (2 * math.pi)).tolist(),
    }
    if full.teeth is not None:
        facts["teeth_mass_kg"] = full.teeth.mass
        facts["teeth_polar_inertia_kg_m2"] = full.teeth.polar_inertia
    return facts
