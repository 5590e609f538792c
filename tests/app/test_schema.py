import dataclasses
import math
import re

import pytest

from jaxgear.scene import _schema
from jaxgear.scene._key import Key, Presence, show
from jaxgear.scene._schema import KEYS

_NUMBER = Key("pair.gap_um", "float", "a gap", above=0.0, at_most=2.0, remedy="Mind the gap")
_CHOICE = Key("pair.law", "text", "a law", choices=("exact", "smooth"))
_LIST = Key("pair.loads_N", "floats", "loads", above=0.0)


@pytest.mark.parametrize(
    "path", [p for p, k in KEYS.items() if not isinstance(k.default, Presence)]
)
def test_every_default_is_allowed(path):
    key = KEYS[path]
    assert key.read(key.default) == key.default
    assert type(key.read(key.default)) is type(key.default)


def test_every_key_is_documented_in_one_line():
    assert all(key.doc and "\n" not in key.doc for key in KEYS.values())


def test_both_gears_have_the_same_keys():
    pinion = {path for path in KEYS if re.search(r"\bpinion\b", path)}
    wheel = {path for path in KEYS if re.search(r"\bwheel\b", path)}
    assert {re.sub(r"\bwheel\b", "pinion", path) for path in wheel} == pinion
    assert len(pinion) > 50


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("material.young_GPa", "GPa"),
        ("material.density_kg_m3", "kg/m^3"),
        ("pair.helix_angle_deg", "degrees"),
        ("pair.torque_pinion_Nm", "N m"),
        ("pinion.face_width_mm", "mm"),
        ("pinion.support.radial_S_N_m", "N/m"),
        ("pinion.support.tilt_Nm_rad", "N m/rad"),
        ("pinion.body.inertia_kg_m2", "kg m^2"),
        ("pinion.body.mass_kg", "kg"),
        ("wheel.body.web.hub_outer_mm", "mm"),
        ("wheel.body.young_GPa", "GPa"),
        ("pinion.shaft.loads[].force_N", "N"),
        ("wheel.shaft.bearings[].tilt_S_Nm_rad", "N m/rad"),
        ("wheel.shaft.bearings[].radial_T_N_m", "N/m"),
        ("flank.wheel.eccentricity_angle_deg", "degrees"),
        ("mesh.stiffness_N_mm_um", "N/(mm um)"),
        ("map.depth_um.from", "um"),
        ("sweep.pinion_speed_rad_s.to", "rad/s"),
        ("damping.a_R_1_s", "1/s"),
        ("damping.b_R_s", "s"),
        ("optimise.bounds.flank.pinion.crowning_um", "um"),
        ("optimise.bounds.pinion.profile_shift", ""),
        ("optimise.bounds.flank.pinion.pitch_error_um[]", "um"),
        ("sizing.amounts.flank.pinion.tip_relief.depth_um", "um"),
        ("pinion.teeth", ""),
    ],
)
def test_unit_follows_the_key(path, unit):
    assert KEYS[path].unit == unit


