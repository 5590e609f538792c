"""What is kept of a design, by the names that it has in `summary.json` and in `result.nc`."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from jaxgear._contact._root_influence import Influences
from jaxgear._geometry._pair import pair_facts
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._factors import face_load
from jaxgear._response._loads import hertz_pressure, line_load, mesh_stiffness
from jaxgear._response._transmission import transmission_error
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._model import PairModel
from jaxgear._types import Reals
from jaxgear._units import MPa, mm, um
from jaxgear.designs._keys import KeepKeys
from jaxgear.scene._mistakes import Mistake, SceneError
from jaxgear.scene._schema import nearest
from jaxgear.study._statics import ROOT_NUMBERS, iso_numbers, root_numbers, static_numbers

# Of a mesh cycle, which many designs are computed of in one call.
_STATIC = """
    mesh_force_N te_mean_um te_rms_um te_peak_to_peak_um max_line_load_N_mm max_pressure_MPa
    face_load_factor transverse_load_factor single_pair_stiffness_max_N_mm_um
    single_pair_stiffness_pitch_N_mm_um single_pair_deflection_um unshared_deflection_um
    mesh_loss_factor specific_sliding_lowest_pinion specific_sliding_lowest_wheel
    sliding_factor_largest mesh_stiffness_mean_N_um nominal_line_load_N_mm
    least_share_in_contact most_solver_steps
"""
_STANDARD = """
    tangential_force_N c_th_N_mm_um c_prime_N_mm_um c_gamma_alpha_N_mm_um c_gamma_beta_N_mm_um
"""
_RATIOS = ("profile_contact_ratio", "overlap_ratio", "total_contact_ratio")
TOGETHER = (
    *(f"static.{each}" for each in _STATIC.split()),
    *(f"static.{each}" for each in ROOT_NUMBERS),
    *(f"iso6336.{each}" for each in _STANDARD.split()),
    *(f"geometry.{each}" for each in _RATIOS),
)
# A single pair gives so much: no design may be beyond what the theory of teeth holds for.
DEFLECTION = "static.single_pair_deflection_um"

# Arrays of a mesh cycle: their dimensions in `result.nc`, and what they are.
ARRAYS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "transmission_error_um": (("phase",), "quasi-static transmission error"),
    "mesh_stiffness_N_um": (("phase",), "stiffness of the cells in contact, along the normal"),
    "face_load_N_mm": (("slice",), "mean load per face width"),
    "line_load_N_mm": (("phase", "line", "slice"), "load per length of contact line"),
    "pressure_MPa": (("phase", "line", "slice"), "largest Hertzian pressure"),
    "phase": (("phase",), "position in the cycle, in mesh periods"),
    "face_position_mm": (("slice",), "position from mid-face along the axes"),
}
# Of these what says where the others are.
PLACES = ("phase", "face_position_mm")


def numbers_together(
    names: Sequence[str],
    model: PairModel,
    cycle: MeshCycle,
    law: AbstractContactLaw,
    influences: Influences | None,
) -> Reals:
    """Numbers of a cycle by their names in the summary; traceable by JAX."""
    facts = pair_facts(model.pair)
    groups = {
        "static": static_numbers(model, cycle, law) | root_numbers(model, cycle, influences),
        "iso6336": iso_numbers(model),
        "geometry": {name: getattr(facts, name) for name in _RATIOS},
    }
    known = {f"{group}.{name}": x for group, each in groups.items() for name, x in each.items()}
    return jnp.stack([jnp.asarray(known[name], dtype=float) for name in names])


def array_of(name: str, model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> Array:
    """An array of a cycle, in the unit of its name; traceable by JAX."""
    shape = cycle.cells.lines.roll.shape
    match name:
        case "transmission_error_um":
            return transmission_error(model.pair, cycle) / um
        case "mesh_stiffness_N_um":
            return mesh_stiffness(cycle) * um
        case "face_load_N_mm":
            return face_load(model.pair, cycle) * mm
        case "line_load_N_mm":
            return line_load(cycle, law).reshape(shape) * mm
        case "phase":
            return cycle.cells.lines.phase
        case "face_position_mm":
            return cycle.cells.lines.face_position / mm
        case _:
            return jnp.reshape(hertz_pressure(model.pair, cycle, law), shape) / MPa


_STEPS = re.compile(r"\[(\d+)\]|([^.\[\]]+)")


def number_in(summary: Mapping[str, Any], name: str) -> float:
    """A number of a summary by its path, such as `modes.frequency_Hz[0]`; NaN of no finite one."""
    found = _at(summary, name)
    return float(found) if _is_number(found) and np.isfinite(found) else float("nan")


def arrays_in(datasets: Mapping[str, xr.Dataset], name: str) -> xr.Dataset:
    """An array of a result by its name in `result.nc`, such as `sweep.dynamic_ratio`.

    With it come the coordinates of its dimensions; of what is not there, nothing.
    """
    group, _, variable = name.rpartition(".")
    if group not in datasets or variable not in datasets[group]:
        return xr.Dataset()
    found = datasets[group][variable]
    return found.drop_vars(set(found.coords) - set(found.dims)).to_dataset(name=name)


def require_known(
    summary: Mapping[str, Any],
    datasets: Mapping[str, xr.Dataset],
    keep: KeepKeys,
    where: Callable[[str], str],
) -> None:
    """Refuse names that the results of a design do not have.

    An entry beyond the end of a list is no mistake: other designs may have more of them.

    **Raises:**

    - `SceneError` with the names: their place is where `keep.numbers` or `keep.arrays` stands.
    """
    arrays = [f"{g}.{each}".lstrip(".") for g, x in datasets.items() for each in x.data_vars]
    numbers, isnt = list(_paths(summary)), lambda x: x is not None and not _is_number(x)
    unknown = [("keep.numbers", each, numbers) for each in keep.numbers if isnt(_at(summary, each))]
    unknown += [("keep.arrays", each, arrays) for each in keep.arrays if each not in arrays]
    mistakes = []
    for key, name, known in unknown:
        near = nearest(name, known)
        words = f"did you mean {near}? " if near else ""
        words = f"results have no {name}; {words}If only some designs have it, let one come first"
        mistakes.append(Mistake(where(key), key, words))
    if mistakes:
        raise SceneError(mistakes)


# What stands in a summary where a path leads nowhere.
_NOWHERE = object()


def _at(summary: Mapping[str, Any], name: str) -> Any:
    """What stands at a path; None if that is an entry beyond the end of a list."""
    found: Any = summary
    for index, key in _STEPS.findall(name):
        if index and isinstance(found, list | tuple | np.ndarray):
            if int(index) >= len(found):
                return None
            found = found[int(index)]
        elif key and isinstance(found, Mapping) and key in found:
            found = found[key]
        else:
            return _NOWHERE
    return found


def _is_number(found: Any) -> bool:
    return isinstance(found, int | float | np.number) or getattr(found, "shape", None) == ()


def _paths(summary: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Paths of the numbers of a summary."""
    found = []
    for key, value in summary.items():
        if isinstance(value, Mapping):
            found += _paths(value, f"{prefix}{key}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append(f"{prefix}{key}")
        elif isinstance(value, list | tuple | np.ndarray) and len(value):
            found.append(f"{prefix}{key}[0]")
    return found
