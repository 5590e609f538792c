"""Unbalance of two geared rotors against another rotor program, ROSS, whose answers are kept.

`benchmarks/judge_rotor.py` makes them. Both have Timoshenko's beams with Cowper's coefficient,
consistent masses and gyroscopic terms, so that with the same elements they agree to rounding.
"""

import functools
import json
import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import rotor_cases as given

import jaxgear as jg

RECORD = Path(__file__).parents[1] / "data" / "ross" / "geared_rotors.json"
GEARS = ("pinion", "wheel")


@functools.cache
def _recorded() -> dict:
    return json.loads(RECORD.read_text())


def _shaft(case: given.Rotor, divisions: int) -> jg.Shaft:
    bearings = [
        jg.Bearing(at, radial_s, radial_t, 0.0 if i else case.axial)
        for i, (at, radial_s, radial_t) in enumerate(case.bearings)
    ]
    return jg.Shaft(
        [jg.Segment(*each) for each in case.segments],
        bearings,
        case.gear_at,
        loads=[jg.ShaftLoad(place) for place, _, _ in case.unbalance],
        material=jg.Material(given.YOUNG, given.POISSON, given.DENSITY),
        divisions=divisions,
    )


@functools.cache
def _dynamics(divisions: int = given.DIVISIONS) -> jg.PairDynamics:
    """The rotors, with teeth whose mean stiffness is that of the record."""
    pinion, wheel = (jg.Gear(case.teeth, 20e-3) for case in given.ROTORS.values())
    pair = jg.GearPair(pinion, wheel, given.MODULE, given.PRESSURE_ANGLE, 0.0)
    shafts = [_shaft(case, divisions) for case in given.ROTORS.values()]
    bodies = [jg.RigidBody(*case.gear) for case in given.ROTORS.values()]
    grid = jg.mesh_grid(pair, phases=8, slices=1)
    damping = jg.RayleighDamping(given.MASS_FACTOR, given.STIFFNESS_FACTOR)

    def of(stiffness: float) -> jg.PairDynamics:
        model = jg.PairModel(
            pair,
            10.0,
            compliance=jg.ConstantStiffness(stiffness),
            pinion_support=shafts[0],
            wheel_support=shafts[1],
            pinion_body=bodies[0],
            wheel_body=bodies[1],
        )
        return jg.pair_dynamics(model, grid, damping, gyroscopic=True)

    teeth = given.MESH / 20e-3
    dynamics = of(teeth * given.MESH / float(of(teeth).system.mean[0, 0]))
    assert float(dynamics.system.mean[0, 0]) == pytest.approx(given.MESH, rel=1e-10)
    return dynamics


def _unbalance(gear: str) -> list[jg.Unbalance]:
    return [
        jg.Unbalance(moment, angle, node=f"{gear} load {i}")
        for i, (_, moment, angle) in enumerate(given.ROTORS[gear].unbalance)
    ]


