import re
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import accessory, helical_25_31
from helpers import assert_close

from jaxgear import deg, mm, um
from jaxgear._checks import InputError
from jaxgear._flank._measured import MeasuredProfile, MeasuredTopography
from jaxgear.scene._files import (
    FlankTable,
    check_covers,
    deviation_of_table,
    read_profile,
    read_topography,
)

# The accessory pinion: base circle, start of active profile, tip and 1.2 times the tip [mm].
_BASE, _START, _TIP, _MOST = 61.175776, 65.93331, 71.3571, 85.62852

_GOOD = "# measured 1.2.\nroll_length_mm, deviation_um\n\n1.0,-2.5\n2.5,0\n# a pause\n4,3e0\n"


def _write(folder: Path, text: str | bytes, name: str = "profile.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def _refused(call, *args) -> str:
    with pytest.raises(InputError) as caught:
        call(*args)
    return str(caught.value)


def _profile(coordinate: str, *position: float) -> FlankTable:
    return FlankTable(Path("p.csv"), coordinate, np.asarray(position), 0.0 * np.asarray(position))


# --- reading


def test_profile(tmp_path):
    """Comments, empty lines and blanks around cells mean nothing."""
    table = read_profile(_write(tmp_path, _GOOD))
    assert table.path == tmp_path / "profile.csv"
    assert table.coordinate == "roll_length_mm"
    np.testing.assert_array_equal(table.position, [1.0, 2.5, 4.0])
    np.testing.assert_array_equal(table.deviation, [-2.5, 0.0, 3.0])


def test_columns_may_stand_in_any_order(tmp_path):
    text = "deviation_um,diameter_mm\r\n1,65\r\n2,66\r\n3,67\r\n"
    table = read_profile(_write(tmp_path, b"\xef\xbb\xbf" + text.encode()))
    assert table.coordinate == "diameter_mm"
    np.testing.assert_array_equal(table.position, [65.0, 66.0, 67.0])
    np.testing.assert_array_equal(table.deviation, [1.0, 2.0, 3.0])


def test_relative_paths_start_at_the_folder(tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    path = _write(tmp_path / "data", _GOOD)
    monkeypatch.chdir(tmp_path / "data")
    assert read_profile("data/profile.csv", tmp_path).path == path
    assert read_profile(path, "/nowhere").path == path
    assert read_profile("profile.csv").deviation[0] == -2.5


_GRID = [("20", "-5", "1"), ("20", "0", "2"), ("25", "-5", "3"), ("25", "0", "4")]


def _topography(rows) -> str:
    return "\n".join(["roll_angle_deg,face_mm,deviation_um", *map(",".join, rows)])


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (0, 2, 1, 3), (3, 0, 2, 1)])
def test_topography_in_any_order(tmp_path, order):
    table = read_topography(_write(tmp_path, _topography([_GRID[i] for i in order])))
    assert table.coordinate == "roll_angle_deg"
    np.testing.assert_array_equal(table.position, [20.0, 25.0])
    np.testing.assert_array_equal(table.face, [-5.0, 0.0])
    np.testing.assert_array_equal(table.deviation, [[1.0, 2.0], [3.0, 4.0]])


# --- what is wrong with a file


