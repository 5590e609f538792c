"""Back flanks beside drive flanks: turned motions, mirrored pairs, the play between the two."""

import dataclasses
import functools
import re
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import helical_25_31, mirrored, power
from helpers import assert_close, assert_gradient, quick

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._dynamics._back_flank import (
    back_flank_table,
    back_vectors,
    turned_misalignment,
    with_back_flanks,
)
from jaxgear._dynamics._cell_forces import mesh_load
from jaxgear._dynamics._table import MeshTable, mesh_at, mesh_table, repeated
from jaxgear._geometry._backlash import mirror_point, normal_backlash
from jaxgear._geometry._profile import tooth_section
from jaxgear._interface._wrench import beam_basis, structure_vectors
from jaxgear._system._mesh_vectors import beam_vectors

_TORQUE = jnp.asarray(60.0)
_TURNED = np.array([1.0, -1.0, -1.0])


class _Coupled(jg.AbstractCompliance):
    """A law that is different at both ends of the path, and bodies that couple the lines.

    It costs no compilation, unlike teeth on rings.
    """

    load_updates: ClassVar[int] = 0  # ty: ignore[incompatible-attribute-override]

    def local(self, pair: jg.GearPair, roll: jax.Array, line_load: jax.Array) -> jax.Array:
        del line_load
        place = (roll - pair.path_start) / pair.path_of_contact
        return (1.0 + 0.5 * place + 0.4 * (2.0 * place - 1.0) ** 2) / 14e9

    def bodies(self, pair: jg.GearPair, neighbours: int) -> tuple[jg.SharedBody, ...]:
        away = 0.5 ** jnp.arange(neighbours + 1.0)[:, None, None]
        own = jnp.asarray([[3.0, 1.0, 0.2], [0.4, 2.0, 0.5], [0.1, 0.6, 4.0]]) * 1e-12
        ends = (jnp.zeros(()), pair.tangent_length)
        return tuple(
            jg.SharedBody(
                tooth_section(pair, gear),
                # A root's motion by its own load is symmetric, that by another's is not.
                (own[None] * away).at[0].set(own + own.T),
                start,
                sign,
                1.0 / jnp.cos(pair.base_helix_angle),
            )
            for gear, start, sign in zip((pair.pinion, pair.wheel), ends, (1, -1), strict=True)
        )

    def log_slope(self, pair: jg.GearPair) -> jax.Array:
        return jnp.zeros_like(pair.normal_module)


@functools.cache
def _grid() -> jg.MeshGrid:
    return jg.mesh_grid(helical_25_31(), phases=12, slices=3)


@pytest.fixture(autouse=True, scope="module")
def _chosen_outside_of_programs():
    """Grids are chosen from concrete pairs, before anything is traced."""
    _grid()


def _with_allowances(pair: jg.GearPair) -> jg.GearPair:
    return eqx.tree_at(
        lambda p: (p.pinion.thickness_allowance, p.wheel.thickness_allowance),
        pair,
        (jnp.asarray(60.0 * um), jnp.asarray(20.0 * um)),
        is_leaf=lambda x: x is None,
    )


@functools.cache
def _model() -> jg.PairModel:
    """A pair in which nothing cancels, with its axes out of parallel both ways."""
    return jg.PairModel(
        _with_allowances(helical_25_31()),
        _TORQUE,
        compliance=_Coupled(),
        misalignment=jg.Misalignment(7.0 * um, -4.0 * um),
    )


def _placed_like(model: jg.PairModel, pair: jg.GearPair, **misalignment: float) -> jg.PairModel:
    """The model with other numbers, so that programs are shared."""
    axes = jg.Misalignment(**misalignment)
    return eqx.tree_at(lambda m: (m.pair, m.misalignment), model, (pair, axes))


@eqx.filter_jit
def _drive(model: jg.PairModel) -> tuple[jg.PairSystem, MeshTable]:
    """The system and the table of its drive flanks."""
    system = jg.pair_system(model.pair, model.torque)
    load = jg.nominal_line_load(model.pair, model.mesh_torque)
    cells = jg.mesh_cells(model.pair, _grid(), model.compliance, load)
    table = mesh_table(system, cells, _grid(), model.flanks, model.misalignment)
    return system, table


@eqx.filter_jit
def _back(system: jg.PairSystem, model: jg.PairModel, table: MeshTable) -> MeshTable:
    return back_flank_table(system, model, _grid(), table)[0]


