"""What [robust] asks for: an optimum for gears as they are made, and how it was judged.

The sample is drawn once. What scatters without a variable's say, such as the torque's stiffness of
the teeth, is prepared once for each gear of it; a search then solves contact alone.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import optimise
from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._solve._cycle import PreparedMesh, corrected_cycle, prepare_mesh
from jaxgear._types import Reals, Scalar
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import unit_of
from jaxgear.study._design import DesignSpace, limits_objectives, limits_of, objective_of
from jaxgear.study._ranks import Doubtful
from jaxgear.study._scatter import Scatter, samples_of
from jaxgear.study._statics import SolverFailure, torques_of


def judge_of(
    scatter: Scatter, grid: MeshGrid, law: AbstractContactLaw
) -> Callable[[Reals, Reals, PreparedMesh | None], Reals]:
    """The objective and the responses that have limits, of one gear of a sample.

    **Arguments:**

    - `scatter`: about the design.
    - `grid`: phases, lines and slices.
    - `law`: contact law.

    **Returns:**

    A function of the variables, the deviations, and the prepared meshes or `None`, over all
    torques of the scene; NaN where a cycle was not solved.
    """
    scene = scatter.space.scene
    torques = jnp.asarray(torques_of(scene, "optimise.torques_Nm"))
    parts = objective_of(scene, grid)[0], *limits_objectives(scene, law)
    worst = scene["optimise.over"] == "worst"

    def judge(values: Reals, drawn: Reals, prepared: PreparedMesh | None) -> Reals:
        def at_torque(torque: Scalar, mesh: PreparedMesh | None) -> Reals:
            model = scatter.model(values, drawn, torque)
            mesh = prepare_mesh(model, grid) if mesh is None else mesh
            cycle = corrected_cycle(mesh, model, law=law)
            found = jnp.stack([part(model, cycle, law) for part in parts])
            return jnp.where(jnp.all(cycle.converged), found, jnp.nan)

        found = jax.lax.map(lambda both: at_torque(*both), (torques, prepared))
        first = jnp.max(found[:, 0]) if worst else jnp.mean(found[:, 0])
        return jnp.concatenate([first[None], jnp.max(found[:, 1:], axis=0)])

    return judge


def members_of(
    scatter: Scatter, samples: np.ndarray, grid: MeshGrid, prepared: PreparedMesh | None
) -> optimise.Population:
    """The gears of a sample, with all that no variable changes.

    **Arguments:**

    - `scatter`: about the design.
    - `samples`: deviations, `[gear, quantity]`.
    - `grid`: phases, lines and slices.
    - `prepared`: the meshes of the nominal gears at the scene's torques, where the variables
        leave them as they are.

    **Returns:**

    The population.
    """
    space = scatter.space
    nothing = jax.tree.map(lambda leaf: None, prepared)
    if scatter.same_mesh or not space.flanks_only:
        # Either all have one mesh, or each evaluation prepares its own.
        return optimise.Population(jnp.asarray(samples), prepared, nothing)
    torques = jnp.asarray(torques_of(space.scene, "optimise.torques_Nm"))
    start = jnp.asarray(space.start)

    def prepare(drawn: Reals) -> PreparedMesh:
        at = lambda torque: prepare_mesh(scatter.model(start, drawn, torque), grid)
        return jax.lax.map(at, torques)

    return optimise.population(prepare, samples)


# Of the scatter of an objective, the width over which its quantile is smoothed. The spread of the
# sample grows by 6 % with it. Half of it follows single members of 256, and what it gains on them
# is not there on fresh ones; twice as much is no longer the quantile that was asked for.
_WIDTH = 0.2
# Of its mean, the width where a response hardly scatters; and of a limit, that of its response:
# the load at the ends of the face may be nothing in all gears.
_NARROWEST, _NARROWEST_OF_LIMIT = 1e-6, 1e-3
# A quantity that moves the objective by less than this, relatively, has no effect.
_NOTHING = 1e-9


class JudgedDesign(NamedTuple):
    """A design in gears as they are made, with exact contact.

    **Fields:**

    - `point`: values of the variables, in the units of their keys.
    - `fresh`: objective in each gear of the fresh sample, in its own unit.
    - `limited`: responses that have limits, `[gear, limit]`, in the unit of each.
    - `at_means`: objective of the gear without deviations.
    - `influence`: of each quantity.
    """

    point: np.ndarray
    fresh: np.ndarray
    limited: np.ndarray
    at_means: float
    influence: optimise.Influence


class Hardened(NamedTuple):
    """Nominal and robust optimum, judged alike.

    **Fields:**

    - `scatter`: for which the robust one was made.
    - `nominal`, `robust`: the designs.
    - `found`: the search.
    - `method`: its name.
    - `widths`: of the smooth quantiles of the objective and of each limited response.
    - `began`: the smooth measure of the nominal optimum over the sample searched with.
    - `seconds`: of the search, with compiling [s].
    - `prepare_s`: of preparing what no variable changes [s].
    """

    scatter: Scatter
    nominal: JudgedDesign
    robust: JudgedDesign
    found: optimise.SearchResult
    method: str
    widths: np.ndarray
    began: float
    seconds: float
    prepare_s: float


def hardened(
    scatter: Scatter,
    nominal: np.ndarray,
    grid: MeshGrid,
    law: SmoothContact,
    prepared: PreparedMesh | None,
    watch: optimise.Watcher,
    file: Path | None = None,
) -> Hardened:
    """Make an optimum robust, and judge both on samples that the search has not seen.

    **Arguments:**

    - `scatter`: about the design.
    - `nominal`: the nominal optimum, from which the search starts.
    - `grid`: phases, lines and slices.
    - `law`: contact law of the search; designs are judged with exact contact.
    - `prepared`: the meshes, where the variables leave them as they are.
    - `watch`: called after each evaluation.
    - `file`: keeps the evaluations.

    **Returns:**

    Both designs.

    **Raises:**

    - `InputError` if nothing that scatters changes the objective.
    - `SolverFailure` if the contact of a gear of the samples was not solved.
    """
    scene, space = scatter.space.scene, scatter.space
    quantities = scatter.quantities
    samples, fresh = samples_of(scatter)
    moved = optimise.moved_alone(quantities)
    start = time.perf_counter()
    # One program judges all of them.
    every = members_of(scatter, np.concatenate([samples, fresh, moved]), grid, prepared)
    members = _first(every, len(samples))
    prepare_s = time.perf_counter() - start
    exact = jax.jit(lambda x, who: optimise.responses_of(judge_of(scatter, grid, _EXACT), x, who))

    def judged(point: np.ndarray) -> tuple[np.ndarray, JudgedDesign]:
        found = np.asarray(exact(jnp.asarray(point), every))
        if lost := int(np.sum(~np.isfinite(found).all(axis=1))):
            raise SolverFailure(
                f"the contact of {lost} of {len(found)} gears of the samples was not solved. Let "
                "less scatter, or narrow [optimise.bounds]"
            )
        seen, new, alone = np.split(found, np.cumsum([len(samples), len(fresh)]))
        influence = optimise.ranked(quantities, alone[:, 0])
        return seen, JudgedDesign(point, new[:, 0], new[:, 1:], float(alone[0, 0]), influence)

    seen, before = judged(np.asarray(nominal, dtype=float))
    if not (acts(before.influence)).any():
        names = ", ".join(each.name for each in quantities)
        raise InputError(
            f"[robust]: nothing that scatters changes the objective, not by its "
            f"{_NOTHING:g}th part: {names}. Let something else scatter, or remove [robust]."
        )
    widths = _widths(scene, seen)
    begin = time.perf_counter()
    both = jax.jit(optimise.measured(judge_of(scatter, grid, law), _measures(scene, widths)))
    objective = lambda point: both(point, members)
    began = float(objective(jnp.asarray(before.point))[0][0])
    method, found = _searched(space, objective, before.point, watch, file)
    seconds = time.perf_counter() - begin
    after = judged(np.asarray(found.point))[1]
    return Hardened(scatter, before, after, found, method, widths, began, seconds, prepare_s)


_EXACT = ExactContact()


def _first(members: optimise.Population, count: int) -> optimise.Population:
    cut = lambda tree: jax.tree.map(lambda leaf: leaf[:count], tree)
    return optimise.Population(cut(members.deviations), members.shared, cut(members.own))


def acts(influence: optimise.Influence) -> np.ndarray:
    """Which quantities of an influence change anything.

    **Arguments:**

    - `influence`: on one design.
    """
    span = np.maximum(
        abs(influence.low - influence.nominal), abs(influence.high - influence.nominal)
    )
    return span > _NOTHING * max(abs(influence.nominal), 1e-300)


def _widths(scene: Scene, seen: np.ndarray) -> np.ndarray:
    """Widths of the smooth quantiles, from the responses of a sample, `[gear, response]`."""
    least = np.asarray([0.0, *(_NARROWEST_OF_LIMIT * limit.most for limit in limits_of(scene))])
    least = np.maximum(least, _NARROWEST * abs(seen.mean(axis=0)))
    return np.maximum(_WIDTH * seen.std(axis=0), least)


def _measures(scene: Scene, widths: np.ndarray) -> list[optimise.AbstractMeasure]:
    if scene["robust.measure"] == "mean":
        return [optimise.Mean() for _ in widths]
    share = scene["robust.share"]
    return [optimise.Quantile(share, float(width)) for width in widths]


def _searched(
    space: DesignSpace,
    objective: Callable[[Array], tuple[Array, Array]],
    start: np.ndarray,
    watch: optimise.Watcher,
    file: Path | None,
) -> tuple[str, optimise.SearchResult]:
    """Search by the scene's method; a measure of squares is no sum of squares."""
    scene, limits = space.scene, limits_of(space.scene)
    settings: Any = dict(most_evaluations=scene["optimise.max_evaluations"], watch=watch, file=file)
    if limits:
        all_of = optimise.Sloped(objective)
        return "slsqp", optimise.constrained(all_of, limits, start, space.box, **settings)
    first = optimise.Sloped(lambda point: _first_of(*objective(point)))
    if scene["optimise.method"] == "adam":
        return "adam", optimise.adam(first, start, space.box, **settings)
    return "lbfgs", optimise.lbfgs(first, start, space.box, **settings)


