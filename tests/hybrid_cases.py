"""Small condensed gear bodies, and the pairs whose teeth stand on them.

The wheel has a thin web off the middle of its rim, and the numbers of teeth are small: nothing
cancels by accident, and whole stiffness matrices are inverted in a moment.
"""

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
import scipy.linalg
from fem_cases import STEEL, ring

import jaxgear as jg
from fem_prep import (
    FullBody,
    HeatedBody,
    ReducedBody,
    Seat,
    condense,
    fixed_interface,
    full_body,
    heated_body,
)
from jaxgear import deg, mm, um
from jaxgear._contact._cells import mesh_gap
from jaxgear._dynamics._march import quasi_static_start
from jaxgear._dynamics._system import PairDynamics
from jaxgear._interface._roots import ROOT_POINTS, Axial, RimSurface, interface_map
from jaxgear._system._body_modes import BodyBasis, body_basis
from jaxgear._system._body_tables import flexible_body, root_patches
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._model import PairModel

TEETH = (20, 24)
FACE = 10e-3
# Of the wheel on a shaft: places of three bearings and of the torque, from mid-face [m].
BEARINGS_AT, TORQUE_AT = (-26e-3, 14e-3, 27e-3), -15e-3


@functools.cache
def spur() -> jg.GearPair:
    """20 and 24 teeth, shifted."""
    return _pair(0.0)


@functools.cache
def helical() -> jg.GearPair:
    """The same at 18 degrees: an overlap of a half."""
    return _pair(18.0)


def _pair(helix: float) -> jg.GearPair:
    pinion, wheel = jg.Gear(TEETH[0], 12.0 * mm, 0.2), jg.Gear(TEETH[1], FACE, 0.1)
    return jg.GearPair(pinion, wheel, 2.0 * mm, 20.0 * deg, helix * deg)


PAIRS = {"spur": spur, "helical": helical}
# Slices on their own, as the dense judges know them.
APART = jg.WeberBanaschek(face_coupling=None)


@functools.cache
def body(
    kind: str = "spur",
    index: int = 1,
    *,
    seats: str = "bore",
    holes: int = 0,
    further: int = 0,
    modes: int = 0,
    layers: int = 2,
    rotating: bool = False,
) -> ReducedBody:
    """A condensed body of the pinion or the wheel.

    `full` says of what; and:

    **Arguments:**

    - `modes`: interior shapes beside the static ones; none: static condensation.
    - `rotating`: with the terms of rotation.
    """
    method = "craig-bampton" if modes else "guyan"
    shape: dict = {"seats": seats, "holes": holes, "further": further, "layers": layers}
    return condense(full(kind, index, **shape), method=method, modes=modes, rotating=rotating)


@functools.cache
def heated(kind: str = "spur", index: int = 1, *, modes: int = 0, **shape) -> HeatedBody:
    """What heat does to `body`; its hub is up to the web."""
    own, root = body(kind, index, modes=modes, **shape), float(PAIRS[kind]().root_radius[index])
    return heated_body(fixed_interface(full(kind, index, **shape)), own, 0.42 * root)