@eqx.filter_jit
def _loads(table: MeshTable, place: jax.Array, part: float) -> jax.Array:
    """Load on the mesh coordinates in each step."""
    law = jg.ExactContact()
    return jax.vmap(lambda mesh: mesh_load(mesh, place, law)[0])(mesh_at(table, part))


@functools.cache
def _tables() -> tuple[jg.PairSystem, MeshTable, MeshTable]:
    system, drive = _drive(_model())
    return system, drive, _back(system, _model(), drive)


def _play() -> float:
    return float(jax.jit(normal_backlash)(_model().pair))


# --- coordinates


def test_turning_the_pair_turns_the_approach_of_the_back_flanks():
    """r_b1 th1 + r_b2 th2 = x closes drive flanks by x cos(beta_b), and opens back flanks."""
    pair = helical_25_31()
    motion = jnp.zeros(12).at[5].set(3e-4).at[11].set(-1e-4)
    closed = 3e-4 * pair.base_radius[0] - 1e-4 * pair.base_radius[1]
    expected = jnp.stack([-closed * jnp.cos(pair.base_helix_angle), 0.0 * closed])
    back = back_vectors(structure_vectors(pair), (1, 1))
    assert_close(motion @ back, expected, rtol=1e-12, atol=1e-18)


def test_approaching_gears_close_both_flanks_and_passing_ones_only_one():
    """By hand: towards each other sin(a_wt) cos(beta_b) on both, past each other +-cos(a_wt)."""
    vectors = np.asarray(structure_vectors(helical_25_31()))
    back = np.asarray(back_vectors(jnp.asarray(vectors), (1, 1)))
    # u_S of the pinion and of the wheel, then u_T, then u_Z.
    np.testing.assert_array_equal(back[[0, 6], 0], vectors[[0, 6], 0])
    np.testing.assert_array_equal(back[[1, 7], 0], -vectors[[1, 7], 0])
    np.testing.assert_array_equal(back[[2, 8], 0], -vectors[[2, 8], 0])


def _approach(pair, mounts, bodies, motions, roll, across) -> float:
    """Approach of back flanks at a place in their own coordinates, by rigid kinematics."""
    angle, helix = float(pair.working_pressure_angle), float(pair.base_helix_angle)
    along = np.array([np.sin(angle), np.cos(angle), 0.0])
    square = np.array([np.cos(angle), -np.sin(angle), 0.0])
    # All of it turned by half a revolution about S; the height turns sign with the rest.
    normal = _TURNED * (np.cos(helix) * along - np.sin(helix) * np.array([0.0, 0.0, 1.0]))
    arm = _TURNED * (float(pair.base_radius[0]) * square + roll * along)
    centres = np.array([float(pair.working_centre_distance), 0.0, 0.0])
    total = 0.0
    for mount, body, motion, from_axis, sign in zip(
        mounts, bodies, motions, (arm, arm - centres), (1.0, -1.0), strict=True
    ):
        section = np.asarray(body.section_motion(mount, jnp.asarray(-across))) @ motion
        total += sign * normal @ (section[:3] + np.cross(section[3:], from_axis))
    return total


@pytest.mark.parametrize("kind", quick(1, ["rigid", "beam"]))
def test_back_vectors_give_the_approach_of_points_on_back_flanks(kind):
    pair = power()
    mounts: tuple[jg.Shaft | jg.Support, jg.Shaft | jg.Support] = jg.Support(), jg.Support()
    bodies: list[jg.RigidBody | jg.BeamBody] = [jg.RigidBody(1.0, 1e-3, 1e-3)] * 2
    if kind == "beam":
        bearings = [jg.Bearing(at, 3e8, 5e8, 1e8) for at in (0.0, 90 * mm)]
        bodies[0] = jg.BeamBody(44 * mm, 84 * mm)
        shaft = [jg.Segment(90 * mm, 30 * mm)]
        mounts = jg.Shaft(shaft, bearings, 40 * mm, body_width=44 * mm), jg.Support()
    counts = (2, 1) if kind == "beam" else (1, 1)
    draw = np.random.default_rng(7).normal(size=6 * sum(counts)) * 1e-5
    motions = np.split(draw, [6 * counts[0]])
    if kind == "beam":
        vectors = jax.jit(lambda: beam_vectors(pair, mounts, bodies))()
    else:
        vectors = structure_vectors(pair)
    place = np.asarray(back_vectors(vectors, counts)).T @ draw
    for roll, across in ((20 * mm, -17 * mm), (23 * mm, 5 * mm), (27 * mm, 20 * mm)):
        if kind == "beam":
            basis = beam_basis(pair, jnp.asarray(across), jnp.asarray(roll))
            found = place @ np.asarray(jnp.stack(basis))
        else:
            helix = float(pair.base_helix_angle)
            off = roll - float(pair.pitch_point)
            found = place @ [1.0, across * np.cos(helix) + off * np.sin(helix)]
        expected = _approach(pair, mounts, bodies, motions, roll, across)
        assert abs(found - expected) < 1e-9 * np.max(np.abs(draw))


