"""What runs with condensed bodies say beside the rigid model's answers."""

import dataclasses
import json
import types
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from table_checks import assert_tables
from tiny_cases import TINY_PAIR

import fem_prep
from fem_prep._artefact import inertia_relief, self_equilibrated
from fem_prep._condense import boundary_of
from fem_prep._hold import fixed_interface
from jaxgear import plot
from jaxgear._cli._main import main
from jaxgear._solve._cycle import MeshCycle, prepare_mesh
from jaxgear._system._structure import bearing_motion
from jaxgear._units import MPa, deg, um
from jaxgear.plot import _hybrid_pictures as pictures
from jaxgear.plot import _hybrid_tables as tables
from jaxgear.scene._body_build import Steps, full_of
from jaxgear.scene._build import grid_of, law_of, model_of
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.scene._scene import read_scene
from jaxgear.study import _body_answers as answered
from jaxgear.study import _body_fields as body_fields
from jaxgear.study import _hybrid as hybrid
from jaxgear.study import _hybrid_dataset as hybrid_dataset
from jaxgear.study._built import BuiltScene
from jaxgear.study._head import foundation_of
from jaxgear.study._notes import _on_condensed
from jaxgear.study._results import static_dataset
from jaxgear.study._statics import Mounts, Statics, solve_statics
from jaxgear.study._stress_maps import (
    stress_dataset,
    stress_maps,
    stress_summary,
    stress_writer,
)

# The web is off the middle and three bearings hold its shaft: nothing cancels by accident.
_SCENE = f"""{TINY_PAIR}[material]
young_GPa = 200.0
density_kg_m3 = 8000.0
"""
_SCENE += """[wheel.body]
kind = "condensed"
web = { hub_outer_mm = 30, web_thickness_mm = 4, rim_inner_mm = 52, web_offset_mm = 2 }
modes = 2
compare_seats = false
fineness = { sectors = 24, rim_across = 1, web_along = 1, hub_deep = 1 }
[wheel.shaft]
gear_at_mm = 20.0
segments = [ { length_mm = 40, outer_mm = 20, inner_mm = 8 } ]
bearings = [
    { at_mm = 0, radial_N_m = 1e8, axial_N_m = 5e7, tilt_Nm_rad = 2e3 },
    { at_mm = 30, radial_N_m = 2e8 },
    { at_mm = 40, radial_N_m = 5e7 },
]
[mesh]
stiffness = "constant"
stiffness_N_mm_um = 14.0
slices = 4
phases = 8
pinion_speed_rad_s = 1500.0
root_correction = false
"""
_HOLES = "web_offset_mm = 2, holes = 4, hole_diameter_mm = 8, hole_circle_mm = 41 }"


def _scene(path, text=_SCENE):
    path.write_text(text)
    return with_bodies(read_scene(path))


@eqx.filter_jit
def _prepared(model, grid):
    return prepare_mesh(model, grid)


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """The scene with its body, and a cycle of any forces that balance the torque."""
    folder = tmp_path_factory.mktemp("hybrid")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXGEAR_CACHE", str(folder / "cache"))
        scene = _scene(folder / "tiny.toml")
    model = model_of(scene)
    grid = grid_of(scene, model)
    prepared = _prepared(model, grid)
    system, cells = prepared.system, prepared.cells
    force = np.random.default_rng(0).uniform(0.1, 1.0, cells.stiffness.shape)
    force *= float(system.force) / force.sum(axis=1, keepdims=True)
    arms = np.asarray(system.arms(cells))
    cycle = MeshCycle(
        system=system,
        cells=cells,
        approach=jnp.zeros(len(force)),
        load=jnp.asarray(np.einsum("pcq,pc->pq", arms, force)),
        overlap=jnp.asarray(1e-6 * force),
        force=jnp.asarray(force),
        converged=jnp.ones(len(force), bool),
        steps=jnp.ones(len(force), int),
    )
    statics = Statics(
        model=model,
        grid=grid,
        law=law_of(scene.mesh),
        cycle=cycle,
        prepared=prepared,
        numbers={},
        standard={},
        mounts=Mounts(*(jnp.zeros(0) for _ in Mounts._fields)),
        angle_change=jnp.zeros(()),
        harris=np.zeros((0, len(force))),
        harris_harmonics=np.zeros((0, 3)),
        influences=None,
    )
    return (
        scene,
        statics,
        answered.body_under_teeth(scene.mesh, "wheel", scene.bodies["wheel"], statics),
    )


