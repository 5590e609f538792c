r"""Stress along the fillets of a tooth by a line load on its flank or on a neighbour's.

Plane strain, by boundary elements of the true outline: involutes, trochoids, neighbours, the body
to its bore. It is solved once for a gear; what is kept is smooth in the load's place. Stresses are
those along the surface, which is free: $\sigma = \frac{2\mu}{1-\nu}\,\partial u_t/\partial s$.
"""

import abc
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jaxgear._compiled import compiled
from jaxgear._contact._boundary_elements import (
    NODES,
    SLOPE_PLACES,
    WEIGHTS,
    Boundary,
    boundary,
    boundary_matrices,
    shapes,
)
from jaxgear._contact._face_coupling import face_operator
from jaxgear._contact._tooth import tooth_load
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._outline import Piece, tooth_outline
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._profile import ToothSection, tooth_section
from jaxgear._types import LineGrid, Reals, Scalar

# Polynomials in the load's place, and along the fillet; points along it that are looked at, and
# points of the flank above it.
_TERMS, _NEIGHBOUR_TERMS, _ALONG, _POINTS, _FLANK_POINTS = 9, 5, 10, 41, 24
_FLANKS = ("behind", "drive_flank", "ahead")

FilletStress = Float[Array, "phase line slice 2 point"]


class AbstractRootInfluence(eqx.Module):
    """Stress along the fillets of one gear's teeth by the loads on its contact lines.

    **Fields:**

    - `point`: half thickness and height of points from the root circle to the involute [m].
    - `flank`: the same of points from there up to the tip [m].
    """

    point: eqx.AbstractVar[Float[Array, "point 2"]]
    flank: eqx.AbstractVar[Float[Array, "flank_point 2"]]

    @property
    def height(self) -> Float[Array, " point"]:
        """Of the points, above the root circle along the tooth's centreline [m]."""
        return self.point[:, 1] - jnp.hypot(self.point[0, 0], self.point[0, 1])

    @abc.abstractmethod
    def along_fillets(
        self, pair: GearPair, lines: ContactLines, load: LineGrid, gear: int
    ) -> FilletStress:
        """Stress along both fillets of the teeth in contact.

        **Arguments:**

        - `pair`: the gears.
        - `lines`: where the slices are.
        - `load`: load of each slice over its length along the contact line [N/m].
        - `gear`: 0 for the pinion, 1 for the wheel.

        **Returns:**

        On the fillet of the loaded flank and on the other, at the points [Pa].
        """


class RootInfluence(AbstractRootInfluence):
    r"""Stress along the fillets of a tooth per line load.

    **Fields:**

    - `terms`: Chebyshev coefficients in the place of the load, from -1 where the involute begins to
        1 at the tip, of the stress times module over line load, for loads on the tooth behind, on
        the tooth itself and on the tooth ahead, in the sense in which they push; on the fillet of
        the loaded flank and on the other; at points from the root circle to the involute [-].
    - `form_roll`, `tip_roll`: roll angles between which a flank is [rad].
    - `point`, `flank`: as of the base class [m].
    - `section`: the tooth.
    """

    terms: Float[Array, "3 2 point term"]
    form_roll: Scalar
    tip_roll: Scalar
    point: Float[Array, "point 2"]
    flank: Float[Array, "flank_point 2"]
    section: ToothSection

    def along_fillets(
        self, pair: GearPair, lines: ContactLines, load: LineGrid, gear: int
    ) -> FilletStress:
        """Stress of each slice in plane strain, spread along the face; see the base class."""
        length = lines.roll if gear == 0 else pair.tangent_length - lines.roll
        angle = roll_angle(pair, self.section, length)
        slices, width = lines.roll.shape[2], lines.length * jnp.cos(pair.base_helix_angle)
        decay, face = self.decay(jnp.mean(angle, axis=2)), pair.of_bodies("face_width")[gear]
        kernel = width * face_operator(decay, slices, slices * width, face)
        loads = load[..., None] * self.place_terms(angle) / self.section.module
        reached = jnp.einsum("plij,pljk,plkt->plit", kernel, kernel, loads)
        none = jnp.zeros_like(reached[:, :1])
        # A tooth further along the path is behind on the pinion, which the mesh pushes back.
        further = jnp.concatenate([reached[:, 1:], none], axis=1)
        nearer = jnp.concatenate([none, reached[:, :-1]], axis=1)
        behind, ahead = (further, nearer) if gear == 0 else (nearer, further)
        every = jnp.concatenate([behind, reached, ahead], axis=-1)
        terms = jnp.concatenate(list(self.terms), axis=-1)
        return jnp.einsum("plit,sqt->plisq", every, terms)

    def place_terms(self, roll_angle: Reals) -> Float[Array, "... term"]:
        """Chebyshev polynomials at places of the load, those beyond the flank at its ends [-].

        **Arguments:**

        - `roll_angle`: of the loaded points [rad].
        """
        share = (roll_angle - self.form_roll) / (self.tip_roll - self.form_roll)
        place = jnp.clip(2.0 * share - 1.0, -1.0, 1.0)
        return jnp.moveaxis(jnp.stack(list(_chebyshev(place, _TERMS))), 0, -1)

    def decay(self, roll_angle: Reals) -> Reals:
        r"""How far along the face a load reaches at the root.

        $\lambda = m\sqrt{0.35 + 0.62\,u/m}$, $u$ from the root circle to where the load crosses
        the centreline, of `face_operator` applied twice. Fitted to teeth of 3-D finite elements
        with free ends: 18, 25, 45 and 86 teeth, 4, 6.3 and 10 modules wide, loads
        $\cos(n\pi z/B)$ up to n = 4; root mean square of what is left 2 % of the even load's
        stress. Not in it: at a free face, over half a module, stress
        falls by up to a third even under an even load, which the middle carries: of a gear of six
        modules 3 to 11 % more than in plane strain, of twenty 1 to 3 %.

        **Arguments:**

        - `roll_angle`: of the loaded points [rad].

        **Returns:**

        $\lambda$ [m].
        """
        module = self.section.module
        lever = tooth_load(self.section, roll_angle).height - self.section.root_radius
        return module * jnp.sqrt(0.35 + 0.62 * jnp.maximum(lever / module, 0.0))


