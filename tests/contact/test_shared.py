"""What one tooth pair gives by the load on the next."""

import equinox as eqx
import jax.numpy as jnp
import pytest
from cases import accessory, exchanged

import jaxgear as jg
from jaxgear import mm


def _bored(pair, *bores):
    where = lambda p: (p.pinion.bore, p.wheel.bore)
    values = tuple(jnp.asarray(bore * mm) for bore in bores)
    return eqx.tree_at(where, pair, values, is_leaf=lambda leaf: leaf is None)


def test_half_planes_share_nothing():
    weber = jg.WeberFoundation()
    teeth = jg.WeberBanaschek(pinion_foundation=weber, wheel_foundation=weber, face_coupling=None)
    assert jg.shared_compliance(accessory(), teeth) == 0.0


@pytest.mark.slow
def test_a_ring_shares_most_of_its_wind_up_whoever_drives():
    """Of the accessory pair 7.2 of 17.8 um that a pair gives alone; a small bore shares more."""
    teeth, pair = jg.WeberBanaschek(face_coupling=None), _bored(accessory(), 30.0, 40.0)
    load = jg.nominal_line_load(pair, jnp.asarray(80.0))
    shared = jg.shared_compliance(pair, teeth)
    alone = 1.0 / jg.single_pair_stiffness(pair, teeth, load)
    assert abs(alone * load / 17.80e-6 - 1.0) < 1e-3
    assert 0.35 < shared / alone < 0.45
    other = jg.shared_compliance(_bored(exchanged(accessory()), 40.0, 30.0), teeth)
    assert abs(other / shared - 1.0) < 1e-9
    assert jg.shared_compliance(_bored(accessory(), 20.0, 30.0), teeth) > 1.3 * shared