# --- The body under its teeth


@pytest.mark.slow
def test_feet_move_as_the_contact_solution_has_them(solved):
    _, statics, under = solved
    cycle, found = statics.cycle, under.under_mesh(0)
    cells = cycle.cells
    assert cells.coupling is not None
    assert cells.seat_arms is not None
    assert cells.growth is not None
    seats = np.asarray(cycle.system.displacement(cycle.load))[:, -24:]
    said = np.einsum("pcs,ps->pc", np.asarray(cells.seat_arms), seats)
    said -= np.einsum("pij,pj->pi", np.asarray(cells.coupling), np.asarray(cycle.force))
    said += np.asarray(cells.growth)
    rim = 3 * len(under.body.rim_nodes)
    whole = (found.motion + under.rotation)[:, :rim].reshape(len(said), -1, 3)
    got = np.sum(found.weights * found.on_feet(whole), axis=2)
    np.testing.assert_allclose(got, said, rtol=0, atol=1e-10 * np.abs(said).max())
    # The body turns by a pitch in a mesh period, the wheel of a pair backwards.
    steps = np.asarray(cycle.cells.lines.phase, dtype=float) * 2.0 * np.pi / 24
    np.testing.assert_allclose(np.diff(found.turn), -np.diff(steps), rtol=1e-9)


def test_the_whole_grid_is_in_balance(solved):
    """Loads on the rim, reactions of the bearings, and nothing at any other node."""
    scene, statics, under = solved
    built, found = scene.bodies["wheel"].built, under.under_mesh(0)
    cycle, phase = statics.cycle, 3
    full = full_of(built.plan, Steps(lambda step: None))
    outer = built.body.boundary_dofs
    held = fixed_interface(full)
    motion = held.followed(found.motion[phase, :outer][:, None])
    np.testing.assert_allclose(
        answered.whole_motion(built, found.motion[phase][None], np.zeros(1))[0],
        full.on_nodes(motion)[0],
        rtol=0,
        atol=1e-12 * np.abs(motion).max(),
    )
    np.testing.assert_allclose(
        boundary_of(full, motion)[:, 0],
        found.motion[phase, :outer],
        atol=1e-10 * np.abs(motion).max(),
    )
    rim = 3 * len(full.rim)
    reaction = held.reaction(motion)[:, 0]
    load = found.load[phase]
    np.testing.assert_allclose(reaction[:rim], load[:rim], atol=1e-6 * np.abs(load).max())
    # What holds the seats are the bearings, and the torque on its seat.
    structure = cycle.system.structure
    moved = np.asarray(cycle.system.displacement(cycle.load))[phase]
    moved = moved - np.asarray(hybrid._rotation_offset(statics.model, cycle))
    bearings = np.asarray(bearing_motion(structure, jnp.asarray(moved)).load)[-3:]
    seats = reaction[rim:].reshape(-1, 6)
    turned = hybrid._turned(seats.reshape(1, -1), found.turn[phase][None]).reshape(-1, 6)
    names = [under.body.seats.index(f"bearing[{i}]") for i in range(3)]
    size = np.abs(bearings).max()
    np.testing.assert_allclose(turned[names, :3], -bearings[:, :3], atol=1e-5 * size)
    np.testing.assert_allclose(turned[names, 3:5], -bearings[:, 3:], atol=1e-6 * size)
    torque = under.body.seats.index("torque")
    np.testing.assert_allclose(turned[torque, 5], 24 / 20 * 100.0, rtol=1e-6)
    # Work of the loads is the strain energy, twice.
    energy = motion[:, 0] @ (full.stiffness @ motion[:, 0])
    work = load @ found.motion[phase] + reaction[rim:] @ found.motion[phase, rim:outer]
    assert energy == pytest.approx(work, rel=1e-8)


