"""Quasi-static mesh cycles: equilibrium, closed forms, limits, symmetries, refusals."""

import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, observed_order, quick
from made_programs import made_programs
from solve_cases import (
    ACCESSORY,
    FZG_C14,
    FZG_H501,
    POWER,
    Drawing,
    run_cycle,
    spread,
    symmetric_relief,
    with_contact_ratio,
    zero,
)

import jaxgear as jg
from jaxgear import um

STIFFNESS = 14e9
SUPPORTS = (
    jg.Support(radial_s=2e8, radial_t=5e8, axial=1e8, tilt=3e5),
    jg.Support(radial_s=4e8, radial_t=7e8, axial=2e8, tilt=6e5),
)


def _superposed(depth: float, crowning: float, slope: float) -> jg.Superposed:
    return jg.Superposed((jg.TipRelief(depth, 0.3), jg.Crowning(crowning), jg.HelixSlope(slope)))


RELIEVED = _superposed(12 * um, 4 * um, 3 * um)
SKEW = jg.Misalignment(8 * um, -15 * um)


def _model(drawing: Drawing, torque: float, **more) -> jg.PairModel:
    more.setdefault("compliance", jg.ConstantStiffness(STIFFNESS))
    return jg.PairModel(drawing.pair(), torque, **more)


# Tests share their grids and the structure of their models: other numbers are the same program.
SPUR_GRID = jg.mesh_grid(ACCESSORY.pair(), phases=16, slices=8)
HELICAL_GRID = jg.mesh_grid(POWER.pair(), phases=16, slices=8)


def _helical(**more) -> jg.PairModel:
    """Helical gears on springs, relieved in three ways, misaligned unless said."""
    given = dict(zip(("pinion_support", "wheel_support"), SUPPORTS, strict=True))
    flanks = jg.Flanks(RELIEVED, RELIEVED)
    return _model(POWER, 120.0, **({"flanks": flanks, "misalignment": SKEW} | given | more))


def _error(model: jg.PairModel, cycle: jg.MeshCycle) -> np.ndarray:
    return np.asarray(jg.transmission_error(model.pair, cycle))


def _deflection(drawing: Drawing, torque: float) -> float:
    """Transverse deflection of one spur pair that carries everything."""
    return drawing.force(torque) / (STIFFNESS * drawing.common_width)


# --- equilibrium

EVERYTHING = {
    "helical": (POWER, _helical()),
    "spur": (ACCESSORY, _model(ACCESSORY, 120.0, flanks=symmetric_relief(10 * um, 0.3))),
    "even": (ACCESSORY, _model(ACCESSORY, 120.0)),
    "fzg": (FZG_H501, _model(FZG_H501, 120.0, compliance=jg.WeberBanaschek())),
}


@pytest.mark.parametrize("case", quick(2, EVERYTHING))
def test_cell_forces_balance_the_torque_at_every_phase(case):
    drawing, model = EVERYTHING[case]
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=16, slices=8))
    assert bool(jnp.all(cycle.converged))
    force = np.asarray(cycle.force)
    # Rounding of the active fraction may leave -1e-18 of it.
    assert np.all(force >= -1e-15 * drawing.force(120.0))
    expected = np.full(16, drawing.force(120.0))
    assert_close(force.sum(axis=1), expected, rtol=1e-9, atol=0.0)
    # Moments: about the pinion's axis the torque, about the contact line's foot the second load.
    arm = drawing.base_radius[0] * math.cos(drawing.base_helix)
    assert_close(force.sum(axis=1) * arm, np.full(16, 120.0), rtol=1e-9, atol=0.0)
    moment = np.sum(force * np.asarray(cycle.cells.arm), axis=1)
    # A spur pair on rigid supports has none: compare in units of the force at 10 mm.
    assert np.all(np.abs(np.asarray(cycle.load[:, 1]) - moment) < 1e-9 * 0.01 * expected[0])


