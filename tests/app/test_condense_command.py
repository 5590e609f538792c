"""`jaxgear condense` and `jaxgear cache` on bodies of a few elements, and what they are made of."""

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgb
from table_checks import assert_tables
from tiny_cases import TINY_PAIR

from fem_prep import (
    BodyError,
    ReducedBody,
    body_grid,
    content_hash,
    key_of,
    largest_rotation,
    read_body,
    read_grid,
    write_vtu,
)
from fem_prep._symmetry import full_turn
from jaxgear import plot
from jaxgear._checks import InputError
from jaxgear._cli._body_report import report_lines
from jaxgear._cli._main import main
from jaxgear.plot._body_render import frame, render
from jaxgear.scene import _body_build
from jaxgear.scene._bodies import Drawn, body_plan
from jaxgear.scene._body_build import Steps, _inputs, built_body, full_of
from jaxgear.scene._body_view import view_folder
from jaxgear.scene._build import model_of, pair_of
from jaxgear.scene._scene import read_scene
from jaxgear.scene._teeth import facts_of_teeth, tooth_outline
from jaxgear.study import condense
from jaxgear.study._condense import body_dataset, body_remarks, body_summary, fastest_of
from jaxgear.study._notes import _on_bodies

_PAIR = f"""{TINY_PAIR}bore_mm = 20.0
[material]
young_GPa = 200.0
density_kg_m3 = 8000.0
"""
_BODY = """[wheel.body]
kind = "condensed"
web = { hub_outer_mm = 30, web_thickness_mm = 4, rim_inner_mm = 52 }
modes = 12
compare_seats = false
fineness = { sectors = 8, rim_across = 1, web_along = 1, hub_deep = 1 }
"""
_SHAFT = """[wheel.shaft]
gear_at_mm = 15.0
segments = [ { length_mm = 10, outer_mm = 18, inner_mm = 8 }, { length_mm = 30, outer_mm = 20, inner_mm = 8 } ]
bearings = [ { at_mm = 0, radial_N_m = 1e8 }, { at_mm = 36, radial_N_m = 1e8 } ]
"""  # noqa: E501
# Root radius of the wheel: 36 mm less 1.25 modules.
_ROOT = 32.25e-3


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))


def _plan(path, *changes, gear="wheel"):
    return body_plan(read_scene(path, changes), gear)


def _built(path, *changes):
    return built_body(_plan(path, *changes), lambda step: None)


def _drawn(plan) -> Drawn:
    assert isinstance(plan.source, Drawn)
    return plan.source


def _grid(plan):
    return body_grid(_drawn(plan).body, _drawn(plan).fineness)


# --- The commands


