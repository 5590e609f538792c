"""Unbalance of condensed bodies as their elements have it: those that turn in a pair have none.

A turn by one of three or more equal sectors leaves the place of the mass as it is, which then lies
on the axis, and the axis is a principal one. Other bodies are refused in motion.
"""

import hybrid_cases
import numpy as np
import pytest
from fem_cases import STEEL
from helpers import quick

from fem_prep._answers import mass_properties
from fem_prep._artefact import ReducedBody
from jaxgear._checks import InputError
from jaxgear._system._body_modes import body_basis
from jaxgear.scene._scene import example_scene
from jaxgear.study._built import built_scene


def _off_axis(body: ReducedBody) -> float:
    """Its first moments across the axis, of mass times radius of inertia, and its products of
    inertia with the axis, of the polar one: the largest."""
    whole = body.rigid_motions.T @ (body.mass @ body.rigid_motions)
    mass, polar = whole[0, 0], whole[5, 5]
    return float(np.max(np.abs([*whole[:2, 5] / np.sqrt(mass * polar), *whole[3:5, 5] / polar])))


@pytest.mark.parametrize(("holes", "further"), quick(1, [(6, 6), (3, 0), (0, 0)]))
def test_even_bodies_have_no_unbalance(holes, further):
    body = hybrid_cases.body(holes=holes, further=further)
    assert body.facts["sectors"] == (holes or hybrid_cases.TEETH[1])
    assert _off_axis(body) < 1e-12
    assert mass_properties(None, body, None)["unbalance_g_mm"] < 1e-9


@pytest.mark.slow
def test_one_hole_unbalances_a_body_which_is_refused_in_motion():
    """By what is missing of the web, a sector of a ring 3 mm thick: rho t (R^3 - r^3) 2 sin(a) / 3.

    `condense` tells it as `unbalance_g_mm`.
    """
    body = hybrid_cases.body(holes=1)
    root = float(hybrid_cases.PAIRS["spur"]().root_radius[1])
    cubes = (0.88 * root) ** 3 - (0.42 * root) ** 3
    half = np.pi / hybrid_cases.TEETH[1]
    wanted = 1e6 * STEEL.density * 3e-3 * cubes * 2.0 / 3.0 * np.sin(half)
    found = mass_properties(None, body, None)["unbalance_g_mm"]
    assert found == pytest.approx(wanted, rel=1e-3)
    with pytest.raises(InputError, match="three or more equal sectors, got 1 of"):
        body_basis(body, 4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["accessory-h1", "power-h1", "power-holes"])
def test_wheels_of_the_examples_have_no_unbalance(name):
    (body,) = (each.built.body for each in built_scene(example_scene(name)).scene.bodies.values())
    assert _off_axis(body) < 1e-9
