import functools
import math
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    exchanged,
    fzg_c14,
    helical_25_31,
    high_contact_ratio,
    iso_tr_6336_30,
    lengths_scaled,
    mirrored,
    over,
    power,
    sizes,
    standard_17_43,
    torque_for,
)
from helpers import assert_close, assert_gradient

import jaxgear as jg
from jaxgear import N_per_mm_um, mm, um
from jaxgear._contact._cells import at_line_loads, flank_coordinates

_WEBER = jg.WeberBanaschek(face_coupling=None)
_CONSTANT = jg.ConstantStiffness(14.0 * N_per_mm_um)
_LOAD = jnp.asarray(200e3)
_STRAIGHT = jg.Misalignment()


class _Parabola(jg.AbstractCompliance):
    """A law that varies along the path, and compiles in no time."""

    load_updates: ClassVar[int] = 0  # ty: ignore[incompatible-attribute-override]

    def bodies(self, pair: jg.GearPair, neighbours: int) -> tuple[jg.SharedBody, ...]:
        del pair, neighbours
        return ()

    def log_slope(self, pair: jg.GearPair) -> jax.Array:
        return jnp.zeros_like(pair.normal_module)

    def local(self, pair: jg.GearPair, roll: jax.Array, line_load: jax.Array) -> jax.Array:
        place = (roll - pair.path_start) / pair.path_of_contact
        softer = 1.0 + 0.4 * (2.0 * place - 1.0) ** 2
        moduli = 1.0 / pair.pinion.material.young + 1.0 / pair.wheel.material.young
        return softer * moduli * (line_load * moduli / pair.normal_module) ** -0.1


_PARABOLA = _Parabola()


def _grid(pair: jg.GearPair) -> jg.MeshGrid:
    return jg.mesh_grid(pair, phases=16, slices=5)


@functools.cache
def _cells(make) -> jg.MeshCells:
    """Of constant stiffness on the grid of all tests, in NumPy: arithmetic compiles nothing."""
    pair = make()
    return jax.tree.map(np.asarray, jg.mesh_cells(pair, _grid(pair), _CONSTANT, _LOAD))


@eqx.filter_jit
def _mesh_gap(pair, grid, flanks, misalignment):
    return jg.mesh_gap(pair, jg.contact_lines(pair, grid), flanks, misalignment)


def _gap(pair, flanks=None, misalignment=_STRAIGHT) -> np.ndarray:
    """Gap of each phase, line and slice [um]."""
    grid = _grid(pair)
    gap = _mesh_gap(pair, grid, flanks or jg.Flanks(), misalignment)
    return np.asarray(gap).reshape(grid.phases, grid.lines, grid.slices) / um


# --- stiffness


def test_nominal_line_load_by_hand():
    """80 N m on 30.587888 x 9.5 mm."""
    expected = 80.0 / 30.587888e-3 / 9.5e-3
    assert_close(
        jg.nominal_line_load(accessory(), jnp.asarray(80.0)), expected, rtol=1e-7, atol=0.0
    )


@over(power, accessory)
def test_nominal_line_load_carries_the_torque(make):
    """On one line across the face: normal force F' b/cos(beta_b), transverse F' b, at r_b."""
    pair = make()
    load = jg.nominal_line_load(pair, jnp.asarray(310.0))
    normal = load * pair.face_width / jnp.cos(pair.base_helix_angle)
    torque = normal * jnp.cos(pair.base_helix_angle) * pair.base_radius[0]
    assert_close(torque, 310.0, rtol=1e-13, atol=0.0)
    assert_close(torque_for(pair, float(load)), 310.0, rtol=1e-13, atol=0.0)


