"""What a search needs of its scene, before anything is computed."""

import itertools

from jaxgear.scene._motion import motion_mistakes
from jaxgear.scene._scene import Mistake, Scene, SceneError
from jaxgear.scene._schema import GEARS
from jaxgear.study._design import refuse_unbounded
from jaxgear.study._objectives import AGAINST, is_dynamic, limits_of, minimised, over_speeds


def require_searchable(scene: Scene) -> None:
    """Refuse a search that cannot do what the scene asks for, before anything is computed."""
    refuse_unbounded(scene, tuple(scene.optimise.vary))
    require_swept(scene)
    _require_method(scene)


_NO_SPEEDS = (
    "which is taken over the speeds of [sweep], and there is no such table. "
    "Add one, such as:\n[sweep]\n"
    "pinion_speed_rad_s = { from = 50.0, to = 3000.0, points = 100 }"
)


def require_swept(scene: Scene) -> None:
    """Refuse an objective over speeds in a scene that has none, or none that can be computed."""
    if not (names := over_speeds(scene)):
        return
    found = motion_mistakes(scene, harmonic=True)
    bearings = [f"{gear}.shaft.bearings" for gear in GEARS]
    if "bearing_force" in names and not any(map(scene.rows, bearings)):
        key = AGAINST if scene.get(AGAINST) == "bearing_force" else "optimise.minimise"
        words = f"names bearing_force, but neither {' nor '.join(bearings)} is there"
        found.append(Mistake(scene.where(key), key, words))
    if not scene.has_table("sweep"):
        weighted = f"optimise.minimise.{names[0]}"
        key = weighted if weighted in scene.values else "optimise.minimise"
        key = key if is_dynamic(scene) else AGAINST
        found.insert(0, Mistake(scene.where(key), key, f"names {names[0]}, {_NO_SPEEDS}"))
    if found:
        raise SceneError(found)


def _require_method(scene: Scene) -> None:
    """Refuse methods and widths that do not go with what is asked for."""
    squares = scene.get("optimise.minimise") == "te_rms" and scene.optimise.over == "mean"
    limited, method = bool(limits_of(scene)), scene.optimise.method
    orders, against = (scene.optimise.harmonics or ()), scene.get(AGAINST)
    widths = [*(scene.optimise.anneal_um or ()), scene.mesh.smoothing_um]
    wrong = [
        (
            "method",
            method == "least_squares" and not squares,
            f'"{method}" is for a sum of squares: te_rms over the mean of torques',
        ),
        (
            "method",
            method != "lbfgs" and limited,
            f'"{method}" knows no limits: leave it out, and SLSQP keeps [optimise.limits]',
        ),
        (
            "anneal_um",
            len(widths) > 1 and (method == "least_squares" or limited),
            "needs lbfgs or adam, without [optimise.limits]",
        ),
        (
            "anneal_um",
            any(wide <= narrow for wide, narrow in itertools.pairwise(widths)),
            "must fall, and end above mesh.smoothing_um: " + ", ".join(f"{w:g}" for w in widths),
        ),
        (
            "harmonics",
            any(order % 1.0 or 2.0 * order >= scene.mesh.phases for order in orders),
            "must be whole numbers, less than half of mesh.phases",
        ),
        (
            "pareto.against",
            against is not None and minimised(scene) == {against: None},
            f'got "{against}", which optimise.minimise names too: name another response',
        ),
    ]
    found = [(f"optimise.{key}", words) for key, is_wrong, words in wrong if is_wrong]
    if found:
        raise SceneError([Mistake(scene.where(key), key, words) for key, words in found])
