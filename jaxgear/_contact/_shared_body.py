"""A gear body between the teeth in mesh, as their contact lines see it."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from jaxgear._compiled import compiled
from jaxgear._contact._foundation import AbstractFoundation
from jaxgear._contact._ring import give_alone, root_resultants
from jaxgear._geometry._gear import Material
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._profile import ToothSection, transverse_section
from jaxgear._types import Bodies, Influence, Reals, Scalar, as_scalar


class SharedBody(eqx.Module):
    r"""A gear body that couples the teeth in mesh (theory 3.6, theory 3.15).

    **Fields:**

    - `section`: of its teeth.
    - `influence`: of one root on itself and on the next ones, see `AbstractFoundation` [m2/N].
    - `roll_start`: roll length of the gear at $T_1$ [m].
    - `roll_sign`: whether the gear's roll length grows along the path: 1 pinion, -1 wheel [-].
    - `share`: of the load along the normal that acts in the body's directions [-].
    - `axial`: whether these are the axis, in place of the section's plane [-].
    """

    section: ToothSection
    influence: Influence
    roll_start: Scalar
    roll_sign: int = eqx.field(static=True)
    share: Scalar = eqx.field(converter=as_scalar, default=1.0)
    axial: bool = eqx.field(static=True, default=False)

    @property
    def bends(self) -> bool:
        """Whether it is a plate, all of whose face moves alike whatever part of it is loaded."""
        return self.axial and self.influence.shape[-1] == 3

    def within(self, neighbours: int) -> "SharedBody":
        """The same of the next teeth alone, so many of them."""
        return dataclasses.replace(self, influence=self.influence[: neighbours + 1])

    @property
    def gear(self) -> int:
        """0 for the pinion, 1 for the wheel."""
        return 0 if self.roll_sign > 0 else 1

    def resultants(self, roll: Reals) -> Array:
        """Resultants at the root per normal line load, at places on the path [-].

        N, Q, M/r_f in the section's plane; along the axis the force and, in a plate, its couples
        over r_f outwards and round.
        """
        angle = self._angle(roll)
        if not self.axial:
            return self.share * root_resultants(self.section, angle)
        radius = self.section.base_radius * jnp.sqrt(1.0 + angle**2)
        one = jnp.ones_like(radius)
        each = [one, radius / self.section.root_radius - 1.0, jnp.zeros_like(radius)]
        return self.share * jnp.stack(each[: self.influence.shape[-1]], axis=-1)

    def tilting(self, roll: Reals) -> Array:
        """Couples over r_f on a plate by the rest of a unit normal load, per place along z [1/m].

        What a plate moves in its plane falls as $-z$ times its slope.
        """
        radial, round_, _ = jnp.moveaxis(root_resultants(self.section, self._angle(roll)), -1, 0)
        across = jnp.sqrt(1.0 - self.share**2) / self.section.root_radius
        return -across * jnp.stack([jnp.zeros_like(radial), radial, round_], axis=-1)

    def _angle(self, roll: Reals) -> Reals:
        return (self.roll_start + self.roll_sign * roll) / self.section.base_radius

    def at_roots(self, ahead: int) -> Array:
        """Motion of a root by loads at another, `ahead` lines further along the path [m2/N]."""
        # Angles count in the sense in which the mesh pushes the tooth: a tooth further along the
        # path lies ahead on the wheel, behind on the pinion. What turning round the ring does
        # to a load, it does to the motion: B(-a) = B(a)^T.
        towards = self.roll_sign * ahead
        influence = self.influence[abs(ahead)]
        return influence if towards >= 0 else influence.T

    def compliance(self, roll: Reals) -> Reals:
        """Give of a tooth loaded alone [m2/N]."""
        return give_alone(self.influence[0], self.resultants(roll))


def shared_bodies(
    pair: GearPair,
    foundations: tuple[AbstractFoundation, AbstractFoundation],
    wider: Bodies,
    neighbours: int,
) -> tuple[SharedBody, ...]:
    """List the gear bodies that couple the pairs in mesh.

    **Arguments:**

    - `pair`: the gears.
    - `foundations`: of both.
    - `wider`: factors on what they give in their plane [-].
    - `neighbours`: how many teeth from a loaded one can be in mesh as well.

    **Returns:**

    Those of the two whose foundation couples teeth.
    """
    near = _near_bodies(pair, foundations, wider, max(neighbours, _NEAR))
    return tuple(body.within(neighbours) for body in near)


# Whoever asks for the next teeth of a body asks for as many, and a program works them out once.
_NEAR = 2


@compiled
def _near_bodies(
    pair: GearPair,
    foundations: tuple[AbstractFoundation, AbstractFoundation],
    wider: Bodies,
    neighbours: int,
) -> tuple[SharedBody, ...]:
    gears = pair.pinion, pair.wheel
    sections = [transverse_section(pair, gear) for gear in gears]
    given = zip(
        foundations,
        sections,
        [gear.material for gear in gears],
        [gear.face_width for gear in gears],
        strict=True,
    )
    influences = _of_either(lambda each: _influences(*each, neighbours=neighbours), *given)
    starts = jnp.zeros(()), pair.tangent_length
    slant = jnp.cos(pair.base_helix_angle)
    # Per length of contact line in place of face width.
    per_line, found = 1.0 / slant, []
    for section, influence, start, sign, wide in zip(
        sections, influences, starts, (1, -1), wider, strict=True
    ):
        own, *along = influence
        if own is not None:
            found.append(SharedBody(section, per_line * wide * own, start, sign, slant))
        # The mesh pushes the two gears apart along their axes.
        share = sign * jnp.sin(pair.base_helix_angle)
        found += [SharedBody(section, per_line * x, start, sign, share, True) for x in along]
    return tuple(found)


def _influences(
    foundation: AbstractFoundation,
    section: ToothSection,
    material: Material,
    face_width: Scalar,
    *,
    neighbours: int,
) -> tuple[Array | None, ...]:
    """Motions of the roots of a body: in the section's plane, and along the axis if there are."""
    own = foundation.influence(section, material, neighbours)
    if own is None:
        return (None,)
    axial = foundation.axial_influences(section, material, neighbours, face_width)
    return own, *(axial or ())


