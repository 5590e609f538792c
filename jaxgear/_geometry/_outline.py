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


class Piece(NamedTuple):
    """A smooth piece of the outline, divided into elements.

    **Fields:**

    - `name`: of what it belongs to.
    - `curve`: points `[..., 2]` by the curve's own parameter [-].
    - `edges`: parameters at which elements begin and end, in the order of the way round.
    """

    name: str
    curve: Callable[[Reals], Reals]
    edges: Reals

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
    at_root = lambda angle: _on_circle(root, angle)
    right = lambda radius: _on_circle(radius, end)
    left = lambda radius: _on_circle(radius, -end)
    return (
        Piece("held", lambda angle: _on_circle(inner, angle), _even(-end, end, 8)),
        Piece("held", right, _even(inner, root, 3)),
        Piece("free", at_root, beside[::-1]),
        *_tooth(section, tip_roll, pitch, _COARSE, ("free", "behind", "free", "free", "free")),
        Piece("free", at_root, _even(pitch - half, half, 2)),
        *_tooth(section, tip_roll, jnp.zeros(()), _FINE, _TOOTH),
        Piece("free", at_root, _even(-half, half - pitch, 2)),
        *_tooth(section, tip_roll, -pitch, _COARSE, ("free", "ahead", "free", "free", "free")),
        Piece("free", at_root, -beside),
        Piece("held", left, _even(root, inner, 3)),
    )


_TOOTH = ("drive_fillet", "drive_flank", "tip", "coast_flank", "coast_fillet")


def _tooth(
    section: ToothSection,
    tip_roll: Scalar,
    turn: Scalar,
    counts: tuple[int, int, int],
    names: tuple[str, ...],
) -> list[Piece]:
    """The pieces of one tooth, turned about the gear's axis towards the right."""
    in_modules = lambda curve: lambda at: jnp.stack(curve(at), axis=-1) / section.module
    fillet, flank = in_modules(section.fillet), in_modules(section.flank)
    corner = flank(tip_roll)
    radius, angle = jnp.hypot(corner[0], corner[1]), jnp.arctan2(corner[0], corner[1])
    on_fillet = _even(jnp.asarray(0.5 * jnp.pi), section.pressure_angle, counts[0])
    on_flank = _even(section.form_roll_angle, tip_roll, counts[1])
    mirror = jnp.asarray([[-1.0, 0.0], [0.0, 1.0]])
    pieces = (
        (fillet, on_fillet),
        (flank, on_flank),
        (lambda at: _on_circle(radius, at), _even(angle, -angle, counts[2])),
        (lambda at: flank(at) @ mirror, on_flank[::-1]),
        (lambda at: fillet(at) @ mirror, on_fillet[::-1]),
    )
    sine, cosine = jnp.sin(turn), jnp.cos(turn)
    turned = jnp.stack([jnp.stack([cosine, -sine]), jnp.stack([sine, cosine])])
    return [
        Piece(name, lambda at, curve=curve: curve(at) @ turned, edges)
        for name, (curve, edges) in zip(names, pieces, strict=True)
    ]


def _on_circle(radius: Reals, angle: Reals) -> Reals:
    """A point at an angle from upright towards the right."""
    return jnp.stack([radius * jnp.sin(angle), radius * jnp.cos(angle)], axis=-1)


def _even(first: Reals, last: Reals, count: int) -> Reals:
    """Parameters from the first to the last, evenly spaced."""
    return first + (last - first) * np.linspace(0.0, 1.0, count + 1)
