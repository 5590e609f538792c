"""The file of a condensed body, and the cache of such files."""

import dataclasses
import functools
import json
import os
import shutil
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import hybrid_cases
import numpy as np
import platformdirs
import pytest

from fem_prep import _archive, _body_file, _cache, _condense
from fem_prep._archive import read_about
from fem_prep._artefact import ReducedBody
from fem_prep._body_file import content_hash, read_body, write_body
from fem_prep._cache import (
    CacheWarning,
    cache_entries,
    cache_folder,
    cached,
    clear_cache,
    file_digest,
    key_of,
)
from fem_prep._checks import BodyError
from fem_prep._equal_sectors import equal_sectors, evened
from fem_prep._sector_shapes import of_one_wave_each

DOF = 3 * 4 + 6 + 2


def _symmetric(seed: int, sign: int = 1) -> np.ndarray:
    matrix = np.random.default_rng(seed).standard_normal((DOF, DOF))
    return matrix + sign * matrix.T


def _body(**changes) -> ReducedBody:
    """Four rim nodes, one seat, two interior shapes and one probe, with everything there is."""
    random = np.random.default_rng(0)
    parts: dict[str, Any] = {
        "name": "wheel, 43 Zähne",
        "stiffness": _symmetric(1),
        "mass": _symmetric(2),
        "centrifugal_load": random.standard_normal(DOF),
        "rim_nodes": random.standard_normal((4, 3)),
        "rim_faces": np.array([[0, 1, 2, 3, 0, 1, 2, 3]]),
        "seats": ("left",),
        "seat_points": np.zeros((1, 3)),
        "interior": 2,
        "probes": ("web",),
        "probe_points": np.ones((1, 3)),
        "probe_rows": random.standard_normal((1, 3, DOF)),
        "coriolis": _symmetric(3, sign=-1),
        "facts": {"density_kg_m3": np.float64(7850.0), "orders": (1, 2), "note": "µ", "none": None},
    }
    return ReducedBody(**(parts | changes))


def _stored(path: Path, *, about: dict | None = None, leave: str = "", **arrays: Any) -> Path:
    """A file with parts changed and a hash that fits them."""
    packed, text = _body_file._packed(_body())
    text = json.dumps(json.loads(text) | (about or {}), sort_keys=True)
    kept: dict[str, Any] = packed | arrays
    kept.pop(leave, None)
    digest = _archive.content_digest(kept, text)
    texts = {"about": _archive._bytes(text), "hash": _archive._bytes(digest)}
    with open(path, "wb") as file:
        np.savez(file, **kept, **texts)
    return path


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "wheel.body"
    write_body(path, _body())
    return path


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "bodies"


def test_a_body_comes_back_to_the_last_digit(file):
    read, wrote = read_body(file), _body()
    for field in dataclasses.fields(ReducedBody):
        got, want = getattr(read, field.name), getattr(wrote, field.name)
        if isinstance(want, np.ndarray):
            assert np.array_equal(got, want), field.name
            assert got.shape == want.shape
        elif field.name != "facts":
            assert got == want, field.name
    assert read.facts == {"density_kg_m3": 7850.0, "orders": [1, 2], "note": "µ", "none": None}


def test_what_is_not_known_comes_back_empty(tmp_path):
    bare = _body(
        coriolis=None, probes=(), probe_points=np.zeros((0, 3)), probe_rows=np.zeros((0, 3, 0))
    )
    write_body(tmp_path / "bare", bare)
    read = read_body(tmp_path / "bare")
    assert read.coriolis is None
    assert read.probe_rows.shape == (0, 3, 0)
    assert read.bricks.dtype == np.int64


def test_the_hash_is_that_of_the_content(file, tmp_path):
    first = read_about(file)["hash"]
    assert write_body(tmp_path / "again", _body()) == first == content_hash(read_body(file))
    # A Fortran array holds the same numbers; one digit more or another name does not.
    turned = _body(mass=np.asfortranarray(_symmetric(2)))
    assert content_hash(turned) == first
    changed = _symmetric(2)
    changed[0, 0] = np.nextafter(changed[0, 0], np.inf)
    assert len({first, content_hash(_body(mass=changed)), content_hash(_body(name="b"))}) == 3


