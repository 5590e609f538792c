"""The quasi-static part of a run: what is solved, and what of it goes into the summary."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._contact._cells import mesh_gap, nominal_line_load
from jaxgear._contact._iso import iso_stiffness
from jaxgear._contact._root_influence import Influences
from jaxgear._contact._shared import shared_compliance
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._sliding import sliding_speed, specific_sliding
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._response._factors import (
    face_load_factor,
    pressure_angle_change,
    transverse_load_factor,
)
from jaxgear._response._loads import (
    corner_pressure,
    hertz_pressure,
    line_load,
    mesh_stiffness,
    pressure_off_ends,
)
from jaxgear._response._losses import mesh_loss_factor
from jaxgear._response._root_stress import root_stress, slice_load
from jaxgear._response._transmission import (
    cycle_mean,
    cycle_rms,
    harmonic_amplitudes,
    peak_to_peak,
    transmission_error,
    unloaded_transmission_error,
)
from jaxgear._solve._cycle import MeshCycle, PreparedMesh, corrected_cycle, prepare_mesh
from jaxgear._system._model import PairModel
from jaxgear._system._structure import bearing_motion
from jaxgear._types import Phases, Reals, Scalar, as_scalar
from jaxgear._units import MPa, N_per_mm_um, mm, um
from jaxgear.scene._build import couples_on_pinion
from jaxgear.scene._gear_tables import PairKeys, ShaftKeys
from jaxgear.scene._schema import GEARS
from jaxgear.study._built import BuiltScene
from jaxgear.study._results import harmonic_count, has_corners
from jaxgear.study._running import timed


class SolverFailure(RuntimeError):
    """A computation on a good scene that found no answer."""


# Largest tensile stress at the roots of each gear.
ROOT_NUMBERS = tuple(f"max_root_stress_{gear}_MPa" for gear in GEARS)
# Of the summary, the unit in each key.
Numbers = dict[str, Scalar]


class Mounts(NamedTuple):
    """Means over a cycle: motion of each gear [m, rad] and wrench of the mesh on it [N, N m].

    Of each bearing displacement and load.
    """

    motion: Reals
    wrench: Reals
    bearings: Reals


class Statics(eqx.Module):
    """A scene's model and its settled mesh cycle.

    **Fields:**

    - `model`: that was solved.
    - `grid`: phases, lines and slices.
    - `law`: contact law.
    - `cycle`: the settled states.
    - `prepared`: the mesh before its flanks are corrected, or `None` where it was not kept.
    - `numbers`: the `static` part of the summary, the unit in each key [-].
    - `standard`: the `iso6336` part of the summary, likewise [-].
    - `mounts`: mean motions and loads.
    - `angle_change`: of the pressure angle where the base radii grow by a thousandth [rad].
    - `harris`: transmission error over phase, one row per further torque [m].
    - `harris_harmonics`: amplitudes of its first mesh harmonics, one row per further torque [m].
    - `influences`: of loads on the roots, or `None` where nobody asks for them [-].
    """

    model: PairModel
    grid: MeshGrid
    law: AbstractContactLaw
    cycle: MeshCycle
    prepared: PreparedMesh | None
    numbers: Numbers
    standard: Numbers
    mounts: Mounts
    angle_change: Scalar
    harris: np.ndarray
    harris_harmonics: np.ndarray
    influences: Influences | None


def solve_statics(
    built: BuiltScene, torques: np.ndarray | None = None, influences: Influences | None = None
) -> Statics:
    """Solve the mesh cycle of a scene at its own torque, and at others for the Harris map [N m].

    Influences on the roots are those given, of the same teeth, or found where they are asked for.
    """
    model, grid, law = built.model, built.grid, built.law
    influences = influences or built.influences
    more = np.zeros(0) if torques is None else torques

    # The scene's own torque and the others in one program: it is compiled once.
    all_torques = np.concatenate([[float(model.torque)], more])
    found = timed(_solve, model, grid, law, all_torques, influences, options=QUICKLY)
    require_solved(found.converged)
    _require_bearable(model, found.told.numbers)
    return Statics(
        model=model,
        grid=grid,
        law=law,
        cycle=found.cycle,
        prepared=found.prepared,
        **found.told._asdict(),
        harris=np.asarray(found.error)[1:],
        harris_harmonics=np.asarray(found.harmonics)[1:],
        influences=influences,
    )


def settled_statics(
    model: PairModel,
    grid: MeshGrid,
    law: AbstractContactLaw,
    cycle: MeshCycle,
    influences: Influences | None = None,
) -> Statics:
    """The statics of a cycle that was solved for another purpose; without further torques."""
    told = timed(_told, model, cycle, law, influences, options=QUICKLY)
    _require_bearable(model, told.numbers)
    return Statics(
        model=model,
        grid=grid,
        law=law,
        cycle=cycle,
        prepared=None,
        **told._asdict(),
        harris=np.zeros((0, grid.phases * grid.periods)),
        harris_harmonics=np.zeros((0, harmonic_count(cycle))),
        influences=influences,
    )


def _require_bearable(model: PairModel, numbers: Numbers) -> None:
    deflection = float(numbers["single_pair_deflection_um"])
    require_bearable(deflection, float(model.pair.normal_module) / mm, float(model.torque))


def require_bearable(deflection_um: float, module_mm: float, torque: float) -> None:
    """Raise where a single tooth pair gives too much for the theory, under a torque [N m]."""
    # Weber's contact term holds while the contact is small against the tooth.
    require(
        1e-3 * deflection_um < 0.1 * module_mm,
        "A single tooth pair would deflect by {got:.3g} mm under {torque:.6g} N m, more than a "
        "tenth of the module: no tooth bears that. pair.torque_pinion_Nm is in N m; with a ring "
        "foundation the body winds up about bore_mm, where it must be held.",
        got=1e-3 * deflection_um,
        torque=torque,
    )


class _Told(NamedTuple):
    """All that a summary says of one cycle: some fields of `Statics`."""

    numbers: Numbers
    standard: Numbers
    mounts: Mounts
    angle_change: Scalar


class _Solved(NamedTuple):
    """Mesh and cycle at the first torque and what is told of it, and a few rows at all torques."""

    prepared: PreparedMesh
    cycle: MeshCycle
    told: _Told
    error: Array
    harmonics: Array
    converged: Array


def _solve(
    model: PairModel,
    grid: MeshGrid,
    law: AbstractContactLaw,
    torques: Reals,
    influences: Influences | None,
) -> _Solved:
    """Cycles at all torques, and everything that a summary says of the first."""

    def at_torque(torque: Scalar):
        loaded = eqx.tree_at(lambda m: m.torque, model, torque)
        prepared = prepare_mesh(loaded, grid)
        cycle = corrected_cycle(prepared, loaded, law=law)
        error = transmission_error(loaded.pair, cycle)
        amplitudes = harmonic_amplitudes(cycle, error, harmonic_count(cycle))
        return (prepared, cycle), error, amplitudes, cycle.converged

    whole, *rows = jax.vmap(at_torque)(torques)
    prepared, cycle = jax.tree.map(lambda x: x[0], whole)
    return _Solved(prepared, cycle, _told(model, cycle, law, influences), *rows)


def _told(
    model: PairModel, cycle: MeshCycle, law: AbstractContactLaw, influences: Influences | None
) -> _Told:
    # Of base radii that grow by a thousandth.
    change = pressure_angle_change(model.pair, 1e-3 * model.pair.base_radius)[0]
    return _Told(
        numbers=static_numbers(model, cycle, law) | root_numbers(model, cycle, influences),
        standard=iso_numbers(model),
        mounts=_mean_loads(cycle),
        angle_change=change,
    )


def require_solved(converged: Any) -> None:
    """Raise unless every contact problem was solved; the last axis of the flags is the phase."""
    flags = np.atleast_1d(np.asarray(converged))
    if not flags.all():
        bad = np.unique(np.nonzero(~flags)[-1]).tolist()
        raise SolverFailure(
            f"the contact was not solved at {np.count_nonzero(~flags)} of {flags.size} positions "
            f"(phases {bad[:8]}{' and more' if len(bad) > 8 else ''}): the forces stayed out of "
            "balance. Check that gaps and deflections are of one size (flank corrections in um), "
            "and that supports are not softer than the mesh by more than a factor of 1e6. With "
            "mesh.tip_contact, so are teeth that bend further than nominal flanks part within a "
            "quarter of a base pitch beyond the path: lower the torque."
        )


def torques_of(
    table: Literal["map", "optimise", "sizing"],
    listed: Sequence[float] | None,
    pair: PairKeys,
    shaft: ShaftKeys,
) -> np.ndarray:
    """Pinion torques that a table of a scene lists, or its own one [N m].

    Refused where couples on the pinion's shaft leave the mesh nothing of one of them.
    """
    given = [abs(pair.torque_pinion_Nm)] if listed is None else listed
    torques, couples = np.asarray(given, dtype=float), couples_on_pinion(shaft, pair.sense)
    require(
        bool(np.all(torques + couples > 0.0)),
        "{key} lists {got:g} N m, of which the couples about Z on pinion.shaft.loads, {couples:g} "
        "N m, leave the mesh nothing. List torques above {limit:g} N m.",
        key=f"{table}.torques_Nm",
        got=float(np.min(torques)),
        couples=couples,
        limit=-couples,
    )
    return torques


def iso_numbers(model: PairModel) -> Numbers:
    """Stiffnesses of ISO 6336-1 method B, whatever stiffness the scene uses."""
    pair = model.pair
    tangential = model.mesh_torque / pair.reference_radius[0]
    stiffness = iso_stiffness(pair, tangential / pair.face_width)
    return {
        "tangential_force_N": tangential,
        "c_th_N_mm_um": stiffness.theoretical / N_per_mm_um,
        "c_prime_N_mm_um": stiffness.single / N_per_mm_um,
        "c_gamma_alpha_N_mm_um": stiffness.mesh / N_per_mm_um,
        "c_gamma_beta_N_mm_um": stiffness.face / N_per_mm_um,
    }


def headline(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> Numbers:
    """The few numbers by which two flanks are compared; traceable by JAX."""
    error = transmission_error(model.pair, cycle)
    return {
        "te_mean_um": cycle_mean(cycle, error) / um,
        "te_rms_um": cycle_rms(cycle, error) / um,
        "te_peak_to_peak_um": peak_to_peak(error) / um,
        "max_line_load_N_mm": jnp.max(line_load(cycle, law)) / (1.0 / mm),
        "max_pressure_MPa": jnp.max(hertz_pressure(model.pair, cycle, law)) / MPa,
        "face_load_factor": face_load_factor(cycle),
        "transverse_load_factor": transverse_load_factor(model.pair, cycle),
    }


def root_numbers(model: PairModel, cycle: MeshCycle, influences: Influences | None) -> Numbers:
    """Largest tensile stress at the roots of each gear, where it is asked for; traceable by JAX."""
    if influences is None:
        return {}
    stress = root_stress(model.pair, influences, cycle.cells.lines, slice_load(cycle))
    return dict(zip(ROOT_NUMBERS, stress.largest / MPa, strict=True))


def static_numbers(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> Numbers:
    """The `static` part of the summary; traceable by JAX."""
    pair = model.pair
    load = nominal_line_load(pair, model.mesh_torque)
    # One call for both: the compliance takes longest to compile.
    path = pair.path_start + jnp.linspace(0.0, 1.0, 129) * pair.path_of_contact
    stiffness = 1.0 / model.compliance(pair, jnp.append(path, pair.pitch_point), load)
    largest, at_pitch = jnp.max(stiffness), stiffness[-1]
    return {
        "mesh_force_N": cycle.load[0, 0],
        **headline(model, cycle, law),
        "max_pressure_off_ends_MPa": pressure_off_ends(pair, cycle, law) / MPa,
        **_corner_numbers(model, cycle, law),
        "te_unloaded_peak_to_peak_um": _unloaded_range(model, cycle) / um,
        "single_pair_stiffness_max_N_mm_um": largest / N_per_mm_um,
        "single_pair_stiffness_pitch_N_mm_um": at_pitch / N_per_mm_um,
        "single_pair_deflection_um": load / largest / um,
        # Without what the bodies let the next pair feel: of the closed form of the Master Curve.
        "unshared_deflection_um": load
        * (1.0 / largest - shared_compliance(pair, model.compliance))
        / um,
        "mesh_loss_factor": mesh_loss_factor(pair, cycle),
        "specific_sliding_lowest_pinion": specific_sliding(pair, pair.path_start)[0],
        "specific_sliding_lowest_wheel": specific_sliding(pair, pair.path_end)[1],
        "sliding_factor_largest": _largest_sliding(pair),
        "mesh_stiffness_mean_N_um": cycle_mean(cycle, mesh_stiffness(cycle)) * um,
        "nominal_line_load_N_mm": load * mm,
        "least_share_in_contact": jnp.min(_share_in_contact(cycle)),
        "most_solver_steps": jnp.max(cycle.steps),
    }


def _corner_numbers(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> Numbers:
    """Largest pressure of tip corners, where they may touch and the radius of one is known."""
    if not has_corners(cycle.cells.lines, model.pair):
        return {}
    return {"max_corner_pressure_MPa": jnp.max(corner_pressure(model.pair, cycle, law)) / MPa}


def _unloaded_range(model: PairModel, cycle: MeshCycle) -> Scalar:
    """Peak to peak of the transmission error that rigid gears have without load [m]."""
    gap = mesh_gap(model.pair, cycle.cells.lines, model.flanks, model.misalignment)
    return peak_to_peak(unloaded_transmission_error(model.pair, cycle.cells, gap))


def _largest_sliding(pair: GearPair) -> Scalar:
    """Largest speed of sliding over that of the pitch line; it is at an end of the path [-]."""
    ends = jnp.stack([pair.path_start, pair.path_end])
    slides = sliding_speed(pair, ends, as_scalar(1.0))
    return jnp.max(jnp.abs(slides)) / pair.working_pitch_radius[0]


def _share_in_contact(cycle: MeshCycle) -> Phases:
    """Stiffness of the closed cells over that of all that could close."""
    stiffness = cycle.cells.stiffness
    closed = jnp.where(cycle.overlap > 0.0, stiffness, 0.0)
    return jnp.sum(closed, axis=1) / jnp.sum(stiffness, axis=1)


def _mean_loads(cycle: MeshCycle) -> Mounts:
    """Motion of the gears, load of the mesh on them; motion and load of the bearings."""
    system = cycle.system
    mean = (cycle.cells.lines.weight @ cycle.load)[None, :]
    motion = system.gear_motion(mean)[0].reshape(2, 6)
    # At its one node a gear on springs gives them the mesh's load.
    at_nodes = jnp.zeros(system.structure.map.size).at[np.asarray(system.structure.map.gear_dofs)]
    on_nodes = at_nodes.set(-system.vectors @ mean[0])
    first = np.asarray([nodes[0] for nodes in system.structure.map.gears])
    wrench = on_nodes[first[:, None] + np.arange(6)]
    bearings = bearing_motion(system.structure, system.displacement(mean)[0])
    return Mounts(motion, wrench, jnp.stack([bearings.displacement, bearings.load]))


def smoothing_bias(
    model: PairModel, prepared: PreparedMesh, widths: Phases
) -> tuple[Phases, Phases, Scalar]:
    """What smooth contact changes, as a function of its width; traceable by JAX.

    Bias of the mean TE and of its RMS for each width, and the exact RMS [m].
    """

    def of_law(law: AbstractContactLaw) -> tuple[Scalar, Scalar]:
        cycle = corrected_cycle(prepared, model, law=law)
        error = transmission_error(model.pair, cycle)
        return cycle_mean(cycle, error), cycle_rms(cycle, error)

    mean, rms = of_law(ExactContact())
    means, all_rms = jax.vmap(lambda width: of_law(SmoothContact(width)))(widths)
    return means - mean, all_rms - rms, rms
