"""Teeth of finite elements in mesh: coupling of cells, load updates, refusals."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxgear as jg
from fem_prep import Material, ToothedGear, ToothSizing, condense_teeth
from jaxgear._contact._half_space import cells_on_half_space
from jaxgear._contact._tooth_elements import ElementTeeth, tooth_tables
from jaxgear._geometry._lines import contact_lines
from jaxgear.scene import model_of, read_scene

_SIZE = ToothSizing(flank=5, across=4, gap=4, ring=4, margin=1, waves=2)
SCENE = """
schema = 1
name = "elements"
[pair]
module_mm = 1.5
pressure_angle_deg = 25.0
torque_pinion_Nm = 20.0
[pinion]
teeth = 45
profile_shift = 0.341
addendum_coeff = 0.9447
dedendum_coeff = 1.1933
fillet_radius_coeff = 0.25
face_width_mm = 4.0
bore_mm = 50.0
[wheel]
teeth = 86
profile_shift = 0.481
addendum_coeff = 0.9447
dedendum_coeff = 1.1933
fillet_radius_coeff = 0.25
face_width_mm = 3.0
bore_mm = 110.0
[mesh]
slices = 6
phases = 8
tooth = "elements"
"""


def _teeth(pair: jg.GearPair, gear: jg.Gear, index: int, helix: float):
    shape = ToothedGear(
        teeth=gear.teeth,
        module=float(pair.normal_module),
        pressure_angle=float(pair.pressure_angle),
        helix_angle=helix,
        profile_shift=float(gear.profile_shift),
        dedendum=float(gear.dedendum),
        fillet_radius=float(gear.fillet_radius),
        tip_radius=float(pair.tip_radius[index]),
        bore=float(np.asarray(gear.bore)),
        face_width=float(gear.face_width),
    )
    found = condense_teeth(shape, Material(), 2, sizing=_SIZE)
    return tooth_tables(found.compliance, found.roll, found.face_width, 206e9)


def _pair(helix_deg: float, updates: int = 0) -> tuple[jg.GearPair, ElementTeeth]:
    gear = lambda teeth, shift, face, bore: jg.Gear(
        teeth, face * jg.mm, shift, 0.9447, 1.1933, 0.25, bore=bore * jg.mm
    )
    pair = jg.GearPair(
        gear(45, 0.341, 4.0, 50.0),
        gear(86, 0.481, 3.0, 110.0),
        1.5 * jg.mm,
        25.0 * jg.deg,
        helix_deg * jg.deg,
    )
    helix = math.radians(helix_deg)
    tables = [
        _teeth(pair, one, index, (helix, -helix)[index])
        for index, one in enumerate((pair.pinion, pair.wheel))
    ]
    return pair, ElementTeeth(tables[0], tables[1], load_updates=updates)


@pytest.fixture(scope="module")
def spur():
    return _pair(0.0)


def test_cells_on_a_half_space_far_apart_are_points():
    """And a long even load lowers the middle of a narrower strip by the logarithm of the widths."""
    steel = jg.Material()
    place = jnp.asarray([-5e-3, 0.0, 5e-3])
    far = jnp.asarray(50e-3)
    found = cells_on_half_space(steel, jnp.asarray(5e-5), jnp.asarray(1e-4), place, (-far, far))
    point = (1.0 - 0.3**2) / (math.pi * 206e9)
    images = sum(1.0 / (100e-3 - 5e-3 * k) for k in (-1, 1))
    assert abs(float(found[0, 1]) / (point * (1.0 / 5e-3 + images)) - 1.0) < 1e-3
    count = 401
    along = 1e-4 * (jnp.arange(float(count)) - 200.0)
    even = [
        float(
            jnp.sum(
                cells_on_half_space(
                    steel, jnp.asarray(half), jnp.asarray(1e-4), along, (-far, far)
                )[200]
            )
        )
        * 1e-4
        for half in (5e-5, 1e-4)
    ]
    assert abs((even[0] - even[1]) / (2.0 * point * math.log(2.0)) - 1.0) < 1e-3


@pytest.mark.parametrize("helix", [0.0, pytest.param(20.0, marks=pytest.mark.slow)])
def test_coupling_is_symmetric_and_positive(helix, spur):
    pair, teeth = spur if helix == 0.0 else _pair(helix)
    load = jnp.asarray(3e5)
    for slices in (1, 8, 40):
        grid = jg.mesh_grid(pair, phases=8, slices=slices, fixed_face=True)
        coupling = np.asarray(teeth.between_cells(pair, contact_lines(pair, grid), load))
        scale = np.abs(coupling).max()
        np.testing.assert_allclose(coupling, np.swapaxes(coupling, 1, 2), atol=1e-12 * scale)
        assert np.linalg.eigvalsh(coupling).min() > -1e-9 * scale


def test_even_load_gives_what_the_pair_gives_alone(spur):
    """One line that is pressed evenly moves, in the mean, as `alone` says."""
    pair, teeth = spur
    load = jnp.asarray(3e5)
    grid = jg.mesh_grid(pair, phases=8, slices=20, fixed_face=True)
    lines = contact_lines(pair, grid)
    coupling = teeth.between_cells(pair, lines, load)
    phase = int(np.flatnonzero(np.asarray(lines.fraction[:, 0, 0]) == 1.0)[2])
    own = coupling[phase, :20, :20]
    alone = teeth.alone(pair, lines.roll[phase, 0, :1], load)[0]
    even = jnp.sum(own) * lines.length / 20.0
    assert abs(float(even / alone) - 1.0) < 1e-6


def test_soft_gears_give_in_proportion_and_the_derivative_by_roll_is_right(spur):
    pair, teeth = spur
    load, middle = jnp.asarray(3e5), 0.5 * (pair.path_start + pair.path_end)
    whole = lambda roll: jnp.sum(teeth(pair, roll, load))
    rolls = middle + 1e-4 * jnp.asarray([-3.0, 0.4, 2.0])
    slope, step = jax.grad(whole)(rolls), 1e-7
    for index in range(3):
        moved = [whole(rolls.at[index].add(sign * step)) for sign in (1.0, -1.0)]
        assert abs((moved[0] - moved[1]) / (2.0 * step) / slope[index] - 1.0) < 1e-5


def _scene(tmp_path, *overrides):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return read_scene(path, overrides)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["wheel.bore_mm=0"], "wheel.bore_mm a value > 0"),
        (["mesh.stiffness=iso6336"], "takes the place of mesh.stiffness"),
        (["wheel.bore_mm=124"], "wheel.body: Under teeth of finite elements the ring must be"),
    ],
)
def test_scenes_that_cannot_have_such_teeth_are_refused(tmp_path, overrides, message):
    with pytest.raises(ValueError, match=message):
        model_of(_scene(tmp_path, *overrides))


def test_what_shapes_the_teeth_is_no_real_key(tmp_path):
    keys = _scene(tmp_path).real_keys()
    assert "pinion.profile_shift" not in keys
    assert "pair.torque_pinion_Nm" in keys
    assert "pinion.profile_shift" in _scene(tmp_path, "mesh.tooth=sliced").real_keys()


@pytest.mark.slow
def test_cycle_of_a_scene(tmp_path):
    """Whole gears of finite elements deflect about as much as sliced teeth on rings."""
    from jaxgear.study import run

    found = [
        run(_scene(tmp_path, f"mesh.tooth={tooth}")).summary["static"]
        for tooth in ("elements", "sliced")
    ]
    assert abs(found[0]["te_mean_um"] / found[1]["te_mean_um"] - 1.0) < 0.05
    stiff = [each["single_pair_stiffness_max_N_mm_um"] for each in found]
    assert abs(stiff[0] / stiff[1] - 1.0) < 0.1
