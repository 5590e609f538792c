r"""Condensed bodies in motion: their seats and modes beside the rest of a structure.

Seats and modes are in coordinates that stand still in space while the body turns, so that a pair
with condensed bodies is a system like any other, periodic with the mesh, whose turning bodies bring
terms of their own. With $B = \mp J\,\Omega_i/\Omega_1$ the velocity on the body is
$\dot x + \Omega_1 Bx$, hence its inertia is $M\ddot x + \Omega_1 G\dot x + \Omega_1^2 Sx$, where
$G = MB - B^TM$ and $S = -B^TMB$. With Coriolis forces, spin softening and stress stiffening of
the body all is exact.
Without them only waves of two and more nodal diameters turn with the body: rigid motions, and the
bending of shafts, would otherwise be given a false inertia.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._dynamics._damping import AbstractDamping
from jaxgear._dynamics._types import Matrix, ModeValues, Vector
from jaxgear._geometry._lines import MeshGrid
from jaxgear._system._body_modes import BodyModes
from jaxgear._system._flexible import FlexibleBody, condensed
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem
from jaxgear._types import Scalar

# Waves of at least so many nodal diameters turn with a body that has no terms of rotation.
LEAST_TURNING = 2


class BodyPlace(eqx.Module):
    """Where the seats and modes of a condensed body are among the degrees of freedom of a pair.

    **Fields:**

    - `square`: of the angular frequency of its modes, all seats held [rad2/s2].
    - `residual`: of its residual shapes, whose degrees of freedom follow the modes' [rad2/s2].
    - `index`: 0 for the pinion, 1 for the wheel.
    - `seats`: degrees of freedom of its seats, six each.
    - `first`: degree of freedom of its first mode; the others follow.
    - `speed`: with which it turns about +Z, over the pinion's [-].
    - `waves`, `diameters`: of its modes, as of `BodyModes`.
    - `residual_waves`: that its residual shapes are made of.
    """

    square: ModeValues
    residual: Array
    index: int = eqx.field(static=True)
    seats: tuple[int, ...] = eqx.field(static=True)
    first: int = eqx.field(static=True)
    speed: float = eqx.field(static=True)
    waves: tuple[int, ...] = eqx.field(static=True)
    diameters: tuple[int, ...] = eqx.field(static=True)
    residual_waves: tuple[int, ...] = eqx.field(static=True, default=())

    @property
    def mode_dofs(self) -> np.ndarray:
        """Degrees of freedom of its modes."""
        return self.first + np.arange(len(self.waves))

    @property
    def residual_dofs(self) -> np.ndarray:
        """Degrees of freedom of its residual shapes."""
        return self.first + len(self.waves) + np.arange(self.residual.size)


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
    def mode_heat(self) -> Vector:
        """Loads on its modes by heat [kg^1/2 m/s2]."""
        heat, modes = self.body.heat, self.modes
        if heat is None or modes.heat is None:
            return jnp.zeros_like(modes.square)
        return modes.heat @ heat.strain

    @property
    def place(self) -> BodyPlace:
        """What others need of it."""
        count = len(self.modes.waves)
        residual = self.modes.residual
        return BodyPlace(
            square=self.modes.square[:count],
            residual=self.modes.square[count:],
            index=self.index,
            seats=tuple(int(dof) for dof in self.seats),
            first=self.first,
            speed=self.speed,
            waves=self.modes.waves,
            diameters=self.modes.diameters,
            residual_waves=() if residual is None else residual.waves,
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
    for index, body in condensed(model.bodies):
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
        speed = (1.0, -ratio)[index]
        found.append(VibratingBody(index, body, body.modes, seats, first, speed))
        first += body.modes.square.size
    return found


def size_with(mounted: PairSystem, bodies: list[VibratingBody]) -> int:
    """Number of degrees of freedom of a structure and the modes on it."""
    return mounted.structure.map.size + sum(each.modes.square.size for each in bodies)


def with_modes(matrix: Array, size: int) -> Array:
    """A matrix of the structure among all degrees of freedom, zero for the modes."""
    if len(matrix) == size:
        return matrix
    return jnp.zeros((size, size)).at[: len(matrix), : len(matrix)].set(matrix)


def matrices_with(
    mounted: PairSystem, bodies: list[VibratingBody], size: int
) -> tuple[Array, Array]:
    """Mass and stiffness of a structure and of the seats and modes of bodies in it.

    **Arguments:**

    - `mounted`: the structure.
    - `bodies`: condensed.
    - `size`: number of degrees of freedom.

    **Returns:**

    Mass and stiffness over all degrees of freedom.
    """
    structure = mounted.structure
    mass, stiffness = (with_modes(each, size) for each in (structure.mass, structure.stiffness))
    for each in bodies:
        own_mass = each.modes.mass[: each.modes.size, : each.modes.size]
        mass = mass.at[each.dofs[:, None], each.dofs[None, :]].add(own_mass)
        own = each.dofs[len(each.seats) :]
        stiffness = stiffness.at[own, own].add(each.modes.square)
    return mass, stiffness


def outside_loads(mounted: PairSystem, bodies: list[VibratingBody], size: int) -> Vector:
    """Loads from outside on a structure and by heat on the modes of bodies in it.

    **Arguments:**

    - `mounted`: the structure.
    - `bodies`: condensed.
    - `size`: number of degrees of freedom.

    **Returns:**

    Loads on all degrees of freedom.
    """
    own = mounted.structure.load
    load = jnp.zeros(size).at[: own.size].set(own)
    for each in bodies:
        load = load.at[each.dofs[len(each.seats) :]].add(each.mode_heat)
    return load


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
        seats, size, count = modes.seat_dofs, modes.size, modes.square.size
        waves = np.r_[np.zeros(seats), np.asarray(modes.diameters) >= LEAST_TURNING]
        # Residual shapes turn, as all of their waves do, and what they damp stays behind.
        alone = np.ones(len(modes.turning) - size)
        turns = jnp.asarray(np.concatenate([waves, np.zeros(size - waves.size), alone]))
        rates = damping.matrix(jnp.eye(count), jnp.diag(modes.square), jnp.zeros((count, count)))
        damped = turns[:size] * jnp.concatenate([jnp.zeros(seats), jnp.diagonal(rates)])
        turning = modes.turning if whole else modes.turning * turns[:, None]
        moved = -each.speed * turning
        gyroscopic = modes.mass[:size] @ moved - moved.T @ modes.mass[:, :size]
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
            turned = each.speed * modes.coriolis[:size] @ moved
            gyroscopic = gyroscopic + each.speed * modes.coriolis[:size, :size]
            softening = softening + turned + each.speed**2 * modes.softening
        circulatory = damped[:, None] * moved[:size] * turns[None, :size]
        terms = TurningTerms(
            gyroscopic=terms.gyroscopic.at[at].add(0.5 * (gyroscopic - gyroscopic.T)),
            circulatory=terms.circulatory.at[at].add(circulatory),
            softening=terms.softening.at[at].add(0.5 * (softening + softening.T)),
            load=terms.load.at[each.dofs].add(
                each.speed**2 * jnp.concatenate([each.body.seat_load, modes.load])
            ),
        )
    return terms
