r"""What carries the teeth of a gear: a rigid body, a beam, or a condensed one.

A body knows its nodes on its mount, what it brings to the structure there, and how its sections
move with its nodes.
"""

import abc
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._compiled import in_numpy
from jaxgear._geometry._gear import Material
from jaxgear._geometry._pair import GearPair, root_radii
from jaxgear._system._beam import beam_shapes
from jaxgear._system._mount import AbstractMount, BodyPiece, MountedNodes, MountMatrices
from jaxgear._types import Scalar, as_scalar
from jaxgear._units import mm

if TYPE_CHECKING:
    SectionMotion = Array
else:
    SectionMotion = Float[Array, "6 node_dof"]

BODIES = ("pinion", "wheel")


class AbstractGearBody(eqx.Module):
    """The body of one gear."""

    @property
    @abc.abstractmethod
    def piece(self) -> BodyPiece | None:
        """The piece of shaft that the body is, if it is a beam: its sections then bend."""

    @property
    @abc.abstractmethod
    def seat_count(self) -> int:
        """Number of seats, whose motions are mesh coordinates of a condensed body."""

    @abc.abstractmethod
    def check(self, name: str, mount: AbstractMount, pair: GearPair, index: int) -> None:
        """Refuse a body that does not fit its gear and mount. Traced numbers are let through.

        **Arguments:**

        - `name`: whose it is, for the message.
        - `mount`: of the gear.
        - `pair`: the gears.
        - `index`: 0 for the pinion, 1 for the wheel.

        **Raises:**

        - `InputError` if it does not fit.
        """

    @abc.abstractmethod
    def nodes(self, mount: AbstractMount) -> MountedNodes:
        """Nodes of the body on its mount.

        **Arguments:**

        - `mount`: of the gear.
        """

    @abc.abstractmethod
    def matrices(self, name: str, mount: AbstractMount) -> MountMatrices:
        """Body and mount without bearings.

        **Arguments:**

        - `name`: whose it is, for the message.
        - `mount`: of the gear.

        **Returns:**

        The matrices; those of a condensed body without mass.

        **Raises:**

        - `InputError` if the body needs a shaft and has none.
        """

    @abc.abstractmethod
    def section_motion(self, mount: AbstractMount, z: Scalar) -> SectionMotion:
        """Motion of a section of a gear per motion of the nodes that its teeth load.

        What the teeth on a condensed body move with is no section: it does not count here.

        **Arguments:**

        - `mount`: of the gear.
        - `z`: height of the section from mid-face [m].

        **Returns:**

        Translations along S, T, Z and rotations about them [-, m, 1/m].
        """

    @abc.abstractmethod
    def middle_motion(self, mount: AbstractMount) -> SectionMotion:
        """Motion of the gear at mid-face per motion of its nodes; of a condensed one as its seat's.

        **Arguments:**

        - `mount`: of the gear.

        **Returns:**

        Translations along S, T, Z and rotations about them [-, m, 1/m].
        """


def carried(away: Scalar) -> Float[Array, "6 6"]:
    """Motion of a rigid body somewhere along the axis per its motion at a node.

    **Arguments:**

    - `away`: from the node along the axis [m].

    **Returns:**

    Translations along S, T, Z and rotations about them [-, m].
    """
    return jnp.eye(6).at[0, 4].set(away).at[1, 3].set(-away)


def check_shaft_within(name: str, mount: AbstractMount, pair: GearPair, index: int) -> None:
    """Refuse a shaft that is as thick as the gear on it; see `AbstractGearBody.check`."""
    if not mount.bearings:
        return
    root = 2.0 * in_numpy(root_radii(pair))[index]
    require(
        in_numpy(mount.diameter_at_gear) < root,
        "The {name}'s shaft must be thinner than the gear on it, whose root circle has "
        "{root:.6g} mm, got {got:.6g} mm. Give the shaft's diameters in millimetres, or "
        "make the body a beam.",
        name=name,
        root=root / mm,
        got=in_numpy(mount.diameter_at_gear) / mm,
    )


class RigidBody(AbstractGearBody):
    """A gear body that does not deform, lumped at its mid-face.

    **Fields:**

    - `mass`: [kg].
    - `polar_inertia`: about the axis [kg m2].
    - `transverse_inertia`: about a diameter at mid-face [kg m2].

    **Raises:**

    - `ValueError` if no body can have these numbers.
    """

    mass: Scalar = eqx.field(converter=as_scalar)
    polar_inertia: Scalar = eqx.field(converter=as_scalar)
    transverse_inertia: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        for name in ("mass", "polar_inertia", "transverse_inertia"):
            require(
                in_numpy(getattr(self, name)) > 0.0,
                "`RigidBody." + name + "` must be positive, got {got:.6g}.",
                got=getattr(self, name),
            )
        # Equality is a flat disc, and must survive rounding.
        require(
            2.0 * in_numpy(self.transverse_inertia) >= (1.0 - 1e-9) * in_numpy(self.polar_inertia),
            "`RigidBody.transverse_inertia` must be at least half the polar inertia, as of every "
            "body, got {transverse:.6g} against {polar:.6g} kg m2. Are the two exchanged?",
            transverse=self.transverse_inertia,
            polar=self.polar_inertia,
        )

    @property
    def piece(self) -> None:
        return None

    @property
    def seat_count(self) -> int:
        return 0

    def check(self, name: str, mount: AbstractMount, pair: GearPair, index: int) -> None:
        check_shaft_within(name, mount, pair, index)

    def nodes(self, mount: AbstractMount) -> MountedNodes:
        return mount.nodes

    def matrices(self, name: str, mount: AbstractMount) -> MountMatrices:
        bare, rows = mount.matrices(), 6 * mount.nodes.gear[0] + np.arange(6)
        across, polar = self.transverse_inertia, self.polar_inertia
        inertia = jnp.stack([self.mass, self.mass, self.mass, across, across, polar])
        spin = np.zeros((6, 6))
        spin[3, 4], spin[4, 3] = 1.0, -1.0
        return MountMatrices(
            stiffness=bare.stiffness,
            mass=bare.mass.at[rows, rows].add(inertia),
            gyroscopic=bare.gyroscopic.at[rows[:, None], rows[None, :]].add(polar * spin),
        )

    def section_motion(self, mount: AbstractMount, z: Scalar) -> SectionMotion:
        return carried(z)

    def middle_motion(self, mount: AbstractMount) -> SectionMotion:
        return carried(jnp.zeros(()))