def test_turning_twice_is_turning_not_at_all():
    vectors = jnp.asarray(np.random.default_rng(1).normal(size=(18, 7)))
    twice = back_vectors(back_vectors(vectors, (1, 2)), (1, 2))
    np.testing.assert_array_equal(twice, vectors)
    with pytest.raises(
        ValueError, match="3 nodes of the gears need 18 rows of mesh vectors, got 12"
    ):
        back_vectors(vectors[:12], (1, 2))


# --- forces


@pytest.mark.slow
def test_the_mirrored_pair_driven_the_other_way_round():
    """In a mirror through both axes back flanks drive: same wrench on the gears at every phase.

    A mirror is no turn: the helix changes hand, slices keep their sides, time runs backwards.
    """
    model = _model()
    pair, axes = model.pair, model.misalignment
    reflected = _placed_like(
        model,
        mirrored(pair),
        inclination=float(axes.inclination),
        deviation=-float(axes.deviation),
    )
    other, theirs = _drive(reflected)
    # The steps of the mirrored pair, in our time.
    mirror = 2.0 * (mirror_point(pair) - pair.path_start) / pair.transverse_base_pitch
    system, drive, _ = _tables()
    steps = dataclasses.replace(drive, edges=(mirror - theirs.edges)[::-1])
    ours = _back(system, model, steps)
    vectors = back_vectors(system.vectors, (1, 1))
    rng = np.random.default_rng(5)
    motion = rng.normal(size=12) * np.tile([3e-6] * 3 + [1e-4] * 3, 2)
    backlash = _play()
    # Turned back until the play is used up, and 15 um further.
    slack = backlash + 15.0 * um - float(motion @ vectors[:, 0])
    motion[5] += slack / float(vectors[5, 0])
    seen = np.tile([1.0, -1.0, 1.0, -1.0, 1.0, -1.0], 2)
    place = jnp.asarray(motion) @ vectors
    reflection = (jnp.asarray(seen * motion) @ other.vectors).at[0].add(-backlash)
    for part in (0.0, 0.5, 1.0):
        wrench = np.asarray(_loads(ours, place, part) @ vectors.T)
        driven = np.asarray(_loads(theirs, reflection, 1.0 - part) @ other.vectors.T)[::-1] * seen
        assert np.min(np.linalg.norm(wrench[:, :3], axis=1)) > 100.0
        np.testing.assert_allclose(wrench, driven, rtol=1e-7, atol=1e-7 * np.max(np.abs(wrench)))


def test_misalignment_is_the_same_seen_from_the_other_side():
    """A wheel that leans away at one end opens both flanks there, one that leans aside only one.

    A slice at height z is at -z in the coordinates of the back flanks.
    """

    @jax.jit
    def gap(axes: jg.Misalignment) -> jax.Array:
        pair, grid = helical_25_31(), _grid()
        lines = jg.contact_lines(pair, grid)
        return jg.mesh_gap(pair, lines, jg.Flanks(), axes).reshape(lines.roll.shape)

    for axes, sign in ((jg.Misalignment(5.0 * um), 1.0), (jg.Misalignment(0.0, 5.0 * um), -1.0)):
        seen = np.asarray(gap(turned_misalignment(axes)))[:, :, ::-1]
        np.testing.assert_allclose(seen, sign * np.asarray(gap(axes)), atol=1e-15)
        assert np.max(np.abs(seen)) > 0.5 * um


