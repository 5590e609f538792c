"""What the mesh tells apart of a condensed body's motion, and what of the mean mesh is teeth."""

import functools
import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hybrid_cases import APART, PAIRS, ROUND, relieved, vibrating

import jaxgear as jg
from jaxgear._dynamics._body_mesh import _combinations, _energy, _leading, _of_unit_strain
from jaxgear._dynamics._damping import ModalDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._modes import Modes, pair_modes
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._steady_state import steady_states
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._lines import contact_lines
from jaxgear._response._dynamic import dynamic_transmission_error
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import line_loads, mode_arms
from jaxgear._system._model import PairModel

every_kind = pytest.mark.parametrize("kind", ["spur", "helical"])
SPEEDS = jnp.asarray([700.0, 1700.0, 2900.0])
MANY = 96


@functools.cache
def _grid(kind: str) -> jg.MeshGrid:
    return jg.mesh_grid(PAIRS[kind](), phases=15, slices=2)


@functools.cache
def _wheel(kind: str, count: int) -> FlexibleBody:
    return vibrating(kind, 1, _grid(kind), count, modes=8)


_made = eqx.filter_jit(
    lambda model, grid, coordinates: pair_dynamics(
        model, grid, ModalDamping(0.07, 0.02), mesh_coordinates=coordinates
    )
)


def _model(kind: str, count: int, torque: float = 20.0) -> PairModel:
    others: dict[str, Any] = {"pinion_support": ROUND, "wheel_support": ROUND}
    others |= {"flanks": relieved(), "compliance": APART, "wheel_body": _wheel(kind, count)}
    return PairModel(PAIRS[kind](), torque, **others)


@functools.cache
def _pair(kind: str, count: int = MANY, coordinates: int = 8) -> PairDynamics:
    return _made(_model(kind, count), _grid(kind), coordinates)


# --- Which motions the mesh tells apart


def _found(arms, loads, size, count):
    """Of two sections and modes, from arms at three places and loads on the cells."""
    seen = [jnp.asarray(loads @ each) for each in arms]
    size = jnp.asarray(size)
    return _combinations(_energy(seen, size, 2), size, 2, count)


def test_loads_that_coordinates_hold_excite_every_mode_as_without_them():
    random = np.random.default_rng(3)
    arms = random.normal(size=(3, 5, 8, 40))
    # Two loads at each of five positions, and three places within the step: thirty patterns.
    loads, size = random.random((5, 2, 8)), np.sqrt(random.random(40) + 0.5)
    few = _found(arms, loads, size, 30)
    over = np.einsum("tpc,xtcn->xtpn", loads, arms)
    through = over @ np.asarray(few.into) @ np.asarray(few.out_of).T
    assert np.abs(through - over).max() < 1e-10 * np.abs(over).max()
    assert float(few.left_out) < 1e-7
    fewer = _found(arms, loads, size, 10)
    through = over @ np.asarray(fewer.into) @ np.asarray(fewer.out_of).T
    soft = size[2:]
    lost = np.linalg.norm((through - over)[..., 2:] * soft) / np.linalg.norm(over[..., 2:] * soft)
    assert lost > 0.1
    assert float(fewer.left_out) == pytest.approx(lost, rel=1e-9)


def test_measured_by_kinetic_energy_only_the_square_of_what_is_left_out_is_missing():
    """Answers of modes to loads at low frequency, with all that is left out at rest (7.8)."""
    random = np.random.default_rng(7)
    square = np.logspace(0, 4, 60)
    load = random.normal(size=60) * square**0.25
    arms = np.zeros((3, 1, 1, 62))
    arms[:, 0, 0, 2:] = load + 0.3 * random.normal(size=(3, 60)) * square**0.25
    frequency = 1e-2 * np.sqrt(square[0])
    missing = {}
    for name, size in (("kinetic", 1.0 / square), ("strain", square**-0.5)):
        whole = np.concatenate([np.ones(2), size])
        few = _found(arms, np.ones((1, 1, 1)), whole, 1)
        seen = arms[1, 0, 0] @ np.asarray(few.into) @ np.asarray(few.out_of).T
        full, seen = arms[1, 0, 0, 2:], seen[2:]
        # What follows at once is the static answer less that of what is seen.
        lost = (full**2 - seen**2) @ (1.0 / (square - frequency**2) - 1.0 / square)
        missing[name] = lost / frequency**2
        if name == "kinetic":
            assert lost / frequency**2 == pytest.approx(
                np.sum(((full - seen) / square) ** 2), rel=1e-3
            )
            assert float(few.left_out) > 1e-2
    assert abs(missing["kinetic"]) < 0.5 * abs(missing["strain"])