def _chebyshev(place: Reals, count: int) -> Iterator[Reals]:
    before, value = place, jnp.ones_like(place)
    for _ in range(count):
        yield value
        before, value = value, 2.0 * place * value - before


@compiled
def root_influence(section: ToothSection, tip_roll: Scalar, poisson: Scalar) -> RootInfluence:
    r"""Solve for the stresses along the fillets of a tooth (theory 3.12).

    **Arguments:**

    - `section`: the tooth, on a body that is held at its bore, six modules below the root circle
        where the bore is deeper or missing.
    - `tip_roll`: roll angle at the tip [rad].
    - `poisson`: $\nu$ of the material [-].

    **Returns:**

    The influence, within 0.5 % of fine plane-strain finite elements of the same outline.
    """
    return _on_outline(_solved_terms(section, tip_roll, poisson), section, tip_roll)


def _solved_terms(section: ToothSection, tip_roll: Scalar, poisson: Scalar) -> Array:
    pieces = tooth_outline(section, tip_roll)
    outline = boundary(pieces)
    moved, places = _motions(pieces, outline, poisson), outline.slopes
    slope = jnp.einsum("qk,ekil->eqil", shapes(SLOPE_PLACES, 1), moved)
    strain = jnp.einsum("eqil,eqi->eql", slope, places.tangent) / places.stretch[..., None]
    # Of the shear modulus: tractions are in its units.
    stress = 2.0 / (1.0 - poisson) * strain
    drive, coast = (_rows(pieces, name) for name in ("drive_fillet", "coast_fillet"))
    both = jnp.stack([_flat(stress[drive]), _flat(stress[coast])[::-1]])
    onto, _ = _along_fillet(drive.size)
    terms, first = [], 0
    for name, count in zip(_FLANKS, (_NEIGHBOUR_TERMS, _TERMS, _NEIGHBOUR_TERMS), strict=True):
        fit = _place_fit(_rows(pieces, name).size, count)
        last = first + fit.shape[1]
        found = jnp.einsum("po,sol,tl->spt", onto, both[..., first:last], fit)
        terms.append(jnp.pad(found, ((0, 0), (0, 0), (0, _TERMS - count))))
        first = last
    return jnp.stack(terms)


def _on_outline(terms: Array, section: ToothSection, tip_roll: Scalar) -> RootInfluence:
    """The influence of solved terms, with the points that they are at."""
    form, share = section.form_roll_angle, 0.5 * (1.0 + np.linspace(-1.0, 1.0, _POINTS))
    along = section.fillet(0.5 * jnp.pi + (section.pressure_angle - 0.5 * jnp.pi) * share)
    up = section.flank(form + (tip_roll - form) * np.linspace(0.0, 1.0, _FLANK_POINTS))
    point, flank = (jnp.stack(each, axis=-1) for each in (along, up))
    return RootInfluence(terms, form, tip_roll, point, flank, section)


def roll_angle(pair: GearPair, section: ToothSection, length: Reals) -> Reals:
    """Roll angle on the virtual tooth, which keeps the normal radius of curvature.

    **Arguments:**

    - `pair`: the gears.
    - `section`: the virtual tooth of one of them.
    - `length`: roll lengths on that gear [m].

    **Returns:**

    The angle [rad].
    """
    return length / jnp.cos(pair.base_helix_angle) / section.base_radius


Influences = tuple[AbstractRootInfluence, AbstractRootInfluence]


def root_influences(pair: GearPair) -> tuple[RootInfluence, RootInfluence]:
    """Solve for the stress influence of both gears' teeth; once for a pair.

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    Pinion, wheel.
    """
    return root_influence(*_shape(pair, 0)), root_influence(*_shape(pair, 1))


