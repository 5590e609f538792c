"""What it costs to condense a gear body: time, processor time and memory.

    python benchmarks/bench_bodies.py [--all] [--out DIR] [--only NAME ...]

Every case runs in a process of its own, on one thread, so that its peak of memory is its own. The
body is the accessory wheel, all nodes of its rim kept, 50 modes. `--all` adds what takes minutes:
the body solved as if it did not repeat around, by every sparse solver at hand, a finer one, and
scikit-fem's own loop over forms beside the assembly. Machines differ and are noisy: compare ratios
within one table, of processor time if the machine is shared. Writes `bodies.json`.
"""

import argparse
import contextlib
import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

from timing import one_thread, peak


def main() -> None:
    """Run the cases one after the other and print them, or one of them for `main`."""
    parser = argparse.ArgumentParser(description="What it costs to condense a gear body.")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--all", action="store_true", help="also what takes minutes")
    parser.add_argument("--only", nargs="*", choices=CASES, metavar="NAME", help="some cases")
    parser.add_argument("--alone", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    # Before NumPy is imported; processes begun from here inherit it.
    one_thread()
    if options.alone:
        print(json.dumps(CASES[options.alone][1]() | {"peak_MB": peak()}))
        return
    options.out.mkdir(parents=True, exist_ok=True)
    report = {}
    print(f"{'':<50} {'time':>8}   {'processor':>9}   {'peak':>8}")
    for name in options.only or (CASES if options.all else QUICK):
        begun = [sys.executable, __file__, "--alone", name]
        done = subprocess.run(begun, capture_output=True, text=True)
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["?"])[-1]
            print(f"{CASES[name][0]:<50} not done: {reason}")
            continue
        report[name] = json.loads(done.stdout.splitlines()[-1])
        print_case(CASES[name][0], report[name])
    (options.out / "bodies.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"\nwritten to {options.out}")


def print_case(title: str, found: dict[str, Any]) -> None:
    """Print the rows of a case: all of it, then its steps."""
    memory = f"{found['peak_MB']:8.0f} MB"
    print(f"{title:<50} {found['s']:8.2f} s {found['cpu_s']:9.2f} s {memory}   {found['note']}")
    for step, (seconds, own) in found["steps"].items():
        print(f"  {step:<48} {seconds:8.2f} s {own:9.2f} s")


class Clock:
    """Seconds, and seconds of the processor, of steps by name; tells of progress too."""

    def __init__(self) -> None:
        self.steps: dict[str, tuple[float, float]] = {}

    @contextlib.contextmanager
    def __call__(self, step: str) -> Generator[None]:
        """Time a step."""
        start, own = time.perf_counter(), time.process_time()
        yield
        self.steps[step] = time.perf_counter() - start, time.process_time() - own

    def told(self, whole: str, note: str) -> dict[str, Any]:
        """What a case returns: one step is the whole, the others are its parts."""
        seconds, own = self.steps.pop(whole)
        return {"s": seconds, "cpu_s": own, "note": note, "steps": self.steps}


def wheel(sectors: int = 86, *, holes: int = 0, fine: bool = False):
    """The accessory wheel, assembled, its bore a rigid ring."""
    import numpy as np

    from fem_prep import GearBody, Holes, Material, MeshSizing, Seat, Web, body_grid, full_body

    pierced = (Holes(count=holes, diameter=20e-3, circle=84e-3),) if holes else ()
    body = GearBody(126.8631e-3, 9.5e-3, bore=40e-3, web=Web(50e-3, 3e-3, 118e-3, holes=pierced))
    fineness = MeshSizing(sectors, rim_axial=3, rim_radial=1, web_radial=12, hub_radial=2)
    if fine:
        fineness = replace(fineness, rim_axial=4, rim_radial=3, web_radial=18, web_layers=2)
    grid = body_grid(body, fineness)
    seats = [Seat("bore", grid.sets["seat:bore"], np.zeros(3))]
    return full_body("wheel", grid, Material(), seats)


def assembly(*, forms: bool = False) -> dict[str, Any]:
    """Stiffness and mass; with `forms` scikit-fem's loop over pairs of shape functions instead."""
    from fem_prep import Material, assemble

    clock, full = Clock(), wheel(78)
    work = scikit_fem_forms(full.grid) if forms else lambda: assemble(full.grid, Material())
    with clock("all"):
        work()
    return clock.told("all", f"{full.grid.dofs} unknowns")


def scikit_fem_forms(grid) -> Callable[[], object]:
    """The same matrices by scikit-fem's vector element, on straight bricks."""
    import numpy as np
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    from fem_prep import Material

    material = Material()
    # Its corners are ordered by the number of coordinates that are 1.
    corners = grid.bricks[:, [6, 2, 5, 7, 1, 3, 4, 0]]
    used, corners = np.unique(corners, return_inverse=True)
    mesh = skfem.MeshHex1(grid.nodes[used].T, corners.reshape(-1, 8).T)
    form = linear_elasticity(*lame_parameters(material.young, material.poisson))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return material.density * sum(u[i] * v[i] for i in range(3))

    def work():
        basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHexS2()), intorder=5)
        return form.assemble(basis), inertia.assemble(basis)

    return work


