"""The mesh wrench against the vectors it stands for: normal, contact point and centres in space."""

import math
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick
from solve_cases import ACCESSORY, FZG_C14, FZG_H501, POWER, Drawing

import jaxgear as jg

LEFT_HAND = replace(POWER, helix_angle=-POWER.helix_angle)
every_drawing = pytest.mark.parametrize(
    "drawing",
    quick(2, [ACCESSORY, POWER, LEFT_HAND, FZG_H501, FZG_C14]),
    ids=["accessory", "power", "power, left hand", "h501", "c14"],
)


def _axes(drawing: Drawing) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Line of action, pinion's normal, centres (rows), S from pinion to wheel, T = Z x S."""
    angle, helix = drawing.working_angle, drawing.base_helix
    line = np.array([math.sin(angle), math.cos(angle), 0.0])
    normal = math.cos(helix) * line - math.sin(helix) * np.array([0.0, 0.0, 1.0])
    centres = np.array([[0.0, 0.0, 0.0], [drawing.centre_distance, 0.0, 0.0]])
    return line, normal, centres


def _point(drawing: Drawing, roll: float, z: float) -> np.ndarray:
    """A point of the plane of action: `roll` from the pinion's base tangent point T1."""
    angle = drawing.working_angle
    line, _, _ = _axes(drawing)
    tangent = drawing.base_radius[0] * np.array([math.cos(angle), -math.sin(angle), 0.0])
    return tangent + roll * line + z * np.array([0.0, 0.0, 1.0])


def _approach(drawing: Drawing, motion: np.ndarray, point: np.ndarray) -> float:
    """Normal velocity with which two rigid bodies close at a point: n1.u1 + n2.u2."""
    _, normal, centres = _axes(drawing)
    total = 0.0
    for body, outward in ((0, normal), (1, -normal)):
        shift, turn = motion[6 * body : 6 * body + 3], motion[6 * body + 3 : 6 * body + 6]
        total += outward @ (shift + np.cross(turn, point - centres[body]))
    return float(total)


@every_drawing
def test_base_tangent_points_lie_on_the_base_cylinders(drawing):
    """Guards the vectors of this file: both ends of the tangent, and the pitch point on O1O2."""
    line, _, centres = _axes(drawing)
    length = drawing.centre_distance * math.sin(drawing.working_angle)
    for roll, centre, radius in zip((0.0, length), centres, drawing.base_radius, strict=True):
        arm = _point(drawing, roll, 0.0) - centre
        assert_close(np.linalg.norm(arm), radius, rtol=1e-13, atol=0.0)
        assert abs(arm @ line) < 1e-15
    pitch_radius = drawing.centre_distance * drawing.teeth[0] / sum(drawing.teeth)
    pitch = _point(drawing, pitch_radius * math.sin(drawing.working_angle), 0.0)
    assert_close(pitch, np.array([pitch_radius, 0.0, 0.0]), rtol=1e-13, atol=1e-16)


@every_drawing
def test_approach_at_any_cell_is_affine_in_its_arm(drawing):
    pair = drawing.pair()
    vectors = np.asarray(jg.structure_vectors(pair))
    grid = jg.mesh_grid(pair, phases=8, slices=5)
    cells = jg.mesh_cells(pair, grid, jg.ConstantStiffness(1e10), jnp.asarray(1e5))
    rolls = np.asarray(cells.lines.roll)
    places = np.broadcast_to(np.asarray(cells.lines.face_position), rolls.shape)
    arms = np.asarray(cells.arm).reshape(rolls.shape)
    rng = np.random.default_rng(1)
    for index in rng.integers(0, rolls.size, 20):
        # Radians count as much as metres at the pitch circle.
        motion = rng.normal(size=12) * np.tile([0.03, 0.03, 0.03, 1.0, 1.0, 1.0], 2)
        point = _point(drawing, float(rolls.flat[index]), float(places.flat[index]))
        affine = motion @ (vectors[:, 0] + arms.flat[index] * vectors[:, 1])
        assert_close(affine, _approach(drawing, motion, point), rtol=1e-11, atol=1e-14)


