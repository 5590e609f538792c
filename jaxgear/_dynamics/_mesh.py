"""The cells of a mesh at one instant, and what tells their contact where all of them bear."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._contact._coupling import share_with_body
from jaxgear._types import Reals, Scalar


class WholeContact(eqx.Module):
    r"""The contact of coupled cells as long as all of them bear: linear in the mesh coordinates.

    With $K$ their stiffnesses, forces are $f = K\Delta$, $\Delta = Wm - \delta - Cf$, and so
    $f = (I + KC)^{-1}K(Wm - \delta)$.

    **Fields:**

    - `inverse`: $(I + KC)^{-1}$ [-].
    - `by_place`: overlap of each cell per mesh coordinate [-, m].
    - `at_zero`: overlap where the coordinates are zero [m].
    - `grown`: more of it by rotation, per square of the speed, or `None` [m s2].
    """

    inverse: Reals
    by_place: Reals
    at_zero: Reals
    grown: Reals | None = None

    def at(self, speed: Scalar) -> "WholeContact":
        """The same with what rotation does, at a speed of the pinion [rad/s]."""
        if self.grown is None:
            return self
        return dataclasses.replace(self, at_zero=self.at_zero + speed**2 * self.grown, grown=None)


class Mesh(eqx.Module):
    """The cells at one instant, or at each of many on a leading axis.

    **Fields:**

    - `stiffness`: of each cell [N/m].
    - `gap`: of each cell [m].
    - `arms`: $W$ [-, m].
    - `coupling`: between the lines of each slice, or all cells, or `None` [m/N].
    - `growth`: approach of each cell by rotation, per square of the speed, or `None` [m s2].
    - `bearing`: what tells all of their contact where all of them bear, or `None`.
    """

    stiffness: Reals
    gap: Reals
    arms: Reals
    coupling: Reals | None
    growth: Reals | None = None
    bearing: WholeContact | None = None

    def at(self, speed: Scalar) -> "Mesh":
        """The same cells as rotation brings them closer, at a speed of the pinion [rad/s]."""
        if self.growth is None:
            return self
        grown = speed**2 * self.growth
        bearing = None if self.bearing is None else self.bearing.at(speed)
        return dataclasses.replace(self, gap=self.gap - grown, growth=None, bearing=bearing)

    def among(self, kept: Array) -> "Mesh":
        """Some of the cells at one instant, which are all coupled, by their numbers."""
        assert self.coupling is not None
        return Mesh(
            stiffness=self.stiffness[kept],
            gap=self.gap[kept],
            arms=self.arms[kept],
            coupling=self.coupling[kept[:, None], kept[None, :]],
            growth=None if self.growth is None else self.growth[kept],
        )

    def ready(self) -> "Mesh":
        """The same cells at one instant, which are all coupled, with their `bearing`."""
        assert self.coupling is not None
        inverse = share_with_body(self.coupling, self.stiffness, jnp.eye(self.stiffness.size))
        under = inverse * self.stiffness[None, :]
        overlap = lambda moved: moved - self.coupling @ (under @ moved)
        growth = None if self.growth is None else overlap(self.growth)
        found = WholeContact(inverse, overlap(self.arms), -overlap(self.gap), growth)
        return dataclasses.replace(self, bearing=found)
