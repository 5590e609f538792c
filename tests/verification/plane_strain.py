r"""Whole spur gears in plane strain by finite elements: the reference for analytic tooth models.

Every tooth of a gear is there, exact fillet and involute on a ring that is clamped at its bore.
One sector per tooth is reduced to its two cuts once, and the ring of sectors is closed harmonic
by harmonic (cyclic symmetry), which is exact. Quadratic nine-node elements on a grid of our own:
lattice rows and columns of an inverted T, the tooth standing on its piece of the ring.

A contact is a semi-elliptic pressure of half-width `a` that the grid resolves. Displacements are
work-conjugate to it, so that compliances are symmetric; the displacement under its centre is
$(1-\nu^2)/(2\pi E)$ larger per line load, and the true Hertz half-width $a_H$ instead of `a` adds
$2(1-\nu^2)/(\pi E) \ln(a/a_H)$ (half-plane, Johnson 1985 section 4.2).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import numpy as np
import scipy.interpolate
import scipy.linalg
import scipy.sparse as sparse
import skfem
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, sym_grad, trace

import jaxgear as jg
from jaxgear._geometry._profile import ToothSection, tooth_section


@dataclass(frozen=True)
class MeshSizing:
    """How fine the grid of one sector is; lengths in modules.

    **Fields:**

    - `flank`: length of elements along the flank [-].
    - `fillet`: length of elements along the fillet and the root [-].
    - `growth`: ratio of neighbouring elements away from the loaded flank and below the root [-].
    - `half_width`: of the pressure [-].
    """

    flank: float = 0.04
    fillet: float = 0.08
    growth: float = 1.3
    half_width: float = 0.12


def _graded(length: float, first: float, growth: float, largest: float) -> np.ndarray:
    """Cell ends from 0 to `length`: `first`, then growing to `largest`."""
    sizes = [first]
    while sum(sizes) < length:
        sizes.append(min(sizes[-1] * growth, largest))
    return np.concatenate([[0.0], np.cumsum(sizes)]) * (length / sum(sizes))


def _with_middles(ends: np.ndarray) -> np.ndarray:
    """Cell ends and middles, alternating."""
    middles = 0.5 * (ends[1:] + ends[:-1])
    return np.insert(ends, np.arange(1, len(ends)), middles)


_fillet = jax.jit(lambda section, angle: section.fillet(angle))
_flank = jax.jit(lambda section, angle: section.flank(angle))


def _even_fillet(section: ToothSection, first: float, last: float, size: float) -> np.ndarray:
    """Rack angles from `first` to `last`, evenly along the fillet, middles included."""
    angle = np.linspace(first, last, 2001)
    x, y = (np.asarray(c) for c in _fillet(section, angle))
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    count = 2 * max(2, round(arc[-1] / size)) + 1
    return scipy.interpolate.CubicSpline(arc, angle)(np.linspace(0.0, arc[-1], count))


def _tooth_points(
    section: ToothSection, rolls: np.ndarray, split: float, fineness: MeshSizing
) -> tuple[np.ndarray, int]:
    """Lattice points of the tooth above the rack angle `split`, and the row of its first flank.

    Rows join the two sides of the tooth; the lowest dips to leave the fillet squarely, the
    highest is the tip circle. Columns are fine at the loaded flank.
    """
    module = float(section.module)
    size = fineness.flank * module
    angle = _even_fillet(section, split, float(section.pressure_angle), fineness.fillet * module)
    curves = [np.asarray(_fillet(section, angle)), np.asarray(_flank(section, rolls))]
    half, height = np.concatenate([curves[0], curves[1][:, 1:]], axis=1)
    loaded = _graded(1.0, size / half[0], fineness.growth, 0.2)
    other = _graded(1.0, 3.0 * size / half[0], fineness.growth**2, 0.3)
    place = _with_middles(np.concatenate([other - 1.0, 1.0 - loaded[-2::-1]]))
    along = (height - height[0]) / (height[-1] - height[0])
    bulge = (np.hypot(half[-1], height[-1]) - height[-1]) * along**2
    bulge -= 0.5 * half[0] * (1.0 - along) ** 2
    points = np.stack([half * place[:, None], height + bulge * (1.0 - place[:, None] ** 2)], -1)
    return points, len(angle) - 1


def _ring_points(
    section: ToothSection, bottom: np.ndarray, split: float, bore: float, fineness: MeshSizing
) -> tuple[np.ndarray, int]:
    """Lattice points of the ring under the tooth's lowest row, and the column of its first one."""
    root, teeth = float(section.root_radius), float(section.teeth)
    size = fineness.fillet * float(section.module)
    x, y = (
        np.asarray(c) for c in _fillet(section, _even_fillet(section, 0.5 * np.pi, split, size))
    )
    gap = np.pi / teeth - np.arctan2(x[0], y[0])
    cells = max(1, round(gap * root / size))
    angle = np.pi / teeth - gap * np.linspace(0.0, 1.0, 2 * cells + 1)[:-1]
    angle = np.concatenate([angle, np.arctan2(x, y)])
    radius = np.concatenate([np.full(2 * cells, root), np.hypot(x, y)])
    inner = bottom[1:-1]
    across = np.concatenate([-angle, np.arctan2(inner[:, 0], inner[:, 1]), angle[::-1]])
    outer = np.concatenate([radius, np.hypot(inner[:, 0], inner[:, 1]), radius[::-1]])
    depth = root - 0.5 * bore
    down = _with_middles(_graded(depth, size, fineness.growth, 0.15 * depth) / depth)[::-1]
    outward = 0.5 * bore + (outer[:, None] - 0.5 * bore) * (1.0 - down)
    return outward[..., None] * np.stack([np.sin(across), np.cos(across)], -1)[:, None], len(
        x
    ) + 2 * cells - 1


