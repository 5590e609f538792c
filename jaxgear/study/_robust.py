"""What [robust] asks for: an optimum for gears as they are made, and how it was judged.

The sample is drawn once. What scatters without a variable's say, such as the torque's stiffness of
the teeth, is prepared once for each gear of it; a search then solves contact alone.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._solve._cycle import PreparedMesh, corrected_cycle, prepare_mesh
from jaxgear._types import Reals, Scalar
from jaxgear.scene._study_tables import RobustKeys
from jaxgear.study._objectives import limits_objectives, limits_of, objective_of
from jaxgear.study._progress import progress
from jaxgear.study._scatter import Scatter, samples_of
from jaxgear.study._search import method_of
from jaxgear.study._statics import SolverFailure


def judge_of(
    scatter: Scatter, grid: MeshGrid, law: AbstractContactLaw
) -> Callable[[Reals, Reals, PreparedMesh | None], Reals]:
    """The objective and the responses that have limits, of one gear of a sample.

    A function of the variables, the deviations, and the prepared meshes or `None`, over all torques
    of the scene; NaN where a cycle was not solved.
    """
    scene = scatter.space.scene
    torques = jnp.asarray(scatter.space.torques)
    space = scatter.with_teeth()
    parts = objective_of(space, grid), *limits_objectives(space, law)
    worst = scene.optimise.over == "worst"

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
    """The gears of a sample `[gear, quantity]`, with all that no variable changes.

    The prepared meshes are those of the nominal gears, where the variables leave them as they are.
    """
    space = scatter.space
    nothing = jax.tree.map(lambda leaf: None, prepared)
    if scatter.same_mesh or not space.flanks_only:
        # Either all have one mesh, or each evaluation prepares its own.
        return optimise.Population(jnp.asarray(samples), prepared, nothing)
    torques = jnp.asarray(space.torques)
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

    The objective in each gear of the fresh sample, the responses that have limits `[gear, limit]`,
    and the objective of the gear without deviations, each in its own unit.
    """

    point: np.ndarray
    fresh: np.ndarray
    limited: np.ndarray
    at_means: float
    influence: optimise.Influence


class Hardened(NamedTuple):
    """Nominal and robust optimum, judged alike, and the search that made the robust one.

    The widths are those of the smooth quantiles of the objective and of each limited response; the
    search began at this smooth measure of the nominal optimum. Seconds are with compiling; what no
    variable changes was prepared before.
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
    file: Path | None = None,
) -> Hardened:
    """Make an optimum robust with smooth contact; judge both exactly on gears it has not seen."""
    scene, space = scatter.space.scene, scatter.space
    quantities = scatter.quantities
    samples, fresh = samples_of(scatter)
    moved = optimise.one_at_a_time_sample(quantities)
    start = time.perf_counter()
    # One program judges all of them.
    every = members_of(scatter, np.concatenate([samples, fresh, moved]), grid, prepared)
    cut = lambda tree: jax.tree.map(lambda leaf: leaf[: len(samples)], tree)
    members = optimise.Population(cut(every.deviations), every.shared, cut(every.own))
    prepare_s = time.perf_counter() - start
    exact = jax.jit(
        lambda x, who: optimise.responses_of(judge_of(scatter, grid, ExactContact()), x, who)
    )

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
    widths = _widths(limits_of(scene.optimise), seen)
    begin = time.perf_counter()
    measures = _measures(scene.robust, widths)
    both = jax.jit(optimise.population_statistics(judge_of(scatter, grid, law), measures))
    objective = lambda point: both(point, members)
    began = float(objective(jnp.asarray(before.point))[0][0])
    most, limits = scene.optimise.max_evaluations, limits_of(scene.optimise)
    # A measure of squares is no sum of squares.
    asked = "adam" if scene.optimise.method == "adam" else "lbfgs"
    method, search = method_of(asked, limits)
    first = lambda point: tuple(each[0] for each in objective(point))
    with progress(most, "robust search") as done:
        found = search(
            optimise.ValueAndGradient(objective if limits else first),
            before.point,
            space.box,
            most_evaluations=most,
            watch=lambda point, value: done(1),
            file=file,
        )
    seconds = time.perf_counter() - begin
    after = judged(np.asarray(found.point))[1]
    return Hardened(scatter, before, after, found, method, widths, began, seconds, prepare_s)


def acts(influence: optimise.Influence) -> np.ndarray:
    """Which quantities of an influence change anything."""
    span = np.maximum(
        np.abs(influence.low - influence.nominal), np.abs(influence.high - influence.nominal)
    )
    return span > _NOTHING * max(abs(influence.nominal), 1e-300)


def _widths(limits: tuple[optimise.Limit, ...], seen: np.ndarray) -> np.ndarray:
    """Widths of the smooth quantiles, from the responses of a sample, `[gear, response]`."""
    least = np.asarray([0.0, *(_NARROWEST_OF_LIMIT * limit.most for limit in limits)])
    least = np.maximum(least, _NARROWEST * abs(seen.mean(axis=0)))
    return np.maximum(_WIDTH * seen.std(axis=0), least)


def _measures(asked: RobustKeys, widths: np.ndarray) -> list[optimise.AbstractMeasure]:
    if asked.measure == "mean":
        return [optimise.Mean() for _ in widths]
    return [optimise.Quantile(asked.share, float(width)) for width in widths]
