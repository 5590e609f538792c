"""What [optimise] makes small and keeps below limits, and what of it cannot be had."""

import dataclasses
from collections.abc import Callable
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
from jaxgear._response._root_stress import root_influences
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._types import Reals, Scalar
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import Scene
from jaxgear.study._design import DesignSpace
from jaxgear.study._dynamics import damping_of, speeds_of
from jaxgear.study._evaluations import Task
from jaxgear.study._results import Entry
from jaxgear.study._running import timed
from jaxgear.study._statics import Statics, torques_of


class Criterion(NamedTuple):
    """What a scene may make small, or trade.

    **Fields:**

    - `make`: the objective, or of those over speeds the number of a response.
    - `unit`: of its value.
    - `words`: what it is.
    - `over_speeds`: whether it looks at the speeds of [sweep].
    """

    make: Callable[[Scene], Any]
    unit: str
    words: str
    over_speeds: bool = False


# Width of the smooth maximum of the dynamic ratio, in static mesh forces.
_RATIO_WIDTH = 0.02

CRITERIA = {
    "te_rms": Criterion(
        lambda scene: optimise.TransmissionErrorRms(), "um", "RMS of the transmission error"
    ),
    "te_peak_to_peak": Criterion(
        lambda scene: optimise.TransmissionErrorRange(),
        "um",
        "peak to peak of the transmission error",
    ),
    "te_harmonics": Criterion(
        lambda scene: optimise.TransmissionErrorHarmonics(
            tuple(int(order) for order in scene.get("optimise.harmonics", (1,)))
        ),
        "um2",
        "mesh harmonics of the transmission error",
    ),
    "max_pressure": Criterion(
        lambda scene: optimise.LargestPressure(), "MPa", "largest flank pressure"
    ),
    "max_root_stress": Criterion(
        lambda scene: _root_stress(scene), "MPa", "largest stress of the fillets"
    ),
    "face_load_factor": Criterion(lambda scene: optimise.FaceLoadFactor(), "-", "face load factor"),
    "pressure_offset": Criterion(
        lambda scene: optimise.PressureOffset(), "-", "squared offset of the pressure"
    ),
    "dynamic_ratio": Criterion(
        lambda scene: optimise.DynamicRatio(scene.get("optimise.smoothing_ratio", _RATIO_WIDTH)),
        "-",
        "dynamic ratio",
        over_speeds=True,
    ),
    "bearing_force": Criterion(
        lambda scene: optimise.BearingForce(), "N", "RMS of the bearing forces", over_speeds=True
    ),
}
AGAINST = "optimise.pareto.against"


def _root_stress(scene: Scene) -> optimise.LargestRootStress:
    """Largest root stress; teeth that no variable changes are solved once, not in each cycle."""
    tied = "optimise.ties."
    followers = [key.removeprefix(tied) for key in scene.values if key.startswith(tied)]
    varied = (*scene["optimise.vary"], *followers)
    if not all(key.startswith("flank.") for key in varied):
        return optimise.LargestRootStress()
    return optimise.LargestRootStress(influences=root_influences(model_of(scene).pair))


def minimised(scene: Scene) -> dict[str, float | None]:
    """What is to be made small, by name: its weight, or `None` where it is one thing alone."""
    if "optimise.minimise" in scene.values:
        return {scene["optimise.minimise"]: None}
    given = {name: scene.get(f"optimise.minimise.{name}") for name in CRITERIA}
    return {name: weight for name, weight in given.items() if weight is not None}


def over_speeds(scene: Scene) -> list[str]:
    """What looks at the speeds: what is made small first, then what it is traded against."""
    named = [*minimised(scene), scene.get(AGAINST)]
    return [name for name in named if name in CRITERIA and CRITERIA[name].over_speeds]


def is_dynamic(scene: Scene) -> bool:
    """Whether the objective of a scene looks at its speeds."""
    return any(CRITERIA[name].over_speeds for name in minimised(scene))


