"""Shafts and bending bodies as the mesh sees them: rigid motions, equilibrium, limits, signs."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, observed_order, quick
from solve_cases import ACCESSORY, POWER, run_cycle

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._interface._wrench import beam_basis
from jaxgear._system._beam import Beam, beam_shapes, cowper_coefficient

STIFFNESS = 14e9
LAW = jg.ConstantStiffness(STIFFNESS)
TORQUE = {"spur": 80.0, "helical": 308.8}
DRAWINGS = {"spur": ACCESSORY, "helical": POWER}

_system = eqx.filter_jit(jg.pair_system)
_bearings = eqx.filter_jit(
    lambda system, load: jax.vmap(lambda x: jg.bearing_motion(system.structure, x).load)(
        system.displacement(load)
    )
)


@functools.cache
def _pair(kind: str) -> jg.GearPair:
    return DRAWINGS[kind].pair()


def _cycle(kind: str, **parts) -> jg.MeshCycle:
    model = jg.PairModel(_pair(kind), parts.pop("torque", TORQUE[kind]), compliance=LAW, **parts)
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=8, slices=6))
    assert bool(jnp.all(cycle.converged))
    return cycle


def _error(cycle: jg.MeshCycle) -> np.ndarray:
    return np.asarray(jg.transmission_error(cycle.system.pair, cycle))


def _face_load(cycle: jg.MeshCycle) -> np.ndarray:
    force = np.asarray(cycle.force).reshape(cycle.cells.lines.roll.shape)
    return np.einsum("p,pls->s", np.asarray(cycle.cells.lines.weight), force)


def _straddle(
    left: float,
    right: float,
    *,
    bearings: tuple[jg.Bearing, jg.Bearing] | None = None,
    force=(0.0, 0.0, 0.0),
    moment=(0.0, 0.0, 0.0),
    diameter: float = 30 * mm,
    young: float = 206e9,
    width: float | None = None,
) -> jg.Shaft:
    """The gear between two bearings, `left` from the one and `right` from the other."""
    if bearings is None:
        bearings = (
            jg.Bearing(0.0, 3e8, 5e8, 1e8),
            jg.Bearing(0.0, 7e8, 2e8),
        )
    placed = [
        eqx.tree_at(lambda b: b.at, bearing, jnp.asarray(at))
        for bearing, at in zip(bearings, (0.0, left + right), strict=True)
    ]
    return jg.Shaft(
        [jg.Segment(left + right, diameter, 6 * mm)],
        placed,
        left,
        loads=[] if width is not None else [jg.ShaftLoad(left, force, moment)],
        material=jg.Material(young, 0.3),
        body_width=width,
    )


def _on_one_bearing(bearing: jg.Bearing, force=(0.0,) * 3, moment=(0.0,) * 3) -> jg.Shaft:
    """A stub with its only bearing, and a load, right under the gear."""
    at = jnp.asarray(20 * mm)
    bearing = eqx.tree_at(lambda b: b.at, bearing, at)
    loads = [jg.ShaftLoad(at, force, moment)]
    return jg.Shaft([jg.Segment(40 * mm, 20 * mm)], [bearing], at, loads=loads)


SUPPORT = jg.Support(radial_s=2e8, radial_t=5e8, axial=1e8, tilt=3e5)
SAME = jg.Bearing(0.0, 2e8, 5e8, 1e8, 3e5, 3e5)


# --- the pair as one rigid body, and as a train of gears


def _beam_system(kind: str) -> jg.PairSystem:
    pair, drawing = _pair(kind), DRAWINGS[kind]
    wide = [1.2 * drawing.face_width[0], 1.1 * drawing.face_width[1]]
    roots = (55 * mm, 100 * mm) if kind == "spur" else (84 * mm, 168 * mm)
    return _system(
        pair,
        jnp.asarray(TORQUE[kind]),
        _straddle(30 * mm, 40 * mm, width=wide[0]),
        _straddle(50 * mm, 30 * mm, width=wide[1]),
        pinion_body=jg.BeamBody(wide[0], roots[0]),
        wheel_body=jg.BeamBody(wide[1], roots[1]),
    )


@functools.cache
def _systems(kind: str) -> dict[str, jg.PairSystem]:
    rigid = _system(_pair(kind), jnp.asarray(TORQUE[kind]))
    return {"rigid": rigid, "beams": _beam_system(kind)}


def _heights(system: jg.PairSystem, kind: str) -> list[float]:
    """Height above mid-face of each gear node, pinion then wheel."""
    if not system.bends:
        return [0.0, 0.0]
    first, second = 0.6 * DRAWINGS[kind].face_width[0], 0.55 * DRAWINGS[kind].face_width[1]
    return [-first, first, -second, second]


def _approach(system: jg.PairSystem, kind: str, motion: np.ndarray) -> np.ndarray:
    """Approach of every cell under a motion of the gear nodes."""
    pair = _pair(kind)
    cells = eqx.filter_jit(jg.mesh_cells)(
        pair, jg.mesh_grid(pair, phases=8, slices=6), LAW, jnp.asarray(1e5)
    )
    coordinates = motion @ np.asarray(system.vectors)
    return np.asarray(system.arms(cells)) @ coordinates


def _moving_together(system: jg.PairSystem, kind: str, shift, turn) -> np.ndarray:
    """Node motions when pinion, wheel and all move as one body about the pinion's centre."""
    heights = _heights(system, kind)
    nodes = []
    for index, z in enumerate(heights):
        centre = 0.0 if index < len(heights) / 2 else DRAWINGS[kind].centre_distance
        nodes.append(np.concatenate([shift + np.cross(turn, [centre, 0.0, z]), turn]))
    return np.concatenate(nodes)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("spur", marks=pytest.mark.slow), "helical"])
