"""A loaded tooth of the accessory wheel: condensed body and beams against all of it in bricks.

    python benchmarks/judge.py [--finer]

The wheel sits on a held bore of 40 mm in place of its shaft. The full model has all its teeth, the
loaded one and its neighbours with exact fillets and involutes; the hybrid one is what meshes: the
condensed body of one element for each tooth, the feet of slices on its rim, and a beam for each
slice. Deflections are those of the tooth's middle plane, along the load, without the contact's.
Takes three minutes, with `--finer` four and 4 GB.
"""

import argparse
import os
import sys
import time
from itertools import product
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import jax
import numpy as np
from cases import accessory
from verification import tooth_model as tm

# Equal parts of the face, and those that are looked at.
PIECES = 9
ACROSS = {"middle": 4, "quarter": 6, "edge": 8}
# Line load that gives the deflections printed [N/m].
LOAD = 100e3
COARSER = tm.ToothFineness(base=2, flank=3, rim_axial=3, rim_radial=1, web_radial=4)
FINER = tm.ToothFineness(base=6, fillet=3, flank=8, rim_radial=6, web_radial=8)

Found = dict[str, tm.Influence]


def loads() -> dict[str, np.ndarray]:
    """Line loads on the pieces of the face, over the mean one."""
    return {"even": np.ones(PIECES), "one-sided": np.linspace(0.0, 2.0, PIECES)}


def full(fineness: tm.ToothFineness, *, alone: bool = False) -> tuple[Found, str]:
    """The full model's answers, and what it cost."""
    start = time.perf_counter()
    pair = accessory()
    body, material = tm.accessory_wheel(pair)
    model = tm.held(tm.toothed_gear(body, pair, 1, fineness, alone=alone), material)
    half = 0.5 * float(pair.face_width)
    edges = np.linspace(-half, half, PIECES + 1)
    places = tm.judged_places(pair, 1)
    found = {name: tm.full_influence(model, each, edges) for name, each in places.items()}
    seconds = time.perf_counter() - start
    return found, f"{model.gear.grid.dofs:,} unknowns, {seconds:.0f} s"


def error(hybrid: Found, judge: Found, place: str, load: np.ndarray, at: int) -> float:
    """How much more the hybrid model gives, of what the full one does [%]."""
    return 100.0 * float(hybrid[place].whole[at] @ load / (judge[place].whole[at] @ load) - 1.0)


def in_parts(hybrid: Found, judge: Found, place: str, load: np.ndarray, at: int) -> str:
    """A row of both models' deflections and their parts [um]."""
    ours, theirs = hybrid[place], judge[place]
    parts = [theirs.whole, ours.whole, theirs.foot, ours.foot, ours.root, theirs.tooth, ours.tooth]
    return " ".join(f"{1e6 * LOAD * float(each[at] @ load):8.3f}" for each in parts)


def print_deflections(hybrid: Found, judge: Found) -> None:
    """Print deflections under loads on the whole face, and under one on each piece alone."""
    print(f"\nDeflection at {LOAD / 1e3:.0f} N/mm, in um; the root's part is one of the foot's")
    names = ["full", "hybrid", "foot:f", "foot:h", "root:h", "tooth:f", "tooth:h"]
    print(f"{'':36}" + " ".join(f"{name:>8}" for name in names) + "   hybrid over full")
    whole, alone = loads().items(), np.eye(PIECES)
    for place in hybrid:
        cases = [(name, across, load) for name, load in whole for across in ACROSS]
        cases += [("there only", across, alone[at]) for across, at in ACROSS.items()]
        for name, across, load in cases:
            at = ACROSS[across]
            row = in_parts(hybrid, judge, place, load, at)
            off = error(hybrid, judge, place, load, at)
            print(f"{place:13} {name:>10} {across:>8}    {row}   {off:+6.1f} %")


def errors(hybrid: Found, judge: Found, load: np.ndarray) -> str:
    """Errors at all places, pitch point first, from the middle to the edge."""
    each = [error(hybrid, judge, p, load, at) for p in hybrid for at in ACROSS.values()]
    return " ".join(f"{value:+8.1f}" for value in each)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="The judge of teeth on condensed bodies.")
    parser.add_argument("--finer", action="store_true", help="judge by the finer full model")
    finer = parser.parse_args().finer
    jax.config.update("jax_enable_x64", True)
    even, pair = np.ones(PIECES), accessory()
    body, material = tm.accessory_wheel(pair)
    places = tm.judged_places(pair, 1)

    coarse, cost = full(COARSER)
    print(f"Full model, coarser: {cost}")
    judge, cost = full(tm.ToothFineness())
    print(f"Full model: {cost}")
    print(f"  coarser one over it, even load [%]:        {errors(coarse, judge, even)}")
    alone, _ = full(tm.ToothFineness(), alone=True)
    print(f"  without the other teeth, even load [%]:    {errors(alone, judge, even)}")
    if finer:
        before = judge
        judge, cost = full(FINER)
        print(f"Full model, finer, which judges: {cost}")
        print(f"  the one before over it, even load [%]:     {errors(before, judge, even)}")

    wheel = tm.condensed_wheel(body, material, pair.wheel.teeth)
    hybrid = tm.hybrid_influence(wheel, material, pair, 1, places, PIECES)
    print_deflections(hybrid, judge)

    print(
        "\nHybrid over full, even load [%]: pitch point, near the tip; middle, quarter, edge each"
    )
    finer_wheel = tm.condensed_wheel(body, material, pair.wheel.teeth, elements=2)
    for points, corrected in product((2, 4, tm.ROOT_POINTS), (False, True)):
        how = tm.Connection(points=points, corrected=corrected)
        for count, condensed in ((1, wheel), (2, finer_wheel)):
            found = tm.hybrid_influence(condensed, material, pair, 1, places, PIECES, how)
            says = "root corrected" if corrected else "not corrected"
            print(
                f"  {points:2} points, {says:14}, {count} elements a tooth "
                f"{errors(found, judge, even)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
