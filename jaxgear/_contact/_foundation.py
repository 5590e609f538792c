r"""What a gear body lets the roots of its teeth move, per length of contact line.

Where a body couples its teeth, a load on one moves the others too: a ring that is held at its bore
winds up under all teeth in mesh at once. Counted once per pair, as if each tooth had a body of
its own, that wind-up would double the fluctuation of the transmission error.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._contact._ring import give_alone, ring_influence, root_resultants
from jaxgear._contact._ring_axial import plate_influence, shear_influence
from jaxgear._contact._sainsot import sainsot_compliance
from jaxgear._contact._tooth import tooth_load
from jaxgear._geometry._gear import Material
from jaxgear._geometry._profile import ToothSection
from jaxgear._types import Influence, PlateInfluence, Reals, Scalar, ShearInfluence


class AbstractFoundation(eqx.Module):
    """What the gear body lets a tooth's root move.

    **Fields:**

    - `couples`: whether teeth feel each other [-].
    """

    couples: eqx.AbstractClassVar[bool]

    @abc.abstractmethod
    def __call__(self, section: ToothSection, material: Material, roll_angle: Reals) -> Reals:
        """Evaluate the compliance that the body adds to a tooth loaded alone.

        **Arguments:**

        - `section`: the tooth.
        - `material`: of the body.
        - `roll_angle`: of the loaded points [rad].

        **Returns:**

        Compliance at each point [m2/N].
        """

    @abc.abstractmethod
    def influence(
        self, section: ToothSection, material: Material, neighbours: int
    ) -> Influence | None:
        r"""Motion of the roots of a tooth and of its neighbours under loads at one root.

        **Arguments:**

        - `section`: the tooth.
        - `material`: of the body.
        - `neighbours`: how many teeth further.

        **Returns:**

        For each tooth from the loaded one on, motions $u_r$, $u_\theta$, $r_f\psi$ by resultants
        $N$, $Q$, $M/r_f$ per face width [m2/N], or `None` where teeth do not feel each other.
        """

    def axial_influences(
        self, section: ToothSection, material: Material, neighbours: int, face_width: Scalar
    ) -> tuple[ShearInfluence, PlateInfluence] | None:
        r"""Motion along the axis of the roots under axial loads at one root.

        **Arguments:**

        - `section`, `material`, `neighbours`: as of `influence`.
        - `face_width`: of the body [m].

        **Returns:**

        What the body is sheared by, and what it bends as a plate, by a force and its couples, per
        face width [m2/N]; `None` where it is not known.
        """
        del section, material, neighbours, face_width

    def near_root(self, plane: Reals, given: Reals) -> Reals:
        r"""Evaluate which share of the compliance of a tooth loaded alone is near its root.

        That of the elastic half-plane, and not more than all: $(c^{-8} + w^{-8})^{-1/8}$ where the
        body gives $c$ and the half-plane $w$.

        **Arguments:**

        - `plane`: $w$ at each loaded point [m2/N].
        - `given`: $c$ at each [m2/N].

        **Returns:**

        The share at each point [m2/N].
        """
        return plane * (1.0 + (plane / given) ** 8) ** -0.125


class WeberFoundation(AbstractFoundation):
    r"""Weber's elastic half-plane under the tooth, plane strain (theory 3.3, theory 3.4).

    $\frac{\cos^2\alpha_p}{E}[L(u/S_f)^2 + M\,u/S_f + P(1 + Q\tan^2\alpha_p)]$ with
    $u = Y_c - r_f$, $S_f = 2 r_f\theta_f$ and, for any Poisson's ratio, $L = 18(1-\nu^2)/\pi$,
    $M = 2(1+\nu)(1-2\nu)$, $P = 4.8(1-\nu^2)/\pi$, $Q = (1-\nu)/2.4$; at $\nu = 0.3$ they are
    5.214, 1.04, 1.390, 0.292, which Weber rounds to 5.2, 1, 1.4, 0.294. The wind-up of the body
    that neighbouring teeth share is not in it.
    """

    couples: ClassVar[bool] = False

    def __call__(self, section: ToothSection, material: Material, roll_angle: Reals) -> Reals:
        """Evaluate the compliance that the foundation adds; see the base class."""
        load = tooth_load(section, roll_angle)
        root_chord = 2.0 * section.root_radius * section.root_half_angle
        slender = (load.height - section.root_radius) / root_chord
        poisson = material.poisson
        stretch = (1.0 - poisson**2) / jnp.pi
        inner = 18.0 * stretch * slender**2
        inner += 2.0 * (1.0 + poisson) * (1.0 - 2.0 * poisson) * slender
        inner += 4.8 * stretch * (1.0 + (1.0 - poisson) / 2.4 * jnp.tan(load.angle) ** 2)
        return jnp.cos(load.angle) ** 2 / material.young * inner

    def near_root(self, plane: Reals, given: Reals) -> Reals:
        """Return all of it; see the base class."""
        del plane
        return given

    def influence(self, section: ToothSection, material: Material, neighbours: int) -> None:
        """Return `None`: a half-plane of its own under each tooth."""
        del section, material, neighbours


def axial_shear(material: Material) -> Scalar:
    r"""What a half-plane gives under a load along the axis, $4.8(1+\nu)/(\pi E)$ [m2/N].

    A line load moves a half-plane by $\frac{2(1-\nu^2)}{\pi E}\ln\frac1r$ in its plane and by
    $\frac{2(1+\nu)}{\pi E}\ln\frac1r$ square to it: $P$ of `WeberFoundation`, in that ratio.
    """
    return 4.8 * (1.0 + material.poisson) / (jnp.pi * material.young)


class NoFoundation(AbstractFoundation):
    """A root that does not move, or a body whose finite elements already let it."""

    couples: ClassVar[bool] = False

    def __call__(self, section: ToothSection, material: Material, roll_angle: Reals) -> Reals:
        """Return zero at each point [m2/N]."""
        del section, material
        return jnp.zeros_like(roll_angle)

    def near_root(self, plane: Reals, given: Reals) -> Reals:
        """Return nothing of nothing [m2/N]."""
        del plane
        return given

    def influence(self, section: ToothSection, material: Material, neighbours: int) -> None:
        """Return `None`: nothing moves."""
        del section, material, neighbours


class SainsotFoundation(AbstractFoundation):
    r"""Sainsot, Velex & Duverger 2004: a fit to elastic rings, for a tooth loaded alone.

    For single-pair stiffness only: teeth are not coupled, so that over a mesh cycle the shared
    wind-up is counted once per pair and the transmission error fluctuates too much. Fitted at
    $\nu = 0.3$. See `sainsot_compliance`.
    """

    couples: ClassVar[bool] = False

    def __call__(self, section: ToothSection, material: Material, roll_angle: Reals) -> Reals:
        """Evaluate the compliance that the foundation adds; see the base class."""
        ratio = _radius_ratio(section, "SainsotFoundation")
        return sainsot_compliance(section, material, ratio, roll_angle)

    def influence(self, section: ToothSection, material: Material, neighbours: int) -> None:
        """Return `None`: a ring of its own under each tooth."""
        del section, material, neighbours


class RingFoundation(AbstractFoundation):
    """An elastic ring, clamped at the gear's bore, under all teeth together (theory 3.6).

    Exact in plane strain for tractions spread over each root; see `ring_influence`. Axial loads of
    helical teeth shear it, and bend it as a plate (theory 3.15).

    **Fields:**

    - `harmonics`: of the series around the ring; 320 are enough for 80 teeth on a rim one module
        thick, and for any gear on a thicker one [-].
    """

    couples: ClassVar[bool] = True
    harmonics: int = eqx.field(static=True, default=320)

    def __call__(self, section: ToothSection, material: Material, roll_angle: Reals) -> Reals:
        """Evaluate the compliance that the foundation adds; see the base class."""
        own = self.influence(section, material, 0)[0]
        return give_alone(own, root_resultants(section, roll_angle))

    def influence(self, section: ToothSection, material: Material, neighbours: int) -> Influence:
        """Motion of the roots; see the base class."""
        dimensionless = ring_influence(
            radius_ratio=_radius_ratio(section, "RingFoundation"),
            root_half_angle=section.root_half_angle,
            poisson=material.poisson,
            pitch_angle=2.0 * jnp.pi / section.teeth,
            neighbours=neighbours,
            harmonics=self.harmonics,
        )
        return dimensionless / material.young

    def axial_influences(
        self, section: ToothSection, material: Material, neighbours: int, face_width: Scalar
    ) -> tuple[ShearInfluence, PlateInfluence]:
        """Motion of the roots along the axis; see the base class."""
        shapes = {
            "radius_ratio": _radius_ratio(section, "RingFoundation"),
            "root_half_angle": section.root_half_angle,
            "poisson": material.poisson,
            "pitch_angle": 2.0 * jnp.pi / section.teeth,
            "neighbours": neighbours,
        }
        sheared = shear_influence(**shapes, harmonics=self.harmonics)
        bent = plate_influence(**shapes, thickness=face_width / section.root_radius)
        return sheared / material.young, bent / material.young


def _radius_ratio(section: ToothSection, owner: str) -> Scalar:
    ratio = section.radius_ratio
    require(
        ratio is not None,
        "`" + owner + "` is a ring held at the gear's bore, and the gear has none. Give `Gear.bore`"
        ", the diameter at which the body is held, or use `WeberFoundation`.",
    )
    assert ratio is not None
    return ratio
