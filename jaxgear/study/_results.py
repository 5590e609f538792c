"""What is written down: the dataset of a mesh cycle, and the files of the results folder.

The library's SI values leave here in the units of files, which stand in every name and in every
variable's `units`. A file appears whole or not at all.
"""

import csv
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from numpy.typing import ArrayLike

import jaxgear as jg
from jaxgear._kept_programs import called
from jaxgear._whole_file import whole_file, write_text

BODIES = ("pinion", "wheel")
_AXES = ("S", "T", "Z")
_HARMONICS = 10

# A slice has a place on the flank if its middle is on the path of contact.
_ON_FLANK = 0.5


class Entry(NamedTuple):
    """One variable: its dimensions, its values in the unit of the file, and what it is."""

    dims: tuple[str, ...]
    values: ArrayLike
    units: str
    long_name: str

    def variable(self) -> xr.Variable:
        """As xarray holds it."""
        attributes = {"units": self.units, "long_name": self.long_name}
        return xr.Variable(self.dims, np.asarray(self.values), attributes)


def static_dataset(
    model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
) -> xr.Dataset:
    """Collect everything that a quasi-static mesh cycle says.

    **Arguments:**

    - `model`: that was solved.
    - `cycle`: its settled states.
    - `law`: with which they were found.

    **Returns:**

    A dataset over phase, line, slice, harmonic, body and axis, in the units of files.
    """
    found = {name: np.asarray(x) for name, x in called(_responses, model, cycle, law).items()}
    facts = {name: np.asarray(x) for name, x in jg.pair_facts(model.pair).items()}
    variables = _over_phases(cycle, found) | _over_cells(cycle, found)
    variables |= _over_bodies(found) | _on_path(facts) | _over_bearings(found)
    variables["face_load_N_mm"] = Entry(
        ("slice",), found["face_load"] * jg.mm, "N/mm", "mean load per face width"
    )
    return xr.Dataset(
        {name: entry.variable() for name, entry in variables.items()},
        coords={name: entry.variable() for name, entry in _coordinates(cycle, facts).items()},
        attrs={
            "torque_pinion_Nm": float(model.torque),
            "face_width_mm": float(facts["face_width"]) / jg.mm,
            "base_radius_pinion_mm": float(facts["base_radius"][0]) / jg.mm,
            "teeth_pinion": model.pair.pinion.teeth,
            "teeth_wheel": model.pair.wheel.teeth,
        },
    )


def _responses(
    model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
) -> dict[str, Array]:
    """Everything that has to be computed, in SI, in one program."""
    pair, lines = model.pair, cycle.cells.lines
    error = jg.transmission_error(pair, cycle)
    # On the gears' mid-faces, also where a body bends: resultant and moment of the cells.
    wrench = jnp.stack(
        [jnp.sum(cycle.force, axis=1), jnp.sum(cycle.force * cycle.cells.arm, axis=1)], axis=1
    )
    return {
        "transmission_error": error,
        "te_harmonic": jg.harmonic_amplitudes(cycle, error, harmonic_count(cycle)),
        "mesh_stiffness": jg.mesh_stiffness(cycle),
        "load_sharing": jg.load_sharing(cycle),
        "gap": jg.mesh_gap(pair, lines, model.flanks, model.misalignment),
        "place": (lines.roll - pair.path_start) / pair.path_of_contact,
        "line_load": jg.line_load(cycle, law),
        "pressure": jg.hertz_pressure(pair, cycle, law),
        "pair_stiffness": _pair_stiffness(model, cycle),
        "motion": cycle.system.gear_motion(cycle.load),
        "body_load": -wrench @ jg.structure_vectors(pair).T,
        "face_load": jg.face_load(pair, cycle),
        **_bearings(cycle),
    }


def _pair_stiffness(model: jg.PairModel, cycle: jg.MeshCycle) -> Array:
    """Of a pair loaded alone: what it gives by itself, and what the bodies under it give."""
    pair, cells = model.pair, cycle.cells
    on_path = jnp.clip(cells.lines.roll, pair.path_start, pair.path_end)
    bodies = model.compliance.bodies(pair, 0)
    give = sum((body.compliance(on_path) for body in bodies), 1.0 / cells.line_stiffness)
    return 1.0 / give


def _bearings(cycle: jg.MeshCycle) -> dict[str, Array]:
    """Motion and load of every bearing at each phase; empty where there is none."""
    structure = cycle.system.structure
    if not structure.map.bearings:
        return {}
    motion = cycle.system.displacement(cycle.load)
    found = jax.vmap(lambda x: jg.bearing_motion(structure, x))(motion)
    return {"bearing_displacement": found.displacement, "bearing_load": found.load}


def harmonic_count(cycle: jg.MeshCycle) -> int:
    """Number of mesh harmonics that are written down, as far as the phases resolve them."""
    return min(_HARMONICS, (cycle.approach.size // cycle.cells.lines.periods - 1) // 2)


def _coordinates(cycle: jg.MeshCycle, facts: dict[str, np.ndarray]) -> dict[str, Entry]:
    lines = cycle.cells.lines
    passage = _passage(facts, lines)
    # At the first phase a line is that far from its entry, in whole periods.
    index = np.rint(passage[0] - np.asarray(lines.phase)[0]).astype(int)
    orders = np.arange(1, harmonic_count(cycle) + 1)
    return {
        "phase": Entry(("phase",), lines.phase, "1", "position in the cycle, in mesh periods"),
        "weight": Entry(("phase",), lines.weight, "1", "share of the cycle"),
        "line": Entry(("line",), index, "1", "contact line, in mesh periods since its entry"),
        "passage": Entry(
            ("phase", "line"), passage, "1", "mesh periods since the pair's entry at mid-face"
        ),
        "face_position_mm": Entry(
            ("slice",),
            np.asarray(lines.face_position) / jg.mm,
            "mm",
            "position from mid-face along the axes",
        ),
        "harmonic": Entry(("harmonic",), orders, "1", "order of the mesh frequency"),
        "body": Entry(("body",), list(BODIES), "1", "gear"),
        "axis": Entry(("axis",), list(_AXES), "1", "axis: S pinion to wheel, T = Z x S, Z axial"),
        "path_point": Entry(("path_point",), list("ABCDE"), "1", "point on the path of contact"),
    }


def _passage(facts: dict[str, np.ndarray], lines: jg.ContactLines) -> np.ndarray:
    """Mesh periods since each line's entry at mid-face, about which the slices are symmetric."""
    at_middle = np.mean(np.asarray(lines.roll), axis=2)
    return (at_middle - facts["path_start"]) / facts["transverse_base_pitch"]


def _over_phases(cycle: jg.MeshCycle, found: dict[str, np.ndarray]) -> dict[str, Entry]:
    return {
        "transmission_error_um": Entry(
            ("phase",), found["transmission_error"] / jg.um, "um", "quasi-static transmission error"
        ),
        "te_harmonic_um": Entry(
            ("harmonic",),
            found["te_harmonic"] / jg.um,
            "um",
            "amplitude of a mesh harmonic of the transmission error",
        ),
        "mesh_stiffness_N_um": Entry(
            ("phase",),
            found["mesh_stiffness"] * jg.um,
            "N/um",
            "stiffness of the cells in contact, along the normal",
        ),
        "load_sharing": Entry(
            ("phase", "line"), found["load_sharing"], "1", "share of the mesh force on a line"
        ),
        "mesh_force_N": Entry(
            ("phase",), np.asarray(cycle.load)[:, 0], "N", "mesh force along the normal"
        ),
        "converged": Entry(
            ("phase",),
            np.asarray(cycle.converged).astype(np.int8),
            "1",
            "1 where the contact was solved, else 0",
        ),
    }


def _over_cells(cycle: jg.MeshCycle, found: dict[str, np.ndarray]) -> dict[str, Entry]:
    lines = cycle.cells.lines
    shape = lines.roll.shape
    each = {
        "roll_mm": (
            np.asarray(lines.roll) / jg.mm,
            "mm",
            "roll length from the pinion's base tangent point",
        ),
        "profile_position": (found["place"], "1", "place on the path of contact, 0 start to 1 end"),
        "fraction": (lines.fraction, "1", "part of the slice that is in contact"),
        "line_load_N_mm": (
            found["line_load"] * jg.mm,
            "N/mm",
            "load per length of contact line",
        ),
        "pressure_MPa": (found["pressure"] / jg.MPa, "MPa", "largest Hertzian pressure"),
        "cell_force_N": (
            np.asarray(cycle.force).reshape(shape),
            "N",
            "force of a cell along the normal",
        ),
        "gap_um": (
            found["gap"].reshape(shape) / jg.um,
            "um",
            "gap of the undeformed flanks along the normal",
        ),
        "pair_stiffness_N_mm_um": (
            found["pair_stiffness"] / jg.N_per_mm_um,
            "N/(mm um)",
            "stiffness of a tooth pair loaded alone, per length of contact line",
        ),
    }
    dims = ("phase", "line", "slice")
    return {name: Entry(dims, *rest) for name, rest in each.items()}


def _over_bodies(found: dict[str, np.ndarray]) -> dict[str, Entry]:
    # Each body: three translations, then three rotations.
    motion = found["motion"].reshape(-1, 2, 2, 3)
    load = found["body_load"].reshape(-1, 2, 2, 3)
    each = {
        "displacement_um": (motion[:, :, 0] / jg.um, "um", "displacement of the gear's centre"),
        "rotation_urad": (
            motion[:, :, 1] * 1e6,
            "urad",
            "rotation of the gear, apart from the driven one",
        ),
        "body_force_N": (load[:, :, 0], "N", "force of the mesh on the gear"),
        "body_moment_Nm": (load[:, :, 1], "N m", "moment of the mesh about the gear's centre"),
    }
    return {name: Entry(("phase", "body", "axis"), *rest) for name, rest in each.items()}


def _over_bearings(found: dict[str, np.ndarray]) -> dict[str, Entry]:
    """The pinion's bearings first, in the order of the scene."""
    if "bearing_load" not in found:
        return {}
    motion, load = found["bearing_displacement"], found["bearing_load"]
    each = {
        "bearing_displacement_um": (motion[:, :, :3] / jg.um, "um", "displacement of the shaft"),
        "bearing_load_N": (load[:, :, :3], "N", "load of the shaft on the bearing"),
    }
    dims = ("phase", "bearing", "axis")
    return {name: Entry(dims, *rest) for name, rest in each.items()}


def _on_path(facts: dict[str, np.ndarray]) -> dict[str, Entry]:
    """Where A to E are. B and D bound single-pair contact, so they need a ratio of 1 to 2."""
    length, start = float(facts["path_of_contact"]), float(facts["path_start"])
    pitch = float(facts["transverse_base_pitch"]) / length
    place = (float(facts["pitch_point"]) - start) / length
    has_single = 0.5 < pitch < 1.0
    first, last = (1.0 - pitch, pitch) if has_single else (math.nan, math.nan)
    position = np.asarray([0.0, first, place, last, 1.0])
    return {
        "path_point_position": Entry(
            ("path_point",), position, "1", "place on the path of contact, 0 start to 1 end"
        ),
        "path_point_roll_mm": Entry(
            ("path_point",),
            (start + position * length) / jg.mm,
            "mm",
            "roll length from the pinion's base tangent point",
        ),
    }


def cycle_statistics(values: xr.DataArray) -> tuple[float, float, float]:
    """Weighted statistics of a variable over the cycle.

    **Arguments:**

    - `values`: over phase, from a dataset with its `weight`.

    **Returns:**

    Mean, RMS of the fluctuation about it, and peak to peak, in the unit of the variable.
    """
    weight, y = values["weight"].values, values.values
    mean = float(np.sum(weight * y))
    return mean, math.sqrt(float(np.sum(weight * (y - mean) ** 2))), float(np.ptp(y))


def flank_grid(dataset: xr.Dataset, variable: str, body: str, *, points: int = 81) -> xr.DataArray:
    """Collect what all lines saw at all phases onto one flank.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `variable`: one over phase, line and slice.
    - `body`: `pinion` or `wheel`: whose flank.
    - `points`: of the regular profile axis.

    **Returns:**

    The variable over `profile_position`, 0 near the root of this flank to 1 at its tip, and
    `face_position_mm`.

    **Raises:**

    - `ValueError` if there is no such body, or no such variable over the cells.
    """
    if body not in BODIES:
        raise ValueError(f"`body` must be one of {', '.join(BODIES)}, got {body!r}.")
    source = dataset[variable]
    if source.dims != ("phase", "line", "slice"):
        raise ValueError(f"`{variable}` must be over phase, line and slice, got {source.dims}.")
    place = dataset["profile_position"].values
    place = place if body == "pinion" else 1.0 - place
    on_flank = dataset["fraction"].values >= _ON_FLANK
    profile = np.linspace(0.0, 1.0, points)
    columns = []
    for each in range(source.sizes["slice"]):
        seen = on_flank[:, :, each]
        x, y = place[:, :, each][seen], source.values[:, :, each][seen]
        order = np.argsort(x)
        columns.append(np.interp(profile, x[order], y[order]))
    return xr.DataArray(
        np.stack(columns, axis=1),
        dims=("profile_position", "slice"),
        coords={
            "profile_position": (
                "profile_position",
                profile,
                {"units": "1", "long_name": f"place on the {body}'s flank, 0 root to 1 tip"},
            ),
            "face_position_mm": ("slice", *_values_and_attributes(dataset["face_position_mm"])),
        },
        attrs=source.attrs,
        name=variable,
    )


def _values_and_attributes(array: xr.DataArray) -> tuple[np.ndarray, dict]:
    return array.values, array.attrs


def write_dataset(
    dataset: xr.Dataset, path: Path, groups: Mapping[str, xr.Dataset] | None = None
) -> None:
    """Write a dataset as netCDF4.

    **Arguments:**

    - `dataset`: at the root of the file; it may be empty.
    - `path`: of the file.
    - `groups`: further datasets under their names, to be read with `group=`.
    """
    with whole_file(path) as draft:
        dataset.to_netcdf(draft, engine="netcdf4", format="NETCDF4")
        for name, group in (groups or {}).items():
            group.to_netcdf(draft, mode="a", group=name, engine="netcdf4", format="NETCDF4")


def write_json(summary: Mapping[str, object], path: Path) -> None:
    """Write a summary as JSON: arrays as lists, and what is not a finite number as null."""
    text = json.dumps(as_json(summary), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(text + "\n", path)


def as_json(value: object) -> object:
    """The value in the types that JSON knows; what is not a finite number is null.

    **Arguments:**

    - `value`: numbers, texts, arrays, lists and tables of them.
    """
    if isinstance(value, Mapping):
        return {str(key): as_json(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(each) for each in value]
    if isinstance(value, float):
        # NumPy's own double is a float too.
        return float(value) if math.isfinite(value) else None
    if isinstance(value, str | int | None):
        return value
    if hasattr(value, "tolist"):
        return as_json(np.asarray(value).tolist())
    raise TypeError(f"A summary holds numbers, texts, lists and tables, got {type(value)}.")


def write_csv(columns: Mapping[str, np.ndarray], path: Path) -> None:
    """Write one table as CSV, a row for each record, with ten digits.

    **Arguments:**

    - `columns`: numbers or texts under their names, units included, all of one length. The cell of
        what is not a finite number, or None, is empty.
    - `path`: of the file.

    **Raises:**

    - `ValueError` if a column is not one-dimensional, or not as long as the others.
    """
    texts = []
    for name, values in columns.items():
        array = np.asarray(values)
        if array.ndim != 1:
            raise ValueError(f"Column `{name}` must be one-dimensional, got shape {array.shape}.")
        texts.append([_cell(x) for x in array.tolist()])
    lengths = {name: len(each) for name, each in zip(columns, texts, strict=True)}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"The columns of a table must have one length, got {lengths}.")
    with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*texts, strict=True))


def _cell(value: object) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    number = cast(float, value)
    return f"{number:.10g}" if math.isfinite(number) else ""
