r"""Mesh coordinates of gears whose bodies are beams: the approach is a cubic across the face.

At any point $M$ of the base plane the approach is $n_1\cdot u_1(M) + n_2\cdot u_2(M)$ with
$u(M) = u(z) + \omega(z)\times r$, section motions $u, \omega$ at the height of $M$ and $r$ from
the axis to $M$ (thesis eq. 2.7 to 2.9). As a function of $M$ it lies in the span of `beam_basis`;
its coefficients are found from as many points.
"""

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._geometry._pair import GearPair
from jaxgear._interface._wrench import beam_basis
from jaxgear._system._gear_body import AbstractGearBody, SectionMotion, carried
from jaxgear._system._mount import AbstractMount
from jaxgear._types import CoordinateMatrix, DofCoordinates, Scalar

# Points of the base plane that determine the seven coefficients: x over half the face, s in base
# pitches from the pitch point.
_POINTS = np.array(
    [[-1.0, 0.0], [-0.4, 0.0], [0.4, 0.0], [1.0, 0.0], [-1.0, 1.0], [0.0, 1.0], [1.0, 1.0]]
)


def beam_vectors(
    pair: GearPair,
    mounts: tuple[AbstractMount, AbstractMount],
    bodies: Sequence[AbstractGearBody],
) -> DofCoordinates:
    """Coefficients of `beam_basis` that unit motions of the gears' nodes produce.

    **Arguments:**

    - `pair`: the gears.
    - `mounts`: the shafts, for the sections of beam bodies.
    - `bodies`: of pinion and wheel; one of them at least a beam.

    **Returns:**

    Rows: the degrees of freedom of the pinion's node or nodes, then the wheel's [-, 1/m].
    """
    motions = (partial(b.section_motion, mount) for mount, b in zip(mounts, bodies, strict=True))
    return _coefficients(pair, *motions)


def rigid_beam_vectors(pair: GearPair) -> DofCoordinates:
    """As `beam_vectors`, of two gears that move as rigid bodies, each by its motion at mid-face."""
    return _coefficients(pair, carried, carried)


_Sections = Callable[[Scalar], SectionMotion]


def _coefficients(pair: GearPair, pinion: _Sections, wheel: _Sections) -> DofCoordinates:
    """Coefficients of `beam_basis` by motions of sections at a height, per those of nodes."""
    across = 0.5 * pair.face_width * jnp.asarray(_POINTS[:, 0])
    roll = pair.pitch_point + pair.transverse_base_pitch * jnp.asarray(_POINTS[:, 1])

    def at_point(z: Scalar, x: Scalar) -> Array:
        normals = _section_normals(pair, x)
        return jnp.concatenate([pinion(z).T @ normals[0], wheel(z).T @ normals[1]])

    values = jax.vmap(at_point)(across, roll)
    basis = jnp.stack(beam_basis(pair, across, roll), axis=1)
    return jnp.linalg.solve(basis, values).T


def _section_normals(pair: GearPair, roll: Scalar) -> tuple[Array, Array]:
    """Approach at a point per motion of the sections of pinion and wheel at its height [-, m]."""
    angle, helix = pair.working_pressure_angle, pair.base_helix_angle
    none = jnp.zeros(())
    along = jnp.stack([jnp.sin(angle), jnp.cos(angle), none])
    square = jnp.stack([jnp.cos(angle), -jnp.sin(angle), none])
    normal = jnp.cos(helix) * along - jnp.sin(helix) * jnp.asarray([0.0, 0.0, 1.0])
    from_pinion = pair.base_radius[0] * square + roll * along
    from_wheel = from_pinion - pair.working_centre_distance * jnp.asarray([1.0, 0.0, 0.0])
    return (
        jnp.concatenate([normal, jnp.cross(from_pinion, normal)]),
        jnp.concatenate([-normal, -jnp.cross(from_wheel, normal)]),
    )


def within_bodies(
    pair: GearPair,
    mounts: tuple[AbstractMount, AbstractMount],
    bodies: Sequence[AbstractGearBody],
) -> CoordinateMatrix:
    r"""Flexibility of beam bodies between their nodes, where teeth load them along the face.

    The shapes of an element are those of a beam loaded at its ends. A load along it also bows its
    twist and its shear deflection, to the leading order as $1 - (2z/b)^2$ (exactly, if the load is
    even): one more shape each, which carries no motion to the nodes. Its stiffness is
    $\frac{16}{3b}$ times $GJ$ or $\kappa GA$. Without it a pinion's uneven load by torsion is a
    quarter too small. The bow by bending, of the fourth degree, is left out: it is about
    $0.1 (b/d)^2$ of that by shear, on bodies about as long as thick a tenth.

    **Arguments:**

    - `pair`: the gears.
    - `mounts`: the shafts.
    - `bodies`: of pinion and wheel.

    **Returns:**

    Mesh coordinates that the bows give up per mesh load [m/N].
    """
    total = jnp.zeros((7, 7))
    normals = _section_normals(pair, pair.pitch_point)
    for mount, body, normal in zip(mounts, bodies, normals, strict=True):
        if body.piece is not None:
            beam, width = mount.body_beam(body.piece), body.piece.width
            curved = (pair.face_width / width) ** 2
            bow = jnp.zeros(7).at[0].set(1.0).at[2].set(-curved)
            twist = 2.0 * beam.shear_modulus * beam.second_moment
            shear = beam.shear_coefficient * beam.shear_modulus * beam.area
            # Twist moves the flank by its moment arm, shear by the normal's two parts.
            give = normal[5] ** 2 / twist + (normal[0] ** 2 + normal[1] ** 2) / shear
            total += 3.0 * width / 16.0 * give * bow[:, None] * bow[None, :]
    return total