def looks_at_speeds(scene: Scene) -> bool:
    """Whether the objective of a scene, or what it is traded against, looks at its speeds."""
    return bool(over_speeds(scene))


def objective_unit(scene: Scene) -> str:
    """The unit of what `objective_of` makes small."""
    (name, weight), *_ = minimised(scene).items()
    if weight is not None:
        return "weighted"
    return "um2" if name == "te_rms" else CRITERIA[name].unit


def objective_of(scene: Scene, grid: MeshGrid) -> optimise.AbstractObjective:
    """The objective that a scene asks for.

    **Arguments:**

    - `scene`: with `optimise.minimise`, a name or a table of weights.
    - `grid`: of the quasi-static cycles.

    **Returns:**

    The objective, its value in `objective_unit`.
    """
    named = minimised(scene)
    (first, weight), *_ = named.items()
    if weight is not None:
        parts = tuple(_named(scene, name, grid) for name in named)
        return optimise.WeightedSum(parts=parts, weights=list(named.values()))
    # Alone without the cone of an RMS.
    return optimise.TransmissionErrorVariance() if first == "te_rms" else _named(scene, first, grid)


def _named(scene: Scene, name: str, grid: MeshGrid) -> optimise.AbstractObjective:
    """An objective by its name."""
    criterion = CRITERIA[name]
    return _at_speeds(scene, name, grid) if criterion.over_speeds else criterion.make(scene)


def with_unit(name: str, unit: str) -> str:
    """The name of a variable, with its unit; `-` stands for none."""
    return name if unit == "-" else f"{name}_{unit}"


def entry(dims: tuple[str, ...], values: ArrayLike, unit: str, words: str) -> Entry:
    """A variable of a dataset; `-` stands for no unit."""
    return Entry(dims, values, "1" if unit == "-" else unit, words)


def traded_objectives(scene: Scene, grid: MeshGrid) -> tuple[optimise.AbstractObjective, ...]:
    """What is minimised, and what it is traded against, in the units of `traded`.

    The RMS of the transmission error is itself here, not its square.
    """
    (first, weight), *_ = minimised(scene).items()
    own = _named(scene, first, grid) if weight is None else objective_of(scene, grid)
    return own, _named(scene, scene[AGAINST], grid)


def traded(scene: Scene) -> dict[str, Criterion]:
    """What `traded_objectives` are, under the names of columns."""
    (first, weight), *_ = minimised(scene).items()
    names = [first if weight is None else "weighted", scene[AGAINST]]
    return {name: _WEIGHTED if name == "weighted" else CRITERIA[name] for name in names}


_WEIGHTED = Criterion(lambda scene: None, "-", "weighted objective")


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
    "max_pressure_MPa": lambda scene: optimise.LargestPressure(),
    "max_root_stress_MPa": lambda scene: _root_stress(scene),
    "te_peak_to_peak_um": lambda scene: optimise.TransmissionErrorRange(),
    "face_load_factor": lambda scene: optimise.FaceLoadFactor(),
    "edge_line_load_N_mm": lambda scene: optimise.EdgeLoad(),
}


def limits_of(scene: Scene) -> tuple[optimise.Limit, ...]:
    """What [optimise.limits] allows, scaled by a tenth of itself, in the order of the keys."""
    given = {name: scene.get(f"optimise.limits.{name}") for name in _LIMITED}
    return tuple(
        optimise.Limit(name, float(most), 0.1 * float(most))
        for name, most in given.items()
        if most is not None
    )


def limits_objectives(scene: Scene, law: AbstractContactLaw) -> list[optimise.AbstractObjective]:
    """The responses of `limits_of`; with exact contact, which is for a re-check, not smoothed."""
    found = [_LIMITED[limit.name](scene) for limit in limits_of(scene)]
    return [_sharpened(each) for each in found] if isinstance(law, ExactContact) else found


