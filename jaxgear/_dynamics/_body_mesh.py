r"""The mesh of condensed bodies in motion, by few coordinates.

All cells move by seats and modes, but on a short arc of the rim few combinations of them can be
told apart. These are the mesh coordinates; what they leave out is added to the compliance between
cells, so that statics is as it was.
"""

import dataclasses
import functools
import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array

from jaxgear._contact._cells import MeshCells, mesh_gap
from jaxgear._dynamics._bodies import VibratingBody
from jaxgear._dynamics._moving_mesh import BodyGive, MovingMesh, beam_bow, mean_mesh
from jaxgear._dynamics._table import at_places, tabulated
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._wrench import beam_arms, cell_arms, structure_vectors
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import foot_tables, line_loads, mode_arms
from jaxgear._system._gear_body import carried
from jaxgear._system._mesh_vectors import rigid_beam_vectors
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem
from jaxgear._system._structure import static_flexibility
from jaxgear._types import CellArmGrid, CellGrid, DenseCouplingGrid, DofCoordinates


def body_mesh(
    model: PairModel,
    mounted: PairSystem,
    cycle: MeshCycle,
    grid: MeshGrid,
    bodies: list[VibratingBody],
    coordinates: int,
) -> MovingMesh:
    r"""The mesh of a pair with condensed bodies over one cycle.

    With $A$ the arms of cells and $P$ some loads on them, the combinations kept are the first
    eigenvectors of $D A^TPP^TA D$, $D$ of a mode the reciprocal of its squared frequency: those to
    which these loads give most kinetic energy (theory 7.8). A load that they hold all of excites
    each mode as it does without them. What they leave out follows its load at once; of the load
    that is always there this must be next to nothing, or what the body gives on the mean rides up
    and down with it. Hence the loads are those of the cycle at rest and, a tenth of them, loads on
    each line. The coordinates of sections, seven beside a beam, are kept as they are.

    **Arguments:**

    - `model`: the pair.
    - `mounted`: its structure.
    - `cycle`: its quasi-static states.
    - `grid`: of the cycle.
    - `bodies`: those that vibrate.
    - `coordinates`: of the mesh, beside approach and tilt.

    **Returns:**

    The mesh.
    """
    cells, pair = cycle.cells, model.pair
    at = at_places(pair, cells)
    gap = jnp.stack([mesh_gap(pair, c.lines, model.flanks, model.misalignment) for c in at])
    at_cells = [_arms(pair, bodies, c, mounted.bends) for c in at]
    growth = jnp.stack([x.growth for x in at_cells])
    heated = jnp.stack([x.heated for x in at_cells])
    held, middle = _held(mounted, bodies), at_cells[_MIDDLE_PLACE]
    few = _choice(at_cells, _loads(cycle), held, coordinates)
    met = jnp.stack([x.by(few.into) for x in at_cells])
    seats, kept, give = (
        jnp.stack([x.seats for x in at_cells]),
        met[_MIDDLE_PLACE],
        held.give_of(few),
    )
    beyond = _in_all(middle, held, beam_bow(mounted)) - _between(kept, give)
    grown = growth + seats @ held.spun[: held.count] - met @ (few.out_of.T @ held.spun)
    # Loads from outside and heat move the cells as they do at rest, by what coordinates leave out
    # too. What heat does with the seats held is all in `heated`.
    moved_out = seats @ held.outside[: held.count]
    gap = gap - heated - (moved_out - met @ (few.out_of.T @ held.outside))
    pressed = jnp.sum(kept * cycle.force[:, :, None], axis=1)
    rest = (few.out_of.T @ held.outside)[None, :] - pressed @ give
    assert cells.coupling is not None
    moved = dataclasses.replace(cells, coupling=cells.coupling + beyond)
    # The bodies have their share in what the mean stores, however few of their modes move.
    gives = BodyGive(middle.feet + beyond, held.modes_give_of(few))
    return MovingMesh(
        table=tabulated(grid, moved, gap, met, grown),
        mean=mean_mesh(cycle, moved.coupling, kept, held.vectors @ few.out_of, gives),
        rest=rest.at[:, 0].add(cycle.approach),
        left_out=few.left_out,
    )


# The middle of a step, among its three places.
_MIDDLE_PLACE = 1


def _between(arms: Array, flexibility: Array) -> Array:
    """Compliance between all cells by motions of a flexibility, at each phase."""
    return (arms @ flexibility) @ jnp.swapaxes(arms, 1, 2)


def _in_all(cells: "_AtCells", held: "_HeldStructure", bow: Array | None) -> DenseCouplingGrid:
    """Compliance between all cells by what is outside of the bodies' modes."""
    whole = _between(cells.seats, held.give[: held.count, : held.count])
    if bow is None:
        return whole
    # It has no mass either: beams and shafts bend by their nodes, and so in mesh coordinates.
    own = bow[: held.sections, : held.sections]
    return whole + _between(cells.seats[:, :, : held.sections], own)