def _first_of(values: Array, slopes: Array) -> tuple[Array, Array]:
    return values[0], slopes[0]


# Names and units of objectives for a reader, who sees an RMS where the objective is its square.
_SQUARED = ("te_rms", "te_harmonics", "pressure_offset")
_SHOWN = {
    "te_rms": ("RMS of the transmission error", "um"),
    "te_harmonics": ("RMS of the chosen mesh harmonics", "um"),
    "te_peak_to_peak": ("peak to peak of the transmission error", "um"),
    "max_pressure": ("largest pressure", "MPa"),
    "face_load_factor": ("face load factor", "-"),
    "pressure_offset": ("offset of the pressure from mid-face, over half the face", "-"),
}


def response_of(scene: Scene) -> tuple[str, str]:
    """Name and unit of the response that a reader sees.

    **Arguments:**

    - `scene`: with [optimise].
    """
    return _SHOWN.get(scene.get("optimise.minimise", ""), ("weighted sum", "-"))


def shown(scene: Scene, values: np.ndarray) -> np.ndarray:
    """Values of the objective as a reader sees them: the RMS for a variance.

    **Arguments:**

    - `scene`: with [optimise].
    - `values`: of its objective, in its own unit.
    """
    squared = scene.get("optimise.minimise") in _SQUARED
    return np.asarray(np.sqrt(values) if squared else values)


