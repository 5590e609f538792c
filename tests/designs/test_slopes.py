"""Derivatives of modes and sweeps in a study, against differences between designs."""

from pathlib import Path

import numpy as np
import pytest
from helpers import assert_close

import jaxgear as jg

_BEARING = "wheel.shaft.bearings[0].radial_N_m"
_TORQUE = "pair.torque_pinion_Nm"
_DEPTH = "flank.pinion.tip_relief.depth_um"


def _table(folder: Path, command: str, numbers: list[str], rows: list[str], more: str):
    """The results of designs that are listed."""
    (folder / "designs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    names = ", ".join(f'"{each}"' for each in numbers)
    (folder / "moving.toml").write_text(
        f'schema = 1\nscene = "accessory"\nset = ["mesh.slices=1", {more}]\n'
        f'command = "{command}"\n[design]\ncsv = "designs.csv"\n'
        f"[keep]\nnumbers = [{names}]\ngradients = true\n[work]\nchunk = 32\n",
        encoding="utf-8",
    )
    found = jg.designs.run(folder / "moving.toml", folder / "results")
    assert not any(found.designs["reason"].values)
    return found.designs


def _compared(folder: Path, command: str, numbers: list[str], centre: dict, steps: dict, more: str):
    """Derivatives at the first design, and central differences of fourth order by each key."""
    rows = [",".join(f'"{key}"' for key in centre)]
    rows.append(",".join(map(repr, centre.values())))
    for key, step in steps.items():
        for share in (-1.0, -0.5, 0.5, 1.0):
            rows.append(",".join(repr(x + share * step * (k == key)) for k, x in centre.items()))
    designs = _table(folder, command, numbers, rows, more)
    found = designs["gradient"].sel(design=0)
    values = np.stack([designs[name].values for name in numbers])
    for place, key in enumerate(steps):
        low, half_low, half_high, high = values[:, 1 + 4 * place : 5 + 4 * place].T
        coarse, fine = (high - low) / (2.0 * steps[key]), (half_high - half_low) / steps[key]
        yield key, found.sel(moved=key).values, (4.0 * fine - coarse) / 3.0, values[:, 0]


@pytest.mark.slow
def test_of_modes(tmp_path):
    # The ninth mode is that of the mesh; the fourth is of the wheel's shaft alone.
    numbers = [
        *("modes.frequency_Hz[3]", "modes.frequency_Hz[8]", "modes.damping_ratio[8]"),
        *("modes.energy.mesh[8]", "modes.critical_speed_rad_s.mesh_harmonic_2[8]"),
    ]
    centre = {_BEARING: 9.0e8, _TORQUE: 80.0, "damping.mesh": 0.07}
    steps = {_BEARING: 2e6, _TORQUE: 1.0, "damping.mesh": 0.004}
    for key, slope, difference, value in _compared(
        tmp_path, "modes", numbers, centre, steps, '"mesh.phases=16"'
    ):
        # What a key does not move has a difference of rounding.
        rounding = 1e-9 * np.abs(value) / centre[key]
        assert np.all(np.abs(slope - difference) <= 1e-6 * np.abs(difference) + rounding), key
        moved = {_BEARING: 5, _TORQUE: 4, "damping.mesh": 1}
        assert np.sum(np.abs(slope) > 1e3 * rounding) == moved[key], key


@pytest.mark.slow
def test_of_sweeps(tmp_path):
    numbers = [
        *("sweep.te_rms_um_up[1]", "sweep.dynamic_ratio_up[1]", "sweep.pair_ratio_up[0]"),
    ]
    centre = {_DEPTH: 12.0, _TORQUE: 80.0, _BEARING: 9.0e8}
    steps = {_DEPTH: 2e-3, _TORQUE: 1e-2, _BEARING: 5e5}
    more = '"sweep.pinion_speed_rad_s=[500.0, 700.0]", "sweep.direction=up", "sweep.steps=32", '
    more += '"sweep.harmonics=6"'
    for key, slope, difference, _ in _compared(tmp_path, "sweep", numbers, centre, steps, more):
        assert_close(slope, difference, rtol=1e-5, atol=0.0)
        assert np.all(slope != 0.0), key
