"""Studies of many designs: their files and tables, and a tiny one computed in parts."""

import importlib.metadata
import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from helpers import assert_close

import jaxgear as jg
from jaxgear._checks import InputError
from jaxgear._cli._designs import write_results
from jaxgear._cli._folder import Folder
from jaxgear._cli._main import main
from jaxgear._cli._parser import READY_STUDIES
from jaxgear.designs._asked import read_study
from jaxgear.designs._chunks import Chunk
from jaxgear.designs._datasets import chunk_dataset, together
from jaxgear.designs._evaluate import Rows
from jaxgear.designs._statistics import effects_dataset, quantiles_dataset
from jaxgear.designs._table import design_table, unfit
from jaxgear.designs._work import Shard, begin, job_of
from jaxgear.scene._bodies import body_plan
from jaxgear.study._result import Result

# Of one slice and the law that compiles soonest: designs are told apart by other numbers.
_COARSE = ["mesh.phases=8", "mesh.slices=1", "mesh.stiffness=iso6336"]
_DEPTH, _TORQUE = "flank.pinion.tip_relief.depth_um", "pair.torque_pinion_Nm"
_BETWEEN = f'[design.between]\n"{_DEPTH}" = [0.0, 20.0]\n"{_TORQUE}" = [60.0, 90.0]\n'


