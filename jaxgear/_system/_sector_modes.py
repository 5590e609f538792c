"""Modes of a body of equal sectors: their pairs, waves and nodal diameters."""

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from jaxgear._checks import InputError, require
from jaxgear._system._condensed import Condensed

# Squared frequencies closer than this, relatively, belong to one pair; a pair apart by more is
# that of an uneven body.
PAIR = 1e-5

# What rounding may leave of a symmetry.
_EVEN = 1e-4


@dataclass(frozen=True)
class _SectorTurn:
    """A turn of a body by one of its sectors.

    **Fields:**

    - `turn`: of a vector, `[3, 3]`.
    - `image`: where each rim node comes to lie, `[rim]`.
    - `action`: on the interior shapes, `[interior, interior]`.
    - `first`: first of their coordinates.
    - `kept`: combinations of interior shapes that turn among themselves, `[interior, kept]`.
    """

    turn: np.ndarray
    image: np.ndarray
    action: np.ndarray
    first: int
    kept: np.ndarray

    def of(self, shapes: np.ndarray) -> np.ndarray:
        """Motions of the turned body, seats left out."""
        result = np.zeros_like(shapes)
        rim = 3 * len(self.image)
        result[:rim] = self.on_rim(shapes[:rim])
        result[self.first :] = self.action @ shapes[self.first :]
        return result

    def on_rim(self, motion: np.ndarray) -> np.ndarray:
        """The same of the rim alone."""
        return _moved(motion, self.turn, self.image)


def _moved(motion: np.ndarray, turn: np.ndarray, image: np.ndarray) -> np.ndarray:
    """A motion of nodes, `[3 node, column]`, turned with them to where they come to lie."""
    moved = np.empty((len(image), 3, motion.shape[1]))
    moved[image] = np.einsum("ij,njc->nic", turn, motion.reshape(len(image), 3, -1))
    return moved.reshape(motion.shape)


def _image(nodes: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, float]:
    """Where each node comes to lie, and how far from there at most, over the radius."""
    tree = scipy.spatial.KDTree(nodes)
    distance, image = (np.asarray(each) for each in tree.query(nodes @ turn.T))
    apart = float(distance.max()) / float(np.hypot(nodes[:, 0], nodes[:, 1]).max())
    return image, apart if len(np.unique(image)) == len(nodes) else math.inf


def sector_turn(body: Condensed, sectors: int) -> _SectorTurn:
    """What a turn by one sector makes of the coordinates of a body."""
    angle = 2.0 * math.pi / sectors
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    nodes = body.rim_nodes
    image, apart = _image(nodes, turn)
    require(
        apart <= 1e-6,
        "The rim nodes of {name!r} must repeat after one of its {sectors} sectors, got {got:.3g} "
        "of the radius between them.",
        name=body.name,
        sectors=sectors,
        got=apart,
    )
    first = 3 * len(nodes) + 6 * len(body.seats)
    none = np.zeros((0, 0))
    alone = _SectorTurn(turn, image, none, first, none)
    if first == len(body.stiffness):
        return alone
    # Interior shapes turn as the grid says or, without one, the mass between them and the rim.
    joined = body.mass[: 3 * len(nodes), first:]
    if len(body.interior_shapes):
        joined = body.interior_shapes.reshape(len(body.interior_shapes), -1).T
        image = _image(body.nodes, turn)[0]
    orthogonal, triangle = np.linalg.qr(joined / np.linalg.norm(joined, axis=0))
    triangle = triangle * np.linalg.norm(joined, axis=0)
    whole = orthogonal.T @ _moved(orthogonal, turn, image)
    # Where a pair was cut, shapes turn out of what is there: those that do not are kept.
    among = np.eye(len(whole))
    while among.shape[1]:
        _, sizes, stays = np.linalg.svd(among.T @ whole @ among)
        if sizes[-1] > 1.0 - _EVEN:
            break
        among = among @ stays[sizes > 1.0 - _EVEN].T
    kept = np.linalg.solve(triangle, among)
    action = kept @ (among.T @ whole @ among) @ (among.T @ triangle)
    if among.shape[1] == len(whole):
        kept = np.eye(len(whole))
    return replace(alone, action=action, kept=kept)


def in_pairs(
    square: np.ndarray, turn: np.ndarray, sectors: int, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Mix modes of one frequency so that each pair turns into itself, and name its waves."""
    size = len(square)
    starts = np.flatnonzero(np.r_[True, np.diff(square) > PAIR * square[1:]])
    angle = 2.0 * math.pi / sectors
    columns, waves = [], []
    for first, last in zip(starts, np.r_[starts[1:], size], strict=True):
        some = slice(first, last)
        own = turn[some, some]
        uneven = float(np.abs(own.T @ own - np.eye(last - first)).max())
        if uneven > _EVEN:
            if last == size:
                break
            raise InputError(
                f"The condensed body {name!r} is not of {sectors} equal sectors: turned by one, "
                f"its mode of {math.sqrt(square[first]) / (2.0 * math.pi):.5g} Hz differs by "
                f"{uneven:.3g} of itself. Keep all interior shapes of a pair."
            )
        form, vectors = scipy.linalg.schur(own, output="real")[:2]
        place = 0
        while place < last - first:
            alone = place + 1 == last - first or abs(form[place + 1, place]) < 1e-3
            chosen = vectors[:, place : place + (1 if alone else 2)]
            if alone:
                waves.append(0 if form[place, place] > 0.0 else sectors // 2)
            else:
                sine = form[place + 1, place]
                if sine < 0.0:
                    chosen = chosen * np.array([1.0, -1.0])
                number = round(math.atan2(abs(sine), form[place, place]) / angle)
                waves += [number, -number]
            block = np.zeros((size, chosen.shape[1]))
            block[some] = chosen
            columns.append(block)
            place += chosen.shape[1]
    return np.concatenate(columns, axis=1), np.array(waves)


def nodal_diameters(nodes: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Number of nodal diameters that each mode shows most of on the rim."""
    angle = np.arctan2(nodes[:, 1], nodes[:, 0])
    motion = shapes.reshape(len(nodes), 3, -1)
    x, y, z = np.moveaxis(motion, 1, 0)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    parts = c * x + s * y, c * y - s * x, z
    around = len(np.unique(np.round(angle * 1e6)))
    content = []
    for number in range(around // 2 + 1):
        wave = np.exp(-1j * number * angle)
        content.append(sum(abs(wave @ part) ** 2 for part in parts))
    return np.argmax(content, axis=0)
