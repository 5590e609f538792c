"""Matrices of CalculiX, Abaqus and Nastran made into condensed bodies.

`tests/data/calculix` holds what CalculiX wrote for one curved brick, a sixth of a ring.
"""

import gzip
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from fem_prep._abaqus import read_mtx, read_storage
from fem_prep._artefact import ReducedBody, rigid_motions
from fem_prep._assembly import Material
from fem_prep._body_file import read_body, write_body
from fem_prep._boundary import FullBody, full_body
from fem_prep._checks import BodyError
from fem_prep._companion import read_table
from fem_prep._condense import condense
from fem_prep._exports import export_body
from fem_prep._grid import FACES, Grid
from fem_prep._imports import SYSTEMS, import_superelement
from fem_prep._modes import free_modes, reduced_modes
from fem_prep._op4 import read_op4
from fem_prep._seats import Seat

DATA = Path(__file__).parent / "data" / "calculix"
TABLE = DATA / "sector.csv"

# What the three names of CalculiX's whole matrices are packed in.
_PACKED = ("sector.sti", "sector.mas", "kept.mtx")


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("calculix")
    for name in _PACKED:
        (folder / name).write_bytes(gzip.decompress((DATA / f"{name}.gz").read_bytes()))
    shutil.copy(DATA / "sector.dof", folder)
    return folder


@pytest.fixture(scope="module")
def full() -> FullBody:
    """The brick that CalculiX was given, assembled here."""
    table = read_table(TABLE)
    order = np.argsort(table.nodes)
    roles = np.array(table.roles)[order]
    grid = Grid(
        1e-3 * table.points[order], np.arange(20)[None], {"rim": np.flatnonzero(roles == "rim")}
    )
    seat = Seat("bore", np.flatnonzero(roles == "seat:bore"), np.zeros(3))
    return full_body("sector", grid, Material(206e9, 0.3, 7850.0), [seat])


@pytest.fixture(scope="module")
def body(full) -> ReducedBody:
    """The same, condensed here; with some interior shapes."""
    return condense(full, method="craig-bampton", modes=2)


def _relative(got: np.ndarray, want: np.ndarray) -> float:
    return float(abs(got - want).max() / abs(want).max())


def _dense(matrix: Any) -> np.ndarray:
    return matrix.toarray()


def _rows(got: ReducedBody, want: ReducedBody) -> np.ndarray:
    """Coordinates of one body in the order of those of the other: rim nodes by their places."""
    apart = np.linalg.norm(got.rim_nodes - want.rim_nodes[:, None], axis=2)
    assert apart.min(axis=1).max() < 1e-12
    rim = (3 * apart.argmin(axis=1)[:, None] + np.arange(3)).ravel()
    return np.concatenate([rim, np.arange(len(rim), got.dofs)])


def _in_units(body: ReducedBody, units: str) -> dict[str, np.ndarray]:
    """Plain arrays of a body in another system of units, by hand."""
    length, weight, time = SYSTEMS[units]
    force = weight * length / time**2
    size = np.ones(body.dofs)
    size[: 3 * len(body.rim_nodes)] = length
    for seat in body.seats:
        size[body.seat_dofs(seat)] = [length] * 3 + [1.0] * 3
    return {
        "stiffness": body.stiffness * np.outer(size, size) / (force * length),
        "mass": body.mass * np.outer(size, size) / (weight * length**2),
        "centrifugal_load": body.centrifugal_load * size / (weight * length**2),
        "rim_nodes": body.rim_nodes / length,
        "seats": np.array(body.seats),
        "seat_points": body.seat_points / length,
        "rim_faces": body.rim_faces,
    }


def _npz(path: Path, arrays: dict[str, Any]) -> Path:
    np.savez(path, **arrays)
    return path


def _table(path: Path, body: ReducedBody, order: np.ndarray | None = None) -> Path:
    """The table of a body in SI; `order` of its rim nodes."""
    rim = np.arange(len(body.rim_nodes)) if order is None else order
    lines = ["node,x,y,z,role"]
    lines += [
        ",".join(map(repr, [int(at) + 1, *body.rim_nodes[at].tolist()])) + ",rim" for at in rim
    ]
    for at, (seat, point) in enumerate(zip(body.seats, body.seat_points, strict=True)):
        lines.append(",".join(map(repr, [1001 + at, *point.tolist()])) + f",seat:{seat}")
    lines += [f"{2001 + at},,,,mode" for at in range(body.interior)]
    path.write_text("\n".join(lines))
    return path