def measure_of(scene: Scene, values: np.ndarray) -> float:
    """The measure of [robust] of a sample of the objective, not smoothed.

    **Arguments:**

    - `scene`: with [robust].
    - `values`: of its objective.
    """
    if scene["robust.measure"] == "mean":
        return float(np.mean(values))
    return float(np.quantile(values, scene["robust.share"]))


def robust_summary(made: Hardened) -> dict[str, Any]:
    """Part of the summary: what scattered, both designs on fresh gears, and the search.

    **Arguments:**

    - `made`: from `hardened`.

    **Returns:**

    The part.
    """
    scatter, found = made.scatter, made.found
    space, scene = scatter.space, scatter.space.scene
    fewer = [measure_of(scene, each.fresh) for each in (made.nominal, made.robust)]
    return {
        "measure": scene["robust.measure"],
        "share": scene["robust.share"],
        "samples": scene["robust.samples"],
        "fresh_samples": scene["robust.fresh_samples"],
        "seed": scene["robust.seed"],
        "response": response_of(scene)[0],
        "unit": response_of(scene)[1],
        "scatter": [
            {
                "name": each.name,
                "unit": _unit(scatter, each.name),
                "standard_deviation": each.deviation,
                "half_width": np.sqrt(3.0) * each.deviation if each.even else None,
            }
            for each in scatter.quantities
        ],
        "variables": {
            key: float(value) for key, value in space.updates(jnp.asarray(found.point)).items()
        },
        "nominal": _on_fresh(scene, made.nominal),
        "robust": _on_fresh(scene, made.robust),
        "better": bool(fewer[1] < fewer[0]),
        "share_of_gears_better": float(np.mean(made.robust.fresh < made.nominal.fresh)),
        "without_effect": without_effect(made),
        "method": made.method,
        "smooth_measure": {"before": made.began, "after": found.value},
        "quantile_widths": made.widths,
        "evaluations": found.evaluations,
        "gradient_evaluations": found.gradient_evaluations,
        "converged": found.converged,
        "reason": found.reason,
        "at_bounds": space.at_bounds(found.point),
        "prepare_s": made.prepare_s,
        "seconds_with_compiling": made.seconds,
    }


