"""`jaxgear modes` end to end: a pair that only turns, and one on shafts."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from table_checks import assert_tables

from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear._dynamics._bodies import BodyPlace
from jaxgear._dynamics._system import PairDynamics
from jaxgear.scene._scene import read_scene
from jaxgear.study._modes import modes_shown
from jaxgear.study._turning import require_retained

_SPUR = """schema = 1
name = "spur"
[pair]
module_mm = 3.0
torque_pinion_Nm = 100.0
[pinion]
teeth = 20
face_width_mm = 20.0
[pinion.body]
mass_kg = 1.0
inertia_kg_m2 = 4e-4
transverse_inertia_kg_m2 = 3e-4
[wheel]
teeth = 40
face_width_mm = 20.0
[wheel.body]
mass_kg = 3.0
inertia_kg_m2 = 5e-3
transverse_inertia_kg_m2 = 3e-3
[mesh]
slices = 1
[sweep]
pinion_speed_rad_s = [100.0, 3000.0]
steps = 32
"""
_SHAFT = (
    "[wheel.shaft]\ngear_at_mm = 30.0\nsegments = [ { length_mm = 80.0, outer_mm = 30.0 } ]\n"
    "bearings = [ { at_mm = 0.0, radial_N_m = 5e8, axial_N_m = 1e8 },\n"
    "             { at_mm = 80.0, radial_N_m = 5e8 } ]\n"
)


def _modes(tmp_path, text, *changes, pictures=True) -> dict:
    path, out = tmp_path / "scene.toml", tmp_path / "out"
    path.write_text(text)
    arguments = [part for change in changes for part in ("--set", change)]
    arguments += [] if pictures else ["--no-pictures"]
    assert main(["modes", str(path), "--out", str(out), *arguments]) == 0
    return json.loads((out / "modes" / "summary.json").read_text())


@pytest.mark.slow
def test_two_discs_swing_at_the_frequency_of_their_mesh(tmp_path, capsys):
    """omega^2 = k (r_b1^2/I_1 + r_b2^2/I_2); no damping is no mistake here."""
    changes = "damping.mesh=0.0", "damping.structure=0.0", "mesh.stiffness=constant"
    changes += ("mesh.stiffness_N_mm_um=14.0",)
    summary = _modes(tmp_path, _SPUR, *changes, pictures=False)
    found, geometry = summary["modes"], summary["geometry"]
    inertia = {"pinion": 4e-4, "wheel": 5e-3}
    radius = {name: 1e-3 * geometry[f"base_radius_{name}_mm"] for name in inertia}
    stiffness = 1e6 * summary["static"]["mesh_stiffness_mean_N_um"]
    square = stiffness * sum(radius[name] ** 2 / inertia[name] for name in inertia)
    expected = np.sqrt(square) / (2.0 * np.pi)
    assert found["frequency_Hz"] == pytest.approx([expected], rel=1e-9)
    assert found["energy"]["mesh"] == pytest.approx([1.0])
    assert found["damping_ratio"] == pytest.approx([0.0], abs=1e-12)
    for h in (1, 2, 3, 4):
        speed = found["critical_speed_rad_s"][f"mesh_harmonic_{h}"]
        assert speed == pytest.approx([2.0 * np.pi * expected / (20 * h)], rel=1e-9)
    # A table for the reader, one row for each mode.
    heads, row, *_ = capsys.readouterr().out.splitlines()
    assert heads.split()[:2] == ["mode", "Hz"]
    assert float(row.split()[1]) == pytest.approx(expected, rel=1e-5)
    out = tmp_path / "out" / "modes"
    assert assert_tables(out) == ["campbell.csv", "campbell_critical.csv", "modes.csv"]
    with xr.open_dataset(out / "result.nc", group="modes") as dataset:
        assert dataset["frequency_Hz"].values == pytest.approx(found["frequency_Hz"], rel=1e-12)


@pytest.mark.slow
def test_shafts_and_bearings_share_the_energy_and_whirl(tmp_path):
    changes = ("modes.highest_Hz=20000.0", "model.gyroscopic=true", "damping.mesh=0.1")
    summary = _modes(tmp_path, _SPUR + _SHAFT, *changes)
    found = summary["modes"]
    frequency = np.asarray(found["frequency_Hz"])
    assert np.all(np.diff(frequency) >= 0.0)
    assert frequency[-1] <= 20000.0
    assert 1 < len(frequency) < found["total"]
    parts = np.stack([found["energy"][name] for name in ("mesh", "pinion", "wheel", "bearings")])
    np.testing.assert_allclose(parts.sum(axis=0), 1.0, atol=1e-9)
    np.testing.assert_allclose(parts[1], 0.0, atol=1e-9)
    # Eq. 2.36: the mesh's share of its own ratio, and the rest of the other.
    np.testing.assert_allclose(found["damping_ratio"], 0.1 * parts[0] + 0.02 * (1.0 - parts[0]))
    out = tmp_path / "out" / "modes"
    for name in ("modes", "campbell"):
        for ending in ("png", "svg", "csv"):
            assert (out / f"{name}.{ending}").stat().st_size > 0
    with xr.open_dataset(out / "result.nc", group="campbell") as dataset:
        np.testing.assert_allclose(dataset["frequency_Hz"][0], frequency, rtol=1e-8)
        # Bending splits with speed, forwards and backwards.
        assert float(np.abs(dataset["frequency_Hz"][-1] / frequency - 1.0).max()) > 1e-4


def test_how_many_modes_are_shown(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(_SPUR)
    frequency = np.arange(1.0, 31.0)
    shown = lambda *changes: modes_shown(read_scene(path, changes).modes, frequency, 12)
    assert shown() == 12
    assert shown("modes.highest_Hz=20.5") == 20
    assert shown("modes.highest_Hz=20.5", "modes.count=5") == 5
    assert shown("modes.count=100") == 30
    with pytest.raises(InputError, match=r"up to modes\.highest_Hz, 0\.5 Hz: the first has 1 Hz"):
        shown("modes.highest_Hz=0.5")


def test_more_modes_than_a_condensed_body_can_tell_are_refused(tmp_path):
    """Two modes of the body, the higher at 5 kHz; the pair has three below, and one above."""
    path = tmp_path / "scene.toml"
    path.write_text(_SPUR)
    place, pair = object.__new__(BodyPlace), object.__new__(PairDynamics)
    square = (2.0 * np.pi * np.array([1e3, 5e3])) ** 2
    mass = np.array([2.0, 1e-3, 1.0, 1e-6])
    whole = mass * (2.0 * np.pi * np.array([4e3, 9e2, 2e3, 7e3])) ** 2
    system = SimpleNamespace(mass=np.diag(mass), whole_stiffness=np.diag(whole))
    for module, name, value in (
        (place, "square", square),
        (place, "index", 1),
        (pair, "bodies", (place,)),
        (pair, "system", system),
    ):
        object.__setattr__(module, name, value)
    require_retained(read_scene(path, ("modes.count=3",)).modes, 100, pair)
    with pytest.raises(InputError, match=r"modes\.count is 4, .*wheel's.* 5000 Hz.* has 3 below"):
        require_retained(read_scene(path, ("modes.count=4",)).modes, 100, pair)
