r"""Condensed bodies in motion: their seats and modes beside the rest, and few mesh coordinates.

Seats and modes are in coordinates that stand still in space while the body turns, so that a pair
with condensed bodies is a system like any other, periodic with the mesh, whose turning bodies bring
terms of their own. With $B = \mp J\,\Omega_i/\Omega_1$ the velocity on the body is
$\dot x + \Omega_1 Bx$, hence its inertia is $M\ddot x + \Omega_1 G\dot x + \Omega_1^2 Sx$, where
$G = MB - B^TM$ and $S = -B^TMB$. With the terms of rotation of the body (physics A7) all is exact.
Without them only waves of two and more nodal diameters turn with the body: rigid motions, and the
bending of shafts, would otherwise be given a false inertia.

All cells move by seats and modes, but on a short arc of the rim few combinations of them can be
told apart. These are the mesh coordinates; what they leave out is added to the compliance between
cells, so that statics is as it was.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._contact._cells import MeshCells, mesh_gap
from jaxgear._dynamics._damping import AbstractDamping
from jaxgear._dynamics._table import MeshTable, at_places, tabulated
from jaxgear._dynamics._types import Matrix, ModeValues, Vector
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._wrench import cell_arms, structure_vectors
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._body_modes import BodyModes
from jaxgear._system._flexible import FlexibleBody, foot_tables, mode_arms
from jaxgear._system._mesh_vectors import carried
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem
from jaxgear._types import CellArmGrid, CellGrid, Scalar

# Waves of at least so many nodal diameters turn with a body that has no terms of rotation.
_TURNING = 2


class BodyPlace(eqx.Module):
    """Where the seats and modes of a condensed body are among the degrees of freedom of a pair.

    **Fields:**

    - `square`: of the angular frequency of its modes, all seats held [rad2/s2].
    - `turning`: $J$ of its seats and modes [-].
    - `index`: 0 for the pinion, 1 for the wheel.
    - `seats`: degrees of freedom of its seats, six each.
    - `first`: degree of freedom of its first mode; the others follow.
    - `speed`: with which it turns about +Z, over the pinion's [-].
    - `waves`, `diameters`: of its modes, as of `BodyModes`.
    """

    square: ModeValues
    turning: Matrix
    index: int = eqx.field(static=True)
    seats: tuple[int, ...] = eqx.field(static=True)
    first: int = eqx.field(static=True)
    speed: float = eqx.field(static=True)
    waves: tuple[int, ...] = eqx.field(static=True)
    diameters: tuple[int, ...] = eqx.field(static=True)


class VibratingBody(NamedTuple):
    """A condensed body of a pair in motion.

    **Fields:**

    - `index`: 0 for the pinion, 1 for the wheel.
    - `body`: its tables.
    - `modes`: its modes.
    - `seats`: degrees of freedom of its seats, in the structure.
    - `first`: degree of freedom of its first mode, after all of the structure.
    - `speed`: with which it turns about +Z, over the pinion's.
    """

    index: int
    body: FlexibleBody
    modes: BodyModes
    seats: np.ndarray
    first: int
    speed: float

    @property
    def dofs(self) -> np.ndarray:
        """Degrees of freedom of its seats and modes."""
        count = self.modes.square.size
        return np.concatenate([self.seats, np.arange(self.first, self.first + count)])

    @property
    def place(self) -> BodyPlace:
        """What others need of it."""
        return BodyPlace(
            square=self.modes.square,
            turning=self.modes.turning,
            index=self.index,
            seats=tuple(int(dof) for dof in self.seats),
            first=self.first,
            speed=self.speed,
            waves=self.modes.waves,
            diameters=self.modes.diameters,
        )


class TurningTerms(eqx.Module):
    r"""What turning bodies bring to a system.

    **Fields:**

    - `gyroscopic`: $G$, per speed of the pinion [kg, kg m, kg m2].
    - `circulatory`: $H$, stiffness per speed, of damping that turns with a body
        [N s/m, N s, N m s].
    - `softening`: $S$, stiffness per square of the speed [kg, kg m, kg m2].
    - `load`: per square of the speed [N s2].
    """

    gyroscopic: Matrix
    circulatory: Matrix
    softening: Matrix
    load: Vector

    def stiffness_at(self, speed: Scalar) -> Matrix:
        """What the stiffness changes by at a speed of the pinion [N/m, N, N m]."""
        return speed * self.circulatory + speed**2 * self.softening


def vibrating_bodies(model: PairModel, mounted: PairSystem, grid: MeshGrid) -> list[VibratingBody]:
    """The condensed bodies of a pair, with their places among the degrees of freedom.

    **Arguments:**

    - `model`: the pair.
    - `mounted`: its structure.
    - `grid`: of the cycle.

    **Returns:**

    One entry for each condensed body.

    **Raises:**

    - `ValueError` if a body was made for statics only, or is not itself again where the cycle ends.
    """
    first, found = mounted.structure.map.size, []
    ratio = model.pair.pinion.teeth / model.pair.wheel.teeth
    for index, (body, speed) in enumerate(zip(model.bodies, (1.0, -ratio), strict=True)):
        if not isinstance(body, FlexibleBody):
            continue
        require(
            body.modes is not None,
            "The {name}'s condensed body has no modes: make it with a `basis` from `body_basis`.",
            name=("pinion", "wheel")[index],
        )
        assert body.modes is not None
        require(
            grid.periods % body.repeats == 0,
            "The {name}'s condensed body repeats under its teeth after {repeats} mesh periods, and "
            "was set in motion over {periods}: where the cycle closes it would jump. Make the grid "
            "with `periods={repeats}`, or a multiple.",
            name=("pinion", "wheel")[index],
            repeats=body.repeats,
            periods=grid.periods,
        )
        loaded = mounted.structure.map.loaded[index]
        seats = np.concatenate([np.arange(6) + start for start in loaded])
        found.append(VibratingBody(index, body, body.modes, seats, first, speed))
        first += body.modes.square.size
    return found


def size_with(mounted: PairSystem, bodies: list[VibratingBody]) -> int:
    """Number of degrees of freedom of a structure and the modes on it."""
    return mounted.structure.map.size + sum(each.modes.square.size for each in bodies)


def with_modes(matrix: Array, size: int) -> Array:
    """A matrix of the structure among all degrees of freedom, zero for the modes."""
    return jnp.zeros((size, size)).at[: len(matrix), : len(matrix)].set(matrix)


def body_masses(bodies: list[VibratingBody], size: int) -> Array:
    """Mass of all condensed bodies, on their seats and modes."""
    mass = jnp.zeros((size, size))
    for each in bodies:
        mass = mass.at[each.dofs[:, None], each.dofs[None, :]].add(each.modes.mass)
    return mass


def mode_stiffness(bodies: list[VibratingBody], size: int) -> Array:
    """Stiffness of the modes of all condensed bodies, one for each degree of freedom."""
    stiffness = jnp.zeros(size)
    for each in bodies:
        stiffness = stiffness.at[each.dofs[len(each.seats) :]].add(each.modes.square)
    return stiffness


def turning_terms(
    bodies: list[VibratingBody], size: int, damping: AbstractDamping, *, whole: bool
) -> TurningTerms:
    """What turning bodies bring to a system.

    **Arguments:**

    - `bodies`: condensed.
    - `size`: number of degrees of freedom.
    - `damping`: of the bodies; it turns with their waves.
    - `whole`: whether the terms of rotation of the bodies are considered.

    **Returns:**

    The terms, over all degrees of freedom.

    **Raises:**

    - `ValueError` if they are to be considered and a body has none.
    """
    none = jnp.zeros((size, size))
    terms = TurningTerms(none, none, none, jnp.zeros(size))
    for each in bodies:
        modes, at = each.modes, (each.dofs[:, None], each.dofs[None, :])
        seats, count = len(each.seats), modes.square.size
        waves = jnp.asarray(np.r_[np.zeros(seats), np.asarray(modes.diameters) >= _TURNING])
        rates = damping.matrix(jnp.eye(count), jnp.diag(modes.square), jnp.zeros((count, count)))
        damped = waves * jnp.concatenate([jnp.zeros(seats), jnp.diagonal(rates)])
        turning = modes.turning if whole else modes.turning * waves[:, None]
        moved = -each.speed * turning
        gyroscopic = modes.mass @ moved - moved.T @ modes.mass
        softening = -moved.T @ modes.mass @ moved
        if whole:
            require(
                modes.coriolis is not None and modes.softening is not None,
                "Gyroscopic forces of a condensed body need its terms of rotation: condense the "
                "{name} with `rotating_terms = true`.",
                name=("pinion", "wheel")[each.index],
            )
            assert modes.coriolis is not None
            assert modes.softening is not None
            turned = each.speed * modes.coriolis @ moved
            gyroscopic = gyroscopic + each.speed * modes.coriolis
            softening = softening + turned + each.speed**2 * modes.softening
        circulatory = damped[:, None] * moved * waves[None, :]
        terms = TurningTerms(
            gyroscopic=terms.gyroscopic.at[at].add(0.5 * (gyroscopic - gyroscopic.T)),
            circulatory=terms.circulatory.at[at].add(circulatory),
            softening=terms.softening.at[at].add(0.5 * (softening + softening.T)),
            load=terms.load.at[each.dofs].add(
                each.speed**2 * jnp.concatenate([each.body.seat_load, modes.load])
            ),
        )
    return terms


class BodyTable(NamedTuple):
    """The mesh of condensed bodies in motion.

    **Fields:**

    - `table`: of the cells.
    - `vectors`: mesh coordinates per degree of freedom, `[dof, coordinate]`.
    - `rest`: mesh coordinates of the quasi-static states, `[phase, coordinate]`.
    - `left_out`: motion of cells that the mesh coordinates leave out, over that which they have, in
        the mean over static loads [-].
    """

    table: MeshTable
    vectors: Array
    rest: Array
    left_out: Array


def body_table(
    model: PairModel,
    mounted: PairSystem,
    cycle: MeshCycle,
    grid: MeshGrid,
    bodies: list[VibratingBody],
    coordinates: int,
) -> BodyTable:
    r"""Tabulate the cells of a pair with condensed bodies over one cycle.

    With $A$ the arms of cells and $F$ the flexibility of the structure, the gears' rotation held,
    the combinations kept are the first eigenvectors of $D A^TA D$, $D^2$ the diagonal of $F$: those
    by which static loads move the cells the most. Which ones they are is a choice and has no
    derivative.

    **Arguments:**

    - `model`: the pair.
    - `mounted`: its structure.
    - `cycle`: its quasi-static states.
    - `grid`: of the cycle.
    - `bodies`: those that vibrate.
    - `coordinates`: of the mesh, beside approach and tilt.

    **Returns:**

    The table.
    """
    cells, pair = cycle.cells, model.pair
    at = at_places(pair, cells)
    gap = jnp.stack([mesh_gap(pair, c.lines, model.flanks, model.misalignment) for c in at])
    arms, growth = (
        jnp.stack(parts) for parts in zip(*(_arms(pair, bodies, c) for c in at), strict=True)
    )
    held = _held(mounted, bodies)
    few = _combinations(arms, cells.stiffness > 0.0, held.give, coordinates)
    met, give = arms @ few.into, few.out_of.T @ held.give @ few.out_of
    # What cells give in all, less what of it is in the motion of the mesh coordinates.
    whole, kept = arms[_MIDDLE_PLACE][:, :, : held.count], met[_MIDDLE_PLACE]
    assert cells.coupling is not None
    coupling = cells.coupling + _between(whole, held.give[: held.count, : held.count])
    coupling = coupling - _between(kept, give)
    grown = growth + arms[..., : held.count] @ held.spun[: held.count]
    grown = grown - met @ (few.out_of.T @ held.spun)
    pressed = jnp.sum(kept * cycle.force[:, :, None], axis=1)
    rest = (few.out_of.T @ held.outside)[None, :] - pressed @ give
    return BodyTable(
        table=tabulated(grid, dataclasses.replace(cells, coupling=coupling), gap, met, grown),
        vectors=held.vectors @ few.out_of,
        rest=rest.at[:, 0].add(cycle.approach),
        left_out=few.left_out,
    )


# The middle of a step, among its three places.
_MIDDLE_PLACE = 1


def _between(arms: Array, flexibility: Array) -> Array:
    """Compliance between all cells by motions of a flexibility, at each phase."""
    return (arms @ flexibility) @ jnp.swapaxes(arms, 1, 2)


def _others(body: FlexibleBody) -> np.ndarray:
    """Seats other than that which turns with the gear."""
    return np.array([i for i in range(len(body.seats)) if i != body.gear_seat], dtype=int)


def _arms(
    pair: GearPair, bodies: list[VibratingBody], cells: MeshCells
) -> tuple[CellArmGrid, CellGrid]:
    """Approach of cells by approach and tilt, other seats against the gear's, modes; and growth."""
    seats, modes, growth = [], [], jnp.zeros_like(cells.stiffness)
    for each in bodies:
        table = foot_tables(pair, each.index, each.body, cells.lines)
        others = (6 * _others(each.body)[:, None] + np.arange(6)).ravel()
        seats.append(table.arms[:, :, others])
        modes.append(mode_arms(pair, each.index, each.body, cells.lines))
        growth += each.speed**2 * table.growth
    return jnp.concatenate([cell_arms(cells.arm), *seats, *modes], axis=2), growth


