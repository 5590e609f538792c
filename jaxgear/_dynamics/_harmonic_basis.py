r"""Values of harmonics at time steps, and harmonics of what is known there.

Of few harmonics both are matrices. The steps of a cycle are alike in each of its $P$ mesh periods:
at the place $\tau$ of period $p$ harmonic $h$ has the angle $2\pi h(p + \tau)/P$, and of the part
by $p$ the remainder of $h$ by $P$ is enough. So a Fourier transform over the periods, for each
place, and for each remainder a matrix of one mesh period do the same (Cooley and Tukey 1965), $P$
times cheaper.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.sparse.linalg import cg

from jaxgear._dynamics._types import Analysis, Basis, PeriodAnalysis, PeriodValues
from jaxgear._types import Reals, Scalar


class PeriodicBasis(eqx.Module):
    r"""Values of the mean, cosines and sines at the steps of many mesh periods, by `@`.

    **Fields:**

    - `phases`: $e^{ih\tau/P}$ at the places of one mesh period, of each remainder of $h$ by $P$,
        for a derivative times $ih$ and a frequency [-, 1/s].
    - `count`: number of harmonics.
    """

    phases: PeriodValues
    count: int = eqx.field(static=True)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of steps and of terms."""
        periods, places, _ = self.phases.shape
        return periods * places, 2 * self.count + 1

    def __matmul__(self, terms: Reals) -> Reals:
        periods, _, most = self.phases.shape
        sines = jnp.concatenate([jnp.zeros_like(terms[:1]), terms[self.count + 1 :]])
        waves = jax.lax.complex(terms[: self.count + 1], -sines)
        unused = most * periods - waves.shape[0]
        waves = jnp.pad(waves, ((0, unused), (0, 0))).reshape(most, periods, -1)
        # The sum over remainders is an inverse transform without its division.
        values = jnp.fft.ifft(
            jnp.einsum("rsq,qrc->rsc", self.phases, waves), axis=0, norm="forward"
        )
        return jnp.real(values).reshape(-1, terms.shape[1])


class PeriodicAnalysis(eqx.Module):
    r"""Harmonics of what is known at the steps of many mesh periods, by `@`.

    **Fields:**

    - `phases`: $e^{-ih\tau/P}$ times the weight of each place, as of `PeriodicBasis` [-].
    - `count`: number of harmonics.
    """

    phases: PeriodAnalysis
    count: int = eqx.field(static=True)

    def __matmul__(self, values: Reals) -> Reals:
        periods, _, places = self.phases.shape
        parts = jnp.fft.fft(values.reshape(periods, places, -1), axis=0)
        waves = jnp.einsum("rqs,rsc->qrc", self.phases, parts)
        waves = waves.reshape(-1, values.shape[1])[: self.count + 1]
        return jnp.concatenate([jnp.real(waves), -jnp.imag(waves[1:])])


# As a matrix, or in its place over the many mesh periods of a long cycle.
HarmonicValues = Basis | PeriodicBasis
HarmonicAnalysis = Analysis | PeriodicAnalysis


def basis_of(share: Reals, count: int) -> Basis:
    """Values of the mean, cosines and sines.

    **Arguments:**

    - `share`: where they are wanted, in shares of the response [-].
    - `count`: number of harmonics.

    **Returns:**

    A matrix [-].
    """
    angle = 2.0 * jnp.pi * share[:, None] * jnp.arange(1, count + 1, dtype=float)[None, :]
    return jnp.concatenate([jnp.ones((share.size, 1)), jnp.cos(angle), jnp.sin(angle)], axis=1)


def analysis_of(middle: Basis, share: Reals, *, averaged: bool) -> Analysis:
    """Mean, cosines and sines of what is known at the middles of steps.

    Equal steps make it the discrete Fourier transform. Steps of two lengths would let the mean leak
    into the harmonics; with the mean of each harmonic over its step it does not, and the loss in
    that mean is made up for at the mean length of the steps. A mean over steps has that loss too.

    **Arguments:**

    - `middle`: values of the harmonics there [-].
    - `share`: lengths of the steps, in shares of the response [-].
    - `averaged`: whether what is known is a mean over each step.

    **Returns:**

    A matrix [-].
    """
    count = (middle.shape[1] - 1) // 2
    weight = _weights(jnp.arange(1, count + 1, dtype=float), share, share.size, averaged=averaged)
    both = jnp.concatenate([jnp.ones((1, share.size)), weight, weight])
    return both * share[None, :] * middle.T


