"""What [sizing] asks for: every combination of the listed amounts, at every torque, ranked.

Contact is exact. What the amounts leave alone, stiffness and structure, is computed once for each
torque.
"""

import itertools
import math
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

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
from jaxgear.scene._schema import KEYS, general
from jaxgear.study._design import refuse_twins, twin
from jaxgear.study._results import Entry, dataset_of
from jaxgear.study._running import timed
from jaxgear.study._statics import SolverFailure, torques_of

# What each combination is judged by, at every torque.
RESPONSES = {
    "te_peak_to_peak_um": ("um", "peak to peak of the transmission error"),
    "te_rms_um": ("um", "RMS of the transmission error about its mean"),
    "te_mean_um": ("um", "mean transmission error"),
    "max_pressure_MPa": ("MPa", "Hertzian pressure"),
    "face_load_factor": ("1", "face load factor"),
}

_AMOUNTS = "sizing.amounts."
_MOST = 100_000
_TOP = 10
# Combinations in one call of the compiled program, and those solved side by side within it.
_CHUNK, _BATCH = 64, 8
# Ranges of the transmission error closer than this are equal, and the pressure decides [um].
_EQUAL = 1e-3


def combinations_of(scene: Scene) -> tuple[tuple[str, ...], np.ndarray]:
    """The amounts that a scene lists: their keys, and a row for each combination."""
    keys = tuple(key.removeprefix(_AMOUNTS) for key in scene.values if key.startswith(_AMOUNTS))
    if not keys:
        raise InputError(
            "[sizing] names no amounts. Add, for example, "
            '"flank.pinion.tip_relief.depth_um" = [0.0, 5.0, 10.0] to a table [sizing.amounts].'
        )
    if scene.sizing.symmetric:
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


def sizing_table(scene: Scene, grid: MeshGrid, done: Callable[[int], None]) -> xr.Dataset:
    """Evaluate every combination at every torque, and rank them.

    The first is the one whose largest peak-to-peak of the transmission error over the torques is
    least; where two are the same to the nanometre the largest pressure decides. Combinations that
    were not solved are last, with NaN.
    """
    keys, amounts = combinations_of(scene)
    torques = torques_of(scene, "sizing")
    base = model_of(scene)
    meshes = timed(
        lambda model, t: optimise.prepare_torques(model, t, grid), base, jnp.asarray(torques)
    )

    def of_combination(values: Reals, model: PairModel, meshes: PreparedMesh) -> Reals:
        updates = dict(zip(keys, values, strict=True))
        if scene.sizing.symmetric:
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
    columns = zip(keys, amounts.T, strict=True)
    return ranked({key: _amount(scene, key, each) for key, each in columns}, torques, values)


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


def _amount(scene: Scene, key: str, values: np.ndarray) -> Entry:
    """The values of a key of a flank."""
    _, gear, name = key.split(".", 2)
    unit = KEYS[general(key)].unit
    whose = "both" if scene.sizing.symmetric else gear
    return Entry(("combination",), values, "1" if unit == "-" else unit, f"{whose}: {name}")


def ranked(amounts: Mapping[str, Entry], torques: np.ndarray, values: np.ndarray) -> xr.Dataset:
    """Sort combinations, the best first.

    Values are `[combination, torque, response]`, NaN where not solved; torques in N m.
    """
    columns = dict(zip(RESPONSES, np.moveaxis(values, 2, 0), strict=True))
    unsolved = ~np.isfinite(values).all(axis=(1, 2))
    worst = {
        name: np.where(unsolved, np.inf, np.max(columns[name], axis=1))
        for name in ("te_peak_to_peak_um", "max_pressure_MPa")
    }
    error, pressure = worst.values()
    rounded = np.where(unsolved, np.inf, np.round(error / _EQUAL))
    order = np.lexsort((error, pressure, rounded))
    pressure_rank = np.empty(len(order), dtype=int)
    pressure_rank[np.argsort(pressure, kind="stable")] = np.arange(1, len(order) + 1)
    of_both, of_one = ("combination", "torque"), ("combination",)
    return dataset_of(
        {
            "rank": Entry(of_one, np.arange(1, len(order) + 1), "1", "rank by the error"),
            "rank_by_pressure": Entry(of_one, pressure_rank[order], "1", "rank by the pressure"),
        }
        | {
            key: entry._replace(values=np.asarray(entry.values)[order])
            for key, entry in amounts.items()
        }
        | {name: Entry(of_both, columns[name][order], *rest) for name, rest in RESPONSES.items()}
        | {
            f"worst_{name}": Entry(
                of_one,
                np.max(columns[name], axis=1)[order],
                unit,
                f"largest {words} of all torques",
            )
            for name, (unit, words) in RESPONSES.items()
        },
        amount=Entry(("amount",), list(amounts), "1", "key that is varied"),
        torque_pinion_Nm=Entry(("torque",), torques, "N m", "torque on the pinion"),
    )


def sizing_summary(scene: Scene, table: xr.Dataset) -> dict[str, Any]:
    """The `sizing` part of the summary: what was tried, and the best of it."""
    number = lambda name, row: float(table[name].values[row])
    top = [
        {
            "rank": row + 1,
            "rank_by_pressure": int(table["rank_by_pressure"].values[row]),
            "amounts": {key: number(key, row) for key in table["amount"].values.tolist()},
            **{f"worst_{name}": number(f"worst_{name}", row) for name in RESPONSES},
        }
        for row in range(min(_TOP, table.sizes["combination"]))
    ]
    return {
        "combinations": table.sizes["combination"],
        "torques_Nm": table["torque_pinion_Nm"].values,
        "symmetric": scene.sizing.symmetric,
        "unsolved": int(np.isnan(table["worst_te_mean_um"].values).sum()),
        "best": top[0],
        "top": top,
    }
