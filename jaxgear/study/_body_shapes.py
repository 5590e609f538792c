"""Operating shapes of condensed bodies: their surfaces as datasets, and files for ParaView."""

import json
from pathlib import Path
from types import MappingProxyType

import numpy as np
import xarray as xr

import fem_prep
from jaxgear._response._wave_words import wave_words
from jaxgear._response._waves import DIRECTIONS
from jaxgear._units import mm, um
from jaxgear._whole_file import write_text
from jaxgear.study._body_surfaces import FACE
from jaxgear.study._body_waves import MainWave
from jaxgear.study._moving_body import MovingBody
from jaxgear.study._results import Entry, dataset_of, entries_over

# Files for ParaView in one period.
_STATES = 12


def shape_dataset(body: MovingBody, shape: np.ndarray, main: MainWave) -> xr.Dataset:
    """One order of a body's surface: how it moves against the gear's seat.

    Over the nodes of the surface, or of the rim if no more is known; of the complex displacement of
    all nodes, shape `[node, 3]` [m].
    """
    faces = fem_prep.surface(_grid(body)) if body.has_grid else body.built.body.rim_faces
    nodes, corners = np.unique(faces, return_inverse=True)
    moved = shape[nodes] / um
    rows = {
        "place_mm": (body.nodes[nodes] / mm, "mm", "place of a node"),
        "real_um": (np.real(moved), "um", "displacement at the begin of a period"),
        "imaginary_um": (np.imag(moved), "um", "displacement three quarters of a period later"),
    }
    return dataset_of(
        {
            "axis": Entry(("axis",), list("xyz"), "1", "direction on the body"),
            "face": Entry(("face", "corner"), corners.reshape(faces.shape), "1", FACE),
            **entries_over(("node", "axis"), rows),
        }
    ).assign_attrs(
        order=main.order,
        wave=wave_words(main.diameters),
        component=DIRECTIONS[int(np.argmax(main.amplitude))],
        radius_mm=body.radius / mm,
    )


def _grid(body: MovingBody) -> fem_prep.Grid:
    return fem_prep.Grid(body.built.body.nodes, body.built.body.bricks, MappingProxyType({}))


def write_shapes(path: Path, body: MovingBody, shape: np.ndarray) -> None:
    """Write one order of a body over one of its periods, as a series of files for ParaView.

    The file that ParaView opens is `path`, in a folder of its own, with the ending .vtu.series;
    of the complex displacement of all nodes, shape `[node, 3]` [m].
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    files = []
    for step in range(_STATES):
        moved = np.real(shape * np.exp(2j * np.pi * step / _STATES))
        name = f"{path.name.removesuffix('.vtu.series')}_{step:02d}.vtu"
        fem_prep.write_vtu(path.with_name(name), _grid(body), {"displacement [m]": moved})
        files.append({"name": name, "time": step / _STATES})
    write_text(json.dumps({"file-series-version": "1.0", "files": files}, indent=2) + "\n", path)
