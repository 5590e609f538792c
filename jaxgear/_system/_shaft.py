"""A stepped shaft on bearings: what its drawing says, and its matrices.

Heights are from the shaft's left (-Z) end. Every number is differentiable; which of its points
share a node, and in which order they lie along the shaft, is not, and is settled once when the
shaft is built.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxgear._checks import InputError, require
from jaxgear._compiled import any_traced, in_numpy
from jaxgear._geometry._gear import Material
from jaxgear._system._beam import Beam, cowper_coefficient, element_matrices
from jaxgear._system._gear_body import AbstractGearBody
from jaxgear._system._mount import AbstractMount, BodyPiece, MountedNodes, MountMatrices, NodeDofs
from jaxgear._system._shaft_layout import SAME_PLACE, ShaftLayout, settled_layout
from jaxgear._system._shaft_parts import Bearing, Segment, ShaftLoad, check_bearings
from jaxgear._types import Scalar, as_optional_scalar, as_scalar

if TYPE_CHECKING:
    Nodes = Array
else:
    Nodes = Float[Array, "node"]


class Shaft(AbstractMount):
    r"""A stepped shaft with its bearings, one gear and loads from outside.

    Positions, lengths, diameters and stiffnesses are differentiable; the layout of the nodes is
    not. It is settled from the numbers when a shaft is built. To build one from numbers that JAX
    traces, hand in the layout of a shaft built before.

    **Fields:**

    - `segments`: from the left end to the right.
    - `bearings`: in any order.
    - `gear_at`: height of the gear's mid-face [m].
    - `torque_at`: height at which the torque enters or leaves [m], or `None`: at the gear.
    - `loads`: constant loads from outside.
    - `shear_coefficient`: $\kappa$ of every section [-], or `None`: Cowper's for each.
    - `material`: of the shaft.
    - `layout`: of the nodes.
    """

    segments: tuple[Segment, ...]
    bearings: tuple[Bearing, ...]
    gear_at: Scalar = eqx.field(converter=as_scalar)
    torque_at: Scalar | None = eqx.field(converter=as_optional_scalar)
    loads: tuple[ShaftLoad, ...]
    shear_coefficient: Scalar | None = eqx.field(converter=as_optional_scalar)
    material: Material
    layout: ShaftLayout = eqx.field(static=True)

    def __init__(
        self,
        segments: Iterable[Segment],
        bearings: Iterable[Bearing],
        gear_at: object,
        torque_at: object = None,
        loads: Iterable[ShaftLoad] = (),
        shear_coefficient: object = None,
        material: Material | None = None,
        *,
        body_width: object = None,
        divisions: int = 1,
        layout: ShaftLayout | None = None,
    ):
        """Build a shaft and settle its layout.

        **Arguments:**

        - `segments`, `bearings`, `gear_at`, `torque_at`, `loads`, `shear_coefficient`: the fields.
        - `material`: the field; steel by default.
        - `body_width`: face width of a gear whose body is a beam between two nodes [m], which the
            layout then makes room for; `None` for any other body. It is not kept.
        - `divisions`: elements between two stations; one is exact in statics [-].
        - `layout`: of a shaft built before, which then need not be settled again.

        **Raises:**

        - `ValueError` if something lies off the shaft, or where it cannot.
        """
        self.segments = tuple(segments)
        self.bearings = tuple(bearings)
        self.gear_at = as_scalar(gear_at)
        self.torque_at = as_optional_scalar(torque_at)
        self.loads = tuple(loads)
        self.shear_coefficient = as_optional_scalar(shear_coefficient)
        self.material = Material() if material is None else material
        _check_shaft(self)
        self.layout = _laid_out(self, body_width, divisions) if layout is None else layout

    @property
    def length(self) -> Scalar:
        """From end to end, as drawn [m]."""
        return jnp.sum(jnp.stack([segment.length for segment in self.segments]))

    @property
    def nodes(self) -> MountedNodes:
        layout = self.layout
        return MountedNodes(
            places=layout.places,
            count=layout.count,
            gear=layout.gear_nodes,
            loaded=layout.gear_nodes,
            torque=layout.torque_nodes,
            bearings=tuple(layout.nodes[f"bearing {i}"] for i in range(len(self.bearings))),
        )

    @property
    def bearing_heights(self) -> tuple[Scalar, ...]:
        return tuple(bearing.at - self.gear_at for bearing in self.bearings)

    @property
    def load_heights(self) -> tuple[Scalar, ...]:
        return tuple(load.at - self.gear_at for load in self.loads)

    @property
    def diameter_at_gear(self) -> Scalar:
        """Outer diameter under the gear's middle; of the left segment at a shoulder [m]."""
        layout = self.layout
        stretch = layout.body
        if stretch is None:
            # Elements of a stretch end at the node to their right.
            ends = np.cumsum(layout.cuts)
            stretch = int(np.searchsorted(ends, layout.nodes["gear"]))
        return self.segments[layout.segments[stretch]].outer

    @property
    def springs(self) -> NodeDofs:
        return jnp.zeros(6)

    def body_beam(self, piece: BodyPiece) -> Beam:
        assert self.layout.body is not None
        inner = self.segments[self.layout.segments[self.layout.body]].inner
        shear = self.shear_coefficient
        if shear is None:
            shear = cowper_coefficient(piece.outer, inner, piece.material.poisson)
        return Beam(piece.width, piece.outer, inner, shear, piece.material)

    def matrices(self, piece: BodyPiece | None = None) -> MountMatrices:
        layout = self.layout
        count, last = layout.count, layout.count - 1
        cuts = np.asarray(layout.cuts)
        segment = np.repeat(np.asarray(layout.segments), cuts)
        inner = jnp.stack([s.inner for s in self.segments])[segment]
        outer = jnp.stack([s.outer for s in self.segments])[segment]
        steel = [self.material.young, self.material.poisson, self.material.density]
        young, poisson, density = (jnp.broadcast_to(x, (last,)) for x in steel)
        if piece is not None and layout.body is not None:
            at = int(cuts[: layout.body].sum())
            require(
                piece.outer > inner[at],
                "`BeamBody.outer` must exceed the shaft's inner diameter there, {inner:.6g} m, got "
                "{got:.6g} m. It is the diameter of the root circle.",
                inner=inner[at],
                got=piece.outer,
            )
            outer = outer.at[at].set(piece.outer)
            young = young.at[at].set(piece.material.young)
            poisson = poisson.at[at].set(piece.material.poisson)
            density = density.at[at].set(piece.material.density)
        shear = (
            cowper_coefficient(outer, inner, poisson)
            if self.shear_coefficient is None
            else jnp.broadcast_to(self.shear_coefficient, (last,))
        )
        length = jnp.diff(_rising_heights(self, piece))
        elements = jax.vmap(element_matrices)(length, outer, inner, shear, young, poisson, density)
        dofs = 6 * np.arange(last)[:, None] + np.arange(12)
        rows, columns = dofs[:, :, None], dofs[:, None, :]
        # One scatter for the three, with the matrix as last axis.
        whole = jnp.zeros((6 * count, 6 * count, 3)).at[rows, columns].add(elements)
        return MountMatrices(whole[..., 0], whole[..., 1], whole[..., 2])

    def check_held(self, name: str) -> None:
        if not any_traced(self):
            lengths = (float(segment.length) for segment in self.segments)
            check_bearings(self.bearings, sum(lengths), f"The {name}'s shaft is free to ")


