r"""What a structure with turning bodies of equal sectors answers, wave by wave.

A turn by one sector takes such a body into itself, in space as on the body: motions of one wave
number mix with each other alone, by stiffness, mass, damping and every term of rotation, and with
the seats those that have no nodal diameter or one (cyclic symmetry, Thomas 1979). A wave runs
forward or backward, $y_\pm = (x_1 \pm i x_2)/\sqrt 2$ of a pair $x_1, x_2$, and neither mixes with
the other. Seats, shafts, the other body and the mesh join the waves through few coordinates
(frequency-based substructuring, Jetmundsen, Bielawa & Flannelly 1988): with $Z_b$ the dynamic
stiffness of a wave, $Z_{bh}$ what ties it to the hub of all that is no wave and $V_b$ its mesh
coordinates, motion under loads $f$ and mesh load $p$ is
$y_b = Z_b^{-1}(f_b - V_bp - Z_{bh}x_h)$, which leaves equations in $x_h$ and $p = \bar kV^Tx$.
No matrix is larger than a wave or the hub, none singular at rest, and a mode costs a few products.
"""

import functools
import itertools
import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._dynamics._types import Matrix, Vector, Vectors
from jaxgear._types import CoordinateMatrix, Reals, Scalar


class WaveGroup(NamedTuple):
    """Motions of one wave number of a body, among the degrees of freedom of a system.

    **Fields:**

    - `first`, `second`: of each pair; `second` is empty where they are alone.
    - `joined`: whether the seats tie to them.
    - `mixed`: whether they tie to each other: terms of rotation of the body do, or the seats.
    """

    first: tuple[int, ...]
    second: tuple[int, ...]
    joined: bool
    mixed: bool


def wave_groups(waves: tuple[int, ...], start: int, *, mixed: bool) -> tuple[WaveGroup, ...]:
    """Sort the modes of a body by wave number.

    **Arguments:**

    - `waves`: wave number of each, the second of a pair negative, right after the first.
    - `start`: degree of freedom of the first mode.
    - `mixed`: whether terms of rotation of the body tie modes of one wave number together.

    **Returns:**

    A group for each wave number.
    """
    numbers, found = np.asarray(waves), []
    for number in np.unique(np.abs(numbers)):
        first, second = (start + np.flatnonzero(numbers == s * number) for s in (1, -1))
        second = second if number else second[:0]
        joined = bool(number <= 1)
        pair = tuple(map(int, first)), tuple(map(int, second))
        found.append(WaveGroup(*pair, joined, mixed or joined))
    return tuple(found)


def hub_of(groups: Sequence[WaveGroup], size: int) -> np.ndarray:
    """Degrees of freedom, of so many, that belong to none of the groups."""
    inside = [dof for group in groups for dof in (*group.first, *group.second)]
    return np.setdiff1d(np.arange(size), inside)