def test_a_file_without_an_end_is_refused():
    with pytest.raises(InputError, match="/dev/zero: the file is longer than 100,000,000 bytes"):
        read_profile(Path("/dev/zero"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "",
            "the file has no lines. It must begin with a header, such as roll_length_mm,deviation",
        ),
        ("# only this\n\n", "the file has no lines"),
        (b"PK\x03\x04\xff\xfe\xfa", "this is not a text file. Export the table as CSV in UTF-8."),
        ("1.0,2.0\n1,2\n", ":1: the header is missing. The first line must name the columns"),
        ("#\nroll_length_mm;deviation_um\n1;2\n", ":2: the columns are separated by semicolons."),
        ("roll_length_mm\tdeviation_um\n", ":1: the columns are separated by tabs. Separate them"),
        (
            "roll_length_m,deviation_um\n",
            ":1: unknown column 'roll_length_m'; columns are roll_length_mm, diameter_mm, "
            "roll_angle_deg, face_mm, deviation_um, with the unit in the name. Did you mean "
            "roll_length_mm?",
        ),
        ("diameter_mm,deviation_mm\n", "column 'deviation_mm'; .* Did you mean deviation_um[?]"),
        ("diameter_mm,deviation_um,zzz\n", "unknown column number 3; .* the unit in the name.$"),
        ("root:secret:1\n", "^[^\n]*:1: unknown column number 1; columns are [^:]*$"),
        ("diameter_mm,diameter_mm,deviation_um\n", ":1: the column diameter_mm is there 2 times."),
        ("diameter_mm\n1\n", ":1: the column deviation_um is missing; got diameter_mm."),
        ("deviation_um\n1\n", "exactly one of the columns roll_length_mm, .* must say .* got none"),
        ("diameter_mm,roll_length_mm,deviation_um\n", "got diameter_mm and roll_length_mm."),
        ("diameter_mm,face_mm,deviation_um\n1,2,3\n", ":1: a profile has no column face_mm."),
        ("diameter_mm,deviation_um\n1,2\n2,2\n", ": a profile needs at least 3 points .* got 2."),
        ("diameter_mm,deviation_um\n", ": a profile needs at least 3 points .* got 0."),
        ("diameter_mm,deviation_um\n#\n1,abc\n2,2\n", ":3: deviation_um: 'abc' is not a number."),
        ("diameter_mm,deviation_um\n1,\n", ":2: deviation_um: the cell is empty."),
        ("diameter_mm,deviation_um\n1_0,1\n", ":2: diameter_mm: '1_0' is not a number."),
        ("diameter_mm,deviation_um\n1,nan\n", ":2: deviation_um: 'nan' is not a finite number."),
        ("diameter_mm,deviation_um\n1,2\n-inf,1\n", ":3: diameter_mm: '-inf' is not a finite"),
        ("diameter_mm,deviation_um\n1,1e999\n", ":2: deviation_um: '1e999' is not a number."),
        (
            'diameter_mm,deviation_um\n1,"0,5"\n',
            ":2: deviation_um: '0,5' has a decimal comma. Write numbers with a decimal point, and "
            "separate them by commas, as in 12.5,-3.2.",
        ),
        (
            "diameter_mm,deviation_um\n65,2,0,5\n",
            ":2: 4 cells, where the header names 2 columns. If these are decimal commas: write num",
        ),
        ("diameter_mm,deviation_um\n65;2\n", ":2: 1 cells, .* 2 columns. Write numbers with a dec"),
        ("diameter_mm,deviation_um\n65\n", ":2: 1 cells, where the header names 2 columns.$"),
        (
            "diameter_mm,deviation_um\n1,2\n\n3,2\n2.5,2\n4,2\n",
            ":5: diameter_mm = 2.5 comes after 3 in line 4. Positions must increase",
        ),
        (
            "diameter_mm,deviation_um\n1,2\n3,2\n#\n3.0,5\n4,2\n",
            ":5: diameter_mm = 3 was given in line 3 already. Keep one of the two lines.",
        ),
        (
            "diameter_mm,deviation_um\n5,2\n4,2\n3,5\n",
            ": diameter_mm must increase from line to line; here it decreases all the way. Reverse",
        ),
        (
            "diameter_mm,deviation_um\n1,0\n2,-8000\n3,300\n",
            ": deviation_um must be in micrometres, but its values span 8300, more than 1000: they "
            "look like nanometres",
        ),
        (
            "diameter_mm,deviation_um\n1,0\n2,-0.008\n3,0.013\n",
            "no value exceeds 0.013 .less than 0.1.: they look like millimetres. Multiply them by",
        ),
    ],
)
def test_profiles_that_are_refused(tmp_path, text, message):
    found = _refused(read_profile, _write(tmp_path, text))
    assert found.startswith(f"{tmp_path / 'profile.csv'}:")
    assert re.search(message, found), found


def test_a_flank_without_deviations_is_no_mistake(tmp_path):
    text = "diameter_mm,deviation_um\n1,0\n2,0\n3,0\n"
    assert not read_profile(_write(tmp_path, text)).deviation.any()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            _GRID[:3],
            r"full grid: 2 values of roll_angle_deg times 2 of face_mm make 4 points, got 3.",
        ),
        (_GRID[:3], r"one missing is roll_angle_deg = 25, face_mm = 0. Add the missing points"),
        ([*_GRID, ("25", "-5.0", "7")], r":6: the point .* = 25, face_mm = -5 was given in line 4"),
        (
            _GRID[:2],
            r"at least 4 points, .*; got 1 different roll_angle_deg. A single section is a",
        ),
        (_GRID[::2], r"at least 4 points, .*; got 1 different face_mm"),
        ([], r"at least 4 points, .*; got 0 different roll_angle_deg"),
        ([(p, z, "1e4") for p, z, _ in _GRID[:3]] + _GRID[3:], "its values span 9996, more than"),
        ([(p, z, "0.01") for p, z, _ in _GRID], "no value exceeds 0.01 .*look like millimetres"),
    ],
)
def test_topographies_that_are_refused(tmp_path, rows, message):
    found = _refused(read_topography, _write(tmp_path, _topography(rows)))
    assert re.search(message, found), found


