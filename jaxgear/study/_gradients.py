"""Every derivative of a scene's responses, three ways: forward, reverse, central differences."""

import dataclasses
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._response._factors import smooth_face_load_factor
from jaxgear._response._loads import hertz_pressure
from jaxgear._response._transmission import (
    cycle_mean,
    cycle_variance,
    smooth_peak_to_peak,
    transmission_error,
)
from jaxgear._smooth import smooth_maximum
from jaxgear._solve._cycle import MeshCycle, mesh_cycle
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft
from jaxgear._system._structure import bearing_motion
from jaxgear._types import Flags, Reals, Scalar
from jaxgear._units import MPa, um
from jaxgear._whole_file import write_csv
from jaxgear.scene._build import model_of, shared_places, smooth_law_of
from jaxgear.scene._scene import Scene
from jaxgear.study._built import BuiltScene, built_scene
from jaxgear.study._derivatives import (
    AT_REST,
    IN_MOTION,
    Keys,
    judged,
    linearised,
)
from jaxgear.study._dynamics import is_too_large, size_of, speeds_of
from jaxgear.study._head import names_of, study
from jaxgear.study._pieces import pieces_at_rest, pieces_in_motion
from jaxgear.study._progress import progress
from jaxgear.study._result import Result, Summary
from jaxgear.study._running import timed
from jaxgear.study._statics import require_solved
from jaxgear.study._steady import (
    SPEED,
    TOO_MANY,
    SteadyPoint,
    builder,
    damping_keys,
    method_of,
    numbers_of,
    responder,
    steady,
    steady_names,
    steady_point,
)
from jaxgear.study._sweep_notes import steady_notes

# Of every pair; and of one on shafts the sum of squares over bearings and directions, at the mean
# mesh load.
_NAMES = (
    "te_mean_um",
    "te_variance_um2",
    "smooth_te_range_um",
    "smooth_max_pressure_MPa",
    "smooth_face_load_factor",
)
_OF_BEARINGS = ("bearing_displacement_squared_um2", "bearing_load_squared_N2")

# Widths of the smooth maxima, as the optimiser's: of the pressure [Pa], of the range of the
# transmission error [um], of the load per face width over its mean [-].
_PRESSURE_WIDTH = 5.0 * MPa
_RANGE_WIDTH = 0.02
_FACE_WIDTH = 0.01


@study
def check_gradients(scene: Scene) -> Result:
    """Compare every derivative that an optimiser may use with central differences.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    Dataset `gradients`, a row for each derivative, and the summary: a derivative that is wrong is
    counted in `check_grad.verdicts.WRONG`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    built = built_scene(scene)
    scene = built.scene
    laws = {"exact": ExactContact(), "smooth": smooth_law_of(scene.mesh)}
    moving = scene.sweep.is_given
    tables: list[xr.Dataset] = []
    points: list[SteadyPoint] = []
    with progress(len(laws) + moving, "derivatives") as done:
        for name, law in laws.items():
            tables.append(static_gradients(built, name, law))
            done(1)
        if moving:
            rows, points = steady_gradients(built, laws)
            tables += [] if rows is None else [rows]
            done(1)
    table = xr.concat(tables, "row")
    found = _summary(table, points, moving)
    columns = {str(name): table[name].values for name in table}
    return Result(
        scene,
        names_of(scene.name, scene.cite) | {"check_grad": found, "notes": steady_notes(points)},
        {"gradients": table},
        {"gradients.csv": lambda path: write_csv(columns, path)},
    )


def _summary(table: xr.Dataset, points: list[SteadyPoint], moving: bool) -> Summary:
    """Verdicts counted, and all rows."""
    verdict, error = table["verdict"].values, table["error"].values
    words = ["ok", "no effect", "shares a place", "set changes", "WRONG"]
    if moving:
        words.insert(1, IN_MOTION.words[0])
    counts = {each: int(np.sum(verdict == each)) for each in words}
    counts["WRONG"] += int(np.sum(verdict == IN_MOTION.words[1]))
    largest = lambda limits: float(np.max(error[verdict == limits.words[0]], initial=0.0))
    return {
        "verdicts": counts,
        "largest_error_ok": largest(AT_REST),
        "largest_error_ok_to_1e-5": largest(IN_MOTION),
        "dynamics": [dataclasses.asdict(each) for each in points],
        "rows": table.to_dataframe().to_dict("records"),
    }


def static_gradients(built: BuiltScene, contact: str, law: AbstractContactLaw) -> xr.Dataset:
    """Compare the derivatives of a scene's quasi-static responses by all of its real keys."""
    keys, base, grid = Keys(built.scene, built.scene.real_keys()), built.model, built.grid
    on_shafts = any(isinstance(x, Shaft) for x in (base.pinion_support, base.wheel_support))
    names = _NAMES + _OF_BEARINGS if on_shafts else _NAMES

    def responses(values: Reals) -> tuple[Reals, tuple[Reals, Flags]]:
        model = model_of(keys.moved(values))
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        found = _responses(model, cycle, law) + (_on_bearings(cycle) if on_shafts else [])
        return jnp.stack(found), (pieces_at_rest(model, cycle, law), cycle.converged)

    centre, weights = jnp.asarray(keys.centre), jnp.eye(len(names))
    value, (_, converged), columns, rows = timed(
        linearised(responses), centre, jnp.eye(len(centre)), weights, options=QUICKLY
    )
    require_solved(converged)
    found, shared = (value, columns.T, rows), shared_places(base)
    every = [contact] * len(names), names, keys.names, centre
    return judged(*every, responses, found, AT_REST, shared)


