"""Condensed bodies under the cells of a cycle: what the feet of teeth give, at every phase."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._compiled import compiled
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_modes import wave_partners
from jaxgear._system._flexible import FlexibleBody
from jaxgear._types import CellArmGrid, CellGrid, DenseCouplingGrid, Reals


class FootTables(eqx.Module):
    """What a body adds to the cells of a cycle.

    **Fields:**

    - `compliance`: between cells, with the seats held [m/N].
    - `arms`: approach of each cell per motion of the seats, along and about S, T, Z [-, m].
    - `growth`: approach of each cell by rotation, per square of the speed [m s2].
    - `heated`: approach of each cell by heat, or `None`: the body was made without [m].
    """

    compliance: DenseCouplingGrid
    arms: CellArmGrid
    growth: CellGrid
    heated: CellGrid | None = None


@compiled
def foot_tables(pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines) -> FootTables:
    """What a condensed body adds to the cells of a cycle.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `body`: of that gear.
    - `lines`: where the cells are.

    **Returns:**

    Compliance, arms, growth, approach by heat.
    """
    # One mesh period at a time: each has the table of the teeth that are in mesh.
    period = lambda x: x.reshape(lines.periods, -1, *x.shape[1:])
    roll = period(lines.roll)
    warm = None if body.heat is None else body.heat.growth

    def of_period(given: tuple[Array, Array]):
        number, roll = given
        table = jax.tree.map(
            lambda x: x[number % body.periods],
            _Table(body.flexibility, body.from_seats, body.growth, body.centres, warm),
        )
        return _on_cells(pair, index, body, table, roll, lines.face_position)

    found = jax.lax.map(of_period, (jnp.arange(lines.periods), roll))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), found)


@compiled
def mode_arms(pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines) -> CellArmGrid:
    """Approach of each cell per motion of modes and residual shapes, in coordinates of space.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `body`: of that gear, with modes.
    - `lines`: where the cells are.

    **Returns:**

    Arms of all cells at each phase [kg^-1/2].
    """
    modes = body.modes
    assert modes is not None
    on_body = _first_cells(pair, index, body, lines)
    roll = lines.roll.reshape(lines.periods, -1, *lines.roll.shape[1:])

    def of_period(given: tuple[Array, Array]) -> Array:
        period, roll = given
        own = period % body.periods
        weights, angle = foot_weights(pair, index, body.centres[own], roll, lines.face_position)
        rows = modes.rows[own]
        arms = sum(
            (weights[c][:, :, None] * rows[i][None] for i, c in enumerate(body.components)),
            jnp.zeros(()),
        )
        ahead = angle[:, 0] - on_body[own]
        arms = _in_space(modes.waves, arms, ahead[:, None])
        if modes.residual is None:
            return arms
        kept = [weights[c] for c in body.components]
        return jnp.concatenate([arms, modes.residual.arms(own, kept, ahead)], axis=2)

    found = jax.lax.map(of_period, (jnp.arange(lines.periods), roll))
    return found.reshape(-1, *found.shape[2:])


@compiled
def mode_loads(
    pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines, force: Reals
) -> Array:
    """Loads on the modes of a body by forces of cells, in coordinates of space.

    **Arguments:**

    - `pair`, `index`, `body`: as of `mode_arms`.
    - `lines`: where the cells are, over one cycle.
    - `force`: of the cells at each phase of one cycle, or of several one after the other, shape
        `[phase, cell]` [N].

    **Returns:**

    Shape `[phase, mode]`: what closes a cell is pushed back [N kg^-1/2].
    """
    modes = body.modes
    assert modes is not None
    on_body = _first_cells(pair, index, body, lines)
    apart = lambda x: x.reshape(-1, len(lines.phase) // lines.periods, *x.shape[1:])
    roll, force = apart(lines.roll), apart(force)

    def of_period(given: tuple[Array, Array]) -> Array:
        period, force = given
        own, place = period % body.periods, period % lines.periods
        centres, rows = body.centres[own], modes.rows[own]
        weights, angle = foot_weights(pair, index, centres, roll[place], lines.face_position)
        load = sum(
            (-(weights[c] * force) @ rows[i] for i, c in enumerate(body.components)),
            jnp.zeros(()),
        )
        return _in_space(modes.waves, load, angle[:, 0] - on_body[own])

    found = jax.lax.map(of_period, (jnp.arange(len(force)), force))
    return found.reshape(-1, found.shape[-1])


def _in_space(waves: tuple[int, ...], own: Array, ahead: Array) -> Array:
    """What is told per mode of a body, in coordinates of space, which it is ahead of [rad]."""
    partner, number = wave_partners(waves)
    turned = jnp.multiply.outer(ahead, number)
    # The first of a pair has a positive number, the second the same negative.
    return jnp.cos(turned) * own - jnp.sin(turned) * own[..., partner]


def _first_cells(pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines) -> Array:
    """Angles on the body of the first cell of each mesh period [rad]."""
    teeth = (pair.pinion, pair.wheel)[index].teeth
    # Its tooth in each period, and how far the helix has it turned.
    first = np.arange(body.periods)
    tooth = (1.0, -1.0)[index] * (body.first_line - first)
    twist = (1.0, -1.0)[index] * jnp.tan(pair.base_helix_angle) / pair.base_radius[index]
    return 2.0 * jnp.pi / teeth * jnp.asarray(tooth) + twist * lines.face_position.ravel()[0]


@compiled
def foot_loads(
    pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines
) -> tuple[Array, Array]:
    """Loads on the feet by loads along each contact line by itself, as of `line_loads`.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `body`: of that gear.
    - `lines`: where the cells are.

    **Returns:**

    On the components of the cells' feet, shape `[phase, load, component, cell]` [-, m]; how far
    the body has turned from where its first cell is on it, shape `[phase]` [rad].
    """
    on_body = _first_cells(pair, index, body, lines)
    roll = lines.roll.reshape(lines.periods, -1, *lines.roll.shape[1:])

    def of_period(given: tuple[Array, Array]) -> tuple[Array, Array]:
        period, roll = given
        own = period % body.periods
        weights, angle = foot_weights(pair, index, body.centres[own], roll, lines.face_position)
        chosen = jnp.stack([weights[c] for c in body.components], axis=1)
        return chosen, angle[:, 0] - on_body[own]

    found, ahead = jax.lax.map(of_period, (jnp.arange(lines.periods), roll))
    found = found.reshape(-1, *found.shape[2:])
    return line_loads(lines)[:, :, None, :] * found[:, None], ahead.ravel()


# Loads along a contact line: even, tilted and bowed, the latter as parts of an even one.
_TILTED, _BOWED = 0.5, 0.3


def line_loads(lines: ContactLines) -> Reals:
    """Loads along each contact line by itself, even, tilted and bowed, of one on a whole cell.

    **Arguments:**

    - `lines`: where the cells are.

    **Returns:**

    Forces of all cells at each phase, `[phase, load, cell]` [-].
    """
    far = jnp.max(jnp.abs(lines.face_position))
    along = lines.face_position / jnp.where(far > 0.0, far, 1.0)
    shapes = [jnp.ones_like(along), _TILTED * along, _BOWED * (along**2 - jnp.mean(along**2))]
    phases, count, slices = lines.fraction.shape
    each = jnp.einsum("pls,ks->plks", lines.fraction, jnp.stack(shapes))
    alone = jnp.einsum("plks,lm->plkms", each, jnp.eye(count))
    return alone.reshape(phases, -1, count * slices)


class _Table(NamedTuple):
    """The tables of a body in one mesh period, or in all; `warm`: motion of the feet by heat."""

    flexibility: Array
    from_seats: Array
    growth: Array
    centres: Array
    warm: Array | None


def _on_cells(
    pair: GearPair,
    index: int,
    body: FlexibleBody,
    table: _Table,
    roll: Reals,
    face_position: Reals,
) -> FootTables:
    """What a body adds to the cells of one mesh period."""
    flexibility, from_seats, growth, centres, warm = table
    all_weights, angle = foot_weights(pair, index, centres, roll, face_position)
    weights = [all_weights[component] for component in body.components]
    size = range(len(weights))
    # Written out over the few components: a batch of tiny products costs many times its arithmetic.
    none = jnp.zeros(())

    def given(a: int) -> Array:
        """Motion of all feet along one component, by the forces of all cells."""
        return sum((flexibility[a, b][None] * weights[b][:, None, :] for b in size), none)

    compliance = sum((weights[a][:, :, None] * given(a) for a in size), none)
    rows = sum((weights[a][:, :, None] * from_seats[a][None] for a in size), none)
    moved = lambda feet: sum((weights[a] * feet[a][None] for a in size), none)
    heated = None
    if body.heat is not None and warm is not None:
        # A slice moves as one with its foot, and grows from there.
        reach = _along_normal(pair, index, roll, face_position)
        reach -= sum((all_weights[axis] * centres[None, :, axis] for axis in range(3)), none)
        heated = moved(warm) + body.heat.of_teeth * reach
    return FootTables(compliance, _in_fixed_frame(rows, angle), moved(growth), heated)


def _along_normal(pair: GearPair, index: int, roll: Reals, face_position: Reals) -> Array:
    r"""Place of the contact along the normal, $\rho\cos\beta_b \mp z\sin\beta_b$ [m]."""
    own = roll if index == 0 else pair.tangent_length - roll
    along = jnp.cos(pair.base_helix_angle) * own
    heights = jnp.broadcast_to(face_position, roll.shape)
    along -= (1.0, -1.0)[index] * jnp.sin(pair.base_helix_angle) * heights
    return along.reshape(roll.shape[0], -1)


def foot_weights(
    pair: GearPair, index: int, centres: Array, roll: Reals, face_position: Reals
) -> tuple[list[Array], Array]:
    r"""Approach of each cell per motion of its foot, and the angle of its tooth's middle.

    In the frame of the foot the normal is $(\cos\beta_b\sin\kappa, \cos\beta_b\cos\kappa,
    \mp\sin\beta_b)$, with $\kappa = \rho/r_b - \psi_b$ the load's angle against the perpendicular
    to the tooth's middle, $\rho$ the gear's own roll length and $\psi_b$ half its tooth's angle at
    the base circle; the point of contact is $r_b(\cos\kappa, -\sin\kappa) + \rho(\sin\kappa,
    \cos\kappa)$ from the axis.
    """
    sign = (1.0, -1.0)[index]
    phases = roll.shape[0]
    base = pair.base_radius[index]
    own = (roll if index == 0 else pair.tangent_length - roll).reshape(phases, -1)
    load = own / base - pair.half_thickness_at_base[index]
    sine, cosine = jnp.sin(load), jnp.cos(load)
    helix = pair.base_helix_angle
    flat = jnp.cos(helix)
    normal = flat * sine, flat * cosine, jnp.full_like(own, -sign) * jnp.sin(helix)
    heights = jnp.broadcast_to(face_position, roll.shape).reshape(phases, -1)
    point = base * cosine + own * sine, own * cosine - base * sine, heights
    arm = [point[axis] - centres[None, :, axis] for axis in range(3)]
    moment = [
        arm[(axis + 1) % 3] * normal[(axis + 2) % 3] - arm[(axis + 2) % 3] * normal[(axis + 1) % 3]
        for axis in range(3)
    ]
    angle = load - pair.working_pressure_angle + (0.0 if index == 0 else jnp.pi)
    return [*normal, *moment], angle


def _in_fixed_frame(rows: Array, angle: Array) -> Array:
    """Rows per motion of the seats in the frame of each foot, per motion along S, T, Z."""
    apart = rows.reshape(*rows.shape[:2], -1, 3)
    cosine, sine = jnp.cos(angle)[:, :, None], jnp.sin(angle)[:, :, None]
    r, t, z = apart[..., 0], apart[..., 1], apart[..., 2]
    return jnp.stack([cosine * r - sine * t, sine * r + cosine * t, z], axis=-1).reshape(rows.shape)