def test_coordinates_of_unit_strain_span_the_same_and_are_of_one_size():
    random = np.random.default_rng(11)
    arms, loads = random.normal(size=(3, 4, 6, 32)), random.random((4, 2, 6))
    give = np.logspace(0, -6, 32)
    few = _found(arms, loads, give, 5)
    same = _of_unit_strain(few, jnp.asarray(give), 2)
    before, after = (np.asarray(each.into @ each.out_of.T) for each in (few, same))
    assert np.abs(after - before).max() < 1e-9 * np.abs(before).max()
    out_of = np.asarray(same.out_of)[2:, 2:]
    assert np.abs(out_of.T @ (give[2:, None] * out_of) - np.eye(5)).max() < 1e-9
    assert np.array_equal(np.asarray(same.out_of)[:2, :2], np.eye(2))


def test_the_space_that_coordinates_span_has_its_derivative():
    random = np.random.default_rng(5)
    first, other = random.normal(size=(2, 60, 12)) * np.logspace(0, -3, 12)
    # Two that are alike within the space may turn as they like.
    first[:, :2] = np.linalg.qr(first[:, :2])[0] * 10.0
    first[:, 2:] -= first[:, :2] @ (first[:, :2].T @ first[:, 2:]) / 100.0

    def space(t):
        seen = jnp.asarray(first) + t * jnp.asarray(other)
        found = _leading(seen.T @ seen, 5)
        return found @ found.T

    _, slope = jax.jvp(space, (jnp.zeros(()),), (jnp.ones(()),))
    step = 1e-6
    central = (space(jnp.asarray(step)) - space(jnp.asarray(-step))) / (2.0 * step)
    assert np.abs(np.asarray(slope)).max() > 1e-2
    assert np.abs(np.asarray(slope - central)).max() < 1e-7 * np.abs(np.asarray(slope)).max()


@every_kind
def test_loads_along_lines_are_even_tilted_and_bowed_on_one_line_each(kind):
    lines = contact_lines(PAIRS[kind](), jg.mesh_grid(PAIRS[kind](), phases=9, slices=5))
    loads = np.asarray(line_loads(lines))
    fraction, z = np.asarray(lines.fraction), np.asarray(lines.face_position)
    phases, count, slices = fraction.shape
    apart = loads.reshape(phases, count, 3, count, slices)
    for line in range(count):
        own = apart[:, line, :, line]
        others = np.delete(apart[:, line], line, axis=2)
        assert np.all(others == 0.0)
        assert own[:, 0] == pytest.approx(fraction[:, line])
        whole = (np.ptp(fraction[:, line], axis=1) < 1e-9) & (fraction[:, line, 0] > 0.0)
        assert whole.any() or kind == "helical"
        # A tilt has no resultant, a bow neither that nor a moment.
        assert np.abs(own[whole, 1:].sum(axis=2)).max(initial=0.0) < 1e-12
        assert np.abs(own[whole, 2] @ z).max(initial=0.0) < 1e-12
        assert np.all(own[whole, 1] @ z > 0.0)


def _missed(kind: str, coordinates: int) -> float:
    """Strain of the modes under the loads at rest that coordinates miss, over all of it."""
    dynamics = _pair(kind, coordinates=coordinates)
    system, cycle, (place,) = dynamics.system, dynamics.cycle, dynamics.bodies
    first = dynamics.dofs.index(place.first)
    arms = np.asarray(mode_arms(PAIRS[kind](), 1, _wheel(kind, MANY), cycle.cells.lines))
    force = np.asarray(cycle.force)
    exact = np.einsum("tc,tcn->tn", force, arms)
    load = np.einsum("tc,tcm->tm", force, np.asarray(system.table.middle_arms))
    seen = load @ np.asarray(system.vectors)[first : first + len(place.waves)].T
    soft = 1.0 / np.sqrt(np.asarray(place.square))
    return float(np.linalg.norm((exact - seen) * soft) / np.linalg.norm(exact * soft))


@pytest.mark.slow
@every_kind
def test_what_coordinates_miss_of_the_load_at_rest_falls_fast(kind):
    """The load that is always there: what of it is missed rides up and down with the load."""
    missed = [_missed(kind, coordinates) for coordinates in (4, 8, 12)]
    assert missed[0] < 2e-2
    assert all(later < 0.2 * before for before, later in itertools.pairwise(missed))


@pytest.mark.slow
@every_kind
def test_responses_hold_still_from_few_coordinates_on(kind):
    """Largest force and RMS of transmission error: with 8 nearly, with 12 as with 24."""

    def numbers(coordinates: int) -> np.ndarray:
        system = _pair(kind, coordinates=coordinates).system
        method = HarmonicBalance(harmonics=7)
        orbits = eqx.filter_jit(steady_states)(system, SPEEDS, method)
        assert np.asarray(orbits.settled).all()
        error = np.asarray(
            eqx.filter_vmap(dynamic_transmission_error, in_axes=(None, 0))(system, orbits)
        )
        return np.stack([np.asarray(orbits.load)[:, :, 0].max(axis=1), error.std(axis=1)])

    exact = numbers(24)
    off = {count: np.abs(numbers(count) / exact - 1.0).max() for count in (8, 12)}
    assert off[8] < 2e-2
    assert off[12] < 2e-3


# --- What of the mean mesh is teeth


def _whole_share(dynamics: PairDynamics, modes: Modes) -> np.ndarray:
    """Share of the mean mesh with what bodies give beside their modes in the energy of each."""
    shape, square = np.asarray(modes.shape), (2.0 * np.pi * np.asarray(modes.frequency)) ** 2
    return (
        np.einsum("ik,ij,jk->k", shape, np.asarray(dynamics.system.mesh_stiffness), shape) / square
    )


@pytest.mark.slow
@every_kind
def test_damping_of_the_tooth_mode_does_not_wait_for_modes_of_the_body(kind):
    """What the body gives beside few modes is not in its teeth: few tell the ratio of many."""
    found = {}
    for count in (12, MANY):
        dynamics = _pair(kind, count)
        modes = pair_modes(dynamics)
        share, parts = np.asarray(modes.mesh), np.asarray(modes.parts)
        tooth = int(np.argmax(share))
        assert np.abs(share + parts.sum(axis=0) - 1.0).max() < 1e-9
        assert modes.damping_ratio is not None
        ratio = float(modes.damping_ratio[tooth])
        assert ratio == pytest.approx(0.02 + 0.05 * share[tooth], rel=1e-6)
        found[count] = share[tooth], _whole_share(dynamics, modes)[tooth]
    (few, few_whole), (many, many_whole) = found[12], found[MANY]
    assert few == pytest.approx(many, rel=0.05)
    # By all of the mean mesh it would be many times as far off.
    assert few_whole - many_whole > 4.0 * abs(few - many)
    assert many < many_whole


@pytest.mark.slow
@every_kind
def test_teeth_are_a_part_of_the_mean_mesh(kind):
    system = _pair(kind, 12).system
    assert system.teeth_part is not None
    teeth, whole = np.asarray(system.teeth_part), np.asarray(system.mean)
    size = np.abs(np.linalg.eigvalsh(whole)).max()
    assert np.linalg.eigvalsh(teeth).min() > -1e-12 * size
    assert np.linalg.eigvalsh(whole - teeth).min() > -1e-9 * size
    assert np.linalg.eigvalsh(whole - teeth).max() > 1e-3 * size


# --- The mean mesh, which must not change with modes or coordinates


def _at_phases(dynamics: PairDynamics) -> list[tuple[np.ndarray, np.ndarray]]:
    """Stiffness of the mesh on the modes of the body at each phase, and that of its teeth."""
    system, table = dynamics.system, dynamics.system.table
    stiffness, coupling = np.asarray(table.stiffness), np.asarray(table.coupling)
    on_modes = np.asarray(system.vectors)[_mode_rows(dynamics)]
    arms, found = np.asarray(table.middle_arms), []
    closed = (np.asarray(dynamics.cycle.overlap) > 0.0) & (stiffness > 0.0)
    for phase, held in enumerate(closed):
        springs = np.diag(1.0 / stiffness[phase][held])
        pushed = np.linalg.solve(springs + coupling[phase][np.ix_(held, held)], arms[phase][held])
        both = arms[phase][held].T @ pushed, pushed.T @ springs @ pushed
        found.append(tuple(on_modes @ each @ on_modes.T for each in both))
    return found


def _mode_rows(dynamics: PairDynamics) -> np.ndarray:
    """Which degrees of freedom are modes of the body."""
    (place,) = dynamics.bodies
    return np.flatnonzero(np.isin(dynamics.dofs, place.mode_dofs))