def test_tilt_of_supported_bodies_follows_their_moment():
    """Overlaps of one line, gaps taken out, lie on a straight line of slope -H1.g."""
    drawing, model = EVERYTHING["helical"]
    cycle = run_cycle(model, HELICAL_GRID)
    gap = jg.mesh_gap(model.pair, cycle.cells.lines, model.flanks, model.misalignment)
    across = 1 / 3e5 + 1 / 6e5
    teeth = np.asarray(drawing.teeth)
    first, second = drawing.centre_distance * teeth / teeth.sum()
    sine = math.sin(drawing.base_helix) * math.sin(drawing.working_angle)
    coupling = sine * (first / 3e5 - second / 6e5)
    force = np.asarray(cycle.force)
    moment = np.sum(force * np.asarray(cycle.cells.arm), axis=1)
    tilt = -(coupling * force.sum(axis=1) + across * moment)
    moved = np.asarray(cycle.overlap + gap)
    arms = np.asarray(cycle.cells.arm)
    slope = (moved[:, -1] - moved[:, 0]) / (arms[:, -1] - arms[:, 0])
    assert_close(slope, tilt, rtol=1e-8, atol=0.0)


# --- closed forms at constant stiffness


@pytest.mark.parametrize("ratio", quick(1, [1.6, 1.01, 2.0, 1.3, 1.9, 2.3]))
def test_unmodified_spur_pair_by_hand(ratio):
    """n or n + 1 pairs share the load: delta/n and delta/(n + 1), for 1 - p and p of the period."""
    drawing = with_contact_ratio(ratio)
    model = _model(drawing, 200.0)
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=16, slices=8))
    error, delta = _error(model, cycle), _deflection(drawing, 200.0)
    # At a whole contact ratio the fraction is 0 or 1, as rounding has it; both sets agree.
    fewer = round(ratio) if abs(ratio - round(ratio)) < 1e-6 else math.floor(ratio)
    part = max(ratio - fewer, 0.0)
    mean = delta * ((1 - part) / fewer + part / (fewer + 1))
    weight = np.asarray(cycle.cells.lines.weight)
    assert_close(np.sum(weight), 1.0, rtol=1e-12, atol=0.0)
    assert_close(np.sum(weight * error), mean, rtol=1e-7, atol=0.0)
    deviation = delta * math.sqrt(part * (1 - part)) / (fewer * (fewer + 1))
    assert abs(spread(cycle, error) - deviation) < 1e-7 * delta
    if ratio < 2.0:
        assert_close(mean, delta * (1 - (ratio - 1) / 2), rtol=1e-12, atol=0.0)
        assert_close(
            deviation, 0.5 * delta * math.sqrt((ratio - 1) * (2 - ratio)), rtol=1e-12, atol=0.0
        )


@pytest.mark.slow
@pytest.mark.parametrize("phases", [13, 8])
def test_unmodified_spur_pair_is_exact_on_any_grid(phases):
    drawing = with_contact_ratio(1.42)
    model = _model(drawing, 200.0)
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=phases, slices=1))
    expected = 0.5 * _deflection(drawing, 200.0) * math.sqrt(0.42 * 0.58)
    assert_close(spread(cycle, _error(model, cycle)), expected, rtol=1e-7, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "ratio",
    [pytest.param(1.2, marks=pytest.mark.slow), 1.42, pytest.param(1.8, marks=pytest.mark.slow)],
)
def test_rms_follows_the_contact_ratio(ratio):
    """d RMS/d eps = delta (3 - 2 eps) / (4 sqrt((eps-1)(2-eps))), through the addendum.

    In reverse mode the phases beside a tooth's entry and exit sit on a corner of the active
    fraction, so rounding enters divided by the corner's width.
    """
    drawing = with_contact_ratio(ratio)
    model = _model(drawing, 200.0)
    grid = jg.mesh_grid(model.pair, phases=32, slices=2)

    def rms(addendum):
        moved = eqx.tree_at(
            lambda m: (m.pair.pinion.addendum, m.pair.wheel.addendum), model, (addendum,) * 2
        )
        cycle = jg.mesh_cycle(moved, grid, throw=False)
        return jg.cycle_rms(cycle, jg.transmission_error(moved.pair, cycle))

    # eps moves with the two tip roll lengths: d sqrt(ra^2 - rb^2) = ra m dh / sqrt(..).
    tips = zip(drawing.tip_radius, drawing.base_radius, strict=True)
    longer = sum(a * drawing.module / math.sqrt(a**2 - b**2) for a, b in tips)
    slope = 0.25 * (3 - 2 * ratio) / math.sqrt((ratio - 1) * (2 - ratio))
    slope *= _deflection(drawing, 200.0) * longer / drawing.base_pitch

    @jax.jit
    def slopes(addendum):
        value, push = jax.linearize(rms, addendum)
        pull = jax.linear_transpose(lambda moved: push(moved), addendum)
        return push(jnp.ones_like(addendum)), pull(jnp.ones_like(value))[0]

    for got in slopes(jnp.asarray(drawing.addendum[0])):
        assert_close(got, slope, rtol=1e-6, atol=0.0)


