"""What searches evaluate: named functions, and all numbers that they need as their arguments.

So a program is compiled once, whatever torque, relief or smoothing width it is then called with.
"""

import dataclasses
import hashlib
import json
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._batches import over_batch
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, SmoothContact
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._system._model import PairModel
from jaxgear._types import Reals, Scalar, as_reals
from jaxgear._whole_file import as_json
from jaxgear.scene._build import flanks_of, model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import split_entry
from jaxgear.study._running import timed

# Values of keys by path, in the units of the file.
Updates = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Wording:
    """What a scene says apart from some of its numbers: all that a program is made from.

    Two are equal, and share programs, if what they say is.

    **Fields:**

    - `scene`: whose numbers may be given by others; not kept in files.
    - `words`: that stand for it.
    """

    scene: Scene | None = dataclasses.field(compare=False)
    words: str

    def __reduce__(self) -> tuple[type, tuple[None, str]]:
        return Wording, (None, self.words)


class Variation(eqx.Module):
    """How variables change a model.

    **Fields:**

    - `wording`: of the scene.
    - `numbers`: of the scene under the keys that may change without another program, in the units
        of their keys [-].
    - `base`: model of the scene itself, or `None` where more than flanks varies.
    """

    wording: Wording = eqx.field(static=True)
    numbers: Updates
    base: PairModel | None

    def model(self, updates: Updates) -> PairModel:
        """The model with other values of some keys, in the units of the keys."""
        scene = self.wording.scene
        assert scene is not None
        # To be told a number again is not to have been given it: some are left out if nobody was.
        given = scene.replace(updates).given
        scene = dataclasses.replace(scene.replace(self.numbers | updates), given=given)
        if self.base is None:
            return model_of(scene)
        flanks = flanks_of(scene, self.base.pair)
        return eqx.tree_at(lambda model: model.flanks, self.base, flanks)


def variation_of(scene: Scene, base: PairModel, *, flanks_only: bool) -> Variation:
    """How a scene's model changes with its keys."""
    if not flanks_only:
        # Which points of shafts share nodes, and which bodies are interpolated, are decided with
        # numbers: another scene may be another program.
        return Variation(Wording(scene, uuid.uuid4().hex), {}, None)
    numbers = [key for key in scene.real_keys() if key.startswith("flank.")]
    lists = {split_entry(key)[0] for key in numbers}
    said = {
        key: len(value) if isinstance(value, list) and key in lists else value
        for key, value in scene.values.items()
        if key.startswith(("flank.", "mesh.periods")) and key not in numbers
    }
    given = sorted(key for key in scene.given if key.startswith("flank."))
    named = (str(value) for key, value in said.items() if key.endswith("_csv"))
    files = [_digest(scene.path.parent / name) for name in named]
    words = json.dumps(as_json({"said": said, "given": given, "files": files}), sort_keys=True)
    plain = {key: np.asarray(scene.value(key), dtype=float) for key in numbers}
    return Variation(Wording(scene, words), plain, base)


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


class Task(eqx.Module):
    """What a search makes small, and what it keeps below limits.

    **Fields:**

    - `variation`: of the model.
    - `keys`: of the variables and of what follows each of them.
    - `objective`: of one cycle.
    - `limited`: responses that have limits.
    - `torques`: on the pinion [N m].
    - `grid`: phases, lines and slices.
    - `prepared`: the meshes, where the variables leave them as they are.
    - `worst`: whether the largest over the torques counts instead of the mean.
    - `batched`: whether all torques are solved at once.
    """

    variation: Variation
    keys: tuple[tuple[str, ...], ...] = eqx.field(static=True)
    objective: optimise.AbstractObjective
    limited: tuple[optimise.AbstractObjective, ...]
    torques: Reals = eqx.field(converter=as_reals)
    grid: MeshGrid
    prepared: PreparedMesh | None
    worst: bool = eqx.field(static=True)
    batched: bool = eqx.field(static=True)

    def model(self, values: Reals) -> PairModel:
        """The model at values of the variables; traceable by JAX."""
        pairs = zip(self.keys, jnp.unstack(values), strict=True)
        return self.variation.model({key: value for keys, value in pairs for key in keys})


def objective_at(task: Task, values: Reals, law: AbstractContactLaw) -> Scalar:
    """The objective over all torques; NaN where a cycle was not solved."""
    return _over_torques(optimise.over_torques, task, law)(values)


def responses_at(task: Task, values: Reals, law: AbstractContactLaw) -> Reals:
    """The objective and the responses that have limits, over all torques."""
    return _over_torques(optimise.responses_over_torques, task, law, task.limited)(values)


def _over_torques(made: Callable, task: Task, law: AbstractContactLaw, *more: Any) -> Callable:
    """A function of the variables, made for the torques of a task."""
    return made(
        task.model,
        task.objective,
        *more,
        task.torques,
        grid=task.grid,
        law=law,
        worst=task.worst,
        prepared=task.prepared,
        batched=task.batched,
    )


def residuals_at(task: Task, values: Reals, law: AbstractContactLaw) -> Reals:
    """Deviations of the transmission error, whose squares sum to the objective."""
    return optimise.residuals_over_torques(
        task.model, task.torques, grid=task.grid, law=law, prepared=task.prepared
    )(values)


def sloped_objective(task: Task, values: Reals, law: AbstractContactLaw) -> tuple[Scalar, Reals]:
    """The objective and its gradient, in reverse."""
    return jax.value_and_grad(lambda x: objective_at(task, x, law))(values)


def sloped_responses(task: Task, values: Reals, law: AbstractContactLaw) -> tuple[Reals, Reals]:
    """The responses and their derivatives, forward."""
    return optimise.value_and_jacobian(lambda x: responses_at(task, x, law))(values)


def sloped_residuals(task: Task, values: Reals, law: AbstractContactLaw) -> tuple[Reals, Reals]:
    """The residuals and their derivatives, forward."""
    return optimise.value_and_jacobian(lambda x: residuals_at(task, x, law))(values)


def sloped_by(evaluate: Callable[..., Any], task: Task) -> optimise.ValueAndGradient:
    """One of these, compiled: of the variables and a width of smooth contact [m]."""
    return optimise.ValueAndGradient(
        lambda x, width: timed(evaluate, task, x, SmoothContact(width))
    )


def objectives_at(task: Task, points: Reals, law: AbstractContactLaw) -> Reals:
    """The objective at many points.

    On a processor one after the other: what 64 phases have fits into its cache, 50 times that does
    not, and takes twice as long.
    """
    return over_batch(lambda values: objective_at(task, values, law), points)


# What a tenth of a limit too much counts, against objectives of order one.
_PENALTY = 1e2


def penalised_at(
    task: Task, points: Reals, law: AbstractContactLaw, most: Reals, scale: Reals
) -> Reals:
    """The objective at many points, with what is beyond limits added to it."""

    def value(values: Reals) -> Scalar:
        found = responses_at(task, values, law)
        over = jnp.maximum((found[1:] - most) / scale, 0.0)
        return found[0] + _PENALTY * jnp.sum(over**2)

    return over_batch(value, points)
