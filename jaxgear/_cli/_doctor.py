"""The command `doctor`: whether this installation is in order, and what it would take."""

import importlib.metadata
import os
import platform
import time
from collections.abc import Iterator
from typing import NamedTuple

_LIBRARIES = (
    "jaxgear jax jaxlib equinox optax numpy scipy scikit-fem xarray netCDF4 matplotlib diffrax"
).split()
# What a solution in closed form may differ by.
_ROUNDING = 1e-12


class Finding(NamedTuple):
    """One thing looked at.

    **Fields:**

    - `name`: what it is.
    - `good`: whether it is in order.
    - `text`: what was found and, where it is not in order, what to do.
    """

    name: str
    good: bool
    text: str


def findings() -> Iterator[Finding]:
    """Look at versions, precision, devices, threads, caches and solvers, and solve one mesh."""
    yield _libraries()
    yield _precision()
    yield _devices()
    yield _threads()
    yield from _caches()
    yield _solver()
    yield _mesh()


def print_findings() -> int:
    """Print what was found, line by line; the exit code is 1 where something is not in order."""
    bad = 0
    for each in findings():
        bad += not each.good
        print(f"{'ok   ' if each.good else 'WRONG'}  {each.name:<12}  {each.text}", flush=True)
    print("all is in order" if not bad else f"{bad} not in order")
    return 1 if bad else 0


def _libraries() -> Finding:
    found, missing = [f"Python {platform.python_version()}"], []
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    remedy = f"; missing: {', '.join(missing)}. Install jaxgear anew" if missing else ""
    return Finding("versions", not missing, ", ".join(found) + remedy)


def _precision() -> Finding:
    import jax

    kind = jax.numpy.zeros(1).dtype.name
    text = f"numbers are {kind}"
    return Finding("precision", kind == "float64", text)


def _devices() -> Finding:
    import jax

    text = f"{jax.default_backend()}: {', '.join(map(str, jax.devices()))}"
    return Finding("devices", True, f"{text}; {os.cpu_count()} cores")


def _threads() -> Finding:
    """Threads of libraries for linear algebra: many get in each other's way on small matrices."""
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info

    counts = {each["internal_api"]: each["num_threads"] for each in threadpool_info()}
    text = ", ".join(f"{name}: {count}" for name, count in sorted(counts.items())) or "of none"
    if max(counts.values(), default=1) > 1:
        text += "; one each is faster: unset OMP_NUM_THREADS, OPENBLAS_NUM_THREADS, MKL_NUM_THREADS"
    return Finding("threads", True, text)


def _caches() -> Iterator[Finding]:
    from jaxgear._cli._cache import cache_summary

    found = cache_summary()
    if found.folder is None:
        yield Finding("caches", True, "JAXGEAR_CACHE=off: nothing is kept, each run compiles anew")
        return
    for name, folder, rows in (
        ("bodies", found.folder, found.bodies),
        ("programs", found.programs_folder, found.programs),
    ):
        size = sum(row["size_MB"] for row in rows)
        count = sum(row.get("count", 1) for row in rows)
        yield _writable(name, folder, f"{count} of {size:.0f} MB in {folder}")


def _writable(name: str, folder: str | None, text: str) -> Finding:
    if folder is None:
        return Finding(name, True, "not kept")
    # The folder is made at the first use: until then its parents must let it.
    while not os.path.exists(folder):
        folder = os.path.dirname(folder)
    good = os.access(folder, os.W_OK)
    remedy = "; it cannot be written to. Name another folder: export JAXGEAR_CACHE=DIR"
    return Finding(name, good, text if good else text + remedy)


def _solver() -> Finding:
    from fem_prep import available_solvers

    name = available_solvers()[0]
    more = "" if name == "cholmod" else "; pip install 'jaxgear[cholmod]' condenses bodies faster"
    return Finding("bodies by", True, name + more)


def _mesh() -> Finding:
    """Solve a mesh cycle whose transmission error is known: constant stiffness, no relief.

    A spur pair of contact ratio 1 to 2 has one or two pairs of teeth in mesh, of which each gives
    by F / (c b): peak to peak is half of that.
    """
    import jax.numpy as jnp

    import jaxgear as jg

    start = time.perf_counter()
    face, stiffness = 10.0 * jg.mm, 14.0 * jg.N_per_mm_um
    pair = jg.GearPair(
        pinion=jg.Gear(20, face),
        wheel=jg.Gear(30, face),
        normal_module=2.0 * jg.mm,
        pressure_angle=20.0 * jg.deg,
    )
    model = jg.PairModel(pair, torque=50.0, compliance=jg.ConstantStiffness(stiffness))
    cycle = jg.mesh_cycle(model, jg.mesh_grid(pair, phases=64, slices=5))
    found = float(jnp.ptp(jg.transmission_error(pair, cycle)))
    closed = 50.0 / float(pair.base_radius[0]) / (2.0 * stiffness * face)
    error = abs(found / closed - 1.0)
    seconds = time.perf_counter() - start
    text = f"peak to peak of TE {found / jg.um:.6g} um, in closed form {closed / jg.um:.6g} um"
    return Finding("a mesh", error < _ROUNDING, f"{text}; {seconds:.1f} s with compiling")
