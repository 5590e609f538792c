r"""A gear with its teeth in 20-node bricks: the judge of teeth on condensed bodies.

The body is one of `fem_prep.body_grid`, its elements moved around so that they are narrow under
the loaded tooth and wide far from it. Its outermost nodes follow the root circle and the lower half
of the fillets; teeth stand on what lies between them. Some teeth, the loaded one in their middle,
have the exact fillet and involute; the others are as thick and as high in few elements, since they
only stiffen the rim.

Tooth 0 is loaded, on its flank that looks along the positive tangent. Displacements are compared
where the load's line of action meets the middle plane of the tooth, along the load: there the
contact has faded, as in Weber and Banaschek's tooth without its penetration.
"""

import dataclasses
import functools
import math
from dataclasses import dataclass
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.sparse import coo_array, csr_array
from scipy.spatial import KDTree

import jaxgear as jg
from fem_prep import (
    GearBody,
    Grid,
    Material,
    MeshSizing,
    ReducedBody,
    Seat,
    Web,
    assemble,
    body_grid,
    condense,
    full_body,
)
from fem_prep._assembly import _face_functions
from fem_prep._extrude import extruded_grid
from fem_prep._grid import merged
from fem_prep._solvers import Factor, factorise
from jaxgear import mm
from jaxgear._contact._tooth import beam_compliance, tooth_load
from jaxgear._geometry._lines import contact_lines, mesh_grid
from jaxgear._geometry._profile import tooth_section
from jaxgear._interface._roots import ROOT_POINTS, Axial
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._foot_tables import foot_tables
from jaxgear.scene._root_correction import RootCorrection, root_correction

# How far the lowest row of a tooth dips in its middle, of half its width: with less it meets the
# fillet at a sharper angle, with more the elements of the rim do.
_DIP = 0.25
# Gauss points across a load or a root, and along the axis in each element.
_ACROSS, _ALONG = 12, 4
# Corners of an 8-node face, then the middles that follow them, in half elements.
_FACE = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]


@dataclass(frozen=True)
class ToothFineness:
    """Elements of a gear with its teeth.

    **Fields:**

    - `base`: through the thickness of a fine tooth, even.
    - `gap`: on the root circle on either side of a fine tooth.
    - `fillet`: along the upper half of the fillet.
    - `flank`: along the involute.
    - `beside`: fine teeth on either side of the loaded one.
    - `rim_axial`, `rim_radial`, `web_radial`, `hub_radial`: of the body, see `fem_prep.MeshSizing`.
    """

    base: int = 4
    gap: int = 1
    fillet: int = 1
    flank: int = 4
    beside: int = 1
    rim_axial: int = 6
    rim_radial: int = 2
    web_radial: int = 6
    hub_radial: int = 2


@dataclass(frozen=True)
class ToothShape:
    """Lattice of a fine tooth in its own plane, corners and middles of elements alike.

    **Fields:**

    - `teeth`: number of teeth of the gear.
    - `root_radius`, `base_radius`: of its circles [m].
    - `points`: across and height by row and column, `[row, column, 2]` [m].
    - `first`: row where the involute begins.
    - `rolls`: roll angles of the rows from there [rad].
    - `lower`: fillet between the root circle and the lowest row, its ends and its middle, `[3, 2]`,
        downward [m].
    """

    teeth: int
    root_radius: float
    base_radius: float
    points: np.ndarray
    first: int
    rolls: np.ndarray
    lower: np.ndarray


@dataclass(frozen=True)
class ToothedGear:
    """A gear with its teeth, ready to be loaded.

    **Fields:**

    - `grid`: its grid; the set `seat:bore` is held.
    - `shape`: of the fine teeth.
    - `levels`: heights of the edges of elements across the face [m].
    """

    grid: Grid
    shape: ToothShape
    levels: np.ndarray


# --- The grid


@functools.partial(jax.jit, static_argnums=1)
def _measures(pair: jg.GearPair, index: int) -> tuple[dict[str, Array], tuple[Array, Array]]:
    """Sizes of one gear's tooth, and points of its fillet from the root circle up."""
    section = tooth_section(pair, (pair.pinion, pair.wheel)[index])
    angles = jnp.linspace(0.5 * math.pi, section.pressure_angle, 4001)
    sizes = {
        "root": section.root_radius,
        "base": section.base_radius,
        "form": section.form_roll_angle,
        "tip": pair.tip_roll[index] / section.base_radius,
    }
    return sizes, section.fillet(angles)


