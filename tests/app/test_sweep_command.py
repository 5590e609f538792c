"""`jaxgear sweep` end to end on a spur pair that only turns: what it finds, writes and refuses."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
import xarray as xr
from table_checks import assert_tables
from tiny_cases import tiny_scene

import jaxgear as jg
from jaxgear._checks import InputError
from jaxgear._cli._fit import refuse_unfit
from jaxgear._cli._main import main
from jaxgear._dynamics._continuation import Curve, CurvePoint
from jaxgear._dynamics._damping import ModalDamping, RayleighDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import TimeStepping
from jaxgear._response._sweep_features import prominent
from jaxgear._system._body_modes import BodyBasis
from jaxgear._system._shaft import Shaft
from jaxgear.scene._build import law_of, model_of
from jaxgear.scene._scene import read_scene
from jaxgear.study import _dynamics, _sweep
from jaxgear.study._built import BuiltScene
from jaxgear.study._sweep_dataset import sweep_dataset
from jaxgear.study._sweep_notes import sweep_notes
from jaxgear.study._sweeping import Sweep, branches, finder_of, is_plain, swept, swept_along

_SPUR = """schema = 1
name = "spur"
[pair]
module_mm = 3.0
torque_pinion_Nm = 100.0
[pinion]
teeth = 20
face_width_mm = 20.0
bore_mm = 20.0
[wheel]
teeth = 40
face_width_mm = 20.0
bore_mm = 30.0
[mesh]
slices = 1
"""
# Between the folds near 2100 and 2130 rad/s rising and falling speeds differ.
_SWEEP = """[sweep]
pinion_speed_rad_s = [2000.0, 2080.0, 2115.0, 2230.0, 1500.0]
steps = 48
harmonics = 10
orders = 3
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("sweep")


