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
from jaxgear._contact._shared_body import SharedBody
from jaxgear._contact._tooth import contact_modulus
from jaxgear._contact._tooth_parts import (
    ToothParts,
    finite_widths,
    teeth_in_contact,
    tooth_parts,
)
from jaxgear._geometry._gear import Gear
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._profile import tooth_section
from jaxgear._types import Bodies, Reals, Scalar, as_scalar


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

    def __call__(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate the secant compliance of one tooth pair, loaded alone.

        **Arguments:**

        - `pair`: the gears.
        - `roll`: positions on the path of contact, from the pinion's base tangent point [m].
        - `line_load`: load per length of contact line at which the secant is taken [N/m].

        **Returns:**

        Deflection along the normal over line load, at each position [m2/N].
        """
        shared = [body.compliance(roll) for body in self.bodies(pair, 0)]
        return sum(shared, self.local(pair, roll, line_load))


class WeberBanaschek(AbstractCompliance):
    """Teeth as cantilevers on their foundations, with Weber's logarithmic contact term.

    A helical pair is evaluated with its virtual spur gears (ISO 6336-1).

    **Fields:**

    - `pinion_foundation`: of the pinion's body; by default `RingFoundation` where the gear has a
        bore, else `WeberFoundation`.
    - `wheel_foundation`: of the wheel's body, likewise.
    - `load_updates`: how often the contact term is taken anew at the line loads found, instead
        of at the nominal one [-].
    - `face_coupling`: how far teeth feel a load along their face; by default slices are on their
        own, and in plane strain.
    """

    pinion_foundation: AbstractFoundation | None = None
    wheel_foundation: AbstractFoundation | None = None
    load_updates: int = eqx.field(static=True, default=0)
    face_coupling: FaceCoupling | None = None

    def local(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate what one tooth pair gives by itself; see the base class."""
        teeth, wider = teeth_in_contact(pair, roll, line_load), self._wider(pair)
        beam = wider.reshape(2, *[1] * roll.ndim) * teeth.beam
        total = jnp.sum(beam + teeth.penetration, axis=0)
        for index, foundation in enumerate(self._foundations(pair)):
            if not foundation.couples:
                material = (pair.pinion, pair.wheel)[index].material
                given = foundation(teeth.sections[index], material, teeth.angle[index])
                total += wider[index] * given
        return total

    def along_face(
        self, pair: GearPair, roll: Reals, line_load: Scalar, bodies: tuple[SharedBody, ...]
    ) -> ToothParts | None:
        """Divide the compliance if slices are coupled; see the base class."""
        if self.face_coupling is None:
            return None
        foundations = self._foundations(pair)
        return tooth_parts(pair, foundations, bodies, self.face_coupling, roll, line_load)

    def bodies(self, pair: GearPair, neighbours: int) -> tuple[SharedBody, ...]:
        """List the gear bodies that couple the pairs in mesh; see the base class."""
        found = []
        for gear, foundation, start, sign, wider in zip(
            (pair.pinion, pair.wheel),
            self._foundations(pair),
            (jnp.zeros(()), pair.tangent_length),
            (1, -1),
            self._wider(pair),
            strict=True,
        ):
            section = tooth_section(pair, gear)
            influence = foundation.influence(section, gear.material, neighbours)
            if influence is not None:
                influence = wider * influence
                to_normal = 1.0 / jnp.cos(pair.base_helix_angle)
                found.append(SharedBody(section, influence, start, sign, to_normal))
        return tuple(found)

    def log_slope(self, pair: GearPair) -> Scalar:
        r"""Return $1/(\pi E^*)$, for $a_H$ grows with the root of the load; see the base class."""
        return 1.0 / (jnp.pi * contact_modulus(pair.pinion.material, pair.wheel.material))

    def without(self, gears: tuple[int, ...]) -> "WeberBanaschek":
        """Leave out the foundations of some gears; see the base class."""
        names = [("pinion_foundation", "wheel_foundation")[gear] for gear in gears]
        return dataclasses.replace(self, **dict.fromkeys(names, NoFoundation()))

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

    load_updates: ClassVar[int] = 0
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

    load_updates: ClassVar[int] = 0

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


class IsoStiffness(eqx.Module):
    r"""Stiffnesses of ISO 6336-1 method B, per face width in the transverse plane.

    **Fields:**

    - `theoretical`: $c'_{th}$ [N/m2].
    - `single`: $c'$ [N/m2].
    - `mesh`: $c_{\gamma\alpha}$, the mean mesh stiffness for the dynamic factor [N/m2].
    - `face`: $c_{\gamma\beta}$, the mean mesh stiffness for the face load factor [N/m2].
    """

    theoretical: Scalar
    single: Scalar
    mesh: Scalar
    face: Scalar


# ISO 6336-1 table 9: C1..C9 [mm um/N], with x2 squared in the last.
_ISO = (0.04723, 0.15551, 0.25791, -0.00635, -0.11654, -0.00193, -0.24188, 0.00529, 0.00182)
_ISO_MEASURED = 0.8  # C_M, ratio of measured to theoretical stiffness
_ISO_YOUNG = 206e9  # steel, for which the series was fitted [Pa]
_ISO_LOAD = 100e3  # below this line load the stiffness falls off [N/m]


@compiled
def iso_stiffness(pair: GearPair, line_load: Scalar) -> IsoStiffness:
    r"""ISO 6336-1 method B for solid discs, with the basic rack's factor $C_B$.

    The standard fits it for $x_1 \ge x_2$, $-0.5 \le x_1 + x_2 \le 2$, helix angles up to 30
    degrees and $\varepsilon_\alpha \ge 1.2$; outside it is extrapolated.

    **Arguments:**

    - `pair`: the gears.
    - `line_load`: $F_t K_A / b$ [N/m]; below 100 N/mm the single stiffness falls as its
        fourth root.

    **Returns:**

    The standard's four stiffnesses.
    """
    spread = jnp.cos(pair.base_helix_angle) ** 2 * jnp.cos(pair.helix_angle)
    first, second = 1.0 / (pair.teeth / spread)
    x1, x2 = pair.of_bodies("profile_shift")
    terms = (1.0, first, second, x1, x1 * first, x2, x2 * second, x1**2, x2**2)
    flexibility = sum(c * term for c, term in zip(_ISO, terms, strict=True))
    young = jnp.stack([pair.pinion.material.young, pair.wheel.material.young])
    steel = 2.0 * young[0] * young[1] / (young[0] + young[1]) / _ISO_YOUNG
    theoretical = 1e9 * steel / flexibility
    dedendum = jnp.mean(pair.of_bodies("dedendum"))
    rack = 1.0 + 0.5 * (1.2 - dedendum)
    rack *= 1.0 - 0.02 * (20.0 - jnp.rad2deg(pair.pressure_angle))
    low = jnp.minimum(line_load / _ISO_LOAD, 1.0) ** 0.25
    single = theoretical * _ISO_MEASURED * rack * jnp.cos(pair.helix_angle) * low
    ratio = pair.path_of_contact / pair.transverse_base_pitch
    mesh = single * (0.75 * ratio + 0.25)
    return IsoStiffness(theoretical=theoretical, single=single, mesh=mesh, face=0.85 * mesh)


@compiled
def single_pair_stiffness(
    pair: GearPair, compliance: AbstractCompliance, line_load: Scalar
) -> Scalar:
    """Largest stiffness of one tooth pair along the path of contact.

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
