"""Studies by several processes and schedulers: the same table, whoever computes and dies."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from tiny_cases import small_study

import jaxgear as jg

pytestmark = pytest.mark.slow


def _begun(path: Path, out: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "jaxgear", "study", str(path), "--out", str(out), "--quiet"]
    return subprocess.Popen(
        [*command, "--no-pictures"], stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def _chunks(out: Path) -> dict[str, int]:
    """When each finished chunk was written."""
    return {path.name: path.stat().st_mtime_ns for path in out.glob("chunks/[!.]*.nc")}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The table as one process makes it."""
    folder = tmp_path_factory.mktemp("alone")
    return jg.designs.run(small_study(folder), folder / "out").designs


def test_processes_and_parts_make_the_same_table(alone, tmp_path):
    path = small_study(tmp_path, "workers = 2\n")
    assert jg.designs.run(path, tmp_path / "out").designs.equals(alone)
    path = small_study(tmp_path)
    for index in (1, 0):
        found = jg.designs.run(path, tmp_path / "parts", shard=jg.designs.Shard(index, 2))
    assert found.designs.equals(alone)


def test_dask_makes_the_same_table(alone, tmp_path):
    pytest.importorskip("distributed")
    program = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    address = tmp_path / "scheduler.json"
    begun = [subprocess.Popen([*program, "--host", "127.0.0.1", "--scheduler-file", str(address)])]
    try:
        while not address.exists():
            time.sleep(0.2)
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-dashboard"]
        worker += ["--scheduler-file", str(address), "--nthreads", "1", "--no-nanny"]
        begun += [subprocess.Popen(worker) for _ in range(2)]
        told = json.loads(address.read_text())["address"]
        path = small_study(tmp_path, f'engine = "dask"\nscheduler = "{told}"\n')
        assert jg.designs.run(path, tmp_path / "out").designs.equals(alone)
    finally:
        for each in begun:
            each.terminate()
            each.wait()


def test_jobs_of_submitit_make_the_same_table(alone, tmp_path):
    pytest.importorskip("submitit")
    path = small_study(tmp_path, 'engine = "slurm"\n[work.slurm]\ncluster = "local"\njobs = 2\n')
    assert jg.designs.run(path, tmp_path / "out").designs.equals(alone)


def test_killed_study_goes_on_and_computes_nothing_twice(tmp_path):
    path, out = small_study(tmp_path, chunk=1, points=200), tmp_path / "out"
    chance = random.Random(0)
    for kill in range(20):
        before = _chunks(out)
        begun = _begun(path, out)
        if kill % 4 == 3:
            # While it starts, reads, or compiles.
            time.sleep(chance.uniform(0.0, 5.0))
        else:
            # While it computes or writes a chunk, or one of the next.
            while begun.poll() is None and len(_chunks(out)) == len(before):
                time.sleep(0.002)
            time.sleep(chance.uniform(0.0, 0.05))
        assert begun.poll() is None
        os.killpg(begun.pid, signal.SIGKILL)
        begun.communicate()
        assert before.items() <= _chunks(out).items()
    before = _chunks(out)
    assert 0 < len(before) < 200
    found = jg.designs.run(path, out)
    assert before.items() <= _chunks(out).items()
    (tmp_path / "alone").mkdir()
    whole = small_study(tmp_path / "alone", chunk=50, points=200)
    assert found.designs.equals(jg.designs.run(whole, tmp_path / "alone" / "out").designs)


def test_worker_that_dies_is_replaced(alone, tmp_path):
    path, out = small_study(tmp_path, "workers = 2\n", chunk=1), tmp_path / "out"
    begun = _begun(path, out)
    while not _chunks(out):
        time.sleep(0.005)
    workers = [
        each
        for each in psutil.Process(begun.pid).children()
        if "spawn_main" in " ".join(each.cmdline())
    ]
    workers[0].kill()
    before = _chunks(out)
    begun.communicate()
    assert begun.returncode == 0
    assert before.items() <= _chunks(out).items()
    assert jg.designs.collect(path, out).designs.equals(alone)


def test_two_may_compute_and_collect_at_once(alone, tmp_path):
    path, out = small_study(tmp_path), tmp_path / "out"
    both = [_begun(path, out) for _ in range(2)]
    for each in both:
        each.communicate()
    assert [each.returncode for each in both] == [0, 0]
    assert jg.designs.collect(path, out).designs.equals(alone)


def test_full_disk_is_named_and_what_is_finished_stays(tmp_path):
    # Twelve chunks, of which a few have room.
    path, out = small_study(tmp_path, chunk=1), tmp_path / "out"
    out.mkdir()
    if os.geteuid() or subprocess.call(
        ["mount", "-t", "tmpfs", "-o", "size=60k", "none", str(out)]
    ):
        pytest.skip("only who may mount a small disk can fill it")
    try:
        begun = _begun(path, out)
        told = begun.communicate()[1]
        assert begun.returncode == 1
        assert "No space left on device" in told
        assert 0 < len(_chunks(out)) < 12
        subprocess.check_call(["mount", "-o", "remount,size=20m", str(out)])
        before = _chunks(out)
        assert jg.designs.run(path, out).status.done_designs == 12
        assert before.items() <= _chunks(out).items()
    finally:
        subprocess.check_call(["umount", str(out)])