def _scene(folder: Path, text: str = _SPUR + _SWEEP, name: str = "spur.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def both(folder):
    """The folder of a sweep in both directions, its summary, and the pair that was swept."""
    out, pairs, quietly = folder / "both", [], ("--quiet", "--no-pictures")

    def noted(scene):
        pairs.append(_dynamics.solve_dynamics(scene))
        return pairs[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_sweep, "solve_dynamics", noted)
        assert main(["sweep", str(_scene(folder)), "--out", str(out), *quietly]) == 0
    own = out / "sweep"
    return own, json.loads((own / "summary.json").read_text()), pairs[0]


@pytest.mark.slow
def test_a_sweep_writes_everything_that_it_found(both):
    out, summary, _ = both
    found = summary["sweep"]
    assert found["pinion_speed_rad_s"] == [1500.0, 2000.0, 2080.0, 2115.0, 2230.0]
    assert found["method"] == "harmonic"
    assert found["unsettled_count"] == 0
    assert summary["model"]["phases"] == 48
    assert "unbalance" not in found
    for name in ("sweep", "waterfall", "orders", "contact_loss", "orbit"):
        assert (out / f"{name}.csv").stat().st_size > 0
    assert {"sweep_folds.csv", "sweep_curve.csv"} < set(assert_tables(out))
    with xr.open_dataset(out / "result.nc", group="sweep") as dataset:
        shape = [dataset.sizes[name] for name in ("direction", "speed", "order", "phase")]
        assert shape == [2, 5, 3, 48]
        assert all(np.isfinite(v).all() for v in dataset.variables.values() if v.dtype.kind == "f")
        ratio = dataset["dynamic_ratio"]
        assert ratio.sel(direction="up").values == pytest.approx(found["dynamic_ratio_up"])
        # The map of the mesh force holds it in mid-steps; the largest may be at the limit of one.
        largest = dataset["mesh_force_ratio"].max("phase")
        assert (largest <= ratio + 1e-12).all()
        np.testing.assert_allclose(largest, ratio, rtol=0.02)
        # One pair at a time, so a pair has the force of the mesh.
        assert float((dataset["pair_ratio"] - ratio).max()) < 1e-12
        assert (dataset["multiplier"] < 1.0).all()


@pytest.mark.slow
def test_both_directions_part_between_the_folds_and_nowhere_else(both):
    found = both[1]["sweep"]
    up, down = (np.asarray(found[f"dynamic_ratio_{way}"]) for way in ("up", "down"))
    apart = [0, 0, 0, 1, 0]
    np.testing.assert_array_equal(np.abs(up / down - 1.0) > 1e-6, np.asarray(apart, bool))
    assert down[3] > 1.2 * up[3]
    assert found["bistable"] == [{"from_rad_s": 2115.0, "to_rad_s": 2115.0}]
    low, high = found["folds_rad_s"]
    assert 2080.0 < low < 2115.0 < high < 2230.0


@pytest.mark.slow
def test_the_highest_peak_is_named_with_its_mode_and_order(both):
    summary = both[1]
    (peak,) = [row for row in summary["sweep"]["peaks"] if row["direction"] == "down"]
    assert peak["speed_rad_s"] == 2115.0
    assert peak["mesh_order"] == 1.0
    assert peak["frequency_Hz"] == pytest.approx(20 * 2115.0 / (2.0 * np.pi))
    assert summary["damping"]["ratios"] == pytest.approx([0.07], rel=1e-9)
    # Teeth that part are softer, so that the peak lies below the natural frequency.
    assert 0.8 < peak["frequency_Hz"] / peak["nearest_mode_Hz"] < 1.0


@pytest.mark.slow
def test_marching_agrees_with_harmonic_balance(both, folder):
    """Another method: with 48 steps Newmark's error is of the order of a percent."""
    _, summary, dynamics = both
    scene = read_scene(folder / "spur.toml", ("sweep.method=newmark", "sweep.cycles=60"))
    speeds = np.asarray([1500.0, 2000.0])
    law, none = law_of(scene.mesh), lambda _: None
    finder = finder_of(law, scene.sweep, dynamics)
    found = swept(law, scene.sweep, dynamics, finder, speeds, "up", none)
    assert all(response.settled and response.stable for response in found)
    assert [response.periods for response in found] == [1, 1]
    ratio = [float(response.numbers.dynamic_ratio) for response in found]
    assert ratio == pytest.approx(summary["sweep"]["dynamic_ratio_up"][:2], rel=0.02)


@pytest.mark.slow
def test_along_a_stable_branch_both_directions_are_found_at_once(both, folder):
    scene, dynamics = read_scene(folder / "spur.toml"), both[2]
    law, none = law_of(scene.mesh), lambda _: None
    method = _dynamics.settings_of(law, scene.sweep, _dynamics.size_of(dynamics.pair)).method
    assert isinstance(method, HarmonicBalance)
    speeds, seen, told = np.asarray([1500.0, 1700.0, 2000.0]), [], []
    curves = branches(method, dynamics.pair, speeds, none)
    assert is_plain(curves)
    found = swept_along(
        law, scene.sweep, dynamics, curves[0], speeds, told.append, lambda *own: seen.append(own)
    )
    assert sum(told) == 6
    assert found is not None
    for way in ("up", "down"):
        finder = finder_of(law, scene.sweep, dynamics)
        expected = swept(law, scene.sweep, dynamics, finder, speeds, way, none)
        for one, other in zip(found, expected, strict=True):
            assert one.dynamic_ratio == pytest.approx(other.dynamic_ratio, rel=1e-9)
            assert one.multiplier == pytest.approx(other.multiplier, rel=1e-6)
    assert [own[0] for own in seen] == [("up", "down")] * 3
    assert [float(own[1].orbit.speed) for own in seen] == speeds.tolist()
    # Round its folds it is not alone, and a branch that is not there is not taken.
    wide = branches(method, dynamics.pair, np.asarray([1500.0, 2230.0]), none)
    assert not is_plain(wide)
    off = eqx.tree_at(lambda curve: curve.terms, curves[0], 3.0 * curves[0].terms)
    assert swept_along(law, scene.sweep, dynamics, off, speeds, told.append) is None
    assert sum(told) == 6


@pytest.mark.slow
def test_a_mode_that_the_mesh_shakes_and_nothing_damps_is_refused(both, folder):
    scene, dynamics = read_scene(folder / "spur.toml"), both[2]
    _dynamics.require_damped(scene.damping, dynamics)
    bare = eqx.tree_at(lambda d: d.modes.damping_ratio, dynamics, jnp.zeros(1))
    with pytest.raises(InputError, match=r"nothing damps mode 1 at 7372 Hz.*Raise damping\.mesh"):
        _dynamics.require_damped(scene.damping, bare)


@pytest.mark.slow
def test_a_slow_pair_has_its_quasi_static_transmission_error(folder):
    """TE of the dynamics and of the statics are the same quantity, on shafts too."""
    shaft = """{ gear_at_mm = 40.0, segments = [ { length_mm = 80.0, outer_mm = 30.0 } ], bearings =
 [ { at_mm = 0.0, radial_N_m = 1e9, axial_N_m = 1e8 }, { at_mm = 80.0, radial_N_m = 1e9 } ] }"""
    joined = shaft.replace("\n", "")
    text = _SPUR.replace("teeth = 20", f"teeth = 20\nshaft = {joined}") + _SWEEP
    scene = read_scene(_scene(folder, text, "slow.toml"), ("sweep.direction=up",))
    scene = scene.replace({"sweep.steps": 24, "sweep.harmonics": 5, "sweep.orders": 1})
    dynamics = _dynamics.solve_dynamics(BuiltScene(scene))
    # Very slowly, many steps of a resonance lie within one of the mesh: its mean is left.
    law, none = law_of(scene.mesh), lambda _: None
    finder = finder_of(law, scene.sweep, dynamics)
    (response,) = swept(law, scene.sweep, dynamics, finder, np.asarray([1.0]), "up", none)
    mean = float(dynamics.statics.numbers["te_mean_um"]) * jg.um
    assert response.settled
    assert response.numbers.te_mean == pytest.approx(mean, rel=5e-3)
    dataset = sweep_dataset(dynamics, Sweep(np.asarray([1.0]), {"up": (response,)}, (), {}))
    assert dataset["bearing"].values.tolist() == ["pinion 0", "pinion 1"]
    assert dataset["bearing_load_order_N"].shape == (1, 1, 2, 3, 1)


def _curve(speed: list[float], **changes: Any) -> Curve:
    """A stable piece of a branch, its values all the same, but for some changes."""
    some = np.ones(len(speed))
    piece = Curve(
        speed=np.array(speed),
        dynamic_ratio=some,
        te_rms=some,
        terms=np.zeros((len(speed), 1, 3)),
        multiplier=0.5j * some,
        stable=some > 0.0,
        folds=(),
        doublings=(),
        tori=(),
        ends=("began", "left"),
        steps=0,
    )
    return dataclasses.replace(piece, **changes)


def _event(speed: float, after: int) -> CurvePoint:
    return CurvePoint(speed, 1.0, np.zeros((1, 3)), after)


def test_a_branch_is_plain_where_nothing_makes_a_machine_leave_it():
    plain, point = _curve([1.0, 2.0, 3.0]), _event(2.0, 1)
    assert is_plain((plain,))
    assert not is_plain(())
    assert not is_plain((plain, plain))
    changes: list[dict[str, Any]] = [{name: (point,)} for name in ("folds", "doublings", "tori")]
    changes += [{"ends": ("began", "lost")}, {"stable": np.array([True, False, True])}]
    changes += [{"speed": np.array([1.0, 3.0, 2.0])}]
    for change in changes:
        assert not is_plain((dataclasses.replace(plain, **change),)), change


def test_what_a_sweep_passes_over_is_unstable_between_two_of_its_speeds():
    """Ranges with a speed in them are seen; on a fold's unstable part no machine was."""
    stable = np.array([True, False, True, True, False, True, False, True])
    piece = _curve(
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 5.5, 7.0],
        stable=stable,
        doublings=(_event(1.9, 0), _event(2.1, 1)),
        tori=(_event(4.5, 3), _event(5.5, 4)),
        folds=(_event(6.1, 5), _event(5.4, 6)),
    )
    over = lambda *speeds: Sweep(np.asarray(speeds), {}, (piece,), {}).passed_over()
    assert over(1.0, 3.0, 4.0, 7.0) == [(1.9, 2.1), (4.5, 5.5)]
    assert over(1.0, 2.0, 3.0, 4.0, 7.0) == [(4.5, 5.5)]
    assert over(1.0, 2.0, 3.0, 5.0, 7.0) == []


