r"""How far a condensed body is from the full one.

Both bodies are asked the same questions in coordinates of the boundary: rim, then seats. The full
one is solved in all its unknowns, so that the answer owes nothing to the condensation.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.sparse.linalg import eigsh

from ._answers import FreeModes, Report, reported_mode_count
from ._artefact import ReducedBody, self_equilibrated
from ._assembly import order
from ._boundary import FullBody, recoupled
from ._checks import Progress, silent
from ._grounded import Grounded, grounded, on_springs
from ._modes import free_modes, operator_of, reduced_modes
from ._static_answers import (
    Springs,
    off_mean,
    rim_rows,
    seat_rows,
    spring_rows,
    tooth_load,
    tooth_row,
)


def _sprung_frequencies(
    body: Grounded, solve: Callable[[np.ndarray], np.ndarray], count: int
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
    body = grounded(full, progress)
    load = self_equilibrated(full.centrifugal_load, full.mass, body.rigid)
    rim = reduced.rim_nodes.size
    found: Report = {
        "centrifugal_growth_error": _off(grown, off_mean(reduced, body.floating(load)[:rim]))
    }
    if bent is None:
        return found
    with progress("a tooth load on the full body"):
        solve = on_springs(body, *spring_rows(reduced, row, springs, mesh=False))
        load = tooth_load(reduced, row, torque_seat)
        answer = body.boundary @ solve(body.boundary.T @ load)
        found["tooth_deflection_error"] = _off(bent[:rim], answer[:rim])
    count = min(max(10, reported_mode_count(reduced) // 2), reduced.dofs - 2)
    with progress(f"{count} modes on springs"):
        rows, stiffness = spring_rows(reduced, row, springs, mesh=True)
        wanted = _sprung_frequencies(body, on_springs(body, rows, stiffness), count)
        added = np.pad(np.sqrt(stiffness)[:, None] * rows, [(0, 0), (0, reduced.interior)])
        square, _ = reduced_modes(reduced, count, added)
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
    body = grounded(full, progress)
    row = tooth_row(reduced, springs.line_of_action, root_thickness)
    solve = on_springs(body, *spring_rows(reduced, row, springs, mesh=True))
    frequencies = _sprung_frequencies(body, solve, 6)
    return _coupling_difference(body, frequencies, reduced, row, springs, progress)


def _coupling_difference(
    body: Grounded,
    frequencies: np.ndarray,
    reduced: ReducedBody,
    row: np.ndarray,
    springs: Springs,
    progress: Progress,
) -> Report:
    changed = grounded(recoupled(body.full), progress)
    with progress("the other coupling of the seats"):
        solve = on_springs(changed, *spring_rows(reduced, row, springs, mesh=True))
        moved = _sprung_frequencies(changed, solve, 6)
        this, that = (_seat_flexibility(each, reduced) for each in (body, changed))
    names = ("radial_um_N", "axial_um_N", "tilt_urad_Nm", "turn_urad_Nm")
    told = []
    for seat, here, there in zip(body.full.seats, this, that, strict=True):
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


def _seat_flexibility(body: Grounded, reduced: ReducedBody) -> np.ndarray:
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
