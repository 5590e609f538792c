"""A study on several devices of one process: the same table, bit for bit."""

import os
import subprocess
import sys

import pytest
import xarray as xr
from tiny_cases import small_study

_SCRIPT = """
import sys
import jax
import jaxgear as jg
from jaxgear.designs import _evaluate

jax.config.update("jax_enable_x64", True)
jg.cache_compilations()
used, called = set(), _evaluate.called


def seen(programs, rows, size):
    for each in programs:
        used.update(each.compiled.input_shardings[0][0].device_set)
    return called(programs, rows, size)


_evaluate.called = seen
found = jg.designs.run("study.toml", sys.argv[1]).designs
assert not any(found["reason"].values)
found.to_netcdf(sys.argv[1] + ".nc")
print(len(used), jax.device_count())
"""


@pytest.mark.slow
def test_two_devices_make_the_same_table(tmp_path):
    # Chunks of five and two: shares are unequal, and one of the last call's is a single design.
    small_study(tmp_path, points=7, chunk=5, arrays='"transmission_error_um"')
    for count in (1, 2):
        flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={count}"
        told = subprocess.run(
            [sys.executable, "-c", _SCRIPT, str(count)],
            cwd=tmp_path,
            env={**os.environ, "XLA_FLAGS": flags},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert told.split()[-2:] == [str(count)] * 2
    one, two = (xr.load_dataset(tmp_path / f"{count}.nc") for count in (1, 2))
    assert one.equals(two)
    assert one.sizes["design"] == 7
