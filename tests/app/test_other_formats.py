"""Scenes for other programs: maps of the mesh for Modelica, flanks as grids."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close
from scipy.interpolate import RegularGridInterpolator

from jaxgear._cli._main import main
from jaxgear._response._transmission import transmission_error
from jaxgear._solve._cycle import mesh_cycle
from jaxgear.scene._build import grid_of, model_of
from jaxgear.scene._build_pair import flanks_of, pair_of
from jaxgear.scene._scene import example_scene, read_scene
from jaxgear.study._mesh_map import mesh_map, modelica_table

_COARSE = ["mesh.slices=3", "mesh.phases=8", "mesh.stiffness=iso6336"]
_FLANK = "flank.pinion.tip_relief.depth_um=12"


@pytest.fixture(scope="module")
def mapped():
    scene = example_scene("accessory", [*_COARSE, _FLANK])
    return scene, mesh_map(scene)


@pytest.mark.slow
def test_map_gives_the_cycle_back(mapped):
    """At a load between those that were solved, at the approach of its cycle, its force."""
    scene, found = mapped
    model = eqx.tree_at(lambda it: it.torque, model_of(scene), jnp.asarray(61.7))
    cycle = mesh_cycle(model, grid_of(scene, model))
    approach = np.asarray(transmission_error(model.pair, cycle))
    read = RegularGridInterpolator((found.phase, found.approach), found.force)
    force = read(np.stack([found.phase[:-1], approach], axis=1))
    assert_close(force, np.full(8, 61.7 / found.base_radius[0]), rtol=2e-3, atol=0.0)


@pytest.mark.slow
def test_map_is_a_spring_without_tension(mapped):
    """It grows with the approach, is nothing where the flanks part, and repeats itself."""
    _, found = mapped
    assert (np.diff(found.force, axis=1) >= 0.0).all()
    assert (found.force >= 0.0).all()
    assert (found.force[:, 0] <= 1e-9).all()
    np.testing.assert_array_equal(found.force[0], found.force[-1])
    assert found.phase[-1] == found.phase[0] + 1.0


def test_table_is_as_modelica_reads_it():
    """By the text format of Modelica.Blocks.Tables: `#1`, then type, name, size, and rows."""
    text = modelica_table(
        "f", np.array([0.0, 0.5]), np.array([1.0, 2.0]), np.array([[3, 4], [5, 6]])
    )
    first, second, *rows = text.splitlines()
    assert (first, second) == ("#1", "double f(3,3)")
    values = [[float(cell) for cell in row.split()] for row in rows]
    assert values == [[0, 1, 2], [0, 3, 4], [0.5, 5, 6]]


@pytest.mark.slow
def test_flanks_come_back_as_measured_ones(tmp_path, capsys):
    """What is written reads as `topography_csv`, and deviates as the flank did."""
    scene = example_scene(
        "accessory", ["flank.wheel.crowning_um=7", "flank.wheel.helix_slope_um=-4"]
    )
    path = tmp_path / "own.toml"
    path.write_text(scene.path.read_text(encoding="utf-8"), encoding="utf-8")
    flank = ["--set", "flank.wheel.crowning_um=7", "--set", "flank.wheel.helix_slope_um=-4"]
    assert main(["export", str(path), "--form", "topography", *flank]) == 0
    files = capsys.readouterr().out.split()
    assert [f.removeprefix(f"{tmp_path}/") for f in files] == [
        f"{scene.name}.{gear}_{kind}.csv"
        for gear in ("pinion", "wheel")
        for kind in ("flank", "flank_grid")
    ]
    given = f"flank.wheel.topography_csv='{files[2]}'"
    back = read_scene(path, [given])
    pair = pair_of(scene)
    places = jnp.linspace(0.0, 1.0, 41), jnp.linspace(-1.0, 1.0, 25)
    grid = jnp.meshgrid(*places, indexing="ij")
    before, after = (flanks_of(each, pair).wheel(*grid) for each in (scene, back))
    plain = scene.replace({"flank.wheel.crowning_um": 0.0})
    assert_close(after, before, rtol=0.0, atol=1e-13)
    assert float(jnp.max(jnp.abs(flanks_of(plain, pair).wheel(*grid) - after))) > 6e-6
    matrix = np.loadtxt(files[3], delimiter=",", skiprows=1)
    assert matrix.shape == (41, 27)
    assert_close(jnp.asarray(matrix[:, 2:]), before / 1e-6, rtol=0.0, atol=1e-8)
    radius, base = 0.5 * matrix[:, 1], float(pair.base_radius[1]) / 1e-3
    assert_close(matrix[:, 0], np.sqrt(radius**2 - base**2), rtol=1e-8, atol=0.0)
