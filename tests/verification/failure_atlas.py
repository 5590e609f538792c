r"""The failure atlas: where each method of the dynamics breaks, and what is done instead.

Every row is a function that runs a small system through a method beyond its limits, and through
what the library does by default. Tests assert on the numbers; the document is written from them:
`python tests/verification/failure_atlas.py --out docs`.

Oscillators have unit mass, mean stiffness and load, and a pinion of one tooth.
The speed is then the mesh frequency over the natural frequency of the closed contact, and the
largest mesh force is the dynamic ratio.
"""

import argparse
import functools
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import scipy.integrate
import scipy.linalg
from dynamics import reference
from dynamics.cases import sdof_driven, sdof_parametric
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from jaxgear._dynamics._continuation import continuation
from jaxgear._dynamics._floquet import floquet_multipliers, monodromy
from jaxgear._dynamics._harmonic import HarmonicBalance, harmonic_balance_problem
from jaxgear._dynamics._march import TimeStepping, at_rest, quasi_static_start, time_history
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._orbit import AbstractMethod
from jaxgear._dynamics._pressing import Pressing, pressed
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import (
    AbstractStepper,
    Exponential,
    HilberHughesTaylor,
    Midpoint,
    Newmark,
)
from jaxgear._dynamics._sweep import sweep
from jaxgear._dynamics._sweep_types import Direction, SweepPoint
from jaxgear._dynamics._system import DynamicSystem, modal_basis
from jaxgear._dynamics._table import MeshTable
from jaxgear._interface._laws import ExactContact, SmoothContact
from jaxgear._solve._contact import SolverSettings, contact_state
from jaxgear._solve._contact_problem import ContactProblem

# --- what a row is


@dataclass(frozen=True)
class Row:
    """One failure, reproduced.

    **Fields:**

    - `title`, `method`: what fails.
    - `breaks`: where, and how it shows, with its numbers.
    - `default`: what the library does by default, with its numbers.
    - `note`: what else was seen.
    - `numbers`: all that tests look at, in the units of the oscillator [-].
    - `draw`: draws the picture.
    """

    title: str
    method: str
    breaks: str
    default: str
    note: str
    numbers: dict[str, Any]
    draw: Callable[[Axes], None]


# --- systems


def _built(
    edges: ArrayLike,
    stiffness: ArrayLike,
    *,
    mass: ArrayLike = ((1.0,),),
    damping_ratio: float = 0.05,
    structure: ArrayLike = ((0.0,),),
    vectors: ArrayLike = ((1.0,),),
    load: ArrayLike = (1.0,),
    gap: ArrayLike | None = None,
    arms: ArrayLike | None = None,
    mean: ArrayLike = ((1.0,),),
    rest: ArrayLike | None = None,
    kinds: Sequence[int] | None = None,
) -> DynamicSystem:
    """A system under a constant load, every mode with one damping ratio."""
    stiffness = np.asarray(stiffness, dtype=float)
    stiffness = stiffness[:, None] if stiffness.ndim == 1 else stiffness
    steps, cells = stiffness.shape
    body, spring, vectors = (np.asarray(x, dtype=float) for x in (mass, structure, vectors))
    mean_, load = np.asarray(mean, dtype=float), np.asarray(load, dtype=float)
    whole = spring + vectors @ mean_ @ vectors.T
    square, shape = scipy.linalg.eigh(whole, body)
    modal = np.diag(2.0 * damping_ratio * np.sqrt(square))
    still = vectors.T @ np.linalg.solve(whole, load)
    if rest is None:
        rest = np.tile(still, (steps, 1))
    table = MeshTable(
        edges=jnp.asarray(edges),
        stiffness=jnp.asarray(stiffness),
        gap=jnp.zeros((3, steps, cells)) if gap is None else jnp.asarray(gap),
        arms=jnp.ones((3, steps, cells, 1)) if arms is None else jnp.asarray(arms),
        coupling=None,
        periods=1,
        kinds=(0,) * steps if kinds is None else tuple(kinds),
    )
    return DynamicSystem(
        mass=jnp.asarray(body),
        damping=jnp.asarray(body @ shape @ modal @ shape.T @ body),
        stiffness=jnp.asarray(spring),
        gyroscopic=None,
        vectors=jnp.asarray(vectors),
        load=jnp.asarray(load),
        bow=None,
        mean=jnp.asarray(mean_),
        table=table,
        cell_damping=None,
        # What the mesh carries: loads on two bodies press it once.
        force=jnp.asarray((mean_ @ still)[0]),
        transmission=jnp.asarray(vectors)[:, 0],
        rest=jnp.asarray(rest, dtype=float),
        free=jnp.zeros((body.shape[0], 0)),
        teeth=1,
    )


def _even(steps: int) -> np.ndarray:
    return np.arange(steps + 1) / steps


def _jumping(edges: np.ndarray, contact_ratio: float) -> np.ndarray:
    """Stiffness of tooth pairs in contact in the middle of each step, mean 1; edges in periods."""
    whole = np.floor(contact_ratio)
    middle = 0.5 * (edges[1:] + edges[:-1]) % 1.0
    return (whole + (middle < contact_ratio - whole)) / contact_ratio


@functools.cache
def square_wave(
    *, damping_ratio: float = 0.05, contact_ratio: float = 1.625, steps: int = 64, waves: int = 1
) -> DynamicSystem:
    """Stiffness that jumps, on equal steps, with several mesh periods in the cycle."""
    edges = _even(steps)
    return _built(edges, _jumping(waves * edges, contact_ratio), damping_ratio=damping_ratio)


@functools.cache
def whole_pairs(contact_ratio: float, *, steps: int = 100, first: int = 60) -> DynamicSystem:
    """Stiffness that jumps, on steps that end where it does; of zero length at whole ratios."""
    part = contact_ratio - np.floor(contact_ratio)
    entered = part * np.arange(first) / first
    alone = part + (1.0 - part) * np.arange(steps - first + 1) / (steps - first)
    whole = np.floor(contact_ratio)
    stiffness = np.repeat([whole + 1.0, whole], [first, steps - first]) / contact_ratio
    kinds = (0,) * first + (1,) * (steps - first)
    return _built(np.concatenate([entered, alone]), stiffness, kinds=kinds)


@functools.cache
def light_tooth(*, steps: int, waves: int = 1) -> DynamicSystem:
    """A light mass between contact and body: a mode 250 times as fast as the mesh's."""
    springs = 30.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    edges = _even(steps)
    return _built(
        edges,
        _jumping(waves * edges, 1.625),
        mass=np.diag([1.0, 5e-4]),
        structure=springs,
        vectors=[[0.0], [1.0]],
        load=[1.0, 0.0],
    )


@functools.cache
def slow_driveline(*, steps: int = 64) -> DynamicSystem:
    """Behind a soft coupling, a heavy flywheel: a mode fifty times as slow as the mesh's."""
    edges = _even(steps)
    integral = edges + 0.3 * np.sin(2.0 * np.pi * edges) / (2.0 * np.pi)
    soft = 20.0 * 0.02**2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return _built(
        edges,
        np.diff(integral) * steps,
        mass=np.diag([20.0, 1.0]),
        damping_ratio=0.02,
        structure=soft,
        vectors=[[0.0], [1.0]],
        load=[1.0, 0.0],
    )


@functools.cache
def light_mode(*, steps: int, waves: int = 1) -> DynamicSystem:
    """Closed contact, damping of half a per cent, a gap with a weak third harmonic."""
    phase = 2.0 * np.pi * waves * _places(steps)
    gap = (np.cos(phase) + 0.3 * np.cos(3.0 * phase + 1.0))[..., None]
    return _built(
        _even(steps),
        np.ones(steps),
        damping_ratio=0.005,
        load=[100.0],
        gap=gap,
        rest=100.0 + gap[1],
    )


def _places(steps: int) -> np.ndarray:
    edges = _even(steps)
    return np.stack([edges[:-1], 0.5 * (edges[:-1] + edges[1:]), edges[1:]])


@functools.cache
def relieved(load: float, *, steps: int = 100, contact_ratio: float = 1.6) -> DynamicSystem:
    """Spur teeth with unit relief at both ends of the path, over half a pitch each."""
    place = _places(steps)[..., None] + np.array([0.0, 1.0])
    inside = (place[1] < contact_ratio).astype(float)
    ends = np.minimum(place, contact_ratio - place)
    gap = np.clip(1.0 - ends / 0.5, 0.0, 2.0) ** 2
    stiffness = inside / contact_ratio
    # The quasi-static approach of each step, by bisection.
    low, high = np.zeros(steps), np.full(steps, 10.0 + 10.0 * load)
    for _ in range(80):
        middle = 0.5 * (low + high)
        short = np.sum(stiffness * np.maximum(middle[:, None] - gap[1], 0.0), axis=1) < load
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    closed = low[:, None] > gap[1]
    mean = np.mean(np.sum(stiffness * closed, axis=1))
    return _built(_even(steps), stiffness, load=[load], gap=gap, mean=[[mean]], rest=low[:, None])


