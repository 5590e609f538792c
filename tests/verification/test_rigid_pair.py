"""A pair of rigid gears whose teeth share elastic rings: hand solutions, limits and symmetries."""

import functools
import itertools
import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import accessory, exchanged, helical_25_31, mirrored, power
from helpers import assert_close

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._contact._cells import at_line_loads
from jaxgear._contact._ring import ring_receptances

RING = jg.WeberBanaschek(face_coupling=None)


def _on(foundation: jg.AbstractFoundation) -> jg.WeberBanaschek:
    return jg.WeberBanaschek(
        pinion_foundation=foundation, wheel_foundation=foundation, face_coupling=None
    )


HALF_PLANES, ALONE = _on(jg.WeberFoundation()), _on(jg.SainsotFoundation())


def _bored(pair: jg.GearPair, first: float, second: float) -> jg.GearPair:
    """The pair with these bores [mm]."""
    bores = jnp.asarray(first * mm), jnp.asarray(second * mm)
    return eqx.tree_at(
        lambda p: (p.pinion.bore, p.wheel.bore), pair, bores, is_leaf=lambda x: x is None
    )


@functools.cache
def spur() -> jg.GearPair:
    return _bored(accessory(), 30.0, 40.0)


@functools.cache
def helical() -> jg.GearPair:
    return _bored(power(), 40.0, 60.0)


_prepare = eqx.filter_jit(jg.prepare_mesh)
_gap = eqx.filter_jit(jg.mesh_gap)


@eqx.filter_jit
def _solve(system: jg.PairSystem, cells: jg.MeshCells, gap: jax.Array) -> jg.MeshCycle:
    return jg.quasi_static(system, cells, gap, law=jg.ExactContact(), settings=jg.SolverSettings())


def _cycle(model: jg.PairModel, grid: jg.MeshGrid) -> jg.MeshCycle:
    """As `mesh_cycle`, in parts that several tests share."""
    # Preparing does not look at the flanks, so their laws need not be compiled into it.
    prepared = _prepare(replace(model, flanks=jg.Flanks()), grid)
    gap = _gap(model.pair, prepared.cells.lines, model.flanks, model.misalignment)
    cycle = _solve(prepared.system, prepared.cells, gap)
    assert bool(jnp.all(cycle.converged))
    return cycle


def _error(cycle: jg.MeshCycle) -> np.ndarray:
    return np.asarray(jg.transmission_error(cycle.system.pair, cycle))


def _mean(cycle: jg.MeshCycle, values: np.ndarray) -> float:
    return float(np.sum(np.asarray(cycle.cells.lines.weight) * values))


def _rms(cycle: jg.MeshCycle) -> float:
    error = _error(cycle)
    return math.sqrt(_mean(cycle, (error - _mean(cycle, error)) ** 2))


@functools.cache
def _spur_cycle(compliance: jg.WeberBanaschek) -> jg.MeshCycle:
    model = jg.PairModel(spur(), 80.0, compliance=compliance)
    return _cycle(model, jg.mesh_grid(spur(), phases=16, slices=4))


# --- one ring under both teeth


def _parity_free_ring(section: jg.ToothSection, poisson: float, places: np.ndarray) -> np.ndarray:
    """Influence B[i, j] (3 x 3) times E b between roots at these angles, by a plain Fourier series.

    Angles count in the sense of the push. Tractions as vectors in the frame of each tooth; nothing
    is assumed of their parity, nor of what an influence at a negative angle is.
    """
    half, orders = float(section.root_half_angle), np.arange(0, 6001)
    assert section.radius_ratio is not None
    receptances = np.asarray(
        ring_receptances(
            radius_ratio=section.radius_ratio,
            poisson=jnp.asarray(poisson),
            harmonics=int(orders[-1]),
        )
    )
    nodes, weights = np.polynomial.legendre.leggauss(400)
    phi = half * nodes
    # Outward and pushed components in the tooth's frame; each resultant is one.
    level, none = np.full_like(phi, 0.5), np.zeros_like(phi)
    moment = -np.sin(phi) / (weights @ np.sin(phi) ** 2)
    fall = weights @ (0.5 * (1.0 - np.cos(phi)))
    vectors = np.array([[level, none], [fall * moment, level], [moment, none]])
    radial = vectors[:, 0] * np.cos(phi) + vectors[:, 1] * np.sin(phi)
    around = -vectors[:, 0] * np.sin(phi) + vectors[:, 1] * np.cos(phi)
    waves = np.exp(-1j * np.outer(phi, orders))
    # Coefficients of exp(i n theta) of a tooth at zero; elsewhere they turn.
    own = np.stack([(x * weights) @ waves for x in (radial, around)], axis=1) / (2.0 * np.pi)
    turned = own[None] * np.exp(-1j * np.outer(places, orders))[:, None, None, :]
    (rr, rt), (tr, tt) = receptances
    moved_r = rr * turned[:, :, 0] + 1j * rt * turned[:, :, 1]
    moved_t = -1j * tr * turned[:, :, 0] + tt * turned[:, :, 1]
    count = np.where(orders == 0, 1.0, 2.0)  # and its conjugate
    work = np.einsum("ian,jbn->ijabn", turned[:, :, 0].conj(), moved_r).real
    work += np.einsum("ian,jbn->ijabn", turned[:, :, 1].conj(), moved_t).real
    return 2.0 * np.pi * (1.0 + poisson) * (work @ count)


