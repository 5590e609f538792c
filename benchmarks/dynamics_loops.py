r"""Marching a gear pair in modal coordinates, as one would write it by hand: in NumPy, in numba.

    python benchmarks/dynamics_loops.py [--modes 30] [--cells 32] [--steps 100] [--cycles 200]

The rivals of the library's own march, and the same algorithm: Newmark on modes $q$ that include
the mean mesh stiffness $\bar k$,
$$\ddot q_i + d_i\dot q_i + \omega_i^2 q_i = f_i - B_i(g(t, m) - \bar k m), \qquad m = B^Tq;$$
a predictor of each mode; Newton's method on the two mesh coordinates until the set of closed cells
repeats; a corrector of each mode. Functions take plain arrays. `numba` is left out where it is not
installed. Times are of one processor, compiling apart.
"""

import argparse
import importlib
import importlib.util
import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Modal(NamedTuple):
    """Modes and mesh as plain arrays.

    **Fields:**

    - `square`: squared frequencies (mode) [rad2/s2].
    - `damping`: twice damping ratio times frequency (mode) [1/s].
    - `mesh`: mesh coordinates per mode (mode, 2).
    - `load`: constant (mode).
    - `mean`: mean mesh stiffness (2, 2).
    - `edges`: ends of the steps in mesh periods (step + 1).
    - `stiffness`: of each cell during each step (step, cell) [N/m].
    - `gap`: at start, middle and end of each step (place, step, cell) [m].
    - `arms`: approach per mesh coordinate, at the same places (place, step, cell, 2).
    """

    square: np.ndarray
    damping: np.ndarray
    mesh: np.ndarray
    load: np.ndarray
    mean: np.ndarray
    edges: np.ndarray
    stiffness: np.ndarray
    gap: np.ndarray
    arms: np.ndarray


class Path(NamedTuple):
    """What a march leaves behind.

    **Fields:**

    - `place`: mesh coordinates at the end of each step (step, 2) [m, rad].
    - `load`: of the mesh on them (step, 2) [N, N m].
    - `state`: displacement and velocity of each mode at the end (2, mode).
    - `solves`: Newton steps per time step, mean [-].
    """

    place: np.ndarray
    load: np.ndarray
    state: np.ndarray
    solves: float


def main() -> None:
    """Time the loops and print microseconds per step."""
    parser = argparse.ArgumentParser(description="Hand-written marches of a gear pair.")
    parser.add_argument("--modes", type=int, default=30)
    parser.add_argument("--cells", type=int, default=32)
    parser.add_argument("--steps", type=int, default=100, help="in one mesh period")
    parser.add_argument("--cycles", type=int, default=200, help="of the numba loop")
    options = parser.parse_args()
    modal = example(options.modes, options.cells, options.steps)
    size = f"{options.modes} modes, {options.cells} cells, {options.steps} steps a period"
    print(f"{size}; microseconds per step, Newton steps per step")
    for name, microseconds, solves in timings(modal, 0.8, options.cycles):
        print(f"{name:<12} {microseconds:8.2f} {solves:6.2f}")