def _on_fresh(scene: Scene, judged: JudgedDesign) -> dict[str, Any]:
    """One design on fresh gears, in the unit that a reader sees."""
    values, influence = shown(scene, judged.fresh), judged.influence
    limited = {
        limit.name: {
            "most": limit.most,
            "measure": measure_of(scene, column),
            "share_above": float(np.mean(column > limit.most)),
        }
        for limit, column in zip(limits_of(scene), judged.limited.T, strict=True)
    }
    return {
        "mean": float(values.mean()),
        "quantile": float(np.quantile(values, scene["robust.share"])),
        "largest": float(values.max()),
        "without_deviations": float(shown(scene, np.asarray(judged.at_means))),
        "influences": [
            {"name": name, "low": float(low), "high": float(high)}
            for name, low, high in zip(
                influence.names,
                shown(scene, influence.low),
                shown(scene, influence.high),
                strict=True,
            )
        ],
    } | ({"limits": limited} if limited else {})


# How far a tornado chart moves each quantity, as `optimise.moved_alone` does unless told.
_REACH = 2.0


def reach_of(
    made: Hardened,
) -> tuple[list[str], list[str], dict[str, tuple[float, np.ndarray, np.ndarray]]]:
    """What a tornado chart draws: names, how far each is moved, and both designs' responses.

    **Arguments:**

    - `made`: from `hardened`.

    **Returns:**

    Names and reaches, the most influential first, and under `nominal` and `robust` the response
    without deviations, and with each moved down and up.
    """
    scene = made.scatter.space.scene
    given = {each.name: each for each in made.scatter.quantities}
    ends, span = {}, dict.fromkeys(given, 0.0)
    for design, judged in (("nominal", made.nominal), ("robust", made.robust)):
        own = judged.influence
        middle = float(shown(scene, np.asarray(own.nominal)))
        low, high = shown(scene, own.low), shown(scene, own.high)
        ends[design] = middle, dict(zip(own.names, zip(low, high, strict=True), strict=True))
        for name, (less, more) in ends[design][1].items():
            span[name] = max(span[name], abs(less - middle), abs(more - middle))
    names = sorted(given, key=lambda name: -span[name])
    reach = []
    for name in names:
        each = given[name]
        far = min(_REACH, np.sqrt(3.0)) if each.even else _REACH
        unit = _unit(made.scatter, name).replace("um", "µm")
        reach.append(f"± {far * each.deviation:.3g} {unit}".rstrip())
    drawn = {
        design: (middle, *np.asarray([found[name] for name in names]).T)
        for design, (middle, found) in ends.items()
    }
    return names, reach, drawn


