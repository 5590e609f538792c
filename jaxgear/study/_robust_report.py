"""What is said of a robust optimum: its numbers on fresh gears, what spreads them, and remarks."""

import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear.scene._schema import unit_of
from jaxgear.scene._study_tables import OptimiseKeys, RobustKeys
from jaxgear.study._objectives import in_unit, limits_of
from jaxgear.study._ranks import Doubtful
from jaxgear.study._result import Datasets, Summary, titled
from jaxgear.study._results import dataset_of, over
from jaxgear.study._robust import Hardened, JudgedDesign, acts
from jaxgear.study._scatter import Scatter

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
# How far a tornado chart moves each quantity, as `optimise.one_at_a_time_sample` does unless told.
_REACH = 2.0
_DESIGNS = ("nominal", "robust")


def _response_of(asked: OptimiseKeys) -> tuple[str, str]:
    """Name and unit of the response that a reader sees."""
    return _SHOWN.get(asked.alone or "", ("weighted sum", "-"))


def _shown(asked: OptimiseKeys, values: np.ndarray | float) -> np.ndarray:
    """Values of the objective as a reader sees them: the RMS for a variance."""
    return np.asarray(np.sqrt(values) if asked.alone in _SQUARED else values)


def _measure_of(asked: RobustKeys, values: np.ndarray) -> float:
    """The measure of [robust] of a sample, not smoothed, in the unit of its values."""
    if asked.measure == "mean":
        return float(np.mean(values))
    return float(np.quantile(values, asked.share))


