import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from scipy.integrate import quad

import jaxgear as jg
from jaxgear import um

_WIDTH = 0.5 * um
_OVERLAP = np.linspace(-3.0, 3.0, 601) * um
_LAWS = [jg.ExactContact(), jg.SmoothContact(_WIDTH)]
every_law = pytest.mark.parametrize("law", _LAWS, ids=lambda law: type(law).__name__)


@eqx.filter_jit
def _of(law: jg.AbstractContactLaw, overlap: jax.Array):
    """Compression, energy and their slopes, of one program for a law."""
    slope = lambda function: jnp.vectorize(jax.grad(function))(overlap)
    compression, energy = law.compression(overlap), law.energy(overlap)
    return compression, energy, slope(law.compression), slope(law.energy)


def _compressed(law: jg.AbstractContactLaw, microns: float) -> float:
    return float(_of(law, jnp.asarray(microns * um))[0]) / um


@pytest.mark.parametrize(
    ("law", "overlap", "compression"),
    [
        (jg.ExactContact(), 2.0, 2.0),
        (jg.ExactContact(), 0.0, 0.0),
        (jg.ExactContact(), -2.0, 0.0),
        (jg.SmoothContact(_WIDTH), 2.0, 2.0),
        (jg.SmoothContact(_WIDTH), 0.5, 0.5),
        # 3/16 of the width.
        (jg.SmoothContact(_WIDTH), 0.0, 0.09375),
        # 0.5 x 1.5^3 x 2.5/16
        (jg.SmoothContact(_WIDTH), 0.25, 0.263671875),
        (jg.SmoothContact(_WIDTH), -0.5, 0.0),
        (jg.SmoothContact(_WIDTH), -2.0, 0.0),
    ],
)
def test_compression_by_hand(law, overlap, compression):
    assert abs(_compressed(law, overlap) - compression) < 1e-12


@every_law
def test_cells_push_only_and_ever_harder(law):
    """Never a pull, never softer as the overlap grows (a convex energy), stiffness at most 1."""
    found = np.asarray(_of(law, jnp.asarray(_OVERLAP))[0])
    assert found.min() == 0.0
    slope = np.diff(found) / np.diff(_OVERLAP)
    assert slope.min() >= 0.0
    assert slope.max() <= 1.0 + 1e-9
    assert (np.diff(slope) >= -1e-9).all()


@every_law
@pytest.mark.parametrize("overlap", [-1.0, -0.2, 0.0, 0.3, 0.5, 2.0])
def test_energy_is_the_integral_of_the_compression(law, overlap):
    corners = [x for x in (-0.5, 0.0, 0.5) if x < overlap]
    integral = quad(lambda x: _compressed(law, x), -1.0, overlap, points=corners, epsabs=1e-14)[0]
    energy = float(_of(law, jnp.asarray(overlap * um))[1]) / um**2
    assert abs(energy - integral) < 1e-12


@every_law
def test_compression_is_the_slope_of_the_energy(law):
    apart = np.abs(_OVERLAP) > 1e-9
    compression, _, _, slope = (np.asarray(x)[apart] for x in _of(law, jnp.asarray(_OVERLAP)))
    assert_close(slope, compression, rtol=1e-12, atol=1e-18)


def test_smooth_contact_is_exact_away_from_separation():
    away = np.abs(_OVERLAP) > 1.0001 * _WIDTH
    exact, smooth = (np.asarray(_of(law, jnp.asarray(_OVERLAP))[0])[away] for law in _LAWS)
    assert_close(smooth, exact, rtol=1e-14, atol=1e-21)


def test_smooth_contact_has_a_continuous_stiffness():
    """The exact law's slope jumps from 0 to 1; this one's bends no more than 3/(4 w)."""
    slope = np.asarray(_of(_LAWS[1], jnp.asarray(_OVERLAP))[2])
    step = float(np.max(np.abs(np.diff(slope))))
    assert step <= 0.75 / _WIDTH * 0.0101 * um
    assert (float(slope[0]), float(slope[-1])) == (0.0, 1.0)


@every_law
def test_gradients(law):
    overlap = jnp.asarray([-1.0, -0.3, 0.2, 0.4, 2.0]) * um

    def mixed(argument):
        own, x = argument
        return jnp.sum(own.compression(x)) / um + 1.7 * jnp.sum(own.energy(x)) / um**2

    assert_gradient(mixed, (law, overlap), rtol=1e-6)


def test_the_width_is_a_leaf():
    assert len(jax.tree.leaves(eqx.filter(_LAWS[1], eqx.is_inexact_array))) == 1
    assert jax.tree.leaves(_LAWS[0]) == []


@pytest.mark.parametrize("width", [0.0, -1e-7, np.nan])
def test_no_width_is_refused(width):
    with pytest.raises(ValueError, match=r"`SmoothContact.width` must be positive, got .* m\."):
        jg.SmoothContact(width)
