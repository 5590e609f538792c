"""Every table that pictures write: one table each, told by its header, read back by pandas."""

import functools
import importlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from table_checks import assert_table, is_told

import jaxgear as jg
from jaxgear import plot
from jaxgear._dynamics._campbell import CriticalSpeed
from jaxgear.plot import _tables
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import ready_scene
from jaxgear.study import _hybrid_dataset, _ladder, _sizing
from jaxgear.study._flank_loads import FlankLoads
from jaxgear.study._hybrid import BodyAnswer, BodyField
from jaxgear.study._results import write_csv

_SPEEDS = np.asarray([100.0, 200.0, 300.0])
_PHASES = (np.arange(48) + 0.5) / 16
_TORQUES = np.asarray([20.0, 40.0])


def _data(
    sizes: Mapping[str, int], variables: Mapping[str, tuple[str, ...]], **coords
) -> xr.Dataset:
    """A dataset of numbers, no two of them alike."""
    made = {}
    for start, (name, dims) in enumerate(variables.items(), 1):
        shape = [len(coords[dim]) if dim in coords else sizes[dim] for dim in dims]
        made[name] = (dims, start + np.arange(np.prod(shape)).reshape(shape) / np.prod(shape))
    return xr.Dataset(made, coords, {"teeth_pinion": 20, "teeth_wheel": 40, "face_width_mm": 9.0})


def _bare(kind: type, **fields) -> Any:
    """A thing of which a table sees these fields only."""
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def _cycle() -> xr.Dataset:
    """Three mesh periods of two lines and three slices, with what condensed bodies add."""
    cells, lines = ("phase", "line", "slice"), ("phase", "line")
    data = _data(
        {"line": 2, "slice": 3, "path_point": 5},
        {
            **dict.fromkeys(("transmission_error_um", "mesh_stiffness_N_um"), ("phase",)),
            **dict.fromkeys(("line_load_N_mm", "pressure_MPa", "cell_force_N"), cells),
            "path_point_roll_mm": ("path_point",),
        },
        phase=_PHASES,
        line=[0, 1],
        face_position_mm=("slice", [-3.0, 0.0, 3.0]),
    )
    passage = np.stack([_PHASES % 1.0, _PHASES % 1.0 + 1.0], axis=1)
    place = np.broadcast_to((passage / 2.0)[:, :, None], (48, 2, 3))
    data = data.assign_coords(passage=(lines, passage), path_point=list("ABCDE"))
    data = data.assign(
        weight=("phase", np.full(48, 1.0 / 48)),
        load_sharing=(lines, np.tile([0.6, 0.4], (48, 1))),
        roll_mm=(cells, 10.0 + place),
        profile_position=(cells, place),
        fraction=(cells, np.ones((48, 2, 3))),
    )
    data.attrs["base_radius_pinion_mm"] = 30.0
    return _hybrid_dataset.hybrid_variables(data, [])


def _sweep() -> xr.Dataset:
    """Two directions, one response without a number, and two pieces of a curve with a fold."""
    names = ("dynamic_ratio", "te_rms_um", "contact_loss", "periods")
    data = _data(
        {},
        dict.fromkeys(names, ("speed", "direction")),
        speed=_SPEEDS,
        direction=["up", "down"],
    )
    data["dynamic_ratio"][1, 1] = np.nan
    flags = (("speed", "direction"), np.ones((3, 2), bool))
    points = [1.0, 2.0, 3.0, 2.5, np.nan, 5.0, 6.0]
    curve = dict.fromkeys(("curve_speed", "curve_dynamic_ratio", "curve_te_rms_um"))
    return data.assign(
        settled=flags, stable=flags, curve_stable=("point", np.ones(7, bool))
    ).assign({name: ("point", points) for name in curve})


def _orders() -> xr.Dataset:
    pairs = ("speed", "order")
    return _data(
        {},
        {
            **dict.fromkeys(("te_order_um", "mesh_force_order_N"), pairs),
            "bearing_force_order_N": ("speed", "bearing", "order"),
        },
        speed=_SPEEDS,
        order=[0.0, 0.5, 1.0],
        bearing=["pinion 0", "wheel 1"],
    )


