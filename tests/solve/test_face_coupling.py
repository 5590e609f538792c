"""Mesh cycles of teeth that feel a load along their face, against 3-D finite elements."""

import dataclasses
import json
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick
from solve_cases import ACCESSORY

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._dynamics._cell_forces import mesh_load
from jaxgear._dynamics._table import MIDDLE, mesh_at

FE = json.loads((Path(__file__).parents[1] / "data" / "fe3d" / "accessory.json").read_text())
LAW = jg.ExactContact()


class Answers(NamedTuple):
    """What a cycle comes to: error [m], pressure [Pa], loads over the face, all phases solved."""

    mean: jax.Array
    rms: jax.Array
    pressure: jax.Array
    face_load: jax.Array
    solved: jax.Array


def _model(crowning=0.0, slope=0.0, torque=80.0, updates=3, coupled=True) -> jg.PairModel:
    pair = eqx.tree_at(
        lambda p: (p.pinion.bore, p.wheel.bore),
        ACCESSORY.pair(),
        (jnp.asarray(30.0 * mm), jnp.asarray(40.0 * mm)),
        is_leaf=lambda x: x is None,
    )
    return jg.PairModel(
        pair,
        torque,
        flanks=jg.Flanks(
            wheel=jg.Superposed((jg.Crowning(crowning * um), jg.HelixSlope(slope * um)))
        ),
        compliance=jg.WeberBanaschek(
            load_updates=updates, face_coupling=jg.FaceCoupling() if coupled else None
        ),
    )


