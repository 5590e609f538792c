r"""The outline of a tooth on its body, between two neighbours, as pieces of smooth curves.

The body goes on to either side of the neighbours, and down to the bore or as deep as stresses of
teeth reach; there it is held. Lengths in modules; the tooth stands upright, its centreline along
the second axis; the body lies on the left of the way round.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxgear._geometry._profile import ToothSection
from jaxgear._types import Reals, Scalar

# How far the body goes on, in modules: half as much again changes stresses by less than 0.2 %.
_BESIDE, _BELOW = 3.0, 6.0
# The part of the root circle's radius at which a body without a bore is held at the deepest.
_CORE = 0.3
# Full fillets leave no root circle between teeth. Neighbours are moved off to have this much of it.
_LEAST_LAND = 0.1
# Elements of the tooth's fillets, flanks and tip; of its neighbours'.
_FINE, _COARSE = (10, 8, 4), (2, 3, 1)


Curve = Callable[[Reals], Reals]


class Piece(NamedTuple):
    """A smooth piece of the outline, divided into elements.

    **Fields:**

    - `name`: of what it belongs to.
    - `curve`: points `[..., 2]` by the curve's own parameter, before they are put in their place;
        pieces that are alike share it [-].
    - `edges`: parameters at which elements begin and end, in the order of the way round.
    - `frame`: by which points are multiplied from the right: turned, mirrored, scaled [-].
    """

    name: str
    curve: Curve
    edges: Reals
    frame: Reals

    @property
    def elements(self) -> int:
        """Number of its elements."""
        return self.edges.size - 1


def tooth_outline(section: ToothSection, tip_roll: Scalar) -> tuple[Piece, ...]:
    """The outline of a tooth, its neighbours and the body below.

    **Arguments:**

    - `section`: the tooth; of its module only proportions are taken.
    - `tip_roll`: roll angle at its tip [rad].

    **Returns:**

    Pieces on the way round. Their names: `drive_fillet`, `drive_flank`, `tip`, `coast_flank` and
    `coast_fillet` of the tooth; `behind` and `ahead`, in the sense in which the drive flank is
    pushed, the same flanks of its neighbours; `held`, and `free` for the rest.
    """
    root, half = section.root_radius / section.module, section.root_half_angle
    pitch = jnp.maximum(2.0 * jnp.pi / section.teeth, 2.0 * half + _LEAST_LAND / root)
    begin = pitch + half
    end = jnp.minimum(begin + _BESIDE / root, 0.9 * jnp.pi)
    ratio = section.radius_ratio
    thick = 1.0 - (_CORE if ratio is None else 1.0 / ratio)
    inner = root - jnp.minimum(thick * root, _BELOW)
    # Elements grow away from the teeth.
    grown = np.cumsum(np.append(0.0, 1.6 ** np.arange(5.0)))
    beside = begin + (end - begin) * (grown / grown[-1])
    circle = lambda name, radius, edges: Piece(name, _circle, edges, radius * np.eye(2))
    side = lambda angle, edges: Piece("held", _ray, edges, _turned(angle))
    fillet, flank = _in_modules(section, section.fillet), _in_modules(section, section.flank)
    tooth = lambda turn, counts, names: _tooth(
        section, (fillet, flank), tip_roll, turn, counts, names
    )
    return (
        circle("held", inner, _even(-end, end, 8)),
        side(end, _even(inner, root, 3)),
        circle("free", root, beside[::-1]),
        *tooth(pitch, _COARSE, ("free", "behind", "free", "free", "free")),
        circle("free", root, _even(pitch - half, half, 2)),
        *tooth(jnp.zeros(()), _FINE, _TOOTH),
        circle("free", root, _even(-half, half - pitch, 2)),
        *tooth(-pitch, _COARSE, ("free", "ahead", "free", "free", "free")),
        circle("free", root, -beside),
        side(-end, _even(root, inner, 3)),
    )


_TOOTH = ("drive_fillet", "drive_flank", "tip", "coast_flank", "coast_fillet")


def _tooth(
    section: ToothSection,
    curves: tuple[Curve, Curve],
    tip_roll: Scalar,
    turn: Scalar,
    counts: tuple[int, int, int],
    names: tuple[str, ...],
) -> list[Piece]:
    """The pieces of one tooth by its fillet and flank, turned about the axis to the right."""
    fillet, flank = curves
    corner = flank(tip_roll)
    radius, angle = jnp.hypot(corner[0], corner[1]), jnp.arctan2(corner[0], corner[1])
    on_fillet = _even(jnp.asarray(0.5 * jnp.pi), section.pressure_angle, counts[0])
    on_flank = _even(section.form_roll_angle, tip_roll, counts[1])
    right = _turned(turn)
    left = np.diag([-1.0, 1.0]) @ right
    pieces = (
        (fillet, on_fillet, right),
        (flank, on_flank, right),
        (_circle, _even(angle, -angle, counts[2]), radius * right),
        (flank, on_flank[::-1], left),
        (fillet, on_fillet[::-1], left),
    )
    return [Piece(name, *each) for name, each in zip(names, pieces, strict=True)]


def _in_modules(section: ToothSection, curve: Callable[[Reals], tuple[Reals, Reals]]) -> Curve:
    return lambda at: jnp.stack(curve(at), axis=-1) / section.module


def _circle(angle: Reals) -> Reals:
    """A point at an angle from upright towards the right, one module from the axis."""
    return jnp.stack([jnp.sin(angle), jnp.cos(angle)], axis=-1)


def _ray(radius: Reals) -> Reals:
    """A point upright above the axis."""
    return jnp.stack([jnp.zeros_like(radius), radius], axis=-1)


def _turned(angle: Reals) -> Reals:
    """By which points are multiplied from the right to turn them to the right."""
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    return jnp.stack([jnp.stack([cosine, -sine]), jnp.stack([sine, cosine])])


def _even(first: Reals, last: Reals, count: int) -> Reals:
    """Parameters from the first to the last, evenly spaced."""
    return first + (last - first) * np.linspace(0.0, 1.0, count + 1)