class _HeldStructure(NamedTuple):
    """What moves the cells, with the rotation of both gears held.

    **Fields:**

    - `vectors`: motions that move the cells per degree of freedom, as `_arms` has them.
    - `give`: of these motions per load on them, $F$.
    - `spun`: of these motions by rotation, per square of the pinion's speed.
    - `outside`: of these motions under the loads from outside.
    - `count`: of them that are not modes.
    """

    vectors: Array
    give: Array
    spun: Array
    outside: Array
    count: int


def _held(mounted: PairSystem, bodies: list[VibratingBody]) -> _HeldStructure:
    structure, mapped = mounted.structure, mounted.structure.map
    vectors = jnp.zeros((mapped.size, 2))
    rigid = mounted.middles.T @ structure_vectors(mounted.pair)
    vectors = vectors.at[np.asarray(mapped.gear_dofs)].set(rigid)
    load = jnp.zeros(mapped.size)
    for each in bodies:
        vectors = jnp.concatenate([vectors, _against_gear(each, mapped.size)], axis=1)
        load = load.at[each.seats].add(each.speed**2 * each.body.seat_load)
    spins = [first + 5 for gear in mapped.gears for first in gear]
    kept = np.setdiff1d(np.asarray(mapped.free), spins)
    columns = jnp.concatenate([vectors, load[:, None], structure.load[:, None]], axis=1)[kept]
    moved = jnp.linalg.solve(structure.stiffness[kept[:, None], kept[None, :]], columns)
    moved = vectors[kept].T @ moved
    count = vectors.shape[1]
    square = jnp.concatenate([each.modes.square for each in bodies])
    grown = jnp.concatenate([each.speed**2 * each.modes.load for each in bodies]) / square
    both = jax.scipy.linalg.block_diag
    give = both(0.5 * (moved[:, :count] + moved[:, :count].T), jnp.diag(1.0 / square))
    return _HeldStructure(
        vectors=both(vectors, jnp.eye(square.size)),
        give=give,
        spun=jnp.concatenate([moved[:, count], grown]),
        outside=jnp.concatenate([moved[:, count + 1], jnp.zeros(square.size)]),
        count=count,
    )


