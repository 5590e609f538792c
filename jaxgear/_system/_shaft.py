"""A stepped shaft on bearings: what its drawing says, and its matrices.

Heights are from the shaft's left (-Z) end. Every number is differentiable; which of its points
share a node, and in which order they lie along the shaft, is not, and is settled once when the
shaft is built.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxgear._checks import InputError, require
from jaxgear._compiled import in_numpy
from jaxgear._geometry._gear import Material
from jaxgear._system._beam import (
    Beam,
    beam_gyroscopic,
    beam_mass,
    beam_stiffness,
    cowper_coefficient,
)
from jaxgear._types import Scalar, as_optional_scalar, as_reals, as_scalar

if TYPE_CHECKING:
    Vector = Array
    Elements = Array
    ElementMatrices = Array
    Nodes = Array
    ShaftMatrix = Array
else:
    Vector = Float[Array, "direction"]
    Elements = Float[Array, "element"]
    ElementMatrices = Float[Array, "matrix 12 12"]
    Nodes = Float[Array, "node"]
    ShaftMatrix = Float[Array, "shaft_dof shaft_dof"]

# Points closer than this share a node [m].
_SAME_PLACE = 1e-9


class Segment(eqx.Module):
    """A stretch of shaft of one section, a circular tube.

    **Fields:**

    - `length`: [m].
    - `outer`: outer diameter [m].
    - `inner`: inner diameter; zero is solid [m].

    **Raises:**

    - `ValueError` unless the length is positive and the inner diameter below the outer.
    """

    length: Scalar = eqx.field(converter=as_scalar)
    outer: Scalar = eqx.field(converter=as_scalar)
    inner: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __check_init__(self):
        require(
            in_numpy(self.length) > 0.0,
            "`Segment.length` must be positive, got {got:.6g} m. Leave the segment out if the "
            "shaft has none there.",
            got=self.length,
        )
        require(
            in_numpy(self.inner) >= 0.0,
            "`Segment.inner` must not be negative, got {got:.6g} m. Zero is a solid shaft.",
            got=self.inner,
        )
        require(
            in_numpy(self.outer) > in_numpy(self.inner),
            "`Segment.outer` must exceed `Segment.inner`, got {outer:.6g} m outside and "
            "{inner:.6g} m inside. Both are diameters in metres.",
            outer=self.outer,
            inner=self.inner,
        )


class Bearing(eqx.Module):
    """Linear springs between a shaft and its housing, or the ground. Zero is free.

    **Fields:**

    - `at`: height on the shaft [m].
    - `radial_s`: stiffness along S [N/m].
    - `radial_t`: stiffness along T [N/m].
    - `axial`: stiffness along Z [N/m].
    - `tilt_s`: stiffness against rotation about S [N m/rad].
    - `tilt_t`: stiffness against rotation about T [N m/rad].

    **Raises:**

    - `ValueError` if a stiffness is negative.
    """

    at: Scalar = eqx.field(converter=as_scalar)
    radial_s: Scalar = eqx.field(converter=as_scalar, default=0.0)
    radial_t: Scalar = eqx.field(converter=as_scalar, default=0.0)
    axial: Scalar = eqx.field(converter=as_scalar, default=0.0)
    tilt_s: Scalar = eqx.field(converter=as_scalar, default=0.0)
    tilt_t: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __check_init__(self):
        for name in ("radial_s", "radial_t", "axial", "tilt_s", "tilt_t"):
            stiffness = getattr(self, name)
            require(
                in_numpy(stiffness) >= 0.0,
                "`Bearing." + name + "` must not be negative, got {got:.6g}. Zero leaves that "
                "direction free.",
                got=stiffness,
            )

    @property
    def translation(self) -> Vector:
        """Stiffness along S, T, Z [N/m]."""
        return jnp.stack([self.radial_s, self.radial_t, self.axial])

    @property
    def tilt(self) -> Vector:
        """Stiffness against rotation about S and T [N m/rad]."""
        return jnp.stack([self.tilt_s, self.tilt_t])


class ShaftLoad(eqx.Module):
    """A constant load from outside, fixed in direction.

    **Fields:**

    - `at`: height on the shaft [m].
    - `force`: along S, T, Z [N].
    - `moment`: about S, T, Z [N m].

    **Raises:**

    - `ValueError` unless force and moment have three components each.
    """

    at: Scalar = eqx.field(converter=as_scalar)
    force: Vector = eqx.field(converter=as_reals, default=(0.0, 0.0, 0.0))
    moment: Vector = eqx.field(converter=as_reals, default=(0.0, 0.0, 0.0))

    def __check_init__(self):
        for name in ("force", "moment"):
            require(
                getattr(self, name).shape == (3,),
                "`ShaftLoad." + name + "` must have the three components S, T, Z, got an array of "
                "shape {got}.",
                got=getattr(self, name).shape,
            )


@dataclass(frozen=True)
class ShaftLayout:
    """Which points of a shaft share a node, and how the nodes follow each other.

    A station is a point where something happens, and has a node. Where several coincide the
    station goes to one of them, and its height and every derivative by it are that one's: a bearing
    before the gear, then the torque, then a load, then the end of a segment. A shaft whose end
    carries a bearing ends, therefore, where the bearing is.

    `owners` names the point that each station belongs to, from left to right, and `segments` tells
    which segment lies between a station and the next. Each such stretch is cut into `divisions`
    elements, but for the stretch `body` that a gear body fills, which is one. `places` lists
    every name with the index of its node.
    """

    owners: tuple[str, ...]
    segments: tuple[int, ...]
    places: tuple[tuple[str, int], ...]
    divisions: int
    body: int | None

    @property
    def cuts(self) -> tuple[int, ...]:
        """Number of elements in each stretch."""
        return tuple(
            1 if stretch == self.body else self.divisions for stretch in range(len(self.segments))
        )

    @property
    def count(self) -> int:
        """Number of nodes."""
        return 1 + sum(self.cuts)

    @property
    def nodes(self) -> Mapping[str, int]:
        """Node of each named point.

        "left end" and "right end", "bearing 0" and so on, "load 0" and so on, "gear" or, for a gear
        body that is a beam, "gear left" and "gear right"; "torque", unless it acts on such a body.
        """
        return dict(self.places)

    @property
    def guests(self) -> Mapping[str, str]:
        """Points that share a station, with its owner: by their own heights nothing moves."""
        nodes = self.nodes
        owner = {nodes[name]: name for name in self.owners}
        return {name: owner[node] for name, node in self.places if name not in self.owners}

    @property
    def gear_nodes(self) -> tuple[int, ...]:
        """The gear's node, or the two ends of its body."""
        nodes = self.nodes
        return (nodes["gear"],) if self.body is None else (nodes["gear left"], nodes["gear right"])

    @property
    def torque_nodes(self) -> tuple[int, ...]:
        """Where the torque enters, in equal parts."""
        nodes = self.nodes
        return (nodes["torque"],) if "torque" in nodes else self.gear_nodes


