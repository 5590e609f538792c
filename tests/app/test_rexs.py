"""Stages of REXS files as scenes: every number by hand, what lacks, and files that are damaged."""

import random

import pytest

from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear.scene._rexs import scene_of_rexs
from jaxgear.scene._scene import read_scene


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
        _component("2", "cylindrical_stage", center_distance=(60.0, "mm")),
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
        _bearing("w3", 5.0),
        _bearing("w4", 95.0),
        _bearing("w5", 5.0),
        _bearing("w6", 55.0),
        _component("l1", "external_load", torque_around_u_axis=(-30.0, "N m")),
        _component("t1", "tip_relief"),
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
    }
    pinion, shaft = keys["pinion"], keys["pinion"]["shaft"]
    assert (pinion["teeth"], pinion["face_width_mm"], pinion["profile_shift"]) == (20, 16.0, 0.1)
    assert shaft["gear_at_mm"] == 42.0 + 8.0 - 10.0
    assert [each["outer_mm"] for each in shaft["segments"]] == [24.0, 26.0]
    first, second = shaft["bearings"]
    assert first == {"at_mm": 5.0, "radial_N_m": 5e8, "axial_N_m": 2e8, "tilt_Nm_rad": 3e4}
    assert second["radial_N_m"] == 1e9
    told = "\n".join(remarks)
    for words in ("radial_N_m = 1e+09", "conical", "Left out: tip_relief", "60 mm"):
        assert words in told


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
    assert "Left out: tip_relief" in output.err
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
        (('type="shaft_section"', 'type="none"'), "2", "shaft has no sections"),
        (("<model", "<box"), "2", "no XML"),
        (('<?xml version="1.0" encoding="UTF-8"?>', "<!DOCTYPE model>"), "2", "no DOCTYPE"),
    ],
)
def test_what_is_no_stage_is_refused(write, change, stage, words):
    with pytest.raises(InputError, match=words):
        scene_of_rexs(write(_file().replace(*change)), stage)


def test_damaged_files_are_answered_or_refused(write):
    """A sign changed, a piece cut out: a stage or a reason, and no other error."""
    draw, text = random.Random(0), _file()
    refused = 0
    for _ in range(300):
        at = draw.randrange(len(text))
        new = text[:at] + draw.choice("0x<>\"'& ") + text[at + draw.choice([0, 1, 1, 40]) :]
        try:
            scene_of_rexs(write(new), "2")
        except InputError:
            refused += 1
    assert 0 < refused < 300
