"""The data of the pictures of statics and searches, as columns with units."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

import jaxgear as jg
from jaxgear._kept_programs import called
from jaxgear._system._beam import beam_shapes
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._mesh_vectors import body_beam
from jaxgear._system._shaft import node_heights
from jaxgear.plot._cycle import amplitudes_of as _amplitudes
from jaxgear.plot._cycle import cycle_periods as _cycle_periods
from jaxgear.plot._cycle import flank_grid
from jaxgear.plot._cycle import mesh_orders as _mesh_orders
from jaxgear.plot._cycle import phase_shares as _shares
from jaxgear.plot._cycle import unrolled as _unrolled
from jaxgear.scene._teeth import tooth_outline
from jaxgear.study._results import BODIES

Columns = dict[str, np.ndarray]


def gear_pair_columns(model: jg.PairModel) -> Columns:
    """The data of `gear_pair`: the points of the tooth outlines, of one gear after the other."""
    return joined(
        [
            {"gear": np.full(outline.shape[1], name), "S_mm": outline[0], "T_mm": outline[1]}
            for body, name in enumerate(BODIES)
            for outline in [_outline(model.pair, body) / jg.mm]
        ]
    )


def joined(tables: Sequence[Mapping[str, np.ndarray]]) -> Columns:
    """Tables with the same columns, one under the other.

    **Arguments:**

    - `tables`: at least one; those of the first are the columns.
    """
    return {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}


_TEETH_SHOWN = 7


def _centre(pair: jg.GearPair, body: int) -> np.ndarray:
    """Place of a gear's axis in S and T [m]."""
    return np.asarray([float(_facts(pair)["working_centre_distance"]) * body, 0.0])


def _facts(pair: jg.GearPair) -> dict[str, np.ndarray]:
    """What is closed-form about a pair, in NumPy."""
    return {name: np.asarray(fact) for name, fact in jg.pair_facts(pair).items()}


