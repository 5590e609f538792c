r"""Natural modes of condensed gear bodies, as what turns with the body of its motion.

The motion of a body is the static one by which it follows its seats, and modes with all seats held:
$u = T s + X z$. A body of equal sectors has its modes in pairs that a turn of the body mixes, or
alone: turned by $\theta$, a pattern $z$ looks from outside like $D(\theta)z$, $D = e^{\theta J}$,
where $J$ has the wave number of each pair. In coordinates $x = D(\theta) z$, which stand still
while the body turns, mesh, seats and bearings are the same in every mesh period: this is the
rotated periodicity of the body, and its Doppler shift, at once (thesis eq. 3.5 to 3.9).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._system._condensed import Condensed
from jaxgear._system._residual_shapes import ResidualShapes
from jaxgear._system._sector_modes import SectorMotions, nodal_diameters

if TYPE_CHECKING:
    ModeRows = Array
    PerMode = Array
    BodyMatrix = Array
    MovingMatrix = Array
    TurningMatrix = Array
else:
    ModeRows = Float[Array, "period component cell own_mode"]
    PerMode = Float[Array, "mode"]
    BodyMatrix = Float[Array, "seat_dof_and_mode seat_dof_and_mode"]
    MovingMatrix = Float[Array, "motion motion"]
    TurningMatrix = Float[Array, "motion seat_dof_and_mode"]


class BodyModes(eqx.Module):
    r"""What of a condensed body vibrates: its mass on the seats, and its modes with these held.

    Coordinates are the displacements of the seats, then the modes, and then residual shapes.

    **Fields:**

    - `square`: $\omega^2$ of each mode and residual shape [rad2/s2].
    - `rows`: motion of the feet per mode, residual shapes apart, in the frame of each foot, as of
        `FlexibleBody` [kg^-1/2, m^-1 kg^-1/2].
    - `load`: on modes and residual shapes by rotation, per square of the speed [kg^1/2 m].
    - `mass`: of all coordinates, and of what residual shapes become as the body turns beneath
        them; of unit modal mass [kg, kg m, kg m2].
    - `turning`: $J$: change of all coordinates per turn of the body, antisymmetric but for
        residual shapes, which become others, the last rows [-].
    - `coriolis`, `softening`: $G$ of the body per speed, as `mass`, and $K_\sigma - M_\perp$ per
        its square, of all coordinates, or `None` if the body was made without them
        [kg, kg m, kg m2].
    - `waves`: wave number of each mode, counted as far as the sectors tell them apart.
    - `diameters`: nodal diameters of each mode.
    - `heat`: load on modes and residual shapes per free strain of hub and rim, or `None`
        [kg^1/2 m/s2].
    - `residual`: how residual shapes move the feet, or `None`: there are none.
    """

    square: PerMode
    rows: ModeRows
    load: PerMode
    mass: MovingMatrix
    turning: TurningMatrix
    coriolis: MovingMatrix | None
    softening: BodyMatrix | None
    waves: tuple[int, ...] = eqx.field(static=True)
    diameters: tuple[int, ...] = eqx.field(static=True)
    heat: Float[Array, "mode part"] | None = None
    residual: ResidualShapes | None = None

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.turning.shape[1]

    @property
    def seat_dofs(self) -> int:
        """Coordinates that are displacements of the seats."""
        return self.size - self.square.size

    @property
    def frequency(self) -> PerMode:
        """Natural frequencies with all seats held [Hz]."""
        return jnp.sqrt(self.square) / (2.0 * jnp.pi)


def wave_partners(waves: Sequence[int] | np.ndarray) -> tuple[np.ndarray, Array]:
    """Which mode each mode turns into as the body turns, and by how much faster.

    **Arguments:**

    - `waves`: wave numbers, as of `BodyModes`.

    **Returns:**

    Number of the partner of each mode, itself if it has none; its signed wave number, zero for what
    stands still on the body [-].
    """
    number = np.asarray(waves)
    partner = np.arange(number.size) + np.where(number < 0, -1, 0)
    partner[np.flatnonzero(number < 0) - 1] += 1
    alone = partner == np.arange(number.size)
    return partner, jnp.asarray(np.where(alone, 0, number), dtype=float)


def whole_pairs(count: int, waves: np.ndarray) -> int:
    """So many of the lowest modes, or one less where a pair would be parted.

    **Arguments:**

    - `count`: number of modes, no more than there are.
    - `waves`: wave numbers by rising frequency, of the second of a pair below zero.
    """
    return count - int(count < len(waves) and waves[count] < 0)


def seat_waves(dofs: int) -> np.ndarray:
    """Wave numbers of motions of seats: of x, y and z the first two are a pair."""
    return np.tile([1, -1, 0], dofs // 3)


def turning_of_waves(waves: np.ndarray) -> np.ndarray:
    """$J$ of motions with such wave numbers, as of `BodyBasis`, `[motion, motion]` [-]."""
    turning = np.zeros((len(waves), len(waves)))
    second = np.flatnonzero(waves < 0)
    turning[second - 1, second], turning[second, second - 1] = waves[second], -waves[second]
    return turning


class BasisMatrices(NamedTuple):
    """Matrices on seats and modes: some fields of `BodyModes`."""

    mass: Array
    turning: Array
    coriolis: Array | None
    softening: Array | None


@dataclass(frozen=True)
class BodyBasis:
    """Motions of a condensed body on which it vibrates.

    **Fields:**

    - `square`: of the frequency of each mode [rad2/s2].
    - `shapes`: $X$, modes with the seats held, of unit modal mass, `[dof, mode]`.
    - `following`: $T$, static motion with the seats, `[dof, 6 seat]`.
    - `waves`: wave number of each mode; the second of a pair has it negative.
    - `diameters`: nodal diameters of each mode.
    - `times`: for how many coordinates each stands, one sector's rim nodes for those of all, shape
        `[dof]`; `None`: each for itself [-].
    """

    square: np.ndarray
    shapes: np.ndarray
    following: np.ndarray
    waves: np.ndarray
    diameters: np.ndarray
    times: np.ndarray | None = None

    @property
    def motions(self) -> np.ndarray:
        """Motion of the body's coordinates per seat and mode, `[dof, 6 seat + mode]`."""
        return np.concatenate([self.following, self.shapes], axis=1)

    @property
    def turning(self) -> np.ndarray:
        """$J$: how motions that stand still on the body change in space as it turns [-]."""
        return turning_of_waves(np.r_[seat_waves(self.following.shape[1]), self.waves])

    def left_out(self, answers: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Static answers to loads, the seats held, less what of them is in the modes.

        **Arguments:**

        - `answers`: coordinates of the body under each load, shape `[load, dof]`.
        - `loads`: on these coordinates, shape `[load, dof]`.

        **Returns:**

        Shape `[load, dof]`.
        """
        return answers - ((loads @ self.shapes) / self.square) @ self.shapes.T

    def matrices(self, body: Condensed) -> "BasisMatrices":
        """Mass, turning and terms of rotation of the seats and modes.

        **Arguments:**

        - `body`: whose basis this is.

        **Returns:**

        They.
        """
        softening = None
        if body.spin_softening is not None and body.stress_stiffening is not None:
            softening = self._onto(body.stress_stiffening - body.spin_softening)
        motions = self.motions
        # Modes are of unit mass and apart: what rounding leaves would tie pairs together.
        mass, seats = np.eye(motions.shape[1]), self.following.shape[1]
        mass[:, :seats] = motions.T @ (body.mass @ self.following)
        mass[:seats, seats:] = mass[seats:, :seats].T
        return BasisMatrices(
            mass=jnp.asarray(0.5 * (mass + mass.T)),
            turning=jnp.asarray(self.turning),
            coriolis=None if body.coriolis is None else self._onto(body.coriolis),
            softening=softening,
        )

    def _onto(self, matrix: np.ndarray) -> Array:
        r"""A matrix of the body, the same after a turn by a sector, on seats and modes.

        Two modes of one wave are $\sqrt 2$ times real and imaginary part of a motion $w$, of which
        $w^HAw$ is as large on each sector; those of two waves have nothing between them.
        """
        seats = self.following.shape[1]
        found = np.zeros((seats + self.square.size,) * 2)
        found[:, :seats] = self.motions.T @ (matrix @ self.following)
        found[:seats, seats:] = (self.following.T @ matrix) @ self.shapes
        times = np.ones(len(matrix)) if self.times is None else self.times
        some = np.flatnonzero(times)
        acting, own = matrix[some] @ self.shapes, times[some, None] * self.shapes[some]
        for wave in np.unique(np.abs(self.waves)):
            alike = np.flatnonzero(np.abs(self.waves) == wave)
            between = own[:, alike].T @ acting[:, alike]
            if np.any(self.waves[alike] < 0):
                turned = turning_of_waves(np.sign(self.waves[alike]))
                between = 0.5 * (between + turned @ between @ turned.T)
            found[np.ix_(seats + alike, seats + alike)] = between
        return jnp.asarray(found)

    def repeats(self, teeth: int, sectors: int) -> int:
        """After how many mesh periods it is itself again.

        **Arguments:**

        - `teeth`: of the gear.
        - `sectors`: of the body.

        **Returns:**

        The number of mesh periods; twice as many for modes that change their sign from each sector
        to the next and pass an odd number of them, unless every tooth stands on the same.
        """
        common = math.gcd(teeth, sectors)
        alone, odd = bool(np.any(2 * self.waves == sectors)), (sectors // common) % 2 == 1
        return (2 if alone and odd and common < teeth else 1) * teeth // common

    def under_teeth(self, teeth: int, sectors: int) -> tuple["BodyBasis", int]:
        """What of a basis repeats under teeth, and after how many mesh periods.

        Modes in which neighbouring sectors move against each other are alone, and do not turn.

        **Arguments:**

        - `teeth`: of the gear.
        - `sectors`: of the body.

        **Returns:**

        The basis, without modes that change their sign from each sector to the next where every
        tooth stands on the same odd number of them; the number of mesh periods, as of `repeats`.
        """
        alone, repeats = 2 * self.waves == sectors, self.repeats(teeth, sectors)
        if not alone.any() or repeats > 1 or (sectors // teeth) % 2 == 0:
            return self, repeats
        kept = dict(
            square=self.square[~alone],
            shapes=self.shapes[:, ~alone],
            waves=self.waves[~alone],
            diameters=self.diameters[~alone],
        )
        return replace(self, **kept), repeats


def body_basis(body: Condensed, count: int) -> BodyBasis:
    """Find the modes of a condensed body with its seats held.

    Where the other half of a pair of interior shapes was cut off when the body was condensed, what
    of the shapes does not turn among them is left out: with it the body would not be even.

    **Arguments:**

    - `body`: the condensed body, of equal sectors.
    - `count`: number of modes; 0 are all. A pair is never parted.

    **Returns:**

    The modes by rising frequency, pairs beside each other, and the motions with the seats.

    **Raises:**

    - `ValueError` if the body has fewer than three equal sectors, or is not as even as it claims.
    """
    sectors = body.facts.get("sectors", 1)
    assert isinstance(sectors, int)
    require(
        sectors >= 3,
        "A condensed body that vibrates must be of three or more equal sectors, got {got} of "
        "{name!r}: seen from the bearings it would change as it turns. Give its grid, so that its "
        "sectors are known, or leave it to statics.",
        got=sectors,
        name=body.name,
    )
    waves = SectorMotions(body, sectors)
    square, shapes, numbers = waves.modes(count)
    # The second of a pair has as many as the first, beside which it stands.
    first = numbers >= 0
    diameters = nodal_diameters(body.rim_nodes, shapes[: waves.rim, first])
    return BodyBasis(
        square=square,
        shapes=shapes,
        following=waves.following(body.stiffness, len(body.seats)),
        waves=numbers,
        diameters=diameters[np.cumsum(first) - 1],
        times=waves.times,
    )
