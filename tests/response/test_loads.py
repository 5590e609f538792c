"""Loads, pressures and stiffness of settled cycles, against the cell forces they come from."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick
from solve_cases import ACCESSORY, FZG_C14, POWER, run_cycle, symmetric_relief

import jaxgear as jg
from jaxgear import MPa, mm, um

STIFFNESS = 14e9
EXACT = jg.ExactContact()
CASES = {
    "spur": (ACCESSORY, EXACT),
    "helical": (POWER, EXACT),
    "smooth": (ACCESSORY, jg.SmoothContact(1 * um)),
}


def _settled(drawing, law, depth=12 * um, **more):
    model = jg.PairModel(
        drawing.pair(),
        120.0,
        symmetric_relief(depth, 0.3),
        jg.ConstantStiffness(STIFFNESS),
        **more,
    )
    grid = jg.mesh_grid(model.pair, phases=16, slices=8)
    return model, run_cycle(model, grid, law=law)


@pytest.mark.parametrize("case", quick(1, CASES))
def test_load_sharing_sums_to_one(case):
    _, cycle = _settled(*CASES[case])
    sharing = jg.load_sharing(cycle)
    assert sharing.shape == cycle.cells.lines.roll.shape[:2]
    assert_close(jnp.sum(sharing, axis=1), jnp.ones(16), rtol=1e-13, atol=0.0)
    assert float(jnp.max(sharing)) <= 1.0 + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_pressure_off_ends_leaves_out_where_helical_teeth_come_and_go(case):
    drawing, law = CASES[case]
    model, cycle = _settled(drawing, law, depth=0.0)
    pair, roll = model.pair, np.asarray(cycle.cells.lines.roll)
    pressure = np.asarray(jg.hertz_pressure(pair, cycle, law))
    lead = 0.1 * float(pair.face_width) * abs(math.tan(float(pair.base_helix_angle)))
    left_out = np.zeros(roll.shape, dtype=bool)
    for end in (pair.path_start, pair.path_end):
        left_out |= np.abs(roll - float(end)) < lead
    assert left_out.any() == (case == "helical")
    assert_close(
        jg.pressure_off_ends(pair, cycle, law), pressure[~left_out].max(), rtol=1e-12, atol=0.0
    )


@pytest.mark.slow
def test_off_the_ends_pressure_of_helical_teeth_without_relief_converges():
    """At the ends, where a tooth comes in over a corner of its face, it does not."""
    pair = POWER.pair()
    model, most, off = jg.PairModel(pair, 308.8), [], []
    for slices in (20, 60):
        cycle = run_cycle(model, jg.mesh_grid(pair, phases=4 * slices, slices=slices))
        most.append(float(jnp.max(jg.hertz_pressure(pair, cycle, EXACT))))
        off.append(float(jg.pressure_off_ends(pair, cycle, EXACT)))
    assert most[1] > 1.15 * most[0]
    assert abs(off[1] / off[0] - 1.0) < 0.01


def test_load_sharing_without_relief_by_hand():
    """Constant stiffness: halves where two pairs are in contact, one alone elsewhere."""
    _, cycle = _settled(ACCESSORY, EXACT, depth=0.0)
    phase = np.asarray(cycle.cells.lines.phase)
    largest = np.asarray(jg.load_sharing(cycle)).max(axis=1)
    expected = np.where(phase < ACCESSORY.contact_ratio - 1, 0.5, 1.0)
    assert_close(largest, expected, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("case", quick(1, CASES))
def test_line_load_integrates_to_the_force(case):
    """Times length and active fraction it is the cell's force, where the middle is in mesh."""
    drawing, law = CASES[case]
    _, cycle = _settled(drawing, law, depth=0.0)
    lines = cycle.cells.lines
    load = jg.line_load(cycle, law)
    length = drawing.common_width / math.cos(drawing.base_helix) / 8
    total = np.sum(np.asarray(load * lines.fraction) * length, axis=(1, 2))
    force = np.asarray(cycle.force).reshape(lines.roll.shape)
    kept = np.where(np.asarray(lines.fraction) >= 0.5, force, 0.0).sum(axis=(1, 2))
    assert_close(total, kept, rtol=1e-10, atol=0.0)
    # Deep enough relief leaves nothing on slices that are only partly in mesh.
    _, cycle = _settled(drawing, law, depth=60 * um)
    load = np.asarray(jg.line_load(cycle, law) * cycle.cells.lines.fraction)
    total = load.sum(axis=(1, 2)) * length
    assert_close(total, np.full(16, drawing.force(120.0)), rtol=1e-8, atol=0.0)


def test_line_load_vanishes_beyond_the_path():
    _, cycle = _settled(POWER, EXACT, depth=0.0)
    outside = cycle.cells.lines.fraction < 0.5
    assert bool(jnp.any(outside & (cycle.force.reshape(outside.shape) > 0.0)))
    assert float(jnp.max(jnp.where(outside, jg.line_load(cycle, EXACT), 0.0))) == 0.0


