"""What a scene's responses react to: the derivatives that `check-grad` proves, in shares.

One sensitivity compares keys of any unit: per cent of a response per per cent of a key. A key in
micrometres is a deviation from the nominal and often 0: for it, per cent per micrometre; for
others that are 0, such as a profile shift, per cent per 0.01.
"""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from jaxgear._interface._laws import ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._response._loads import mesh_stiffness
from jaxgear._response._transmission import cycle_mean
from jaxgear._solve._cycle import mesh_cycle
from jaxgear._types import Flags, Reals
from jaxgear._units import um
from jaxgear.scene._build import model_of
from jaxgear.scene._gear_tables import GearKeys, MaterialKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import split_entry
from jaxgear.study._built import BuiltScene, built_scene
from jaxgear.study._derivatives import Keys, linearised
from jaxgear.study._dynamics import is_too_large, size_of, speeds_of
from jaxgear.study._head import names_of, study
from jaxgear.study._progress import progress
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._results import dataset_of, told
from jaxgear.study._running import timed
from jaxgear.study._statics import ROOT_NUMBERS, headline, require_solved, root_numbers
from jaxgear.study._steady import (
    SPEED,
    TOO_MANY,
    SteadyPoint,
    builder,
    damping_keys,
    method_of,
    numbers_of,
    responder,
    steady_names,
    steady_point,
)
from jaxgear.study._sweep_notes import steady_notes

_AT_REST = ("te_mean_um", "te_rms_um", "max_pressure_MPa", "face_load_factor")
_STIFFNESS = "mesh_stiffness_mean_N_um"

# Smaller sensitivities are rounding.
_LEAST = 1e-9
# Speeds of [sweep] at which sensitivities are found: the first, the last and between them.
_FEW_SPEEDS = 3
# Units of sensitivities; per cent of a response per 0.01 of a key is its relative change per one.
_MEASURES = {"%/%": None, "%/um": 100.0, "%/0.01": 1.0}

# What a reader of the table has to know.
_OF_BODIES = (
    "Young's modulus of a condensed body, with its shaft, is a key of its own here, "
    "body.young_GPa: that of the material is then of the teeth, the contact and all rigid gears' "
    "shafts."
)