def _others(body: FlexibleBody) -> np.ndarray:
    """Seats other than that which turns with the gear."""
    return np.array([i for i in range(len(body.seats)) if i != body.gear_seat], dtype=int)


class _AtCells(NamedTuple):
    """Condensed bodies at the cells.

    What modes do takes gigabytes over a long cycle, and is not put together with the rest.

    **Fields:**

    - `seats`: approach of cells by sections, then other seats against the gear's.
    - `modes`: approach of cells by modes, which come after these.
    - `growth`: approach by rotation, per square of the pinion's speed.
    - `heated`: approach by heat, the seats held.
    - `feet`: compliance between cells, the seats held.
    """

    seats: CellArmGrid
    modes: CellArmGrid
    growth: CellGrid
    heated: CellGrid
    feet: DenseCouplingGrid

    def by(self, motions: Array) -> Array:
        """Approach of cells by combinations of motions, `[motion, coordinate]`."""
        count = self.seats.shape[2]
        return self.seats @ motions[:count] + self.modes @ motions[count:]

    def under(self, loads: Array) -> Array:
        """What loads on the cells are on each motion, `[phase, load, motion]`."""
        return jnp.concatenate([loads @ self.seats, loads @ self.modes], axis=2)


def _arms(pair: GearPair, bodies: list[VibratingBody], cells: MeshCells, bends: bool) -> _AtCells:
    seats, modes, feet, growth = [], [], [], jnp.zeros_like(cells.stiffness)
    heated = jnp.zeros_like(cells.stiffness)
    for each in bodies:
        table = foot_tables(pair, each.index, each.body, cells.lines)
        others = (6 * _others(each.body)[:, None] + np.arange(6)).ravel()
        seats.append(table.arms[:, :, others])
        modes.append(mode_arms(pair, each.index, each.body, cells.lines))
        feet.append(table.compliance)
        growth += each.speed**2 * table.growth
        heated += 0.0 if table.heated is None else table.heated
    sections = beam_arms(pair, cells.lines) if bends else cell_arms(cells.arm)
    held, moved = jnp.concatenate([sections, *seats], axis=2), jnp.concatenate(modes, axis=2)
    return _AtCells(held, moved, growth, heated, functools.reduce(operator.add, feet))


class _HeldStructure(NamedTuple):
    """What moves the cells, with the rotation of both gears held.

    **Fields:**

    - `vectors`: motions that move the cells per degree of freedom, as `_arms` has them.
    - `give`: of these motions per load on them, $F$.
    - `spun`: of these motions by rotation, per square of the pinion's speed.
    - `outside`: of these motions under the loads from outside and by heat.
    - `sections`: of them that are motions of sections: the first.
    - `count`: of them that are not modes.
    - `weights`: with which each counts in the choice of mesh coordinates [-].
    """

    vectors: Array
    give: Array
    spun: Array
    outside: Array
    sections: int
    count: int
    weights: Array

    def give_of(self, few: "_Combinations") -> Array:
        """Of mesh coordinates per load on them."""
        return few.out_of.T @ self.give @ few.out_of

    def modes_give_of(self, few: "_Combinations") -> Array:
        """Of mesh coordinates per load on them by modes alone, the seats held."""
        own = few.out_of[self.count :]
        return own.T @ (jnp.diagonal(self.give)[self.count :, None] * own)


def _held(mounted: PairSystem, bodies: list[VibratingBody]) -> _HeldStructure:
    vectors = _section_vectors(mounted, bodies)
    gears = np.asarray(mounted.structure.map.gear_dofs)
    own = [_against_gear(each, mounted.structure.map.size)[gears] for each in bodies]
    vectors, sections = jnp.concatenate([vectors, *own], axis=1), vectors.shape[1]
    load = jnp.zeros(mounted.structure.map.size)
    for each in bodies:
        load = load.at[each.seats].add(each.speed**2 * each.body.seat_load)
    both = jnp.concatenate([vectors, load[gears][:, None]], axis=1)
    statics = static_flexibility(mounted.structure, both)
    count = vectors.shape[1]
    square = jnp.concatenate([each.modes.square for each in bodies])
    grown = jnp.concatenate([each.speed**2 * each.modes.load for each in bodies]) / square
    warm = jnp.concatenate([each.mode_heat for each in bodies]) / square
    on_diagonal = jax.scipy.linalg.block_diag
    moved = statics.mesh_flexibility[:count]
    whole = jnp.zeros((mounted.structure.map.size, count)).at[gears].set(vectors)
    return _HeldStructure(
        vectors=on_diagonal(whole, jnp.eye(square.size)),
        give=on_diagonal(moved[:, :count], jnp.diag(1.0 / square)),
        spun=jnp.concatenate([moved[:, count], grown]),
        outside=jnp.concatenate([statics.mesh_offset[:count], warm]),
        sections=sections,
        count=count,
        # Kinetic over strain energy of a mode under a load, against that of the slowest.
        weights=jnp.concatenate([jnp.ones(count), jnp.sqrt(jnp.min(square) / square)]),
    )