def _interpolates(make):
    """Everywhere within 5e-4, and within 2e-5 where no load crosses near a root chord."""
    pair = make()
    cells = eqx.filter_jit(jg.mesh_cells)(pair, _grid(pair), _WEBER, _LOAD)
    place = (cells.lines.roll - pair.path_start) / pair.path_of_contact
    roll = pair.path_start + jnp.clip(place, 0.0, 1.0).ravel() * pair.path_of_contact
    direct = 1.0 / eqx.filter_jit(_WEBER.local)(pair, roll, _LOAD)
    off = np.abs(np.asarray(cells.line_stiffness.ravel() / direct) - 1.0)
    assert off.max() < 5e-4
    middle = np.abs(np.asarray(place).ravel() - 0.5) < 0.3
    assert middle.any()
    assert off[middle].max() < 2e-5


@pytest.mark.slow
@over(power, slow=(accessory,))
def test_interpolated_stiffness_against_the_law_itself(make):
    _interpolates(make)


@pytest.mark.slow
@over(helical_25_31, iso_tr_6336_30, high_contact_ratio, standard_17_43)
def test_interpolated_stiffness_of_other_pairs(make):
    _interpolates(make)


def test_constant_stiffness_is_interpolated_exactly():
    found = _cells(power).line_stiffness
    assert_close(found, np.full_like(found, 14e9), rtol=1e-12, atol=0.0)


@over(power, accessory)
def test_mean_stiffness_with_constant_law(make):
    """k' times the mean length of the lines, eps_alpha b/cos(beta_b)."""
    pair = make()
    cells = _cells(make)
    mean = np.sum(cells.lines.weight * np.sum(cells.stiffness, axis=1))
    length = jg.profile_contact_ratio(pair) * pair.face_width / jnp.cos(pair.base_helix_angle)
    assert_close(mean, 14e9 * length, rtol=1e-10, atol=0.0)


@over(power, accessory)
def test_cells_are_lines_times_slices(make):
    cells = _cells(make)
    expected = cells.line_stiffness * cells.lines.fraction * cells.lines.length
    assert_close(cells.stiffness, expected.reshape(16, -1), rtol=1e-14, atol=0.0)


@over(power, helical_25_31)
def test_arm_by_plane_vectors(make):
    """Place along the line through the cell, from the foot of the pitch point at mid-face."""
    pair = make()
    grid = _grid(pair)
    cells = _cells(make)
    beta = float(pair.base_helix_angle)
    line = np.asarray([math.sin(beta), math.cos(beta)])
    x = np.asarray(cells.lines.roll - pair.pitch_point)
    z = np.broadcast_to(np.asarray(cells.lines.face_position, dtype=float), x.shape)
    expected = np.stack([x, z], axis=-1) @ line
    assert_close(cells.arm, expected.reshape(16, -1), rtol=1e-12, atol=1e-16)
    # The cells of one line lie their own length apart.
    apart = np.diff(cells.arm.reshape(16, grid.lines, grid.slices), axis=2)
    assert_close(apart, np.full_like(apart, cells.lines.length), rtol=1e-10, atol=0.0)


def test_contact_hardens_with_its_line_load_by_hand():
    """A tenth of the nominal load: 2 (1 - nu^2)/(pi E) ln 10 more; below a hundredth no more."""
    pair, cells, nominal = accessory(), _cells(accessory), 275e3
    share = np.full(cells.lines.roll.shape, 0.1)
    share[:, :, 1], share[:, :, 2] = 1e-7, 0.0
    force = share * cells.lines.fraction * cells.lines.length * nominal
    slope = _WEBER.log_slope(pair)
    force = jnp.asarray(force.reshape(cells.stiffness.shape))
    loaded = jax.jit(at_line_loads)(cells, force, jnp.asarray(nominal), slope)
    rise = 1.0 / np.asarray(loaded.line_stiffness) - 1.0 / cells.line_stiffness
    young, poisson = 206e9, 0.3
    assert float(pair.pinion.material.young) == young
    per_e_fold = 2.0 * (1.0 - poisson**2) / (math.pi * young)
    expected = per_e_fold * math.log(10.0) * np.array([1.0, 2.0, 2.0, 1.0, 1.0])
    in_mesh = cells.lines.fraction[:, :, 0] > 0.1
    assert_close(rise[in_mesh], np.tile(expected, (int(in_mesh.sum()), 1)), rtol=1e-9, atol=0.0)