# CalculiX.


def test_whole_matrices_of_calculix_condense_to_the_same_as_our_own(files, full):
    got = import_superelement(files / "sector.sti", TABLE, units="mm-t-s", mass=0.0246)
    want = condense(full, method="guyan")
    rows = _rows(got, want)
    assert got.seats == ("bore",)
    assert np.allclose(got.seat_points, 0.0)
    assert _relative(got.stiffness[np.ix_(rows, rows)], want.stiffness) < 1e-12
    assert _relative(got.mass[np.ix_(rows, rows)], want.mass) < 1e-12
    assert _relative(got.centrifugal_load[rows], want.centrifugal_load) < 1e-12
    assert abs(got.stiffness @ got.rigid_motions).max() < 1e-12 * abs(got.stiffness).max()
    assert got.facts["source_units"] == "mm-t-s"


def test_any_of_the_three_names_will_do_and_the_name_is_that_of_the_file(files):
    first = import_superelement(files / "sector.mas", TABLE, units="mm-t-s")
    second = import_superelement(str(files / "sector.dof"), str(TABLE), units="mm-t-s", name="b")
    assert np.array_equal(first.mass, second.mass)
    assert (first.name, second.name) == ("sector", "b")


def test_modes_of_interior_nodes_bring_the_frequencies_near(files, full):
    want, _ = free_modes(full, 6)
    off = []
    # Four nodes are interior, and all but two of their modes can be had.
    for modes in (0, 4, 50):
        got = import_superelement(files / "sector.sti", TABLE, units="mm-t-s", modes=modes)
        assert got.interior == got.facts["modes_of_interior_nodes"] == min(modes, 10)
        # Six modes are rigid; the condensed body is the stiffer one.
        square = scipy.linalg.eigh(got.stiffness, got.mass, eigvals_only=True)[6:12]
        off.append((square / want - 1).max())
        assert (square / want - 1).min() > -1e-9

    assert 1.0 > off[0] > off[1] > 0.1 > off[2]


def test_a_body_from_elsewhere_is_kept_like_any_other(files, tmp_path):
    body = import_superelement(
        files / "sector.sti", TABLE, units="mm-t-s", faces=DATA / "faces.csv"
    )
    write_body(tmp_path / "a", body)
    read = read_body(tmp_path / "a")
    assert np.array_equal(read.stiffness, body.stiffness)
    assert read.facts["source"] == ["sector.sti"]
    digests: Any = read.facts["source_sha256"]
    assert len(digests[0]) == 64
    # The face that CalculiX's brick shows outward, in the numbers of its nodes.
    table = read_table(TABLE)
    rim = np.array(table.nodes)[table.those("rim")]
    assert np.array_equal(rim[read.rim_faces[0]], FACES[3] + 1)


def test_a_substructure_of_calculix_that_keeps_all_is_read_row_by_row(files):
    kept = read_mtx([files / "kept.mtx"])
    whole = read_storage(files / "sector.dof")
    assert kept.labels is not None
    assert whole.labels is not None
    assert kept.mass is None
    assert kept.labels[:4].tolist() == [[1, 1], [1, 2], [1, 3], [2, 1]]
    places = [whole.labels.tolist().index(label) for label in kept.labels.tolist()]
    stiffness = _dense(whole.stiffness)[np.ix_(places, places)]
    assert _relative(np.asarray(kept.stiffness), stiffness) < 1e-12


def test_a_substructure_without_mass_is_for_statics_only(files):
    with pytest.raises(BodyError, match=r"kept.mtx must hold a mass too.*static=True"):
        import_superelement(files / "kept.mtx", TABLE, units="mm-t-s")
    got = import_superelement(files / "kept.mtx", TABLE, units="mm-t-s", static=True, modes=5)
    want = import_superelement(files / "sector.sti", TABLE, units="mm-t-s")
    assert _relative(got.stiffness, want.stiffness) < 1e-12
    assert not got.mass.any()
    assert not got.centrifugal_load.any()