@pytest.mark.parametrize("body", quick(1, ["beams", "rigid"]))
def test_motions_that_leave_the_flanks_where_they_are(kind, body):
    """No cell comes closer: all as one body, gears in their ratio, gliding along the contact."""
    system, drawing = _systems(kind)[body], DRAWINGS[kind]
    heights = _heights(system, kind)
    half = len(heights) // 2
    rng = np.random.default_rng(1)
    for _ in range(4):
        shift, turn = rng.normal(size=3), rng.normal(size=3)
        motion = _moving_together(system, kind, shift, turn)
        assert np.abs(_approach(system, kind, motion)).max() < 1e-12
    # r_b1 theta_1 + r_b2 theta_2 = 0.
    rolling = np.zeros((2 * half, 6))
    rolling[:half, 5], rolling[half:, 5] = drawing.base_radius[1], -drawing.base_radius[0]
    assert np.abs(_approach(system, kind, rolling.ravel())).max() < 1e-15
    # The pinion along its contact lines, and square to the path in the transverse plane.
    sine, cosine = math.sin(drawing.working_angle), math.cos(drawing.working_angle)
    tilt = drawing.base_helix
    line = [math.sin(tilt) * sine, math.sin(tilt) * cosine, math.cos(tilt)]
    for direction in (line, [cosine, -sine, 0.0]):
        gliding = np.zeros((2 * half, 6))
        gliding[:half, :3] = direction
        assert np.abs(_approach(system, kind, gliding.ravel())).max() < 1e-13
    # And one that does close: along the normal, by all of it.
    closing = np.zeros((2 * half, 6))
    normal = [math.cos(tilt) * sine, math.cos(tilt) * cosine, -math.sin(tilt)]
    closing[:half, :3] = normal
    found = _approach(system, kind, closing.ravel())
    assert_close(found, np.ones_like(found), rtol=1e-12, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["helical", "spur"])
