r"""The judge of the dynamics: oscillators by Runge-Kutta, small systems as the thesis marches them.

Plain NumPy; it shares no line with the library. The oscillators are in
numbers without dimension: clearance or static deflection, linear natural frequency and mass are 1,
$$\ddot x + 2\zeta\dot x + k(\tau)\,g(x) = F(\tau), \qquad \tau = \Omega t/2\pi,$$
with $g(x) = \langle x - d\rangle - \langle -x - b\rangle$ behind a drive and a back clearance.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

# --- oscillators


@dataclass(frozen=True)
class Oscillator:
    """One mass on a clearance.

    **Fields:**

    - `damping_ratio`: of the closed contact at mean stiffness [-].
    - `stiffness`: at a phase in periods [-].
    - `force`: at a phase in periods and a speed [-].
    - `drive`: where the drive flank closes [-].
    - `back`: how far in the other direction the back flank closes [-]; infinite without one.
    """

    damping_ratio: float
    stiffness: Callable[[np.ndarray], np.ndarray]
    force: Callable[[np.ndarray, np.ndarray], np.ndarray]
    drive: float = 0.0
    back: float = np.inf


def parametric(damping_ratio: float = 0.05, ripple: float = 0.3) -> Oscillator:
    """B5 (a): stiffness with one harmonic, contact that opens, no back flank."""
    return Oscillator(
        damping_ratio,
        lambda phase: 1.0 + ripple * np.cos(2.0 * np.pi * phase),
        lambda phase, speed: np.ones(np.broadcast_shapes(np.shape(phase), np.shape(speed))),
    )


def backlash(damping_ratio: float = 0.05, mean: float = 0.1, shaken: float = 0.05) -> Oscillator:
    """B5 (b): constant stiffness, a clearance to both sides, inertial excitation."""
    return Oscillator(
        damping_ratio,
        lambda phase: np.ones(np.shape(phase)),
        lambda phase, speed: mean + shaken * speed**2 * np.sin(2.0 * np.pi * phase),
        drive=1.0,
        back=1.0,
    )


def rectangular(damping_ratio: float = 0.05, contact_ratio: float = 1.6) -> Oscillator:
    """One pair of teeth, or two for the fraction of the period after a pair enters; mean 1."""
    pair = 1.0 / contact_ratio
    return Oscillator(
        damping_ratio,
        lambda phase: pair * (1.0 + (phase % 1.0 < contact_ratio - 1.0)),
        lambda phase, speed: np.ones(np.broadcast_shapes(np.shape(phase), np.shape(speed))),
    )


class Statistics(NamedTuple):
    """Of the position over whole periods: RMS about the mean, largest, least [-]."""

    rms: float
    most: float
    least: float


class Settled(NamedTuple):
    """Where a march has come to.

    **Fields:**

    - `statistics`: of the position over the last periods.
    - `start`: position and velocity at the end, where another period begins [-].
    - `path`: position at the start of each step of the last periods [-].
    """

    statistics: Statistics
    start: tuple[float, float]
    path: np.ndarray


def statistics(position: np.ndarray) -> Statistics:
    """Of equally spaced samples over whole periods, the last one not repeated."""
    return Statistics(float(np.std(position)), float(np.max(position)), float(np.min(position)))


# Stages lie this far inside their step, in steps: a jump at its end is not its own.
_INSIDE = 1e-9


def _stages(oscillator: Oscillator, speed, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and force at the start, middle and end of each step of one period."""
    places = np.array([_INSIDE, 0.5, 1.0 - _INSIDE])
    phase = (np.arange(steps)[:, None] + places) / steps
    phase = phase.reshape(-1, *(1,) * np.ndim(speed))
    return oscillator.stiffness(phase), oscillator.force(phase, np.asarray(speed))


