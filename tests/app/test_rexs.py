"""Stages of REXS files as scenes and back: numbers by hand, what lacks, files that are damaged."""

import json
import math
import random
import re
import xml.etree.ElementTree as ET
import zipfile

import pytest
from helpers import quick

from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear._cli._parser import ready_names
from jaxgear.scene._rexs import scene_of_rexs
from jaxgear.scene._rexs_out import rexs_of_scene
from jaxgear.scene._scene import example_scene, read_scene
from jaxgear.scene._schema import general
from jaxgear.scene._sizes import of_material


def _component(identifier, kind, **attributes):
    lines = [
        f'<attribute id="{name}" unit="{unit}">{value}</attribute>'
        for name, (value, unit) in attributes.items()
    ]
    return f'<component id="{identifier}" type="{kind}">{"".join(lines)}</component>'


def _relation(kind, **roles):
    refs = [f'<ref role="{role.rstrip("_")}" id="{of}"/>' for role, of in roles.items()]
    return f'<relation type="{kind}">{"".join(refs)}</relation>'


def _gear(identifier, teeth, width, at):
    return _component(
        identifier,
        "cylindrical_gear",
        number_of_teeth=(teeth, "none"),
        normal_module=(2.0, "mm"),
        helix_angle_reference_diameter=(0.0, "°"),
        face_width=(width, "mm"),
        u_coordinate_on_shaft=(at, "mm"),
    )


def _section(identifier, at, length, begin, end):
    return _component(
        identifier,
        "shaft_section",
        u_coordinate_on_shaft=(at, "mm"),
        length=(length, "mm"),
        outer_diameter_begin=(begin, "mm"),
        outer_diameter_end=(end, "mm"),
        inner_diameter_begin=(0.0, "mm"),
        inner_diameter_end=(0.0, "mm"),
    )


def _bearing(identifier, at, radial="5e8"):
    return _component(
        identifier,
        "concept_bearing",
        u_coordinate_on_shaft_inner_side=(at, "mm"),
        radial_stiffness=(radial, "N / m"),
        axial_stiffness=("2e5", "N / mm"),
        bending_stiffness=("3e7", "N mm / rad"),
    )


def _file(version="1.4", flank="cylindrical_gear_flank"):
    """Two stages in a row, 20 to 40 and 25 to 50 teeth, of which the first is driven by 30 N m."""
    components = [
        _component("1", "gear_unit"),
        _component("2", "cylindrical_stage", center_distance=(60.3, "mm")),
        _component("3", "cylindrical_stage"),
        _gear("20", 20, 16.0, 42.0),
        _gear("40", 40, 15.0, 30.0),
        _gear("25", 25, 16.0, 60.0),
        _gear("50", 50, 15.0, 20.0),
        _component(
            "21",
            flank,
            normal_pressure_angle=(20.0, "°"),
            addendum_modification_coefficient=(0.1, "none"),
        ),
        *(_component(each, "shaft") for each in ("s1", "s2", "s3")),
        _section("a1", 10.0, 40.0, 24.0, 24.0),
        _section("a2", 50.0, 50.0, 24.0, 28.0),
        _section("b1", 0.0, 100.0, 30.0, 30.0),
        _section("c1", 0.0, 60.0, 40.0, 40.0),
        _bearing("w1", 15.0),
        _bearing("w2", 95.0, radial="1e23"),
        _component(
            "m1",
            "material",
            elastic_modulus=("210000", "N / mm^2"),
            poisson_ratio=("0.3", "none"),
            density=("7.83", "kg / dm^3"),
        ),
        _bearing("w3", 5.0),
        _bearing("w4", 95.0),
        _bearing("w5", 5.0),
        _bearing("w6", 55.0),
        _component("l1", "external_load", torque_around_u_axis=(-30.0, "N m")),
        _component(
            "t1",
            "tip_relief",
            tip_relief_depth=("0.0123", "mm"),
            tip_relief_datum_diameter=("43.2", "mm"),
            shape_of_relief=("circular", "none"),
        ),
        _component(
            "c1",
            "helix_crowning",
            helix_crowning_amount_datum_face=("4", "mum"),
            helix_crowning_amount_non_datum_face=("0.006", "mm"),
        ),
        _component("q1", "lubricant"),
    ]
    on = {
        "s1": ("20", "a2", "a1", "l1"),
        "s2": ("40", "25", "b1"),
        "s3": ("50", "c1"),
    }
    sides = {"w1": "s1", "w2": "s1", "w3": "s2", "w4": "s2", "w5": "s3", "w6": "s3"}
    relations = [
        _relation("stage", stage="2", gear_1="20", gear_2="40"),
        _relation("stage", stage="3", gear_1="50", gear_2="25"),
        _relation("flank", gear="20", left="21"),
        *(_relation("reference", origin="21", referenced=each) for each in ("t1", "c1")),
        _relation("reference", origin="20", referenced="m1"),
        *(_relation("assembly", assembly=s, part=p) for s, parts in on.items() for p in parts),
        *(_relation("side", assembly=w, inner_part=s) for w, s in sides.items()),
    ]
    head = '<?xml version="1.0" encoding="UTF-8"?>'
    space = ' xmlns="http://rexs.info"' if version == "2.0" else ""
    inner = f"<relations>{''.join(relations)}</relations>"
    inner += f"<components>{''.join(components)}</components>"
    return f'{head}<model version="{version}" applicationId="mine"{space}>{inner}</model>'


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "box.rexs"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(
    ("version", "flank"),
    [
        ("1.0", "flank_geometry"),
        ("1.4", "cylindrical_gear_flank"),
        ("2.0", "cylindrical_gear_flank"),
    ],
)
def test_a_stage_becomes_a_scene(write, version, flank):
    """Every number by hand: places from the shaft's left end, a cone's mean, units."""
    keys, remarks = scene_of_rexs(write(_file(version, flank)), "2")
    assert keys["pair"] == {
        "module_mm": 2.0,
        "pressure_angle_deg": 20.0,
        "helix_angle_deg": 0.0,
        "torque_pinion_Nm": 30.0,
        "centre_distance_mm": 60.3,
    }
    pinion, shaft = keys["pinion"], keys["pinion"]["shaft"]
    assert (pinion["teeth"], pinion["face_width_mm"], pinion["profile_shift"]) == (20, 16.0, 0.1)
    assert shaft["gear_at_mm"] == 42.0 + 8.0 - 10.0
    assert [each["outer_mm"] for each in shaft["segments"]] == [24.0, 26.0]
    first, second = shaft["bearings"]
    assert first == {"at_mm": 5.0, "radial_N_m": 5e8, "axial_N_m": 2e8, "tilt_Nm_rad": 3e4}
    assert second["radial_N_m"] == 1e9
    told = "\n".join(remarks)
    for words in ("radial_N_m = 1e+09", "conical", "Left out: lubricant", "60.3 mm", "circular"):
        assert words in told


def test_flanks_and_materials_become_keys(write):
    """A diameter becomes a fraction of the path, by r_a, r_b and a of 20 to 40 teeth."""
    keys, remarks = scene_of_rexs(write(_file()), "2")
    roll = lambda radius, base: math.sqrt(radius**2 - (base * math.cos(math.radians(20.0))) ** 2)
    working = math.acos(60.0 / 60.3 * math.cos(math.radians(20.0)))
    path = roll(22.2, 20.0) + roll(42.0, 40.0) - 60.3 * math.sin(working)
    flank = keys["flank"]["pinion"]
    extent = (roll(22.2, 20.0) - roll(21.6, 20.0)) / path
    assert flank["tip_relief"] == {
        "depth_um": 12.3,
        "extent": pytest.approx(extent, rel=1e-12),
        "shape": "parabolic",
    }
    assert flank["crowning_um"] == 5.0
    assert any("4 and 6 um are taken as their mean" in each for each in remarks)
    assert keys["pinion"]["material"] == {
        "young_GPa": 210.0,
        "poisson": 0.3,
        "density_kg_m3": 7830.0,
    }
    assert "material" not in keys["wheel"]


def _json(text):
    """The same model as JSON, where the value of an attribute is under the name of its type."""
    root = ET.fromstring(text)
    value = lambda x: (
        {"floating_point": float(x.text)} if x.text[-1].isdigit() else {"enum": x.text}
    )
    parts = [
        {
            "id": x.get("id"),
            "type": x.get("type"),
            "attributes": [{"id": y.get("id"), "unit": y.get("unit"), **value(y)} for y in x],
        }
        for x in root.iter("component")
    ]
    relations = [
        {"id": 1, "type": x.get("type"), "refs": [dict(y.attrib) for y in x]}
        for x in root.iter("relation")
    ]
    model = {"version": "1.4", "applicationId": "mine", "components": parts}
    return json.dumps({"model": {**model, "relations": relations}})