def _turning() -> xr.Dataset:
    pairs = ("speed", "mode")
    names = ("frequency_Hz", "frequency_body_Hz", "mesh_energy")
    data = _data({"mode": 2}, dict.fromkeys(names, pairs), speed=_SPEEDS)
    data["frequency_Hz"] *= 500.0
    whole = {"gear": [[0, 1]] * 3, "direction": [[0, 2]] * 3, "nodal_diameter": [[2, 3]] * 3}
    return data.assign({name: (pairs, np.asarray(each)) for name, each in whole.items()})


def _modes() -> xr.Dataset:
    names = ("frequency_Hz", "damping_ratio", "nodal_diameter", "wave_share")
    data = _data(
        {"mode": 3},
        dict.fromkeys(names, ("mode",)) | {"energy": ("mode", "part")},
        part=["mesh", "pinion"],
    )
    data["energy"][0] = np.nan
    return data.assign(gear=("mode", ["pinion", "wheel", "wheel"]))


def _orbits() -> xr.Dataset:
    names = ("mesh_force_ratio", "te_um", "te_rate_mm_s")
    data = _data(
        {},
        dict.fromkeys(names, ("branch", "phase")) | {"te_static_um": ("phase",)},
        branch=["speed rising", "speed falling"],
        phase=_PHASES,
    )
    # One repeats every mesh period, the other after all three.
    whole = (data["branch"] == "speed falling") | (data["phase"] < 1.0)
    return data.assign({name: data[name].where(whole) for name in names})


def _waves() -> xr.Dataset:
    way = ("direction", "speed")
    data = _data(
        {"order": 4, "wave": 3, "number": 5, "along": 3},
        {
            "wheel_probe_amplitude_um": ("wheel_probe", "order"),
            "wheel_order": ("order",),
            "wheel_wave_amplitude_um": ("wave", "along"),
            **dict.fromkeys(("wheel_wave_order", "wheel_wave_diameters"), ("wave",)),
            "wheel_wave_travel_rad_s": ("wave",),
            "wheel_wave_rms_um": (*way, "number", "along"),
            "wheel_diameters": ("number",),
            "wheel_probe_rms_um": (*way, "wheel_probe"),
            **dict.fromkeys(("max_line_load_N_mm", "max_pressure_MPa"), way),
            **dict.fromkeys(("max_line_load_passage", "max_line_load_face_mm"), way),
        },
        speed=_SPEEDS,
        direction=["up"],
        wheel_probe=["on the web", "beside the rim"],
    )
    data.attrs["peak_direction"] = "up"
    return data


def _loads() -> list[FlankLoads]:
    passage = np.mod(_PHASES, 1.0)[:, None] + np.arange(2)
    load = np.ones((48, 2, 3))
    one = FlankLoads(
        speed=500.0,
        passage=passage,
        pair=np.rint(_PHASES[:, None] - passage).astype(int) % 3,
        touching=passage < 1.6,
        face=1e-3 * np.arange(3.0),
        load=load,
        pressure=load,
        teeth=(20, 24),
        width=0.01,
    )
    return [one, one]


def _chart() -> tuple[Any, Any]:
    extent, depth = np.linspace(0.1, 0.4, 4), np.linspace(0.0, 20e-6, 3)
    chart = SimpleNamespace(extent=extent, depth=depth, value=np.ones((3, 4)))
    return chart, SimpleNamespace(depth=1e-5 * np.ones(4), value=np.ones(4))


def _field() -> tuple[BodyAnswer, BodyField]:
    rim = np.random.default_rng(1).normal(size=(6, 3))
    body = SimpleNamespace(rim_nodes=rim)
    shown = BodyField("mesh", "load", rim, rim, 0.3)
    return _bare(BodyAnswer, gear="wheel", built=SimpleNamespace(body=body)), shown


_CURVE = {
    "torque_Nm": 60.0,
    **{
        name: np.asarray([1.0, 2.0])
        for name in ("extent", "depth_um", "te_rms_um", "te_rms_per_depth", "closed_form_depth_um")
    },
}
_BEARINGS = [
    {"gear": gear, "index": index, "load_N": dict.fromkeys("STZ", 1.0)}
    for gear in ("pinion", "wheel")
    for index in (0, 1)
]
_CRITICAL = [
    CriticalSpeed(
        speed=100.0,
        harmonic=1,
        mode=0,
        gear=1,
        diameters=2,
        direction=1,
        space=900.0,
        body=np.nan,
        mesh=0.2,
    )
]
_HOLES = _hybrid_dataset.HolePlaces(np.asarray([0.5]), np.asarray([0.2]))
_RUNGS = [
    {"name": "H5", "family": "a", "dofs": 1, "time_s": 0.1, "error": {"te_rms": None}},
    {"name": "H9", "family": "b", "dofs": 1, "time_s": 0.2, "held_out": {"te_rms": 0.1}},
]