# --- gap


def _one_sided(owner: str, deviation: jg.AbstractFlankDeviation) -> jg.Flanks:
    return jg.Flanks(pinion=deviation) if owner == "pinion" else jg.Flanks(wheel=deviation)


@over(power, accessory)
def test_nominal_flanks_touch_everywhere(make):
    assert np.abs(_gap(make())).max() == 0.0


@pytest.mark.parametrize("owner", ["pinion", "wheel"])
@pytest.mark.parametrize("make", [power, accessory])
def test_material_removed_opens_the_gap(make, owner):
    gap = _gap(make(), _one_sided(owner, jg.Crowning(7 * um)))
    assert gap.min() >= 0.0
    assert gap.max() > 1.0


@over(power, accessory)
def test_tip_relief_acts_where_its_owner_has_its_tip(make):
    """The pinion's tip leaves at the end of the path, the wheel's tip enters at its start."""
    pair = make()
    place = np.asarray(jg.contact_lines(pair, _grid(pair)).roll - pair.path_start)
    place = place / float(pair.path_of_contact)
    relief = jg.TipRelief(20 * um, 0.3)
    expected = 20.0 * np.maximum(1.0 - (1.0 - place) / 0.3, 0.0)
    np.testing.assert_allclose(_gap(pair, jg.Flanks(pinion=relief)), expected, atol=1e-9)
    expected = 20.0 * np.maximum(1.0 - place / 0.3, 0.0)
    np.testing.assert_allclose(_gap(pair, jg.Flanks(wheel=relief)), expected, atol=1e-9)
    # Root relief of the one meets the tip of the other.
    root = jg.RootRelief(20 * um, 0.3)
    np.testing.assert_allclose(_gap(pair, jg.Flanks(pinion=root)), expected, atol=1e-9)


@over(power, slow=(accessory,))
def test_tip_corners_touch_above_the_start_of_active_profile(make):
    """Beyond the path: the corner at its own tip, the mate's place above 0 and growing."""
    pair = make()
    grid = jg.mesh_grid(pair, phases=16, slices=5, beyond=0.25)

    @eqx.filter_jit
    def both(pair):
        lines = jg.contact_lines(pair, grid)
        (pinion, _), (wheel, _) = flank_coordinates(pair, lines)
        relieved = jg.Flanks(wheel=jg.RootRelief(20 * um, 0.2))
        gaps = [jg.mesh_gap(pair, lines, x, _STRAIGHT) for x in (jg.Flanks(), relieved)]
        linear = (lines.roll - pair.path_start) / pair.path_of_contact
        return linear, pinion, wheel, (gaps[1] - gaps[0]).reshape(linear.shape), lines.fraction

    linear, pinion, wheel, relief, fraction = (np.asarray(x) for x in both(pair))
    on_path = (linear >= 0.0) & (linear <= 1.0)
    np.testing.assert_allclose(pinion[on_path], linear[on_path], atol=1e-12)
    np.testing.assert_allclose(wheel[on_path], 1.0 - linear[on_path], atol=1e-12)
    window = fraction > 0.0
    for own, mate, past in ((pinion, wheel, linear - 1.0), (wheel, pinion, -linear)):
        corner = window & (past > 0.0)
        assert corner.any()
        assert np.all(own[corner] == 1.0)
        order = np.argsort(past[corner])
        assert np.all(mate[corner] > 0.0)
        assert np.all(np.diff(mate[corner][order]) >= 0.0)
    # The wheel's root relief is largest at its start of active profile, so nowhere deeper.
    depth = 20 * um * np.maximum(1.0 - wheel / 0.2, 0.0)
    np.testing.assert_allclose(relief[window], depth[window], atol=1e-9 * um)
    assert relief[window].max() < 20 * um


def test_gaps_of_both_gears_add():
    pair = power()
    first, second = jg.TipRelief(20 * um, 0.3), jg.HelixSlope(5 * um)
    both = _gap(pair, jg.Flanks(first, second))
    apart = _gap(pair, jg.Flanks(pinion=first)) + _gap(pair, jg.Flanks(wheel=second))
    np.testing.assert_allclose(both, apart, atol=1e-12)


