r"""Contact lines on the plane of action, at every phase of one cycle of mesh periods.

A phase $\tau$ counts mesh periods, from 0 or, where contact is looked for beyond the path, from
that much earlier; at $\tau = 0$ a tooth pair enters contact at
mid-face. Line $i$ runs through $x = T_1A + (\tau + i)\,p_{bt} + z\tan\beta_b$ (ISO 21771-1), with
$x$ along the path of contact from the pinion's base tangent point, $z$ along the axes from
mid-face.

Shapes are fixed: `lines` lines of `slices` slices at each phase, each slice with the
fraction of it that is in contact. Two choices make the fractions differentiable:

- Phases are mid-points of equal steps, one set between the entry of a pair and the exit of
  the pair ahead of it, one set between that exit and the next entry. The sets stretch with the
  contact ratio, so no phase straddles a spur pair's event and nothing jumps between two whole
  contact ratios; at one of them the sets change places.
- A slice's fraction is its share inside the path, averaged over the step of its phase: the
  overlap of the path with the parallelogram that the slice sweeps.
"""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._geometry._pair import (
    GearPair,
    overlap_ratio,
    pair_facts,
    profile_contact_ratio,
)
from jaxgear._types import CellNumbers, Flag, LineGrid, LineNumbers, Phases, Reals, Scalar, Slices


class MeshGrid(eqx.Module):
    """How finely a mesh period is divided. Integers only: it selects a program.

    **Fields:**

    - `phases`: positions in one mesh period.
    - `slices`: slices across the face.
    - `lines`: contact lines kept at each phase.
    - `first_line`: index of the line furthest ahead of entry, -1 for spur gears.
    - `entry_phases`: phases between a pair's entry and the exit of the pair ahead.
    - `abreast`: contact lines of these that are in contact at one place of the face.
    - `periods`: mesh periods in one cycle.
    - `beyond`: how far contact is looked for beyond either end of the path, in base
        pitches [-].
    """

    phases: int = eqx.field(static=True)
    slices: int = eqx.field(static=True)
    lines: int = eqx.field(static=True)
    first_line: int = eqx.field(static=True)
    entry_phases: int = eqx.field(static=True)
    abreast: int | None = eqx.field(static=True, default=None)
    periods: int = eqx.field(static=True, default=1)
    beyond: float = eqx.field(static=True, default=0.0)

    @property
    def cells(self) -> int:
        """Number of cells at each phase."""
        return self.lines * self.slices


def mesh_grid(
    pair: GearPair,
    *,
    phases: int = 64,
    slices: int = 20,
    periods: int = 1,
    beyond: float = 0.0,
    margin: float = 0.05,
    fixed_face: bool = False,
) -> MeshGrid:
    """Choose the grid for a pair. Call it outside of `jit`, on concrete gears.

    **Arguments:**

    - `pair`: the gears.
    - `phases`: positions in one mesh period, at least 8.
    - `slices`: slices across the face, at least 1.
    - `periods`: mesh periods in one cycle; pitch errors and eccentricities need several.
    - `beyond`: how far tip corners may touch beyond either end of the path, in base pitches; zero
        leaves such contact out, 0.25 suffices for common loads [-].
    - `margin`: by how much the contact ratios may grow, in traced copies of this pair, before
        contact at the ends of the path is lost from the grid [-].
    - `fixed_face`: whether helix angle and face width stay what they are: a spur pair then has no
        line that is about to enter.

    **Returns:**

    The grid.

    **Raises:**

    - `ValueError` if there are too few phases or slices.
    """
    require(phases >= 8, "A mesh period needs at least 8 phases, got {got}.", got=phases)
    require(slices >= 1, "The face needs at least 1 slice, got {got}.", got=slices)
    require(
        0.0 <= beyond < 0.5,
        "Contact `beyond` the path is looked for over 0 to 0.5 base pitches, got {got:.6g}.",
        got=beyond,
    )
    require(periods >= 1, "A cycle has at least 1 mesh period, got {got}.", got=periods)
    facts = pair_facts(pair)
    profile = float(facts.profile_contact_ratio) + 2.0 * beyond
    overlap = float(facts.overlap_ratio)
    half_overlap = 0.5 * overlap
    require(
        overlap <= slices * profile,
        "A slice covers {got:.3g} base pitches of the path of contact, which has only {limit:.3g}: "
        "use at least {least} slices across this face.",
        got=overlap / slices,
        limit=profile,
        least=math.ceil(overlap / profile),
    )
    # Spur gears too: the derivative by the helix angle needs the line that is about to enter.
    ahead = math.ceil(half_overlap + (0.0 if fixed_face else margin))
    last = math.floor(profile + half_overlap + margin)
    # An eighth of the phases at least on either side of the event, so that a contact ratio that
    # crosses an integer in a traced copy still finds both sets populated.
    fewest = phases // 8
    share = round(phases * (profile - math.floor(profile)))
    entry = min(max(share, fewest), phases - fewest)
    # A cell is in contact until all of it has left the path in all of its phase.
    whole = math.floor(profile)
    step = max((profile - whole) / entry, (whole + 1.0 - profile) / (phases - entry))
    abreast = math.ceil(profile + margin + step + overlap / slices)
    return MeshGrid(
        phases=phases,
        slices=slices,
        lines=last + ahead + 1,
        first_line=-ahead,
        entry_phases=entry,
        abreast=abreast if abreast < last + ahead + 1 else None,
        periods=periods,
        beyond=beyond,
    )