@functools.partial(jax.jit, static_argnums=1)
def _flank(pair: jg.GearPair, index: int, rolls: Array) -> tuple[Array, Array]:
    """Half thickness and height of a tooth at roll angles [m]."""
    return tooth_section(pair, (pair.pinion, pair.wheel)[index]).flank(rolls)


def tooth_shape(pair: jg.GearPair, index: int, fineness: ToothFineness) -> ToothShape:
    """Lattice of the fine teeth of one gear of a spur pair."""
    sizes, fillet = _measures(pair, index)
    base, root, form, tip = (float(sizes[name]) for name in ("base", "root", "form", "tip"))
    fillet = np.stack([np.asarray(c) for c in fillet], axis=-1)
    step = np.abs(np.diff(fillet, axis=0))
    # Where the fillet has turned by 45 degrees from the root circle.
    split = int(np.argmin(np.abs(np.arctan2(step[:, 1], step[:, 0]) - 0.25 * math.pi)))
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
    along = lambda lengths: np.stack([np.interp(lengths, arc, c) for c in fillet.T], axis=-1)
    upper = along(np.linspace(arc[split], arc[-1], 2 * fineness.fillet + 1))
    # The arc of an involute grows with the square of its roll angle.
    rolls = np.sqrt(np.linspace(form**2, tip**2, 2 * fineness.flank + 1))
    flank = np.stack([np.asarray(c) for c in _flank(pair, index, jnp.asarray(rolls))], axis=-1)
    side = np.concatenate([upper[:-1], flank])
    place = np.linspace(-1.0, 1.0, 2 * fineness.base + 1)
    share = (side[:, 1] - side[0, 1]) / np.ptp(side[:, 1])
    bulge = (np.hypot(*side[-1]) - side[-1, 1]) * share**2 - _DIP * side[0, 0] * (1.0 - share) ** 2
    heights = side[:, 1:] + bulge[:, None] * (1.0 - place**2)
    points = np.stack([side[:, :1] * place, heights], axis=-1)
    lower = along(arc[split] * np.array([1.0, 0.5, 0.0]))
    teeth = (pair.pinion, pair.wheel)[index].teeth
    return ToothShape(teeth, root, base, points, 2 * fineness.fillet, rolls, lower)


def _coarse_points(shape: ToothShape) -> np.ndarray:
    """Lattice of a tooth of one element through its thickness and two along its height."""
    half, height = shape.points[:, -1].T
    radius = np.hypot(half, height)
    rows = np.linspace(shape.root_radius, radius[-1], 5)
    angle = np.interp(rows, radius, np.arctan2(half, height))[:, None] * np.array([-1.0, 0.0, 1.0])
    return rows[:, None, None] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def _fine_outline(shape: ToothShape, gap: int) -> np.ndarray:
    """The rim's outside over one pitch, corners and middles in turn, `[point, 2]` [m]."""
    end = np.arctan2(*shape.lower[-1])
    turn = np.linspace(math.pi / shape.teeth, end, 2 * gap + 1)
    circle = shape.root_radius * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
    right = np.concatenate([shape.lower, circle[::-1][1:]])
    return np.concatenate([right[::-1] * [-1.0, 1.0], shape.points[0, 1:-1], right])


def _outline(shape: ToothShape, fineness: ToothFineness) -> tuple[np.ndarray, np.ndarray]:
    """Angle from tooth 0 and radius of the rim's outside, corners and middles in turn."""
    teeth, root = shape.teeth, shape.root_radius
    pitch = 2.0 * math.pi / teeth
    foot = np.arctan2(*_coarse_points(shape)[0, -1])
    own = _fine_outline(shape, fineness.gap)
    fine = np.arctan2(*own.T), np.hypot(*own.T)
    near = range(-fineness.beside, fineness.beside + 1)
    angle = [fine[0][:-1] + tooth * pitch for tooth in near]
    radius = [fine[1][:-1] for tooth in near]
    far = range(fineness.beside + 1, teeth - fineness.beside)
    edges = [tooth * pitch + side for tooth in far for side in (-foot, foot)]
    edges = np.array([(far[0] - 0.5) * pitch, *edges, (far[-1] + 0.5) * pitch])
    both = _halved(edges)[:-1]
    return np.concatenate([*angle, both]), np.concatenate([*radius, np.full(len(both), root)])


