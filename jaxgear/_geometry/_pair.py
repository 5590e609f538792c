"""A gear pair: two gears at a working centre distance, and what of it cannot be."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._checks import require
from jaxgear._compiled import any_traced, compiled, lasting_rare
from jaxgear._geometry._gear import Gear
from jaxgear._geometry._pair_facts import PairFacts
from jaxgear._geometry._pair_formulas import AbstractGearPair
from jaxgear._geometry._tooth_checks import check_tooth
from jaxgear._types import Bodies, Scalar, as_optional_scalar, as_reals, as_scalar
from jaxgear._units import deg, mm


class GearPair(AbstractGearPair):
    r"""Two external involute gears, spur or helical, in mesh (theory 1.1 to theory 1.6).

    **Fields:**

    - `pinion`: the driving gear.
    - `wheel`: the driven gear.
    - `normal_module`: $m_n$ [m].
    - `pressure_angle`: normal pressure angle $\alpha_n$ [rad].
    - `helix_angle`: $\beta$ at the reference cylinder [rad]; positive is a right-hand pinion.
    - `centre_distance`: working centre distance [m], or `None` for the zero-backlash one that
        follows from the profile shifts.

    **Raises:**

    - `ValueError` if the pair is impossible: no working pressure angle, teeth that jam, are
        pointed, undercut, interfere or bottom, or a total contact ratio below 1.
    """

    pinion: Gear
    wheel: Gear
    normal_module: Scalar = eqx.field(converter=as_scalar)
    pressure_angle: Scalar = eqx.field(converter=as_scalar, default=20.0 * deg)
    helix_angle: Scalar = eqx.field(converter=as_scalar, default=0.0)
    centre_distance: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)

    def __check_init__(self):
        _check_pair(self)

    @property
    def teeth(self) -> Bodies:
        """Numbers of teeth, as reals [-]."""
        # A list would cost a program.
        return as_reals(np.asarray([self.pinion.teeth, self.wheel.teeth], dtype=float))


@compiled
def profile_contact_ratio(pair: AbstractGearPair) -> Scalar:
    r"""$\varepsilon_\alpha$ [-]: the path of contact over the transverse base pitch."""
    return pair.path_of_contact / pair.transverse_base_pitch


@compiled
def overlap_ratio(pair: AbstractGearPair) -> Scalar:
    r"""$\varepsilon_\beta$ [-]: $b \tan|\beta_b| / p_{bt}$ (theory 1.7)."""
    tangent = jnp.tan(jnp.abs(pair.base_helix_angle))
    return pair.face_width * tangent / pair.transverse_base_pitch


@compiled
def total_contact_ratio(pair: AbstractGearPair) -> Scalar:
    r"""$\varepsilon_\gamma = \varepsilon_\alpha + \varepsilon_\beta$ [-] (theory 1.7)."""
    return profile_contact_ratio(pair) + overlap_ratio(pair)


@compiled
def full_tip_shortening(pair: AbstractGearPair) -> Scalar:
    r"""$k = x_1 + x_2 - y$ [-], the shortening that restores the rack's root clearance."""
    centre = pair.working_centre_distance - jnp.sum(pair.reference_radius)
    return jnp.sum(pair.of_bodies("profile_shift")) - centre / pair.normal_module


def pair_facts(pair: GearPair) -> PairFacts:
    """Everything closed-form about a pair at once, compiled: for reports and checks.

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    Its facts.
    """
    return _facts(_of_numbers(pair))


def root_radii(pair: GearPair) -> Bodies:
    """The root radii of a pair by themselves, compiled: what a body needs to be built [m]."""
    return _root_radii(_of_numbers(pair))


class _PairOfNumbers(AbstractGearPair):
    """A pair whose numbers of teeth a program is given, which then serves all of them.

    **Fields:**

    - `pinion`, `wheel`: with any numbers of teeth.
    - `normal_module`, `pressure_angle`, `helix_angle`, `centre_distance`: as of `GearPair`
        [m, rad].
    - `numbers`: of teeth [-].
    """

    pinion: Gear
    wheel: Gear
    normal_module: Scalar
    pressure_angle: Scalar
    helix_angle: Scalar
    centre_distance: Scalar | None
    numbers: Bodies

    @property
    def teeth(self) -> Bodies:
        return self.numbers