def _sum_of_pairs(drawing: Drawing, torque: float, phase: float, depth: float, extent: float):
    """TE of a relieved spur pair at one phase: sum_j k b <x - e(s_j)> = F, by bisection."""
    ratio = drawing.contact_ratio
    run = extent * ratio
    places = [phase + j for j in range(3) if phase + j < ratio]

    def removed(s: float) -> float:
        return depth * (max(1 - s / run, 0.0) + max(1 - (ratio - s) / run, 0.0))

    delta = _deflection(drawing, torque)

    def missing(x: float) -> float:
        return sum(max(x - removed(s), 0.0) for s in places) - delta

    return zero(missing, 0.0, delta + 2 * depth)


@pytest.mark.parametrize(
    ("ratio", "extent", "depth"),
    quick(
        4,
        [
            (1.6, 0.3, 0.0),
            (1.6, 0.3, 3 * um),
            (1.6, 0.3, 40 * um),
            # Unrelieved flank shorter than a pitch, and deep: two barely touching pairs, large TE.
            (1.6, 0.45, 60 * um),
            (1.01, 0.2, 20 * um),
            (2.3, 0.4, 15 * um),
        ],
    ),
)
def test_relieved_spur_pair_against_bisection(ratio, extent, depth):
    drawing = with_contact_ratio(ratio)
    model = _model(drawing, 200.0, flanks=symmetric_relief(depth, extent))
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=64, slices=4))
    phases = np.asarray(cycle.cells.lines.phase)
    expected = [_sum_of_pairs(drawing, 200.0, phase, depth, extent) for phase in phases]
    assert_close(_error(model, cycle), np.array(expected), rtol=1e-7, atol=0.0)


def test_deep_relief_separates_neighbouring_teeth():
    """Unrelieved for more than a pitch and relieved by far more than delta: one pair at a time."""
    drawing = with_contact_ratio(1.6)
    model = _model(drawing, 200.0, flanks=symmetric_relief(2e-3, 0.15))
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=64, slices=4))
    assert bool(jnp.all(cycle.converged))
    sharing = np.asarray(jg.load_sharing(cycle))
    alone = np.isclose(sharing.max(axis=1), 1.0, rtol=0, atol=1e-9)
    # Both are unrelieved only over (1 - 2 * 0.15) * 1.6 - 1 = 0.12 of the period.
    assert_close(np.sum(np.asarray(cycle.cells.lines.weight)[~alone]), 0.12, rtol=0.09, atol=0.0)
    delta = _deflection(drawing, 200.0)
    assert_close(_error(model, cycle)[alone], np.full(alone.sum(), delta), rtol=1e-9, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "drawing",
    [pytest.param(ACCESSORY, marks=pytest.mark.slow), POWER],
    ids=["spur", "helical"],
)
def test_slope_at_zero_relief_is_a_derivative(drawing):
    """d mean TE/d depth: the mean removal over the cells in contact. A tie must not halve it."""
    model = _model(drawing, 120.0)
    grid = jg.mesh_grid(model.pair, phases=32, slices=12)

    def error(depth):
        moved = eqx.tree_at(lambda m: m.flanks, model, symmetric_relief(depth, 0.25))
        cycle = jg.mesh_cycle(moved, grid, throw=False)
        return jg.transmission_error(moved.pair, cycle), cycle.cells

    @jax.jit
    def with_slope(depth):
        value, push, cells = jax.linearize(error, depth, has_aux=True)
        return value, push(jnp.ones_like(depth)), cells

    at_zero, slope, cells = with_slope(jnp.asarray(0.0))
    lines = cells.lines
    ratio = drawing.contact_ratio
    place = (np.asarray(lines.roll) - float(model.pair.path_start)) / drawing.base_pitch / ratio
    removed = np.maximum(1 - place / 0.25, 0.0) + np.maximum(1 - (1 - place) / 0.25, 0.0)
    share = np.asarray(cells.stiffness).reshape(place.shape)
    expected = np.sum(share * removed, axis=(1, 2)) / np.sum(share, axis=(1, 2))
    expected /= math.cos(drawing.base_helix)
    assert_close(slope, expected, rtol=1e-8, atol=1e-9)
    # From the inside: the difference over a relief far below any deflection.
    step = 1e-9
    ahead = (with_slope(jnp.asarray(step))[0] - at_zero) / step
    assert_close(ahead, expected, rtol=1e-5, atol=1e-6)