def condensing(
    sectors: int = 86,
    *,
    holes: int = 0,
    fine: bool = False,
    whole: bool = False,
    solver: str | None = None,
    rotating: bool = False,
) -> dict[str, Any]:
    """Condense the wheel from its grid on; `whole`: as if it did not repeat around."""
    import numpy as np

    from fem_prep import Rotation, _solvers, condense

    if solver is not None:
        if solver not in _solvers.available_solvers():
            raise SystemExit(f"{solver} is not installed")
        _solvers.available_solvers = lambda: [solver]  # ty: ignore[invalid-assignment]
    clock = Clock()
    with clock("all"):
        with clock("grid and assembly"):
            full = wheel(sectors, holes=holes, fine=fine)
        rotation = Rotation(1, np.arange(full.points)) if whole else None
        body = condense(full, rotating=rotating, rotation=rotation, progress=clock)
    by = solver or _solvers.available_solvers()[0]
    note = f"{full.grid.dofs} unknowns, {body.dofs} kept, {body.facts['sectors']} sectors, {by}"
    return clock.told("all", note)


def from_cache() -> dict[str, Any]:
    """Read the condensed wheel back."""
    from fem_prep import cached, condense

    clock = Clock()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["JAXGEAR_CACHE"] = folder
        with clock("condensed and written"):
            cached("0", lambda: condense(wheel()))
        with clock("all"):
            body, found = cached("0", lambda: condense(wheel()))
        size = sum(file.stat().st_size for file in Path(folder).rglob("*.npz"))
    if not found:
        raise SystemExit("The body did not come from the cache.")
    return clock.told("all", f"{body.dofs} coordinates, file of {size / 2**20:.0f} MB")


Case = tuple[str, Callable[[], dict[str, Any]]]
WHOLE = functools.partial(condensing, whole=True)
QUICK: dict[str, Case] = {
    "assembly": ("assembly", assembly),
    "wheel": ("accessory wheel", condensing),
    "rotating": ("  with terms of rotation", functools.partial(condensing, rotating=True)),
    "holes": ("  with 6 holes", functools.partial(condensing, 90, holes=6)),
    "fine": ("  of a finer grid", functools.partial(condensing, fine=True)),
    "cache": ("  from the cache", from_cache),
}
CASES = QUICK | {
    "forms": ("assembly by scikit-fem's forms", functools.partial(assembly, forms=True)),
    "cholmod": ("accessory wheel as a whole", functools.partial(WHOLE, solver="cholmod")),
    "superlu": ("accessory wheel as a whole", functools.partial(WHOLE, solver="superlu")),
    "fine-whole": ("  of a finer grid, as a whole", functools.partial(WHOLE, fine=True)),
}

if __name__ == "__main__":
    main()
