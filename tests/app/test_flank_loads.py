"""Loads on the flanks at speed: numbers, datasets and pictures of loads made by hand."""

import dataclasses

import numpy as np
import pytest
import xarray as xr
from jaxgear.study._flank_loads import loads_over_speeds, tooth_places

from jaxgear._response._flank_loads import FlankLoads
from jaxgear._units import MPa, deg, mm
from jaxgear.plot import _flank_pictures as pictures
from jaxgear.plot import _flank_tables as tables
from jaxgear.study._flank_dataset import loads_summary
from jaxgear.study._hybrid_dataset import HolePlaces

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
        teeth=(20, 24),
        width=12.0 * mm,
    )


def test_the_largest_is_found_where_it_is():
    loads = _loads()
    found = loads.numbers()
    assert found["flank_line_load"] == pytest.approx(3e5, rel=0.01)
    assert found["flank_pressure"] == pytest.approx(1e6 * np.sqrt(3e5), rel=0.01)
    assert found["flank_passage"] == pytest.approx(0.5 * RATIO, abs=0.06)
    assert found["flank_face"] == pytest.approx(4.0 * mm)
    assert found["flank_pair"] == 2
    assert found["flank_by_pair"] == pytest.approx(1.5e5 * np.array([1, 1, 2, 1]), rel=0.01)
    passage, load, pressure = loads.way()
    assert len(passage) == round(RATIO * PHASES)
    assert (np.diff(passage) > 0.0).all()
    assert load[:, 2].max() == found["flank_line_load"]
    assert pressure == pytest.approx(1e6 * np.sqrt(load))


@pytest.fixture(scope="module")
def dataset() -> xr.Dataset:
    each = [_loads(500.0, 1), _loads(900.0, 3)]
    louder = dataclasses.replace(each[1], load=1.5 * each[1].load)
    entries = loads_over_speeds([[x.numbers() for x in (each[0], louder)]])
    found = xr.Dataset({name: entry.variable() for name, entry in entries.items()})
    return found.assign_coords(speed=[500.0, 900.0])


def test_a_sweep_says_how_much_and_where(dataset):
    found = loads_summary(dataset)
    assert found["max_line_load_N_mm"] == pytest.approx(450.0, rel=0.01)
    assert found["max_pressure_MPa"] == pytest.approx(1e6 * np.sqrt(3e5) / MPa, rel=0.01)
    assert found["pinion_speed_rad_s"] == 900.0
    assert found["tooth_pair"] == 3
    assert found["face_position_mm"] == pytest.approx(4.0)
    assert dataset["tooth_line_load_N_mm"].dims == ("direction", "speed", "tooth_pair")


def test_pictures_have_their_data(dataset, tmp_path):
    chosen = [_loads(500.0, 1), _loads(900.0, 2)]
    # Pair 2 of the wheel stands at twice the angle between teeth.
    assert tooth_places(chosen[0], "wheel") == pytest.approx([0.0, 15.0, 30.0, 45.0])
    holes = HolePlaces(np.array([30.0]) * deg, np.array([8.0]) * deg)
    own = dataset.isel(direction=0)
    for name, figure, columns in (
        (
            "pressure",
            pictures.flank_pressure(chosen, "by hand"),
            tables.flank_pressure_columns(chosen),
        ),
        ("loads", pictures.largest_loads(own, "by hand"), tables.largest_loads_columns(own)),
        (
            "teeth",
            pictures.teeth_at_speed(chosen, "wheel", holes, "by hand"),
            tables.teeth_at_speed_columns(chosen, "wheel", holes),
        ),
    ):
        (length,) = {len(values) for values in columns.values()}
        assert length > 0
        figure.savefig(tmp_path / f"{name}.png", dpi=60)
    above = columns["above_a_hole"].astype(bool)
    assert columns["tooth_angle_deg"][above] == pytest.approx([30.0, 30.0])
    # At the second speed that tooth is the heavy one.
    assert columns["line_load_max_N_mm"][above] == pytest.approx([150.0, 300.0], rel=0.01)
