"""The data of the pictures of condensed bodies, as columns with units."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fem_prep._grid import Grid, surface
from jaxgear.plot._palette import BLUE, GREEN, ORANGE, RED, SKY
from jaxgear.plot._picture import Columns

# The wedge left out of the grid's picture, on the viewer's side [rad].
_WEDGE = (-0.06 * np.pi, 0.44 * np.pi)


# A face of eight nodes as a polygon: corners and middles in turn.
_AROUND = [0, 4, 1, 5, 2, 6, 3, 7]


@dataclass(frozen=True)
class DrawnBody:
    """What of a body is drawn.

    **Fields:**

    - `grid`: with the sets `rim` and, for each seat, `seat:NAME` [m].
    - `seats`: place of each seat's own node, by name [m].
    """

    grid: Grid
    seats: Mapping[str, np.ndarray]

    @property
    def colours(self) -> dict[str, str]:
        """Colour of the rim and of every seat, by name of its set."""
        several = (ORANGE, GREEN, RED, SKY)
        seats = {f"seat:{name}": several[i % len(several)] for i, name in enumerate(self.seats)}
        return {"rim": BLUE} | {
            name: colour for name, colour in seats.items() if name in self.grid.sets
        }


def grid_columns(body: DrawnBody) -> Columns:
    """The data of `grid`: outline of every element in the section."""
    section = 1e3 * _section(body.grid)
    face = np.repeat(np.arange(len(section)), section.shape[1])
    r, z = section.reshape(-1, 2).T
    return {"element": face, "r_mm": r, "z_mm": z}


def _opened(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Outer faces with a wedge left out, and which of them the cut has laid open."""
    middle = grid.nodes[grid.bricks[:, :8]].mean(axis=1)
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    left = grid.bricks[(angle < _WEDGE[0]) | (angle > _WEDGE[1])]
    kept = surface(Grid(grid.nodes, left))
    outside = {tuple(row) for row in np.sort(surface(grid)[:, :4], axis=1)}
    opened = [tuple(row) not in outside for row in np.sort(kept[:, :4], axis=1)]
    return kept, np.array(opened, dtype=bool)


def _section(grid: Grid) -> np.ndarray:
    """Faces of one side of the cut: radius and Z around each, shape `[face, 8, 2]` [m]."""
    kept, opened = _opened(grid)
    faces = grid.nodes[kept[opened]][:, _AROUND]
    middle = faces.mean(axis=1)
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    near = np.abs(angle - _WEDGE[1]) < np.abs(angle - _WEDGE[0])
    return np.stack([np.hypot(faces[..., 0], faces[..., 1]), faces[..., 2]], axis=-1)[near]


@dataclass(frozen=True)
class DrawnModes:
    """Free modes of a body, lowest first.

    **Fields:**

    - `frequency_Hz`: [Hz].
    - `diameter`: nodal diameters [-].
    - `circle`: nodal circles, or None if they are not known [-].
    - `share`: of the energy that the nodal diameter has [-].
    - `kind`: where most motion goes: "radial", "tangential" or "axial".
    """

    frequency_Hz: np.ndarray
    diameter: np.ndarray
    circle: np.ndarray | None
    share: np.ndarray
    kind: Sequence[str]

    def label(self, mode: int) -> str:
        """A mode in words."""
        words = [_counted(int(self.diameter[mode]), "nodal diameter")]
        if self.circle is not None:
            words.append(_counted(int(self.circle[mode]), "circle"))
        return f"{self.frequency_Hz[mode]:.5g} Hz, {self.kind[mode]}\n{', '.join(words)}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}"


# Frequencies of a pair differ by less than that; holes may part them.
_TWINS = 1e-3


# How many mode shapes are drawn.
_DRAWN = 9


def families_columns(modes: DrawnModes) -> Columns:
    """The data of `families`, a row for each mode."""
    circles = {} if modes.circle is None else {"nodal_circle": modes.circle}
    return {
        "mode": np.arange(1, len(modes.frequency_Hz) + 1),
        "frequency_Hz": modes.frequency_Hz,
        "nodal_diameter": modes.diameter,
        **circles,
        "kind": np.asarray(modes.kind),
        "family": 1 + _ranks(modes),
        "share_of_nodal_diameter": modes.share,
    }


def _ranks(modes: DrawnModes) -> np.ndarray:
    """Number of each mode among those of its kind and nodal diameter; two make one pair."""
    rank = np.zeros(len(modes.frequency_Hz), dtype=int)
    seen: Counter[tuple[str, int]] = Counter()
    for mode, kind in enumerate(modes.kind):
        diameter = int(modes.diameter[mode])
        rank[mode] = seen[kind, diameter] // (2 if diameter else 1)
        seen[kind, diameter] += 1
    return rank


def chosen_modes(modes: DrawnModes) -> list[int]:
    """Modes, lowest first; of the two of a pair, which differ by a turn, the first only."""
    chosen: list[int] = []
    for mode, frequency in enumerate(modes.frequency_Hz):
        twin = any(
            modes.diameter[mode] == modes.diameter[other] > 0
            and modes.kind[mode] == modes.kind[other]
            and frequency < (1.0 + _TWINS) * modes.frequency_Hz[other]
            for other in chosen
        )
        if not twin:
            chosen.append(mode)
    return chosen


def mode_shapes_columns(modes: DrawnModes, shapes: np.ndarray) -> Columns:
    """Which modes `mode_shapes` draws; the shapes themselves are in the VTU file."""
    chosen = [mode for mode in chosen_modes(modes) if mode < len(shapes)][:_DRAWN]
    return {name: column[chosen] for name, column in families_columns(modes).items()}