# --- From the scene to the library


def test_speeds_are_a_range_or_a_sorted_list(folder):
    path = _scene(folder, _SPUR, "speeds.toml")
    of = lambda text: _dynamics.speeds_of(
        read_scene(path, (f"sweep.pinion_speed_rad_s={text}",)).sweep
    )
    assert of("{from=10, to=20, points=3}").tolist() == [10.0, 15.0, 20.0]
    assert of("[30, 10, 20, 10]").tolist() == [10.0, 20.0, 30.0]


def test_damping_and_method_follow_the_scene(folder):
    path = _scene(folder, _SPUR + _SWEEP, "methods.toml")
    damping = _dynamics.damping_of(read_scene(path, ("damping.mesh=0.05",)).damping)
    assert isinstance(damping, ModalDamping)
    assert float(damping.mesh) == 0.05
    rayleigh = ("damping.kind=rayleigh", "damping.a_R_1_s=25.0", "damping.b_R_s=2.5e-6")
    damping = _dynamics.damping_of(read_scene(path, rayleigh).damping)
    assert isinstance(damping, RayleighDamping)
    assert float(damping.stiffness_factor) == 2.5e-6


def test_long_cycles_are_marched(folder):
    """60 harmonics of 1000 mesh periods are too many unknowns; 100 mesh periods are 5 cycles of 20,
    and 4 of 1000 are the least.
    """
    path = _scene(folder, _SPUR + _SWEEP, "long.toml")

    def settings(*overrides):
        scene = read_scene(path, ("sweep.harmonics=20", "mesh.phases=8", *overrides))
        size = _dynamics.Size(1, scene.mesh.periods)
        return _dynamics.settings_of(law_of(scene.mesh), scene.sweep, size)

    assert isinstance(settings().method, HarmonicBalance)
    assert isinstance(settings("mesh.periods=4").method, HarmonicBalance)
    assert isinstance(settings("mesh.periods=20").method, HarmonicBalance)
    assert isinstance(settings("mesh.periods=1000").method, HarmonicBalance)
    long = settings("mesh.periods=1000", "sweep.harmonics=60")
    assert isinstance(long.method, TimeStepping)
    assert long.method.cycles == 4
    assert isinstance(settings("sweep.method=newmark").method, TimeStepping)
    marched = settings("mesh.periods=20", "sweep.method=newmark").method
    assert isinstance(marched, TimeStepping)
    assert marched.cycles == 5


