"""Condensed gear bodies in motion, against plain NumPy on the turning body, limits, and each other.

The small wheel of `hybrid_cases` has 24 teeth on 24 equal sectors: its waves are its nodal
diameters. It turns backwards about Z.
"""

import dataclasses
import functools
import math
from typing import Any

import equinox as eqx
import hybrid_cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fem_cases import assert_near
from helpers import observed_order
from hybrid_cases import (
    APART,
    PAIRS,
    ROUND,
    TEETH,
    Turning,
    loaded_shaft,
    relieved,
    shaft,
    vibrating,
)

import jaxgear as jg
from fem_prep import ReducedBody
from jaxgear import um
from jaxgear._dynamics._bodies import turning_terms, vibrating_bodies
from jaxgear._dynamics._cell_forces import cell_forces
from jaxgear._dynamics._damping import ModalDamping, RayleighDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import TimeStepping, quasi_static_start, time_history
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import steady_state, steady_states
from jaxgear._dynamics._steppers import Exponential, Midpoint, Newmark
from jaxgear._dynamics._system import DynamicSystem, PairDynamics
from jaxgear._dynamics._table import MIDDLE, mesh_at
from jaxgear._response._dynamic import dynamic_transmission_error, orbit_variance
from jaxgear._system._body_modes import body_basis
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import foot_tables, mode_arms
from jaxgear._system._gear_body import RigidBody
from jaxgear._system._model import PairModel

# Interior shapes and terms of rotation; all modes up to 60 kHz.
WHEEL = {"modes": 8, "rotating": True}
MODES, RATIO = 24, TEETH[0] / TEETH[1]
FEW = 6
# Stiffer along T than along S: on the body they would change as it turns.
UNLIKE = jg.Support(1e8, 2.5e8, 3e8, 1e5)

_made = eqx.filter_jit(
    lambda model, grid, damping, whole, coordinates: pair_dynamics(
        model, grid, damping, gyroscopic=whole, mesh_coordinates=coordinates
    )
)
_steady = eqx.filter_jit(steady_states)


@functools.cache
def _grid(phases: int = 15, kind: str = "spur", periods: int = 1) -> jg.MeshGrid:
    return jg.mesh_grid(PAIRS[kind](), phases=phases, slices=2, periods=periods)


def _model(grid: jg.MeshGrid, count: int = MODES, factor: float = 1.0, **others) -> PairModel:
    """A rigid pinion and the condensed wheel, light enough for one cell or the other to open."""
    parts: dict = {"flanks": relieved(), "pinion_support": ROUND, "wheel_support": ROUND}
    parts["compliance"] = APART
    if "wheel_body" not in others:
        parts["wheel_body"] = vibrating("spur", 1, grid, count, factor, **WHEEL)
    return PairModel(PAIRS["spur"](), 20.0, **{**parts, **others})


def _mass_damped(rate: float = 1500.0) -> RayleighDamping:
    """In proportion to mass: a ratio of 1 % at 12 kHz."""
    return RayleighDamping(rate, 0.0)


@functools.cache
def _pair(
    rate: float = 1500.0,
    factor: float = 1.0,
    phases: int = 15,
    coordinates: int = FEW,
    alike: bool = True,
    count: int = MODES,
) -> PairDynamics:
    """With all terms of rotation. Whatever is given, but for the steps: one program."""
    grid = _grid(phases)
    others = {} if alike else {"pinion_support": UNLIKE, "wheel_support": UNLIKE}
    model = _model(grid, count, factor, **others)
    return _made(model, grid, _mass_damped(rate), True, coordinates)


@eqx.filter_jit
def _terms(model: PairModel, grid: jg.MeshGrid, dynamics: PairDynamics, damping: RayleighDamping):
    bodies = vibrating_bodies(model, dynamics.cycle.system, grid)
    size = max(dynamics.dofs) + 1
    return turning_terms(bodies, size, damping, whole=False)


def _by_default(rate: float = 1500.0) -> DynamicSystem:
    """The same pair without terms of rotation of the body: waves alone turn with it."""
    dynamics, grid = _pair(rate), _grid()
    terms = _terms(_model(grid), grid, dynamics, _mass_damped(rate))
    dofs = np.asarray(dynamics.dofs)
    among = lambda x: x[dofs[:, None], dofs] if x.ndim == 2 else x[dofs]
    terms = jax.tree.map(among, terms)
    return dataclasses.replace(dynamics.system, gyroscopic=terms.gyroscopic, turning=terms)


def _seat(dynamics: PairDynamics) -> np.ndarray:
    """Columns of the wheel's seat: three translations, three rotations."""
    return np.array([dynamics.dofs.index(dof) for dof in dynamics.bodies[0].seats[:6]])


def _modes(dynamics: PairDynamics) -> np.ndarray:
    """Columns of the wheel's modes."""
    first = dynamics.bodies[0].first
    return dynamics.dofs.index(first) + np.arange(len(dynamics.bodies[0].waves))


# --- At rest