def _resultants(section: jg.ToothSection, roll: float) -> np.ndarray:
    """N outward, Q along the push, M/r_f of a unit load at this roll length."""
    base = float(section.base_radius)
    angle = math.atan(roll / base)
    shift, pressure = float(section.profile_shift), float(section.pressure_angle)
    half = (0.5 * math.pi + 2 * shift * math.tan(pressure)) / float(section.teeth)
    half += math.tan(pressure) - pressure - (math.tan(angle) - angle)
    load = angle - half
    arm = base / math.cos(load) / float(section.root_radius) - 1.0
    return np.array([-math.sin(load), math.cos(load), math.cos(load) * arm])


def _bodies_by_hand(pair: jg.GearPair, rolls: np.ndarray) -> np.ndarray:
    """Compliance per face width between teeth in contact at these places on the path [m2/N].

    Line i + 1 is one pitch further along the path than line i: further round in the sense of its
    own rotation on both gears. The mesh pushes the wheel that way, and the pinion against it.
    """
    total = np.zeros((rolls.size, rolls.size))
    pitches = np.round((rolls - rolls[0]) / float(pair.transverse_base_pitch))
    for gear, forward, own in (
        (pair.pinion, -1.0, rolls),
        (pair.wheel, 1.0, float(pair.tangent_length) - rolls),
    ):
        section = jg.tooth_section(pair, gear)
        places = forward * pitches * 2.0 * math.pi / gear.teeth
        influence = _parity_free_ring(section, float(gear.material.poisson), places)
        loads = np.stack([_resultants(section, roll) for roll in own])
        total += np.einsum("ia,ijab,jb->ij", loads, influence, loads) / float(gear.material.young)
    return total


def _middle_of_two(cycle: jg.MeshCycle) -> tuple[int, np.ndarray]:
    """A phase within double contact, and its two lines."""
    fraction = np.asarray(cycle.cells.lines.fraction)[:, :, 0]
    phase = int(np.flatnonzero((fraction > 0.5).sum(axis=1) == 2)[1])
    return phase, np.flatnonzero(fraction[phase] > 0.5)


@pytest.mark.slow
def test_two_pairs_on_two_rings_by_hand():
    """The 2 x 2 compliance of a spur pair in double contact, from tractions on explicit angles."""
    cycle = _spur_cycle(RING)
    cells, pair = cycle.cells, spur()
    phase, both = _middle_of_two(cycle)
    rolls = np.asarray(cells.lines.roll)[phase, both, 0]
    bodies = _bodies_by_hand(pair, rolls)
    assert cells.coupling is not None
    coupling = np.asarray(cells.coupling)[phase][np.ix_(both, both)] * float(cells.lines.length)
    assert_close(coupling, np.repeat(bodies[:, :, None], 4, axis=2), rtol=2e-5, atol=0.0)
    local = np.diag(1.0 / np.asarray(cells.line_stiffness)[phase, both, 0])
    shares = np.linalg.solve(local + bodies, np.ones(2))
    force = 80.0 / float(pair.base_radius[0])
    approach = force / float(pair.face_width) / shares.sum()
    assert_close(cycle.approach[phase], approach, rtol=2e-5, atol=0.0)
    carried = np.asarray(cycle.force).reshape(16, -1, 4)[phase, both].sum(axis=1)
    assert_close(carried, force * shares / shares.sum(), rtol=1e-4, atol=0.0)