@functools.cache
def two_bodies(bearing: float, *, steps: int = 100) -> DynamicSystem:
    """A body on bearings of any stiffness, in mesh with one that only the mesh holds."""
    edges = _even(steps)
    integral = edges + 0.3 * np.sin(2.0 * np.pi * edges) / (2.0 * np.pi)
    return _built(
        edges,
        np.diff(integral) * steps,
        mass=np.eye(2),
        structure=np.diag([bearing, 0.0]),
        vectors=[[-1.0], [1.0]],
        load=[-1.0, 1.0],
        rest=np.ones((steps, 1)),
    )


@functools.cache
def face(slices: int, *, steps: int = 100) -> DynamicSystem:
    """Approach and tilt, a face of many slices that is crowned and tilted, or of one."""
    edges = _even(steps)
    integral = edges + 0.3 * np.sin(2.0 * np.pi * edges) / (2.0 * np.pi)
    across = (np.arange(slices) + 0.5) / slices - 0.5
    stiffness = np.tile((np.diff(integral) * steps)[:, None] / slices, (1, slices))
    gap = np.broadcast_to(2.0 * across**2 + across, (3, steps, slices))
    arms = np.stack([np.ones(slices), across], axis=-1)
    mean = arms.T @ arms / slices
    return _built(
        edges,
        stiffness,
        mass=np.diag([1.0, 0.05]),
        structure=np.diag([0.0, 0.1]),
        vectors=np.eye(2),
        load=[1.0, 0.0],
        gap=gap,
        arms=np.broadcast_to(arms, (3, steps, slices, 2)),
        mean=mean,
    )


# --- programs, each compiled once for systems of one shape


# Systems are run in batches of so many, filled up, so that few programs are compiled.
_LANES = 16


def _stacked(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


def _batches(run: Callable[..., Any], *lanes: Any) -> Any:
    """Run a batched program over lists of equal length, and join what it gives."""
    count = len(lanes[0])
    found = []
    for first in range(0, count, _LANES):
        batch = [list(lane[first : first + _LANES]) for lane in lanes]
        filled = [part + part[-1:] * (_LANES - len(part)) for part in batch]
        found.append(jax.tree.map(np.asarray, run(*map(_stacked, filled))))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *found)


def _lanes_of(tree: Any) -> list[Any]:
    count = jax.tree.leaves(tree)[0].shape[0]
    return [jax.tree.map(lambda x, i=i: x[i], tree) for i in range(count)]


@eqx.filter_jit
def _marches(systems, speeds, starts, stepper, cycles, keep, averaged):
    run = lambda system, speed, start: time_history(
        system, speed, start, cycles=cycles, keep=keep, stepper=stepper, averaged=averaged
    )
    return jax.vmap(run)(systems, speeds, starts)


@eqx.filter_jit
def _quasi_static(systems):
    return jax.vmap(quasi_static_start)(systems)


def still(systems: Sequence[DynamicSystem]) -> np.ndarray:
    """The quasi-static start of each system."""
    return _batches(_quasi_static, systems)


def marched(
    systems: Sequence[DynamicSystem],
    speeds: ArrayLike,
    stepper: AbstractStepper,
    cycles: int,
    keep: int = 1,
    *,
    starts: ArrayLike | None = None,
    averaged: bool = False,
):
    """March systems side by side, by default from the quasi-static state."""
    starts = still(systems) if starts is None else np.asarray(starts)
    run = lambda built, slow, start: _marches(built, slow, start, stepper, cycles, keep, averaged)
    return _batches(run, systems, np.asarray(speeds, dtype=float), starts)


@eqx.filter_jit
def _orbits(systems, speeds, method):
    return jax.lax.map(lambda given: method.orbit(*given, None), (systems, speeds))


def balanced(
    systems: Sequence[DynamicSystem], speeds: ArrayLike, method: AbstractMethod = HarmonicBalance()
):
    """Cold starts of a method."""
    run = lambda built, slow: _orbits(built, slow, method)
    return _batches(run, systems, np.asarray(speeds, dtype=float))


@eqx.filter_jit
def _matrices(systems, orbits):
    def at(given):
        system, orbit = given
        modes = modal_basis(system)
        return monodromy(system, modes, orbit), modes

    return jax.lax.map(at, (systems, orbits))


def floquet(systems: Sequence[DynamicSystem], orbits) -> np.ndarray:
    """Sizes of the multipliers of each orbit, largest first."""
    matrices, modes = _batches(_matrices, systems, _lanes_of(orbits))
    each = jax.tree.map(jnp.asarray, list(zip(matrices, _lanes_of(modes), strict=True)))
    return np.abs(np.array([floquet_multipliers(matrix, basis) for matrix, basis in each]))


def _rms(place: ArrayLike) -> np.ndarray:
    """RMS about the mean of lanes of samples of the first coordinate."""
    return np.std(np.asarray(place)[..., 0], axis=1)


def _most(load: ArrayLike) -> np.ndarray:
    return np.max(np.asarray(load)[..., 0], axis=1)


def _size(value: float) -> str:
    return f"{value:.1e}"


def _listed(values: ArrayLike) -> str:
    return ", ".join(f"{value:g}" for value in np.asarray(values)) or "no speed"


def _percent(value: float, digits: int = 1) -> str:
    return f"{100.0 * value:.{digits}f} %"


# --- the rows


# Steps in a cycle of marches that compare step lengths.
_FINE = 256


