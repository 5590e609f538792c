"""The power pair at 3000 rad/s with corrections of its pinion, per web: answers and optima.

The webs are those of `power-h1` with the thicknesses of the thesis's Tab. IV-9.
"""

import dataclasses
import functools
import time
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
import optimise
from jaxgear import example_scene, grid_of, model_of
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.study._dynamics import damping_of

from .statics import THESIS, web

um, mm, MPa = 1e-6, 1e-3, 1e6
SPEED = 3000.0
# Tab. IV-9: the web of the wheel as it is, 24 % and 48 % thinner.
WEBS = {"O": 6.5, "D": 4.94, "E": 3.38}
# The thesis gives no hand of the helix; thrust tilts the rim one way or the other. With that of the
# example, right-handed pinion, the load at rest leans to the side that rotation loads as well.
LEFT_HANDED = {f"{label}, left": thickness for label, thickness in WEBS.items()}
# Slices that feel each other.
COUPLED = {f"{label}, coupled": thickness for label, thickness in WEBS.items()}
COARSE = ("mesh.slices=10", "mesh.phases=64", "sweep.steps=64")
LAW = jg.ExactContact()
BALANCE = jg.HarmonicBalance(harmonics=14, averaged=True)
# Of the smooth maxima that searches look at, one after the other; what is told is exact.
WIDTHS = 5.0 * MPa, 0.5 * MPa
# Fig. IV-33: share of the face that is relieved at its loaded end.
END = 0.4


# --- The pairs


class Pair(NamedTuple):
    """The power pair with one web, without corrections.

    `quick` and `still` are its meshes at `SPEED` and at rest.
    """

    model: jg.PairModel
    grid: jg.MeshGrid
    damping: jg.AbstractDamping
    quick: jg.PreparedMesh
    still: jg.PreparedMesh


@functools.cache
def pair_with(label: str) -> Pair:
    """The pair with the web of a test case."""
    settings = [*COARSE, f"sweep.pinion_speed_rad_s=[{SPEED}]", f"mesh.pinion_speed_rad_s={SPEED}"]
    if label in LEFT_HANDED:
        settings.append("pair.helix_angle_deg=-12.0")
    if label in COUPLED:
        settings.append('mesh.face_coupling="coupled"')
    thickness = (WEBS | LEFT_HANDED | COUPLED)[label]
    scene = example_scene("power-h1", [*THESIS, *settings, *web(web_thickness_mm=thickness)])
    scene = with_bodies(scene, moving=True)
    model = model_of(scene)
    grid = grid_of(scene, model, scene.sweep.steps)
    resting = dataclasses.replace(model, speed=jnp.zeros(()))
    damping = damping_of(scene.damping)
    return Pair(model, grid, damping, prepared(model, grid), prepared(resting, grid))


prepared = eqx.filter_jit(jg.prepare_mesh)

# Of the pinion's flank [um].
KINDS = ("crowning", "elliptical", "relief", "left relief", "slope")

RELIEFS = "relief", "left relief"


def corrected(model: jg.PairModel, depths) -> jg.PairModel:
    """The pair with corrections of `KINDS`; relief of either end is linear over `END`."""
    parabolic, elliptical, relief, left, slope = um * depths
    parts = (
        jg.Crowning(parabolic),
        jg.EllipticalCrowning(elliptical),
        jg.EndRelief(relief, END, left=False),
        jg.EndRelief(left, END, right=False),
        jg.HelixSlope(slope),
    )
    flanks = jg.Flanks(jg.Superposed(parts), jg.Superposed())
    return eqx.tree_at(lambda m: m.flanks, model, flanks)


class Across(NamedTuple):
    """What the flanks carry.

    `pressure` largest at each slice [MPa], `load` mean per face width [N/mm], `ends` largest line
    load at the left and right end [N/mm], `offset` of the pressure over half the face [-], `rms` of
    the transmission error [um].
    """

    pressure: np.ndarray
    load: np.ndarray
    ends: np.ndarray
    offset: float
    rms: float

    @property
    def highest(self) -> float:
        """Largest pressure [MPa]."""
        return float(self.pressure.max())

    @property
    def evenness(self) -> float:
        """Face load factor [-]."""
        return float(self.load.max() / self.load.mean())

    def place(self) -> float:
        """Where the largest pressure is, from mid-face over half the face [-]."""
        count = len(self.pressure)
        return float((2.0 * np.argmax(self.pressure) + 1.0) / count - 1.0)


