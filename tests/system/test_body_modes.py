"""Natural modes of condensed bodies: a basis whose pairs turn with the body.

What a turn of a body by one of its sectors does to its rim is known from the rim's nodes alone;
cells on its modes are compared with those placed from the drawing by `hybrid_cases`.
"""

import dataclasses
import functools
import itertools
import math

import equinox as eqx
import hybrid_cases
import numpy as np
import pytest
import scipy.linalg
from fem_cases import assert_near
from helpers import quick
from hybrid_cases import PAIRS, TEETH, Dense, Gear
from scipy.spatial import KDTree

import jaxgear as jg
from fem_prep import ReducedBody
from jaxgear._system._body_modes import BodyBasis, body_basis
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._foot_tables import mode_arms

_arms = eqx.filter_jit(mode_arms)

WHEEL = TEETH[1]
FREE = np.array([[np.inf] * 5 + [0.0]])

# A body by its ring, one with interior shapes and terms of rotation, one on three bearings and one
# whose sectors are of four teeth.
SHAPES = {
    "rotating": {"modes": 8, "rotating": True},
    "bore": {},
    "shaft": {"seats": "shaft"},
    "holes": {"holes": 6, "modes": 8},
}
every_body = pytest.mark.parametrize("name", quick(1, SHAPES))


@functools.cache
def _basis(name: str, count: int = 30) -> tuple[ReducedBody, BodyBasis]:
    body = hybrid_cases.body("spur", 1, **SHAPES[name])
    return body, body_basis(body, count)


def _sectors(body: ReducedBody) -> int:
    sectors = body.facts["sectors"]
    assert isinstance(sectors, int)
    return sectors