def test_what_calculix_left_out_instead_of_condensing_is_refused(tmp_path):
    # A real file of CalculiX 2.20: rows of four nodes of twenty, no more.
    lines = TABLE.read_text().splitlines()
    kept = [line for line in lines if line.split(",")[0] in ("node", "2", "3", "6", "7")]
    (tmp_path / "left.csv").write_text("\n".join(kept))
    with pytest.raises(BodyError, match=r"must not resist rigid motions.*CalculiX 2\.20"):
        import_superelement(DATA / "left.mtx", tmp_path / "left.csv", units="mm-t-s", static=True)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
@pytest.mark.parametrize("name", ["sector", "kept", "left"])
def test_calculix_still_writes_the_same(files, tmp_path, name):
    shutil.copy(DATA / f"{name}.inp", tmp_path)
    subprocess.run(["ccx", name], cwd=tmp_path, check=True, capture_output=True)
    if name == "sector":
        new, old = read_storage(tmp_path / "sector.sti"), read_storage(files / "sector.sti")
        assert _relative(_dense(new.mass), _dense(old.mass)) < 1e-12
        new, old = _dense(new.stiffness), _dense(old.stiffness)
    else:
        folder = DATA if name == "left" else files
        new, old = (
            np.asarray(read_mtx([at / f"{name}.mtx"]).stiffness) for at in (tmp_path, folder)
        )
    assert _relative(new, old) < 1e-12


# Abaqus.


def _user_element(body: ReducedBody) -> str:
    """What Abaqus writes for a substructure with the nodes of a body; modes are nodes too."""
    rim, seats = len(body.rim_nodes), len(body.seats)
    nodes = [*range(1, rim + 1), *range(1001, 1001 + seats)]
    nodes += [*range(2001, 2001 + body.interior)]
    text = f"**\n*USER ELEMENT, NODES={len(nodes):5d}, LINEAR\n** ELEMENT NODES\n"
    for start in range(0, len(nodes), 10):
        text += "** " + ", ".join(map(str, nodes[start : start + 10])) + "\n"
    # Components are told where they change: of the first, of a seat, of the first mode.
    text += f"1, 2, 3\n{rim + 1}, 1, 2, 3, 4, 5, 6\n"
    text += f"{rim + seats + 1}, 1\n" if body.interior else ""
    for kind, matrix in (("STIFFNESS", body.stiffness), ("MASS", body.mass)):
        text += f"*MATRIX, TYPE={kind}\n"
        for row in range(body.dofs):
            for start in range(0, row + 1, 4):
                values = matrix[row, start : min(start + 4, row + 1)]
                text += ", ".join(f"{value:.14g}" for value in values) + " ,\n"
    return text


def test_a_substructure_of_abaqus(body, tmp_path):
    (tmp_path / "a.mtx").write_text(_user_element(body))
    table = _table(tmp_path / "a.csv", body)
    got = import_superelement(tmp_path / "a.mtx", table, units="m-kg-s")
    assert _relative(got.stiffness, body.stiffness) < 1e-12
    assert _relative(got.mass, body.mass) < 1e-12
    assert got.interior == body.interior


def test_lines_with_the_nodes_of_row_and_column(body, tmp_path):
    # One triangle of the rows in Abaqus's order, which is not that of node numbers.
    labels = [(at + 1, axis) for at in range(len(body.rim_nodes)) for axis in (1, 2, 3)]
    labels += [(1001, axis) for axis in range(1, 7)]
    labels += [(2001 + at, 1) for at in range(body.interior)]
    order = np.random.default_rng(0).permutation(body.dofs)
    paths = [tmp_path / "a_STIF1.mtx", tmp_path / "a_MASS1.mtx"]
    for path, matrix in zip(paths, (body.stiffness, body.mass), strict=True):
        lines = ["** Assembled matrix", "*MATRIX INPUT, NAME=A, TYPE=SYMMETRIC"]
        for at, row in enumerate(order):
            for column in order[: at + 1]:
                places = (*labels[row], *labels[column])
                lines.append(",".join(map(str, places)) + f", {matrix[row, column]:.15E}")
        path.write_text("\n".join(lines))
    table = _table(tmp_path / "a.csv", body)
    got = import_superelement(paths, table, units="m-kg-s")
    assert _relative(got.stiffness, body.stiffness) < 1e-12
    assert _relative(got.mass, body.mass) < 1e-12
    # The table's order is that of the rim.
    turned = np.arange(len(body.rim_nodes))[::-1]
    other = import_superelement(paths, _table(tmp_path / "b.csv", body, turned), units="m-kg-s")
    assert np.array_equal(other.rim_nodes, body.rim_nodes[::-1])
    rows = _rows(other, body)
    assert _relative(other.stiffness[np.ix_(rows, rows)], body.stiffness) < 1e-12


