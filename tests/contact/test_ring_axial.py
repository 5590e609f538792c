"""A ring under axial loads of helical teeth, against closed forms and 3-D finite elements."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close

import jaxgear as jg
from jaxgear import deg, mm
from jaxgear._contact._face_cells import face_cells
from jaxgear._contact._ring_axial import plate_influence, shear_influence
from jaxgear._contact._shared_body import where_helical


def _real(value: float):
    return jnp.asarray(value)


def _shapes(ratio: float = 2.1, half: float = 0.09) -> dict:
    return {
        "radius_ratio": _real(ratio),
        "root_half_angle": _real(half),
        "poisson": _real(0.3),
        "pitch_angle": _real(2.0 * math.pi / 24),
        "neighbours": 23,
    }


_PLATE = eqx.filter_jit(plate_influence)


def test_loads_on_all_teeth_shear_the_ring_as_a_tube():
    r"""$u = \frac{F}{2\pi G b}\ln h$ under loads that are even around it."""
    each = np.asarray(eqx.filter_jit(shear_influence)(**_shapes(), harmonics=20))
    wanted = 24 * 2.0 * 1.3 / (2.0 * math.pi) * math.log(2.1)
    assert_close(each.sum(), wanted, rtol=1e-12, atol=0.0)


def test_loads_on_all_teeth_bend_the_plate_as_one_that_is_even_around():
    """Against the plate's own equation, integrated: bore clamped, a force on the rim."""
    from scipy.integrate import solve_bvp

    ratio, thick, poisson = 2.1, 0.3, 0.3
    each = np.asarray(_PLATE(**_shapes(ratio), thickness=_real(thick)))
    stiffness, force = thick**3 / (12.0 * (1.0 - poisson**2)), 24.0 / (2.0 * math.pi)

    def slopes(r, y):
        # w, w', w'', and (w'' + w'/r)' = -Q/D.
        return np.array([y[1], y[2], -force / (stiffness * r) - y[2] / r + y[1] / r**2])

    def ends(inner, outer):
        return np.array([inner[0], inner[1], outer[2] + poisson * outer[1]])

    r = np.linspace(1.0 / ratio, 1.0, 50)
    found = solve_bvp(slopes, ends, r, np.zeros((3, r.size)), tol=1e-9)
    # Sums over all teeth leave the orders 0, 24 and 48: the last two are 1e-5 of the first.
    scale = thick
    assert_close(each[:, 0, 0].sum() / scale, found.y[0, -1], rtol=1e-3, atol=0.0)
    assert_close(each[:, 1, 0].sum() / scale, found.y[1, -1], rtol=1e-3, atol=0.0)


def test_forces_and_couples_on_the_plate_are_reciprocal_and_positive():
    each = np.asarray(_PLATE(**_shapes(), thickness=_real(0.3)))
    count = each.shape[0]
    whole = np.block([[each[(i - j) % count] for j in range(count)] for i in range(count)])
    assert_close(whole, whole.T, rtol=1e-9, atol=1e-9 * whole.max())
    assert np.linalg.eigvalsh(whole)[0] > -1e-9 * whole.max()


# Motion of the next tooth and the one after by an even load in the middle of the flank [pm m/N]:
# elements of `fem_prep.condense_teeth`, 24 teeth of module 3, bore 36 mm; by helix [deg] and face
# [mm].
_ELEMENTS = {
    (0.0, 15.0): (6.07, 4.52),
    (15.0, 15.0): (7.73, 5.38),
    (30.0, 15.0): (15.52, 9.85),
    (30.0, 30.0): (10.16, 7.22),
}
# Roll length of that place [mm].
_PLACE = {0.0: 13.894, 15.0: 14.540, 30.0: 17.046}


@pytest.mark.parametrize(("helix", "face"), _ELEMENTS)
def test_the_next_teeth_against_finite_elements(helix, face):
    gear = jg.Gear(24, face * mm, 0.0, bore=36.0 * mm, dedendum=1.25, fillet_radius=0.3)
    pair = jg.GearPair(gear, gear, 3.0 * mm, 20.0 * deg, helix * deg)
    given = _given_to_next(pair, _real(_PLACE[helix] * 1e-3))
    for got, wanted in zip(given, _ELEMENTS[helix, face], strict=True):
        assert abs(1e12 * float(got) / wanted - 1.0) < 0.06


@eqx.filter_jit
def _given_to_next(pair, roll):
    """Motion of the next tooth of the pinion and of the one after, per force [m/N]."""
    bodies = [body for body in jg.WeberBanaschek().bodies(pair, 2) if body.gear == 0]
    loads = [body.resultants(roll) for body in bodies]
    return [
        sum(load @ body.at_roots(ahead) @ load for body, load in zip(bodies, loads, strict=True))
        for ahead in (1, 2)
    ]


def test_nothing_without_a_helix_has_a_slope_by_it():
    gear = jg.Gear(24, 15.0 * mm, 0.0)
    pair_of = lambda helix: jg.GearPair(gear, gear, 3.0 * mm, 20.0 * deg, helix)
    added = lambda helix, by: where_helical(
        pair_of(helix),
        lambda pair, by: jnp.sin(pair.helix_angle) * by,
        lambda pair, by: jnp.zeros_like(by),
        pair_of(helix),
        by,
    )
    three = _real(3.0)
    assert added(_real(0.0), three) == 0.0
    assert_close(jax.grad(added)(_real(0.0), three), 3.0, rtol=1e-14, atol=0.0)
    assert_close(added(_real(0.2), three), 3.0 * math.sin(0.2), rtol=1e-14, atol=0.0)


@pytest.mark.slow
def test_the_slope_by_the_helix_is_there_at_no_helix():
    """Teeth lean over either end: two slopes at zero, and derivatives lie between them."""
    gear = jg.Gear(24, 15.0 * mm, 0.0, bore=36.0 * mm, dedendum=1.25, fillet_radius=0.3)
    pair_of = lambda helix: jg.GearPair(gear, gear, 3.0 * mm, 20.0 * deg, helix)
    grid = jg.mesh_grid(pair_of(0.0), phases=8, slices=3)

    @jax.jit
    def between(helix):
        pair = pair_of(helix)
        lines = jg.contact_lines(pair, grid)
        found = face_cells(pair, lines, jg.WeberBanaschek(), _real(2e5))
        assert found is not None
        # Of both lines with each other: what axial loads of one tooth do to the other.
        size = grid.slices
        return found.coupling[:, :size, size : 2 * size]

    step = 1e-6
    still, slope = jax.jvp(between, (_real(0.0),), (_real(1.0),))
    ahead = (between(_real(step)) - still) / step
    behind = (still - between(_real(-step))) / step
    room = 1e-3 * float(jnp.abs(slope).max())
    assert room > 0.0
    assert bool(jnp.all(slope > jnp.minimum(ahead, behind) - room))
    assert bool(jnp.all(slope < jnp.maximum(ahead, behind) + room))