def test_misalignment_that_unloads_half_a_face_by_hand():
    """A wedge gap c z: F = n k c b^2 / 8 leaves the mid-face just touching, TE = 0."""
    drawing = with_contact_ratio(1.01)
    torque = 200.0
    wedge = 8 * drawing.force(torque) / (STIFFNESS * drawing.common_width**2)
    deviation = wedge * drawing.common_width / math.cos(drawing.working_angle)
    model = _model(drawing, torque, misalignment=jg.Misalignment(deviation=deviation))
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=16, slices=8))
    delta = _deflection(drawing, torque)
    single = np.asarray(cycle.cells.lines.phase) > 0.01
    assert np.all(np.abs(_error(model, cycle)[single]) < 1e-9 * delta)
    # The wheel leans away from the pinion at the right end: the left half carries.
    force = np.asarray(cycle.force).reshape(16, -1, 8)[single].sum(axis=1)
    ramp = np.maximum(-np.asarray(cycle.cells.lines.face_position), 0.0)
    expected = drawing.force(torque) * ramp / ramp.sum()
    assert_close(force, np.broadcast_to(expected, force.shape), rtol=1e-7, atol=1e-9)


def test_inclination_acts_by_the_sine_of_the_pressure_angle():
    def force(**more) -> np.ndarray:
        misalignment = jg.Misalignment(**more)
        flanks = symmetric_relief(10 * um, 0.3)
        model = _model(ACCESSORY, 80.0, flanks=flanks, misalignment=misalignment)
        return np.asarray(run_cycle(model, SPUR_GRID).force)

    one = force(inclination=20 * um)
    other = force(deviation=20 * um * math.tan(ACCESSORY.working_angle))
    assert_close(one, other, rtol=1e-9, atol=1e-6)
    assert np.max(np.abs(one - force())) > 1.0


# --- scaling and symmetry


def test_all_lengths_times_37():
    """At equal stress (torque x 37^3) the TE scales with the lengths, forces with 37^2."""

    def solved(by: float) -> tuple[np.ndarray, np.ndarray]:
        width = (by * POWER.face_width[0], by * POWER.face_width[1])
        drawing = replace(POWER, module=by * POWER.module, face_width=width)
        flank = _superposed(by * 12 * um, by * 4 * um, by * 3 * um)
        give = [jg.Support(by * 2e8, by * 5e8, by * 1e8, by**3 * 3e5) for _ in range(2)]
        skew = jg.Misalignment(by * 8 * um, by * -15 * um)
        model = _model(
            drawing, 80.0 * by**3, flanks=jg.Flanks(flank, flank), pinion_support=give[0],
            wheel_support=give[1], misalignment=skew,
        )  # fmt: skip
        cycle = run_cycle(model, HELICAL_GRID)
        return _error(model, cycle), np.asarray(cycle.force)

    (error, force), (many_errors, forces) = solved(1.0), solved(37.0)
    assert_close(many_errors, 37.0 * error, rtol=1e-10, atol=0.0)
    assert_close(forces, 37.0**2 * force, rtol=1e-8, atol=1e-3)


