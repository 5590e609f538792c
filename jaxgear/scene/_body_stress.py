"""Rows that give stresses at points of a condensed body, kept beside it in the cache.

They are made for the points that are asked for only; of all others no artefact knows anything.
"""

import dataclasses
import hashlib
import zipfile

import numpy as np

from fem_prep import StressRows, stress_rows
from jaxgear._checks import require
from jaxgear.scene._body_build import BuiltBody
from jaxgear.scene._body_view import keep_beside, view_folder
from jaxgear.scene._body_words import in_keys


def stress_at(built: BuiltBody, nodes: np.ndarray) -> StressRows:
    """Stress at nodes of a body's grid from its coordinates, from the cache if it is there.

    **Raises:**

    - `ValueError` if the body came without a grid.
    """
    require(
        len(built.body.nodes) > 0,
        "{gear}.body: stresses need the grid of a condensed body, and of its matrices only rim and "
        "seats are known. Give the grid, or leave out gauges and mesh.body_stress.",
        gear=built.plan.gear,
    )
    digest = hashlib.sha256(np.asarray(nodes, dtype="<i8").tobytes()).hexdigest()[:16]
    name = f"{built.key}-stress-{digest}"
    found = _read(name, len(nodes), built.body.dofs)
    if found is None:
        with in_keys(built.plan.gear):
            found = stress_rows(built.held(), built.body, nodes)
        keep_beside(built.key, name, dataclasses.asdict(found))
    return found


def _read(name: str, count: int, dofs: int) -> StressRows | None:
    folder = view_folder()
    if folder is None:
        return None
    try:
        with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
            found = StressRows(**{each.name: file[each.name] for each in _FIELDS})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return found if found.rows.shape == (count, 6, dofs) else None


_FIELDS = dataclasses.fields(StressRows)