def _unit(scatter: Scatter, name: str) -> str:
    """Unit of what scatters: that of its key, or um of a deviation of a tolerance class."""
    return unit_of(name) if name in scatter.keys else "um"


def without_effect(made: Hardened) -> list[str]:
    """What scatters and changes the objective of neither design.

    **Arguments:**

    - `made`: from `hardened`.
    """
    acting = {
        name
        for each in (made.nominal.influence, made.robust.influence)
        for name, does in zip(each.names, acts(each), strict=True)
        if does
    }
    return [each.name for each in made.scatter.quantities if each.name not in acting]


def robust_notes(made: Hardened) -> list[str]:
    """What a user must hear of a robust optimum.

    **Arguments:**

    - `made`: from `hardened`.

    **Returns:**

    A sentence or two each.
    """
    scatter, found = made.scatter, _comparison(made)
    if idle := without_effect(made):
        found.append(f"[robust]: {', '.join(idle)} scattered without any effect on the objective.")
    if scatter.tolerated and scatter.space.scene["mesh.periods"] == 1:
        found.append(
            "[robust]: one mesh period leaves out the pitch errors of robust.accuracy_grade. Make "
            "mesh.periods 2 or more to let them scatter."
        )
    # Which variable each key follows.
    owners = scatter.space.updates(jnp.arange(float(len(scatter.space.keys))))
    for key in scatter.keys:
        same = [k for k in owners if key in owners and owners[k] == owners[key]]
        if still := [k for k in same if k not in scatter.keys]:
            found.append(
                f"[robust]: {key} scatters, {', '.join(still)} does not: what is tied is what is "
                "aimed at, not the errors of two gears. Name both to let both scatter."
            )
    if made.found.converged is False:
        words = f"The robust search did not converge: {made.found.reason}."
        found.append(Doubtful(words))
    return found


def _comparison(made: Hardened) -> list[str]:
    """That a robust optimum is not better than the nominal one on fresh gears, where it is not."""
    scene = made.scatter.space.scene
    before, after = (measure_of(scene, each.fresh) for each in (made.nominal, made.robust))
    if after < before:
        return []
    what, unit = response_of(scene)
    old, new = (float(shown(scene, np.asarray(value))) for value in (before, after))
    mean_square = scene["robust.measure"] == "mean" and scene.get("optimise.minimise") in _SQUARED
    over = "root mean square" if mean_square else scene["robust.measure"]
    numbers = (
        f"on {scene['robust.fresh_samples']} fresh gears the {over} of the {what} is {new:.4g} "
        f"{unit}, that of the nominal optimum {old:.4g} {unit}"
    )
    broken = [
        limit.name
        for limit, column in zip(limits_of(scene), made.nominal.limited.T, strict=True)
        if measure_of(scene, column) > limit.most
    ]
    if broken:
        return [f"The robust optimum pays for its limits: {numbers}, beyond {', '.join(broken)}."]
    return [
        f"THE ROBUST OPTIMUM IS NOT BETTER: {numbers}. Keep the nominal one, or raise "
        "robust.samples."
    ]
