r"""Modes of condensed bodies that are no coordinates of a pair: the mesh feels their inertia.

A mode far above the mesh's strongest harmonics follows the teeth, so that its motion is known where
the load on the mesh is: harmonic by harmonic, without an unknown of its own. Statics has all of its
give; what is here is what inertia, damping and the turning of the body make of that.

A pair of waves of $w$ nodal diameters on a body that turns at $b\,\Omega_1$ meets a load at
$\omega$ in space as one at $\omega \pm w b\,\Omega_1$ on the body (thesis eq. 3.5 to 3.9). With
$h(\nu) = 1/(\omega_i^2 - \nu^2 + 2i\xi\omega_i\nu)$ at both, and $p_1, p_2$ the arms of the
pair, the mesh coordinates give
$\tfrac12(h_+ + h_-)(p_1p_1^T + p_2p_2^T) + \tfrac i2(h_+ - h_-)(p_1p_2^T - p_2p_1^T)$ per load.
Coriolis forces and the softening by rotation are left out: they change $\omega_i^2$ by the order of
$(\Omega_1/\omega_i)^2$.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jaxgear._dynamics._bodies import TURNING, VibratingBody
from jaxgear._dynamics._damping import AbstractDamping
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._system._flexible import mode_arms
from jaxgear._types import CellArmGrid, CellGrid, Scalar


class ModesBeyondMesh(eqx.Module):
    r"""Modes that are no coordinates, as the mesh coordinates feel them.

    **Fields:**

    - `square`: $\omega_i^2$ of each pair of modes, or of a mode alone [rad2/s2].
    - `rate`: $2\xi\omega_i$ of each [1/s].
    - `turning`: $wb$, nodal diameters times the body's speed over the pinion's; zero of a mode
        alone [-].
    - `first`, `second`: $p_1, p_2$, mesh coordinates per motion of each; zero where a mode is alone
        [kg^-1/2].
    """

    square: Float[Array, " pair"]
    rate: Float[Array, " pair"]
    turning: Float[Array, " pair"]
    first: Float[Array, "pair coordinate"]
    second: Float[Array, "pair coordinate"]

    def give(self, frequency: Scalar, speed: Scalar) -> Complex[Array, "coordinate coordinate"]:
        """What the mesh coordinates give by these modes beyond their static give.

        **Arguments:**

        - `frequency`: of the load [rad/s].
        - `speed`: of the pinion [rad/s].

        **Returns:**

        Motion per load [m/N, 1/N, 1/(N m)].
        """
        forwards, backwards = (
            1.0 / jax.lax.complex(self.square - met**2, self.rate * met)
            for met in (frequency + speed * self.turning, frequency - speed * self.turning)
        )
        along = 0.5 * (forwards + backwards) - 1.0 / self.square
        across = 0.5j * (forwards - backwards)
        first, second = self.first.astype(complex), self.second.astype(complex)
        crossed = (first.T * across[None, :]) @ second
        weighted = (first.T * along[None, :]) @ first + (second.T * along[None, :]) @ second
        return weighted + crossed - crossed.T


def modes_beyond(
    pair: GearPair,
    bodies: list[VibratingBody],
    lines: ContactLines,
    arms: CellArmGrid,
    in_mesh: CellGrid,
    damping: AbstractDamping,
) -> ModesBeyondMesh | None:
    """Modes of bodies that are no coordinates, by the mesh coordinates that there are.

    Of their motion at the cells the mesh coordinates have what they can tell apart: the closest, in
    the mean square over all cells of the cycle.

    **Arguments:**

    - `pair`: the gears.
    - `bodies`: condensed.
    - `lines`: where the cells are.
    - `arms`: of the mesh coordinates.
    - `in_mesh`: which cells count [-].
    - `damping`: of the bodies.

    **Returns:**

    The modes, or `None` if the bodies have none.
    """
    every = []
    for each in bodies:
        beyond = each.body.beyond
        if beyond is None:
            continue
        own = mode_arms(pair, each.index, each.body, beyond, lines)
        felt = _felt(arms, own, in_mesh).T
        waves, diameters = np.asarray(beyond.waves), np.asarray(beyond.diameters)
        second = np.flatnonzero(waves < 0)
        first = np.setdiff1d(np.arange(waves.size), second)
        paired = np.isin(first + 1, second)
        turns = paired & (diameters[first] >= TURNING)
        # J of a pair: the second follows the first by a quarter of a wave.
        partner = jnp.where(paired[:, None], felt[np.minimum(first + 1, waves.size - 1)], 0.0)
        square = beyond.square[first]
        every.append(
            ModesBeyondMesh(
                square=square,
                rate=damping.rates(square),
                turning=jnp.asarray(np.where(turns, -each.speed * waves[first], 0.0)),
                first=felt[first],
                second=partner,
            )
        )
    if not every:
        return None
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), *every)


# So little of the largest is no motion of its own: combinations of the others come close to it.
_APART = 1e-10


def _felt(arms: CellArmGrid, modes: CellArmGrid, in_mesh: CellGrid) -> Array:
    """Mesh coordinates per motion of modes, `[coordinate, mode]`, by least squares."""
    weighted = jnp.where(in_mesh[:, :, None] > 0.0, arms, 0.0).reshape(-1, arms.shape[2])
    size = jnp.sqrt(jnp.sum(weighted**2, axis=0))
    size = jnp.where(size > 0.0, size, 1.0)
    scaled = weighted / size[None, :]
    matrix = scaled.T @ scaled + _APART * jnp.eye(size.size)
    right = scaled.T @ modes.reshape(weighted.shape[0], -1)
    return jnp.linalg.solve(matrix, right) / size[:, None]
