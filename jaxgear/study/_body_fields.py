"""Surfaces of condensed bodies under the loads of their teeth: as datasets, and for ParaView."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from fem_prep import surface, write_vtu
from jaxgear._units import deg, mm, um
from jaxgear.study._body_answers import BodyAnswer
from jaxgear.study._body_surfaces import FACE
from jaxgear.study._hybrid import DIRECTIONS, along_radius
from jaxgear.study._results import Entry, dataset_of, entries_over


def fields_dataset(answer: BodyAnswer) -> xr.Dataset:
    """How the surface of a body with a grid and its rim are displaced, by what loads them.

    A dataset over cause, nodes of the surface and nodes of the rim; displacements are against the
    gear's seat. Angles are from the mesh about Z.
    """
    grid, fields = answer.grid, answer.fields
    nodes, corners = np.unique(surface(grid), return_inverse=True)
    places = answer.built.body.rim_nodes
    towards = (0.0 if answer.gear == "pinion" else np.pi) - fields[0].turn
    angle = np.arctan2(places[:, 1], places[:, 0]) - towards
    # From just below half a turn back: the cut must not run through a line of nodes.
    around = np.mod(angle + np.pi + 1e-9, 2.0 * np.pi) - np.pi - 1e-9
    parts = np.stack([along_radius(places, each.rim) for each in fields]) / um
    moved = np.stack([each.field[nodes] for each in fields]) / um
    # Nodes inside may move further than those of the surface.
    largest = [each.largest / um for each in fields]
    on_rim = {
        f"{name}_um": (parts[..., i], "um", f"{name} displacement of the rim")
        for i, name in enumerate(DIRECTIONS)
    }
    places_of_rim = {
        "angle_deg": (around / deg, "deg", "place on the rim, from the mesh about Z"),
        "Z_mm": (places[:, 2] / mm, "mm", "place along Z from mid-face"),
    }
    against = "displacement against the gear's seat"
    return dataset_of(
        {
            "place_mm": Entry(("node", "axis"), grid.nodes[nodes] / mm, "mm", "place of a node"),
            "face": Entry(("face", "corner"), corners.reshape(-1, 8), "1", FACE),
            "displacement_um": Entry(("cause", "node", "axis"), moved, "um", against),
            "largest_um": Entry(("cause",), largest, "um", "largest displacement of any node"),
            "mesh_angle_deg": Entry((), towards / deg, "deg", "where the mesh is, about Z from x"),
            **entries_over(("rim",), places_of_rim),
            **entries_over(("cause", "rim"), on_rim),
        },
        cause=Entry(("cause",), [each.what for each in fields], "1", "what loads the body"),
        under=Entry(("cause",), [each.words for each in fields], "1", "what that is in words"),
        axis=Entry(("axis",), list("xyz"), "1", "direction on the body"),
    ).assign_attrs(gear=answer.gear)


def grid_writer(answer: BodyAnswer) -> Callable[[Path], None]:
    """A function that writes the whole grid with its displacements to a path, for ParaView."""
    fields = {f"displacement under {each.words} [m]": each.field for each in answer.fields}
    return lambda path: write_vtu(path, answer.grid, fields)