def _outline(pair: jg.GearPair, body: int) -> np.ndarray:
    """Outline of several teeth around the mesh, S and T [m]."""
    radius, half = _tooth(pair, body)
    facts, count = _facts(pair), (pair.pinion, pair.wheel)[body].teeth
    step = 2.0 * np.pi / count
    # The loaded flank, which leads anticlockwise on either gear, passes through the pitch point.
    pitch_point = facts["pitch_point"]
    roll = (pitch_point, facts["tangent_length"] - pitch_point)[body]
    turned = roll / facts["base_radius"][body] - facts["half_thickness_at_base"][body]
    centreline = np.pi * body - facts["working_pressure_angle"] + turned
    shown = min(_TEETH_SHOWN, count)
    teeth = centreline + step * (np.arange(shown) - shown // 2)
    around = np.concatenate([-half, half[::-1]])
    angle = (teeth[:, None] + around).ravel()
    distance = np.tile(np.concatenate([radius, radius[::-1]]), len(teeth))
    return _centre(pair, body)[:, None] + distance * np.stack([np.cos(angle), np.sin(angle)])


def _tooth(pair: jg.GearPair, body: int) -> tuple[np.ndarray, np.ndarray]:
    """Radius [m] and half angle [rad] of a tooth, from mid-space over the flank to mid-tip."""
    x, y = tooth_outline(pair, body)
    radius, half = np.hypot(x, y), np.arctan2(x, y)
    space = np.linspace(np.pi / (pair.pinion, pair.wheel)[body].teeth, half[0], 7)[:-1]
    land = np.linspace(half[-1], 0.0, 7)[1:]
    radius = np.concatenate([np.full(6, radius[0]), radius, np.full(6, radius[-1])])
    return radius, np.concatenate([space, half, land])


def shafts_columns(model: jg.PairModel, cycle: jg.MeshCycle) -> Columns:
    """The data of `shafts`: the points of the deflected lines, of one shaft after the other."""
    return joined(
        [
            {
                "gear": np.full(len(z), name),
                "Z_mm": z / jg.mm,
                "deflection_S_um": along_s / jg.um,
                "deflection_T_um": along_t / jg.um,
            }
            for name, (z, along_s, along_t) in _deflected_lines(model, cycle).items()
        ]
    )


def bearing_columns(model: jg.PairModel, bearings: Sequence[Mapping[str, Any]]) -> Columns:
    """The data of `shafts`, a row for each bearing."""
    mounts = dict(zip(BODIES, _mounts(model), strict=True))
    at = [
        _height(mounts[each["gear"]], mounts[each["gear"]].bearings[each["index"]].at)
        for each in bearings
    ]
    columns = {name: np.asarray([each[name] for each in bearings]) for name in ("gear", "index")}
    return (
        columns
        | {"Z_mm": np.asarray(at)}
        | {f"load_{x}_N": np.asarray([each["load_N"][x] for each in bearings]) for x in "STZ"}
    )


def _mounts(model: jg.PairModel) -> tuple[Any, Any]:
    return model.pinion_support, model.wheel_support


def _height(shaft: jg.Shaft, at: Any) -> float:
    """Place along Z of a height on the shaft, from mid-face [mm]."""
    return (float(at) - float(shaft.gear_at)) / jg.mm


def _deflected_lines(model: jg.PairModel, cycle: jg.MeshCycle) -> dict[str, np.ndarray]:
    """Place along Z and mean deflection along S and T of each shaft's axis [m], by name."""
    return {name: np.asarray(line) for name, line in called(_lines_of_shafts, model, cycle).items()}


def _lines_of_shafts(model: jg.PairModel, cycle: jg.MeshCycle) -> dict[str, Array]:
    mean = cycle.cells.lines.weight @ cycle.load
    motion = cycle.system.displacement(mean[None])[0]
    first = cycle.system.structure.map.sizes[0]
    parts = motion[:first], motion[first:]
    bodies = model.pinion_body, model.wheel_body
    return {
        name: _seats_of_body(body, part)
        if isinstance(body, FlexibleBody)
        else _line_of_shaft(mount, body if isinstance(body, jg.BeamBody) else None, part)
        for name, mount, body, part in zip(BODIES, _mounts(model), bodies, parts, strict=True)
        if isinstance(mount, jg.Shaft)
    }


def _seats_of_body(body: FlexibleBody, motion: Array) -> Array:
    """Rows Z from mid-face, displacement along S and T: each seat of a condensed body [m]."""
    moved = motion.reshape(-1, 6)
    return jnp.stack([body.seat_heights, moved[:, 0], moved[:, 1]])


_POINTS_OF_BEAM = 9


def _line_of_shaft(shaft: jg.Shaft, body: jg.BeamBody | None, motion: Array) -> Array:
    """Rows Z from mid-face, deflection along S and T: several points on each element [m]."""
    heights = node_heights(shaft, body)
    fraction = jnp.linspace(0.0, 1.0, _POINTS_OF_BEAM)
    segment = np.repeat(np.asarray(shaft.layout.segments), np.asarray(shaft.layout.cuts))
    parts = []
    for element, index in enumerate(segment):
        length = heights[element + 1] - heights[element]
        if body is not None and element == shaft.layout.gear_nodes[0]:
            beam = body_beam(shaft, body)
        else:
            beam = _beam_of_segment(shaft, shaft.segments[index], length)
        ends = motion[6 * element : 6 * element + 12]
        shape = jax.vmap(lambda at, beam=beam: beam_shapes(beam, at)[:2])(fraction) @ ends
        parts.append(jnp.stack([heights[element] + fraction * length, *shape.T]))
    line = jnp.concatenate(parts, axis=1)
    return line.at[0].add(-shaft.gear_at)


def _beam_of_segment(shaft: jg.Shaft, segment: jg.Segment, length: Array) -> jg.Beam:
    """A stretch of a segment between two nodes."""
    outer, inner, shear = segment.outer, segment.inner, shaft.shear_coefficient
    if shear is None:
        shear = jg.cowper_coefficient(outer, inner, shaft.material.poisson)
    return jg.Beam(length, outer, inner, shear, shaft.material)


def transmission_error_columns(dataset: xr.Dataset) -> Columns:
    """The data of `transmission_error`, over phase."""
    names = ("phase", "transmission_error_um")
    return dict(zip(names, _unrolled(*(dataset[name].values for name in names)), strict=True))


def te_harmonics_columns(dataset: xr.Dataset) -> Columns:
    """The data of `transmission_error`, a row for each mesh harmonic."""
    phase, weight, error = (
        dataset[name].values for name in ("phase", "weight", "transmission_error_um")
    )
    orders = _mesh_orders(phase)
    return {"harmonic": orders, "te_harmonic_um": _amplitudes(phase, weight, error, orders)}


def mesh_stiffness_columns(dataset: xr.Dataset) -> Columns:
    """The data of `stiffness_and_sharing`, over phase."""
    names = ("phase", "mesh_stiffness_N_um")
    return dict(zip(names, _unrolled(*(dataset[name].values for name in names)), strict=True))


def load_sharing_columns(dataset: xr.Dataset) -> Columns:
    """The data of `stiffness_and_sharing`, of one tooth pair after the other."""
    phase = dataset["phase"].values
    roll = dataset["roll_mm"].mean("slice").values
    touching = (dataset["fraction"] > 1e-6).any("slice").values
    sharing = dataset["load_sharing"].values
    # In the order of entry; the cycle begins again with the same pair.
    pair = np.rint(phase[:, None] - dataset["passage"].values).astype(int) % _cycle_periods(phase)
    parts = []
    for one in np.unique(pair):
        places = np.nonzero(pair == one)
        places = tuple(x[np.argsort(roll[places])] for x in places)
        first, last = np.nonzero(touching[places])[0][[0, -1]]
        # One free place on either side, so that entry and exit are seen.
        shown = tuple(x[max(first - 1, 0) : last + 2] for x in places)
        parts.append((np.full(len(shown[0]), one), roll[shown], sharing[shown]))
    names = ("tooth_pair", "roll_mm", "load_sharing")
    return joined([dict(zip(names, part, strict=True)) for part in parts])


_FLANK_MAPS = {
    "line_load_N_mm": ("line load", "N/mm"),
    "pressure_MPa": ("Hertzian pressure", "MPa"),
}


def flank_maps_columns(dataset: xr.Dataset) -> Columns:
    """The data of `flank_maps`, one row per place on the flank."""
    grids = {name: flank_grid(dataset, name, "pinion") for name in _FLANK_MAPS}
    first = grids["pressure_MPa"]
    place, face = np.meshgrid(
        first["profile_position"].values, first["face_position_mm"].values, indexing="ij"
    )
    angle, diameter = _along_flank(dataset, place.ravel())
    columns = {
        "profile_position": place.ravel(),
        "roll_angle_deg": angle,
        "diameter_mm": diameter,
        "face_position_mm": face.ravel(),
    }
    return columns | {name: grid.values.ravel() for name, grid in grids.items()}


def _along_flank(dataset: xr.Dataset, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roll angle [degrees] and diameter [mm] at places on the pinion's flank, root 0 to tip 1."""
    start, end = dataset["path_point_roll_mm"].sel(path_point=["A", "E"]).values
    roll, base = start + place * (end - start), dataset.attrs["base_radius_pinion_mm"]
    return roll / base / jg.deg, 2.0 * np.hypot(base, roll)


def face_load_columns(dataset: xr.Dataset) -> Columns:
    """The data of `face_load`."""
    load = _loads_across(dataset)
    return {
        "face_position_mm": dataset["face_position_mm"].values,
        "face_load_mean_N_mm": dataset["weight"].values @ load,
        "face_load_at_largest_N_mm": load[_phase_of_largest(load)],
    }


def _loads_across(dataset: xr.Dataset) -> np.ndarray:
    """Load per face width, rows phases, columns slices, all contact lines together [N/mm]."""
    force = dataset["cell_force_N"].sum("line").values
    return force * force.shape[1] / dataset.attrs["face_width_mm"]


def _phase_of_largest(load: np.ndarray) -> int:
    return int(np.argmax(np.max(load, axis=1)))


def harris_map_columns(
    torques_Nm: np.ndarray,
    phases: np.ndarray,
    te_um: np.ndarray,
    *,
    weight: np.ndarray | None = None,
) -> Columns:
    """The data of `harris_map`, one row per torque."""
    weight = _shares(phases) if weight is None else weight
    mean = te_um @ weight
    return {
        "torque_pinion_Nm": np.asarray(torques_Nm),
        "te_mean_um": mean,
        "te_rms_um": np.sqrt((te_um - mean[:, None]) ** 2 @ weight),
        "te_peak_to_peak_um": np.ptp(te_um, axis=1),
    }


def harris_curves_columns(torques_Nm: np.ndarray, phases: np.ndarray, te_um: np.ndarray) -> Columns:
    """The data of `harris_map`, one row per torque and phase."""
    return {
        "torque_pinion_Nm": np.repeat(torques_Nm, len(phases)),
        "phase": np.tile(phases, len(torques_Nm)),
        "transmission_error_um": te_um.ravel(),
    }


def te_spectrum_columns(
    torques_Nm: np.ndarray,
    phases: np.ndarray,
    te_um: np.ndarray,
    *,
    weight: np.ndarray | None = None,
) -> Columns:
    """The data of `te_spectrum`, one row per torque and order."""
    order, amplitudes = _spectra(phases, te_um, weight)
    return {
        "torque_pinion_Nm": np.repeat(torques_Nm, len(order)),
        "order": np.tile(order, len(torques_Nm)),
        "te_order_um": amplitudes.ravel(),
    }


def _spectra(
    phases: np.ndarray, te_um: np.ndarray, weight: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Orders of the mesh frequency, and their amplitudes, rows torques [um]."""
    weight = _shares(phases) if weight is None else weight
    periods, last = _cycle_periods(phases), _mesh_orders(phases)[-1]
    order = np.arange(1, last * periods + 1) / periods
    return order, _amplitudes(phases, weight, te_um, order)


def smoothing_bias_columns(
    width_um: np.ndarray,
    mean_bias_um: np.ndarray,
    rms_bias_relative: np.ndarray,
    *,
    gradient_bias_relative: np.ndarray | None = None,
) -> Columns:
    """The data of `smoothing_bias`."""
    columns = {
        "width_um": width_um,
        "te_mean_bias_um": mean_bias_um,
        "te_rms_bias_relative": rms_bias_relative,
    }
    if gradient_bias_relative is not None:
        columns["gradient_bias_relative"] = gradient_bias_relative
    return columns


def master_curve_columns(chart: Any) -> Columns:
    """The data of `master_curve`, one row per place on the map."""
    depth, extent = np.meshgrid(chart.depth / jg.um, chart.extent, indexing="ij")
    return {
        "depth_um": depth.ravel(),
        "extent": extent.ravel(),
        "te_rms_um": chart.value.ravel(),
    }


def valley_columns(chart: Any, valley: Any, closed_form_um: np.ndarray) -> Columns:
    """The data of `master_curve`, one row per extent: the best depth, and the closed form's."""
    return {
        "extent": chart.extent,
        "depth_um": valley.depth / jg.um,
        "te_rms_um": valley.value,
        "closed_form_depth_um": closed_form_um,
    }


def search_trace_columns(values_by_method: Mapping[str, np.ndarray], unit: str) -> Columns:
    """The data of `search_trace`: each evaluation, of one method after the other."""
    return joined(
        [
            {
                "method": np.full(len(values), name),
                "evaluation": np.arange(1, len(values) + 1),
                with_unit("objective", unit): values,
            }
            for name, values in values_by_method.items()
        ]
    )


def with_unit(name: str, unit: str) -> str:
    """The name of a column, with its unit.

    **Arguments:**

    - `name`: of the quantity.
    - `unit`: as it stands in names; `-` where there is none.
    """
    return name if unit == "-" else f"{name}_{unit}"


def before_after_columns(dataset_before: xr.Dataset, dataset_after: xr.Dataset) -> Columns:
    """The data of `before_after`, of one design after the other."""
    parts = []
    for name, dataset in (("before", dataset_before), ("after", dataset_after)):
        own = dataset["phase"].values
        phase, error = _unrolled(own, dataset["transmission_error_um"].values)
        parts.append(
            {
                "design": np.full(len(phase), name),
                "phase": phase,
                "transmission_error_um": error,
                "max_pressure_MPa": _unrolled(own, _largest_pressure(dataset))[1],
            }
        )
    return joined(parts)


def _largest_pressure(dataset: xr.Dataset) -> np.ndarray:
    """Largest pressure on any line at each phase [MPa]."""
    return dataset["pressure_MPa"].max(("line", "slice")).values