@dataclass(frozen=True)
class Sector:
    """One tooth on its piece of the ring: +y is the tooth's centreline, x > 0 its loaded flank.

    **Fields:**

    - `section`: the tooth.
    - `basis`: of the displacements.
    - `stiffness`: of the free sector [Pa].
    - `unknown`: number of each displacement by column, row (half cells) and direction x, y; -1
        beside the tooth.
    - `ring`: row of the tooth's foot.
    - `flank`: column and first row of the loaded flank.
    - `flank_roll`: roll angles of the flank's lattice points [rad].
    """

    section: ToothSection
    basis: skfem.Basis
    stiffness: sparse.csc_array
    unknown: np.ndarray
    ring: int
    flank: tuple[int, int]
    flank_roll: np.ndarray

    @property
    def bore(self) -> np.ndarray:
        """Unknowns at the bore."""
        return self.unknown[:, 0].ravel()

    @property
    def cuts(self) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns of the two cuts without the bore, by node and direction; least x first."""
        rows = slice(1, self.ring + 1)
        return self.unknown[0, rows], self.unknown[-1, rows]


def _split_angle(section: ToothSection) -> float:
    """Rack angle at which the fillet's normal has turned by 45 degrees from the root's."""
    angle = np.linspace(float(section.pressure_angle), 0.5 * np.pi, 801)
    x, y = (np.asarray(c) for c in _fillet(section, angle))
    slope = np.arctan2(np.abs(np.diff(y)), np.abs(np.diff(x)))
    return float(angle[np.argmin(np.abs(slope - 0.25 * np.pi))])


def _flank_rolls(section: ToothSection, tip: float, size: float) -> np.ndarray:
    """Roll angles along the flank, ends of elements evenly spaced and middles between them."""
    base = float(section.base_radius)
    first, last = 0.5 * base * np.array([float(section.form_roll_angle), tip]) ** 2
    cells = max(4, round((last - first) / size))
    return _with_middles(np.sqrt(2.0 / base * np.linspace(first, last, cells + 1)))


Factor = Callable[[np.ndarray], np.ndarray]


def fe_sector(pair: jg.GearPair, body: int, fineness: MeshSizing, factor: Factor) -> Sector:
    """Grid and stiffness of one tooth's sector; see `fe_gear`."""
    gear = (pair.pinion, pair.wheel)[body]
    assert gear.bore is not None
    assert float(pair.helix_angle) == 0.0
    section = jax.jit(tooth_section)(pair, gear)
    tip = float(np.asarray(pair.tip_roll)[body]) / float(section.base_radius)
    rolls = _flank_rolls(section, tip, fineness.flank * float(section.module))
    split = _split_angle(section)
    tooth, first_row = _tooth_points(section, rolls, split, fineness)
    ring, first = _ring_points(section, tooth[:, 0], split, float(gear.bore), fineness)
    foot = ring.shape[1] - 1
    points = np.full((ring.shape[0], foot + tooth.shape[1], 2), np.nan)
    points[:, : foot + 1] = ring
    points[first : first + tooth.shape[0], foot:] = tooth

    # The lattice: an inverted T of unit squares, whose points are moved to their places.
    lattice = skfem.MeshQuad.init_tensor(
        *(np.arange(0.0, 0.5 * count) for count in points.shape[:2])
    )
    column, row = 2.0 * lattice.p[:, lattice.t].mean(axis=1)
    standing = (first < column) & (column < first + tooth.shape[0] - 1)
    lattice = lattice.restrict(np.flatnonzero((row < foot) | standing))
    straight = skfem.MeshQuad2.from_mesh(lattice)
    assert straight.doflocs is not None
    assert lattice.t is not None
    place = np.rint(2.0 * straight.doflocs).astype(int)
    grid = skfem.MeshQuad2(points[*place].T.copy(), lattice.t)
    element = skfem.ElementVector(skfem.ElementQuad2())
    basis = skfem.Basis(grid, element, intorder=6)

    # The same element on the lattice itself says which unknown is where.
    plain = skfem.Basis(lattice, element, intorder=1)
    assert plain.nodal_dofs is not None
    assert plain.facet_dofs is not None
    assert plain.interior_dofs is not None
    unknown = np.full(points.shape, -1)
    for numbers in (plain.nodal_dofs, plain.facet_dofs, plain.interior_dofs):
        for axis in (0, 1):
            place = np.rint(2.0 * plain.doflocs[:, numbers[axis]]).astype(int)
            unknown[place[0], place[1], axis] = numbers[axis]
    return Sector(
        section=section,
        basis=basis,
        stiffness=_stiffness(basis, gear.material, factor),
        unknown=unknown,
        ring=foot,
        flank=(first + tooth.shape[0] - 1, foot + first_row),
        flank_roll=rolls,
    )


