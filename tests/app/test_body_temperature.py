"""Temperatures of condensed bodies in a scene: growth, stresses, derivatives, refusals."""

import jax
import numpy as np
import pytest
from tiny_cases import tiny_scene

import jaxgear as jg
from jaxgear._checks import InputError
from jaxgear._units import MPa, um
from jaxgear.scene._build import grid_of, model_of, smooth_law_of
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.scene._mistakes import SceneError
from jaxgear.scene._scene import read_scene
from jaxgear.study._body_answers import body_answers, body_under_teeth
from jaxgear.study._built import built_scene
from jaxgear.study._gauges import gauges_dataset, gauges_summary
from jaxgear.study._notes import _on_bodies
from jaxgear.study._statics import solve_statics
from jaxgear.study._stress_maps import _stresses, stress_maps

_SCENE = (
    tiny_scene(modes=2, gear_at=20.0)
    + """[mesh]
stiffness = "constant"
stiffness_N_mm_um = 14.0
slices = 2
phases = 8
pinion_speed_rad_s = 1500.0
root_correction = false
"""
)
_KELVIN = 60.0
_WARM = f"""[wheel.body.temperature]
hub_K = {_KELVIN}
rim_K = {_KELVIN}
[[gauges]]
gear = "wheel"
radius_mm = 22.0
angle_deg = 7.0
height_mm = 1.5
"""
_HUB, _RIM = (f"wheel.body.temperature.{part}_K" for part in ("hub", "rim"))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("warm")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXGEAR_CACHE", str(folder / "cache"))
        path = folder / "tiny.toml"
        path.write_text(_SCENE + _WARM)
        yield path


def _solved(path, **kelvin):
    sets = [f"wheel.body.temperature.{part}_K={value}" for part, value in kelvin.items()]
    built = built_scene(read_scene(path, sets))
    return built.scene, solve_statics(built)


@pytest.mark.slow
def test_a_body_as_warm_everywhere_grows_in_proportion_and_has_no_stress_of_it(path):
    scene, statics = _solved(path)
    (answer,) = body_answers(scene.mesh, scene.bodies, statics)
    strain = 1.15e-5 * _KELVIN
    radius = np.median(np.hypot(*answer.built.body.rim_nodes[:, :2].T))
    for name in ("heat_growth_mean_radial_um", "heat_growth_radial_um"):
        assert answer.numbers[name] == pytest.approx(strain * radius / um, rel=1e-8)
    field = next(case for case in answer.fields if case.what == "heat").field
    nodes = answer.built.body.nodes
    assert np.abs(field[:, :2] - strain * nodes[:, :2]).max() < 1e-8 * strain * radius
    cold, still = _solved(path, hub=0.0, rim=0.0)
    built = scene.bodies["wheel"].built
    held = built.held()
    one, other = (
        _stresses(held, each, each.at_rest[None], np.zeros((1, each.body.dofs)))
        for each in (
            body_under_teeth(scene.mesh, "wheel", scene.bodies["wheel"], statics),
            body_under_teeth(cold.mesh, "wheel", cold.bodies["wheel"], still),
        )
    )
    # Beside that of rotation.
    assert np.abs(one - other).max() < 1e-6 * built.plan.material.young * strain
    assert np.abs(other).max() > 1e6


@pytest.mark.slow
def test_gauges_and_maps_say_the_same_of_a_hotter_hub(path):
    scene, statics = _solved(path, hub=120.0, rim=20.0)
    found = stress_maps(scene.mesh, scene.bodies, statics)["wheel"]
    dataset = gauges_dataset(scene.mesh, scene.gauges, scene.bodies, statics)
    (gauge,) = gauges_summary(dataset)
    place = np.array([gauge[f"{name}"] for name in ("radius_mm", "angle_deg", "height_mm")])
    nodes = found.built.body.nodes
    angle = np.radians(place[1])
    at = 1e-3 * np.array([place[0] * np.cos(angle), place[0] * np.sin(angle), place[2]])
    node = int(np.argmin(np.linalg.norm(nodes - at, axis=1)))
    c, s = np.cos(angle), np.sin(angle)
    x, y, _, xy, _, _ = found.stress[node]
    radial = (c * c * x + s * s * y + 2 * c * s * xy) / MPa
    # The map is of one time of the cycle: the gauge was as near to the mesh then as it ever is.
    turned = dataset["wheel_gauge_stress_MPa"].values[0]
    assert np.abs(turned - radial).min() < 1e-6 * np.abs(turned).max()
    cold = gauges_summary(gauges_dataset(*_of_gauges(*_solved(path, hub=0.0, rim=0.0))))[0]
    assert abs(gauge["strain_mean_um_m"] - cold["strain_mean_um_m"]) > 50.0


