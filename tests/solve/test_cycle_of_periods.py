"""Cycles of several mesh periods: teeth that differ from each other, and gears that run out.

At constant stiffness everything has a closed form: a pair in mesh is a spring, and gaps enter as
their mean over the pairs that carry.
"""

import functools
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from solve_cases import ACCESSORY, POWER, Drawing, run_cycle, spread, symmetric_relief

import jaxgear as jg
from jaxgear import um

STIFFNESS = 14e9
LAW = jg.ConstantStiffness(STIFFNESS)
# Few teeth, so that a whole turn of both gears is short: 12 and 18 teeth meet anew after 36.
SMALL = Drawing(teeth=(12, 18), module=3e-3, shift=(0.45, 0.1))


@functools.cache
def _small() -> jg.GearPair:
    return SMALL.pair()


def _cycle(pair: jg.GearPair, periods: int, *, phases: int = 8, slices: int = 1, **parts):
    parts.setdefault("compliance", LAW)
    model = jg.PairModel(pair, parts.pop("torque", 100.0), **parts)
    return run_cycle(model, jg.mesh_grid(pair, phases=phases, slices=slices, periods=periods))


def _error(cycle: jg.MeshCycle) -> np.ndarray:
    return np.asarray(jg.transmission_error(cycle.system.pair, cycle))


def _turns(pinion: jg.Indexing | None = None, wheel: jg.Indexing | None = None) -> jg.MeshCycle:
    """Three turns of the small pinion, two of its wheel: all by one program."""
    whole = []
    for indexing, teeth in ((pinion, 12), (wheel, 18)):
        own = jg.Indexing() if indexing is None else indexing
        each = jnp.broadcast_to(own.pitch_error, (teeth,))
        whole.append(jg.Indexing(each, own.eccentricity, own.eccentricity_angle))
    flanks = jg.Flanks(pinion_indexing=whole[0], wheel_indexing=whole[1])
    return _cycle(_small(), 36, flanks=flanks)


@functools.cache
def _plain() -> jg.MeshCycle:
    return _turns()


def _single_error(teeth: int, tooth: int, size: float) -> jg.Indexing:
    return jg.Indexing(size * jnp.asarray(np.arange(teeth) == tooth, dtype=float))


# --- repetition


@pytest.mark.slow
@pytest.mark.parametrize("make", [ACCESSORY, POWER], ids=["spur", "helical"])
def test_three_periods_repeat_one(make):
    flanks = symmetric_relief(10 * um, 0.3)
    more: dict[str, Any] = {"phases": 12, "slices": 4, "flanks": flanks}
    one, three = (_cycle(make.pair(), n, **more) for n in (1, 3))
    error = _error(three).reshape(3, 12)
    for period in error:
        assert_close(period, _error(one), rtol=1e-13, atol=0.0)
    force = np.asarray(three.force).reshape(3, 12, -1)
    assert_close(force, np.broadcast_to(np.asarray(one.force), force.shape), rtol=1e-12, atol=1e-9)
    lines = three.cells.lines
    assert_close(jnp.sum(lines.weight), 1.0, rtol=1e-13, atol=0.0)
    assert np.all(np.diff(np.asarray(lines.phase)) > 0.0)
    assert 2.0 < float(lines.phase[-1]) < 3.0
    assert abs(spread(three, _error(three)) / spread(one, _error(one)) - 1.0) < 1e-12


@pytest.mark.parametrize("tip_contact", [False, True])
def test_teeth_are_numbered_by_their_entry(tip_contact):
    """Tooth n starts its path at phase n, at mid-face: phase = n + place in base pitches."""
    pair = POWER.pair()
    grid = jg.mesh_grid(pair, phases=8, slices=3, periods=4, beyond=0.25 if tip_contact else 0.0)
    lines = jg.contact_lines(pair, grid)
    place = (lines.roll[:, :, 1] - pair.path_start) / pair.transverse_base_pitch
    entered = np.asarray(lines.phase)[:, None] - np.asarray(place)
    assert_close(np.asarray(lines.tooth, dtype=float), entered, rtol=0.0, atol=1e-9)


# --- pitch errors