@every_drawing
def test_arm_is_distance_along_the_contact_line(drawing):
    """Two cells of one line are as far apart in space as in their arms."""
    pair = drawing.pair()
    grid = jg.mesh_grid(pair, phases=8, slices=6)
    cells = jg.mesh_cells(pair, grid, jg.ConstantStiffness(1e10), jnp.asarray(1e5))
    rolls, places = np.asarray(cells.lines.roll), np.asarray(cells.lines.face_position)
    arms = np.asarray(cells.arm).reshape(rolls.shape)
    first, last = (_point(drawing, rolls[3, 1, i], places[i]) for i in (0, -1))
    apart = arms[3, 1, -1] - arms[3, 1, 0]
    assert_close(apart, np.linalg.norm(last - first), rtol=1e-12, atol=0.0)


@every_drawing
def test_rigid_kinematics_neither_close_nor_open_the_gap(drawing):
    vectors = jg.structure_vectors(drawing.pair())
    first, second = drawing.base_radius
    motion = jnp.zeros(12).at[5].set(1.0).at[11].set(-first / second)
    assert_close(motion @ vectors, jnp.zeros(2), rtol=0.0, atol=1e-16)


@every_drawing
def test_moving_both_bodies_together_neither_closes_nor_opens_the_gap(drawing):
    """Three translations, and three rotations of the whole about the pinion's centre."""
    vectors = np.asarray(jg.structure_vectors(drawing.pair()))
    arm = np.array([drawing.centre_distance, 0.0, 0.0])
    for axis in np.eye(3):
        shift = np.concatenate([axis, np.zeros(3), axis, np.zeros(3)])
        turn = np.concatenate([np.zeros(3), axis, np.cross(axis, arm), axis])
        assert_close(shift @ vectors, np.zeros(2), rtol=0.0, atol=1e-16)
        assert_close(turn @ vectors, np.zeros(2), rtol=0.0, atol=1e-16)


@every_drawing
def test_positive_rotations_of_either_body_close_the_gap(drawing):
    """Moments about the axes are +r_b cos(beta_b), and do not tilt."""
    vectors = jg.structure_vectors(drawing.pair())
    expected = jnp.asarray(drawing.base_radius) * math.cos(drawing.base_helix)
    assert_close(vectors[jnp.asarray([5, 11]), 0], expected, rtol=1e-13, atol=0.0)
    assert_close(vectors[jnp.asarray([5, 11]), 1], jnp.zeros(2), rtol=0.0, atol=1e-17)


def test_hand_of_the_helix_by_hand():
    """A right-hand pinion that drives is pushed towards -Z: its flank's normal leans to -Z."""
    vectors = jg.structure_vectors(FZG_H501.pair())
    # sin(beta_b) = sin 15 deg cos 20 deg
    assert_close(vectors[2, 0], -0.2432103, rtol=1e-6, atol=0.0)
    assert_close(vectors[8, 0], 0.2432103, rtol=1e-6, atol=0.0)


def test_translations_carry_the_unit_normal():
    for drawing in (ACCESSORY, POWER, LEFT_HAND):
        vectors = jg.structure_vectors(drawing.pair())
        _, normal, _ = _axes(drawing)
        assert_close(vectors[:3, 0], normal, rtol=1e-12, atol=1e-17)
        assert_close(jnp.linalg.norm(vectors[6:9, 0]), 1.0, rtol=1e-14, atol=0.0)


def test_structure_vectors_are_differentiable():
    def weighted(pair: jg.GearPair) -> jnp.ndarray:
        weights = jnp.asarray(np.random.default_rng(2).normal(size=(12, 2)))
        return jnp.sum(weights * jg.structure_vectors(pair))

    pair = jg.GearPair(
        jg.Gear(20, 0.023, 0.1809), jg.Gear(30, 0.023, 0.0891), 3.5e-3, 0.35, 0.26, 0.0916
    )
    scale = jg.GearPair(
        jg.Gear(20, 0.023, 0.1809, tip_shortening=0.01),
        jg.Gear(30, 0.023, 0.0891, tip_shortening=0.01),
        3.5e-3,
        0.35,
        0.26,
        0.0916,
    )
    assert_gradient(weighted, pair, rtol=1e-7, scale=scale)
