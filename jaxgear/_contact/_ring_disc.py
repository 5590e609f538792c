"""The singular share of a ring's root influence: a solid disc's, in closed form."""

import functools
from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._types import Reals, Scalar

if TYPE_CHECKING:
    Influences = Array
    Tractions = Array
    Kernels = Array
else:
    Influences = Float[Array, "neighbour displacement resultant"]
    Tractions = Float[Array, "node resultant component"]
    Kernels = Float[Array, "neighbour place node"]

# Gauss points on a tooth's root, an even number. They integrate cos(n theta) to rounding up to
# n theta_f = 15, and leave 4e-6 of a tooth's own influence in its neighbour's where two roots
# touch, 1e-12 where the gap is a twentieth of a pitch.
ROOT_NODES = 24


# --- integrals over a root


class _Rule(NamedTuple):
    """Weights that integrate over a root what its node values say, places in rows.

    A place is where the displacement is looked at. `plain`, `log`, `sign` go with the kernels 1,
    ln|x - y| and sign(x - y), x the place and y the node, both from -1 to 1, and are exact for
    node values of a polynomial. With as many places as nodes they also integrate over x.
    """

    places: np.ndarray
    plain: np.ndarray
    log: np.ndarray
    sign: np.ndarray


class _Legendre(NamedTuple):
    """Gauss nodes, their weights, and the map from node values to Legendre coefficients."""

    nodes: np.ndarray
    weights: np.ndarray
    coefficients: np.ndarray


@functools.cache
def gauss_legendre() -> _Legendre:
    """Nodes and weights across a root, and what turns node values into Legendre coefficients."""
    nodes, weights = np.polynomial.legendre.leggauss(ROOT_NODES)
    values = np.polynomial.legendre.legvander(nodes, ROOT_NODES - 1).T
    degree = np.arange(ROOT_NODES)[:, None]
    return _Legendre(nodes, weights, (degree + 0.5) * values * weights)


def _mean_rule() -> _Rule:
    """Over both roots: Legendre's polynomials against each other."""
    basis = gauss_legendre()
    m, n = np.meshgrid(*2 * [np.arange(float(ROOT_NODES))], indexing="ij")
    apart, both = m - n, m + n
    even = both % 2 == 0
    both[0, 0] = 1.0
    log = np.where(even, 8.0 / (np.where(even, apart**2 - 1.0, 1.0) * both * (both + 2.0)), 0.0)
    log[0, 0] = 4.0 * np.log(2.0) - 6.0
    sign = np.where(np.abs(apart) == 1.0, 4.0 * apart / ((2.0 * m + 1.0) * (2.0 * n + 1.0)), 0.0)
    transform = basis.coefficients
    return _Rule(
        places=basis.nodes,
        plain=np.outer(basis.weights, basis.weights),
        log=transform.T @ log @ transform,
        sign=transform.T @ sign @ transform,
    )


def _values_at_zero() -> np.ndarray:
    """Legendre's polynomials at zero, one degree more than a root's values fill."""
    return np.polynomial.legendre.legvander(np.zeros(1), ROOT_NODES)[0]


def _point_rule() -> _Rule:
    """Seen from the middle of the root."""
    basis = gauss_legendre()
    second = np.zeros(ROOT_NODES + 1)  # Legendre's functions of the second kind at zero.
    second[1] = -1.0
    for degree in range(2, ROOT_NODES, 2):
        second[degree + 1] = -degree / (degree + 1.0) * second[degree - 1]
    values = _values_at_zero()
    rise = 2.0 / (2.0 * np.arange(1.0, ROOT_NODES) + 1.0)
    log = np.concatenate([[-2.0], rise * (second[2:] - second[:-2])])
    log[1::2] = 0.0
    sign = np.concatenate([[0.0], rise * (values[2:] - values[:-2])])
    return _Rule(
        places=np.zeros(1),
        plain=basis.weights[None],
        log=(log @ basis.coefficients)[None],
        sign=(sign @ basis.coefficients)[None],
    )


# --- the solid disc in closed form


class _Disc(NamedTuple):
    """Angles from node to place, and the weighted kernels 1, ln|2 sin| and sawtooth there."""

    angle: Kernels
    plain: Kernels
    log: Kernels
    saw: Kernels


