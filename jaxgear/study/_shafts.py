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
from jaxgear.study._results import Entry, dataset_of

# Points on each element of a deflected line.
POINTS_OF_BEAM = 9


def shafts_dataset(
    model: PairModel,
    cycle: MeshCycle,
    bearings: list[dict[str, Any]],
    sections: Mapping[str, np.ndarray],
) -> xr.Dataset:
    """Both shafts in the plane of the axes: Z from mid-face.

    **Arguments:**

    - `model`: with at least one shaft.
    - `cycle`: its settled states, of which the mean is shown.
    - `bearings`: `static.bearings` of the summary.
    - `sections`: of condensed bodies, by gear: radius and Z around each element in the cut, shape
        `[element, point, 2]` [m].

    **Returns:**

    A dataset over points of the deflected lines, segments, bearings, further loads and elements of
    sections, each with its gear.
    """
    mounts = dict(zip(GEARS, (model.pinion_support, model.wheel_support), strict=True))
    shafts = {gear: mount for gear, mount in mounts.items() if isinstance(mount, Shaft)}
    bodies: dict[str, Any] = dict(zip(GEARS, model.bodies, strict=True))
    return dataset_of(
        _lines(deflected_lines(model, cycle))
        | _segments(shafts)
        | _bearings(shafts, bearings)
        | _loads(model, shafts)
        | _sections(sections)
        | {
            "seats_only": Entry(
                ("mount",),
                [isinstance(bodies[gear], FlexibleBody) for gear in shafts],
                "1",
                "whether points are seats of a condensed body, and no line",
            )
        },
        mount=Entry(("mount",), list(shafts), "1", "gear that is on a shaft"),
        axis=Entry(("axis",), list("STZ"), "1", "axis: S pinion to wheel, T = Z x S, Z axial"),
    )


def _lines(lines: Mapping[str, np.ndarray]) -> dict[str, Entry]:
    gears = np.concatenate([np.full(line.shape[1], gear) for gear, line in lines.items()])
    z, along_s, along_t = np.concatenate(list(lines.values()), axis=1)
    at = ("point",)
    return {
        "gear": Entry(at, gears, "1", "gear of the shaft"),
        "Z_mm": Entry(at, z / mm, "mm", "place along Z from mid-face"),
        "deflection_S_um": Entry(at, along_s / um, "um", "mean deflection along S"),
        "deflection_T_um": Entry(at, along_t / um, "um", "mean deflection along T"),
    }


def _segments(shafts: Mapping[str, Shaft]) -> dict[str, Entry]:
    rows = []
    for gear, shaft in shafts.items():
        start = height(shaft, 0.0)
        for each in shaft.segments:
            length, outer, inner = (float(x) / mm for x in (each.length, each.outer, each.inner))
            rows.append((gear, start, length, outer, inner))
            start += length
    gears, *numbers = zip(*rows, strict=True)
    names = {
        "start_Z": "start of the segment along Z",
        "length": "length of the segment",
        "outer": "outer diameter of the segment",
        "inner": "bore of the segment",
    }
    return {"segment_gear": Entry(("segment",), list(gears), "1", "gear of the shaft")} | {
        f"segment_{name}_mm": Entry(("segment",), np.asarray(values), "mm", words)
        for (name, words), values in zip(names.items(), numbers, strict=True)
    }


def _bearings(shafts: Mapping[str, Shaft], rows: list[dict[str, Any]]) -> dict[str, Entry]:
    springs = [shafts[each["gear"]].bearings[each["index"]] for each in rows]
    places = [
        height(shafts[each["gear"]], spring.at) for each, spring in zip(rows, springs, strict=True)
    ]
    load = np.asarray([[each["load_N"][axis] for axis in "STZ"] for each in rows]).reshape(-1, 3)
    at = ("bearing",)
    stiffness = np.asarray([float(spring.axial) for spring in springs])
    return {
        "bearing_gear": Entry(at, [each["gear"] for each in rows], "1", "gear of the shaft"),
        "bearing_index": Entry(at, [each["index"] for each in rows], "1", "bearing of the shaft"),
        "bearing_Z_mm": Entry(at, places, "mm", "place along Z from mid-face"),
        "bearing_axial_N_m": Entry(at, stiffness, "N/m", "stiffness along Z"),
        **{
            f"bearing_load_{axis}_N": Entry(
                at, load[:, i], "N", f"mean load of the shaft on the bearing along {axis}"
            )
            for i, axis in enumerate("STZ")
        },
    }


def _loads(model: PairModel, shafts: Mapping[str, Shaft]) -> dict[str, Entry]:
    """The torque about Z, and what else loads a shaft from outside."""
    at = [
        height(shaft, shaft.gear_at if shaft.torque_at is None else shaft.torque_at)
        for shaft in shafts.values()
    ]
    extra = [(gear, shaft, load) for gear, shaft in shafts.items() for load in shaft.loads]
    vector = lambda of: np.asarray([np.asarray(of(load)) for *_, load in extra]).reshape(-1, 3)
    return {
        "torque_Nm": Entry(
            ("mount",), [torque_on(model, gear) for gear in shafts], "N m", "torque about Z"
        ),
        "torque_Z_mm": Entry(("mount",), at, "mm", "where the torque enters, from mid-face"),
        "load_gear": Entry(("load",), [str(gear) for gear, *_ in extra], "1", "gear of the shaft"),
        "load_Z_mm": Entry(
            ("load",), [height(shaft, load.at) for _, shaft, load in extra], "mm", "place along Z"
        ),
        "load_force_N": Entry(("load", "axis"), vector(lambda x: x.force), "N", "force on a shaft"),
        "load_moment_Nm": Entry(
            ("load", "axis"), vector(lambda x: x.moment), "N m", "moment on a shaft"
        ),
    }


def _sections(sections: Mapping[str, np.ndarray]) -> dict[str, Entry]:
    if not sections:
        return {}
    gears = np.concatenate([np.full(len(each), gear) for gear, each in sections.items()])
    r, z = np.moveaxis(np.concatenate(list(sections.values())), 2, 0) / mm
    at = ("element", "corner")
    return {
        "section_gear": Entry(("element",), gears, "1", "gear whose body is cut"),
        "section_r_mm": Entry(at, r, "mm", "radius of a corner of an element in the cut"),
        "section_Z_mm": Entry(at, z, "mm", "its place along Z from mid-face"),
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


def deflected_lines(model: PairModel, cycle: MeshCycle) -> dict[str, np.ndarray]:
    """Place along Z and mean deflection along S and T of each shaft's axis [m], by gear."""
    return {name: np.asarray(line) for name, line in called(_lines_of_shafts, model, cycle).items()}


def _lines_of_shafts(model: PairModel, cycle: MeshCycle) -> dict[str, Array]:
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