def test_the_file_is_plain_and_says_what_it_is(file):
    with np.load(file, allow_pickle=False) as archive:
        assert archive["stiffness"].dtype.str == "<f8"
        assert archive["rim_faces"].dtype.str == "<i8"
    about = read_about(file)
    assert about["format"] == 2
    assert about["units"] == "SI: m, kg, s, N, rad"
    assert set(about["versions"]) == {"jaxgear", "numpy", "scipy", "scikit-fem"}


def test_a_file_is_whole_or_as_it_was(file, monkeypatch):
    before = file.read_bytes()

    def broken(target, **arrays):
        target.write(b"half of it")
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez", broken)
    with pytest.raises(OSError, match="disk full"):
        write_body(file, _body(name="other"))
    assert file.read_bytes() == before
    assert [each.name for each in file.parent.iterdir()] == [file.name]


def test_no_file(tmp_path):
    with pytest.raises(BodyError, match=r"There is no file .*nothing\. Condense"):
        read_body(tmp_path / "nothing")


def test_another_file(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("not a body")
    with pytest.raises(BodyError, match="not that of a condensed body"):
        read_body(path)
    with open(path, "wb") as file:
        np.savez(file, a=np.zeros(3))
    with pytest.raises(BodyError, match="holds arrays, but not those of a condensed body"):
        read_body(path)


@pytest.mark.parametrize("part", [0.3, 0.9, 0.999])
def test_a_truncated_file(file, part):
    content = file.read_bytes()
    file.write_bytes(content[: int(part * len(content))])
    with pytest.raises(BodyError, match=r"is truncated .* copy the file again"):
        read_body(file)


def test_an_altered_file(file):
    content = bytearray(file.read_bytes())
    with zipfile.ZipFile(file) as archive:
        member = archive.getinfo("stiffness.npy")
    content[member.header_offset + 600] ^= 1
    file.write_bytes(content)
    with pytest.raises(BodyError, match="altered after it was written"):
        read_body(file)


def test_a_file_altered_with_care(tmp_path):
    # The archive's own sums fit here: only the hash does not.
    path = _stored(tmp_path / "a", mass=_symmetric(9))
    with np.load(path) as archive:
        members = dict(archive)
    members["mass"] = _symmetric(8)
    with open(path, "wb") as file:
        np.savez(file, **members)
    with pytest.raises(BodyError, match="does not match its hash"):
        read_body(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"about": {"format": 0}}, "format 2, got 0. Condense the body again with this version"),
        ({"about": {"format": 7}}, "format 2, got 7. It comes from a newer jaxgear"),
        ({"about": {"units": "mm, t"}}, "must be in SI: m, kg, s, N, rad, got mm, t"),
        ({"leave": "mass"}, "must hold all parts of a body, got none named mass"),
        ({"mass": np.zeros((DOF, DOF), dtype="<f4")}, "got mass of float32"),
        ({"stiffness": np.zeros((DOF, DOF), dtype=">f8")}, "got stiffness of >f8"),
        ({"more": np.zeros(2)}, "got more of float64"),
        ({"mass": np.zeros((DOF, 5))}, r"`ReducedBody.mass` must have the shape \[20, 20\]"),
    ],
)
def test_a_file_of_another_kind(tmp_path, changes, message):
    with pytest.raises(BodyError, match=message):
        read_body(_stored(tmp_path / "a", **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": np.full((DOF, DOF), np.nan)}, "`ReducedBody.mass` must be finite"),
        ({"rim_nodes": np.full((4, 3), np.inf)}, "`ReducedBody.rim_nodes` must be finite"),
        ({"stiffness": np.triu(_symmetric(1))}, "`ReducedBody.stiffness` must be symmetric"),
        ({"coriolis": _symmetric(3)}, "`ReducedBody.coriolis` must be skew"),
        ({"interior": 3}, r"got \[20, 20\]: the body has 4 rim nodes, 1 seats and 3 interior"),
        ({"rim_faces": np.full((1, 8), 4)}, "`ReducedBody.rim_faces` must name nodes 0 to 3"),
        ({"seats": ("a", "b")}, "`ReducedBody.seats` must be names of their own"),
        ({"facts": {"a": object()}}, "`ReducedBody.facts` must be finite numbers"),
        ({"facts": {"a": float("nan")}}, "`ReducedBody.facts` must be finite numbers"),
    ],
)
def test_a_body_that_is_not_sound_is_not_written(tmp_path, changes, message):
    with pytest.raises(BodyError, match=message):
        write_body(tmp_path / "a", _body(**changes))
    assert not list(tmp_path.iterdir())


