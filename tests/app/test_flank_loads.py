"""Loads on the flanks at speed: numbers, datasets and pictures of loads made by hand."""

import dataclasses

import numpy as np
import pytest
import xarray as xr
from table_checks import assert_table

from jaxgear import plot
from jaxgear._response._flank_loads import FlankLoads
from jaxgear._units import MPa, deg, mm
from jaxgear._whole_file import write_csv
from jaxgear.study._body_waves import Seen
from jaxgear.study._flank_dataset import Teeth, flanks_of, largest_loads, loads_summary

PERIODS, PHASES, SLICES, RATIO = 4, 10, 3, 1.6


def _loads(speed: float = 1000.0, heavy: int = 2) -> FlankLoads:
    """Two lines over four mesh periods; one tooth pair carries twice as much at one end."""
    phase = (np.arange(PERIODS * PHASES) + 0.5) / PHASES
    passage = np.mod(phase, 1.0)[:, None] + np.arange(2)
    pair = np.rint(phase[:, None] - passage).astype(int) % PERIODS
    touching = passage < RATIO
    shape = np.where(touching, np.sin(np.pi * passage / RATIO), 0.0)[:, :, None]
    factor = np.where(pair == heavy, 2.0, 1.0)[:, :, None]
    load = 1e5 * shape * factor * np.array([0.5, 1.0, 1.5])
    return FlankLoads(
        speed=speed,
        passage=passage,
        pair=pair,
        touching=touching,
        face=4.0 * mm * np.array([-1.0, 0.0, 1.0]),
        load=load,
        pressure=1e6 * np.sqrt(load),
    )


def test_the_largest_is_found_where_it_is():
    loads = _loads()
    found = loads.largest
    assert found.line_load == pytest.approx(3e5, rel=0.01)
    assert found.pressure == pytest.approx(1e6 * np.sqrt(3e5), rel=0.01)
    assert found.passage == pytest.approx(0.5 * RATIO, abs=0.06)
    assert found.face == pytest.approx(4.0 * mm)
    assert found.pair == 2
    assert found.by_pair == pytest.approx(1.5e5 * np.array([1, 1, 2, 1]), rel=0.01)
    passage, load, pressure = loads.way()
    assert len(passage) == round(RATIO * PHASES)
    assert (np.diff(passage) > 0.0).all()
    assert load[:, 2].max() == found.line_load
    assert pressure == pytest.approx(1e6 * np.sqrt(load))


@pytest.fixture(scope="module")
def dataset() -> xr.Dataset:
    each = [_loads(500.0, 1), _loads(900.0, 3)]
    louder = dataclasses.replace(each[1], load=1.5 * each[1].load)
    entries = largest_loads([[Seen(x.largest, {}, {}) for x in (each[0], louder)]])
    found = xr.Dataset({name: entry.variable() for name, entry in entries.items()})
    about = {"long_name": "speed of the pinion", "units": "rad/s"}
    found = found.assign_coords(speed=("speed", [500.0, 900.0], about), direction=["up"])
    return found.assign_attrs(peak_direction="up", title="by hand")


def test_a_sweep_says_how_much_and_where(dataset):
    found = loads_summary(dataset)
    assert found["max_line_load_N_mm"] == pytest.approx(450.0, rel=0.01)
    assert found["max_pressure_MPa"] == pytest.approx(1e6 * np.sqrt(3e5) / MPa, rel=0.01)
    assert found["pinion_speed_rad_s"] == 900.0
    assert found["tooth_pair"] == 3
    assert found["face_position_mm"] == pytest.approx(4.0)
    assert dataset["tooth_line_load_N_mm"].dims == ("direction", "speed", "tooth_pair")


@pytest.mark.slow
def test_pictures_have_their_data(dataset, tmp_path):
    chosen = [_loads(500.0, 1), _loads(900.0, 2)]
    holes = np.array([[30.0, 8.0]]) * deg
    flanks = flanks_of(chosen, 12.0 * mm, [Teeth("wheel", 24, holes)])
    # Pair 2 of the wheel stands at twice the angle between teeth.
    assert flanks["wheel_tooth_angle_deg"].values == pytest.approx([0.0, 15.0, 30.0, 45.0])
    found = {
        each.name: each
        for each in plot.pictures(
            {"waves": dataset, "flanks": flanks.assign_attrs(title="by hand")}
        )
    }
    assert list(found) == ["flank_pressure", "flank_loads", "wheel_teeth_at_speed"]
    for each in found.values():
        write_csv(each.table, tmp_path / f"{each.name}.csv")
        assert len(assert_table(tmp_path / f"{each.name}.csv"))
        each.draw().savefig(tmp_path / f"{each.name}.png", dpi=60)
    assert len(found["flank_pressure"].table["passage"]) == 2 * round(RATIO * PHASES) * SLICES
    columns = found["wheel_teeth_at_speed"].table
    above = columns["above_a_hole"].astype(bool)
    assert columns["tooth_angle_deg"][above] == pytest.approx([30.0, 30.0])
    # At the second speed that tooth is the heavy one.
    assert columns["line_load_max_N_mm"][above] == pytest.approx([150.0, 300.0], rel=0.01)
