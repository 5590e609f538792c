"""What a sweep says and draws of waves, by a wave made by hand in a small condensed wheel."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from table_checks import assert_table
from tiny_cases import tiny_scene

from fem_prep import nodal_stress, tensors
from jaxgear import plot
from jaxgear._checks import InputError
from jaxgear._dynamics._system import PairDynamics
from jaxgear._response._body_motion import rotating_spectrum
from jaxgear._response._flank_loads import FlankLoads
from jaxgear._response._measured import Measured
from jaxgear._response._waves import BodyMotion, along_directions
from jaxgear._system._body_modes import body_basis, seat_waves
from jaxgear._system._flexible import FlexibleBody
from jaxgear._units import mm, um
from jaxgear._whole_file import write_csv
from jaxgear.plot import _shape_pictures
from jaxgear.scene._bodies import body_plan
from jaxgear.scene._body_build import built_body
from jaxgear.scene._scene import read_scene
from jaxgear.study import _body_shapes, _probes
from jaxgear.study._body_waves import Peak, wave_watch
from jaxgear.study._built import BuiltScene
from jaxgear.study._moving_body import MovingBody
from jaxgear.study._sweeping import Response, Sweep
from jaxgear.study._waves_result import waves_seen

TEETH = 24
_SCENE = (
    tiny_scene(modes=2, gear_at=20.0)
    + """[mesh]
stiffness = "constant"
stiffness_N_mm_um = 14.0
slices = 2
root_correction = false
[model]
coordinates = 16
[sweep]
pinion_speed_rad_s = [100.0, 200.0]
"""
)
_PROBES = """
[[probes]]
gear = "wheel"
name = "on the web"
radius_mm = 22.0
angle_deg = 7.0
height_mm = 1.5
[[probes]]
gear = "wheel"
name = "beside the rim"
frame = "fixed"
height_mm = 5.0
[[gauges]]
gear = "wheel"
name = "turning gauge"
radius_mm = 22.0
angle_deg = 7.0
height_mm = 1.5
[[gauges]]
gear = "wheel"
name = "fixed gauge"
frame = "fixed"
radius_mm = 22.0
height_mm = 1.5
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("waves")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXGEAR_CACHE", str(folder / "cache"))
        path = folder / "tiny.toml"
        path.write_text(_SCENE + _PROBES)
        scene = read_scene(path)
        built = built_body(body_plan(scene, "wheel"), lambda step: None)
    # What the mesh sees of the body is of no interest here.
    flexible = object.__new__(FlexibleBody)
    object.__setattr__(flexible, "gear_seat", built.body.seats.index("torque"))
    basis = body_basis(built.body, 16)
    shapes = dict(basis=basis, made_of=None, into=None, residual=None)
    body = SimpleNamespace(built=built, flexible=flexible, of_modes=flexible, heated=None, **shapes)
    return dataclasses.replace(scene, bodies={"wheel": body})


@pytest.fixture(scope="module")
def watch(scene):
    return wave_watch(BuiltScene(scene), object.__new__(PairDynamics))


@pytest.fixture(scope="module")
def motion(watch):
    """A wave of two nodal diameters that travels forward on the wheel, which turns about -Z."""
    basis = watch.looked["wheel"].body.basis
    seats = basis.following.shape[1]
    first = int(np.flatnonzero((basis.waves == 2) & (basis.diameters == 2))[0])
    amplitudes = np.zeros((2, seats + len(basis.waves)), dtype=complex)
    amplitudes[1, seats + first : seats + first + 2] = 1e-7 * np.array([1.0, 1j])
    return BodyMotion(amplitudes, np.r_[seat_waves(seats), basis.waves], TEETH, 1, -100.0, 0.3)


def by_modes(body, probe, motion):
    """What a probe shows of a motion of seats and natural modes."""
    return probe.spectrum(motion, probe.looking_at(probe.coordinates @ body.motions))


def made_loads(speed):
    """One tooth pair on a line of two slices, from its entry to its exit."""
    passage = np.linspace(0.0, 1.5, 16)[:, None]
    load = 1e5 * np.sin(np.pi * passage[:, :, None] / 1.5) * np.array([1.0, 2.0])
    pair, touching = np.zeros(passage.shape, int), np.ones(passage.shape, bool)
    face = np.array([-0.003, 0.003])
    return FlankLoads(speed, passage, pair, touching, face, load, 1e6 * np.sqrt(np.abs(load)))


