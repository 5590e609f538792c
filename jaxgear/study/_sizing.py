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
from jaxgear._batches import over_batch
from jaxgear._checks import InputError
from jaxgear._interface._laws import ExactContact
from jaxgear._solve._cycle import PreparedMesh, corrected_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Reals
from jaxgear.scene._build import flanks_of
from jaxgear.scene._schema import KEYS, general
from jaxgear.scene._study_tables import SizingKeys
from jaxgear.study._built import BuiltScene
from jaxgear.study._design import refuse_twins, twin
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry, dataset_of, told
from jaxgear.study._running import timed
from jaxgear.study._statics import SolverFailure, headline, torques_of

# What each combination is judged by, at every torque.
RESPONSES = {
    "te_peak_to_peak_um": "peak to peak of the transmission error",
    "te_rms_um": "RMS of the transmission error about its mean",
    "te_mean_um": "mean transmission error",
    "max_pressure_MPa": "Hertzian pressure",
    "face_load_factor": "face load factor",
}

_MOST = 100_000
_TOP = 10
# Combinations in one call of the compiled program, and those solved side by side within it.
_CHUNK, _BATCH = 64, 8
# Ranges of the transmission error closer than this are equal, and the pressure decides [um].
_EQUAL = 1e-3


def combinations_of(asked: SizingKeys) -> tuple[tuple[str, ...], np.ndarray]:
    """The amounts that a scene lists: their keys, and a row for each combination."""
    keys = tuple(asked.amounts)
    if not keys:
        raise InputError(
            "[sizing] names no amounts. Add, for example, "
            '"flank.pinion.tip_relief.depth_um" = [0.0, 5.0, 10.0] to a table [sizing.amounts].'
        )
    if asked.symmetric:
        refuse_twins("sizing", keys)
    lists = [sorted(set(values)) for values in asked.amounts.values()]
    count = math.prod(map(len, lists))
    if count > _MOST:
        sizes = " x ".join(str(len(values)) for values in lists)
        raise InputError(
            f"[sizing.amounts] has {sizes} = {count} combinations, more than {_MOST}. List fewer "
            "amounts, or keep some keys fixed; `jaxgear optimise` finds the best of many in far "
            "fewer evaluations."
        )
    return keys, np.asarray(list(itertools.product(*lists)))


def sizing_table(built: BuiltScene, done: Callable[[int], None]) -> xr.Dataset:
    """Evaluate every combination at every torque, and rank them.

    The first is the one whose largest peak-to-peak of the transmission error over the torques is
    least; where two are the same to the nanometre the largest pressure decides. Combinations that
    were not solved are last, with NaN.
    """
    scene, base, grid = built.scene, built.model, built.grid
    keys, amounts = combinations_of(scene.sizing)
    torques = torques_of("sizing", scene.sizing.torques_Nm, scene.pair, scene.pinion.shaft)
    meshes = timed(
        lambda model, t: optimise.prepare_torques(model, t, grid), base, jnp.asarray(torques)
    )

    def of_combination(values: Reals, model: PairModel, meshes: PreparedMesh) -> Reals:
        updates = dict(zip(keys, values, strict=True))
        if scene.sizing.symmetric:
            updates |= {twin(key): value for key, value in updates.items()}
        flanks = flanks_of(scene.replace(updates), model.pair)
        judge = lambda mesh, torque: _judge(model, flanks, mesh, torque)
        return jax.vmap(judge)(meshes, jnp.asarray(torques))

    def of_chunk(chunk: Reals, model: PairModel, meshes: PreparedMesh) -> Reals:
        one = lambda values: of_combination(values, model, meshes)
        return over_batch(one, chunk, on_cpu=_BATCH)

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
    symmetric = scene.sizing.symmetric
    entries = {key: _amount(key, each, symmetric=symmetric) for key, each in columns}
    return ranked(entries, torques, values)


def _judge(model: PairModel, flanks: Any, mesh: PreparedMesh, torque: Reals) -> Reals:
    """The responses at one torque, NaN where a phase was not solved."""
    model = eqx.tree_at(lambda m: (m.flanks, m.torque), model, (flanks, torque))
    cycle = corrected_cycle(mesh, model, law=ExactContact())
    numbers = headline(model, cycle, ExactContact())
    found = jnp.stack([numbers[name] for name in RESPONSES])
    return jnp.where(jnp.all(cycle.converged), found, jnp.nan)


def _amount(key: str, values: np.ndarray, *, symmetric: bool) -> Entry:
    """The values of a key of a flank."""
    _, gear, name = key.split(".", 2)
    unit = KEYS[general(key)].unit
    words = f"{'both' if symmetric else gear}: {name}"
    return Entry(("combination",), values, "1" if unit == "-" else unit, words)


def ranked(amounts: Mapping[str, Entry], torques: np.ndarray, values: np.ndarray) -> xr.Dataset:
    """Sort combinations, the best first.

    Values are `[combination, torque, response]`, NaN where not solved; torques in N m.
    """
    columns = dict(zip(RESPONSES, np.moveaxis(values, 2, 0), strict=True))
    worst = {name: np.max(each, axis=1) for name, each in columns.items()}
    unsolved = ~np.isfinite(values).all(axis=(1, 2))
    error, pressure = (
        np.where(unsolved, np.inf, worst[name])
        for name in ("te_peak_to_peak_um", "max_pressure_MPa")
    )
    rounded = np.where(unsolved, np.inf, np.round(error / _EQUAL))
    order = np.lexsort((error, pressure, rounded))
    rank = np.arange(1, len(order) + 1)
    of_pressure = np.empty(len(order), dtype=int)
    of_pressure[np.argsort(pressure, kind="stable")] = rank
    in_order = {
        key: each._replace(values=np.asarray(each.values)[order]) for key, each in amounts.items()
    }
    at_each = {name: (columns[name][order], words) for name, words in RESPONSES.items()}
    at_worst = {
        f"worst_{name}": (worst[name][order], f"largest {words} of all torques")
        for name, words in RESPONSES.items()
    }
    return dataset_of(
        told(
            "combination",
            rank=(rank, "rank by the error"),
            rank_by_pressure=(of_pressure[order], "rank by the pressure"),
        )
        | in_order
        | told("combination torque", **at_each)
        | told("combination", **at_worst),
        **told("amount", amount=(list(amounts), "key that is varied")),
        **told("torque", torque_pinion_Nm=(torques, "torque on the pinion")),
    )


def sizing_summary(table: xr.Dataset, *, symmetric: bool) -> Summary:
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
        "symmetric": symmetric,
        "unsolved": int(np.isnan(table["worst_te_mean_um"].values).sum()),
        "best": top[0],
        "top": top,
    }