def test_seven_coefficients_are_the_motion_of_every_point(kind):
    """n.(u + w x r) by plane vectors at 50 points of the base plane, for random end motions."""
    system, drawing, pair = _systems(kind)["beams"], DRAWINGS[kind], _pair(kind)
    rng = np.random.default_rng(2)
    motion = rng.normal(size=24) * np.tile([1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3], 4)
    coordinates = motion @ np.asarray(system.vectors)
    z = rng.uniform(-0.5, 0.5, 50) * drawing.common_width
    x = float(pair.path_start) + rng.uniform(0.0, 1.0, 50) * float(pair.path_of_contact)
    basis = np.stack(jax.jit(beam_basis)(pair, jnp.asarray(z), jnp.asarray(x)), axis=1)
    found = basis @ coordinates
    alpha, beta = drawing.working_angle, drawing.base_helix
    along = np.array([math.sin(alpha), math.cos(alpha), 0.0])
    normal = math.cos(beta) * along - np.array([0.0, 0.0, math.sin(beta)])
    # From the pinion's axis: the base tangent point, then x along the path.
    foot = drawing.base_radius[0] * np.array([math.cos(alpha), -math.sin(alpha), 0.0])
    expected = np.zeros(50)
    widths = (1.2 * drawing.face_width[0], 1.1 * drawing.face_width[1])
    roots = (55 * mm, 100 * mm) if kind == "spur" else (84 * mm, 168 * mm)
    shapes = jax.jit(jax.vmap(beam_shapes, (None, 0)))
    for gear, (width, root) in enumerate(zip(widths, roots, strict=True)):
        shear = cowper_coefficient(jnp.asarray(root), jnp.asarray(6 * mm), jnp.asarray(0.3))
        length, outer, inner = (jnp.asarray(v) for v in (width, root, 6 * mm))
        beam = Beam(length, outer, inner, shear, jg.Material())
        sections = np.asarray(shapes(beam, jnp.asarray(0.5 + z / width)))
        moved = sections @ motion[12 * gear : 12 * gear + 12]
        arm = foot[None] + x[:, None] * along - gear * np.array([drawing.centre_distance, 0, 0])
        point = moved[:, :3] + np.cross(moved[:, 3:], arm)
        expected += (1.0 - 2.0 * gear) * point @ normal
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


# --- equilibrium


def _equilibrium(cycle: jg.MeshCycle, kind: str, shafts) -> None:
    """Bearings, mesh and loads from outside of each gear sum to nothing, at every phase."""
    drawing = DRAWINGS[kind]
    alpha, beta = drawing.working_angle, drawing.base_helix
    along = np.array([math.sin(alpha), math.cos(alpha), 0.0])
    normal = math.cos(beta) * along - np.array([0.0, 0.0, math.sin(beta)])
    foot = drawing.base_radius[0] * np.array([math.cos(alpha), -math.sin(alpha), 0.0])
    lines = cycle.cells.lines
    force = np.asarray(cycle.force).reshape(lines.roll.shape)
    place = np.zeros((*lines.roll.shape, 3)) + foot
    place += np.asarray(lines.roll)[..., None] * along
    place[..., 2] += np.asarray(lines.face_position)
    load = np.asarray(_bearings(cycle.system, cycle.load))
    size = force.sum(axis=(1, 2)).max()
    first = 0
    for gear, shaft in enumerate(shafts):
        own = place - gear * np.array([drawing.centre_distance, 0.0, 0.0])
        on_gear = -(1.0 - 2.0 * gear) * force[..., None] * normal
        total = on_gear.sum(axis=(1, 2))
        moment = np.cross(own, on_gear).sum(axis=(1, 2))
        # The mesh turns the gear against its drive: all of it, about Z.
        torque = -TORQUE[kind] * (drawing.teeth[gear] / drawing.teeth[0])
        assert_close(moment[:, 2], np.full(moment.shape[0], torque), rtol=1e-8, atol=0.0)
        for extra in shaft.loads:
            at = np.array([0.0, 0.0, float(extra.at - shaft.gear_at)])
            total = total + np.asarray(extra.force)
            moment = moment + np.asarray(extra.moment) + np.cross(at, np.asarray(extra.force))
        for index, bearing in enumerate(shaft.bearings):
            on_bearing = load[:, first + index]
            at = np.array([0.0, 0.0, float(bearing.at - shaft.gear_at)])
            total = total - on_bearing[:, :3]
            moment = moment - np.cross(at, on_bearing[:, :3])
            moment[:, :2] -= on_bearing[:, 3:]
        assert np.abs(total).max() < 1e-8 * size
        assert np.abs(moment[:, :2]).max() < 1e-8 * size * 0.01
        first += len(shaft.bearings)


