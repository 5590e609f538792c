"""Shapes of condensed bodies that the mesh excites: what they keep of natural modes, and gain."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import hybrid_cases
import numpy as np
import pytest
import scipy.linalg
from fem_cases import assert_near
from helpers import quick
from hybrid_cases import PAIRS
from scipy.spatial import KDTree

import jaxgear as jg
from fem_prep import ReducedBody
from jaxgear._dynamics._bodies import VibratingBody, turning_terms
from jaxgear._geometry._lines import contact_lines
from jaxgear._system._body_in_mesh import BodyInMesh
from jaxgear._system._body_modes import BodyBasis, BodyModes, body_basis
from jaxgear._system._body_tables import body_in_mesh, flexible_body
from jaxgear._system._excited_shapes import CANDIDATES, excited_shapes, natural_among
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import line_loads, mode_arms
from jaxgear._system._mode_combinations import Combinations
from jaxgear._system._residual_shapes import Residual
from jaxgear._system._scaled_body import scaled_body

# Of the holes' body several nodal diameters share a wave number.
BODIES = {"rotating": {"modes": 8, "rotating": True}, "plain": {}, "holes": {"holes": 6}}
every_body = pytest.mark.parametrize("name", quick(1, BODIES))
COUNT = 40


def _sectors(body: ReducedBody) -> int:
    sectors = body.facts["sectors"]
    assert isinstance(sectors, int)
    return sectors


@functools.cache
def _case(name: str, kind: str = "spur"):
    """A body, its pair and grid, 160 natural modes, and the shapes in their place."""
    body, pair = hybrid_cases.body(kind, 1, **BODIES[name]), PAIRS[kind]()
    grid = jg.mesh_grid(pair, phases=16, slices=4)
    basis, _ = body_basis(body, 4 * COUNT).under_teeth(pair.wheel.teeth, _sectors(body))
    found = excited_shapes(basis, _in_mesh(name, kind), pair, 1, grid, COUNT)
    assert found is not None
    return body, pair, grid, basis, found.of_basis(basis)


@functools.cache
def _in_mesh(name: str, kind: str = "spur") -> BodyInMesh:
    body, pair = hybrid_cases.body(kind, 1, **BODIES[name]), PAIRS[kind]()
    grid = jg.mesh_grid(pair, phases=16, slices=4)
    repeats = body_basis(body, 4 * COUNT).repeats(pair.wheel.teeth, _sectors(body))
    return body_in_mesh(body, pair, 1, grid, repeats)


@every_body
def test_shapes_are_of_unit_mass_and_apart_in_stiffness(name):
    body, _, _, _, shapes = _case(name)
    assert COUNT - 1 <= len(shapes.square) <= COUNT
    onto = lambda matrix: shapes.shapes.T @ matrix @ shapes.shapes
    assert_near(onto(body.mass), np.eye(len(shapes.square)), 1e-8)
    root = np.sqrt(shapes.square)
    assert_near(onto(body.stiffness) / root / root[:, None], np.eye(len(root)), 1e-6)


def test_a_quarter_of_the_shapes_are_natural_modes_and_no_pair_is_parted():
    *_, basis, shapes = _case("plain")
    count = natural_among(COUNT, basis.waves)
    assert count in (COUNT // 4, COUNT // 4 - 1)
    assert basis.waves[count] >= 0
    assert_near(shapes.square[:count], basis.square[:count], 1e-12)
    assert np.all(shapes.square[count:] > shapes.square[count - 1])


@every_body
def test_shapes_turn_with_the_body_as_natural_modes_do(name):
    body, _, _, basis, shapes = _case(name)
    angle = 2.0 * np.pi / _sectors(body)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    image = np.asarray(KDTree(body.rim_nodes).query(body.rim_nodes @ turn.T)[1])

    def uneven(found: BodyBasis) -> float:
        on_rim = found.shapes[: 3 * len(image)].reshape(len(image), 3, -1)
        turned = np.empty_like(on_rim)
        turned[image] = turn @ on_rim
        seats = found.following.shape[1]
        wanted = on_rim @ scipy.linalg.expm(angle * found.turning[seats:, seats:])
        # Of modes without a partner neighbouring sectors move against each other.
        wanted[..., 2 * found.waves == _sectors(body)] *= -1.0
        return float(np.abs(turned - wanted).max() / np.abs(on_rim).max())

    assert uneven(basis) < 1e-6
    assert uneven(shapes) < 1e-6


@every_body
def test_shapes_are_no_softer_than_as_many_natural_modes_of_their_wave(name):
    _, _, _, basis, shapes = _case(name)
    lowest = np.sum(shapes.square <= basis.square[COUNT // 4 - 3] * (1.0 + 1e-9))
    np.testing.assert_allclose(shapes.square[:lowest], basis.square[:lowest], rtol=1e-12)
    for wave in set(shapes.waves):
        own = shapes.square[shapes.waves == wave]
        natural = basis.square[basis.waves == wave][: len(own)]
        assert np.all(own >= natural * (1.0 - 1e-9))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plain", "rotating"])
def test_flanks_move_closer_to_all_modes_than_by_as_many_natural_ones(name):
    body, pair, grid, basis, shapes = _case(name)
    lines = contact_lines(pair, grid)
    fraction = np.asarray(lines.fraction)
    frequencies = np.linspace(0.02, 0.7, 200) * np.sqrt(basis.square[-1])

    def moved(found: BodyBasis) -> np.ndarray:
        """Dynamic part of what even loads along lines move at their own place, `[f, line]`."""
        flexible = flexible_body(body, pair, 1, grid, basis=found)
        arms = np.asarray(mode_arms(pair, 1, flexible, lines)).reshape(*fraction.shape, -1)
        even = np.einsum("plsm,pls->plm", arms, fraction).reshape(-1, arms.shape[-1])
        root = np.sqrt(found.square)
        answer = 1.0 / (root**2 + 0.04j * root * frequencies[:, None] - frequencies[:, None] ** 2)
        return (answer - 1.0 / root**2) @ (even**2).T

    def off(found: BodyBasis) -> float:
        exact = moved(basis)
        return float(np.linalg.norm(moved(found) - exact) / np.linalg.norm(exact))

    natural = body_basis(body, COUNT)
    assert off(shapes) < 0.75 * off(natural)


def test_a_basis_with_no_more_modes_stays_what_it_is():
    _, pair, grid, basis, _ = _case("plain")
    for count in (0, len(basis.square), 1000):
        assert excited_shapes(basis, _in_mesh("plain"), pair, 1, grid, count) is None


@every_body
def test_loads_on_modes_are_arms_of_the_cells_under_loads_along_lines(name):
    body, pair, grid, basis, _ = _case(name)
    lines = contact_lines(pair, grid)
    arms = mode_arms(pair, 1, flexible_body(body, pair, 1, grid, basis=basis), lines)
    wanted = np.einsum("plc,pcn->pln", line_loads(lines), arms).reshape(-1, len(basis.square))
    assert_near(_in_mesh(name).loads(pair, 1, lines, basis), wanted, 1e-12)


# --- Residual shapes


class _Combined(NamedTuple):
    """A body on all its modes and on shapes with residual ones, and these by its modes."""

    flexible: FlexibleBody
    combined: FlexibleBody
    found: Combinations
    residual: Residual
    every: np.ndarray


@functools.cache
def _combined(name: str) -> _Combined:
    body, pair, grid, basis, _ = _case(name)
    flexible = flexible_body(body, pair, 1, grid, basis=basis)
    found = excited_shapes(basis, _in_mesh(name), pair, 1, grid, COUNT)
    assert found is not None
    assert found.residual is not None
    every = np.concatenate([found.into, found.residual.into], axis=1)
    combined = found.of_body(_in_mesh(name), basis).flexible
    return _Combined(flexible, combined, found, found.residual, every)


def _modes(body: FlexibleBody) -> BodyModes:
    assert body.modes is not None
    return body.modes


@every_body
def test_residual_shapes_are_of_unit_mass_and_apart_in_stiffness(name):
    _, _, found, residual, every = _combined(name)
    basis = _case(name)[3]
    assert len(residual.square) == 12
    assert_near(residual.into.T @ residual.into, np.eye(12), 1e-9)
    square = np.r_[found.square, residual.square]
    stiffness = every.T @ (basis.square[:, None] * every)
    root = np.sqrt(square)
    assert_near(stiffness / root / root[:, None], np.eye(len(root)), 1e-8)
    assert np.all(residual.into[basis.diameters < 2] == 0.0)


def test_four_more_residual_shapes_are_of_the_modes_beyond_those_that_shapes_are_made_of():
    """Apart from the others, and what the rest of those modes give at rest is little."""
    body, pair, grid, _, _ = _case("plain")
    basis, _ = body_basis(body, 0).under_teeth(pair.wheel.teeth, _sectors(body))
    found = excited_shapes(basis, _in_mesh("plain"), pair, 1, grid, 12)
    assert found is not None
    assert found.residual is not None
    into, end = found.residual.into, 12 * CANDIDATES
    assert into.shape[1] == 12 + 4
    assert np.all(into[end:, :12] == 0.0)
    assert np.all(into[: end - 1, 12:] == 0.0)
    assert_near(into.T @ into, np.eye(16), 1e-9)
    assert_near(into.T @ (basis.square[:, None] * into), np.diag(found.residual.square), 1e-9)
    loads = _in_mesh("plain").loads(pair, 1, contact_lines(pair, grid), basis)[:, end:]
    turns = (basis.diameters[end:] >= 2) & (np.abs(basis.waves[end:]) >= 2)
    own, square = into[end:, 12:], basis.square[end:]
    whole = np.sum((loads * turns) ** 2 / square)
    kept = np.sum((loads @ own) ** 2 / found.residual.square[12:])
    assert 0.9 * whole < kept < whole


@every_body
def test_residual_shapes_move_flanks_as_the_modes_do_that_they_are_made_of(name):
    flexible, combined, _, _, every = _combined(name)
    _, pair, grid, _, _ = _case(name)
    lines = contact_lines(pair, grid)
    modes, shapes = (np.asarray(mode_arms(pair, 1, x, lines)) for x in (flexible, combined))
    assert_near(shapes, modes @ every, 1e-9)


@every_body
def test_flanks_give_at_rest_all_that_they_give_by_all_modes_but_a_thousandth(name):
    """Of the part with two and more nodal diameters, which twelve answers in space span."""
    flexible, combined, found, _, _ = _combined(name)
    _, pair, grid, basis, _ = _case(name)
    lines = contact_lines(pair, grid)
    turns = (basis.diameters >= 2) & (np.abs(basis.waves) >= 2)
    shapes = (found.diameters >= 2) & (np.abs(found.waves) >= 2)
    own = np.r_[shapes, np.ones(12, dtype=bool)]
    load = np.asarray(lines.fraction).reshape(len(lines.phase), -1)

    def give(body, which: np.ndarray) -> np.ndarray:
        arms = np.asarray(mode_arms(pair, 1, body, lines))[:, :, which]
        square = np.asarray(_modes(body).square)[which]
        moved = np.einsum("pcm,pc->pm", arms, load)
        return np.sum(moved**2 / square, axis=1)

    whole, kept = give(flexible, turns), give(combined, own)
    without = give(combined, np.r_[shapes, np.zeros(12, dtype=bool)])
    assert np.all(np.abs(kept / whole - 1.0) < 1e-3)
    assert np.all(without / whole < 0.97)


@pytest.mark.parametrize(
    ("name", "whole"),
    quick(2, [("plain", False), ("rotating", True), ("rotating", False), ("holes", False)]),
)
def test_a_turning_body_with_residual_shapes_is_all_its_modes_projected(name, whole):
    """What turns is no combination of the shapes; its inertia must be there all the same."""
    flexible, combined, _, residual, every = _combined(name)
    seats = _modes(flexible).seat_dofs

    @eqx.filter_jit
    def terms(body: FlexibleBody):
        own = VibratingBody(1, body, _modes(body), np.arange(seats), seats, -0.4)
        return turning_terms([own], _modes(body).size, jg.ModalDamping(), whole=whole)

    onto = scipy.linalg.block_diag(np.eye(seats), every)
    alone, projected = terms(combined), terms(flexible)
    for field in ("gyroscopic", "softening"):
        wanted = onto.T @ np.asarray(getattr(projected, field)) @ onto
        assert_near(getattr(alone, field), wanted, 1e-8)
    count = len(residual.square)
    assert np.all(np.asarray(alone.circulatory)[-count:] == 0.0)


def test_another_material_of_a_body_with_residual_shapes():
    """As if it had been condensed of that material."""
    _, combined, found, residual, _ = _combined("rotating")
    young, density = 1.3, 0.8
    got = _modes(scaled_body(combined, young=young, density=density))
    body, _, _, basis, _ = _case("rotating")
    by_mass = ("mass", "coriolis", "spin_softening", "stress_stiffening", "centrifugal_load")
    scaled = {name: density * getattr(body, name) for name in by_mass}
    made = dataclasses.replace(body, stiffness=young * body.stiffness, **scaled)
    # Of unit mass.
    modes = dataclasses.replace(basis, shapes=basis.shapes / np.sqrt(density))
    ratio = young / density
    shapes = found._replace(
        square=ratio * found.square, residual=residual._replace(square=ratio * residual.square)
    )
    in_mesh = dataclasses.replace(_in_mesh("rotating"), condensed=made)
    wanted = _modes(shapes.of_body(in_mesh, modes).flexible)
    for field in ("square", "rows", "load", "mass", "turning", "coriolis", "softening"):
        assert_near(getattr(got, field), getattr(wanted, field), 1e-9)
    assert got.residual is not None
    assert wanted.residual is not None
    assert_near(np.asarray(got.residual.rows), np.asarray(wanted.residual.rows), 1e-9)