@pytest.mark.slow
def test_a_single_error_shows_while_its_tooth_is_in_mesh():
    """Tooth 3 of the pinion stands 2 um proud: 2 um less where it is alone, half of it in pairs."""
    size = 2 * um
    cycle = _turns(_single_error(12, 3, size))
    phase = np.asarray(cycle.cells.lines.phase)[: 12 * 8]
    ratio = SMALL.contact_ratio
    moved = (_error(cycle) - _error(_plain()))[: 12 * 8]
    in_mesh = [np.array([p - ratio < n < p for n in range(-2, 14)]).astype(float) for p in phase]
    count = np.array([x.sum() for x in in_mesh])
    hit = np.array([x[3 + 2] for x in in_mesh])
    assert_close(moved, -size * hit / count, rtol=1e-7, atol=1e-15)
    # From its entry at phase 3 to its exit at 3 + eps; of 12 periods nothing else moves.
    assert phase[hit > 0].min() > 3.0
    assert phase[hit > 0].max() < 3.0 + ratio
    assert set(count[hit > 0]) == {1.0, 2.0}


@pytest.mark.parametrize("gear", ["pinion", "wheel"])
def test_the_last_tooth_of_a_turn_is_in_mesh_at_the_start(gear):
    """Teeth count modulo the number of teeth: at phase 0 the tooth before tooth 0 is still there.

    An error that repeats after the gear's teeth repeats in the error of transmission.
    """
    teeth = 12 if gear == "pinion" else 18
    indexing = _single_error(teeth, teeth - 1, 2 * um)
    moved = _error(_turns(**{gear: indexing})) - _error(_plain())
    by_turn = moved.reshape(36 // teeth, teeth, 8)
    assert_close(by_turn, np.broadcast_to(by_turn[0], by_turn.shape), rtol=1e-9, atol=1e-16)
    assert np.abs(by_turn[0, 0]).max() > 0.4 * um
    assert np.abs(by_turn[0, 1:-1]).max() < 1e-15


def test_both_gears_meet_their_own_teeth():
    """Errors of one tooth of each gear add up in the period in which the two meet."""
    # Tooth 29 of the cycle: pinion 29 - 24 = 5, wheel 29 - 18 = 11.
    one, other = _single_error(12, 5, 2 * um), _single_error(18, 11, 3 * um)
    cycles = (_turns(one), _turns(None, other), _turns(one, other))
    first, second, both = (_error(cycle) - _error(_plain()) for cycle in cycles)
    assert_close(both, first + second, rtol=1e-9, atol=1e-15)
    by_period = np.abs(both).reshape(36, 8).max(axis=1)
    assert int(by_period.argmax()) == 29
    assert_close(by_period[29], 5 * um, rtol=1e-6, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "law",
    [LAW, pytest.param(jg.WeberBanaschek(), marks=pytest.mark.slow)],
    ids=["constant", "weber"],
)
def test_the_same_error_on_all_teeth_only_shifts(law):
    """The gap is along the normal: TE falls by error / cos(beta_b), whatever the stiffness."""
    pair = POWER.pair()
    relief = jg.TipRelief(12 * um, 0.25)
    more: dict[str, Any] = {"phases": 12, "slices": 4, "compliance": law, "torque": 200.0}
    one, other = (
        _cycle(pair, 1, flanks=jg.Flanks(relief, relief, *map(jg.Indexing, errors)), **more)
        for errors in ((0.0, 0.0), (3 * um, 1 * um))
    )
    expected = _error(one) - 4 * um / math.cos(POWER.base_helix)
    assert_close(_error(other), expected, rtol=1e-10, atol=0.0)
    assert_close(other.force, one.force, rtol=1e-8, atol=1e-6)


def test_a_large_error_carries_alone_and_the_rest_hangs_free():
    """A tooth 1 mm proud: single contact throughout its path, TE = F/k - 1 mm."""
    cycle = _turns(_single_error(12, 1, 1e-3))
    phase = np.asarray(cycle.cells.lines.phase)
    alone = (phase > 1.0) & (phase < 1.0 + SMALL.contact_ratio)
    delta = SMALL.force(100.0) / (STIFFNESS * SMALL.common_width)
    assert_close(_error(cycle)[alone], np.full(alone.sum(), delta - 1e-3), rtol=1e-9, atol=0.0)
    sharing = np.asarray(jg.load_sharing(cycle))
    assert_close(sharing.max(axis=1)[alone], np.ones(alone.sum()), rtol=1e-12, atol=0.0)


# --- eccentricity


def _runout(gear: str, size: float, angle: float) -> np.ndarray:
    """What an eccentricity adds to the error of transmission over 36 periods."""
    indexing = jg.Indexing(eccentricity=size, eccentricity_angle=angle)
    return _error(_turns(**{gear: indexing})) - _error(_plain())


@pytest.mark.parametrize(("gear", "teeth"), [("pinion", 12), ("wheel", 18)])
def test_eccentricity_by_moving_the_gear(gear, teeth):
    """Once per turn, e in amplitude. By plane vectors: what the offset adds along the path."""
    size, angle = 5 * um, 0.7
    added = _runout(gear, size, angle)
    phase = np.asarray(_plain().cells.lines.phase)
    # The pinion turns about +Z, the wheel about -Z; angles are from S, T is 90 degrees on.
    turn = angle + 2 * math.pi * phase / teeth
    sense = 1.0 if gear == "pinion" else -1.0
    offset = size * np.stack([np.cos(turn), sense * np.sin(turn)])
    along = np.array([math.sin(SMALL.working_angle), math.cos(SMALL.working_angle)])
    # The pinion pushed along the path meets the wheel early; the wheel, late.
    assert_close(added, -sense * along @ offset, rtol=1e-9, atol=1e-15)
    turns = 36 // teeth
    lead = np.fft.rfft(added.reshape(36, 8).mean(axis=1))
    spectrum = np.abs(lead) * 2 / 36
    assert int(spectrum.argmax()) == turns
    assert np.delete(spectrum, turns).max() < 1e-3 * spectrum[turns]
    assert 0.97 * size < spectrum[turns] < size


@pytest.mark.slow
def test_eccentricity_of_a_helical_gear_is_as_large_in_the_transverse_error():
    """It acts in the transverse plane: amplitude e, not e / cos(beta_b)."""
    size = 5 * um
    pair = POWER.pair()
    flanks = jg.Flanks(pinion_indexing=jg.Indexing(eccentricity=size))
    more = {"slices": 4}
    added = _error(_cycle(pair, 35, flanks=flanks, **more)) - _error(_cycle(pair, 35, **more))
    extremes = np.array([added.max(), -added.min()])
    assert_close(extremes, np.full(2, size), rtol=2e-4, atol=0.0)


def test_eccentricities_of_both_gears_superpose():
    one = jg.Indexing(eccentricity=5 * um, eccentricity_angle=0.7)
    other = jg.Indexing(eccentricity=8 * um, eccentricity_angle=-1.1)
    both = _error(_turns(one, other)) - _error(_plain())
    apart = _runout("pinion", 5 * um, 0.7) + _runout("wheel", 8 * um, -1.1)
    assert_close(both, apart, rtol=1e-9, atol=1e-16)
    # Two turns of the wheel and three of the pinion in the cycle: orders 2 and 3 of 36.
    spectrum = np.abs(np.fft.rfft(both.reshape(36, 8).mean(axis=1))) * 2 / 36
    assert_close(spectrum[2:4], np.array([8 * um, 5 * um]), rtol=2e-2, atol=0.0)
    assert np.delete(spectrum, [2, 3]).max() < 1e-3 * spectrum[3]


def test_mesh_harmonics_do_not_see_slow_orders():
    """Over whole turns, runout leaves the mean, and the harmonics of the mesh frequency."""
    plain, runout = _plain(), _turns(jg.Indexing(eccentricity=5 * um))
    assert_close(
        jg.harmonic_amplitudes(runout, jnp.asarray(_error(runout)), 2),
        jg.harmonic_amplitudes(plain, jnp.asarray(_error(plain)), 2),
        rtol=1e-9,
        atol=0.0,
    )


def test_negative_eccentricity_is_refused():
    with pytest.raises(ValueError, match="cannot be negative"):
        jg.Indexing(eccentricity=-1e-6)


@pytest.mark.slow
def test_pitch_error_and_runout_are_differentiable():
    pair = _small()
    grid = jg.mesh_grid(pair, phases=8, slices=1, periods=3)
    rng = np.random.default_rng(1)
    base = jg.PairModel(pair, 100.0, compliance=LAW)

    def number(indexing):
        model = eqx.tree_at(
            lambda m: m.flanks,
            base,
            jg.Flanks(pinion_indexing=indexing[0], wheel_indexing=indexing[1]),
        )
        cycle = jg.mesh_cycle(model, grid, law=jg.SmoothContact(1 * um), throw=False)
        error = jg.transmission_error(pair, cycle) / um
        weights = jnp.linspace(0.5, 1.5, error.size)
        return jnp.sum(weights * error) + jg.cycle_variance(cycle, error)

    indexing = tuple(
        jg.Indexing(jnp.asarray(3 * um * rng.normal(size=n)), 4 * um, 0.6) for n in (12, 18)
    )
    assert_gradient(number, indexing, rtol=1e-6)
    assert jax.tree.leaves(indexing)[0].shape == (12,)
