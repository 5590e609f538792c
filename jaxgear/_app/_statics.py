"""The quasi-static part of a run: what is solved, and what of it goes into the summary."""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._app._model import grid_of, law_of, model_of
from jaxgear._app._scene import Scene
from jaxgear._contact._cells import nominal_line_load
from jaxgear._contact._compliance import iso_stiffness, single_pair_stiffness
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import (
    full_tip_shortening,
    overlap_ratio,
    profile_contact_ratio,
    total_contact_ratio,
)
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._response._loads import hertz_pressure, line_load, mesh_stiffness
from jaxgear._response._transmission import (
    cycle_mean,
    cycle_rms,
    peak_to_peak,
    transmission_error,
)
from jaxgear._solve._cycle import MeshCycle, mesh_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Scalar
from jaxgear._units import MPa, N_per_mm_um, deg, mm, um


class SolverFailure(RuntimeError):
    """A computation on a good scene that found no answer."""


class Stopwatch:
    """Seconds spent compiling and running, kept apart."""

    def __init__(self):
        self.compile_s = 0.0
        self.run_s = 0.0

    def __call__(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Compile `function` for these arguments, run it, and wait for the result."""
        start = time.perf_counter()
        compiled = jax.jit(function).lower(*arguments).compile()
        middle = time.perf_counter()
        result = jax.block_until_ready(compiled(*arguments))
        self.compile_s += middle - start
        self.run_s += time.perf_counter() - middle
        return result


class Statics(eqx.Module):
    """A scene's model and its settled mesh cycle.

    **Fields:**

    - `model`: that was solved.
    - `grid`: phases, lines and slices.
    - `law`: contact law.
    - `cycle`: the settled states.
    """

    model: PairModel
    grid: MeshGrid
    law: AbstractContactLaw
    cycle: MeshCycle


def solve_statics(scene: Scene, watch: Stopwatch) -> Statics:
    """Solve the mesh cycle of a scene at its own torque.

    **Arguments:**

    - `scene`: checked against the schema.
    - `watch`: keeps the time.

    **Returns:**

    The solved cycle.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a phase was not solved.
    """
    model = model_of(scene)
    grid, law = grid_of(scene, model), law_of(scene)
    cycle = watch(lambda m, w: mesh_cycle(m, grid, law=w, throw=False), model, law)
    require_solved(cycle.converged)
    return Statics(model=model, grid=grid, law=law, cycle=cycle)


def require_solved(converged: Any) -> None:
    """Raise unless every contact problem was solved.

    **Arguments:**

    - `converged`: flags; the last axis is the phase.

    **Raises:**

    - `SolverFailure` naming the phases.
    """
    flags = np.atleast_1d(np.asarray(converged))
    if not flags.all():
        bad = np.unique(np.nonzero(~flags)[-1]).tolist()
        raise SolverFailure(
            f"the contact was not solved at {np.count_nonzero(~flags)} of {flags.size} positions "
            f"(phases {bad[:8]}{' and more' if len(bad) > 8 else ''}): the forces stayed out of "
            "balance. Check that gaps and deflections are of one size (flank corrections in um), "
            "and that supports are not softer than the mesh by more than a factor of 1e6."
        )


def geometry_summary(model: PairModel) -> dict[str, float]:
    """The `geometry` part of the summary."""
    pair = model.pair
    lengths = {
        "centre_distance_mm": pair.working_centre_distance,
        "base_pitch_mm": pair.transverse_base_pitch,
        "path_of_contact_mm": pair.path_of_contact,
        "common_face_width_mm": pair.face_width,
        "backlash_mm": pair.backlash,
    }
    for index, name in enumerate(("pinion", "wheel")):
        lengths |= {
            f"{quantity}_{name}_mm": getattr(pair, quantity)[index]
            for quantity in (
                "reference_radius",
                "base_radius",
                "tip_radius",
                "root_radius",
                "form_radius",
                "working_pitch_radius",
                "tip_thickness",
                "root_clearance",
            )
        }
    # From the wheel's tip to the inner single contact point, the pitch point, the outer one, the
    # pinion's tip.
    along = {
        "path_AB_mm": pair.path_of_contact - pair.transverse_base_pitch,
        "path_AC_mm": pair.pitch_point - pair.path_start,
        "path_AD_mm": pair.transverse_base_pitch,
        "path_AE_mm": pair.path_of_contact,
    }
    angles = {
        "working_pressure_angle_deg": pair.working_pressure_angle,
        "transverse_pressure_angle_deg": pair.transverse_pressure_angle,
        "base_helix_angle_deg": pair.base_helix_angle,
    }
    ratios = {
        "profile_contact_ratio": profile_contact_ratio(pair),
        "overlap_ratio": overlap_ratio(pair),
        "total_contact_ratio": total_contact_ratio(pair),
        "full_tip_shortening_coeff": full_tip_shortening(pair),
    }
    return (
        {key: float(value / mm) for key, value in (lengths | along).items()}
        | {key: float(value / deg) for key, value in angles.items()}
        | {key: float(value) for key, value in ratios.items()}
    )


def iso_summary(model: PairModel) -> dict[str, float]:
    """Stiffnesses of ISO 6336-1 method B, whatever stiffness the scene uses."""
    pair = model.pair
    tangential = model.torque / pair.reference_radius[0]
    stiffness = iso_stiffness(pair, tangential / pair.face_width)
    return {
        "tangential_force_N": float(tangential),
        "c_th_N_mm_um": float(stiffness.theoretical / N_per_mm_um),
        "c_prime_N_mm_um": float(stiffness.single / N_per_mm_um),
        "c_gamma_alpha_N_mm_um": float(stiffness.mesh / N_per_mm_um),
        "c_gamma_beta_N_mm_um": float(stiffness.face / N_per_mm_um),
    }


def headline(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> dict[str, Scalar]:
    """The few numbers by which two flanks are compared; traceable by JAX."""
    error = transmission_error(model.pair, cycle)
    return {
        "te_mean_um": cycle_mean(cycle, error) / um,
        "te_rms_um": cycle_rms(cycle, error) / um,
        "te_peak_to_peak_um": peak_to_peak(error) / um,
        "max_line_load_N_mm": jnp.max(line_load(cycle, law)) / (1.0 / mm),
        "max_pressure_MPa": jnp.max(hertz_pressure(model.pair, cycle, law)) / MPa,
    }


def single_pair_deflection(model: PairModel) -> Scalar:
    """Deflection of one tooth pair of the largest stiffness under the whole load [m]."""
    pair = model.pair
    load = nominal_line_load(pair, model.torque)
    return load / single_pair_stiffness(pair, model.compliance, load)


def static_summary(statics: Statics) -> dict[str, Any]:
    """The `static` part of the summary."""
    model, cycle, pair = statics.model, statics.cycle, statics.model.pair
    load = nominal_line_load(pair, model.torque)
    pitch = 1.0 / model.compliance(pair, pair.pitch_point[None], load)[0]
    share = jnp.sum(jnp.where(cycle.force > 0.0, cycle.cells.stiffness, 0.0), axis=1)
    whole = jnp.sum(cycle.cells.stiffness, axis=1)
    numbers = {
        "mesh_force_N": cycle.load[0, 0],
        **headline(model, cycle, statics.law),
        "single_pair_stiffness_max_N_mm_um": single_pair_stiffness(pair, model.compliance, load)
        / N_per_mm_um,
        "single_pair_stiffness_pitch_N_mm_um": pitch / N_per_mm_um,
        "single_pair_deflection_um": single_pair_deflection(model) / um,
        "mesh_stiffness_mean_N_um": cycle_mean(cycle, mesh_stiffness(cycle)) * um,
        "nominal_line_load_N_mm": load * mm,
        "least_contact_share": jnp.min(share / whole),
    }
    return {key: float(value) for key, value in numbers.items()} | {
        "solver_steps_most": int(jnp.max(cycle.steps))
    }


def harris(statics: Statics, torques: np.ndarray, watch: Stopwatch) -> np.ndarray:
    """Transmission error over phase at several torques, rows torques [m]."""

    def at_torque(model: PairModel, torque: Scalar):
        loaded = eqx.tree_at(lambda m: m.torque, model, torque)
        cycle = mesh_cycle(loaded, statics.grid, law=statics.law, throw=False)
        return transmission_error(loaded.pair, cycle), cycle.converged

    error, converged = watch(
        lambda model, t: jax.vmap(lambda torque: at_torque(model, torque))(t),
        statics.model,
        jnp.asarray(torques),
    )
    require_solved(converged)
    return np.asarray(error)


def smoothing_bias(
    statics: Statics, widths: np.ndarray, watch: Stopwatch
) -> tuple[np.ndarray, np.ndarray]:
    """What smooth contact adds to the mean TE [m] and to its RMS [m], for several widths [m]."""

    def of_law(model: PairModel, law: AbstractContactLaw):
        cycle = mesh_cycle(model, statics.grid, law=law, throw=False)
        error = transmission_error(model.pair, cycle)
        return cycle_mean(cycle, error), cycle_rms(cycle, error), cycle.converged

    exact = watch(lambda model: of_law(model, ExactContact()), statics.model)
    smooth = watch(
        lambda model, w: jax.vmap(lambda width: of_law(model, SmoothContact(width)))(w),
        statics.model,
        jnp.asarray(widths),
    )
    require_solved(exact[2])
    require_solved(smooth[2])
    return np.asarray(smooth[0] - exact[0]), np.asarray(smooth[1] - exact[1])