def _halved(ends: np.ndarray) -> np.ndarray:
    """Ends with their middles between them."""
    return np.interp(np.arange(2 * len(ends) - 1) / 2, np.arange(len(ends)), ends)


def _body_places(
    body: GearBody, fineness: ToothFineness, angle: np.ndarray, radius: np.ndarray
) -> np.ndarray:
    """Bricks of the body, moved to the angles and the outline, `[brick, 20, 3]` [m]."""
    sectors = len(angle) // 2
    even = MeshSizing(
        sectors=sectors,
        rim_axial=fineness.rim_axial,
        rim_radial=fineness.rim_radial,
        web_radial=fineness.web_radial,
        hub_radial=fineness.hub_radial,
    )
    grid = body_grid(body, even)
    x, y, z = grid.nodes.T
    number = np.rint(np.arctan2(y, x) * sectors / math.pi + 1.0).astype(int) % (2 * sectors)
    own = grid.radius
    assert body.web is not None
    inner, outer = 0.5 * body.web.rim_inner, 0.5 * body.rim_outer
    own = own + np.clip((own - inner) / (outer - inner), 0.0, None) * (radius[number] - outer)
    turned = np.stack([own * np.cos(angle[number]), own * np.sin(angle[number]), z], axis=-1)
    return turned[grid.bricks]


def _quads(points: np.ndarray) -> np.ndarray:
    """Quadrilaterals of a lattice of corners and middles, in the plane of the gear."""
    rows, columns = (np.arange(0, count - 2, 2) for count in points.shape[:2])
    row, column = (each.ravel() for each in np.meshgrid(rows, columns, indexing="ij"))
    quads = np.stack([points[row + up, column + along] for up, along in _FACE], axis=1)
    # The height of a tooth lies along x, its thickness along y.
    return quads[..., ::-1]