def _stiffness(basis: skfem.Basis, material: jg.Material, factor: Factor) -> sparse.csc_array:
    """Plane-strain stiffness; Young's modulus is multiplied by `factor` of the radius."""
    young, poisson = float(material.young), float(material.poisson)
    lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    shear = young / (2.0 * (1.0 + poisson))

    @skfem.BilinearForm
    def form(u, v, w):
        strain, virtual = sym_grad(u), sym_grad(v)
        stress = 2.0 * shear * ddot(strain, virtual) + lame * trace(strain) * trace(virtual)
        return factor(np.hypot(*w.x)) * stress

    return sparse.csc_array(form.assemble(basis))


@dataclass(frozen=True)
class FEGear:
    """Compliances of one gear at given roll positions.

    **Fields:**

    - `rolls`: from the gear's own base tangent point [m].
    - `compliance`: `[k, i, j]`, displacement along its normal at roll `i` of the tooth `k` pitches
        on, per line load at roll `j` of the tooth itself; work-conjugate [m2/N]. Teeth are counted
        in the sense in which roll grows along the line of action.
    - `half_width`: of the pressure at each roll [m].
    - `material`: of the gear.
    - `size`: degrees of freedom of one sector [-].
    """

    rolls: np.ndarray
    compliance: np.ndarray
    half_width: np.ndarray
    material: jg.Material
    size: int

    @property
    def plane_modulus(self) -> float:
        """E/(1 - nu^2) [Pa]."""
        return float(self.material.young / (1.0 - self.material.poisson**2))

    def own(self, hertz_half_width: np.ndarray) -> np.ndarray:
        """Displacement under the centre of a contact of this half-width, at each roll [m2/N]."""
        wider = np.log(self.half_width / hertz_half_width)
        local = (2.0 * wider + 0.5) / (np.pi * self.plane_modulus)
        return np.diagonal(self.compliance[0]) + local

    def matrix(self, places: Sequence[int], teeth: Sequence[int]) -> np.ndarray:
        """Compliances between contacts: roll number and tooth of each; work-conjugate [m2/N]."""
        count = len(self.compliance)
        return np.array(
            [
                [self.compliance[(k - m) % count, i, j] for j, m in zip(places, teeth, strict=True)]
                for i, k in zip(places, teeth, strict=True)
            ]
        )


