r"""Boundary elements of plane strain: displacements along an outline by tractions on it.

Somigliana's identity $c\,u_i(x) + \int T_{ij}u_j\,ds = \int U_{ij}t_j\,ds$ with Kelvin's solutions

$U_{ij} = \frac{1}{8\pi\mu(1-\nu)}[-(3-4\nu)\ln r\,\delta_{ij} + r_{,i}r_{,j}]$ and
$T_{ij} = \frac{-1}{4\pi(1-\nu)r}\{r_{,n}[(1-2\nu)\delta_{ij} + 2r_{,i}r_{,j}] -
(1-2\nu)(r_{,i}n_j - r_{,j}n_i)\}$ (Brebbia, Telles & Wrobel 1984, Boundary Element Techniques,
section 5), is met at the three Gauss points of each element, which carry a quadratic: corners and
jumps of the traction then need no care, and the free terms $c$ follow from rigid motion. Lengths
are in any unit, tractions in units of the shear modulus $\mu$.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._geometry._outline import Piece
from jaxgear._types import Reals, Scalar

# Nodes of an element, and the weights with which they integrate over its [-1, 1].
NODES = np.sqrt(0.6) * np.asarray([-1.0, 0.0, 1.0])
WEIGHTS = np.asarray([5.0, 8.0, 5.0]) / 9.0
# Where the derivative of the quadratic is most exact.
SLOPE_PLACES = np.asarray([-1.0, 1.0]) / np.sqrt(3.0)
# The nearest node of the next element is 0.23 half-lengths off: 12 points leave 1e-6 there.
_POINTS, _POINT_WEIGHTS = np.polynomial.legendre.leggauss(12)


def _own_places() -> tuple[np.ndarray, np.ndarray]:
    """Where an element is integrated for each of its own nodes, shape `[node, place]`, and weights.

    Cubic from the node to either end: it takes the logarithm of the kernel away.
    """
    point, weight = np.polynomial.legendre.leggauss(8)
    point, weight = 0.5 * (point + 1.0), 0.5 * weight
    ways = np.asarray([-1.0, 1.0]) - NODES[:, None]
    places = NODES[:, None, None] + ways[..., None] * point**3
    weights = np.abs(ways)[..., None] * (3.0 * point**2 * weight)
    return places.reshape(3, -1), weights.reshape(3, -1)


_OWN, _OWN_WEIGHTS = _own_places()


class Sampled(NamedTuple):
    """Points of all elements of an outline.

    **Fields:**

    - `point`: shape `[element, place, 2]`.
    - `slope`: derivative of the point by the place within the element, the same shape.
    """

    point: Array
    slope: Array

    @property
    def stretch(self) -> Array:
        """Length per place within the element, shape `[element, place]`."""
        return jnp.sqrt(jnp.sum(self.slope**2, axis=-1))

    @property
    def tangent(self) -> Array:
        """Unit vectors on the way round."""
        return self.slope / self.stretch[..., None]

    @property
    def normal(self) -> Array:
        """Outward unit normals; the body lies on the left of the way round."""
        tangent = self.tangent
        return jnp.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)


class Boundary(NamedTuple):
    """An outline at all places of its elements that are looked at.

    **Fields:**

    - `nodes`: at the three nodes.
    - `slopes`: at `SLOPE_PLACES`.
    - `points`: of integration.
    - `own`: of integration for each node of the element itself, one after the other.
    """

    nodes: Sampled
    slopes: Sampled
    points: Sampled
    own: Sampled


def boundary(pieces: tuple[Piece, ...]) -> Boundary:
    """Look at an outline at all places of its elements.

    **Arguments:**

    - `pieces`: the outline.
    """
    kinds = (NODES, SLOPE_PLACES, _POINTS, _OWN.ravel())
    # All places at once, and all pieces of one curve: it is compiled once.
    places, found = np.concatenate(kinds), {}
    for curve in dict.fromkeys(piece.curve for piece in pieces):
        alike = [number for number, piece in enumerate(pieces) if piece.curve is curve]
        first = jnp.concatenate([pieces[number].edges[:-1] for number in alike])[:, None]
        last = jnp.concatenate([pieces[number].edges[1:] for number in alike])[:, None]
        at = 0.5 * (first + last) + 0.5 * (last - first) * places[None]
        point, slope = jax.jvp(curve, (at,), (jnp.ones_like(at),))
        parts = np.cumsum([pieces[number].elements for number in alike])[:-1]
        both = jnp.split(point, parts), jnp.split(slope * (0.5 * (last - first))[..., None], parts)
        found |= dict(zip(alike, zip(*both, strict=True), strict=True))
    ordered = ([part @ piece.frame for part in found[i]] for i, piece in enumerate(pieces))
    points, slopes = map(jnp.concatenate, zip(*ordered, strict=True))
    ends = np.cumsum([kind.size for kind in kinds])[:-1]
    split = lambda values: jnp.split(values, ends, axis=1)
    return Boundary(*map(Sampled, split(points), split(slopes)))


def shapes(places: np.ndarray, derivative: int = 0) -> np.ndarray:
    """The quadratics of an element's nodes or their derivatives, shape `[place, node]`.

    **Arguments:**

    - `places`: within an element, from -1 to 1.
    - `derivative`: 0 or 1.
    """
    columns = []
    for node in range(3):
        shape = np.polynomial.Polynomial.fromroots(np.delete(NODES, node))
        columns.append((shape / shape(NODES[node])).deriv(derivative)(places))
    return np.stack(columns, axis=-1)


def boundary_matrices(outline: Boundary, poisson: Scalar) -> tuple[Array, Array]:
    r"""$H u = G t$ between displacements and tractions at the nodes of an outline.

    **Arguments:**

    - `outline`: closed.
    - `poisson`: $\nu$ [-].

    **Returns:**

    $H$ and $G$, shape `[node, 2, node, 2]`; nodes go round with three on each element.
    """
    nodes, places = outline.nodes.point, outline.points
    elements, count = nodes.shape[0], 3 * nodes.shape[0]
    apart = places.point[None] - nodes.reshape(count, 1, 1, 2)
    by_traction, by_motion = _kelvin(apart, places.normal[None], poisson)
    weight = places.stretch[..., None] * (_POINT_WEIGHTS[:, None] * shapes(_POINTS))[None]
    sums = lambda kernel: jnp.einsum("neqij,eqk->niekj", kernel, weight)
    motion = sums(by_motion).reshape(count, 2, count, 2)
    traction = sums(by_traction).reshape(elements, 3, 2, elements, 3, 2)
    own = np.arange(elements)
    # Here the kernel is a logarithm.
    traction = traction.at[own, :, :, own].set(_own_tractions(outline, poisson))
    every = np.arange(count)
    # Rigid motion takes no tractions: it gives the free terms and the principal values.
    motion = motion.at[every, :, every, :].set(0.0)
    motion = motion.at[every, :, every, :].set(-jnp.sum(motion, axis=2))
    return motion, traction.reshape(count, 2, count, 2)


def _own_tractions(outline: Boundary, poisson: Scalar) -> Array:
    """$G$ of the nodes of each element among themselves, shape `[element, node, 2, node, 2]`."""
    nodes, places = outline.nodes.point, outline.own
    shape = (*nodes.shape[:2], -1, 2)
    kernel, _ = _kelvin(
        places.point.reshape(shape) - nodes[:, :, None], places.normal.reshape(shape), poisson
    )
    stretch = places.stretch.reshape(shape[:-1])[..., None]
    weighted = stretch * (_OWN_WEIGHTS[..., None] * shapes(_OWN))[None]
    return jnp.einsum("enqij,enqk->enikj", kernel, weighted)


def _kelvin(apart: Reals, normal: Reals, poisson: Scalar) -> tuple[Array, Array]:
    """Kernels of tractions and of displacements, at vectors from the node."""
    squared = jnp.sum(apart**2, axis=-1)[..., None, None]
    along = apart / jnp.sqrt(squared[..., 0])
    both = along[..., :, None] * along[..., None, :]
    unit = np.eye(2).reshape((1,) * (apart.ndim - 1) + (2, 2))
    scale = 8.0 * jnp.pi * (1.0 - poisson)
    by_traction = (both - (1.5 - 2.0 * poisson) * jnp.log(squared) * unit) / scale
    across = jnp.sum(along * normal, axis=-1)[..., None, None]
    skew = along[..., :, None] * normal[..., None, :]
    skew = skew - jnp.swapaxes(skew, -1, -2)
    inner = across * ((1.0 - 2.0 * poisson) * unit + 2.0 * both) - (1.0 - 2.0 * poisson) * skew
    return by_traction, -2.0 * inner / (scale * jnp.sqrt(squared))