@pytest.mark.end_to_end
def test_condense_end_to_end_and_then_from_the_cache(write, tmp_path, capsys):
    path, out = write(_PAIR + _BODY), tmp_path / "out"
    assert main(["condense", str(path), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    out = out / "condense"
    (body,) = json.loads((out / "summary.json").read_text())["bodies"]
    assert body["file"] == "tiny-wheel.body.npz"
    assert len(assert_tables(out)) == 3
    assert not body["from_cache"]
    assert (body["name"], body["gear"]) == ("tiny-wheel", "wheel")
    _check_counts(body)
    _check_mass(body)
    assert len(body["free_frequency_Hz"]) == len(body["nodal_diameter"]) == 12
    assert len(body["nodal_circle"]) == 12
    assert body["rigid_body_modes"] == 6
    assert body["largest_free_frequency_error"] < 1e-8
    growth = body["centrifugal_growth_um_at_rad_s"]
    assert growth["1000"] == pytest.approx(4.0 * growth["500"])
    assert f"{body['free_frequency_Hz'][0]:.6g}" in printed.out
    # Eight elements around for 24 teeth, each three teeth long: the report and the reader know.
    assert "is a whole number" not in printed.out
    assert "An element of the rim" in printed.out
    assert "wheel.body.fineness.sectors = 24 every tooth would" in printed.out
    assert f"({body['teeth_mass_kg']:.4g} in truth; it keeps their inertia)" in printed.out
    kept = read_body(out / "tiny-wheel.body.npz")
    health: Any = kept.facts["health"]
    assert health["mass_kg"] == body["mass_kg"]
    assert kept.seats == ("gear",)
    for name in ("grid", "families", "modes"):
        for ending in ("png", "svg", "csv"):
            assert (out / f"wheel_{name}.{ending}").stat().st_size > 100
    again = read_grid(out / "tiny-wheel.vtu", rim="rim", length_unit=1.0)
    np.testing.assert_allclose(again.nodes, kept.nodes, atol=1e-9)
    modes = xr.open_dataset(out / "result.nc", group="wheel_body")
    np.testing.assert_allclose(modes["frequency_Hz"], body["free_frequency_Hz"])
    modes.close()
    (second,) = condense(read_scene(path)).summary["bodies"]
    assert second["from_cache"]
    assert second["seconds"] < 1.0
    assert second["content_hash"] == body["content_hash"]
    assert second["free_frequency_Hz"] == body["free_frequency_Hz"]
    _check_cache_command(body["cache_key"], capsys)


def _check_counts(body):
    assert body["dofs"] == 3 * body["nodes"] - 3 * _nodes_of_bore(body) + 6
    assert body["boundary_dofs"] == 3 * body["rim_nodes"] + 6
    assert body["condensed_dofs"] == body["boundary_dofs"] + body["interior_shapes"]
    assert body["seats"] == ["gear"]
    assert body["torque_seat"] == "gear"


def _nodes_of_bore(body):
    """On 8 elements around: for three elements along, 7 nodes at corners and 4 between."""
    along = round((body["dofs"] - 3 * body["nodes"] - 6) / -24)
    assert along == 2 * 3 + 1 + 3 + 1
    return 8 * along


def _check_mass(body):
    """Three rings of a drawing; the teeth are laid on as a skin that keeps their inertia."""
    rings = ((10e-3, 15e-3, 10e-3), (15e-3, 26e-3, 4e-3), (26e-3, _ROOT, 10e-3))
    mass = sum(8000.0 * math.pi * (r**2 - s**2) * width for s, r, width in rings)
    inertia = sum(8000.0 * math.pi / 2 * (r**4 - s**4) * width for s, r, width in rings)
    assert body["solid_mass_kg"] == pytest.approx(mass, rel=1e-9)
    assert abs(body["mass_deviation"]) < 2e-3
    assert body["lumped_teeth_mass_kg"] > 1.05 * body["teeth_mass_kg"]
    teeth = body["polar_inertia_kg_m2"] - inertia
    assert body["teeth_mass_kg"] * _ROOT**2 < teeth < body["teeth_mass_kg"] * (1.2 * _ROOT) ** 2


def _check_cache_command(key, capsys):
    assert main(["cache", "--json"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["bodies"]
    assert (entry["name"], entry["key"]) == ("tiny-wheel", key)
    assert main(["cache"]) == 0
    assert "tiny-wheel" in capsys.readouterr().out
    folder = view_folder()
    assert folder is not None
    (view,) = folder.glob("*.npz")
    size = entry["size_MB"] * 1e6 + view.stat().st_size
    assert main(["cache", "--clear", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["freed_bytes"] == pytest.approx(size)
    assert main(["cache"]) == 0
    assert "none" in capsys.readouterr().out
    assert not list(folder.glob("*"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_PAIR, "Write, for instance,\n\n[wheel.body]"),
        (_PAIR + _BODY.replace('"condensed"', '"rigid"'), "wheel.body has web, but its kind is"),
    ],
)
def test_condense_without_a_condensed_body_says_what_to_write(write, capsys, text, words):
    assert main(["condense", str(write(text))]) == 2
    assert words in capsys.readouterr().err


def test_a_model_is_not_built_as_if_the_body_were_rigid(write):
    with pytest.raises(InputError, match="has not been built for this scene: use `with_bodies"):
        model_of(read_scene(write(_PAIR + _BODY)))


def test_an_impossible_body_is_refused_in_the_scene_s_own_words(write, capsys, tmp_path):
    text = (_PAIR + _BODY).replace("rim_inner_mm = 52", "rim_inner_mm = 52, web_offset_mm = 4")
    assert main(["condense", str(write(text)), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "scene.toml: wheel.body: `wheel.body.web` must end within the hub" in error


def test_a_rigid_gear_with_a_web_is_told_that_it_has_none(write):
    scene = read_scene(write(_PAIR + _BODY), ["wheel.body.kind=rigid"])
    assert [*_on_bodies(scene.gears)] == [
        'wheel.body.web does nothing: wheel.body.kind is "rigid".'
    ]
    assert not [*_on_bodies(read_scene(write(_PAIR + _BODY)).gears)]


# --- From the scene to the plan


def test_measures_reach_the_drawing_in_metres(write):
    text = (
        _PAIR
        + _SHAFT
        + _BODY.replace(
            "rim_inner_mm = 52",
            "rim_inner_mm = 52, web_offset_mm = 1, web_angle_deg = 5, hub_width_mm = 9, holes = 4, "
            "hole_diameter_mm = 5, hole_circle_mm = 42, hole_angle_deg = 10, second_holes = 4, "
            "second_hole_diameter_mm = 3",
        )
    )
    plan = _plan(write(text))
    drawn = _drawn(plan).body
    assert drawn.rim_outer == pytest.approx(2 * _ROOT)
    sizes = drawn.rim_width, drawn.gear_at, drawn.hub_width
    assert sizes == pytest.approx((10e-3, 15e-3, 9e-3))
    assert [s.outer for s in drawn.segments] == pytest.approx([18e-3, 20e-3])
    web = drawn.web
    assert web is not None
    sizes = web.hub_outer, web.thickness, web.rim_inner, web.offset, web.angle
    assert sizes == pytest.approx((30e-3, 4e-3, 52e-3, 1e-3, math.radians(5)))
    rings = [(ring.count, ring.diameter, ring.circle, ring.angle) for ring in web.holes]
    assert rings[0] == pytest.approx((4, 5e-3, 42e-3, math.radians(10)))
    # Where nothing is said the second ring stands on the same circle, between the holes.
    assert rings[1] == pytest.approx((4, 3e-3, 42e-3, math.radians(55)))
    assert _drawn(plan).fineness.sectors == 8
    assert _drawn(plan).fineness.rim_axial == 1
    assert (plan.material.young, plan.material.density) == pytest.approx((200e9, 8000.0))
    assert plan.method == "herting"


@pytest.mark.parametrize(
    ("torque", "places", "carrier"),
    [
        # At the gear: the inside of the shaft under the hub; its node is on the axis.
        ("", [-15e-3, 21e-3, 0.0], "torque"),
        ("torque_at_mm = 17", [-15e-3, 21e-3, 2e-3], "torque"),
        ("torque_at_mm = 28", [-15e-3, 21e-3, 13e-3], "torque"),
        # Within the seat of a bearing: the same piece of shaft.
        ("torque_at_mm = 38", [-15e-3, 21e-3], "bearing[1]"),
    ],
)
def test_seats_are_where_bearings_and_torque_are(write, torque, places, carrier):
    shaft = _SHAFT.replace("gear_at_mm = 15.0", f"gear_at_mm = 15.0\n{torque}")
    plan = _plan(write(_PAIR + shaft + _BODY))
    names = ["bearing[0]", "bearing[1]", "torque"][: len(places)]
    assert [seat.name for seat in plan.seats] == names
    assert [seat.at for seat in plan.seats] == pytest.approx(places)
    assert [seat.averaging for seat in plan.seats] == [name == "torque" for name in names]
    assert plan.torque_seat == carrier
    grid = _grid(plan)
    assert all(len(grid.sets[f"seat:{seat.label}"]) > 2 for seat in plan.seats)


def test_loads_have_seats_of_their_own_where_there_is_room(write):
    """Between, on a bearing's seat, where the torque leaves, and under the hub."""
    rows = ", ".join(f"{{ at_mm = {at}, force_N = [9, 0, 0] }}" for at in (27, 37, 8, 16))
    extra = f"gear_at_mm = 15.0\ntorque_at_mm = 8.2\nloads = [{rows}]"
    plan = _plan(write(_PAIR + _SHAFT.replace("gear_at_mm = 15.0", extra) + _BODY))
    assert plan.load_seats == ("load[0]", "bearing[1]", "load[2]", "load[3]")
    assert plan.torque_seat == "load[2]"
    found = {seat.name: (seat.label, seat.averaging) for seat in plan.seats}
    assert found["load[0]"] == ("load[0]", True)
    assert found["load[3]"] == ("gear", True)
    assert len(found) == 5
    grid = _grid(plan)
    assert all(len(grid.sets[f"seat:{seat.label}"]) > 2 for seat in plan.seats)


def test_a_solid_disc_is_held_without_being_stiffened(write):
    (seat,) = _plan(write(_PAIR.replace("bore_mm = 20.0\n", "") + _BODY)).seats
    assert (seat.name, seat.label, seat.averaging) == ("gear", "gear", True)
    (seat,) = _plan(write(_PAIR + _BODY)).seats
    assert (seat.name, seat.label, seat.averaging) == ("gear", "bore", False)


def test_coupling_width_and_method_of_the_seats(write):
    path = write(_PAIR + _SHAFT + _BODY)
    soft = _plan(path, "wheel.body.seat_coupling=averaging", "wheel.body.seat_width_mm=4")
    assert all(seat.averaging for seat in soft.seats)
    assert {place.width for place in _drawn(soft).body.seats} == {4e-3}
    held = _plan(path, "wheel.body.interface=craig-bampton")
    assert not any(seat.averaging for seat in held.seats)
    assert held.method == "craig-bampton"


@pytest.mark.parametrize(
    ("changes", "sectors"),
    [
        ((), 24),
        (("wheel.body.web.holes=0",), 24),
        (("wheel.body.fineness.elements_per_tooth=2",), 48),
        # Holes take a whole number for each, a solid axis pairs.
        (("wheel.body.web.holes=9",), 27),
        (("wheel.body.web.holes=9", "wheel.shaft.segments[0].inner_mm=0"), 36),
    ],
)
def test_elements_around_follow_teeth_holes_and_axis(write, changes, sectors):
    holes = "rim_inner_mm = 52, hole_diameter_mm = 5, hole_circle_mm = 41, holes = 3"
    text = _BODY.replace("rim_inner_mm = 52", holes).replace("{ sectors = 8, ", "{ ")
    plan = _plan(write(_PAIR + _SHAFT + text), *changes)
    assert _drawn(plan).fineness.sectors == sectors


def test_teeth_weigh_what_their_outline_encloses(write):
    """By Green's theorem around one tooth: its two flanks, the tip circle, the root circle."""
    pair = pair_of(read_scene(write(_PAIR)))
    found = facts_of_teeth(pair, 1)
    x, y = tooth_outline(pair, 1)
    tip, root = math.atan2(x[-1], y[-1]), math.atan2(x[0], y[0])
    over, under = np.linspace(tip, 0, 50), np.linspace(0, root, 50)
    outer, inner = math.hypot(x[-1], y[-1]), math.hypot(x[0], y[0])
    assert inner == pytest.approx(_ROOT)
    around_x = np.concatenate([x, outer * np.sin(over), inner * np.sin(under)])
    around_y = np.concatenate([y, outer * np.cos(over), inner * np.cos(under)])
    area = -np.trapezoid(around_x, around_y)
    assert found.mass == pytest.approx(24 * 2 * abs(area) * 8000.0 * 10e-3, rel=1e-4)
    middle = math.sqrt(found.polar_inertia / found.mass)
    assert _ROOT < middle < 0.5 * (inner + outer)
    assert found.root_thickness == pytest.approx(2 * root * inner)


# --- Bodies


@pytest.mark.slow
def test_a_rigidified_body_has_its_mass_and_not_its_frequencies(write):
    """Frequencies grow with the root of Young's modulus; the material of the gear stays."""
    path = write(_PAIR + _BODY)
    plain, stiff = _built(path), _built(path, "wheel.body.young_GPa=20000")
    assert stiff.key != plain.key
    assert stiff.health["mass_kg"] == pytest.approx(plain.health["mass_kg"], rel=1e-12)
    np.testing.assert_allclose(
        stiff.health["free_frequency_Hz"],
        10.0 * np.asarray(plain.health["free_frequency_Hz"]),
        rtol=1e-7,
    )
    bare = _built(path, "wheel.body.teeth_mass=false")
    assert bare.health["mass_kg"] < plain.health["mass_kg"]
    # A name is none of a body's business; what it is made from is.
    assert _built(path, "name=other", "pair.torque_pinion_Nm=7").from_cache


def test_a_summary_is_of_its_own_scene_and_leaves_the_body_as_it_is(write):
    """With a sweep the summary tells growth at its highest speed too; the file does not change."""
    path = write(_PAIR + _BODY)
    _built(path)
    changes = ("name=other", "sweep.pinion_speed_rad_s=[720.0]")
    found = _built(path, *changes)
    before = content_hash(found.body)
    swept = read_scene(path, changes)
    summary = body_summary(found, fastest_of(swept.sweep, swept.gears, "wheel"))
    assert summary["from_cache"]
    assert summary["name"] == found.body.name == "other-wheel"
    growth = "centrifugal_growth_um_at_rad_s"
    assert summary[growth]["600"] == pytest.approx(0.36 * found.health[growth]["1000"])
    assert content_hash(found.body) == before


def test_columns_of_a_body_that_does_not_repeat_count_as_memory(write, tmp_path, monkeypatch):
    full = full_of(_plan(write(_PAIR + _BODY)), Steps(lambda step: None))
    matrices = 8 * 8 * (3 * len(full.rim) + 6) ** 2
    columns = 8 * 3 * full.points * 3 * len(full.rim)
    (tmp_path / "limit").write_text(str(matrices + 3 * columns // 4))
    monkeypatch.setattr(_body_build, "_LIMITS", (tmp_path / "none", tmp_path / "limit"))
    _body_build._check_memory(full, largest_rotation(full))
    with pytest.raises(BodyError, match="1 equal sectors, takes some"):
        _body_build._check_memory(full, full_turn(full.points))
    (tmp_path / "limit").write_text("max\n")
    _body_build._check_memory(full, full_turn(full.points))


def test_a_lost_view_is_made_again(write):
    path = write(_PAIR + _BODY)
    first = _built(path)
    assert first.view is not None
    folder = view_folder()
    assert folder is not None
    (file,) = folder.glob("*.npz")
    file.write_bytes(b"spoilt")
    second = _built(path)
    assert second.from_cache
    assert second.view is not None
    # The two modes of a pair may turn together; what they hold of each place is the same.
    pairs = [np.sum(view.shapes[:2] ** 2, axis=(0, 2)) for view in (first.view, second.view)]
    np.testing.assert_allclose(*pairs, rtol=1e-3, atol=1e-6)
    assert set(second.view.sets) == set(first.view.sets)


def test_a_grid_of_one_s_own_is_the_body_it_was_written_from(write, tmp_path):
    """In millimetres, with the contract's `interface` for the name of the rim's set."""
    path = write(_PAIR + _BODY)
    drawn = _built(path)
    grid = _grid(drawn.plan)
    write_vtu(tmp_path / "wheel.vtu", grid)
    own = 'grid = "wheel.vtu"\ninterface = "rim"\nseats = ["seat:bore"]\ngrid_unit_mm = 1000\n'
    text = "\n".join(line for line in _BODY.splitlines() if "web =" not in line)
    read = _built(write(_PAIR + text.replace("modes", own + "modes", 1)))
    assert read.body.seats == ("gear",)
    np.testing.assert_allclose(
        read.health["free_frequency_Hz"], drawn.health["free_frequency_Hz"], rtol=1e-6
    )
    lost = text.replace("modes", own.replace("wheel.vtu", "none.vtu") + "modes", 1)
    with pytest.raises(InputError, match=r"none\.vtu cannot be read"):
        _built(write(_PAIR + lost))
    metres = text.replace("modes", own.replace("1000", "1") + "modes", 1)
    with pytest.raises(InputError, match=r"`wheel\.body\.grid_unit_mm`.* 1000 for one in metres"):
        _built(write(_PAIR + metres))


@pytest.mark.slow
def test_equal_inputs_give_equal_bodies(write, monkeypatch):
    path = write(_PAIR + _BODY)
    monkeypatch.setenv("JAXGEAR_CACHE", "off")
    first, second = (_built(path) for _ in range(2))
    assert not first.from_cache
    assert not second.from_cache
    assert content_hash(first.body) == content_hash(second.body)


@pytest.mark.parametrize(
    ("top", "line"), [("ring.inp", "*INCLUDE, INPUT={}"), ("ring.bdf", "INCLUDE '{}'")]
)
def test_the_cache_knows_the_files_that_a_grid_includes(write, tmp_path, top, line):
    own = f'kind = "condensed"\ngrid = "{top}"\nrim_set = "rim"\nseats = ["bore"]\n'
    plan = _plan(write(_PAIR + "[wheel.body]\n" + own))
    (tmp_path / top).write_text(line.format("nodes.txt"))
    keys = []
    for text in ("1, 0, 0, 0", "1, 0, 0, 1", "1, 0, 0, 0"):
        (tmp_path / "nodes.txt").write_text(text)
        keys.append(key_of(_inputs(plan)))
    assert keys[0] == keys[2] != keys[1]


def test_a_middle_of_the_face_that_is_missing_is_asked_for_by_its_key(write, tmp_path):
    body: ReducedBody = _built(write(_PAIR + _BODY)).body
    arrays = {name: getattr(body, name) for name in ("stiffness", "mass")}
    places = {
        name: getattr(body, name) + np.array([0, 0, 0.04]) for name in ("rim_nodes", "seat_points")
    }
    np.savez(tmp_path / "wheel.npz", **arrays, **places)
    text = (
        '[wheel.body]\nkind = "condensed"\nsuperelement = "wheel.npz"\n'
        'superelement_units = "m-kg-s"\n'
    )
    says = r"`wheel\.body\.superelement_mid_face_mm` is 40 mm in the files, not 0 mm"
    with pytest.raises(InputError, match=says):
        _built(write(_PAIR + text))


def test_matrices_from_elsewhere_are_the_body_they_came_from(write, tmp_path):
    drawn = _built(write(_PAIR + _BODY))
    body: ReducedBody = drawn.body
    fields = ("stiffness", "mass", "rim_nodes", "rim_faces", "seat_points", "centrifugal_load")
    arrays = {name: getattr(body, name) for name in fields}
    np.savez(tmp_path / "wheel.npz", seats=np.asarray(body.seats), **arrays)
    text = (
        '[wheel.body]\nkind = "condensed"\nsuperelement = "wheel.npz"\n'
        'superelement_units = "m-kg-s"\nmodes = 3\nyoung_GPa = 100\nrotating_terms = true\n'
    )
    path = write(_PAIR + text)
    found, scene = _built(path), read_scene(path)
    said = "\n".join(body_remarks(scene.wheel, found))
    for key in ("modes", "young_GPa", "rotating_terms"):
        assert f"wheel.body.{key} does nothing: the matrices" in said
    assert said.count("does nothing") == 3
    summary = body_summary(found, 0.0)
    assert "young_GPa" not in summary
    assert not [line for line in report_lines(summary) if "Young" in line]
    assert found.view is None
    assert found.body.seats == ("gear",)
    wide = dataclasses.replace(found.plan, face_width=2.0 * found.plan.face_width)
    small = dataclasses.replace(found.plan, root_radius=0.9 * found.plan.root_radius)
    for plan, says in ((wide, r"width of `wheel\.face_width_mm`"), (small, "diameter of the root")):
        with pytest.raises(InputError, match=says):
            built_body(plan, lambda step: None)
    np.testing.assert_allclose(found.body.stiffness, body.stiffness, rtol=1e-9, atol=1e-3)
    frequency = found.health["free_frequency_Hz"]
    count = min(len(frequency), 12)
    np.testing.assert_allclose(
        frequency[:count], drawn.health["free_frequency_Hz"][:count], rtol=1e-6
    )
    assert [each.name for each in plot.pictures(condense(scene).datasets)] == ["wheel_families"]


# --- Pictures


def _square(z, colour):
    """A face of side 2 at a height, and its colour."""
    x = np.array([-1, 1, 1, -1, 0, 1, 0, -1.0])
    y = np.array([-1, -1, 1, 1, -1, 0, 1, 0.0])
    return np.stack([x, y, np.full(8, z)], axis=1), np.tile(to_rgb(colour), (8, 1))


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_is_nearer_is_seen(order):
    faces = [_square(0.0, "red"), _square(1.0, "blue")]
    nodes = np.concatenate([faces[i][0] for i in order])
    colours = np.stack([faces[i][1] for i in order])
    picture = render(nodes, np.arange(16).reshape(2, 8), colours, flat=np.ones(2, bool), pixels=60)
    left, right, bottom, top = picture.extent

    def colour_at(point):
        across, up = (np.asarray(point) @ frame())[:2]
        rows, columns = picture.image.shape[:2]
        column = int((across - left) / (right - left) * columns)
        return picture.image[int((top - up) / (top - bottom) * rows), column]

    np.testing.assert_allclose(colour_at([0.0, 0.0, 1.0]), [0, 0, 1, 1], atol=1e-6)
    # The lower one shows where it reaches out from under the upper one, towards the viewer.
    np.testing.assert_allclose(colour_at([0.9, 0.9, 0.0]), [1, 0, 0, 1], atol=1e-6)
    assert picture.image[0, 0, 3] == 0.0
    # Seen from behind there is nothing.
    hidden = render(nodes, np.arange(16).reshape(2, 8)[:, [3, 2, 1, 0, 6, 5, 4, 7]], colours)
    assert hidden.image[..., 3].max() == 0.0


def test_the_section_is_that_of_the_drawing(write):
    pictures = plot.pictures({"wheel_body": body_dataset(_built(write(_PAIR + _BODY)))})
    (columns,) = (each.table for each in pictures if each.name == "wheel_grid")
    element, r, z = (columns[name] for name in ("element", "r_mm", "z_mm"))
    area = sum(_area(r[element == each], z[element == each]) for each in np.unique(element))
    expected = 5 * 10 + 11 * 4 + (1e3 * _ROOT - 26) * 10
    assert area == pytest.approx(expected, rel=1e-9)


def _area(x, y):
    return abs(np.sum(x * np.roll(y, 1) - y * np.roll(x, 1))) / 2


def test_pairs_are_one_and_families_follow_the_nodal_diameter(write):
    found = _built(write(_PAIR + _BODY))
    assert found.view is not None
    modes = {
        "free_frequency_Hz": [100, 100.01, 150, 180, 190, 300, 300.001, 400.0],
        "nodal_diameter": [2, 2, 0, 3, 3, 2, 2, 0],
        "nodal_circle": [0, 0, 1, 0, 0, 1, 1, 2],
        "nodal_diameter_share": [1, 1, 1, 1, 1, 1, 1, 0.4],
        "kind": ("axial",) * 8,
    }
    body = dataclasses.replace(found.body, facts={**found.body.facts, "health": modes})
    view = dataclasses.replace(found.view, shapes=found.view.shapes[:8])
    dataset = body_dataset(dataclasses.replace(found, body=body, view=view))
    # Holes part the pair of three nodal diameters: both are drawn, in one family.
    assert dataset["shown"].values.tolist() == [1, 3, 4, 5, 6, 8]
    assert dataset["family"].values.tolist() == [1, 1, 1, 1, 1, 2, 2, 2]
    assert dataset["label"].values[2] == "150 Hz, axial\n0 nodal diameters, 1 circle"