def timings(modal: Modal, frequency: float, cycles: int) -> list[tuple[str, float, float]]:
    """Time the loops at one speed.

    **Arguments:**

    - `modal`: modes and mesh.
    - `frequency`: of the mesh [rad/s].
    - `cycles`: of the numba loop; NumPy's has a twentieth of them.

    **Returns:**

    Name, microseconds per step and Newton steps per step of each.
    """
    start = at_rest(modal)
    found = [("NumPy", numpy_march, max(1, cycles // 20))]
    if importlib.util.find_spec("numba") is not None:
        found.append(("numba", numba_march(), cycles))
    rows = []
    for name, march, count in found:
        march(modal, frequency, start, 1)
        seconds = [_seconds(march, modal, frequency, start, count) for _ in range(5)]
        steps = count * len(modal.stiffness)
        solves = march(modal, frequency, start, count).solves
        rows.append((name, 1e6 * statistics.median(seconds) / steps, solves))
    return rows


def _seconds(march: Callable, *arguments) -> float:
    start = time.perf_counter()
    march(*arguments)
    return time.perf_counter() - start


def example(modes: int, cells: int, steps: int, *, seed: int = 3) -> Modal:
    """A torsional motion under a unit force, elastic ones about it, cells with relief.

    The mean mesh stiffness is 1, the torsional motion alone has the natural frequency 1 rad/s.

    **Arguments:**

    - `modes`: how many.
    - `cells`: how many; half of them are a second line that comes and goes.
    - `steps`: in one mesh period.
    - `seed`: of the elastic motions' shares in the mesh.
    """
    draw = np.random.default_rng(seed)
    motions = np.concatenate([[1e-3], np.geomspace(0.1, 14.0, modes - 1)])
    vectors = draw.normal(size=(modes, 2)) * [0.1, 0.3]
    vectors[0] = [1.0, 0.0]
    slices = cells // 2
    edges = np.arange(steps + 1) / steps
    across = np.tile((np.arange(slices) + 0.5) / slices - 0.5, 2)
    entered = np.where(0.5 * (edges[1:] + edges[:-1]) < 0.6, 1.0, 0.0)
    lines = np.stack([np.ones(steps), entered], axis=1) / 1.6 / slices
    phase = np.stack([edges[:-1], 0.5 * (edges[:-1] + edges[1:]), edges[1:]])
    toward = np.repeat(np.stack([phase - 0.6, phase], axis=-1), slices, axis=-1)
    relief = np.where(toward > 0.0, 0.5 * np.abs(np.cos(np.pi * toward)) ** 4, 0.0)
    arms = np.broadcast_to(np.stack([np.ones(cells), across], axis=-1), (3, steps, cells, 2))
    mean = np.diag([1.0, float(np.mean(across**2))])
    square, shape = np.linalg.eigh(np.diag(motions**2) + vectors @ mean @ vectors.T)
    return Modal(
        square=square,
        damping=2.0 * 0.03 * np.sqrt(square),
        mesh=shape.T @ vectors,
        load=shape[0],
        mean=mean,
        edges=edges,
        stiffness=np.repeat(lines, slices, axis=1),
        gap=relief + 0.1 * across,
        arms=np.ascontiguousarray(arms),
    )


def at_rest(modal: Modal) -> np.ndarray:
    """Displacement and velocity of each mode under the constant load and the mean stiffness.

    **Arguments:**

    - `modal`: modes and mesh.
    """
    return np.stack([modal.load / modal.square, np.zeros_like(modal.load)])


def coefficients(
    modal: Modal, frequency: float, beta: float, gamma: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is the same at every step.

    **Arguments:**

    - `modal`: modes and mesh.
    - `frequency`: of the mesh [rad/s].
    - `beta`, `gamma`: of Newmark [-].

    **Returns:**

    Length of each step [s]; acceleration of each mode per force (step, mode); motion of the mesh
    coordinates per mesh load within a step (step, 2, 2).
    """
    lengths = np.diff(modal.edges) * 2.0 * np.pi / frequency
    h = lengths[:, None]
    ease = 1.0 / (1.0 + gamma * h * modal.damping + beta * h**2 * modal.square)
    within = np.einsum("sn,np,nq->spq", beta * h**2 * ease, modal.mesh, modal.mesh)
    return lengths, ease, within


def numpy_march(
    modal: Modal,
    frequency: float,
    start: np.ndarray,
    cycles: int,
    *,
    beta: float = 0.25,
    gamma: float = 0.5,
    most: int = 20,
) -> Path:
    """March in a plain loop over steps, each operation on whole arrays.

    **Arguments:**

    - `modal`: modes and mesh.
    - `frequency`: of the mesh [rad/s].
    - `start`: displacement and velocity of each mode (2, mode).
    - `cycles`: how many.
    - `beta`, `gamma`: of Newmark [-].
    - `most`: Newton steps at most.
    """
    square, damping, mesh, load, mean = modal[:5]
    lengths, ease, within = coefficients(modal, frequency, beta, gamma)
    across = np.ascontiguousarray(mesh.T)
    moved, rate = start
    count = len(lengths)
    places, loads = np.empty((cycles * count, 2)), np.empty((cycles * count, 2))
    solves = 0
    for n in range(cycles * count):
        i = n % count
        h, stiffness, arms = lengths[i], modal.stiffness[i], modal.arms[0, i]
        # A step has its own stiffness: so has the acceleration at its start.
        place = across @ moved
        pressed = stiffness * np.maximum(arms @ place - modal.gap[0, i], 0.0)
        excess = pressed @ arms - mean @ place
        acceleration = load - damping * rate - square * moved - mesh @ excess
        ahead = moved + h * rate + (0.5 - beta) * h * h * acceleration
        faster = rate + (1.0 - gamma) * h * acceleration
        unpushed = ease[i] * (load - damping * faster - square * ahead)
        free = across @ (ahead + beta * h * h * unpushed)
        # n: mesh coordinates in balance with the load that they cause.
        arms, gap, give = modal.arms[2, i], modal.gap[2, i], within[i]
        overlap = arms @ place - gap
        closed = overlap > 0.0
        for _ in range(most):
            solves += 1
            springs = np.where(closed, stiffness, 0.0)
            weighted = springs[:, None] * arms
            tangent = arms.T @ weighted - mean
            matrix = np.eye(2) + give @ tangent
            place = np.linalg.solve(matrix, free + give @ (gap @ weighted))
            overlap = arms @ place - gap
            now = overlap > 0.0
            if np.array_equal(now, closed):
                break
            closed = now
        total = (stiffness * np.maximum(overlap, 0.0)) @ arms
        ended = unpushed - ease[i] * (mesh @ (total - mean @ place))
        moved = ahead + beta * h * h * ended
        rate = faster + gamma * h * ended
        places[n], loads[n] = place, total
    return Path(places, loads, np.stack([moved, rate]), solves / (cycles * count))


def _loop(
    square, damping, mesh, load, mean, lengths, ease, within, stiffness, gap, arms, start,
    cycles, beta, gamma, most,
):  # fmt: skip
    """The same, number by number: for numba."""
    count, cells = stiffness.shape
    modes = len(square)
    moved, rate = start[0].copy(), start[1].copy()
    ahead, faster, unpushed = np.empty(modes), np.empty(modes), np.empty(modes)
    places, loads = np.empty((cycles * count, 2)), np.empty((cycles * count, 2))
    closed = np.zeros(cells, dtype=np.bool_)
    solves = 0
    for n in range(cycles * count):
        i = n % count
        h = lengths[i]
        a = b = 0.0
        for j in range(modes):
            a += mesh[j, 0] * moved[j]
            b += mesh[j, 1] * moved[j]
        g0 = g1 = 0.0
        for c in range(cells):
            over = arms[0, i, c, 0] * a + arms[0, i, c, 1] * b - gap[0, i, c]
            force = stiffness[i, c] * max(over, 0.0)
            g0 += arms[0, i, c, 0] * force
            g1 += arms[0, i, c, 1] * force
        e0 = g0 - mean[0, 0] * a - mean[0, 1] * b
        e1 = g1 - mean[1, 0] * a - mean[1, 1] * b
        free0 = free1 = 0.0
        for j in range(modes):
            pull = load[j] - damping[j] * rate[j] - square[j] * moved[j]
            acceleration = pull - mesh[j, 0] * e0 - mesh[j, 1] * e1
            ahead[j] = moved[j] + h * rate[j] + (0.5 - beta) * h * h * acceleration
            faster[j] = rate[j] + (1.0 - gamma) * h * acceleration
            unpushed[j] = ease[i, j] * (load[j] - damping[j] * faster[j] - square[j] * ahead[j])
            at = ahead[j] + beta * h * h * unpushed[j]
            free0 += mesh[j, 0] * at
            free1 += mesh[j, 1] * at
        s00, s01, s10, s11 = within[i, 0, 0], within[i, 0, 1], within[i, 1, 0], within[i, 1, 1]
        for c in range(cells):
            closed[c] = arms[2, i, c, 0] * a + arms[2, i, c, 1] * b - gap[2, i, c] > 0.0
        for _ in range(most):
            solves += 1
            k00, k01, k11 = -mean[0, 0], -mean[0, 1], -mean[1, 1]
            p0 = p1 = 0.0
            for c in range(cells):
                spring = stiffness[i, c] if closed[c] else 0.0
                w0, w1 = arms[2, i, c, 0], arms[2, i, c, 1]
                k00 += spring * w0 * w0
                k01 += spring * w0 * w1
                k11 += spring * w1 * w1
                p0 += spring * gap[2, i, c] * w0
                p1 += spring * gap[2, i, c] * w1
            r0, r1 = free0 + s00 * p0 + s01 * p1, free1 + s10 * p0 + s11 * p1
            j00, j01 = 1.0 + s00 * k00 + s01 * k01, s00 * k01 + s01 * k11
            j10, j11 = s10 * k00 + s11 * k01, 1.0 + s10 * k01 + s11 * k11
            size = j00 * j11 - j01 * j10
            a, b = (j11 * r0 - j01 * r1) / size, (j00 * r1 - j10 * r0) / size
            changed = False
            g0 = g1 = 0.0
            for c in range(cells):
                w0, w1 = arms[2, i, c, 0], arms[2, i, c, 1]
                over = w0 * a + w1 * b - gap[2, i, c]
                if (over > 0.0) != closed[c]:
                    changed = True
                closed[c] = over > 0.0
                force = stiffness[i, c] * max(over, 0.0)
                g0 += w0 * force
                g1 += w1 * force
            if not changed:
                break
        e0 = g0 - mean[0, 0] * a - mean[0, 1] * b
        e1 = g1 - mean[1, 0] * a - mean[1, 1] * b
        for j in range(modes):
            ended = unpushed[j] - ease[i, j] * (mesh[j, 0] * e0 + mesh[j, 1] * e1)
            moved[j] = ahead[j] + beta * h * h * ended
            rate[j] = faster[j] + gamma * h * ended
        places[n, 0], places[n, 1] = a, b
        loads[n, 0], loads[n, 1] = g0, g1
    return places, loads, moved, rate, solves


def looped_march(loop: Callable = _loop) -> Callable[..., Path]:
    """The loop over numbers as a march like `numpy_march`.

    **Arguments:**

    - `loop`: compiled or, very slowly, not.
    """

    def march(
        modal: Modal,
        frequency: float,
        start: np.ndarray,
        cycles: int,
        *,
        beta: float = 0.25,
        gamma: float = 0.5,
        most: int = 20,
    ) -> Path:
        parts = coefficients(modal, frequency, beta, gamma)
        places, loads, moved, rate, solves = loop(
            *modal[:5], *parts, *modal[6:], start, cycles, beta, gamma, most
        )
        return Path(places, loads, np.stack([moved, rate]), solves / len(places))

    return march


def numba_march() -> Callable[..., Path]:
    """The loop over numbers, compiled by numba."""
    numba = importlib.import_module("numba")
    return looped_march(numba.njit(_loop))


if __name__ == "__main__":
    main()
