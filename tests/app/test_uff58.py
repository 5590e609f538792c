"""Universal files, dataset 58: orders and spectra out, judged by pyuff, and measured ones in."""

import csv
import gc
from typing import Any

import numpy as np
import pytest
import xarray as xr

from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear.study._uff58 import functions_of_sweep, read_functions, write_functions

# Reading is pyuff's; it comes with the extra `vibro`.
pyuff = pytest.importorskip("pyuff")

_SPEED = np.array([100.0, 150.0, 275.0])


def _sweep(order=(1.0, 2.0, 3.0)):
    """One direction, three speeds; the bearings' forces have a dimension of their own."""
    draw = np.random.default_rng(0)
    dims = ("direction", "speed", "order")
    error = draw.uniform(0.1, 3.0, (1, 3, len(order)))
    force = draw.uniform(1.0, 5e3, (1, 3, len(order), 2))
    return xr.Dataset(
        {
            "te_order_um": (dims, error, {"units": "um"}),
            "bearing_force_order_N": ((*dims, "bearing"), force, {"units": "N"}),
            "dynamic_ratio": (dims[:2], np.ones((1, 3)), {"units": "1"}),
        },
        {
            "direction": ["up"],
            "speed": _SPEED,
            "order": np.asarray(order),
            "bearing": ["pinion 0", "wheel 0"],
        },
        {"teeth_pinion": 20},
    )


@pytest.mark.parametrize("order", [(1.0, 2.0, 3.0), (0.5, 1.0, 1.5, 2.0), (1.0,)])
def test_orders_and_spectra_come_back(tmp_path, order):
    """By pyuff: amplitudes in m and N to twelve digits, rpm and Hz to six."""
    sweep, path = _sweep(order), tmp_path / "a.uff"
    written = list(functions_of_sweep(sweep))
    assert len(written) == 3 * (len(order) + len(_SPEED))
    write_functions(written, path)
    for before, after in zip(written, read_functions(path), strict=True):
        # A unit of one number has a length of 1, which pyuff reads as a number.
        bare: dict[str, Any] = {"x": 0, "values": 0, "z": 0}
        assert before._replace(**bare) == after._replace(**bare)
        np.testing.assert_allclose(after.values, before.values, rtol=1e-12)
        np.testing.assert_allclose(after.x, before.x, rtol=5e-6)
        np.testing.assert_allclose(after.z, before.z, rtol=5e-6)


def test_a_spectrum_by_hand():
    """At 275 rad/s 20 teeth mesh 875.35 times a second; 1 um is 1e-6 m."""
    found = {each.name: each for each in functions_of_sweep(_sweep())}
    spectrum = found["te_order_um up, 2626.06 rpm"]
    assert spectrum.x[1] == pytest.approx(2.0 * 20.0 * 275.0 / (2.0 * np.pi))
    expected = 1e-6 * _sweep()["te_order_um"].values[0, 2]
    np.testing.assert_allclose(spectrum.values, expected)
    assert (spectrum.kind, spectrum.abscissa.unit, spectrum.ordinate.unit) == (12, "Hz", "m")
    assert "bearing_force_order_N up wheel 0, order 3" in found


def test_commands_write_and_read(tmp_path, capsys):
    result, out = tmp_path / "result.nc", tmp_path / "out"
    xr.DataTree.from_dict({"/sweep": _sweep()}).to_netcdf(result)
    assert main(["export", str(result), "--form", "uff58", "--out", str(out)]) == 0
    assert main(["import", str(out / "sweep.uff"), "--out", str(out), "--quiet"]) == 0
    with (out / "sweep.measured.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 18
    assert (rows[0]["unit"], rows[0]["x_unit"]) == ("m", "rpm")
    assert float(rows[0]["real"]) == pytest.approx(1e-6 * _sweep()["te_order_um"].values[0, 0, 0])
    xr.DataTree.from_dict({"/pair": _sweep()}).to_netcdf(result)
    assert main(["export", str(result), "--form", "uff58", "--out", str(out)]) == 2
    assert "no sweep in it" in capsys.readouterr().err


# pyuff leaves a binary file open that it has written.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("binary", [0, 1])
def test_measured_files_of_others_are_read(tmp_path, binary):
    """A complex response, as analysers write it, as text or binary."""
    path = tmp_path / "measured.unv"
    frequency = np.linspace(0.0, 100.0, 11)
    values = np.exp(1j * frequency / 30.0)
    nodes = pyuff.prepare_58(
        binary=binary,
        func_type=4,
        rsp_node=1,
        rsp_dir=1,
        ref_dir=1,
        ref_node=2,
        data=values,
        x=frequency,
        id1="mobility",
        rsp_ent_name="NONE",
        ref_ent_name="NONE",
        abscissa_spacing=1,
        abscissa_spec_data_type=18,
        ordinate_spec_data_type=12,
        orddenom_spec_data_type=13,
    )
    pyuff.UFF(str(path)).write_sets(nodes, mode="add")
    gc.collect()
    (found,) = read_functions(path)
    assert (found.kind, found.name, found.abscissa.quantity) == (4, "mobility", 18)
    np.testing.assert_allclose(found.values, values, rtol=1e-12)
    np.testing.assert_allclose(found.x, frequency, atol=1e-9)


@pytest.mark.parametrize(
    "content", [b"", b"    -1\n    58\nhalf", b"\x00" * 300, b"    -1\n   151\n"]
)
def test_damaged_files_are_refused(tmp_path, capsys, content):
    path = tmp_path / "a.uff"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.uff: (not a universal file|no functions)"):
        read_functions(path)
    assert main(["import", str(path)]) == 2
    assert "a.uff: no" in capsys.readouterr().err