@jax.jit
def _cells(system: DynamicSystem, speed: float = 0.0):
    """Forces of all cells at the quasi-static mesh coordinates."""
    meshes = mesh_at(system.table, MIDDLE).at(jnp.asarray(speed))
    pressed = jax.vmap(lambda mesh, place: cell_forces(mesh, place, jg.ExactContact())[0])
    return system.table.on_all_cells(pressed(meshes, system.rest))


def _same_at_rest(dynamics: PairDynamics, speed: float = 0.0) -> None:
    """Cell forces at the quasi-static mesh coordinates are those of the cycle."""
    system, force = dynamics.system, np.asarray(dynamics.cycle.force)
    assert np.asarray(dynamics.cycle.converged).all()
    assert_near(np.asarray(_cells(system, speed)), force, 1e-10)
    assert ((force == 0.0) & (np.asarray(system.table.stiffness) > 0.0)).any()


@pytest.mark.slow
def test_statics_has_what_few_modes_and_coordinates_leave_out():
    dynamics = _pair()
    assert dynamics.system.vectors.shape[1] == 2 + FEW
    assert 1e-5 < float(dynamics.left_out) < 1e-3
    _same_at_rest(dynamics)


@pytest.mark.slow
def test_what_mesh_coordinates_leave_out_gives_way_under_any_load():
    coupling = np.asarray(_pair().system.table.coupling)
    assert np.linalg.eigvalsh(coupling).min() > -1e-9 * np.abs(coupling).max()


@pytest.mark.slow
@pytest.mark.parametrize("coordinates", [2, 12])
@pytest.mark.parametrize("count", [7, 24])
def test_statics_of_two_condensed_gears(coordinates, count):
    """Helical, the wheel with its shaft on three bearings, that are not the same along S and T."""
    grid = _grid(8, "helical")
    model = PairModel(
        PAIRS["helical"](),
        150.0,
        flanks=relieved(),
        speed=2000.0,
        pinion_support=UNLIKE,
        wheel_support=shaft(),
        pinion_body=vibrating("helical", 0, grid, count),
        wheel_body=vibrating("helical", 1, grid, count, seats="shaft"),
    )
    dynamics = _made(model, grid, ModalDamping(), False, coordinates)
    assert len(dynamics.bodies) == 2
    found = _cells(dynamics.system)
    assert np.asarray(dynamics.cycle.converged).all()
    assert_near(np.asarray(found), np.asarray(dynamics.cycle.force), 1e-10)


def _beam(kind: str) -> dict[str, Any]:
    """A pinion whose body is a beam, on its shaft; the second bearing holds it along Z."""
    pair = PAIRS[kind]()
    width, outer = pair.pinion.face_width, 2.0 * pair.root_radius[0]
    bearings = [
        jg.Bearing(5e-3, 2e8, 3e8),
        jg.Bearing(50e-3, 3e8, 3e8, 1e8, 1e4, 1e4),
    ]
    segments = [jg.Segment(56e-3, 14e-3)]
    mount = jg.Shaft(segments, bearings, gear_at=25e-3, torque_at=2e-3, body_width=width)
    return {"pinion_support": mount, "pinion_body": jg.BeamBody(width, outer)}


@pytest.mark.slow
def test_statics_of_a_beam_beside_a_condensed_wheel_with_a_load_on_its_shaft():
    """The beam winds up and bows, and with it what its shaft lets its sections do."""
    grid = _grid(8, "helical")
    wheel = vibrating("helical", 1, grid, MODES, seats="shaft")
    wheel = dataclasses.replace(wheel, load_seats=(1,))
    parts: dict[str, Any] = {
        "flanks": relieved(),
        "wheel_support": loaded_shaft(1.5e-3),
        "wheel_body": wheel,
    }
    model = PairModel(PAIRS["helical"](), 150.0, **parts, **_beam("helical"))
    dynamics = _made(model, grid, ModalDamping(), False, FEW)
    assert dynamics.system.vectors.shape[1] == 7 + FEW
    found = _cells(dynamics.system)
    assert np.asarray(dynamics.cycle.converged).all()
    assert_near(np.asarray(found), np.asarray(dynamics.cycle.force), 1e-10)


# --- The body's own frame


@functools.cache
def _marching(cycles: int):
    return eqx.filter_jit(
        lambda system, speed: time_history(
            system,
            speed,
            quasi_static_start(system),
            cycles=cycles,
            keep=cycles,
            stepper=Midpoint(),
        )
    )


def _apart(phases: int) -> float:
    """Transmission error of a transient at constant speed from that of a march, over its swing."""
    system, cycles = _pair(phases=phases, count=7, coordinates=12).system, 2
    speed = jnp.asarray(1500.0)
    marched = _marching(cycles)(system, speed).motion @ system.transmission
    ends = np.arange(cycles)[:, None] + np.asarray(system.table.edges)[None, 1:]
    times = jnp.asarray(float(system.mesh_period(speed)) * np.append(0.0, ends.ravel()))
    start, law = quasi_static_start(system), jg.ExactContact()
    found = jg.transient(system, speed, 1.0, start, times, law=law, rtol=1e-6, atol=1e-6)
    error = np.asarray(found.transmission_error)[1:]
    return np.abs(error - np.asarray(marched)).max() / np.ptp(error)


@pytest.mark.slow
def test_a_transient_at_constant_speed_is_what_a_march_tends_to():
    """With all terms of rotation and growth; the march is of the second order in its steps."""
    coarse, fine = _apart(60), _apart(120)
    assert fine < 0.05
    assert fine < 0.4 * coarse


@pytest.mark.slow
def test_a_slow_run_up_passes_through_the_responses_at_constant_speed():
    """A run-up by 1 % over sixty mesh periods, after which its start is forgotten."""
    system, law = _pair(6000.0, phases=60, count=7, coordinates=12).system, jg.ExactContact()
    method = TimeStepping(law=law, cycles=300, stepper=Exponential())
    speeds = jnp.asarray([1500.0, 1515.0])
    first, last = (eqx.filter_jit(method.orbit)(system, speed) for speed in speeds)
    swing = [
        float(np.ptp(np.asarray(dynamic_transmission_error(system, x)))) for x in (first, last)
    ]
    period = float(system.mesh_period(jnp.asarray(1507.5)))
    times = jnp.linspace(0.0, 60.0 * period, 1201)
    ramp = jg.Schedule(jnp.asarray([0.0, 60.0 * period]), speeds)
    found = jg.transient(
        system, ramp, 1.0, quasi_static_start(system), times, law=law, rtol=1e-5, atol=1e-5
    )
    assert bool(found.complete)
    late = np.asarray(found.transmission_error)[-60:]
    assert min(swing) * 0.9 < np.ptp(late) < max(swing) * 1.1


def _off(phases: int, cycles: int, speed: float, coordinates: int, count: int) -> np.ndarray:
    """Differences of the mesh force in each mesh period, over the largest force."""
    rate, grid = 300.0, _grid(phases)
    dynamics = _pair(rate, 1.0, phases, coordinates, count=count)
    history = _marching(cycles)(dynamics.system, jnp.asarray(speed))
    assert bool(history.converged)
    body = hybrid_cases.body("spur", 1, **WHEEL)
    basis = hybrid_cases.basis_of("spur", 1, count, **WHEEL)
    judge = Turning(_model(grid, count), grid, dynamics, body, basis, damping=rate)
    force = judge.march(speed, cycles)
    off = np.abs(np.asarray(history.load)[:, 0] - force).reshape(cycles, phases)
    return off / force.max()


@pytest.mark.slow
def test_a_march_in_space_is_one_on_the_turning_body():
    off = _off(15, 2, 3900.0, FEW, MODES).max(axis=1)
    assert off[0] < 1e-3
    assert off[1] < 5e-3


@pytest.mark.slow
def test_frames_agree_to_the_order_of_the_time_step():
    """The midpoint rule has its second order in each frame: so has what they differ by.

    All modes must be slow enough for the time step, and all mesh coordinates be there.
    """
    off = [_off(phases, 2, 3900.0, 6, 6) for phases in (16, 32, 64)]
    rms = [float(np.sqrt(np.mean(each**2))) for each in off]
    assert rms[0] < 1e-4
    steps = [1.0 / 16, 1.0 / 32, 1.0 / 64]
    assert observed_order(steps, rms) == pytest.approx(2.0, abs=0.1)


# --- Seen from space


def _without_mesh(dynamics: PairDynamics, speed: float) -> np.ndarray:
    """Stiffness; what then turns freely, the wheel, has a spring."""
    system, spin = dynamics.system, _seat(dynamics)[5]
    matrix = np.array(system.stiffness_at(jnp.asarray(speed)) - system.mesh_stiffness)
    matrix[spin, spin] += 1e5
    return matrix


def _rigid_mass() -> np.ndarray:
    """Mass of the wheel about mid-face, in rigid motions."""
    body = hybrid_cases.body("spur", 1, **WHEEL)
    basis = hybrid_cases.basis_of("spur", 1, MODES, **WHEEL)
    return basis.following.T @ body.mass @ basis.following


@pytest.mark.slow
def test_a_load_fixed_in_space_moves_a_stiff_wheel_the_same_at_every_speed():
    dynamics = _pair(1500.0, 1e6)
    seat = _seat(dynamics)
    mass = _rigid_mass()[0, 0]
    for column, stiffness in zip(seat[:5], (1e8, 1e8, 3e8, 1e5, 1e5), strict=True):
        load = np.zeros(len(dynamics.dofs))
        load[column] = 1.0
        for speed in (1.0, 4000.0):
            moved = np.linalg.solve(_without_mesh(dynamics, speed), load)
            assert moved[column] * stiffness == pytest.approx(1.0, rel=1e-6)
        still = np.linalg.solve(_without_mesh(dynamics, 1.0), load)
        apart = np.linalg.norm((moved - still)[seat[:3]]) / np.linalg.norm(still)
        assert apart < 1e-8
    # Held on the body without Coriolis and centrifugal forces it would miss by so much.
    assert mass * (4000.0 * RATIO) ** 2 / 1e8 > 5e-3


@pytest.mark.slow
def test_rates_of_a_stiff_wheel_are_those_of_a_gyroscope():
    dynamics = _pair(1500.0, 1e6)
    seat = _seat(dynamics)
    speed, own = 4000.0, -4000.0 * RATIO
    mass, polar = np.diagonal(_rigid_mass())[[0, 5]]
    system = dynamics.system
    whirl = np.asarray(system.rates_at(jnp.asarray(speed)) - system.damping)
    np.testing.assert_allclose(whirl, -whirl.T, atol=1e-12 * np.abs(whirl).max())
    block = whirl[seat[:, None], seat]
    # M_x = -I_p Omega' theta_y' on the body, hence a force with the other sign on the left.
    wanted = np.zeros((6, 6))
    wanted[3, 4], wanted[4, 3] = polar * own, -polar * own
    size = np.sqrt([mass] * 3 + [polar] * 3)
    assert_near(block / size[:, None] / size, wanted / size[:, None] / size, 1e-8)


@pytest.mark.slow
def test_seats_are_in_space_by_default():
    system, dynamics = _by_default(), _pair()
    seat = _seat(dynamics)
    terms = system.turning
    assert terms is not None
    for matrix in (terms.gyroscopic, terms.circulatory, terms.softening):
        size = np.abs(matrix).max()
        assert np.abs(np.asarray(matrix)[seat]).max() < 1e-12 * size
        assert np.abs(np.asarray(matrix)[:, seat]).max() < 1e-12 * size
    modes = _modes(dynamics)
    waves = np.asarray(dynamics.bodies[0].waves)
    softening = np.diagonal(np.asarray(terms.softening))[modes]
    # A pattern of n waves that stands still in space passes the body n times a turn.
    np.testing.assert_allclose(
        softening, -(np.where(abs(waves) >= 2, waves * RATIO, 0) ** 2), atol=1e-12
    )
    # And its rate of change on the body is damped there.
    spun = np.asarray(terms.circulatory)[modes[:, None], modes]
    first = np.flatnonzero(waves >= 2)
    np.testing.assert_allclose(
        np.abs(spun[first, first + 1]), 1500.0 * waves[first] * RATIO, rtol=1e-6
    )


# --- Waves