def _weights(order: Reals, share: Reals, steps: int, *, averaged: bool) -> Reals:
    """Of each step in a harmonic, over its share [-]."""
    loss = jnp.sinc(order / steps)[:, None]
    return 2.0 * jnp.sinc(order[:, None] * share[None, :]) / (loss**2 if averaged else loss)


def periodic_basis(place: Reals, count: int, periods: int) -> PeriodicBasis:
    """As `basis_of`, at steps that are alike in each mesh period.

    **Arguments:**

    - `place`: where values are wanted, in mesh periods, of the first of them [-].
    - `count`: number of harmonics.
    - `periods`: number of mesh periods.

    **Returns:**

    What takes the place of the matrix.
    """
    order = _by_remainder(count, periods)
    angle = 2.0 * jnp.pi / periods * order[:, None, :] * place[None, :, None]
    return PeriodicBasis(jax.lax.complex(jnp.cos(angle), jnp.sin(angle)), count)


def _by_remainder(count: int, periods: int) -> Reals:
    """Harmonics up to a count and some that are not used, by remainder and multiple [-]."""
    order = jnp.arange((count // periods + 1) * periods, dtype=float)
    return order.reshape(-1, periods).T


def periodic_analysis(middle: PeriodicBasis, share: Reals, *, averaged: bool) -> PeriodicAnalysis:
    """As `analysis_of`, at steps that are alike in each mesh period.

    **Arguments:**

    - `middle`: values of the harmonics at the middles of steps [-].
    - `share`: lengths of the steps of one mesh period, in shares of the response [-].
    - `averaged`: whether what is known is a mean over each step.

    **Returns:**

    What takes the place of the matrix.
    """
    periods, places, _ = middle.phases.shape
    order = _by_remainder(middle.count, periods).reshape(-1)
    weight = _weights(order, share, periods * places, averaged=averaged)
    weight = jnp.where(order[:, None] > 0.0, weight, 1.0) * share[None, :]
    phases = jnp.conj(jnp.moveaxis(middle.phases, 1, 2))
    phases = phases * weight.reshape(phases.shape).astype(complex)
    return PeriodicAnalysis(phases, middle.count)


def rates_of(values: HarmonicValues, base: Scalar) -> HarmonicValues:
    """Time derivative of each term.

    **Arguments:**

    - `values`: of the harmonics [-].
    - `base`: frequency of the first of them [rad/s].

    **Returns:**

    The same of their derivatives [1/s].
    """
    if isinstance(values, PeriodicBasis):
        order = base * _by_remainder(values.count, values.phases.shape[0])
        turned = values.phases * jax.lax.complex(jnp.zeros_like(order), order)[:, None, :]
        return dataclasses.replace(values, phases=turned)
    count = (values.shape[1] - 1) // 2
    order = base * jnp.arange(1, count + 1, dtype=float)[None, :]
    cosines, sines = values[:, 1 : count + 1], values[:, count + 1 :]
    return jnp.concatenate([jnp.zeros_like(values[:, :1]), -order * sines, order * cosines], axis=1)


def as_matrix(values: HarmonicValues) -> Basis:
    """Values of the harmonics as a matrix, which of long cycles is large [-, 1/s]."""
    return values @ jnp.eye(values.shape[1]) if isinstance(values, PeriodicBasis) else values


def closest_terms(values: HarmonicValues, weight: Reals, known: Reals) -> Reals:
    """Terms whose values are closest to what is known at the steps, by least squares.

    **Arguments:**

    - `values`: of the terms [-].
    - `weight`: of each step [-].
    - `known`: at the steps, in columns.

    **Returns:**

    The terms, in columns.
    """
    if not isinstance(values, PeriodicBasis):
        weighted = values.T * weight[None, :]
        return jnp.linalg.solve(weighted @ values, weighted @ known)
    # Equal steps make the matrix diagonal, and with these scales the unit matrix.
    scale = jnp.full((values.shape[1], 1), jnp.sqrt(2.0)).at[0].set(1.0)
    product = lambda terms: values @ (scale * terms)
    none = jax.ShapeDtypeStruct((values.shape[1], known.shape[1]), known.dtype)
    back = lambda found: jax.linear_transpose(product, none)(weight[:, None] * found)[0]
    found, _ = cg(lambda terms: back(product(terms)), back(known), tol=1e-13)
    return scale * found
