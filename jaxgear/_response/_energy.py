r"""Where the energy of a march is.

At a phase that stands still, under constant load, the sum of all but what is dissipated only falls,
and with that it is constant. A mesh that moves on also does work, of gaps and stiffnesses that
change: it is what a gear pair vibrates from.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._contact._coupling import body_yield
from jaxgear._dynamics._march import History
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._table import END, Mesh, cell_forces, mesh_at, repeated
from jaxgear._dynamics._types import Series
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import Coordinates, Scalar


class Energies(eqx.Module):
    """Energies at the end of each step of a march.

    **Fields:**

    - `kinetic`: of the bodies [J].
    - `structure`: strain energy of shafts and bearings [J].
    - `contact`: strain energy of the cells, and of the bodies that couple them [J].
    - `load`: potential of the constant loads [J].
    - `dissipated`: by the damping of the structure, since the first cycle that was kept [J].
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


def energies(
    system: DynamicSystem, history: History, law: AbstractContactLaw = ExactContact()
) -> Energies:
    """Work out the energies of a march.

    **Arguments:**

    - `system`: that marched, without bodies that bend between their nodes.
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
    table = repeated(system.table, times)
    steps = table.lengths * system.mesh_period(history.speed)
    before = jnp.concatenate([history.start[1:], history.velocity[:-1]])
    # Exact for the midpoint rule.
    middle = 0.5 * (before + history.velocity)
    form = lambda matrix, x: jnp.sum(x * (x @ matrix), axis=1)

    def stored(mesh: Mesh, place: Coordinates) -> Scalar:
        force, overlap = cell_forces(mesh, place, law)
        own = jnp.sum(mesh.stiffness * law.energy(overlap))
        if mesh.coupling is None:
            return own
        return own + 0.5 * jnp.sum(force * body_yield(mesh.coupling, force))

    return Energies(
        kinetic=0.5 * form(system.mass, history.velocity),
        structure=0.5 * form(system.stiffness, history.motion),
        contact=jax.vmap(stored)(mesh_at(table, END), history.motion @ system.vectors),
        load=-history.motion @ system.load,
        dissipated=jnp.cumsum(steps * form(system.damping, middle)),
    )