def test_branches_are_followed_with_both_directions_but_over_long_cycles(folder):
    path = _scene(folder, _SPUR + _SWEEP, "followed.toml")

    def followed(periods: int, *overrides: str) -> bool:
        asked = read_scene(path, ("sweep.harmonics=20", *overrides)).sweep
        return _dynamics.is_followed(asked, _dynamics.Size(1, periods))

    assert followed(1, "sweep.direction=both")
    assert not followed(1, "sweep.direction=up")
    assert followed(39, "sweep.direction=both")
    assert not followed(41, "sweep.direction=both")
    assert followed(41, "sweep.direction=both", "sweep.continuation=true")
    assert not followed(1, "sweep.direction=both", "sweep.continuation=false")


def test_divisions_cut_shafts_into_finite_elements(folder):
    shaft = "{ gear_at_mm = 40.0, segments = [ { length_mm = 80.0, outer_mm = 30.0 } ], "
    bearing = "{ at_mm = 0.0, radial_N_m = 1e9, axial_N_m = 1e8, tilt_Nm_rad = 1e5 }"
    shaft += f"bearings = [ {bearing} ], divisions = 3 }}"
    path = _scene(folder, _SPUR.replace("teeth = 40", f"teeth = 40\nshaft = {shaft}"), "cut.toml")
    model = model_of(read_scene(path))
    assert isinstance(model.wheel_support, Shaft)
    assert model.wheel_support.layout.divisions == 3