def test_a_topography_needs_its_face(tmp_path):
    found = _refused(read_topography, _write(tmp_path, _GOOD))
    assert ":2: the column face_mm is missing; got roll_length_mm, deviation_um." in found


def test_lines_that_are_wrong_are_listed_together(tmp_path):
    lines = [f"{i},{'x' * (i % 2 + 1)}" for i in range(8)]
    path = _write(tmp_path, "\n".join(["diameter_mm,deviation_um", "0.5,1", *lines]))
    found = _refused(read_profile, path).splitlines()
    assert found[0] == f"{path}:3: deviation_um: 'x' is not a number."
    assert found[4] == f"{path}:7: deviation_um: 'x' is not a number."
    assert found[5:] == ["and 3 more lines like these."]


def test_files_that_cannot_be_read(tmp_path):
    found = _refused(read_profile, "none.csv", tmp_path)
    assert found == (
        f"{tmp_path / 'none.csv'}: there is no such file. A relative path is relative to the "
        "folder of the scene file."
    )
    assert "this is a folder; name a CSV file in it." in _refused(read_profile, tmp_path)
    path = _write(tmp_path, _GOOD)
    assert "the file cannot be read: Not a directory." in _refused(read_profile, path / "x.csv")


# --- what does not fit the gear


def test_whole_flanks_are_covered():
    """To within a hundredth of the path: on the accessory pinion 0.0607 mm of roll length."""
    pair = accessory()
    check_covers(_profile("diameter_mm", _START - 0.05, 68.0, _TIP), pair, 0)
    start, tip = (np.sqrt(d**2 - _BASE**2) / 2.0 for d in (_START, _TIP))
    assert tip - start == pytest.approx(6.0713, abs=2e-4)
    check_covers(_profile("roll_length_mm", start + 0.0602, 10.0, tip - 0.0602), pair, 0)
    angle = np.asarray([start, 12.0, tip]) / (0.5 * _BASE) / deg
    check_covers(_profile("roll_angle_deg", *angle), pair, 0)
    with pytest.raises(InputError):
        check_covers(_profile("roll_length_mm", start + 0.0612, 10.0, tip), pair, 0)
    with pytest.raises(InputError):
        check_covers(_profile("roll_length_mm", start, 10.0, tip - 0.0612), pair, 0)


def test_flanks_that_are_not_covered():
    found = _refused(check_covers, _profile("diameter_mm", 66.5, 68.0, 71.0), accessory(), 0)
    assert re.fullmatch(
        r"p\.csv: diameter_mm must cover 65\.9333 to 71\.3571, the whole of the pinion's active "
        r"flank, from its start of active profile to its tip, within 1 %\. Missing: 65\.9333 to "
        r"66\.5 and 71 to 71\.3571\. Add points there\.",
        found,
    ), found
    found = _refused(check_covers, _profile("diameter_mm", 65.9, 68.0, 71.0), accessory(), 0)
    assert "Missing: 71 to 71.3571. Add" in found
    found = _refused(check_covers, _profile("diameter_mm", 66.5, 68.0, 71.4), accessory(), 0)
    assert re.search(r"Missing: 65\.9333 to 66\.5\. Add", found)


@pytest.mark.parametrize(
    ("table", "hint"),
    [
        (_profile("diameter_mm", 0.0639, 0.07, 0.0714), "they look like metres. Convert them."),
        (_profile("diameter_mm", 31.9, 33.0, 35.7), "they look like radii. Convert them."),
        (_profile("diameter_mm", 63.9e3, 65e3, 71.4e3), "they look like micrometres. Convert"),
        (_profile("diameter_mm", 2.51, 2.6, 2.82), "they look like inches. Convert them."),
        (_profile("diameter_mm", 120.0, 121.0, 134.0), "is this the file of this gear?"),
        (_profile("diameter_mm", 61.1, 65.0, 72.0), "is this the file of this gear?"),
        (_profile("roll_length_mm", 12.2, 15.0, 184.0), "is this the file of this gear?"),
        (_profile("roll_length_mm", 0.012, 0.015, 0.0184), "they look like metres. Convert them."),
        (_profile("roll_angle_deg", 0.4, 0.5, 0.61), "they look like radians. Convert them."),
        (_profile("roll_length_mm", -1.0, 15.0, 18.4), "is this the file of this gear?"),
    ],
)
def test_positions_off_the_involute_are_refused(table, hint):
    found = _refused(check_covers, table, accessory(), 0)
    first, last = table.position[0], table.position[-1]
    assert f"got {first:.6g} to {last:.6g}: {hint}" in found
    if table.coordinate == "diameter_mm":
        assert found.startswith(
            f"p.csv: diameter_mm of the pinion must lie between {_BASE:.6g}, its base circle, and "
            f"{_MOST:.6g}, 1.2 times its tip diameter, and its active flank is {_START:.6g} to "
            f"{_TIP:.6g}; got "
        )