@pytest.mark.slow
@pytest.mark.parametrize("body", ["beam", "rigid"])
def test_every_shaft_is_in_equilibrium(body):
    """Helical, misaligned, loaded from outside: forces and couples about both bearings' plane."""
    width = None if body == "rigid" else 44 * mm
    wheel = _straddle(35 * mm, 60 * mm, force=(900.0, -400.0, 250.0), moment=(15.0, -8.0, 0.0))
    pinion = _straddle(30 * mm, 45 * mm, width=width)
    parts = {} if body == "rigid" else {"pinion_body": jg.BeamBody(width, 84 * mm)}
    cycle = _cycle(
        "helical",
        pinion_support=pinion,
        wheel_support=wheel,
        misalignment=jg.Misalignment(8 * um, -15 * um),
        **parts,
    )
    _equilibrium(cycle, "helical", (pinion, wheel))


@pytest.mark.slow
def test_bearing_totals_of_the_power_pair():
    """Tables III-6 and III-7: S 3444.5, T 6829.5 N on either gear, whatever the shaft."""
    for left, diameter in ((30 * mm, 30 * mm), (60 * mm, 12 * mm)):
        shaft = _straddle(left, 45 * mm, diameter=diameter)
        cycle = _cycle("helical", pinion_support=shaft, wheel_support=shaft)
        load = np.asarray(_bearings(cycle.system, cycle.load))
        wheel = load[:, 2:, :3].sum(axis=1)
        assert_close(wheel[:, :2], np.tile([3444.5, 6829.5], (8, 1)), rtol=1e-3, atol=0.0)
        assert_close(load[:, :2, :3].sum(axis=1), -wheel, rtol=1e-8, atol=1e-4)
        # Only the first bearing of each holds along Z: F_t tan(beta_b).
        axial = 7648.4 * math.tan(math.radians(10.861291))
        assert_close(load[:, 0, 2], np.full(8, axial), rtol=1e-4, atol=0.0)
        assert_close(load[:, 2, 2], np.full(8, -axial), rtol=1e-4, atol=0.0)
        assert np.abs(load[:, [1, 3], 2]).max() < 1e-6


@pytest.mark.slow
def test_lever_rule():
    """Rigid shafts: a gear at 1/4 of the span loads its bearings 3 to 1, along the path."""
    pinned = (jg.Bearing(0.0, 1e13, 1e13, 1e13), jg.Bearing(0.0, 1e13, 1e13))
    shaft = _straddle(20 * mm, 60 * mm, bearings=pinned, young=1e19)
    cycle = _cycle("spur", pinion_support=shaft, wheel_support=shaft)
    load = np.asarray(_bearings(cycle.system, cycle.load))[:, :2, :2]
    alpha, force = ACCESSORY.working_angle, ACCESSORY.force(80.0)
    along = -force * np.array([math.sin(alpha), math.cos(alpha)])
    expected = np.stack([0.75 * along, 0.25 * along])
    assert_close(load, np.broadcast_to(expected, load.shape), rtol=1e-4, atol=0.0)


# --- supports and shafts as limits of each other


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("spur", marks=pytest.mark.slow), "helical"])
def test_a_bearing_under_the_gear_is_a_support_at_its_centre(kind):
    more = {"misalignment": jg.Misalignment(8 * um, -15 * um)}
    springs = _cycle(kind, pinion_support=SUPPORT, wheel_support=SUPPORT, **more)
    stub = _on_one_bearing(SAME)
    shafts = _cycle(kind, pinion_support=stub, wheel_support=stub, **more)
    assert_close(shafts.approach, springs.approach, rtol=1e-9, atol=0.0)
    assert_close(shafts.force, springs.force, rtol=1e-7, atol=1e-5)


