"""The conditions that every test runs under. Imports no package of ours."""

import gc
import os
import re
import shutil
import sys
import time
from importlib.metadata import version
from pathlib import Path

# Before anything imports NumPy: with its default threads a small solve takes ten times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tests compile far more than they compute: without the optimiser's passes, and with the old
# emitters of loops, that takes a quarter of the time. Releases after 0.10 have only the new
# emitters and refuse the flag. The older ones are for tests only: the derivatives of a wheel with a
# web by all its keys, a slow test, do not converge with them. `XLA_FLAGS= pytest` tests the
# programs as users have them, as `make test-slow` does.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
    " --xla_cpu_parallel_codegen_split_count=1"
    + " --xla_cpu_use_fusion_emitters=false"
    * version("jaxlib").startswith("0.10."),
)
# Where an operation stands in the sources: JAX notes it in each program, and XLA, where it puts
# the body in place of a call, joins such notes. That was half the time of this, its longest pass.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
# What one run has compiled the next one reads, as do commands that tests start, of which none then
# turns on a cache of its own. But for what takes less to compile [s] than to write and to read.
os.environ.setdefault(
    "JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".pytest_cache" / "compiled")
)
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.03")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")

import jax
import psutil
import pytest
from budget import pytest_addoption, pytest_runtest_call
from jaxtyping import install_import_hook

__all__ = [
    "pytest_addoption",
    "pytest_collection_finish",
    "pytest_configure",
    "pytest_runtest_call",
    "pytest_sessionfinish",
]

# What Python compiles is kept too, the checks below in it, whatever the environment says: else each
# process does it anew, those that tests start among them.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Modules that speak of the shapes of arrays. All else has plain types, which ty checks: to look at
# each cell of a table again as it is written takes longer than to write it. `jaxgear._types` makes
# the names: its converters of fields are most of all calls, and the classes check what they give.
_ROOT = Path(__file__).parents[1]
_SOURCES = (path for name in ("jaxgear", "optimise") for path in (_ROOT / name).rglob("*.py"))
_CHECKED = [
    ".".join(path.relative_to(_ROOT).with_suffix("").parts)
    for path in _SOURCES
    if path != _ROOT / "jaxgear" / "_types.py"
    and re.search("jaxtyping|_types import", path.read_text(encoding="utf-8"))
]

# The hook rewrites modules as they are imported; one that is already in has escaped it.
if escaped := [name for name in _CHECKED if name in sys.modules]:
    raise RuntimeError(f"Imported before the shape checks were installed: {escaped}.")
install_import_hook(_CHECKED, "late_checks.checked")

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# As commands, but sooner: each look for garbage walks through all that JAX has traced.
gc.set_threshold(200_000, 50, 100)

# Of compiled programs on the disk, of all versions of the code [B]; of one process in memory, as a
# share of the machine's, and by how much it may grow after it has let programs go: that memory is
# used again, not given back.
_DISK, _MEMORY, _MORE = 1e9, 0.25, 1.25
# A test that takes longer may have compiled much [s].
_LONG = 1.0


@pytest.fixture(autouse=True, scope="session")
def _fonts_are_known():
    """Where fonts were never looked for, matplotlib does so once: that is no test's time."""
    import matplotlib.font_manager  # noqa: F401


def pytest_collection_finish() -> None:
    """What was imported stays: no look for garbage walks through it again."""
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Nothing more is given back: pytest looks for garbage five times as it ends."""
    gc.freeze()


def pytest_configure(config: pytest.Config) -> None:
    """Begin a cache anew that has grown too large; workers begin after this."""
    compiled = Path(os.environ["JAX_COMPILATION_CACHE_DIR"])
    ours = compiled.is_relative_to(config.rootpath) and not hasattr(config, "workerinput")
    if ours and sum(file.stat().st_size for file in compiled.glob("*")) > _DISK:
        shutil.rmtree(compiled)


@pytest.fixture(autouse=True)
def _make_room():
    """Where a test may have compiled much: XLA maps each kernel, and maps are limited."""
    started = time.monotonic()
    yield
    if time.monotonic() - started > _LONG:
        from jaxgear._kept_programs import make_room

        make_room()


@pytest.fixture(scope="session")
def _allowed() -> dict[str, float]:
    """Memory that this process may take [B]."""
    return {"memory": _MEMORY * psutil.virtual_memory().total}


@pytest.fixture(autouse=True, scope="module")
def _let_programs_go(_allowed: dict[str, float]):
    """Forget what was compiled where it has come to fill the memory; else other files use it."""
    yield
    if psutil.Process().memory_info().rss > _allowed["memory"]:
        jax.clear_caches()
        _allowed["memory"] = _MORE * psutil.Process().memory_info().rss