class Shaft(eqx.Module):
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
        self.layout = _settled_layout(self, body_width, divisions) if layout is None else layout

    @property
    def length(self) -> Scalar:
        """From end to end, as drawn [m]."""
        return jnp.sum(jnp.stack([segment.length for segment in self.segments]))

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


class BeamBody(eqx.Module):
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


class ShaftMatrices(eqx.Module):
    r"""A free shaft: $M\ddot q + \Omega G\dot q + Kq$, six degrees of freedom per node.

    **Fields:**

    - `stiffness`: $K$ [N/m, N/rad, N m/rad].
    - `mass`: $M$ [kg, kg m, kg m2].
    - `gyroscopic`: $G$, per spin speed about +Z [kg, kg m, kg m2].
    """

    stiffness: ShaftMatrix
    mass: ShaftMatrix
    gyroscopic: ShaftMatrix


def node_heights(shaft: Shaft, body: BeamBody | None = None) -> Nodes:
    """Height of each node above the left end.

    **Arguments:**

    - `shaft`: the shaft.
    - `body`: of its gear, where that is a beam.

    **Returns:**

    Heights [m], in rising order; NaN where points that are traced have changed places.

    **Raises:**

    - `ValueError` if two points have changed places since the layout was settled, or if
        the layout was settled for the other kind of body.
    """
    heights = drawn_heights(shaft, body)
    rising = jnp.all(jnp.diff(heights) > 0.0)
    require(
        rising,
        "The points of a shaft must keep the order in which it was laid out: {owners}. Build the "
        "shaft anew, without `layout`.",
        owners=", ".join(shaft.layout.owners),
    )
    # While JAX traces, nobody is told: no number is then better than a wrong one.
    return jnp.where(rising, heights, jnp.nan)


