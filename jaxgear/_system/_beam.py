r"""One uniform Timoshenko beam: a circular tube along Z between two nodes.

Degrees of freedom of a node, here and in everything built on it: translations along S, T, Z, then
rotations about S, T, Z. A small turn moves a point at height z by $\omega\times z Z$, so that a
section square to the axis has $dv/dz = +\psi$ and $dw/dz = -\varphi$: the plane (S, about T) and
the plane (T, about S with the other sign) share one matrix. Each plane deforms in the exact static
shapes of a beam loaded at its ends only, bending and shear together: J. S. Przemieniecki, Theory of
Matrix Structural Analysis, McGraw-Hill 1968 (section 5.6, as others cite it; the book was not at
hand: what holds the matrices is quadrature of these shapes); thesis annex 1 without its misprints.
"""

from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._compiled import compiled
from jaxgear._geometry._gear import Material
from jaxgear._types import Reals, Scalar, as_scalar

if TYPE_CHECKING:
    BeamMatrix = Array
    BeamShapes = Array
    PlaneMatrix = Array
else:
    BeamMatrix = Float[Array, "12 12"]
    BeamShapes = Float[Array, "6 12"]
    PlaneMatrix = Float[Array, "4 4"]


def _rows(*entries: tuple[int, float]) -> np.ndarray:
    """One row per entry: a degree of freedom of the element, and the sign that it enters with."""
    chosen = np.zeros((len(entries), 12))
    for row, (dof, sign) in enumerate(entries):
        chosen[row, dof] = sign
    return chosen


# Deflection and slope at both ends in either plane; stretch; twist.
_IN_S = _rows((0, 1.0), (4, 1.0), (6, 1.0), (10, 1.0))
_IN_T = _rows((1, 1.0), (3, -1.0), (7, 1.0), (9, -1.0))
_ALONG = _rows((2, 1.0), (8, 1.0))
_ABOUT = _rows((5, 1.0), (11, 1.0))

_SPRING = np.array([[1.0, -1.0], [-1.0, 1.0]])
_BAR = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0


def _mirrored(a: float, b: float, c: float, d: float, e: float, f: float) -> np.ndarray:
    """Symmetric matrix of a plane that looks the same from both ends of the beam."""
    return np.array([[a, b, c, d], [b, e, -d, f], [c, -d, a, -b], [d, f, -b, e]])


# Powers of the shear ratio, constant first, for slopes times the length: integrals of the shapes.
_BENDING = (
    _mirrored(12.0, 6.0, -12.0, 6.0, 4.0, 2.0),
    _mirrored(0.0, 0.0, 0.0, 0.0, 1.0, -1.0),
)
_TRANSLATION = (
    _mirrored(13 / 35, 11 / 210, 9 / 70, -13 / 420, 1 / 105, -1 / 140),
    _mirrored(7 / 10, 11 / 120, 3 / 10, -3 / 40, 1 / 60, -1 / 60),
    _mirrored(1 / 3, 1 / 24, 1 / 6, -1 / 24, 1 / 120, -1 / 120),
)
_ROTATION = (
    _mirrored(6 / 5, 1 / 10, -6 / 5, 1 / 10, 2 / 15, -1 / 30),
    _mirrored(0.0, -1 / 2, 0.0, -1 / 2, 1 / 6, -1 / 6),
    _mirrored(0.0, 0.0, 0.0, 0.0, 1 / 3, 1 / 6),
)


@compiled
def cowper_coefficient(outer: Reals, inner: Reals, poisson: Reals) -> Reals:
    r"""Shear coefficient of a circular tube (theory 6.5).

    G. R. Cowper, "The shear coefficient in Timoshenko's beam theory", J. Appl. Mech. 33 (1966)
    335: $\kappa = 6(1+\nu)(1+m^2)^2 / [(7+6\nu)(1+m^2)^2 + (20+12\nu)m^2]$ with $m$ the
    ratio of the radii; $6(1+\nu)/(7+6\nu)$ when solid, $2(1+\nu)/(4+3\nu)$ when thin.

    **Arguments:**

    - `outer`: outer diameter [m].
    - `inner`: inner diameter [m].
    - `poisson`: Poisson's ratio [-].

    **Returns:**

    $\kappa$ [-].
    """
    square = (inner / outer) ** 2
    whole = (1.0 + square) ** 2
    hollow = (20.0 + 12.0 * poisson) * square
    return 6.0 * (1.0 + poisson) * whole / ((7.0 + 6.0 * poisson) * whole + hollow)


class Beam(eqx.Module):
    """A uniform tube between two nodes; the second lies `length` further along Z.

    **Fields:**

    - `length`: [m].
    - `outer`: outer diameter [m].
    - `inner`: inner diameter, zero when solid [m].
    - `shear_coefficient`: share of the area that carries shear [-].
    - `material`: of the tube.
    """

    length: Scalar = eqx.field(converter=as_scalar)
    outer: Scalar = eqx.field(converter=as_scalar)
    inner: Scalar = eqx.field(converter=as_scalar)
    shear_coefficient: Scalar = eqx.field(converter=as_scalar)
    material: Material

    @property
    def area(self) -> Scalar:
        """Of the section [m2]."""
        return 0.25 * jnp.pi * (self.outer**2 - self.inner**2)

    @property
    def second_moment(self) -> Scalar:
        """$I$ of the section about a diameter; twice that about the axis [m4]."""
        return jnp.pi / 64.0 * (self.outer**4 - self.inner**4)

    @property
    def shear_modulus(self) -> Scalar:
        """$G$ [Pa]."""
        return self.material.young / (2.0 * (1.0 + self.material.poisson))

    @property
    def shear_ratio(self) -> Scalar:
        r"""$\Phi = 12EI/(\kappa GAL^2)$: deflection by shear over that by bending [-]."""
        bending = 12.0 * self.material.young * self.second_moment
        shear = self.shear_coefficient * self.shear_modulus * self.area
        return bending / (shear * self.length**2)