class ContactLines(eqx.Module):
    r"""Where the slices of all contact lines are, over one cycle.

    **Fields:**

    - `phase`: $\tau$, the position in the cycle, in mesh periods [-].
    - `weight`: share of the cycle that each phase stands for; sums to 1 [-].
    - `tooth`: number of the tooth pair on each line, in the order of entry; 0 enters at
        phase 0 [-].
    - `roll`: place on the path of contact of each slice's middle, from $T_1$ [m].
    - `face_position`: $z$ of each slice's middle, from mid-face [m].
    - `fraction`: part of each slice that is in contact, 0 to 1 [-].
    - `length`: length of a slice along its contact line [m].
    - `complete`: whether the grid holds every line that is in contact.
    - `kept`: of each phase, numbers of the cells that may be in contact, or `None`: all [-].
    - `periods`: mesh periods in the cycle.
    - `beyond`: how far contact is looked for beyond either end of the path, in base pitches [-].
    """

    phase: Phases
    weight: Phases
    tooth: LineNumbers
    roll: LineGrid
    face_position: Slices
    fraction: LineGrid
    length: Scalar
    complete: Flag
    kept: CellNumbers | None = None
    periods: int = eqx.field(static=True, default=1)
    beyond: float = eqx.field(static=True, default=0.0)


@compiled
def contact_lines(pair: GearPair, grid: MeshGrid) -> ContactLines:
    """Place the slices of all contact lines over one cycle (theory 1.13).

    **Arguments:**

    - `pair`: the gears.
    - `grid`: from `mesh_grid` of this pair or a close one.

    **Returns:**

    Positions and active fractions. Look at `complete` if the pair has outgrown its grid.
    """
    edges = _phase_edges(_window(pair, grid), grid)
    lines = lines_on_steps(pair, grid, edges, edges[:-1, None], edges[1:, None])
    return repeated_lines(lines, grid.periods)


def lines_on_steps(
    pair: GearPair, grid: MeshGrid, edges: Phases, first: Reals, last: Reals
) -> ContactLines:
    """Place the slices of all contact lines on given steps.

    All in mesh periods from the entry of a pair, at mid-face, into the path or, where contact
    is looked for beyond it, into the window that begins earlier.

    **Arguments:**

    - `pair`: the gears.
    - `grid`: lines and slices.
    - `edges`: ends of the steps [-].
    - `first`, `last`: least and greatest advance of the teeth within each step; one for all slices,
        or one for each [-].

    **Returns:**

    Positions in the middle of each step, fractions averaged over it.
    """
    pitch = pair.transverse_base_pitch
    ratio = _window(pair, grid)
    phase = 0.5 * (edges[:-1] + edges[1:]) - grid.beyond
    middle = 0.5 * (first + last) - grid.beyond
    line = jnp.arange(grid.lines, dtype=float) + grid.first_line
    face_position = face_positions(pair, grid)
    slope = jnp.tan(pair.base_helix_angle)
    last_line, half_overlap = grid.first_line + grid.lines - 1, 0.5 * overlap_ratio(pair)
    # In base pitches from the start of the path; at a phase's edges, and in its middle.
    place = line[None, :, None] + (slope * face_position / pitch)[None, None, :]
    fraction = _swept_fraction(
        first[:, None, :] + place,
        last[:, None, :] + place,
        ratio,
        stretch=overlap_ratio(pair) / grid.slices,
    )
    # The pair on line i entered i mesh periods ago.
    tooth = -jnp.arange(grid.first_line, grid.first_line + grid.lines)
    kept, complete = None, (ratio + half_overlap <= last_line + 1.0)
    complete &= half_overlap <= -grid.first_line
    if grid.abreast is not None:
        kept = _near_path(middle[:, None, :] + place, ratio, grid.abreast)
        flat = fraction.reshape(phase.size, -1)
        held = jnp.take_along_axis(flat, kept, axis=1)
        # Fractions of cells long out of mesh are zero but for rounding.
        seen, found = (jnp.sum(x > _ROUNDING, axis=1) for x in (flat, held))
        complete &= jnp.all(seen == found)
    return ContactLines(
        phase=phase,
        weight=edges[1:] - edges[:-1],
        tooth=jnp.broadcast_to(tooth, (phase.size, grid.lines)),
        roll=pair.path_start + (middle[:, None, :] + place) * pitch,
        face_position=face_position,
        fraction=fraction,
        length=pair.face_width / (grid.slices * jnp.cos(pair.base_helix_angle)),
        complete=complete,
        kept=kept,
        beyond=grid.beyond,
    )