def node_heights(shaft: Shaft, body: AbstractGearBody | None = None) -> Nodes:
    """Height of each node above the left end.

    **Arguments:**

    - `shaft`: the shaft.
    - `body`: of its gear.

    **Returns:**

    Heights [m], in rising order; NaN where points that are traced have changed places.

    **Raises:**

    - `ValueError` if two points have changed places since the layout was settled, or if
        the layout was settled for the other kind of body.
    """
    return _rising_heights(shaft, None if body is None else body.piece)


def drawn_heights(shaft: Shaft, body: AbstractGearBody | None = None) -> Nodes:
    """Height of each node in the order of the layout, even if points have passed each other since.

    **Arguments:**

    - `shaft`: the shaft.
    - `body`: of its gear.

    **Returns:**

    Heights [m].

    **Raises:**

    - `ValueError` if the layout was settled for the other kind of body.
    """
    return _drawn_heights(shaft, None if body is None else body.piece)


def _rising_heights(shaft: Shaft, piece: BodyPiece | None) -> Nodes:
    heights = _drawn_heights(shaft, piece)
    rising = jnp.all(jnp.diff(heights) > 0.0)
    require(
        rising,
        "The points of a shaft must keep the order in which it was laid out: {owners}. Build the "
        "shaft anew, without `layout`.",
        owners=", ".join(shaft.layout.owners),
    )
    # While JAX traces, nobody is told: no number is then better than a wrong one.
    return jnp.where(rising, heights, jnp.nan)


