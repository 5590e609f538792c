"""Studies on a real SLURM of one node, which the test itself starts on the loopback."""

import getpass
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest
from tiny_cases import small_study

import jaxgear as jg

pytestmark = pytest.mark.slow

_PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "scancel", "squeue", "sinfo")
_CONF = """ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MailProg=/bin/true
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=4096 State=UNKNOWN
PartitionName=cpu Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def _found(name: str) -> str | None:
    """A program, also where only an administrator's path has it."""
    return shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin:/usr/local/sbin")


def _told(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def _wait(until: Callable[[], bool], what: str, seconds: float = 300.0) -> None:
    end = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < end, f"waited {seconds:g} s for {what}"
        time.sleep(0.2)


def _free_ports() -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Iterator[None]:
    """A cluster of one node, this machine: key, controller and node in a folder of their own."""
    programs = {name: _found(name) for name in _PROGRAMS}
    if missing := [name for name, path in programs.items() if path is None]:
        pytest.skip(f"{', '.join(missing)} not installed: apt install slurm-wlm munge")
    folder = tmp_path_factory.mktemp("slurm")
    for name in ("munge", "state", "spool"):
        (folder / name).mkdir(mode=0o700)
    key = folder / "munge" / "key"
    key.write_bytes(os.urandom(1024))
    key.chmod(0o600)
    host = socket.gethostname().split(".")[0]
    known = {"host": host, "user": getpass.getuser(), "cpus": os.cpu_count()}
    conf = folder / "slurm.conf"
    conf.write_text(_CONF.format(folder=folder, ports=_free_ports(), **known), encoding="utf-8")
    files = {"pid-file": "pid", "log-file": "log", "seed-file": "seed"}
    munged = [f"--{option}={folder}/munge/{file}" for option, file in files.items()]
    munged += [f"--key-file={key}", f"--socket={folder}/munge.socket"]
    with pytest.MonkeyPatch.context() as patch, (folder / "daemons.log").open("wb") as log:
        patch.setenv("SLURM_CONF", str(conf))
        begun: list[subprocess.Popen[bytes]] = []

        def begin(name: str, *options: str) -> None:
            path = programs[name]
            assert path is not None
            begun.append(subprocess.Popen([path, *options], stdout=log, stderr=log))

        try:
            # Forced: a folder of tests may stand below one that others can write to.
            begin("munged", "--foreground", "--force", *munged)
            _wait((folder / "munge.socket").exists, "munged", 30.0)
            begin("slurmctld", "-D")
            begin("slurmd", "-D")
            _wait(lambda: "idle" in _told("sinfo", "-h", "-o", "%T"), "an idle node", 60.0)
            yield
        finally:
            for each in reversed(begun):
                each.terminate()
                each.wait()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The table as one process makes it."""
    path = small_study(tmp_path_factory.mktemp("alone"))
    return jg.designs.run(path, path.parent / "out").designs


@pytest.mark.usefixtures("cluster")
def test_jobs_make_the_same_table(alone, tmp_path):
    pytest.importorskip("submitit")
    path = small_study(tmp_path, 'engine = "slurm"\n[work.slurm]\njobs = 2\nmemory_GB = 1.0\n')
    assert jg.designs.run(path, tmp_path / "out").designs.equals(alone)
    # What ran was jobs of the cluster: the controller remembers them.
    jobs = lambda: _told("squeue", "-h", "-t", "all", "-n", "jaxgear", "-o", "%T").split()
    _wait(lambda: jobs() == ["COMPLETED"] * 2, "two completed jobs", 30.0)


@pytest.mark.usefixtures("cluster")
def test_an_array_of_shards_makes_the_same_table(alone, tmp_path):
    path, out = small_study(tmp_path), tmp_path / "out"
    shard = "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT"
    command = f"{sys.executable} -m jaxgear study {path} --out {out} --quiet --shard {shard}"
    log = f"--output={tmp_path}/%a.log"
    job = _told("sbatch", "--parsable", "--array=0-3", log, f"--wrap={command}").strip()
    _wait(lambda: not _told("squeue", "-h", "-j", job), f"job {job}")
    logs = "".join(each.read_text(encoding="utf-8") for each in sorted(tmp_path.glob("*.log")))
    found = jg.designs.collect(path, out)
    assert found.status.done_designs == 12, logs
    assert found.designs.equals(alone)


@pytest.mark.usefixtures("cluster")
def test_cancelled_job_loses_nothing_that_is_finished(alone, tmp_path):
    path, out = small_study(tmp_path), tmp_path / "out"
    command = f"{sys.executable} -m jaxgear study {path} --out {out} --quiet --shard 0/1"
    chunks = lambda: {each.name: each.stat().st_mtime_ns for each in out.glob("chunks/[!.]*.nc")}
    log = f"--output={tmp_path}/job.log"
    job = _told("sbatch", "--parsable", log, f"--wrap={command}").strip()
    _wait(lambda: bool(chunks()), "the first chunk")
    _told("scancel", job)
    _wait(lambda: not _told("squeue", "-h", "-j", job), f"job {job}")
    before = chunks()
    assert jg.designs.run(path, out).designs.equals(alone)
    assert before.items() <= chunks().items()