def robust_summary(made: Hardened) -> Summary:
    """Part of the summary: what scattered, both designs on fresh gears, and the search."""
    scatter, found = made.scatter, made.found
    space, scene = scatter.space, scatter.space.scene
    before, after = (_measure_of(scene.robust, each.fresh) for each in (made.nominal, made.robust))
    response, unit = _response_of(scene.optimise)
    return {
        "measure": scene.robust.measure,
        "share": scene.robust.share,
        "samples": scene.robust.samples,
        "fresh_samples": scene.robust.fresh_samples,
        "seed": scene.robust.seed,
        "response": response,
        "unit": unit,
        "scatter": [
            {
                "name": each.name,
                "unit": _unit(scatter, each.name),
                "standard_deviation": each.deviation,
                "half_width": np.sqrt(3.0) * each.deviation if each.even else None,
            }
            for each in scatter.quantities
        ],
        "variables": space.numbers(found.point),
        "nominal": _on_fresh(scene.optimise, scene.robust, made.nominal),
        "robust": _on_fresh(scene.optimise, scene.robust, made.robust),
        "better": after < before,
        "share_of_gears_better": float(np.mean(made.robust.fresh < made.nominal.fresh)),
        "without_effect": _without_effect(made),
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


def _on_fresh(asked: OptimiseKeys, robust: RobustKeys, judged: JudgedDesign) -> Summary:
    """One design on fresh gears, in the unit that a reader sees."""
    values, own = _shown(asked, judged.fresh), judged.influence
    ends = own.names, _shown(asked, own.low), _shown(asked, own.high)
    found: Summary = {
        "mean": float(values.mean()),
        "quantile": float(np.quantile(values, robust.share)),
        "largest": float(values.max()),
        "without_deviations": float(_shown(asked, judged.at_means)),
        "influences": [
            {"name": name, "low": float(low), "high": float(high)}
            for name, low, high in zip(*ends, strict=True)
        ],
    }
    if limits := limits_of(asked):
        found["limits"] = {
            limit.name: {
                "most": limit.most,
                "measure": _measure_of(robust, column),
                "share_above": float(np.mean(column > limit.most)),
            }
            for limit, column in zip(limits, judged.limited.T, strict=True)
        }
    return found


def robust_datasets(made: Hardened) -> Datasets:
    """Groups `robust_gears`, both designs in each fresh gear, and `robust_influences`."""
    scene, both = made.scatter.space.scene, (made.nominal, made.robust)
    response, unit = _response_of(scene.optimise)
    told = lambda name, dims, values: in_unit(name, dims, values, unit, response)
    designs = over("design", design=(list(_DESIGNS), "design"))
    values = np.stack([_shown(scene.optimise, each.fresh) for each in both])
    gears = dataset_of(told("response", ("design", "gear"), values), **designs).assign_attrs(
        share=scene.robust.share
    )
    given = {each.name: each for each in made.scatter.quantities}
    middle = np.stack([_shown(scene.optimise, each.influence.nominal) for each in both])
    ends = np.stack([_ends(scene.optimise, each.influence, list(given)) for each in both])
    order = np.argsort(-np.max(np.abs(ends - middle[:, None, None]), axis=(0, 1)), kind="stable")
    names = [list(given)[place] for place in order]
    dims = ("design", "quantity")
    moved = [_moved(made.scatter, given[name]) for name in names]
    bars = dataset_of(
        over("quantity", moved=(moved, "how far a quantity is moved either way"))
        | told("less", dims, ends[:, 0, order])
        | told("without_deviations", ("design",), middle)
        | told("more", dims, ends[:, 1, order]),
        **designs,
        **over("quantity", quantity=(names, "what scatters")),
    )
    count = f", {scene.robust.fresh_samples} gears"
    return {
        "robust_gears": titled(gears, scene.title + count),
        "robust_influences": titled(bars, scene.title),
    }


def _ends(asked: OptimiseKeys, influence: optimise.Influence, names: list[str]) -> np.ndarray:
    """The response with each quantity down, and up, in the order of the names."""
    at = [influence.names.index(name) for name in names]
    return np.stack([_shown(asked, end)[at] for end in (influence.low, influence.high)])


def _moved(scatter: Scatter, quantity: optimise.Quantity) -> str:
    """How far a tornado chart moves a quantity, in words."""
    far = min(_REACH, np.sqrt(3.0)) if quantity.even else _REACH
    unit = _unit(scatter, quantity.name).replace("um", "µm")
    return f"± {far * quantity.deviation:.3g} {unit}".rstrip()


def _unit(scatter: Scatter, name: str) -> str:
    """Unit of what scatters: that of its key, or um of a deviation of a tolerance class."""
    return unit_of(name) if name in scatter.keys else "um"


def _without_effect(made: Hardened) -> list[str]:
    """What scatters and changes the objective of neither design."""
    acting = {
        name
        for each in (made.nominal.influence, made.robust.influence)
        for name, does in zip(each.names, acts(each), strict=True)
        if does
    }
    return [each.name for each in made.scatter.quantities if each.name not in acting]


def robust_notes(made: Hardened) -> list[str]:
    """What a user must hear of a robust optimum."""
    scatter, found = made.scatter, _comparison(made)
    if idle := _without_effect(made):
        found.append(f"[robust]: {', '.join(idle)} scattered without any effect on the objective.")
    if scatter.tolerated and scatter.space.scene.mesh.periods == 1:
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
    before, after = (_measure_of(scene.robust, each.fresh) for each in (made.nominal, made.robust))
    if after < before:
        return []
    what, unit = _response_of(scene.optimise)
    old, new = (float(_shown(scene.optimise, np.asarray(value))) for value in (before, after))
    mean_square = scene.robust.measure == "mean" and scene.optimise.alone in _SQUARED
    over = "root mean square" if mean_square else scene.robust.measure
    numbers = (
        f"on {scene.robust.fresh_samples} fresh gears the {over} of the {what} is {new:.4g} "
        f"{unit}, that of the nominal optimum {old:.4g} {unit}"
    )
    broken = [
        limit.name
        for limit, column in zip(limits_of(scene.optimise), made.nominal.limited.T, strict=True)
        if _measure_of(scene.robust, column) > limit.most
    ]
    if broken:
        return [f"The robust optimum pays for its limits: {numbers}, beyond {', '.join(broken)}."]
    return [
        f"THE ROBUST OPTIMUM IS NOT BETTER: {numbers}. Keep the nominal one, or raise "
        "robust.samples."
    ]
