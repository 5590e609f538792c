"""Roots of teeth of finite elements: against plane strain at mid-face, free faces, neighbours."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close

import jaxgear as jg
from fem_prep import Material, ToothedGear, ToothSizing, condense_teeth
from jaxgear._geometry._lines import contact_lines
from jaxgear.scene._element_roots import gear_roots

SIZE = ToothSizing(flank=5, across=4, gap=8, ring=4, margin=1, waves=2)


@pytest.fixture(scope="module")
def made():
    """A pair of one width, its lines, and both influences of its pinion."""
    gear = lambda teeth, shift: jg.Gear(
        teeth, 9.0 * jg.mm, shift, 0.9447, 1.1933, 0.25, bore=0.8 * 1.5 * teeth * jg.mm
    )
    pair = jg.GearPair(gear(45, 0.341), gear(86, 0.481), 1.5 * jg.mm, 25.0 * jg.deg)
    shape = ToothedGear(
        teeth=45,
        module=1.5e-3,
        pressure_angle=math.radians(25.0),
        helix_angle=0.0,
        profile_shift=0.341,
        dedendum=1.1933,
        fillet_radius=0.25,
        tip_radius=float(pair.tip_radius[0]),
        bore=54e-3,
        face_width=9e-3,
    )
    plane = jg.root_influences(pair)[0]
    teeth = condense_teeth(shape, Material(), 2, sizing=SIZE)
    lines = contact_lines(pair, jg.mesh_grid(pair, phases=8, slices=8))
    return pair, lines, plane, gear_roots(shape, teeth, plane)


def _on_one_line(made, line: int):
    """Largest tension and compression by an even load on one line, by plane strain and elements."""
    pair, lines, *influences = made
    load = jnp.zeros(lines.roll.shape).at[:, line].set(1e5)
    stress = [np.asarray(each.along_fillets(pair, lines, load, 0)) for each in influences]
    return [(x[..., 0, :].max(axis=-1), x[..., 1, :].min(axis=-1)) for x in stress]


@pytest.mark.slow
def test_points_are_those_of_the_same_fillet(made):
    _, _, plane, elements = made
    assert_close(elements.point, plane.point, rtol=1e-9, atol=1e-9)
    assert_close(elements.flank, plane.flank, rtol=1e-9, atol=1e-9)
    assert float(elements.height[0]) < 0.0 < float(elements.height[-1])


@pytest.mark.slow
def test_mean_over_the_face_is_that_of_plane_strain_and_faces_carry_less(made):
    """Free faces give a quarter away, which the middle of a narrow gear carries beside its own."""
    line = 1
    (tension, compression), (own, other) = (
        [x[:, line] for x in each] for each in _on_one_line(made, line)
    )
    fully = np.asarray(made[1].fraction[:, line]).min(axis=1) == 1.0
    assert fully.any()
    assert_close(own.mean(axis=1)[fully], tension.mean(axis=1)[fully], rtol=0.08, atol=0.0)
    assert_close(other.mean(axis=1)[fully], compression.mean(axis=1)[fully], rtol=0.09, atol=0.0)
    highest = own[fully][np.argmax(own[fully, 4])]
    assert highest[0] < 0.92 * highest[4]


@pytest.mark.slow
def test_neighbours_feel_it_from_both_sides(made):
    """A tooth ahead of the load, by elements, and one behind it, by plane strain."""
    plane, elements = _on_one_line(made, 1)
    for line in (0, 2):
        least = [np.abs(each[1][:, line, 4]).max() for each in (plane, elements)]
        assert 0.0 < least[0] < np.inf
        assert least[1] == pytest.approx(least[0], rel=0.25)
