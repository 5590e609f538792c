import csv
import json

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from helpers import quick

import jaxgear as jg
from jaxgear._whole_file import whole_file, write_csv, write_dataset, write_json
from jaxgear.plot._cycle import cycle_statistics, flank_grid
from jaxgear.study._results import static_dataset

_LAW = jg.ExactContact()
_STIFFNESS_N_UM = 2000.0
# Quick to compile; what is told of it is the same.
_TEETH = jg.ConstantStiffness(14e9)


def _spur() -> jg.PairModel:
    pair = jg.GearPair(jg.Gear(20, 12 * jg.mm), jg.Gear(41, 10 * jg.mm), 2 * jg.mm)
    relief = jg.TipRelief(10 * jg.um, 0.2)
    return jg.PairModel(pair, 60.0, flanks=jg.Flanks(pinion=relief), compliance=_TEETH)


def _helical() -> jg.PairModel:
    pinion, wheel = jg.Gear(25, 30 * jg.mm), jg.Gear(31, 30 * jg.mm)
    pair = jg.GearPair(pinion, wheel, 3 * jg.mm, 20 * jg.deg, 15 * jg.deg)
    radial = _STIFFNESS_N_UM / jg.um
    support = jg.Support(radial_s=radial, radial_t=radial, axial=radial)
    return jg.PairModel(
        pair, 300.0, compliance=_TEETH, pinion_support=support, wheel_support=support
    )


def _solve(model: jg.PairModel) -> jg.MeshCycle:
    return jg.mesh_cycle(model, jg.mesh_grid(model.pair, phases=16, slices=5), law=_LAW)


@pytest.fixture(scope="module", params=quick(1, [_spur, _helical]), ids=["spur", "helical"])
def case(request) -> tuple[jg.PairModel, jg.MeshCycle, xr.Dataset]:
    model = request.param()
    cycle = _solve(model)
    return model, cycle, static_dataset(model, cycle, _LAW)


def test_everything_has_a_unit_and_a_long_name(case):
    dataset = case[2]
    assert set(dataset.sizes) >= {"phase", "line", "slice", "harmonic", "body", "axis"}
    for name, variable in dataset.variables.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name


@pytest.mark.parametrize(
    ("unit", "suffix"), [("um", "_um"), ("mm", "_mm"), ("N", "_N"), ("MPa", "_MPa")]
)
def test_unit_in_the_name_is_the_unit(case, unit, suffix):
    named = [x for x in case[2].variables.values() if x.attrs["units"] == unit]
    names = [str(n) for n, x in case[2].variables.items() if x.attrs["units"] == unit]
    assert named
    assert all(name.endswith(suffix) for name in names)


def test_loads_add_up(case):
    model, _, dataset = case
    np.testing.assert_allclose(dataset["load_sharing"].sum("line"), 1.0, rtol=1e-12)
    total = dataset["cell_force_N"].sum(("line", "slice"))
    np.testing.assert_allclose(total, dataset["mesh_force_N"], rtol=1e-9)
    pair = model.pair
    force = model.torque / (pair.base_radius[0] * jnp.cos(pair.base_helix_angle))
    np.testing.assert_allclose(total, float(force), rtol=1e-9)


def test_line_load_is_force_over_length(case):
    _, cycle, dataset = case
    length = float(cycle.cells.lines.length) / jg.mm * dataset["fraction"]
    on_flank = (dataset["fraction"] >= 0.5).values
    load = (dataset["line_load_N_mm"] * length).values[on_flank]
    np.testing.assert_allclose(load, dataset["cell_force_N"].values[on_flank], rtol=1e-12)
    assert np.all(dataset["line_load_N_mm"].values[~on_flank] == 0.0)