@pytest.mark.parametrize("value", [1.0, 2, 2.0, 1e-9])
def test_numbers_are_read_as_floats(value):
    read = _NUMBER.read(value)
    assert read == value
    assert type(read) is float


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (_NUMBER, 0, "got 0, must be a number > 0 and <= 2 [um]. Mind the gap"),
        (_NUMBER, 2.5, "got 2.5, must be a number > 0 and <= 2 [um]. Mind the gap"),
        (_NUMBER, math.nan, "got nan, must be a number > 0 and <= 2 [um]. It must be finite"),
        (_NUMBER, math.inf, "It must be finite"),
        (_NUMBER, 10**400, "It must be finite"),
        (_NUMBER, True, "got true, must be a number"),
        (_NUMBER, "1.5", 'got "1.5", must be a number > 0 and <= 2 [um]. Write 1.5, without the'),
        (_NUMBER, "wide", 'got "wide", must be a number > 0 and <= 2 [um]'),
        (_NUMBER, [1.0], "got [1.0], must be a number"),
        (_NUMBER, {"x": 1}, "got a table, must be a number"),
        (_CHOICE, "smoth", 'got "smoth", must be one of "exact", "smooth", did you mean "smooth"?'),
        (_CHOICE, 3, 'got 3, must be one of "exact", "smooth"'),
        (_LIST, 80, "got 80, must be a list of numbers, each > 0 [N]. Write [80]"),
        (_LIST, [], "got [], must be a list of numbers, each > 0 [N]"),
        (_LIST, [1.0, -2.0], "got [1.0, -2.0], must be a list of numbers, each > 0 [N]"),
        (_LIST, [1.0, "a"], 'got [1.0, "a"], must be a list of numbers'),
        (KEYS["pinion.teeth"], 45.0, "must be an integer >= 5 and <= 10000. Write 45"),
        (KEYS["pinion.teeth"], 2, "got 2, must be an integer >= 5"),
        (KEYS["pinion.teeth"], True, "got true, must be an integer"),
        (KEYS["schema"], 2, "must be an integer equal to 1. This version of jaxgear reads"),
        (KEYS["name"], "../up", "It names a folder: no slashes"),
        (KEYS["name"], "..", "It names a folder: no slashes"),
        (KEYS["name"], "", "It names a folder: no slashes, and not empty"),
        (KEYS["optimise.symmetric"], 1, "got 1, must be true or false"),
        (KEYS["optimise.vary"], "a.b", 'must be a list of texts in quotes. Write ["a.b"]'),
        (
            KEYS["optimise.bounds.pair.module_mm"],
            [1.0],
            "must be a list of 2 numbers, each >= 0.01",
        ),
        (KEYS["sizing.amounts.flank.wheel.crowning_um"], [0, -1], "A depth is material removed"),
        (KEYS["sizing.amounts.flank.wheel.crowning_um"], [], "must be a list of numbers, each >="),
        (KEYS["pinion.shaft.loads[].force_N"], [1.0, 2.0], "must be a list of 3 numbers [N]"),
        (KEYS["pinion.shaft.shear_coeff"], 1.1, "must be a number > 0 and <= 1"),
        (KEYS["pinion.shaft.bearings[].axial_N_m"], -1, "must be a number >= 0 [N/m]. Leave"),
        (KEYS["flank.pinion.accuracy_grade"], 12, "must be a number >= 1 and <= 11. ISO 1328-1"),
        (KEYS["flank.pinion.accuracy_waves"], 0, "must be an integer >= 1"),
        (KEYS["mesh.periods"], 10_001, "must be an integer >= 1 and <= 10000"),
        (KEYS["wheel.body.modes"], 201, "must be an integer >= 0 and <= 200. 0 keeps the rim"),
        (KEYS["wheel.body.web.web_angle_deg"], 75, ">= -60 and <= 60 [degrees]. The key is in deg"),
        (KEYS["wheel.body.fineness.sectors"], 7, "must be an integer >= 8"),
        (KEYS["wheel.body.seat_coupling"], "averagin", 'did you mean "averaging"?'),
        (KEYS["wheel.body.seats"], "LEFT", 'must be a list of texts in quotes. Write ["LEFT"]'),
        (KEYS["mesh.line_load_updates"], 11, "must be an integer >= 0 and <= 10"),
    ],
)
def test_a_bad_value_says_what_is_allowed(key, value, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        key.read(value)


@pytest.mark.parametrize(("path", "value"), [("name", "a b.2"), ("name", "...")])
def test_any_name_of_a_folder_will_do(path, value):
    assert KEYS[path].read(value) == value


def test_an_empty_list_is_taken_where_it_is_the_default():
    assert dataclasses.replace(KEYS["optimise.vary"], default=[]).read([]) == []


def test_only_real_numbers_that_matter_to_statics_are_differentiable():
    real = set(_schema.REAL_KEYS)
    entries = {path for path in real if path.endswith("[]")}
    assert all(KEYS[path].kind == "float" for path in real - entries)
    assert all(KEYS[path.removesuffix("[]")].kind == "floats" for path in entries)
    assert {"pair.module_mm", "wheel.support.tilt_Nm_rad", "flank.wheel.helix_slope_um"} <= real
    assert {"pinion.bore_mm", "wheel.shaft.bearings[].at_mm", "wheel.shaft.gear_at_mm"} <= real
    assert {"pinion.shaft.loads[].force_N[]", "flank.pinion.pitch_error_um[]"} <= entries
    assert not {"pinion.teeth", "damping.mesh", "mesh.periods"} & real


def test_bounds_and_amounts_follow_the_keys_that_they_are_for():
    bounds = {path.removeprefix("optimise.bounds.") for path in KEYS if "optimise.bounds." in path}
    assert bounds == set(_schema.REAL_KEYS)
    sized = {path.removeprefix("sizing.amounts.") for path in KEYS if "sizing.amounts." in path}
    assert sized == {
        path for path in bounds if path.startswith("flank.") and not path.endswith("[]")
    }
    assert len(sized) > 20


@pytest.mark.parametrize(
    ("path", "schema", "entry"),
    [
        ("a.b[0].c_N[12]", "a.b[].c_N[]", ("a.b[0].c_N", 12)),
        ("a.b[0].c", "a.b[].c", ("a.b[0].c", None)),
        ("a.b[00].c[01]", "a.b[00].c[01]", ("a.b[00].c[01]", None)),
        ("a", "a", ("a", None)),
    ],
)
def test_indices_of_a_path(path, schema, entry):
    assert _schema.general(path) == schema
    assert _schema.split_entry(path) == entry


@pytest.mark.parametrize(
    ("path", "meant"),
    [
        ("pair.tork", "pair.torque_pinion_Nm"),
        ("pair.module", "pair.module_mm"),
        ("wheel.tooth", "wheel.teeth"),
        ("naem", "name"),
        ("flank.pinoin.crowning_um", "flank.pinion.crowning_um"),
        ("pair.face_width_mm", "pinion.face_width_mm"),
        ("mesh.zzz", None),
    ],
)
def test_nearest_key(path, meant):
    plain = [known for known in KEYS if not known.startswith("optimise.bounds")]
    assert _schema.nearest(path, plain) == meant


def test_long_values_are_cut():
    shown = show(list(range(1000)))
    assert len(shown) == 80
    assert shown.endswith("...")
