"""Gauges on condensed bodies, and probes beside them: where they are, and what they show."""

import dataclasses
from collections.abc import Collection, Iterator, Sequence
from typing import TypeVar

import numpy as np

from fem_prep import ReducedBody
from jaxgear._checks import require
from jaxgear._response._body_motion import rotating_spectrum
from jaxgear._response._spectrum import Spectrum
from jaxgear._response._waves import (
    DIRECTIONS,
    BodyMotion,
    Circle,
    along_directions,
    circle_around,
    fixed_spectrum,
    seen_passing,
)
from jaxgear._units import deg, mm
from jaxgear.scene._tables import GaugeKeys, ProbeKeys
from jaxgear.study._hybrid import radius_of
from jaxgear.study._moving_body import SAME_CIRCLE, MovingBody, angle_of

Asked = TypeVar("Asked", ProbeKeys, GaugeKeys)

# A probe may be so far from where it was asked for, over the radius.
_OFF = 0.05


@dataclasses.dataclass(frozen=True)
class Probe:
    """A gauge on a body, or a probe beside it that sees it pass.

    **Fields:**

    - `name`: in results.
    - `gear`: `pinion` or `wheel`.
    - `direction`: that is read: 0 radial, 1 tangential, 2 axial.
    - `turns`: whether it turns with the body.
    - `angle`: of a fixed probe about Z, from S [rad].
    - `place`: radius, angle and height of the node or the circle [m, rad, m].
    - `angles`: of its node or those of its circle, about Z from the body's x, `[node]` [rad].
    - `coordinates`: what it reads of each per coordinate of the condensed body, `[node, dof]`
        [-, m].
    """

    name: str
    gear: str
    direction: int
    turns: bool
    angle: float
    place: tuple[float, float, float]
    angles: np.ndarray
    coordinates: np.ndarray

    def looking_at(self, rows: np.ndarray) -> Circle:
        """What it looks at: its circle, or its own node alone.

        **Arguments:**

        - `rows`: what it reads of each node per coordinate of a motion, shape
            `[node, coordinate]`.
        """
        if self.turns:
            return Circle(np.zeros(1, dtype=int), rows[:, None])
        return circle_around(self.angles, rows[:, None])

    def spectrum(self, motion: BodyMotion, circle: Circle) -> Spectrum:
        """What it shows of a motion, by orders of the gear's rotation, shape `[order]` [m].

        **Arguments:**

        - `motion`: of the body.
        - `circle`: from `looking_at`, by the coordinates of that motion.
        """
        if self.turns:
            found = rotating_spectrum(motion, circle.rows[0])
        else:
            found = fixed_spectrum(motion, circle, self.angle)
        return Spectrum(found.order, found.amplitude[:, 0])

    def shown(self, readings: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """What it shows of what its nodes do, as of `Gauge.shown`; of `[step, node]`, `[step]`."""
        if self.turns:
            return readings[:, 0]
        return seen_passing(self.angles, self.angle, readings, turn)


def probes_of(
    asked: Sequence[ProbeKeys], condensed: Collection[str], body: MovingBody
) -> tuple[Probe, ...]:
    """The probes that look at a body: those of the scene's [[probes]], or else the usual four.

    **Raises:**

    - `ValueError` if a probe is where there is no node, or its gear is not condensed.
    """
    rows = on_gear("probes", asked, condensed, body.gear, "waves")
    return tuple(_probe(row, each, body) for row, each in rows) or tuple(_usual(body))


def on_gear(
    table: str, asked: Sequence[Asked], condensed: Collection[str], gear: str, read: str
) -> Iterator[tuple[str, Asked]]:
    """Rows of a table that look at a gear's body, each with its path in the scene.

    **Raises:**

    - `ValueError` if a row looks at a gear that is not condensed: there is nothing to read.
    """
    for number, each in enumerate(asked):
        row = f"{table}[{number}]"
        require(
            each.gear in condensed,
            "{row}.gear: the body of the {gear} is not condensed, so there are no {read} in it.",
            row=row,
            gear=each.gear,
            read=read,
        )
        if each.gear == gear:
            yield row, each


def _probe(row: str, asked: ProbeKeys, body: MovingBody) -> Probe:
    direction, turns = DIRECTIONS.index(asked.direction), asked.frame == "rotating"
    if asked.node is not None:
        name = asked.name or asked.node
        return _condensed_probe(row, body, asked.node, direction, turns, name)
    radius = body.radius if asked.radius_mm is None else asked.radius_mm * mm
    where = f"{body.gear} r {radius / mm:.4g} mm {asked.direction} {asked.frame}"
    place = radius, asked.angle_deg * deg, asked.height_mm * mm
    return probe_at(body, place, direction, turns=turns, name=asked.name or where, key=row)


def _condensed_probe(
    row: str, body: MovingBody, node: str, direction: int, turns: bool, name: str
) -> Probe:
    known = body.built.body.probes
    require(
        node in known,
        "{row}.node: no node {node!r} was condensed with the body of the {gear}, which has "
        "{known}. Give the place of the probe instead: radius_mm, angle_deg, height_mm.",
        row=row,
        node=node,
        gear=body.gear,
        known=", ".join(map(repr, known)) or "none",
    )
    require(
        turns,
        '{row}.frame: a condensed node turns with the body, got "fixed". Give the place of the '
        "probe instead, so that it can see what passes.",
        row=row,
    )
    number = known.index(node)
    place = body.built.body.probe_points[number]
    rows = body.built.body.probe_rows[number][None]
    return _gauge(name, body, direction, place, rows)


def _gauge(
    name: str, body: MovingBody, direction: int, place: np.ndarray, rows: np.ndarray
) -> Probe:
    """What turns with a body, of rows along x, y, z per coordinate of it."""
    where = _where(place)
    angles = np.array([where[1]])
    found = along_directions(angles, rows)[:, direction]
    return Probe(name, body.gear, direction, True, 0.0, where, angles, found)


def _where(place: np.ndarray) -> tuple[float, float, float]:
    """Radius, angle and height of a place [m, rad, m]."""
    return float(radius_of(place[None])[0]), float(angle_of(place[None])[0]), float(place[2])


def probe_at(
    body: MovingBody,
    place: tuple[float, float, float],
    direction: int,
    *,
    turns: bool,
    name: str,
    key: str = "probe",
) -> Probe:
    """A probe at the node, or the circle of nodes, that is nearest to a place.

    The angle of one that turns is from the body's x, of one that stands still from S; radius,
    angle and height [m, rad, m]. Messages name it by its key.

    **Raises:**

    - `ValueError` if no node is near, or the nodes there are no circle.
    """
    at = nodes_at(body.built.body, body.gear, place, turns=turns, key=key)
    where = _where(body.nodes[at[0]])
    rows = body.coordinate_rows(at)
    if turns:
        return _gauge(name, body, direction, body.nodes[at[0]], rows)
    angles = angle_of(body.nodes[at])
    try:
        circle_around(angles, np.zeros((len(at), 0)))
    except ValueError as error:
        raise type(error)(f"{key}: a fixed probe sees a circle of nodes pass. {error}") from None
    own, looks = along_directions(angles, rows)[:, direction], (where[0], place[1], where[2])
    return Probe(name, body.gear, direction, False, place[1], looks, angles, own)


def nodes_at(
    body: ReducedBody,
    gear: str,
    place: tuple[float, float, float],
    *,
    turns: bool,
    key: str,
) -> np.ndarray:
    """The node of a body that is nearest to a place, or all nodes of the circle of the nearest.

    Radius, angle and height [m, rad, m]; the first one is the nearest.

    **Raises:**

    - `ValueError` if no node is near; the message names the place by its key.
    """
    radius, angle, height = place
    nodes = body.nodes if len(body.nodes) else body.rim_nodes
    size = float(np.median(radius_of(body.rim_nodes)))
    off = np.hypot(radius_of(nodes) - radius, nodes[:, 2] - height)
    around = np.abs(np.mod(angle_of(nodes) - angle + np.pi, 2.0 * np.pi) - np.pi) if turns else 0.0
    apart = np.hypot(off, radius * around)
    nearest = int(np.argmin(apart))
    where = _where(nodes[nearest])
    require(
        float(apart[nearest]) <= _OFF * size,
        "{key}: no node of the {gear}'s body is near radius {radius:.4g} mm, height {height:.4g} "
        "mm{angle}: the nearest is at radius {r:.4g} mm, height {h:.4g} mm, {a:.4g} degrees.{only}",
        key=key,
        gear=gear,
        radius=radius / mm,
        height=height / mm,
        angle=f", {angle / deg:.4g} degrees" if turns else "",
        r=where[0] / mm,
        h=where[2] / mm,
        a=where[1] / deg,
        only="" if len(body.nodes) else " Of a body without a grid only the rim is known.",
    )
    if turns:
        return np.array([nearest])
    same = np.hypot(radius_of(nodes) - where[0], nodes[:, 2] - where[2])
    chosen = np.flatnonzero(same <= SAME_CIRCLE * size)
    return np.r_[nearest, chosen[chosen != nearest]]


def _usual(body: MovingBody) -> list[Probe]:
    """Where a scene asks for nothing: at the end of the rim, a quarter of a turn from the mesh."""
    end = float(body.built.body.rim_nodes[:, 2].min())
    found = []
    for turns, direction in ((True, 2), (True, 0), (False, 2), (False, 0)):
        name = f"rim {DIRECTIONS[direction]} {'rotating' if turns else 'fixed'}"
        place = (body.radius, 0.0 if turns else 0.5 * np.pi, end)
        found.append(probe_at(body, place, direction, turns=turns, name=name))
    return found
