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
from jaxgear._checks import require
from jaxgear._contact._cells import nominal_line_load
from jaxgear._contact._compliance import iso_stiffness
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import pair_facts
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._response._loads import hertz_pressure, line_load, mesh_stiffness
from jaxgear._response._transmission import (
    cycle_mean,
    cycle_rms,
    peak_to_peak,
    transmission_error,
)
from jaxgear._solve._cycle import MeshCycle, PreparedMesh, corrected_cycle, mesh_cycle
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import pair_system
from jaxgear._types import Phases, Reals, Scalar
from jaxgear._units import MPa, N_per_mm_um, deg, mm, um


class SolverFailure(RuntimeError):
    """A computation on a good scene that found no answer."""


class Stopwatch:
    """Seconds spent compiling and running, kept apart."""

    def __init__(self):
        self.compile_s = 0.0
        self.run_s = 0.0
        self._programs: dict[Any, Callable[..., Any]] = {}

    def __call__(
        self, function: Callable[..., Any], *arguments: Any, options: dict[str, Any] | None = None
    ) -> Any:
        """Compile `function` for these arguments, run it, and wait for the result."""
        start = time.perf_counter()
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple((jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves)
        key = function, structure, shapes, str(options)
        if key not in self._programs:
            lowered = jax.jit(function).lower(*arguments)
            self._programs[key] = lowered.compile(compiler_options=options)
        compiled = self._programs[key]
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
    - `numbers`: the `static` part of the summary, the unit in each key [-].
    - `harris`: transmission error over phase, one row per further torque [m].
    """

    model: PairModel
    grid: MeshGrid
    law: AbstractContactLaw
    cycle: MeshCycle
    numbers: dict[str, Scalar]
    harris: np.ndarray


def solve_statics(scene: Scene, watch: Stopwatch, torques: np.ndarray | None = None) -> Statics:
    """Solve the mesh cycle of a scene at its own torque, and at others.

    **Arguments:**

    - `scene`: checked against the schema.
    - `watch`: keeps the time.
    - `torques`: further torques on the pinion, for the Harris map [N m].

    **Returns:**

    The solved cycle.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a phase was not solved.
    """
    model = model_of(scene)
    grid, law = grid_of(scene, model), law_of(scene)
    more = np.zeros(0) if torques is None else torques

    # The scene's own torque and the others in one program: it is compiled once.
    all_torques = jnp.concatenate([model.torque[None], jnp.asarray(more)])
    cycles, error, numbers = watch(_solve, model, grid, law, all_torques)
    require_solved(cycles.converged)
    # Weber's contact term holds while the contact is small against the tooth.
    deflection = float(numbers["single_pair_deflection_um"][0]) * um
    require(
        deflection < 0.1 * float(model.pair.normal_module),
        "A single tooth pair would give way by {got:.3g} mm under {torque:.6g} N m, more than a "
        "tenth of the module: no tooth bears that. pair.torque_pinion_Nm is in N m.",
        got=deflection / mm,
        torque=float(model.torque),
    )
    first = jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[0]), (cycles, numbers))
    return Statics(
        model=model,
        grid=grid,
        law=law,
        cycle=first[0],
        numbers=first[1],
        harris=np.asarray(error)[1:],
    )


def _solve(model: PairModel, grid: MeshGrid, law: AbstractContactLaw, torques: Reals):
    """Cycle, transmission error and numbers for the summary, at each torque."""

    def at_torque(torque: Scalar):
        loaded = eqx.tree_at(lambda m: m.torque, model, torque)
        cycle = mesh_cycle(loaded, grid, law=law, throw=False)
        error = transmission_error(loaded.pair, cycle)
        return cycle, error, _static_numbers(loaded, cycle, law)

    return jax.vmap(at_torque)(torques)


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
    facts = {name: np.asarray(value) for name, value in pair_facts(model.pair).items()}
    pitch, path = facts["transverse_base_pitch"], facts["path_of_contact"]
    lengths = {
        "centre_distance_mm": facts["working_centre_distance"],
        "base_pitch_mm": pitch,
        "path_of_contact_mm": path,
        # From the wheel's tip A to the inner single contact point B, the pitch point C, the outer
        # single contact point D and the pinion's tip E.
        "path_AB_mm": path - pitch if pitch < path < 2.0 * pitch else np.nan,
        "path_AC_mm": facts["pitch_point"] - facts["path_start"],
        "path_AD_mm": pitch if pitch < path < 2.0 * pitch else np.nan,
        "path_AE_mm": path,
        "common_face_width_mm": facts["face_width"],
        "backlash_mm": facts["backlash"],
    }
    for index, name in enumerate(("pinion", "wheel")):
        lengths |= {
            f"{quantity}_{name}_mm": facts[quantity][index]
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
    angles = ("working_pressure_angle", "transverse_pressure_angle", "base_helix_angle")
    ratios = ("profile_contact_ratio", "overlap_ratio", "total_contact_ratio")
    return (
        {key: float(value / mm) for key, value in lengths.items()}
        | {f"{name}_deg": float(facts[name] / deg) for name in angles}
        | {name: float(facts[name]) for name in ratios}
        | {"full_tip_shortening_coeff": float(facts["full_tip_shortening"])}
    )


def iso_summary(model: PairModel) -> dict[str, float]:
    """Stiffnesses of ISO 6336-1 method B, whatever stiffness the scene uses."""
    return {key: float(value) for key, value in jax.jit(_iso_numbers)(model).items()}


def _iso_numbers(model: PairModel) -> dict[str, Scalar]:
    pair = model.pair
    tangential = model.torque / pair.reference_radius[0]
    stiffness = iso_stiffness(pair, tangential / pair.face_width)
    return {
        "tangential_force_N": tangential,
        "c_th_N_mm_um": stiffness.theoretical / N_per_mm_um,
        "c_prime_N_mm_um": stiffness.single / N_per_mm_um,
        "c_gamma_alpha_N_mm_um": stiffness.mesh / N_per_mm_um,
        "c_gamma_beta_N_mm_um": stiffness.face / N_per_mm_um,
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


def _static_numbers(
    model: PairModel, cycle: MeshCycle, law: AbstractContactLaw
) -> dict[str, Scalar]:
    """The `static` part of the summary; traceable by JAX."""
    pair = model.pair
    load = nominal_line_load(pair, model.torque)
    # One call for both: the compliance takes longest to compile.
    path = pair.path_start + jnp.linspace(0.0, 1.0, 129) * pair.path_of_contact
    stiffness = 1.0 / model.compliance(pair, jnp.append(path, pair.pitch_point), load)
    largest, at_pitch = jnp.max(stiffness), stiffness[-1]
    return {
        "mesh_force_N": cycle.load[0, 0],
        **headline(model, cycle, law),
        "single_pair_stiffness_max_N_mm_um": largest / N_per_mm_um,
        "single_pair_stiffness_pitch_N_mm_um": at_pitch / N_per_mm_um,
        "single_pair_deflection_um": load / largest / um,
        "mesh_stiffness_mean_N_um": cycle_mean(cycle, mesh_stiffness(cycle)) * um,
        "nominal_line_load_N_mm": load * mm,
        "least_share_in_contact": jnp.min(
            mesh_stiffness(cycle) / jnp.sum(cycle.cells.stiffness, axis=1)
        ),
        "most_solver_steps": jnp.max(cycle.steps),
    }


def supports_summary(statics: Statics) -> list[dict[str, Any]]:
    """Mean displacement and load of each gear's support; load is what the gear puts on it."""
    model = statics.model
    found = jax.jit(_support_means)(model, statics.cycle)
    motion, load = (np.asarray(x).reshape(2, 2, 3) for x in found)
    return [
        {
            "gear": gear,
            "displacement_um": dict(zip("STZ", (motion[body, 0] / um).tolist(), strict=True)),
            "tilt_urad": dict(zip("ST", (1e6 * motion[body, 1, :2]).tolist(), strict=True)),
            "load_N": dict(zip("STZ", load[body, 0].tolist(), strict=True)),
        }
        for body, gear in enumerate(("pinion", "wheel"))
    ]


def _support_means(model: PairModel, cycle: MeshCycle) -> tuple[Reals, Reals]:
    system = pair_system(model.pair, model.torque, model.pinion_support, model.wheel_support)
    mean = cycle.cells.lines.weight @ cycle.load
    return system.displacement(mean[None])[0], -system.vectors @ mean


def smoothing_bias(
    model: PairModel, prepared: PreparedMesh, widths: Phases
) -> tuple[Phases, Phases, Scalar]:
    """What smooth contact changes, as a function of its width; traceable by JAX.

    **Arguments:**

    - `model`: gives the flanks.
    - `prepared`: its mesh.
    - `widths`: of the smooth law [m].

    **Returns:**

    Bias of the mean TE and of its RMS for each width, and the exact RMS [m].
    """

    def of_law(law: AbstractContactLaw) -> tuple[Scalar, Scalar]:
        cycle = corrected_cycle(prepared, model, law=law)
        error = transmission_error(model.pair, cycle)
        return cycle_mean(cycle, error), cycle_rms(cycle, error)

    mean, rms = of_law(ExactContact())
    means, all_rms = jax.vmap(lambda width: of_law(SmoothContact(width)))(widths)
    return means - mean, all_rms - rms, rms
