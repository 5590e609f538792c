"""Modes of a turning pair with a condensed wheel: waves from space and on it, critical speeds."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, quick
from hybrid_cases import ROUND, TEETH, basis_of, body, spur, vibrating
from jaxtyping import Array

import jaxgear as jg
from jaxgear._dynamics._bodies import (
    BodyPlace,
    TurningTerms,
    matrices_with,
    size_with,
    turning_terms,
    vibrating_bodies,
)
from jaxgear._dynamics._campbell import TurningModes, critical_crossings, modes_alone, turning_modes
from jaxgear._dynamics._damping import ModalDamping
from jaxgear._dynamics._modes import pair_modes, rotating_frequencies
from jaxgear._dynamics._system import DynamicSystem, PairDynamics
from jaxgear._dynamics._wave_content import wave_content
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem, pair_system

_WHEEL = {"modes": 8, "rotating": True}
_COUNT = 12
_RATIO = TEETH[0] / TEETH[1]
_SPEEDS = np.linspace(0.0, 15000.0, 13)


def _bare(kind, **fields):
    """An object of which only some fields exist: a pair without contact needs no more."""
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


class _Matrices(NamedTuple):
    """Of a rigid pinion and a condensed wheel without mesh, over all degrees of freedom."""

    mounted: PairSystem
    bodies: tuple[BodyPlace, ...]
    mass: Array
    stiffness: Array
    turning: tuple[TurningTerms, TurningTerms]


@functools.cache
def _matrices() -> _Matrices:
    pair, grid = spur(), jg.mesh_grid(spur(), phases=8, slices=2)
    wheel = vibrating("spur", 1, grid, _COUNT, **_WHEEL)
    model = PairModel(pair, 20.0, pinion_support=ROUND, wheel_support=ROUND, wheel_body=wheel)
    return _assembled(model, grid)


@eqx.filter_jit
def _assembled(model: PairModel, grid: jg.MeshGrid) -> _Matrices:
    mounted = pair_system(model.pair, model.torque, ROUND, ROUND, wheel_body=model.wheel_body)
    bodies = vibrating_bodies(model, mounted, grid)
    size = size_with(mounted, bodies)
    return _Matrices(
        mounted,
        tuple(each.place for each in bodies),
        *matrices_with(mounted, bodies, size),
        (
            turning_terms(bodies, size, ModalDamping(), whole=False),
            turning_terms(bodies, size, ModalDamping(), whole=True),
        ),
    )


@functools.cache
def _pair(mesh: float, *, whole: bool = False) -> PairDynamics:
    """A rigid pinion and a condensed wheel; the mesh is one spring at the rim [N/m]."""
    known = _matrices()
    first = known.mounted.structure.map.size
    dofs = np.r_[np.asarray(known.mounted.structure.map.free), first : len(known.mass)]
    among = lambda matrix: np.asarray(matrix)[np.ix_(dofs, dofs)]
    mass, turning = among(known.mass), known.turning[whole]
    vector, free = np.zeros(len(known.mass)), np.zeros(len(known.mass))
    radius = _touch(vector, first)
    free[5], free[11] = 1.0, -_RATIO
    assert abs(vector @ free) < 1e-9 * radius
    free = free[dofs] / np.sqrt(free[dofs] @ mass @ free[dofs])
    held = among(known.stiffness) + 1e9 * np.outer(mass @ free, mass @ free)
    system = _bare(
        DynamicSystem,
        mass=jnp.asarray(mass),
        damping=jnp.zeros_like(mass),
        stiffness=jnp.asarray(held),
        gyroscopic=jnp.asarray(among(turning.gyroscopic)),
        vectors=jnp.asarray(vector[dofs, None]),
        mean=jnp.full((1, 1), mesh),
        free=jnp.asarray(free[:, None]),
        teeth=TEETH[0],
        turning=_bare(TurningTerms, softening=jnp.asarray(among(turning.softening))),
    )
    return _bare(
        PairDynamics,
        system=system,
        cycle=_bare(MeshCycle, system=known.mounted),
        dofs=tuple(int(i) for i in dofs),
        bodies=known.bodies,
    )


_at_rest = eqx.filter_jit(pair_modes)


def _touch(vector: np.ndarray, first: int) -> float:
    """The pinion against the rim of the wheel, where it is nearest; the radius of the rim."""
    nodes, motions = body("spur", 1, **_WHEEL).rim_nodes, basis_of("spur", 1, _COUNT, **_WHEEL)
    away = np.linalg.norm(nodes - np.array([nodes[:, 0].min(), 0.0, 3e-3]), axis=1)
    node = int(np.argmin(away))
    assert abs(nodes[node, 1]) < 1e-9
    radius = -float(nodes[node, 0])
    slope = np.array([np.sin(0.4), np.cos(0.4), 0.0])
    vector[:6] = [*slope, 0.0, 0.0, slope[1] * radius * _RATIO]
    rows = slope @ motions.motions[3 * node : 3 * node + 3]
    vector[6:12], vector[first:] = -rows[:6], -rows[6:]
    return radius


@functools.cache
def _turning(mesh: float, *, whole: bool = False) -> TurningModes:
    pair = _pair(mesh, whole=whole)
    return turning_modes(pair, _at_rest(pair), _SPEEDS)


def _branch(turning: TurningModes, diameters: int, way: int) -> int:
    """The first mode of so many nodal diameters that runs that way at speed."""
    fits = (turning.diameters[-1] == diameters) & (turning.direction[-1] == way)
    return int(np.flatnonzero(fits)[0])


# Softer than anything, so that the wheel is as good as alone.
_SOFT = 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("n", quick(1, [2, 3, 4]))
def test_waves_from_space_are_those_on_the_wheel_and_its_turning(n):
    r"""Without rotating terms $\omega \mp n\Omega$ to the last digit; on the wheel $\omega$."""
    basis, turning = basis_of("spur", 1, _COUNT, **_WHEEL), _turning(_SOFT)
    own = np.sqrt(basis.square[list(basis.diameters).index(n)]) / (2.0 * np.pi)
    turned = n * _RATIO * _SPEEDS / (2.0 * np.pi)
    for way in (1, -1):
        branch = _branch(turning, n, way)
        assert_close(turning.space[:, branch], own + way * turned, rtol=1e-9, atol=0.0)
        assert_close(turning.body[1:, branch], np.full(12, own), rtol=1e-9, atol=0.0)
        assert (turning.gear[:, branch] == 1).all()
        assert turning.share[:, branch].min() > 1.0 - 1e-9


def test_fewer_than_two_diameters_stay_as_they_are_without_rotating_terms():
    turning = _turning(_SOFT)
    few = turning.diameters[0] < 2
    assert few.sum() > 10
    assert_close(
        turning.space[:, few], np.tile(turning.space[0, few], (13, 1)), rtol=1e-9, atol=0.0
    )


@pytest.mark.parametrize("whole", [False, True])
def test_all_frequencies_at_each_speed_are_those_found_without_following(whole):
    pair, turning = _pair(3e8, whole=whole), _turning(3e8, whole=whole)
    system = pair.system
    assert system.gyroscopic is not None
    assert system.turning is not None
    got = rotating_frequencies(
        system.mass,
        system.whole_stiffness,
        system.gyroscopic,
        system.free,
        jnp.asarray(_SPEEDS),
        system.turning.softening,
    )
    # The rotation that is free feels the terms of rotation, which only the former consider.
    expected = np.sort(turning.frequency, axis=1)
    assert_close(got, expected, rtol=1e-4 if whole else 1e-9, atol=0.0)


def test_modes_keep_their_waves_through_crossings():
    """Straight lines that cross: sorted, they would have kinks."""
    turning = _turning(_SOFT)
    order = np.argsort(np.argsort(turning.space, axis=1), axis=1)
    falls = _branch(turning, 2, -1)
    assert len(np.unique(order[:, falls])) >= 4
    assert len(np.unique(turning.diameters[:, falls])) == 1
    assert np.abs(np.diff(turning.space, 2, axis=0)).max() < 1e-6 * turning.space[0, falls]
    # From standing still to running half a wave is lost.
    assert turning.likeness[1].min() > 0.49
    assert turning.likeness[2:].min() > 0.99


def test_critical_speeds_without_rotating_terms():
    r"""$\Omega_2 = \omega_n/(hz_2 \mp n)$: backward comes first."""
    basis, turning = basis_of("spur", 1, _COUNT, **_WHEEL), _turning(_SOFT)
    found = critical_crossings(turning, (1, 2))
    assert [row.speed for row in found] == sorted(row.speed for row in found)
    for n, harmonic in ((2, 1), (2, 2), (3, 1), (3, 2), (4, 2)):
        own = np.sqrt(basis.square[list(basis.diameters).index(n)])
        rows = [
            row
            for row in found
            if (row.harmonic, row.diameters, row.gear) == (harmonic, n, 1)
            and row.speed * _RATIO < 1.3 * own / (harmonic * TEETH[1] - n)
        ]
        assert [row.direction for row in rows] == [-1, 1]
        for row, way in zip(rows, (-1, 1), strict=True):
            wheel = own / (harmonic * TEETH[1] - way * n)
            assert_close(row.speed * _RATIO, wheel, rtol=1e-9, atol=0.0)
            assert_close(row.body, own / (2.0 * np.pi), rtol=1e-9, atol=0.0)
            mesh = harmonic * TEETH[0] * row.speed / (2.0 * np.pi)
            assert_close(row.space, mesh, rtol=1e-9, atol=0.0)
    with pytest.raises(ValueError, match="from 1 on"):
        critical_crossings(turning, (0,))


def test_a_wheel_overtakes_its_own_wave():
    """Faster than a backward wave runs, its frequency from space goes on through zero."""
    pair = _pair(_SOFT)
    at_rest = _at_rest(pair)
    basis = basis_of("spur", 1, _COUNT, **_WHEEL)
    own = np.sqrt(basis.square[list(basis.diameters).index(2)])
    speeds = np.array([0.0, 0.4, 0.8, 1.2]) * own / (2.0 * _RATIO)
    turning = turning_modes(pair, at_rest, speeds)
    fits = (turning.diameters[1] == 2) & (turning.direction[1] == -1)
    branch = int(np.flatnonzero(fits)[0])
    expected = own / (2.0 * np.pi) * np.array([1.0, 0.6, 0.2, -0.2])
    assert_close(turning.frequency[:, branch], expected, rtol=1e-7, atol=0.0)


def test_a_turning_wheel_rests_in_space_under_a_load_that_does():
    """With all terms the false inertia of the turning frame cancels."""
    system = _pair(_SOFT, whole=True).system
    assert system.turning is not None
    mass, softening = np.asarray(system.mass), np.asarray(system.turning.softening)
    for dof in (6, 7, 8, 11):
        rigid = np.eye(len(mass))[dof]
        # Without the cancelling it would be as large as the mass.
        lost = np.abs(softening @ rigid).max()
        assert lost < 1e-6 * np.abs(mass @ rigid).max()
    # On its bearings it swings as at rest, alike in both directions.
    turning = _turning(_SOFT, whole=True)
    swings = np.flatnonzero((turning.diameters[0] == 1) & (turning.gear[0] == 0))
    assert_close(turning.space[-1, swings], turning.space[0, swings], rtol=1e-9, atol=0.0)


def test_rotating_terms_split_waves_on_the_wheel():
    r"""Backward is higher there, by less than the $4n\Omega/(n^2+1)$ of a thin ring."""
    turning = _turning(_SOFT, whole=True)
    for n in (2, 3):
        forward, backward = (_branch(turning, n, way) for way in (1, -1))
        split = turning.body[-1, backward] - turning.body[-1, forward]
        ring = 4.0 * n / (n**2 + 1.0) * _RATIO * _SPEEDS[-1] / (2.0 * np.pi)
        assert 0.2 * ring < split < ring
        # In proportion to speed, as far as the square of the speed leaves it.
        half = turning.body[6, backward] - turning.body[6, forward]
        assert_close(half, 0.5 * split, rtol=1e-2, atol=0.0)


def test_a_wheel_alone_and_in_mesh():
    """The mesh raises frequencies; of waves only the one with an antinode at the teeth."""
    soft = modes_alone(_pair(_SOFT), _at_rest(_pair(_SOFT)), 1)
    at_rest = np.asarray(_at_rest(_pair(_SOFT)).frequency)
    assert_close(at_rest[soft.in_mesh], soft.frequency, rtol=1e-9, atol=0.0)
    assert soft.likeness.min() > 1.0 - 1e-9
    basis = basis_of("spur", 1, _COUNT, **_WHEEL)
    waves = basis.diameters >= 2
    own = np.sort(np.sqrt(basis.square[waves])) / (2.0 * np.pi)
    assert_close(soft.frequency[soft.diameters >= 2], own, rtol=1e-9, atol=0.0)
    pair = _pair(3e8)
    meshed = _at_rest(pair)
    firm = modes_alone(pair, meshed, 1)
    two = np.flatnonzero(firm.diameters == 2)
    moved = np.asarray(meshed.frequency)[firm.in_mesh[two]] / firm.frequency[two] - 1.0
    low, high = np.sort(np.abs(moved))
    assert low < 1e-6
    assert 1e-3 < high < 0.2
    # The stiffness of the wheel is split as the modes say.
    total = np.asarray(meshed.mesh) + np.asarray(meshed.parts).sum(axis=0)
    assert_close(total, np.ones(total.size), rtol=1e-9, atol=0.0)
    content = wave_content(pair, np.asarray(meshed.shape))
    assert_close(content.mesh, np.asarray(meshed.mesh), rtol=1e-6, atol=1e-9)