def _exchanged(model: jg.PairModel, drawing: Drawing) -> jg.PairModel:
    """The wheel drives: same force, mirrored hand, the mesh runs backwards."""
    pair = model.pair
    swapped = jg.GearPair(
        pair.wheel, pair.pinion, pair.normal_module, pair.pressure_angle, -pair.helix_angle
    )
    first, second = drawing.base_radius
    return jg.PairModel(
        swapped,
        model.torque * second / first,
        jg.Flanks(model.flanks.wheel, model.flanks.pinion),
        model.compliance,
        model.wheel_support,
        model.pinion_support,
        model.misalignment,
    )


def _change_places(model: jg.PairModel, drawing: Drawing, grid: jg.MeshGrid) -> None:
    other = _exchanged(model, drawing)
    error = _error(model, run_cycle(model, grid))
    back = _error(other, run_cycle(other, grid))
    # A phase tau is met at eps - tau: each of the two sets of phases is reversed.
    split = grid.entry_phases
    reversed_ = np.concatenate([back[:split][::-1], back[split:][::-1]])
    assert_close(reversed_, error, rtol=1e-9, atol=0.0)
    assert np.ptp(error) > 1e-3 * np.mean(error)


@pytest.mark.slow
def test_pinion_and_wheel_change_places():
    flanks = jg.Flanks(_superposed(18 * um, 3 * um, 5 * um), RELIEVED)
    _change_places(_helical(flanks=flanks, misalignment=jg.Misalignment()), POWER, HELICAL_GRID)


@pytest.mark.slow
@pytest.mark.parametrize("drawing", [ACCESSORY, POWER], ids=["spur", "helical"])
def test_pinion_and_wheel_change_places_with_their_compliance(drawing):
    supports = dict(zip(("pinion_support", "wheel_support"), SUPPORTS, strict=True))
    flanks = jg.Flanks(jg.Superposed((jg.TipRelief(15 * um, 0.3), RELIEVED)), RELIEVED)
    model = _model(drawing, 120.0, flanks=flanks, compliance=jg.WeberBanaschek(), **supports)
    _change_places(model, drawing, jg.mesh_grid(model.pair, phases=16, slices=6))


def test_mirrored_pair_has_mirrored_forces():
    """The other hand, with every feature across the face mirrored too."""
    results = []
    for sign in (1.0, -1.0):
        model = _helical(
            flanks=jg.Flanks(
                _superposed(10 * um, 2 * um, sign * 6 * um), _superposed(um, um, sign * um)
            ),
            misalignment=jg.Misalignment(sign * 5 * um, sign * 9 * um),
        )
        hand = sign * model.pair.helix_angle
        model = eqx.tree_at(lambda m: m.pair.helix_angle, model, hand)
        cycle = run_cycle(model, HELICAL_GRID)
        results.append((_error(model, cycle), np.asarray(cycle.force).reshape(16, -1, 8)))
    (right, force), (left, mirrored) = results
    assert_close(left, right, rtol=1e-10, atol=0.0)
    assert_close(mirrored[:, :, ::-1], force, rtol=1e-8, atol=1e-6)
    assert np.max(np.abs(mirrored - force)) > 1.0


# --- extremes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("helix", "width", "slices"),
    quick(1, [(35.0, 0.06, 30), (0.0, 0.02, 1), (0.0, 0.6, 20), (5.0, 0.02, 1), (20.0, 0.3, 40)]),
)
def test_wide_narrow_and_steep_pairs_converge(helix, width, slices):
    drawing = with_contact_ratio(1.4, helix_angle=math.radians(helix), face_width=width)
    support = jg.Support(radial_s=2e8, radial_t=5e8, axial=1e8, tilt=3e5)
    more = {"pinion_support": support, "flanks": jg.Flanks(RELIEVED, RELIEVED)}
    model = _model(drawing, 150.0, misalignment=jg.Misalignment(30 * um, -40 * um), **more)
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=16, slices=slices))
    assert bool(jnp.all(cycle.converged))
    assert int(jnp.max(cycle.steps)) < 30
    expected = np.full(16, drawing.force(150.0))
    assert_close(np.asarray(cycle.force).sum(axis=1), expected, rtol=1e-9, atol=0.0)


@pytest.mark.slow
def test_two_hundred_slices_agree_with_twenty():
    model = _model(POWER, 150.0, flanks=jg.Flanks(RELIEVED, RELIEVED))
    means = []
    for slices in (20, 200):
        cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=16, slices=slices))
        means.append(float(jg.cycle_mean(cycle, jg.transmission_error(model.pair, cycle))))
    assert_close(means[0], means[1], rtol=2e-3, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_integer_overlap_keeps_an_unmodified_pair_still(sign):
    """eps_beta = 1: the length of contact is constant, so is TE = F / (k eps b) cos(beta_b)^-1."""
    helix = math.radians(18.0) * sign
    width = with_contact_ratio(1.4, helix_angle=helix).base_pitch / math.tan(
        abs(with_contact_ratio(1.4, helix_angle=helix).base_helix)
    )
    drawing = with_contact_ratio(1.4, helix_angle=helix, face_width=width)
    assert_close(abs(drawing.overlap_ratio), 1.0, rtol=1e-12, atol=0.0)
    model = _model(drawing, 150.0)
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=16, slices=16))
    error = _error(model, cycle)
    # Normal deflection F_n / (k L), L = eps b / cos(beta_b); transverse: over cos(beta_b).
    length = 1.4 * width / math.cos(drawing.base_helix)
    expected = drawing.force(150.0) / (STIFFNESS * length) / math.cos(drawing.base_helix)
    weight = np.asarray(cycle.cells.lines.weight)
    assert_close(np.sum(weight * error), expected, rtol=1e-3, atol=0.0)
    assert spread(cycle, error) < 1e-3 * expected


# --- supports


@pytest.mark.slow
def test_radial_springs_add_their_own_deflection():
    """Spur, no tilt: TE rises by F (sin^2/k_S + cos^2/k_T) of both gears, at every phase."""
    relief = symmetric_relief(12 * um, 0.25)
    rigid = _model(ACCESSORY, 80.0, flanks=relief)
    soft = _model(
        ACCESSORY,
        80.0,
        flanks=relief,
        pinion_support=jg.Support(radial_s=2e7, radial_t=5e7),
        wheel_support=jg.Support(radial_s=4e7, radial_t=7e7),
    )
    sine, cosine = math.sin(ACCESSORY.working_angle), math.cos(ACCESSORY.working_angle)
    give = sine**2 * (1 / 2e7 + 1 / 4e7) + cosine**2 * (1 / 5e7 + 1 / 7e7)
    rise = _error(soft, run_cycle(soft, SPUR_GRID)) - _error(rigid, run_cycle(rigid, SPUR_GRID))
    assert_close(rise, np.full(16, ACCESSORY.force(80.0) * give), rtol=1e-9, atol=0.0)


def _on(k: float) -> jg.PairModel:
    """Helical gears on equal springs."""
    support = jg.Support(k, k, k, 1e-3 * k)
    return _helical(pinion_support=support, wheel_support=support)


@pytest.mark.slow
def test_very_stiff_supports_tend_to_rigid_ones():
    rigid = _helical(pinion_support=jg.Support(), wheel_support=jg.Support())
    still = _error(rigid, run_cycle(rigid, HELICAL_GRID))
    stiffness = np.array([1e11, 1e12, 1e13])
    models = [_on(k) for k in stiffness]
    errors = [_error(model, run_cycle(model, HELICAL_GRID)) for model in models]
    differences = [np.max(np.abs(error / still - 1)) for error in errors]
    assert 0.98 < observed_order(1 / stiffness, differences) < 1.02


