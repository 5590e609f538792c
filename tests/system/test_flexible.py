"""Condensed bodies under teeth in mesh: rigid motions, tables, statics against the whole body.

The reference of `hybrid_cases` holds every degree of freedom of a body, and places its cells from
the drawing.
"""

import dataclasses
import functools
import math

import equinox as eqx
import hybrid_cases
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import quick
from hybrid_cases import (
    FORCE,
    MOMENT,
    PAIRS,
    TEETH,
    TORQUE_AT,
    Dense,
    Gear,
    loaded_shaft,
    shaft,
    shaft_springs,
)

import jaxgear as jg
from fem_prep import ReducedBody
from jaxgear._contact._coupling import between_all_cells
from jaxgear._interface._wrench import structure_vectors
from jaxgear._solve._cycle import prepare_mesh
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import FootTables, foot_tables
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import pair_system

_tables = eqx.filter_jit(foot_tables)
_assembled = eqx.filter_jit(pair_system)

FREE = np.array([[np.inf] * 5 + [0.0]])


@functools.cache
def _grid(kind: str, periods: int = 1, slices: int = 3) -> jg.MeshGrid:
    return jg.mesh_grid(PAIRS[kind](), phases=8, slices=slices, periods=periods)


def _flexible(body: ReducedBody, kind: str = "spur", index: int = 1, **others) -> FlexibleBody:
    grid = others.pop("grid", _grid(kind))
    return flexible_body(body, PAIRS[kind](), index, grid, **others)


@functools.cache
def _in_mesh(
    kind: str, index: int, seats: str = "bore", holes: int = 0, periods: int = 1
) -> tuple[ReducedBody, FlexibleBody, jg.ContactLines, FootTables]:
    modes = 2 if seats == "bore" else 0
    body = hybrid_cases.body(kind, index, seats=seats, holes=holes, modes=modes)
    pair, grid = PAIRS[kind](), _grid(kind, periods)
    flexible = flexible_body(body, pair, index, grid)
    lines = jg.contact_lines(pair, grid)
    return body, flexible, lines, _tables(pair, index, flexible, lines)


def _near(found, wanted, share: float) -> None:
    found, wanted = np.asarray(found), np.asarray(wanted)
    off, size = np.abs(found - wanted).max(), np.abs(wanted).max()
    assert off <= share * size, f"off by {off / size:.3g} of {size:.3g}"


every_gear = pytest.mark.parametrize("index", [0, 1], ids=["pinion", "wheel"])
# A body on its shaft stands for spur wheels in the fast tests.
every_kind = pytest.mark.parametrize(
    "kind", [pytest.param("spur", marks=pytest.mark.slow), "helical"]
)


# --- Rigid motions


