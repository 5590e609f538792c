"""The pressure of a rounded tip corner on the flank that it meets beyond the path."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxgear as jg
from jaxgear import deg, mm, um

_STIFF = jg.ConstantStiffness(1.4e10)


def _pair(pinion: float | None = 0.2 * mm, wheel: float | None = 0.3 * mm) -> jg.GearPair:
    return jg.GearPair(
        jg.Gear(25, 12 * mm, tip_corner_radius=pinion),
        jg.Gear(31, 10 * mm, tip_corner_radius=wheel),
        2 * mm,
        helix_angle=10 * deg,
    )


@pytest.fixture(scope="module")
def grid():
    return jg.mesh_grid(_pair(), phases=16, slices=3, beyond=0.3)


def _cycle(pair, grid, torque=200.0):
    flanks = jg.Flanks(jg.Crowning(0.0 * um), jg.Crowning(0.0 * um))
    return jg.mesh_cycle(jg.PairModel(pair, torque, flanks, _STIFF), grid)


def test_a_corner_presses_as_a_cylinder_on_a_cylinder():
    pair = _pair()
    beyond = 0.1 * mm
    early, late = pair.path_start - beyond, pair.path_end + beyond
    found = jg.corner_contact(pair, jnp.stack([early, late]))
    pressure = found.pressure(jnp.asarray([2e5, 2e5]))
    met = jg.tip_contact_rolls(pair, jnp.stack([early, late]))
    modulus = 206e9 / (2.0 * (1.0 - 0.3**2))
    for place, corner, roll in ((0, 0.3e-3, met[0][0]), (1, 0.2e-3, met[1][1])):
        flank = float(roll) / math.cos(float(pair.base_helix_angle))
        radius = 1.0 / (1.0 / corner + 1.0 / flank)
        half_width = math.sqrt(4.0 * 2e5 * radius / (math.pi * modulus))
        # The load is what an elliptic pressure over the band adds up to.
        assert float(pressure[place]) == pytest.approx(
            2.0 * 2e5 / (math.pi * half_width), rel=1e-12
        )


def test_on_the_path_and_without_a_radius_it_is_the_flanks():
    bare, half = _pair(None, None), _pair(0.2 * mm, None)
    roll = jnp.linspace(bare.path_start - 0.5 * mm, bare.path_end + 0.5 * mm, 41)
    on_path = jnp.clip(roll, bare.path_start, bare.path_end)
    flanks = jg.hertz_contact(bare, on_path).radius
    np.testing.assert_array_equal(jg.corner_contact(bare, roll).radius, flanks)
    other = np.asarray(jg.corner_contact(half, roll).radius != flanks)
    np.testing.assert_array_equal(other, np.asarray(roll > bare.path_end))


def test_pressure_goes_with_the_root_of_a_small_radius():
    place = (_pair().path_end + 0.1 * mm)[None]
    radii = 1e-6, 4e-6
    small, large = (jg.corner_contact(_pair(r), place).pressure(jnp.asarray([1e5])) for r in radii)
    assert float(small[0] / large[0]) == pytest.approx(2.0, rel=1e-3)


@pytest.mark.slow
def test_only_corners_of_known_radius_have_a_pressure(grid):
    law = jg.ExactContact()
    for pair in (_pair(), _pair(0.2 * mm, None), _pair(None, None)):
        cycle = _cycle(pair, grid)
        corner, pressure = (f(pair, cycle, law) for f in (jg.corner_pressure, jg.hertz_pressure))
        roll, load = cycle.cells.lines.roll, jg.line_load(cycle, law)
        known = (roll > pair.path_end) & (pair.pinion.tip_corner_radius is not None)
        known |= (roll < pair.path_start) & (pair.wheel.tip_corner_radius is not None)
        assert bool(jnp.any((roll > pair.path_end) & (load > 0.0)))
        np.testing.assert_allclose(corner, jnp.where(known, pressure, 0.0), rtol=1e-13)
        np.testing.assert_array_equal(corner > 0.0, known & (load > 0.0))


@pytest.mark.slow
def test_its_derivatives_are_those_of_differences(grid):
    def largest(inputs):
        pair = _pair(inputs[0], inputs[1])
        cycle = _cycle(pair, grid, inputs[2])
        return jnp.max(jg.corner_pressure(pair, cycle, jg.ExactContact()))

    at = np.asarray([0.2 * mm, 0.3 * mm, 200.0])
    # Whichever corner presses harder, the other one's radius has no part in it.
    program = jax.jit(largest)
    slopes = jax.jit(jax.grad(largest))(jnp.asarray(at))
    for entry, step in enumerate(1e-5 * at):
        moved = [at.copy(), at.copy()]
        moved[0][entry] += step
        moved[1][entry] -= step
        up, down = (float(program(jnp.asarray(each))) for each in moved)
        difference = (up - down) / (2.0 * step)
        assert float(slopes[entry]) == pytest.approx(difference, rel=1e-5, abs=1e-3)
    assert np.count_nonzero(np.asarray(slopes)) == 2