def test_numbers_are_those_of_the_library_in_file_units(case):
    model, cycle, dataset = case
    error = dataset["transmission_error_um"]
    np.testing.assert_allclose(error, jg.transmission_error(model.pair, cycle) * 1e6, rtol=1e-12)
    np.testing.assert_allclose(
        dataset["mesh_stiffness_N_um"], jg.mesh_stiffness(cycle) / 1e6, rtol=1e-12
    )
    pressure = jg.hertz_pressure(model.pair, cycle, _LAW)
    np.testing.assert_allclose(dataset["pressure_MPa"], pressure / 1e6, rtol=1e-12)
    gap = jg.mesh_gap(model.pair, cycle.cells.lines, model.flanks, model.misalignment)
    np.testing.assert_allclose(dataset["gap_um"].values.ravel(), gap.ravel() * 1e6, rtol=1e-12)
    stiffness = dataset["pair_stiffness_N_mm_um"].values
    np.testing.assert_allclose(stiffness, cycle.cells.line_stiffness / 1e9, rtol=1e-12)
    # Steel teeth: about 14 N/(mm um) in ISO 6336, with fast contact terms up to twice that.
    assert np.all((stiffness > 8.0) & (stiffness < 30.0))
    statistics = cycle_statistics(error)
    assert statistics[0] == pytest.approx(float(jg.cycle_mean(cycle, jnp.asarray(error.values))))
    assert statistics[1] == pytest.approx(float(jg.cycle_rms(cycle, jnp.asarray(error.values))))
    assert statistics[2] == pytest.approx(float(error.max() - error.min()))


def test_harmonics_stay_below_half_the_phases(case):
    assert case[2]["harmonic"].values.tolist() == [1, 2, 3, 4, 5, 6, 7]


def test_lines_are_counted_from_entry(case):
    model, _, dataset = case
    np.testing.assert_allclose(dataset["passage"], dataset["phase"] + dataset["line"], atol=1e-12)
    if float(model.pair.helix_angle) == 0.0:
        touching = (dataset["fraction"] > 1e-6).all("slice")
        inside = (dataset["passage"] > 0) & (dataset["profile_position"].mean("slice") < 1)
        assert bool((touching == inside).all())


def test_points_of_the_path_are_in_order(case):
    model, _, dataset = case
    place = dataset["path_point_position"].values
    assert place[0] == 0.0
    assert place[4] == 1.0
    assert np.all(np.diff(place) > 0.0)
    roll = dataset["path_point_roll_mm"].sel(path_point="C")
    assert float(roll) == pytest.approx(float(model.pair.pitch_point) * 1e3)
    # One base pitch lies between A and D, and between B and E.
    rolls = dataset["path_point_roll_mm"].values
    pitch = float(model.pair.transverse_base_pitch) * 1e3
    np.testing.assert_allclose([rolls[3] - rolls[0], rolls[4] - rolls[1]], pitch, rtol=1e-12)


@pytest.mark.slow
def test_path_without_single_contact_has_no_inner_points():
    pinion, wheel = (
        jg.Gear(teeth, 20 * jg.mm, addendum=1.35, dedendum=1.6, fillet_radius=0.2)
        for teeth in (50, 60)
    )
    pair = jg.GearPair(pinion, wheel, 2 * jg.mm)
    assert float(jg.profile_contact_ratio(pair)) > 2.0
    model = jg.PairModel(pair, 100.0, compliance=_TEETH)
    place = static_dataset(model, _solve(model), _LAW)["path_point_position"].values
    assert np.isnan(place).tolist() == [False, True, False, True, False]


def test_bodies_are_pushed_apart_and_yield_by_their_stiffness():
    model = _helical()
    dataset = static_dataset(model, _solve(model), _LAW)
    force = dataset["body_force_N"]
    both = force.sum("body")
    np.testing.assert_allclose(both, np.zeros(both.shape), atol=1e-8)
    size = (force**2).sum("axis") ** 0.5
    np.testing.assert_allclose(size, size.mean(), rtol=1e-9)
    np.testing.assert_allclose(size.sel(body="wheel"), dataset["mesh_force_N"], rtol=1e-9)
    assert np.all(force.sel(body="pinion", axis="S") < 0.0)
    np.testing.assert_allclose(dataset["displacement_um"] * _STIFFNESS_N_UM, force, rtol=1e-9)
    torque = dataset["body_moment_Nm"].sel(body="pinion", axis="Z")
    np.testing.assert_allclose(torque, -300.0, rtol=1e-9)


@pytest.mark.parametrize(("body", "sign"), [("pinion", 1.0), ("wheel", -1.0)])
def test_flank_grid_puts_values_in_their_place(case, body, sign):
    dataset = case[2].copy()
    place, face = dataset["profile_position"], dataset["face_position_mm"]
    dataset["known"] = (3.0 * place + 0.1 * face).transpose("phase", "line", "slice")
    grid = flank_grid(dataset, "known", body, points=31)
    assert grid.dims == ("profile_position", "slice")
    own = grid["profile_position"].values
    along = own if sign > 0 else 1.0 - own
    expected = 3.0 * along[:, None] + 0.1 * grid["face_position_mm"].values[None, :]
    # Beyond the first and the last place that a phase saw, half a step, the grid is flat.
    assert np.max(np.abs(grid.values - expected)) < 3.0 * 0.06
    np.testing.assert_allclose(grid.values[3:-3], expected[3:-3], atol=1e-12)