@functools.cache
def steps_too_large() -> Row:
    """Newmark with few steps in a mesh period, where harmonics meet the mode, and far below."""
    speeds, waves = np.array([1 / 2, 1 / 4, 1 / 5, 0.01]), (16, 8, 4)
    counts = [_FINE // count for count in waves]
    systems = [square_wave(steps=_FINE, waves=count) for count in waves for _ in speeds]
    slowed = np.array([speed / count for count in waves for speed in speeds])
    judge = reference.rectangular(0.05, 1.625)
    start = np.array([[1.0] * 3, [0.0] * 3])
    path, _ = reference.march_many(judge, speeds[:3], start, periods=30, steps=200)
    known = np.append(np.std(path[-400:], axis=0), _exact_rectangular(1.625, 0.05, speeds[3]))

    marches = [marched(systems, slowed, stepper, 160, 8) for stepper in (Newmark(), Exponential())]
    newmark, exponential = (_rms(history.motion).reshape(3, 4) / known - 1.0 for history in marches)
    drift = marches[0].drift[:, -1].reshape(3, 4)
    quiet = (drift <= TimeStepping().tolerance) & (abs(newmark) > 0.05)
    orbits = balanced([square_wave()] * 4, speeds)
    default = _rms(orbits.place) / known - 1.0

    def draw(ax: Axes) -> None:
        for speed, lane in zip(("1/2", "1/4", "1/5", "0.01"), newmark.T, strict=True):
            ax.loglog(counts, abs(lane), "o-", label=f"Newmark, speed {speed}")
        ax.set_prop_cycle(None)
        for lane, name in zip(
            exponential.T, ("Exponential, same speeds", *[None] * 3), strict=True
        ):
            ax.loglog(counts, abs(lane), "x:", label=name)
        ax.loglog([64] * 4, abs(default), "k*", label="harmonic balance")
        ax.set(xlabel="steps in a mesh period", ylabel="error of RMS [-]", ylim=(1e-5, 1e6))
        ax.set_xticks(counts, labels=map(str, counts))
        ax.minorticks_off()

    worst, slow = abs(newmark[:, :3]).max(axis=1), newmark[:, 3]
    fewer = [f"{_percent(w)} (N = {n})" for w, n in zip(worst, counts, strict=True)]
    return Row(
        title="Steps too large",
        method="Newmark",
        breaks=f"Error of the RMS of up to {', '.join(fewer)} at speeds 1/2, 1/4 and 1/5 of the "
        f"mesh mode. At speed 0.01 the RMS is {_listed(np.round(slow + 1.0, 2))} times the right "
        f"one: jumps of the stiffness feed energy. {quiet.sum()} of the "
        f"{(abs(newmark) > 0.05).sum()} marches that are off by more than 5 % have settled, and "
        "give no sign of it.",
        default=f"Harmonic balance on 64 samples: {_percent(abs(default[:3]).max(), 2)}, "
        f"{_percent(abs(default[3]))} at speed 0.01. Marching by `Exponential`, N = 64: "
        f"{_percent(abs(exponential[-1, :3]).max())} and {_percent(abs(exponential[-1, 3]))}.",
        note="Stiffness jumps between 1.23 and 0.62. At low speeds a mesh period holds many "
        "periods of the mode, and steps must resolve these: N = 64 at speed 1/5 is 13 steps in a "
        "period. At vanishing speed the quasi-static cycle is the answer, not a march.",
        numbers={
            "newmark": newmark,
            "exponential": exponential,
            "default": default,
            "quiet": int(quiet.sum()),
            "settled": bool(np.all(orbits.settled)),
        },
        draw=draw,
    )


@functools.cache
def ringing() -> Row:
    """A light mass behind the contact, hit at each impact; undamped bouncing."""
    speed, coarse, fine = 0.8, 96, 768
    alternation = {}
    traces = {}
    steppers = {
        "Newmark": Newmark(),
        "HHT": HilberHughesTaylor(-0.1),
        "Exponential": Exponential(),
    }
    systems = [light_tooth(steps=fine, waves=count) for count in (8, 1)]
    slowed = [speed / 8, speed]
    for name, stepper in steppers.items():
        history = marched(systems, slowed, stepper, 40)
        force = np.asarray(history.load[..., 0])
        traces[name] = force[0, :coarse]
        if name == "Exponential":
            traces["truth"] = force[1, 4::8]
    for name, force in traces.items():
        closed = (force[:-2] > 0.0) & (force[1:-1] > 0.0) & (force[2:] > 0.0)
        bend = abs(force[1:-1] - 0.5 * (force[2:] + force[:-2]))[closed]
        # The largest are the jumps of the stiffness.
        alternation[name] = float(np.quantile(bend, 0.9))

    lengths = np.array([0.5, 0.2, 0.1])
    frictionless = square_wave(damping_ratio=0.0, contact_ratio=1.0)
    tall = np.tile([[[4.0], [0.0]]], (3, 1, 1))

    def energy(stepper: AbstractStepper, *, averaged: bool = False) -> np.ndarray:
        history = marched(
            [frictionless] * 3,
            2.0 * np.pi / (64 * lengths),
            stepper,
            40,
            40,
            starts=tall,
            averaged=averaged,
        )
        x, v = np.asarray(history.motion[..., 0]), np.asarray(history.velocity[..., 0])
        # Above the rest at x = 1, over the 4.5 that it begins with.
        return (0.5 * v**2 + 0.5 * np.maximum(x, 0.0) ** 2 - x + 0.5) / 4.5 - 1.0

    by_newmark, by_average = energy(Newmark()), energy(Midpoint(), averaged=True)

    def draw(ax: Axes) -> None:
        phase = (np.arange(coarse) + 0.5) / coarse
        ax.plot(phase, traces["Newmark"], ".-", lw=0.8, ms=3, label="Newmark, beta = 1/4")
        ax.plot(phase, traces["HHT"], lw=1.0, label="HHT, alpha = -0.1")
        ax.plot(phase, traces["truth"], "k:", lw=1.0, label="converged")
        ax.set(xlabel="phase [mesh periods]", ylabel="mesh force / load [-]", xlim=(0.0, 0.35))

    return Row(
        title="Ringing after impacts, energy of bouncing",
        method="Newmark, beta = 1/4",
        breaks="A mode 250 times as fast as the mesh's rings after each impact: in a tenth of the "
        "steps in contact the mesh force alternates by more than "
        f"{alternation['Newmark']:.2f} of the load (converged: "
        f"{alternation['truth']:.3f}). Undamped bouncing gains up to "
        f"{_percent(by_newmark[0].max())} of its energy at steps of 0.5, "
        f"{_percent(by_newmark[1].max())} at 0.2.",
        default=f"Alternation {alternation['HHT']:.3f} with HHT, {alternation['Exponential']:.3f} "
        f"with `Exponential`, by which sweeps and shooting march. "
        f"`Midpoint` with averaged contact keeps the energy to {_size(abs(by_average).max())}.",
        note="Newmark's rule leaves almost all of a mode that it does not resolve, in every step. "
        "The energy of averaged contact is exact because stiffness is constant here.",
        numbers={
            "alternation": alternation,
            "newmark_energy": by_newmark,
            "averaged_energy": by_average,
        },
        draw=draw,
    )


@functools.cache
def smoothing() -> Row:
    """Smooth contact of many widths, at contact loss and under lighter loads."""
    system, speed = sdof_parametric(steps=100), 1.0
    widths = np.array([1e-8, 1e-4, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0])

    @eqx.filter_jit
    def smooth(system, speed, widths):
        at = lambda width: HarmonicBalance(law=SmoothContact(width)).orbit(system, speed)
        return jax.lax.map(at, widths)

    orbits = smooth(system, jnp.asarray(speed), jnp.asarray(widths))
    exact = balanced([system], [speed])
    known = float(_rms(exact.place)[0])
    bias = abs(_rms(orbits.place) / known - 1.0)
    steps = np.asarray(orbits.steps)
    order = float(np.polyfit(np.log(widths[2:6]), np.log(bias[2:6]), 1)[0])
    sharp_steps = {width: _explicit_steps(width) for width in (0.0, 1e-4, 0.03, 0.3)}

    def draw(ax: Axes) -> None:
        seen = bias > 0.0
        ax.loglog(widths[seen], bias[seen], "o-")
        ax.loglog(widths[2:7], bias[4] * (widths[2:7] / 0.1) ** 2, "k:", label="width squared")
        ax.set(xlabel="width / static deflection [-]", ylabel="bias of RMS [-]")

    return Row(
        title="Smoothing too wide, too sharp",
        method="`SmoothContact`",
        breaks=f"Bias of the RMS {_size(bias[3])}, {_size(bias[4])}, {_size(bias[5])}, "
        f"{bias[6]:.2f}, {bias[7]:.2f} at widths of 0.03, 0.1, 0.3, 1 and 3 static deflections "
        f"(order {order:.2f}): a width of 3 % under full load is 100 % under 3 % of it.",
        default="Exact contact: no bias, no width to choose.",
        note="Too sharp does no harm: a width of 1e-8 has no bias, and takes "
        f"{steps[0]:.0f} Newton steps, exact contact {float(exact.steps[0]):.0f}, wide contact "
        f"{steps[4]:.0f}. Explicit Runge-Kutta needs "
        f"{sharp_steps[0.0]}, {sharp_steps[1e-4]}, {sharp_steps[0.03]}, {sharp_steps[0.3]} "
        "evaluations for widths of 0, 1e-4, 0.03 and 0.3: sharp contact of this stiffness is not "
        "stiff.",
        numbers={
            "widths": widths,
            "bias": bias,
            "order": order,
            "steps": steps,
            "exact_steps": float(exact.steps[0]),
            "settled": np.asarray(orbits.settled),
            "evaluations": sharp_steps,
        },
        draw=draw,
    )


def _explicit_steps(width: float) -> int:
    """Evaluations of an adaptive Runge-Kutta method over ten mesh periods at speed 1."""

    def slope(time, state):
        x, v = state
        t = x / width if width > 0.0 else np.inf * np.sign(x)
        pressed = max(x, 0.0) if abs(t) >= 1.0 else width * (1.0 + t) ** 3 * (3.0 - t) / 16.0
        return v, 1.0 - 0.1 * v - (1.0 + 0.3 * np.cos(time)) * pressed

    found = scipy.integrate.solve_ivp(slope, (0.0, 20.0 * np.pi), (3.0, 0.0), rtol=1e-6, atol=1e-8)
    return int(found.nfev)


@functools.cache
def harmonics_and_samples() -> Row:
    """Harmonic balance at contact loss with few harmonics, and with few samples."""
    speed, waves = 1.0, (1, 2, 4, 5, 10, 20)
    counts = [20 // count for count in waves]
    many = [sdof_parametric(steps=400, waves=count) for count in waves]
    few = [sdof_parametric(steps=60, waves=count) for count in waves[:-1]]
    orbits = balanced(many, [speed / count for count in waves])
    coarse = balanced(few, [speed / count for count in waves[:-1]])
    start = np.asarray(orbits.start[0])[:, 0]
    judge = reference.parametric()
    settled = reference.sweep(
        judge, [speed], (float(start[0]), float(start[1])), periods=40, steps=200
    )[speed]
    known = settled.statistics.rms
    by_harmonics = _rms(orbits.place) / known - 1.0
    by_samples = _rms(coarse.place) / known - 1.0
    # What a Fourier series of the force would say, cut at five harmonics.
    force = np.asarray(orbits.load[0, :, 0])
    lines = np.fft.rfft(force)
    lines[6:] = 0.0
    series = np.fft.irfft(lines, force.size)

    def draw(ax: Axes) -> None:
        ax.loglog(counts, abs(by_harmonics), "o-", label="20 samples per harmonic")
        ax.loglog(counts[:-1], abs(by_samples), "s--", label="3 samples per harmonic")
        ax.set(xlabel="harmonics", ylabel="error of RMS [-]", xticks=counts)
        ax.set_xticklabels(map(str, counts))
        ax.minorticks_off()

    return Row(
        title="Too few harmonics, too few samples",
        method="Harmonic balance",
        breaks="Contact is lost; error of the RMS with 1, 2, 5 harmonics "
        f"{_size(abs(by_harmonics[5]))}, {_size(abs(by_harmonics[4]))}, "
        f"{_size(abs(by_harmonics[2]))}. With 3 samples per harmonic instead "
        f"of 20: {_size(by_samples[4])} (H = 2), {_size(by_samples[2])} (H = 5).",
        default=f"20 harmonics: {_size(abs(by_harmonics[0]))} on 400 samples, "
        f"{_size(abs(by_samples[0]))} on 60. Fewer than 2 H + 1 samples are refused.",
        note="The force is the law at the motion found, never its own Fourier series, which "
        f"at 5 harmonics pulls with {-series.min():.2f} of the load where contact is open and is "
        f"off by {_percent(abs(series.max() / force.max() - 1.0))} at the peak.",
        numbers={
            "harmonics": counts,
            "by_harmonics": by_harmonics,
            "by_samples": by_samples,
            "settled": bool(np.all(orbits.settled) and np.all(coarse.settled)),
            "least_force": float(force.min()),
            "series_least": float(series.min()),
        },
        draw=draw,
    )


_SWEEP_SPEEDS = np.round(np.arange(0.5, 2.325, 0.05), 3)


@functools.cache
def _swept(direction: Direction) -> tuple[SweepPoint, ...]:
    """The default sweep of B5 (a)."""
    return sweep(sdof_parametric(steps=100), _SWEEP_SPEEDS, direction)


@functools.cache
def _cold():
    """Newton's method alone, from the quasi-static state at every speed, and its stability."""
    system = sdof_parametric(steps=100)
    systems = [system] * _SWEEP_SPEEDS.size
    orbits = balanced(systems, _SWEEP_SPEEDS)
    return orbits, floquet(systems, orbits)


@functools.cache
def past_the_fold() -> Row:
    """Newton's method, from speed to speed downwards, beyond the end of the branch."""
    system, method = sdof_parametric(steps=100), HarmonicBalance()
    speeds = np.round(np.arange(1.2, 0.495, -0.01), 3)

    @eqx.filter_jit
    def followed(system, speeds):
        balance = harmonic_balance_problem(method, system)

        def at(near, speed):
            orbit, terms = method.solve(balance, speed, near)
            return terms, orbit

        return jax.lax.scan(at, balance.rest, speeds)[1]

    orbits = followed(system, jnp.asarray(speeds))
    settled = np.asarray(orbits.settled)
    ratio = _most(orbits.load)
    size = floquet([system] * speeds.size, jax.tree.map(np.asarray, orbits))[:, 0]
    unstable = settled & (size > 1.0 + 1e-6)
    points = _swept("down")
    below = _SWEEP_SPEEDS <= 1.2
    kept = [bool(point.stable) for point, low in zip(points, below, strict=True) if low]
    known = np.array([float(jnp.max(point.orbit.load)) for point in points])[below]

    def draw(ax: Axes) -> None:
        kept_on = np.where(settled & ~unstable, ratio, np.nan)
        ax.plot(speeds, kept_on, "-", label="warm Newton, settled")
        ax.plot(speeds[unstable], ratio[unstable], "m+", label="settled, unstable")
        ax.plot(speeds[~settled], ratio[~settled], "rx", label="not settled")
        ax.plot(_SWEEP_SPEEDS[below], known, "k.", label="default sweep down")
        ax.set(xlabel="speed / mesh mode [-]", ylabel="dynamic ratio [-]", ylim=(0.0, 15.0))

    lost = speeds[~settled]
    return Row(
        title="Newton past a fold",
        method="Harmonic balance, warm start",
        breaks=f"Downwards from 1.2, no root is near below {lost.max() + 0.01:.2f}: "
        f"{lost.size} speeds give dynamic ratios of {ratio[~settled].min():.1f} to "
        f"{ratio[~settled].max():.1f}, residuals up to "
        f"{float(np.max(orbits.residual[~settled])):.2g}.",
        default="Every one of them has `settled` False, and none above has. The default sweep "
        f"marches on from there: {sum(kept)} of {len(kept)} speeds stable and settled.",
        note="Judged by the number alone, some garbage would pass for a resonance. Just before it "
        f"loses its way, at {_listed(speeds[unstable])}, the balance settles on unstable orbits: "
        "multipliers as well as residuals must be looked at.",
        numbers={
            "speeds": speeds,
            "settled": settled,
            "ratio": ratio,
            "residual": np.asarray(orbits.residual),
            "unstable": unstable,
            "sweep_stable": kept,
            "sweep_ratio": known,
            "sweep_speeds": _SWEEP_SPEEDS[below],
        },
        draw=draw,
    )


@functools.cache
def cold_starts() -> Row:
    """What cold starts see of the stable responses that coexist."""
    orbits, size = _cold()
    rms = _rms(orbits.place)
    settled = np.asarray(orbits.settled)
    stable = settled & (size[:, 0] <= 1.0 + 1e-6)
    existing, found, both = 0, 0, 0
    swept = {}
    for direction in ("up", "down"):
        points = _swept(direction)
        assert all(point.stable for point in points)
        swept[direction] = np.array([float(jnp.std(point.orbit.place)) for point in points])
    for i in range(_SWEEP_SPEEDS.size):
        known = [swept["up"][i]]
        if abs(swept["down"][i] / known[0] - 1.0) > 1e-3:
            known.append(swept["down"][i])
        existing += len(known)
        both += len(known)
        found += stable[i] and min(abs(rms[i] / x - 1.0) for x in known) < 1e-3
    # An independent count at some speeds.
    judged = {}
    for speed in (0.75, 0.9, 1.5, 2.0):
        all_known = reference.catalogue(
            reference.parametric(), speed, across=5, settling=20, steps=100
        )
        index = int(np.argmin(abs(_SWEEP_SPEEDS - speed)))
        judged[speed] = (
            sorted(m.statistics.rms for m in all_known if m.stable),
            sorted({round(swept[d][index], 3) for d in swept}),
        )
    missed = 1.0 - found / existing

    def draw(ax: Axes) -> None:
        ax.plot(_SWEEP_SPEEDS, swept["up"], "^", ms=4, label="sweep up")
        ax.plot(_SWEEP_SPEEDS, swept["down"], "v", ms=4, label="sweep down")
        ax.plot(_SWEEP_SPEEDS[stable], rms[stable], "k-", lw=0.8, label="cold, stable")
        ax.plot(_SWEEP_SPEEDS[~stable], rms[~stable], "rx", label="cold, unstable or not settled")
        ax.set(xlabel="speed / mesh mode [-]", ylabel="RMS of motion [-]", ylim=(0.0, 3.2))

    return Row(
        title="Cold starts on one branch only",
        method="Cold starts, quasi-static",
        breaks=f"Newton's method from the quasi-static state settles at {settled.sum()} of "
        f"{settled.size} speeds, on a stable response at {stable.sum()}; it sees {found} of the "
        f"{existing} stable responses and misses {_percent(missed, 0)}.",
        default=f"Sweeps up and down together: all {both}, each settled and stable.",
        note="The count is that of both sweeps; an independent search at 0.75, 0.9, 1.5 and 2 "
        "finds no other. Isolated branches could still be missed.",
        numbers={
            "settled": settled,
            "stable": stable,
            "existing": existing,
            "found": int(found),
            "judged": judged,
        },
        draw=draw,
    )


@functools.cache
def light_load() -> Row:
    """Relieved teeth under ever lighter loads, until everything separates."""
    loads = np.array([10.0, 1.0, 0.1, 0.01])
    speeds = np.linspace(0.2, 2.4, 32)
    shares: dict[str, list[float]] = {"harmonic balance": [], "shooting": [], "marching": []}
    opens = []
    for load in loads:
        system = relieved(float(load))
        slow = speeds * float(np.sqrt(system.mean[0, 0]))
        orbits = balanced([system] * speeds.size, slow)
        shot = balanced([system] * speeds.size, slow, Shooting())
        shares["harmonic balance"].append(float(np.mean(orbits.settled)))
        shares["shooting"].append(float(np.mean(shot.settled)))
        opens.append(float(np.mean(np.min(np.asarray(shot.load)[..., 0], axis=1) <= 0.0)))
        history = marched([system] * speeds.size, slow, Newmark(), 200)
        settled = (history.drift[:, -1] <= TimeStepping().tolerance) & history.converged
        shares["marching"].append(float(np.mean(settled)))
        if load == loads[-1]:
            finite = bool(np.all(np.isfinite(orbits.place)) and np.all(np.isfinite(shot.place)))
            size = floquet([system] * speeds.size, shot)[:, 0]
            stable = float(np.mean(np.asarray(shot.settled) & (size <= 1.0 + 1e-6)))
    points = sweep(relieved(0.01), speeds * float(np.sqrt(relieved(0.01).mean[0, 0])), "up")
    swept = float(np.mean([point.settled for point in points]))

    def draw(ax: Axes) -> None:
        for (name, lane), mark in zip(shares.items(), "os^", strict=True):
            ax.semilogx(loads, lane, mark + "-", label=name)
        ax.semilogx(loads, opens, "k:", label="lose contact")
        ax.set(xlabel="load / (stiffness x relief) [-]", ylabel="share of speeds [-]")

    per = lambda name: ", ".join(f"{100 * x:.0f}" for x in shares[name])
    return Row(
        title="Light load",
        method="All methods",
        breaks="Share of speeds that settle, in per cent, under loads of 10, 1, 0.1 and 0.01 of "
        f"stiffness times relief: cold harmonic balance {per('harmonic balance')}; shooting "
        f"{per('shooting')}; 200 cycles of Newmark {per('marching')}. Contact is lost at "
        + ", ".join(f"{100 * x:.0f}" for x in opens)
        + " per cent of the speeds.",
        default=f"The default sweep at the lightest load: {_percent(swept, 0)} settled; the others "
        "are kept as marches, flagged.",
        note="Speeds are 0.2 to 2.4 times the mesh mode, whose frequency falls with the load. What "
        f"shooting settles on at the lightest load is stable at {_percent(stable, 0)} of the "
        "speeds only; the sweep keeps stable responses over one cycle or two.",
        numbers={
            "shares": shares,
            "opens": opens,
            "sweep": swept,
            "stable": stable,
            "finite": finite,
        },
        draw=draw,
    )


@functools.cache
def zero_damping() -> Row:
    """No damping: linear and parametric response, in and off resonance."""
    speeds = np.array([0.77, 0.9, 1.0, 1.3])
    closed = sdof_driven(load=10.0, damping_ratio=0.0, steps=100)
    parametric = sdof_parametric(damping_ratio=0.0, steps=100)
    off = np.array([0.6, 0.7, 1.5, 2.2])
    systems = [closed] * 4 + [parametric] * 4
    every = np.concatenate([speeds, off])
    orbits = balanced(systems, every)
    order = np.arange(1, 6)
    known = [np.sqrt(0.5 * np.sum((1.0 / order**2 / (1.0 - (order * s) ** 2)) ** 2)) for s in
             speeds[[0, 1, 3]]]  # fmt: skip
    error = abs(_rms(orbits.place)[[0, 1, 3]] / known - 1.0)
    good = np.asarray(orbits.settled)
    size = floquet([parametric] * 4, jax.tree.map(lambda x: x[4:], orbits))
    history = marched(systems, every, Exponential(), 400)
    drift = np.asarray(history.drift)

    def draw(ax: Axes) -> None:
        for lane, speed in ((1, 0.9), (4, 0.6), (6, 1.5)):
            ax.semilogy(drift[lane], lw=0.6, label=f"speed {speed}")
        ax.set(xlabel="cycle", ylabel="change over a cycle [-]", ylim=(1e-3, 20.0))

    return Row(
        title="Zero damping",
        method="Marching; harmonic balance at resonance",
        breaks=f"After 400 cycles the state still changes by {drift[:, -1].min():.2f} to "
        f"{drift[:, -1].max():.1f} of itself per cycle: no march settles. At resonance harmonic "
        f"balance has no answer (`settled` {bool(good[2])}, the motion is NaN).",
        default="Off resonance harmonic balance needs no damping: closed form to "
        f"{_size(error.max())}, parametric cases settled. Multipliers lie on the unit circle to "
        f"{_size(abs(size - 1.0).max())}: a neutral orbit, which machines do not forget.",
        note="A flagged NaN stays in the orbit; whoever writes files must look at `settled`.",
        numbers={
            "settled": good,
            "closed_error": error,
            "multipliers": size,
            "drift": drift,
            "resonant_finite": bool(np.all(np.isfinite(orbits.place[2]))),
        },
        draw=draw,
    )


@functools.cache
def whole_contact_ratios() -> Row:
    """Contact ratios of exactly 1 and 2, where some steps have no length."""
    near = 1e-6
    ratios = np.array([2.0 - near, 2.0, 2.0 + near, 1.0, 1.0 + near, 2.0 - 0.02, 2.0 + 0.02])
    systems = [whole_pairs(ratio) for ratio in ratios]
    speeds = np.full(ratios.size, 0.5)
    orbits = balanced(systems, speeds)
    history = marched(systems, speeds, Newmark(), 60)
    places = {"balance": np.asarray(orbits.place), "newmark": np.asarray(history.motion)}
    swing = {name: np.ptp(x[..., 0], axis=1) for name, x in places.items()}
    finite = all(np.all(np.isfinite(x)) for x in places.values())

    def draw(ax: Axes) -> None:
        for lane in (5, 1, 6):
            edges = np.asarray(systems[lane].table.edges)
            middle = 0.5 * (edges[1:] + edges[:-1])
            ax.plot(middle, places["balance"][lane, :, 0], label=f"contact ratio {ratios[lane]:g}")
        ax.set(xlabel="phase [mesh periods]", ylabel="motion / static deflection [-]")

    gap = abs(swing["balance"][[0, 2, 4]]).max()
    return Row(
        title="Whole contact ratios",
        method="Event-aligned steps",
        breaks="At contact ratios of exactly 1 and 2 the 60 or 40 steps of one of the two parts of "
        "a mesh period have no length. This does NOT fail: all methods stay finite.",
        default=f"The swing is {_size(swing['balance'][[1, 3]].max())} there and {_size(gap)} at "
        "1e-6 to either side (harmonic balance); Newmark: "
        f"{_size(swing['newmark'][[1, 3]].max())} and {_size(swing['newmark'][[0, 2, 4]].max())}.",
        note="Between 1.98 and 2.02 the swing goes to zero from both sides: "
        f"{swing['balance'][5]:.3f}, 0, {swing['balance'][6]:.3f}.",
        numbers={
            "swing": swing,
            "finite": bool(finite),
            "settled": np.asarray(orbits.settled),
            "converged": bool(np.all(history.converged)),
        },
        draw=draw,
    )


@functools.cache
def long_gradients() -> Row:
    """Derivatives of the RMS mesh force through a march, and by the implicit function theorem."""
    cycles = 400
    chaotic = square_wave(damping_ratio=0.02, contact_ratio=1.6, steps=100)
    smooth = sdof_parametric(steps=100)
    names = ("chaos 0.5", "chaos 0.21", "cold 0.83", "warm 0.84", "regular 1.0")
    speeds = np.array([0.5, 0.21, 0.83, 0.84, 1.0])
    systems = [chaotic, chaotic, smooth, smooth, smooth]

    def rippled(system: DynamicSystem, change: jax.Array) -> DynamicSystem:
        stiffness = 1.0 + (1.0 + change) * (system.table.stiffness - 1.0)
        return eqx.tree_at(lambda s: s.table.stiffness, system, stiffness)

    def rms(load: jax.Array) -> jax.Array:
        return jnp.std(load[:, 0])

    method = HarmonicBalance(averaged=True)

    @eqx.filter_jit
    def implicit(systems, speeds, changes):
        def at(given):
            system, speed, change = given

            def steady(change):
                orbit = method.orbit(rippled(system, change), speed)
                return rms(orbit.load), orbit

            value, slope, orbit = jax.jvp(steady, (change,), (jnp.ones(()),), has_aux=True)
            return value, slope, orbit

        return jax.lax.map(at, (systems, speeds, changes))

    nudge = 1e-6
    changes = np.repeat([0.0, nudge, -nudge], len(names))
    value, slope, orbits = _batches(implicit, systems * 3, np.tile(speeds, 3), changes)
    _, ahead, behind = np.split(value, 3)
    central, slope = (ahead - behind) / (2.0 * nudge), slope[: len(names)]
    orbits = jax.tree.map(lambda x: x[: len(names)], orbits)
    size = floquet(systems, orbits)[:, 0]

    @eqx.filter_jit
    def through(systems, speeds, starts):
        def one(system, speed, start):
            def values(change):
                moved = rippled(system, change)

                def over(state, _):
                    history = time_history(moved, speed, state, cycles=1, averaged=True)
                    ended = jnp.stack([history.motion[-1], history.velocity[-1]])
                    return ended, rms(history.load)

                return jax.lax.scan(over, start, length=cycles)[1]

            return jax.jvp(values, (jnp.zeros(()),), (jnp.ones(()),))

        return jax.vmap(one)(systems, speeds, starts)

    rest = np.array([[1.0], [0.0]])
    starts = np.stack([rest, rest, rest, orbits.start[3], rest])
    gradient = np.asarray(through(_stacked(systems), jnp.asarray(speeds), starts)[1])
    seen = (10, 30, 100, 400)

    def draw(ax: Axes) -> None:
        for lane, name in enumerate(names):
            ax.semilogy(np.arange(1, cycles + 1), abs(gradient[lane]), lw=0.8, label=name)
        ax.plot([cycles] * 3, abs(slope[2:]), "k*", label="implicit")
        ax.set(xlabel="cycles marched", ylabel="size of the derivative [-]", ylim=(1e-2, 1e30))

    powers = ", ".join(_size(abs(gradient[0, count - 1])) for count in seen)
    fault = abs(slope[2:] / central[2:] - 1.0).max()
    return Row(
        title="Derivatives through a long march",
        method="Derivatives through marching",
        breaks=f"In a chaotic band (rectangular stiffness, damping 2 %, speed 0.5) the derivative "
        f"by the ripple after 10, 30, 100, 400 cycles is {powers}. Beside a jump (0.83) the march "
        f"from rest is on the other branch: {gradient[2, -1]:.3f} instead of {slope[2]:.3f}. "
        f"At 1.0, off all jumps, 10 cycles from rest give {gradient[4, 9]:.3f}, 100 cycles "
        f"{gradient[4, 99]:.4f}.",
        default=f"By the implicit function theorem {slope[2]:.4f}, {slope[3]:.4f}, {slope[4]:.4f}; "
        f"central differences of converged orbits agree to {_size(fault)}.",
        note=f"In the chaotic band the balance's orbit (settled: {bool(orbits.settled[0])}) has a "
        f"multiplier of {size[0]:.2g} and a finite derivative {slope[0]:.3g}: right for that "
        "orbit, on which no machine stays. A march that starts on the orbit at 0.84, close to the "
        f"fold, does NOT fail: 10 cycles give {gradient[3, 9]:.3f}. The largest multipliers at "
        "0.83, 0.84 and 1 are " + ", ".join(f"{x:.3f}" for x in size[2:]) + ".",
        numbers={
            "gradient": gradient,
            "implicit": slope,
            "central": central,
            "multiplier": size,
            "settled": np.asarray(orbits.settled),
        },
        draw=draw,
    )


def _exact_rectangular(contact_ratio: float, damping_ratio: float, speed: float) -> float:
    """RMS of the motion while contact is kept, by exponentials of the two linear parts."""
    part = contact_ratio - 1.0
    samples = 2000
    period = 2.0 * np.pi / speed

    def over(stiffness: float, time: float) -> np.ndarray:
        matrix = [[0.0, 1.0, 0.0], [-stiffness, -2.0 * damping_ratio, 1.0], [0.0, 0.0, 0.0]]
        return scipy.linalg.expm(np.array(matrix) * time)

    pieces = [(2.0 / contact_ratio, part), (1.0 / contact_ratio, 1.0 - part)]
    cycle = over(pieces[1][0], pieces[1][1] * period) @ over(pieces[0][0], pieces[0][1] * period)
    start = np.linalg.solve(np.eye(2) - cycle[:2, :2], cycle[:2, 2])
    state, paths, weights = np.append(start, 1.0), [], []
    for stiffness, share in pieces:
        step = share * period / samples
        half, whole = over(stiffness, 0.5 * step), over(stiffness, step)
        for _ in range(samples):
            paths.append((half @ state)[0])
            weights.append(share / samples)
            state = whole @ state
    path, weight = np.array(paths), np.array(weights)
    assert path.min() > 0.0
    return float(np.sqrt(weight @ (path - weight @ path) ** 2))


@functools.cache
def unaligned_grid() -> Row:
    """Rectangular stiffness on steps that do not end where it jumps."""
    speed, ratio, total = 1.5, 1.6, 2560
    known = _exact_rectangular(ratio, 0.05, speed)
    # A jump falls on a step's end only if the number of steps is a multiple of five.
    waves, even = (80, 40, 20, 10, 5), (64, 32, 16, 8)
    counts, aligned = (np.array([total // count for count in x]) for x in (waves, even))
    edges = _even(total)

    def integral(time: np.ndarray) -> np.ndarray:
        whole, rest = np.floor(time), time - np.floor(time)
        return whole + (np.minimum(rest, ratio - 1.0) + rest) / ratio

    sampled = [square_wave(contact_ratio=ratio, steps=total, waves=count) for count in waves]
    meant = [_built(edges, np.diff(integral(count * edges)) * total / count) for count in waves]
    grids = [square_wave(contact_ratio=ratio, steps=total, waves=count) for count in even]
    slowed = [speed / count for count in (*waves, *waves, *even)]
    history = marched([*sampled, *meant, *grids], slowed, Newmark(), 24, 8)
    by_sample, by_mean, by_newmark = np.split(_rms(history.motion) / known - 1.0, [5, 10])
    fine = [square_wave(contact_ratio=ratio, steps=100)]
    balance = float(_rms(balanced(fine, [speed]).place)[0]) / known - 1.0

    def draw(ax: Axes) -> None:
        ax.loglog(counts, abs(by_sample), "o-", label="Newmark, unaligned, sampled")
        ax.loglog(counts, abs(by_mean), "s-", label="Newmark, unaligned, mean over the step")
        ax.loglog(aligned, abs(by_newmark), "^-", label="Newmark, aligned")
        ax.loglog([100], abs(balance), "k*", label="harmonic balance, aligned")
        ax.set(xlabel="steps in a mesh period", ylabel="error of RMS [-]")
        ax.set_xticks(counts, labels=map(str, counts))
        ax.minorticks_off()

    return Row(
        title="Unaligned steps",
        method="Marching through jumps of stiffness",
        breaks=f"Stiffness sampled on steps across its jumps: {_size(abs(by_sample[-1]))} with 512 "
        f"steps, no better than {_size(abs(by_newmark[1]))} with 80 aligned ones.",
        default=f"Steps end at entry and exit: {_size(abs(by_newmark[0]))}, "
        f"{_size(abs(by_newmark[1]))}, {_size(abs(by_newmark[2]))} with 40, 80, 160 (Newmark), "
        f"{_size(abs(balance))} with 100 (harmonic balance).",
        note="The table holds the mean of the stiffness over each step. That alone repairs most of "
        f"it: {_size(abs(by_mean[2]))} at 128 unaligned steps, second order.",
        numbers={
            "sampled": by_sample,
            "mean": by_mean,
            "counts": counts,
            "aligned": by_newmark,
            "balance": balance,
        },
        draw=draw,
    )


@functools.cache
def period_elongation() -> Row:
    """A lightly damped mode beside the third mesh harmonic: closed contact, closed form."""
    damping_ratio = 0.005
    speeds = np.array([0.32, 0.33, 1.0 / 3.0, 0.336])
    waves, total = (8, 4, 2, 1), _FINE
    counts = [total // count for count in waves]
    order, size = np.array([1, 3]), np.array([1.0, 0.3])
    known = np.array(
        [
            np.sqrt(0.5 * np.sum(abs(reference.linear_response(damping_ratio, 1.0, size, order * s))
                                 ** 2))
            for s in speeds
        ]
    )  # fmt: skip
    systems = [light_mode(steps=total, waves=count) for count in waves for _ in speeds]
    slowed = [speed / count for count in waves for speed in speeds]

    def errors(stepper: AbstractStepper) -> np.ndarray:
        history = marched(systems, slowed, stepper, 160, 8)
        return _rms(history.motion).reshape(len(waves), -1) / known - 1.0

    newmark, exponential = errors(Newmark()), errors(Exponential())
    coarse = [light_mode(steps=64)] * speeds.size
    balance = _rms(balanced(coarse, speeds).place) / known - 1.0

    def draw(ax: Axes) -> None:
        ax.loglog(counts, abs(newmark).max(axis=1), "o-", label="Newmark")
        ax.loglog(counts, abs(exponential).max(axis=1), "x-", label="Exponential")
        ax.set(xlabel="steps in a mesh period", ylabel="largest error of RMS [-]", ylim=(1e-4, 3.0))
        ax.set_xticks(counts, labels=map(str, counts))
        ax.minorticks_off()

    worst, own = abs(newmark).max(axis=1), abs(exponential).max(axis=1)
    return Row(
        title="Elongated periods of light modes",
        method="Newmark",
        breaks="A mode damped by 0.5 % near the third mesh harmonic: the RMS is off by up to "
        + ", ".join(f"{_percent(w)} (N = {n})" for w, n in zip(worst, counts, strict=True))
        + ".",
        default=f"Harmonic balance: {_size(abs(balance).max())} at N = 64. `Exponential`: "
        f"{_percent(own[1])} at N = 64.",
        note="Newmark's frequency is low by (w h)^2/12 of itself, to be compared with the damping "
        "ratio: it moves the mode off, or onto, the harmonic.",
        numbers={
            "counts": counts,
            "newmark": newmark,
            "exponential": exponential,
            "balance": balance,
        },
        draw=draw,
    )


@functools.cache
def extreme_bodies() -> Row:
    """Bearings from nothing to rigid, a face of one slice and of 200."""
    bearings = 10.0 ** np.arange(-6.0, 9.0, 2.0)
    systems = [two_bodies(float(bearing)) for bearing in bearings for _ in range(2)]
    speeds = np.tile([0.7, 1.7], bearings.size)
    orbits = balanced(systems, speeds)
    settled = np.asarray(orbits.settled)
    ratio = _most(orbits.load)
    limit = balanced([sdof_parametric(steps=100)] * 2, speeds[:2])
    rigid = abs(ratio[-2:] / _most(limit.load) - 1.0)
    shot = balanced(systems, speeds, Shooting())
    agreed = abs(_most(shot.load) / ratio - 1.0)[settled & np.asarray(shot.settled)]
    faces = {count: face(count) for count in (1, 20, 200)}
    by_slices = {}
    for count, system in faces.items():
        orbit = balanced([system], [0.7])
        by_slices[count] = (float(_most(orbit.load)[0]), bool(orbit.settled[0]))

    def draw(ax: Axes) -> None:
        for lane, speed in enumerate((0.7, 1.7)):
            ax.semilogx(bearings, ratio[lane::2], "o-", label=f"speed {speed}")
        ax.semilogx([bearings[-1]] * 2, _most(limit.load), "k*", label="rigid bearings")
        ax.set(xlabel="bearing stiffness / mesh stiffness [-]", ylabel="dynamic ratio [-]")

    fine = by_slices[200][0]
    return Row(
        title="Very stiff and very soft bodies, 1 and 200 slices",
        method="All methods",
        breaks="Bearings of 1e-6 to 1e8 of the mesh stiffness. This does NOT fail: cold harmonic "
        f"balance settles at {settled.sum()} of {settled.size}, shooting at "
        f"{int(np.sum(shot.settled))}.",
        default=f"On rigid bearings the ratio is that of one body within {_size(rigid.max())}; "
        f"shooting and harmonic balance agree to {_size(agreed.max())}.",
        note="One slice settles ("
        f"{by_slices[1][1]}) but knows no tilt; ratio with 1, 20, 200 slices "
        f"{by_slices[1][0]:.4f}, {by_slices[20][0]:.4f}, {fine:.4f}.",
        numbers={
            "settled": settled,
            "shot": np.asarray(shot.settled),
            "finite": bool(np.all(np.isfinite(orbits.place)) and np.all(np.isfinite(shot.place))),
            "rigid": rigid,
            "agreed": agreed,
            "slices": by_slices,
        },
        draw=draw,
    )


def _random_contacts(count: int, stiffness: float, bodies: int, seed: int):
    """Random structures, cells along a face, gaps and loads."""
    random = np.random.default_rng(seed)
    cells = 32
    arms = np.stack([np.ones(cells), np.linspace(-1.0, 1.0, cells)], axis=-1)
    for _ in range(count):
        root = random.normal(size=(bodies, bodies))
        yield (
            root @ root.T / bodies + 0.1 * np.eye(bodies),
            random.normal(size=(bodies, 2)),
            random.normal(size=bodies),
            stiffness * random.uniform(0.5, 1.5, cells) / cells,
            0.3 * random.normal(size=cells),
            arms,
        )


@functools.cache
def contact_loops() -> Row:
    """The two nested loops of the thesis and Newton's method on random stiff contacts."""
    count, bodies = 400, 12
    hardness = np.array([1.0, 1e2, 1e3, 1e4])

    def looped(matrix, right, rows, stiffness, gap) -> np.ndarray:
        closed = np.ones(gap.size, dtype=bool)
        try:
            return reference.two_loops(matrix, right, rows, stiffness, gap, closed).motion
        except (reference.TwoLoopsFailed, np.linalg.LinAlgError):
            return np.full(right.size, np.nan)

    @eqx.filter_jit
    def statics(flexibility, stiffness, gap, arms):
        def one(flexibility, stiffness, gap):
            problem = ContactProblem(
                stiffness=stiffness,
                gap=gap,
                arms=arms,
                flexibility=flexibility,
                direction=jnp.asarray([1.0, 0.0]),
                force=jnp.ones(()),
            )
            state = contact_state(problem, ExactContact(), SolverSettings())
            return state.approach, state.converged

        return jax.vmap(one)(flexibility, stiffness, gap)

    @eqx.filter_jit
    def in_step(flexibility, place, stiffness, gap, arms):
        def one(flexibility, place, stiffness, gap):
            none = jnp.zeros_like(place)
            problem = Pressing(
                law=ExactContact(),
                meshes=(Mesh(stiffness, gap, arms, None),),
                begun=None,
                place=place,
                yields=flexibility,
                rate=none,
                brakes=jnp.zeros_like(flexibility),
                cell_damping=None,
                scale=jnp.ones(()),
            )
            load, error = pressed(problem, none)
            return place - flexibility @ load, error

        return jax.vmap(one)(flexibility, place, stiffness, gap)

    shares = {
        name: [] for name in ("loops, step", "Newton, step", "loops, static", "Newton, static")
    }
    apart = 0.0
    for hard in hardness:
        cases = list(_random_contacts(count, hard, bodies, seed=7))
        arms = cases[0][-1]
        yields = np.array([v.T @ np.linalg.solve(k, v) for k, v, *_ in cases])
        places = np.array([v.T @ np.linalg.solve(k, f) for k, v, f, *_ in cases])
        springs, gaps = (np.array([case[i] for case in cases]) for i in (3, 4))
        step = np.array([v.T @ looped(k, f, arms @ v.T, s, g) for k, v, f, s, g, _ in cases])
        found, error = in_step(*map(jnp.asarray, (yields, places, springs, gaps, arms)))
        error = np.asarray(error)
        # At rest a drive closes the cells: one more unknown, which only the cells hold.
        static = []
        for k, v, _, s, g, _ in cases:
            matrix = scipy.linalg.block_diag(0.0, k)
            rows = np.concatenate([np.ones((arms.shape[0], 1)), -arms @ v.T], axis=1)
            right = np.zeros(bodies + 1)
            right[0] = 1.0
            static.append(looped(matrix, right, rows, s, g)[0])
        driven, converged = statics(*map(jnp.asarray, (yields, springs, gaps, arms)))
        static, driven = np.array(static), np.asarray(driven)
        shares["loops, step"].append(float(np.mean(np.isnan(step[:, 0]))))
        shares["Newton, step"].append(float(np.mean(~(error <= 1e-9))))
        shares["loops, static"].append(float(np.mean(np.isnan(static))))
        shares["Newton, static"].append(float(np.mean(~np.asarray(converged))))
        both = ~np.isnan(static) & np.asarray(converged)
        same = abs(driven - static)[both].max() / abs(static[both]).max()
        also = ~np.isnan(step[:, 0]) & (error <= 1e-9)
        apart = max(apart, same, abs(np.asarray(found) - step)[also].max())

    def draw(ax: Axes) -> None:
        for (name, lane), mark in zip(shares.items(), ("o-", "s-", "o:", "s:"), strict=True):
            ax.semilogx(hardness, 100.0 * np.array(lane), mark, label=name)
        ax.set(xlabel="cell stiffness x flexibility [-]", ylabel="not solved [%]")

    per = lambda name: ", ".join(f"{100 * x:.2g}" for x in shares[name])
    return Row(
        title="Two nested contact loops",
        method="The thesis's loops",
        breaks="Random structures of 12 degrees of freedom, 32 cells, stiffness times flexibility "
        f"1, 100, 1e3, 1e4. Not solved, in per cent: {per('loops, static')} at rest, "
        f"{per('loops, step')} in a time step.",
        default=f"Newton's method with a search on the energy, at rest: "
        f"{per('Newton, static')}. In a time step Newton's method halves on the imbalance: "
        f"{per('Newton, step')}.",
        note="In a time step stiffness times flexibility is about (w h)^2/4: it stays below 10 in "
        "marches that resolve the mesh mode. "
        + (
            "Beyond that the solver of the steps is NOT better than the loops; `converged` says "
            "so. "
            if max(shares["Newton, step"]) > max(shares["loops, step"])
            else ""
        )
        + f"Where both solve, they agree to {_size(apart)}.",
        numbers={"hardness": hardness, "shares": shares, "apart": float(apart)},
        draw=draw,
    )


@functools.cache
def slow_modes() -> Row:
    """A march with a mode fifty times slower than the mesh's."""
    system, speeds = slow_driveline(), np.array([0.7, 1.5])
    cycles = 400
    orbits = balanced([system] * 2, speeds)
    slow = scipy.linalg.eigvalsh(system.whole_stiffness, system.mass)[0]
    size = np.exp(-0.02 * np.sqrt(slow) * 2.0 * np.pi / speeds)
    starts = np.tile(at_rest(system), (2, 1, 1))
    history = marched([system] * 2, speeds, Exponential(), cycles, cycles, starts=starts)
    force = np.asarray(history.load[..., 0]).reshape(2, cycles, -1)
    error = force.max(axis=2) / _most(orbits.load)[:, None] - 1.0
    drift = np.asarray(history.drift)
    seen = (100, 200, 400)
    needed = np.log(1e-3) / np.log(size)

    def draw(ax: Axes) -> None:
        for lane, speed in enumerate(speeds):
            ax.semilogy(abs(error[lane]), lw=0.6, label=f"error of the ratio, speed {speed}")
            ax.semilogy(drift[lane], "--", lw=0.8, label=f"drift, speed {speed}")
        ax.axhline(TimeStepping().tolerance, color="k", lw=0.6)
        ax.set(xlabel="cycle", ylabel="relative [-]")

    worst = [float(abs(error[:, count - 20 : count]).max()) for count in seen]
    return Row(
        title="Marches that have not settled",
        method="Marching, 100 to 400 cycles",
        breaks="A driveline mode at 2 % of the mesh mode, damped by 2 %, from rest: the dynamic "
        f"ratio is off by up to {worst[0]:.2f}, {worst[1]:.2f}, {worst[2]:.2f} in the 20 cycles "
        "before the 100th, 200th, 400th.",
        default="`settled` is False: the drift over a cycle is still "
        f"{_size(drift[:, -1].min())}. Harmonic balance: "
        f"{int(np.max(orbits.steps))} Newton steps.",
        note=f"Multipliers of {size[0]:.4f} and {size[1]:.4f}: {needed[0]:.0f} and {needed[1]:.0f} "
        "cycles to 1e-3.",
        numbers={
            "worst": worst,
            "drift": drift,
            "multiplier": size,
            "settled": np.asarray(orbits.settled),
            "steps": np.asarray(orbits.steps),
        },
        draw=draw,
    )


@functools.cache
def harmless_looking() -> Row:
    """The orbit of one period at twice the mesh mode, and what the machine does."""
    orbits, size = _cold()
    index = int(np.argmin(abs(_SWEEP_SPEEDS - 2.0)))
    calm = float(jnp.max(orbits.load[index]))
    point = _swept("up")[index]
    real = float(jnp.max(point.orbit.load))

    def draw(ax: Axes) -> None:
        steps = orbits.place.shape[1]
        phase = (np.arange(2 * steps) + 0.5) / steps
        ax.plot(phase, np.tile(np.asarray(orbits.load[index, :, 0]), 2), label="one period")
        ax.plot(phase, np.asarray(point.orbit.load[:, 0]), label="default sweep")
        ax.set(xlabel="phase [mesh periods]", ylabel="mesh force / load [-]")

    return Row(
        title="Orbits that look harmless",
        method="One-period methods near speed 2",
        breaks=f"At twice the mesh mode harmonic balance settles (residual "
        f"{_size(float(orbits.residual[index]))}) on a dynamic ratio of {calm:.2f}; its largest "
        f"multiplier is {size[index, 0]:.3f}: unstable.",
        default=f"The default sweep looks at the multipliers, leaves it, and finds {real:.2f} over "
        f"{point.multiple} periods, stable.",
        note="The disturbance grows by this multiplier in a period only: a short march, started on "
        "the orbit, would not see it either.",
        numbers={
            "calm": calm,
            "real": real,
            "multiplier": float(size[index, 0]),
            "settled": bool(orbits.settled[index]),
            "multiple": point.multiple,
            "stable": point.stable,
        },
        draw=draw,
    )


@functools.cache
def narrow_windows() -> Row:
    """A period that doubles between two speeds of a sweep, and two points of its branch."""
    ripple, damping = 0.02, 0.003
    system = sdof_parametric(damping_ratio=damping, ripple=ripple)
    speeds = np.linspace(1.715, 2.345, 22)
    fine = np.linspace(1.97, 2.03, 61)

    def largest(speeds: np.ndarray) -> np.ndarray:
        systems = [system] * speeds.size
        return floquet(systems, balanced(systems, speeds))[:, 0]

    size, known = largest(speeds), largest(fine)
    curve = continuation(system, speeds[0], speeds[-1])
    edges = np.array([point.speed for point in curve.doublings])
    wide = 2.0 * np.sqrt((ripple / 4.0) ** 2 - damping**2)

    def draw(ax: Axes) -> None:
        ax.plot(fine, known, label="known")
        ax.plot(speeds, size, "o", ms=4, label="a sweep's speeds")
        ax.plot(curve.speed, abs(curve.multiplier), "x", label="the branch's points")
        ax.axhline(1.0, color="k", lw=0.6)
        ax.set(xlabel="speed [-]", ylabel="largest multiplier [-]", xlim=(1.85, 2.15))

    return Row(
        title="Windows between two speeds",
        method="Multipliers at given speeds",
        breaks=f"Stiffness 1 + {ripple} cos, damping {100 * damping} %: between "
        f"{2 - wide:.4f} and {2 + wide:.4f} the period doubles, with multipliers of up to "
        f"{known.max():.4f}. None of {speeds.size} speeds of a sweep lies there: the largest is "
        f"{size.max():.4f}.",
        default="The branch asks the harmonics of the mesh stiffness where two vibrations may grow "
        f"at once, puts a point there, and finds {edges[0]:.4f} and {edges[-1]:.4f} with "
        f"{curve.speed.size} points; a note of the sweep says so.",
        note="To either side of a window the multipliers have the size that damping gives them: "
        "their angle alone comes near to half a turn.",
        numbers={
            "seen": size,
            "known": known,
            "edges": edges,
            "closed_form": np.array([2.0 - wide, 2.0 + wide]),
            "unstable": int(np.sum(~curve.stable)),
            "points": curve.speed.size,
        },
        draw=draw,
    )


ROWS: tuple[Callable[[], Row], ...] = (
    steps_too_large,
    ringing,
    smoothing,
    harmonics_and_samples,
    past_the_fold,
    cold_starts,
    light_load,
    zero_damping,
    whole_contact_ratios,
    long_gradients,
    unaligned_grid,
    period_elongation,
    extreme_bodies,
    contact_loops,
    slow_modes,
    harmless_looking,
    narrow_windows,
)


# --- the document

_HEAD = """# Failure atlas

Where the methods of the dynamics break, how it shows, and what is done instead. Every number is
measured; `python tests/verification/failure_atlas.py --out docs` writes this file and its pictures,
`tests/verification/test_failure_atlas.py` asserts on the same numbers.

Oscillators have unit mass, mean stiffness and load: speed is the mesh frequency over the mesh
mode's, the largest mesh force is the dynamic ratio. Unless said otherwise stiffness is
1 + 0.3 cos, damping 5 %. N is the number of time steps in a mesh period, H that of harmonics.

**Default**: `sweep` with `HarmonicBalance()` (20 harmonics, exact contact, at event-aligned steps),
each point judged by its residual and its Floquet multipliers.

| # | method | where it breaks | what the default does |
|---|---|---|---|
"""


def picture_of(row: Any) -> str:
    """Path of a row's picture from the document's folder."""
    return f"failure_atlas/{row.__name__}.png"


def document() -> str:
    """The text with all its numbers."""
    lines, parts = [], []
    for number, row in enumerate(ROWS, 1):
        found = row()
        lines.append(f"| {number} | {found.method} | {found.breaks} | {found.default} |\n")
        parts.append(
            f"\n## {number}. {found.title}\n\n![{found.title}]({picture_of(row)})\n\n{found.note}\n"
        )
    return _HEAD + "".join(lines) + "".join(parts)


def write(folder: Path) -> None:
    """Write the document and its pictures."""
    (folder / "failure_atlas").mkdir(parents=True, exist_ok=True)
    for number, row in enumerate(ROWS, 1):
        figure, ax = plt.subplots(figsize=(5.6, 3.4), layout="constrained")
        row().draw(ax)
        ax.set_title(f"{number}. {row().title}", fontsize=10)
        ax.grid(alpha=0.3)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=7)
        figure.savefig(folder / picture_of(row), dpi=90, metadata={"Software": None})
        plt.close(figure)
    (folder / "failure_atlas.md").write_text(document(), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the failure atlas.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the document")
    jax.config.update("jax_enable_x64", True)
    plt.switch_backend("Agg")
    write(parser.parse_args().out)
