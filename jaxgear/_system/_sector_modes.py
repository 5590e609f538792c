"""Modes of a body of equal sectors, wave by wave.

A turn by one sector leaves such a body as it is. Motions that it only shifts in phase, by the angle
of a sector times a wave number, do not mix with others: stiffness and mass fall apart into a small
matrix for each wave number, of one sector's size (cyclic symmetry, Thomas 1979). Complex motions of
a wave are pairs of real ones, a quarter of a wave apart.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from jaxgear._checks import require
from jaxgear._system._condensed import Condensed

# What rounding may leave of a symmetry, and so many motions tell.
_EVEN, _TRIALS = 1e-4, 4


@dataclass(frozen=True)
class _SectorTurn:
    """A turn of a body by one of its sectors.

    **Fields:**

    - `turn`: of a vector, `[3, 3]`.
    - `image`: where each rim node comes to lie, `[rim]`.
    - `action`: on the kept combinations of interior shapes, `[kept, kept]`.
    - `kept`: combinations of interior shapes that turn among themselves, `[interior, kept]`.
    """

    turn: np.ndarray
    image: np.ndarray
    action: np.ndarray
    kept: np.ndarray


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


def _sector_turn(body: Condensed, sectors: int) -> _SectorTurn:
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
    alone = _SectorTurn(turn, image, none, none)
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
    return replace(alone, action=among.T @ whole @ among, kept=kept)


class SectorMotions:
    r"""The inner motions of a body, all but those of its seats, by wave number.

    Those of wave number $d$ are $e^{ids\alpha}R^s u$ on sector $s$, $\alpha$ the angle of a sector
    and $R$ a turn by it, $u$ the motion of the first one's nodes; and such combinations of interior
    shapes. A turn by one sector multiplies them by $e^{-id\alpha}$.

    **Fields:**

    - `orbits`: rim nodes, each with those that turns take it to, `[node, sector]`.
    - `turns`: of a vector by so many sectors, `[sector, 3, 3]`.
    - `shapes`: interior shapes of each wave number, `[interior, shape]`.
    """

    def __init__(self, body: Condensed, sectors: int):
        turn = _sector_turn(body, sectors)
        self.name, self.sectors, self.rim = body.name, sectors, 3 * len(turn.image)
        places = [np.arange(len(turn.image))]
        turns = [np.eye(3)]
        for _ in range(sectors - 1):
            places.append(turn.image[places[-1]])
            turns.append(turn.turn @ turns[-1])
        every = np.stack(places, axis=1)
        self.orbits = every[every.min(axis=1) == every[:, 0]]
        self.turns = np.stack(turns)
        self.shapes = [turn.kept @ each for each in _of_waves(turn.action, sectors)]
        self.start, self.size = self.rim + 6 * len(body.seats), len(body.stiffness)
        for what in ("stiffness", "mass", "coriolis", "spin_softening", "stress_stiffening"):
            matrix = getattr(body, what)
            if matrix is not None:
                self._require_even(matrix[: self.rim, : self.rim], turn, what.replace("_", " "))
        self.stiffness, self.mass = self._blocks(body.stiffness), self._blocks(body.mass)

    def _require_even(self, matrix: np.ndarray, turn: _SectorTurn, what: str) -> None:
        # Turned before the matrix acts or after it: motions of one or minus one everywhere show
        # what a single number is off, and take a thousandth of what turning the matrix does.
        motion = np.random.default_rng(0).choice([-1.0, 1.0], (self.rim, _TRIALS))
        turned = lambda values: _moved(values, turn.turn, turn.image)
        before, after = np.split(matrix @ np.hstack([turned(motion), motion]), 2, axis=1)
        # Zeros everywhere are even too: some bodies have no stress that stiffens them.
        largest = max(matrix.max(), -matrix.min()) or 1.0
        uneven = float(np.abs(before - turned(after)).max() / largest)
        require(
            uneven <= _EVEN,
            "The condensed body {name!r} is not of {sectors} equal sectors: turned by one, its "
            "{what} on the rim differs by {uneven:.3g} of its largest.",
            name=self.name,
            sectors=self.sectors,
            what=what,
            uneven=uneven,
        )

    def _blocks(self, matrix: np.ndarray) -> list[np.ndarray]:
        """A symmetric matrix of the body, for each wave number."""
        axes = np.arange(3)
        first = (3 * self.orbits[:, :1] + axes).ravel()
        columns = (3 * self.orbits.T[:, :, None] + axes).ravel()
        rows = matrix[np.ix_(first, columns)].reshape(len(first), self.sectors, -1, 3)
        rows = np.einsum("asok,skc->saoc", rows, self.turns).reshape(self.sectors, len(first), -1)
        on_rim = np.fft.ifft(rows, axis=0) * self.sectors
        blocks = []
        for number, shapes in enumerate(self.shapes):
            joined = math.sqrt(self.sectors) * (matrix[first, self.start :] @ shapes)
            inside = shapes.conj().T @ (matrix[self.start :, self.start :] @ shapes)
            block = np.block([[on_rim[number], joined], [joined.conj().T, inside]])
            block = 0.5 * (block + block.conj().T)
            blocks.append(np.real(block) if self.alone(number) else block)
        return blocks

    @property
    def times(self) -> np.ndarray:
        """For how many coordinates each stands: one sector's rim nodes for those of all, `[dof]`.

        Interior shapes stand for themselves, seats for nothing.
        """
        found = np.zeros(self.size)
        found[: self.rim].reshape(-1, 3)[self.orbits[:, 0]] = self.sectors
        found[self.start :] = 1.0
        return found

    def alone(self, number: int) -> bool:
        """Whether motions of a wave number are real, and have no second a quarter wave apart."""
        return number == 0 or 2 * number == self.sectors

    def of_load(self, load: np.ndarray, number: int) -> np.ndarray:
        """A load on all coordinates that has one wave number alone, on its motions."""
        on_rim = load[: self.rim].reshape(-1, 3)[self.orbits[:, 0]].ravel()
        inside = self.shapes[number].conj().T @ load[self.start :]
        return np.concatenate([math.sqrt(self.sectors) * on_rim, inside])

    def whole(self, motions: np.ndarray, number: int) -> np.ndarray:
        """Motions of a wave number on all coordinates, `[dof, motion]`; the seats stand still."""
        count = motions.shape[1]
        rim = 3 * len(self.orbits)
        phase = np.exp(2j * math.pi * number / self.sectors * np.arange(self.sectors))
        own = motions[:rim].reshape(-1, 3, count) / math.sqrt(self.sectors)
        found = np.zeros((self.start + len(self.shapes[number]), count), dtype=complex)
        nodes = found[: self.rim].reshape(-1, 3, count)
        turned = phase[:, None, None] * self.turns
        for sector in range(self.sectors):
            nodes[self.orbits[:, sector]] = np.einsum("ck,okm->ocm", turned[sector], own)
        found[self.start :] = self.shapes[number] @ motions[rim:]
        return found

    def modes(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lowest modes with the seats held, of unit modal mass.

        **Arguments:**

        - `count`: number of modes; 0 are all. A pair is never parted.

        **Returns:**

        Squares of their angular frequencies, rising; shapes `[dof, mode]`; wave numbers, negative
        for the second of a pair.
        """
        solved = [scipy.linalg.eigh(*each) for each in zip(self.stiffness, self.mass, strict=True)]
        every = sorted(
            (float(square), number, place)
            for number, (squares, _) in enumerate(solved)
            for place, square in enumerate(squares)
        )
        if count:
            sizes = np.cumsum([1 if self.alone(number) else 2 for _, number, _ in every])
            every = every[: int(np.searchsorted(sizes, count, side="right"))]
        sizes = [1 if self.alone(number) else 2 for _, number, _ in every]
        place = np.concatenate([[0], np.cumsum(sizes)])
        squares = np.repeat([square for square, _, _ in every], sizes)
        found, waves = np.empty((self.size, place[-1])), np.empty(place[-1], dtype=int)
        # One wave at a time: all of them at once would be as many complex numbers again.
        of_wave = np.array([number for _, number, _ in every])
        for number in map(int, np.unique(of_wave)):
            own = place[np.flatnonzero(of_wave == number)]
            motion = self.whole(solved[number][1][:, : len(own)], number)
            parts = [np.real(motion)] if self.alone(number) else [np.real(motion), np.imag(motion)]
            for second, part in enumerate(parts):
                found[:, own + second] = math.sqrt(len(parts)) * part
                waves[own + second] = -number if second else number
        return squares, found, waves

    def following(self, stiffness: np.ndarray, seats: int) -> np.ndarray:
        """Static motion of all coordinates with each of the seats', `[dof, 6 seat]`."""
        moved = np.zeros((len(stiffness), 6 * seats))
        moved[self.rim : self.start] = np.eye(6 * seats)
        for first in range(self.rim, self.start, 3):
            # Across the axis: of wave number 1. Along it: of 0.
            for number, motion in ((1, [1.0, 1.0j, 0.0]), (0, [0.0, 0.0, 1.0])):
                load = stiffness[:, first : first + 3] @ np.array(motion)
                held = np.linalg.solve(self.stiffness[number], -self.of_load(load, number))
                whole = self.whole(held[:, None], number)[:, 0]
                column = first - self.rim
                if number == 1:
                    moved[:, column] += np.real(whole)
                    moved[:, column + 1] += np.imag(whole)
                else:
                    moved[:, column + 2] += np.real(whole)
        return moved