@every_kind
def test_the_mean_mesh_gives_as_the_cycle_does_on_the_mean(kind):
    """With the seats held, and loads on the modes that stay: their motion, energy in the teeth."""
    dynamics = _pair(kind)
    system, rows = dynamics.system, _mode_rows(dynamics)
    # Without the spring that holds the free rotation.
    modes, each = _wheel(kind, MANY).modes, _at_phases(dynamics)
    assert modes is not None
    own = np.diag(np.asarray(modes.square))
    weight = np.asarray(dynamics.cycle.cells.lines.weight)
    gives = [np.linalg.inv(own + whole) for whole, _ in each]
    stored = [give @ teeth @ give for give, (_, teeth) in zip(gives, each, strict=True)]
    on_modes = np.asarray(system.vectors)[rows]
    give = np.linalg.inv(own + on_modes @ np.asarray(system.mean) @ on_modes.T)
    teeth = give @ on_modes @ np.asarray(system.teeth_part) @ on_modes.T @ give
    for found, phases in ((give, gives), (teeth, stored)):
        mean = np.einsum("p,pij->ij", weight, np.stack(phases))
        # Measured by the modes: the first move a million times as far as the last.
        size = np.sqrt(np.diagonal(mean))
        assert np.abs((found - mean) / np.outer(size, size)).max() < 1e-9


def _ratios(dynamics: PairDynamics) -> np.ndarray:
    """Of the slowest modes."""
    return np.asarray(pair_modes(dynamics).damping_ratio)[: MANY // 4]


@pytest.mark.parametrize(("coordinates", "most"), [(4, 3e-3), (8, 1e-4), (12, 1e-5)])
def test_damping_does_not_change_with_mesh_coordinates(coordinates, most):
    few, many = (_ratios(_pair("helical", coordinates=each)) for each in (coordinates, 24))
    assert np.abs(few / many - 1.0).max() < most
    assert many.max() > 0.03


@pytest.mark.slow
@every_kind
def test_damping_and_frequencies_do_not_change_with_modes_of_the_body(kind):
    """But by the inertia of modes eight times as fast, at most."""
    few, many = (pair_modes(_pair(kind, count)) for count in (MANY // 2, MANY))
    slow = slice(MANY // 8)
    assert few.damping_ratio is not None
    assert many.damping_ratio is not None
    for found, exact in ((few.damping_ratio, many.damping_ratio), (few.frequency, many.frequency)):
        assert np.abs(np.asarray(found)[slow] / np.asarray(exact)[slow] - 1.0).max() < 1e-3


@pytest.mark.slow
def test_responses_peak_at_the_frequency_of_the_tooth_mode():
    """The second mesh harmonic sweeps across it, under a load that keeps the teeth in contact."""
    model, damping = _model("helical", MANY, 1000.0), ModalDamping(0.01, 0.01)
    dynamics = pair_dynamics(model, _grid("helical"), damping, mesh_coordinates=8)
    system, modes = dynamics.system, pair_modes(dynamics)
    tooth = int(np.argmax(np.asarray(modes.mesh)))
    frequency = 2.0 * np.pi * float(modes.frequency[tooth])
    places = frequency * np.linspace(0.97, 1.03, 31)
    speeds = jnp.asarray(places / (2.0 * system.teeth))
    orbits = steady_states(system, speeds, HarmonicBalance(harmonics=5))
    assert np.asarray(orbits.settled).all()
    on_mode = np.asarray(modes.shape)[:, tooth] @ np.asarray(system.mass)
    line = np.abs(np.fft.rfft(np.asarray(orbits.motion) @ on_mode, axis=1)[:, 2])
    top = int(np.argmax(line))
    around = slice(top - 1, top + 2)
    bend, slope, _ = np.polyfit(places[around] - places[top], line[around] ** -2.0, 2)
    peak = places[top] - 0.5 * slope / bend
    # By the mean of the stiffness it would be further off.
    rows, weight = _mode_rows(dynamics), dynamics.cycle.cells.lines.weight
    each = [float(w) * whole for w, (whole, _) in zip(weight, _at_phases(dynamics), strict=True)]
    stiffer = np.sum(each, axis=0) - np.asarray(system.mesh_stiffness)[np.ix_(rows, rows)]
    shape = np.asarray(modes.shape)[rows, tooth]
    with_it = frequency * (1.0 + 0.5 * shape @ stiffer @ shape / frequency**2)
    assert abs(frequency / peak - 1.0) < 4e-3
    assert with_it - frequency > 2e-3 * frequency
    assert frequency > peak