def _study(folder: Path, design: str, more: str = "", head: str = "") -> Path:
    path = folder / "tiny.toml"
    path.write_text(
        f'schema = 1\nscene = "accessory"\nset = {json.dumps(_COARSE)}\n'
        f'{head}\n[design]\n{design}\n[keep]\nnumbers = ["static.te_rms_um"]\n{more}',
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize(
    ("design", "more", "words"),
    [
        ('kind = "sobl"', "", r"6: design.kind: .* did you mean \"sobol\""),
        (f"{_BETWEEN}", "", "design.points: is missing"),
        (
            'points = 4\n[design.between]\n"pair.torque_pinion_Nm" = [9.0, 4.0]',
            "",
            r"write \[4, 9\]",
        ),
        (
            'points = 4\n[design.between]\n"pair.torque_pinion_N" = [4.0, 9.0]',
            "",
            "8: .*did you mean",
        ),
        ('points = 4\n[design.between]\n"pinion.teeth" = [4.5, 9]', "", "8: .*must be an integer"),
        (f'points = 4\n[design.between]\n"{_TORQUE}" = [nan, 9.0]', "", "8: .*finite"),
        (f'points = 4\n[design.scatter]\n"{_TORQUE}" = -1.0', "", "8: .*> 0"),
        (
            'points = 4\n[design.between]\n"pinion.shaft.bearings[5].at_mm" = [0.0, 1.0]',
            "",
            "no such",
        ),
        (
            'points = 4\n[design.scatter]\n"pair.centre_distance_mm" = 0.1',
            "",
            "no value in the scene",
        ),
        (f'kind = "grid"\n[design.scatter]\n"{_TORQUE}" = 1.0', "", "goes without design.kind"),
        (f'csv = "x.csv"\n{_BETWEEN}', "", "goes without design.csv"),
        ("points = 4", "", "nothing varies"),
        (f"points = 4\n{_BETWEEN}", "minimise = ['static.x']", "must be one of keep.numbers"),
        (f"points = 4\n{_BETWEEN}", "gradient = true", "did you mean keep.gradients"),
        (f"points = 4\n{_BETWEEN}", "[work]\nengine = 'dask'", "work.scheduler: is missing"),
    ],
)
def test_mistakes_are_told_by_name_and_line(tmp_path, design, more, words):
    # Keys of the table itself stand before those of the tables in it.
    with pytest.raises(jg.SceneError, match=words):
        read_study(_study(tmp_path, design, more))


_MOVES = '"mesh.phases=8", "sweep.pinion_speed_rad_s=[500.0]", "sweep.direction=up"'


@pytest.mark.parametrize(
    ("command", "number", "words"),
    [
        ("optimise", "static.te_rms_um", "an optimum has none"),
        ("modes", "static.te_rms_um", "static.te_rms_um has none. Those that have: modes.freq"),
        ("sweep", "sweep.peaks[0].speed_rad_s", "has none. Those that have: sweep.dynamic"),
        ("sweep", "sweep.te_rms_um_up[1]", "is not of this sweep: 1 speeds, up"),
        ("sweep", "sweep.te_rms_um_down[0]", "is not of this sweep: 1 speeds, up"),
    ],
)
def test_what_has_no_derivative_is_refused_before_work(tmp_path, command, number, words):
    path = _study(tmp_path, f"points = 4\n{_BETWEEN}", "gradients = true", f'command = "{command}"')
    text = path.read_text(encoding="utf-8").replace("static.te_rms_um", number)
    path.write_text(text.replace('"mesh.phases=8"', _MOVES), encoding="utf-8")
    with pytest.raises(jg.SceneError, match=rf"keep.gradients: got true, but .*{re.escape(words)}"):
        read_study(path)


def test_files_that_are_not_there_are_told_by_line(tmp_path):
    path = _study(tmp_path, 'csv = "none.csv"')
    with pytest.raises(InputError, match=r"tiny.toml:6: design.csv: there is no file .*none.csv"):
        design_table(read_study(path))
    path.write_text(path.read_text(encoding="utf-8").replace('"accessory"', '"accesory"'))
    words = r"tiny.toml:2: scene: .* no example scene; did you mean accessory\?"
    with pytest.raises(jg.SceneError, match=words):
        read_study(path)
    with pytest.raises(jg.SceneError, match=r"no such file.*writes an example study"):
        read_study(tmp_path / "none.toml")


@pytest.mark.parametrize("more", ["", '"damping.mesh=0.02", ', '"damping.kind=rayleigh", '])
def test_sweep_of_a_condensed_body_has_derivatives_where_its_damping_has(tmp_path, more):
    path = _study(tmp_path, f"points = 4\n{_BETWEEN}", "gradients = true", 'command = "sweep"')
    text = path.read_text(encoding="utf-8").replace("static.te_rms_um", "sweep.te_rms_um_up[0]")
    text = text.replace('"mesh.phases=8"', f"{more}{_MOVES}").replace(
        '"accessory"', '"accessory-h1"'
    )
    if "rayleigh" in more:
        text = text.replace(more, f'{more}"damping.a_R_1_s=50", "damping.b_R_s=2e-7", ')
    path.write_text(text, encoding="utf-8")
    if more:
        assert read_study(path).asked.keep.gradients
        return
    with pytest.raises(jg.SceneError, match=r"keep.gradients: .* beside a condensed body .* pairs"):
        read_study(path)


def _table(folder: Path, design: str):
    return design_table(read_study(_study(folder, design)))


def test_sobol_designs_fill_the_box_and_are_drawn_alike(tmp_path):
    table = _table(tmp_path, f"points = 64\nseed = 3\n{_BETWEEN}")
    rows = np.asarray(table.rows)
    assert table.keys == (_DEPTH, _TORQUE)
    # One in each of as many steps: what random points do not.
    for column, (low, high) in enumerate(((0.0, 20.0), (60.0, 90.0))):
        places = np.floor(64 * (rows[:, column] - low) / (high - low))
        assert sorted(places) == list(range(64))
    assert _table(tmp_path, f"points = 64\nseed = 3\n{_BETWEEN}").rows == table.rows
    assert _table(tmp_path, f"points = 64\nseed = 4\n{_BETWEEN}").rows != table.rows


def test_grid_has_every_combination_also_of_words_and_counts(tmp_path):
    listed = '[design.values]\n"mesh.foundation" = ["ring", "weber"]\n'
    table = _table(
        tmp_path,
        f'kind = "grid"\npoints = 3\n[design.between]\n"pinion.teeth" = [40, 45]\n{listed}',
    )
    expected = [(teeth, word) for teeth in (40, 42, 45) for word in ("ring", "weber")]
    assert list(table.rows) == expected


def test_one_at_a_time_moves_each_key_about_the_scene(tmp_path):
    more = '[design.scatter]\n"flank.wheel.tip_relief.depth_um" = 2.0\n'
    table = _table(tmp_path, f'kind = "one-at-a-time"\n{_BETWEEN}{more}')
    assert [tuple(map(float, row)) for row in table.rows] == [
        (0.0, 80.0, 0.0),
        (20.0, 80.0, 0.0),
        (0.0, 60.0, 0.0),
        (0.0, 90.0, 0.0),
        (0.0, 80.0, -4.0),
        (0.0, 80.0, 4.0),
    ]


def test_scatter_has_the_deviation_that_was_asked_for(tmp_path):
    even = f'[design.even]\n"{_DEPTH}" = 3.0\n'
    rows = _table(tmp_path, f'points = 1024\n[design.scatter]\n"{_TORQUE}" = 8.0\n{even}').rows
    torque, depth = np.asarray(rows).T[::-1] if rows[0][0] < 10.0 else np.asarray(rows).T
    assert abs(torque.mean() - 80.0) < 0.1
    assert abs(torque.std() - 8.0) < 0.1
    assert abs(depth.std() - 3.0 / np.sqrt(3.0)) < 0.01
    assert abs(depth).max() <= 3.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pair.torque_pinion_N\n80\n", "csv:1: unknown column.*Did you mean pair.torque_pinion_Nm"),
        ("pair.torque_pinion_Nm\n80\nnan\n", "csv:3: pair.torque_pinion_Nm: 'nan' is not a finite"),
        ("pair.torque_pinion_Nm\n", "no designs"),
    ],
)
def test_mistakes_in_a_file_of_designs_are_told_by_line(tmp_path, text, words):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        _table(tmp_path, 'csv = "x.csv"')