@pytest.mark.slow
def test_hertz_pressure_at_the_pitch_point_by_hand():
    """FZG C14, 200 N m, one pair over 14 mm: 1347 MPa at the pitch point."""
    pair = FZG_C14.pair()
    model = jg.PairModel(pair, 200.0, compliance=jg.ConstantStiffness(STIFFNESS))
    grid = jg.mesh_grid(pair, phases=64, slices=4)
    cycle = run_cycle(model, grid)
    pressure = np.asarray(jg.hertz_pressure(pair, cycle, EXACT))
    lines = cycle.cells.lines
    roll = np.asarray(lines.roll)
    pitch = FZG_C14.centre_distance * 16 / 40 * math.sin(FZG_C14.working_angle)
    alone = (np.asarray(lines.phase) > FZG_C14.contact_ratio - 1)[:, None, None]
    inside = alone & (np.asarray(lines.fraction) > 0.99)
    nearest = np.argmin(np.where(inside, np.abs(roll - pitch), np.inf))
    assert abs(roll.flat[nearest] - pitch) < 0.1 * mm
    assert_close(pressure.flat[nearest], 1347.3 * MPa, rtol=5e-3, atol=0.0)
    # And in every cell: sqrt(F' E* / (pi rho)), E* = 206 GPa / (2 0.91).
    tangent = FZG_C14.centre_distance * math.sin(FZG_C14.working_angle)
    radius = roll * (tangent - roll) / tangent
    modulus = 206e9 / (2 * (1 - 0.3**2))
    load = np.asarray(jg.line_load(cycle, EXACT))
    closed = load > 1.0
    expected = np.sqrt(load[closed] * modulus / (math.pi * radius[closed]))
    assert_close(pressure[closed], expected, rtol=1e-9, atol=0.0)
    assert np.all(pressure[~closed] == 0.0)


def test_helical_pressure_uses_the_normal_radius():
    """rho_n = rho_t / cos(beta_b)."""
    model, cycle = _settled(POWER, EXACT)
    load, roll = np.asarray(jg.line_load(cycle, EXACT)), np.asarray(cycle.cells.lines.roll)
    tangent = POWER.centre_distance * math.sin(POWER.working_angle)
    radius = roll * (tangent - roll) / tangent / math.cos(POWER.base_helix)
    inside = (np.asarray(cycle.cells.lines.fraction) > 0.99) & (load > 1.0)
    expected = np.sqrt(load[inside] * 206e9 / 1.82 / (math.pi * radius[inside]))
    pressure = np.asarray(jg.hertz_pressure(model.pair, cycle, EXACT))
    assert_close(pressure[inside], expected, rtol=1e-9, atol=0.0)


def test_mesh_stiffness_by_hand():
    """k' b for each pair in contact; relief deep enough opens one of two."""
    _, plain = _settled(ACCESSORY, EXACT, depth=0.0)
    phase = np.asarray(plain.cells.lines.phase)
    pairs = np.where(phase < ACCESSORY.contact_ratio - 1, 2.0, 1.0)
    single = STIFFNESS * ACCESSORY.common_width
    assert_close(jg.mesh_stiffness(plain), pairs * single, rtol=1e-7, atol=0.0)
    _, open_ = _settled(ACCESSORY, EXACT, depth=2e-3)
    lost = np.asarray(jg.mesh_stiffness(open_)) < 1.5 * single
    assert np.count_nonzero(lost) > np.count_nonzero(pairs == 1.0)


def test_mesh_stiffness_of_a_helical_pair_has_the_mean_length():
    """Mean over the period: k' eps_alpha b / cos(beta_b), whatever the slices."""
    _, cycle = _settled(POWER, EXACT, depth=0.0)
    length = POWER.contact_ratio * POWER.common_width / math.cos(POWER.base_helix)
    mean = jg.cycle_mean(cycle, jg.mesh_stiffness(cycle))
    assert_close(mean, STIFFNESS * length, rtol=1e-3, atol=0.0)


@pytest.mark.slow
def test_loads_are_differentiable():
    """In what a cycle has found; that has derivatives in its turn, by tests of its own."""
    law = CASES["smooth"][1]
    # Every cell carries: the root of a load near zero would bend central differences.
    model, settled = _settled(ACCESSORY, law, depth=3 * um)
    found = lambda cycle: (cycle.force, cycle.overlap, cycle.cells.stiffness)

    def loads(moved):
        cycle = eqx.tree_at(found, settled, moved)
        pressure = jg.hertz_pressure(model.pair, cycle, law) / MPa
        share = jg.load_sharing(cycle)
        load = jg.line_load(cycle, law) / 1e5
        weights = jnp.arange(1.0, share.size + 1.0).reshape(share.shape)
        return jnp.sum(weights * share) + 1e-3 * jnp.sum(pressure) + jnp.sum(load**2)

    assert_gradient(loads, found(settled), rtol=1e-6, step=1e-6)


@pytest.mark.slow
def test_pressure_of_an_open_cell_has_no_infinite_slope():
    base, _ = _settled(ACCESSORY, EXACT)
    grid = jg.mesh_grid(base.pair, phases=8, slices=2)

    def pressure(depth):
        model = eqx.tree_at(lambda m: m.flanks, base, symmetric_relief(depth, 0.3))
        cycle = jg.mesh_cycle(model, grid, throw=False)
        return jg.smooth_maximum(jg.hertz_pressure(model.pair, cycle, EXACT), jnp.asarray(5 * MPa))

    assert bool(jnp.isfinite(jax.jit(jax.grad(pressure))(jnp.asarray(40 * um))))
