"""Derivatives of responses by keys, three ways: forward, reverse and central differences."""

import dataclasses
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from jaxgear._types import Flag, Flags, Reals
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import split_entry
from jaxgear.study._results import dataset_of, told
from jaxgear.study._running import timed

# Of keys: responses, which piece of each piecewise formula is in use, and what is solved.
Responses = Callable[[Reals], tuple[Reals, tuple[Reals, Flags]]]

# Points in one call of a compiled program, between which it can be interrupted.
_CHUNK = 120
# Derivatives below this share of the response over the step's scale count as none.
_NO_EFFECT = 1e-12


class Limits(NamedTuple):
    """How close derivatives have to be to central differences.

    **Fields:**

    - `tolerance`: relative error that a derivative may have.
    - `floor`: below this share of the response over the step's scale a derivative drowns in the
        rounding of the difference.
    - `steps`: of the differences, over the size of the key. A long step has little rounding, a
        short one is less likely to straddle the edge between two pieces of a formula.
    - `rounding`: of a response, as it was seen: estimates that agree better than that do so by
        luck.
    - `words`: that are added to a verdict.
    """

    tolerance: float
    floor: float
    steps: tuple[float, ...]
    rounding: float
    words: tuple[str, str]


# Rounding in the difference is about 1e-10 of the response over the step's scale.
AT_REST = Limits(1e-6, 1e-3, (1e-4, 2e-5, 4e-6), 2e-14, ("ok", "WRONG"))
# A steady response is as much more sensitive as it is close to a resonance. Modes of nearly the
# same frequency, as of equal bearings along S and T, round to about 1e-8. RMS of TE of accessory-h1
# at 1500 rad/s scatters by 4e-10 of itself where all is built anew.
IN_MOTION = Limits(1e-5, 1e-2, (2e-3, 4e-4, 1e-4), 4e-10, ("ok to 1e-5", "WRONG at 1e-5"))


@dataclasses.dataclass(frozen=True)
class Keys:
    """Real keys of a scene, which are moved together.

    **Fields:**

    - `scene`: where derivatives are taken.
    - `names`: dotted paths, with their units.
    """

    scene: Scene
    names: tuple[str, ...]

    @property
    def centre(self) -> np.ndarray:
        """Their values, in the units of their names."""
        return np.asarray([self.scene.value(name) for name in self.names], dtype=float)

    def moved(self, values: Reals) -> Scene:
        """The scene with other values of the keys.

        Unstacked, whose reverse is to stack: that of as many slices is a sum of as many vectors,
        which XLA would fuse with all that their numbers are of, for each of them anew.
        """
        return self.scene.replace(dict(zip(self.names, jnp.unstack(values), strict=True)))


def linearised(function: Callable[..., tuple[Reals, Any]]) -> Callable:
    """A program for derivatives in both directions, which share one linearisation.

    It takes numbers, tangents `[row, number]`, weights `[row, value]` or `None`, and what else the
    function takes. It returns the values; whatever else was found; how the values move along each
    tangent; and the derivatives of their weighted sums by the numbers.
    """

    def program(numbers: Reals, tangents: Reals, weights: Reals | None, *others: Any):
        own = lambda numbers: function(numbers, *others)
        value, push, seen = jax.linearize(own, numbers, has_aux=True)
        # Named: of what has no name JAX prints all that was traced, to tell it in errors.
        along = lambda moved: push(moved)
        # One column, or one row, after the other: batched they take far longer to compile.
        columns = jax.lax.map(along, tangents)
        if weights is None:
            return value, seen, columns, None
        pull = jax.linear_transpose(along, numbers)
        return value, seen, columns, jax.lax.map(lambda row: pull(row)[0], weights)

    return program


# What counts as a change of order one of a key whose value is 0, by its unit; the longest ending
# first, and 1 without any of these.
_USUAL = {"_N_m": 1e6, "_Nm_rad": 1e3, "_um": 10.0, "_N": 100.0}


def usual_size(key: str, value: float) -> float:
    """What counts as a change of order one of a key: its value, or what is usual where it is 0."""
    name = split_entry(key)[0]
    usual = next((size for ending, size in _USUAL.items() if name.endswith(ending)), 1.0)
    return abs(value) or usual