def march(
    oscillator: Oscillator,
    speed: float,
    start: tuple[float, float],
    *,
    periods: int,
    steps: int,
) -> tuple[np.ndarray, tuple[float, float]]:
    """Runge-Kutta of order four through whole periods, in plain numbers.

    **Arguments:**

    - `oscillator`: what moves.
    - `speed`: frequency of the excitation [-].
    - `start`: position and velocity at phase zero [-].
    - `periods`: how many.
    - `steps`: in one period.

    **Returns:**

    The position at the start of each step [-], and position and velocity at the end.
    """
    stiffness, force = (x.tolist() for x in _stages(oscillator, float(speed), steps))
    loss, drive, back = 2.0 * oscillator.damping_ratio, oscillator.drive, oscillator.back

    def acceleration(stage: int, x: float, v: float) -> float:
        spring = x - drive if x > drive else (x + back if x < -back else 0.0)
        return force[stage] - loss * v - stiffness[stage] * spring

    x, v = start
    h = 2.0 * np.pi / speed / steps
    half, sixth = 0.5 * h, h / 6.0
    path = []
    for _ in range(periods):
        for i in range(0, 3 * steps, 3):
            path.append(x)
            a0 = acceleration(i, x, v)
            v1 = v + half * a0
            a1 = acceleration(i + 1, x + half * v, v1)
            v2 = v + half * a1
            a2 = acceleration(i + 1, x + half * v1, v2)
            v3 = v + h * a2
            a3 = acceleration(i + 2, x + h * v2, v3)
            x += sixth * (v + 2.0 * (v1 + v2) + v3)
            v += sixth * (a0 + 2.0 * (a1 + a2) + a3)
    return np.array(path), (x, v)


def sweep(
    oscillator: Oscillator,
    speeds: Iterable[float],
    start: tuple[float, float] = (1.0, 0.0),
    *,
    periods: int = 150,
    steps: int = 200,
    last: int = 10,
) -> dict[float, Settled]:
    """March from speed to speed, each from where the one before ended, as B5 does.

    **Arguments:**

    - `oscillator`: what moves.
    - `speeds`: in the order in which they are run [-].
    - `start`: position and velocity before the first [-].
    - `periods`: at each speed.
    - `steps`: in one period.
    - `last`: periods that are looked at.

    **Returns:**

    What it has come to at each speed.
    """
    found = {}
    for speed in speeds:
        path, start = march(oscillator, speed, start, periods=periods, steps=steps)
        path = path[-last * steps :]
        found[speed] = Settled(statistics(path), start, path)
    return found