@pytest.mark.slow
def test_very_stiff_shafts_are_no_shafts():
    """Shaft and bearings a hundred to ten thousand times stiffer: TE tends to the rigid one."""
    rigid = _error(_cycle("helical"))
    factors = np.array([1e2, 1e3, 1e4])
    off = []
    for factor in factors:
        first = jg.Bearing(0.0, 3e8 * factor, 5e8 * factor, 1e8 * factor)
        bearings = first, jg.Bearing(0.0, 3e8 * factor, 5e8 * factor)
        shaft = _straddle(30 * mm, 45 * mm, bearings=bearings, young=206e9 * factor)
        error = _error(_cycle("helical", pinion_support=shaft, wheel_support=shaft))
        off.append(np.abs(error / rigid - 1.0).max())
    assert 0.95 < observed_order(1.0 / factors, off) < 1.05
    assert off[-1] < 1e-3


@pytest.mark.slow
def test_a_housing_is_in_series():
    """Bearings k on a housing of h: as bearings of k h/(k + h)."""
    soft = 4e8
    shaft = _straddle(30 * mm, 45 * mm)
    behind = jg.Housing(soft * jnp.eye(12))
    elastic = _cycle("helical", pinion_support=shaft, wheel_support=shaft, housing=behind)
    series = lambda k: k * soft / (k + soft)
    bearings = (
        jg.Bearing(0.0, series(3e8), series(5e8), series(1e8)),
        jg.Bearing(0.0, series(7e8), series(2e8)),
    )
    same = _straddle(30 * mm, 45 * mm, bearings=bearings)
    other = _cycle("helical", pinion_support=same, wheel_support=same)
    assert_close(elastic.approach, other.approach, rtol=1e-9, atol=0.0)
    assert_close(elastic.force, other.force, rtol=1e-7, atol=1e-5)


# --- signs


def test_a_load_from_outside_moves_the_gear_and_the_error():
    """P along S on the pinion, k = 2e8: it comes P/k closer, TE falls by sin(alpha) P/k."""
    wheel = _on_one_bearing(SAME)
    plain = _error(_cycle("spur", pinion_support=_on_one_bearing(SAME), wheel_support=wheel))
    for force, give in (((500.0, 0.0, 0.0), 1 / 2e8), ((0.0, 500.0, 0.0), 1 / 5e8)):
        loaded = _on_one_bearing(SAME, force=force)
        error = _error(_cycle("spur", pinion_support=loaded, wheel_support=wheel))
        angle = ACCESSORY.working_angle
        share = math.sin(angle) if force[0] else math.cos(angle)
        assert_close(error, plain - share * 500.0 * give, rtol=1e-9, atol=0.0)
        # On the wheel the same force takes it away.
        error = _error(_cycle("spur", pinion_support=_on_one_bearing(SAME), wheel_support=loaded))
        assert_close(error, plain + share * 500.0 * give, rtol=1e-9, atol=0.0)


def test_tilting_moments_undo_a_misalignment_in_both_planes():
    """The wheel's shift (i, d) across b: the pinion follows, by -d/b and i/b about S and T."""
    inclination, deviation, width = 10 * um, -16 * um, ACCESSORY.common_width
    moment = (-3e5 * deviation / width, 3e5 * inclination / width, 0.0)
    wheel = _on_one_bearing(SAME)
    straight = _cycle("spur", pinion_support=_on_one_bearing(SAME), wheel_support=wheel)
    turned = _cycle(
        "spur",
        pinion_support=_on_one_bearing(SAME, moment=moment),
        wheel_support=wheel,
        misalignment=jg.Misalignment(inclination, deviation),
    )
    assert_close(turned.approach, straight.approach, rtol=1e-9, atol=0.0)
    assert_close(turned.force, straight.force, rtol=1e-7, atol=1e-6)
    only = _cycle(
        "spur",
        pinion_support=_on_one_bearing(SAME),
        wheel_support=wheel,
        misalignment=jg.Misalignment(inclination, deviation),
    )
    load = _face_load(only)
    assert load.max() > 1.02 * load.mean()


