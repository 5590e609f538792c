r"""Residual shapes: how the rest of a body answers loads on the flanks, as shapes in space.

A body vibrates on few of its shapes. What all others give follows its load at once, without
inertia, which is the largest error of what is left out: at half the frequency of a shape it gives a
third more than that. But loads act at one place in space, and their static answers are few, though
they take part of hundreds of shapes that turn with the body. These answers, the residual vectors of
component mode synthesis (MacNeal 1971, Craig and Kurdila 2006, 17.5), are added to the shapes. They
stand still in space while the body turns beneath them: with $J$ of all modes, $J R$ is how such
shapes change as it turns, and it is no combination of them (theory 8.16).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._types import Reals, as_reals

# Waves of fewer nodal diameters move the seats, and are left to the shapes.
_LEAST_DIAMETERS = 2

# Answers smaller than this, of all, are rounding.
_NOISE = 1e-8

# So many times more combinations of answers than shapes, and how often they are improved: sizes
# fall by a decade over a few shapes, and are found to rounding.
_MORE, _ITERATIONS = 4, 6


class ResidualShapes(eqx.Module):
    r"""Motion of the feet by residual shapes, by the waves that they are made of.

    Of the wave number $w$, at the angle $\theta$ between the body and the coordinates in space, a
    foot moves by $\cos w\theta\,c_w - \sin w\theta\,s_w$ in its frame.

    **Fields:**

    - `rows`: $c_w$, then $s_w$ [kg^-1/2, m^-1 kg^-1/2].
    - `waves`: $w$.
    """

    rows: Float[Array, "period part component cell wave shape"]
    waves: tuple[int, ...] = eqx.field(static=True)

    def arms(self, period: Array, weights: list[Array], turned: Reals) -> Array:
        """Approach of cells per motion of the shapes, `[phase, cell, shape]` [kg^-1/2].

        **Arguments:**

        - `period`: of the table.
        - `weights`: approach per motion of a foot's components, `[phase, cell]` each.
        - `turned`: angle by which the waves are ahead, `[phase]` [rad].
        """
        angle = turned[:, None] * jnp.asarray(self.waves, dtype=float)[None, :]
        cosine, sine = self.rows[period]
        at = lambda wave, rows: jnp.einsum("pw,cwk->pck", wave, rows)
        return sum(
            (
                weight[:, :, None] * (at(jnp.cos(angle), c) - at(jnp.sin(angle), s))
                for weight, c, s in zip(weights, cosine, sine, strict=True)
            ),
            jnp.zeros(()),
        )


class Residual(NamedTuple):
    """Residual shapes as combinations of modes.

    **Fields:**

    - `into`: of unit mass, and apart in stiffness from each other and from the shapes that are
        kept, `[mode, shape]` [-].
    - `square`: of their angular frequencies [rad2/s2].
    """

    into: np.ndarray
    square: np.ndarray

    def waves(self, number: np.ndarray) -> tuple[int, ...]:
        """Wave numbers that the shapes are made of, rising.

        **Arguments:**

        - `number`: of the modes, from `wave_partners`.
        """
        apart = np.unique(np.abs(number[np.any(self.into != 0.0, axis=1)]))
        return tuple(int(wave) for wave in apart)

    def parts(self, partner: np.ndarray, number: np.ndarray) -> np.ndarray:
        """Of each wave that the shapes are made of its part of each shape.

        **Arguments:**

        - `partner`, `number`: of the modes, from `wave_partners`.

        **Returns:**

        Pairs that turn into each other as modes of that wave do, the first of them what is in the
        shape, `[wave, mode, shape, 2]` [-].
        """
        alike = np.abs(number)[None, :] == np.array(self.waves(number))[:, None]
        own = alike[:, :, None] * self.into[None]
        turned = (np.sign(number)[None, :, None] * own)[:, partner]
        return np.stack([own, turned], axis=3)

    def rows(self, rows: np.ndarray, waves: tuple[int, ...]) -> ResidualShapes:
        """The motion of feet.

        **Arguments:**

        - `rows`: of their parts, `[period, component, cell, part]`, by wave, shape and of a pair.
        - `waves`: that they are made of.
        """
        apart = rows.reshape(*rows.shape[:3], len(waves), len(self.square), 2)
        return ResidualShapes(as_reals(np.moveaxis(apart, -1, 1)), waves)


def residual_shapes(
    square: np.ndarray,
    waves: np.ndarray,
    diameters: np.ndarray,
    kept: np.ndarray,
    loads: np.ndarray,
    among: np.ndarray,
    count: int,
) -> Residual:
    r"""The residual shapes that move most, in strain energy, under loads on the flanks.

    With $\Lambda$ the squares and $Q$ what is kept, they span the first singular vectors of
    $\Lambda^{-1}L^T$ less its part in $Q$, both measured by $\Lambda$.

    **Arguments:**

    - `square`, `waves`, `diameters`: of the modes.
    - `kept`: $Q$, shapes on which the body vibrates, `[mode, shape]`.
    - `loads`: $L$, loads on the modes, `[load, mode]` [kg^-1/2].
    - `among`: modes that they may be made of, `[mode]`.
    - `count`: number of residual shapes.

    **Returns:**

    They; fewer if all answers are combinations of fewer.
    """
    root = np.sqrt(square)
    turns = (np.abs(waves) >= _LEAST_DIAMETERS) & (diameters >= _LEAST_DIAMETERS)
    turns &= among
    answers = ((loads / root) * turns).T
    ours = np.linalg.qr(root[:, None] * kept)[0]
    size = np.linalg.norm(answers)
    # Twice, so that what is left is apart from what is kept to the last digit.
    for _ in range(2):
        answers = answers - ours @ (ours.T @ answers)
    few = _largest(answers, count, float(_NOISE * size))
    into = few / root[:, None] * turns[:, None]
    values, turn = np.linalg.eigh(into.T @ into)
    order = np.argsort(-values)
    values, turn = values[order], turn[:, order]
    return Residual(into @ turn / np.sqrt(values), 1.0 / values)


def beside(one: Residual, other: Residual) -> Residual:
    """Residual shapes of some modes and of others, which are apart."""
    into = np.concatenate([one.into, other.into], axis=1)
    return Residual(into, np.concatenate([one.square, other.square]))


def _largest(answers: np.ndarray, count: int, least: float) -> np.ndarray:
    """The first left singular vectors, of sizes above the least.

    By subspace iteration from random combinations of the answers (Halko, Martinsson and Tropp
    2011): over a cycle of many mesh periods there are thousands of loads, and all of their singular
    vectors take a minute.
    """
    start = np.random.default_rng(0).standard_normal((answers.shape[1], _MORE * count))
    among = np.linalg.qr(answers @ start)[0]
    for _ in range(_ITERATIONS):
        among = np.linalg.qr(answers @ (answers.T @ among))[0]
    vectors, sizes, _ = np.linalg.svd(among.T @ answers, full_matrices=False)
    return among @ vectors[:, :count][:, sizes[:count] > least]