def fe_gear(
    pair: jg.GearPair,
    body: int,
    rolls: np.ndarray,
    *,
    fineness: MeshSizing = MeshSizing(),
    factor: Factor = np.ones_like,
) -> FEGear:
    """Solve one gear of a pair for loads at several rolls.

    **Arguments:**

    - `pair`: spur.
    - `body`: 0 for the pinion, 1 for the wheel; its `bore` is clamped.
    - `rolls`: from the gear's own base tangent point [m]. A pressure that would reach over the tip
        or into the fillet is made narrower, down to 0.6 of an element, then moved.
    - `fineness`: of the grid.
    - `factor`: of Young's modulus, over the radius [m], to make the tooth or the body rigid.

    **Returns:**

    Its compliances.
    """
    gear = (pair.pinion, pair.wheel)[body]
    sector = fe_sector(pair, body, fineness, factor)
    loads, half_width = sector_loads(sector, np.asarray(rolls), fineness)
    reduced, on_cut, local = _reduce(sector, loads)
    compliance = _close_ring(reduced, on_cut, gear.teeth)
    compliance[0] += local
    return FEGear(
        rolls=np.asarray(rolls),
        compliance=compliance,
        half_width=half_width,
        material=gear.material,
        size=int(sector.basis.N),
    )


def sector_loads(
    sector: Sector, rolls: np.ndarray, fineness: MeshSizing
) -> tuple[np.ndarray, np.ndarray]:
    """Unit line loads into the flank.

    **Arguments:**

    - `sector`: of the gear.
    - `rolls`: from the gear's own base tangent point [m].
    - `fineness`: gives the width.

    **Returns:**

    Nodal loads, a column for each roll [-], and half-widths of the pressure [m].
    """
    section = sector.section
    base, module = float(section.base_radius), float(section.module)
    first, last = 0.5 * base * sector.flank_roll[[0, -1]] ** 2
    least = 0.6 * fineness.flank * module
    centre = np.clip(0.5 * rolls**2 / base, first + least, last - least)
    half_width = np.minimum(fineness.half_width * module, np.minimum(centre - first, last - centre))
    # p ds = 2/pi cos^2(t) dt with s = a sin(t), along the arc s of the involute.
    turn = np.pi * ((np.arange(400) + 0.5) / 400 - 0.5)
    weight = 2.0 * np.cos(turn) ** 2 / 400
    arc = centre[:, None] + half_width[:, None] * np.sin(turn)
    place = np.sqrt(2.0 / base * arc)
    ends = sector.flank_roll[::2]
    cell = np.clip(np.searchsorted(ends, place) - 1, 0, len(ends) - 2)
    t = 2.0 * (place - ends[cell]) / (ends[cell + 1] - ends[cell]) - 1.0
    # The normal's inclination, roll angle less half the angle of the tooth at the base circle.
    inclined = np.sqrt(2.0 * centre / base) - float(section.half_angle(0.0 * section.teeth))
    direction = -np.stack([np.cos(inclined), np.sin(inclined)])
    nodes = sector.unknown[sector.flank[0], sector.flank[1] :]
    loads = np.zeros((sector.basis.N, len(rolls)))
    number = np.broadcast_to(np.arange(len(rolls))[:, None], cell.shape)
    for offset, shape in enumerate((0.5 * t * (t - 1.0), 1.0 - t**2, 0.5 * t * (t + 1.0))):
        for axis in (0, 1):
            at = nodes[2 * cell + offset, axis]
            np.add.at(loads, (at, number), weight * shape * direction[axis][:, None])
    return loads, half_width


