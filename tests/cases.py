"""Reference pairs, each a function, and the ways in which a pair may be turned round.

A pair whose source is not named is ours. Pairs do not change, so each is built once.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from jaxtyping import PyTree

import jaxgear as jg
from jaxgear import deg, mm


@functools.cache
def accessory() -> jg.GearPair:
    """Thin-rimmed spur pair of an accessory gearbox (Guilbert 2017, tab. III-1)."""
    return jg.GearPair(
        jg.Gear(45, 11.5 * mm, 0.341, 0.9447, 1.1933, 0.25),
        jg.Gear(86, 9.5 * mm, 0.481, 0.9447, 1.1933, 0.25),
        1.5 * mm,
        25.0 * deg,
    )


@functools.cache
def power() -> jg.GearPair:
    """Helical pair of a power gearbox (Guilbert 2017, tab. III-5)."""
    return jg.GearPair(
        jg.Gear(35, 40.0 * mm, 0.275, 0.976, 1.262, 0.25),
        jg.Gear(68, 40.0 * mm, 0.317, 0.970, 1.268, 0.25),
        2.5 * mm,
        25.0 * deg,
        12.0 * deg,
    )


@functools.cache
def fzg_c14() -> jg.GearPair:
    """Spur pair of the FZG test rig, tips not shortened."""
    return jg.GearPair(jg.Gear(16, 14.0 * mm, 0.1817), jg.Gear(24, 14.0 * mm, 0.1715), 4.5 * mm)


@functools.cache
def fzg_h501() -> jg.GearPair:
    """Helical pair of the FZG test rig, tips not shortened."""
    return jg.GearPair(
        jg.Gear(20, 23.0 * mm, 0.1809),
        jg.Gear(30, 23.0 * mm, 0.0891),
        3.5 * mm,
        20.0 * deg,
        15.0 * deg,
    )


@functools.cache
def iso_tr_6336_30() -> jg.GearPair:
    """Example 1 of ISO/TR 6336-30:2017, at its given centre distance."""
    return jg.GearPair(
        jg.Gear(17, 100.0 * mm, 0.145, 1.0, 1.4, 0.39),
        jg.Gear(103, 100.0 * mm, 0.0, 1.0, 1.4, 0.39),
        8.0 * mm,
        20.0 * deg,
        15.8 * deg,
        500.0 * mm,
    )


@functools.cache
def standard_17_43() -> jg.GearPair:
    """Standard spur teeth, the pinion undercut by a hair."""
    return jg.GearPair(jg.Gear(17, 10.0 * mm), jg.Gear(43, 10.0 * mm), 1.0 * mm)


@functools.cache
def standard_30_30() -> jg.GearPair:
    """Equal standard spur gears."""
    return jg.GearPair(jg.Gear(30, 20.0 * mm), jg.Gear(30, 20.0 * mm), 3.0 * mm)


@functools.cache
def standard_50_50() -> jg.GearPair:
    """Equal spur gears of the size that Blankenship and Kahraman measured, tips standard."""
    return jg.GearPair(jg.Gear(50, 20.0 * mm), jg.Gear(50, 20.0 * mm), 3.0 * mm)


@functools.cache
def high_contact_ratio() -> jg.GearPair:
    """Spur gears with long teeth: two or three pairs share the load."""
    return jg.GearPair(
        jg.Gear(40, 20.0 * mm, 0.0, 1.35, 1.65, 0.2),
        jg.Gear(60, 20.0 * mm, 0.0, 1.35, 1.65, 0.2),
        3.0 * mm,
    )


@functools.cache
def ross_62_62() -> jg.GearPair:
    """Equal spur gears of a test in petrobras/ross."""
    return jg.GearPair(
        jg.Gear(62, 20.0 * mm, bore=35.0 * mm),
        jg.Gear(62, 20.0 * mm, bore=35.0 * mm),
        2.0 * mm,
    )


@functools.cache
def helical_25_31() -> jg.GearPair:
    """Helical, shifted, unequal in everything, with backlash: nothing cancels by accident."""
    return jg.GearPair(
        jg.Gear(25, 21.0 * mm, 0.23, 0.98, 1.28, 0.3, 0.01, 20.0 * mm),
        jg.Gear(31, 18.0 * mm, -0.11, 1.02, 1.31, 0.27, 0.02, 22.0 * mm, jg.Material(200e9, 0.28)),
        2.0 * mm,
        21.0 * deg,
        17.0 * deg,
        58.9 * mm,
    )


_Makers = tuple[Callable[[], jg.GearPair], ...]

# One of each kind: as built, undercut, two or three pairs in contact; overlap above one, and below
# it with nothing equal. What those after them add is other numbers.
SPUR: _Makers = (accessory, standard_17_43, high_contact_ratio)
HELICAL: _Makers = (power, helical_25_31)
MORE_SPUR: _Makers = (fzg_c14, standard_30_30, standard_50_50, ross_62_62)
MORE_HELICAL: _Makers = (fzg_h501, iso_tr_6336_30)


def over(*makers: Callable[[], jg.GearPair], slow: _Makers = ()) -> pytest.MarkDecorator:
    """Run a test with each of these pairs as `make`; with some among the slow tests."""
    late = (pytest.param(make, marks=pytest.mark.slow) for make in slow)
    return pytest.mark.parametrize("make", [*makers, *late])


every_pair = over(*SPUR, *HELICAL, slow=(*MORE_SPUR, *MORE_HELICAL))
every_spur_pair = over(*SPUR, slow=MORE_SPUR)
every_helical_pair = over(*HELICAL, slow=MORE_HELICAL)


def model(pair: jg.GearPair, torque: float, **parts: Any) -> jg.PairModel:
    """A pair under a torque on its pinion [N m]; `parts` are the other fields of the model."""
    return jg.PairModel(pair, torque, **parts)


def torque_for(pair: jg.GearPair, line_load: float) -> float:
    """Pinion torque [N m] whose nominal line load is this [N/m]."""
    return float(line_load * pair.base_radius[0] * pair.face_width)


def lengths_scaled(pair: jg.GearPair, by: float) -> jg.GearPair:
    """The same pair drawn at another scale."""

    def lengths(p: jg.GearPair) -> list[jax.Array]:
        found = [p.normal_module, p.centre_distance]
        for gear in (p.pinion, p.wheel):
            found += [gear.face_width, gear.bore]
        return [x for x in found if x is not None]

    return eqx.tree_at(lengths, pair, replace_fn=lambda x: by * x)


def exchanged(pair: jg.GearPair) -> jg.GearPair:
    """The wheel drives. Its helix has the other hand."""
    return jg.GearPair(
        pair.wheel,
        pair.pinion,
        pair.normal_module,
        pair.pressure_angle,
        -pair.helix_angle,
        pair.centre_distance,
    )


def mirrored(pair: jg.GearPair) -> jg.GearPair:
    """The pair in a mirror square to its axes."""
    return eqx.tree_at(lambda p: p.helix_angle, pair, -pair.helix_angle)


def sizes(tree: PyTree) -> PyTree:
    """How large each real leaf is, for `assert_gradient`: a tenth where it happens to be zero."""
    return jax.tree.map(
        lambda x: jnp.where(x == 0.0, 0.1, jnp.abs(x)) if eqx.is_inexact_array(x) else x, tree
    )