@study
def sensitivity(scene: Scene) -> Result:
    """Find what the responses of a scene react to, and how strongly.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    Datasets `sensitivity` and, of a scene with a table [sweep], `sensitivity_in_motion`: keys that
    act, the strongest first, those of one measure together; and the summary.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    built = built_scene(scene.replace(own_moduli(scene.material, scene.gears)))
    scene = built.scene
    moving, points, found = scene.sweep.is_given, [], {}
    with progress(1 + moving, "derivatives") as done:
        found["sensitivity"] = static_sensitivities(built)
        done(1)
        if moving:
            steady, points = steady_sensitivities(built)
            found |= {} if steady is None else {"sensitivity_in_motion": steady}
            done(1)
    remarks = steady_notes(points) + [_OF_BODIES] * bool(scene.condensed)
    remarks += [words for each in found.values() for words in lost(each)]
    more = ": what the responses react to"
    datasets = {name: titled(acting(each), scene.title + more) for name, each in found.items()}
    summary = {"notes": remarks} | {name: table_of(each) for name, each in datasets.items()}
    return Result(scene, names_of(scene.name, scene.cite) | summary, datasets)


def own_moduli(material: MaterialKeys, gears: Mapping[str, GearKeys]) -> Mapping[str, float]:
    """The key of a Young's modulus of its own for each condensed body that has none.

    Its value is that of the gear's material, so that nothing changes but what can be told apart:
    the body from the teeth and the other parts.
    """
    added = {}
    for gear, keys in gears.items():
        body, own = keys.body, keys.material.young_GPa
        if body.kind == "condensed" and body.young_GPa is None and body.superelement is None:
            added[f"{gear}.body.young_GPa"] = material.young_GPa if own is None else own
    return added


def static_sensitivities(built: BuiltScene) -> xr.Dataset:
    """How the quasi-static responses of a scene react to all of its real keys.

    The largest pressure is that of one place: where two are equal, the mean of what moves either.
    """
    scene, still, grid, law = built.scene, built.model, built.grid, built.law
    keys, influences = Keys(scene, scene.real_keys()), built.influences_near()
    names = (*_AT_REST, _STIFFNESS, *(ROOT_NUMBERS if influences(still.pair) else ()))

    def respond(values: Reals) -> tuple[Reals, Flags]:
        model = model_of(keys.moved(values))
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        numbers = headline(model, cycle, law) | root_numbers(model, cycle, influences(model.pair))
        numbers[_STIFFNESS] = cycle_mean(cycle, mesh_stiffness(cycle)) * um
        return jnp.stack([numbers[name] for name in names]), cycle.converged

    centre = jnp.asarray(keys.centre)
    value, converged, slopes, _ = timed(
        linearised(respond), centre, jnp.eye(len(centre)), None, options=QUICKLY
    )
    require_solved(converged)
    return in_shares(names, value, keys.names, centre, slopes.T)


def steady_sensitivities(built: BuiltScene) -> tuple[xr.Dataset | None, list[SteadyPoint]]:
    """How steady responses react to all real keys, damping and speed, at a few speeds of [sweep].

    Contact is exact; `None` if no response has any. Says how each speed went.
    """
    scene, every = built.scene, speeds_of(built.scene.sweep)
    places = np.unique(np.round(np.linspace(0, len(every) - 1, _FEW_SPEEDS)).astype(int))
    keys = Keys(scene, (*scene.real_keys(), *damping_keys(scene.damping)))
    names, centre = (*keys.names, SPEED), jnp.append(keys.centre, every[0])
    build, tangents = numbers_of(builder(keys, built.grid_in_motion)), jnp.eye(len(centre))
    numbers, dynamics, columns, _ = timed(
        linearised(build), centre, tangents, None, options=QUICKLY
    )
    require_solved(dynamics.cycle.converged)
    if is_too_large(scene.sweep, size_of(dynamics)):
        return None, [SteadyPoint("exact", every[0], None, None, TOO_MANY)]
    program = linearised(responder(method_of(scene.sweep, dynamics, ExactContact())))
    points: list[SteadyPoint] = []
    found: list[xr.Dataset] = []
    for speed in every[places].tolist():
        at = numbers.at[-1].set(speed)
        value, seen, slopes, _ = timed(program, at, columns, None, dynamics)
        points.append(steady_point("exact", speed, seen))
        if points[-1].verdict == "ok":
            own = centre.at[-1].set(speed)
            found.append(in_shares(steady_names(dynamics), value, names, own, slopes.T, speed))
    return (xr.concat(found, "case", data_vars="minimal") if found else None), points


def in_shares(
    responses: Sequence[str],
    values: ArrayLike,
    keys: Sequence[str],
    centre: ArrayLike,
    slopes: ArrayLike,
    speed: float = np.nan,
) -> xr.Dataset:
    """Derivatives `[response, key]` in per cent; NaN where there is none.

    Cases are of one response at one speed of the pinion [rad/s] each, NaN of the quasi-static
    cycle.
    """
    values, centre, slopes = map(np.asarray, (values, centre, slopes))
    measures = list(map(_measure, keys, centre))
    per = [_MEASURES[measure] or at for measure, at in zip(measures, centre, strict=True)]
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = slopes * np.asarray(per) / values[:, None]
    shares = np.where(np.isfinite(shares), shares, np.nan)
    return dataset_of(
        told(
            "case",
            response=(responses, "response, with its unit"),
            pinion_speed_rad_s=(np.full(len(values), speed), "speed of the pinion"),
            value=(values, "response, in the unit of its name"),
        )
        | told(
            "key", key=(keys, "key, with its unit"), measure=(measures, "unit of the sensitivity")
        )
        | told("case key", sensitivity=(shares, "sensitivity, in its measure"))
    )


def _measure(key: str, value: float) -> str:
    if split_entry(key)[0].endswith("_um"):
        return "%/um"
    return "%/%" if value else "%/0.01"


def acting(found: xr.Dataset) -> xr.Dataset:
    """The keys that act, the strongest first, those of one measure together; rounding is 0."""
    shares = found["sensitivity"]
    most, measures = abs(shares).max("case").values, found["measure"].values
    order = list(_MEASURES)
    places = [j for j in range(len(most)) if most[j] > _LEAST]
    places.sort(key=lambda j: (order.index(measures[j]), -most[j]))
    return found.isel(key=places)


def table_of(found: xr.Dataset) -> Summary:
    """The table for the summary: for each response its value and its keys, strongest first."""
    keys, measures = found["key"].values, found["measure"].values
    words = [f"{key} [{unit}]" for key, unit in zip(keys, measures, strict=True)]
    table = {}
    for case in range(found.sizes["case"]):
        own = found.isel(case=case)
        speed, shares = float(own["pinion_speed_rad_s"]), own["sensitivity"].values.tolist()
        at = "" if np.isnan(speed) else f"_at_{speed:g}_rad_s"
        strong = [each for each in zip(words, shares, strict=True) if abs(each[1]) > _LEAST]
        strongest = dict(sorted(strong, key=lambda each: -abs(each[1])))
        table[str(own["response"].values) + at] = {"value": float(own["value"])} | strongest
    return table


def lost(found: xr.Dataset) -> list[str]:
    """A sentence on keys by which no response has a derivative, if there are any."""
    keys = ", ".join(found["key"].values[found["sensitivity"].isnull().all("case")])
    if not keys:
        return []
    return [
        f"No response has a derivative by {keys}. In motion that is so where natural modes "
        'that the mesh loads coincide: modal damping has none there, damping.kind = "rayleigh" '
        "has one."
    ]
