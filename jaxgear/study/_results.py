"""Variables of datasets, and the dataset of a mesh cycle.

The library's SI values leave here in the units of files, which stand in every name and in every
variable's `units`.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from numpy.typing import ArrayLike

import jaxgear as jg
from jaxgear._geometry._lines import ContactLines
from jaxgear._kept_programs import called
from jaxgear._units import MPa, N_per_mm_um, deg, mm, um
from jaxgear.scene._schema import GEARS

_HARMONICS = 10
# Units of files by the ends of names, the longest first: how they are written, and their size [SI].
_UNITS = {
    "_N_mm_um": ("N/(mm um)", N_per_mm_um),
    "_N_mm": ("N/mm", 1.0 / mm),
    "_N_um": ("N/um", 1.0 / um),
    "_mm_s": ("mm/s", mm),
    "_rad_s": ("rad/s", 1.0),
    "_urad": ("urad", um),
    "_um": ("um", um),
    "_mm": ("mm", mm),
    "_deg": ("deg", deg),
    "_MPa": ("MPa", MPa),
    "_Nm": ("N m", 1.0),
    "_Hz": ("Hz", 1.0),
    "_N": ("N", 1.0),
}


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


Entries = dict[str, Entry]


def over(dims: str, **found: tuple[Any, str]) -> Entries:
    """Variables over some dimensions: of each its values, in SI, and what it is.

    The unit at the end of a name is that of the file; without one the values are numbers.
    """
    sizes = {name: unit_of_name(name)[1] for name in found}
    return told(
        dims,
        **{
            name: (values if sizes[name] == 1.0 else np.asarray(values) / sizes[name], words)
            for name, (values, words) in found.items()
        },
    )


def told(dims: str, **found: tuple[Any, str]) -> Entries:
    """As `over`, of values in the units of files."""
    along = tuple(dims.split())
    return {
        name: Entry(along, x, unit_of_name(name)[0], words) for name, (x, words) in found.items()
    }


def unit_of_name(name: str) -> tuple[str, float]:
    """The unit of a file at the end of a name, and its size in SI; `1` without one."""
    return next((each for end, each in _UNITS.items() if name.endswith(end)), ("1", 1.0))


def dataset_of(variables: Mapping[str, Entry], **coordinates: Entry) -> xr.Dataset:
    """A dataset of entries by name: variables and coordinates."""
    return xr.Dataset(
        {name: entry.variable() for name, entry in variables.items()},
        coords={name: entry.variable() for name, entry in coordinates.items()},
    )


def entries_over(
    dims: tuple[str, ...], rows: Mapping[str, tuple[ArrayLike, str, str]]
) -> Mapping[str, Entry]:
    """Variables of the same dimensions: values, units and words, by name."""
    return {name: Entry(dims, *row) for name, row in rows.items()}


def static_dataset(
    model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
) -> xr.Dataset:
    """Everything that a quasi-static mesh cycle says, in the units of files."""
    found = jax.tree.map(np.asarray, called(_responses, model, cycle, law))
    facts = jax.tree.map(np.asarray, jg.pair_facts(model.pair))
    variables = _over_mesh(cycle, found) | _over_bodies(found) | _on_path(facts)
    return dataset_of(variables, **_coordinates(cycle, facts)).assign_attrs(
        torque_pinion_Nm=float(model.torque),
        face_width_mm=float(facts.face_width) / mm,
        base_radius_pinion_mm=float(facts.base_radius[0]) / mm,
        teeth_pinion=model.pair.pinion.teeth,
        teeth_wheel=model.pair.wheel.teeth,
    )


class _Responses(NamedTuple):
    """Responses of a mesh cycle, in SI; `None` where no corner touches or no bearing is."""

    transmission_error: Array
    unloaded: Array
    te_harmonic: Array
    mesh_stiffness: Array
    load_sharing: Array
    gap: Array
    place: Array
    line_load: Array
    pressure: Array
    pair_stiffness: Array
    motion: Array
    body_load: Array
    face_load: Array
    corner_pressure: Array | None
    bearing_displacement: Array | None
    bearing_load: Array | None


def _responses(model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw) -> _Responses:
    """Everything that has to be computed, in SI, in one program."""
    pair, lines, structure = model.pair, cycle.cells.lines, cycle.system.structure
    error = jg.transmission_error(pair, cycle)
    # On the gears' mid-faces, also where a body bends: resultant and moment of the cells.
    wrench = jnp.stack(
        [jnp.sum(cycle.force, axis=1), jnp.sum(cycle.force * cycle.cells.arm, axis=1)], axis=1
    )
    gap = jg.mesh_gap(pair, lines, model.flanks, model.misalignment)
    corners, displacement, load = None, None, None
    if has_corners(lines, pair):
        corners = jg.corner_pressure(pair, cycle, law)
    if structure.map.bearings:
        motion = cycle.system.displacement(cycle.load)
        bearings = jax.vmap(lambda x: jg.bearing_motion(structure, x))(motion)
        displacement, load = bearings.displacement, bearings.load
    return _Responses(
        transmission_error=error,
        unloaded=jg.unloaded_transmission_error(pair, cycle.cells, gap),
        te_harmonic=jg.harmonic_amplitudes(cycle, error, harmonic_count(cycle)),
        mesh_stiffness=jg.mesh_stiffness(cycle),
        load_sharing=jg.load_sharing(cycle),
        gap=gap,
        place=(lines.roll - pair.path_start) / pair.path_of_contact,
        line_load=jg.line_load(cycle, law),
        pressure=jg.hertz_pressure(pair, cycle, law),
        pair_stiffness=_pair_stiffness(model, cycle),
        motion=cycle.system.gear_motion(cycle.load),
        body_load=-wrench @ jg.structure_vectors(pair).T,
        face_load=jg.face_load(pair, cycle),
        corner_pressure=corners,
        bearing_displacement=displacement,
        bearing_load=load,
    )


def _pair_stiffness(model: jg.PairModel, cycle: jg.MeshCycle) -> Array:
    """Of a pair loaded alone: what it gives by itself, and what the bodies under it give."""
    pair, cells = model.pair, cycle.cells
    on_path = jnp.clip(cells.lines.roll, pair.path_start, pair.path_end)
    load = jg.nominal_line_load(pair, model.mesh_torque)
    own = 1.0 / cells.line_stiffness + (0.0 if cells.spread is None else cells.spread)
    return 1.0 / (own + model.compliance.alone(pair, on_path, load))


def harmonic_count(cycle: jg.MeshCycle) -> int:
    """Number of mesh harmonics that are written down, as far as the phases resolve them."""
    return harmonics_resolved(cycle.cells.lines)


def has_corners(lines: ContactLines, pair: jg.GearPair) -> bool:
    """Whether tip corners may touch, and the radius of one is known."""
    known = any(gear.tip_corner_radius is not None for gear in (pair.pinion, pair.wheel))
    return known and lines.beyond > 0.0


def harmonics_resolved(lines: ContactLines) -> int:
    """As `harmonic_count`, of contact lines that no load has been put on."""
    return min(_HARMONICS, (lines.phase.size // lines.periods - 1) // 2)


def _coordinates(cycle: jg.MeshCycle, facts: jg.PairFacts) -> Entries:
    lines = cycle.cells.lines
    # Mesh periods since each line's entry at mid-face, about which the slices are symmetric.
    at_middle = np.mean(np.asarray(lines.roll), axis=2)
    passage = (at_middle - facts.path_start) / facts.transverse_base_pitch
    # At the first phase a line is that far from its entry, in whole periods.
    index = np.rint(passage[0] - np.asarray(lines.phase)[0]).astype(int)
    orders = np.arange(1, harmonic_count(cycle) + 1)
    return (
        over(
            "phase",
            phase=(lines.phase, "position in the cycle, in mesh periods"),
            weight=(lines.weight, "share of the cycle"),
        )
        | over("line", line=(index, "contact line, in mesh periods since its entry"))
        | over("phase line", passage=(passage, "mesh periods since the pair's entry at mid-face"))
        | over(
            "slice",
            face_position_mm=(lines.face_position, "position from mid-face along the axes"),
        )
        | over("harmonic", harmonic=(orders, "order of the mesh frequency"))
        | over("body", body=(list(GEARS), "gear"))
        | over("axis", axis=(list("STZ"), "axis: S pinion to wheel, T = Z x S, Z axial"))
        | over("path_point", path_point=(list("ABCDE"), "point on the path of contact"))
    )


def _over_mesh(cycle: jg.MeshCycle, found: _Responses) -> Entries:
    """What the flanks do, over phases, and over the cells of the contact lines."""
    lines = cycle.cells.lines
    of_cells = lambda values: np.asarray(values).reshape(lines.roll.shape)
    te = "transmission error"
    solved = np.asarray(cycle.converged).astype(np.int8)
    corners = {}
    if found.corner_pressure is not None:
        words = "pressure of a tip corner of known radius beyond the path"
        corners["corner_pressure_MPa"] = found.corner_pressure, words
    return (
        over(
            "phase",
            transmission_error_um=(found.transmission_error, f"quasi-static {te}"),
            unloaded_te_um=(found.unloaded, f"{te} of rigid gears without load"),
            mesh_stiffness_N_um=(
                found.mesh_stiffness,
                "stiffness of the cells in contact, along the normal",
            ),
            mesh_force_N=(np.asarray(cycle.load)[:, 0], "mesh force along the normal"),
            converged=(solved, "1 where the contact was solved, else 0"),
        )
        | over(
            "harmonic",
            te_harmonic_um=(found.te_harmonic, f"amplitude of a mesh harmonic of the {te}"),
        )
        | over(
            "phase line",
            load_sharing=(found.load_sharing, "share of the mesh force on a line"),
        )
        | over(
            "phase line slice",
            roll_mm=(lines.roll, "roll length from the pinion's base tangent point"),
            profile_position=(found.place, "place on the path of contact, 0 start to 1 end"),
            fraction=(lines.fraction, "part of the slice that is in contact"),
            line_load_N_mm=(found.line_load, "load per length of contact line"),
            pressure_MPa=(found.pressure, "largest Hertzian pressure"),
            **corners,
            cell_force_N=(of_cells(cycle.force), "force of a cell along the normal"),
            gap_um=(of_cells(found.gap), "gap of the undeformed flanks along the normal"),
            pair_stiffness_N_mm_um=(
                found.pair_stiffness,
                "stiffness of a tooth pair loaded alone, per length of contact line",
            ),
        )
        | over("slice", face_load_N_mm=(found.face_load, "mean load per face width"))
    )


def _over_bodies(found: _Responses) -> Entries:
    """What gears and bearings do, the pinion's bearings first, in the order of the scene."""
    # Each body: three translations, then three rotations.
    motion, load = (each.reshape(-1, 2, 2, 3) for each in (found.motion, found.body_load))
    entries = over(
        "phase body axis",
        displacement_um=(motion[:, :, 0], "displacement of the gear's centre"),
        rotation_urad=(motion[:, :, 1], "rotation of the gear, apart from the driven one"),
        body_force_N=(load[:, :, 0], "force of the mesh on the gear"),
        body_moment_Nm=(load[:, :, 1], "moment of the mesh about the gear's centre"),
    )
    motion, load = found.bearing_displacement, found.bearing_load
    if motion is not None and load is not None:
        entries |= over(
            "phase bearing axis",
            bearing_displacement_um=(motion[:, :, :3], "displacement of the shaft"),
            bearing_load_N=(load[:, :, :3], "load of the shaft on the bearing"),
        )
    return entries


def _on_path(facts: jg.PairFacts) -> Entries:
    """Where A to E are. B and D bound single-pair contact, so they need a ratio of 1 to 2."""
    length, start = float(facts.path_of_contact), float(facts.path_start)
    pitch = float(facts.transverse_base_pitch) / length
    place = (float(facts.pitch_point) - start) / length
    first, last = (1.0 - pitch, pitch) if 0.5 < pitch < 1.0 else (math.nan, math.nan)
    position = np.asarray([0.0, first, place, last, 1.0])
    roll = start + position * length
    return over(
        "path_point",
        path_point_position=(position, "place on the path of contact, 0 start to 1 end"),
        path_point_roll_mm=(roll, "roll length from the pinion's base tangent point"),
    )
