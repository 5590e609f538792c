"""`schema`, `explain` and `doctor`: what an editor is told, and what a user asks of a key."""

import json
import tomllib

import jsonschema
import pytest

from jaxgear._cli import _doctor
from jaxgear._cli._main import main
from jaxgear.scene._json_schema import SCHEMA_FILE, SCHEMA_LINE, json_schema
from jaxgear.scene._scene import READY, read_scene

_CHECK = jsonschema.Draft202012Validator(json_schema())


def test_it_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(json_schema())


@pytest.mark.parametrize("ready", sorted(READY.glob("*.toml")), ids=lambda path: path.stem)
def test_ready_scenes_hold_it(ready):
    assert not list(_CHECK.iter_errors(tomllib.loads(ready.read_text())))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[pair]\ntorke = 1", "'torke' was unexpected"),
        ("[pair]\nmodule_mm = -1.0", "less than the minimum of 0.01"),
        ("[mesh]\nslices = 2.5", "not of type 'integer'"),
        ("[mesh]\ncontact = 'rigid'", "is not one of"),
        ("[[pinion.shaft.bearings]]\nradial_N_m = 1.0", "'at_mm' is a required property"),
        ("[sweep]\npinion_speed_rad_s = 'all'", "is not valid under any"),
        ("[optimise.bounds]\n'pair.module_m' = [1.0, 2.0]", "is not of type 'object'"),
        ("[optimise.bounds]\n'pair.module_mm' = [1.0]", "too short"),
        ("[robust.scatter]\n'pinion.shaft.bearings[0].at_mm' = -1.0", "minimum of 0"),
    ],
)
def test_mistakes_are_marked(text, message):
    """A mistake of each kind, beside the three tables that lack."""
    errors = [each.message for each in _CHECK.iter_errors(tomllib.loads(text))]
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(errors))


@pytest.mark.parametrize(
    "text",
    [
        "pinion_speed_rad_s = [1.0, 2.0]",
        "pinion_speed_rad_s = {from = 1.0, to = 2.0, points = 3}",
    ],
)
def test_a_table_may_stand_for_a_value(text):
    schema = json_schema()["properties"]["sweep"]
    jsonschema.validate(tomllib.loads(text), schema)


def test_keys_are_told_with_units_and_defaults():
    mesh = json_schema()["properties"]["mesh"]["properties"]
    assert mesh["slices"]["default"] == 20
    assert mesh["smoothing_um"]["description"].endswith(
        '[um]. counts where mesh.contact = "smooth"'
    )


def test_init_leads_an_editor_to_it(tmp_path, monkeypatch, capsys):
    """Both kinds of scene name the schema in their first line, and are read as ever."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", "accessory"]) == 0
    assert main(["init", "--pair", "20", "30", "--module", "2"]) == 0
    for name in ("accessory", "pair-20-30"):
        path = tmp_path / f"{name}.toml"
        assert path.read_text().startswith(SCHEMA_LINE)
        read_scene(path)
    capsys.readouterr()
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / SCHEMA_FILE).read_text())


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("wheel.bore_mm", ["[mm]", "derivatives by it", "another condensed body of the wheel"]),
        ("material.young_GPa", ["follows it", "accessory: 206.0"]),
        ("pinion.shaft.bearings[1].at_mm", ["required"]),
        ("pair.module_mm", ["other teeth of finite elements", "power: 2.5"]),
    ],
)
def test_a_key_is_explained(path, words, capsys):
    assert main(["explain", path]) == 0
    told = capsys.readouterr().out
    assert [word for word in words if word not in told] == []


@pytest.mark.parametrize("name", ["K_Hbeta", "face_load_factor"])
def test_a_result_is_told_from_a_key(name, capsys):
    assert main(["explain", name]) == 0
    assert capsys.readouterr().out.startswith("face_load_factor, symbol K_Hbeta: a result")


def test_a_key_that_is_none_is_refused(capsys):
    assert main(["explain", "pair.torque"]) == 2
    assert "Did you mean pair.torque_pinion_Nm?" in capsys.readouterr().err


def test_doctor_finds_this_installation_in_order(capsys):
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out.endswith("all is in order\n")


@pytest.mark.parametrize(("count", "advised"), [(1, False), (8, True)])
def test_doctor_tells_threads(monkeypatch, count, advised):
    """Many are advised against: no fault of the installation."""
    pools = [{"internal_api": "openblas", "num_threads": count}]
    monkeypatch.setattr("threadpoolctl.threadpool_info", lambda: pools)
    found = next(each for each in _doctor.findings() if each.name == "threads")
    assert found.good
    assert found.text.startswith(f"openblas: {count}")
    assert ("one each is faster" in found.text) == advised


def test_doctor_tells_what_is_wrong(tmp_path, monkeypatch, capsys):
    """A library that lacks, a cache that cannot be written to, a solution that is off."""
    monkeypatch.setattr(_doctor, "_LIBRARIES", ["no-such-library"])
    monkeypatch.setattr(_doctor.os, "access", lambda *_: False)
    monkeypatch.setattr(_doctor, "_ROUNDING", 0.0)
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "kept"))
    assert main(["doctor"]) == 1
    told = capsys.readouterr().out
    for words in ("missing: no-such-library", "export JAXGEAR_CACHE=DIR", "not in order"):
        assert words in told