def _against_gear(each: VibratingBody, size: int) -> Array:
    """Motions of a body's other seats against its gear's, by degrees of freedom of a structure."""
    body, columns = each.body, []
    gear = each.seats[6 * body.gear_seat : 6 * body.gear_seat + 6]
    for other in _others(body):
        away = body.seat_heights[other] - body.seat_heights[body.gear_seat]
        own = jnp.zeros((size, 6)).at[each.seats[6 * other : 6 * other + 6]].set(jnp.eye(6))
        columns.append(own.at[gear].set(-carried(away).T))
    return jnp.concatenate(columns, axis=1) if columns else jnp.zeros((size, 0))


class _Combinations(NamedTuple):
    """Mesh coordinates as combinations of the motions that move the cells.

    **Fields:**

    - `into`: arms of the coordinates per arm of the motions, `[motion, coordinate]`.
    - `out_of`: coordinates per motion, `[motion, coordinate]`.
    - `left_out`: as of `BodyTable`.
    """

    into: Array
    out_of: Array
    left_out: Array


def _combinations(arms: Array, in_mesh: Array, give: Array, count: int) -> _Combinations:
    """Those by which static loads move the cells most; which they are has no derivative."""
    # The sizes have one: modes are of unit mass, and what they are of a body has to follow that.
    size = jnp.sqrt(jnp.diagonal(give)[2:])
    seen = jnp.where(in_mesh[None, :, :, None], arms[..., 2:], 0.0)
    seen = jax.lax.stop_gradient(seen.reshape(-1, seen.shape[-1]) * size[None, :])
    energies, patterns = jnp.linalg.eigh(seen.T @ seen)
    patterns = patterns[:, ::-1][:, :count]
    both = jax.scipy.linalg.block_diag
    lost = jnp.sum(energies[: max(size.size - count, 0)]) / jnp.sum(energies)
    return _Combinations(
        into=both(jnp.eye(2), size[:, None] * patterns),
        out_of=both(jnp.eye(2), patterns / size[:, None]),
        left_out=jnp.sqrt(jnp.maximum(lost, 0.0)),
    )