def test_a_design_on_the_other_side_of_the_teeth_is_refused():
    assert unfit({_TORQUE: 3.0, _DEPTH: 5.0}, 60.0) == unfit({_TORQUE: -3.0}, -60.0) == ""
    for torque in (0.0, -3.0):
        assert "must have the sign of the scene's, 60" in unfit({_TORQUE: torque}, 60.0)


def test_quantiles_have_the_bounds_of_order_statistics():
    # Of 100 values the median is between the 40th and the 61st with 95 % confidence, as tables of
    # the sign test have it; 100 are too few to bound the 99 % quantile from above.
    values = xr.Dataset({"x": ("design", np.random.default_rng(0).permutation(100) + 1.0)})
    found = quantiles_dataset(values, ["x"]).sel(number="x")
    middle = found.sel(share=0.5)
    assert (float(middle["low"]), float(middle["high"])) == (40.0, 61.0)
    assert float(middle["value"]) == 50.5
    assert np.isnan(float(found.sel(share=0.99)["high"]))


def test_effects_are_the_shares_of_a_polynomial():
    # Of a + 2 b + 3 a b with a, b of variance 1: 1, 4 and 9 of 14.
    a, b = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 31) * np.sqrt(3.0 * 30.0 / 32.0)])
    data = {"a": a.ravel(), "b": b.ravel(), "y": (a + 2.0 * b + 3.0 * a * b).ravel()}
    found = effects_dataset(xr.Dataset({k: ("design", v) for k, v in data.items()}), "ab", ["y"])
    assert found is not None
    share = found["share"].sel(number="y").values
    assert_close(share, np.asarray([[1.0, 9.0], [0.0, 4.0]]) / 14.0, rtol=1e-12, atol=1e-12)
    assert found["rest"].values[0] < 1e-12


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A study of five designs in chunks of two, one of which cannot be, and where it is."""
    folder = tmp_path_factory.mktemp("study")
    rows = ["0,80", "5,80", "10,-3", "5.001,80", "12,70"]
    (folder / "x.csv").write_text("\n".join([f"{_DEPTH},{_TORQUE}", *rows, ""]))
    more = 'arrays = ["transmission_error_um"]\ngradients = true\n[work]\nchunk = 2\n'
    path = _study(folder, 'csv = "x.csv"', more)
    # The second of three chunks first: parts and the whole are the same.
    part = jg.designs.run(path, folder / "out", shard=jg.designs.Shard(1, 3))
    assert part.status == jg.designs.Status(3, 5, 1, 2)
    assert "3 of 5 designs are not computed yet" in part.summary["notes"][0]
    return path, jg.designs.run(path, folder / "out")


@pytest.mark.slow
def test_designs_are_what_a_study_of_each_finds(solved):
    _, found = solved
    table = found.table
    scene = jg.example_scene("accessory", [*_COARSE, f"{_DEPTH}=5"])
    own = jg.study.statics(scene)
    assert_close(
        float(table["static.te_rms_um"][1]), own.summary["static"]["te_rms_um"], rtol=1e-9, atol=0.0
    )
    error = found.designs["transmission_error_um"].sel(design=1)
    assert_close(error.values, own.dataset["transmission_error_um"].values, rtol=1e-9, atol=0.0)
    assert_close(error["phase"].values, own.dataset["phase"].values, rtol=1e-12, atol=0.0)


@pytest.mark.slow
def test_gradients_are_slopes_between_designs(solved):
    table = solved[1].table
    slope = table[f"d static.te_rms_um / d {_DEPTH}"][[1, 3]].mean()
    assert_close(np.diff(table["static.te_rms_um"][[1, 3]])[0] / 0.001, slope, rtol=1e-6, atol=0.0)


def test_design_that_cannot_be_is_a_row_with_its_reason(solved):
    table = solved[1].table
    assert table["reason"][2].startswith(f"{_TORQUE}: got -3, must have the sign of the scene's")
    assert np.isnan(table["static.te_rms_um"][2])
    assert [bool(each) for each in table["reason"]] == [False, False, True, False, False]
    assert solved[1].summary["study"]["failed"] == 1


def test_nothing_is_computed_twice(solved, monkeypatch):
    path, found = solved
    monkeypatch.setattr("jaxgear.designs._work.write_dataset", lambda *given: 1 / 0)
    again = jg.designs.run(path, path.parent / "out")
    assert again.designs.identical(found.designs)


def test_changed_scene_is_refused_by_key_and_line(solved):
    path, _ = solved
    other = path.with_name("other.toml")
    text = path.read_text().replace("phases=8", "phases=9").replace("chunk = 2", "chunk = 3")
    other.write_text(text)
    with pytest.raises(jg.SceneError) as caught:
        jg.designs.status(other, path.parent / "out")
    assert "mesh.phases: is 9, and was 8 for 3 finished chunks" in str(caught.value)
    assert f"{other}:12: work.chunk: is 3, and was 2" in str(caught.value)
    assert job_of(other, path.parent / "out", anew=True).missing


def test_a_shard_begins_anew_without_removing_the_chunks_of_others(solved, tmp_path):
    path, _ = solved
    shutil.copytree(path.parent / "out", tmp_path / "out")
    job = job_of(path, tmp_path / "out")
    older = tmp_path / "out" / "chunks" / "older.nc"
    older.write_bytes(b"")
    begin(job, Shard(1, 2), anew=True)
    assert not older.exists()
    assert [chunk in job.missing for chunk in job.chunks] == [False, True, False]
    begin(job, anew=True)
    assert job.missing == job.chunks


def test_parquet_has_the_table_and_what_it_is_made_from(solved, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    path, found = solved
    write_results(found, Folder(tmp_path, False))
    table = parquet.read_table(tmp_path / "designs.parquet")
    assert table.column_names == list(found.table)
    for name in table.column_names:
        assert np.array_equal(table[name].to_numpy(), found.table[name], equal_nan=name != "reason")
    about = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert about["study"] == path.read_text(encoding="utf-8")
    assert about["scene"].startswith("# A spur pair of a helicopter's accessory gearbox")
    assert f"jaxgear {importlib.metadata.version('jaxgear')}" in json.loads(about["versions"])
    assert json.loads(about["seed"]) == 0


@pytest.mark.end_to_end
def test_command_collects_and_draws(solved, capsys):
    path, found = solved
    out = path.parent / "out"
    assert main(["study", str(path), "--out", str(out), "--collect", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    least = int(np.nanargmin(found.table["static.te_rms_um"]))
    assert summary["study"]["best"][0]["design"] == least
    best = jg.read_scene(out / "best_1.toml")
    assert best.value(_DEPTH) == summary["study"]["best"][0][_DEPTH]
    assert best.mesh.phases == 8
    assert best.name == "tiny_best_1"
    assert main(["plot", str(out), "--no-pictures", "--quiet"]) == 0
    assert {"main_effects.csv", "parallel_coordinates.csv"} <= {p.name for p in out.iterdir()}
    page = (out / "report.html").read_text(encoding="utf-8")
    for words in ("Results of study", "Designs that failed: 1", "main effects", "[study.design]"):
        assert words in page, words
    assert main(["report", str(out), "--quiet"]) == 0
    assert "Results of study" in (out / "report.html").read_text(encoding="utf-8")
    assert main(["study", str(path), "--out", str(out), "--status", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["study"]["done_designs"] == 5
    assert main(["study", str(path), "--out", str(out), "--shard", "3/3"]) == 2
    assert "counted from 0, got 3/3. The last is 2/3" in capsys.readouterr().err


def test_ready_studies_of_webs_have_the_same_designs():
    """27 wheels, none of which is impossible; whose bodies both studies share."""
    studies = [
        read_study(READY_STUDIES / f"{name}.toml")
        for name in ("power-webs", "power-webs-crossings")
    ]
    tables = [design_table(study) for study in studies]
    assert len(tables[0].rows) == 27
    assert tables[0] == tables[1]
    scenes = [dict(study.scene.values) for study in studies]
    assert scenes[1].pop("modes.harmonics") == 2
    scenes[0].pop("modes.harmonics", None)
    assert scenes[0] == scenes[1]
    for row in range(27):
        values = tables[0].at(row)
        assert body_plan(studies[0].scene.replace(values), "wheel").name


def test_study_without_a_design_that_can_be_is_a_table_of_reasons(tmp_path, capsys, monkeypatch):
    # Without pyarrow, installed or not, the table is a text.
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    path = _study(tmp_path, 'csv = "designs.csv"')
    (tmp_path / "designs.csv").write_text(f"{_TORQUE}\n-1.0\n-2.0\n", encoding="utf-8")
    assert main(["study", str(path), "--out", str(tmp_path / "results"), "--quiet"]) == 0
    capsys.readouterr()
    (table,) = (tmp_path / "results").rglob("designs.csv")
    assert table.read_text(encoding="utf-8").count(_TORQUE) == 3
    assert not list((tmp_path / "results").rglob("*.png"))


def _peaks(monkeypatch):
    """In place of a study: as many peaks as the torque has tens, above 60; the second is at 7."""

    def found(scene):
        count = int((scene.pair.torque_pinion_Nm - 60.0) // 10.0)
        peaks = [{"at": 6.0 + place, "kind": "up"} for place in range(count)]
        words = {"units": "1", "long_name": "x"}
        arrays = xr.Dataset({"high": ("peak", np.arange(count) + 0.5, words)})
        return Result(scene, {"peaks": peaks, "sum": 1.0}, {"peaks": arrays} if count else {})

    monkeypatch.setattr("jaxgear.study.modes", found)


def _of_peaks(folder: Path, torques: list[float], more: str = "") -> Path:
    path = _study(folder, 'csv = "x.csv"', more, 'command = "modes"')
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("static.te_rms_um", 'peaks[1].at", "sum'), encoding="utf-8")
    (folder / "x.csv").write_text("\n".join([_TORQUE, *map(str, torques), ""]))
    return path


def test_number_that_a_design_lacks_is_an_empty_place(tmp_path, monkeypatch):
    _peaks(monkeypatch)
    path = _of_peaks(tmp_path, [75.0, 85.0, 65.0, 95.0], 'arrays = ["peaks.high"]\n')
    text = path.read_text(encoding="utf-8").replace(', "sum"', "")
    path.write_text(text, encoding="utf-8")
    found = jg.designs.run(path, tmp_path / "out")
    lacks = np.isnan(found.table["peaks[1].at"])
    assert lacks.tolist() == [True, False, True, False]
    assert not any(found.table["reason"])
    assert found.summary["study"]["failed"] == 0
    # The best are among those that have it.
    assert [each["design"] for each in found.summary["study"]["best"]] == [1, 3]
    assert found.summary["notes"] == [
        "2 of 4 designs have no peaks[1].at, or none that is finite: empty places."
    ]
    high = found.designs["peaks.high"]
    assert np.isfinite(high.values).sum(axis=1).tolist() == [1, 2, 0, 3]
    assert {"main_effects", "parallel_coordinates"} <= set(found.plot())


def test_name_that_no_result_has_is_refused_by_line(tmp_path, monkeypatch):
    _peaks(monkeypatch)
    path = _of_peaks(tmp_path, [85.0, 75.0], 'arrays = ["peaks.hihg"]\n')
    for name, near in (
        ("peaks[1].att", ""),
        ("peaks[0].kind", ""),
        ("summ", "; did you mean sum?"),
    ):
        text = path.read_text(encoding="utf-8").replace("peaks[1].at", name)
        path.with_name("other.toml").write_text(text, encoding="utf-8")
        with pytest.raises(jg.SceneError) as caught:
            jg.designs.run(path.with_name("other.toml"), tmp_path / "out")
        told = str(caught.value)
        assert f"other.toml:8: keep.numbers: results have no {name}{near}" in told
        assert "other.toml:9: keep.arrays: results have no peaks.hihg; did you mean peaks.h" in told


def test_statistics_leave_out_what_a_design_lacks():
    a, b = np.random.default_rng(0).random((2, 60))
    whole = xr.Dataset({"a": ("design", a), "b": ("design", b), "y": ("design", a + b)})
    holes = xr.where(whole["a"] > 0.2, whole["y"], np.nan)
    kept, lacking = whole.isel(design=a > 0.2), whole.assign(y=holes, none=holes * np.nan)
    for of in (quantiles_dataset, lambda x, names: effects_dataset(x, ["a", "b"], names)):
        found, own = of(lacking, ["y", "none"]), of(kept, ["y"])
        assert found is not None
        assert own is not None
        for name in own.data_vars:
            both = (x[name].sel(number="y").values for x in (found, own))
            assert np.array_equal(*both, equal_nan=True)
            assert np.isnan(found[name].sel(number="none").values).all()


@pytest.mark.parametrize("failed", [(), (0,), (0, 1)])
def test_arrays_keep_the_words_of_their_places(tmp_path, failed):
    """Of a sweep the direction; designs without results have none."""
    path = _study(tmp_path, f"points = 4\n{_BETWEEN}", 'arrays = ["sweep.dynamic_ratio"]')
    study, told = read_study(path), {"units": "1", "long_name": "x"}
    files = []
    for place in (0, 2):
        chunk = Chunk("x", (place, place + 1))
        good = [x for x in (0, 1) if place + x not in failed]
        arrays = {
            "sweep.dynamic_ratio": xr.Variable(("direction", "speed"), np.ones((1, 3)), told),
            "direction": xr.Variable("direction", np.array(["up"], dtype=object), told),
        }
        rows = Rows(
            [{_TORQUE: 70.0}] * 2,
            (),
            ["" if x in good else "no" for x in (0, 1)],
            np.ones((2, 1)),
            np.ones((2, 1, 0)),
            {name: dict.fromkeys(good, each) for name, each in arrays.items() if good},
        )
        files.append(tmp_path / f"{place}.nc")
        chunk_dataset(study, chunk, rows).to_netcdf(files[-1])
    found = together(files)
    assert found["direction"].values.tolist() == ["up"]
    ratio = found["sweep.dynamic_ratio"].sel(direction="up")
    assert np.isnan(ratio.values).all(axis=1).tolist() == [x in failed for x in range(4)]