def test_bearing_loads_balance_the_mesh(solved):
    _, statics, _ = solved
    cycle = statics.cycle
    moved = cycle.system.displacement(cycle.load)
    load = np.asarray(
        eqx.filter_vmap(bearing_motion, in_axes=(None, 0))(cycle.system.structure, moved).load
    )[:, -3:]
    force = float(cycle.system.force)
    angle = float(statics.model.pair.working_pressure_angle)
    total = np.sum(load[:, :, :3], axis=1)
    expected = force * np.array([np.sin(angle), np.cos(angle), 0.0])
    np.testing.assert_allclose(np.abs(total), np.tile(expected, (len(total), 1)), atol=1e-4 * force)


def test_rotation_is_told_apart(solved):
    """It grows with the square of the speed, is the same all around, and opens the rim."""
    scene, statics, under = solved
    slow = eqx.tree_at(lambda m: m.speed, statics.model, 0.5 * statics.model.speed)
    system = _prepared(slow, statics.grid).system
    cycle = dataclasses.replace(statics.cycle, system=system)
    slower = hybrid.BodyUnderTeeth(
        scene.bodies["wheel"], 1, slow, statics.grid, cycle, points=12, axial="mortar"
    )
    scale = np.abs(under.rotation).max()
    np.testing.assert_allclose(4.0 * slower.rotation, under.rotation, rtol=0, atol=1e-9 * scale)
    assert under.spin == pytest.approx(1500.0 * 20 / 24)
    grown = under.against_seat(under.rotation[None])[0]
    parts = hybrid.along_radius(under.body.rim_nodes, grown).reshape(24, -1, 3)
    np.testing.assert_allclose(parts, np.broadcast_to(parts[:1], parts.shape), atol=1e-6 * scale)
    assert parts[..., 0].mean() > 0.0
    # Nothing resists it, not even the bearings, of which one alone holds the axis.
    body = under.body
    load = self_equilibrated(under.spin**2 * body.centrifugal_load, body.mass, body.rigid_motions)
    alone = under.against_seat(inertia_relief(body, load)[None])[0]
    np.testing.assert_allclose(grown, alone, rtol=0, atol=1e-6 * scale)
    # Under the mesh alone it does not show.
    moved, slow_moved = under.under_mesh(0).motion, slower.under_mesh(0).motion
    np.testing.assert_allclose(moved, slow_moved, rtol=0, atol=1e-9 * np.abs(moved).max())


def test_a_rigid_motion_is_no_deflection(solved):
    _, _, under = solved
    rigid = under.body.rigid_motions.T
    left = under.against_seat(rigid)
    np.testing.assert_allclose(left, 0.0, atol=1e-12)


@pytest.mark.slow
def test_answers_are_of_all_phases(solved, tmp_path):
    scene, statics, under = solved
    (answer,) = answered.body_answers(scene.mesh, scene.bodies, statics)
    assert answer.rim.shape == (8, 3)
    assert answer.roots.shape == (*statics.cycle.cells.lines.roll.shape, 3)
    # A foot follows its patch of the rim, which moves by no more than the rim's largest.
    assert np.abs(answer.roots).max() <= 1.2 * answer.rim.max()
    numbers = answer.numbers
    worst = answered.worst_phase(statics.cycle)
    assert [field.what for field in answer.fields] == ["mesh", "rotation"]
    field = answer.fields[0]
    rim = answer.grid.sets["rim"]
    largest = np.linalg.norm(field.field, axis=1)
    assert numbers["body_deflection_um"] == pytest.approx(largest.max() / um)
    np.testing.assert_allclose(
        np.abs(hybrid.along_radius(answer.grid.nodes[rim], field.field[rim])).max(axis=0),
        answer.rim[worst],
        rtol=1e-6,
    )
    assert numbers["web_wind_up_um"] > 0.0
    known = answer.built.health["centrifugal_growth_um_at_rad_s"]
    speed, growth = max((float(name), each) for name, each in known.items())
    expected = growth * (numbers["speed_rad_s"] / speed) ** 2
    assert numbers["growth_mean_radial_um"] == pytest.approx(expected, rel=1e-6)
    shown = body_fields.fields_dataset(answer)
    assert shown.sizes["rim"] == len(under.body.rim_nodes)
    assert shown["cause"].values.tolist() == ["mesh", "rotation"]
    # The wheel's rim gives most where the teeth press.
    at = np.argmax(np.abs(shown["tangential_um"].sel(cause="mesh").values))
    assert abs(float(shown["angle_deg"][at])) < 60.0
    body_fields.grid_writer(answer)(tmp_path / "wheel.vtu")
    assert (tmp_path / "wheel.vtu").stat().st_size > 0
    drawn = plot.pictures({"wheel_deflected": shown.assign_attrs(title="tiny")})
    names = [(each.name, len(each.draw().axes), set(each.table)) for each in drawn]
    told = {"angle_deg", "Z_mm", "radial_um", "tangential_um", "axial_um"}
    assert names == [("wheel_under_mesh", 3, told), ("wheel_under_rotation", 3, told)]
    assert (
        foundation_of(scene.mesh, scene.gears, scene.bodies)
        == "pinion weber, wheel its condensed body"
    )


