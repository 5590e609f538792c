"""The unbalance of a scene's shafts: read, made nodes of, and answered over speed."""

import json
import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from helpers import assert_close, assert_gradient
from table_checks import assert_tables
from tiny_cases import tiny_scene

import jaxgear as jg
from jaxgear import plot
from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear.scene._build import grid_of, model_of
from jaxgear.scene._scene import read_scene
from jaxgear.scene._unbalance import unbalances_of
from jaxgear.study._built import built_scene
from jaxgear.study._design import design_space
from jaxgear.study._dynamics import dynamics_of
from jaxgear.study._notes import notes
from jaxgear.study._result import titled
from jaxgear.study._scatter import scatter_of
from jaxgear.study._statics import solve_statics
from jaxgear.study._unbalance import shaken

MASS, RADIAL, LENGTH, OUTER = 20.0, 1e6, 100.0, 30.0
# Two rotors on shafts, with a mesh ten thousand times as soft as their bearings between them.
_ROTORS = f"""schema = 1
name = "rotors"
[material]
density_kg_m3 = 100.0
[pair]
module_mm = 2.0
torque_pinion_Nm = 1e-3
[mesh]
stiffness = "constant"
stiffness_N_mm_um = 1e-5
slices = 1
[damping]
mesh = 0.0
structure = 1e-6
[sweep]
pinion_speed_rad_s = [150.0, 250.0, 400.0]
steps = 8
[pinion]
teeth = 20
face_width_mm = 12.0
body = {{ mass_kg = {MASS} }}
[wheel]
teeth = 30
face_width_mm = 12.0
body = {{ mass_kg = {MASS} }}
""" + "".join(
    f"""[{gear}.shaft]
gear_at_mm = {0.5 * LENGTH}
segments = [ {{ length_mm = {LENGTH}, outer_mm = {OUTER} }} ]
bearings = [ {{ at_mm = 0.0, radial_N_m = {RADIAL}, axial_N_m = 1e7 }},
             {{ at_mm = {LENGTH}, radial_N_m = {RADIAL} }} ]
"""
    for gear in ("pinion", "wheel")
)


def _grid(scene):
    return grid_of(scene, model_of(scene), scene.sweep.steps)


def _moved(scene, changes=None, grid=None):
    """Dynamics and unbalances of a scene whose keys are moved."""
    grid = grid or _grid(scene)
    scene = scene.replace(changes or {})
    model = model_of(scene)
    pair = dynamics_of(model, grid, scene)
    return pair, unbalances_of(scene, model)


def _row(gear, at, moment, angle=0.0):
    return f"[[{gear}.shaft.unbalance]]\nat_mm = {at}\nmoment_gmm = {moment}\nangle_deg = {angle}\n"


@pytest.fixture(scope="module")
def scene_of(tmp_path_factory):
    def write(text):
        path = tmp_path_factory.mktemp("unbalance") / "scene.toml"
        path.write_text(text)
        return read_scene(path)

    return write


@pytest.fixture(scope="module")
def rotors(scene_of):
    text = _ROTORS + _row("pinion", 50.0, 3.0) + _row("pinion", 50.0, 4.0, 90.0)
    scene = scene_of(text + _row("wheel", 50.0, 6.0))
    pair, _ = _moved(scene)
    return shaken(built_scene(scene), pair)


@pytest.mark.slow
def test_a_scene_whirls_as_jeffcott_says(rotors):
    """A disc amid a shaft: bearings carry half of u w^2 / (1 - w^2 m/k), 1/k = 1/2k_b + 1/k_s.

    The shaft is Timoshenko's, k_s of 48 EI/l^3 and 4 kGA/l in series. Two masses at a right angle
    add up as vectors. The wheel turns at two thirds of the pinion's speed.
    """
    found = rotors
    young, poisson, length, outer = 206e9, 0.3, LENGTH * 1e-3, OUTER * 1e-3
    area, inertia = np.pi * outer**2 / 4.0, np.pi * outer**4 / 64.0
    shear = 6.0 * (1.0 + poisson) / (7.0 + 6.0 * poisson) * young / (2.0 * (1.0 + poisson)) * area
    shaft = 1.0 / (length**3 / (48.0 * young * inertia) + length / (4.0 * shear))
    stiffness = 1.0 / (1.0 / (2.0 * RADIAL) + 1.0 / shaft)
    critical = np.sqrt(stiffness / MASS)
    data = found.dataset
    for gear, ratio, moment in (("pinion", 1.0, 5e-6), ("wheel", 2.0 / 3.0, 6e-6)):
        own = data.sel(gear=gear, speed=[150.0, 250.0, 400.0])
        turned = ratio * own["speed"].values
        wanted = 0.5 * moment * turned**2 / np.abs(1.0 - (turned / critical) ** 2)
        for index in (0, 1):
            force = own["unbalance_bearing_force_N"].sel(bearing=f"{gear} {index}").values
            np.testing.assert_allclose(force, wanted, rtol=2e-3)
        at = found.summary[gear]["critical_speeds_rad_s"]
        assert at[0] * ratio == pytest.approx(critical, rel=1e-3)
        # It is not stepped over, and the largest of all.
        if at[0] < 400.0:
            row = found.summary[gear]["bearings"][0]
            assert row["at_rad_s"] == pytest.approx(at[0], rel=1e-3)
    assert data["unbalance_frequency_Hz"].sel(gear="wheel", speed=150.0) == pytest.approx(
        100.0 / (2.0 * np.pi)
    )
    # With next to no damping teeth part at the critical speed, and that is said.
    (note,) = found.notes
    assert "teeth part" in note