def _of_gauges(scene, statics):
    return scene.mesh, scene.gauges, scene.bodies, statics


@pytest.mark.slow
def test_responses_have_derivatives_by_temperatures(path):
    scene = with_bodies(read_scene(path, ["mesh.pinion_speed_rad_s=0"]))
    model = model_of(scene)
    grid, law = grid_of(scene, model), smooth_law_of(scene.mesh)
    expansion = "wheel.body.temperature.expansion_1_K"

    @jax.jit
    def fluctuation(hub, rim, more):
        changes = {_HUB: hub, _RIM: rim, expansion: 1.15e-5 * more}
        own = model_of(scene, changes)
        cycle = jg.mesh_cycle(own, grid, law=law)
        return 1e6 * jg.cycle_rms(cycle, jg.transmission_error(own.pair, cycle))

    at = (80.0, 30.0, 1.0)
    slopes = jax.jit(jax.grad(fluctuation, argnums=(0, 1, 2)))(*at)
    for place, (slope, step) in enumerate(zip(slopes, (0.05, 0.05, 1e-3), strict=True)):
        ahead, behind = ([*at] for _ in range(2))
        ahead[place] += step
        behind[place] -= step
        wanted = (fluctuation(*ahead) - fluctuation(*behind)) / (2 * step)
        assert slope == pytest.approx(float(wanted), rel=1e-5)
    assert abs(slopes[1]) > 1e-5
    assert {_HUB, _RIM} <= set(scene.real_keys())
    assert scene.replace({_HUB: 10.0}).bodies
    assert not scene.replace({"wheel.body.temperature.hub_diameter_mm": 29.0}).bodies


def test_temperatures_that_cannot_be_are_refused(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(_SCENE + "[wheel.body.temperature]\nhub_K = 1e4\n")
    with pytest.raises(SceneError) as caught:
        read_scene(path)
    said = str(caught.value)
    assert "wheel.body.temperature.hub_K" in said
    assert "wheel.body.temperature.rim_K: is missing" in said
    matrices = 'superelement = "a.npz"\nsuperelement_units = "m-kg-s"'
    web = _SCENE[_SCENE.index("web = {") : _SCENE.index("modes = 2")]
    path.write_text(_SCENE.replace(web, f"{matrices}\n") + _WARM)
    with pytest.raises(SceneError, match="temperature: excludes wheel"):
        read_scene(path)


def test_a_rigid_body_is_said_not_to_warm(tmp_path):
    path = tmp_path / "tiny.toml"
    head, _, tail = _SCENE.partition("[wheel.body]")
    rigid = "[wheel.shaft]" + tail.partition("[wheel.shaft]")[2]
    path.write_text(head + rigid + _WARM.partition("[[")[0])
    scene = read_scene(path)
    said = list(_on_bodies(scene.gears))
    assert said == ['wheel.body.temperature does nothing: wheel.body.kind is "rigid".']
    assert _HUB not in scene.real_keys()


@pytest.mark.slow
def test_a_body_put_in_mesh_cold_says_what_to_do(path):
    cold = path.with_name("cold.toml")
    cold.write_text(_SCENE)
    scene = with_bodies(read_scene(cold))
    with pytest.raises(InputError, match="put in mesh without temperatures"):
        model_of(scene, {_HUB: 10.0, _RIM: 5.0})
    far = read_scene(path, ["wheel.body.temperature.hub_diameter_mm=7"])
    with pytest.raises(InputError, match="must reach beyond the smallest radius"):
        with_bodies(far)
