import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxgear as jg
from jaxgear import GPa, mm


def test_defaults_are_steel_and_the_iso_53_rack():
    gear = jg.Gear(20, 10.0 * mm)
    got = {name: float(getattr(gear, name)) for name in ("addendum", "dedendum", "fillet_radius")}
    assert got == {"addendum": 1.0, "dedendum": 1.25, "fillet_radius": 0.38}
    assert float(gear.profile_shift) == float(gear.tip_shortening) == 0.0
    assert gear.bore is None
    steel = gear.material
    assert (float(steel.young), float(steel.poisson)) == (206.0 * GPa, 0.3)
    assert float(steel.density) == 7850.0


@pytest.mark.parametrize(("bore", "count"), [(None, 9), (30.0 * mm, 10)])
def test_every_real_field_is_a_leaf_of_double_precision(bore, count):
    """Given as ints, floats or NumPy numbers, all of them can be differentiated."""
    gear = jg.Gear(20, 1, np.float32(0.25), 1, 1.25, 0.25, 0, bore)
    leaves = jax.tree.leaves(eqx.filter(gear, eqx.is_inexact_array))
    assert len(leaves) == len(jax.tree.leaves(gear)) == count
    assert {(leaf.shape, leaf.dtype) for leaf in leaves} == {((), jnp.dtype("float64"))}


def test_the_number_of_teeth_selects_a_program():
    one, two = jg.Gear(20, 0.01), jg.Gear(21, 0.01)
    assert jax.tree.structure(one) != jax.tree.structure(two)


def test_positions_of_the_fields():
    """The order is part of the interface: drawings are typed in positionally."""
    gear = jg.Gear(20, 0.01, 0.1, 1.1, 1.3, 0.3, 0.02, 0.005, jg.Material(70e9, 0.33, 2700.0))
    assert [float(x) for x in jax.tree.leaves(gear)] == [
        0.01, 0.1, 1.1, 1.3, 0.3, 0.02, 0.005, 70e9, 0.33, 2700.0,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"teeth": 4}, r"`Gear.teeth` must be at least 5, got 4\."),
        ({"face_width": 0.0}, r"`Gear.face_width` must be positive, got 0 m\."),
        ({"face_width": -0.01}, r"must be positive, got -0.01 m\."),
        ({"face_width": np.nan}, r"must be positive, got nan m\."),
        ({"fillet_radius": -0.01}, r"between 0 and the dedendum coefficient 1.25, got -0.01\."),
        ({"fillet_radius": 1.25}, r"between 0 and the dedendum coefficient 1.25, got 1.25\."),
        ({"dedendum": 0.3}, r"between 0 and the dedendum coefficient 0.3, got 0.38\."),
    ],
)
def test_impossible_gears_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        jg.Gear(**({"teeth": 20, "face_width": 0.01} | change))


def test_the_limits_of_a_gear_are_allowed():
    jg.Gear(5, 1e-6, fillet_radius=0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"young": 0.0}, r"`Material.young` must be positive, got 0 Pa\."),
        ({"young": -206e9}, r"got -2.06e\+11 Pa\."),
        ({"poisson": 0.5}, r"`Material.poisson` must lie between -1 and 0.5, got 0.5\."),
        ({"poisson": -1.0}, r"between -1 and 0.5, got -1\."),
        ({"poisson": np.nan}, r"got nan\."),
    ],
)
def test_impossible_materials_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        jg.Material(**change)


def test_a_traced_gear_is_built_without_checks():
    """Inside `jit` there is nothing to compare yet, and no message to format."""

    @jax.jit
    def shifted(width, young):
        gear = jg.Gear(20, width, material=jg.Material(young))
        return gear.face_width * gear.material.young

    assert float(shifted(-2.0, -3.0)) == 6.0