def _section_vectors(mounted: PairSystem, bodies: list[VibratingBody]) -> DofCoordinates:
    """Coordinates of sections per motion of the gears' nodes; condensed gears go with their seat.

    Approach and tilt, or the seven of `beam_basis` if a body bends.
    """
    if not mounted.bends:
        return mounted.middles.T @ structure_vectors(mounted.pair)
    rigid = rigid_beam_vectors(mounted.pair)
    found = mounted.vectors[:, : rigid.shape[1]]
    for each in bodies:
        rows = slice(6 * each.index, 6 * each.index + 6)
        found = found + mounted.middles[rows].T @ rigid[rows]
    return found


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
    - `left_out`: as of `MovingMesh`.
    """

    into: Array
    out_of: Array
    left_out: Array


# Loads on lines that motion adds to those at rest, as parts of all that there is.
_MOTION = 0.1


def _loads(cycle: MeshCycle) -> Array:
    """Loads of one in all that the mesh coordinates are chosen by, `[phase, load, cell]` [-]."""
    lines = cycle.cells.lines
    whole = jnp.sum(cycle.force, axis=1)[:, None]
    rest = cycle.force / jnp.where(whole > 0.0, whole, 1.0)
    active = jnp.sum(lines.fraction, axis=(1, 2))[:, None, None]
    moving = _MOTION * line_loads(lines) / jnp.where(active > 0.0, active, 1.0)
    return jnp.concatenate([rest[:, None, :], moving], axis=1)


def _choice(cells: list[_AtCells], loads: Array, held: _HeldStructure, count: int) -> _Combinations:
    """So many combinations of modes for loads on the cells at all places."""
    alone = jnp.diagonal(held.give)
    size = jnp.sqrt(alone) * held.weights
    energy = _energy([x.under(loads) for x in cells], size, held.sections)
    few = _combinations(energy, size, held.sections, count)
    return _of_unit_strain(few, alone, held.sections)


def _energy(loads: list[Array], size: Array, sections: int) -> Array:
    """What some loads, as of `_AtCells.under`, give to motions of modes measured by their sizes."""
    seen = (x[:, :, sections:].reshape(-1, size.size - sections) for x in loads)
    seen = (each * size[None, sections:] for each in seen)
    return functools.reduce(operator.add, (x.T @ x for x in seen))


def _combinations(energy: Array, size: Array, sections: int, count: int) -> _Combinations:
    """Those that loads of this energy move most; motions measured by their sizes."""
    size = size[sections:]
    patterns = _leading(energy, count)
    energy, found = (jax.lax.stop_gradient(each) for each in (energy, patterns))
    whole = jnp.trace(energy)
    lost = jnp.maximum(whole - jnp.sum(found * (energy @ found)), 0.0) / whole
    both = jax.scipy.linalg.block_diag
    return _Combinations(
        into=both(jnp.eye(sections), size[:, None] * patterns),
        out_of=both(jnp.eye(sections), patterns / size[:, None]),
        left_out=jnp.sqrt(lost),
    )


def _of_unit_strain(few: _Combinations, give: Array, sections: int) -> _Combinations:
    """The same combinations in coordinates of one size: their squares are strain energy.

    What measures a response, such as a step along a branch, then sees what moves the cells most.
    """
    out_of, into = few.out_of[sections:, sections:], few.into[sections:, sections:]
    root = jnp.linalg.cholesky(out_of.T @ (give[sections:, None] * out_of))
    both = jax.scipy.linalg.block_diag
    out_of = jax.scipy.linalg.solve_triangular(root, out_of.T, lower=True).T
    return _Combinations(
        into=both(few.into[:sections, :sections], into @ root),
        out_of=both(few.out_of[:sections, :sections], out_of),
        left_out=few.left_out,
    )


# Differences of eigenvalues that are rounding, over the largest.
_NOISE = 1e-14


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def _leading(matrix: Array, count: int) -> Array:
    """First eigenvectors of a symmetric matrix. Only the space that they span has a meaning.

    Its derivative is that of this space: it turns by what the first take from the others, and how
    they turn among themselves, which may have no derivative, does not matter.
    """
    return jnp.linalg.eigh(matrix)[1][:, ::-1][:, :count]


@_leading.defjvp
def _leading_tangent(count: int, primals: tuple[Array], tangents: tuple[Array]):
    values, vectors = jnp.linalg.eigh(primals[0])
    values, vectors = values[::-1], vectors[:, ::-1]
    first, others = vectors[:, :count], vectors[:, count:]
    gap = values[None, :count] - values[count:, None]
    apart = gap > _NOISE * values[0]
    turned = (others.T @ tangents[0] @ first) * jnp.where(apart, 1.0, 0.0)
    return first, others @ (turned / jnp.where(apart, gap, 1.0))