def _turn(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _turned_rim(body: ReducedBody, motion: np.ndarray, angle: float) -> np.ndarray:
    """Motion of the rim's nodes, quick(2, `[3 rim, column]`), after all of it has been turned."""
    turn = _turn(angle)
    apart, image = KDTree(body.rim_nodes).query(body.rim_nodes @ turn.T)
    assert np.max(apart) < 1e-9
    image = np.asarray(image)
    turned = np.empty((len(image), 3, motion.shape[1]))
    turned[image] = turn @ motion.reshape(len(image), 3, -1)
    return turned.reshape(motion.shape)


def _scaled(matrix: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """A matrix of seats and modes in units in which every mass is one."""
    size = 1.0 / np.sqrt(np.diagonal(mass))
    return size[:, None] * matrix * size


# --- Modes


@every_body
def test_modes_are_orthonormal_with_the_seats_held(name):
    body, basis = _basis(name)
    shapes, square = basis.shapes, basis.square
    assert len(square) in (29, 30)
    assert (np.diff(square) > -1e-9 * square[1:]).all()
    rim, seats = 3 * len(body.rim_nodes), 6 * len(body.seats)
    assert not shapes[rim : rim + seats].any()
    assert_near(shapes.T @ body.mass @ shapes, np.eye(len(square)), 1e-9)
    omega = np.sqrt(square)
    energy = (shapes / omega).T @ body.stiffness @ (shapes / omega)
    assert_near(energy, np.eye(len(square)), 1e-9)
    # Statics by the seats is apart from the modes.
    off = basis.following.T @ body.stiffness @ shapes
    size = np.sqrt(np.diagonal(body.stiffness)[rim : rim + seats])
    assert np.abs(off / size[:, None] / omega).max() < 1e-9
    assert np.array_equal(basis.following[rim : rim + seats], np.eye(seats))


@every_body
def test_a_turn_by_one_sector_turns_pairs_into_themselves(name):
    body, basis = _basis(name)
    angle, rim = 2.0 * math.pi / _sectors(body), 3 * len(body.rim_nodes)
    motions = basis.motions[:rim]
    turned = _turned_rim(body, motions, angle)
    wanted = motions @ scipy.linalg.expm(angle * basis.turning)
    alone = 6 * len(body.seats) + np.flatnonzero(2 * basis.waves == _sectors(body))
    # Neighbouring sectors of such a mode move against each other.
    wanted[:, alone] *= -1.0
    size = np.abs(motions).max(axis=0)
    assert np.abs((turned - wanted) / size).max() < 1e-7


@every_body
def test_turning_exchanges_no_mass(name):
    body, basis = _basis(name)
    given = {
        key: np.asarray(x) for key, x in basis.matrices(body)._asdict().items() if x is not None
    }
    assert len(given) == (4 if name == "rotating" else 2)
    mass, turning = given["mass"], given["turning"]
    assert np.array_equal(turning, -turning.T)
    assert np.array_equal(mass, mass.T)
    for each in given:
        if each == "turning":
            continue
        matrix = _scaled(given[each], mass)
        if each == "coriolis":
            assert_near(matrix, -matrix.T, 1e-12)
        # Translations and rotations of a seat, and modes of one frequency, are of one size.
        assert np.abs(matrix @ turning - turning @ matrix).max() < 1e-7 * np.abs(matrix).max()


@every_body
def test_terms_of_rotation_wave_by_wave_are_those_of_all_motions_at_once(name):
    body, basis = _basis(name)
    found, motions = basis.matrices(body), basis.motions
    onto = lambda matrix: motions.T @ matrix @ motions
    if name != "rotating":
        assert found.coriolis is None
        # Stiffness falls apart as terms of rotation do.
        body = dataclasses.replace(
            body, coriolis=body.mass, spin_softening=body.mass, stress_stiffening=body.stiffness
        )
        found = basis.matrices(body)
    assert body.coriolis is not None
    assert body.spin_softening is not None
    assert body.stress_stiffening is not None
    assert_near(np.asarray(found.coriolis), onto(body.coriolis), 1e-9)
    softening = onto(body.stress_stiffening) - onto(body.spin_softening)
    assert_near(np.asarray(found.softening), softening, 1e-9)


def test_waves_are_nodal_diameters_where_every_tooth_has_its_sector():
    for name in ("bore", "rotating", "shaft"):
        _, basis = _basis(name)
        assert np.array_equal(np.abs(basis.waves), basis.diameters)
    # The umbrella and the twist are alone, the first bending of a web has one nodal diameter.
    _, basis = _basis("bore")
    assert list(basis.waves[:8]) == [1, -1, 2, -2, 0, 0, 3, -3]


def test_waves_are_told_apart_by_the_sectors_alone():
    body, basis = _basis("holes")
    assert _sectors(body) == 6
    folded = np.minimum(basis.diameters % 6, -basis.diameters % 6)
    assert np.array_equal(np.abs(basis.waves), folded)
    # Three nodal diameters, through the holes or between them: no pair, and two frequencies.
    three = np.flatnonzero(basis.diameters == 3)[:2]
    assert (basis.waves[three] == 3).all()
    assert basis.square[three[1]] > 1.005 * basis.square[three[0]]
    # A wave of four looks like one of two that goes the other way: still a pair.
    four = np.flatnonzero(basis.diameters == 4)[:2]
    assert list(basis.waves[four]) == [2, -2]


def test_pairs_stand_beside_each_other():
    for name in SHAPES:
        body, basis = _basis(name)
        second = np.flatnonzero(basis.waves < 0)
        assert np.array_equal(basis.waves[second - 1], -basis.waves[second])
        assert np.array_equal(basis.square[second - 1], basis.square[second])
        # Whatever has a partner has it there.
        paired = (basis.waves > 0) & (2 * basis.waves != _sectors(body))
        assert np.array_equal(np.flatnonzero(paired), second - 1)


# --- How many


def test_no_count_is_all_of_them():
    body, few = _basis("rotating")
    every = _basis("rotating", 0)[1]
    assert len(every.square) == body.dofs - 6
    count = len(few.square)
    np.testing.assert_allclose(few.square, every.square[:count], rtol=1e-8)
    assert np.array_equal(few.waves, every.waves[:count])
    # Within pairs the choice is free.
    for first, last in ((0, 2), (2, 4), (4, 5), (5, 6)):
        overlap = few.shapes[:, first:last].T @ body.mass @ every.shapes[:, first:last]
        assert_near(overlap @ overlap.T, np.eye(last - first), 1e-7)
    rim = 3 * len(body.rim_nodes)
    angle = 2.0 * math.pi / WHEEL
    turned = _turned_rim(body, every.shapes[:rim], angle)
    wanted = every.shapes[:rim] @ scipy.linalg.expm(angle * every.turning[6:, 6:])
    wanted[:, every.waves == 12] *= -1.0
    size = np.abs(every.shapes[:rim]).max(axis=0)
    assert np.abs((turned - wanted) / size).max() < 1e-4


@pytest.mark.parametrize(("count", "kept"), [(2, 2), (3, 2), (5, 5), (6, 6), (7, 6)])
def test_a_pair_is_never_parted(count, kept):
    body = hybrid_cases.body("spur", 1)
    assert len(body_basis(body, count).square) == kept


@pytest.mark.slow
def test_a_shape_whose_partner_was_cut_off_is_left_out():
    body = hybrid_cases.body("spur", 1, modes=20)
    whole = hybrid_cases.body("spur", 1, modes=8)
    basis = body_basis(body, 0)
    assert len(basis.square) == body.dofs - 6 - 1
    assert len(body_basis(whole, 0).square) == whole.dofs - 6
    # With it one mode of a pair would be slower than the other.
    second = np.flatnonzero(basis.waves < 0)
    assert np.array_equal(basis.square[second - 1], basis.square[second])
    np.testing.assert_allclose(basis.square[:8], body_basis(whole, 8).square, rtol=1e-3)
    rim = 3 * len(body.rim_nodes)
    assert np.linalg.matrix_rank(basis.shapes[rim + 6 :]) == body.interior - 1


# --- What is refused


def test_a_body_without_sectors_is_refused_by_name():
    body = hybrid_cases.body("spur", 1, holes=2)
    with pytest.raises(ValueError, match=r"three or more equal sectors, got 2 of 'spur 1'"):
        body_basis(body, 10)
    unknown = dataclasses.replace(body, facts={})
    with pytest.raises(ValueError, match=r"got 1 of 'spur 1'"):
        body_basis(unknown, 10)


def test_a_body_less_even_than_it_claims_is_refused_by_name():
    body = hybrid_cases.body("spur", 1, holes=6)
    claims = dataclasses.replace(body, facts={**body.facts, "sectors": 24})
    with pytest.raises(ValueError, match=r"'spur 1' is not of 24 equal sectors: turned by one"):
        body_basis(claims, 20)
    more = dataclasses.replace(body, facts={**body.facts, "sectors": 7})
    with pytest.raises(ValueError, match=r"rim nodes of 'spur 1' must repeat .* its 7 sectors"):
        body_basis(more, 20)


@pytest.mark.parametrize("what", ["stiffness", "mass", "coriolis", "stress_stiffening"])
def test_one_number_that_is_off_is_seen(what):
    body, _ = _basis("rotating")
    matrix = getattr(body, what).copy()
    # Of a node with another, far from the largest.
    place = 3 * 7, 3 * 20 + 2
    rim = 3 * len(body.rim_nodes)
    matrix[place] += 1e-3 * np.abs(matrix[:rim, :rim]).max()
    uneven = dataclasses.replace(body, **{what: matrix})
    told = f"its {what.replace('_', ' ')} on the rim differs by 0.001 of"
    with pytest.raises(ValueError, match=told):
        body_basis(uneven, 10)


def test_a_matrix_of_zeros_is_even():
    body, basis = _basis("rotating")
    assert body.stress_stiffening is not None
    free = dataclasses.replace(body, stress_stiffening=np.zeros_like(body.stress_stiffening))
    assert np.array_equal(body_basis(free, 30).square, basis.square)


# --- Under teeth


def _made_of(waves: list[int]) -> BodyBasis:
    size = len(waves)
    one = np.arange(1.0, size + 1.0)
    return BodyBasis(one, np.diag(one), np.zeros((size, 6)), np.array(waves), np.abs(waves))


@pytest.mark.parametrize("teeth", [20, 24, 25])
@pytest.mark.parametrize("sectors", [3, 6, 8, 24, 48])
@pytest.mark.parametrize("alone", [False, True])
def test_a_basis_repeats_when_the_body_and_its_modes_do(teeth, sectors, alone):
    half = sectors // 2
    alone = alone and sectors % 2 == 0
    basis = _made_of([0, 1, -1, half] if alone else [0, 1, -1])
    kept, repeats = basis.under_teeth(teeth, sectors)

    def same(periods: int, alone: bool) -> bool:
        """Whether so many teeth are whole sectors, and an even number of them."""
        passed, rest = divmod(periods * sectors, teeth)
        return rest == 0 and not (alone and passed % 2)

    left = len(basis.square) - len(kept.square)
    # Where every tooth stands on the same, not to have two tables is worth a few modes.
    assert left == (alone and same(1, False) and not same(1, True))
    alone = alone and not left
    assert repeats == next(p for p in itertools.count(1) if same(p, alone))
    if left:
        assert half not in kept.waves
        assert np.array_equal(kept.shapes, basis.shapes[:, :3])
        assert np.array_equal(kept.diameters, [0, 1, 1])


def test_six_holes_double_the_period_for_modes_alone():
    basis = _basis("holes")[1]
    kept, repeats = basis.under_teeth(WHEEL, 6)
    assert (basis.waves == 3).any()
    assert len(kept.square) == len(basis.square)
    assert repeats == 8
    without = dataclasses.replace(basis, waves=np.where(basis.waves == 3, 0, basis.waves))
    assert without.under_teeth(WHEEL, 6)[1] == 4


# --- Rigid motions


def _of_seats(body: ReducedBody) -> np.ndarray:
    moved = np.zeros((len(body.seats), 6, 6))
    for own, (x, y, z) in zip(moved, body.seat_points, strict=True):
        own[:] = np.eye(6)
        own[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return moved.reshape(-1, 6)


@pytest.mark.parametrize("name", ["rotating", "shaft"])
def test_a_body_follows_rigid_seats_rigidly(name):
    body, basis = _basis(name)
    rigid, rim = _of_seats(body), 3 * len(body.rim_nodes)
    moved = (basis.following @ rigid)[:rim].reshape(-1, 3, 6)
    x, y, z = body.rim_nodes.T
    none = np.zeros_like(x)
    turned = np.array([[none, z, -y], [-z, none, x], [y, -x, none]]).transpose(2, 0, 1)
    assert_near(moved[..., :3], np.broadcast_to(np.eye(3), (len(x), 3, 3)), 1e-9)
    assert_near(moved[..., 3:], turned, 1e-8)


def test_forces_of_rotation_of_rigid_motions_cancel_in_space():
    """What stands still in space needs no force, however fast the body turns in it."""
    body, basis = _basis("rotating")
    given = {
        key: np.asarray(x) for key, x in basis.matrices(body)._asdict().items() if x is not None
    }
    mass, turning = given["mass"], given["turning"]
    # A motion x that stands still in space is z = D(-theta) x on the body.
    force = mass @ turning @ turning - given["coriolis"] @ turning + given["softening"]
    rigid = np.concatenate([_of_seats(body), np.zeros((len(basis.square), 6))])
    size = np.sqrt(np.diagonal(rigid.T @ mass @ rigid))
    off = np.abs(_scaled(force, mass) @ (np.sqrt(np.diagonal(mass))[:, None] * rigid / size))
    assert off.max() < 1e-10
    # None of the three cancels alone: the spin's own square would be felt.
    spun = np.abs(_scaled(mass @ turning @ turning, mass)[:2, :2])
    assert spun.max() > 0.9


# --- Under cells


def _dense(kind: str, index: int, body: ReducedBody, grid, lines) -> Dense:
    gears = [Gear(None, FREE), Gear(None, FREE)]
    gears[index] = Gear(body, np.full((len(body.seats), 6), np.inf))
    return Dense(PAIRS[kind](), grid, gears, lines)


def _compare(kind: str, index: int, name: str, periods: int, phases: tuple[int, ...]) -> None:
    """Approach of cells by modes in space, against cells from the drawing on the turned body."""
    pair = PAIRS[kind]()
    body = hybrid_cases.body(kind, index, **SHAPES[name])
    basis = body_basis(body, 24)
    grid = jg.mesh_grid(pair, phases=8, slices=3, periods=periods)
    flexible = flexible_body(body, pair, index, grid, basis=basis)
    lines = jg.contact_lines(pair, grid)
    assert flexible.modes is not None
    found = np.asarray(_arms(pair, index, flexible, lines))
    basis = basis.under_teeth(TEETH[index], _sectors(body))[0]
    assert flexible.modes.waves == tuple(basis.waves)
    dense = _dense(kind, index, body, grid, lines)
    turning = basis.turning[6 * len(body.seats) :, 6 * len(body.seats) :]
    for phase in phases:
        # The middle of the body's tooth 0 enters at phase 0: how far it has turned since.
        theta = dense.turned(index, phase)
        rows = dense.rows(index, phase) @ basis.shapes
        assert_near(found[phase], rows @ scipy.linalg.expm(-theta * turning), 1e-7)


@pytest.mark.parametrize(
    ("kind", "index", "name", "periods", "phases"),
    quick(
        2,
        [
            ("spur", 1, "bore", 1, (0, 5)),
            ("helical", 0, "bore", 2, (3, 12)),
            ("helical", 1, "bore", 1, (6,)),
            ("spur", 1, "holes", 10, (1, 8 * 3 + 2, 8 * 5 + 1, 8 * 9 + 4)),
        ],
    ),
)
def test_cells_feel_modes_where_the_drawing_has_them(kind, index, name, periods, phases):
    _compare(kind, index, name, periods, phases)


@pytest.mark.slow
def test_cells_feel_modes_of_a_body_on_its_shaft():
    _compare("spur", 1, "shaft", 3, (2, 19))