def drawn_heights(shaft: Shaft, body: BeamBody | None = None) -> Nodes:
    """Height of each node in the order of the layout, even if points have passed each other since.

    **Arguments:**

    - `shaft`: the shaft.
    - `body`: of its gear, where that is a beam.

    **Returns:**

    Heights [m].

    **Raises:**

    - `ValueError` if the layout was settled for the other kind of body.
    """
    layout = shaft.layout
    require(
        (body is None) == (layout.body is None),
        "A shaft is laid out for the body that it carries. Build it with `body_width` for a "
        "`BeamBody`, and without for any other.",
    )
    places = _places(shaft, None if body is None else body.width)
    stations = jnp.stack([places[owner] for owner in layout.owners])
    cuts = np.asarray(layout.cuts)
    first = np.repeat(np.arange(len(cuts)), cuts)
    part = np.concatenate([np.arange(cut) / cut for cut in cuts])
    heights = stations[first] * (1.0 - part) + stations[first + 1] * part
    return jnp.concatenate([heights, stations[-1:]])


def shaft_matrices(shaft: Shaft, body: BeamBody | None = None) -> ShaftMatrices:
    """Assemble the beams of a shaft, without its bearings.

    **Arguments:**

    - `shaft`: the shaft.
    - `body`: of its gear, where that is a beam. A shear coefficient given for the shaft holds for
        the body too.

    **Returns:**

    The matrices, nodes from left to right.

    **Raises:**

    - `ValueError` if two points have changed places since the layout was settled, or if a body
        is smaller than the hole in its shaft.
    """
    layout = shaft.layout
    count, last = layout.count, layout.count - 1
    cuts = np.asarray(layout.cuts)
    segment = np.repeat(np.asarray(layout.segments), cuts)
    inner = jnp.stack([s.inner for s in shaft.segments])[segment]
    outer = jnp.stack([s.outer for s in shaft.segments])[segment]
    steel = [shaft.material.young, shaft.material.poisson, shaft.material.density]
    young, poisson, density = (jnp.broadcast_to(x, (last,)) for x in steel)
    if body is not None and layout.body is not None:
        at = int(cuts[: layout.body].sum())
        require(
            body.outer > inner[at],
            "`BeamBody.outer` must exceed the shaft's inner diameter there, {inner:.6g} m, got "
            "{got:.6g} m. It is the diameter of the root circle.",
            inner=inner[at],
            got=body.outer,
        )
        outer = outer.at[at].set(body.outer)
        young = young.at[at].set(body.material.young)
        poisson = poisson.at[at].set(body.material.poisson)
        density = density.at[at].set(body.material.density)
    shear = (
        cowper_coefficient(outer, inner, poisson)
        if shaft.shear_coefficient is None
        else jnp.broadcast_to(shaft.shear_coefficient, (last,))
    )
    length = jnp.diff(node_heights(shaft, body))
    elements = jax.vmap(_element)(length, outer, inner, shear, young, poisson, density)
    dofs = 6 * np.arange(last)[:, None] + np.arange(12)
    rows, columns = dofs[:, :, None], dofs[:, None, :]
    # One scatter for the three, with the matrix as last axis.
    whole = jnp.zeros((6 * count, 6 * count, 3)).at[rows, columns].add(elements)
    return ShaftMatrices(whole[..., 0], whole[..., 1], whole[..., 2])


