"""What is written of condensed bodies in mesh: data of their pictures, and grids for ParaView."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr

from fem_prep import write_vtu
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._units import deg, mm, um
from jaxgear.plot._plots import hybrid_pictures
from jaxgear.plot._tables import Columns, _cycle_periods
from jaxgear.study._hybrid import DIRECTIONS, BodyAnswer, BodyField, along_radius
from jaxgear.study._hybrid_dataset import HolePlaces, hole_places

# Phases shown side by side.
_SHOWN = 6


def contact_line_loads_columns(dataset: xr.Dataset) -> Columns:
    """The data of `contact_line_loads`, one row per slice of every line that is drawn."""
    chosen = _phases_shown(dataset)
    lines, load = _loaded_lines(dataset, chosen), dataset["line_load_N_mm"].values
    phase, line, slices = np.meshgrid(
        chosen, lines, np.arange(dataset.sizes["slice"]), indexing="ij"
    )
    at = phase.ravel(), line.ravel(), slices.ravel()
    return {
        "phase": dataset["phase"].values[at[0]],
        "line": dataset["line"].values[at[1]],
        "face_position_mm": dataset["face_position_mm"].values[at[2]],
        "line_load_N_mm": load[at],
    }


def _phases_shown(dataset: xr.Dataset) -> np.ndarray:
    """Phases in equal steps through the mesh period of the largest load, which is among them."""
    load = dataset["line_load_N_mm"].values.max(axis=(1, 2))
    each = len(load) // _cycle_periods(dataset["phase"].values)
    worst = int(np.argmax(load))
    steps = np.rint(np.arange(_SHOWN) * each / _SHOWN).astype(int)
    return np.sort(each * (worst // each) + (worst % each + steps) % each)


def _loaded_lines(dataset: xr.Dataset, phases: np.ndarray) -> np.ndarray:
    """Lines that carry load at some of the phases, the latest to enter first."""
    load = dataset["line_load_N_mm"].values[phases].max(axis=(0, 2))
    return np.flatnonzero(load > 0.0)


def tooth_way_columns(dataset: xr.Dataset) -> Columns:
    """The data of `tooth_way`, one row per place."""
    shape = dataset["way_line_load_N_mm"].shape
    passage, share = (
        np.broadcast_to(dataset[name].values[:, None], shape).ravel()
        for name in ("way_passage", "way_share")
    )
    face = np.broadcast_to(dataset["face_position_mm"].values, shape).ravel()
    return {
        "passage": passage,
        "share_of_mesh_force": share,
        "face_position_mm": face,
        "line_load_N_mm": dataset["way_line_load_N_mm"].values.ravel(),
        "pressure_MPa": dataset["way_pressure_MPa"].values.ravel(),
    }


def tooth_loads_columns(dataset: xr.Dataset, gear: str, holes: HolePlaces | None) -> Columns:
    """The data of `tooth_loads`, a row for each tooth in the order of its place."""
    angle = dataset[f"{gear}_tooth_angle_deg"].values
    order = np.argsort(angle, kind="stable")
    above = np.zeros(len(angle), bool) if holes is None else holes.above(angle * deg)
    return {
        "tooth_pair": dataset["tooth_pair"].values[order],
        "tooth_angle_deg": angle[order],
        "line_load_max_N_mm": dataset["tooth_line_load_N_mm"].values[order],
        "share_max": dataset["tooth_share"].values[order],
        "load_over_mean": dataset["tooth_load_over_mean"].values[order],
        "above_a_hole": above[order].astype(int),
    }


def deflected_body_columns(answer: BodyAnswer, shown: BodyField) -> Columns:
    """The data of `deflected_body`: a row for every node of the rim; the whole is in the VTU."""
    places = answer.built.body.rim_nodes
    towards = (0.0 if answer.gear == "pinion" else np.pi) - shown.turn
    angle = np.arctan2(places[:, 1], places[:, 0]) - towards
    parts = along_radius(places, shown.rim) / um
    # From just below half a turn back: the cut must not run through a line of nodes.
    around = np.mod(angle + np.pi + 1e-9, 2.0 * np.pi) - np.pi - 1e-9
    return {
        "angle_deg": around / deg,
        "Z_mm": places[:, 2] / mm,
        **{f"{name}_um": parts[:, i] for i, name in enumerate(DIRECTIONS)},
    }


def _largest_across(dataset: xr.Dataset) -> np.ndarray:
    """Largest line load on each slice, of all lines and phases [N/mm]."""
    return dataset["line_load_N_mm"].values.max(axis=(0, 1))


def draw(folder: Folder, title: str, dataset: xr.Dataset, answers: Sequence[BodyAnswer]) -> None:
    """The pictures that a run with condensed bodies adds, and the deflected grids for ParaView.

    **Arguments:**

    - `folder`: where to.
    - `title`: the case.
    - `dataset`: from `hybrid_variables`.
    - `answers`: from `body_answers`.
    """
    figure = partial(hybrid_pictures.contact_line_loads, dataset, title)
    save(figure, contact_line_loads_columns(dataset), folder, "contact_lines")
    save(
        partial(hybrid_pictures.tooth_way, dataset, title),
        tooth_way_columns(dataset),
        folder,
        "tooth_way",
    )
    for answer in answers:
        gear, fields = answer.gear, {}
        if "tooth_line_load_N_mm" in dataset:
            holes = hole_places(answer.built)
            figure = partial(hybrid_pictures.tooth_loads, dataset, gear, holes, title)
            columns = tooth_loads_columns(dataset, gear, holes)
            save(figure, columns, folder, f"{gear}_tooth_loads")
        for shown in answer.fields:
            figure = partial(hybrid_pictures.deflected_body, answer, shown, title)
            columns = deflected_body_columns(answer, shown)
            save(figure, columns, folder, f"{gear}_under_{shown.what}")
            fields[f"displacement under {shown.words} [m]"] = shown.field
        if fields:
            write_vtu(folder / f"{gear}_deflected.vtu", answer.grid, fields)
