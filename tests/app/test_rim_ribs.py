"""What teeth all around take from the give of a condensed rim."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from tiny_cases import TINY_PAIR

from fem_prep import Holes
from jaxgear.scene._bodies import BodyPlan, Drawn, body_plan
from jaxgear.scene._build import pair_grid, pair_of
from jaxgear.scene._mesh_teeth import toothed_gear
from jaxgear.scene._rim_ribs import rim_ribs
from jaxgear.scene._scene import Scene, read_scene

_SCENE = f"""{TINY_PAIR}bore_mm = 16.0
"""
_SCENE += """[wheel.body]
kind = "condensed"
web = { hub_outer_mm = 30, web_thickness_mm = 4, rim_inner_mm = 54, web_offset_mm = 2 }
[mesh]
slices = 8
phases = 8
"""


def _ribs(scene: Scene, plan: BodyPlan) -> np.ndarray | None:
    pair, mesh = pair_of(scene), scene.mesh
    how = {"points": mesh.root_points, "axial": mesh.connection}
    grid = pair_grid(mesh, pair, jnp.asarray(100.0), None, condensed=True)
    return rim_ribs(scene.plain, plan, pair, grid, print, **how)


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Scene:
    path = tmp_path_factory.mktemp("ribs") / "tiny.toml"
    path.write_text(_SCENE)
    return read_scene(path)


@pytest.fixture(scope="module")
def found(scene) -> np.ndarray:
    found = _ribs(scene, body_plan(scene, "wheel"))
    assert found is not None
    return found


@pytest.mark.slow
def test_ribs_take_from_what_a_webbed_rim_gives_and_are_reciprocal(found):
    lines, size = found.shape[:2]
    matrix = found.reshape(lines * size, -1)
    largest = np.abs(matrix).max()
    np.testing.assert_allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * largest)
    # An even load along the tangent of a tooth, and one that tilts its rim.
    even = np.zeros((8, 6))
    even[:, 1] = 1.0
    tilting = even * np.linspace(-1.0, 1.0, 8)[:, None]
    for load in (even.ravel(), tilting.ravel()):
        assert load @ found[0, :, 0] @ load < 0.0
    # Spur teeth do not load the rest.
    assert np.abs(found[0, :, 0].reshape(8, 6, 8, 6)[:, 2:5]).max() == 0.0


@pytest.mark.slow
def test_lines_are_told_apart_by_the_turns_between_their_teeth_alone(found):
    np.testing.assert_array_equal(found[0, :, 0], found[1, :, 1])
    np.testing.assert_array_equal(found[0, :, 1], found[1, :, 0].T)


@pytest.mark.slow
def test_holes_change_nothing_and_a_solid_disc_has_none(scene, found):
    plan = body_plan(scene, "wheel")
    assert isinstance(plan.source, Drawn)
    source, body = plan.source, plan.source.body
    assert body.web is not None
    drawn = lambda web: dataclasses.replace(
        plan, source=dataclasses.replace(source, body=dataclasses.replace(body, web=web))
    )
    holes = (Holes(count=4, diameter=8e-3, circle=41e-3),)
    holed = drawn(dataclasses.replace(body.web, holes=holes))
    np.testing.assert_array_equal(_ribs(scene, holed), found)
    assert _ribs(scene, drawn(None)) is None


_SHAFT = """[wheel.shaft]
gear_at_mm = 20
segments = [ { length_mm = 40, outer_mm = 20, inner_mm = 8 } ]
bearings = [ { at_mm = 0, radial_N_m = 1e8, axial_N_m = 5e7 }, { at_mm = 40, radial_N_m = 5e7 } ]
"""


def test_without_a_bore_the_plain_ring_is_held_at_the_shaft(tmp_path):
    path = tmp_path / "shaft.toml"
    path.write_text(_SCENE.replace("bore_mm = 16.0\n", "") + _SHAFT)
    assert toothed_gear(read_scene(path).plain, "wheel").bore == pytest.approx(0.02)


@pytest.mark.slow
def test_the_bore_of_the_plain_ring_matters_little(tmp_path):
    """It tells what the web lets the ribs do from what they do anyway: its bore matters little."""
    found, path = [], tmp_path / "shaft.toml"
    for bore in ("", "bore_mm = 16.0\n"):
        path.write_text(_SCENE.replace("bore_mm = 16.0\n", bore) + _SHAFT)
        held = read_scene(path)
        found.append(_ribs(held, body_plan(held, "wheel")))
    np.testing.assert_allclose(*found, rtol=0.0, atol=0.03 * np.abs(found[0]).max())
