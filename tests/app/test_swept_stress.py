"""Stresses of condensed bodies in a sweep: gauges over speed, and maps at the highest peak."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from table_checks import assert_table
from tiny_cases import tiny_scene

from jaxgear import plot
from jaxgear._response._gauges import moving_gauge_readings
from jaxgear._response._whole_motion import beyond_in_steps
from jaxgear._units import MPa
from jaxgear._whole_file import write_csv
from jaxgear.scene._scene import read_scene
from jaxgear.study._built import built_scene
from jaxgear.study._dynamics import solve_dynamics
from jaxgear.study._gauges import gauges_dataset
from jaxgear.study._stress_maps import moving_stress_maps
from jaxgear.study._sweep import sweep_result
from jaxgear.study._swept_stress import stress_watch

_SCENE = (
    tiny_scene(modes=2, gear_at=20.0)
    + """[wheel.body.temperature]
hub_K = 90.0
rim_K = 30.0
[mesh]
body_stress = true
stiffness = "constant"
stiffness_N_mm_um = 14.0
slices = 2
phases = 24
pinion_speed_rad_s = 3.0
root_correction = false
[[gauges]]
gear = "wheel"
radius_mm = 22.0
angle_deg = 7.0
height_mm = 1.5
[[gauges]]
gear = "wheel"
name = "standing"
frame = "fixed"
radius_mm = 22.0
height_mm = 1.5
[model]
coordinates = 16
[sweep]
pinion_speed_rad_s = [3.0, 900.0]
direction = "up"
steps = 24
harmonics = 8
"""
)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A scene in motion, what a sweep says of it, and its responses."""
    folder, points = tmp_path_factory.mktemp("swept"), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXGEAR_CACHE", str(folder / "cache"))
        path = folder / "tiny.toml"
        path.write_text(_SCENE)
        built = built_scene(read_scene(path), moving=True)
        dynamics = solve_dynamics(built)
        result = sweep_result(built, dynamics, lambda ways, point, ratio: points.append(point))
        yield built, dynamics, result, [point.orbit for point in points]


@pytest.mark.slow
def test_gauges_at_a_crawl_read_what_they_read_at_rest(swept):
    built, dynamics, result, _ = swept
    scene = built.scene
    rest = gauges_dataset(scene.mesh, scene.gauges, scene.bodies, dynamics.statics)
    slow = result.datasets["gauges_swept"].sel(speed=3.0, direction="up")
    for number in range(2):
        stress = rest["wheel_gauge_stress_MPa"].values[number]
        size = np.abs(stress).max()
        own = slow.isel(wheel_gauge=number)
        assert abs(float(own["wheel_gauge_stress_mean_MPa"]) - stress.mean()) < 0.01 * size
        # Teeth come into mesh at once, which few harmonics show with a ripple.
        assert float(own["wheel_gauge_stress_amplitude_MPa"]) == pytest.approx(
            0.5 * np.ptp(stress), rel=0.1, abs=0.02 * size
        )
    (first, second) = result.summary["sweep"]["gauges"]
    assert (first["name"], second["name"]) == ("wheel r 22 mm radial rotating", "standing")
    assert first["stress_largest_at_pinion_speed_rad_s"] == 900.0


@pytest.mark.slow
def test_gauges_and_the_map_of_a_response_say_the_same(swept):
    built, dynamics, result, orbits = swept
    orbit = orbits[1]
    found = moving_stress_maps(built, dynamics.pair, orbit)["wheel"]
    watch = stress_watch(built, dynamics.pair)
    own = watch.gauges["wheel"]
    beyond = lambda orbit: jnp.asarray(
        beyond_in_steps(own.whole, dynamics.pair, orbit, built.law, 1)
    )
    read = lambda orbit: moving_gauge_readings(
        own.influences, dynamics.pair, orbit, built.law, own.strain, beyond(orbit)
    )
    readings, turn = read(orbit)
    gauge = own.gauges[0]
    radius, angle, height = gauge.places[0]
    place = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    node = int(np.argmin(np.linalg.norm(found.grid.nodes - place, axis=1)))
    c, s = np.cos(angle), np.sin(angle)
    x, y, _, xy, _, _ = found.stress[node] / MPa
    along = np.asarray(readings)[:, 1] / MPa
    at = int(np.argmin(np.abs(np.exp(1j * np.asarray(turn)) - np.exp(1j * found.turn))))
    assert along[at] == pytest.approx(c * c * x + s * s * y + 2 * c * s * xy, rel=1e-6)
    # Twice the same cycle is the same revolution.
    twice = dataclasses.replace(
        orbit,
        **{name: jnp.tile(getattr(orbit, name), (2, 1)) for name in ("place", "load", "motion")},
    )
    again, _ = read(twice)
    np.testing.assert_allclose(again, readings, rtol=1e-9, atol=1e-9 * np.abs(readings).max())
    longer = moving_stress_maps(built, dynamics.pair, twice)["wheel"]
    size = found.range.principal.max()
    np.testing.assert_allclose(longer.range.principal, found.range.principal, atol=1e-6 * size)
    (told,) = result.summary["sweep"]["body_stress"]
    assert told["pinion_speed_rad_s"] == 900.0
    assert told["largest_principal_MPa"] <= size / MPa


@pytest.mark.slow
def test_pictures_of_stresses_in_motion_are_drawn(swept, tmp_path):
    _, _, result, _ = swept
    named = {"gauges_at_speed", "wheel_stress_moving"}
    drawn = [each for each in plot.pictures(result.datasets) if each.name in named]
    assert {each.name for each in drawn} == named
    for each in drawn:
        each.draw().savefig(tmp_path / f"{each.name}.png", dpi=40)
        write_csv(each.table, tmp_path / f"{each.name}.csv")
        assert len(assert_table(tmp_path / f"{each.name}.csv"))
    result.files["wheel_stress_moving.vtu"](tmp_path / "moving.vtu")
    assert b"alternating stress [Pa]" in (tmp_path / "moving.vtu").read_bytes()
