r"""How far a condensed body is from the full one.

Both bodies are asked the same questions in coordinates of the boundary: rim, then seats. The full
one is solved by one factor: of its stiffness on six supports, which carry nothing if loads balance
each other. Springs, and motions of the body as a whole, are added to that by the flexibility
method, so that the answer owes nothing to the condensation.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, vstack
from scipy.sparse.linalg import eigsh

from ._answers import FreeModes, Report, reported_mode_count
from ._artefact import ReducedBody, self_equilibrated
from ._assembly import order
from ._boundary import FullBody, full_body
from ._checks import Progress, silent
from ._modes import free_modes, operator_of, reduced_modes
from ._seats import dofs_of
from ._solvers import Factor, factorise
from ._static_answers import (
    Springs,
    off_mean,
    rim_rows,
    seat_rows,
    spring_matrix,
    spring_rows,
    tooth_load,
    tooth_row,
)


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
        OPinv=operator_of(len(start), solve),
        v0=start,
        return_eigenvectors=False,
    )
    return np.sqrt(np.sort(square)) / (2 * math.pi)


def free_error(
    full: FullBody, modes: FreeModes, free_frequency: object, progress: Progress = silent
) -> Report:
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


def _frequency_error(name: str, found: np.ndarray, wanted: np.ndarray) -> Report:
    error = found / wanted - 1
    return {
        f"{name}_frequency_error": error.tolist(),
        f"largest_{name}_frequency_error": float(np.abs(error).max()),
    }


def compared(
    full: FullBody,
    reduced: ReducedBody,
    grown: np.ndarray,
    bent: np.ndarray | None,
    row: np.ndarray,
    springs: Springs,
    torque_seat: str | None,
    couplings: bool,
    progress: Progress,
) -> Report:
    """Errors of growth, of deflection under a tooth load, and of frequencies on springs."""
    body = _grounded(full, progress)
    load = self_equilibrated(full.centrifugal_load, full.mass, body.rigid)
    rim = reduced.rim_nodes.size
    found: Report = {
        "centrifugal_growth_error": _off(grown, off_mean(reduced, body.floating(load)[:rim]))
    }
    if bent is None:
        return found
    with progress("a tooth load on the full body"):
        solve = _on_springs(body, *spring_rows(reduced, row, springs, mesh=False))
        load = tooth_load(reduced, row, torque_seat)
        answer = body.boundary @ solve(body.boundary.T @ load)
        found["tooth_deflection_error"] = _off(bent[:rim], answer[:rim])
    count = min(max(10, reported_mode_count(reduced) // 2), reduced.dofs - 2)
    with progress(f"{count} modes on springs"):
        solve = _on_springs(body, *spring_rows(reduced, row, springs, mesh=True))
        wanted = _sprung_frequencies(body, solve, count)
        matrix = spring_matrix(reduced, row, springs, mesh=True)
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


def seat_coupling_difference(
    full: FullBody,
    reduced: ReducedBody,
    *,
    springs: Springs | None = None,
    root_thickness: float | None = None,
    progress: Progress = silent,
) -> Report:
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
    solve = _on_springs(body, *spring_rows(reduced, row, springs, mesh=True))
    frequencies = _sprung_frequencies(body, solve, 6)
    return _coupling_difference(body, frequencies, reduced, row, springs, progress)


def _coupling_difference(
    body: _Grounded,
    frequencies: np.ndarray,
    reduced: ReducedBody,
    row: np.ndarray,
    springs: Springs,
    progress: Progress,
) -> Report:
    full = body.full
    seats = [replace(seat, averaging=not seat.averaging) for seat in full.seats]
    # No probes: they may be on seats that become rigid.
    other = full_body(
        full.name, full.grid, full.material, seats, teeth=full.teeth, progress=progress
    )
    changed = _grounded(other, progress)
    with progress("the other coupling of the seats"):
        solve = _on_springs(changed, *spring_rows(reduced, row, springs, mesh=True))
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
    seats = seat_rows(reduced)
    mean = np.zeros((6, reduced.boundary_dofs))
    mean[:, :rim] = rim_rows(reduced)
    # Loads on the seats, each balanced by what moves the rim as a whole.
    rows = seats - (seats @ reduced.rigid_motions[: reduced.boundary_dofs]) @ mean
    answer = body.floating(body.boundary.T @ rows.T)
    flexibility = np.einsum("ij,ji->i", rows, answer).reshape(-1, 6)
    groups = ([0, 1], [2], [3, 4], [5])
    return np.stack([flexibility[:, group].mean(axis=1) for group in groups], axis=1)
