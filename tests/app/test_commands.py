"""The commands end to end, on a coarse mesh: files, numbers, refusals."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit
import xarray as xr
from helpers import quick
from table_checks import assert_tables

from jaxgear._cli._main import main
from jaxgear.scene._scene import example_scene, read_scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._built import BuiltScene
from jaxgear.study._statics import solve_statics
from jaxgear.study._statics_summary import mounts_summary

_COARSE = ("--set", "mesh.phases=26", "--set", "mesh.slices=4", "--quiet", "--json")


def _run(capsys, *arguments: str) -> tuple[int, dict]:
    code = main(arguments)
    out = capsys.readouterr().out
    return code, json.loads(out) if out else {}


@pytest.mark.end_to_end
@pytest.mark.parametrize("size", quick(1, [[*_COARSE], [*_COARSE[4:]]]), ids=["coarse", "whole"])
def test_run_writes_everything_and_finds_the_optimum(size, accessory, tmp_path, capsys):
    """The slow one is the real thing: 64 phases, 20 slices, as the user gets it."""
    code, summary = _run(capsys, "run", accessory, *size)
    assert code == 0
    folder = tmp_path / "results" / "accessory"
    assert summary == json.loads((folder / "summary.json").read_text())
    # On the default ring; 2.36 um on the thesis's half-planes.
    assert 2.0 < summary["static"]["te_rms_um"] < 2.1
    # 16.3 um by teeth and bodies alone; the thesis, shafts and bearings included, has 19 to 41.
    assert 15.0 < summary["static"]["te_mean_um"] < 41.0
    _assert_bearings_of_the_thesis(summary["static"]["bearings"])
    assert summary["geometry"]["profile_contact_ratio"] == pytest.approx(1.421555, abs=1e-6)
    found = summary["optimise"]
    assert found["converged"]
    assert found["searches"][0]["evaluations"] < 50
    assert found["gradient_evaluations"] < 50 * found["starts"]
    assert found["after"]["te_rms_um"] < 0.3
    assert abs(found["smooth_less_exact"]) < 1e-3 * found["before"]["objective"]
    for name in ("gear_pair", "transmission_error", "mesh_stiffness", "flank_maps", "harris_map"):
        for ending in ("png", "svg", "csv"):
            assert (folder / f"{name}.{ending}").stat().st_size > 0
    assert (folder / "report.html").read_text().count("<img") == len(list(folder.glob("*.svg")))
    dataset = xr.load_dataset(folder / "result.nc")
    error = dataset["transmission_error_um"]
    mean = float((error * dataset["weight"]).sum())
    assert mean == pytest.approx(summary["static"]["te_mean_um"], rel=1e-12)
    # At the scene's own torque the Harris map repeats the cycle.
    row = np.asarray(dataset["harris_te_um"].sel(torque=dataset["torque_Nm"] == 80.0))[0]
    assert row == pytest.approx(error.values, rel=1e-12)
    improved = tomllib.loads((folder / "accessory.optimised.toml").read_text())
    depth = improved["flank"]["wheel"]["tip_relief"]["depth_um"]
    assert depth == found["variables"]["flank.wheel.tip_relief.depth_um"]
    assert {"shafts.csv", "shafts_bearings.csv"} < set(assert_tables(folder))
    # What was run can be run again: every key that was given, and every default, is as it was.
    overridden = [change for change in size if "=" in change]
    again = read_scene(folder / "scene.toml")
    assert again.values == read_scene(Path(accessory), overridden).values


def _assert_bearings_of_the_thesis(bearings: list[dict]) -> None:
    """Tab. III-2 and III-3, within 5 %: displacement along S and T [um]."""
    expected = [(-0.35, -0.70), (-0.77, -1.55), (0.55, 1.11), (0.57, 1.15)]
    for row, (along_s, along_t) in zip(bearings, expected, strict=True):
        assert row["displacement_um"]["S"] == pytest.approx(along_s, rel=0.05)
        assert row["displacement_um"]["T"] == pytest.approx(along_t, rel=0.05)


@pytest.mark.slow
def test_bearing_loads_of_the_power_pair():
    """Tab. III-6 and III-7: totals within 0.1 %; the split follows from the shafts chosen."""
    scene = example_scene("power", ("mesh.phases=16", "mesh.stiffness=iso6336"))
    statics = solve_statics(BuiltScene(scene))
    rows = mounts_summary(statics)["bearings"]
    load = np.asarray([[row["load_N"][axis] for axis in "STZ"] for row in rows])
    assert load[:2].sum(axis=0)[:2] == pytest.approx([-3444.5, -6829.5], rel=1e-3)
    assert load[2:].sum(axis=0)[:2] == pytest.approx([3444.5, 6829.5], rel=1e-3)
    assert load.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-3)
    thesis = [[-2008, -3406], [-1436, -3423], [723, 4216], [1482, 1847], [1240, 767]]
    assert load[:, :2] == pytest.approx(np.asarray(thesis, dtype=float), rel=5e-3)


@pytest.mark.slow
def test_map_finds_the_valley_and_the_closed_form(accessory, tmp_path, capsys):
    code, summary = _run(
        capsys,
        *("map", accessory, "--json", "--quiet"),
        *("--set", "map.extent={from=0.2, to=0.3, points=5}"),
        *("--set", "map.depth_um={to=30.0, points=31}"),
    )
    assert code == 0
    curve = summary["master_curve"]
    valley = curve["valley"]
    at = valley["extent"].index(0.25)
    ratio = valley["depth_um"][at] / valley["closed_form_depth_um"][at]
    assert 0.80 < ratio < 0.90
    assert min(valley["te_rms_um"]) < 0.3
    assert curve["te_rms_um"] < 0.3
    assert curve["gradient_evaluations"] < 50
    bias = np.abs(summary["smoothing_bias"]["te_mean_bias_um"])
    # Tends to zero with the width.
    assert bias[0] < 1e-3 * bias[-1]
    for name in ("master_curve", "smoothing_bias"):
        assert (tmp_path / "results" / "accessory" / "map" / f"{name}.png").exists()


@pytest.mark.slow
def test_optimise_over_torques_and_by_adam(accessory, capsys):
    code, summary = _run(
        capsys,
        *("optimise", accessory, *_COARSE),
        *("--set", "optimise.torques_Nm=[60.0, 80.0, 100.0]", "--set", "optimise.over=worst"),
        *("--set", "optimise.method=adam", "--set", "optimise.minimise=te_peak_to_peak"),
        *("--set", "optimise.max_evaluations=60"),
    )
    assert code == 0
    found = summary["optimise"]
    assert found["torques_Nm"] == [60.0, 80.0, 100.0]
    assert found["gradient_evaluations"] == 60 * found["starts"] == 300
    assert found["after"]["objective"] < 0.5 * found["before"]["objective"]
    assert found["objective_unit"] == "um"


@pytest.mark.slow
def test_optimise_a_weighted_sum_over_macro_geometry(accessory, capsys):
    """A variable that is no flank needs bounds, and changes stiffness and cells too."""
    vary = 'optimise.vary=["pinion.addendum_coeff", "flank.pinion.crowning_um"]'
    weights = "optimise.minimise={ te_rms = 1.0, max_pressure = 0.001 }"
    common = ("optimise", accessory, *_COARSE, "--set", vary, "--set", weights)
    code, _ = _run(capsys, *common)
    assert code == 2
    bounds = "optimise.bounds.pinion.addendum_coeff=[0.9, 0.95]"
    code, summary = _run(capsys, *common, "--set", bounds)
    assert code == 0
    found = summary["optimise"]
    assert found["objective_unit"] == "weighted"
    assert found["after"]["objective"] < found["before"]["objective"]
    assert 0.9 <= found["variables"]["pinion.addendum_coeff"] <= 0.95


@pytest.mark.slow
def test_optimise_within_a_limit_from_several_starts(accessory, tmp_path, capsys):
    """The limit is kept and active: without it the pressure is higher and the error lower."""
    vary = 'optimise.vary=["flank.pinion.tip_relief.depth_um", "flank.pinion.crowning_um"]'
    common = ("optimise", accessory, *_COARSE, "--set", vary, "--set", "optimise.symmetric=false")
    common += ("--set", "flank.pinion.crowning_um=5.0")
    common += ("--set", "optimise.bounds.flank.pinion.crowning_um=[2.0, 20.0]")
    code, free = _run(capsys, *common, "--set", "optimise.method=least_squares")
    assert code == 0
    assert free["optimise"]["method"] == "least_squares"
    assert free["optimise"]["starts"] == 5
    most = 0.98 * free["optimise"]["after"]["max_pressure_MPa"]
    limit = ("--set", f"optimise.limits.max_pressure_MPa={most}")
    code, kept = _run(capsys, *common, *limit, "--set", "optimise.starts=2")
    assert code == 0
    (row,) = kept["optimise"]["limits"]
    assert row["kept"]
    assert row["found"] == pytest.approx(most, rel=1e-2)
    assert kept["optimise"]["after"]["te_rms_um"] > free["optimise"]["after"]["te_rms_um"]
    assert kept["optimise"]["method"] == "slsqp"
    assert not list((tmp_path / "results").rglob("*.jsonl"))


@pytest.mark.slow
def test_a_front_of_two_numbers_with_little_load_at_the_ends(accessory, tmp_path, capsys):
    """Each design keeps the limit; the ends are the best in one number each."""
    vary = 'optimise.vary=["flank.pinion.tip_relief.depth_um", "flank.pinion.crowning_um"]'
    common = ("optimise", accessory, *_COARSE, "--set", vary, "--set", "optimise.symmetric=false")
    common += ("--set", "flank.pinion.crowning_um=5.0", "--set", "optimise.max_evaluations=20")
    front = ("--set", "optimise.pareto={ against = 'te_rms', points = 3 }")
    limit = ("--set", "optimise.limits.edge_line_load_N_mm=180.0")
    code, summary = _run(capsys, *common, *front, *limit, "--set", "optimise.minimise=max_pressure")
    assert code == 0
    (row,) = summary["optimise"]["limits"]
    assert row["name"] == "edge_line_load_N_mm"
    assert row["kept"]
    found = summary["pareto"]
    designs = found["designs"]
    assert (found["minimise"], found["against"]) == ("max_pressure_MPa", "te_rms_um")
    assert 2 <= len(designs) <= 3
    kept = [each for each in designs if each["kept"]]
    assert kept
    assert kept[0]["max_pressure_MPa"] <= kept[-1]["max_pressure_MPa"] * (1.0 + 1e-4)
    assert kept[-1]["te_rms_um"] <= kept[0]["te_rms_um"] * (1.0 + 1e-4)
    assert all(each["flank.pinion.crowning_um"] > 5.0 for each in kept)
    for ending in ("png", "svg", "csv"):
        assert (tmp_path / "results" / "accessory" / "optimise" / f"pareto.{ending}").exists()


@pytest.mark.slow
def test_map_traces_a_curve_for_each_torque(accessory, tmp_path, capsys):
    """Deflections, and so depths, grow a little slower than the torque: contact stiffens."""
    code, summary = _run(
        capsys,
        *("map", accessory, *_COARSE, "--set", "map.torques_Nm=[40.0, 80.0]"),
        *("--set", "map.depth_um.points=8", "--set", "map.extent.points=6"),
        *("--set", "map.extent.from=0.22", "--set", "map.extent.to=0.32"),
    )
    assert code == 0
    half, whole = summary["master_curve"]["torques"]
    assert (half["torque_Nm"], whole["torque_Nm"]) == (40.0, 80.0)
    assert half["extent"] == whole["extent"]
    share = np.asarray(half["depth_um"]) / np.asarray(whole["depth_um"])
    assert np.all((0.5 < share) & (share < 0.56))
    own = summary["master_curve"]["traced"]["depth_um"]
    assert whole["depth_um"] == pytest.approx(own, rel=1e-6)
    folder = tmp_path / "results" / "accessory" / "map"
    assert (folder / "master_curve_torques.png").exists()
    assert {"master_curve.csv", "master_curve_valley.csv"} < set(assert_tables(folder))


def test_searches_that_cannot_do_what_is_asked_are_refused(accessory, capsys):
    squares = "--set", "optimise.method=least_squares"
    tie = "optimise.ties.flank.wheel.crowning_um"
    for settings, words in (
        ((*squares, "--set", "optimise.minimise=max_pressure"), "is for a sum of squares"),
        ((*squares, "--set", "optimise.limits.face_load_factor=1.2"), "knows no limits"),
        (("--set", "optimise.limits.face_load_factor=0.9"), "face_load_factor"),
        ((*squares, "--set", "optimise.anneal_um=[2.0, 1.0]"), "needs lbfgs or adam"),
        (("--set", "optimise.anneal_um=[1.0, 2.0]"), "must fall"),
        (("--set", "optimise.harmonics=[1.5]"), "must be whole numbers"),
        (("--set", "optimise.minimise=bearing_force"), "names bearing_force, which is taken over"),
        (("--set", "optimise.pareto.against=te_rms"), "which optimise.minimise names too"),
        (("--set", "optimise.limits.edge_line_load_N_mm=0"), r"> 0 [N/mm]"),
        (("--set", "optimise.pareto.against=dynamic_ratio"), "dynamic_ratio, which is taken over"),
        (("--set", f"{tie}='flank.pinion.crowning_um'"), "must be one of optimise.vary"),
        (
            ("--set", f"{tie}='flank.pinion.tip_relief.extent'"),
            "in no unit, must be a number in um",
        ),
    ):
        assert main(["optimise", accessory, *settings]) == 2
        error = capsys.readouterr().err
        assert words in error, error
        assert "Traceback" not in error


@pytest.mark.slow
def test_optimise_through_falling_widths_tied_harmonics(accessory, tmp_path, capsys):
    """The first harmonic goes, the tied depth follows, and smoothing's bias is within its bound."""
    code, summary = _run(
        capsys,
        *("optimise", accessory, *_COARSE),
        *("--set", "optimise.minimise=te_harmonics", "--set", "optimise.harmonics=[1, 2]"),
        *("--set", "optimise.symmetric=false", "--set", "optimise.anneal_um=[2.0, 1.0]"),
        *("--set", "optimise.vary=['flank.pinion.tip_relief.depth_um']"),
        *(
            "--set",
            "optimise.ties.flank.wheel.tip_relief.depth_um='flank.pinion.tip_relief.depth_um'",
        ),
    )
    assert code == 0
    found = summary["optimise"]
    pinion, wheel = (found["variables"][f"flank.{g}.tip_relief.depth_um"] for g in GEARS)
    assert pinion == wheel > 5.0
    assert found["after"]["objective"] < 0.05 * found["before"]["objective"]
    assert abs(found["smooth_less_exact"]) <= found["smoothing_bias_at_most"] + 1e-9
    assert not list((tmp_path / "results").rglob("*.jsonl"))


