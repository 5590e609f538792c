r"""Transmission error and its statistics over a cycle of mesh periods.

$TE = r_{b1}\theta_1 + r_{b2}\theta_2$ at the two gear nodes, a transverse length. Phases stand for
unequal shares of the period, so every mean is weighted.
"""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._contact._cells import MeshCells
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._smooth import smooth_maximum
from jaxgear._solve._cycle import MeshCycle
from jaxgear._types import CellGrid, Harmonics, Phases, Scalar


@compiled
def transmission_error(pair: GearPair, cycle: MeshCycle) -> Phases:
    """Transmission error at each phase [m], positive where the pinion runs ahead (theory 5.5)."""
    return cycle.approach / jnp.cos(pair.base_helix_angle)


@compiled
def unloaded_transmission_error(pair: GearPair, cells: MeshCells, gap: CellGrid) -> Phases:
    r"""Transmission error without load, of rigid gears: their kinematic error.

    Flanks touch at one point, that of least gap $e_i$ along the normal:
    $\min_i e_i/\cos\beta_b$, the envelope of what all tooth pairs would do by themselves (Guilbert
    2017, fig. I-12). Bodies, bearings and loads from outside have no part in it.

    **Arguments:**

    - `pair`: the gears.
    - `cells`: in mesh.
    - `gap`: of each cell, from `mesh_gap` [m].

    **Returns:**

    At each phase [m], positive where the pinion runs ahead: where material is missing.
    """
    least = jnp.min(jnp.where(cells.stiffness > 0.0, gap, jnp.inf), axis=1)
    return least / jnp.cos(pair.base_helix_angle)


@compiled
def cycle_mean(cycle: MeshCycle, values: Phases) -> Scalar:
    """Mean of `values` over the cycle, in their unit."""
    return jnp.sum(cycle.cells.lines.weight * values)


@compiled
def cycle_variance(cycle: MeshCycle, values: Phases) -> Scalar:
    """Mean square of the fluctuation of `values` about their mean, in their unit squared.

    Optimise this rather than the RMS, whose slope is 0/0 where it vanishes.
    """
    return cycle_mean(cycle, (values - cycle_mean(cycle, values)) ** 2)


@compiled
def cycle_rms(cycle: MeshCycle, values: Phases) -> Scalar:
    """RMS of the fluctuation of `values` about their mean, in their unit."""
    return jnp.sqrt(cycle_variance(cycle, values))


@compiled
def peak_to_peak(values: Phases) -> Scalar:
    """Largest less smallest of `values`, in their unit."""
    return jnp.max(values) - jnp.min(values)


@compiled
def smooth_peak_to_peak(values: Phases, width: Scalar) -> Scalar:
    """Differentiable `peak_to_peak`; too large by `2 width log(phases)` at the most (theory 11.5).

    **Arguments:**

    - `values`: at each phase.
    - `width`: of the smoothing, in the unit of `values`.

    **Returns:**

    The range, in the unit of `values`.
    """
    return smooth_maximum(values, width) + smooth_maximum(-values, width)


@compiled
def harmonic_amplitudes(cycle: MeshCycle, values: Phases, count: int) -> Harmonics:
    """Amplitudes of the first mesh harmonics.

    **Arguments:**

    - `cycle`: gives phases and weights.
    - `values`: at each phase.
    - `count`: number of harmonics, from the first; fewer than half the phases.

    **Returns:**

    Peak amplitude of each, in the unit of `values`.
    """
    return harmonics_of_phases(cycle.cells.lines, values, count)


def harmonics_of_phases(lines: ContactLines, values: Phases, count: int) -> Harmonics:
    """As `harmonic_amplitudes`, of contact lines that no load has been put on."""
    order = jnp.arange(1, count + 1, dtype=float)
    angle = 2.0 * jnp.pi * order[:, None] * lines.phase[None, :]
    # Uneven phases would let the mean leak into the harmonics.
    weighted = (lines.weight * (values - jnp.sum(lines.weight * values)))[None, :]
    real = jnp.sum(weighted * jnp.cos(angle), axis=1)
    imaginary = jnp.sum(weighted * jnp.sin(angle), axis=1)
    return 2.0 * jnp.hypot(real, imaginary)