@pytest.mark.slow
def test_a_gear_in_the_middle_is_loaded_evenly():
    """Spur on equal bearings at equal distances: symmetric, and even, whatever bends."""
    equal = (jg.Bearing(0.0, 3e8, 5e8, 1e8), jg.Bearing(0.0, 3e8, 5e8))
    shaft = _straddle(40 * mm, 40 * mm, bearings=equal, diameter=15 * mm)
    load = _face_load(_cycle("spur", pinion_support=shaft, wheel_support=shaft))
    assert_close(load, np.full(6, load.mean()), rtol=1e-8, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("side", [pytest.param(1.0, marks=pytest.mark.slow), -1.0])
def test_an_overhung_gear_gives_way_at_its_free_end(side):
    """The mesh bends the pinion's shaft away: the end of the face towards the bearings carries."""
    reach = 30 * mm
    places = (0.0, 50 * mm) if side > 0 else (reach, reach + 50 * mm)
    at = 50 * mm + reach if side > 0 else 0.0
    bearings = [
        jg.Bearing(places[0], 1e10, 1e10, 1e10),
        jg.Bearing(places[1], 1e10, 1e10),
    ]
    shaft = jg.Shaft([jg.Segment(80 * mm, 24 * mm)], bearings, at)
    load = _face_load(_cycle("spur", pinion_support=shaft))
    assert np.all(side * np.diff(load) < 0.0)
    # Tilt by hand, the load taken as even: F (a L/3 + a^2/2)/(E I) about the end of the overhang.
    second = math.pi / 64 * (24 * mm) ** 4
    tilt = ACCESSORY.force(80.0) * (reach * 50 * mm / 3 + reach**2 / 2) / (206e9 * second)
    pairs = ACCESSORY.contact_ratio
    slope = -side * tilt * STIFFNESS * pairs * ACCESSORY.common_width / 6
    found = np.polyfit(np.asarray(np.arange(6)) * ACCESSORY.common_width / 6, load, 1)[0]
    assert_close(found, slope, rtol=9e-2, atol=0.0)


# --- bodies that bend and twist


@pytest.mark.slow
def test_a_stiff_beam_is_a_rigid_body():
    """Shaft and body 10 to 1000 times stiffer, bearings as they are."""
    rigid_shaft = _straddle(30 * mm, 45 * mm, young=1e19)
    rigid = _cycle("helical", pinion_support=rigid_shaft)
    factors = np.array([1e1, 1e2, 1e3])
    off = []
    for factor in factors:
        stiff = jg.Material(206e9 * factor, 0.3)
        body = jg.BeamBody(44 * mm, 84 * mm, stiff)
        shaft = _straddle(30 * mm, 45 * mm, young=206e9 * factor, width=44 * mm)
        cycle = _cycle("helical", pinion_support=shaft, pinion_body=body)
        off.append(np.abs(_error(cycle) / _error(rigid) - 1.0).max())
    assert 0.95 < observed_order(1.0 / factors, off) < 1.05
    assert off[-1] < 2e-4


def _twisted(size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A spur pinion held at its ends against bending, driven from the left, on a rigid wheel.

    `size` is mu b, mu^2 = k' r_b^2/(G J). In single contact: places of the slices from -1 to 1,
    their loads over the mean, the same from the differential equation, and the twist between the
    ends over that of the equation.
    """
    width, inner, outer = ACCESSORY.common_width, 6 * mm, 55 * mm
    radius = ACCESSORY.base_radius[0]
    polar, area = math.pi / 32 * (outer**4 - inner**4), math.pi / 4 * (outer**2 - inner**2)
    modulus = STIFFNESS * radius**2 * width**2 / (size**2 * polar)
    kappa = 0.9
    held = [jg.Bearing(x, 1e15, 1e15, 1e15, 1e13, 1e13) for x in (0.0, width)]
    shaft = jg.Shaft(
        [jg.Segment(width, 20 * mm, inner)], held, 0.5 * width, 0.0, (), kappa, body_width=width
    )
    body = jg.BeamBody(width, outer, jg.Material(2.6 * modulus, 0.3))
    pair = eqx.tree_at(lambda p: p.pinion.face_width, _pair("spur"), jnp.asarray(width))
    model = jg.PairModel(pair, 80.0, compliance=LAW, pinion_support=shaft, pinion_body=body)
    cycle = run_cycle(model, jg.mesh_grid(pair, phases=8, slices=20))
    lines = cycle.cells.lines
    alone = int(np.flatnonzero((np.asarray(lines.fraction)[:, :, 0] > 1e-6).sum(axis=1) == 1)[0])
    load = np.asarray(cycle.force).reshape(lines.roll.shape)[alone].sum(axis=0)
    nodes = cycle.system.structure.map.dofs
    motion = np.asarray(cycle.system.displacement(cycle.load))[alone]
    ends = [motion[nodes[f"pinion gear {side}"] + 5] for side in ("left", "right")]
    place = 2 * np.asarray(lines.face_position) / width
    field, twist = _twist_and_shear(modulus * polar, kappa * modulus * area, radius, width)
    expected = field(0.5 * place * width)
    return place, load / load.mean(), expected / expected.mean(), (ends[0] - ends[1]) / twist


def _twist_and_shear(torsion: float, shear: float, radius: float, width: float):
    """Approach a(z) = r_b theta + v, and theta(-b/2) - theta(b/2), from the equations.

    G J theta'' = r_b k' a, kappa G A v'' = k' a; theta' = -T/(G J) on the left, 0 on the right,
    v = 0 at both ends. With nu^2 = k' (r_b^2/(G J) + 1/(kappa G A)), a is A cosh + B sinh of nu z
    and theta is r_b k' a/(G J nu^2) + c + d z, which v makes up for.
    """
    rate = math.sqrt(STIFFNESS * (radius**2 / torsion + 1.0 / shear))
    turn, slip = (STIFFNESS * x / rate**2 for x in (radius / torsion, 1.0 / shear))
    half = 0.5 * width
    cosh, sinh = math.cosh(rate * half), math.sinh(rate * half)
    matrix = [
        [-turn * rate * sinh, turn * rate * cosh, 0.0, 1.0],
        [turn * rate * sinh, turn * rate * cosh, 0.0, 1.0],
        [slip * cosh, -slip * sinh, -radius, radius * half],
        [slip * cosh, slip * sinh, -radius, -radius * half],
    ]
    even, odd, _, drift = np.linalg.solve(matrix, [-80.0 / torsion, 0.0, 0.0, 0.0])
    twist = -2.0 * (turn * odd * sinh + drift * half)
    return lambda z: even * np.cosh(rate * z) + odd * np.sinh(rate * z), twist


@pytest.mark.slow
@pytest.mark.parametrize(("size", "within"), [(0.2, 1.5e-3), (0.5, 6e-3), (1.0, 2e-2), (2.0, 6e-2)])
def test_a_twisted_body_against_the_differential_equation(size, within):
    """Uneven load of a body driven from one end, as part of its own excess at that end.

    The element has the parabola that an even load gives; what an uneven one adds is of the
    relative order (mu b)^2, and the twist between the ends is better than that.
    """
    place, load, expected, twist = _twisted(size)
    assert place[0] < 0.0
    assert expected[0] > expected[-1]
    excess = expected[0] - 1.0
    # Torsion alone, about mu b coth(mu b) - 1 at the very end, and the shear on top.
    assert excess > 0.8 * (size / math.tanh(size) - 1.0)
    assert np.abs(load - expected).max() < within * excess
    assert abs(twist - 1.0) < 0.5 * within
