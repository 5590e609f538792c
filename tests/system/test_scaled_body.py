"""Bodies of another material and of another shape, against bodies that were condensed so."""

import dataclasses
import functools

import equinox as eqx
import hybrid_cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close
from hybrid_cases import PAIRS

import jaxgear as jg
from jaxgear._system._body_modes import body_basis
from jaxgear._system._body_tables import flexible_body

STIFFER, DENSER = 0.5, 1.3


_OF_DENSITY = ("mass", "coriolis", "spin_softening", "stress_stiffening", "centrifugal_load")


@functools.cache
def _body():
    return hybrid_cases.body("spur", 1, modes=8, rotating=True)


@functools.cache
def _grid():
    return jg.mesh_grid(PAIRS["spur"](), phases=8, slices=2, periods=1)


@functools.cache
def _in_mesh(young=1.0, density=1.0):
    own = _body()
    denser = {name: density * getattr(own, name) for name in _OF_DENSITY}
    body = dataclasses.replace(own, stiffness=young * own.stiffness, **denser)
    basis = body_basis(body, 24)
    return flexible_body(body, PAIRS["spur"](), 1, _grid(), basis=basis)


def _invariants(body):
    """What does not depend on the choice of directions within a pair of modes, or of signs."""
    modes = body.modes
    seats = len(modes.mass) - modes.square.size
    square = lambda x: x**2
    pairs = lambda x: np.asarray(x) @ np.asarray(x).T
    rows = jnp.moveaxis(modes.rows, 3, 0).reshape(modes.square.size, -1).T
    found = {
        "square": modes.square,
        "mass": modes.mass[:seats, :seats],
        "joined": pairs(modes.mass[:seats, seats:]),
        "coriolis": modes.coriolis[:seats, :seats],
        "softening": modes.softening[:seats, :seats],
        "stiffening": jnp.sum(square(modes.softening[seats:, seats:])),
        "turned": jnp.sum(square(modes.coriolis[seats:, seats:])),
        "rows": pairs(rows),
        "grown": np.asarray(rows) @ np.asarray(modes.load / modes.square),
    }
    tables = ("flexibility", "from_seats", "growth", "seat_stiffness", "seat_load")
    return found | {name: getattr(body, name) for name in tables}


@pytest.mark.slow
def test_a_scaled_body_is_the_body_of_the_other_material():
    """Each table, modes and terms of rotation too, against one that was made anew."""
    scaled = _invariants(jg.scaled_body(_in_mesh(), young=STIFFER, density=DENSER))
    anew = _invariants(_in_mesh(STIFFER, DENSER))
    before = _invariants(_in_mesh())
    # One seat alone has neither stiffness nor load but for rounding.
    size = {name: float(np.abs(wanted).max()) for name, wanted in anew.items()}
    size |= {"seat_stiffness": 1e6, "seat_load": 1e-6}
    apart = lambda one, name: float(np.abs(one[name] - anew[name]).max()) / size[name]
    for name in anew:
        assert apart(scaled, name) <= 1e-8, name
    # How feet follow seats is geometry, and so is what turns with modes of unit mass.
    same = {name for name in anew if apart(before, name) <= 1e-6}
    assert same == {"from_seats", "turned", "stiffening", "seat_stiffness", "seat_load"}


@pytest.mark.slow
def test_its_derivatives_are_those_of_the_powers():
    grown = lambda young: jnp.sum(jg.scaled_body(_in_mesh(), young=young).growth)
    assert_close(jax.grad(grown)(2.0), -0.25 * jnp.sum(_in_mesh().growth), rtol=1e-12, atol=0.0)

    def tone(density):
        modes = jg.scaled_body(_in_mesh(), density=density).modes
        assert modes is not None
        return modes.frequency[0]

    assert_close(jax.grad(tone)(1.0), -0.5 * tone(1.0), rtol=1e-12, atol=0.0)
    with pytest.raises(ValueError, match=r"`young` of `scaled_body` must be a ratio above 0"):
        jg.scaled_body(_in_mesh(), young=0.0)


# --- Families


def _still():
    return eqx.tree_at(lambda b: b.modes, _in_mesh(), None)


def _of_thickness(value):
    """As of a web that gives as membranes and plates do."""
    return jg.scaled_body(_still(), young=1.0 / (0.5 + 0.3 / value + 0.2 / value**3))


def _compliance(body):
    """What of the tables a stiffness of the web changes linearly."""
    return body.flexibility[0, 1, 1, 0, 0]


@pytest.mark.slow
def test_a_family_is_its_bodies_and_exact_for_membranes_and_plates():
    at, between = jg.family_parameters(1.0, 3.0, 5, reciprocal=True)
    assert at[0] == 1.0
    assert at[-1] == 3.0
    assert len(between) == 2
    family = jg.body_family(
        at,
        [_of_thickness(value) for value in at],
        checks=[(value, _of_thickness(value)) for value in between],
        reciprocal=True,
    )
    # With one seat nothing but compliances changes here, and they are polynomials.
    assert family.interpolation_error < 1e-12
    assert family(at[1]).modes is None
    assert jg.table_difference(family(at[1]), _of_thickness(at[1])) < 1e-12
    # The compliance is a polynomial of the third degree in 1/t, and so is its derivative known.
    assert_close(_compliance(family(1.7)), _compliance(_of_thickness(1.7)), rtol=1e-12, atol=0.0)
    slope = jax.grad(lambda value: _compliance(family(value)))(1.7)
    wanted = jax.grad(lambda value: _compliance(_of_thickness(value)))(1.7)
    assert_close(slope, wanted, rtol=1e-10, atol=0.0)


def test_a_family_refuses_what_it_does_not_know():
    at = np.array([1.0, 2.0, 3.0])
    bodies = [_of_thickness(value) for value in at]
    good = [(1.5, _of_thickness(1.5))]
    make = functools.partial(jg.body_family, at, bodies, reciprocal=True, most=0.5)
    family = make(checks=good)
    # A difference at an end goes a little beyond it.
    assert_close(_compliance(family(0.999)), _compliance(_of_thickness(0.999)), rtol=0.05, atol=0.0)
    for beyond in (0.9, 3.1):
        with pytest.raises(ValueError, match="nothing is extrapolated"):
            family(beyond)
    assert jnp.isnan(jax.jit(lambda value: _compliance(family(value)))(0.9))
    with pytest.raises(ValueError, match=r"must be off by 1e-06 at most, got .* at 1\.5"):
        make(checks=good, most=1e-6)
    with pytest.raises(ValueError, match="one or more to check"):
        make(checks=[])
    with pytest.raises(ValueError, match="three or more bodies"):
        jg.body_family(at[:2], bodies[:2], checks=good)
    for low, high, count in ((3.0, 1.0, 5), (0.0, 1.0, 5), (1.0, 3.0, 2)):
        with pytest.raises(ValueError, match="three or more bodies and ends that rise"):
            jg.family_parameters(low, high, count, reciprocal=True)
    other = eqx.tree_at(lambda b: b.growth, bodies[0], bodies[0].growth[:, :, :1])
    with pytest.raises(ValueError, match="same seats, slices, lines"):
        jg.body_family(at, [other, *bodies[1:]], checks=good)
