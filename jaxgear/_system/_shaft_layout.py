"""Which points of a shaft share a node, and in which order they lie along it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxgear._checks import require

# Points closer than this share a node [m].
SAME_PLACE = 1e-9


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


def settled_layout(
    heights: dict[str, float],
    lengths: Sequence[float],
    *,
    gear_at: float,
    with_body: bool,
    divisions: int,
) -> ShaftLayout:
    """Sort the points of a shaft along it, and let those that coincide share a node.

    **Arguments:**

    - `heights`: of every named point, those that own a station first [m].
    - `lengths`: of the segments [m].
    - `gear_at`: height of the gear's mid-face [m].
    - `with_body`: whether a beam body fills the face, between "gear left" and "gear right".
    - `divisions`: elements between two stations [-].

    **Returns:**

    The layout.

    **Raises:**

    - `InputError` if something lies within the face of a beam body.
    """
    at_gear = "torque" not in heights and not with_body
    if with_body:
        _check_face(heights, gear_at)
    # A stable sort keeps the order of `_places`, by which stations are owned, within a place.
    names = sorted(heights, key=lambda name: heights[name])
    stations: list[list[str]] = []
    for name in names:
        apart = not stations or heights[name] - heights[stations[-1][-1]] > SAME_PLACE
        stations.append([name]) if apart else stations[-1].append(name)
    order = list(heights)
    owners = tuple(min(station, key=order.index) for station in stations)
    middle = np.asarray([heights[owner] for owner in owners])
    middle = 0.5 * (middle[:-1] + middle[1:])
    ends = np.cumsum(lengths)
    segments = tuple(int(np.searchsorted(ends[:-1], height)) for height in middle)
    body = None
    if with_body:
        body = next(i for i, station in enumerate(stations) if "gear left" in station)
    layout = ShaftLayout(owners, segments, (), divisions, body)
    nodes = np.concatenate([[0], np.cumsum(layout.cuts)])
    places = [(name, int(nodes[i])) for i, names in enumerate(stations) for name in names]
    if at_gear:
        places.append(("torque", dict(places)["gear"]))
    return ShaftLayout(owners, segments, tuple(places), divisions, body)


def _check_face(heights: dict[str, float], gear_at: float) -> None:
    """Refuse a beam body that is not on the shaft or has something within its face.

    A torque at mid-face is given to both ends of the body, and then needs no place of its own.
    """
    if abs(heights.get("torque", np.inf) - gear_at) <= SAME_PLACE:
        del heights["torque"]
    left, right, end = heights["gear left"], heights["gear right"], heights["right end"]
    require(
        -SAME_PLACE <= left < right <= end + SAME_PLACE,
        "The face of a gear whose body is a beam must lie on its shaft, between 0 and {end:.6g} m, "
        "got {left:.6g} to {right:.6g} m. Move the gear, or lengthen the shaft.",
        end=end,
        left=left,
        right=right,
    )
    for name, height in heights.items():
        require(
            not left + SAME_PLACE < height < right - SAME_PLACE,
            "A gear body that is a beam must have nothing between the ends of its face, {left:.6g} "
            "to {right:.6g} m, but the {name} is at {got:.6g} m. Move it to an end of the face, or "
            "make the body rigid.",
            name=name,
            left=left,
            right=right,
            got=height,
        )