# --- Teeth and holes, by hand


def _dataset(periods=6, phases=8):
    """Two lines, three slices: the pair on line 0 carries more the later it entered."""
    count = periods * phases
    phase = (np.arange(count) + 0.5) / phases
    passage = np.stack([phase % 1.0, phase % 1.0 + 1.0], axis=1)
    pair = np.rint(phase[:, None] - passage).astype(int) % periods
    share = np.tile([0.6, 0.4], (count, 1))
    load = (100.0 + 10.0 * pair)[:, :, None] * np.array([1.0, 0.8, 0.5])
    cells = ("phase", "line", "slice")
    return xr.Dataset(
        {
            "load_sharing": (("phase", "line"), share),
            "line_load_N_mm": (cells, load),
            "pressure_MPa": (cells, 10.0 * load),
            "fraction": (cells, np.ones(load.shape)),
            "transmission_error_um": ("phase", 20.0 + np.sin(2 * np.pi * phase)),
        },
        coords={
            "weight": ("phase", np.full(count, 1.0 / count)),
            "phase": phase,
            "passage": (("phase", "line"), passage),
            "line": ("line", [0, 1]),
            "face_position_mm": ("slice", [-3.0, 0.0, 3.0]),
        },
        attrs={"face_width_mm": 9.0, "teeth_pinion": 20, "teeth_wheel": 24},
    )


def test_each_tooth_has_its_own_load():
    found = hybrid_dataset.hybrid_variables(_dataset(), [])
    np.testing.assert_allclose(found["tooth_line_load_N_mm"], 100.0 + 10.0 * np.arange(6))
    np.testing.assert_allclose(found["tooth_load_over_mean"], 1.0)
    np.testing.assert_allclose(found["tooth_share"], 0.6)
    assert int(found["way_tooth_pair"]) == 5
    assert np.all(np.diff(found["way_passage"]) > 0.0)
    assert found.sizes["step"] == 16
    np.testing.assert_allclose(found["way_line_load_N_mm"][:, 1], 0.8 * 150.0)
    # Teeth enter ahead on the wheel, behind on the pinion.
    np.testing.assert_allclose(found["wheel_tooth_angle_deg"], 15.0 * np.arange(6))
    np.testing.assert_allclose(found["pinion_tooth_angle_deg"][:3], [0.0, 342.0, 324.0])


def test_teeth_above_holes_are_told_from_others():
    found = hybrid_dataset.hybrid_variables(_dataset(), [])
    holes = hybrid_dataset.HolePlaces(np.array([0.0]), np.array([20 * deg]))
    assert holes.above(np.array([0, 19, 21, 341.0]) * deg).tolist() == [True, True, False, True]
    numbers = hybrid_dataset.hole_numbers(found, "wheel", holes)
    assert numbers["line_load_above_holes_mean_N_mm"] == pytest.approx(105.0)
    assert numbers["line_load_above_holes_largest_N_mm"] == pytest.approx(110.0)
    assert numbers["line_load_between_holes_mean_N_mm"] == pytest.approx(135.0)
    above = holes.above(found["wheel_tooth_angle_deg"].values * deg)
    shown = found.assign(
        wheel_tooth_above_a_hole=("tooth_pair", above.astype(int)),
        wheel_hole_deg=("hole", [0.0]),
        wheel_hole_half_deg=("hole", [20.0]),
    ).assign_attrs(title="tiny")
    columns = tables.tooth_loads_columns(shown, "wheel")
    assert columns["above_a_hole"].tolist() == [1, 1, 0, 0, 0, 0]
    figure = pictures.tooth_loads(shown, "wheel")
    assert figure.legends
    assert figure.axes[0].get_ylabel() == "largest line load [N/mm]"