def test_roll_begins_at_the_base_circle():
    """A table may start there, and its limit is a round zero."""
    pair = accessory()
    check_covers(_profile("roll_length_mm", 0.0, 10.0, 40.0), pair, 1)
    check_covers(_profile("roll_angle_deg", 0.0, 10.0, 40.0), pair, 1)
    found = _refused(check_covers, _profile("roll_angle_deg", 70.0, 80.0, 90.0), pair, 1)
    assert "roll_angle_deg of the wheel must lie between 0, its base circle, and 53.48" in found


def test_flanks_beside_the_active_one():
    """On the involute, but not where contact is: all of it is missing, no more."""
    found = _refused(check_covers, _profile("diameter_mm", 61.5, 62.0, 63.0), accessory(), 0)
    assert "Missing: 65.9333 to 71.3571. Add" in found
    found = _refused(check_covers, _profile("diameter_mm", 72.0, 75.0, 80.0), accessory(), 0)
    assert "Missing: 65.9333 to 71.3571. Add" in found


def test_the_common_face_must_be_covered():
    """The pinion is 11.5 mm wide, the wheel 9.5: contact reaches 4.75 mm from mid-face."""

    def table(*face: float) -> FlankTable:
        position = np.asarray([65.9, 71.4])
        z = np.asarray(face)
        return FlankTable(Path("t.csv"), "diameter_mm", position, np.zeros((2, z.size)), z)

    check_covers(table(-4.66, 4.75), accessory(), 0)
    found = _refused(check_covers, table(-4.0, 0.0, 5.0), accessory(), 0)
    assert found == (
        "t.csv: face_mm must cover -4.75 to 4.75, the whole of the common face of the two gears, "
        "counted from mid-face, within 1 %. Missing: -4.75 to -4. Add points there."
    )
    found = _refused(check_covers, table(0.0, 9.5), accessory(), 0)
    assert "Missing: -4.75 to 0. Add" in found


# --- from the file to the flank


@pytest.mark.parametrize("gear", [0, 1])
def test_the_same_flank_in_each_coordinate(gear):
    """A point of the pinion's flank, said in three ways, is one point."""
    pair = helical_25_31()
    base = float(pair.base_radius[gear]) / mm
    roll = np.linspace(6.0, 18.0, 7)
    positions = {
        "roll_length_mm": roll,
        "diameter_mm": 2.0 * np.hypot(base, roll),
        "roll_angle_deg": roll / base / deg,
    }
    deviation = np.asarray([-3.0, 1.0, 2.0, 0.5, -1.0, 4.0, -6.0])
    laws = [
        deviation_of_table(FlankTable(Path("p.csv"), name, position, deviation), pair, gear)
        for name, position in positions.items()
    ]
    for law in laws[1:]:
        assert_close(law, laws[0], rtol=1e-10, atol=1e-12)
    assert isinstance(laws[0], MeasuredProfile)
    assert_close(laws[0].deviation, deviation * um, rtol=1e-14, atol=0.0)


def test_topography_is_in_si(tmp_path):
    pair = accessory()
    path = _write(tmp_path, _topography(_GRID))
    law = deviation_of_table(read_topography(path), pair, 1)
    assert isinstance(law, MeasuredTopography)
    assert_close(law.face, np.asarray([-5.0, 0.0]) / 4.75, rtol=1e-13, atol=0.0)
    assert_close(law.deviation, np.asarray([[1.0, 2.0], [3.0, 4.0]]) * um, rtol=1e-13, atol=0.0)
    middle = law(jnp.mean(law.place), jnp.mean(law.face))
    assert float(middle) / um == pytest.approx(2.5, rel=1e-12)


def test_tables_follow_a_pair_that_is_traced():
    """The derivative by the wheel's addendum: its tip moves the start of the pinion's path."""
    table = FlankTable(
        Path("p.csv"), "diameter_mm", np.asarray([63.0, 67.0, 72.0]), np.asarray([0.0, 3.0, -4.0])
    )

    @jax.jit
    def at_quarter(addendum):
        pair = eqx.tree_at(lambda p: p.wheel.addendum, accessory(), addendum)
        check_covers(table, pair, 0)
        return deviation_of_table(table, pair, 0)(jnp.asarray(0.25), jnp.zeros(())) / um

    now, step = accessory().wheel.addendum, 1e-6
    central = (at_quarter(now + step) - at_quarter(now - step)) / (2.0 * step)
    slope = jax.grad(at_quarter)(now)
    assert abs(float(slope)) > 0.1
    assert_close(slope, central, rtol=1e-7, atol=0.0)
