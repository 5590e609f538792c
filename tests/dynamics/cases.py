"""Systems for the tests of the dynamics: the oscillators of B5, small systems, a real pair.

The oscillators have unit mass, unit mean stiffness and a pinion of one tooth: the speed of the
pinion is the frequency of the mesh, and 1 rad/s is the natural frequency of the closed contact.
"""

import functools

import cases
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from dynamics import reference

import jaxgear as jg
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._system import DynamicSystem, PairDynamics
from jaxgear._dynamics._table import MeshTable

# Hidden behind the contact, it carries the periodic force of `sdof_backlash`, and K takes it away.
_CARRIER = 1e-3


def _even(steps: int) -> np.ndarray:
    return np.arange(steps + 1) / steps


def _places(edges: np.ndarray) -> np.ndarray:
    """Phases of the start, the middle and the end of each step."""
    return np.stack([edges[:-1], 0.5 * (edges[:-1] + edges[1:]), edges[1:]])


def _table(edges, stiffness, gap=None, arms=None, kinds=None) -> MeshTable:
    # With its type said an array needs no program of its own.
    reals = lambda values: jnp.asarray(values, dtype=float)
    steps, cells = np.shape(stiffness)
    return MeshTable(
        edges=reals(edges),
        stiffness=reals(stiffness),
        gap=reals(np.zeros((3, steps, cells))) if gap is None else reals(gap),
        arms=reals(np.ones((3, steps, cells, 1))) if arms is None else reals(arms),
        coupling=None,
        periods=1,
        kinds=(0,) * steps if kinds is None else kinds,
    )


def _system(
    table: MeshTable, mass, damping, stiffness, vectors, load, mean, rest, force: float = 1.0
) -> DynamicSystem:
    return DynamicSystem(
        mass=jnp.asarray(mass, dtype=float),
        damping=jnp.asarray(damping, dtype=float),
        stiffness=jnp.asarray(stiffness, dtype=float),
        gyroscopic=None,
        vectors=jnp.asarray(vectors, dtype=float),
        load=jnp.asarray(load, dtype=float),
        bow=None,
        mean=jnp.asarray(mean, dtype=float),
        table=table,
        cell_damping=None,
        force=jnp.asarray(force),
        transmission=jnp.asarray(vectors, dtype=float)[:, 0],
        rest=jnp.asarray(rest, dtype=float),
        free=jnp.zeros((np.shape(mass)[0], 0)),
        teeth=1,
    )


def _one_cell(edges, stiffness, damping_ratio: float, kinds=None) -> DynamicSystem:
    """Unit mass under a unit force on one cell of mean stiffness 1."""
    return _system(
        _table(edges, stiffness[:, None], kinds=kinds),
        [[1.0]],
        [[2.0 * damping_ratio]],
        [[0.0]],
        [[1.0]],
        [1.0],
        [[1.0]],
        1.0 / stiffness[:, None],
    )


@functools.cache
def sdof_parametric(
    *, damping_ratio: float = 0.05, ripple: float = 0.3, steps: int = 200, waves: int = 1
) -> DynamicSystem:
    """B5 (a): stiffness 1 + ripple cos(2 pi tau), its mean over each step taken exactly.

    With several waves in the cycle, and as much less speed, the same steps are that much longer.
    """
    edges = _even(steps)
    turn = 2.0 * np.pi * waves
    integral = edges + ripple * np.sin(turn * edges) / turn
    return _one_cell(edges, np.diff(integral) * steps, damping_ratio)


@functools.cache
def sdof_rectangular(
    *, damping_ratio: float = 0.05, contact_ratio: float = 1.6, steps: int = 200
) -> DynamicSystem:
    """One pair of teeth, or two after a pair enters; steps end where the stiffness jumps."""
    double = contact_ratio - 1.0
    first = round(steps * double)
    entered = double * np.arange(first) / first
    alone = double + (1.0 - double) * np.arange(steps - first + 1) / (steps - first)
    stiffness = np.repeat([2.0 / contact_ratio, 1.0 / contact_ratio], [first, steps - first])
    kinds = (0,) * first + (1,) * (steps - first)
    return _one_cell(np.concatenate([entered, alone]), stiffness, damping_ratio, kinds)