def test_loads_across_the_face_are_shown_where_they_are_largest():
    dataset = hybrid_dataset.hybrid_variables(_dataset(), []).assign_attrs(title="tiny")
    shown = tables.contact_line_loads(dataset)
    assert float(shown["line_load_N_mm"].max()) == pytest.approx(150.0)
    assert shown.sizes["phase"] == 6
    assert np.ptp(shown["phase"].values) < 1.0
    assert len(pictures.contact_line_loads(dataset).axes) == 6
    way = tables.tooth_way_columns(dataset)
    assert len(way["passage"]) == 48
    assert pictures.tooth_way(dataset).axes[0].get_title(loc="left").startswith("tooth pair 5")


# --- Notes


def test_notes_on_condensed_bodies(solved, tmp_path):
    scene, _, _ = solved
    said_of = lambda scene: [*_on_condensed(scene.mesh, scene.gears, scene.bodies)]
    (said,) = said_of(scene)
    assert "is taken as that of teeth alone" in said
    given = scene.replace({"wheel.foundation": "weber"})
    assert "wheel.foundation does nothing to the wheel" in said_of(given)[1]
    facts = {"sectors": 4}
    known = dataclasses.replace(scene.bodies["wheel"].built.body, facts=facts)
    body: Any = types.SimpleNamespace(built=types.SimpleNamespace(body=known), family=None)
    short = dataclasses.replace(scene, bodies={"wheel": body})
    (_, said) = said_of(short)
    assert "repeats after 6 teeth" in said
    assert "multiple of 6" in said
    path = tmp_path / "rigid.toml"
    path.write_text(_SCENE.replace('kind = "condensed"', 'kind = "rigid"'))
    (said,) = said_of(read_scene(path))
    assert said.startswith("mesh.pinion_speed_rad_s, mesh.root_correction: no body is condensed")


# --- The command


def _teeth_of(path, *changes):
    """Largest line load of each tooth."""
    scene = with_bodies(read_scene(path, changes))
    statics = solve_statics(BuiltScene(scene))
    dataset = static_dataset(statics.model, statics.cycle, statics.law)
    return hybrid_dataset.hybrid_variables(dataset, [])["tooth_line_load_N_mm"].values