def test_a_truncated_user_element(files, tmp_path):
    text = (files / "kept.mtx").read_text()
    (tmp_path / "a.mtx").write_text(text[:30000])
    with pytest.raises(BodyError, match=r"must have 1830 values, .* 60 rows, got 1\d\d\d\. If"):
        read_mtx([tmp_path / "a.mtx"])


# Nastran.


def _op4(name: str, matrix: np.ndarray, form: str, digits: int = 16) -> str:
    """Text of a real matrix in double precision, after the manual: `full`, `packed` or `big`."""
    rows, columns = matrix.shape
    width = digits + 7
    per_line = 80 // width
    sign = -1 if form == "big" else 1
    lines = [f"{columns:8d}{sign * rows:8d}{6:8d}{2:8d}{name:<8s}1P,{per_line}E{width}.{digits}"]

    def write(values: np.ndarray) -> None:
        for start in range(0, len(values), per_line):
            part = values[start : start + per_line]
            lines.append("".join(f"{value:{width}.{digits}E}" for value in part))

    for column in range(columns):
        there = np.flatnonzero(matrix[:, column])
        if not there.size:
            continue
        strings = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
        if form == "full":
            strings = [np.arange(there[0], there[-1] + 1)]
            lines.append(f"{column + 1:8d}{there[0] + 1:8d}{len(strings[0]):8d}")
        else:
            words = sum(2 * len(each) + (2 if form == "big" else 1) for each in strings)
            lines.append(f"{column + 1:8d}{0:8d}{words:8d}")
        for string in strings:
            length, row = 2 * len(string) + 1, string[0] + 1
            if form == "big":
                lines.append(f"{length:8d}{row:8d}")
            elif form == "packed":
                lines.append(f"{row + 65536 * length:8d}")
            write(matrix[string, column])
    lines.append(f"{columns + 1:8d}{1:8d}{1:8d}")
    write(np.ones(1))
    return "\n".join(lines) + "\n"


_BY_HAND = """\
       3       3       6       2KAA     1P,3E16.9
       1       1       3
 2.000000000E+00-1.000000000E+00 0.000000000E+00
       2       0       5
  327681
-1.000000000E+00 2.000000000E+00
       4       1       1
 1.414213562E+00
       2      -2       2       1B       1P,3D16.9
       2       0       3
       2       2
-5.000000000D-01
       3       1       1
 1.000000000D+00
       1       1       2       4CPLX    1P,3E16.9
       1       1       2
 1.000000000E+00 1.000000000E+00
       2       1       1
 1.000000000E+00
"""


def test_op4_by_hand(tmp_path):
    # 327681 = 1 + 65536 (2 values of 2 words + 1); a single precision value is one word.
    path = tmp_path / "a.op4"
    path.write_text(_BY_HAND)
    stiffness, other = read_op4([path], ["KAA", "B"])
    assert np.array_equal(stiffness, [[2, -1, 0], [-1, 2, 0], [0, 0, 0]])
    assert np.array_equal(other, [[0, 0], [0, -0.5]])
    with pytest.raises(BodyError, match="CPLX is complex"):
        read_op4([path], ["CPLX"])
    with pytest.raises(BodyError, match="named MAA, got KAA, B, CPLX"):
        read_op4([path], ["MAA"])
    path.write_text(_BY_HAND[:200])
    with pytest.raises(BodyError, match="KAA of Nastran's OUTPUT4 is truncated"):
        read_op4([path], ["KAA"])
    path.write_bytes(b"\x18\0\0\0")
    with pytest.raises(BodyError, match="is binary"):
        read_op4([path], ["KAA"])