def _disc(rule: _Rule, root_half_angle: Scalar, shifts: Reals) -> _Disc:
    """Kernels between a loaded root and one `shifts` away; the first shift is zero."""
    apart = np.asarray(rule.places)[:, None] - gauss_legendre().nodes[None]
    angle = shifts[:, None, None] + root_half_angle * jnp.asarray(apart)[None]
    plain = jnp.asarray(rule.plain)[None]
    own, far = angle[:1], angle[1:]
    smooth = jnp.log(root_half_angle) + jnp.log(jnp.sinc(own / (2.0 * jnp.pi)))
    own_log = jnp.asarray(rule.log)[None] + plain * smooth
    own_saw = 0.5 * (jnp.pi * jnp.asarray(rule.sign)[None] - plain * own)
    far_log = plain * jnp.log(jnp.abs(2.0 * jnp.sin(0.5 * far)))
    far_saw = plain * 0.5 * (jnp.pi - jnp.mod(far, 2.0 * jnp.pi))
    return _Disc(
        angle=angle,
        plain=jnp.broadcast_to(plain, angle.shape),
        log=jnp.concatenate([own_log, far_log]),
        saw=jnp.concatenate([own_saw, far_saw]),
    )


def _disc_kernel(disc: _Disc, kolosov: Scalar) -> tuple[Kernels, Kernels]:
    r"""Displacements $(u_r, u_\theta)$ under a unit radial force, orders above one, times $2G$.

    Per order the disc obeys $u_m = \kappa p_m/(m+1)$, $u_{-m} = p_{-m}/(m-1)$ in $u_r + iu_\theta$,
    and $\sum z^m/m = -\ln(1 - z)$. A tangential force turns both by a right angle.
    """
    sine, cosine = jnp.sin(disc.angle), jnp.cos(disc.angle)
    strong, weak = kolosov + 1.0, kolosov - 1.0
    rest = kolosov * disc.plain
    along = -strong * disc.log * cosine + weak * disc.saw * sine - rest * (1.0 + 0.5 * cosine)
    across = strong * disc.log * sine + weak * disc.saw * cosine - rest * 0.5 * sine
    scale = 0.5 / jnp.pi
    return scale * along, scale * across


def _disc_slopes(disc: _Disc, kolosov: Scalar, impulse: Kernels) -> tuple[Kernels, Kernels]:
    """Derivatives of `_disc_kernel` by the place; `impulse` is the sign's, halved.

    The pole of the cotangent at the middle of the root is a principal value, which Gauss nodes
    that lie symmetrically about it take exactly.
    """
    sine, cosine = jnp.sin(disc.angle), jnp.cos(disc.angle)
    strong, weak = kolosov + 1.0, kolosov - 1.0
    pole = 0.5 * disc.plain / jnp.tan(0.5 * disc.angle)
    rest = 0.5 * kolosov * disc.plain
    along = strong * (disc.log * sine - pole * cosine) + rest * sine
    along += weak * (disc.saw * cosine - 0.5 * disc.plain * sine)
    across = strong * (disc.log * cosine + pole * sine) - rest * cosine
    across += weak * (jnp.pi * impulse - 0.5 * disc.plain * cosine - disc.saw * sine)
    scale = 0.5 / jnp.pi
    return scale * along, scale * across


def disc_mean(
    tractions: Tractions, root_half_angle: Scalar, kolosov: Scalar, shifts: Reals
) -> Influences:
    """The disc's share in the displacements weighted as the tractions are."""
    along, across = _disc_kernel(_disc(_mean_rule(), root_half_angle, shifts), kolosov)
    radial, tangential = tractions[..., 0], tractions[..., 1]
    straight = jnp.einsum("kab,bj->kaj", along, radial)
    straight -= jnp.einsum("kab,bj->kaj", across, tangential)
    sideways = jnp.einsum("kab,bj->kaj", across, radial)
    sideways += jnp.einsum("kab,bj->kaj", along, tangential)
    return jnp.einsum("ai,kaj->kij", radial, straight) + jnp.einsum(
        "ai,kaj->kij", tangential, sideways
    )


def disc_point(
    tractions: Tractions, root_half_angle: Scalar, kolosov: Scalar, shifts: Reals
) -> Influences:
    """The disc's share in the displacements of the root point."""
    disc = _disc(_point_rule(), root_half_angle, shifts)
    at_zero = _values_at_zero()[:-1] @ gauss_legendre().coefficients
    own = np.asarray(np.arange(shifts.shape[0]) == 0, dtype=float)
    impulse = jnp.asarray(own[:, None, None] * at_zero) / root_half_angle
    along, across = _disc_kernel(disc, kolosov)
    slope, side_slope = _disc_slopes(disc, kolosov, impulse)
    under_radial = jnp.concatenate([along, across, across - slope], axis=1)
    under_tangential = jnp.concatenate([-across, along, along + side_slope], axis=1)
    return jnp.einsum("kib,bj->kij", under_radial, tractions[..., 0]) + jnp.einsum(
        "kib,bj->kij", under_tangential, tractions[..., 1]
    )