def _wave(dynamics: PairDynamics, orbit, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes of a pair's waves at the mesh frequency, with the wheel's sense and against it."""
    waves = dynamics.bodies[0].waves
    first = int(_modes(dynamics)[waves.index(number)])
    motion = np.asarray(orbit.motion)
    pair = motion[..., first] + 1j * motion[..., first + 1]
    table = dynamics.system.table
    turn = np.exp(-2j * np.pi * np.asarray(table.middles)) * np.asarray(table.lengths)
    # A pattern at angle n alpha is e^{i n alpha}; the wheel turns backwards about Z.
    return np.abs(pair @ turn.conj()), np.abs(pair @ turn)


@pytest.mark.slow
def test_waves_peak_where_the_mesh_meets_them():
    """With the terms of rotation, and without, when both waves are equally fast on the body."""
    dynamics, number = _pair(), 2
    body = hybrid_cases.body("spur", 1, **WHEEL)
    basis = hybrid_cases.basis_of("spur", 1, MODES, **WHEEL)
    omega, shapes = math.sqrt(basis.square[2]), basis.shapes[:, 2:4]
    assert list(basis.waves[2:4]) == [2, -2]
    assert body.coriolis is not None
    # On the body, omega^2 +- 2 split Omega omega = omega_0^2 + spun Omega^2, + for forward waves.
    split = 0.5 * abs((shapes.T @ body.coriolis @ shapes)[0, 1])
    assert body.stress_stiffening is not None
    assert body.spin_softening is not None
    softened = body.stress_stiffening - body.spin_softening
    spun = float((shapes.T @ softened @ shapes)[0, 0])
    # At omega = (Z -+ n) Omega.
    sides = np.array([TEETH[1] - number, TEETH[1] + number])
    met = sides**2 + 2.0 * split * np.array([1.0, -1.0]) * sides - spun
    speeds = np.r_[3310.0:3451.0:10.0, 3910.0:4051.0:10.0]
    peaks = []
    for system, squares in ((dynamics.system, met), (_by_default(), sides**2)):
        orbits = _steady(system, jnp.asarray(speeds), HarmonicBalance(harmonics=7))
        assert np.asarray(orbits.settled).all()
        forward, backward = _wave(dynamics, orbits, number)
        at, back = int(np.argmax(forward)), int(np.argmax(backward))
        # The mesh stiffens it a little.
        found, wanted = speeds[[at, back]], omega / np.sqrt(squares) / RATIO
        assert (found > wanted).all()
        np.testing.assert_allclose(found, wanted, rtol=0.025)
        assert forward[at] > 8.0 * backward[at]
        assert backward[back] > 3.0 * forward[back]
        peaks.append((found, wanted))
    (found, wanted), (found_without, wanted_without) = peaks
    np.testing.assert_allclose(found - found_without, wanted - wanted_without, atol=12.0)
    assert abs(wanted - wanted_without).min() > 25.0


# --- Limits


def _rigid(support: jg.Support, rate: float, **pinion: Any) -> PairDynamics:
    """The wheel as a rigid body of the same mass, its own foundation left out."""
    whole = _rigid_mass()
    parts: dict[str, Any] = {"pinion_support": support, **pinion}
    model = PairModel(
        PAIRS["spur"](),
        20.0,
        flanks=relieved(),
        compliance=APART.without((1,)),
        wheel_support=support,
        wheel_body=RigidBody(whole[0, 0], whole[5, 5], whole[3, 3]),
        **parts,
    )
    dynamics = _made(model, _grid(), _mass_damped(rate), True, FEW)
    # The web is off the middle of the rim: the centre of mass is not at mid-face.
    first = dynamics.cycle.system.structure.map.dofs["wheel gear"]
    wheel = np.array([dynamics.dofs.index(first + k) for k in range(6)])
    system = dynamics.system
    more = jnp.zeros_like(system.mass)
    more = more.at[wheel[:, None], wheel].set(whole) - more.at[wheel[:, None], wheel].set(
        system.mass[wheel[:, None], wheel]
    )
    assert np.abs(np.asarray(more)).max() > 1e-6
    system = dataclasses.replace(
        system, mass=system.mass + more, damping=system.damping + rate * more
    )
    return dataclasses.replace(dynamics, system=system)


@pytest.mark.slow
@pytest.mark.parametrize("alike", [True, False])
def test_a_rigidified_wheel_runs_as_a_rigid_one(alike):
    """Also on bearings that are stiffer along T: seats are in space."""
    # Damped well: a light pair has more than one response near its resonances.
    rate = 6000.0
    rigid = _rigid(ROUND if alike else UNLIKE, rate)
    method = HarmonicBalance(harmonics=7)
    speeds = jnp.linspace(300.0, 3500.0, 17)
    wanted = _steady(rigid.system, speeds, method)
    static = float(rigid.system.force)
    swing = np.ptp(np.asarray(wanted.load)[:, :, 0], axis=1) / static
    assert swing.max() > 0.3
    across = [rigid.dofs.index(dof) for dof in range(6, 11)]
    found = []
    for factor in (1e4, 1e6):
        dynamics = _pair(rate, factor, alike=alike)
        orbits = _steady(dynamics.system, speeds, method)
        # Newton's method may go round where a cell just opens.
        kept = np.asarray(orbits.settled & wanted.settled)
        assert kept.sum() >= 14
        ours, theirs = (np.asarray(each.load)[kept][:, :, 0] for each in (orbits, wanted))
        force = np.abs(ours - theirs)
        seat = np.asarray(orbits.motion)[kept][:, :, _seat(dynamics)[:5]]
        body = np.asarray(wanted.motion)[kept][:, :, across]
        moved = np.abs(seat - body).max(axis=(0, 1)) / np.abs(body).max(axis=(0, 1)).max()
        found.append((force.max() / static, moved[:2].max()))
    # Both are of the first order in the body's flexibility.
    assert found[0][0] < 1e-2
    for first, second in zip(*found, strict=True):
        assert second < 0.05 * first


@pytest.mark.slow
def test_a_rigidified_wheel_beside_a_beam_runs_as_a_rigid_one():
    """Apart from harmonics of what bows the beam, which its own mesh leaves out."""
    rate, method, grid = 6000.0, HarmonicBalance(harmonics=7), _grid()
    rigid = _rigid(UNLIKE, rate, **_beam("spur"))
    speeds = jnp.asarray([500.0, 900.0, 1700.0, 2600.0])
    wanted = _steady(rigid.system, speeds, method)
    model = _model(grid, factor=1e6, wheel_support=UNLIKE, **_beam("spur"))
    dynamics = _made(model, grid, _mass_damped(rate), True, FEW)
    orbits = _steady(dynamics.system, speeds, method)
    assert np.asarray(orbits.settled & wanted.settled).all()
    ours, theirs = (np.asarray(each.load)[:, :, 0] for each in (orbits, wanted))
    static = float(rigid.system.force)
    assert np.ptp(theirs, axis=1).max() > 0.3 * static
    assert np.abs(ours - theirs).max() < 1e-3 * static


@pytest.mark.slow
def test_more_modes_come_closer_and_statics_helps_them():
    """The largest mesh force of 6 and 24 modes against 80, with and without the rest of the
    flexibility."""
    grid, speeds = _grid(), jnp.linspace(1200.0, 4200.0, 13)
    method, rate = HarmonicBalance(harmonics=7), 1500.0
    peaks: dict[tuple[int, bool], np.ndarray] = {}
    for count in (80, 24, 6):
        model = _model(grid, count)
        dynamics = _made(model, grid, _mass_damped(rate), True, 12)
        for whole in (True, False):
            system = dynamics.system
            if not whole:
                table = _without_rest(model, dynamics)
                system = dataclasses.replace(system, table=table)
            orbits = _steady(system, speeds, method)
            peaks[count, whole] = np.asarray(orbits.load)[:, :, 0].max(axis=1)
            peaks[count, whole][~np.asarray(orbits.settled)] = np.nan
    best = peaks[80, True]
    off = {key: np.nanmedian(np.abs(peak / best - 1.0)) for key, peak in peaks.items()}
    assert off[24, True] < off[6, True]
    assert off[24, True] < 0.03
    for count in (6, 24):
        assert off[count, True] < 0.5 * off[count, False]


@eqx.filter_jit
def _rest_of(model: PairModel, dynamics: PairDynamics):
    lines, body = dynamics.cycle.cells.lines, model.wheel_body
    assert isinstance(body, FlexibleBody)
    assert body.modes is not None
    tables = foot_tables(model.pair, 1, body, lines)
    arms = mode_arms(model.pair, 1, body, lines)
    return tables.compliance - (arms / body.modes.square[None, None, :]) @ jnp.swapaxes(arms, 1, 2)


def _without_rest(model: PairModel, dynamics: PairDynamics):
    """Cells that feel of the body what its modes show alone."""
    table = dynamics.system.table
    rest = _rest_of(model, dynamics)
    assert table.coupling is not None
    assert np.linalg.eigvalsh(np.asarray(rest)).min() > -1e-6 * np.abs(np.asarray(rest)).max()
    return dataclasses.replace(table, coupling=table.coupling - rest)


# --- Methods


def _even(system: DynamicSystem) -> DynamicSystem:
    """The same cells, but at steps of one length."""
    steps = len(system.table.kinds)
    table = dataclasses.replace(
        system.table, edges=jnp.linspace(0.0, system.table.periods, steps + 1), kinds=(0,) * steps
    )
    return dataclasses.replace(system, table=table)


@pytest.mark.slow
def test_bilinear_harmonics_are_the_midpoint_rule():
    system = _even(_pair().system)
    # With so few steps there are two responses at some lower speeds.
    speeds = jnp.asarray([2200.0, 3390.0, 3960.0])
    harmonic = _steady(system, speeds, HarmonicBalance(harmonics=7, bilinear=True, tolerance=1e-12))
    shot = _steady(system, speeds, Shooting(stepper=Midpoint(), tolerance=1e-13))
    assert np.asarray(harmonic.settled & shot.settled).all()
    for one, other in ((harmonic.load, shot.load), (harmonic.motion, shot.motion)):
        assert_near(np.asarray(one), np.asarray(other), 1e-10)


@pytest.mark.slow
def test_harmonics_and_shooting_agree_on_a_mesh_that_damps_in_contact():
    """But for the rates of closed cells, in which steps and harmonics differ."""
    grid = _grid()
    make = eqx.filter_jit(lambda m: pair_dynamics(m, grid, active_mesh_damping=True))
    system, speeds = _even(make(_model(grid)).system), jnp.asarray([2200.0, 3390.0, 3960.0])
    harmonic = _steady(system, speeds, HarmonicBalance(harmonics=7, bilinear=True))
    shot = _steady(system, speeds, Shooting(stepper=Midpoint()))
    assert system.cell_damping is not None
    less = dataclasses.replace(system, cell_damping=0.3 * system.cell_damping)
    other = _steady(less, speeds, HarmonicBalance(harmonics=7, bilinear=True))
    assert np.asarray(harmonic.settled & shot.settled & other.settled).all()
    loads = [np.asarray(each.load)[:, :, 0] for each in (harmonic, shot, other)]
    off, moved = (np.abs(each - loads[0]).max() / np.ptp(loads[0]) for each in loads[1:])
    assert off < 0.02
    assert moved > 5.0 * off


def _off_shooting(phases: int) -> np.ndarray:
    """Of harmonic balance and of a long march, at a forward wave's critical speed and elsewhere."""
    system = _pair(phases=phases).system
    speeds = jnp.asarray([1700.0, 3960.0])
    harmonic = _steady(system, speeds, HarmonicBalance(harmonics=phases // 2 - 2))
    shot = _steady(system, speeds, Shooting(stepper=Exponential()))
    long = _steady(system, speeds, TimeStepping(stepper=Newmark(), cycles=400))
    assert np.asarray(harmonic.settled & shot.settled & long.settled).all()
    force = [np.asarray(orbit.load)[:, :, 0] for orbit in (harmonic, shot, long)]
    swing = np.ptp(force[1], axis=1)
    return np.array([np.abs(force[i] - force[1]).max(axis=1) / swing for i in (0, 2)])


@pytest.mark.slow
def test_harmonics_shooting_and_a_long_march_tend_to_one_response():
    """Teeth without relief meet with a jump, for which 64 steps in a mesh period are few."""
    coarse, fine = (_off_shooting(phases) for phases in (64, 128))
    assert coarse.max() < 0.08
    assert (fine[0] < 0.4 * coarse[0]).all()
    assert (fine[1] < 0.9 * coarse[1]).all()


# --- Derivatives

NAMES = ("relief depth", "speed", "bearing")


@pytest.mark.slow
def test_gradients_of_a_steady_state():
    """Variance of the dynamic transmission error, by implicit differentiation."""
    grid = _grid()
    body = vibrating("spur", 1, grid, MODES, **WHEEL)
    method = HarmonicBalance(harmonics=7, tolerance=1e-12)

    @jax.jit
    @jax.value_and_grad
    def variance(factors):
        depth, faster, stiffer = factors
        relief = jg.TipRelief(12.0 * um * depth, 0.3)
        flanks = jg.Flanks(jg.Superposed(parts=(relief, jg.Crowning(5.0 * um))), relief)
        support = jg.Support(1e8 * stiffer, 1.2e8 * stiffer, 3e8, 1e5)
        model = _model(grid, flanks=flanks, wheel_support=support, wheel_body=body)
        dynamics = pair_dynamics(model, grid, gyroscopic=True, mesh_coordinates=FEW)
        orbit = steady_state(dynamics.system, 2200.0 * faster, method)
        error = dynamic_transmission_error(dynamics.system, orbit) / um
        return orbit_variance(dynamics.system, error)

    at, step = jnp.ones(3), 1e-5
    value, gradient = variance(at)
    for i, name in enumerate(NAMES):
        away = step * jnp.eye(3)[i]
        central = float((variance(at + away)[0] - variance(at - away)[0]) / (2.0 * step))
        assert abs(central) > 1e-3 * float(value)
        assert float(gradient[i]) == pytest.approx(central, rel=1e-4), name


# --- Holes


def _turned_by_a_tooth(body):
    """The same body with its holes one tooth further along the angle."""
    angle = 2.0 * math.pi / TEETH[1]
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rim, seats = len(body.rim_nodes), len(body.seats)
    whole = np.eye(body.dofs)
    first = 3 * rim + 6 * seats
    whole[:first, :first] = np.kron(np.eye(rim + 2 * seats), turn)
    return dataclasses.replace(
        body,
        stiffness=whole @ body.stiffness @ whole.T,
        mass=whole @ body.mass @ whole.T,
        centrifugal_load=whole @ body.centrifugal_load,
        rim_nodes=body.rim_nodes @ turn.T,
    )


@pytest.mark.slow
def test_holes_are_seen_again_after_their_teeth():
    """Three holes under 24 teeth: a response over eight mesh periods, which turns with them."""
    grid, kind = _grid(15, periods=8), "spur"
    own = hybrid_cases.body(kind, 1, holes=3, modes=8)
    orbits = []
    for body in (own, _turned_by_a_tooth(own)):
        flexible = flexible_body(body, PAIRS[kind](), 1, grid, basis=body_basis(body, 6))
        assert flexible.repeats == 8
        assert flexible.periods == 8
        model = _model(grid, wheel_body=flexible)
        system = _made(model, grid, _mass_damped(), False, FEW).system
        orbits.append(_steady(system, jnp.asarray([2200.0]), HarmonicBalance(harmonics=7)))
    force = [np.asarray(orbit.load)[0, :, 0] for orbit in orbits]
    assert all(np.asarray(orbit.settled).all() for orbit in orbits)
    period = force[0].reshape(8, 15)
    assert np.ptp(period, axis=0).max() > 0.02 * np.ptp(force[0])
    # What was under tooth 0 is one mesh period later.
    assert_near(force[1], np.roll(force[0], 15), 1e-6)
    # And a march comes to the same, up to the harmonics that are left out.
    even = _even(system)
    bilinear = HarmonicBalance(harmonics=7, bilinear=True)
    balanced = np.asarray(_steady(even, jnp.asarray([2200.0]), bilinear).load)[0, :, 0]
    history = eqx.filter_jit(
        lambda s: time_history(
            s, jnp.asarray(2200.0), quasi_static_start(s), cycles=12, keep=1, stepper=Midpoint()
        )
    )(even)
    assert bool(history.converged)
    marched = np.asarray(history.load)[:, 0]
    assert np.abs(marched - balanced).max() < 0.05 * np.ptp(balanced)


@dataclasses.dataclass(frozen=True)
class _Holes:
    """Holes in both gears, and the mesh periods after which both are themselves again."""

    wheel: int
    periods: int
    further: int = 0
    pinion: int = 0


# An odd number of holes, even ones, two rings of holes, and holes in both gears.
_HOLES = {
    "3": _Holes(3, 8),
    "4": _Holes(4, 12),
    "6": _Holes(6, 8),
    "6 and 6": _Holes(6, 8, further=6),
    "6 and 10 in the pinion": _Holes(6, 8, pinion=10),
}


def _bodies(holes: _Holes, grid: jg.MeshGrid) -> dict[str, FlexibleBody]:
    """Condensed bodies of the gears that have holes, in mesh."""
    shapes = {"wheel": {"holes": holes.wheel, "further": holes.further}}
    if holes.pinion:
        shapes["pinion"] = {"holes": holes.pinion}
    found = {}
    for gear, shape in shapes.items():
        index = ("pinion", "wheel").index(gear)
        body = hybrid_cases.body("spur", index, modes=8, **shape)
        basis = body_basis(body, MODES)
        # In some modes sectors move against their neighbours, if their number is even.
        assert (2 * basis.waves == shape["holes"]).any() == (shape["holes"] % 2 == 0)
        found[gear] = flexible_body(body, PAIRS["spur"](), index, grid, basis=basis)
    return found


def _system_over(holes: _Holes, periods: int) -> DynamicSystem:
    """A pair in motion whose gears have holes, over so many mesh periods."""
    grid = _grid(15, periods=periods)
    bodies: dict[str, Any] = {f"{gear}_body": body for gear, body in _bodies(holes, grid).items()}
    return _made(_model(grid, **bodies), grid, _mass_damped(), False, FEW).system


def _of_sectors(body: ReducedBody, sectors: int) -> ReducedBody:
    """The same body, which claims so many sectors."""
    return dataclasses.replace(body, facts={**body.facts, "sectors": sectors})


@pytest.mark.slow
def test_a_cycle_that_ends_where_holes_are_not_the_same_is_refused():
    """Six holes under 24 teeth come again after four mesh periods, but with modes turned over."""
    with pytest.raises(ValueError, match=r"repeats under its teeth after 8 mesh periods.*over 4"):
        _system_over(_HOLES["6"], 4)


def test_two_holes_are_refused_in_motion():
    """Seen from its bearings the wheel would change as it turns."""
    body = hybrid_cases.body("spur", 1, holes=6, modes=8)
    with pytest.raises(ValueError, match=r"three or more equal sectors, got 2 of 'spur 1'"):
        body_basis(_of_sectors(body, 2), MODES)


@pytest.mark.slow
def test_a_wheel_with_holes_is_itself_again_after_its_mesh_periods():
    """In coordinates that stand still, against all 24 teeth one by one; not after half of them."""
    grid, holes = _grid(8, periods=24), _HOLES["6"]
    ours = _bodies(holes, grid)["wheel"]
    body = hybrid_cases.body("spur", 1, holes=6, modes=8)
    basis = body_basis(body, MODES)
    alone = 2 * basis.waves == 6
    every = flexible_body(_of_sectors(body, 1), PAIRS["spur"](), 1, grid, basis=basis)
    assert (ours.repeats, ours.periods, every.periods) == (8, 8, 24)
    lines = jg.contact_lines(PAIRS["spur"](), grid)
    found, wanted = (
        np.asarray(_arms_of(each, lines)).reshape(24, 8, -1, alone.size) for each in (ours, every)
    )
    assert_near(found, wanted, 1e-9)
    assert_near(wanted[:16], wanted[8:], 1e-9)
    assert_near(wanted[:20, ..., ~alone], wanted[4:, ..., ~alone], 1e-9)
    assert_near(wanted[:20, ..., alone], -wanted[4:, ..., alone], 1e-9)


@jax.jit
def _arms_of(body: FlexibleBody, lines):
    return mode_arms(PAIRS["spur"](), 1, body, lines)


@pytest.mark.slow
@pytest.mark.parametrize("name", _HOLES)
def test_a_response_over_holes_is_the_same_over_two_of_its_cycles(name: str):
    holes, loads = _HOLES[name], []
    for cycles in (1, 2):
        system = _system_over(holes, cycles * holes.periods)
        orbit = _steady(system, jnp.asarray([2200.0]), HarmonicBalance(harmonics=7))
        assert np.asarray(orbit.settled).all()
        loads.append(np.asarray(orbit.load)[0, :, 0])
    once, twice = loads
    assert_near(twice, np.tile(once, 2), 1e-8)
    # Holes are seen: periods differ.
    assert np.ptp(once.reshape(-1, 15), axis=0).max() > 1e-3 * np.ptp(once)
    # Where modes are turned over after half a cycle, the flanks feel the same.
    if holes.wheel % 2 == 0:
        first, second = once.reshape(2, -1)
        assert_near(first, second, 1e-8)


# --- All coordinates of the body


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "most"), [(1500.0, 0.05), (3900.0, 0.15)])
def test_modes_of_a_march_against_all_coordinates_of_the_body(speed, most):
    """What the modes cut off leaves out, beside the time step: 4 and 11 % of the largest force."""
    cycles, grid = 2, _grid(15)
    dynamics = _pair(300.0, 1.0, 15, FEW)
    history = _marching(cycles)(dynamics.system, jnp.asarray(speed))
    body = hybrid_cases.body("spur", 1, **WHEEL)
    basis = hybrid_cases.basis_of("spur", 1, 0, **WHEEL)
    kept = hybrid_cases.basis_of("spur", 1, MODES, **WHEEL)
    judge = Turning(_model(grid), grid, dynamics, body, kept, damping=300.0, every=basis)
    force = judge.march(speed, cycles)
    off = np.abs(np.asarray(history.load)[:, 0] - force).max() / force.max()
    assert off < most
