"""What roots of teeth give beyond what the elements of a body's rim can show.

A rim has one element for each tooth as a rule, twice as long as a tooth is thick at its root. Such
elements are too stiff under a tooth, by a tenth of a pair's give and more (physics C 31). The
neighbourhood of the root, with the same elements and with smaller ones, shows by how much.

A piece of rim is cut about the middle or an edge of an element, whichever is nearest to its tooth:
with teeth and elements of different numbers every tooth stands elsewhere on its element, yet all of
them stand on two kinds of pieces. Each kind is factorised once, and what its surface gives where
feet stand gives the feet of every tooth. Elements around a hole are all unlike: deep under the rim
they are left out, as every tooth would have a piece of its own for what it hardly feels.
"""

import dataclasses
import math

import numpy as np
import scipy

from fem_prep import (
    CUT,
    RIM,
    Grid,
    Material,
    ReducedBody,
    piece_compliance,
    piece_of,
    refined,
    surface_of,
)
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._roots import ROOT_POINTS, Axial, RimSurface, RootPatches, interface_map
from jaxgear._system._body_tables import root_patches
from jaxgear.scene._kept_compliance import kept_compliance

# How far the piece reaches to either side [pitches], and under the rim [root widths]; how far where
# elements do not repeat around. Of wheels with thin webs a piece of the rim alone changes the mean
# of the transmission error by less than 0.1 %, its RMS by 0.5 %.
_REACH, _DEPTH, _UNEVEN_DEPTH = 1.6, 1.5, 1.0
# Elements of the finer piece, around for a pitch and for each old one in depth: of a wheel with one
# element for each tooth the root's deflection then is within 0.2 % of that of a body that is as
# fine all over, where one of the old elements is 17 % off.
_AROUND, _DEEP = 8, 4
# Of the radius: how far apart nodes may be that are at the same place of equal pieces.
_SAME = 1e-6


def root_correction(
    body: ReducedBody,
    material: Material,
    pair: GearPair,
    index: int,
    grid: MeshGrid,
    *,
    points: int,
    axial: Axial,
) -> "RootCorrection | None":
    """The correction for a body, if its elements are known."""
    if not len(body.bricks):
        return None
    return RootCorrection(body, material, pair, index, grid, points, axial)


@dataclasses.dataclass(frozen=True)
class _Kind:
    """A piece of rim, which teeth stand on equals of it, and where.

    **Fields:**

    - `grid`: of the first of the equals.
    - `anchor`: angle about which it was cut [rad].
    - `teeth`: places of the teeth in what was asked for.
    - `angles`: of the middles of the teeth from the anchors of their pieces [rad].
    """

    grid: Grid
    anchor: float
    teeth: list[int]
    angles: list[float]


