"""Where condensed bodies are held, driven and loaded: bearings, torque, loads of the shaft."""

import dataclasses
from typing import NamedTuple

import numpy as np

from fem_prep import GearBody, SeatPlace
from jaxgear._units import mm
from jaxgear.scene._gear_tables import GearKeys

# Of the diameter there: how much of a shaft a bearing holds, if nobody says.
_SEAT_WIDTH = 1.0 / 3.0
# Of the distance between two seats: what they may fill.
_NO_WIDER = 0.8


@dataclasses.dataclass(frozen=True)
class PlannedSeat:
    """Where a body will be held, driven or loaded.

    **Fields:**

    - `name`: `bearing[0]` and so on, `load[0]` and so on, `torque`, or `gear` for a body without a
        shaft.
    - `label`: of the set of nodes: of a drawn body as its grid names it, else as the user does.
    - `at`: z of the seat's own node, on the axis [m].
    - `averaging`: whether the node moves as the mean of the set, which stiffens nothing.
    """

    name: str
    label: str
    at: float
    averaging: bool


class Seats(NamedTuple):
    """The seats of a body.

    **Fields:**

    - `all`: of them.
    - `torque`: name of that where the torque enters or leaves.
    - `loads`: name of that of each load of the shaft, then of each unbalance.
    """

    all: tuple[PlannedSeat, ...]
    torque: str
    loads: tuple[str, ...]


def seat_places(gear: GearKeys, body: GearBody) -> tuple[SeatPlace, ...]:
    """Where bearings hold a shaft, and places of their own where loads and the torque act.

    **Arguments:**

    - `gear`: with a shaft.
    - `body`: as drawn.
    """
    given, torque = gear.body.seat_width_mm, gear.shaft.torque_at_mm
    at = [bearing.at_mm * mm for bearing in gear.shaft.bearings]
    seats = [
        SeatPlace(f"bearing[{i}]", place, _width(body, at, place) if given is None else given * mm)
        for i, place in enumerate(at)
    ]
    # Where the torque leaves by a gear of the next stage, loads act too: they have the seat.
    others = [(f"load[{i}]", at) for i, at in enumerate(gear.shaft.loaded_at_mm)]
    others += [] if torque is None else [("torque", torque)]
    for name, place in others:
        gap = min(abs(place * mm - seat.at) - 0.5 * seat.width for seat in seats)
        if _under_gear(body, place * mm - body.gear_at) or gap <= 1e-3 * body.rim_outer:
            continue
        width = min(_width(body, [], place * mm), 2.0 * _NO_WIDER * gap)
        seats.append(SeatPlace(name, place * mm, width))
    return tuple(seats)


def drawn_seats(gear: GearKeys, body: GearBody, soft: bool) -> Seats:
    """Seats of a drawn body.

    **Arguments:**

    - `gear`: its keys.
    - `body`: as drawn, with `seat_places`.
    - `soft`: whether what carries a torque or a load moves as the mean of its nodes.
    """
    averaging = gear.body.seat_coupling == "averaging"
    if not body.segments:
        if body.bore:
            return Seats((PlannedSeat("gear", "bore", 0.0, averaging),), "gear", ())
        # Of a body without a bore the innermost elements, whose size is no measure of anything.
        return Seats((PlannedSeat("gear", "gear", 0.0, averaging or soft),), "gear", ())
    seats = {
        place.name: PlannedSeat(
            place.name,
            place.name,
            place.at - body.gear_at,
            averaging if place.name.startswith("bearing") else soft,
        )
        for place in body.seats
    }
    # Under the gear it is the nodes inside of the hub, for one of all that act there.
    for name, at in _asked(gear).items():
        taken = any(seat.label == "gear" for seat in seats.values())
        if name not in seats and not taken and _under_gear(body, at):
            seats[name] = PlannedSeat(name, "gear", at, soft)
    return _with_nearest(gear, seats)


def named_seats(gear: GearKeys, soft: bool) -> Seats:
    """Seats of a grid of the user's own, by the names of its sets.

    **Arguments:**

    - `gear`: its keys.
    - `soft`: whether what carries a torque or a load moves as the mean of its nodes.
    """
    body, shaft = gear.body, gear.shaft
    averaging, sets = body.seat_coupling == "averaging", body.seats or []
    if not shaft.bearings:
        return Seats((PlannedSeat("gear", sets[0], 0.0, averaging),), "gear", ())
    seats = {}
    for i, (bearing, label) in enumerate(zip(shaft.bearings, sets, strict=True)):
        at = (bearing.at_mm - shaft.gear_at_mm) * mm
        seats[f"bearing[{i}]"] = PlannedSeat(f"bearing[{i}]", label, at, averaging)
    labels = {f"load[{i}]": label for i, label in enumerate(body.load_sets or [])}
    labels |= {"torque": body.torque_set} if body.torque_set else {}
    for name, at in _asked(gear).items():
        if name in labels:
            seats[name] = PlannedSeat(name, labels[name], at, soft)
    return _with_nearest(gear, seats)


def _asked(gear: GearKeys) -> dict[str, float]:
    """Names and heights from mid-face [m] of what acts on a shaft beside its bearings.

    The torque comes first: of two that act at one place it has the seat.
    """
    origin, torque = gear.shaft.gear_at_mm, gear.shaft.torque_at_mm
    places = {"torque": origin if torque is None else torque}
    places |= {f"load[{i}]": at for i, at in enumerate(gear.shaft.loaded_at_mm)}
    return {name: (at - origin) * mm for name, at in places.items()}


def _with_nearest(gear: GearKeys, seats: dict[str, PlannedSeat]) -> Seats:
    """Seats, and for what has none of its own the nearest."""
    found = tuple(seats.values())
    taken = {
        name: name if name in seats else min(found, key=lambda seat, at=at: abs(seat.at - at)).name
        for name, at in _asked(gear).items()
    }
    torque = taken.pop("torque")
    return Seats(found, torque, tuple(taken.values()))


def _under_gear(body: GearBody, at: float) -> bool:
    """Whether a height from mid-face is within the hub."""
    return abs(at) <= 0.5 * body.hub_width


def _width(body: GearBody, others: list[float], at: float) -> float:
    """Length of the seat of a bearing: by the shaft's diameter, or as its neighbours allow."""
    ends = np.cumsum([segment.length for segment in body.segments])
    here = min(int(np.searchsorted(ends, at)), len(body.segments) - 1)
    width = _SEAT_WIDTH * body.segments[here].outer
    apart = [abs(other - at) for other in others if other != at]
    return min([width, *(_NO_WIDER * each for each in apart)])