def test_json_and_archives_are_the_same_stage(write):
    """By what is in the file, whatever its name; another load case gives another torque."""
    path = write(_file())
    keys, remarks = scene_of_rexs(path, "2")
    path.write_text(_json(_file()), encoding="utf-8")
    assert scene_of_rexs(path, "2") == (keys, remarks)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("../notes.txt", "not to be unpacked")
        archive.writestr("../../box.rexs", _file())
    assert scene_of_rexs(path, "2") == (keys, remarks)
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def _cases(text):
    torque = '<attribute id="torque_around_u_axis" unit="N m">{}</attribute>'
    load = f'<component id="l1" type="external_load">{torque}</component>'
    speed = '<attribute id="rotational_speed" unit="1 / min">-600</attribute>'
    shaft = f'<component id="s2" type="shaft">{speed}</component>'
    cases = f'<load_case id="1">{load}</load_case><load_case id="2">{load}{shaft}</load_case>'
    spectrum = f'<load_spectrum id="1">{cases.replace("{}", "40", 1).replace("{}", "-50")}'
    return text.replace("</model>", f"{spectrum}</load_spectrum></model>")


def test_load_cases_are_chosen(write):
    """The first unless another is named; 600 rpm of 40 teeth are 1200 of 20."""
    path = write(_cases(_file()))
    keys, remarks = scene_of_rexs(path, "2")
    assert keys["pair"]["torque_pinion_Nm"] == 40.0
    assert "Load case 1 is taken, of 1, 2" in remarks[0]
    pair = scene_of_rexs(path, "2", "2").keys["pair"]
    assert (pair["torque_pinion_Nm"], pair["speed_rpm"]) == (50.0, 1200.0)
    with pytest.raises(InputError, match="there is no load case 3; there are: 1, 2"):
        scene_of_rexs(path, "2", "3")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"PK\x03\x04 and no more", "the archive cannot be read"),
        (b'{"model": ', "no JSON"),
        (b'{"model": [1]}', "it has no model"),
        (b'{"model": {"relations": 3, "components": [{"attributes": [{}]}, 7]}}', "no stage"),
        (b"{" + b'"a":[' * 100_000, "no JSON"),
        (b'<?xml version="1.0" encoding="none"?><model/>', "no XML"),
        (b"\xff\xfe\x00", "no XML"),
        (b"", "no XML"),
        (b" " * 64_000_001, "more than 64 MB"),
    ],
)
def test_other_files_are_refused(tmp_path, content, words):
    path = tmp_path / "box.rexsj"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words):
        scene_of_rexs(path)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"a.txt": b""}, "has no .rexs or .rexsj file"),
        ({"a.rexs": b" " * 70_000_000}, "more than 64 MB"),
        ({f"{number}.txt": b"" for number in range(1001)}, "has 1001 entries"),
    ],
)
def test_archives_that_grow_are_refused(tmp_path, entries, words):
    """70 MB in an archive of 70 kB are not read to their end."""
    path = tmp_path / "box.rexsz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    with pytest.raises(InputError, match=words):
        scene_of_rexs(path)


_SCENE = """
schema = 1
material = { young_GPa = 205.7, poisson = 0.29, density_kg_m3 = 7831.3 }
[pair]
module_mm = 2.3
helix_angle_deg = 14.73
torque_pinion_Nm = 51.37
speed_rpm = 1234.5
centre_distance_mm = 108.3
[pinion]
teeth = 31
profile_shift = 0.217
fillet_radius_coeff = 0.3
face_width_mm = 21.7
bore_mm = 20.3
[pinion.shaft]
gear_at_mm = 41.1
torque_at_mm = 0.1
segments = [{length_mm=33.3, outer_mm=30.1, inner_mm=5.7}, {length_mm=47.1, outer_mm=31.7}]
bearings = [
    { at_mm = 3.3, radial_N_m = 3.7e8, axial_N_m = 1.3e7 },
    { at_mm = 77.7, radial_N_m = 1.1e9, tilt_Nm_rad = 1.7e4 },
]
[wheel]
teeth = 59
profile_shift = 0.117
tip_diameter_mm = 144.55
face_width_mm = 20.1
material = { young_GPa = 201.1 }
[flank.pinion]
tip_relief = { depth_um = 17.3, extent = 0.237, shape = "parabolic" }
root_relief = { depth_um = 3.1, extent = 0.11 }
crowning_um = 4.7
end_relief = { side = "right", depth_um = 7.9, extent = 0.13 }
[flank.wheel]
helix_slope_um = -3.3
profile_slope_um = 1.9
profile_crowning_um = 2.3
bias_um = 3.0
end_relief = { side = "both", depth_um = 7.7, extent = 0.17, shape = "parabolic" }
[mesh]
slices = 10
"""