def _of_waves(action: np.ndarray, sectors: int) -> list[np.ndarray]:
    """Combinations of each wave number, of what turns among itself by `action`."""
    size, found = len(action), []
    if not size:
        return [np.zeros((0, 0))] * (sectors // 2 + 1)
    powers = [np.eye(size)]
    for _ in range(sectors - 1):
        powers.append(action @ powers[-1])
    for number in range(sectors // 2 + 1):
        phase = np.exp(2j * math.pi * number / sectors * np.arange(sectors))
        part = np.einsum("s,sij->ij", phase, np.stack(powers)) / sectors
        if number == 0 or 2 * number == sectors:
            part = np.real(part)
        vectors, sizes, _ = np.linalg.svd(part)
        found.append(vectors[:, sizes > 0.5])
    return found


def nodal_diameters(nodes: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Number of nodal diameters that each mode shows most of on the rim."""
    angle = np.arctan2(nodes[:, 1], nodes[:, 0])
    motion = shapes.reshape(len(nodes), 3, -1)
    x, y, z = np.moveaxis(motion, 1, 0)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    parts = c * x + s * y, c * y - s * x, z
    around = len(np.unique(np.round(angle * 1e6)))
    waves = np.exp(-1j * np.outer(np.arange(around // 2 + 1), angle))
    return np.argmax(sum(np.abs(waves @ part) ** 2 for part in parts), axis=0)