@pytest.mark.slow
def test_a_wheel_with_holes_moves_on_natural_modes_and_more_of_them_judge(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "tiny.toml"
    path.write_text(_SCENE.replace("web_offset_mm = 2 }", _HOLES))
    settings = ["model.coordinates=20", "pair.helix_angle_deg=12"]
    scene = with_bodies(read_scene(path, settings), moving=True)
    assert (scene.model.shapes, scene.at_mesh) == ("natural", 100)
    (wheel,) = scene.bodies.values()
    natural, count = wheel.natural, len(wheel.basis.square)
    assert count in (19, 20)
    np.testing.assert_array_equal(wheel.basis.square, natural.square[:count])
    judge, into = wheel.more_modes
    assert into.shape == (len(judge.modes.waves), count)
    # Twice as many, or one less: a pair is not parted.
    assert len(judge.modes.waves) in (2 * count - 1, 2 * count)
    own = wheel.flexible.modes.square
    np.testing.assert_allclose(into.T @ judge.modes.square, own, rtol=1e-12)
    # Its 24 teeth stand on four sectors alike after 6 of them, waves that alternate after 12.
    assert scene.mesh.periods == 12


@pytest.mark.slow
def test_natural_modes_over_a_long_cycle_need_no_sweep(tmp_path, monkeypatch):
    """Five holes under 24 teeth repeat after 24 mesh periods: fewer steps, but no speeds."""
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    path, out = tmp_path / "tiny.toml", tmp_path / "out"
    text = _SCENE.replace("web_offset_mm = 2 }", _HOLES.replace("holes = 4", "holes = 5"))
    path.write_text(text.replace("sectors = 24", "sectors = 25"))
    scene = with_bodies(read_scene(path), moving=True)
    assert (scene.mesh.periods, scene.sweep.steps, scene.sweep.is_given) == (24, 64, False)
    assert main(["modes", str(path), "--out", str(out), "--no-pictures"]) == 0
    summary = json.loads((out / "modes" / "summary.json").read_text())
    frequency = np.array(summary["modes"]["frequency_Hz"])
    assert frequency.size > 10
    assert np.all(np.diff(frequency) >= 0.0)


@pytest.mark.slow
def test_a_run_shows_teeth_above_holes_and_between(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    path, out = tmp_path / "tiny.toml", tmp_path / "out"
    text = _SCENE.replace("web_offset_mm = 2 }", _HOLES).replace("slices", "periods = 6\nslices")
    path.write_text(text)
    assert main(["run", str(path), "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    wheel = summary["static"]["wheel_body"]
    assert summary["bodies"][0]["gear"] == "wheel"
    assert summary["model"]["foundation"] == "pinion weber, wheel its condensed body"
    assert len(summary["static"]["bearings"]) == 3
    above, between = (wheel[f"line_load_{where}_holes_mean_N_mm"] for where in ("above", "between"))
    assert 1e-4 < abs(above / between - 1.0) < 0.1
    with xr.open_dataset(out / "result.nc") as dataset:
        assert dataset["wheel_root_deflection_um"].dims == ("phase", "line", "slice", "direction")
        assert float(dataset["tooth_load_over_mean"].mean()) == pytest.approx(1.0)
        loads = dataset["tooth_line_load_N_mm"].values
    for name in (
        "contact_lines",
        "tooth_way",
        "wheel_tooth_loads",
        "wheel_under_mesh",
        "wheel_under_rotation",
        "shafts",
    ):
        for ending in ("png", "svg", "csv"):
            assert (out / f"{name}.{ending}").stat().st_size > 0
    assert (out / "wheel_deflected.vtu").exists()
    assert_tables(out)
    # Holes one tooth further on: the same loads, one tooth further on.
    moved = _teeth_of(path, "wheel.body.web.hole_angle_deg=15")
    assert np.ptp(loads) > 1e-4 * loads.max()
    np.testing.assert_allclose(np.roll(loads, 1), moved, rtol=1e-6)


@pytest.mark.slow
def test_stress_maps_are_those_of_the_grid_over_a_revolution(solved, tmp_path):
    scene, statics, under = solved
    maps = stress_maps(scene.mesh, scene.bodies, statics)
    found, built = maps["wheel"], scene.bodies["wheel"].built
    phase = answered.worst_phase(statics.cycle)
    motion = under.under_mesh(0).motion[phase] + under.rotation
    field = answered.whole_motion(built, motion[None], np.array([under.spin]))
    wanted = fem_prep.nodal_stress(found.grid, built.plan.material, field)[0]
    np.testing.assert_allclose(found.stress, wanted, atol=1e-9 * np.abs(wanted).max())
    equivalent = fem_prep.von_mises(wanted)
    assert np.all(found.range.equivalent >= equivalent * (1.0 - 1e-9))
    assert found.range.equivalent.max() == pytest.approx(equivalent.max(), rel=0.5)
    assert found.covered == 1.0
    (told,) = stress_summary(maps)
    assert told["largest_von_mises_MPa"] <= found.range.equivalent.max() / MPa
    assert 10.0 < told["alternating_at_radius_mm"] < 32.0
    shown = stress_dataset("wheel", found)
    assert shown["section_principal_MPa"].max() <= shown["largest_principal_MPa"].max()
    stress_writer(found)(tmp_path / "stress.vtu")
    assert b"alternating stress [Pa]" in (tmp_path / "stress.vtu").read_bytes()
