"""The conditions that every test runs under. Imports no package of ours."""

import os
import sys

# Before anything imports NumPy: with its default threads a small solve takes ten times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tests compile far more than they compute: without the optimiser's passes that takes half the time.
# `XLA_FLAGS= pytest` tests the programs as users have them.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
)

# A command would turn the cache of compiled programs on for all tests that follow it.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ.setdefault("JAX_ENABLE_COMPILATION_CACHE", "false")

import jax
import pytest
from jaxtyping import install_import_hook

_CHECKED = ("jaxgear", "optimise")

# The hook rewrites modules as they are imported; one that is already in has escaped it.
if escaped := [name for name in _CHECKED if name in sys.modules]:
    raise RuntimeError(f"Imported before the shape checks were installed: {escaped}.")
install_import_hook(_CHECKED, "beartype.beartype")

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(autouse=True, scope="module")
def _let_programs_go():
    """Forget what was compiled after each file: thousands of programs exhaust a process."""
    yield
    jax.clear_caches()
