"""Shafts as a dataset: their shape, how they deflect, what bearings carry and what loads them."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from jaxgear._kept_programs import called
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._beam import Beam, beam_shapes, cowper_coefficient
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._gear_body import BeamBody
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Segment, Shaft, node_heights
from jaxgear._units import mm, um
from jaxgear.scene._schema import GEARS
from jaxgear.study._results import Entry, dataset_of, entries_over

# Points on each element of a deflected line.
POINTS_OF_BEAM = 9


def shafts_dataset(
    model: PairModel,
    cycle: MeshCycle,
    bearings: list[dict[str, Any]],
    sections: Mapping[str, np.ndarray],
) -> xr.Dataset:
    """Both shafts in the plane of the axes, of a model with at least one: Z from mid-face.

    A dataset over points of the lines that deflect so in the mean of a solved cycle, segments,
    bearings as in `static.bearings` of the summary, further loads and elements of sections of
    condensed bodies (radius and Z, shape `[element, point, 2]` [m]), each with its gear.
    """
    mounts = dict(zip(GEARS, (model.pinion_support, model.wheel_support), strict=True))
    shafts = {gear: mount for gear, mount in mounts.items() if isinstance(mount, Shaft)}
    bodies: dict[str, Any] = dict(zip(GEARS, model.bodies, strict=True))
    seats = [isinstance(bodies[gear], FlexibleBody) for gear in shafts]
    words = "whether points are seats of a condensed body, and no line"
    return dataset_of(
        {
            **_lines(deflected_lines(model, cycle)),
            **_segments(shafts),
            **_bearings(shafts, bearings),
            **_loads(model, shafts),
            **_sections(sections),
            "seats_only": Entry(("mount",), seats, "1", words),
        },
        mount=Entry(("mount",), list(shafts), "1", "gear that is on a shaft"),
        axis=Entry(("axis",), list("STZ"), "1", "axis: S pinion to wheel, T = Z x S, Z axial"),
    )


def _lines(lines: Mapping[str, np.ndarray]) -> Mapping[str, Entry]:
    gears = np.concatenate([np.full(line.shape[1], gear) for gear, line in lines.items()])
    z, along_s, along_t = np.concatenate(list(lines.values()), axis=1)
    rows = {
        "gear": (gears, "1", "gear of the shaft"),
        "Z_mm": (z / mm, "mm", "place along Z from mid-face"),
        "deflection_S_um": (along_s / um, "um", "mean deflection along S"),
        "deflection_T_um": (along_t / um, "um", "mean deflection along T"),
    }
    return entries_over(("point",), rows)


def _segments(shafts: Mapping[str, Shaft]) -> Mapping[str, Entry]:
    found = []
    for gear, shaft in shafts.items():
        start = height(shaft, 0.0)
        for each in shaft.segments:
            length, outer, inner = (float(x) / mm for x in (each.length, each.outer, each.inner))
            found.append((gear, start, length, outer, inner))
            start += length
    gears, start, length, outer, inner = map(np.asarray, zip(*found, strict=True))
    rows = {
        "segment_gear": (gears, "1", "gear of the shaft"),
        "segment_start_Z_mm": (start, "mm", "start of the segment along Z"),
        "segment_length_mm": (length, "mm", "length of the segment"),
        "segment_outer_mm": (outer, "mm", "outer diameter of the segment"),
        "segment_inner_mm": (inner, "mm", "bore of the segment"),
    }
    return entries_over(("segment",), rows)


def _bearings(shafts: Mapping[str, Shaft], told: list[dict[str, Any]]) -> Mapping[str, Entry]:
    gears, index = [each["gear"] for each in told], [each["index"] for each in told]
    own = [shafts[gear] for gear in gears]
    springs = [shaft.bearings[i] for shaft, i in zip(own, index, strict=True)]
    places = [height(shaft, spring.at) for shaft, spring in zip(own, springs, strict=True)]
    stiffness = [float(spring.axial) for spring in springs]
    rows = {
        "bearing_gear": (gears, "1", "gear of the shaft"),
        "bearing_index": (index, "1", "bearing of the shaft"),
        "bearing_Z_mm": (places, "mm", "place along Z from mid-face"),
        "bearing_axial_N_m": (np.asarray(stiffness), "N/m", "stiffness along Z"),
    }
    for axis in "STZ":
        load = np.asarray([each["load_N"][axis] for each in told])
        words = f"mean load of the shaft on the bearing along {axis}"
        rows[f"bearing_load_{axis}_N"] = load, "N", words
    return entries_over(("bearing",), rows)


def _loads(model: PairModel, shafts: Mapping[str, Shaft]) -> Mapping[str, Entry]:
    """The torque about Z, and what else loads a shaft from outside."""
    at = [
        height(shaft, shaft.gear_at if shaft.torque_at is None else shaft.torque_at)
        for shaft in shafts.values()
    ]
    extra = [
        (gear, shaft, load)
        for gear, shaft in shafts.items()
        for load in shaft.loads
        # Those of zero are nodes of an unbalance.
        if np.any(load.force) or np.any(load.moment)
    ]
    vector = lambda name: np.reshape([getattr(load, name) for *_, load in extra], (-1, 3))
    mounts = {
        "torque_Nm": ([torque_on(model, gear) for gear in shafts], "N m", "torque about Z"),
        "torque_Z_mm": (at, "mm", "where the torque enters, from mid-face"),
    }
    heights = [height(shaft, load.at) for _, shaft, load in extra]
    loads = {
        "load_gear": ([str(gear) for gear, *_ in extra], "1", "gear of the shaft"),
        "load_Z_mm": (heights, "mm", "place along Z"),
    }
    vectors = {
        "load_force_N": (vector("force"), "N", "force on a shaft"),
        "load_moment_Nm": (vector("moment"), "N m", "moment on a shaft"),
    }
    return {
        **entries_over(("mount",), mounts),
        **entries_over(("load",), loads),
        **entries_over(("load", "axis"), vectors),
    }


def _sections(sections: Mapping[str, np.ndarray]) -> Mapping[str, Entry]:
    if not sections:
        return {}
    gears = np.concatenate([np.full(len(each), gear) for gear, each in sections.items()])
    r, z = np.moveaxis(np.concatenate(list(sections.values())), 2, 0) / mm
    rows = {
        "section_r_mm": (r, "mm", "radius of a corner of an element in the cut"),
        "section_Z_mm": (z, "mm", "its place along Z from mid-face"),
    }
    return {
        "section_gear": Entry(("element",), gears, "1", "gear whose body is cut"),
        **entries_over(("element", "corner"), rows),
    }


def height(shaft: Shaft, at: Any) -> float:
    """Place along Z of a height on the shaft, from mid-face [mm]."""
    return (float(at) - float(shaft.gear_at)) / mm


def torque_on(model: PairModel, gear: str) -> float:
    """Torque about +Z that the drive or what is driven puts on a shaft [N m]."""
    if gear == "pinion":
        return float(model.torque)
    wheel = model.wheel_support
    loads = wheel.loads if isinstance(wheel, Shaft) else ()
    ratio = model.pair.wheel.teeth / model.pair.pinion.teeth
    return ratio * float(model.mesh_torque) - sum(float(load.moment[2]) for load in loads)


def deflected_lines(model: PairModel, cycle: MeshCycle) -> Mapping[str, np.ndarray]:
    """Place along Z and mean deflection along S and T of each shaft's axis [m], by gear."""
    return {name: np.asarray(line) for name, line in called(_lines_of_shafts, model, cycle).items()}