# In base pitches. In the middle of the positions at which two lines bear both are equally near:
# rounding would choose, and XLA, which may work a place out twice, once each way. What is taken by
# one order would be put back by the other.
_ASIDE = 1e-6


def _near_path(place: Reals, ratio: Scalar, abreast: int) -> CellNumbers:
    """Cells of the lines that at each slice are nearest to the path, as many at every slice.

    `place` is in base pitches from the start of the path, and grows by one from line to line. The
    line nearest to the middle of the path comes first: where one is in contact, it is that one.
    """
    phases, lines, slices = place.shape
    place = place - _ASIDE
    ahead = jnp.ceil(0.5 * (ratio - abreast) - place[:, 0]).astype(int)
    first = jnp.clip(ahead, 0, lines - abreast)
    nearest = jnp.round(0.5 * ratio - place[:, 0]).astype(int) - first
    after = jnp.clip(nearest, 0, abreast - 1)[:, None, :] + jnp.arange(abreast)[None, :, None]
    line = first[:, None, :] + after % abreast
    return (line * slices + jnp.arange(slices)[None, None, :]).reshape(phases, -1)


def face_positions(pair: GearPair, grid: MeshGrid) -> Slices:
    """Middles of the slices, from mid-face [m]."""
    position = (jnp.arange(grid.slices, dtype=float) + 0.5) / grid.slices - 0.5
    return position * pair.face_width


def repeated_lines(lines: ContactLines, periods: int) -> ContactLines:
    """Lines of one mesh period, repeated over a cycle of several, with the next teeth in each.

    **Arguments:**

    - `lines`: of one mesh period.
    - `periods`: of the cycle.

    **Returns:**

    The lines of the cycle.
    """
    if periods == 1:
        return lines
    again = lambda x: jnp.concatenate([x] * periods)
    period = np.repeat(np.arange(periods), lines.phase.size)
    return dataclasses.replace(
        lines,
        periods=periods,
        phase=again(lines.phase) + jnp.asarray(period, dtype=float),
        weight=again(lines.weight) / periods,
        kept=None if lines.kept is None else again(lines.kept),
        tooth=again(lines.tooth) + jnp.asarray(period)[:, None],
        roll=again(lines.roll),
        fraction=again(lines.fraction),
    )


@compiled
def mean_line_length(pair: GearPair) -> Scalar:
    r"""Mean total length of the contact lines, $\varepsilon_\alpha b / \cos\beta_b$ [m]."""
    return profile_contact_ratio(pair) * pair.face_width / jnp.cos(pair.base_helix_angle)


def _window(pair: GearPair, grid: MeshGrid) -> Scalar:
    """Length over which contact is looked for, in base pitches [-].

    Where tip corners may touch, the path is longer at both ends, and phases start earlier.
    """
    return profile_contact_ratio(pair) + 2.0 * grid.beyond


def _phase_edges(ratio: Scalar, grid: MeshGrid) -> Phases:
    """Ends of the steps of all phases, from 0 over the exit of the pair ahead to 1.

    The exit is met to the last digit, so that no rounding shifts a spur pair's events.
    """
    exit_phase = ratio - jnp.floor(ratio)
    before, after = grid.entry_phases, grid.phases - grid.entry_phases
    first = exit_phase * (jnp.arange(before + 1, dtype=float) / before)
    second = 1.0 - (1.0 - exit_phase) * (jnp.arange(after - 1, -1, -1, dtype=float) / after)
    return jnp.concatenate([first, second])


# Corner of the active fraction of a spur pair's slice, which covers no path, and the least step of
# a phase, which vanishes at whole contact ratios [base pitches].
_THINNEST, _SHORTEST = 1e-10, 1e-12
# Least fraction that is no rounding: of ramps up to many base pitches, over a phase [-].
_ROUNDING = 1e-9


def _swept_fraction(first: Reals, last: Reals, ratio: Scalar, *, stretch: Scalar) -> Reals:
    """Share of a slice inside the path [0, ratio], averaged over its advance in one phase.

    In base pitches: the slice's middle moves from `first` to `last`, and its own width covers
    `stretch` of the path.
    """
    thin = jnp.maximum(stretch, _THINNEST)
    last = jnp.where(last - first > _SHORTEST, last, first + _SHORTEST)
    inside = _rounded_ramp(last, thin) - _rounded_ramp(first, thin)
    inside -= _rounded_ramp(last - ratio, thin) - _rounded_ramp(first - ratio, thin)
    return jnp.clip(inside / (last - first), 0.0, 1.0)


def _rounded_ramp(x: Reals, width: Scalar) -> Reals:
    """Mean of max(0, x + s) over s uniform in a band of this width about zero."""
    inside = jnp.clip(x / width + 0.5, 0.0, 1.0)
    return 0.5 * width * inside**2 + jnp.maximum(x - 0.5 * width, 0.0)
