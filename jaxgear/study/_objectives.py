"""What [optimise] makes small and keeps below limits, and what of it cannot be had."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

import optimise
from jaxgear._dynamics._damping import ModalDamping, RayleighDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._types import Reals, Scalar
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.study._design import DesignSpace
from jaxgear.study._dynamics import damping_of, speeds_of
from jaxgear.study._evaluations import Task
from jaxgear.study._results import Entries, Entry
from jaxgear.study._running import timed
from jaxgear.study._statics import Statics


class Criterion(NamedTuple):
    """What a scene may make small, or trade: its objective, or number of responses over speeds."""

    kind: Callable[..., Any]
    unit: str
    words: str
    over_speeds: bool = False

    def made(self, asked: OptimiseKeys) -> Any:
        """The objective as [optimise] asks for it."""
        if self.kind is optimise.TransmissionErrorHarmonics:
            return self.kind(tuple(int(order) for order in (asked.harmonics or (1,))))
        if self.kind is optimise.DynamicRatio:
            return self.kind(asked.smoothing_ratio)
        return _unplaced(self.kind)


def _unplaced(kind: Callable[..., Any]) -> Any:
    """An objective with its defaults; stresses at gauges know none yet."""
    return kind(gauges=()) if kind in _OF_GAUGES else kind()


_OF_GAUGES = (optimise.GaugeStress, optimise.GaugeStressAmplitude)
_TE = "transmission error"
CRITERIA = {
    "te_rms": Criterion(optimise.TransmissionErrorRms, "um", f"RMS of the {_TE}"),
    "te_peak_to_peak": Criterion(
        optimise.TransmissionErrorRange, "um", f"peak to peak of the {_TE}"
    ),
    "te_harmonics": Criterion(
        optimise.TransmissionErrorHarmonics, "um2", f"mesh harmonics of the {_TE}"
    ),
    "max_pressure": Criterion(optimise.LargestPressure, "MPa", "largest flank pressure"),
    "max_root_stress": Criterion(
        optimise.LargestRootStress, "MPa", "largest stress of the fillets"
    ),
    "max_gauge_stress": Criterion(
        optimise.GaugeStress, "MPa", "largest principal stress at the gauges"
    ),
    "gauge_stress_amplitude": Criterion(
        optimise.GaugeStressAmplitude, "MPa", "largest stress amplitude along the gauges"
    ),
    "face_load_factor": Criterion(optimise.FaceLoadFactor, "-", "face load factor"),
    "pressure_offset": Criterion(optimise.PressureOffset, "-", "squared offset of the pressure"),
    "dynamic_ratio": Criterion(optimise.DynamicRatio, "-", "dynamic ratio", True),
    "bearing_force": Criterion(optimise.BearingForce, "N", "RMS of the bearing forces", True),
}


def over_speeds(asked: OptimiseKeys) -> list[str]:
    """What looks at the speeds: what is made small first, then what it is traded against."""
    named = [*asked.weights, asked.pareto.against]
    return [name for name in named if name in CRITERIA and CRITERIA[name].over_speeds]


def is_dynamic(asked: OptimiseKeys) -> bool:
    """Whether what is made small looks at the speeds."""
    return any(CRITERIA[name].over_speeds for name in asked.weights)


def objective_unit(asked: OptimiseKeys) -> str:
    """The unit of what `objective_of` makes small."""
    if asked.alone is None:
        return "weighted"
    return "um2" if asked.alone == "te_rms" else CRITERIA[asked.alone].unit


def objective_of(space: DesignSpace, grid: MeshGrid) -> optimise.AbstractObjective:
    """The objective that a scene asks for, its value in `objective_unit`."""
    # Alone without the cone of an RMS.
    is_rms = space.scene.optimise.alone == "te_rms"
    return optimise.TransmissionErrorVariance() if is_rms else _minimised(space, grid)


def _minimised(space: DesignSpace, grid: MeshGrid) -> optimise.AbstractObjective:
    """What is made small; the RMS of the transmission error is itself here, not its square."""
    asked = space.scene.optimise
    parts = tuple(_named(space, name, grid) for name in asked.weights)
    if asked.alone is not None:
        return parts[0]
    return optimise.WeightedSum(parts=parts, weights=list(asked.weights.values()))


def _named(space: DesignSpace, name: str, grid: MeshGrid) -> optimise.AbstractObjective:
    """An objective by its name."""
    if CRITERIA[name].over_speeds:
        return _at_speeds(space, name, grid)
    return _with_teeth(space, CRITERIA[name].made(space.scene.optimise))


def _with_teeth(space: DesignSpace, objective: Any) -> Any:
    """A largest root stress with the teeth of its space, stress at gauges with these."""
    if isinstance(objective, _OF_GAUGES):
        return dataclasses.replace(objective, gauges=space.gauges)
    if not isinstance(objective, optimise.LargestRootStress):
        return objective
    return dataclasses.replace(objective, influences=space.influences)


def in_unit(name: str, dims: tuple[str, ...], values: ArrayLike, unit: str, words: str) -> Entries:
    """A variable of a dataset whose unit ends its name; `-` stands for none."""
    if unit == "-":
        return {name: Entry(dims, values, "1", words)}
    return {f"{name}_{unit}": Entry(dims, values, unit, words)}


def traded(asked: OptimiseKeys) -> Mapping[str, Criterion]:
    """What is minimised, and what it is traded against, under the names of columns."""
    known = CRITERIA | {"weighted": Criterion(optimise.WeightedSum, "-", "weighted objective")}
    return {name: known[name] for name in (asked.alone or "weighted", asked.pareto.against or "")}


def _sharpened(objective: Any) -> Any:
    """The same objective with its smoothing taken away, for a re-check."""
    match objective:
        case optimise.WeightedSum():
            parts = tuple(_sharpened(part) for part in objective.parts)
            return dataclasses.replace(objective, parts=parts)
        case optimise.OverSpeeds():
            return dataclasses.replace(objective, response=_sharpened(objective.response))
    if not hasattr(objective, "width"):
        return objective
    return dataclasses.replace(objective, width=_SHARP * objective.width)


# Of a smoothing width, for numbers that are told.
_SHARP = 1e-3

# Responses that may have limits, with the unit in the key.
_LIMITED = {
    "max_pressure_MPa": optimise.LargestPressure,
    "max_root_stress_MPa": optimise.LargestRootStress,
    "max_gauge_stress_MPa": optimise.GaugeStress,
    "gauge_stress_amplitude_MPa": optimise.GaugeStressAmplitude,
    "te_peak_to_peak_um": optimise.TransmissionErrorRange,
    "face_load_factor": optimise.FaceLoadFactor,
    "edge_line_load_N_mm": optimise.EdgeLoad,
}


def limits_of(asked: OptimiseKeys) -> tuple[optimise.Limit, ...]:
    """What [optimise.limits] allows, scaled by a tenth of itself, in the order of the keys."""
    given = {name: getattr(asked.limits, name) for name in _LIMITED}
    return tuple(
        optimise.Limit(name, float(most), 0.1 * float(most))
        for name, most in given.items()
        if most is not None
    )


def limits_objectives(
    space: DesignSpace, law: AbstractContactLaw
) -> list[optimise.AbstractObjective]:
    """The responses of `limits_of`; with exact contact, which is for a re-check, not smoothed."""
    limits = limits_of(space.scene.optimise)
    found = [_with_teeth(space, _unplaced(_LIMITED[limit.name])) for limit in limits]
    return [_sharpened(each) for each in found] if isinstance(law, ExactContact) else found


def _at_speeds(space: DesignSpace, name: str, grid: MeshGrid) -> optimise.OverSpeeds:
    """A number of the responses over the speeds of [sweep]."""
    scene = space.scene
    asked, steps, damping = scene.sweep, scene.sweep.steps, damping_of(scene.damping)
    assert isinstance(damping, ModalDamping | RayleighDamping)
    # With its margins, and the same share of the steps after a pair's entry.
    entry, fewest = round(grid.entry_phases * steps / grid.phases), steps // 8
    entry = min(max(entry, fewest), steps - fewest)
    return optimise.OverSpeeds(
        response=CRITERIA[name].made(scene.optimise),
        speeds=jnp.asarray(speeds_of(asked)),
        grid=dataclasses.replace(grid, phases=steps, entry_phases=entry),
        damping=damping,
        method=HarmonicBalance(harmonics=asked.harmonics, averaged=True),
        power=np.inf if scene.optimise.over_speeds == "worst" else 1.0,
        gyroscopic=scene.model.gyroscopic,
        active_mesh_damping=scene.damping.active_mesh,
    )


JudgedSpeeds = list[tuple[float, optimise.SpeedResults]]


def judged_speeds(
    space: DesignSpace, grid: MeshGrid, law: AbstractContactLaw
) -> Callable[[np.ndarray], JudgedSpeeds]:
    """What each speed contributes to the objective, or to what it is traded against.

    A function of the variables: for each torque [N m] the numbers, and which of them count, for the
    user must hear of those that do not; none without speeds.
    """
    if not (names := over_speeds(space.scene.optimise)):
        return lambda values: []
    # Which speeds count does not depend on what is read from their responses.
    objective = _at_speeds(space, names[0], grid)

    @jax.jit
    def judge(values: Reals, torque: Scalar) -> optimise.SpeedResults:
        model = eqx.tree_at(lambda m: m.torque, space.model(values), torque)
        return objective.judged(model, law)

    return lambda values: [
        (torque, judge(jnp.asarray(values), jnp.asarray(torque)))
        for torque in space.torques.tolist()
    ]


def prepared_mesh(
    space: DesignSpace, grid: MeshGrid, statics: Statics | None = None
) -> PreparedMesh | None:
    """The meshes at the scene's torques, stacked, if the variables leave them as they are.

    The mesh of the scene's own statics may be the one that is wanted.
    """
    if not space.flanks_only:
        return None
    torques, own = space.torques, None if statics is None else statics.prepared
    if statics is not None and own is not None and statics.grid == grid:
        if torques.tolist() == [float(statics.model.torque)]:
            return jax.tree.map(lambda x: np.asarray(x)[None], own)
    return timed(optimise.prepare_torques, space.base, torques, grid, options=QUICKLY)


def task_of(
    space: DesignSpace,
    grid: MeshGrid,
    law: AbstractContactLaw,
    prepared: PreparedMesh | None,
    *,
    trading: bool = False,
) -> Task:
    """What a scene asks to be made small, over all its torques; limits are not smoothed if exact.

    Where it is traded against another number, that one comes before the limits; with exact contact
    both are not smoothed either, and limits are left out.
    """
    asked, limited = space.scene.optimise, limits_objectives(space, law)
    if trading:
        objective = _minimised(space, grid)
        limited.insert(0, _named(space, asked.pareto.against or "", grid))
        if isinstance(law, ExactContact):
            objective, limited = _sharpened(objective), [_sharpened(limited[0])]
    else:
        objective = objective_of(space, grid)
    return Task(
        variation=space.variation,
        keys=space.moved,
        objective=objective,
        limited=tuple(limited),
        torques=space.torques,
        grid=grid,
        prepared=prepared,
        worst=asked.over == "worst",
        batched=not (over_speeds(asked) if trading else is_dynamic(asked)),
    )