def central_differences(
    responses: Responses, centre: np.ndarray, sizes: np.ndarray, limits: Limits
) -> tuple[np.ndarray, np.ndarray]:
    """Extrapolated central differences, and whether both sides use the same pieces as the centre.

    Of all steps, over the sizes of the keys, the one counts whose two estimates, with h and with
    h/2, agree best but for rounding. Both are `[response, key]`.
    """
    # Traced once, for the shape of its pieces and for the loop.
    responses, steps = jax.jit(responses), limits.steps

    def compared(known: Reals, point: tuple[Reals, Flag]) -> tuple[Reals, tuple[Reals, Flag]]:
        values, is_first = point
        found, (own, _) = responses(values)
        known = jnp.where(is_first, own, known)
        return known, (found, jnp.all(own == known))

    def chunk(points: Reals) -> tuple[Reals, Flags]:
        pieces = jax.eval_shape(responses, points[0])[1][0]
        is_first = jnp.arange(len(points)) == 0
        return jax.lax.scan(compared, jnp.zeros(pieces.shape), (points, is_first))[1]

    shifts = np.outer(steps, [1.0, -1.0, 0.5, -0.5]).ravel()
    points = (centre + shifts[:, None, None] * np.diag(sizes)).reshape(-1, len(centre))
    size = min(_CHUNK, len(points))
    padded = np.pad(points, ((0, -len(points) % size), (0, 0)), mode="edge")
    parts = [
        timed(chunk, jnp.asarray(np.concatenate([centre[None], part])))
        for part in padded.reshape(-1, size, len(centre))
    ]
    around, same = (np.concatenate([x[1:] for x in xs]) for xs in zip(*parts, strict=True))
    shape = (len(steps), 4, len(centre))
    around = around[: len(points)].reshape(*shape, -1)
    same = np.all(same[: len(points)].reshape(shape), axis=1)
    step = np.asarray(steps)[:, None, None] * sizes[:, None]
    coarse = (around[:, 0] - around[:, 1]) / (2.0 * step)
    fine = (around[:, 2] - around[:, 3]) / step
    off = np.abs(fine - coarse) + limits.rounding * np.abs(around[:, 0]) / step
    best = np.argmin(off, axis=0)
    chosen = lambda x: np.take_along_axis(x, best[None], axis=0)[0].T
    return chosen((4.0 * fine - coarse) / 3.0), chosen(np.broadcast_to(same[..., None], fine.shape))


def judged(
    contact: Sequence[str],
    names: Sequence[str],
    keys: Sequence[str],
    centre: ArrayLike,
    responses: Responses,
    found: tuple[ArrayLike, ArrayLike, ArrayLike],
    limits: Limits,
    shared: Collection[str] = (),
) -> xr.Dataset:
    """Compare derivatives by keys with central differences: one row for each response and key.

    Found are the responses, and their derivatives forward and reverse, `[response, key]`; shared
    keys are of points on a shaft that move with another one. Verdicts are `ok`, `no effect`,
    `shares a place`, `set changes` (contact or relief is not the same on both sides of the
    difference, which then proves nothing) or `WRONG`; of a steady response `ok to 1e-5` and `WRONG
    at 1e-5`.
    """
    centre, values, forward, reverse = map(np.asarray, (centre, *found))
    sizes = np.asarray(list(map(usual_size, keys, centre)))
    difference, same = central_differences(responses, centre, sizes, limits)
    scale = np.abs(values)[:, None] / sizes
    with np.errstate(divide="ignore", invalid="ignore"):
        largest = np.abs([forward, reverse, difference]).max(axis=0)
        off = np.maximum(np.abs(forward - difference), np.abs(reverse - difference))
        error = off / np.maximum(largest, limits.floor * scale)
    ok, wrong = limits.words
    none = np.where([key in shared for key in keys], "shares a place", "no effect")
    where = [~np.isfinite(largest), largest <= _NO_EFFECT * scale, error <= limits.tolerance, same]
    verdict = np.select(where, [wrong, none, ok, wrong], "set changes")
    flat = lambda values: np.broadcast_to(values, same.shape).ravel()
    entries = told(
        "row",
        contact=(flat(np.asarray(contact)[:, None]), "contact law"),
        response=(flat(np.asarray(names)[:, None]), "response, with its unit"),
        key=(flat(np.asarray(keys)), "key, with its unit"),
        forward=(flat(forward), "derivative, forward"),
        reverse=(flat(reverse), "derivative, reverse"),
        difference=(flat(difference), "derivative, by central differences"),
        error=(flat(error), "larger relative error of the first two against the third"),
        verdict=(flat(verdict), "verdict"),
    )
    for name in ("forward", "reverse", "difference"):
        entries[name] = entries[name]._replace(units="response/key")
    return dataset_of(entries)