@pytest.mark.slow
def test_the_other_way_round_would_show():
    """Neighbours exchanged move the coupling by more than the tolerance above."""
    cycle = _spur_cycle(RING)
    phase, both = _middle_of_two(cycle)
    rolls = np.asarray(cycle.cells.lines.roll)[phase, both, 0]
    right = _bodies_by_hand(spur(), rolls)[0, 1]
    section = jg.tooth_section(spur(), spur().pinion)
    pitch = 2.0 * math.pi / 45
    influence = _parity_free_ring(section, 0.3, np.array([0.0, pitch, -pitch]))
    loads = [_resultants(section, roll) for roll in rolls]
    one, other = (loads[0] @ influence[0, k] @ loads[1] for k in (1, 2))
    assert abs(one - other) / float(spur().pinion.material.young) > 1e-3 * right


@pytest.mark.slow
def test_a_pair_alone_gives_what_its_compliance_says():
    cycle = _spur_cycle(RING)
    fraction = np.asarray(cycle.cells.lines.fraction)[:, :, 0]
    alone = np.flatnonzero((fraction > 1e-6).sum(axis=1) == 1)
    assert alone.size >= 8
    rolls = np.asarray(cycle.cells.lines.roll)[alone, fraction[alone].argmax(axis=1), 0]
    load = jnp.asarray(80.0) / spur().base_radius[0] / spur().face_width
    compliance = eqx.filter_jit(RING)(spur(), jnp.asarray(rolls), load)
    # The polynomial through the stiffness along the path is good to 2e-5.
    assert_close(cycle.approach[alone], compliance * load, rtol=2e-5, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("make", [helical, spur])
def test_couplings_are_symmetric_and_never_negative(make):
    """At every phase, slices that are partly in contact included."""
    pair = make()
    model = jg.PairModel(pair, 200.0, compliance=RING)
    grid = jg.mesh_grid(pair, phases=16, slices=4 if make is spur else 8)
    cells = _prepare(model, grid).cells
    assert cells.coupling is not None
    matrices = np.moveaxis(np.asarray(cells.coupling), -1, 1)
    assert_close(matrices, np.swapaxes(matrices, 2, 3), rtol=1e-12, atol=0.0)
    values = np.linalg.eigvalsh(matrices)
    assert values.min() > -1e-13 * values.max()
    # A line out of mesh is not coupled; one in mesh gives way.
    fraction = np.moveaxis(np.asarray(cells.lines.fraction), 2, 1)
    own = np.diagonal(matrices, axis1=2, axis2=3)
    assert np.array_equal(own > 0.0, fraction > 0.0)
    # A slice half in contact gives way as one half as long does.
    whole = fraction > 0.999
    assert whole.any()
    if make is helical:
        assert ((fraction > 0.01) & ~whole).any()


@pytest.mark.slow
def test_a_shared_ring_shifts_the_error_and_hardly_adds_to_it():
    """Wind-up is common to all pairs: in the mean, not in the RMS; counted per pair it doubles."""
    weber, ring, alone = (_spur_cycle(x) for x in (HALF_PLANES, RING, ALONE))
    means = [_mean(cycle, _error(cycle)) for cycle in (weber, ring, alone)]
    assert means[1] > 1.4 * means[0]
    assert means[2] > 1.4 * means[0]
    assert 0.7 < _rms(ring) / _rms(weber) < 1.05
    assert 1.7 < _rms(alone) / _rms(ring) < 2.3


# --- symmetries


def _shaft(sign: float, first: float, second: float) -> jg.Shaft:
    """Bearing, load, gear, load, bearing; unequal in everything. `sign` -1 is its mirror image."""
    axial = (1e8, 0.0)
    parts = [
        (jg.Segment(first, 28 * mm), jg.Bearing(0.0, 3e8, 5e8, axial[0]), 15 * mm),
        (jg.Segment(second, 34 * mm, 8 * mm), jg.Bearing(first + second, 7e8, 2e8, axial[1]), None),
    ]
    bearings = [parts[0][1], parts[1][1]]
    loads = [
        jg.ShaftLoad(0.4 * first, (300.0, -200.0, 90.0), (4.0, 7.0, 3.0)),
        jg.ShaftLoad(first + 0.6 * second, (-150.0, 80.0, -40.0), (-6.0, 2.0, -1.0)),
    ]
    segments = [parts[0][0], parts[1][0]]
    at, length = first + 3 * mm, first + second
    if sign < 0:
        flip = lambda x: length - x
        segments.reverse()
        bearings = [replace(b, at=flip(b.at)) for b in reversed(bearings)]
        mirror = jnp.asarray([1.0, 1.0, -1.0])
        loads = [
            jg.ShaftLoad(flip(x.at), mirror * x.force, -mirror * x.moment) for x in reversed(loads)
        ]
        at = flip(at)
    return jg.Shaft(segments, bearings, at, loads=loads)


def _half_turned(shaft: jg.Shaft) -> jg.Shaft:
    """Seen from a frame turned by 180 degrees about Z."""
    turn = jnp.asarray([-1.0, -1.0, 1.0])
    loads = [jg.ShaftLoad(x.at, turn * x.force, turn * x.moment) for x in shaft.loads]
    return jg.Shaft(shaft.segments, shaft.bearings, shaft.gear_at, loads=loads)


CORRECTED = jg.Superposed((jg.TipRelief(12 * um, 0.3), jg.Crowning(4 * um), jg.HelixSlope(3 * um)))
MIRRORED = jg.Superposed((jg.TipRelief(12 * um, 0.3), jg.Crowning(4 * um), jg.HelixSlope(-3 * um)))


def _on_shafts(sign: float) -> jg.PairModel:
    pair = helical_25_31() if sign > 0 else mirrored(helical_25_31())
    return jg.PairModel(
        pair,
        120.0,
        flanks=jg.Flanks(CORRECTED if sign > 0 else MIRRORED, jg.TipRelief(7 * um, 0.25)),
        pinion_support=_shaft(sign, 35 * mm, 50 * mm),
        wheel_support=_shaft(sign, 55 * mm, 30 * mm),
        misalignment=jg.Misalignment(sign * 9 * um, -sign * 14 * um),
    )


GRID = jg.mesh_grid(helical_25_31(), phases=16, slices=6)


@functools.cache
def _cycle_on_shafts(sign: float) -> jg.MeshCycle:
    return _cycle(_on_shafts(sign), GRID)


def _face_load(cycle: jg.MeshCycle) -> np.ndarray:
    weight = np.asarray(cycle.cells.lines.weight)
    force = np.asarray(cycle.force).reshape(cycle.cells.lines.roll.shape)
    return np.einsum("p,pls->s", weight, force)


@pytest.mark.slow
def test_mirror_square_to_the_axes():
    """Rings, shafts, loads, flanks, all mirrored: the same error, face loads the other way."""
    one, other = _cycle_on_shafts(1.0), _cycle_on_shafts(-1.0)
    assert_close(_error(other), _error(one), rtol=1e-8, atol=0.0)
    load = _face_load(one)
    assert load.max() > 1.1 * load.mean()
    assert_close(_face_load(other), load[::-1], rtol=1e-6, atol=0.0)
    shape = one.cells.lines.roll.shape
    force = np.asarray(one.force).reshape(shape)[:, :, ::-1]
    assert np.abs(np.asarray(other.force).reshape(shape) - force).max() < 1e-7 * load.sum()


@pytest.mark.slow
def test_pinion_and_wheel_change_places():
    """The wheel drives with the same force: the mesh runs backwards, at the same face loads."""
    model = _on_shafts(1.0)
    pinion, wheel = model.pinion_support, model.wheel_support
    assert isinstance(pinion, jg.Shaft)
    assert isinstance(wheel, jg.Shaft)
    first, second = (float(x) for x in model.pair.base_radius)
    # Couples about Z act on the mesh too: of the pinion's, the force is what is left.
    force = 120.0 + sum(float(x.moment[2]) for x in pinion.loads)
    outside = sum(float(x.moment[2]) for x in wheel.loads)
    other = _cycle(
        jg.PairModel(
            exchanged(model.pair),
            force * second / first - outside,
            jg.Flanks(model.flanks.wheel, model.flanks.pinion),
            model.compliance,
            _half_turned(wheel),
            _half_turned(pinion),
            model.misalignment,
        ),
        GRID,
    )
    one = _cycle_on_shafts(1.0)
    split = GRID.entry_phases
    error = _error(one)
    backwards = np.concatenate([error[:split][::-1], error[split:][::-1]])
    assert_close(_error(other), backwards, rtol=1e-8, atol=0.0)
    assert_close(_face_load(other), _face_load(one), rtol=1e-6, atol=0.0)


# --- slices, gradients


@pytest.mark.slow
def test_slices_converge():
    """Mean TE of a helical pair on rings: from 4 to 32 slices at an order between 1.5 and 2.5.

    Of slices on their own; those that feel each other: `tests/solve/test_face_coupling.py`.
    """
    model = jg.PairModel(helical(), 308.8, compliance=RING)
    means = {}
    for slices in (4, 8, 32, 96):
        cycle = _cycle(model, jg.mesh_grid(helical(), phases=16, slices=slices))
        means[slices] = _mean(cycle, _error(cycle))
    errors = [abs(means[n] / means[96] - 1.0) for n in (4, 8, 32)]
    assert errors[0] < 5e-3
    assert errors[1] < 2e-3
    assert 8**1.5 < errors[0] / errors[2] < 8**2.5


DIRECTIONS = {
    "torque": lambda m: m.torque,
    "helix angle": lambda m: m.pair.helix_angle,
    "face width": lambda m: m.pair.wheel.face_width,
    "bore": lambda m: m.pair.pinion.bore,
    "bearing": lambda m: m.pinion_support.bearings[0].radial_t,
    "load": lambda m: m.wheel_support.loads[0].force,
}


def _everything() -> tuple[jg.PairModel, jg.MeshGrid]:
    """Rings, shafts, tip contact, a line-load update, with contact that is smooth."""
    model = replace(_on_shafts(1.0), compliance=jg.WeberBanaschek(load_updates=1))
    return model, jg.mesh_grid(model.pair, phases=8, slices=3, beyond=0.25)


def _number(model: jg.PairModel, grid: jg.MeshGrid) -> jax.Array:
    cycle = jg.mesh_cycle(model, grid, law=jg.SmoothContact(1 * um), throw=False)
    error = jg.transmission_error(model.pair, cycle) / um
    return jg.cycle_mean(cycle, error) + 3.0 * jg.cycle_variance(cycle, error)


@pytest.mark.slow
def test_slopes_with_everything_switched_on():
    """Forward derivatives of mean and variance against differences, one input at a time."""
    model, grid = _everything()

    @eqx.filter_jit
    def forward(model: jg.PairModel, change: jg.PairModel):
        return eqx.filter_jvp(lambda m: _number(m, grid), (model,), (change,))

    nothing = jax.tree.map(jnp.zeros_like, eqx.filter(model, eqx.is_inexact_array))
    for name, of in DIRECTIONS.items():
        size = jnp.max(jnp.abs(of(model)))
        change = eqx.tree_at(of, nothing, size * jnp.ones_like(of(model)))
        slope = forward(model, change)[1]
        step = 1e-5
        ahead, behind = (
            forward(eqx.tree_at(of, model, of(model) + s * of(change)), change)[0]
            for s in (step, -step)
        )
        assert abs(float(slope)) > 1e-4, name
        assert_close(slope, (ahead - behind) / (2 * step), rtol=2e-5, atol=0.0)


# --- stiffness at the line loads found


@pytest.mark.slow
def test_one_update_leaves_single_contact_as_it_is():
    """Uniform load: in single contact the line load is the nominal one. One or two updates do."""
    base = _spur_cycle(RING)
    nominal = jg.nominal_line_load(spur(), jnp.asarray(80.0))
    softening = RING.log_slope(spur())
    gap = jnp.zeros_like(base.force)
    update = jax.jit(at_line_loads)
    cycles = [base]
    for _ in range(3):
        loaded = update(base.cells, cycles[-1].force, nominal, softening)
        cycles.append(_solve(base.system, loaded, gap))
    fraction = np.asarray(base.cells.lines.fraction)[:, :, 0]
    alone = (fraction > 1e-6).sum(axis=1) == 1
    errors = [_error(cycle) for cycle in cycles]
    assert_close(errors[1][alone], errors[0][alone], rtol=1e-9, atol=0.0)
    moved = [np.abs(b - a).max() for a, b in itertools.pairwise(errors)]
    # 2 pairs carry half each: their contact gives 2 (1 - nu^2)/(pi E) ln 2 more.
    assert moved[0] > 1e-2 * errors[0].min()
    assert moved[1] < 2e-3 * moved[0]
    assert moved[2] < 0.1 * moved[1]
    # And that is what `load_updates` does.
    model = jg.PairModel(spur(), 80.0, compliance=replace(RING, load_updates=2))
    grid = jg.mesh_grid(spur(), phases=16, slices=4)
    whole = eqx.filter_jit(jg.mesh_cycle)(model, grid)
    assert_close(_error(whole), errors[2], rtol=1e-11, atol=0.0)


# --- tip corners


def _with_tips(flanks: jg.Flanks) -> tuple[jg.MeshCycle, jg.MeshCycle]:
    """Accessory on rings, without and with tip contact."""
    model = jg.PairModel(spur(), 80.0, flanks=flanks)
    grids = (jg.mesh_grid(spur(), phases=48, slices=1, beyond=x) for x in (0.0, 0.25))
    off, on = (_cycle(model, grid) for grid in grids)
    return off, on


@functools.cache
def _tips_of_nominal_flanks() -> tuple[jg.MeshCycle, jg.MeshCycle]:
    return _with_tips(jg.Flanks())


def _beyond(cycle: jg.MeshCycle) -> np.ndarray:
    roll = np.asarray(cycle.cells.lines.roll)
    return (roll < float(spur().path_start)) | (roll > float(spur().path_end))


@pytest.mark.slow
def test_tip_corners_take_load_off_the_others():
    """Longer contact: less TE at each phase, and no jump where a pair enters."""
    off, on = _tips_of_nominal_flanks()
    assert _mean(on, _error(on)) < 0.97 * _mean(off, _error(off))
    # Phase by phase: where the other grid has the same event on either side.
    phase = np.asarray(on.cells.lines.phase) % 1.0
    order = np.argsort(phase)
    # The off cycle has two branches, single and double contact; each is smooth.
    ratio = float(jg.profile_contact_ratio(spur())) - 1.0
    own_phase, own = np.asarray(off.cells.lines.phase), _error(off)
    for branch in (own_phase < ratio, own_phase > ratio):
        inside = (phase > own_phase[branch][0]) & (phase < own_phase[branch][-1])
        limit = np.interp(phase[inside], own_phase[branch], own[branch])
        assert np.all(_error(on)[inside] < limit * (1.0 + 1e-3))
    jumps = [np.abs(np.diff(np.append(x, x[0]))).max() for x in (own, _error(on)[order])]
    assert jumps[1] < 0.25 * jumps[0]


@pytest.mark.slow
def test_corners_carry_only_where_teeth_bend_enough():
    """A cell beyond the path carries if, and only if, its separation is below the approach."""
    _, on = _tips_of_nominal_flanks()
    beyond = _beyond(on)
    separation = np.asarray(jg.tip_separation(spur(), on.cells.lines.roll))
    assert np.all(separation[~beyond] == 0.0)
    overlap = np.asarray(on.overlap).reshape(beyond.shape)
    force = np.asarray(on.force).reshape(beyond.shape)
    approach = np.asarray(on.approach)[:, None, None]
    carries = force > 0.0
    assert carries[beyond].any()
    assert not carries[separation > approach].any()
    assert np.array_equal(carries, overlap > 0.0)
    # The ring has sunk under the other pair, so it takes more than the approach alone.
    share = np.where(beyond, force, 0.0).sum(axis=(1, 2)) / force.sum(axis=(1, 2))
    assert 0.3 < share.max() < 0.5
    assert 0.05 < _mean(on, share) < 0.15


@pytest.mark.slow
def test_heavy_tip_relief_keeps_the_corners_out():
    relief = jg.TipRelief(60 * um, 0.3)
    off, on = _with_tips(jg.Flanks(relief, relief))
    assert np.all(np.asarray(on.force).reshape(_beyond(on).shape)[_beyond(on)] == 0.0)
    assert_close(_mean(on, _error(on)), _mean(off, _error(off)), rtol=1e-3, atol=0.0)


@pytest.mark.slow
def test_reverse_slopes_with_everything_switched_on():
    model, grid = _everything()

    def number(model: jg.PairModel) -> jax.Array:
        return _number(model, grid)

    gradient = eqx.filter_jit(eqx.filter_grad(number))(model)
    nothing = jax.tree.map(jnp.zeros_like, eqx.filter(model, eqx.is_inexact_array))
    forward = eqx.filter_jit(lambda m, d: eqx.filter_jvp(number, (m,), (d,))[1])
    for of in DIRECTIONS.values():
        change = eqx.tree_at(of, nothing, jnp.max(jnp.abs(of(model))) * jnp.ones_like(of(model)))
        slope = jnp.sum(of(gradient) * of(change))
        assert_close(slope, forward(model, change), rtol=1e-8, atol=0.0)