@eqx.filter_jit
def _answers(model: jg.PairModel, grid: jg.MeshGrid) -> Answers:
    cycle = jg.mesh_cycle(model, grid, law=LAW, throw=False)
    error, weight = jg.transmission_error(model.pair, cycle), cycle.cells.lines.weight
    mean = jnp.sum(weight * error)
    lines = cycle.force.reshape(cycle.cells.lines.roll.shape)
    return Answers(
        mean=mean,
        rms=jnp.sqrt(jnp.sum(weight * (error - mean) ** 2)),
        pressure=jnp.max(jg.hertz_pressure(model.pair, cycle, LAW)),
        face_load=jnp.sum(weight[:, None] * jnp.sum(lines, axis=1), axis=0),
        solved=jnp.all(cycle.converged),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "crowning", "slope"),
    quick(1, [("a-plain", 0.0, 0.0), ("b-crown10", 10.0, 0.0), ("b-slope20", 0.0, 20.0)]),
)
def test_uneven_loads_against_finite_elements(case, crowning, slope):
    model = _model(crowning, slope)
    found = _answers(model, jg.mesh_grid(model.pair, phases=24, slices=20))
    truth = FE["cycles"][case]
    assert bool(found.solved)
    assert_close(float(found.mean) / um, truth["te_mean_um"], rtol=0.015, atol=0.0)
    assert_close(float(found.rms) / um, truth["te_rms_um"], rtol=0.03, atol=0.0)
    assert_close(float(found.pressure) / 1e6, truth["max_pressure_MPa"], rtol=0.04, atol=0.0)
    factor = float(jnp.max(found.face_load) / jnp.mean(found.face_load))
    assert_close(factor, truth["face_load_factor"], rtol=0.08, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("law", [jg.ExactContact(), jg.SmoothContact(width=0.5 * um)])
def test_derivatives_against_differences(law):
    """By torque, crowning, both face widths, module and the decay lengths."""
    grid = jg.mesh_grid(_model().pair, phases=8, slices=5)

    def error(numbers):
        torque, crowning, faces, module, lengths = numbers
        model = eqx.tree_at(
            lambda m: (
                m.torque,
                m.flanks.wheel.parts[0].depth,
                m.pair.pinion.face_width,
                m.pair.wheel.face_width,
                m.pair.normal_module,
                m.compliance.face_coupling.beam,
                m.compliance.face_coupling.body,
            ),
            _model(10.0, 10.0, updates=1),
            (torque, crowning, faces[0], faces[1], module, lengths[0], lengths[1]),
        )
        cycle = jg.mesh_cycle(model, grid, law=law, throw=False)
        return 1e6 * jnp.sum(cycle.cells.lines.weight * cycle.approach)

    numbers = (
        jnp.asarray(80.0),
        jnp.asarray(10.0 * um),
        jnp.asarray([11.5, 9.5]) * mm,
        jnp.asarray(1.5 * mm),
        jnp.asarray([1.11, 4.0]),
    )
    assert_gradient(error, numbers, rtol=1e-5)


def _helical(helix, crowning=0.0, slope=0.0) -> jg.PairModel:
    """Two gears of 24 teeth, ten modules wide."""
    pinion, wheel = (
        jg.Gear(24, 30.0 * mm, shift, bore=36.0 * mm, dedendum=1.25, fillet_radius=0.3)
        for shift in (0.2, -0.1)
    )
    pair = jg.GearPair(pinion, wheel, 3.0 * mm, 20.0 * jg.deg, helix * jg.deg)
    flank = jg.Superposed(
        (
            jg.Crowning(crowning * um),
            jg.HelixSlope(slope * um),
            jg.TipRelief(20.0 * um, 0.3),
        )
    )
    return jg.PairModel(
        pair,
        400.0,
        flanks=jg.Flanks(wheel=flank),
        compliance=jg.WeberBanaschek(load_updates=1),
    )


@pytest.mark.slow
def test_slices_converge_in_first_order_or_better():
    model = _model(0.0, 20.0)
    means = [
        float(_answers(model, jg.mesh_grid(model.pair, phases=8, slices=n)).mean)
        for n in (10, 20, 40, 80)
    ]
    steps = np.abs(np.diff(means))
    assert steps[0] / steps[1] > 1.9
    assert steps[1] / steps[2] > 1.9


@pytest.mark.slow
@pytest.mark.parametrize("law", [jg.ExactContact(), jg.SmoothContact(width=0.5 * um)])
def test_derivatives_of_helical_teeth_against_differences(law):
    """By what leaves the axial direction alone, and by the helix and all that it moves."""
    start = _helical(20.0, 8.0, 6.0)
    grid = jg.mesh_grid(start.pair, phases=8, slices=4)

    def error(numbers):
        cycle = jg.mesh_cycle(eqx.tree_at(_moved, start, numbers), grid, law=law, throw=False)
        return 1e6 * jnp.sum(cycle.cells.lines.weight * cycle.approach)

    # Numbers are arguments: as constants of a program they take minutes to fold.
    def along(still, helical, by):
        return jax.jvp(lambda part: error((*still, *part)), (helical,), (by,))

    def along_still(still, helical, by):
        return jax.jvp(lambda part: error((*part, *helical)), (still,), (by,))

    numbers = _moved(start)
    still, helical = numbers[:2], numbers[2:]
    value = jax.jit(lambda still, helical: error((*still, *helical)))
    moved = lambda part, by: tuple(each * (1.0 + by) for each in part)
    step = 1e-5
    ahead, behind = (value(moved(still, by), helical) for by in (step, -step))
    slope = jax.jit(along_still)(still, helical, still)[1]
    assert_close(slope, (ahead - behind) / (2.0 * step), rtol=1e-6, atol=0.0)
    ahead, behind = (value(still, moved(helical, by)) for by in (step, -step))
    slope = jax.jit(along)(still, helical, helical)[1]
    assert_close(slope, (ahead - behind) / (2.0 * step), rtol=1e-5, atol=0.0)
    # In reverse, one by one.
    reverse = jax.grad(lambda helical, still: error((*still, *helical)))
    slopes = jax.jit(reverse)(helical, still)
    assert_close(
        sum(jnp.vdot(*each) for each in zip(slopes, helical, strict=True)),
        slope,
        rtol=1e-9,
        atol=0.0,
    )


def _moved(model: jg.PairModel) -> tuple:
    pair, flank = model.pair, model.flanks.wheel
    assert isinstance(flank, jg.Superposed)
    crowning = flank.parts[0]
    assert isinstance(crowning, jg.Crowning)
    return (
        model.torque,
        crowning.depth,
        pair.helix_angle,
        pair.normal_module,
        pair.pinion.face_width,
        pair.wheel.bore,
    )


@pytest.mark.slow
@pytest.mark.parametrize("helix", [15.0, 30.0])
def test_slices_of_helical_teeth_converge_in_first_order_or_better(helix):
    """The mean; what is largest at an edge does not, nor RMS where phases are the coarser."""
    model = _helical(helix, 10.0, 10.0)
    means = [
        float(_answers(model, jg.mesh_grid(model.pair, phases=16, slices=n)).mean)
        for n in (10, 20, 40)
    ]
    first, second = np.abs(np.diff(means))
    assert first / second > 1.9


# Mean TE [um], pressure [MPa] and K_Hbeta of two gears of 24 teeth, helix 30 degrees, on
# `ElementTeeth` of five rows; by face [mm] and torque [N m].
_HELICAL = {(30.0, 400.0): (27.048, 1354.3, 1.095), (15.0, 200.0): (33.481, 1597.1, 1.078)}


@pytest.mark.slow
@pytest.mark.parametrize(("face", "torque"), _HELICAL)
def test_helical_teeth_against_finite_elements(face, torque):
    """Slices apart lack 16 and 27 % of the pressure, and 8 and 7 % of the face load factor."""
    gear = jg.Gear(24, face * mm, 0.0, bore=36.0 * mm, dedendum=1.25, fillet_radius=0.3)
    pair = jg.GearPair(gear, gear, 3.0 * mm, 20.0 * jg.deg, 30.0 * jg.deg)
    model = jg.PairModel(pair, torque, compliance=jg.WeberBanaschek(load_updates=3))
    found = _answers(model, jg.mesh_grid(pair, phases=16, slices=20))
    assert bool(found.solved)
    mean, pressure, uneven = _HELICAL[face, torque]
    assert abs(1e6 * float(found.mean) / mean - 1.0) < 0.07
    assert abs(1e-6 * float(found.pressure) / pressure - 1.0) < 0.1
    assert abs(float(jnp.max(found.face_load) / jnp.mean(found.face_load)) / uneven - 1.0) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("helix", [20.0, 35.0])
def test_helical_pairs_are_solved(helix):

    drawing = dataclasses.replace(ACCESSORY, helix_angle=np.radians(helix))
    model = jg.PairModel(
        drawing.pair(), 80.0, compliance=jg.WeberBanaschek(face_coupling=jg.FaceCoupling())
    )
    found = _answers(model, jg.mesh_grid(model.pair, phases=8, slices=12))
    assert bool(found.solved)
    apart = eqx.tree_at(
        lambda m: m.compliance,
        model,
        jg.WeberBanaschek(face_coupling=None),
        is_leaf=lambda x: x is None,
    )
    other = _answers(apart, jg.mesh_grid(model.pair, phases=8, slices=12))
    # Lines shorter than the face lean on the rest of the tooth. By how much, no other program says.
    assert 0.75 < float(found.mean / other.mean) < 1.0


@pytest.mark.slow
def test_cells_out_of_mesh_cost_nothing_and_periods_repeat():
    """A helical pair over two periods, against all cells of one, in mesh or not."""
    pair = dataclasses.replace(ACCESSORY, helix_angle=np.radians(20.0)).pair()
    law = jg.WeberBanaschek(face_coupling=jg.FaceCoupling())
    model = jg.PairModel(pair, 80.0, compliance=law)
    some = jg.mesh_grid(pair, phases=8, slices=4, periods=2)
    assert some.abreast == 2
    assert some.lines > 2
    every = dataclasses.replace(some, abreast=None, periods=1)
    found, other = (jg.mesh_cycle(model, grid, law=LAW) for grid in (some, every))
    for period in (slice(0, 8), slice(8, 16)):
        assert_close(found.force[period], other.force, rtol=1e-9, atol=1e-9)
        assert_close(found.overlap[period], other.overlap, rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_coupled_mesh_in_motion_presses_as_at_rest():
    """The table of a pair in motion, where statics has its nodes: the same loads."""
    model = _model(10.0, 0.0, updates=0)
    grid = jg.mesh_grid(model.pair, phases=8, slices=4)
    dynamics = jg.pair_dynamics(model, grid)
    table, cycle = dynamics.system.table, dynamics.cycle
    assert table.coupling is not None
    assert table.coupling.shape == (8, grid.cells, grid.cells)
    pressed = jax.vmap(lambda m, place: mesh_load(m, place, LAW)[0])
    load = jax.jit(pressed)(mesh_at(table, MIDDLE), dynamics.system.rest)
    assert_close(load, cycle.load, rtol=1e-9, atol=1e-6)