@pytest.mark.slow
def test_impossible_gears_are_refused_with_a_remedy(accessory, capsys):
    for setting, words in (
        (
            "pinion={teeth=10, profile_shift=-0.3, fillet_radius_coeff=0.25, face_width_mm=10.0}",
            "undercut",
        ),
        ("wheel.addendum_coeff=1.6", "Interference"),
        ("pair.centre_distance_mm=105.0", "total contact ratio"),
        ("pair.centre_distance_mm=98.0", "jam"),
        ("pinion.fillet_radius_coeff=0.9", "rack"),
    ):
        assert main(["run", accessory, "--set", setting]) == 2
        error = capsys.readouterr().err
        assert words in error, (setting, error)
        assert "Traceback" not in error


_FREE = "without shafts"


def _without_shafts(folder: Path) -> Path:
    """The accessory scene, its gears free to be held otherwise."""
    document = tomlkit.parse(example_scene("accessory").path.read_text(encoding="utf-8"))
    for gear in ("pinion", "wheel"):
        del document[gear]["shaft"]
    path = folder / "free.toml"
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path


_HARD = [
    ["pinion.shaft.bearings[0].radial_N_m=1e5"],
    ["mesh.slices=200"],
    ["pair.misalignment_deviation_um=40"],
    [_FREE, "pinion.support={radial_N_m=1e8, tilt_Nm_rad=1e5}"],
    ["mesh.slices=1", "flank.pinion.crowning_um=20"],
    ["flank.pinion.tip_relief={depth_um=900, extent=0.4}"],
    ["pair.helix_angle_deg=35", "mesh.contact=smooth"],
    ["mesh.stiffness=iso6336"],
    ["pair.torque_pinion_Nm=0.01", "flank.wheel.crowning_um=30"],
    [_FREE, "pair.misalignment_deviation_um=40", "wheel.support={tilt_Nm_rad=1e3}"],
    [_FREE, "pinion.support={radial_N_m=1e6}"],
    ["mesh.foundation=ring"],
    ["mesh.foundation=ring", "pair.helix_angle_deg=25", "mesh.line_load_updates=2"],
    ["mesh.foundation=ring", "pinion.bore_mm=8", "wheel.bore_mm=126"],
    ["mesh.tip_contact=true", "mesh.foundation=ring"],
    ["pinion.body.kind=beam", "pair.helix_angle_deg=15", "pinion.shaft.torque_at_mm=0"],
    ["pinion.shaft.bearings[0].radial_N_m=1e14", "wheel.shaft.bearings[1].radial_N_m=1e14"],
    ["wheel.shaft.segments[0].inner_mm=39.9"],
    ["mesh.periods=5", "flank.pinion.eccentricity_um=20", "flank.pinion.accuracy_grade=7"],
    ["pinion.face_width_mm=500", "wheel.face_width_mm=500", "flank.pinion.crowning_um=200"],
    ["pinion.addendum_coeff=0.66", "wheel.addendum_coeff=0.66"],
]


# Soft and stiff bearings are solved fast in `solve/test_cycle.py`, the scene itself above.
@pytest.mark.slow
@pytest.mark.parametrize("settings", _HARD, ids=str)
def test_hard_scenes_are_solved(settings, tmp_path):
    coarse = ("mesh.phases=24", "mesh.slices=4")
    if _FREE in settings:
        path = _without_shafts(tmp_path)
        scene = read_scene(path, (*coarse, *(s for s in settings if s != _FREE)))
    else:
        scene = example_scene("accessory", (*coarse, *settings))
    statics = solve_statics(BuiltScene(scene))
    pair = statics.model.pair
    expected = statics.model.torque / (pair.base_radius[0] * np.cos(pair.base_helix_angle))
    numbers = {name: float(value) for name, value in statics.numbers.items()}
    assert numbers["mesh_force_N"] == pytest.approx(float(expected), rel=1e-9)
    assert np.all(np.isfinite(list(numbers.values())))
    assert numbers["te_mean_um"] > 0.0