def of_gears(pinion: Any, wheel: Any) -> Any:
    """Arrays of both gears, on a leading axis: at once they are half the program to compile."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), pinion, wheel)


def _of_either(function: Callable[[Any], Any], first: Any, second: Any) -> tuple[Any, Any]:
    """A function of either gear; of gears of one kind, of both at once."""
    if jax.tree.map(jnp.shape, first) != jax.tree.map(jnp.shape, second):
        return function(first), function(second)
    both = jax.vmap(function)(of_gears(first, second))
    return jax.tree.map(lambda x: x[0], both), jax.tree.map(lambda x: x[1], both)


def where_helical(
    pair: GearPair, function: Callable[..., Array], without: Callable[..., Array], *operands: Any
) -> Array:
    """What there is with loads along the axis, of which spur gears have none.

    They do not pay for what stands inside, such as sums over all pairs of cells.

    At a helix of zero they add nothing, but their slope by the helix is not zero: derivatives by
    the helix are those of the function everywhere.

    **Arguments:**

    - `pair`: the gears.
    - `function`: of arrays and modules alone.
    - `without`: the same where the helix is zero, for less.
    - `operands`: what both are of.

    **Returns:**

    Its value.
    """

    @jax.custom_jvp
    def found(helix: Scalar, *operands: Any) -> Array:
        return jax.lax.cond(helix != 0.0, function, without, *operands)

    def slopes(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
        moves = jax.tree.map(lambda each: not isinstance(each, SymbolicZero), tangents)
        moved, still = eqx.partition(primals, moves)
        # Where the helix stays, at zero neither side depends on what moves along the axis.
        either = (lambda _, *operands: function(*operands)) if moves[0] else found.fun
        of = lambda moved: either(*eqx.combine(moved, still))
        return jax.jvp(of, (moved,), (eqx.filter(tangents, moves),))

    found.defjvp(slopes, symbolic_zeros=True)
    return found(pair.helix_angle, *operands)