@pytest.mark.parametrize("form", ["op4", "mtx"])
def test_what_is_exported_can_be_imported(body, tmp_path, form):
    """Matrices, places, seats, shapes and the rim's elements come back."""
    *matrices, table, rim = export_body(body, tmp_path, form)
    got = import_superelement(matrices, table, faces=rim, units="m-kg-s", mass=0.0246)
    for name in ("stiffness", "mass"):
        assert _relative(getattr(got, name), getattr(body, name)) < 1e-15
    np.testing.assert_array_equal(got.rim_nodes, body.rim_nodes)
    np.testing.assert_array_equal(got.seat_points, body.seat_points)
    np.testing.assert_array_equal(got.rim_faces, body.rim_faces)
    assert (got.seats, got.interior) == (body.seats, body.interior)


def test_export_of_no_known_form_is_refused(body, tmp_path):
    with pytest.raises(BodyError, match="one of op4, mtx, got 'docx'"):
        export_body(body, tmp_path, "docx")


def test_op4_has_both_triangles(body, tmp_path):
    """Whole columns, read here number by number: other readers add no triangle to what is there."""
    path = export_body(body, tmp_path, "op4")[0]
    text = path.read_text(encoding="ascii")
    head, *lines = text.splitlines()
    size = body.dofs
    assert head[:24].split() == [str(size), str(size), "6"]
    per_column = 1 + -(-size // 3)
    for column in range(size):
        record = lines[column * per_column : (column + 1) * per_column]
        assert [int(each) for each in record[0].split()] == [column + 1, 1, size]
        digits = "".join(record[1:])
        values = [float(digits[at : at + 23]) for at in range(0, 23 * size, 23)]
        np.testing.assert_allclose(values, body.stiffness[:, column], rtol=1e-15)


@pytest.mark.parametrize("form", ["full", "packed", "big"])
@pytest.mark.parametrize("triangle", [False, True])
def test_op4_round_trip(body, tmp_path, form, triangle):
    matrices = [np.tril(each) if triangle else each for each in (body.stiffness, body.mass)]
    text = "".join(
        _op4(name, each, form) for name, each in zip(("KAA", "MAA"), matrices, strict=True)
    )
    (tmp_path / "a.op4").write_text(text)
    got = import_superelement(
        tmp_path / "a.op4", _table(tmp_path / "a.csv", body), units="m-kg-s", mass=0.0246
    )
    assert _relative(got.stiffness, body.stiffness) < 1e-14
    assert _relative(got.mass, body.mass) < 1e-14


def test_nine_digits_are_enough(body, tmp_path):
    for name, each in (("KXX", body.stiffness), ("MXX", body.mass)):
        (tmp_path / f"{name}.op4").write_text(_op4(name, each, "full", digits=9))
    got = import_superelement(
        [tmp_path / "KXX.op4", tmp_path / "MXX.op4"],
        _table(tmp_path / "a.csv", body),
        units="m-kg-s",
        matrices=("KXX", "MXX"),
    )
    want, _ = reduced_modes(body, 12)
    assert np.allclose(reduced_modes(got, 12)[0][6:], want[6:], rtol=1e-6)


# Plain arrays, units and what is refused.


@pytest.mark.parametrize("units", sorted(SYSTEMS))
def test_units(body, tmp_path, units):
    path = _npz(tmp_path / "a.npz", _in_units(body, units))
    got = import_superelement(path, units=units, mass=0.0246)
    for name in ("stiffness", "mass", "centrifugal_load", "rim_nodes", "seat_points"):
        want = getattr(body, name)
        assert np.allclose(getattr(got, name), want, rtol=1e-12, atol=1e-14 * abs(want).max())
    assert np.array_equal(got.rim_faces, body.rim_faces)
    assert (got.seats, got.interior) == (body.seats, body.interior)


def test_the_middle_of_the_face_is_in_metres_whatever_the_files_are_in(body, tmp_path):
    arrays = _in_units(body, "mm-t-s")
    for name in ("rim_nodes", "seat_points"):
        arrays[name] = arrays[name] + [0.0, 0.0, 40.0]
    path = _npz(tmp_path / "a.npz", arrays)
    got = import_superelement(path, units="mm-t-s", mid_face=0.04)
    assert np.allclose(got.rim_nodes, body.rim_nodes, atol=1e-15)
    assert np.allclose(got.seat_points, body.seat_points, atol=1e-15)
    # The middle that is asked for is the whole one, not what is missing of it.
    with pytest.raises(BodyError, match=r"`mid_face` is 40 mm in the files, not 25 mm"):
        import_superelement(path, units="mm-t-s", mid_face=0.025)


def test_centrifugal_load_of_the_nodes_that_are_known(body, tmp_path):
    # M times distances from the axis: of rim and seat alone, as nothing more is in the file.
    arrays = _in_units(body, "m-kg-s")
    del arrays["centrifugal_load"]
    got = import_superelement(_npz(tmp_path / "a.npz", arrays), units="m-kg-s")
    radial = np.zeros(body.dofs)
    for axis in (0, 1):
        radial[axis : 3 * len(body.rim_nodes) : 3] = body.rim_nodes[:, axis]
    assert _relative(got.centrifugal_load, body.mass @ radial) < 1e-12
    assert got.facts["centrifugal_load"] == "of the nodes in the file"


def test_a_seat_of_many_nodes_moves_as_a_rigid_ring(files, full):
    got = import_superelement(files / "sector.sti", TABLE, units="mm-t-s")
    motions = got.rigid_motions
    assert abs(got.stiffness @ motions).max() < 1e-11 * abs(got.stiffness).max()
    inertia = motions.T @ got.mass @ motions
    points = rigid_motions(full.grid.nodes)
    assert _relative(inertia, points.T @ (full.grid_mass @ points)) < 1e-12


def _at(body: ReducedBody, name: str, value: float, *place: int) -> np.ndarray:
    matrix = getattr(body, name).copy()
    matrix[place] += value * matrix.max()
    return matrix


@pytest.mark.parametrize(
    ("spoil", "options", "message"),
    [
        (lambda b: {"mass": _at(b, "mass", 0.1, 0, 5)}, {}, "mass must be symmetric, .* 0.1 of"),
        (lambda b: {"mass": _at(b, "mass", np.nan, 0, 0)}, {}, "mass must be finite"),
        (
            lambda b: {"stiffness": _at(b, "stiffness", 0.01, 0, 0)},
            {},
            "moving along x gives forces .* something holds the body",
        ),
        (
            lambda b: {"rim_nodes": 1e-3 * b.rim_nodes, "seat_points": 1e-3 * b.seat_points},
            {},
            "another unit of length than the matrices, by a factor of 1000",
        ),
        (
            lambda b: {"rim_nodes": b.rim_nodes[::-1]},
            {},
            r"turning about . gives .* places belong to other nodes",
        ),
        (lambda b: {"stiffness": -b.stiffness}, {}, "must not be negative"),
        (
            lambda b: {
                "stiffness": b.stiffness - np.diag(np.eye(b.dofs)[-1] * b.stiffness[-1, -1])
            },
            {},
            "six rigid motions, a has 7",
        ),
        (lambda b: {"mass": -b.mass}, {}, "same along x, y and z, got -0.0246"),
        (
            lambda b: {"mass": _at(b, "mass", -5.0, b.dofs - 1, b.dofs - 1)},
            {},
            "mass must not be negative",
        ),
        (lambda b: {"mass": 1e3 * b.mass}, {"mass": 0.0246}, "A factor of 1000 between them"),
        (lambda b: {"mass": 1.1 * b.mass}, {"mass": 0.0246}, "Are all parts in the model"),
        (lambda b: {"mass": 1e3 * b.mass}, {}, "that of a gear, got 24.6 kg in .* in tonnes"),
        (lambda b: {}, {"units": "mm-t-s"}, "another unit of length|radius of the rim"),
        (lambda b: {}, {"units": "SI"}, "one of m-kg-s, mm-t-s, .*, got 'SI'"),
        (lambda b: {}, {"mid_face": 1e-3}, r"from -7 to 5 mm. .* is 0 mm in the files, not 1 mm"),
        (lambda b: {"stiffness": b.stiffness[:9, :9]}, {}, "must be square and of one size"),
        (lambda b: {"seats": np.array(["a", "b"])}, {}, "1 seats and 2 names|2 names of seats"),
        (lambda b: {"centrifugal_load": np.zeros(3)}, {}, r"for each of \d+ rows, got \[3\]"),
        (lambda b: {}, {"modes": -1}, "must not be negative, got -1"),
    ],
)
def test_arrays_that_are_no_free_gear_body(body, tmp_path, spoil, options, message):
    path = _npz(tmp_path / "a.npz", _in_units(body, "m-kg-s") | spoil(body))
    with pytest.raises(BodyError, match=message):
        import_superelement(path, **({"units": "m-kg-s"} | options))


def test_rows_in_another_order_are_recognised(body, tmp_path):
    # The rim alone, all else condensed statically; all rows along x come first.
    count = 3 * len(body.rim_nodes)
    rim, rest = slice(count), slice(count, None)
    basis = np.eye(body.dofs)[:, rim]
    basis[rest] = -np.linalg.solve(body.stiffness[rest, rest], body.stiffness[rest, rim])
    order = np.arange(count).reshape(-1, 3).T.ravel()
    arrays = {
        name: (basis.T @ getattr(body, name) @ basis)[np.ix_(order, order)]
        for name in ("stiffness", "mass")
    }
    table = _table(tmp_path / "a.csv", body)
    lines = [line for line in table.read_text().splitlines() if line.endswith(("role", "rim"))]
    table.write_text("\n".join(lines))
    with pytest.raises(BodyError, match="stand by components, first all along x"):
        import_superelement(_npz(tmp_path / "a.npz", arrays), table, units="m-kg-s")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("node, x", "name, x"), "got no column node"),
        (("10, 30, 0", "10, 30, zero"), "Lines of the table .*zero"),
        (("10, 30, 0, -6, rim", "10, 30, 0, -6, rims"), "role of node 10 must be .* got 'rims'"),
        (("10, 30, 0, -6", "10, , 0, -6"), "Node 10 must have a place"),
        (("10, 30, 0, -6", "2, 30, 0, -6"), "twice: 2"),
        (("10, 30, 0, -6, rim", ""), "Every node of the matrices .* got none for 10"),
        (("10, 30, 0, -6, rim", "10, 31, 0, -6, rim"), "another unit|places belong to other"),
        (("9, 21.6", "99, 0, 0, 0, rim\n9, 21.6"), r"Node 99 \(rim\) must have rows .* got none"),
        ((" seat:bore", " seat:"), "role of node 1 must be .* got 'seat:'"),
    ],
)
def test_tables_that_do_not_fit(files, tmp_path, change, message):
    text = TABLE.read_text()
    assert change[0] in text
    (tmp_path / "a.csv").write_text(text.replace(*change))
    with pytest.raises(BodyError, match=message):
        import_superelement(files / "sector.sti", tmp_path / "a.csv", units="mm-t-s")