def _drawn_heights(shaft: Shaft, piece: BodyPiece | None) -> Nodes:
    layout = shaft.layout
    require(
        (piece is None) == (layout.body is None),
        "A shaft is laid out for the body that it carries. Build it with `body_width` for a "
        "`BeamBody`, and without for any other.",
    )
    places = _places(shaft, None if piece is None else piece.width)
    stations = jnp.stack([places[owner] for owner in layout.owners])
    cuts = np.asarray(layout.cuts)
    first = np.repeat(np.arange(len(cuts)), cuts)
    part = np.concatenate([np.arange(cut) / cut for cut in cuts])
    heights = stations[first] * (1.0 - part) + stations[first + 1] * part
    return jnp.concatenate([heights, stations[-1:]])


def _places(shaft: Shaft, body_width: Any) -> Mapping[str, Any]:
    """Height of every named point, those that own a station first."""
    places: dict[str, Any] = {
        f"bearing {i}": bearing.at for i, bearing in enumerate(shaft.bearings)
    }
    if body_width is None:
        places["gear"] = shaft.gear_at
    else:
        places["gear left"] = shaft.gear_at - 0.5 * body_width
        places["gear right"] = shaft.gear_at + 0.5 * body_width
    if shaft.torque_at is not None:
        places["torque"] = shaft.torque_at
    places |= {f"load {i}": load.at for i, load in enumerate(shaft.loads)}
    end = np.zeros(())
    places["left end"] = end
    for i, segment in enumerate(shaft.segments[:-1]):
        end = end + segment.length
        places[f"end of segment {i}"] = end
    places["right end"] = end + shaft.segments[-1].length
    return places


def _plain_places(shaft: Shaft, body_width: Scalar | None) -> dict[str, float]:
    """Heights as plain numbers, also while JAX traces something else around them."""
    # A modulus may be traced where no height is.
    plain_leaf = lambda leaf: leaf if isinstance(leaf, Tracer) else np.asarray(leaf)
    plain, width = jax.tree.map(plain_leaf, (shaft, body_width))
    return {name: float(height) for name, height in _places(plain, width).items()}


def _check_shaft(shaft: Shaft) -> None:
    """Refuse a shaft that has nothing to stand on, or something off its ends."""
    require(
        len(shaft.segments) > 0,
        "A shaft must have a segment, got none. Give its length and diameters as a `Segment`.",
    )
    require(
        len(shaft.bearings) > 0,
        "A shaft must have a bearing, got none. Give `Bearing`s, or hold the gear by a `Support` "
        "instead of a shaft.",
    )
    shear = shaft.shear_coefficient
    require(
        shear is None or (in_numpy(shear) > 0.0) & (in_numpy(shear) <= 1.0),
        "`Shaft.shear_coefficient` must lie between 0 and 1, got {got}. Leave it out for Cowper's "
        "of each section.",
        got=shear,
    )
    if any_traced(shaft.segments, shaft.bearings, shaft.gear_at, shaft.torque_at, shaft.loads):
        return
    places = _plain_places(shaft, None)
    end = places["right end"]
    for name, height in places.items():
        require(
            -SAME_PLACE <= height <= end + SAME_PLACE,
            "The {name} of a shaft must lie on it, between 0 and {end:.6g} m from its left end, "
            "got {got:.6g} m. Move it, or lengthen the shaft.",
            name=name,
            end=end,
            got=height,
        )


def _laid_out(shaft: Shaft, body_width: object, divisions: int) -> ShaftLayout:
    """The layout that the numbers of a shaft make."""
    require(
        divisions >= 1,
        "A stretch of shaft must have at least one element, got {got} divisions.",
        got=divisions,
    )
    width = as_optional_scalar(body_width)
    if any_traced(shaft, width):
        raise InputError(
            "A shaft cannot be laid out from numbers that JAX traces. Build it once from plain "
            "numbers, outside of `jit` and `grad`, and hand its layout in: `layout=built.layout`."
        )
    return settled_layout(
        _plain_places(shaft, width),
        [float(segment.length) for segment in shaft.segments],
        gear_at=float(shaft.gear_at),
        with_body=width is not None,
        divisions=divisions,
    )
