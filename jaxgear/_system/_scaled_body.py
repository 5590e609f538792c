"""A condensed body of another material: elasticity and density scale what was condensed once.

All stiffness of a body is in proportion to Young's modulus, all mass, and all that rotation brings,
to its density: stresses of rotation do not know the modulus, and stress stiffening is the
density's too. Seats that are rigid or averaged have no stiffness of their own, and shapes that
solve an eigenproblem solve it for any factors of its two matrices: nothing is left to condense.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._system._body_heat import BodyHeat
from jaxgear._system._body_modes import BodyModes
from jaxgear._system._flexible import FlexibleBody
from jaxgear._types import Scalar


def scaled_body(
    body: FlexibleBody, *, young: Scalar | float = 1.0, density: Scalar | float = 1.0
) -> FlexibleBody:
    r"""The same body of a stiffer or denser material, exactly (theory 12.3).

    With $e = E'/E$ and $r = \varrho'/\varrho$: compliances change by $1/e$, growth by rotation by
    $r/e$, by heat not at all, stiffness between seats and loads of heat by $e$, loads of rotation
    by $r$, squares of frequencies by $e/r$, and modes of unit modal mass by $1/\sqrt r$. Poisson's
    ratio stays: nothing scales with it. What the condensed body contains scales too, its shaft if
    it has one; bearings do not. The teeth's own bending and the contact are of the gear's material,
    which is not here.

    **Arguments:**

    - `body`: as `flexible_body` made it.
    - `young`: new Young's modulus over the old one, $e$ [-].
    - `density`: new density over the old one, $r$, of teeth laid on the rim too [-].

    **Returns:**

    The body; differentiable by both ratios.

    **Raises:**

    - `ValueError` if a ratio is not positive.
    """
    for name, ratio in (("young", young), ("density", density)):
        require(
            jnp.asarray(ratio) > 0.0,
            "`{name}` of `scaled_body` must be a ratio above 0, new over old, got {got:.6g}.",
            name=name,
            got=ratio,
        )
    return _scaled(body, jnp.asarray(young, dtype=float), jnp.asarray(density, dtype=float))


@compiled
def _scaled(body: FlexibleBody, stiffer: Scalar, denser: Scalar) -> FlexibleBody:
    return eqx.tree_at(
        lambda b: (b.flexibility, b.growth, b.seat_stiffness, b.seat_load, b.modes, b.heat),
        body,
        (
            body.flexibility / stiffer,
            body.growth * (denser / stiffer),
            body.seat_stiffness * stiffer,
            body.seat_load * denser,
            None if body.modes is None else _scaled_modes(body.modes, stiffer, denser),
            None if body.heat is None else _scaled_heat(body.heat, stiffer),
        ),
        is_leaf=lambda x: x is None,
    )


def _scaled_heat(heat: BodyHeat, stiffer: Scalar) -> BodyHeat:
    return dataclasses.replace(heat, seats=heat.seats * stiffer)


def _scaled_modes(modes: BodyModes, stiffer: Scalar, denser: Scalar) -> BodyModes:
    """The modes: unit modal mass stays, so that their shapes take the root of the density."""
    root = jnp.sqrt(denser)
    # Of seats and modes: what is between two seats takes all of the density, and two roots.
    each = jnp.where(jnp.arange(modes.mass.shape[0]) < modes.seat_dofs, root, 1.0)
    # Stress stiffening has no rows for what residual shapes become.
    inertia = lambda matrix: each[: len(matrix), None] * matrix * each[None, : len(matrix)]
    of_rotation: list[Array | None] = [
        None if matrix is None else inertia(matrix) for matrix in (modes.coriolis, modes.softening)
    ]
    residual = modes.residual
    if residual is not None:
        residual = dataclasses.replace(residual, rows=residual.rows / root)
    return eqx.tree_at(
        lambda m: (
            *(m.square, m.rows, m.load, m.heat, m.mass, m.coriolis),
            *(m.softening, m.residual),
        ),
        modes,
        (
            modes.square * (stiffer / denser),
            modes.rows / root,
            modes.load * root,
            None if modes.heat is None else modes.heat * (stiffer / root),
            inertia(modes.mass),
            *of_rotation,
            residual,
        ),
        is_leaf=lambda x: x is None,
    )
