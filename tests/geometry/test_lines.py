import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    every_helical_pair,
    every_pair,
    every_spur_pair,
    exchanged,
    helical_25_31,
    high_contact_ratio,
    lengths_scaled,
    mirrored,
    over,
    power,
    sizes,
)
from helpers import assert_close, assert_gradient, observed_order

import jaxgear as jg
from jaxgear import mm
from jaxgear._geometry._lines import lines_on_steps


def _grid(pair: jg.GearPair, phases: int = 16, slices: int = 5) -> jg.MeshGrid:
    """The same size wherever it does not matter, so that programs are shared."""
    return jg.mesh_grid(pair, phases=phases, slices=slices)


def _lines(pair: jg.GearPair, phases: int = 16, slices: int = 5) -> jg.ContactLines:
    return _found(pair, _grid(pair, phases, slices))


def _found(pair: jg.GearPair, grid: jg.MeshGrid) -> jg.ContactLines:
    """In NumPy, where arithmetic compiles nothing."""
    return jax.tree.map(np.asarray, jg.contact_lines(pair, grid))


def _total_length(lines: jg.ContactLines) -> jax.Array:
    """Length of all contact lines at each phase [m]."""
    return lines.fraction.sum(axis=(1, 2)) * lines.length


def _with_contact_ratio(ratio: float) -> jg.GearPair:
    """30/30 spur teeth of module 3, whose tips are set to give this ratio."""
    alpha = math.radians(20.0)
    roll = 0.5 * ratio * math.pi * 3.0 * math.cos(alpha) + 45.0 * math.sin(alpha)
    addendum = (math.hypot(roll, 45.0 * math.cos(alpha)) - 45.0) / 3.0
    gear = jg.Gear(30, 20.0 * mm, 0.0, addendum, addendum + 0.25, 0.2)
    return jg.GearPair(gear, gear, 3.0 * mm)


# --- the length of the lines