@functools.cache
def _accessory() -> jg.PairModel:
    return model_of(ready_scene("accessory", ("mesh.phases=8", "mesh.slices=2")))


def _sizings() -> _sizing.SizingTable:
    keys = ("flank.pinion.tip_relief.depth_um", "flank.pinion.tip_relief.extent")
    values = np.ones((3, 2, len(_sizing.RESPONSES)))
    values[2, 1] = np.nan
    return _sizing._ranked(keys, _TORQUES, np.arange(6.0).reshape(3, 2), values)


# What each function that ends in `_columns` is given, by its module and its name.
_CASES = {
    "_axes_tables.axes": lambda: (_accessory().pair,),
    "_campbell_tables.campbell": lambda: (_turning(),),
    "_campbell_tables.campbell_on_body": lambda: (_turning(), "wheel"),
    "_campbell_tables.critical": lambda: (_turning(), _CRITICAL),
    "_curve_tables.family": lambda: ([_CURVE, _CURVE],),
    "_dynamic_tables.sweep": lambda: (_sweep(),),
    "_dynamic_tables.curve": lambda: (_sweep(),),
    "_dynamic_tables.fold": lambda: (_sweep(),),
    "_dynamic_tables.critical": lambda: ([(100.0, "mode 1"), (200.0, "mode 1 / 2")],),
    "_dynamic_tables.waterfall": lambda: (_orders(),),
    "_dynamic_tables.orders": lambda: (_orders(),),
    "_dynamic_tables.bearing_orders": lambda: (_orders(),),
    "_dynamic_tables.contact_loss": lambda: (_loss(),),
    "_dynamic_tables.contact_shares": lambda: (_loss(),),
    "_dynamic_tables.modes": lambda: (_modes(),),
    "_dynamic_tables.campbell": lambda: (_turning(),),
    "_dynamic_tables.crossing": lambda: (_turning(),),
    "_dynamic_tables.orbit": lambda: (_orbits(),),
    "_flank_tables.flank_pressure": lambda: (_loads(),),
    "_flank_tables.largest_loads": lambda: (_waves().sel(direction="up"),),
    "_flank_tables.teeth_at_speed": lambda: (_loads(), "wheel", _HOLES),
    "_hybrid_tables.contact_line_loads": lambda: (_cycle(),),
    "_hybrid_tables.tooth_way": lambda: (_cycle(),),
    "_hybrid_tables.tooth_loads": lambda: (_cycle(), "wheel", _HOLES),
    "_hybrid_tables.deflected_body": _field,
    "_modification_tables.modification": lambda: ({"given": _accessory()},),
    "_robust_tables.robust": lambda: (dict(nominal=_TORQUES, robust=_SPEEDS), "um"),
    "_robust_tables.robust_errors": lambda: (dict(nominal=_cycle(), robust=_cycle()),),
    "_robust_tables.tornado": lambda: (
        ["a", "b"],
        ["+-1", "+-2"],
        {name: (1.0, _TORQUES, _TORQUES) for name in ("nominal", "robust")},
        "-",
    ),
    "_tables.gear_pair": lambda: (_accessory(),),
    "_sliding_tables.sliding": lambda: (_accessory().pair,),
    "_tables.shafts": lambda: (_accessory(), object.__new__(jg.MeshCycle)),
    "_tables.bearing": lambda: (_accessory(), _BEARINGS),
    "_tables.transmission_error": lambda: (_cycle(),),
    "_tables.te_harmonics": lambda: (_cycle(),),
    "_tables.mesh_stiffness": lambda: (_cycle(),),
    "_tables.load_sharing": lambda: (_cycle(),),
    "_tables.flank_maps": lambda: (_cycle(),),
    "_tables.face_load": lambda: (_cycle(),),
    "_tables.harris_map": lambda: (_TORQUES, _PHASES, np.ones((2, 48))),
    "_tables.harris_curves": lambda: (_TORQUES, _PHASES, np.ones((2, 48))),
    "_tables.te_spectrum": lambda: (_TORQUES, _PHASES, np.ones((2, 48))),
    "_tables.smoothing_bias": lambda: (_SPEEDS, _SPEEDS, _SPEEDS),
    "_tables.master_curve": lambda: _chart()[:1],
    "_tables.valley": lambda: (*_chart(), np.asarray([np.nan, 1.0, 1.0, 1.0])),
    "_tables.search_trace": lambda: ({"lbfgs": _SPEEDS, "adam": _TORQUES}, "um2"),
    "_tables.before_after": lambda: (_cycle(), _cycle()),
    "_wave_tables.wave_spectra": lambda: (_waves(), "wheel"),
    "_wave_tables.wave_map": lambda: (_waves(), "wheel"),
    "_wave_tables.wave_levels": lambda: (_waves(), "wheel"),
    "_wave_tables.probe_levels": lambda: (_waves(), "wheel"),
}
# Tables that are made where they are written.
_OTHERS = {
    "sizing": lambda: _sizing.sizing_columns(_sizings()),
    "compare": lambda: _ladder.columns_of(_RUNGS),
}