def _of_seats(body: ReducedBody) -> np.ndarray:
    """Motions of the seats per rigid motion of the gear, about mid-face."""
    moved = np.zeros((len(body.seats), 6, 6))
    for own, (x, y, z) in zip(moved, body.seat_points, strict=True):
        own[:] = np.eye(6)
        own[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return moved.reshape(-1, 6)


def _rigid_arms(kind: str, index: int, arm: np.ndarray) -> np.ndarray:
    """Approach of cells per motion of a rigid gear, `[phase, cell, 6]`."""
    approach, tilt = np.asarray(structure_vectors(PAIRS[kind]()))[6 * index : 6 * index + 6].T
    return approach + arm[..., None] * tilt


def _arm(kind: str) -> np.ndarray:
    pair, lines = PAIRS[kind](), _in_mesh(kind, 1)[2]
    helix = pair.base_helix_angle
    along = np.asarray(lines.roll - pair.pitch_point) * math.sin(helix)
    return (along + np.asarray(lines.face_position) * math.cos(helix)).reshape(8, -1)


@every_gear
@every_kind
def test_a_rigid_motion_of_the_seats_is_that_of_a_rigid_gear(kind, index):
    body, _, _, tables = _in_mesh(kind, index)
    found = np.asarray(tables.arms) @ _of_seats(body)
    # Rotations on the length of the pinion's radius.
    units = np.array([1.0, 1.0, 1.0, 50.0, 50.0, 50.0])
    wanted = _rigid_arms(kind, index, _arm(kind))
    for motion in range(6):
        off = np.abs(found - wanted)[..., motion].max() * units[motion]
        assert off < 1e-10, f"motion {motion}: {off}"


@pytest.mark.slow
def test_the_thesis_s_screw_leaves_the_tilts_of_helical_teeth_out():
    body = hybrid_cases.body("helical", 1, seats="bore", modes=2)
    rigid, screw = (_flexible(body, "helical", motion=motion) for motion in ("rigid", "screw"))
    assert screw.components == (0, 1, 2, 5)
    kept = np.array(screw.components)
    for name in ("from_seats", "growth"):
        _near(getattr(screw, name), getattr(rigid, name)[:, kept], 1e-12)
    _near(screw.flexibility, rigid.flexibility[:, kept][:, :, kept], 1e-12)
    spur = hybrid_cases.body("spur", 1, seats="bore", modes=2)
    assert _flexible(spur, motion="screw").components == _flexible(spur).components


@pytest.mark.slow
def test_a_rigid_motion_of_several_seats_is_that_of_a_rigid_gear():
    body, flexible, _, tables = _in_mesh("spur", 1, "shaft")
    assert flexible.seats == ("bearing[0]", "torque", "bearing[1]", "bearing[2]")
    assert flexible.seats[flexible.gear_seat] == "torque"
    _near(np.asarray(tables.arms) @ _of_seats(body), _rigid_arms("spur", 1, _arm("spur")), 1e-9)


@every_kind
def test_rigid_rolling_closes_no_gap(kind):
    """r_b1 theta_1 + r_b2 theta_2 = 0."""
    base = PAIRS[kind]().base_radius
    rolled = [
        np.asarray(_in_mesh(kind, index)[3].arms)[..., 5] * sense / base[index]
        for index, sense in ((0, 1.0), (1, -1.0))
    ]
    np.testing.assert_allclose(rolled[0], np.cos(PAIRS[kind]().base_helix_angle), rtol=1e-10)
    np.testing.assert_allclose(rolled[0] + rolled[1], 0.0, atol=1e-10)


# --- The tables


@every_gear
@every_kind
def test_the_flexibility_of_feet_is_symmetric_and_positive(kind, index):
    flexible = _in_mesh(kind, index)[1]
    assert flexible.components == ((0, 1, 5) if kind == "spur" else (0, 1, 2, 3, 4, 5))
    size, cells = len(flexible.components), flexible.growth.shape[2]
    table = np.asarray(flexible.flexibility[0]).swapaxes(1, 2).reshape(size * cells, -1)
    assert np.array_equal(table, table.T)
    scale = 1.0 / np.sqrt(np.diagonal(table))
    lowest = np.linalg.eigvalsh(scale[:, None] * table * scale)[0]
    # Positive definite: no two feet stand on the same elements with the same weights.
    assert lowest > 1e-6


def test_what_cells_give_is_symmetric_and_positive():
    compliance = np.asarray(_in_mesh("helical", 1)[3].compliance)
    _near(compliance, compliance.swapaxes(1, 2), 1e-12)
    assert (np.linalg.eigvalsh(compliance) > 0.0).all()


@pytest.mark.parametrize("holes", quick(1, [0, 3]))
def test_the_stiffness_between_seats_turns_with_the_body(holes):
    body = hybrid_cases.body("spur", 1, seats="shaft", holes=holes)
    flexible = _flexible(body)
    matrix = np.asarray(flexible.seat_stiffness)
    size = np.sqrt(np.diagonal(matrix))
    scaled = lambda x: x / size[:, None] / size
    for angle in (0.3, math.pi / 3, 2.0):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.kron(np.eye(8), [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        _near(scaled(turn @ matrix @ turn.T), scaled(matrix), 1e-7)
    rigid = _of_seats(body)
    assert np.abs(scaled(matrix) @ (size[:, None] * rigid)).max() < 1e-10 * size.max()
    values = np.linalg.eigvalsh(scaled(matrix))
    assert np.abs(values[:6]).max() < 1e-12 < 1e-5 < values[6]


def _whole_flexibility(body: ReducedBody, kind: str, periods: int) -> FlexibleBody:
    """Tables of every tooth, whatever is known of the body's symmetry."""
    facts = {**body.facts, "sectors": 1}
    blind = dataclasses.replace(body, facts=facts)
    return _flexible(blind, kind, grid=_grid(kind, periods))


@every_kind
def test_a_body_that_repeats_from_tooth_to_tooth_has_one_table(kind):
    body = _in_mesh(kind, 1)[0]
    assert _flexible(body, kind, grid=_grid(kind, 7)).periods == 1
    tables = _whole_flexibility(body, kind, 7)
    assert tables.periods == 7
    for name in ("flexibility", "from_seats", "growth", "centres"):
        each = np.asarray(getattr(tables, name))
        _near(each, np.broadcast_to(each[:1], each.shape), 1e-10)


@pytest.mark.slow
def test_holes_make_a_table_for_each_place_between_them():
    body = hybrid_cases.body("spur", 1, holes=3)
    assert body.facts["sectors"] == 3
    own = _flexible(body, grid=_grid("spur", 10))
    assert own.periods == 8
    tables = _whole_flexibility(body, "spur", 10)
    each = np.asarray(tables.flexibility)
    # Teeth are counted modulo their number only where the body repeats.
    _near(own.flexibility, each[:8], 1e-10)
    _near(each[8:], each[:2], 1e-10)
    # The web's elements are gone under every eighth tooth: half way its neighbours are as stiff.
    assert np.abs(each[4] / each[0] - 1.0).max() > 0.05


def test_two_points_and_collocation_give_other_tables():
    body = hybrid_cases.body("spur", 1)
    own, two, off = (
        np.asarray(tables.flexibility)
        for tables in (
            _flexible(body),
            _flexible(body, points=2),
            _flexible(body, axial="collocation"),
        )
    )
    for other in (two, off):
        assert 1e-4 < np.abs(other - own).max() / np.abs(own).max() < 0.5


def test_a_correction_is_added_tooth_by_tooth():
    body = hybrid_cases.body("spur", 1)
    local = np.random.default_rng(0).normal(size=(18, 18))
    local = 1e-10 * (local + local.T)
    own, more = (
        np.asarray(_flexible(body, local=x).flexibility[0])
        for x in (None, lambda teeth: local[None])
    )
    added = (more - own).reshape(3, 3, 3, 3, 3, 3)
    wanted = local.reshape(3, 6, 3, 6)[:, [0, 1, 5]][..., [0, 1, 5]]
    for line in range(3):
        for other in range(3):
            block = added[:, :, line, :, other].transpose(2, 0, 3, 1)
            _near(block + own.max(), own.max() + (wanted if line == other else 0.0 * wanted), 1e-12)


# --- Statics against all degrees of freedom


def _system(kind: str, index: int, flexible: FlexibleBody, mount, speed: float = 0.0):
    mounts: list = [jg.Support(), jg.Support()]
    bodies: list = [None, None]
    mounts[index], bodies[index] = mount, flexible
    torque = jnp.asarray(100.0)
    return _assembled(
        PAIRS[kind](),
        torque,
        *mounts,
        pinion_body=bodies[0],
        wheel_body=bodies[1],
        speed=jnp.asarray(speed),
    )


def _dense(kind: str, index: int, gear: Gear, lines) -> Dense:
    gears = [Gear(None, FREE), Gear(None, FREE)]
    gears[index] = gear
    return Dense(PAIRS[kind](), _grid(kind, lines.periods), gears, lines)


# Unequal along S and T: what the mesh coordinates get wrong by a turn would show.
SUPPORT = jg.Support(1e8, 2.5e8, 3e8, 1e5)
SPRINGS = np.array([[1e8, 2.5e8, 3e8, 1e5, 1e5, np.inf]])


def _compare(kind: str, index: int, state, gear: Gear, mount, phases=(1, 5), speed=900.0) -> None:
    """What cells give to forces and to rotation, in both ways."""
    body, flexible, lines, tables = state
    system = _system(kind, index, flexible, mount, speed)
    dense = _dense(kind, index, gear, lines)
    own = speed * (1.0 if index == 0 else TEETH[0] / TEETH[1])
    for phase in phases:
        arms, seats = np.asarray(tables.arms[phase]), np.asarray(system.mesh_flexibility)[2:, 2:]
        given = np.asarray(tables.compliance[phase]) + arms @ seats @ arms.T
        _near(given, dense.flexibility(index, phase), 1e-9)
        grown = (
            own**2 * np.asarray(tables.growth[phase]) + arms @ np.asarray(system.mesh_offset)[2:]
        )
        spun = dense.answer(index, phase, own**2 * body.centrifugal_load)
        _near(grown, dense.rows(index, phase) @ spun, 1e-8)


@every_gear
@every_kind
def test_statics_are_those_of_the_whole_body(kind, index):
    state = _in_mesh(kind, index)
    _compare(kind, index, state, Gear(state[0], SPRINGS), SUPPORT)


@pytest.mark.slow
def test_statics_of_a_body_on_three_bearings():
    state = _in_mesh("spur", 1, "shaft")
    _compare("spur", 1, state, Gear(state[0], shaft_springs(), 1), shaft())


@pytest.mark.slow
def test_statics_of_a_body_with_holes_at_every_period():
    state = _in_mesh("spur", 1, "bore", 3, 9)
    # Phases of the first, a middle and the last period, in which the tables begin again.
    _compare("spur", 1, state, Gear(state[0], SPRINGS), SUPPORT, (2, 8 * 3 + 2, 8 * 8 + 2))
    compliance = np.asarray(state[3].compliance)
    _near(compliance[8 * 8 + 2], compliance[2], 1e-12)
    assert np.abs(compliance[8 * 3 + 2] / compliance[2] - 1.0).max() > 0.01


def test_slices_that_share_a_ring_add_to_the_cells_of_a_body():
    coupling = np.random.default_rng(1).normal(size=(2, 3, 3, 4))
    dense = np.asarray(between_all_cells(jnp.asarray(coupling)))
    force = np.random.default_rng(2).normal(size=(3, 4))
    wanted = np.einsum("pijs,js->pis", coupling, force).reshape(2, 12)
    np.testing.assert_allclose(dense @ force.ravel(), wanted, rtol=0, atol=1e-14)


# --- What is refused


def _refused(message: str, body: ReducedBody | None = None, pair=None, **others) -> None:
    body = hybrid_cases.body("spur", 1) if body is None else body
    pair = PAIRS["spur"]() if pair is None else pair
    with pytest.raises(ValueError, match=message):
        flexible_body(body, pair, 1, _grid("spur"), **others)


def _scaled(by: float) -> ReducedBody:
    body = hybrid_cases.body("spur", 1)
    return dataclasses.replace(body, rim_nodes=by * body.rim_nodes)


def test_the_body_of_another_gear_is_refused():
    _refused(
        r"rim of the wheel.*radius of the root circle.*got 17\.9 mm.*another gear\.$",
        hybrid_cases.body("spur", 0),
    )


@pytest.mark.parametrize("by", [1e3, 1e-3])
def test_a_body_in_other_units_is_refused(by):
    _refused(r"another gear\. Its file is in other units than metres", _scaled(by))


def test_a_body_narrower_than_the_face_is_refused():
    body = hybrid_cases.body("spur", 1)
    narrow = dataclasses.replace(body, rim_nodes=body.rim_nodes * [1.0, 1.0, 0.8])
    _refused(r"wheel's condensed body must be at least as wide as .* 10 mm, got 9\.6 mm", narrow)


def test_a_body_beside_its_teeth_is_refused():
    body = hybrid_cases.body("spur", 1)
    beside = dataclasses.replace(body, rim_nodes=np.add(body.rim_nodes, [0.0, 0.0, 3e-3]))
    _refused(r"be attached to the rim.*z = 0 in the middle of the face", beside)


def test_a_rim_without_faces_is_refused():
    body = hybrid_cases.body("spur", 1)
    blank = dataclasses.replace(body, rim_faces=np.zeros((0, 8), dtype=int))
    _refused(r"wheel must know the elements of its rim", blank)


def test_a_shaft_stiffer_in_one_direction_is_refused():
    body = hybrid_cases.body("spur", 1, seats="shaft")
    stiffness, (one, other) = (
        body.stiffness.copy(),
        (body.seat_dofs(s).start for s in body.seats[:2]),
    )
    flat = 0.02 * stiffness[one, one]
    stiffness[[one, other], [one, other]] += flat
    stiffness[[one, other], [other, one]] -= flat
    uneven = dataclasses.replace(body, stiffness=stiffness)
    _refused(r"same in every direction.*'spur 1' differs", uneven)


def test_a_torque_at_no_seat_is_refused():
    _refused(r"must be one of the body's, bore, got 'torque'", gear_seat="torque")


def _model(flexible: FlexibleBody, mount) -> PairModel:
    return PairModel(PAIRS["spur"](), 100.0, wheel_support=mount, wheel_body=flexible)


def test_seats_that_no_bearing_has_are_refused():
    flexible = _in_mesh("spur", 1)[1]
    with pytest.raises(ValueError, match=r"a seat for each bearing, bearing\[0\].* got bore"):
        _model(flexible, shaft())
    flexible = _in_mesh("spur", 1, "shaft")[1]
    with pytest.raises(ValueError, match=r"has the seats bearing\[0\].* give the bearings"):
        _model(flexible, SUPPORT)


# --- Loads on the shaft, at the seat of the torque

_BESIDE = 1.5e-3


def test_a_load_on_a_condensed_shaft_moves_it_as_all_its_unknowns_say():
    """A load 1.5 mm beside its seat, against the body before its rim is taken out, in NumPy."""
    body, flexible, _, tables = _in_mesh("spur", 1, "shaft")
    flexible = dataclasses.replace(flexible, load_seats=(1,))
    torque = jnp.asarray(20.0)
    system = _assembled(
        PAIRS["spur"](), torque, SUPPORT, loaded_shaft(_BESIDE), wheel_body=flexible
    )
    wheel = np.arange(6, 30)
    found = np.asarray(system.statics.offset)[wheel].reshape(4, 6)

    at = np.array([0.0, 0.0, TORQUE_AT + _BESIDE])
    whole = np.concatenate([FORCE, MOMENT + np.cross([0.0, 0.0, _BESIDE], FORCE)])
    stiffness, seats = body.stiffness.copy(), [body.seat_dofs(name) for name in body.seats]
    springs = shaft_springs()
    for own, spring in zip(seats, springs, strict=True):
        stiffness[own, own] += np.diag(spring)
    load = np.zeros(len(stiffness))
    load[seats[1]] = whole
    # What balances the couples about Z acts at the torque's seat, whose rotation is the gear's.
    kept = np.setdiff1d(np.arange(len(stiffness)), [seats[1].start + 5])
    moved = np.zeros(len(stiffness))
    moved[kept] = np.linalg.solve(stiffness[kept[:, None], kept], load[kept])
    _near(found, [moved[own] for own in seats], 1e-7)

    # Bearings bear it as a rigid body would ask.
    borne = springs * found
    _near(borne[:, :3].sum(axis=0), FORCE, 1e-8)
    turned = np.cross(body.seat_points, borne[:, :3]).sum(axis=0)
    _near(turned[:2], (MOMENT + np.cross(at, FORCE))[:2], 1e-8)

    # Work of the load by a tooth's force is that of the tooth's force by the load.
    arms = np.asarray(tables.arms)[2]
    by_load = arms @ found.ravel()
    by_teeth = np.asarray(system.statics.response)[wheel][6:12, 2:] @ arms.T
    _near(by_load, whole @ by_teeth, 1e-9)


def test_a_load_far_from_every_seat_of_a_condensed_shaft_is_refused():
    flexible = _in_mesh("spur", 1, "shaft")[1]
    with pytest.raises(ValueError, match=r"seat of each of its loads: there are 1 loads"):
        _model(flexible, loaded_shaft(_BESIDE))
    flexible = dataclasses.replace(flexible, load_seats=(1,))
    with pytest.raises(ValueError, match=r"thick, 8 mm, got 9 mm. Give the body a seat there"):
        _model(flexible, loaded_shaft(9e-3))


def test_tables_for_another_grid_are_refused():
    model = _model(_in_mesh("spur", 1)[1], SUPPORT)
    with pytest.raises(ValueError, match=r"made for 3 slices and 3 lines, used with 5 and 3"):
        prepare_mesh(model, _grid("spur", slices=5))
    more = dataclasses.replace(_grid("spur"), lines=4, first_line=-2)
    with pytest.raises(ValueError, match=r"made for 3 slices and 3 lines, used with 3 and 4"):
        prepare_mesh(model, more)