@pytest.mark.slow
def test_nothing_pushes_within_the_backlash():
    """Drive flanks push at once, back flanks once the pair has turned by j_n; as hard."""
    system, _, _ = _tables()
    model = _placed_like(_model(), _model().pair)
    system, drive = _drive(model)
    both = with_back_flanks(drive, _back(system, model, drive))
    play = _play()
    vectors = jnp.concatenate([system.vectors, back_vectors(system.vectors, (1, 1))], axis=1)

    def force(approach: float) -> np.ndarray:
        """On drive and on back flanks in each step, if the pinion turns by this approach."""
        motion = jnp.zeros(12).at[5].set(approach / system.vectors[5, 0])
        return np.asarray(_loads(both, motion @ vectors, 0.5))[:, [0, 2]]

    assert play > 80.0 * um * 0.9  # what the allowances give, and the centre distance more
    for approach in (-1e-9, -0.5 * play, -play + 1e-9):
        np.testing.assert_array_equal(force(approach), 0.0)
    length = np.diff(np.asarray(drive.edges))
    pushed, pushed_back = force(10.0 * um), force(-play - 10.0 * um)
    assert np.all(pushed[:, 1] == 0.0)
    assert np.all(pushed_back[:, 0] == 0.0)
    # The same stiffness in the mean of all phases, but for the quadrature.
    assert_close(length @ pushed_back[:, 1], length @ pushed[:, 0], rtol=5e-3, atol=0.0)
    # Straight axes: once j_n is used up the force is proportional to what is left.
    twice = force(-play - 20.0 * um)
    np.testing.assert_allclose(twice[:, 1], 2.0 * pushed_back[:, 1], rtol=1e-9)


# --- both flanks in one table


@pytest.mark.slow
def test_joined_tables_push_as_each_does_alone():
    _, drive, back = _tables()
    both = with_back_flanks(drive, back)
    cells = drive.stiffness.shape[1] + back.stiffness.shape[1]
    assert both.arms.shape == (3, 12, cells, 4)
    place = jnp.asarray([12.0 * um, 2e-4, _play() + 15.0 * um, -3e-4])
    alone = [_loads(drive, place[:2], 0.5), _loads(back, place[2:], 0.5)]
    assert min(float(jnp.min(load[:, 0])) for load in alone) > 100.0
    joined = _loads(both, place, 0.5)
    np.testing.assert_allclose(joined, np.concatenate(alone, axis=1), rtol=1e-9)


@pytest.mark.slow
def test_a_flank_that_is_not_coupled_stands_alone():
    _, drive, back = _tables()
    stiff = dataclasses.replace(back, coupling=None)
    place = jnp.asarray([12.0 * um, 2e-4, _play() + 15.0 * um, -3e-4])
    for ours, theirs in ((drive, stiff), (stiff, drive)):
        joined = _loads(with_back_flanks(ours, theirs), jnp.roll(place, 2 * (ours is stiff)), 0.5)
        first, second = (place[2:], place[:2]) if ours is stiff else (place[:2], place[2:])
        alone = [_loads(ours, first, 0.5), _loads(theirs, second, 0.5)]
        np.testing.assert_allclose(joined, np.concatenate(alone, axis=1), rtol=1e-9)
    loose = with_back_flanks(dataclasses.replace(drive, coupling=None), stiff)
    assert loose.coupling is None


@pytest.mark.slow
def test_several_periods_repeat_nominal_back_flanks():
    system, drive, back = _tables()
    long = repeated(drive, 3)
    found = _back(system, _model(), long)
    again = repeated(back, 3)
    assert (found.periods, found.kinds) == (3, again.kinds)
    np.testing.assert_array_equal(found.edges, long.edges)
    for name in ("stiffness", "gap", "arms", "coupling"):
        np.testing.assert_array_equal(getattr(found, name), getattr(again, name))
    with pytest.raises(ValueError, match=re.escape("got 12 and 36 steps in 1 and 3 mesh periods")):
        with_back_flanks(drive, found)


@pytest.mark.slow
def test_steps_too_long_for_the_lines_kept_are_refused():
    few = dataclasses.replace(_grid(), lines=1)
    with pytest.raises(ValueError, match="Use more phases"):
        jg.pair_dynamics(_model(), few)


@pytest.mark.slow
def test_forces_of_back_flanks_are_differentiable():
    """Their teeth move through the steps, and their gap with the geometry."""
    system, drive, _ = _tables()
    place = jnp.asarray([_play() + 20.0 * um, -3e-4])
    uncoupled = dataclasses.replace(_model(), compliance=jg.ConstantStiffness(14e9))

    def pushed(model: jg.PairModel) -> jax.Array:
        back, _ = back_flank_table(system, model, _grid(), drive)
        overlap = back.arms @ place - back.gap
        return jnp.sum(back.stiffness * jnp.sum(jnp.maximum(overlap, 0.0), axis=0))

    moving = lambda x: (x.pair, x.misalignment)
    of_pair = lambda parts: pushed(eqx.tree_at(moving, uncoupled, parts))
    assert_gradient(of_pair, moving(uncoupled), rtol=1e-5, step=1e-7)