# --- Refusals


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (("damping.mesh=0", "damping.structure=0"), "no damping: at a resonance there is no"),
        (("sweep.harmonics=24",), "less than half of sweep.steps, 48"),
        (("sweep.method=newmark", "sweep.continuation=true"), "needs harmonic balance"),
        (
            ("damping={kind='rayleigh', a_R_1_s=1.0, b_R_s=1e-6, active_mesh=true}",),
            "Rayleigh damping has none",
        ),
        (("sweep.pinion_speed_rad_s={from=20, to=10, points=3}",), "must be less than `to`, 10"),
        (("sweep.pinion_speed_rad_s=[0.0, 10.0]",), "must be a list of numbers, each > 0 [rad/s]"),
        (("sweep.pinion_speed_rad_s=[]",), "got []"),
    ],
)
def test_what_cannot_be_swept_is_refused(folder, capsys, changes, words):
    path = _scene(folder, name="refused.toml")
    arguments = [part for change in changes for part in ("--set", change)]
    out = folder / "refused"
    assert main(["sweep", str(path), "--out", str(out), *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert not [path for path in out.rglob("*") if path.is_file()]


def test_mistakes_of_a_sweep_come_together_with_file_and_line(folder, capsys):
    text = _SPUR + _SWEEP + 'continuation = true\nmethod = "shooting"\n'
    text += "[damping]\nmesh = 0.0\nstructure = 0.0\n"
    path = _scene(folder, text, "two.toml")
    assert main(["sweep", str(path), "--out", str(folder / "two")]) == 2
    error = capsys.readouterr().err
    lines = text.splitlines()
    for key, start in (("damping.mesh", "mesh = 0.0"), ("sweep.continuation", "continuation")):
        line = next(i for i, x in enumerate(lines, start=1) if x.startswith(start))
        assert f"{path}:{line}: {key}: " in error
    assert "2 mistakes" in error


def test_without_speeds_the_lines_to_add_are_given(folder, capsys):
    path = _scene(folder, _SPUR, "bare.toml")
    assert main(["sweep", str(path)]) == 2
    error = capsys.readouterr().err
    lines = error[error.index("[sweep]") :]
    path.write_text(_SPUR + lines)
    assert _dynamics.directions_of(read_scene(path).sweep) == ("up", "down")
    refuse_unfit("sweep", read_scene(path))


# --- A condensed wheel

_THIN = (
    tiny_scene(modes=4, gear_at=20.0)
    + """[flank.pinion]
tip_relief = { depth_um = 35.0, extent = 0.25 }
crowning_um = 5.0
[flank.wheel]
tip_relief = { depth_um = 35.0, extent = 0.25 }
[mesh]
stiffness = "constant"
stiffness_N_mm_um = 14.0
slices = 4
root_correction = false
[model]
coordinates = 16
mesh_coordinates = 4
[sweep]
pinion_speed_rad_s = [60.0, 1000.0]
direction = "up"
steps = 24
harmonics = 5
[modes]
count = 10
"""
)


@pytest.mark.slow
def test_a_condensed_wheel_from_its_drawing_to_its_waves(folder, capsys, monkeypatch):
    monkeypatch.setenv("JAXGEAR_CACHE", str(folder / "cache"))
    scene, out = _scene(folder, _THIN, "tiny.toml"), folder / "thin"
    assert main(["modes", str(scene), "--out", str(out)]) == 0
    found = json.loads((out / "modes" / "summary.json").read_text())["modes"]
    assert len(found["frequency_Hz"]) == 10
    assert set(found["gear"]) <= {"pinion", "wheel"}
    assert max(found["nodal_diameter"]) >= 2
    for name in ("modes", "campbell"):
        assert (out / "modes" / f"{name}.png").stat().st_size > 0
    # Beyond what sixteen modes of the body can tell.
    assert main(["modes", str(scene), "--set", "modes.count=60", "--out", str(out)]) == 2
    assert "modes.count is 60" in capsys.readouterr().err
    assert main(["sweep", str(scene), "--out", str(out), "--quiet"]) == 0
    summary = json.loads((out / "sweep" / "summary.json").read_text())
    assert summary["sweep"]["unsettled_count"] == 0
    (waves,) = summary["sweep"]["waves"]
    assert waves["gear"] == "wheel"
    assert len(waves["probes"]) == 4
    (said,) = (note for note in summary["notes"] if "sweep.harmonics = 5" in note)
    # A quarter of sixteen shapes are natural modes, without the first of a pair.
    assert "mode 3 of the wheel's body" in said
    with xr.open_dataset(out / "sweep" / "result.nc", group="waves") as dataset:
        load = dataset["max_line_load_N_mm"].values[0]
        pressure = dataset["max_pressure_MPa"].values[0]
    # Slowly it is the quasi-static cycle where relief lets each tooth take its load by degrees.
    # Without relief it is not at any speed: the motion goes on through the instant of entry, and
    # the tooth that enters meets it whole.
    static = summary["static"]
    assert load[0] == pytest.approx(static["max_line_load_N_mm"], rel=0.01)
    assert pressure[0] == pytest.approx(static["max_pressure_MPa"], rel=0.01)
    assert waves["flank"]["max_line_load_N_mm"] == pytest.approx(load.max())
    for name in ("flank_pressure", "flank_loads", "wheel_waves", "wheel_spectra", "sweep"):
        assert (out / "sweep" / f"{name}.png").stat().st_size > 0
    assert (out / "sweep" / "wheel_shape.gif").stat().st_size > 0
    assert "modes/campbell_critical.csv" in assert_tables(out)


def test_what_a_condensed_body_cannot_show_is_said(folder):
    """Its highest mode against harmonics or steps; more modes than it has."""
    bare = read_scene(_scene(folder, _THIN, "bare.toml"))
    square = (2.0 * np.pi * np.array([3e3, 9e3])) ** 2
    none, waves = np.zeros((6, 2)), np.array([0, 4])
    basis = BodyBasis(square, none, np.eye(6), waves, waves)
    bodies = {"wheel": SimpleNamespace(basis=basis, made_of=None)}
    scene = dataclasses.replace(bare, bodies=bodies)
    # 9 kHz is the 2.83rd order of 20 teeth at 1000 rad/s, the 47.1st at 60.
    too_many, reach = sweep_notes(scene, 0, 2)
    assert "asks for 16 modes, but the wheel's condensed body has 2" in too_many
    assert "mode 2 of the wheel's body, 9000 Hz with 4 nodal diameters" in reach
    assert "below 565.49 rad/s" in reach
    assert "sweep.harmonics must be at least 3 at 1000 rad/s, 48 at 60 rad/s" in reach
    marched = scene.replace({"sweep.method": "newmark", "sweep.steps": 24})
    (_, reach) = sweep_notes(marched, 0, 2)
    assert "at all speeds up to 1000 rad/s" in reach
    assert "sweep.steps must be at least 29 at 1000 rad/s, 472 at 60 rad/s" in reach
    fine = scene.replace({"sweep.harmonics": 48, "model.coordinates": 2})
    assert sweep_notes(fine, 0, 2) == []
    (passed,) = sweep_notes(fine, 0, 2, (), ((929.1, 940.75), (1081.9, 1083.3)))
    assert "unstable: 929.1 to 940.75, 1081.9 to 1083.3 rad/s" in passed


def test_prominent_maxima_are_those_of_scipy():
    draw = np.random.default_rng(0)
    for count in range(1, 60):
        values, least = draw.random(count), 0.5 * draw.random()
        expected = scipy.signal.find_peaks(values, prominence=least)[0]
        assert prominent(values, least) == list(expected)


def test_of_a_flat_top_the_first_place_is_the_maximum():
    assert prominent(np.asarray([0.0, 1.0, 1.0, 0.5, 1.0, 1.0, 2.0]), 0.4) == [1]