def _turned(quads: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return quads @ np.array([[cosine, sine], [-sine, cosine]])


def toothed_gear(
    body: GearBody,
    pair: jg.GearPair,
    index: int,
    fineness: ToothFineness = ToothFineness(),
    *,
    alone: bool = False,
) -> ToothedGear:
    """Grid of a gear with all its teeth.

    **Arguments:**

    - `body`: bored, with a web without holes, its outside the root circle.
    - `pair`: spur.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `fineness`: of the grid.
    - `alone`: leave all teeth out but the loaded one.

    **Returns:**

    The gear.
    """
    shape = tooth_shape(pair, index, fineness)
    places = _body_places(body, fineness, *_outline(shape, fineness))
    outside = np.hypot(places[..., 0], places[..., 1]).max(axis=1) > 0.499 * body.rim_outer
    heights = places[outside, :8, 2] / body.rim_width
    levels = np.unique(np.round(heights, 9)) * body.rim_width
    fine, coarse = _quads(shape.points), _quads(_coarse_points(shape))
    every = []
    for tooth in range(1 if alone else shape.teeth):
        near = min(tooth, shape.teeth - tooth) <= fineness.beside
        quads = _turned(fine if near else coarse, 2.0 * math.pi * tooth / shape.teeth)
        every += [extruded_grid(quads, *ends) for ends in pairwise(levels)]
    bricks = np.concatenate([places, *every])
    numbers = np.arange(20 * len(bricks)).reshape(-1, 20)
    nodes, bricks = merged(bricks.reshape(-1, 3), numbers, 1e-7)
    bore = np.flatnonzero(np.hypot(nodes[:, 0], nodes[:, 1]) < 0.5 * body.bore + body.same)
    return ToothedGear(Grid(nodes, bricks, {"seat:bore": bore}), shape, levels)


# --- Loads and places on tooth 0


@dataclass(frozen=True)
class Place:
    """Where a tooth is loaded: a height on its flank.

    **Fields:**

    - `roll_angle`: of the loaded point [rad].
    - `normal`: direction of the load in the gear's frame, x along the tooth's height [-].
    - `height`: where the load crosses the tooth's middle [m].
    """

    roll_angle: float
    normal: np.ndarray
    height: float


def judged_places(pair: jg.GearPair, index: int) -> dict[str, Place]:
    """The pitch point, and a place near the tip."""
    rolls, angles, heights = (np.asarray(each) for each in _judged(pair, index))
    normals = -np.stack([np.sin(angles), np.cos(angles), 0.0 * angles], axis=-1)
    given = zip(rolls, normals, heights, strict=True)
    places = [Place(float(roll), normal, float(height)) for roll, normal, height in given]
    return dict(zip(("pitch point", "near the tip"), places, strict=True))


@functools.partial(jax.jit, static_argnums=1)
def _judged(pair: jg.GearPair, index: int) -> tuple[Array, Array, Array]:
    """Roll angles, angles of the loads, and heights where these cross the tooth's middle."""
    section = tooth_section(pair, (pair.pinion, pair.wheel)[index])
    pitch = jnp.tan(pair.working_pressure_angle)
    tip = pair.tip_roll[index] / section.base_radius
    rolls = jnp.stack([pitch, pitch + 0.8 * (tip - pitch)])
    load = tooth_load(section, rolls)
    return rolls, load.angle, load.height


@dataclass(frozen=True)
class Sheet:
    """A surface of the loaded tooth along the axis: nodes of its 8-node faces.

    **Fields:**

    - `nodes`: by row and level, corners and middles in turn; -1 in the middle of a face.
    - `ends`: coordinate of the rows' corners, growing.
    - `levels`: heights of the levels' corners [m].
    """

    nodes: np.ndarray
    ends: np.ndarray
    levels: np.ndarray


def _sheet(gear: ToothedGear, line: np.ndarray, ends: np.ndarray) -> Sheet:
    """The surface that a line of lattice points `[row, 2]` sweeps."""
    levels = _halved(gear.levels)
    places = np.empty((len(line), len(levels), 3))
    places[..., 0], places[..., 1], places[..., 2] = line[:, None, 1], line[:, None, 0], levels
    away, nearest = KDTree(gear.grid.nodes).query(places)
    nodes = np.asarray(nearest)
    nodes[1::2, 1::2] = -1
    assert np.asarray(away)[nodes >= 0].max() < 1e-8
    return Sheet(nodes, ends, gear.levels)


def _rows(sheet: Sheet, places: np.ndarray, heights: np.ndarray, count: int) -> csr_array:
    """What points of a sheet have from each of `count` nodes, `[place * height, node]`."""
    place, height = (each.ravel() for each in np.meshgrid(places, heights, indexing="ij"))
    row, s = _cell(sheet.ends, place)
    level, t = _cell(sheet.levels, height)
    values = _face_functions(s, t)[0]
    nodes = np.stack([sheet.nodes[2 * row + up, 2 * level + on] for up, on in _FACE], axis=1)
    entries = values.ravel(), (np.repeat(np.arange(len(place)), 8), nodes.ravel())
    return csr_array(coo_array(entries, (len(place), count)))


def _cell(ends: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cell of each place and the coordinate in it, -1 to 1."""
    cell = np.clip(np.searchsorted(ends, places) - 1, 0, len(ends) - 2)
    return cell, 2.0 * (places - ends[cell]) / (ends[cell + 1] - ends[cell]) - 1.0


def _along(piece: tuple[float, float], levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points along the axis in a piece of the face, and their weights [m]."""
    inside = levels[(levels > piece[0]) & (levels < piece[1])]
    points, weights = np.polynomial.legendre.leggauss(_ALONG)
    cuts = np.array([piece[0], *inside, piece[1]])
    half = 0.5 * np.diff(cuts)[:, None]
    return (cuts[:-1, None] + half * (1.0 + points)).ravel(), (half * weights).ravel()


def loads_on(
    gear: ToothedGear, place: Place, edges: np.ndarray, half_width: float = 0.1 * mm
) -> np.ndarray:
    """Loads on all nodes of a unit line load on each piece of the face.

    **Arguments:**

    - `gear`: with its teeth.
    - `place`: on the flank.
    - `edges`: of the pieces along the axis, shape `[piece + 1]` [m].
    - `half_width`: over which the load is spread along the flank [m].

    **Returns:**

    Shape `[3 node, piece]` [m].
    """
    shape = gear.shape
    # Coordinates along the flank are squares of roll angles: its arc grows with them.
    flank = _sheet(gear, shape.points[shape.first :, -1], shape.rolls[::2] ** 2)
    points, weights = np.polynomial.legendre.leggauss(_ACROSS)
    squares = place.roll_angle**2 + 2.0 * half_width / shape.base_radius * points
    assert flank.ends[0] <= squares.min()
    assert squares.max() <= flank.ends[-1]
    loads = []
    for piece in pairwise(edges):
        heights, share = _along(piece, gear.levels)
        nodal = _rows(flank, squares, heights, len(gear.grid.nodes)).T @ np.kron(weights, share)
        loads.append((0.5 * nodal[:, None] * place.normal).ravel())
    return np.stack(loads, axis=1)


@dataclass(frozen=True)
class Held:
    """A gear with its teeth, its bore held.

    **Fields:**

    - `gear`: with its teeth.
    - `free`: displacements that are not held.
    - `factor`: of their stiffness.
    """

    gear: ToothedGear
    free: np.ndarray
    factor: Factor


def held(gear: ToothedGear, material: Material) -> Held:
    """Hold a gear at its bore."""
    stiffness, _ = assemble(gear.grid, material)
    free = np.setdiff1d(np.arange(len(gear.grid.nodes)), gear.grid.sets["seat:bore"])
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    return Held(gear, dofs, factorise(csr_array(stiffness[dofs][:, dofs])))


@dataclass(frozen=True)
class Influence:
    """Mean deflections of pieces of the face by unit line loads on each, `[piece, piece]` [m2/N].

    **Fields:**

    - `foot`: by the motion of the tooth's foot.
    - `tooth`: by the tooth itself.
    - `root`: of `foot`, what the root correction brought; zero for the full model.
    """

    foot: np.ndarray
    tooth: np.ndarray
    root: np.ndarray

    @property
    def whole(self) -> np.ndarray:
        """Foot and tooth."""
        return self.foot + self.tooth


def full_influence(
    model: Held, place: Place, edges: np.ndarray, half_width: float = 0.1 * mm
) -> Influence:
    """Deflection of the loaded tooth in the full model.

    **Arguments:**

    - `model`: the gear.
    - `place`: on the flank.
    - `edges`: of the pieces along the axis [m].
    - `half_width`: over which the load is spread along the flank [m].

    **Returns:**

    The deflection of the tooth's middle plane at the load, along the load. Its foot is the lowest
    row of the tooth, taken as the nearest rigid motion over each piece.
    """
    gear = model.gear
    loads = loads_on(gear, place, edges, half_width)
    motion = np.zeros_like(loads)
    motion[model.free] = model.factor.solve(loads[model.free])
    motion = motion.reshape(len(gear.grid.nodes), 3, -1)
    middle = gear.shape.points.shape[1] // 2
    heights = gear.shape.points[:, middle, 1]
    plane = _sheet(gear, gear.shape.points[:, middle], heights[::2])
    base = gear.shape.points[0]
    foot = _sheet(gear, base, np.linspace(-1.0, 1.0, (len(base) + 1) // 2))
    at = np.array([_within(heights, place.height)])
    whole, of_foot = [], []
    for piece in pairwise(edges):
        z, share = _along(piece, gear.levels)
        mean = (share / share.sum()) @ _rows(plane, at, z, len(gear.grid.nodes))
        whole.append(np.einsum("n,nip,i->p", mean, motion, place.normal))
        of_foot.append(_foot_rows(gear, foot, place, piece) @ motion.reshape(-1, len(edges) - 1))
    return Influence(np.stack(of_foot), np.stack(whole) - np.stack(of_foot), 0.0 * np.stack(whole))


def _within(heights: np.ndarray, height: float) -> float:
    """Coordinate of a height between rows whose middles are not half way."""
    cell = int(np.clip(np.searchsorted(heights[::2], height) - 1, 0, len(heights) // 2 - 1))
    low, middle, high = heights[2 * cell : 2 * cell + 3]
    t = np.linspace(-1.0, 1.0, 2001)
    at = 0.5 * t * (t - 1.0) * low + (1.0 - t**2) * middle + 0.5 * t * (t + 1.0) * high
    return float(low + 0.5 * (np.interp(height, at, t) + 1.0) * (high - low))


def _foot_rows(
    gear: ToothedGear, foot: Sheet, place: Place, piece: tuple[float, float]
) -> np.ndarray:
    """Approach at the load per displacement of the nodes, by the rigid motion of a foot."""
    z, share = _along(piece, gear.levels)
    points, weights = np.polynomial.legendre.leggauss(_ACROSS)
    rows = _rows(foot, points, z, len(gear.grid.nodes))
    weight = np.kron(weights, share) / (weights.sum() * share.sum())
    places = rows @ gear.grid.nodes
    centre = weight @ places
    x, y, _ = (places - centre).T
    turn = np.stack([-y, x, 0.0 * x], axis=1) * (weight / (weight @ (x**2 + y**2)))[:, None]
    arm = np.array([place.height, 0.0, 0.0]) - centre
    moment = arm[0] * place.normal[1] - arm[1] * place.normal[0]
    return (rows.T @ (weight[:, None] * place.normal + moment * turn)).ravel()


# --- The same by a condensed body and beams


def accessory_wheel(pair: jg.GearPair) -> tuple[GearBody, Material]:
    """Body and material of the accessory pair's wheel, on a bore of 40 mm in place of its shaft."""
    web = Web(hub_outer=50.0 * mm, thickness=3.0 * mm, rim_inner=118.0 * mm)
    wheel, root = pair.wheel, float(pair.root_radius[1])
    body = GearBody(2.0 * root, float(wheel.face_width), bore=40.0 * mm, web=web)
    steel = wheel.material
    return body, Material(float(steel.young), float(steel.poisson), float(steel.density))


def condensed_wheel(
    body: GearBody, material: Material, teeth: int, *, elements: int = 1
) -> ReducedBody:
    """A body with no teeth, condensed on its rim and its bore; some elements for each tooth."""
    grid = body_grid(body, MeshSizing(sectors=elements * teeth))
    seat = Seat("gear", grid.sets["seat:bore"], np.zeros(3))
    return condense(full_body("wheel", grid, material, [seat]), method="guyan", modes=0)


@dataclass(frozen=True)
class Connection:
    """How slices stand on the rim.

    **Fields:**

    - `points`: across a root.
    - `corrected`: whether the root gives what the rim's elements cannot show.
    - `axial`: how slices follow the rim along the axis.
    - `slices`: in each piece of the face.
    """

    points: int = ROOT_POINTS
    corrected: bool = True
    axial: Axial = "mortar"
    slices: int = 2


def hybrid_influence(
    body: ReducedBody,
    material: Material,
    pair: jg.GearPair,
    index: int,
    places: dict[str, Place],
    pieces: int,
    connection: Connection = Connection(),
) -> dict[str, Influence]:
    """Deflection of a loaded tooth of a condensed body, its bore held.

    **Arguments:**

    - `body`: the body.
    - `material`: its material.
    - `pair`: spur.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `places`: on the flank, by name.
    - `pieces`: equal parts of the face.
    - `connection`: of slices and rim.

    **Returns:**

    Deflections by the names of the places. The tooth is a beam for every slice, without the
    contact.
    """
    gear = (pair.pinion, pair.wheel)[index]
    section = tooth_section(pair, gear)
    how, slices = connection, pieces * connection.slices
    grid = mesh_grid(pair, slices=slices)
    nothing = given = _of_slices(body, pair, index, grid, places, how, None)
    if how.corrected:
        local = root_correction(
            body, material, pair, index, grid, points=how.points, axial=how.axial
        )
        given = _of_slices(body, pair, index, grid, places, how, local)
    # A line load on a slice is a force of its width; deflections are means over a piece.
    gather = np.kron(np.eye(pieces), np.ones((1, how.slices)))
    width = float(pair.face_width) / slices
    rolls = jnp.asarray([place.roll_angle for place in places.values()])
    beams = np.asarray(beam_compliance(section, gear.material, rolls))
    found = {}
    for name, beam, of_foot, bare in zip(places, beams, given, nothing, strict=True):
        foot, plain = (width / how.slices * gather @ each @ gather.T for each in (of_foot, bare))
        found[name] = Influence(foot, beam * np.eye(pieces), foot - plain)
    return found


def _of_slices(
    body: ReducedBody,
    pair: jg.GearPair,
    index: int,
    grid: jg.MeshGrid,
    places: dict[str, Place],
    how: Connection,
    local: RootCorrection | None,
) -> np.ndarray:
    """Compliance between the slices of one tooth by the motions of their feet, at each place."""
    tables = flexible_body(body, pair, index, grid, points=how.points, axial=how.axial, local=local)
    base = float(pair.base_radius[index])
    own = base * np.array([place.roll_angle for place in places.values()])
    roll = own if index == 0 else float(pair.tangent_length) - own
    lines = contact_lines(pair, grid)
    # Phases that have no place stay as they are.
    all_rolls = lines.roll.at[: len(roll)].set(jnp.asarray(roll)[:, None, None])
    compliance = foot_tables(
        pair, index, tables, dataclasses.replace(lines, roll=all_rolls)
    ).compliance
    return np.asarray(compliance)[: len(roll), : grid.slices, : grid.slices]