def _reduce(sector: Sector, loads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sector without its inside: stiffness of, loads on, and compliance beside its cuts.

    On the cuts, directions are radial and tangential, alike in neighbouring sectors.
    """
    cut = np.concatenate([side.ravel() for side in sector.cuts])
    turns = []
    for side in sector.cuts:
        x, y = sector.basis.doflocs[:, side[-1, 0]]
        to_polar = np.array([[x, y], [y, -x]]).T / np.hypot(x, y)
        turns.append(np.kron(np.eye(len(side)), to_polar))
    turn = scipy.linalg.block_diag(*turns)
    inside = np.setdiff1d(np.arange(sector.basis.N), np.concatenate([cut, sector.bore]))
    stiffness = sector.stiffness
    coupling = stiffness[inside][:, cut] @ turn
    solver = splu(
        stiffness[inside][:, inside].tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    answer = solver.solve(np.hstack([coupling, loads[inside]]))
    from_cut, from_load = answer[:, : len(cut)], answer[:, len(cut) :]
    reduced = turn.T @ (stiffness[cut][:, cut] @ turn) - coupling.T @ from_cut
    return reduced, -coupling.T @ from_load, loads[inside].T @ from_load


def _close_ring(reduced: np.ndarray, on_cut: np.ndarray, teeth: int) -> np.ndarray:
    """Compliance through the ring of sectors, from each sector reduced to its two cuts."""
    half = len(reduced) // 2
    (ll, lr), (rl, rr) = ([k[:, :half], k[:, half:]] for k in (reduced[:half], reduced[half:]))
    spectrum = []
    for harmonic in range(teeth // 2 + 1):
        wave = np.exp(2j * np.pi * harmonic / teeth)
        load = on_cut[:half] + on_cut[half:] / wave
        spectrum.append(load.conj().T @ np.linalg.solve(ll + rr + wave * lr + rl / wave, load))
    return np.fft.irfft(np.array(spectrum), teeth, axis=0)


@dataclass(frozen=True)
class FEMesh:
    """Compliances of a gear pair at places a fraction of the base pitch apart.

    **Fields:**

    - `rolls`: positions on the path of contact, from the pinion's base tangent point [m].
    - `per_pitch`: how many of them make a base pitch [-].
    - `gears`: pinion and wheel.
    - `own`: compliance of a single tooth pair at each, secant at the line load [m2/N].
    """

    rolls: np.ndarray
    per_pitch: int
    gears: tuple[FEGear, FEGear]
    own: np.ndarray

    def matrix(self, places: Sequence[int]) -> np.ndarray:
        """Compliances between simultaneous contacts at these places, one pitch apart [m2/N]."""
        pinion, wheel = self.gears
        teeth = np.rint((np.asarray(places) - places[0]) / self.per_pitch).astype(int)
        both = pinion.matrix(places, list(teeth)) + wheel.matrix(places, list(-teeth))
        np.fill_diagonal(both, self.own[list(places)])
        return both


def hertz_half_width(pair: jg.GearPair, rolls: np.ndarray, line_load: float) -> np.ndarray:
    """Of the contact at positions on the path [m], under a line load [N/m]."""
    length = float(pair.tangent_length)
    radius = rolls * (length - rolls) / length
    soft = sum(
        (1.0 - float(g.material.poisson) ** 2) / float(g.material.young)
        for g in (pair.pinion, pair.wheel)
    )
    return np.sqrt(4.0 * line_load * radius * soft / np.pi)


def fe_mesh_compliance(
    pair: jg.GearPair,
    rolls: np.ndarray,
    line_load: float,
    per_pitch: int = 1,
    **options,
) -> FEMesh:
    """Solve both gears for contacts at positions on the path of contact.

    **Arguments:**

    - `pair`: spur, both bores given.
    - `rolls`: from the pinion's base tangent point [m].
    - `line_load`: for the width of the contacts [N/m].
    - `per_pitch`: how many of the rolls make a base pitch [-].
    - `options`: of `fe_gear`.

    **Returns:**

    Compliances of the pair.
    """
    pinion = fe_gear(pair, 0, rolls, **options)
    wheel = fe_gear(pair, 1, float(pair.tangent_length) - rolls, **options)
    hertz = hertz_half_width(pair, rolls, line_load)
    return FEMesh(
        rolls=np.asarray(rolls),
        per_pitch=per_pitch,
        gears=(pinion, wheel),
        own=pinion.own(hertz) + wheel.own(hertz),
    )


def fe_path(pair: jg.GearPair, per_pitch: int) -> np.ndarray:
    """Positions on the path of contact, `per_pitch` to the base pitch, none at its ends [m]."""
    step = float(pair.transverse_base_pitch) / per_pitch
    count = int(np.floor(float(pair.path_of_contact) / step))
    spare = float(pair.path_of_contact) - (count - 1) * step
    # The last stretch may hold one position more or less: centred, so that neither end is met.
    return float(pair.path_start) + 0.5 * spare + step * np.arange(count)


def solve_contacts(matrix: np.ndarray, gap: np.ndarray, load: float) -> tuple[float, np.ndarray]:
    """Approach and forces of unilateral contacts: closed ones carry, open ones do not overlap.

    **Arguments:**

    - `matrix`: compliances between the contacts [m2/N].
    - `gap`: of each at rest [m].
    - `load`: that they carry together [N/m].

    **Returns:**

    Approach [m], and the line load of each contact [N/m].
    """
    closed = np.ones(len(gap), bool)
    for _ in range(2 ** len(gap)):
        inner = np.linalg.inv(matrix[np.ix_(closed, closed)])
        approach = (load + np.sum(inner @ gap[closed])) / np.sum(inner)
        force = np.zeros(len(gap))
        force[closed] = inner @ (approach - gap[closed])
        overlap = approach - gap - matrix @ force
        if np.any(force < 0.0):
            closed &= force >= 0.0
        elif np.any(overlap[~closed] > 1e-12 * approach):
            closed |= overlap > 1e-12 * approach
        else:
            return float(approach), force
    raise RuntimeError("The contacts neither open nor close.")


Gap = Callable[[np.ndarray], np.ndarray]


def transmission_error(
    mesh: FEMesh, line_load: float, gap: Gap = np.zeros_like, load_updates: int = 0
) -> np.ndarray:
    """Approach along the line of action, at each phase of a mesh period.

    **Arguments:**

    - `mesh`: compliances, from `fe_path` positions at this line load.
    - `line_load`: that all pairs carry together [N/m].
    - `gap`: between the flanks, over the position on the path [m].
    - `load_updates`: how often contacts get the Hertz width of the load found on them [-].

    **Returns:**

    `per_pitch` values [m].
    """
    opening = gap(mesh.rolls)
    narrower = sum(1.0 / (np.pi * gear.plane_modulus) for gear in mesh.gears)
    error = []
    for phase in range(mesh.per_pitch):
        places = list(range(phase, len(mesh.rolls), mesh.per_pitch))
        matrix = mesh.matrix(places)
        approach, force = solve_contacts(matrix, opening[places], line_load)
        for _ in range(load_updates):
            share = np.maximum(force / line_load, 1e-3)
            local = np.diag(-narrower * np.log(share))
            approach, force = solve_contacts(matrix + local, opening[places], line_load)
        error.append(approach)
    return np.array(error)


def fe_transmission_error(
    pair: jg.GearPair,
    torque: float,
    phases: int,
    gap: Gap = np.zeros_like,
    load_updates: int = 0,
    **options,
) -> np.ndarray:
    """Loaded transmission error of a spur pair over a mesh period, rigid shafts in the bores.

    **Arguments:**

    - `pair`: spur, both bores given.
    - `torque`: on the pinion [N m].
    - `phases`: of the mesh period [-].
    - `gap`: between the flanks, over the position on the path [m]; none for nominal flanks.
    - `load_updates`: how often contacts get the Hertz width of the load found on them [-].
    - `options`: of `fe_gear`.

    **Returns:**

    Along the line of action, at each phase [m].
    """
    load = torque / float(pair.base_radius[0]) / float(pair.face_width)
    mesh = fe_mesh_compliance(pair, fe_path(pair, phases), load, phases, **options)
    return transmission_error(mesh, load, gap, load_updates)
