r"""What gauges on a condensed body read, over one of its revolutions at rest.

A gauge reads $r u + \Omega^2 r_c + r_h s$ of the body's coordinates $u$, with the free strains $s$
of hub and rim by heat. With the seats held it is loaded by the forces at the feet of all teeth, one
after the other; the seats carry it along. So what it reads follows from the forces of the cells,
the motion of the seats and these strains alone, and has derivatives by all that they depend on.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._lines import ContactLines, MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._interface._roots import ROOT_POINTS, Axial, RimSurface, interface_map
from jaxgear._response._body_motion import beyond_rest
from jaxgear._response._dynamic import forces_in_motion
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._body_modes import BodyBasis, wave_partners
from jaxgear._system._body_tables import root_patches, teeth_on_lines
from jaxgear._system._condensed import Condensed
from jaxgear._system._foot_tables import foot_weights
from jaxgear._system._held_body import held_answers
from jaxgear._types import Reals, Scalar


class GaugeInfluences(eqx.Module):
    """What gauges on a condensed body read of all that loads and moves it.

    **Fields:**

    - `feet`: per load on the feet of each tooth along and about radius, tangent and axis, the
        seats held, shape `[gauge, tooth, slice, component]` [1/N, Pa/N, 1/(N m)].
    - `seats`: per motion of the seats along and about x, y, z of the body, shape
        `[gauge, 6 seat]` [1/m, Pa/m, 1/rad].
    - `rotation`: per square of the speed, the seats held, shape `[gauge]` [s2, Pa s2].
    - `heat`: per free strain of hub and rim, the seats held, shape `[gauge, 2]` [-, Pa].
    - `angles`: of the middles of the teeth at the first slice, about z from the body's x, shape
        `[tooth]` [rad].
    - `centres`: of the feet of one tooth on all lines, in their frames, `[cell, 3]` [m].
    - `lines`: teeth on the contact lines in each mesh period of a revolution, shape
        `[period, line]` [-].
    - `index`: 0 for the pinion, 1 for the wheel.
    - `components`: of the feet's loads that the body was put in mesh with.
    - `modes`: per amplitude of the modes of a body in motion, shape `[gauge, mode]`, or `None`
        [kg^-1/2, Pa kg^-1/2 / m].
    - `waves`: wave numbers of these modes.
    """

    feet: Reals
    seats: Reals
    rotation: Reals
    heat: Reals
    angles: Reals
    centres: Reals
    lines: Array
    index: int = eqx.field(static=True)
    components: tuple[int, ...] = eqx.field(static=True)
    modes: Reals | None = None
    waves: tuple[int, ...] = eqx.field(static=True, default=())


def gauge_influences(
    body: Condensed,
    rows: np.ndarray,
    rotation: np.ndarray,
    pair: GearPair,
    index: int,
    grid: MeshGrid,
    *,
    components: Sequence[int],
    points: int = ROOT_POINTS,
    axial: Axial = "mortar",
    heat: tuple[np.ndarray, np.ndarray] | None = None,
    basis: BodyBasis | None = None,
    answers: np.ndarray | None = None,
) -> GaugeInfluences:
    """Load a body by what its gauges read. Call it outside of `jit`, on concrete gears.

    **Arguments:**

    - `body`: the condensed body.
    - `rows`: of the gauges, shape `[gauge, dof]` [1/m, Pa/m, 1/rad].
    - `rotation`: what they read of rotation beside the coordinates, shape `[gauge]` [s2, Pa s2].
    - `pair`: the gears.
    - `index`: 0 if it is the pinion's, 1 if it is the wheel's.
    - `grid`: slices and lines of the cycle.
    - `components`: of the feet's loads, as of `FlexibleBody`.
    - `points`, `axial`: as of `flexible_body`.
    - `heat`: if the body may warm, what they read beside the coordinates, shape `[gauge, 2]`
        [-, Pa], and the load on these, `[2, dof]`, per free strain of hub and rim.
    - `basis`: on which the body vibrates, for `moving_gauge_readings`; none for its statics.
    - `answers`: `held_answers` to the rows, if they are known already.

    **Returns:**

    The influences.
    """
    gear = (pair.pinion, pair.wheel)[index]
    rim, count = 3 * len(body.rim_nodes), 6 * len(body.seats)
    seat = np.arange(rim, rim + count)
    solved = held_answers(body, rows) if answers is None else answers
    by_seats = rows[:, seat] - solved @ body.stiffness[:, seat]
    patches = root_patches(pair, index, grid, np.arange(gear.teeth), points=points, axial=axial)
    found = interface_map(RimSurface(body.rim_nodes, body.rim_faces), patches)
    by_feet = (found.rows @ solved[:, :rim].T).T
    slices, lines = grid.slices, teeth_on_lines(index, grid, gear.teeth) % gear.teeth
    shown, load = (
        (np.zeros((len(rows), 2)), np.zeros((2, len(body.stiffness)))) if heat is None else heat
    )
    centres = found.centres.reshape(gear.teeth, slices, 3)[lines[0]].reshape(-1, 3)
    return GaugeInfluences(
        feet=jnp.asarray(by_feet.reshape(len(rows), gear.teeth, slices, 6)),
        seats=jnp.asarray(by_seats),
        rotation=jnp.asarray(rotation + solved @ body.centrifugal_load),
        heat=jnp.asarray(shown + solved @ load.T),
        angles=jnp.asarray(patches.angles.reshape(gear.teeth, slices)[:, 0]),
        centres=jnp.asarray(centres),
        lines=jnp.asarray(lines),
        index=index,
        components=tuple(components),
        modes=None if basis is None else jnp.asarray(rows @ basis.shapes),
        waves=() if basis is None else tuple(int(wave) for wave in basis.waves),
    )


def gauge_readings(
    gauges: GaugeInfluences,
    pair: GearPair,
    cycle: MeshCycle,
    speed: Scalar,
    strain: Reals | None = None,
) -> tuple[Array, Array]:
    """What gauges that turn with a body read while it turns once, tooth by tooth at rest.

    The mesh cycle is repeated; where it is shorter than the body takes to repeat under its teeth,
    as one with holes may, each tooth loads the mesh as that cycle says.

    **Arguments:**

    - `gauges`: of the body.
    - `pair`: the gears.
    - `cycle`: its solved cycle.
    - `speed`: of the pinion [rad/s].
    - `strain`: free strain of hub and rim, `[2]`, as of `BodyHeat`; `None`: none [-].

    **Returns:**

    Readings, shape `[phase, gauge]` [-, Pa], and the angle of the body's x from S about
    Z, shape `[phase]` [rad]; phases of all mesh periods of a revolution.
    """
    places = cycle.system.structure.map.loaded[gauges.index]
    seats = np.concatenate([first + np.arange(6) for first in places])
    motion = cycle.system.displacement(cycle.load)[:, seats]
    return _over_revolution(
        gauges, pair, cycle.cells.lines, _Borne(cycle.force, motion, None), speed, strain
    )


@compiled
def moving_gauge_readings(
    gauges: GaugeInfluences,
    dynamics: PairDynamics,
    orbit: Orbit,
    law: AbstractContactLaw,
    strain: Reals | None = None,
    beyond: Reals | None = None,
) -> tuple[Array, Array]:
    """What gauges that turn with a body read over a revolution in a steady response.

    In the middle of each step. All of the body follows the forces of the cells, rotation and heat
    at once, and modes add what they do beyond that (mode acceleration, theory 11.7).

    **Arguments:**

    - `gauges`: of the body, with its modes.
    - `dynamics`: the pair.
    - `orbit`: its response; over more cycles than divide a revolution, of its first part.
    - `law`: with which it was found.
    - `strain`: as of `gauge_readings`.
    - `beyond`: motion of its seats, and of the gauges' modes beyond what they do at rest, in space
        at each step, `[step, coordinate]`, or `None`: these modes are those of the pair
        [m, rad, m kg^1/2].

    **Returns:**

    As of `gauge_readings`; phases are the steps.
    """
    lines = dynamics.cycle.cells.lines
    (body,) = (each for each in dynamics.bodies if each.index == gauges.index)
    force = forces_in_motion(dynamics, orbit, law)
    if beyond is None:
        whole = jnp.zeros((len(orbit.motion), max(dynamics.dofs) + 1))
        whole = whole.at[:, np.asarray(dynamics.dofs)].set(beyond_rest(dynamics, orbit).motion)
        beyond = whole[:, np.r_[list(body.seats), body.mode_dofs]]
    seats = len(body.seats)
    borne = _Borne(force, beyond[:, :seats], beyond[:, seats:])
    return _over_revolution(gauges, dynamics.cycle.system.pair, lines, borne, orbit.speed, strain)


@compiled
def rest_readings(
    gauges: GaugeInfluences, dynamics: PairDynamics, orbit: Orbit, force: Array, periods: int
) -> tuple[Array, Array]:
    """What gauges that turn with a body read of the forces of a response alone, as if at rest.

    The seats held, without rotation and heat, in the middle of each step.

    **Arguments:**

    - `gauges`: of the body.
    - `dynamics`, `orbit`: as of `moving_gauge_readings`.
    - `force`: of the cells, from `forces_in_motion` [N].
    - `periods`: mesh periods that are read, from the first.

    **Returns:**

    As of `gauge_readings`; phases are the steps of so many mesh periods.
    """
    lines = dynamics.cycle.cells.lines
    pair, none = dynamics.cycle.system.pair, jnp.zeros((len(force), gauges.seats.shape[1]))
    alone = dataclasses.replace(
        gauges, rotation=jnp.zeros_like(gauges.rotation), heat=jnp.zeros_like(gauges.heat)
    )
    borne = _Borne(force, none, None)
    return _over_revolution(alone, pair, lines, borne, orbit.speed, None, periods)


class _Borne(NamedTuple):
    """Forces of cells `[step, cell]`, motion of seats and modes in space, `[step, dof]`."""

    force: Array
    seats: Array
    modes: Array | None


def _over_revolution(
    gauges: GaugeInfluences,
    pair: GearPair,
    lines: ContactLines,
    borne: _Borne,
    speed: Scalar,
    strain: Reals | None,
    read: int | None = None,
) -> tuple[Array, Array]:
    """Readings tooth by tooth, of one cycle or several on the same lines; see `gauge_readings`.

    Of so many mesh periods; by default those of a revolution.
    """
    times = len(borne.force) // len(lines.phase)
    periods, phases = lines.periods * times, lines.roll.shape[0] // lines.periods
    teeth = len(gauges.angles)
    weights, fixed = foot_weights(
        pair, gauges.index, gauges.centres, lines.roll, lines.face_position
    )
    none = jnp.zeros_like(weights[0])
    kept = [weights[a] if a in gauges.components else none for a in range(len(weights))]
    # What closes a cell is pushed back by its force.
    load = -jnp.tile(jnp.stack(kept, axis=-1), (times, 1, 1)) * borne.force[:, :, None]
    load = load.reshape(periods, phases, *lines.roll.shape[1:], 6)
    apart = lambda x: x.reshape(periods, phases, -1)
    seats = apart(borne.seats)
    turned = jnp.tile(fixed[:, 0], times).reshape(periods, phases)
    ratio = teeth / pair.pinion.teeth
    grown = (speed / ratio) ** 2 * gauges.rotation
    if strain is not None:
        grown = grown + gauges.heat @ strain

    def of_period(each: tuple[Array, Array]) -> tuple[Array, Array]:
        period, on_lines = each
        place = period % periods
        turn = turned[place] - gauges.angles[on_lines[0]]
        found = jnp.einsum("plsc,glsc->pg", load[place], gauges.feet[:, on_lines])
        found += _turned_back(seats[place], turn) @ gauges.seats.T
        if borne.modes is not None and gauges.modes is not None:
            found += _modes_back(apart(borne.modes)[place], turn, gauges) @ gauges.modes.T
        return found + grown[None, :], turn

    number = jnp.arange(teeth if read is None else read)
    found, angle = jax.lax.map(of_period, (number, gauges.lines[number % teeth]))
    return found.reshape(len(number) * phases, -1), angle.ravel()


def _modes_back(modes: Array, angle: Array, gauges: GaugeInfluences) -> Array:
    """Amplitudes of modes on a body that has turned by an angle each, from those in space."""
    partner, number = wave_partners(gauges.waves)
    by = angle[:, None] * number[None, :]
    return jnp.cos(by) * modes + jnp.sin(by) * modes[:, partner]


def _turned_back(vectors: Array, angle: Array) -> Array:
    """Vectors that follow each other in rows, along axes that have turned by an angle each."""
    x, y, z = jnp.moveaxis(vectors.reshape(len(vectors), -1, 3), 2, 0)
    cosine, sine = jnp.cos(angle)[:, None], jnp.sin(angle)[:, None]
    turned = jnp.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=2)
    return turned.reshape(vectors.shape)


def direction_rows(
    rows: np.ndarray, directions: np.ndarray, young: float, poisson: float
) -> np.ndarray:
    r"""Strain and stress along directions, from six components of the stress.

    The strain is that of stress alone, as a gauge shows it that makes up for heat:
    $\varepsilon = ((1 + \nu) n \sigma n - \nu \mathrm{tr} \sigma) / E$.

    **Arguments:**

    - `rows`: of xx, yy, zz, xy, yz, zx, shape `[place, 6, ...]`.
    - `directions`: unit vectors along x, y, z, shape `[place, 3]` [-].
    - `young`: Young's modulus [Pa].
    - `poisson`: Poisson's ratio [-].

    **Returns:**

    Shape `[place, 2, ...]`: strain [-], then normal stress [Pa].

    **Raises:**

    - `ValueError` if a direction is not of unit length.
    """
    x, y, z = directions.T
    require(bool(np.allclose(x**2 + y**2 + z**2, 1.0)), "Directions must be vectors of length one.")
    normal = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * y * z, 2 * z * x], axis=1)
    mean = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    strain = ((1.0 + poisson) * normal - poisson * mean) / young
    return np.einsum("pkc,pc...->pk...", np.stack([strain, normal], axis=1), rows)