class BeamBody(AbstractGearBody):
    """A gear body that is a piece of shaft: one beam between the ends of its face.

    Its inner diameter is that of the shaft around it.

    **Fields:**

    - `width`: face width [m].
    - `outer`: diameter, that of the root circle [m].
    - `material`: of the body.

    **Raises:**

    - `ValueError` unless width and diameter are positive.
    """

    width: Scalar = eqx.field(converter=as_scalar)
    outer: Scalar = eqx.field(converter=as_scalar)
    material: Material = eqx.field(default_factory=Material)

    def __check_init__(self):
        for name in ("width", "outer"):
            require(
                in_numpy(getattr(self, name)) > 0.0,
                "`BeamBody." + name + "` must be positive, got {got:.6g} m.",
                got=getattr(self, name),
            )

    @property
    def piece(self) -> BodyPiece:
        return BodyPiece(self.width, self.outer, self.material)

    @property
    def seat_count(self) -> int:
        return 0

    def check(self, name: str, mount: AbstractMount, pair: GearPair, index: int) -> None:
        width = (pair.pinion, pair.wheel)[index].face_width
        require(
            in_numpy(self.width) >= (1.0 - 1e-9) * in_numpy(width),
            "The {name}'s beam body must be at least as wide as its face, {width:.6g} m, got "
            "{got:.6g} m.",
            name=name,
            width=width,
            got=self.width,
        )

    def nodes(self, mount: AbstractMount) -> MountedNodes:
        return mount.nodes

    def matrices(self, name: str, mount: AbstractMount) -> MountMatrices:
        require(
            len(mount.bearings) > 0,
            "The {name}'s body is a beam, which must be part of a shaft. Give its shaft and "
            "bearings, or make the body rigid.",
            name=name,
        )
        return mount.matrices(self.piece)

    def section_motion(self, mount: AbstractMount, z: Scalar) -> SectionMotion:
        return beam_shapes(mount.body_beam(self.piece), 0.5 + z / self.width)

    def middle_motion(self, mount: AbstractMount) -> SectionMotion:
        return self.section_motion(mount, jnp.zeros(()))


def solid_disc(
    outer: Scalar | float,
    inner: Scalar | float,
    width: Scalar | float,
    density: Scalar | float,
    *,
    mass: Scalar | float | None = None,
    polar_inertia: Scalar | float | None = None,
    transverse_inertia: Scalar | float | None = None,
) -> RigidBody:
    r"""A disc with a bore, apart from what is known better (theory 6.4).

    Without one of its own the transverse inertia follows from what is known of the others: of a
    body that is even along its width $b$ it is $I_p / 2 + m b^2 / 12$, whatever its shape in the
    plane.

    **Arguments:**

    - `outer`: diameter, that of a gear's root circle [m].
    - `inner`: bore diameter, zero for none [m]. A shaft within brings its own mass.
    - `width`: face width [m].
    - `density`: [kg/m3].
    - `mass`, `polar_inertia`, `transverse_inertia`: in place of the disc's [kg, kg m2].

    **Returns:**

    The body.

    **Raises:**

    - `ValueError` unless the outer diameter exceeds the inner.
    """
    outer, inner, width, density = (in_numpy(as_scalar(x)) for x in (outer, inner, width, density))
    require(
        (outer > inner) & (inner >= 0.0),
        "A gear body must be larger than its bore, got {outer:.6g} m outside and {inner:.6g} m "
        "inside. Both are diameters in metres.",
        outer=outer,
        inner=inner,
    )
    whole = density * 0.25 * np.pi * (outer**2 - inner**2) * width
    if polar_inertia is None:
        polar_inertia = whole * (outer**2 + inner**2) / 8.0
    mass = whole if mass is None else mass
    if transverse_inertia is None:
        transverse_inertia = 0.5 * polar_inertia + mass * width**2 / 12.0
    return RigidBody(mass, polar_inertia, transverse_inertia)


def gear_disc(
    pair: GearPair, index: int, mount: AbstractMount, **given: Scalar | float
) -> RigidBody:
    """A gear's body where nothing else is said of it: a disc out to the root circle.

    It begins at the bore or, without one, at its shaft, which has a mass of its own.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `mount`: its shaft, or the springs at its centre.
    - `given`: `mass`, `polar_inertia`, `transverse_inertia` where they are known [kg, kg m2].

    **Returns:**

    The body.
    """
    gear = (pair.pinion, pair.wheel)[index]
    inner = mount.diameter_at_gear if gear.bore is None else gear.bore
    outer = 2.0 * in_numpy(root_radii(pair))[index]
    return solid_disc(outer, inner, gear.face_width, gear.material.density, **given)