@functools.cache
def sdof_backlash(
    speed: float,
    *,
    damping_ratio: float = 0.05,
    mean: float = 0.1,
    shaken: float = 0.05,
    steps: int = 200,
) -> DynamicSystem:
    r"""B5 (b) at one speed: clearance to both sides, force $F_m + F_a\Omega^2\sin 2\pi\tau$.

    Its coordinates are the drive flank's approach, the back flank's, which is the opposite, and a
    carrier's: a cell that never opens, whose gap moves such that it pushes with the periodic force.
    A constant load holds it closed, and the structure takes its stiffness away again, so that the
    equation is that of B5 exactly.
    """
    edges = _even(steps)
    wave = shaken * speed**2 * np.sin(2.0 * np.pi * _places(edges))
    held = 2.0 * (mean + shaken * speed**2) + 20.0 * _CARRIER
    flank = np.ones_like(wave)
    gap = np.stack([flank, flank, (wave - held) / _CARRIER], axis=-1)
    stiffness = np.tile([1.0, 1.0, _CARRIER], (steps, 1))
    arms = np.broadcast_to(np.eye(3), (3, steps, 3, 3))
    settled = 1.0 + mean
    return _system(
        _table(edges, stiffness, gap, arms),
        [[1.0]],
        [[2.0 * damping_ratio]],
        [[-_CARRIER]],
        [[1.0, -1.0, 1.0]],
        [mean + held],
        np.diag([1.0, 0.0, _CARRIER]),
        np.tile([settled, -settled, settled], (steps, 1)),
        mean,
    )


@functools.cache
def sdof_driven(
    *, load: float = 10.0, damping_ratio: float = 0.05, steps: int = 64
) -> DynamicSystem:
    """Constant stiffness 1, excited by a gap that moves; it stays closed under a heavy load."""
    edges = _even(steps)
    phase = 2.0 * np.pi * _places(edges)[..., None]
    order = np.arange(1, 6)
    gap = np.sum(np.cos(order * phase + order) / order**2, axis=-1, keepdims=True)
    return _system(
        _table(edges, np.ones((steps, 1)), gap),
        [[1.0]],
        [[2.0 * damping_ratio]],
        [[0.0]],
        [[1.0]],
        [load],
        [[1.0]],
        load + gap[1],
        load,
    )


@functools.cache
def two_dof(*, steps: int = 100, ripple: float = 0.2, load: float = 1.0) -> DynamicSystem:
    """Approach and tilt on four cells across the face, with a slope and a travelling relief.

    Light damping, an elastic tilt, cells that open one after the other.
    """
    edges = _even(steps)
    across = np.array([-0.375, -0.125, 0.125, 0.375])
    phase = _places(edges)[..., None]
    integral = edges[:, None] + ripple * np.sin(2.0 * np.pi * (edges[:, None] + across)) / (
        2.0 * np.pi
    )
    stiffness = 0.25 * np.diff(integral, axis=0) * steps
    gap = 0.4 * across + 0.3 * (1.0 - np.cos(2.0 * np.pi * (phase - across)))
    arms = np.broadcast_to(np.stack([np.ones(4), across], axis=-1), (3, steps, 4, 2))
    mean = np.diag([1.0, 0.25 * np.sum(across**2)])
    return _system(
        _table(edges, stiffness, gap, arms),
        np.diag([1.0, 0.05]),
        np.diag([0.1, 0.01]),
        np.diag([0.0, 0.12]),
        np.eye(2),
        [load, 0.0],
        mean,
        np.tile([load + 0.3, 0.0], (steps, 1)),
        load,
    )


# Neither bodies nor faces couple cells.
ON_THEIR_OWN = jg.WeberBanaschek(
    pinion_foundation=jg.WeberFoundation(),
    wheel_foundation=jg.WeberFoundation(),
    face_coupling=None,
)


@functools.cache
def torsional_pair(
    *,
    torque: float = 80.0,
    phases: int = 32,
    slices: int = 4,
    relief: float = 0.0,
    compliance: jg.AbstractCompliance = jg.WeberBanaschek(),
) -> PairDynamics:
    """The accessory pair, whose gears only turn; relief is the depth at both tips [m]."""
    pair = cases.accessory()
    tip = jg.TipRelief(relief, 0.25)
    model = cases.model(pair, torque, flanks=jg.Flanks(tip, tip), compliance=compliance)
    grid = jg.mesh_grid(pair, phases=phases, slices=slices)
    return eqx.filter_jit(pair_dynamics)(model, grid)


# --- the same for the judge


def as_bodies(system: DynamicSystem) -> reference.Bodies:
    """What the judge needs to know of a system besides its cells."""
    return reference.Bodies(
        *(
            np.asarray(x)
            for x in (
                system.mass,
                system.damping,
                system.stiffness,
                system.vectors,
                system.load,
            )
        )
    )


def as_cells(system: DynamicSystem) -> reference.Cells:
    """The cells of a system for the judge, which knows rigid gears and uncoupled cells."""
    table = system.table
    assert table.coupling is None
    assert system.bow is None
    assert system.cell_damping is None
    return reference.Cells(
        *(np.asarray(x) for x in (table.edges, table.stiffness, table.gap, table.arms))
    )