def test_a_rim_that_is_no_cylinder(files, tmp_path):
    text = TABLE.read_text().replace(
        "9, 21.6506350946, -12.5, -6, interior", "9, 21.6506350946, -12.5, -6, rim"
    )
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(BodyError, match=r"one cylinder about the z axis, .* got 25 mm at \(21.651"):
        import_superelement(files / "sector.sti", tmp_path / "a.csv", units="mm-t-s")


def test_files_that_are_not_there_or_do_not_belong_together(files, tmp_path):
    with pytest.raises(BodyError, match="must come with a table"):
        import_superelement(files / "sector.sti", units="mm-t-s")
    with pytest.raises(BodyError, match=r"There is no file .*nothing\.mtx"):
        import_superelement(tmp_path / "nothing.mtx", TABLE, units="mm-t-s")
    with pytest.raises(BodyError, match=r"must be in a file .mtx, .sti, .op4 or .npz, got a.dat"):
        import_superelement(tmp_path / "a.dat", TABLE, units="mm-t-s")
    for name in ("sector.sti", "sector.mas"):
        shutil.copy(files / name, tmp_path)
    with pytest.raises(BodyError, match=r"There is no file .*sector\.dof"):
        read_storage(tmp_path / "sector.sti")
    (tmp_path / "sector.dof").write_text("1.1\n1.2\n")
    with pytest.raises(BodyError, match="has 2 rows, and the matrices have 60"):
        read_storage(tmp_path / "sector.sti")
