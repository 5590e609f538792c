"""What [sizing] asks for: every combination of the listed amounts, at every torque, ranked.

Contact is exact. What the amounts leave alone, stiffness and structure, is computed once for each
torque.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import ExactContact
from jaxgear._response._factors import face_load_factor
from jaxgear._response._loads import hertz_pressure
from jaxgear._response._transmission import (
    cycle_mean,
    cycle_rms,
    peak_to_peak,
    transmission_error,
)
from jaxgear._solve._cycle import PreparedMesh, corrected_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Reals
from jaxgear._units import MPa, um
from jaxgear.scene._build import flanks_of, model_of
from jaxgear.scene._scene import Scene
from jaxgear.study._design import refuse_twins, twin
from jaxgear.study._running import timed
from jaxgear.study._statics import SolverFailure, torques_of

RESPONSES = (
    "te_peak_to_peak_um",
    "te_rms_um",
    "te_mean_um",
    "max_pressure_MPa",
    "face_load_factor",
)

_AMOUNTS = "sizing.amounts."
_MOST = 100_000
_TOP = 10
# Combinations in one call of the compiled program, and those solved side by side within it.
_CHUNK, _BATCH = 64, 8
# Ranges of the transmission error closer than this are equal, and the pressure decides [um].
_EQUAL = 1e-3


@dataclasses.dataclass(frozen=True)
class SizingTable:
    """Every combination of amounts, from the best to the worst.

    The first is the one whose largest peak-to-peak of the transmission error over the torques is
    least; where two are the same to the nanometre the largest pressure decides. Combinations that
    were not solved are last, with NaN.

    **Fields:**

    - `keys`: dotted path of each amount, with its unit.
    - `torques`: on the pinion [N m].
    - `amounts`: rows combinations, columns keys, in the units of the keys.
    - `responses`: under the names of `RESPONSES`, rows combinations, columns torques, in the unit
        of the name.
    - `pressure_rank`: of each combination, by its largest pressure over the torques; from 1.
    """

    keys: tuple[str, ...]
    torques: np.ndarray
    amounts: np.ndarray
    responses: dict[str, np.ndarray]
    pressure_rank: np.ndarray

    def worst(self, response: str) -> np.ndarray:
        """Largest value over the torques, for each combination.

        **Arguments:**

        - `response`: one of `RESPONSES`.
        """
        return np.max(self.responses[response], axis=1)


def combinations_of(scene: Scene) -> tuple[tuple[str, ...], np.ndarray]:
    """The amounts that a scene lists, each once and in rising order, in all combinations.

    **Arguments:**

    - `scene`: with a table [sizing].

    **Returns:**

    The keys, and one row of their values for each combination, in the units of the keys.

    **Raises:**

    - `InputError` if there are no amounts, too many combinations, or both of two keys that are
        to be the same.
    """
    keys = tuple(key.removeprefix(_AMOUNTS) for key in scene.values if key.startswith(_AMOUNTS))
    if not keys:
        raise InputError(
            "[sizing] names no amounts. Add, for example, "
            '"flank.pinion.tip_relief.depth_um" = [0.0, 5.0, 10.0] to a table [sizing.amounts].'
        )
    if scene["sizing.symmetric"]:
        refuse_twins("sizing", keys)
    lists = [sorted(set(scene[f"{_AMOUNTS}{key}"])) for key in keys]
    count = math.prod(map(len, lists))
    if count > _MOST:
        sizes = " x ".join(str(len(values)) for values in lists)
        raise InputError(
            f"[sizing.amounts] has {sizes} = {count} combinations, more than {_MOST}. List fewer "
            "amounts, or keep some keys fixed; `jaxgear optimise` finds the best of many in far "
            "fewer evaluations."
        )
    return keys, np.asarray(list(itertools.product(*lists)))


def sizing_table(scene: Scene, grid: MeshGrid, done: Callable[[int], None]) -> SizingTable:
    """Evaluate every combination at every torque.

    **Arguments:**

    - `scene`: with a table [sizing].
    - `grid`: phases, lines and slices.
    - `done`: told how many more combinations are finished.

    **Returns:**

    The table.

    **Raises:**

    - `InputError` as `combinations_of`.
    - `SolverFailure` if no combination was solved at all torques.
    """
    keys, amounts = combinations_of(scene)
    torques = torques_of(scene, "sizing.torques_Nm")
    base = model_of(scene)
    meshes = timed(
        lambda model, t: optimise.prepare_torques(model, t, grid), base, jnp.asarray(torques)
    )

    def of_combination(values: Reals, model: PairModel, meshes: PreparedMesh) -> Reals:
        updates = dict(zip(keys, values, strict=True))
        if scene["sizing.symmetric"]:
            updates |= {twin(key): value for key, value in updates.items()}
        flanks = flanks_of(scene.replace(updates), model.pair)
        return jax.vmap(lambda mesh, torque: _judge(model, flanks, mesh, torque))(
            meshes, jnp.asarray(torques)
        )

    def of_chunk(chunk: Reals, model: PairModel, meshes: PreparedMesh) -> Reals:
        one = lambda values: of_combination(values, model, meshes)
        return jax.lax.map(one, chunk, batch_size=min(_BATCH, chunk.shape[0]))

    size = min(_CHUNK, len(amounts))
    padded = np.pad(amounts, ((0, -len(amounts) % size), (0, 0)), mode="edge")
    found = []
    for first in range(0, len(amounts), size):
        chunk = jnp.asarray(padded[first : first + size])
        found.append(np.asarray(timed(of_chunk, chunk, base, meshes)))
        done(min(size, len(amounts) - first))
    values = np.concatenate(found)[: len(amounts)]
    if not np.isfinite(values).all(axis=(1, 2)).any():
        raise SolverFailure("the contact was solved for no combination of [sizing.amounts]")
    return _ranked(keys, torques, amounts, values)


def _judge(model: PairModel, flanks: Any, mesh: PreparedMesh, torque: Reals) -> Reals:
    """The responses at one torque, NaN where a phase was not solved."""
    model = eqx.tree_at(lambda m: (m.flanks, m.torque), model, (flanks, torque))
    law = ExactContact()
    cycle = corrected_cycle(mesh, model, law=law)
    error = transmission_error(model.pair, cycle)
    found = jnp.stack(
        [
            peak_to_peak(error) / um,
            cycle_rms(cycle, error) / um,
            cycle_mean(cycle, error) / um,
            jnp.max(hertz_pressure(model.pair, cycle, law)) / MPa,
            face_load_factor(cycle),
        ]
    )
    return jnp.where(jnp.all(cycle.converged), found, jnp.nan)


def _ranked(
    keys: tuple[str, ...], torques: np.ndarray, amounts: np.ndarray, values: np.ndarray
) -> SizingTable:
    """Sort the combinations; `values` has the axes combination, torque, response."""
    columns = dict(zip(RESPONSES, np.moveaxis(values, 2, 0), strict=True))
    unsolved = ~np.isfinite(values).all(axis=(1, 2))
    error, pressure = (
        np.where(unsolved, np.inf, np.max(columns[name], axis=1))
        for name in ("te_peak_to_peak_um", "max_pressure_MPa")
    )
    rounded = np.where(unsolved, np.inf, np.round(error / _EQUAL))
    order = np.lexsort((error, pressure, rounded))
    pressure_rank = np.empty(len(order), dtype=int)
    pressure_rank[np.argsort(pressure, kind="stable")] = np.arange(1, len(order) + 1)
    return SizingTable(
        keys=keys,
        torques=torques,
        amounts=amounts[order],
        responses={name: column[order] for name, column in columns.items()},
        pressure_rank=pressure_rank[order],
    )


def sizing_columns(table: SizingTable) -> dict[str, np.ndarray]:
    """The whole table as columns: one row for each combination and torque, the best first."""
    count, torques = table.responses["te_mean_um"].shape
    each = lambda values: np.repeat(values, torques)
    return (
        {"rank": each(np.arange(1, count + 1)), "rank_by_pressure": each(table.pressure_rank)}
        | {key: each(table.amounts[:, index]) for index, key in enumerate(table.keys)}
        | {"torque_pinion_Nm": np.tile(table.torques, count)}
        | {name: values.ravel() for name, values in table.responses.items()}
        | {
            f"worst_{name}": each(table.worst(name))
            for name in ("te_peak_to_peak_um", "max_pressure_MPa")
        }
    )


def sizing_summary(scene: Scene, table: SizingTable) -> dict[str, Any]:
    """The `sizing` part of the summary: what was tried, and the best of it."""
    worst = {name: table.worst(name) for name in RESPONSES}
    top = [
        {
            "rank": row + 1,
            "rank_by_pressure": int(table.pressure_rank[row]),
            "amounts": dict(zip(table.keys, table.amounts[row].tolist(), strict=True)),
            **{f"worst_{name}": float(values[row]) for name, values in worst.items()},
        }
        for row in range(min(_TOP, len(table.amounts)))
    ]
    return {
        "combinations": len(table.amounts),
        "torques_Nm": table.torques,
        "symmetric": scene["sizing.symmetric"],
        "unsolved": int(np.isnan(worst["te_mean_um"]).sum()),
        "best": top[0],
        "top": top,
    }