def test_flank_grid_says_what_it_takes(case):
    with pytest.raises(ValueError, match=r"pinion, wheel, got 'gear'"):
        flank_grid(case[2], "pressure_MPa", "gear")
    with pytest.raises(ValueError, match="over phase, line and slice"):
        flank_grid(case[2], "transmission_error_um", "wheel")


def test_dataset_survives_its_file(case, tmp_path):
    path = tmp_path / "result.nc"
    path.write_text("an older result")
    write_dataset(case[2], path)
    with xr.open_dataset(path, engine="netcdf4") as back:
        assert back.identical(case[2])
    assert [x.name for x in tmp_path.iterdir()] == ["result.nc"]


def test_interrupted_file_leaves_the_old_one(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("old")

    def interrupted():
        with whole_file(path) as draft:
            draft.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert [x.name for x in tmp_path.iterdir()] == ["result.json"]


def test_json_has_plain_finite_numbers(tmp_path):
    path = tmp_path / "summary.json"
    summary = {
        "name": "Zahnrad µ",
        "teeth": np.int64(45),
        "ratio": np.float64(1.5),
        "lost": float("nan"),
        "far": np.asarray([1.0, np.inf]),
        "traced": jnp.asarray(2.0),
        "settled": np.bool_(True),
        "nothing": None,
        "rows": [{"x": (1, 2)}],
    }
    write_json(summary, path)
    text = path.read_text(encoding="utf-8")
    assert "NaN" not in text
    assert json.loads(text) == {
        "name": "Zahnrad µ",
        "teeth": 45,
        "ratio": 1.5,
        "lost": None,
        "far": [1.0, None],
        "traced": 2.0,
        "settled": True,
        "nothing": None,
        "rows": [{"x": [1, 2]}],
    }


def test_json_refuses_what_is_no_number(tmp_path):
    with pytest.raises(TypeError, match="numbers, texts, lists and tables"):
        write_json({"x": object()}, tmp_path / "summary.json")
    assert not list(tmp_path.iterdir())


def test_csv_reads_back(tmp_path):
    path = tmp_path / "picture.csv"
    phase = np.linspace(0.0, 1.0, 7)
    error = 1e-3 * np.pi * phase
    error[3:5] = np.nan, np.inf
    method = np.asarray(["lbfgs", "a, b", None, "", "µ", '"', "z"], dtype=object)
    write_csv({"phase": phase, "error_um": error, "method": method}, path)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["phase", "error_um", "method"]
    np.testing.assert_allclose([float(row["phase"]) for row in rows], phase, rtol=1e-9)
    read = [float(row["error_um"] or "nan") for row in rows]
    np.testing.assert_allclose(read, np.where(np.isfinite(error), error, np.nan), rtol=1e-9)
    assert [row["error_um"] for row in rows[3:5]] == ["", ""]
    assert [row["method"] for row in rows] == ["lbfgs", "a, b", "", "", "µ", '"', "z"]


def test_csv_wants_columns(tmp_path):
    with pytest.raises(ValueError, match=r"`x_um` must be one-dimensional, got shape \(2, 2\)"):
        write_csv({"x_um": np.zeros((2, 2))}, tmp_path / "x.csv")
    with pytest.raises(ValueError, match=r"one length, got \{'x_um': 2, 'y_um': 3\}"):
        write_csv({"x_um": np.zeros(2), "y_um": np.zeros(3)}, tmp_path / "x.csv")
    assert not list(tmp_path.iterdir())


def test_written_files_can_be_read_by_others(tmp_path):
    usual = tmp_path / "usual"
    usual.touch()
    write_json({}, tmp_path / "x.json")
    assert (tmp_path / "x.json").stat().st_mode == usual.stat().st_mode


def test_bodies_are_named_in_the_order_of_the_axis(case):
    assert tuple(case[2]["body"].values.tolist()) == ("pinion", "wheel")