@pytest.mark.slow
def test_its_picture_has_bearings_critical_speeds_and_units(rotors):
    (picture,) = plot.pictures({"unbalance": titled(rotors.dataset, "rotors")})
    figure = picture.draw()
    force, mesh = figure.axes
    assert force.get_ylabel() == "largest bearing force [N]"
    assert mesh.get_xlabel() == "pinion speed [rad/s]"
    lines = (np.asarray(line.get_xdata(), dtype=float) for line in force.lines)
    upright = {x[0] for x in lines if x.size == 2}
    critical = rotors.dataset["critical_speed_rad_s"].values
    assert upright == {x for x in critical if 150.0 <= x <= 400.0}
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[0] == "bearing pinion 0"
    assert words[-1] == "static mesh force"
    assert len(words) == 4 + 2 + 1
    assert set(picture.beside) == {"bearings", "critical"}


def _stage(kind: str) -> str:
    """A pair on shafts whose wheel's body is of a kind."""
    text = tiny_scene(30, 20.0).replace(
        "[pinion]",
        '[mesh]\nslices = 4\nface_coupling = "none"\n[sweep]\npinion_speed_rad_s = [1.0]\n'
        "steps = 16\n[pinion]",
    )
    if kind != "condensed":
        start = text.index("[wheel.body]")
        text = f'{text[:start]}[wheel.body]\nkind = "{kind}"\n{text[text.index("[wheel.shaft]") :]}'
    return f"""{text}[pinion.shaft]
gear_at_mm = 20.0
segments = [ {{ length_mm = 40, outer_mm = 20 }} ]
bearings = [ {{ at_mm = 0, radial_N_m = 1e8, axial_N_m = 5e7 }},
             {{ at_mm = 40, radial_N_m = 1e8 }} ]
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "beam", "condensed"])
@pytest.mark.parametrize("at", [0.0, 14.0, 33.0])
def test_bearings_of_all_bodies_carry_a_slow_unbalance(scene_of, kind, at):
    """Slowly turned, force and moment of it are those that both shafts put on their bearings.

    At a bearing, close to the gear and beside it: with a node of its own or as a neighbour's guest.
    """
    scene = built_scene(scene_of(_stage(kind) + _row("wheel", at, 100.0)), moving=True).scene
    pair, given = _moved(scene)
    found = jg.unbalance_response(pair, given["wheel"], 1.0)
    push = 1e-4 * float(found.frequency) ** 2 * np.asarray([1.0, 1j])
    load = np.asarray(found.bearing_load)
    assert_close(load[:, :2].sum(axis=0), push, rtol=1e-3, atol=0.0)
    # Both shafts start at one height: gears are amid them.
    heights = np.asarray([0.0, 0.04, 0.0, 0.04])
    moment = heights @ load[:, :2] + load[:, [4, 3]].sum(axis=0) * [1.0, -1.0]
    assert_close(moment, at * 1e-3 * push, rtol=1e-3, atol=1e-6 * abs(push[0]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "beam", "condensed"])
def test_at_a_critical_speed_a_turning_mode_has_the_frequency_of_the_shaft(scene_of, kind):
    """As the modes over speed have it, which are found otherwise, gyroscopic terms in them."""
    text = _stage(kind).replace("modes = 30", "modes = 30\nrotating_terms = true")
    scene = scene_of(text + "[model]\ngyroscopic = true\n" + _row("wheel", 33.0, 100.0))
    pair, given = _moved(built_scene(scene, moving=True).scene)
    system = pair.system
    speeds = jnp.asarray(jg.unbalance_critical_speeds(pair, given["wheel"])[:1])
    softening = None if system.turning is None else system.turning.softening
    assert system.gyroscopic is not None
    natural = jg.rotating_frequencies(
        system.mass, system.whole_stiffness, system.gyroscopic, system.free, speeds, softening
    )
    wanted = float(speeds[0]) * 20.0 / 24.0 / (2.0 * np.pi)
    assert np.nanmin(np.abs(natural / wanted - 1.0)) < 1e-6
    # Not a mode at rest that happens to be there.
    at_rest = np.asarray(jg.pair_modes(pair).frequency)
    assert np.min(np.abs(at_rest / wanted - 1.0)) > 1e-5


@pytest.mark.slow
def test_bearing_amplitudes_have_derivatives_by_keys_of_the_scene(scene_of):
    """By moments, angle, stiffness and places: of an unbalance with a node, and of a guest."""
    rows = _row("wheel", 30.0, 50.0, 20.0) + _row("wheel", 20.0, 30.0)
    scene = scene_of(_stage("rigid") + rows)
    table = "wheel.shaft"
    keys = (
        *(f"{table}.unbalance[{i}].{name}" for i in (0, 1) for name in ("at_mm", "moment_gmm")),
        f"{table}.unbalance[0].angle_deg",
        f"{table}.bearings[0].radial_N_m",
        f"{table}.bearings[1].at_mm",
    )
    sizes, grid = [float(scene.value(key)) for key in keys], _grid(scene)

    @jax.jit
    def amplitude(shares):
        changes = {key: x * size for key, x, size in zip(keys, shares, sizes, strict=True)}
        pair, given = _moved(scene, changes, grid)
        found = jg.unbalance_response(pair, given["wheel"], 2000.0)
        return jnp.abs(found.bearing_load[2, 0]) + jnp.abs(found.bearing_load[3, 1])

    each = jax.grad(amplitude)(jnp.ones(len(keys)))
    for i, slope in enumerate(each):
        at = lambda step, i=i: float(amplitude(jnp.ones(len(keys)).at[i].add(step)))
        difference = (at(1e-4) - at(-1e-4)) / 2e-4
        assert float(slope) == pytest.approx(difference, rel=1e-5), keys[i]
        assert abs(difference) > 1e-3 * float(amplitude(jnp.ones(len(keys)))), keys[i]
    assert_gradient(amplitude, jnp.ones(len(keys)), rtol=1e-6)


@pytest.mark.slow
def test_a_sweep_writes_what_unbalance_does(scene_of, tmp_path):
    scene = scene_of(_stage("rigid") + _row("wheel", 30.0, 50.0))
    asked = ("--set", "sweep.pinion_speed_rad_s=[500.0, 900.0]")
    asked += ("--set", "sweep.harmonics=5", "--quiet")
    assert main(["sweep", str(scene.path), "--out", str(tmp_path), *asked]) == 0
    (out,) = tmp_path.glob("*/")
    assert {"unbalance.csv", "unbalance_bearings.csv"} < set(assert_tables(out))
    assert (out / "unbalance.png").stat().st_size > 0
    found = json.loads((out / "summary.json").read_text())["sweep"]["unbalance"]
    # Below all critical speeds the largest is at the top.
    assert [row["at_rad_s"] for row in found["wheel"]["bearings"]] == [900.0] * 4
    assert found["wheel"]["critical_speeds_rad_s"][0] > 900.0
    with xr.open_dataset(out / "result.nc", group="unbalance") as dataset:
        assert dataset["unbalance_bearing_load_N"].attrs["units"] == "N"
        assert dict(dataset.sizes)["gear"] == 1


@pytest.mark.slow
def test_a_mirrored_pair_has_the_same_unbalance(scene_of):
    """A negative torque mirrors the pair in its axes; angles are about each shaft's own sense."""
    text = _stage("rigid") + _row("pinion", 33.0, 100.0, 30.0) + _row("pinion", 5.0, 50.0, -60.0)
    drive, coast = scene_of(text), scene_of(text.replace("Nm = 100.0", "Nm = -100.0"))
    loads = []
    for scene in (drive, coast):
        pair, given = _moved(scene)
        loads.append(jg.unbalance_response(pair, given["pinion"], 3000.0).bearing_load[:, 0])
    assert_close(loads[0], loads[1], rtol=1e-6, atol=1e-9)


