"""Which piece of each piecewise formula is in use: derivatives hold as long as none changes."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

import jaxgear as jg
from jaxgear._contact._cells import at_line_loads, flank_coordinates
from jaxgear._dynamics._cell_forces import cell_forces
from jaxgear._dynamics._harmonic import Balance
from jaxgear._dynamics._table import END, MIDDLE, START, mesh_at
from jaxgear._dynamics._types import Terms
from jaxgear._types import LineGrid, Reals


def pieces_at_rest(model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw) -> Reals:
    """Which piece of each formula is in use at each cell of a quasi-static cycle.

    A number for each piece [-]: they are the same where all formulas use the same pieces.
    """
    lines = cycle.cells.lines
    contact = _contact(cycle.overlap.reshape(lines.roll.shape), law)
    fraction = jnp.sign(lines.fraction - 1e-9) + jnp.sign(lines.fraction - 1.0 + 1e-9)
    in_mesh = fraction > -1.5
    # The ends of the path: where stiffness and pressure stay constant, and corners touch.
    end = jnp.sign(lines.roll - model.pair.path_start) + jnp.sign(lines.roll - model.pair.path_end)
    inside = [contact, end]
    for flank, place in zip(
        (model.flanks.pinion, model.flanks.wheel),
        flank_coordinates(model.pair, lines),
        strict=True,
    ):
        for part in flank.parts if isinstance(flank, jg.Superposed) else (flank,):
            inside += _pieces_of_flank(part, *place)
    if model.compliance.load_updates:
        inside.append(_above_least_load(model, cycle))
    parts = [fraction + jnp.sign(lines.fraction - 0.5)]
    parts += [jnp.where(in_mesh, part, 0.0) for part in inside]
    if cycle.cells.coupling is not None:
        # Of two lines of a slice, the longer contact counts.
        parts += [jnp.sign(_unlike(lines.fraction, apart)) for apart in range(1, in_mesh.shape[1])]
    narrower = jnp.sign(model.pair.pinion.face_width - model.pair.wheel.face_width)
    return jnp.append(jnp.stack(parts).ravel(), narrower)


def _unlike(fraction: LineGrid, apart: int) -> LineGrid:
    """Difference of the fractions of two lines, as far as neither is full [-]."""
    other = jnp.roll(fraction, apart, axis=1)
    difference = fraction - other
    return jnp.where(jnp.abs(difference) > 1e-12, difference, 0.0)


def _pieces_of_flank(part: jg.AbstractFlankDeviation, profile: Reals, face: Reals) -> list[Reals]:
    """Which piece of a flank deviation is in use at each cell; none of one that is smooth."""
    match part:
        case jg.TipRelief() | jg.RootRelief() | jg.EndRelief():
            # Where it acts does not depend on how deep it is, not even at depth zero.
            one = eqx.tree_at(lambda p: p.depth, part, jnp.ones(()))
            return [(one(profile, face) != 0.0).astype(float)]
        case jg.MeasuredProfile():
            return [_interval(part.place, profile)]
        case jg.MeasuredTopography():
            return [_interval(part.place, profile), _interval(part.face, face)]
    return []


def _interval(points: Reals, place: Reals) -> Reals:
    """Number of points of a table before each place [-]."""
    return jnp.searchsorted(points, place, side="right").astype(float)


def _above_least_load(model: jg.PairModel, cycle: jg.MeshCycle) -> LineGrid:
    """Whether a cell's stiffness follows its line load [-]; below a least load it is constant."""
    nominal = jg.nominal_line_load(model.pair, model.mesh_torque)
    softening = model.compliance.log_slope(model.pair)
    loaded, least = (
        at_line_loads(cycle.cells, force, nominal, softening).line_stiffness
        for force in (cycle.force, jnp.zeros_like(cycle.force))
    )
    return (loaded > least).astype(float)


def pieces_in_motion(balance: Balance, orbit: jg.Orbit, terms: Terms) -> Reals:
    """Whether each cell is closed, wherever in time a steady response evaluates contact.

    A number for each [-], as `pieces_at_rest`.
    """
    at = [(MIDDLE, orbit.place)]
    if len(balance.times) > 1:
        ends = zip((START, END), balance.times, strict=True)
        at = [(part, values @ terms.T) for part, values in ends]
    table, law = balance.system.table, balance.law
    overlap = lambda mesh, place: cell_forces(mesh, place, law)[1]
    found = jnp.stack([jax.vmap(overlap)(mesh_at(table, part), place) for part, place in at])
    return _contact(found, law).ravel()


def _contact(overlap: Array, law: jg.AbstractContactLaw) -> Array:
    """Which piece of the contact law is in use at each overlap."""
    if isinstance(law, jg.SmoothContact):
        return jnp.sign(overlap + law.width) + jnp.sign(overlap - law.width)
    return (overlap > 0.0).astype(float)