# In place of numbers of teeth, which a program would be made for.
_ANY = 20


def _of_numbers(pair: GearPair) -> _PairOfNumbers:
    return _PairOfNumbers(
        pinion=dataclasses.replace(pair.pinion, teeth=_ANY),
        wheel=dataclasses.replace(pair.wheel, teeth=_ANY),
        normal_module=pair.normal_module,
        pressure_angle=pair.pressure_angle,
        helix_angle=pair.helix_angle,
        centre_distance=pair.centre_distance,
        numbers=pair.teeth,
    )


@lasting_rare
def _facts(pair: _PairOfNumbers) -> PairFacts:
    ratios = (profile_contact_ratio, overlap_ratio, total_contact_ratio, full_tip_shortening)
    found = {ratio.__name__: ratio(pair) for ratio in ratios}
    own = {name: getattr(pair, name) for name in PairFacts._fields if name not in found}
    return PairFacts(**own, **found)


@lasting_rare
def _root_radii(pair: _PairOfNumbers) -> Bodies:
    return pair.root_radius


# How far inside the zero-backlash centre distance a pair may sit, as backlash over module:
# profile shifts on drawings are rounded to 1e-3 of the module.
_ROUNDED_SHIFT = 5e-3


def _check_pair(pair: GearPair) -> None:
    """Refuse what cannot run, in the order in which a designer would find out.

    Traced numbers are let through.
    """
    if any_traced(pair):
        return
    module, pressure = float(pair.normal_module), float(pair.pressure_angle)
    require(module > 0.0, "The normal module must be positive, got {got:.6g} mm.", got=module / mm)
    require(
        0.0 < pressure < 45.0 * deg,
        "`GearPair.pressure_angle` must lie between 0 and 45 degrees, got {got:.4g} degrees. "
        "Angles are in radians: write `20.0 * jaxgear.deg`.",
        got=pressure / deg,
    )
    helix = float(pair.helix_angle)
    require(
        abs(helix) < 60.0 * deg,
        "`GearPair.helix_angle` must lie within 60 degrees, got {got:.4g} degrees. Angles are in "
        "radians: write `15.0 * jaxgear.deg`.",
        got=helix / deg,
    )
    facts = pair_facts(pair)
    # Plain numbers within somebody else's program.
    if any_traced(facts):
        return
    facts = jax.tree.map(np.asarray, facts)
    base_sum = facts.base_radius.sum()
    # The inverse involute has no answer below zero.
    angle = facts.zero_backlash_pressure_angle
    require(
        bool(np.isfinite(angle) and angle > 0.0),
        "The profile shifts sum to {got:.4g}, too negative for {teeth} teeth to have a working "
        "pressure angle without backlash. Raise them.",
        got=float(pair.pinion.profile_shift) + float(pair.wheel.profile_shift),
        teeth=pair.pinion.teeth + pair.wheel.teeth,
    )
    require(
        bool(facts.working_centre_distance > base_sum),
        "The centre distance must exceed the sum of the base radii, {limit:.6g} mm, or the gears "
        "have no line of action; got {got:.6g} mm. These profile shifts ask for {asked:.6g} mm.",
        got=facts.working_centre_distance / mm,
        limit=base_sum / mm,
        asked=facts.zero_backlash_centre_distance / mm,
    )
    require(
        bool(facts.backlash > -_ROUNDED_SHIFT * module),
        "The teeth jam: at the centre distance of {got:.6g} mm the backlash is {backlash:.4g} mm. "
        "Use {asked:.6g} mm or more, or lower the profile shifts.",
        got=facts.working_centre_distance / mm,
        backlash=facts.backlash / mm,
        asked=facts.zero_backlash_centre_distance / mm,
    )
    require(
        bool(facts.path_of_contact > 0.0 and facts.total_contact_ratio >= 1.0),
        "The total contact ratio must be at least 1, got {got:.4g} (profile {profile:.4g} + "
        "overlap {overlap:.4g}): the mesh would lose contact between teeth. Raise the addendum, "
        "reduce the centre distance or tip shortening, or widen a helical face.",
        got=facts.total_contact_ratio,
        profile=facts.profile_contact_ratio,
        overlap=facts.overlap_ratio,
    )
    for body in (0, 1):
        check_tooth((pair.pinion, pair.wheel), facts, body, module=module, pressure_angle=pressure)
