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
from jaxgear._dynamics._march_step import ties_of
from jaxgear._dynamics._modes import Modes, pair_modes
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._steady_state import steady_states
from jaxgear._dynamics._system import PairDynamics, modal_basis
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


@functools.cache
def _pair(kind: str, count: int = MANY, coordinates: int = 8) -> PairDynamics:
    others: dict[str, Any] = {"pinion_support": ROUND, "wheel_support": ROUND}
    others |= {"flanks": relieved(), "compliance": APART, "wheel_body": _wheel(kind, count)}
    return _made(PairModel(PAIRS[kind](), 20.0, **others), _grid(kind), coordinates)


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
        # As many coordinates as damping has: else modes exchange a little of it.
        dynamics = _pair(kind, count, coordinates=24)
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


# --- Damping, which must not change with their number


def _over_masses(system, matrix) -> np.ndarray:
    root = np.linalg.inv(np.linalg.cholesky(np.asarray(system.mass)))
    return root @ np.asarray(matrix) @ root.T


@pytest.mark.parametrize("coordinates", [4, 12])
def test_damping_is_that_of_as_many_coordinates_as_always(coordinates):
    system, usual = (_pair("helical", coordinates=each).system for each in (coordinates, 24))
    apart = _over_masses(usual, system.damping - usual.damping)
    # The hold of the free rotation, which is no damping of anything, is faster than all modes.
    size = np.linalg.eigvalsh(_over_masses(usual, usual.damping))[-2]
    assert np.abs(apart).max() < 1e-9 * size
    mean, whole = (np.asarray(each.mesh_stiffness) for each in (system, usual))
    assert np.abs(mean - whole).max() > 1e-5 * np.abs(whole).max()


def test_damping_that_modes_exchange_is_in_marches_and_multipliers_too():
    """A disturbance of the linear system dies out as in all of its own matrices."""
    system = _pair("helical", coordinates=4).system
    modes, speed = modal_basis(system), jnp.asarray(700.0)
    rates = np.asarray(modes.shape.T @ system.rates_at(speed) @ modes.shape)
    assert system.gyroscopic is not None
    off = rates - np.asarray(speed * modes.shape.T @ system.gyroscopic @ modes.shape)
    off -= np.diag(np.diagonal(off))
    assert np.abs(off).max() > 1e-3 * np.median(np.asarray(modes.damping))
    tied = np.diag(np.asarray(modes.damping)) + np.asarray(ties_of(system, modes, speed).whirl)
    assert np.abs(tied - rates).max() < 1e-9 * np.abs(rates).max()