@pytest.mark.parametrize("k", [1e5, 1e6, 1e7])
def test_soft_supports_converge(k):
    """Centres that move by millimetres."""
    cycle = run_cycle(_on(k), HELICAL_GRID)
    expected = np.full(16, POWER.force(120.0))
    assert_close(np.asarray(cycle.force).sum(axis=1), expected, rtol=1e-8, atol=0.0)


# --- gradients


@pytest.mark.slow
@pytest.mark.parametrize(
    "compliance",
    [
        jg.ConstantStiffness(STIFFNESS),
        pytest.param(jg.WeberBanaschek(), marks=pytest.mark.slow),
    ],
    ids=["constant", "weber"],
)
def test_every_real_input_is_differentiable(compliance):
    """One direction through gears, flanks, supports, misalignment, stiffness and torque at once."""
    model = eqx.tree_at(lambda m: m.torque, _helical(compliance=compliance), jnp.asarray(300.0))
    # Tip shortenings and the speed are zero.
    sizes = eqx.tree_at(
        lambda m: (m.pair.pinion.tip_shortening, m.pair.wheel.tip_shortening, m.speed),
        model,
        (jnp.asarray(0.1), jnp.asarray(0.1), jnp.asarray(100.0)),
    )
    grid = jg.mesh_grid(model.pair, phases=8, slices=8)

    def mean(moved):
        cycle = jg.mesh_cycle(moved, grid, law=jg.SmoothContact(2 * um), throw=False)
        error = jg.transmission_error(moved.pair, cycle)
        return (jg.cycle_mean(cycle, error) + jg.cycle_rms(cycle, error)) / um

    assert_gradient(mean, model, rtol=2e-5, step=1e-6, scale=sizes)


# --- refusals and bookkeeping


def test_single_precision_is_refused_with_the_line_to_add():
    with jax.enable_x64(False):
        model = _model(ACCESSORY, 80.0)
        grid = jg.mesh_grid(model.pair, phases=8, slices=2)
        with pytest.raises(ValueError, match=r'jax\.config\.update\("jax_enable_x64", True\)'):
            jg.mesh_cycle(model, grid)


def test_a_torque_that_does_not_drive_is_refused():
    with pytest.raises(ValueError, match="torque must be positive"):
        _model(ACCESSORY, -80.0)
    # Nor may it be turned round later.
    model = eqx.tree_at(lambda m: m.torque, _model(ACCESSORY, 80.0), jnp.asarray(-80.0))
    with pytest.raises(ValueError, match="torque must be positive"):
        jg.mesh_cycle(model, jg.mesh_grid(model.pair))


def test_quasi_static_is_the_body_of_mesh_cycle():
    model = _model(ACCESSORY, 80.0, flanks=symmetric_relief(10 * um, 0.3))
    cells = jg.mesh_cells(model.pair, SPUR_GRID, model.compliance, jnp.asarray(1.0))
    gap = jg.mesh_gap(model.pair, cells.lines, model.flanks, jg.Misalignment())
    cycle = jg.quasi_static(
        jg.pair_system(model.pair, model.torque),
        cells,
        gap,
        law=jg.ExactContact(),
        settings=jg.SolverSettings(),
    )
    assert_close(cycle.approach, run_cycle(model, SPUR_GRID).approach, rtol=1e-12, atol=0.0)


@pytest.mark.slow
def test_one_program_serves_all_designs():
    designs = [(0.0, 80.0), (10 * um, 100.0), (20 * um, 40.0)]
    models = [_model(ACCESSORY, load, flanks=symmetric_relief(d, 0.3)) for d, load in designs]
    jg.mesh_cycle(models[0], SPUR_GRID)
    with made_programs() as made:
        for model in models[1:]:
            jg.mesh_cycle(model, SPUR_GRID)
    assert not made


def test_nominal_line_load_by_hand():
    """T / (r_b b): F_n cos(beta_b) / b; 200 N m on the FZG C14, 5912 N over 14 mm."""
    pair = FZG_C14.pair()
    load = jg.nominal_line_load(pair, jnp.asarray(200.0))
    assert_close(load, 5912.1 / 0.014, rtol=1e-4, atol=0.0)