def _at_speeds(scene: Scene, name: str, grid: MeshGrid) -> optimise.OverSpeeds:
    """A number of the responses over the speeds of [sweep]."""
    steps = scene["sweep.steps"]
    # With its margins, and the same share of the steps after a pair's entry.
    entry, fewest = round(grid.entry_phases * steps / grid.phases), steps // 8
    grid = dataclasses.replace(
        grid, phases=steps, entry_phases=min(max(entry, fewest), steps - fewest)
    )
    worst = scene.get("optimise.over_speeds", "mean") == "worst"
    damping = damping_of(scene)
    assert isinstance(damping, ModalDamping | RayleighDamping)
    return optimise.OverSpeeds(
        response=CRITERIA[name].make(scene),
        speeds=jnp.asarray(speeds_of(scene)),
        grid=grid,
        damping=damping,
        method=HarmonicBalance(harmonics=scene["sweep.harmonics"], averaged=True),
        power=np.inf if worst else 1.0,
        gyroscopic=scene["model.gyroscopic"],
        active_mesh_damping=scene["damping.active_mesh"],
    )


JudgedSpeeds = list[tuple[float, optimise.Judged]]


def judged_speeds(
    space: DesignSpace, grid: MeshGrid, law: AbstractContactLaw
) -> Callable[[np.ndarray], JudgedSpeeds]:
    """What each speed contributes to the objective, or to what it is traded against.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `law`: contact law.

    **Returns:**

    A function of the variables, in the units of their keys: for each torque [N m] the numbers, and
    which of them count, for the user must hear of those that do not; none without speeds.
    """
    if not (names := over_speeds(space.scene)):
        return lambda values: []
    # Which speeds count does not depend on what is read from their responses.
    objective = _at_speeds(space.scene, names[0], grid)

    @jax.jit
    def judge(values: Reals, torque: Scalar) -> optimise.Judged:
        model = eqx.tree_at(lambda m: m.torque, space.model(values), torque)
        return objective.judged(model, law)

    torques = [float(torque) for torque in torques_of(space.scene, "optimise.torques_Nm")]
    return lambda values: [(t, judge(jnp.asarray(values), jnp.asarray(t))) for t in torques]


def prepared_mesh(
    space: DesignSpace, grid: MeshGrid, statics: Statics | None = None
) -> PreparedMesh | None:
    """The meshes at the scene's torques, stacked, if the variables leave them as they are.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `statics`: of the scene itself, whose mesh may be the one that is wanted.
    """
    if not space.flanks_only:
        return None
    torques = torques_of(space.scene, "optimise.torques_Nm")
    if (
        statics is not None
        and statics.prepared is not None
        and statics.grid == grid
        and list(torques) == [float(statics.model.torque)]
    ):
        return jax.tree.map(lambda x: np.asarray(x)[None], statics.prepared)
    return timed(optimise.prepare_torques, space.base, torques, grid, options=QUICKLY)


def task_of(
    space: DesignSpace,
    grid: MeshGrid,
    law: AbstractContactLaw,
    prepared: PreparedMesh | None,
    *,
    trading: bool = False,
) -> Task:
    """What a scene asks to be made small, over all its torques.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `law`: contact law; with exact contact, which is for a re-check, limits are not smoothed.
    - `prepared`: the meshes, where the variables leave them as they are.
    - `trading`: whether it is traded against another number, which then comes before the limits;
        with exact contact both are not smoothed either, and limits are left out.

    **Returns:**

    The task.
    """
    scene = space.scene
    objectives = [objective_of(scene, grid), *limits_objectives(scene, law)]
    if trading:
        both = traded_objectives(scene, grid)
        exact = isinstance(law, ExactContact)
        objectives = [*map(_sharpened, both)] if exact else [*both, *objectives[1:]]
    return Task(
        variation=space.variation,
        keys=space.moved,
        objective=objectives[0],
        limited=tuple(objectives[1:]),
        torques=torques_of(scene, "optimise.torques_Nm"),
        grid=grid,
        prepared=prepared,
        worst=scene["optimise.over"] == "worst",
        batched=not (looks_at_speeds(scene) if trading else is_dynamic(scene)),
    )