def _shape(pair: GearPair, gear: int) -> tuple[ToothSection, Scalar, Scalar]:
    """All that the influence of one gear's teeth depends on."""
    own = (pair.pinion, pair.wheel)[gear]
    tip = jnp.sqrt(pair.tip_radius[gear] ** 2 - pair.base_radius[gear] ** 2)
    section = tooth_section(pair, own)
    return section, roll_angle(pair, section, tip), own.material.poisson


class NearbyInfluences(eqx.Module):
    """Influences of a pair and of others close to it: exact in value and first derivative there.

    One solution and one linearisation, however many keys it is then differentiated by.

    **Fields:**

    - `numbers`: of the shape of each gear's teeth, in SI [-].
    - `terms`: of the influence of each [-].
    - `slopes`: of these by the numbers, the numbers leading [-].
    """

    numbers: tuple[Array, Array]
    terms: tuple[Array, Array]
    slopes: tuple[Array, Array]

    def at(self, pair: GearPair) -> tuple[RootInfluence, RootInfluence]:
        """The influences of a pair close by.

        **Arguments:**

        - `pair`: the gears.

        **Returns:**

        Pinion, wheel.
        """
        pinion, wheel = (self._of(pair, gear) for gear in (0, 1))
        return pinion, wheel

    def _of(self, pair: GearPair, gear: int) -> RootInfluence:
        shape = _shape(pair, gear)
        away = ravel_pytree(shape)[0] - self.numbers[gear]
        terms = self.terms[gear] + jnp.tensordot(away, self.slopes[gear], axes=1)
        return _on_outline(terms, *shape[:2])


def nearby_influences(pair: GearPair) -> NearbyInfluences:
    """Solve for influences that follow their pair.

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    The influences, and how they change.
    """
    pinion, wheel = (_linearised(*_shape(pair, gear)) for gear in (0, 1))
    return NearbyInfluences(*zip(pinion, wheel, strict=True))


@compiled
def _linearised(
    section: ToothSection, tip_roll: Scalar, poisson: Scalar
) -> tuple[Array, Array, Array]:
    """Numbers of a shape, its terms and their slopes."""
    numbers, shaped = ravel_pytree((section, tip_roll, poisson))
    terms, push = jax.linearize(lambda moved: _solved_terms(*shaped(moved)), numbers)
    # In a function of its own: of what has no name JAX prints all that was traced.
    return numbers, terms, jax.lax.map(lambda moved: push(moved), jnp.eye(numbers.size))


def _motions(pieces: tuple[Piece, ...], outline: Boundary, poisson: Scalar) -> Array:
    """Displacements of the nodes by unit loads at the nodes of the three drive flanks.

    Shape `[element, node, 2, load]`. A traction that is one node's quadratic, over what it
    integrates to, is a unit load there for all that is a quadratic along the element.
    """
    motion, traction = boundary_matrices(outline, poisson)
    nodes, count = outline.nodes, motion.shape[0]
    held = np.repeat(_rows(pieces, "held", mask=True), 3)[None, None, :, None]
    loaded = np.concatenate([_rows(pieces, name) for name in _FLANKS])
    columns = (3 * loaded[:, None] + np.arange(3)).ravel()
    inward = -nodes.normal[loaded].reshape(-1, 2)
    unit = (nodes.stretch[loaded] * WEIGHTS[None]).reshape(1, 1, -1)
    right = jnp.einsum("nikj,kj->nik", traction[:, :, columns, :], inward) / unit
    # What is not known: tractions where the body is held, displacements elsewhere.
    left = jnp.where(held, -traction, motion).reshape(2 * count, 2 * count)
    found = jnp.linalg.solve(left, right.reshape(2 * count, -1)).reshape(count, 2, -1)
    return jnp.where(held[0, 0, :, :, None], 0.0, found).reshape(-1, 3, 2, found.shape[-1])


def _rows(pieces: tuple[Piece, ...], name: str, *, mask: bool = False) -> np.ndarray:
    """Numbers of the elements of the pieces of a name, or whether each is one of them."""
    own = np.concatenate([np.full(piece.elements, piece.name == name) for piece in pieces])
    return own if mask else np.nonzero(own)[0]


def _flat(stress: Array) -> Array:
    """Elements and places in one row, in the order of the way round."""
    return stress.reshape(-1, stress.shape[-1])


def _element_places(elements: int, places: np.ndarray) -> np.ndarray:
    """Places of equal elements on the whole piece, from -1 to 1."""
    return ((2 * np.arange(elements) + 1)[:, None] + places).ravel() / elements - 1.0


def _along_fillet(elements: int) -> tuple[np.ndarray, np.ndarray]:
    """From stresses at the elements' places to those at points along the fillet."""
    at = _element_places(elements, SLOPE_PLACES)
    points = np.linspace(-1.0, 1.0, _POINTS)
    vander = np.polynomial.chebyshev.chebvander
    return vander(points, _ALONG) @ np.linalg.pinv(vander(at, _ALONG)), points


def _place_fit(elements: int, terms: int) -> np.ndarray:
    """From values at the nodes of a flank to Chebyshev coefficients along it."""
    at = _element_places(elements, NODES)
    return np.linalg.pinv(np.polynomial.chebyshev.chebvander(at, terms - 1))