def _motion(dynamics: jg.PairDynamics, gear: str, speed: float) -> dict[str, np.ndarray]:
    """Along and about S and T of all stations of both shafts, `[station, direction]`."""
    found = jg.unbalance_response(dynamics, _unbalance(gear), speed / _ratio(gear))
    assert float(found.frequency) == pytest.approx(speed, rel=1e-12)
    whole = np.zeros(max(dynamics.dofs) + 1, dtype=complex)
    whole[list(dynamics.dofs)] = np.asarray(found.motion)
    sizes = dynamics.cycle.system.structure.map.sizes
    parts = np.split(whole[: sum(sizes)].reshape(-1, 6), [sizes[0] // 6])
    divisions = (len(parts[0]) - 1) // (len(given.PINION.stations) - 1)
    return dict(zip(GEARS, (part[::divisions, [0, 1, 3, 4]] for part in parts), strict=True))


def _in_ross(gear: str, shaft: str) -> np.ndarray:
    parts = np.asarray(_recorded()[gear]["response"][shaft])
    return parts[:, :, 0] + 1j * parts[:, :, 1]


def _ratio(gear: str) -> float:
    """Speed of a gear over that of the pinion."""
    return given.PINION.teeth / given.ROTORS[gear].teeth


@pytest.mark.slow
@pytest.mark.parametrize("gear", GEARS)
def test_another_program_finds_the_same_motion(gear):
    """Amplitudes and phases of both shafts, to 1e-6 of the largest along or about an axis."""
    for k, speed in enumerate(given.ROTORS[gear].speeds):
        for shaft, motion in _motion(_dynamics(), gear, speed).items():
            wanted = _in_ross(gear, shaft)[k]
            for kind in (slice(0, 2), slice(2, 4)):
                off = np.max(np.abs(motion[:, kind] - wanted[:, kind]))
                assert off < 1e-6 * np.max(np.abs(wanted[:, kind])), (speed, shaft)


@pytest.mark.slow
@pytest.mark.parametrize("gear", GEARS)
def test_another_program_finds_the_same_critical_speeds(gear):
    """Those that unbalance excites are among them, and each is a mode's frequency here too."""
    system, wanted = _dynamics().system, np.asarray(_recorded()[gear]["critical_rad_s"])
    found = _ratio(gear) * jg.unbalance_critical_speeds(_dynamics(), _unbalance(gear))
    found = found[found < given.ROTORS[gear].speeds[-1]]
    assert system.gyroscopic is not None
    assert len(found) >= 2
    assert np.max(np.min(np.abs(wanted / found[:, None] - 1.0), axis=1)) < 1e-7
    speeds = jnp.asarray(wanted / _ratio(gear))
    natural = (
        2.0
        * np.pi
        * np.asarray(
            jg.rotating_frequencies(
                system.mass, system.whole_stiffness, system.gyroscopic, system.free, speeds
            )
        )
    )
    assert np.max(np.nanmin(np.abs(natural / wanted[:, None] - 1.0), axis=1)) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("gear", GEARS)
def test_modes_of_single_elements_are_no_critical_speeds(gear):
    """No gear turns faster than 1000 m/s at its tip, 25.6 krad/s; elements have modes there."""
    dynamics, unbalance = _dynamics(), _unbalance(gear)
    found = jg.unbalance_critical_speeds(dynamics, unbalance)
    every = jg.unbalance_critical_speeds(dynamics, unbalance, highest=math.inf)
    assert every[-1] > 1e6
    tip = float(dynamics.cycle.system.pair.tip_radius[0])
    np.testing.assert_allclose(found, every[tip * every < 1000.0], rtol=1e-12)
    assert len(found) < len(every)
    few = jg.unbalance_critical_speeds(dynamics, unbalance, highest=3000.0)
    np.testing.assert_allclose(few, every[every < 3000.0], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("gear", GEARS)
def test_elements_of_shafts_are_fine_enough_by_default(gear):
    """With one element between two stations, against eight: critical speeds and motion."""
    unbalance, coarse, fine = _unbalance(gear), _dynamics(1), _dynamics(8)
    top = given.ROTORS[gear].speeds[-1]
    critical = [jg.unbalance_critical_speeds(each, unbalance) for each in (coarse, fine)]
    # All that are told are of the shafts, not of single elements.
    np.testing.assert_allclose(critical[0], critical[1], rtol=0.08)
    critical = [_ratio(gear) * each[_ratio(gear) * each < top] for each in critical]
    assert len(critical[0]) == len(critical[1]) >= 2
    assert np.max(np.abs(critical[0] / critical[1] - 1.0)) < 1e-3
    for speed in given.ROTORS[gear].speeds[:-2]:
        found, wanted = (_motion(each, gear, speed)[gear][:, :2] for each in (coarse, fine))
        assert np.max(np.abs(found - wanted)) < 0.01 * np.max(np.abs(wanted)), speed