def steady_gradients(
    built: BuiltScene, laws: Mapping[str, AbstractContactLaw], only: tuple[str, ...] | None = None
) -> tuple[xr.Dataset | None, list[SteadyPoint]]:
    """Compare the derivatives of a steady response by all real keys, damping and speed.

    Harmonic balance at the middle speed of the scene, with each contact law. What is built of the
    keys, and the response of what is built, are differentiated one after the other, and chained. No
    rows of a law whose point says why there are none.
    """
    scene, speeds = built.scene, speeds_of(built.scene.sweep)
    speed = float(speeds[len(speeds) // 2])
    keys = Keys(scene, only or (*scene.real_keys(), *damping_keys(scene.damping)))
    build, centre = builder(keys, built.grid_in_motion), jnp.append(keys.centre, speed)
    numbers_at, tangents = numbers_of(build), jnp.eye(len(centre))
    shape, still = jax.eval_shape(numbers_at, centre)
    names, program = steady_names(still), linearised(numbers_at)
    # The weights follow from the response, and that from what is built: the program runs twice.
    weights = jnp.zeros((len(laws) * len(names), *shape.shape))
    numbers, dynamics, columns, _ = timed(program, centre, tangents, weights, options=QUICKLY)
    require_solved(dynamics.cycle.converged)
    if is_too_large(scene.sweep, size_of(dynamics)):
        return None, [SteadyPoint(name, speed, None, None, TOO_MANY) for name in laws]
    methods = {name: method_of(scene.sweep, dynamics, law) for name, law in laws.items()}
    each = {
        name: timed(linearised(responder(method)), numbers, columns, jnp.eye(len(names)), dynamics)
        for name, method in methods.items()
    }
    points = [steady_point(name, speed, found[1]) for name, found in each.items()]
    good = [point.contact for point in points if point.verdict == "ok"]
    if not good:
        return None, points

    def responses(values: Reals) -> tuple[Reals, tuple[Reals, Flags]]:
        model, dynamics = build(values[:-1])
        numbers, pieces = [], [pieces_at_rest(model, dynamics.cycle, ExactContact())]
        for name in good:
            own, orbit, terms, balance = steady(methods[name], dynamics, values[-1])
            numbers.append(own)
            pieces.append(pieces_in_motion(balance, orbit, terms))
        return jnp.concatenate(numbers), (jnp.concatenate(pieces), dynamics.cycle.converged)

    value, _, forward, rows = zip(*(each[name] for name in good), strict=True)
    weights = weights.at[: len(good) * len(names)].set(jnp.concatenate(rows))
    reverse = timed(program, centre, tangents, weights, options=QUICKLY)[-1]
    found = (
        np.concatenate(value),
        np.concatenate(forward, axis=1).T,
        reverse[: len(good) * len(names)],
    )
    every = [name for name in good for _ in names], names * len(good), (*keys.names, SPEED), centre
    shared = shared_places(built.model)
    return judged(*every, responses, found, IN_MOTION, shared), points


def _responses(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> list[Scalar]:
    """The responses of every pair, in the units of their names."""
    error = transmission_error(model.pair, cycle) / um
    pressure = hertz_pressure(model.pair, cycle, law)
    return [
        cycle_mean(cycle, error),
        cycle_variance(cycle, error),
        smooth_peak_to_peak(error, jnp.asarray(_RANGE_WIDTH)),
        smooth_maximum(pressure, jnp.asarray(_PRESSURE_WIDTH)) / MPa,
        smooth_face_load_factor(cycle, jnp.asarray(_FACE_WIDTH)),
    ]


def _on_bearings(cycle: MeshCycle) -> list[Scalar]:
    """The responses of the bearings, in the units of their names; translations and forces only."""
    mean = cycle.cells.lines.weight @ cycle.load
    system = cycle.system
    motion = bearing_motion(system.structure, system.displacement(mean[None])[0])
    return [
        jnp.sum((motion.displacement[:, :3] / um) ** 2),
        jnp.sum(motion.load[:, :3] ** 2),
    ]