def test_searches_refuse_what_only_a_sweep_feels(scene_of):
    key = "pinion.shaft.unbalance[0].moment_gmm"
    relief = "flank.pinion.tip_relief.depth_um"
    search = f'[optimise]\nvary = ["{relief}"]\n[robust.scatter]\n"{key}" = 1.0\n'
    built = built_scene(scene_of(_ROTORS + _row("pinion", 50.0, 3.0) + search))
    options: dict[str, Any] = {"symmetric": False, "deflection": 10.0}
    with pytest.raises(InputError, match=rf"{re.escape(key)}.* unbalance to `jaxgear sweep`"):
        design_space(built, (key,), **options)
    space = design_space(built, (relief,), **options)
    with pytest.raises(InputError, match=rf"{re.escape(key)} scatter.* to `jaxgear sweep`"):
        scatter_of(space, space.base.pair, np.arange(-1, 20))


def test_a_scene_without_unbalance_asks_for_none(scene_of):
    scene = scene_of(_ROTORS)
    assert unbalances_of(scene, model_of(scene)) == {}
    assert not any(gear.shaft.unbalance for gear in scene.gears.values())


@pytest.mark.slow
def test_unbalance_of_a_scene_that_is_not_swept_is_told_to_do_nothing(scene_of):
    text = _ROTORS.replace("um = 1e-5", "um = 10.0") + _row("wheel", 50.0, 6.0)
    still = text[: text.index("[sweep]")] + text[text.index("[pinion]") :]
    told = []
    for each in (still, text):
        built = built_scene(scene_of(each))
        told.append([words for words in notes(built, solve_statics(built)) if "unbal" in words])
    ((words,), swept) = told
    assert words.startswith("wheel.shaft.unbalance does nothing here")
    assert "[sweep]" in words
    assert not swept