def test_impossible_distances_and_bare_shafts_are_told(write):
    text = _file().replace(
        'unit="mm">60.3</attribute></component>', 'unit="mm">600</attribute></component>'
    )
    keys, remarks = scene_of_rexs(write(text.replace('"shaft_section"', '"none"')), "2")
    assert "centre_distance_mm" not in keys["pair"]
    assert "shaft" not in keys["pinion"]
    told = "\n".join(remarks)
    assert "The centre distance of 600 mm does not fit" in told
    assert "wheel: its shaft has no sections in the file, so the gear only turns" in told


def _there_and_back(path, form, told, changes=()):
    """Export and import by command: the scene, what came back, and the keys told as left out."""
    out = path.parent / f"out_{form}"
    sets = [f"--set={key}={value}" for key, value in changes]
    assert main(["export", str(path), "--form", form, "--out", str(out), *sets]) == 0
    left = re.search(r"Left out: (.*)\.", told.readouterr().err)
    scene = read_scene(path, [f"{key}={value}" for key, value in changes])
    file = out / f"{scene.name}.{form}"
    assert main(["import", str(file), "--out", str(out)]) == 0
    back = read_scene(out / f"{scene.name}.toml")
    return scene, back, set(left[1].split(", ")) if left else set()


def _assert_all_is_back(scene, back, lost):
    """What was given comes back to the last digit, but for what was told to be left out."""
    bodies = [key.removesuffix("kind") for key in lost if key.endswith(".body.kind")]
    for key in scene.given & scene.fixed.keys():
        if key.startswith(tuple(bodies)):
            continue
        if general(key) not in lost and ".material" not in f".{key}":
            assert back.value(key) == scene.value(key), key
    for gear in ("pinion", "wheel"):
        for key in ("young_GPa", "poisson", "density_kg_m3"):
            assert of_material(back, gear, key) == of_material(scene, gear, key)


def test_a_scene_comes_back_as_it_was(tmp_path, capsys):
    path = tmp_path / "own.toml"
    path.write_text(_SCENE, encoding="utf-8")
    scene, back, lost = _there_and_back(path, "rexs", capsys)
    assert lost == {"flank.wheel.bias_um", "mesh.slices"}
    _assert_all_is_back(scene, back, lost)


_FLANKS = (
    ("flank.pinion.tip_relief.depth_um", 12.3),
    ("flank.pinion.tip_relief.extent", 0.1234567890123457),
    ("flank.wheel.tip_relief.extent", 0.3333333333333333),
    ("flank.wheel.crowning_um", 3.7),
    ("flank.wheel.end_relief.extent", 0.17),
)


@pytest.mark.parametrize("form", quick(1, ["rexs", "rexsj", "rexsz"]))
@pytest.mark.parametrize("name", quick(3, ready_names()))
def test_ready_scenes_come_back(tmp_path, capsys, name, form):
    """All of a pair, its flanks and shafts but for their loads; of reliefs without depth their
    extents too."""
    assert main(["init", name, "--out", str(tmp_path)]) == 0
    scene, back, lost = _there_and_back(tmp_path / f"{name}.toml", form, capsys, _FLANKS)
    gears = r"(pair|material|(pinion|wheel)\.(?!body|shaft\.loads)|flank)"
    assert not [key for key in lost if re.match(gears, key)]
    tables = {key for key in back.given - back.fixed.keys() if key.startswith("flank.")}
    assert tables <= scene.given
    assert "centre_distance_mm" not in {key.rpartition(".")[2] for key in back.given}
    _assert_all_is_back(scene, back, lost)


def test_names_of_version_2_are_known(tmp_path):
    """What 2.0 changed of what is read: the name of the rack's rounding, the unit of a modulus."""
    text, _ = rexs_of_scene(example_scene("accessory").replace({"wheel.fillet_radius_coeff": 0.31}))
    new = {
        'version="1.5"': 'version="2.0"',
        "tip_radius_factor": "tip_corner_radius_factor_reference_profile",
        "N / mm^2": "MPa",
    }
    for was, now in new.items():
        assert was in text
        text = text.replace(was, now)
    path = tmp_path / "new.rexs"
    path.write_text(text, encoding="utf-8")
    keys, _ = scene_of_rexs(path)
    assert keys["wheel"]["fillet_radius_coeff"] == 0.31
    assert keys["material"]["young_GPa"] == example_scene("accessory").material.young_GPa