def _element(
    length: Scalar,
    outer: Scalar,
    inner: Scalar,
    shear: Scalar,
    young: Scalar,
    poisson: Scalar,
    density: Scalar,
) -> Float[Array, "12 12 3"]:
    """Stiffness, mass and gyroscopic matrix of one element."""
    beam = Beam(length, outer, inner, shear, Material(young, poisson, density))
    return jnp.stack([beam_stiffness(beam), beam_mass(beam), beam_gyroscopic(beam)], axis=-1)


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
    plain, width = jax.tree.map(np.asarray, (shaft, body_width))
    return {name: float(height) for name, height in _places(plain, width).items()}


def _is_traced(*trees: object) -> bool:
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


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
    if _is_traced(shaft.segments, shaft.bearings, shaft.gear_at, shaft.torque_at, shaft.loads):
        return
    places = _plain_places(shaft, None)
    end = places["right end"]
    for name, height in places.items():
        require(
            -_SAME_PLACE <= height <= end + _SAME_PLACE,
            "The {name} of a shaft must lie on it, between 0 and {end:.6g} m from its left end, "
            "got {got:.6g} m. Move it, or lengthen the shaft.",
            name=name,
            end=end,
            got=height,
        )


def _settled_layout(shaft: Shaft, body_width: object, divisions: int) -> ShaftLayout:
    """Sort the points of a shaft along it, and let those that coincide share a node."""
    require(
        divisions >= 1,
        "A stretch of shaft must have at least one element, got {got} divisions.",
        got=divisions,
    )
    width = as_optional_scalar(body_width)
    if _is_traced(shaft, width):
        raise InputError(
            "A shaft cannot be laid out from numbers that JAX traces. Build it once from plain "
            "numbers, outside of `jit` and `grad`, and hand its layout in: `layout=built.layout`."
        )
    heights = _plain_places(shaft, width)
    if width is not None:
        _check_face(heights, float(shaft.gear_at))
    # A stable sort keeps the order of `_places`, by which stations are owned, within a place.
    names = sorted(heights, key=lambda name: heights[name])
    stations: list[list[str]] = []
    for name in names:
        apart = not stations or heights[name] - heights[stations[-1][-1]] > _SAME_PLACE
        stations.append([name]) if apart else stations[-1].append(name)
    order = list(heights)
    owners = tuple(min(station, key=order.index) for station in stations)
    middle = np.asarray([heights[owner] for owner in owners])
    middle = 0.5 * (middle[:-1] + middle[1:])
    ends = np.cumsum([float(segment.length) for segment in shaft.segments])
    segments = tuple(int(np.searchsorted(ends[:-1], height)) for height in middle)
    body = None
    if width is not None:
        body = next(i for i, station in enumerate(stations) if "gear left" in station)
    layout = ShaftLayout(owners, segments, (), divisions, body)
    nodes = np.concatenate([[0], np.cumsum(layout.cuts)])
    places = [(name, int(nodes[i])) for i, names in enumerate(stations) for name in names]
    if shaft.torque_at is None and body is None:
        places.append(("torque", dict(places)["gear"]))
    return ShaftLayout(owners, segments, tuple(places), divisions, body)


def _check_face(heights: dict[str, float], gear_at: float) -> None:
    """Refuse a beam body that is not on the shaft or has something within its face.

    A torque at mid-face is given to both ends of the body, and then needs no place of its own.
    """
    if abs(heights.get("torque", np.inf) - gear_at) <= _SAME_PLACE:
        del heights["torque"]
    left, right, end = heights["gear left"], heights["gear right"], heights["right end"]
    require(
        -_SAME_PLACE <= left < right <= end + _SAME_PLACE,
        "The face of a gear whose body is a beam must lie on its shaft, between 0 and {end:.6g} m, "
        "got {left:.6g} to {right:.6g} m. Move the gear, or lengthen the shaft.",
        end=end,
        left=left,
        right=right,
    )
    for name, height in heights.items():
        require(
            not left + _SAME_PLACE < height < right - _SAME_PLACE,
            "A gear body that is a beam must have nothing between the ends of its face, {left:.6g} "
            "to {right:.6g} m, but the {name} is at {got:.6g} m. Move it to an end of the face, or "
            "make the body rigid.",
            name=name,
            left=left,
            right=right,
            got=height,
        )
