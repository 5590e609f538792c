r"""What shapes and mesh coordinates leave out of a response, as the cells of the mesh feel it.

Under the forces of its cells a whole body moves in a way of which its shapes show a part, and the
mesh coordinates a part of these (`whole_modes`). By the difference each cell would come closer, and
its inertia loads the seats. With such gaps and loads the same few unknowns find what many would,
but for what the change of the forces then leaves out in its turn: a few rounds (theory 11.9).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._compiled import compiled
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._body_motion import beyond_rest, driven_by_mesh, start_angle
from jaxgear._response._dynamic import forces_in_motion
from jaxgear._response._spectrum import fitted_harmonics, values_in_steps
from jaxgear._response._whole_motion import WholeBody, by_inertia, loads_on_seats, whole_modes
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import mode_loads
from jaxgear._types import Reals


class LeftOut(NamedTuple):
    """What of bodies' motion a response lacks, as its unknowns would feel it.

    **Fields:**

    - `closer`: how much closer each cell would come, in the middle of each step, `[step, cell]`
        [m].
    - `load`: on all degrees of freedom, by the inertia of what is left out: amplitudes of all
        harmonics of the response, `[harmonic, dof]` [N, N m].
    """

    closer: np.ndarray
    load: np.ndarray

    @property
    def scale(self) -> float:
        """What loads give that are as much as cells come closer [m/N]."""
        closer, load = (float(np.linalg.norm(each)) for each in self)
        return closer / load if closer and load else 1.0

    def vector(self, scale: float) -> np.ndarray:
        """All of it, loads by so much give [m/N]."""
        load = scale * self.load.ravel()
        return np.concatenate([self.closer.ravel(), np.real(load), np.imag(load)])


def still_apart(given: LeftOut, found: Sequence[LeftOut]) -> float:
    """How far the last that was found is from what was given, over the first that was found [-]."""
    scale = found[0].scale
    apart = float(np.linalg.norm(found[-1].vector(scale) - given.vector(scale)))
    return apart / float(np.linalg.norm(found[0].vector(scale))) if apart else 0.0


# Earlier rounds that are looked back at.
_DEPTH = 3


def mixed(given: Sequence[LeftOut], found: Sequence[LeftOut]) -> LeftOut:
    """What to give a response next, so that what is left out of it is what it was given.

    Anderson's mixing (Anderson 1965; Walker and Ni 2011). Of one round it is what was found.

    **Arguments:**

    - `given`: to each response so far; nothing, zeros, to the first.
    - `found`: what was then left out of each.

    **Returns:**

    The next to be given.
    """
    first, scale = found[0], found[0].scale
    images = [each.vector(scale) for each in found[-_DEPTH - 1 :]]
    starts = [each.vector(scale) for each in given[-_DEPTH - 1 :]]
    off = [image - start for image, start in zip(images, starts, strict=True)]
    best = images[-1]
    if len(images) > 1:
        turns = np.stack([off[-1] - each for each in off[:-1]], axis=1)
        moves = np.stack([images[-1] - each for each in images[:-1]], axis=1)
        best = best - moves @ np.linalg.lstsq(turns, off[-1])[0]
    closer, load = np.split(best, [first.closer.size])
    load = (load[: load.size // 2] + 1j * load[load.size // 2 :]) / scale
    return LeftOut(closer.reshape(first.closer.shape), load.reshape(first.load.shape))


def left_out(
    wholes: Mapping[int, WholeBody],
    dynamics: PairDynamics,
    orbit: Orbit,
    law: AbstractContactLaw,
    harmonics: int,
) -> LeftOut:
    """What shapes and mesh coordinates leave out of the bodies' motion in a response.

    **Arguments:**

    - `wholes`: bodies on many natural modes, by index: 0 for the pinion, 1 for the wheel.
    - `dynamics`: the pair, on shapes of them.
    - `orbit`: its response at one speed, over one cycle.
    - `law`: with which it was found.
    - `harmonics`: of the mesh, as many as the response has.

    **Returns:**

    What is left out.
    """
    system, gears = dynamics.system, dynamics.cycle.system.pair
    table, lines, dofs = system.table, dynamics.cycle.cells.lines, np.asarray(dynamics.dofs)
    most = harmonics * table.periods + 1
    at_steps = lambda amplitudes: values_in_steps(
        amplitudes[:most], table.period_lengths, table.periods
    )
    shapes = [np.r_[place.mode_dofs, place.residual_dofs] for place in dynamics.bodies]
    own = np.flatnonzero(np.isin(dofs, np.concatenate(shapes)))
    few = np.asarray(beyond_rest(dynamics, orbit).motion)[:, own]
    met = at_steps(fitted_harmonics(few, table.period_lengths, None))
    met = met @ np.asarray(system.vectors)[own]
    closer = -np.einsum("pcn,pn->pc", np.asarray(table.middle_arms), met)
    load = np.zeros((most, len(dofs)), dtype=complex)
    driven, force = driven_by_mesh(dynamics, orbit), forces_in_motion(dynamics, orbit, law)
    for place, some in zip(dynamics.bodies, shapes, strict=True):
        index, whole = place.index, wholes[place.index]
        angle = start_angle(gears, index)
        found = whole_modes(whole, dynamics, driven, index, force, harmonics, angle=angle)
        modes = jnp.asarray(at_steps(found.modes - found.at_rest))
        closer += np.asarray(approach_by_modes(gears, index, whole.flexible, lines, modes))
        seats = np.flatnonzero(np.isin(dofs, place.seats))
        known, of = np.isin(place.seats, dofs), np.flatnonzero(np.isin(dofs, some))
        less = by_inertia(dynamics, driven, seats, of, found.frequency)
        load[: len(less), seats] += less - loads_on_seats(whole, found)[:, known]
    return LeftOut(closer, load)


@compiled
def approach_by_modes(
    pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines, modes: Reals
) -> Array:
    """How much closer cells come by motion of modes: the transpose of what loads these.

    **Arguments:**

    - `pair`, `index`, `body`, `lines`: as of `mode_arms`.
    - `modes`: their motion at each phase of one cycle, or of several one after the other, shape
        `[phase, mode]` [m kg^1/2].

    **Returns:**

    Shape `[phase, cell]` [m].
    """
    loads = lambda force: mode_loads(pair, index, body, lines, force)
    cells = lines.fraction.shape[1] * lines.fraction.shape[2]
    force = jax.ShapeDtypeStruct((len(modes), cells), modes.dtype)
    (closer,) = jax.linear_transpose(loads, force)(modes)
    return -closer