def test_json_has_types_and_the_digits_of_the_scene():
    scene = example_scene("accessory").replace({"pair.torque_pinion_Nm": 51.370000000000005})
    text, _ = rexs_of_scene(scene, as_json=True)
    model = json.loads(text, parse_float=str)["model"]
    gear, load = (
        {x["id"]: x for x in each["attributes"]}
        for kind in ("cylindrical_gear", "external_load")
        for each in [next(x for x in model["components"] if x["type"] == kind)]
    )
    assert gear["number_of_teeth"] == {"id": "number_of_teeth", "unit": "none", "integer": 45}
    assert gear["normal_module"]["floating_point"] == "1.5"
    assert gear["datum_face_orientation"]["enum"] == "negative"
    assert load["torque_around_u_axis"]["floating_point"] == "51.370000000000005"
    assert load["transmits_torque"]["boolean"] is True
    known = {x["id"]: x["type"] for x in model["components"]}
    refs = [ref for each in model["relations"] for ref in each["refs"]]
    assert all(known[ref["id"]] == ref["hint"] for ref in refs)


def test_torque_goes_through_the_stages(write):
    """30 N m on 20 teeth are 60 on 40, which are on the shaft of the pinion of the next stage."""
    keys, _ = scene_of_rexs(write(_file()), "3")
    assert (keys["pinion"]["teeth"], keys["wheel"]["teeth"]) == (25, 50)
    assert keys["pair"]["torque_pinion_Nm"] == pytest.approx(60.0)


def test_command_writes_a_scene_that_reads(write, capsys):
    path = write(_file())
    out = path.with_name("mine.toml")
    assert main(["import", str(path), "--stage", "2", "--out", str(out)]) == 0
    output = capsys.readouterr()
    assert output.out.strip() == str(out)
    assert "Left out: lubricant" in output.err
    scene = read_scene(out)
    assert scene.value("pinion.shaft.bearings[0].radial_N_m") == 5e8
    assert main(["import", str(path), "--stage", "2", "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "stage", "words"),
    [
        (("", ""), "", r"name one of its stages with --stage: 2 \(20 and 40 teeth\), 3"),
        (("", ""), "7", "name one of its stages"),
        (('type="stage"', 'type="none"'), "2", "no stage of two external"),
        (('id="number_of_teeth"', 'id="teeth"'), "2", "number_of_teeth is missing"),
        ((">2.0<", ">two<"), "2", "normal_module must be a number in a unit"),
        ((">2.0<", ">inf<"), "2", "must be finite"),
        (('unit="mm">2.0', 'unit="cubit">2.0'), "2", "got 2.0 in cubit"),
        (('type="assembly"', 'type="none"'), "2", "is on no shaft"),
        (("<model", "<box"), "2", "no XML"),
        (('<?xml version="1.0" encoding="UTF-8"?>', "<!DOCTYPE model>"), "2", "no DOCTYPE"),
    ],
)
def test_what_is_no_stage_is_refused(write, change, stage, words):
    with pytest.raises(InputError, match=words):
        scene_of_rexs(write(_file().replace(*change)), stage)


@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_archives_are_answered_or_refused(write, count):
    """Bytes changed, or a piece cut out, which moves all places that an archive tells."""
    draw = random.Random(0)
    path = write("")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("box.rexs", _file())
    whole = path.read_bytes()
    reasons = []
    for _ in range(count):
        at = draw.randrange(len(whole))
        new = whole[:at] + draw.randbytes(1) + whole[at + draw.choice([1, 1, 40, 400]) :]
        path.write_bytes(new)
        try:
            scene_of_rexs(path, "2")
        except InputError as error:
            reasons.append(str(error))
    assert reasons
    assert all(each.startswith(str(path)) for each in reasons)


@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_files_are_answered_or_refused(write, count):
    """A sign changed, a piece cut out: a stage or a reason, and no other error."""
    draw = random.Random(0)
    texts = [_file(), _json(_file()), _cases(_file())]
    refused = 0
    for number in range(count):
        text = texts[number % len(texts)]
        at = draw.randrange(len(text))
        new = text[:at] + draw.choice("0x<>\"'&[{ ") + text[at + draw.choice([0, 1, 1, 40]) :]
        try:
            scene_of_rexs(write(new), "2")
        except InputError:
            refused += 1
    assert 0 < refused < count
