r"""Where the energy of a time history is, and what does work on it.

At a phase that stands still, under constant load, the sum of all but what is dissipated only falls,
and with that it is constant. A mesh that moves on also does work, of gaps and stiffnesses that
change: it is what a gear pair vibrates from. Once a response repeats, that work is what is
dissipated.

A condensed body that turns under waves that stand still in space is damped on its own frame: with
$B$ the rate at which these pass, per speed of the pinion, it dissipates
$(\dot x + \Omega_1Bx)^TC(\dot x + \Omega_1Bx)$. Of that the vibration gives
$\dot x^TC\dot x + \Omega_1\dot x^THx$, where $H = CB$; the drive gives the rest as it turns the
body through the waves. Gyroscopic forces, spin softening and the load of rotation give nothing over
a period.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._contact._coupling import body_yield
from jaxgear._dynamics._cell_forces import cell_forces
from jaxgear._dynamics._march import TimeHistory
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._table import END, mesh_at, repeated
from jaxgear._dynamics._types import Matrix, Motion, Series
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import Coordinates, Scalar


class Energies(eqx.Module):
    """Energies at the end of each step of a march.

    **Fields:**

    - `kinetic`: of the bodies [J].
    - `structure`: strain energy of shafts and bearings [J].
    - `contact`: strain energy of the cells, and of the bodies that couple them [J].
    - `load`: potential of the constant loads [J].
    - `dissipated`: taken by the damping of the structure, which in condensed bodies turns with
        them, since the first cycle that was kept [J].
    """

    kinetic: Series
    structure: Series
    contact: Series
    load: Series
    dissipated: Series

    @property
    def total(self) -> Series:
        """All of it [J]."""
        return self.kinetic + self.structure + self.contact + self.load + self.dissipated


@compiled
def energies(
    system: DynamicSystem, history: TimeHistory, law: AbstractContactLaw = ExactContact()
) -> Energies:
    """Work out the energies of a march.

    **Arguments:**

    - `system`: that moved, without bodies that bend between their nodes.
    - `history`: what was kept of the march.
    - `law`: its contact law.

    **Returns:**

    The energies.

    **Raises:**

    - `ValueError` for bodies that bend between their nodes, and for cells that damp.
    """
    require(
        system.bow is None and system.cell_damping is None,
        "Energies are worked out for rigid bodies and damping of the structure: not for bodies "
        "that bend between their nodes, nor for cells that damp.",
    )
    times = history.motion.shape[0] // len(system.table.kinds)
    table, speed = repeated(system.table, times), history.speed
    steps = table.lengths * system.mesh_period(speed)

    def stored(mesh: Mesh, place: Coordinates) -> Scalar:
        force, overlap = cell_forces(mesh, place, law)
        own = jnp.sum(mesh.stiffness * law.energy(overlap))
        if mesh.coupling is None:
            return own
        return own + 0.5 * jnp.sum(force * body_yield(mesh.coupling, force))

    power = _powers(system, history)
    meshes = mesh_at(table, END).at(speed)
    return Energies(
        kinetic=0.5 * _form(system.mass, history.velocity),
        structure=0.5 * _form(_standing_stiffness(system, speed), history.motion),
        contact=jax.vmap(stored)(meshes, history.motion @ system.vectors),
        load=-history.motion @ system.load_at(speed),
        dissipated=jnp.cumsum(steps * (power.damping + power.circulatory)),
    )


class Work(eqx.Module):
    """Work over the cycles of a time history that were kept.

    **Fields:**

    - `mesh`: that the mesh does on the motion [J].
    - `load`: of the constant loads, those of rotation included [J].
    - `damping`: that the damping takes, as if it stood still in space [J].
    - `circulatory`: that it takes beyond that, as condensed bodies turn with it [J].
    - `gyroscopic`: of gyroscopic forces [J].
    - `stored`: by how much kinetic energy and strain energy of the structure have grown [J].
    """

    mesh: Scalar
    load: Scalar
    damping: Scalar
    circulatory: Scalar
    gyroscopic: Scalar
    stored: Scalar

    @property
    def taken(self) -> Scalar:
        """What all damping takes from the motion [J]."""
        return self.damping + self.circulatory

    @property
    def missing(self) -> Scalar:
        """What the balance lacks: zero where nothing is lost or made [J]."""
        return self.mesh + self.load - self.gyroscopic - self.taken - self.stored


@compiled
def work_done(system: DynamicSystem, history: TimeHistory) -> Work:
    r"""Work out what does work over time steps of the midpoint rule.

    The balance is that of the rule itself, exact up to rounding whatever its steps. After a start
    from a steady response `stored` and `load` vanish, and `mesh` is what is dissipated.

    **Arguments:**

    - `system`: that moved; its bodies may be condensed.
    - `history`: what was kept of time steps of `Midpoint`, its contact not averaged.

    **Returns:**

    The work.

    **Raises:**

    - `ValueError` for cells that damp.
    """
    require(
        system.cell_damping is None,
        "Work is told apart for damping of the structure, not for cells that damp.",
    )
    times = history.motion.shape[0] // len(system.table.kinds)
    table, speed = repeated(system.table, times), history.speed
    steps = table.lengths * system.mesh_period(speed)
    power = _powers(system, history)
    over = lambda each: jnp.sum(steps * each)
    stiffness = _standing_stiffness(system, speed)
    ends = jnp.stack([history.start[0], history.motion[-1]])
    rates = jnp.stack([history.start[1], history.velocity[-1]])
    energy = 0.5 * (_form(system.mass, rates) + _form(stiffness, ends))
    return Work(
        mesh=-over(jnp.sum((power.middle @ system.vectors) * history.load, axis=1)),
        load=(ends[1] - ends[0]) @ system.load_at(speed),
        damping=over(power.damping),
        circulatory=over(power.circulatory),
        gyroscopic=over(power.gyroscopic),
        stored=energy[1] - energy[0],
    )


class _Powers(NamedTuple):
    """Velocity in the middle of each step, exact for the midpoint rule, and what takes power."""

    middle: Motion
    damping: Series
    circulatory: Series
    gyroscopic: Series


def _powers(system: DynamicSystem, history: TimeHistory) -> _Powers:
    before = jnp.concatenate([history.start[1:], history.velocity[:-1]])
    middle, speed = 0.5 * (before + history.velocity), history.speed
    none = jnp.zeros(middle.shape[0])
    turning = system.turning
    carried = none
    if turning is not None:
        carried = speed * jnp.sum(middle * (history.middle @ turning.circulatory.T), axis=1)
    whirl = system.gyroscopic
    return _Powers(
        middle=middle,
        damping=_form(system.damping, middle),
        circulatory=carried,
        gyroscopic=none if whirl is None else speed * jnp.sum(middle * (middle @ whirl.T), axis=1),
    )


def _form(matrix: Matrix, rows: Motion) -> Series:
    return jnp.sum(rows * (rows @ matrix), axis=1)


def _standing_stiffness(system: DynamicSystem, speed: Scalar) -> Matrix:
    """Stiffness that has an energy: without the mesh and what damping makes of rotation."""
    if system.turning is None:
        return system.stiffness
    return system.stiffness + speed**2 * system.turning.softening
