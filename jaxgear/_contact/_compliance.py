r"""Stiffness of one tooth pair along the path of contact, per length of contact line.

Directions are normal to the flank. All three models are secant, and depend on the position
along the path only: teeth are alike, and so are their slices. A body that couples the pairs in mesh
is kept apart from what each pair gives by itself.
"""

import abc
import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._contact._face_coupling import FaceCoupling
from jaxgear._contact._foundation import (
    AbstractFoundation,
    NoFoundation,
    RingFoundation,
    WeberFoundation,
)
from jaxgear._contact._iso import iso_stiffness
from jaxgear._contact._shared_body import SharedBody, shared_bodies
from jaxgear._contact._tooth import contact_modulus
from jaxgear._contact._tooth_parts import (
    TeethOnBodies,
    ToothParts,
    finite_widths,
    teeth_on_bodies,
    tooth_parts,
)
from jaxgear._geometry._gear import Gear
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Bodies, DenseCouplingGrid, Reals, Scalar, as_scalar


class AbstractCompliance(eqx.Module):
    """How far a tooth pair gives under a line load.

    **Fields:**

    - `load_updates`: how often the contact term is taken anew at the line loads found [-].
    """

    load_updates: eqx.AbstractVar[int]

    @abc.abstractmethod
    def local(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate what a tooth pair gives that no other pair in mesh feels.

        **Arguments:**

        - `pair`: the gears.
        - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
        - `line_load`: load per length of contact line at which the secant is taken [N/m].

        **Returns:**

        Deflection along the normal over line load, at each position [m2/N].
        """

    @abc.abstractmethod
    def bodies(self, pair: GearPair, neighbours: int) -> tuple[SharedBody, ...]:
        """List the gear bodies that couple the pairs in mesh.

        **Arguments:**

        - `pair`: the gears.
        - `neighbours`: how many teeth from a loaded one can be in mesh as well.

        **Returns:**

        Those bodies of the two that do.
        """

    def along_face(
        self, pair: GearPair, roll: Reals, line_load: Scalar, bodies: tuple[SharedBody, ...]
    ) -> ToothParts | None:
        """Divide the compliance into parts that couple the slices of a tooth.

        **Arguments:**

        - `pair`: the gears.
        - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
        - `line_load`: load per length of contact line at which the secant is taken [N/m].
        - `bodies`: the same that `bodies` lists.

        **Returns:**

        The parts, or `None`: slices are on their own.
        """
        del pair, roll, line_load, bodies

    def without(self, gears: tuple[int, ...]) -> "AbstractCompliance":
        """Leave out what the bodies of some gears give: condensed ones bring their own.

        Only where the model has a foundation of its own can it be left out.

        **Arguments:**

        - `gears`: 0 for the pinion, 1 for the wheel.

        **Returns:**

        The compliance of the rest.
        """
        del gears
        return self

    @abc.abstractmethod
    def log_slope(self, pair: GearPair) -> Scalar:
        """Fall of the compliance per natural logarithm of the line load [m2/N].

        **Arguments:**

        - `pair`: the gears.
        """

    def between_cells(
        self, pair: GearPair, lines: ContactLines, line_load: Scalar
    ) -> DenseCouplingGrid | None:
        """Evaluate what all cells of a phase make each other give, where the model knows.

        **Arguments:**

        - `pair`: the gears.
        - `lines`: where the cells are.
        - `line_load`: at which the secant is taken [N/m].

        **Returns:**

        The compliance between them besides `local`, or `None`: then `bodies` say it [m/N].
        """
        del pair, lines, line_load
        return None

    def alone(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate what a pair that is loaded alone gives besides `local`.

        **Arguments:**

        - `pair`: the gears.
        - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
        - `line_load`: at which the secant is taken [N/m].

        **Returns:**

        Deflection along the normal over line load, at each position [m2/N].
        """
        del line_load
        shared = [body.compliance(roll) for body in self.bodies(pair, 0)]
        return sum(shared, jnp.zeros_like(roll))

    def felt(self, pair: GearPair, roll: Reals) -> Reals:
        """Evaluate what a line load on a pair lets the next one give through the bodies.

        **Arguments:**

        - `pair`: the gears.
        - `roll`: positions of the loaded pair; the other is a base pitch further [m].

        **Returns:**

        Motion along the normal over line load, at each position [m2/N].
        """
        total = jnp.zeros_like(roll)
        for body in self.bodies(pair, 1):
            felt = body.resultants(roll) @ body.at_roots(1)
            total += jnp.sum(felt * body.resultants(roll + pair.transverse_base_pitch), axis=-1)
        return total

    def __call__(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate the secant compliance of one tooth pair, loaded alone.

        **Arguments:**

        - `pair`: the gears.
        - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
        - `line_load`: load per length of contact line at which the secant is taken [N/m].

        **Returns:**

        Deflection along the normal over line load, at each position [m2/N].
        """
        return self.local(pair, roll, line_load) + self.alone(pair, roll, line_load)


class WeberBanaschek(AbstractCompliance):
    r"""Teeth as cantilevers on their foundations, with Weber's logarithmic contact term.

    A helical pair is evaluated with its virtual spur gears, of $z/(\cos^2\beta_b\cos\beta)$ teeth
    in the normal section: those of ISO 6336-3 for root stress. (For stiffness ISO 6336-1, whose
    text was not at hand, is cited with the approximation $z/\cos^3\beta$.)

    **Fields:**

    - `pinion_foundation`: of the pinion's body; by default `RingFoundation` where the gear has a
        bore, else `WeberFoundation`.
    - `wheel_foundation`: of the wheel's body, likewise.
    - `load_updates`: how often the contact term is taken anew at the line loads found, instead
        of at the nominal one [-].
    - `face_coupling`: how far teeth feel a load along their face; with `None` slices are on their
        own, and in plane strain.
    """

    pinion_foundation: AbstractFoundation | None = None
    wheel_foundation: AbstractFoundation | None = None
    load_updates: int = eqx.field(static=True, default=0)
    face_coupling: FaceCoupling | None = eqx.field(default_factory=FaceCoupling)

    def local(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate what one tooth pair gives by itself; see the base class."""
        return self._teeth(pair, roll, line_load, self.bodies(pair, 0)).own

    def along_face(
        self, pair: GearPair, roll: Reals, line_load: Scalar, bodies: tuple[SharedBody, ...]
    ) -> ToothParts | None:
        """Divide the compliance if slices are coupled; see the base class."""
        if self.face_coupling is None:
            return None
        teeth = self._teeth(pair, roll, line_load, bodies)
        return tooth_parts(pair, teeth, self.face_coupling)

    def bodies(self, pair: GearPair, neighbours: int) -> tuple[SharedBody, ...]:
        """List the gear bodies that couple the pairs in mesh; see the base class."""
        return shared_bodies(pair, self._foundations(pair), self._wider(pair), neighbours)

    def log_slope(self, pair: GearPair) -> Scalar:
        r"""Return $1/(\pi E^*)$, for $a_H$ grows with the root of the load; see the base class."""
        return 1.0 / (jnp.pi * contact_modulus(pair.pinion.material, pair.wheel.material))

    def without(self, gears: tuple[int, ...]) -> "WeberBanaschek":
        """Leave out the foundations of some gears; see the base class."""
        names = [("pinion_foundation", "wheel_foundation")[gear] for gear in gears]
        return dataclasses.replace(self, **dict.fromkeys(names, NoFoundation()))

    def _teeth(
        self, pair: GearPair, roll: Reals, line_load: Scalar, bodies: tuple[SharedBody, ...]
    ) -> TeethOnBodies:
        foundations, wider = self._foundations(pair), self._wider(pair)
        return teeth_on_bodies(pair, foundations, bodies, wider, roll, line_load)

    def _wider(self, pair: GearPair) -> Bodies:
        """Factors on all that the gears give beside their contact [-]."""
        return (
            jnp.ones(2) if self.face_coupling is None else finite_widths(pair, self.face_coupling)
        )

    def _foundations(self, pair: GearPair) -> tuple[AbstractFoundation, AbstractFoundation]:
        return (
            _foundation(self.pinion_foundation, pair.pinion),
            _foundation(self.wheel_foundation, pair.wheel),
        )


def _foundation(given: AbstractFoundation | None, gear: Gear) -> AbstractFoundation:
    """The foundation of a gear, where none is named: a ring if there is a bore to hold it."""
    if given is not None:
        return given
    return WeberFoundation() if gear.bore is None else RingFoundation()


class ConstantStiffness(AbstractCompliance):
    """The same stiffness everywhere, for closed forms and for comparison.

    **Fields:**

    - `stiffness`: of one tooth pair per length of contact line [N/m2].

    **Raises:**

    - `ValueError` unless it is positive.
    """

    load_updates: ClassVar[int] = 0  # ty: ignore[incompatible-attribute-override]
    stiffness: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        require(
            self.stiffness > 0.0,
            "`ConstantStiffness.stiffness` must be positive, got {got:.6g} N/m2.",
            got=self.stiffness,
        )

    def local(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Return the one compliance at each position [m2/N]."""
        del pair, line_load
        return jnp.ones_like(roll) / self.stiffness

    def bodies(self, pair: GearPair, neighbours: int) -> tuple[SharedBody, ...]:
        """Return none; see the base class."""
        del pair, neighbours
        return ()

    def log_slope(self, pair: GearPair) -> Scalar:
        """Return zero; see the base class."""
        return jnp.zeros_like(pair.normal_module)


class Iso6336(AbstractCompliance):
    r"""The single stiffness of ISO 6336-1 method B, the same along the whole path.

    ISO quotes $c'$ per face width in the transverse plane, with a factor $\cos\beta$; the stiffness
    normal to the flank is taken without it, $c'_{th} C_M C_B$. For solid discs ($C_R = 1$); see
    `iso_stiffness`.
    """

    load_updates: ClassVar[int] = 0  # ty: ignore[incompatible-attribute-override]

    def local(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate the secant compliance of one tooth pair; see the base class."""
        tangential = line_load * jnp.cos(pair.transverse_pressure_angle)
        per_line = iso_stiffness(pair, tangential).single / jnp.cos(pair.helix_angle)
        return jnp.ones_like(roll) / per_line

    def bodies(self, pair: GearPair, neighbours: int) -> tuple[SharedBody, ...]:
        """Return none; see the base class."""
        del pair, neighbours
        return ()

    def log_slope(self, pair: GearPair) -> Scalar:
        """Return zero; see the base class."""
        return jnp.zeros_like(pair.normal_module)


@compiled
def single_pair_stiffness(
    pair: GearPair, compliance: AbstractCompliance, line_load: Scalar
) -> Scalar:
    """Largest stiffness of one tooth pair along the path of contact.

    Of a law of the tooth on faces as wide as the contact: a wider gear's overhang, which stiffens
    cells that feel each other along the face, is not in it.

    **Arguments:**

    - `pair`: the gears.
    - `compliance`: of one tooth pair.
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    Stiffness per length of contact line [N/m2].
    """
    place = jnp.linspace(0.0, 1.0, 129)
    roll = pair.path_start + place * pair.path_of_contact
    return 1.0 / jnp.min(compliance(pair, roll, line_load))