class _Waves(NamedTuple):
    """Waves in both directions, and alone, each padded to the longest.

    **Fields:**

    - `first`, `second`: degree of freedom of each motion's pair, `[wave, motion]`.
    - `by_first`, `by_second`: what the motion has of both; zero beyond the wave's end.
    """

    first: np.ndarray
    second: np.ndarray
    by_first: np.ndarray
    by_second: np.ndarray

    @property
    def sides(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Weights of the first and of the second, and where these are."""
        return (self.by_first, self.first), (self.by_second, self.second)

    @property
    def none(self) -> np.ndarray:
        """One where there is no motion."""
        return (self.by_first == 0.0).astype(complex)

    def diagonals(self, matrix: Array) -> Array:
        """Diagonal of a matrix of the system on each wave, `[wave, motion]`."""
        each = [
            a * matrix[p, q] * b.conj()
            for (a, p), (b, q) in itertools.product(self.sides, repeat=2)
        ]
        return jnp.asarray(functools.reduce(operator.add, each))

    def matrices(self, matrix: Array) -> Array:
        """A matrix of the system on each wave, `[wave, motion, motion]`."""
        each = [
            a[:, :, None] * matrix[p[:, :, None], q[:, None, :]] * b.conj()[:, None, :]
            for (a, p), (b, q) in itertools.product(self.sides, repeat=2)
        ]
        return jnp.asarray(functools.reduce(operator.add, each))

    def rows(self, columns: Array) -> Array:
        """Columns over degrees of freedom on each wave, `[wave, motion, column]`."""
        each = [weights[:, :, None] * columns[places] for weights, places in self.sides]
        return jnp.asarray(functools.reduce(operator.add, each))

    def spread(self, motion: Array, onto: Array) -> Array:
        """Add motions of waves to those of all degrees of freedom."""
        for weights, places in self.sides:
            onto = onto.at[places].add(weights.conj()[:, :, None] * motion)
        return onto


def _waves(groups: list[WaveGroup]) -> _Waves:
    longest = max(len(group.first) for group in groups)
    parts: list[list[np.ndarray]] = []
    for group in groups:
        pad = (0, longest - len(group.first))
        kinds = [(1.0, 0.0)]
        if group.second:
            kinds = [(math.sqrt(0.5), sign * 1j * math.sqrt(0.5)) for sign in (1.0, -1.0)]
        for by_first, by_second in kinds:
            ones = np.ones(len(group.first))
            columns = group.first, group.second or group.first, by_first * ones, by_second * ones
            parts.append([np.pad(np.asarray(column), pad) for column in columns])
    first, second, by_first, by_second = (np.stack(part) for part in zip(*parts, strict=True))
    return _Waves(first, second, by_first.astype(complex), by_second.astype(complex))


def _solved(matrices: Array, right: Array) -> Array:
    """Solve many small systems at once; derivatives are those of the solutions."""
    return jax.lax.custom_linear_solve(
        lambda x: matrices @ x,
        right,
        lambda _, b: _eliminated(matrices, b),
        lambda _, b: _eliminated(jnp.swapaxes(matrices, 1, 2), b),
    )


def _eliminated(matrices: Array, right: Array) -> Array:
    """Gauss-Jordan with pivots, all systems together: a library call for each costs far more."""
    size, count = matrices.shape[1], matrices.shape[0]
    every = np.arange(count)

    def step(k: Array, whole: Array) -> Array:
        candidates = jnp.where(np.arange(size)[None, :] >= k, jnp.abs(whole[:, :, k]), -1.0)
        pivot = jnp.argmax(candidates, axis=1)
        chosen, here = whole[every, pivot], whole[:, k]
        whole = whole.at[every, pivot].set(here)
        chosen = chosen / chosen[every, k][:, None]
        factors = whole[:, :, k].at[:, k].set(0.0)
        return (whole - factors[:, :, None] * chosen[:, None, :]).at[:, k].set(chosen)

    whole = jnp.concatenate([matrices, right], axis=2)
    return jax.lax.fori_loop(0, size, step, whole)[:, :, size:]


class Parts(NamedTuple):
    """A matrix of a system in parts.

    **Fields:**

    - `hub`: on all that is no wave, `[hub, hub]`.
    - `own`: on the waves of each kind, `[wave, motion, motion]`; of motions that nothing mixes the
        diagonals, `[wave, motion]`.
    - `onto`: loads on them per motion of the hub, `[wave, motion, hub]`, or `None`: apart from it.
    - `back`: loads on the hub per motion of theirs, `[wave, hub, motion]`, or `None`.
    """

    hub: Array
    own: tuple[Array, ...]
    onto: tuple[Array | None, ...]
    back: tuple[Array | None, ...]


class Substructures:
    """How a system falls apart into waves and a hub.

    **Arguments:**

    - `groups`: of the motions of its bodies.
    - `size`: number of its degrees of freedom.
    """

    def __init__(self, groups: Sequence[WaveGroup], size: int):
        self.hub, self.size = hub_of(groups, size), size
        kinds = sorted({(group.joined, group.mixed) for group in groups})
        self.joined = [joined for joined, _ in kinds]
        self.mixed = [mixed for _, mixed in kinds]
        self.waves = [_waves([g for g in groups if (g.joined, g.mixed) == kind]) for kind in kinds]

    def parts(self, matrix: Matrix) -> Parts:
        """A real matrix of the system in parts."""
        matrix = matrix.astype(complex)
        onto, back = [], []
        for waves, joined in zip(self.waves, self.joined, strict=True):
            onto.append(waves.rows(matrix[:, self.hub]) if joined else None)
            # The rows of a transposed matrix, their weights conjugate.
            turned = jnp.conj(waves.rows(matrix.T[:, self.hub])) if joined else None
            back.append(None if turned is None else jnp.swapaxes(turned, 1, 2))
        return Parts(
            hub=matrix[self.hub[:, None], self.hub],
            own=tuple(
                waves.matrices(matrix) if mixed else waves.diagonals(matrix)
                for waves, mixed in zip(self.waves, self.mixed, strict=True)
            ),
            onto=tuple(onto),
            back=tuple(back),
        )

    def answers(
        self,
        parts: tuple[Parts, Parts, Parts],
        mesh: tuple[CoordinateMatrix, CoordinateMatrix],
        vectors: Vectors,
        load: Vector,
        frequency: Reals,
    ) -> Array:
        r"""Motion of all degrees of freedom per mesh load, and under another load.

        **Arguments:**

        - `parts`: of mass, rates and stiffness, at one speed and without the mesh.
        - `mesh`: its mean stiffness and damping on its coordinates [N/m, N, N m; by the second].
        - `vectors`: mesh coordinates per motion [-, m].
        - `load`: that other load [N, N m].
        - `frequency`: of the loads [rad/s].

        **Returns:**

        For each frequency a column for each mesh coordinate [m/N, rad/N, rad/(N m)], and one for
        the load [m, rad].
        """
        columns = jnp.concatenate([vectors, load[:, None]], axis=1).astype(complex)
        both = mesh[0].astype(complex), mesh[1].astype(complex)
        of_waves = [waves.rows(columns) for waves in self.waves]
        at = lambda w: self._answer(parts, both, columns, of_waves, w)
        # One by one: a batch of all harmonics would not fit in the processor's own memory.
        return jax.lax.map(at, frequency)

    def _answer(
        self,
        parts: tuple[Parts, Parts, Parts],
        mesh: tuple[Array, Array],
        columns: Array,
        of_waves: list[Array],
        frequency: Scalar,
    ) -> Array:
        """At one frequency; see `answers`."""
        s = jax.lax.complex(jnp.zeros(()), frequency)
        whole = jax.tree.map(lambda m, c, k: s * s * m + s * c + k, *parts)
        mean = mesh[0] + s * mesh[1]
        meet, every = mean.shape[0], columns.shape[1]
        # Of the hub and the mesh, with the waves taken out: motions, then mesh loads, then columns.
        hub, loads = whole.hub, columns[self.hub]
        moved, given = loads[:, :meet].T, jnp.zeros((meet, every), dtype=complex)
        found = []
        for waves, own, onto, back, right in zip(
            self.waves, whole.own, whole.onto, whole.back, of_waves, strict=True
        ):
            asked = right if onto is None else jnp.concatenate([right, onto], axis=2)
            if own.ndim == 2:
                answer = asked / (own + waves.none)[:, :, None]
            else:
                answer = _solved(
                    own + waves.none[:, :, None] * np.eye(own.shape[1], dtype=complex), asked
                )
            found.append(answer)
            met = jnp.einsum("wna,wnb->ab", right[:, :, :meet].conj(), answer)
            given = given + met[:, :every]
            if back is not None:
                borne = jnp.einsum("whn,wnb->hb", back, answer)
                moved, loads = moved - met[:, every:], loads - borne[:, :every]
                hub = hub - borne[:, every:]
        joined = jnp.block(
            [
                [hub, loads[:, :meet]],
                [-mean @ moved, jnp.eye(meet, dtype=complex) + mean @ given[:, :meet]],
            ]
        )
        solved = jnp.linalg.solve(joined, jnp.concatenate([loads, mean @ given]))
        at_hub, pressed = solved[: len(self.hub)], solved[len(self.hub) :]
        motion = jnp.zeros((self.size, every), dtype=complex).at[self.hub].set(at_hub)
        for waves, answer in zip(self.waves, found, strict=True):
            own = answer[:, :, :every] - answer[:, :, :meet] @ pressed
            if answer.shape[2] > every:
                own = own - answer[:, :, every:] @ at_hub
            motion = waves.spread(own, motion)
        return motion
