r"""Cells whose teeth feel a load along their face: what stays in a cell, and what they share.

A part of a tooth that gives $c$ adds $\sqrt{c_i c_j}\,G_{ij}$ between the cells of one contact
line, $G$ its operator along the face: cells of a helical tooth lie at different heights. A body's
influence between roots is multiplied by its operator likewise. Products of positive definite
matrices, element by element, are positive definite (Schur), and with them all that is added here.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._contact._compliance import AbstractCompliance
from jaxgear._contact._face_coupling import end_images, face_operator, leaning_operator
from jaxgear._contact._path_interpolant import PathInterpolant, path_interpolant
from jaxgear._contact._shared_body import SharedBody, where_helical
from jaxgear._contact._tooth_parts import ToothParts
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Bodies, DenseCouplingGrid, LineGrid, Reals, Scalar

# Lengths by which those within a contact are represented, even on a scale of logarithms; they err
# by 0.3 % of its compliance under a cosine load of any wave number.
_LENGTHS = 5
# Of the largest of a part of compliance along the path: what is less is none.
_ROUNDING = 1e-13
# Parts of the contact that reach less far, over the shortest, are left to each cell: with the line
# load it is those that change, and they do so in each cell by itself.
_LOCAL = 3.0
# Of them, shares of the way down to the shortest at which their images are taken.
_WITHIN = np.array([1.0, 3.0, 5.0]) / 6.0


class FaceCells(NamedTuple):
    """What a compliance along the face makes of cells.

    **Fields:**

    - `local`: compliance that stays in each cell [m2/N].
    - `spread`: compliance under an even load of what each tooth pair shares along its face [m2/N].
    - `coupling`: between all cells, that and what bodies give [m/N].
    """

    local: LineGrid
    spread: LineGrid
    coupling: DenseCouplingGrid


def face_cells(
    pair: GearPair, lines: ContactLines, compliance: AbstractCompliance, line_load: Scalar
) -> FaceCells | None:
    """Divide a compliance into what cells have to themselves and what couples them.

    To the others a slice that is in contact over a part of its length is a whole one; what it gives
    itself under a load on that part alone is the cell's own.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: where the cells are.
    - `compliance`: of one tooth pair.
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    Both, or `None` where the compliance leaves slices on their own.
    """
    shared = compliance.bodies(pair, lines.roll.shape[1] - 1)
    along_path = path_interpolant(pair, lines.roll)
    parts = compliance.along_face(pair, along_path.nodes, line_load, shared)
    if parts is None:
        return None
    at = _on_lines(along_path, parts)
    slices = lines.face_position.size
    first = jnp.log(_LOCAL * jnp.mean(parts.shortest))
    last = jnp.maximum(jnp.max(jnp.log(parts.longest)), first + 1e-3)
    step = (last - first) / (_LENGTHS - 1)
    reach = jnp.exp(first + step * jnp.asarray(np.arange(float(_LENGTHS))))
    within = jnp.exp(first - np.log(_LOCAL) * jnp.asarray(_WITHIN))
    # Along the contact line, as the lengths of cells are.
    slant = jnp.cos(pair.base_helix_angle)
    common = pair.face_width / slant
    faces = pair.of_bodies("face_width") / slant
    # What a body that couples teeth has in it of their roots is negative.
    signs = jnp.sign(jnp.sum(parts.rest, axis=1))

    def operators_of(face: Scalar, lost: Array, shift: Scalar, ends: Array) -> Array:
        leaning = leaning_operator(parts.lengths, lost, slices, common, face, shift, jnp.zeros(()))
        images = end_images(jnp.concatenate([within, reach]), slices, common, face, ends)
        # Those that stay in a cell have images in the ends too.
        image = jnp.mean(images[: _WITHIN.size], axis=0, keepdims=True)
        contact = face_operator(reach, slices, common, face) + images[_WITHIN.size :]
        return jnp.concatenate([leaning, image, contact])

    operators = jax.vmap(operators_of)(faces, parts.lost, parts.shift, parts.end_image)
    one = jnp.ones(2)
    factors = [one, one, signs, parts.per_log * np.log(_LOCAL), *[one] * _LENGTHS]
    operators *= jnp.stack(factors, axis=1)[..., None, None]
    bodies = _between_teeth(pair, lines, parts, faces)
    per_log = parts.per_log[:, None, None, None, None]
    weights = jnp.moveaxis(_up_to((at.longest - first) / step), 0, 1) * per_log * step
    whole = jnp.ones_like(at.beam)
    roots = jnp.stack([at.beam, at.root, at.rest, whole], axis=1)
    roots = jnp.concatenate([roots, jax.vmap(_root)(weights)], axis=1)
    own = _on_each_line(jnp.concatenate(roots), jnp.concatenate(operators))
    coupling = _between_cells(pair, lines, along_path, shared, bodies, own)
    beam, root = (jnp.sum(part**2, axis=0) for part in (at.beam, at.root))
    rest = jnp.sum(signs.reshape(2, 1, 1, 1) * at.rest**2, axis=0)
    weights = jnp.sum(weights, axis=0)
    contacts = jnp.sum(weights, axis=0)
    reaching = jnp.concatenate([jnp.stack([beam, root]), weights])
    narrower = _narrower(lines, reaching, jnp.concatenate([parts.lengths[:2], reach]), common)
    cells = lines.roll.shape[1] * slices
    return FaceCells(
        local=at.penetration - contacts + narrower,
        spread=beam + root + rest + contacts,
        coupling=coupling.reshape(-1, cells, cells),
    )


class _OnLines(NamedTuple):
    """Roots of parts of compliance at each cell, `[gear, phase, line, slice]`, and its contact.

    Roots, as the products of those of two cells are what couples them.
    """

    beam: Array
    root: Array
    rest: Array
    longest: Array
    penetration: Array


def _on_lines(along_path: PathInterpolant, parts: ToothParts) -> _OnLines:
    roots = [_root(part) for part in (parts.beam, parts.root, jnp.abs(parts.rest))]
    columns = jnp.concatenate(
        [*roots, jnp.log(parts.longest), jnp.sum(parts.penetration, axis=0)[None]]
    )
    found = along_path(columns)
    beam, root, rest, longest = found[:8].reshape(4, 2, *found.shape[1:])
    return _OnLines(beam, root, rest, jnp.asarray(longest), found[8])


def _root(part: Reals) -> Reals:
    """Square root, with a derivative of zero at zero.

    A load below the root chord leaves a beam the rounding of its integral, whose root would be
    millions of times that.
    """
    positive = part > _ROUNDING * jnp.max(part)
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, part, 1.0)), 0.0)


def _on_each_line(roots: Array, operators: Array) -> Array:
    """Operators between the cells of each line, times the roots of both: the sum of all parts."""

    def of(_: None, roots: Array):
        parts = zip(roots, operators, strict=True)
        return None, sum(x[..., :, None] * x[..., None, :] * along[None] for x, along in parts)

    # Line by line, else XLA would work out all of it anew for each pair of lines.
    found = jax.lax.scan(of, None, jnp.moveaxis(roots, 2, 0))[1]
    return jnp.moveaxis(found, 0, 1)


class _Between(NamedTuple):
    """A part of compliance between lines, as products.

    Loads on roots and what roots feel of them, each by resultants, and an operator along the face.
    """

    load: Array
    felt: Array
    operator: Array


def _between_cells(
    pair: GearPair,
    lines: ContactLines,
    along_path: PathInterpolant,
    bodies: tuple[SharedBody, ...],
    spread: Array,
    own: Array,
) -> Array:
    """Compliance within lines, and by the roots of teeth that share a body: all in one pass.

    Arrays of all pairs of cells are large: what costs is how often they are read and written.
    """
    sheared = [body for body in bodies if body.axial and not body.bends]
    plates = [body for body in bodies if body.bends]
    plane = [body for body in bodies if not body.axial]
    in_plane, axial = (_of_bodies(along_path, each, spread) for each in (plane, sheared))
    if not sheared:
        return _summed(own, in_plane)
    axial += _of_plates(pair, lines, along_path, plates)
    with_axial = lambda own, terms, axial: _summed(own, terms + axial)
    without = lambda own, terms, axial: _summed(own, terms)
    return where_helical(pair, with_axial, without, own, in_plane, axial)


def _summed(own: Array, terms: list[_Between]) -> Array:
    """Compliance within lines and between them."""
    same = jnp.asarray(np.eye(own.shape[1]))[None, :, None, :, None]
    total = own[:, :, :, None, :] * same
    for load, felt, operator in terms:
        each = (x[..., None, None] * y[:, :, None] for x, y in zip(load, felt, strict=True))
        total += sum(each) * operator[None]
    return total


def _between_teeth(pair: GearPair, lines: ContactLines, parts: ToothParts, faces: Bodies) -> Array:
    r"""How bodies spread a load along their faces, between the cells of any two lines [1/m].

    `[gear, line, slice, line, slice]`, of faces as lengths of contact line. Square to a tooth, the
    next one is $\pi m_n\sin\beta$ further along the face.
    """
    slant = jnp.cos(pair.base_helix_angle)
    step = jnp.pi * pair.normal_module * jnp.sin(pair.helix_angle)
    count, slices = lines.roll.shape[1:]
    common, length = pair.face_width / slant, parts.lengths[2:]

    def operator(face: Scalar, lost: Array, shift: Scalar, apart: Scalar) -> Array:
        return leaning_operator(length, lost, slices, common, face, shift, apart)[0]

    of_steps = jax.vmap(jax.vmap(operator, (None, None, None, 0)), (0, 0, 0, None))(
        faces,
        parts.lost[:, 2:],
        parts.shift,
        jnp.asarray(np.arange(1.0 - count, count)) * step / slant,
    )
    each = of_steps[:, np.subtract.outer(np.arange(count), np.arange(count)) + count - 1]
    return jnp.moveaxis(each, 2, 3)


def _of_bodies(
    along_path: PathInterpolant, bodies: list[SharedBody], spread: Array
) -> list[_Between]:
    """Of bodies that spread along the face what the loads on their roots do."""
    if not bodies:
        return []
    loads = along_path(_at_nodes([body.resultants(along_path.nodes) for body in bodies]))
    felt = _felt(bodies, loads)
    operators = [spread[body.gear] for body in bodies]
    return [_Between(*each) for each in zip(loads, felt, operators, strict=True)]


def _of_plates(
    pair: GearPair, lines: ContactLines, along_path: PathInterpolant, bodies: list[SharedBody]
) -> list[_Between]:
    """Of bodies that move alike all over their face, by loads along the axis.

    Loads in the plane tilt them too. What tilts do to tilts is left out: how a body spreads loads
    in its plane along the face has that in it.
    """
    if not bodies:
        return []
    loads, tilts = (
        along_path(_at_nodes([of(body) for body in bodies]))
        for of in (
            lambda body: body.resultants(along_path.nodes),
            lambda body: body.tilting(along_path.nodes),
        )
    )
    tilts *= lines.face_position[None, None, None, None]
    by_loads, by_both = (_felt(bodies, each) for each in (loads, loads + tilts))
    even = jnp.cos(pair.base_helix_angle) / pair.of_bodies("face_width")
    cells = lines.roll.shape[1:] * 2
    operators = [jnp.full(cells, even[body.gear]) for body in bodies]
    terms = [(loads, by_both), (tilts, by_loads)]
    return [_Between(*each) for term in terms for each in zip(*term, operators, strict=True)]


def _at_nodes(of_bodies: list[Array]) -> Array:
    """Resultants of bodies at nodes of the path, `[body, resultant, node]`."""
    return jnp.moveaxis(jnp.stack(of_bodies), -1, 1)


def _felt(bodies: list[SharedBody], loads: Array) -> Array:
    """Of each resultant at the first root, motion by loads on the line of the second one."""
    count = loads.shape[3]
    steps = [jnp.stack([body.at_roots(i) for i in range(1 - count, count)]) for body in bodies]
    ahead = np.subtract.outer(np.arange(count), np.arange(count)).T + count - 1
    return jnp.einsum("gijab,gbpjs->gapijs", jnp.stack(steps)[:, ahead], loads)


def _narrower(lines: ContactLines, given: Array, length: Reals, common: Scalar) -> LineGrid:
    r"""What parts of compliance give more where a slice carries on a share of its length only.

    A mean of $e^{-|z - z'|/\lambda}/(2\lambda)$ over a length $h$ is $g(h/\lambda)/h$,
    $g(x) = 1 - (1 - e^{-x})/x$; over a share $\varphi$ it is $g(\varphi x)/(\varphi h)$, no less.
    """
    x = (common / (lines.face_position.size * length))[:, None, None, None]
    share = lines.fraction[None]
    mean = lambda x: 1.0 + jnp.expm1(-x) / x
    more = jnp.where(share > 0.0, mean(jnp.maximum(share, 1e-9) * x) - share * mean(x), 0.0)
    return jnp.sum(given * jnp.maximum(more, 0.0), axis=0)


def _up_to(place: Reals) -> Array:
    """Shares of the lengths that are represented in all lengths up to a place, in steps from them.

    Integrals of hat functions: together they are `place`, and each is smooth.
    """
    number = jnp.asarray(np.arange(float(_LENGTHS))).reshape(-1, *[1] * place.ndim)
    end = _hat_integral(jnp.clip(place, 0.0, _LENGTHS - 1.0)[None] - number)
    return end - _hat_integral(-number)


def _hat_integral(place: Reals) -> Reals:
    """Integral of the hat function on (-1, 1) from the left."""
    x = jnp.clip(place, -1.0, 1.0)
    return jnp.where(x < 0.0, 0.5 * (1.0 + x) ** 2, 1.0 - 0.5 * (1.0 - x) ** 2)
