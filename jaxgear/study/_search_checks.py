"""What a search needs of its scene, before anything is computed."""

import itertools
from collections.abc import Mapping

from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._motion import motion_mistakes
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.scene._tables import DampingKeys, SweepKeys
from jaxgear.study._design import refuse_unbounded
from jaxgear.study._objectives import is_dynamic, limits_of, over_speeds


def require_searchable(scene: Scene) -> None:
    """Refuse a search that cannot do what the scene asks for, before anything is computed."""
    refuse_unbounded(scene, tuple(scene.optimise.vary))
    asked = scene.optimise, scene.damping, scene.sweep
    scene.refuse(not_over_speeds(*asked, scene.gears))
    found = _of_method(scene.optimise, scene.mesh.smoothing_um, scene.mesh.phases)
    scene.refuse((f"optimise.{key}", words) for key, words in found)


_NO_SPEEDS = (
    "which is taken over the speeds of [sweep], and there is no such table. "
    "Add one, such as:\n[sweep]\n"
    "pinion_speed_rad_s = { from = 50.0, to = 3000.0, points = 100 }"
)


def not_over_speeds(
    asked: OptimiseKeys, damping: DampingKeys, sweep: SweepKeys, gears: Mapping[str, GearKeys]
) -> list[tuple[str, str]]:
    """What is wrong with an objective over speeds, of a scene without any that can be computed."""
    if not (names := over_speeds(asked)):
        return []
    found = list(motion_mistakes(damping, sweep, harmonic=True))
    against = "optimise.pareto.against"
    if "bearing_force" in names and not any(gear.shaft.bearings for gear in gears.values()):
        key = against if asked.pareto.against == "bearing_force" else "optimise.minimise"
        bearings = " nor ".join(f"{gear}.shaft.bearings" for gear in GEARS)
        found.append((key, f"names bearing_force, but neither {bearings} is there"))
    if not sweep.is_given:
        key = "optimise.minimise" + (f".{names[0]}" if asked.alone is None else "")
        key = key if is_dynamic(asked) else against
        found.insert(0, (key, f"names {names[0]}, {_NO_SPEEDS}"))
    return found


def _of_method(asked: OptimiseKeys, smoothing: float, phases: int) -> list[tuple[str, str]]:
    """Keys of methods and widths [um] that do not go with what is asked for, and why."""
    squares = asked.alone == "te_rms" and asked.over == "mean"
    limited, method, against = bool(limits_of(asked)), asked.method, asked.pareto.against
    widths = [*(asked.anneal_um or ()), smoothing]
    falling = all(wide > narrow for wide, narrow in itertools.pairwise(widths))
    orders = all(not order % 1.0 and 2.0 * order < phases for order in asked.harmonics or ())
    found = []
    if method == "least_squares" and not squares:
        words = f'"{method}" is for a sum of squares: te_rms over the mean of torques'
        found.append(("method", words))
    if method != "lbfgs" and limited:
        words = f'"{method}" knows no limits: leave it out, and SLSQP keeps [optimise.limits]'
        found.append(("method", words))
    if len(widths) > 1 and (method == "least_squares" or limited):
        found.append(("anneal_um", "needs lbfgs or adam, without [optimise.limits]"))
    if not falling:
        words = "must fall, and end above mesh.smoothing_um: "
        found.append(("anneal_um", words + ", ".join(f"{width:g}" for width in widths)))
    if not orders:
        found.append(("harmonics", "must be whole numbers, less than half of mesh.phases"))
    if against is not None and asked.alone == against:
        words = f'got "{against}", which optimise.minimise names too: name another response'
        found.append(("pareto.against", words))
    return found
