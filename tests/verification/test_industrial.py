"""The example scene of the thesis's industrial pair."""

import math
import re
from importlib.resources import files

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxgear as jg
from fem_prep._modes import largest_rotation, lowest_modes, scale_of
from fem_prep._symmetry import waves_of
from jaxgear import bearing_motion, example_scene, face_load, grid_of, mesh_cycle, model_of
from jaxgear.scene._bodies import body_plan
from jaxgear.scene._body_build import Steps, full_of
from jaxgear.scene._mesh_bodies import with_bodies

mm, deg = 1e-3, math.pi / 180.0
_TORQUE = 100.0
_HELIX, _ANGLE, _RADIUS = 12.0 * deg, 25.0 * deg, 0.5 * 27 * 2.5 * mm / math.cos(12.0 * deg)


def test_the_scene_is_what_its_lines_say():
    scene = example_scene("industrial")
    assert scene.condensed == ("wheel",)
    assert scene.value("pinion.body.kind") == "beam"
    pair = model_of(scene.replace({"wheel.body.kind": "rigid"})).pair
    assert list(map(float, pair.teeth)) == [28.0, 127.0]
    across = 1.5 * mm / math.cos(_HELIX)
    assert float(pair.working_centre_distance) == pytest.approx(0.5 * 155 * across, rel=1e-12)
    roots = [0.5 * z * across - 1.25 * 1.5 * mm for z in (28, 127)]
    np.testing.assert_allclose(np.asarray(pair.root_radius), roots, rtol=1e-12)


def _wrench(torque):
    """Force [N] and moment [N m] on the next stage's pinion, of which the wheel drives +S."""
    turning = torque * 127 / 28 / _RADIUS
    separating = turning * math.tan(_ANGLE) / math.cos(_HELIX)
    thrust = turning * math.tan(_HELIX)
    return np.array([-separating, turning, thrust]), np.array([0.0, -thrust * _RADIUS, 0.0])


def test_the_next_stage_has_a_wrench_by_hand():
    (load,) = example_scene("industrial").wheel.shaft.loads
    force, moment = _wrench(_TORQUE)
    np.testing.assert_allclose(load.force_N, force, atol=0.6)
    np.testing.assert_allclose(load.moment_Nm, moment, atol=0.05)


@pytest.mark.slow
def test_waves_have_the_frequencies_of_the_measured_speeds():
    """Of the free wheel: +8, -9, -10 the lowest of theirs, +7 the next one (Tab. III-12)."""
    measured = {8: (0, 119 * 8650), 9: (0, 136 * 8930), 10: (0, 137 * 10190), 7: (1, 120 * 8354)}
    full = full_of(body_plan(example_scene("industrial"), "wheel"), Steps(lambda step: None))
    waves = waves_of(largest_rotation(full))
    stiffness, mass = (list(waves.matrices(x)) for x in (full.stiffness, full.mass))
    for n, (place, per_minute) in measured.items():
        square, _ = lowest_modes(stiffness[n], mass[n], 2, scale_of(full))
        hertz = math.sqrt(square[place]) / (2.0 * math.pi)
        assert hertz == pytest.approx(per_minute / 60.0, rel=0.03), n


@pytest.mark.slow
def test_bearings_carry_what_both_meshes_do():
    """The wheel's shaft on two radial bearings and one of thrust is statically determinate."""
    less = "wheel.body.interface=guyan", "wheel.body.modes=0"
    scene = with_bodies(example_scene("industrial", [*less, "mesh.slices=8", "mesh.phases=16"]))
    model = model_of(scene)
    grid = grid_of(scene, model)
    solve = jax.jit(lambda model: mesh_cycle(model, grid, law=jg.ExactContact(), throw=False))
    cycle = solve(model)
    assert bool(jnp.all(cycle.converged))
    mean = (cycle.cells.lines.weight @ cycle.load)[None, :]
    loads = bearing_motion(cycle.system.structure, cycle.system.displacement(mean)[0]).load
    one, two, thrust = np.asarray(loads)[3:, :3]
    turning = _TORQUE / (14 * 1.5 * mm / math.cos(_HELIX))
    mesh = turning * np.array(
        [math.tan(_ANGLE) / math.cos(_HELIX), 1.0, -math.tan(_HELIX)],
    )
    force, moment = _wrench(_TORQUE)
    np.testing.assert_allclose(one + two + thrust, mesh + force, atol=0.002 * force[1])
    # About the first bearing: the load's own centre across the face, and what thrust tilts, that of
    # the mesh 63.5 modules from the axis at -S.
    face = np.asarray(face_load(model.pair, cycle))
    centre = float(np.asarray(cycle.cells.lines.face_position) @ face / face.sum())
    tilt = moment[1] + 63.5 * 1.5 * mm / math.cos(_HELIX) * mesh[2]
    by_hand = (mesh * (40.0 * mm + centre) + force * 95.0 * mm + [tilt, 0.0, 0.0]) / (130.0 * mm)
    np.testing.assert_allclose(two[:2], by_hand[:2], atol=0.005 * force[1])

    # At 8820 rpm the rim grows most on the side away from the web, which is overloaded.
    quick = model_of(scene.replace({"mesh.pinion_speed_rad_s": 8820.0 * math.pi / 30.0 * 127 / 28}))
    face = np.asarray(face_load(quick.pair, solve(quick)))
    assert face[-1] > 1.5 * face.mean()
    assert face[0] < face.mean()


@pytest.mark.slow
def test_the_holes_of_the_comments_overload_one_end_at_speed():
    """As Fig. III-32 and III-33 have it: one side is overloaded, the other almost free."""
    text = (files("jaxgear.scene") / "scenes" / "industrial.toml").read_text("utf-8")
    holes = re.findall(r"^# (hole\w*) = ([\d.]+)$", text, re.MULTILINE)
    assert len(holes) == 3
    given = [f"wheel.body.web.{key}={value}" for key, value in holes]
    given += ["wheel.body.fineness={sectors=96, rim_across=2}", "mesh.periods=127"]
    less = ["wheel.body.interface=guyan", "wheel.body.modes=0", "mesh.face_coupling=none"]
    less += ["mesh.slices=8", "mesh.phases=8", "mesh.pinion_speed_rad_s=4189.3"]
    scene = with_bodies(example_scene("industrial", [*given, *less]))
    model = model_of(scene)
    (body,) = scene.bodies.values()
    assert body.flexible.repeats == 127
    grid = grid_of(scene, model)
    cycle = mesh_cycle(model, grid, law=jg.ExactContact(), throw=False)
    assert bool(jnp.all(cycle.converged))
    face = np.asarray(face_load(model.pair, cycle))
    assert face[-1] > 1.8 * face.mean()
    assert face[0] < 0.25 * face.mean()
