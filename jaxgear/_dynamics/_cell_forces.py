"""Forces of the cells of a table: those in contact press, alone or through their common bodies."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxgear._contact._coupling import body_yield, share_with_body, shared_where_needed
from jaxgear._dynamics._mesh import Mesh
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import (
    CellArms,
    CellColumns,
    Cells,
    CoordinateMatrix,
    Coordinates,
    Coupling,
    Flag,
    Reals,
)

_Where = Bool[Array, "..."]


def cell_forces(mesh: Mesh, place: Coordinates, law: AbstractContactLaw) -> tuple[Cells, Cells]:
    r"""Force of each cell at given mesh coordinates, $f = k\,\sigma(W m - \delta - C f)$.

    **Arguments:**

    - `mesh`: cells at one instant.
    - `place`: mesh coordinates $m$ [m, rad].
    - `law`: exact or smooth contact.

    **Returns:**

    Forces [N] and overlaps, what the bodies yield subtracted [m].
    """
    free = mesh.arms @ place - mesh.gap
    if mesh.bearing is not None and mesh.coupling is not None and isinstance(law, ExactContact):
        none = mesh.arms[:, :0]
        own = mesh.stiffness, mesh.coupling, free, none, _if_all_bear(mesh, place, none)
        return _exact_forces(*own)[:2]
    return _shared_forces(mesh.stiffness, mesh.coupling, free, law)


class _IfAllBear(NamedTuple):
    """The contact of cells if all of them bore.

    **Fields:**

    - `overlap`: of each [m].
    - `columns`: overlaps per mesh coordinate [-, m].
    - `inverse`: as of `WholeContact` [-].
    """

    overlap: Cells
    columns: CellColumns
    inverse: Coupling


def _if_all_bear(mesh: Mesh, place: Coordinates, columns: CellColumns) -> _IfAllBear | None:
    """The contact of cells that are ready, if all of them bore, with so many of the columns."""
    if (found := mesh.bearing) is None:
        return None
    overlap = found.by_place @ place + found.at_zero
    return _IfAllBear(overlap, found.by_place[:, : columns.shape[1]], found.inverse)


def _shared_forces(
    stiffness: Cells, coupling: Coupling | None, free: Cells, law: AbstractContactLaw
) -> tuple[Cells, Cells]:
    """Forces and overlaps of cells whose overlaps on rigid bodies would be `free`."""
    if coupling is None:
        return stiffness * law.compression(free), free
    if coupling.ndim == 2:
        force = forces_between_all(law, stiffness, coupling, free)
        return force, free - body_yield(coupling, force)
    share = lambda tangent, force: share_with_body(coupling, tangent, force[:, None])[:, 0]
    force = share(stiffness, stiffness * free)
    # A slice has few lines: from all of them closed, Newton's steps open one or more each.
    for _ in range(coupling.shape[0] + 2):
        overlap = free - body_yield(coupling, force)
        compression, slope = _pressed(law, overlap)
        missing = stiffness * compression - force
        force = force + share(stiffness * slope, missing)
    return force, free - body_yield(coupling, force)


# Newton's steps between all cells, and the forces still missing then, over those there are.
_MOST_STEPS, _MISSING = 30, 1e-13


@functools.partial(jax.custom_jvp, nondiff_argnums=(4,))
def forces_between_all(
    law: AbstractContactLaw,
    stiffness: Cells,
    coupling: Coupling,
    free: Cells,
    symmetric: bool = True,
) -> Cells:
    r"""Forces of cells that are all coupled, $f = k\,\sigma(\Delta_0 - C f)$.

    Newton's method from no forces, and so from the cells that overlap on rigid bodies: others do
    not close. Derivatives are those of the solution.

    **Arguments:**

    - `law`: exact or smooth contact.
    - `stiffness`: of each cell [N/m].
    - `coupling`: $C$ between all cells [m/N].
    - `free`: $\Delta_0$, overlap of each on rigid bodies [m].
    - `symmetric`: whether the coupling is.

    **Returns:**

    Forces [N].
    """
    return _searched(law, stiffness, coupling, free, free[:, None][:, :0], symmetric)[0]


@forces_between_all.defjvp
def _forces_tangent(symmetric, primals, tangents):
    law, stiffness, coupling, free = primals
    force = forces_between_all(law, stiffness, coupling, free, symmetric)
    change, slope = _change_at(force, primals, tangents)
    moved = share_with_body(coupling, stiffness * slope, change[:, None], symmetric=symmetric)
    return force, moved[:, 0]


def _change_at(force: Cells, primals, tangents) -> tuple[Cells, Cells]:
    """Change of what the cells press with as long as their forces stay, and slopes of compression.

    By law, stiffness, coupling and overlaps, as of `forces_between_all`.
    """

    def pressed(law, stiffness, coupling, free):
        return stiffness * law.compression(free - body_yield(coupling, force))

    law, _, coupling, free = primals
    _, slope = _pressed(law, free - body_yield(coupling, force))
    return jax.jvp(pressed, primals, tangents)[1], slope


def _searched(
    law: AbstractContactLaw,
    stiffness: Cells,
    coupling: Coupling,
    free: Cells,
    arms: CellArms,
    symmetric: bool,
    borne: _IfAllBear | None = None,
) -> tuple[Cells, Cells, CellColumns]:
    """Forces, overlaps, and forces per coordinate with the contact of the step before the last.

    Where all cells bear, `borne` tells all of it.
    """

    def missing_at(force: Cells, overlap: Cells) -> tuple[Cells, Cells]:
        compression, slope = _pressed(law, overlap)
        return stiffness * compression - force, stiffness * slope

    def solved(tangent: Cells, missing: Cells, needed: Flag) -> CellColumns:
        # Of a batch, what has been found is not factorised again.
        if symmetric:
            return shared_where_needed(coupling, tangent, arms, missing, needed)
        right = jnp.column_stack([tangent[:, None] * arms, missing])
        return share_with_body(coupling, tangent, right, symmetric=False)

    def body(state):
        force, overlap, pushed, done, steps = state
        missing, tangent = missing_at(force, overlap)
        step = solved(tangent, missing, ~done)
        force = jnp.where(done, force, force + step[:, -1])
        pushed = jnp.where(done, pushed, step[:, :-1])
        overlap = jnp.where(done, overlap, free - body_yield(coupling, force))
        missing, _ = missing_at(force, overlap)
        found = jnp.max(jnp.abs(missing)) <= _MISSING * jnp.max(stiffness * jnp.abs(free))
        return force, overlap, pushed, done | found, steps + 1

    def unfinished(state):
        return ~state[3] & (state[4] < _MOST_STEPS)

    force, overlap, pushed = jnp.zeros_like(free), free, jnp.zeros_like(arms)
    done = jnp.asarray(False)
    if borne is not None:
        done = jnp.all((borne.overlap >= 0.0) | (stiffness == 0.0))
        force = jnp.where(done, stiffness * borne.overlap, force)
        overlap = jnp.where(done, borne.overlap, overlap)
        pushed = jnp.where(done, stiffness[:, None] * borne.columns, pushed)
    first = force, overlap, pushed, done, 0
    force, overlap, pushed, _, _ = jax.lax.while_loop(unfinished, body, first)
    return force, overlap, pushed


@jax.custom_jvp
def _exact_forces(
    stiffness: Cells, coupling: Coupling, free: Cells, arms: CellArms, borne: _IfAllBear | None
) -> tuple[Cells, Cells, CellColumns]:
    """As of `_searched` with exact contact, columns by the factor of the last step.

    The cells that were closed in it are those that are closed in the end.
    """
    return _searched(ExactContact(), stiffness, coupling, free, arms, True, borne)


@_exact_forces.defjvp
def _exact_forces_tangent(primals, tangents):
    borne = primals[4]

    def one_by_one(stiffness, coupling, free, arms):
        if borne is None:
            force = forces_between_all(ExactContact(), stiffness, coupling, free)
        else:
            force = _forces_on_the_way(stiffness, coupling, free, borne)
        overlap = free - body_yield(coupling, force)
        _, slope = _pressed(ExactContact(), overlap)
        return force, overlap, tangent_columns(stiffness * slope, coupling, arms)

    return jax.jvp(one_by_one, primals[:4], tangents[:4])


@jax.custom_jvp
def _forces_on_the_way(
    stiffness: Cells, coupling: Coupling, free: Cells, borne: _IfAllBear
) -> Cells:
    """Forces with exact contact. Their derivatives, forward only, need no factor where all bear."""
    none = borne._replace(columns=borne.columns[:, :0])
    return _exact_forces(stiffness, coupling, free, free[:, None][:, :0], none)[0]


@_forces_on_the_way.defjvp
def _forces_on_the_way_tangent(primals, tangents):
    stiffness, coupling, _, borne = primals
    force, law = _forces_on_the_way(*primals), ExactContact()
    change, slope = _change_at(force, (law, *primals[:3]), (law, *tangents[:3]))
    whole = _bear(stiffness, slope)
    arms = change[:, None][:, :0]
    found = shared_where_needed(coupling, stiffness * slope, arms, change, ~whole)[:, 0]
    return force, jnp.where(whole, borne.inverse @ change, found)


def _bear(stiffness: Cells, closed: Cells) -> Flag:
    """Whether all cells bear, with so much of each closed."""
    return jnp.all((closed == 1.0) | (stiffness == 0.0))


def _pressed(law: AbstractContactLaw, overlap: Cells) -> tuple[Cells, Cells]:
    """Compression of each cell [m] and its slope by the overlap [-]."""
    return jax.jvp(law.compression, (overlap,), (jnp.ones_like(overlap),))


def mesh_load(
    mesh: Mesh, place: Coordinates, law: AbstractContactLaw
) -> tuple[Coordinates, CoordinateMatrix]:
    """Load of the mesh on its coordinates, and its tangent stiffness.

    **Arguments:**

    - `mesh`: cells at one instant.
    - `place`: mesh coordinates [m, rad].
    - `law`: exact or smooth contact.

    **Returns:**

    Resultants of the cell forces [N, N m], and their derivative by `place` [N/m, N, N m].
    """
    force, _, pushed = _pressed_cells(mesh, place, law)
    return mesh.arms.T @ force, mesh.arms.T @ pushed


def _pressed_cells(
    mesh: Mesh, place: Coordinates, law: AbstractContactLaw
) -> tuple[Cells, Cells, CellColumns]:
    """Force and overlap of each cell, and the forces per mesh coordinate."""
    if isinstance(law, ExactContact) and mesh.coupling is not None and mesh.coupling.ndim == 2:
        free = mesh.arms @ place - mesh.gap
        borne = _if_all_bear(mesh, place, mesh.arms)
        return _exact_forces(mesh.stiffness, mesh.coupling, free, mesh.arms, borne)
    force, overlap = cell_forces(mesh, place, law)
    _, slope = _pressed(law, overlap)
    return force, overlap, tangent_columns(mesh.stiffness * slope, mesh.coupling, mesh.arms)


def tangent_columns(stiffness: Cells, coupling: Coupling | None, arms: CellArms) -> CellColumns:
    """Forces of the cells per mesh coordinate."""
    columns = stiffness[:, None] * arms
    return columns if coupling is None else share_with_body(coupling, stiffness, columns)


def mean_load(
    start: Mesh, middle: Mesh, end: Mesh, first: Coordinates, last: Coordinates
) -> tuple[Coordinates, CoordinateMatrix, CoordinateMatrix]:
    r"""Load of the mesh in the mean over a step, with exact contact.

    Overlaps are taken to change evenly over the step, so that a cell's mean compression is
    $[\Phi(\Delta_1) - \Phi(\Delta_0)]/(\Delta_1 - \Delta_0)$ with $\Phi$ the integral of the
    positive part: it knows when within the step the cell closed. As a time step at constant
    stiffness this is Gonzalez's discrete gradient, which conserves energy.

    **Arguments:**

    - `start`, `middle`, `end`: the cells at these places of the step.
    - `first`: mesh coordinates at its start [m, rad].
    - `last`: mesh coordinates at its end [m, rad].

    **Returns:**

    Resultants of the mean cell forces [N, N m]; their derivatives by `first` and by `last`.
    """
    begun, by_first = _overlaps(start, first)
    ended, by_last = _overlaps(end, last)
    compression = mean_ramp(begun, ended)
    slopes = _ramp_slopes(begun, ended, compression)
    load = middle.arms.T @ (middle.stiffness * compression)
    tangents = [
        middle.arms.T @ ((middle.stiffness * slope)[:, None] * columns)
        for slope, columns in zip(slopes, (by_first, by_last), strict=True)
    ]
    return load, tangents[0], tangents[1]


def mean_tangent(
    start: Mesh, middle: Mesh, end: Mesh, first: Coordinates, last: Coordinates
) -> CoordinateMatrix:
    """Mean tangent stiffness of exact contact over a step: each cell while it is closed.

    **Arguments:**

    - `start`, `middle`, `end`: the cells at these places of the step.
    - `first`: mesh coordinates at its start [m, rad].
    - `last`: mesh coordinates at its end [m, rad].

    **Returns:**

    The mean stiffness on the mesh coordinates [N/m, N, N m].
    """
    law = ExactContact()
    _, begun = cell_forces(start, first, law)
    _, ended = cell_forces(end, last, law)
    change = ended - begun
    moves = jnp.abs(change) > 0.0
    closing = (law.compression(ended) - law.compression(begun)) / jnp.where(moves, change, 1.0)
    closed = jnp.where(moves, closing, jnp.where(begun > 0.0, 1.0, 0.0))
    if middle.bearing is None or middle.coupling is None:
        columns = tangent_columns(middle.stiffness * closed, middle.coupling, middle.arms)
        return middle.arms.T @ columns
    whole, stiffness = _bear(middle.stiffness, closed), middle.stiffness
    right = middle.arms, jnp.zeros_like(closed)
    found = shared_where_needed(middle.coupling, stiffness * closed, *right, ~whole)[:, :-1]
    borne = stiffness[:, None] * middle.bearing.by_place
    return middle.arms.T @ jnp.where(whole, borne, found)


def _overlaps(mesh: Mesh, place: Coordinates) -> tuple[Cells, CellColumns]:
    """Overlap of each cell with exact contact, what bodies yield subtracted, and its slopes."""
    _, overlap, pushed = _pressed_cells(mesh, place, ExactContact())
    if mesh.coupling is None:
        return overlap, mesh.arms
    yields = jax.vmap(body_yield, in_axes=(None, 1), out_axes=1)
    return overlap, mesh.arms - yields(mesh.coupling, pushed)


def mean_ramp(first: Reals, last: Reals) -> Reals:
    """Mean of the positive part of what changes evenly from `first` to `last`, in their unit.

    Written without the difference of like numbers, so that its slopes are right to rounding.

    **Arguments:**

    - `first`, `last`: any real arrays of one shape.

    **Returns:**

    An array like them.
    """
    closed, crossing, span = _closed_and_crossing(first, last)
    squares = jnp.maximum(first, 0.0) ** 2 + jnp.maximum(last, 0.0) ** 2
    part = jnp.where(crossing, 0.5 * squares / span, 0.0)
    return jnp.where(closed, 0.5 * (first + last), part)


def _ramp_slopes(first: Reals, last: Reals, mean: Reals) -> tuple[Reals, Reals]:
    """Derivatives of `mean_ramp` by `first` and by `last`, where it is `mean`."""
    closed, crossing, span = _closed_and_crossing(first, last)

    def by(end: Reals) -> Reals:
        part = (jnp.maximum(end, 0.0) - jnp.sign(end) * mean) / span
        return jnp.where(closed, 0.5, jnp.where(crossing, part, 0.0))

    return by(first), by(last)


def _closed_and_crossing(first: Reals, last: Reals) -> tuple[_Where, _Where, Reals]:
    """Where both ends are closed, where one or both are open, and the sum of their sizes there."""
    closed = (first >= 0.0) & (last >= 0.0)
    span = jnp.abs(first) + jnp.abs(last)
    crossing = ~closed & (span > 0.0)
    return closed, crossing, jnp.where(crossing, span, 1.0)