def march_many(
    oscillator: Oscillator, speed: np.ndarray, start: np.ndarray, *, periods: int, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """As `march`, for many speeds or starts side by side, in arrays.

    **Arguments:**

    - `oscillator`: what moves.
    - `speed`: frequency of the excitation of each lane [-].
    - `start`: position and velocity of each lane, two rows [-].
    - `periods`: how many.
    - `steps`: in one period.

    **Returns:**

    The position at the start of each step of each lane [-], and the two rows at the end.
    """
    stiffness, force = _stages(oscillator, speed, steps)
    loss, drive, back = 2.0 * oscillator.damping_ratio, oscillator.drive, oscillator.back
    h = 2.0 * np.pi / speed / steps

    def slope(stage: int, state: np.ndarray) -> np.ndarray:
        x, v = state
        spring = np.maximum(x - drive, 0.0) - np.maximum(-x - back, 0.0)
        return np.stack([v, force[stage] - loss * v - stiffness[stage] * spring])

    state, path = np.array(start, dtype=float), []
    for _ in range(periods):
        for i in range(0, 3 * steps, 3):
            path.append(state[0])
            first = slope(i, state)
            second = slope(i + 1, state + 0.5 * h * first)
            third = slope(i + 1, state + 0.5 * h * second)
            fourth = slope(i + 2, state + h * third)
            state = state + h / 6.0 * (first + 2.0 * (second + third) + fourth)
    return np.array(path), state


# --- their coexisting orbits


@dataclass(frozen=True)
class PeriodicMotion:
    """One orbit of an oscillator.

    **Fields:**

    - `speed`: frequency of the excitation [-].
    - `multiple`: periods of the excitation in one of its own.
    - `start`: position and velocity at phase zero; of several, the one furthest ahead [-].
    - `position`: at the start of each step [-].
    - `multipliers`: Floquet multipliers over its own period, the larger first [-].
    """

    speed: float
    multiple: int
    start: tuple[float, float]
    position: np.ndarray = field(repr=False)
    multipliers: np.ndarray

    @property
    def statistics(self) -> Statistics:
        """Of the position."""
        return statistics(self.position)

    @property
    def stable(self) -> bool:
        """Whether neighbours approach it."""
        return bool(np.abs(self.multipliers[0]) < 1.0)


_NUDGE = 1e-6


def _closing(
    oscillator: Oscillator, speed: float, start: np.ndarray, multiple: int, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where each lane arrives after the period, and the derivative by central differences."""
    lanes = start.shape[1]
    moves = _NUDGE * np.array([[0, 1, -1, 0, 0], [0, 0, 0, 1, -1]], dtype=float)
    nudged = (start[:, :, None] + moves[:, None, :]).reshape(2, -1)
    speeds = np.full(nudged.shape[1], speed)
    _, end = march_many(oscillator, speeds, nudged, periods=multiple, steps=steps)
    end = end.reshape(2, lanes, 5)
    slopes = np.stack([end[..., 1] - end[..., 2], end[..., 3] - end[..., 4]], axis=-1)
    return end[..., 0], np.moveaxis(slopes, 0, 1) / (2.0 * _NUDGE)


def closed_orbits(
    oscillator: Oscillator,
    speed: float,
    starts: np.ndarray,
    *,
    multiple: int = 1,
    steps: int = 400,
    newton_steps: int = 12,
) -> list[PeriodicMotion]:
    """Newton on the map of one period from many starts; the different orbits that it finds.

    **Arguments:**

    - `oscillator`: what moves.
    - `speed`: frequency of the excitation [-].
    - `starts`: position and velocity of each start, two rows [-].
    - `multiple`: periods until the orbit closes; orbits that close earlier are left out.
    - `steps`: in one period.
    - `newton_steps`: at most.

    **Returns:**

    The orbits, those of larger RMS first.
    """
    state = np.array(starts, dtype=float)
    for _ in range(newton_steps):
        end, slope = _closing(oscillator, speed, state, multiple, steps)
        # A lane whose matrix is singular is beyond help, and must not stop the others.
        matrix = slope - np.eye(2) + 1e-14 * np.eye(2)
        step = np.linalg.solve(matrix, (end - state).T[..., None])[..., 0].T
        length = np.hypot(*step)
        state = state - step * np.minimum(1.0, 2.0 / np.maximum(length, 1e-300))
        state = np.clip(state, -50.0, 50.0)
    end, slope = _closing(oscillator, speed, state, multiple, steps)
    closed = np.hypot(*(end - state)) < 1e-10
    found: list[PeriodicMotion] = []
    for lane in np.flatnonzero(closed):
        lead = tuple(state[:, lane].tolist())
        returns = [lead]
        for _ in range(multiple - 1):
            returns.append(march(oscillator, speed, returns[-1], periods=1, steps=steps)[1])
        if any(np.hypot(*np.subtract(lead, other)) < 1e-5 for other in returns[1:]):
            continue
        lead = max(returns)
        if any(np.hypot(*np.subtract(lead, motion.start)) < 1e-5 for motion in found):
            continue
        multipliers = np.linalg.eigvals(slope[lane])
        multipliers = multipliers[np.argsort(-np.abs(multipliers))]
        path, _ = march(oscillator, speed, lead, periods=multiple, steps=steps)
        found.append(PeriodicMotion(speed, multiple, lead, path, multipliers))
    return sorted(found, key=lambda motion: -motion.statistics.rms)


def polished(oscillator: Oscillator, motion: PeriodicMotion) -> PeriodicMotion:
    """The same orbit by adaptive steps, whose slopes see contact open within a step.

    Fixed steps know the orbit to second order, but its multipliers to first order only.

    **Arguments:**

    - `oscillator`: what moves, with smooth stiffness.
    - `motion`: the orbit, closely.

    **Returns:**

    The orbit with another start and other multipliers.
    """
    speed = motion.speed
    nudges = _NUDGE * np.array([[0, 1, -1, 0, 0], [0, 0, 0, 1, -1]], dtype=float)

    def slope(time: float, flat: np.ndarray) -> np.ndarray:
        x, v = flat.reshape(2, 5)
        phase = np.asarray(time * speed / (2.0 * np.pi))
        spring = np.maximum(x - oscillator.drive, 0.0) - np.maximum(-x - oscillator.back, 0.0)
        pull = oscillator.force(phase, np.asarray(speed)) - oscillator.stiffness(phase) * spring
        return np.concatenate([v, pull - 2.0 * oscillator.damping_ratio * v])

    duration = motion.multiple * 2.0 * np.pi / speed
    start = np.array(motion.start)
    for _ in range(4):
        begin = (start[:, None] + nudges).reshape(-1)
        run = solve_ivp(slope, (0.0, duration), begin, method="DOP853", rtol=1e-11, atol=1e-12)
        end = run.y[:, -1].reshape(2, 5)
        matrix = np.stack([end[:, 1] - end[:, 2], end[:, 3] - end[:, 4]], axis=1) / (2.0 * _NUDGE)
        step = np.linalg.solve(matrix - np.eye(2), end[:, 0] - start)
        start = start - step
    multipliers = np.linalg.eigvals(matrix)
    multipliers = multipliers[np.argsort(-np.abs(multipliers))]
    return replace(motion, start=tuple(start.tolist()), multipliers=multipliers)


def catalogue(
    oscillator: Oscillator,
    speed: float,
    *,
    multiples: tuple[int, ...] = (1, 2),
    reach: float = 4.0,
    across: int = 9,
    settling: int = 40,
    steps: int = 400,
) -> list[PeriodicMotion]:
    """Orbits that coexist at a speed, stable or not, looked for from a grid of starts.

    Newton begins at the starts, which finds unstable orbits too, and where they have settled to,
    which finds those that attract. Isolated orbits between the starts may be missed.

    **Arguments:**

    - `oscillator`: what moves.
    - `speed`: frequency of the excitation [-].
    - `multiples`: of the period that are looked for.
    - `reach`: largest position and velocity of a start [-].
    - `across`: starts in each direction.
    - `settling`: periods marched before the second attempt.
    - `steps`: in one period.

    **Returns:**

    The orbits, by their multiple, those of larger RMS first.
    """
    line = np.linspace(-reach, reach, across)
    starts = np.stack(np.meshgrid(line, line)).reshape(2, -1)
    speeds = np.full(starts.shape[1], speed)
    _, settled = march_many(oscillator, speeds, starts, periods=settling, steps=max(50, steps // 4))
    both = np.concatenate([starts, settled], axis=1)
    return [
        motion
        for multiple in multiples
        for motion in closed_orbits(oscillator, speed, both, multiple=multiple, steps=steps)
    ]


def linear_response(
    damping_ratio: float, natural: float, force: np.ndarray, frequency: np.ndarray
) -> np.ndarray:
    """Complex amplitudes of a mass on a spring, unit mass.

    **Arguments:**

    - `damping_ratio`: [-].
    - `natural`: its natural frequency [rad/s].
    - `force`: complex amplitudes [N/kg].
    - `frequency`: of each [rad/s].
    """
    damped = 2.0j * damping_ratio * natural * frequency
    return force / (natural**2 - frequency**2 + damped)


# --- small systems, in the coordinates of their bodies


@dataclass(frozen=True)
class Cells:
    """Contact cells over one cycle, as arrays with the step first.

    **Fields:**

    - `edges`: ends of the steps in mesh periods.
    - `stiffness`: of each cell during each step [N/m].
    - `gap`: of each cell at start, middle and end of each step (place, step, cell) [m].
    - `arms`: approach per mesh coordinate (place, step, cell, coordinate).
    """

    edges: np.ndarray
    stiffness: np.ndarray
    gap: np.ndarray
    arms: np.ndarray


@dataclass(frozen=True)
class Bodies:
    """Everything that does not depend on time.

    **Fields:**

    - `mass`, `damping`, `stiffness`: without the mesh (dof, dof).
    - `vectors`: mesh coordinates per motion (dof, coordinate).
    - `load`: constant (dof).
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    vectors: np.ndarray
    load: np.ndarray


class Contact(NamedTuple):
    """A state of contact: motion, which cells are closed, how often it was solved."""

    motion: np.ndarray
    closed: np.ndarray
    solves: int


class TwoLoopsFailed(RuntimeError):
    """The two loops went round in circles."""


def two_loops(
    matrix: np.ndarray,
    right: np.ndarray,
    rows: np.ndarray,
    stiffness: np.ndarray,
    gap: np.ndarray,
    closed: np.ndarray,
    *,
    most: int = 100,
) -> Contact:
    """The contact loops of Velex and Maatar (1996), one within the other.

    **Arguments:**

    - `matrix`: of the system without the mesh (dof, dof).
    - `right`: its right-hand side (dof).
    - `rows`: approach of each cell per motion (cell, dof).
    - `stiffness`: of each cell.
    - `gap`: of each cell.
    - `closed`: which cells are taken to be closed at first.
    - `most`: solutions before it gives up.

    **Returns:**

    The state of contact.

    **Raises:**

    - `TwoLoopsFailed` if it was not found by then.
    """
    closed, solves = closed.copy(), 0
    while solves < most:
        while solves < most:
            touching = rows[closed]
            springs = (touching * stiffness[closed][:, None]).T
            motion = np.linalg.solve(matrix + springs @ touching, right + springs @ gap[closed])
            solves += 1
            overlap = rows @ motion - gap
            tensile = closed & (overlap < 0.0)
            if not tensile.any():
                break
            closed &= ~tensile
        else:
            break
        interfering = ~closed & (overlap > 0.0) & (stiffness > 0.0)
        if not interfering.any():
            return Contact(motion, closed, solves)
        closed |= interfering
    raise TwoLoopsFailed(f"No state of contact after {solves} solutions.")


@dataclass(frozen=True)
class Record:
    """What happened at both ends of every step: axis `end` is start, end of the step.

    **Fields:**

    - `motion`, `velocity`, `acceleration`: of each degree of freedom (step, end, dof).
    - `force`: on the mesh coordinates (step, end, coordinate).
    - `solves`: solutions of each step.
    """

    motion: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    solves: np.ndarray

    @property
    def last(self) -> tuple[np.ndarray, np.ndarray]:
        """Motion and velocity at the end."""
        return self.motion[-1, 1], self.velocity[-1, 1]


def newmark(
    bodies: Bodies,
    cells: Cells,
    frequency: float,
    start: tuple[np.ndarray, np.ndarray],
    *,
    cycles: int,
    beta: float = 0.25,
    gamma: float = 0.5,
) -> Record:
    """March a small system in the coordinates of its bodies, as the thesis does.

    A step has one stiffness: the acceleration at its start is that of its own stiffness, not that
    at the end of the step before, so that a jump between two steps costs no accuracy.

    **Arguments:**

    - `bodies`: masses, dampers, springs, loads.
    - `cells`: of the mesh.
    - `frequency`: of the mesh [rad/s].
    - `start`: motion and velocity.
    - `cycles`: how many.
    - `beta`, `gamma`: of Newmark [-].

    **Returns:**

    The record of all steps.
    """
    lengths = np.diff(cells.edges) * 2.0 * np.pi / frequency
    rows = cells.arms @ bodies.vectors.T
    mass, damping, stiffness = bodies.mass, bodies.damping, bodies.stiffness
    motion, velocity = (np.array(x, dtype=float) for x in start)
    closed = np.ones(cells.stiffness.shape[1], dtype=bool)
    motions, velocities, accelerations, forces, solves = [], [], [], [], []
    for i in np.tile(np.arange(len(lengths)), cycles):
        h, k = lengths[i], cells.stiffness[i]

        def mesh(place: int, at: np.ndarray, i=i, k=k) -> np.ndarray:
            pressed = k * np.maximum(rows[place, i] @ at - cells.gap[place, i], 0.0)
            return cells.arms[place, i].T @ pressed

        before = mesh(0, motion)
        pull = bodies.load - damping @ velocity - stiffness @ motion - bodies.vectors @ before
        acceleration = np.linalg.solve(mass, pull)
        guess = motion + h * velocity + h**2 * (0.5 - beta) * acceleration
        faster = velocity + h * (1.0 - gamma) * acceleration
        # a = (q - guess) / (beta h^2), v = faster + gamma h a.
        inertia = mass / (beta * h**2) + damping * (gamma / (beta * h))
        found = two_loops(
            inertia + stiffness,
            bodies.load + inertia @ guess - damping @ faster,
            rows[2, i],
            k,
            cells.gap[2, i],
            closed,
        )
        closed = found.closed
        ended = (found.motion - guess) / (beta * h**2)
        quickly = faster + gamma * h * ended
        motions.append((motion, found.motion))
        velocities.append((velocity, quickly))
        accelerations.append((acceleration, ended))
        forces.append((before, mesh(2, found.motion)))
        solves.append(found.solves)
        motion, velocity = found.motion, quickly
    records = (motions, velocities, accelerations, forces, solves)
    return Record(*(np.array(x) for x in records))