@compiled
def beam_stiffness(beam: Beam) -> BeamMatrix:
    """Loads at the ends per motion of the ends (theory 6.1).

    **Arguments:**

    - `beam`: the element.

    **Returns:**

    Symmetric matrix [N/m, N/rad, N m/rad].
    """
    young, length, second = beam.material.young, beam.length, beam.second_moment
    factor = young * second / ((1.0 + beam.shear_ratio) * length**3)
    plane = factor * _plane(beam, _BENDING)
    axial = young * beam.area / length * _SPRING
    twist = beam.shear_modulus * 2.0 * second / length * _SPRING
    return _both_planes(plane) + _placed(_ALONG, axial, _ALONG) + _placed(_ABOUT, twist, _ABOUT)


@compiled
def beam_mass(beam: Beam) -> BeamMatrix:
    """Consistent mass: translation, rotary inertia of the sections, stretch and twist.

    **Arguments:**

    - `beam`: the element.

    **Returns:**

    Symmetric matrix [kg, kg m, kg m2].
    """
    density, length = beam.material.density, beam.length
    mass = density * beam.area * length
    translation = mass / (1.0 + beam.shear_ratio) ** 2 * _plane(beam, _TRANSLATION)
    axial = mass * _BAR
    twist = density * 2.0 * beam.second_moment * length * _BAR
    plane = translation + _rotary_plane(beam)
    return _both_planes(plane) + _placed(_ALONG, axial, _ALONG) + _placed(_ABOUT, twist, _ABOUT)


@compiled
def beam_gyroscopic(beam: Beam) -> BeamMatrix:
    r"""What the spin couples, in $M\ddot q + \Omega G\dot q + Kq$, in axes that do not spin.

    The polar inertia of a section is twice that about a diameter. A disc has
    $I_d\ddot\varphi + I_p\Omega\dot\psi$ about S and $I_d\ddot\psi - I_p\Omega\dot\varphi$ about T.

    **Arguments:**

    - `beam`: the element.

    **Returns:**

    Skew matrix, per spin speed about +Z [kg, kg m, kg m2].
    """
    coupling = _placed(_IN_S, 2.0 * _rotary_plane(beam), _IN_T)
    return coupling - coupling.T


def element_matrices(
    length: Scalar,
    outer: Scalar,
    inner: Scalar,
    shear: Scalar,
    young: Scalar,
    poisson: Scalar,
    density: Scalar,
) -> Float[Array, "12 12 3"]:
    """Stiffness, mass and gyroscopic matrix of one element.

    **Arguments:**

    - `length`, `outer`, `inner`, `shear`, `young`, `poisson`, `density`: as of `Beam` and its
        `Material`.

    **Returns:**

    The three, as `[dof, dof, matrix]`.
    """
    beam = Beam(length, outer, inner, shear, Material(young, poisson, density))
    return jnp.stack([beam_stiffness(beam), beam_mass(beam), beam_gyroscopic(beam)], axis=-1)


def beam_shapes(beam: Beam, fraction: Scalar) -> BeamShapes:
    """Motion of the section at a fraction of the length, per motion of the ends.

    Exact for loads at the ends only: deflection is cubic, rotation quadratic, the rest linear.

    **Arguments:**

    - `beam`: the element.
    - `fraction`: position over the length, from the first node [-].

    **Returns:**

    Rows: translations S, T, Z [m] and rotations about them [rad] of the section.
    """
    at, ratio, length = fraction, beam.shear_ratio, beam.length
    away = 1.0 - at
    curve = jnp.stack(
        [
            away**2 * (1.0 + 2.0 * at) + ratio * away,
            length * at * away * (away + 0.5 * ratio),
            at**2 * (1.0 + 2.0 * away) + ratio * at,
            -length * at * away * (at + 0.5 * ratio),
        ]
    ) / (1.0 + ratio)
    turn = jnp.stack(
        [
            -6.0 * at * away / length,
            away * (1.0 - 3.0 * at + ratio),
            6.0 * at * away / length,
            at * (1.0 - 3.0 * away + ratio),
        ]
    ) / (1.0 + ratio)
    straight = jnp.stack([away, at])
    rows = [
        curve @ _IN_S,
        curve @ _IN_T,
        straight @ _ALONG,
        -turn @ _IN_T,
        turn @ _IN_S,
        straight @ _ABOUT,
    ]
    return jnp.stack(rows)


def _plane(beam: Beam, powers: tuple[np.ndarray, ...]) -> PlaneMatrix:
    """Polynomial in the shear ratio, for deflections [m] and slopes [rad]."""
    ratio = beam.shear_ratio
    polynomial = sum(ratio**power * matrix for power, matrix in enumerate(powers))
    size = jnp.stack([jnp.ones(()), beam.length, jnp.ones(()), beam.length])
    return size[:, None] * polynomial * size[None, :]


def _rotary_plane(beam: Beam) -> PlaneMatrix:
    """Inertia of the sections' rotation in one plane."""
    factor = beam.material.density * beam.second_moment / beam.length
    return factor / (1.0 + beam.shear_ratio) ** 2 * _plane(beam, _ROTATION)


def _both_planes(plane: PlaneMatrix) -> BeamMatrix:
    return _placed(_IN_S, plane, _IN_S) + _placed(_IN_T, plane, _IN_T)


def _placed(rows: np.ndarray, small: Reals, columns: np.ndarray) -> BeamMatrix:
    """A small matrix among the degrees of freedom of the element."""
    return jnp.matmul(rows.T, small @ columns)
