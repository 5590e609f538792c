"""How well a branch is followed, and what it costs, beside steps so short that it is known.

    python benchmarks/bench_branches.py [resolution windows] [--quick] [--out DIR]

Rigid pairs, over speed: `resolution` compares straight lines between the points of the default with
a branch of short steps; `windows` where stability is lost and comes back, with little damping.
Processor seconds of second runs. `--quick` takes one pair in each. Writes `branches.json`.
"""

import time
from typing import Any

from timing import in_parts

# Pair, helix angle [deg], speeds from and to [rad/s].
RESOLVED = (
    ("accessory", 14.0, 100.0, 2000.0),
    ("accessory", 0.0, 100.0, 2000.0),
    ("power", 0.0, 100.0, 3000.0),
)
# Damping ratio of the accessory pair's mesh; its structure has half of it.
DAMPED = (0.01, 0.005)
# Arc length of a step where the branch is taken as known.
RESOLVED_BY, DAMPED_BY = 0.004, 0.01


def main() -> None:
    """Run the parts asked for and print their tables."""
    parts = {"resolution": resolution, "windows": windows}
    in_parts("How well a branch is followed.", "one pair in each", "branches.json", parts)


def system_of(pair: str, *settings: str):
    """A rigid pair in motion."""
    import jaxgear as jg
    from jaxgear.study._dynamics import dynamics_of

    scene = jg.example_scene(pair, settings)
    model = jg.model_of(scene)
    return dynamics_of(model, jg.grid_of(scene, model, scene.sweep.steps), scene).system


def followed(system, low: float, high: float, short: float, **more: Any):
    """A branch by the default and by short steps, and processor seconds of both [s]."""
    import jaxgear as jg

    # What is compiled first does not count.
    jg.continuation(system, low, high, most_points=2, **more)
    start = time.process_time()
    curve = jg.continuation(system, low, high, **more)
    middle = time.process_time()
    steps: Any = {"first_step": short, "largest_step": short, "most_points": 100_000}
    known = jg.continuation(system, low, high, **steps, **more)
    return (curve, middle - start), (known, time.process_time() - middle)


def resolution(*, quick: bool) -> dict[str, Any]:
    """How far straight lines between points are off."""
    import numpy as np

    report = {}
    for pair, helix, low, high in RESOLVED[: 1 if quick else None]:
        system = system_of(pair, f"pair.helix_angle_deg={helix}")
        (curve, seconds), (known, _) = followed(system, low, high, RESOLVED_BY, stability=False)

        def off(name: str, curve=curve, known=known) -> float:
            right = getattr(known, name)
            found = np.interp(np.log(known.speed), np.log(curve.speed), getattr(curve, name))
            return float(np.max(np.abs(found - right)) / np.max(right))

        te, ratio = off("te_rms"), off("dynamic_ratio")
        print(
            f"{pair:<10} {helix:4.0f} deg {curve.speed.size:5} points for {known.speed.size:6}, "
            f"{seconds:6.1f} s; off by {100 * te:6.2f} % of the largest RMS of TE, "
            f"{100 * ratio:6.2f} % of the ratio",
            flush=True,
        )
        report[f"{pair}, {helix:.0f} deg"] = {
            "points": curve.speed.size,
            "te": te,
            "ratio": ratio,
            "processor_s": seconds,
        }
    return report


def windows(*, quick: bool) -> dict[str, Any]:
    """Where, of those that are known, stability is lost."""
    import numpy as np

    report = {}
    for damping in DAMPED[: 1 if quick else None]:
        settings = f"damping.mesh={damping}", f"damping.structure={damping / 2.0}", "mesh.slices=6"
        found = followed(system_of("accessory", *settings), 500.0, 4000.0, DAMPED_BY)
        places = [
            np.sort([point.speed for point in (*curve.doublings, *curve.tori)])
            for curve, _ in found
        ]
        missed = [
            float(speed)
            for speed in places[1]
            if not np.any(np.abs(places[0] / speed - 1.0) < 1e-4)
        ]
        (curve, seconds), (known, _) = found
        print(
            f"damping {damping:<7} {curve.speed.size:5} points for {known.speed.size:6}, "
            f"{seconds:6.1f} s; {places[1].size} passages, missed: {np.round(missed, 1)}",
            flush=True,
        )
        report[str(damping)] = {
            "points": curve.speed.size,
            "passages": places[1].tolist(),
            "missed": missed,
            "processor_s": seconds,
        }
    return report


if __name__ == "__main__":
    main()