@dataclasses.dataclass(frozen=True)
class _Steel:
    young: float = 206e9
    nodes: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(2))


def test_a_key_depends_on_everything_and_on_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "grid.inp"
    path.write_bytes(b"*NODE")
    inputs = {"steel": _Steel(), "holes": (1, 2.5, "a", None), "file": file_digest(path)}
    key = key_of(inputs)
    assert len(key) == 64
    assert key == key_of(dict(reversed(inputs.items())))
    path.write_bytes(b"*NODE, NSET=A")
    others = [
        inputs | {"steel": _Steel(young=207e9)},
        inputs | {"steel": _Steel(nodes=np.eye(2, dtype=int))},
        inputs | {"steel": _Steel(nodes=np.eye(2).reshape(4))},
        inputs | {"holes": (1, 2.5, "b", None)},
        inputs | {"file": file_digest(path)},
    ]
    assert len({key, *map(key_of, others)}) == 6
    monkeypatch.setattr(_cache, "METHOD", _cache.METHOD + 1)
    assert key_of(inputs) != key
    monkeypatch.undo()
    assert key_of(inputs) == key
    monkeypatch.setattr(_cache.importlib.metadata, "version", lambda name: f"{name} 99")
    assert key_of(inputs) != key
    with pytest.raises(TypeError, match="file_digest"):
        key_of({"path": path})


def test_the_folder_of_the_cache(monkeypatch):
    monkeypatch.setenv("JAXGEAR_CACHE", "/a")
    assert cache_folder() == Path("/a/bodies")
    monkeypatch.setenv("JAXGEAR_CACHE", "off")
    assert cache_folder() is None
    monkeypatch.delenv("JAXGEAR_CACHE")
    monkeypatch.setattr(platformdirs, "user_cache_path", _user_folder)
    assert cache_folder() == Path("/b/jaxgear/bodies")


def _user_folder(name, *, appauthor, opinion):
    assert (appauthor, opinion) == (False, False)
    return Path("/b") / name