def _loss() -> xr.Dataset:
    names = ("mesh_force_ratio", "tooth_pairs")
    return _data({}, dict.fromkeys(names, ("phase", "speed")), speed=_SPEEDS, phase=_PHASES)


def _functions() -> dict[str, Any]:
    """Every public function that ends in `_columns`, in every module whose name ends in tables."""
    found = {}
    for path in Path(plot.__file__).parent.glob("*_tables.py"):
        module = importlib.import_module(f"{plot.__name__}.{path.stem}")
        for name, each in vars(module).items():
            own = getattr(each, "__module__", None) == module.__name__
            if own and name.endswith("_columns") and not name.startswith("_"):
                found[f"{path.stem}.{name.removesuffix('_columns')}"] = each
    return found


@pytest.fixture
def _lines(monkeypatch):
    """Deflected lines of two shafts, of which one has more points than the other."""
    lines = {"pinion": np.ones((3, 5)), "wheel": np.ones((3, 9))}
    monkeypatch.setattr(_tables, "_deflected_lines", lambda model, cycle: lines)


@pytest.mark.usefixtures("_lines")
def test_every_table_of_a_picture_is_one_table(tmp_path):
    functions = _functions()
    assert set(functions) == set(_CASES), "a table is without a case, or a case without its table"
    tables = {name: partial(functions[name], *make()) for name, make in _CASES.items()}
    for name, make in (tables | _OTHERS).items():
        write_csv(make(), tmp_path / f"{name}.csv")
        assert len(assert_table(tmp_path / f"{name}.csv")), name


def test_rows_of_several_series_stay_together(tmp_path):
    """Series of two lengths, one under the other, each under its name."""
    functions = _functions()
    for name, of, count in (
        ("_dynamic_tables.orbit", "branch", [16, 48]),
        ("_tables.search_trace", "method", [3, 2]),
        ("_robust_tables.robust", "design", [2, 3]),
    ):
        columns = functions[name](*_CASES[name]())
        _, first, found = np.unique(columns[of], return_index=True, return_counts=True)
        assert found[np.argsort(first)].tolist() == count


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("pinion_speed_rad_s", True),
        ("te_rms_per_depth", True),
        ("flank.pinion.tip_relief.extent", True),
        ("flank.pinion.tip_relief.depth_um", True),
        ("energy_mesh", True),
        ("depth", False),
        ("speed", False),
        ("um", False),
        ("te_amplitude_um_at_80_Nmm", False),
    ],
)
def test_a_header_is_told_by_its_end(name, told):
    assert is_told(name) is told


@pytest.mark.parametrize(
    "text",
    [
        "a_um,b_um\n1,2\n3,nan\n",
        "a_um,b_um\n1,2\n,\n",
        "a_um,b_um\n1,2\n3\n",
        "a_um,a_um\n1,2\n",
        "a_um,b\n1,2\n",
        "a_um,label\n1,2\n3,four\n",
    ],
)
def test_what_is_no_table_is_told_from_one(tmp_path, text):
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(AssertionError):
        assert_table(path)