def _lines_of_shafts(model: PairModel, cycle: MeshCycle) -> Mapping[str, Array]:
    mean = cycle.cells.lines.weight @ cycle.load
    motion = cycle.system.displacement(mean[None])[0]
    first = cycle.system.structure.map.sizes[0]
    parts = motion[:first], motion[first:]
    mounts = model.pinion_support, model.wheel_support
    return {
        name: _seats_of_body(body, part)
        if isinstance(body, FlexibleBody)
        else line_of_shaft(mount, body if isinstance(body, BeamBody) else None, part)
        for name, mount, body, part in zip(GEARS, mounts, model.bodies, parts, strict=True)
        if isinstance(mount, Shaft)
    }


def _seats_of_body(body: FlexibleBody, motion: Array) -> Array:
    """Rows Z from mid-face, displacement along S and T: each seat of a condensed body [m]."""
    moved = motion.reshape(-1, 6)
    return jnp.stack([body.seat_heights, moved[:, 0], moved[:, 1]])


def line_of_shaft(shaft: Shaft, body: BeamBody | None, motion: Array) -> Array:
    """Rows Z from mid-face, deflection along S and T: several points on each element [m]."""
    heights = node_heights(shaft, body)
    fraction = jnp.linspace(0.0, 1.0, POINTS_OF_BEAM)
    segment = np.repeat(np.asarray(shaft.layout.segments), np.asarray(shaft.layout.cuts))
    parts = []
    for element, index in enumerate(segment):
        length = heights[element + 1] - heights[element]
        if body is not None and element == shaft.layout.gear_nodes[0]:
            beam = shaft.body_beam(body.piece)
        else:
            beam = _beam_of_segment(shaft, shaft.segments[index], length)
        ends = motion[6 * element : 6 * element + 12]
        shape = jax.vmap(lambda at, beam=beam: beam_shapes(beam, at)[:2])(fraction) @ ends
        parts.append(jnp.stack([heights[element] + fraction * length, *shape.T]))
    line = jnp.concatenate(parts, axis=1)
    return line.at[0].add(-shaft.gear_at)


def _beam_of_segment(shaft: Shaft, segment: Segment, length: Array) -> Beam:
    """A stretch of a segment between two nodes."""
    outer, inner, shear = segment.outer, segment.inner, shaft.shear_coefficient
    if shear is None:
        shear = cowper_coefficient(outer, inner, shaft.material.poisson)
    return Beam(length, outer, inner, shear, shaft.material)