def test_nothing_is_kept_where_the_cache_is_off(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("JAXGEAR_CACHE", "off")
    assert [cached("a" * 64, _body)[1] for _ in range(2)] == [False, False]
    assert (cache_entries(), clear_cache()) == ([], 0)
    assert not list(tmp_path.iterdir())


def test_the_second_time_a_body_comes_from_the_cache(folder):
    made = []

    def build():
        made.append(1)
        return _body()

    first, hit = cached("a" * 64, build)
    second, again = cached("a" * 64, build)
    assert (hit, again, len(made)) == (False, True, 1)
    assert content_hash(first) == content_hash(second)


def test_the_list_of_the_cache_and_clearing_it(folder):
    assert (cache_entries(), clear_cache()) == ([], 0)
    cached("a" * 64, _body)
    cached("b" * 64, lambda: _body(name="pinion"))
    (folder / f"{'c' * 64}.npz").write_bytes(b"damaged")
    (folder / ".d.tmp").write_bytes(b"left by a process that was stopped")
    for age, key in enumerate("bac"):
        os.utime(folder / f"{key * 64}.npz", (1e9 - age, 1e9 - age))
    cached("a" * 64, _body)
    found = cache_entries()
    assert [entry.key[0] for entry in found] == ["a", "b", "c"]
    assert [entry.name for entry in found] == ["wheel, 43 Zähne", "pinion", ""]
    assert found[0].size == (folder / f"{'a' * 64}.npz").stat().st_size
    assert clear_cache(["a" * 64]) == found[0].size
    assert [entry.key[0] for entry in cache_entries()] == ["b", "c"]
    assert clear_cache() == found[1].size + 7 + 34
    assert not list(folder.iterdir())


def test_a_damaged_file_in_the_cache_is_made_anew(folder):
    cached("a" * 64, _body)
    path = folder / f"{'a' * 64}.npz"
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.warns(CacheWarning, match="made anew.*truncated"):
        _, hit = cached("a" * 64, _body)
    assert not hit
    assert cached("a" * 64, _body)[1]


def test_a_body_in_the_place_of_another_is_made_anew(folder):
    first, _ = cached("a" * 64, _body)
    cached("b" * 64, lambda: _body(name="pinion"))
    shutil.copy(folder / f"{'b' * 64}.npz", folder / f"{'a' * 64}.npz")
    with pytest.warns(CacheWarning, match="made anew.*made from something else"):
        body, hit = cached("a" * 64, _body)
    assert not hit
    assert body.facts[_cache.MADE_FROM] == "a" * 64
    assert content_hash(body) == content_hash(first)
    assert cached("a" * 64, _body)[1]


def test_the_oldest_bodies_go_where_the_cache_is_full(folder, monkeypatch):
    for age, key in enumerate("abc"):
        cached(key * 64, _body)
        os.utime(folder / f"{key * 64}.npz", (1e9 - age, 1e9 - age))
    size = cache_entries()[0].size
    monkeypatch.setattr(_cache, "LIMIT", int(3.5 * size))
    cached("d" * 64, _body)
    assert [entry.key[0] for entry in cache_entries()] == ["d", "a", "b"]
    # One that is larger than the limit by itself stays: it was asked for.
    monkeypatch.setattr(_cache, "LIMIT", size // 2)
    cached("e" * 64, _body)
    assert [entry.key[0] for entry in cache_entries()] == ["e"]


def test_drafts_of_killed_processes_go_and_those_of_others_at_work_stay(folder):
    folder.mkdir(parents=True)
    for name in ("old", "new"):
        (folder / f".{name}.tmp").write_bytes(b"half")
    old = time.time() - 4000.0
    os.utime(folder / ".old.tmp", (old, old))
    cached("a" * 64, _body)
    assert [path.name for path in sorted(folder.iterdir())] == [".new.tmp", f"{'a' * 64}.npz"]


def test_a_cache_that_cannot_be_written_does_not_stop_the_work(tmp_path, monkeypatch):
    # A file in the place of the folder: no permission is needed to see it fail.
    (tmp_path / "cache").write_text("")
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    with pytest.warns(CacheWarning, match="cannot be kept in .* set JAXGEAR_CACHE"):
        body, hit = cached("a" * 64, _body)
    assert body.name == "wheel, 43 Zähne"
    assert not hit
    assert (cache_entries(), clear_cache()) == ([], 0)


def test_writers_at_once_leave_whole_files(tmp_path):
    path = tmp_path / "wheel.body"
    write_body(path, _body(name="from 0"))

    def write(number: int) -> str:
        return write_body(path, _body(name=f"from {number}"))

    with ThreadPoolExecutor(4) as pool:
        writing = [pool.submit(write, number) for number in range(1, 21)]
        read = [pool.submit(lambda: read_body(path).name) for _ in range(20)]
        assert len({each.result() for each in writing}) == 20
        assert {each.result() for each in read} <= {f"from {number}" for number in range(21)}
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


# --- Bodies of equal sectors

MATRICES = ("stiffness", "mass", "coriolis", "spin_softening", "stress_stiffening")


@functools.cache
def _of_sectors(holes: int = 0) -> ReducedBody:
    """24 sectors with terms of rotation, or as many as holes."""
    return hybrid_cases.body("spur", 1, holes=holes, modes=8, rotating=True)


def _condensed_without(step: str, monkeypatch) -> ReducedBody:
    """The body of 24 sectors, condensed without one of the last steps."""
    monkeypatch.setattr(_condense, step, lambda body: body)
    hybrid_cases.body.cache_clear()
    try:
        return hybrid_cases.body("spur", 1, modes=8, rotating=True)
    finally:
        hybrid_cases.body.cache_clear()


@pytest.mark.slow
@pytest.mark.parametrize("holes", [6, 0])
def test_equal_sectors_are_kept_once_and_come_back_to_the_last_digit(tmp_path, holes):
    path, body = tmp_path / "wheel.body", _of_sectors(holes)
    digest = write_body(path, body)
    packed, _ = _body_file._packed(body)
    assert {f"{name}.sector" for name in MATRICES} <= packed.keys()
    assert not packed.keys() & set(MATRICES)
    whole = sum(getattr(body, name).nbytes for name in MATRICES)
    kept = sum(packed[name + part].nbytes for name in MATRICES for part in (".sector", ".others"))
    assert kept < 0.55 * whole if holes else kept < 0.35 * whole
    found = read_body(path)
    for name in MATRICES:
        assert np.array_equal(getattr(found, name), getattr(body, name)), name
    assert content_hash(found) == digest


@pytest.mark.slow
def test_a_body_is_evened_by_no_more_than_rounding(monkeypatch):
    body, before = _of_sectors(), _condensed_without("evened", monkeypatch)
    for name in MATRICES:
        own, new = getattr(before, name), getattr(body, name)
        assert np.abs(new - own).max() < 1e-12 * np.abs(own).max(), name
    assert evened(body) is not body
    for name in MATRICES:
        assert np.array_equal(getattr(evened(body), name), getattr(body, name)), name


def test_interior_shapes_are_kept_on_two_sectors_and_come_back_to_the_last_digit(tmp_path):
    path, body = tmp_path / "wheel.body", _of_sectors()
    digest = write_body(path, body)
    packed, _ = _body_file._packed(body)
    assert "interior_shapes" not in packed
    assert 12 * packed["interior_shapes.sector"].nbytes == body.interior_shapes.nbytes
    found = read_body(path)
    assert np.array_equal(found.interior_shapes, body.interior_shapes)
    assert content_hash(found) == digest
    # In its own frame each sector is twice the cosine of the one before, less that before it.
    sectors = equal_sectors(body.nodes, body.facts)
    assert sectors is not None
    local = np.einsum("sij,msei->msej", sectors.turns, body.interior_shapes[:, sectors.nodes])
    twice = 2.0 * np.cos(2.0 * np.pi / 24 * packed["interior_shapes.waves"])
    before, own, after = (np.roll(local, shift, axis=1) for shift in (1, 0, -1))
    size = np.abs(local).max()
    np.testing.assert_allclose(after + before, twice[:, None, None, None] * own, 0.0, 1e-9 * size)
    # What is no wave is kept whole.
    shapes = body.interior_shapes.copy()
    shapes[0, 5, 1] += 1e-9 * size
    write_body(path, dataclasses.replace(body, interior_shapes=shapes))
    assert np.array_equal(read_body(path).interior_shapes, shapes)


def test_shapes_are_made_waves_by_no_more_than_rounding(monkeypatch):
    body, before = _of_sectors(), _condensed_without("of_one_wave_each", monkeypatch)
    own, new = before.interior_shapes, body.interior_shapes
    assert np.abs(new - own).max() < 1e-11 * np.abs(own).max()
    assert np.array_equal(of_one_wave_each(body).interior_shapes, new)
    # Mixed, shapes of two numbers of waves are left as they are.
    mixed = np.tensordot(np.ones((8, len(new))), new, axes=1)
    mixed = dataclasses.replace(body, interior_shapes=mixed)
    assert of_one_wave_each(mixed) is mixed


def test_what_is_not_the_same_in_every_sector_is_kept_whole(tmp_path):
    body, path = _of_sectors(), tmp_path / "wheel.body"
    mass = body.mass.copy()
    mass[70, 70] *= 1.0 + 1e-9
    other = dataclasses.replace(body, mass=mass)
    packed, _ = _body_file._packed(other)
    assert "mass" in packed
    assert "stiffness.sector" in packed
    write_body(path, other)
    assert np.array_equal(read_body(path).mass, mass)
    # And so is what claims other sectors than its rim has.
    claims = dataclasses.replace(body, facts={**body.facts, "sectors": 7})
    assert set(MATRICES) <= _body_file._packed(claims)[0].keys()


def test_parts_that_do_not_fit_are_refused(tmp_path):
    packed, text = _body_file._packed(_of_sectors())
    path = tmp_path / "wheel.body"
    cut = packed | {"mass.sector": packed["mass.sector"][:-1]}
    _archive.write_archive(path, cut, text)
    with pytest.raises(BodyError, match="parts of mass in the file"):
        read_body(path)
    moved = packed | {"rim_nodes": packed["rim_nodes"] * np.linspace(1.0, 2.0, 3)}
    _archive.write_archive(path, moved, text)
    with pytest.raises(BodyError, match="must repeat from sector to sector"):
        read_body(path)
    for name, wrong in (("sector", np.s_[:, :1]), ("waves", np.s_[:-1])):
        few = packed | {f"interior_shapes.{name}": packed[f"interior_shapes.{name}"][wrong]}
        _archive.write_archive(path, few, text)
        with pytest.raises(BodyError, match=r"interior shapes of the file .* must be waves"):
            read_body(path)


def test_files_of_the_first_format_are_read(tmp_path):
    path = _stored(tmp_path / "old.body", about={"format": 1})
    assert np.array_equal(read_body(path).mass, _body().mass)