@eqx.filter_jit
def _across(model, prepared, depths):
    own = corrected(model, depths)
    cycle = jg.corrected_cycle(prepared, own, law=LAW)
    line = jnp.max(jg.line_load(cycle, LAW), axis=(0, 1))
    found = (
        jnp.max(jg.hertz_pressure(own.pair, cycle, LAW), axis=(0, 1)) / MPa,
        jg.face_load(own.pair, cycle) * mm,
        line[jnp.asarray([0, -1])] * mm,
        # Hardly smoothed: as good as exact.
        optimise.pressure_offset(own.pair, cycle, LAW, jnp.asarray(0.05 * MPa)),
        jg.cycle_rms(cycle, jg.transmission_error(own.pair, cycle)) / um,
    )
    return found, jnp.all(cycle.converged)


def seen_across(model: jg.PairModel, mesh: jg.PreparedMesh, depths: Sequence[float]) -> Across:
    """What the flanks of a pair carry with corrections of its pinion."""
    found, solved = _across(model, mesh, jnp.asarray(depths))
    assert bool(solved), "the contact was not solved at some phase"
    pressure, load, ends, offset, rms = (np.asarray(x) for x in found)
    return Across(pressure, load, ends, float(offset), float(rms))


def across(label: str, depths: Sequence[float], *, still: bool = False) -> Across:
    """A pair with corrections, quasi-static: with centrifugal load, or at rest."""
    pair = pair_with(label)
    return seen_across(pair.model, pair.still if still else pair.quick, depths)


@eqx.filter_jit
def _slopes(model, prepared, weights, width, depths):
    parts = optimise.PressureOffset(width), optimise.LargestPressure(width)

    def value(depths):
        own = corrected(model, depths)
        cycle = jg.corrected_cycle(prepared, own, law=LAW)
        return optimise.WeightedSum(parts=parts, weights=weights)(own, cycle, LAW)

    return jax.value_and_grad(value)(depths)


# What a search makes small: the squared offset in percent, or the pressure in 100 MPa.
AIMS = {"centred": (1e4, 0.0), "even": (0.0, 1e-2)}


class Optimum(NamedTuple):
    """Where a search ended: depths of `KINDS` [um], gradients, seconds without compiling."""

    depths: np.ndarray
    evaluations: int
    seconds: float


@functools.cache
def optimum(label: str, aim: str, vary: tuple[str, ...]) -> Optimum:
    """Corrections of a pair that centre its pressure, or make the largest least.

    **Arguments:**

    - `label`: of the web.
    - `aim`: of `AIMS`.
    - `vary`: of `KINDS`; the others are zero.
    """
    pair, weights = pair_with(label), jnp.asarray(AIMS[aim])
    # Where the load leans to the left, so do its corrections.
    lean = -1.0 if label in LEFT_HANDED else 1.0
    if lean < 0.0:
        vary = tuple("left relief" if kind == "relief" else kind for kind in vary)
    at = np.asarray([KINDS.index(kind) for kind in vary], dtype=int)

    def with_slope(width, depths):
        full = jnp.zeros(len(KINDS)).at[at].set(depths)
        value, slope = _slopes(pair.model, pair.quick, weights, jnp.asarray(width), full)
        return value, slope[at]

    point = np.asarray([-2.0 * lean if kind == "slope" else 2.0 for kind in vary])
    lower = np.asarray([-60.0 if kind == "slope" else 0.0 for kind in vary])
    box = optimise.Box(lower, np.full(len(vary), 60.0))
    with_slope(WIDTHS[0], point)
    begun, evaluations = time.perf_counter(), 0
    for width in WIDTHS:
        # One of a width after the other, each from where the one before has ended.
        own = optimise.ValueAndGradient(functools.partial(with_slope, width))
        found = optimise.lbfgs(own, point, box)
        point, evaluations = found.point, evaluations + found.gradient_evaluations
    depths = np.zeros(len(KINDS))
    depths[at] = point
    return Optimum(depths, evaluations, time.perf_counter() - begun)


@eqx.filter_jit
def _in_motion(model, grid, damping, depths):
    dynamics = jg.pair_dynamics(corrected(model, depths), grid, damping)
    orbit = jg.steady_state(dynamics.system, jnp.asarray(SPEED), BALANCE)
    pressure = jnp.max(jg.dynamic_pressure(dynamics, orbit), axis=(0, 1)) / MPa
    return jg.dynamic_ratio(dynamics.system, orbit), pressure, orbit.settled


class Motion(NamedTuple):
    """The response at `SPEED`: dynamic ratio [-] and largest pressure at each slice [MPa]."""

    ratio: float
    pressure: np.ndarray


def in_motion(label: str, depths: Sequence[float]) -> Motion:
    """The response of a pair with corrections at `SPEED`."""
    pair = pair_with(label)
    ratio, pressure, settled = _in_motion(pair.model, pair.grid, pair.damping, jnp.asarray(depths))
    assert bool(settled), "no response was found"
    return Motion(float(ratio), np.asarray(pressure))


def only(kind: str, depth: float) -> list[float]:
    """Depths of `KINDS` of which all but one are zero."""
    return [depth if each == kind else 0.0 for each in KINDS]


PLAIN = only("crowning", 0.0)