def test_each_gear_counts_its_own_face():
    """Accessory: the pinion's face is 11.5 mm wide, of which the wheel's 9.5 mm are in mesh."""
    pair = accessory()
    z = np.asarray(jg.contact_lines(pair, _grid(pair)).face_position) / mm
    assert abs(z[-1] - 0.4 * 9.5) < 1e-9
    for owner, width in (("pinion", 11.5), ("wheel", 9.5)):
        gap = _gap(pair, _one_sided(owner, jg.Crowning(8 * um)))[0, 0]
        np.testing.assert_allclose(gap, 8.0 * (2.0 * z / width) ** 2, atol=1e-9)
        # Material added at the right closes there, whichever gear has it.
        slope = _gap(pair, _one_sided(owner, jg.HelixSlope(8 * um)))[0, 0]
        np.testing.assert_allclose(slope, -8.0 * z / width, atol=1e-9)


@over(power, accessory, slow=(helical_25_31,))
@pytest.mark.parametrize(("inclination", "deviation"), [(10.0, 0.0), (0.0, 10.0), (4.0, -7.0)])
def test_misalignment_by_moving_the_wheel(make, inclination, deviation):
    """The wheel's slice at z goes by (i, d) z/b along S and T: a gap along the flank's normal."""
    pair = make()
    alpha, beta = float(pair.working_pressure_angle), float(pair.base_helix_angle)
    # The pinion's outward normal: cos(beta_b) along the path, which rises from S by 90 - alpha.
    normal = math.cos(beta) * np.asarray([math.sin(alpha), math.cos(alpha)])
    lines = jg.contact_lines(pair, _grid(pair))
    z = np.asarray(lines.face_position / pair.face_width)
    expected = z * (normal @ np.asarray([inclination, deviation]))
    gap = _gap(pair, misalignment=jg.Misalignment(inclination * um, deviation * um))
    np.testing.assert_allclose(gap, np.broadcast_to(expected, gap.shape), atol=1e-9)
    # Seen at the right end: half of the shift between both ends.
    if inclination >= 0.0 and deviation >= 0.0:
        assert gap[0, 0, -1] > 0.0 > gap[0, 0, 0]


def test_misalignment_is_worth_a_helix_slope():
    """10 um of deviation are undone by 10 cos(alpha_wt) um added to the wheel's right end."""
    pair = accessory()
    amount = 10 * um * math.cos(float(pair.working_pressure_angle))
    gap = _gap(pair, jg.Flanks(wheel=jg.HelixSlope(amount)), jg.Misalignment(0.0, 10 * um))
    assert np.abs(gap).max() < 1e-9


# --- scaling, symmetry


@over(helical_25_31, slow=(fzg_c14,))
def test_cells_scale(make):
    """Lengths x 37 at equal stress: stiffness x 37, arms x 37."""
    pair = make()
    grid = _grid(pair)
    one = jg.mesh_cells(pair, grid, _PARABOLA, _LOAD)
    other = jg.mesh_cells(lengths_scaled(pair, by=37.0), grid, _PARABOLA, 37.0 * _LOAD)
    assert_close(other.stiffness, 37.0 * one.stiffness, rtol=1e-7, atol=1.0)
    assert_close(other.arm, 37.0 * one.arm, rtol=1e-10, atol=1e-13)


def test_mirror_square_to_the_axes():
    pair = helical_25_31()
    grid = _grid(pair)
    one, other = (jg.mesh_cells(p, grid, _PARABOLA, _LOAD) for p in (pair, mirrored(pair)))
    shape = (16, grid.lines, grid.slices)
    flipped = one.stiffness.reshape(shape)[:, :, ::-1]
    assert_close(other.stiffness.reshape(shape), flipped, rtol=1e-9, atol=1e-3)
    assert_close(
        other.arm.reshape(shape), -one.arm.reshape(shape)[:, :, ::-1], rtol=1e-9, atol=1e-12
    )