@functools.cache
def full(
    kind: str = "spur",
    index: int = 1,
    *,
    seats: str = "bore",
    holes: int = 0,
    further: int = 0,
    layers: int = 2,
) -> FullBody:
    """A body of the pinion or the wheel in all its unknowns.

    **Arguments:**

    - `kind`: of the teeth.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `seats`: "bore" is one ring, "mean" one that averages, "shaft" three bearings and the torque.
    - `holes`: in the web, equal and equally far apart.
    - `further`: the same of a second ring, further out, each between two of the first.
    - `layers`: elements across the rim.
    """
    teeth = TEETH[index]
    root = float(PAIRS[kind]().root_radius[index])
    hub, middle, rim = 0.42 * root, 0.65 * root, 0.88 * root
    half = 6e-3
    web = (-1e-3, 2e-3)
    inner = np.union1d(np.linspace(-half, half, layers + 1), web)
    outer = 30e-3 * np.array([-1.0, -0.6, 0.6, 1.0]) if seats == "shaft" else []
    heights = np.union1d(inner, outer)

    def keep(at: np.ndarray) -> np.ndarray:
        r, angle, z = at.T
        in_face, in_web = abs(z) < half, (z > web[0]) & (z < web[1])
        solid = (r < hub) | (in_face & ((r > rim) | in_web))
        number = np.round(angle * teeth / (2.0 * np.pi)).astype(int)
        for count, first, low, high in (
            (holes, 0, hub, middle if further else rim),
            (further, teeth // (2 * max(further, 1)), middle, rim),
        ):
            if count:
                opened = (number - first) % (teeth // count) == 0
                solid &= ~(opened & (r > low) & (r < high))
        return solid

    grid = ring([0.25 * root, hub, middle, rim, root], teeth, heights, keep=keep)
    return full_body(f"{kind} {index}", grid, STEEL, _seats(grid, seats))


def _seats(grid, seats: str) -> list[Seat]:
    bore = grid.sets["bore"]
    if seats != "shaft":
        return [Seat("bore", bore, np.zeros(3), seats == "mean")]
    z = grid.nodes[bore, 2]
    bands = {
        "bearing[0]": (z < -20e-3, BEARINGS_AT[0]),
        "torque": ((z > -20e-3) & (z < -10e-3), TORQUE_AT),
        "bearing[1]": ((z > 7e-3) & (z < 19e-3), BEARINGS_AT[1]),
        "bearing[2]": (z > 20e-3, BEARINGS_AT[2]),
    }
    # A seat that averages leaves the bore as flexible as it is.
    return [
        Seat(name, bore[inside], np.array([0.0, 0.0, at]), True)
        for name, (inside, at) in bands.items()
    ]


def stiffened(body: ReducedBody, factor: float) -> ReducedBody:
    """The same body of another Young's modulus."""
    return dataclasses.replace(body, stiffness=factor * body.stiffness)


def shaft() -> jg.Shaft:
    """Three unequal bearings under a body with seats for a shaft, the second one axial too."""
    bearings = [
        jg.Bearing((30.0 + 1e3 * at) * mm, 2e8 * (i + 1), 3e8, 1e8 if i == 1 else 0.0)
        for i, at in enumerate(BEARINGS_AT)
    ]
    return jg.Shaft([jg.Segment(60.0 * mm, 8.0 * mm)], bearings, gear_at=30.0 * mm)


# Of the next stage, on the wheel's shaft [N, N m].
FORCE, MOMENT = np.array([300.0, -200.0, 150.0]), np.array([1.0, 2.0, 0.7])


def loaded_shaft(beside: float) -> jg.Shaft:
    """The same with a load, so far beside the seat of the torque [m]."""
    given, load = shaft(), jg.ShaftLoad(30e-3 + TORQUE_AT + beside, FORCE, MOMENT)
    return jg.Shaft(given.segments, given.bearings, given.gear_at, None, [load])


def shaft_springs() -> np.ndarray:
    """The same on the body's seats, along and about S, T, Z."""
    springs = np.zeros((4, 6))
    for seat, (i, axial) in {0: (0, 0.0), 2: (1, 1e8), 3: (2, 0.0)}.items():
        springs[seat, :3] = 2e8 * (i + 1), 3e8, axial
    return springs


# --- The same mechanics in plain NumPy, with every degree of freedom of the bodies


class Gear(NamedTuple):
    """One gear of a dense reference.

    `body` is `None` for a rigid one; `springs` hold its seats, or its centre, along and about S, T,
    Z, shape `[seat, 6]`, infinite where they are rigid; `gear_seat` is the seat that turns with it;
    `load` is on its coordinates whatever the speed.
    """

    body: ReducedBody | None
    springs: np.ndarray
    gear_seat: int = 0
    load: np.ndarray | float = 0.0


class DenseState(NamedTuple):
    """Motion of a dense reference: approach, cell forces, seats of both gears in S, T, Z."""

    approach: float
    force: np.ndarray
    seats: tuple[np.ndarray, np.ndarray]


def _turn(angle: float) -> np.ndarray:
    """Components along S, T, Z from those in a frame that has turned."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class Dense:
    """Two gears in mesh with all unknowns of their bodies, built from the drawing.

    **Arguments:**

    - `pair`, `grid`: as in the model.
    - `gears`: pinion and wheel.
    - `lines`: places of the cells.
    - `points`, `axial`: of the connection.
    """

    def __init__(
        self, pair, grid, gears, lines, points: int = ROOT_POINTS, axial: Axial = "mortar"
    ):
        self.pair, self.grid, self.gears = pair, grid, gears
        self.points: int = points
        self.axial: Axial = axial
        self.roll = np.asarray(lines.roll)
        self.heights = np.asarray(lines.face_position)
        self.phase = np.asarray(lines.phase)
        self.alpha = float(pair.working_pressure_angle)
        self.helix = float(pair.base_helix_angle)
        self.base = [float(x) for x in pair.base_radius]
        self.path = np.array([math.sin(self.alpha), math.cos(self.alpha), 0.0])
        self.normal = math.cos(self.helix) * self.path - math.sin(self.helix) * np.eye(3)[2]

    def _points(self, index: int, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Points of contact from the centre of a gear, along S, T, Z."""
        start = self.base[0] * np.array([math.cos(self.alpha), -math.sin(self.alpha), 0.0])
        away = np.array([index * sum(self.base) / math.cos(self.alpha), 0.0, 0.0])
        return start - away + x[..., None] * self.path + z[..., None] * np.eye(3)[2]

    def _middle(self, index: int, at: np.ndarray) -> np.ndarray:
        """Angle of the middle of the tooth whose flank is touched at a point."""
        pair = self.pair
        gear = (pair.pinion, pair.wheel)[index]
        cosine, tangent = math.cos(float(pair.helix_angle)), math.tan(float(pair.pressure_angle))
        transverse = math.atan(tangent / cosine)
        half = (0.5 * math.pi + 2.0 * float(gear.profile_shift) * tangent) / gear.teeth
        # Signed: cells that are not in contact may lie beyond the base tangent point.
        here = np.arctan((1.0, -1.0)[index] * (at @ self.path) / self.base[index])
        thick = half + math.tan(transverse) - transverse - (np.tan(here) - here)
        return np.arctan2(at[..., 1], at[..., 0]) - thick

    def turned(self, index: int, phase: int) -> float:
        """Angle of the body's own x against S: tooth 0 enters at phase 0."""
        first = np.asarray(float(self.pair.path_start))
        begin = self._middle(index, self._points(index, first, np.zeros(())))
        step = 2.0 * math.pi / TEETH[index] * float(self.phase[phase])
        return float(begin) + (step if index == 0 else -step)

    def rows(self, index: int, phase: int) -> np.ndarray:
        """Overlap of the cells per coordinate of a gear: of its body, or of its centre."""
        x = self.roll[phase]
        z = np.broadcast_to(self.heights, x.shape)
        at = self._points(index, x, z)
        normal = (1.0, -1.0)[index] * self.normal
        body = self.gears[index].body
        if body is None:
            turning = np.cross(at, np.broadcast_to(normal, at.shape))
            both = np.concatenate([np.broadcast_to(normal, at.shape), turning], axis=-1)
            return both.reshape(-1, 6)
        middle = self._middle(index, at)
        twist = (1.0, -1.0)[index] * math.tan(self.helix) / self.base[index] * self.heights
        angle = middle - self.turned(index, phase)
        tooth = (angle - twist) * TEETH[index] / (2.0 * math.pi)
        assert abs(tooth - np.round(tooth)).max() < 1e-9
        own = root_patches(
            self.pair, index, self.grid, np.zeros(1, int), points=self.points, axial=self.axial
        )
        patches = dataclasses.replace(own, angles=angle)
        found = interface_map(RimSurface(body.rim_nodes, body.rim_faces), patches)
        rows = np.zeros((x.size, body.dofs))
        follow = found.rows.toarray()
        for cell, (point, turn) in enumerate(zip(at.reshape(-1, 3), middle.ravel(), strict=True)):
            into = _turn(turn).T
            push = into @ normal
            moment = np.cross(into @ point - found.centres[cell], push)
            load = np.concatenate([push, moment])
            rows[cell, : follow.shape[1]] = load @ follow[6 * cell : 6 * cell + 6]
        return rows

    def held(self, index: int, phase: int) -> tuple[np.ndarray, np.ndarray, int]:
        """Stiffness of a gear on its springs, which coordinates can move, and that of rotation."""
        gear = self.gears[index]
        if gear.body is None:
            springs = gear.springs[0]
            return np.diag(np.where(np.isfinite(springs), springs, 0.0)), np.isfinite(springs), 5
        stiffness, free = gear.body.stiffness.copy(), np.ones(gear.body.dofs, dtype=bool)
        turn = np.kron(np.eye(2), _turn(self.turned(index, phase)))
        first = 3 * len(gear.body.rim_nodes)
        for seat, springs in enumerate(gear.springs):
            at = slice(first + 6 * seat, first + 6 * seat + 6)
            finite = np.isfinite(springs)
            stiffness[at, at] += turn.T @ np.diag(np.where(finite, springs, 0.0)) @ turn
            free[at] = finite
        return stiffness, free, first + 6 * gear.gear_seat + 5

    def flexibility(self, index: int, phase: int) -> np.ndarray:
        """Overlap of the cells per force on them that one gear gives, its rotation held."""
        rows = self.rows(index, phase)
        return rows @ self.answer(index, phase, rows.T)

    def answer(self, index: int, phase: int, load: np.ndarray) -> np.ndarray:
        """Motion of all coordinates of one gear under loads, its rotation held."""
        stiffness, free, rotation = self.held(index, phase)
        free[rotation] = False
        motion = np.zeros(load.shape)
        motion[free] = _solved(stiffness[np.ix_(free, free)], load[free])
        return motion

    def state(
        self, phase: int, stiffness: np.ndarray, gap: np.ndarray, torque: float, speed: float = 0.0
    ) -> DenseState:
        """Rest by the active set: closed cells are springs in the matrix, which is rebuilt."""
        parts = [self.held(index, phase) for index in (0, 1)]
        rows = [self.rows(index, phase) for index in (0, 1)]
        sizes = [len(part[0]) for part in parts]
        whole = scipy.linalg.block_diag(parts[0][0], parts[1][0])
        across = np.concatenate(rows, axis=1)
        free = np.concatenate([parts[0][1], parts[1][1]])
        free[parts[0][2]], free[sizes[0] + parts[1][2]] = True, False
        load = np.zeros(sum(sizes))
        for begin, gear, own in zip(
            (0, sizes[0]), self.gears, (speed, speed * TEETH[0] / TEETH[1]), strict=True
        ):
            if gear.body is not None:
                load[begin : begin + gear.body.dofs] = (
                    own**2 * gear.body.centrifugal_load + gear.load
                )
        load[parts[0][2]] += torque
        closed = stiffness > 0.0
        for _ in range(40):
            springs = np.where(closed, stiffness, 0.0)
            total = whole + across.T @ (springs[:, None] * across)
            right = load + across.T @ (springs * gap)
            motion = np.zeros(len(load))
            motion[free] = _solved(total[np.ix_(free, free)], right[free])
            overlap = across @ motion - gap
            before, closed = closed, (overlap > 0.0) & (stiffness > 0.0)
            if np.array_equal(before, closed):
                break
        else:
            raise AssertionError("The active set goes round.")
        turn = motion[parts[0][2]] * self.base[0] * math.cos(self.helix)
        seats = [
            self._seats(index, phase, motion[begin : begin + size])
            for index, begin, size in zip((0, 1), (0, sizes[0]), sizes, strict=True)
        ]
        return DenseState(turn, springs * overlap, (seats[0], seats[1]))

    def _seats(self, index: int, phase: int, motion: np.ndarray) -> np.ndarray:
        body = self.gears[index].body
        if body is None:
            return motion[None]
        first = 3 * len(body.rim_nodes)
        own = motion[first : first + 6 * len(body.seats)].reshape(-1, 2, 3)
        return (own @ _turn(self.turned(index, phase)).T).reshape(-1, 6)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve a positive definite system whose rows are of different units."""
    scale = 1.0 / np.sqrt(np.diagonal(matrix))
    right = (right.T * scale).T
    found = scipy.linalg.solve(scale[:, None] * matrix * scale, right, assume_a="pos")
    return (found.T * scale).T


# --- In motion

# Equally stiff all round: the same springs on a body and in space.
ROUND = jg.Support(1e8, 1e8, 3e8, 1e5)
_ROUND = np.array([[1e8, 1e8, 3e8, 1e5, 1e5, 0.0]])


def relieved() -> jg.Flanks:
    """Flanks with tip reliefs and a crowned pinion."""
    relief = jg.TipRelief(12.0 * um, 0.3)
    return jg.Flanks(jg.Superposed(parts=(relief, jg.Crowning(5.0 * um))), relief)


@functools.cache
def basis_of(kind: str, index: int, count: int, **shape) -> BodyBasis:
    """Modes of `body`."""
    return body_basis(body(kind, index, **shape), count)


@functools.cache
def vibrating(
    kind: str, index: int, grid: jg.MeshGrid, count: int, factor: float = 1.0, **shape
) -> FlexibleBody:
    """A condensed body with modes, in mesh.

    **Arguments:**

    - `kind`, `index`, `shape`: of `body`.
    - `grid`: of the cycle.
    - `count`: of modes.
    - `factor`: of Young's modulus.
    """
    basis, own = basis_of(kind, index, count, **shape), body(kind, index, **shape)
    if factor != 1.0:
        basis = dataclasses.replace(basis, square=factor * basis.square)
        own = stiffened(own, factor)
    return flexible_body(own, PAIRS[kind](), index, grid, basis=basis)


class Turning:
    """A rigid pinion and a condensed wheel in time, on the wheel's own turning frame, in NumPy.

    Both stand on `ROUND`. All terms of rotation are in it, and damping in proportion to mass: in
    space for seats and waves of one nodal diameter or none, on the body for others.

    **Arguments:**

    - `model`, `grid`: of the pair.
    - `dynamics`: gives the cells and where the march begins.
    - `body`, `basis`: of the wheel.
    - `damping`: over the mass [1/s].
    - `every`: all modes of the body, so that all of its coordinates move; else its seats and those
        of `basis` do, and the rest of the body follows at once.
    """

    def __init__(
        self,
        model: PairModel,
        grid: jg.MeshGrid,
        dynamics: PairDynamics,
        body: ReducedBody,
        basis: BodyBasis,
        *,
        damping: float,
        every: BodyBasis | None = None,
    ):
        self.model, self.dynamics, self.basis = model, dynamics, basis
        self.grid, self.body = grid, body
        structure = dynamics.cycle.system.structure
        motions = basis.motions
        # All coordinates of the body by those that move here, and these by its seats and modes.
        own, some = np.eye(body.dofs), np.eye(motions.shape[1])
        self.moves, self.onto = (motions, some) if every is None else (own, motions)
        reduced = lambda matrix: self.moves.T @ matrix @ self.moves
        first = 3 * len(body.rim_nodes)
        on_springs = self.moves[first : first + 6].T @ np.diag(_ROUND[0]) @ self.moves[first:][:6]
        assert body.coriolis is not None
        assert body.spin_softening is not None
        assert body.stress_stiffening is not None
        both = scipy.linalg.block_diag
        pinion = np.asarray(structure.mass)[:6, :6]
        spun = np.asarray(structure.pinion_gyroscopic)[:6, :6]
        self.mass = np.asarray(both(pinion, reduced(body.mass)))
        self.stiffness = both(np.diag(_ROUND[0]), reduced(body.stiffness) + on_springs)
        softening = reduced(body.stress_stiffening - body.spin_softening)
        self.softening = both(np.zeros((6, 6)), softening)
        self.pinion_gyroscopic = both(spun, np.zeros_like(softening))
        self.coriolis = both(np.zeros((6, 6)), reduced(body.coriolis))
        spun_load = self.moves.T @ body.centrifugal_load
        self.centrifugal = np.concatenate([np.zeros(6), spun_load])
        found = basis if every is None else every
        in_space = np.concatenate([np.ones(6), found.diameters < 2])
        carried = found.turning * in_space
        if every is not None:
            carried = every.motions @ carried @ np.linalg.inv(every.motions)
        # Both turning together, which nothing holds or damps.
        radius = [float(x) for x in model.pair.base_radius]
        free = np.concatenate([np.zeros(6), -self.onto[:, 5] / radius[1]])
        free[5] = 1.0 / radius[0]
        momentum = np.asarray(self.mass @ free) / math.sqrt(free @ self.mass @ free)
        self.damping = damping * (self.mass - np.outer(momentum, momentum))
        self.carried = damping * self.mass @ both(np.zeros((6, 6)), carried)
        torque = float(model.torque)
        self.load = np.concatenate([np.zeros(6), self.moves[first + 5] * TEETH[1] / TEETH[0]])
        self.load[5] = 1.0
        self.load *= torque
        self.rest = self._rest() if every is None else None
        self._seen: dict[tuple[int, int], _Cells] = {}

    def _rest(self) -> np.ndarray:
        """Flexibility of the body, its seats held, that its modes leave out."""
        body, basis = self.body, self.basis
        seat = 3 * len(body.rim_nodes) + np.arange(6)
        inner = np.setdiff1d(np.arange(body.dofs), seat)
        rest = np.zeros((body.dofs, body.dofs))
        rest[np.ix_(inner, inner)] = np.linalg.inv(body.stiffness[np.ix_(inner, inner)])
        return rest - (basis.shapes / basis.square) @ basis.shapes.T

    def march(self, speed: float, cycles: int) -> np.ndarray:
        """Total mesh force in the middle of each step, by the midpoint rule and active sets.

        **Arguments:**

        - `speed`: of the pinion [rad/s].
        - `cycles`: mesh periods, from the quasi-static start.
        """
        own = -speed * TEETH[0] / TEETH[1]
        stiffness = self.stiffness + own**2 * self.softening + own * self.carried
        rates = self.damping + speed * self.pinion_gyroscopic + own * self.coriolis
        load = self.load + own**2 * self.centrifugal
        cells, system = self.dynamics.cycle.cells, self.dynamics.system
        springs, model = np.asarray(cells.stiffness), self.model
        gap = np.asarray(mesh_gap(model.pair, cells.lines, model.flanks, model.misalignment))
        lengths = np.asarray(system.table.lengths) * 2.0 * math.pi / (TEETH[0] * speed)
        answers: dict[int, np.ndarray] = {}
        place, rate = self._start(own)
        found = []
        for step in range(cycles * len(lengths)):
            k = step % len(lengths)
            half = 0.5 * lengths[k]
            key = round(half * 1e15)
            if key not in answers:
                answers[key] = np.linalg.inv(self.mass / half**2 + rates / half + stiffness)
            answer = answers[key]
            across, give, grown = self._cells(step // len(lengths), k)
            right = load + self.mass @ (place / half**2 + rate / half) + rates @ (place / half)
            overlap = across @ (answer @ right) + own**2 * grown - gap[k]
            force = _pressed(overlap, across @ answer @ across.T + give, springs[k])
            middle = answer @ (right - across.T @ force)
            velocity = (middle - place) / half
            place, rate = 2.0 * middle - place, 2.0 * velocity - rate
            found.append(force.sum())
        return np.array(found)

    def _dense(self, phase: float, roll: np.ndarray) -> Dense:
        """The pair at one instant."""
        gears = [Gear(None, _ROUND), Gear(self.body, _ROUND)]
        heights = np.asarray(self.dynamics.cycle.cells.lines.face_position)
        lines = _Lines(roll[None], heights, np.array([phase]))
        return Dense(self.model.pair, self.grid, gears, lines)

    def _cells(self, period: int, step: int) -> "_Cells":
        """The cells at one step of a mesh period."""
        if (period, step) not in self._seen:
            lines = self.dynamics.cycle.cells.lines
            dense = self._dense(float(lines.phase[step]) + period, np.asarray(lines.roll)[step])
            rows = dense.rows(1, 0)
            across = np.concatenate([dense.rows(0, 0), rows @ self.moves], axis=1)
            give, grown = np.zeros((len(rows), len(rows))), np.zeros(len(rows))
            if self.rest is not None:
                give, grown = (
                    rows @ self.rest @ rows.T,
                    rows @ self.rest @ self.body.centrifugal_load,
                )
            self._seen[period, step] = _Cells(across, give, grown)
        return self._seen[period, step]

    def _start(self, own: float) -> tuple[np.ndarray, np.ndarray]:
        """The quasi-static start, at rest in space: on the body all of it turns back."""
        motion = np.zeros(12 + len(self.basis.square))
        motion[list(self.dynamics.dofs)] = np.asarray(quasi_static_start(self.dynamics.system))[0]
        dense = self._dense(0.0, np.asarray(self.dynamics.cycle.cells.lines.roll)[0])
        on_body = scipy.linalg.expm(-dense.turned(1, 0) * self.basis.turning) @ motion[6:]
        turned = self.onto @ (-own * self.basis.turning @ on_body)
        place = np.concatenate([motion[:6], self.onto @ on_body])
        return place, np.concatenate([np.zeros(6), turned])


class _Lines(NamedTuple):
    """Places of cells at one instant."""

    roll: np.ndarray
    face_position: np.ndarray
    phase: np.ndarray


class _Cells(NamedTuple):
    """Overlap of cells per coordinate, and what follows at once: per force on them, and by rotation
    per square of the wheel's speed."""

    across: np.ndarray
    give: np.ndarray
    grown: np.ndarray


def _pressed(overlap: np.ndarray, give: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Forces of cells from their overlap without force and what they give, by the active set."""
    carries = stiffness > 0.0
    closed = carries.copy()
    for _ in range(40):
        on = np.flatnonzero(closed)
        force = np.zeros(len(overlap))
        force[on] = np.linalg.solve(
            np.diag(1.0 / stiffness[on]) + give[np.ix_(on, on)], overlap[on]
        )
        before, closed = closed, carries & (overlap - give @ force > 0.0)
        if np.array_equal(before, closed):
            return force
    raise AssertionError("The active set goes round.")