@pytest.fixture(scope="module")
def found(scene, watch, motion):
    """What is said of a sweep of two speeds, of which the first was the higher."""
    whole = {"wheel": motion}
    loads = made_loads(100.0)
    looked = watch.looked["wheel"]
    shown = tuple(by_modes(looked.body, probe, motion) for probe in looked.probes)
    seen = watch.look(loads.largest, whole, {"wheel": shown})
    half = seen._replace(waves={name: 0.5 * each for name, each in seen.waves.items()})
    watch = dataclasses.replace(
        watch,
        seen={"up": {100.0: seen, 200.0: half}},
        peak={"up": Peak((True, 1.0), 100.0, whole, {"wheel": shown})},
        loads={"up": {"peak": loads}},
    )
    gears = SimpleNamespace(face_width=0.012)
    watch.pair = SimpleNamespace(cycle=SimpleNamespace(system=SimpleNamespace(pair=gears)))
    numbers = Measured(*[1.0] * len(Measured._fields))
    responses = tuple(Response(x, True, True, 1, 0.0, None, numbers) for x in (100.0, 200.0))
    sweep = Sweep(np.array([100.0, 200.0]), {"up": responses}, (), {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_body_shapes, "_STATES", 2)
        yield waves_seen(scene.title, watch, sweep)


@pytest.mark.slow
def test_the_wave_is_named(found):
    (found,) = found.summary
    assert (found["order"], found["nodal_diameters"]) == (TEETH - 2, 2)
    assert found["wave"] == "2 nodal diameters, forward"
    assert found["share"] > 0.999
    assert found["travel_rad_s"] == pytest.approx(100.0 * 11)
    assert max(found["amplitude_um"], key=found["amplitude_um"].__getitem__) == "axial"
    gauge, probe = found["probes"]
    assert (gauge["name"], gauge["frame"], gauge["strongest_order"]) == (
        "on the web",
        "rotating",
        TEETH - 2,
    )
    assert (probe["name"], probe["frame"], probe["strongest_order"]) == (
        "beside the rim",
        "fixed",
        TEETH,
    )
    assert probe["amplitude_at_teeth_um"] == probe["amplitude_um"] > 0.0
    assert gauge["amplitude_at_teeth_um"] < 1e-6 * gauge["amplitude_um"]
    largest = {row["nodal_diameters"]: row for row in found["largest"]}
    assert largest[2]["pinion_speed_rad_s"] == 100.0
    assert largest[2]["rms_um"] > 1e3 * max(largest[n]["rms_um"] for n in (-2, -1, 0, 1, 3))


@pytest.mark.slow
def test_gauges_show_the_orders_that_doppler_says(watch, found):
    # A forward wave of two nodal diameters driven at the order of the teeth.
    spectra = found.datasets["gauges_moving"]
    strain = spectra["wheel_gauge_strain_um_m"].values
    order = spectra["wheel_order"].values
    for row, wanted in zip(strain, (TEETH - 2, TEETH), strict=True):
        assert order[np.argmax(row)] == wanted
        # What rotation does stands still on the body.
        assert np.sort(row[order > 0.0])[-2] < 1e-6 * row.max()
    turning, fixed = watch.looked["wheel"].gauges
    assert (turning.turns, len(turning.places)) == (True, 1)
    # One wave passes both: alike in size, but for what repeats with the sectors.
    assert strain[0].max() == pytest.approx(strain[1].max(), rel=0.05)
    assert len(fixed.places) == TEETH


@pytest.mark.slow
def test_a_gauge_reads_the_strain_of_the_grid(watch, motion):
    each = watch.looked["wheel"]
    body, gauge = each.body, each.gauges[0]
    # Along x, y, z, with the rigid part of the motion: it strains nothing.
    whole = body.motions @ motion.on_body(TEETH - 2)
    field = body.field(np.stack([np.real(whole), np.imag(whole)], axis=1))
    grid, material = body._held.full.grid, body.built.plan.material
    radius, angle, height = gauge.places[0]
    place = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    node = int(np.argmin(np.linalg.norm(body.nodes - place, axis=1)))
    stress = nodal_stress(grid, material, field, np.array([node]))[:, 0]
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    normal = tensors(stress) @ along @ along
    own = gauge.spectrum(motion).near(TEETH - 2)
    assert own[1] == pytest.approx(normal[0] + 1j * normal[1], rel=1e-8)
    rest = stress[:, :3].sum(axis=1) - normal
    strain = (normal - material.poisson * rest) / material.young
    assert own[0] == pytest.approx(strain[0] + 1j * strain[1], rel=1e-8)


@pytest.mark.slow
def test_a_gauge_on_the_web_moves_as_the_grid_does(watch, motion):
    each = watch.looked["wheel"]
    body, probe = each.body, each.probes[0]
    assert probe.place == pytest.approx((22.0 * mm, np.radians(7.0), 1.5 * mm), rel=0.1)
    radius, angle, height = probe.place
    place = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    node = int(np.argmin(np.linalg.norm(body.nodes - place, axis=1)))
    # Neither on the rim nor held: its motion follows by the grid alone.
    assert body._rim[node] < 0
    shape = body.shape(motion, TEETH - 2)
    own = along_directions(np.array([angle]), shape[None, node])[0, 2]
    seat = along_directions(np.array([angle]), body.with_seat(place[None]))[0, 2]
    own = own + seat @ motion.on_body(TEETH - 2)[body.seat]
    assert by_modes(body, probe, motion).near(TEETH - 2) == pytest.approx(own, rel=1e-9)
    # The rim's part of the whole grid is the rim.
    rim = np.flatnonzero(body._rim >= 0)
    moved = body.field(body.basis.shapes[:, :2])[:, rim]
    assert np.moveaxis(body.rows(rim), 2, 0)[body.basis.following.shape[1] :][:2] == pytest.approx(
        moved, rel=1e-6, abs=1e-9 * np.abs(moved).max()
    )


@pytest.mark.slow
def test_pictures_and_shapes_are_written(found, tmp_path, monkeypatch):
    monkeypatch.setattr(_shape_pictures, "_FRAMES", 3)
    drawn = {}
    for each in plot.pictures(found.datasets):
        each.draw().savefig(tmp_path / f"{each.name}.png", dpi=40)
        drawn[each.name] = each.table
        drawn.update({f"{each.name}_{key}": others for key, others in each.beside.items()})
    names = {"wheel_spectra", "wheel_waves", "wheel_levels", "wheel_levels_probes"}
    assert set(drawn) == names | {"flank_pressure", "flank_loads", "gauges_moving"}
    for name, columns in drawn.items():
        write_csv(columns, tmp_path / f"{name}.csv")
        assert len(assert_table(tmp_path / f"{name}.csv"))
    (moving,) = plot.animations(found.datasets)
    moving.write(tmp_path / f"{moving.name}.gif")
    with Image.open(tmp_path / "wheel_shape.gif") as picture:
        assert getattr(picture, "n_frames", 1) == 3
    ((name, write),) = found.files.items()
    write(tmp_path / name)
    series = json.loads((tmp_path / "wheel_shape" / "wheel_shape.vtu.series").read_text())
    assert [each["time"] for each in series["files"]] == [0.0, 0.5]
    first = tmp_path / "wheel_shape" / series["files"][0]["name"]
    assert b"displacement [m]" in first.read_bytes()
    largest = drawn["wheel_waves"]
    assert largest["nodal_diameters"][np.argmax(largest["axial_um"])] == 2


@pytest.mark.slow
def test_probes_say_what_they_cannot_see(scene, watch):
    body = watch.looked["wheel"].body
    at = lambda **place: dataclasses.replace(scene, fixed={**scene.fixed, **place})
    seen_by = lambda scene, body: _probes.probes_of(scene.probes, scene.condensed, body)
    with pytest.raises(InputError, match=r"probes\[0\]: no node of the wheel's body is near"):
        seen_by(at(**{"probes[0].radius_mm": 100.0}), body)
    with pytest.raises(InputError, match=r"probes\[0\]\.node: no node 'ear' was condensed"):
        seen_by(at(**{"probes[0].node": "ear"}), body)
    with pytest.raises(InputError, match=r"probes\[1\]\.gear: the body of the pinion is not"):
        seen_by(at(**{"probes[1].gear": "pinion"}), body)
    bare = dataclasses.replace(body.built.body, nodes=np.zeros((0, 3)), bricks=np.zeros((0, 20)))
    built = dataclasses.replace(body.built, body=bare, view=None)
    rim_only = MovingBody("wheel", built, body.basis, body.natural, TEETH)
    with pytest.raises(InputError, match="Of a body without a grid only the rim is known"):
        seen_by(scene, rim_only)
    (usual, *_) = _probes._usual(rim_only)
    assert usual.turns


@pytest.mark.slow
def test_the_usual_probes_are_on_the_rim(watch, motion):
    body = watch.looked["wheel"].body
    found = _probes._usual(body)
    assert [probe.turns for probe in found] == [True, True, False, False]
    axial = [np.abs(by_modes(body, probe, motion).amplitude).max() / um for probe in found[::2]]
    # One wave passes both, but for what repeats with the sectors.
    assert axial[0] == pytest.approx(axial[1], rel=1e-3)
    rows = body.rows(np.array([0, 1]))
    assert rotating_spectrum(motion, rows).amplitude.shape[1:] == (2, 3)