class RootCorrection:
    """Corrections of the teeth of a gear; teeth on equal pieces of rim share its factor.

    **Fields:**

    - `pieces`: pieces of rim that were solved.
    """

    def __init__(
        self,
        body: ReducedBody,
        material: Material,
        pair: GearPair,
        index: int,
        grid: MeshGrid,
        points: int,
        axial: Axial,
    ):
        self.pieces = 0
        self._body, self._material = body, material
        self._patches = lambda teeth: root_patches(
            pair, index, grid, np.asarray(teeth), points=points, axial=axial
        )
        gear = (pair.pinion, pair.wheel)[index]
        self._pitch = 2.0 * np.pi / gear.teeth
        self._radius = float(np.median(np.hypot(*body.rim_nodes.T[:2])))
        self._anchors = _anchors(body)
        # As far as any tooth is from its anchor: pieces do not depend on which teeth are asked for.
        middles = self._pitch * np.arange(gear.teeth)
        off = float(np.abs(_turned(middles - self._anchor_of(middles))).max())
        first = self._patches(np.zeros(1))
        reach = _REACH * self._pitch + off
        self._ends = first.angles.min() - reach, first.angles.max() + reach
        even = _repeat_around(body, len(self._anchors) // 2, self._radius)
        self._depth = np.where(even, _DEPTH, _UNEVEN_DEPTH) * first.width

    def __call__(self, teeth: np.ndarray) -> np.ndarray:
        """More give of the feet of some teeth, in their frames.

        **Arguments:**

        - `teeth`: their numbers, shape `[tooth]`.

        **Returns:**

        Shape `[tooth, 6 slice, 6 slice]` [m/N, 1/N, 1/(N m)].
        """
        found = None
        for kind in self._kinds(teeth):
            patches = self._patches(np.zeros(len(kind.teeth)))
            on_piece = np.array(kind.angles)[:, None] + kind.anchor
            patches = dataclasses.replace(patches, angles=patches.angles + on_piece)
            finer = refined(kind.grid, self._parts(kind.grid), _DEEP, 1)
            # Few points are line loads, whose give grows as elements shrink: only to be taken off.
            spread = dataclasses.replace(patches, points=max(patches.points, ROOT_POINTS))
            more = self._give(finer, spread) - self._give(kind.grid, patches)
            self.pieces += 1
            if found is None:
                found = np.empty((len(teeth), *more.shape[1:]))
            found[kind.teeth] = more
        assert found is not None
        return found

    def kept(self, teeth: np.ndarray) -> np.ndarray:
        """The same as by a call, from the cache of bodies where it is known."""
        body = self._body
        made_from = {
            "grid": (body.nodes, body.bricks, body.rim_nodes, body.rim_faces),
            "material": self._material,
            "patches": self._patches(teeth),
        }
        return kept_compliance({"roots beyond a rim": made_from}, lambda: self(teeth))

    def _kinds(self, teeth: np.ndarray) -> list[_Kind]:
        """The different pieces of rim on which teeth stand."""
        middles = self._pitch * np.asarray(teeth)
        anchors = self._anchor_of(middles)
        kinds: list[_Kind] = []
        for anchor in np.unique(anchors):
            own = np.flatnonzero(anchors == anchor)
            grid, angles = self._piece(anchor), _turned(middles[own] - anchor)
            kind = next((k for k in kinds if self._equal(k, grid, anchor)), None)
            if kind is None:
                kind = _Kind(grid, float(anchor), [], [])
                kinds.append(kind)
            kind.teeth.extend(own.tolist())
            kind.angles.extend(angles.tolist())
        return kinds

    def _anchor_of(self, angles: np.ndarray) -> np.ndarray:
        """The middles or edges of elements nearest to some angles, which may be full turns on."""
        around = np.concatenate(
            [self._anchors[-1:] - 2.0 * np.pi, self._anchors, self._anchors[:1] + 2.0 * np.pi]
        )
        places = angles % (2.0 * np.pi)
        above = np.clip(np.searchsorted(around, places), 1, len(around) - 1)
        # A tooth in the middle of both takes the lower one, whatever rounding says.
        low, high = places - around[above - 1], around[above] - places
        chosen = np.where(low <= high * (1.0 + _SAME), above - 1, above)
        return self._anchors[(chosen - 1) % len(self._anchors)]

    def _piece(self, anchor: float) -> Grid:
        """The piece of rim about an angle, wide enough for any tooth that stands on it."""
        return piece_of(
            self._body.nodes,
            self._body.bricks,
            radius=self._radius,
            angles=(anchor + self._ends[0], anchor + self._ends[1]),
            depth=self._depth,
        )

    def _equal(self, kind: _Kind, grid: Grid, anchor: float) -> bool:
        """Whether a piece turned onto a known one is the same, cut where it is.

        What is cut tells pieces above a hole from those beside it.
        """
        known = kind.grid
        if known.nodes.shape != grid.nodes.shape or known.bricks.shape != grid.bricks.shape:
            return False
        cosine, sine = np.cos(kind.anchor - anchor), np.sin(kind.anchor - anchor)
        x, y, z = grid.nodes.T
        turned = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
        away, place = scipy.spatial.KDTree(known.nodes).query(turned)
        cut = np.zeros(len(turned), dtype=bool)
        cut[known.sets[CUT]] = True
        return bool((away <= _SAME * self._radius).all()) and np.array_equal(
            np.flatnonzero(cut[place]), grid.sets[CUT]
        )

    def _parts(self, piece: Grid) -> int:
        """Into how many parts the elements of a piece go around."""
        faces = surface_of(piece, RIM)[:, :4]
        angle = np.arctan2(piece.nodes[faces, 1], piece.nodes[faces, 0])
        turned = (angle - angle[:, :1] + np.pi) % (2.0 * np.pi)
        length = float(np.median(np.ptp(turned, axis=1)))
        return max(1, math.ceil(_AROUND * length / self._pitch - 1e-6))

    def _give(self, grid: Grid, patches: RootPatches) -> np.ndarray:
        """Compliance between the feet of each tooth on a piece, `[tooth, 6 slice, 6 slice]`."""
        rows = interface_map(RimSurface(grid.nodes, surface_of(grid, RIM)), patches).rows
        nodes = np.unique(rows.indices // 3)
        under = piece_compliance(grid, self._material, nodes)
        feet = rows[:, (3 * nodes[:, None] + np.arange(3)).ravel()]
        each = feet.shape[0] // len(patches.angles)
        own = (feet[start : start + each] for start in range(0, feet.shape[0], each))
        return np.stack([tooth @ (tooth @ under).T for tooth in own])


def _repeat_around(body: ReducedBody, elements: int, radius: float) -> np.ndarray:
    """Which elements have others like them all around, as many as the rim has, `[brick]`."""
    x, y, z = body.nodes[body.bricks[:, :8]].mean(axis=1).T
    places = np.stack([np.hypot(x, y), z], axis=1)
    alike = scipy.spatial.KDTree(places).query_ball_point(
        places, _SAME * radius, return_length=True
    )
    return np.asarray(alike) == elements


def _anchors(body: ReducedBody) -> np.ndarray:
    """Angles of the edges and middles of the elements of a rim, rising from zero [rad]."""
    x, y, _ = body.rim_nodes.T
    corners = np.stack([x, y], axis=1)[body.rim_faces[:, :4]]
    places = np.concatenate([corners.reshape(-1, 2), corners.mean(axis=1)])
    angles = np.sort(np.arctan2(places[:, 1], places[:, 0]) % (2.0 * np.pi))
    apart = np.diff(angles, prepend=angles[-1] - 2.0 * np.pi) > _SAME
    return angles[apart]


def _turned(angles: np.ndarray) -> np.ndarray:
    """Angles less full turns, from minus to plus half of one [rad]."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi
