"""What is written down: the dataset of a mesh cycle, and the files of the results folder.

The library's SI values leave here in the units of files, which stand in every name and in every
variable's `units`. A file appears whole or not at all.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from numpy.typing import ArrayLike

import jaxgear as jg
from jaxgear._kept_programs import called

BODIES = ("pinion", "wheel")
_AXES = ("S", "T", "Z")
_HARMONICS = 10


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


def dataset_of(variables: Mapping[str, Entry], **coordinates: Entry) -> xr.Dataset:
    """A dataset of entries.

    **Arguments:**

    - `variables`: by name.
    - `coordinates`: likewise.
    """
    return xr.Dataset(
        {name: entry.variable() for name, entry in variables.items()},
        coords={name: entry.variable() for name, entry in coordinates.items()},
    )


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
    return dataset_of(variables, **_coordinates(cycle, facts)).assign_attrs(
        {
            "torque_pinion_Nm": float(model.torque),
            "face_width_mm": float(facts["face_width"]) / jg.mm,
            "base_radius_pinion_mm": float(facts["base_radius"][0]) / jg.mm,
            "teeth_pinion": model.pair.pinion.teeth,
            "teeth_wheel": model.pair.wheel.teeth,
        }
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
    load = jg.nominal_line_load(pair, model.mesh_torque)
    shared = model.compliance.alone(pair, on_path, load)
    return 1.0 / (shared + 1.0 / cells.line_stiffness)


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