def test_gears_may_change_places():
    """The total stiffness over the period, run backwards."""
    pair = helical_25_31()
    grid = _grid(pair)
    one, other = (
        np.sum(jg.mesh_cells(p, _grid(p), _PARABOLA, _LOAD).stiffness, axis=1)
        for p in (pair, exchanged(pair))
    )
    split = grid.entry_phases
    backwards = np.concatenate([one[:split][::-1], one[split:][::-1]])
    assert_close(other, backwards, rtol=1e-7, atol=0.0)
    assert np.max(one) / np.min(one) > 1.02


# --- gradients


@pytest.mark.parametrize(
    ("make", "law"),
    [
        pytest.param(helical_25_31, _PARABOLA, id="helical"),
        pytest.param(accessory, _PARABOLA, id="spur", marks=pytest.mark.slow),
        pytest.param(helical_25_31, _WEBER, id="weber", marks=pytest.mark.slow),
    ],
)
def test_gradients(make, law):
    """Stiffness and arms by every number of the pair, each cell counted differently."""
    pair = make()
    grid = jg.mesh_grid(pair, phases=8, slices=3)
    draw = np.random.default_rng(7)
    factors = jnp.asarray(draw.uniform(0.5, 1.5, (2, 8, grid.cells)))

    def mixed(argument):
        own, load = argument
        # A spur pair stays one: its cells have a kink where the helix begins.
        helix = own.helix_angle if make is helical_25_31 else pair.helix_angle
        own = eqx.tree_at(lambda p: p.helix_angle, own, helix)
        cells = jg.mesh_cells(own, grid, law, load)
        total = jnp.sum(factors[0] * cells.stiffness) / 1e8
        return total + jnp.sum(factors[1] * cells.arm * cells.stiffness) / 1e6

    argument = pair, _LOAD
    assert_gradient(mixed, argument, rtol=1e-4, step=1e-6, scale=sizes(argument))


@pytest.mark.slow
def test_gradients_of_the_gap():
    pair = helical_25_31()
    grid = jg.mesh_grid(pair, phases=8, slices=3)
    flanks = jg.Flanks(
        jg.Superposed((jg.TipRelief(20 * um, 0.37), jg.Crowning(4 * um))),
        jg.Superposed((jg.TipRelief(15 * um, 0.31, 2), jg.HelixSlope(3 * um))),
    )
    factors = jnp.asarray(np.random.default_rng(8).uniform(0.5, 1.5, (8, grid.cells)))

    def mixed(argument):
        own, corrections, misalignment = argument
        gap = jg.mesh_gap(own, jg.contact_lines(own, grid), corrections, misalignment)
        return jnp.sum(factors * gap) / um

    argument = pair, flanks, jg.Misalignment(3 * um, -5 * um)
    assert_gradient(mixed, argument, rtol=1e-5, step=1e-6, scale=sizes(argument))


def test_gradient_at_nominal_flanks():
    """No maximum hides in the gap: one micron of relief counts the same from the first on."""
    pair = power()
    lines = jg.contact_lines(pair, _grid(pair))

    def total(depth: jax.Array) -> jax.Array:
        flanks = jg.Flanks(jg.TipRelief(depth, 0.3), jg.TipRelief(depth, 0.3))
        return jnp.sum(jg.mesh_gap(pair, lines, flanks, _STRAIGHT))

    slope = jax.jit(jax.grad(total))
    at_zero, later = (slope(jnp.asarray(depth)) for depth in (0.0, 20 * um))
    assert float(later) > 1.0
    assert_close(at_zero, later, rtol=1e-13, atol=0.0)


@pytest.mark.slow
def test_one_trace():
    pair = power()
    grid = _grid(pair)

    def found(pair: jg.GearPair, load: jax.Array):
        return jg.mesh_cells(pair, grid, _PARABOLA, load)

    cells = eqx.filter_jit(eqx.debug.assert_max_traces(found, max_traces=1))
    for load in (1e5, 2e5):
        cells(pair, jnp.asarray(load))