def _line_count(ratio: float, overlap: float, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Lines in contact, as fractions of full ones, averaged between two phases.

    At phase tau a point of the face at height h, in overlaps from mid-face, lies on line i if
    0 <= tau + i + h <= ratio. The third integral of that box over tau and h, by its corners.
    """

    def third(x: np.ndarray) -> np.ndarray:
        return np.maximum(x, 0.0) ** 2 / 2.0

    def second(x: np.ndarray) -> np.ndarray:
        if overlap == 0.0:
            return np.maximum(x, 0.0)
        return (third(x + 0.5 * overlap) - third(x - 0.5 * overlap)) / overlap

    total = np.zeros_like(first)
    for i in range(-3, 8):
        for edge, sign in ((0.0, 1.0), (ratio, -1.0)):
            total += sign * (second(last + i - edge) - second(first + i - edge))
    return total / (last - first)


@pytest.mark.slow
@every_pair
def test_length_against_counting(make):
    """Every phase stands for its step; there the number of lines is integrated by hand."""
    pair = make()
    lines = _lines(pair)
    edges = np.concatenate([[0.0], np.cumsum(lines.weight)])
    expected = _line_count(
        float(jg.profile_contact_ratio(pair)), float(jg.overlap_ratio(pair)), edges[:-1], edges[1:]
    )
    one = pair.face_width / np.cos(pair.base_helix_angle)
    assert_close(_total_length(lines), expected * float(one), rtol=1e-9, atol=0.0)


@every_helical_pair
def test_length_against_its_fourier_series(make):
    """Physics A1.7, with tau counted from the entry of mid-face and each step averaged over."""
    pair = make()
    profile, overlap = float(jg.profile_contact_ratio(pair)), float(jg.overlap_ratio(pair))
    lines = _lines(pair)
    k = np.arange(1, 4001)[:, None]
    tau, step = np.asarray(lines.phase), np.asarray(lines.weight)
    terms = np.sinc(k * profile) * np.sinc(k * overlap) * np.sinc(k * step)
    series = 1.0 + 2.0 * np.sum(terms * np.cos(math.pi * k * (2.0 * tau - profile)), axis=0)
    mean = profile * float(pair.face_width / np.cos(pair.base_helix_angle))
    assert_close(jg.mean_line_length(pair), mean, rtol=1e-13, atol=0.0)
    assert_close(_total_length(lines) / mean, series, rtol=1e-6, atol=0.0)


@every_pair
def test_mean_length_is_exact(make):
    pair = make()
    lines = _lines(pair)
    mean = np.sum(lines.weight * _total_length(lines))
    assert_close(mean, jg.mean_line_length(pair), rtol=1e-10, atol=0.0)


@over(power, accessory)
@pytest.mark.parametrize(("phases", "slices"), [(8, 1), (8, 200)])
def test_mean_length_is_exact_on_any_grid(make, phases, slices):
    pair = make()
    lines = _lines(pair, phases, slices)
    mean = np.sum(lines.weight * _total_length(lines))
    assert_close(mean, jg.mean_line_length(pair), rtol=1e-10, atol=0.0)


@over(power, helical_25_31)
@pytest.mark.parametrize("overlap", [1, 2])
def test_whole_overlaps_keep_the_length_constant(make, overlap):
    pair = make()
    width = overlap * math.pi * pair.normal_module / np.sin(pair.helix_angle)
    pair = eqx.tree_at(lambda p: [p.pinion.face_width, p.wheel.face_width], pair, [width, width])
    assert_close(jg.overlap_ratio(pair), float(overlap), rtol=1e-12, atol=0.0)
    length = _total_length(_lines(pair))
    assert_close(length, np.full(16, jg.mean_line_length(pair)), rtol=1e-11, atol=0.0)


def test_whole_profile_ratios_keep_the_length_constant():
    pair = _with_contact_ratio(2.0)
    length = _total_length(_lines(pair))
    # The rounding of 2 may leave a step of no width in which a line is on its way.
    assert_close(length, np.full(16, 2.0 * 20.0 * mm), rtol=1e-3, atol=0.0)


# --- what is where


@every_pair
def test_fractions_and_weights(make):
    pair = make()
    lines = _lines(pair)
    fraction, phase = np.asarray(lines.fraction), np.asarray(lines.phase)
    assert fraction.min() > -1e-13
    assert fraction.max() < 1.0 + 1e-13
    assert_close(np.sum(lines.weight), 1.0, rtol=1e-14, atol=0.0)
    assert ((phase > 0.0) & (phase < 1.0) & (np.asarray(lines.weight) > 0.0)).all()
    # Each phase is the middle of its step.
    edges = np.concatenate([[0.0], np.cumsum(lines.weight)])
    assert_close(lines.phase, 0.5 * (edges[1:] + edges[:-1]), rtol=1e-12, atol=0.0)
    # Some step ends where the pair ahead leaves contact at mid-face.
    exit_phase = float(jg.profile_contact_ratio(pair)) % 1.0
    assert np.abs(edges - exit_phase).min() < 1e-12
    # Slices fill the face.
    assert_close(
        lines.length * 5 * np.cos(pair.base_helix_angle), pair.face_width, rtol=1e-14, atol=0.0
    )
    assert_close(np.sum(lines.face_position) / mm + 1.0, 1.0, rtol=1e-12, atol=0.0)
    spread = pair.face_width * 4.0 / 5.0
    assert_close(lines.face_position[-1] - lines.face_position[0], spread, rtol=1e-13, atol=0.0)


def test_places_by_hand():
    """A right-hand pinion of 17 degrees: the right end of the face is ahead by z tan(beta_b)."""
    pair = helical_25_31()
    grid = _grid(pair)
    lines = _found(pair, grid)
    middle = lines.roll[:, -grid.first_line, 2]
    pitch = math.pi * 2.0 * mm * math.cos(21.0 * math.pi / 180.0) / math.cos(pair.base_helix_angle)
    assert_close(middle, pair.path_start + lines.phase * pitch, rtol=1e-12, atol=0.0)
    assert_close(
        np.diff(lines.roll, axis=1), np.full((16, grid.lines - 1, 5), pitch), rtol=1e-11, atol=0.0
    )
    slope = (lines.roll[3, 2, 4] - lines.roll[3, 2, 0]) / (0.8 * 18.0 * mm)
    sine = math.sin(math.radians(17.0)) * math.cos(math.radians(21.0))
    assert_close(slope, sine / math.sqrt(1.0 - sine**2), rtol=1e-11, atol=0.0)


@every_spur_pair
def test_spur_slices_are_in_contact_or_not(make):
    pair = make()
    lines = _lines(pair)
    fraction = np.asarray(lines.fraction)
    assert np.abs(fraction * (1.0 - fraction)).max() < 1e-8
    ratio = float(jg.profile_contact_ratio(pair))
    count = np.where(np.asarray(lines.phase) < ratio % 1.0, math.ceil(ratio), math.floor(ratio))
    got = np.sum(lines.fraction, axis=1)
    assert_close(got, np.repeat(count[:, None] * 1.0, 5, axis=1), rtol=1e-8, atol=0.0)
    # Those in contact lie on the path, the others do not.
    place = (np.asarray(lines.roll) - float(pair.path_start)) / float(pair.path_of_contact)
    assert ((fraction > 0.5) == ((place > 0.0) & (place < 1.0))).all()


@over(power, helical_25_31)
@pytest.mark.parametrize("slices", [1, 200])
def test_every_slice_spends_the_contact_ratio_in_contact(make, slices):
    """Averaged over the mesh, each slice of the face sees as many lines as the ratio says."""
    pair = make()
    lines = _lines(pair, phases=8, slices=slices)
    seen = np.einsum("p,pls->s", lines.weight, lines.fraction)
    assert_close(seen, np.full(slices, jg.profile_contact_ratio(pair)), rtol=1e-11, atol=0.0)


@every_helical_pair
def test_middle_of_contact_is_the_middle_of_the_path(make):
    """Weighted by fraction and step the cells are spread evenly from A to E."""
    pair = make()
    lines = _lines(pair)
    share = lines.weight[:, None, None] * lines.fraction
    mean = np.sum(share * lines.roll) / np.sum(share)
    assert_close(mean, 0.5 * (pair.path_start + pair.path_end), rtol=1e-11, atol=0.0)


@pytest.mark.slow
@over(power, slow=(accessory,))
def test_sums_over_the_mesh_converge_like_the_square_of_the_step(make):
    """Mean over one period of the sum of a smooth function of place, against its integral."""
    pair = make()
    start, path = pair.path_start, pair.path_of_contact
    errors = []
    for divisions in (16, 32, 64):
        lines = _lines(pair, phases=divisions, slices=divisions // 2)
        share = lines.weight[:, None, None] * lines.fraction / (divisions // 2)
        total = np.sum(share * np.sin(3.0 * (lines.roll - start) / path))
        exact = (1.0 - math.cos(3.0)) / 3.0 * float(jg.profile_contact_ratio(pair))
        errors.append(abs(float(total) / exact - 1.0))
    order = observed_order([1.0, 0.5, 0.25], errors, bend=0.3)
    assert 1.8 < order < 2.2


# --- the grid


def test_grid_by_hand():
    """Power: 1.397 + 1.059/2 = 1.93 base pitches behind entry at mid-face, 0.53 ahead of it."""
    grid = jg.mesh_grid(power(), phases=64, slices=20)
    assert (grid.first_line, grid.lines, grid.cells) == (-1, 3, 60)
    # 64 x 0.397
    assert grid.entry_phases == 25
    spur = jg.mesh_grid(accessory(), phases=64, slices=2)
    assert (spur.first_line, spur.lines, spur.cells, spur.entry_phases) == (-1, 3, 6, 27)
    assert jg.mesh_grid(accessory(), phases=64, slices=2, margin=0.0).lines == 2


@pytest.mark.parametrize(
    ("sizes_", "message"),
    [
        ({"phases": 7}, r"needs at least 8 phases, got 7\."),
        ({"slices": 0}, r"needs at least 1 slice, got 0\."),
    ],
)
def test_impossible_grids_are_refused(sizes_, message):
    with pytest.raises(ValueError, match=message):
        jg.mesh_grid(accessory(), **sizes_)


@pytest.mark.parametrize("ratio", [1.0 + 1e-6, 1.999999, 2.0 + 1e-6])
def test_contact_ratios_next_to_a_whole_number(ratio):
    pair = _with_contact_ratio(ratio)
    lines = _lines(pair)
    length = _total_length(lines)
    assert_close(np.sum(lines.weight * length), 20.0 * mm * ratio, rtol=1e-10, atol=0.0)
    # Almost all of the time the whole number of lines is in contact.
    whole = np.abs(np.asarray(length) / (20.0 * mm) - round(ratio)) < 1e-9
    assert_close(np.sum(lines.weight[whole]), 1.0 - 1e-6, rtol=1e-8, atol=0.0)


@pytest.mark.slow
def test_gradient_next_to_a_whole_number():
    """The shortest set of phases stretches most: nothing is lost by dividing by its width."""
    pair = _with_contact_ratio(1.0 + 1e-6)
    grid = _grid(pair)

    def mean(p: jg.GearPair) -> jax.Array:
        lines = jg.contact_lines(p, grid)
        return jnp.sum(lines.weight * _total_length(lines))

    got, expected = jax.jit(lambda p: [jax.grad(f)(p) for f in (mean, jg.mean_line_length)])(pair)
    got, expected = (np.stack(jax.tree.leaves(each)) for each in (got, expected))
    assert_close(got, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("margin", "kept"), [(0.05, True), (0.0, False)])
def test_margin_keeps_what_a_growing_contact_ratio_needs(margin, kept):
    """A grid made at 1.97 still serves 2.01, where a third line appears."""
    grid = jg.mesh_grid(_with_contact_ratio(1.97), phases=32, slices=2, margin=margin)
    grown = _with_contact_ratio(2.01)
    lines = _found(grown, grid)
    mean = float(np.sum(lines.weight * _total_length(lines)) / (20.0 * mm))
    assert abs(mean - (2.01 if kept else 2.0)) < 1e-9


# --- scaling, symmetry


@over(power, helical_25_31, slow=(accessory,))
def test_lines_scale(make):
    pair = make()
    grid = _grid(pair)
    assert _grid(lengths_scaled(pair, by=37.0)) == grid
    one, other = (_found(p, grid) for p in (pair, lengths_scaled(pair, by=37.0)))
    assert_close(other.phase, one.phase, rtol=1e-11, atol=0.0)
    assert_close(other.roll, 37.0 * one.roll, rtol=1e-11, atol=1e-14)
    assert_close(other.fraction, one.fraction, rtol=0.0, atol=1e-10)
    assert_close(other.length, 37.0 * one.length, rtol=1e-13, atol=0.0)


@every_helical_pair
def test_mirror_square_to_the_axes(make):
    """The other hand: left and right end of the face change places, nothing else."""
    pair = make()
    one, other = (_lines(p) for p in (pair, mirrored(pair)))
    assert_close(other.phase, one.phase, rtol=1e-14, atol=0.0)
    assert_close(other.roll, one.roll[:, :, ::-1], rtol=1e-12, atol=1e-15)
    assert_close(other.fraction, one.fraction[:, :, ::-1], rtol=0.0, atol=1e-12)
    assert_close(other.length, one.length, rtol=1e-14, atol=0.0)
    # It is not its own mirror image.
    assert float(np.max(np.abs(other.fraction - one.fraction))) > 0.1


@over(helical_25_31, slow=(accessory, power))
def test_film_run_backwards(make):
    """If the gears change places, entry is exit: the same cells in the reverse order of phases."""
    pair = make()
    grid = _grid(pair)
    one = _found(pair, grid)
    other = _found(exchanged(pair), _grid(exchanged(pair)))
    before = np.arange(grid.entry_phases)[::-1]
    order = np.concatenate([before, np.arange(grid.entry_phases, grid.phases)[::-1]])
    for power_ in (0, 1, 2):
        roll = (pair.tangent_length - one.roll) / pair.tangent_length
        expected = np.sum(one.fraction * roll**power_, axis=1)[order]
        own = np.sum(other.fraction * (other.roll / pair.tangent_length) ** power_, axis=1)
        assert_close(own, expected, rtol=1e-9, atol=1e-12)


def test_which_cells_are_kept_is_no_matter_of_rounding():
    """In the middle of double contact both lines are as near to the middle of the path.

    XLA may work a place out twice: were it to round it one way and the other, forces would be of
    other cells than those that were solved for.
    """
    pair = accessory()
    grids = (_grid(pair, phases) for phases in range(16, 24))
    grid = next(grid for grid in grids if grid.entry_phases % 2)
    edges = np.append(0.0, np.cumsum(_found(pair, grid).weight))
    kept_at = eqx.filter_jit(
        lambda x: lines_on_steps(pair, grid, x, x[:-1, None], x[1:, None]).kept
    )
    kept = [np.asarray(kept_at(jnp.asarray(edges + shift))) for shift in (-1e-12, 0.0, 1e-12)]
    assert all(np.array_equal(each, kept[0]) for each in kept)


# --- gradients


@pytest.mark.slow
def test_gradients():
    """A sum in which every phase, line and slice counts differently."""
    pair = helical_25_31()
    grid = jg.mesh_grid(pair, phases=11, slices=5)
    draw = np.random.default_rng(3)
    factors = jnp.asarray(draw.uniform(0.5, 1.5, (11, grid.lines, 5)))

    def mixed(p: jg.GearPair) -> jax.Array:
        lines = jg.contact_lines(p, grid)
        weighed = factors * lines.fraction * (1.0 + lines.roll / p.tangent_length)
        spread = 1.0 + lines.face_position / p.normal_module
        return jnp.einsum("p,pls,s->", lines.weight, weighed, spread) * lines.length

    assert_gradient(mixed, pair, rtol=1e-5, step=1e-6, scale=sizes(pair))


@over(high_contact_ratio, slow=(accessory,))
def test_derivative_of_the_length_of_spur_lines(make):
    """Within a step nothing enters or leaves, so the length at a phase does not move; but the steps
    with one line more grow with the contact ratio."""
    pair = make()
    grid = jg.mesh_grid(pair, phases=16, slices=3)
    direction = jax.tree.map(lambda x: jnp.zeros_like(x), eqx.filter(pair, eqx.is_inexact_array))
    direction = eqx.tree_at(lambda p: p.pinion.addendum, direction, jnp.ones(()))

    def moments(p: jg.GearPair) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
        lines = jg.contact_lines(p, grid)
        length = _total_length(lines) / p.face_width
        mean, square = (jnp.sum(lines.weight * length**n) for n in (1, 2))
        return jg.profile_contact_ratio(p), length, mean, square

    (ratio, _, _, _), (ratio_dot, length_dot, mean_dot, square_dot) = eqx.filter_jit(
        eqx.filter_jvp
    )(moments, (pair,), (direction,))
    assert float(ratio_dot) > 0.1
    assert float(jnp.max(jnp.abs(length_dot))) < 1e-6
    assert_close(mean_dot, ratio_dot, rtol=1e-9, atol=0.0)
    few = math.floor(float(ratio))
    # d/d(ratio) of n^2 + (ratio - n) ((n + 1)^2 - n^2).
    assert_close(square_dot, (2 * few + 1) * ratio_dot, rtol=1e-9, atol=0.0)


@pytest.mark.slow
def test_derivative_by_the_helix_angle_of_a_spur_pair():
    """Tilting brings one end of the face in early and the other late."""
    pair = accessory()
    grid = jg.mesh_grid(pair, phases=16, slices=4)
    factors = jnp.asarray(np.random.default_rng(5).uniform(0.5, 1.5, (16, grid.lines, 4)))

    def lopsided(helix: jax.Array) -> jax.Array:
        lines = jg.contact_lines(eqx.tree_at(lambda p: p.helix_angle, pair, helix), grid)
        side = lines.face_position / lines.length
        return jnp.einsum("pls,pls,s,p->", factors, lines.fraction, side, lines.weight)

    assert_gradient(lopsided, jnp.zeros(()), rtol=1e-4, step=1e-5, scale=jnp.ones(()))


def test_one_trace():
    grid = jg.mesh_grid(power(), phases=8, slices=2)

    def found(pair: jg.GearPair) -> jg.ContactLines:
        return jg.contact_lines(pair, grid)

    lines = eqx.filter_jit(eqx.debug.assert_max_traces(found, max_traces=1))
    for width in (0.03, 0.035, 0.04):
        lines(eqx.tree_at(lambda p: p.wheel.face_width, power(), jnp.asarray(width)))


@pytest.mark.slow
def test_a_grid_that_the_pair_has_outgrown_says_so():
    """Lost lines are no answer: a traced copy with a longer path needs another line."""
    pair = accessory()
    grid = jg.mesh_grid(pair)
    longer = eqx.tree_at(
        lambda p: (p.pinion.addendum, p.wheel.addendum), pair, (jnp.asarray(1.5),) * 2
    )
    assert bool(jg.contact_lines(pair, grid).complete)
    assert float(jg.profile_contact_ratio(longer)) > 2.05
    assert not bool(jg.contact_lines(longer, grid).complete)
    model = jg.PairModel(longer, 80.0, compliance=jg.ConstantStiffness(14e9))
    cycle = eqx.filter_jit(jg.mesh_cycle)(model, grid, throw=False)
    assert not bool(jnp.any(cycle.converged))
    assert bool(jg.contact_lines(longer, jg.mesh_grid(pair, margin=1.0)).complete)


def test_a_slice_wider_than_the_path_is_refused():
    with pytest.raises(ValueError, match="use at least 3 slices"):
        jg.mesh_grid(
            jg.GearPair(
                jg.Gear(35, 0.11, 0.275, 0.976, 1.262, 0.25),
                jg.Gear(68, 0.11, 0.317, 0.970, 1.268, 0.25),
                2.5e-3,
                25.0 * jg.deg,
                12.0 * jg.deg,
            ),
            slices=2,
        )
