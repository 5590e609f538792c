"""Pictures and their data on their way into the results folder."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jaxgear import plot
from jaxgear._cli._folder import Folder
from jaxgear._system._model import PairModel
from jaxgear._whole_file import write_csv
from jaxgear.plot._plots import style
from jaxgear.study._pair_dataset import modification_dataset
from jaxgear.study._progress import say


def save(
    draw: Callable[[], Any],
    columns: Mapping[str, np.ndarray],
    folder: Folder,
    name: str,
    **beside: Mapping[str, np.ndarray],
) -> None:
    """Write a picture's data, and the picture where pictures are wanted.

    **Arguments:**

    - `draw`: returns the figure; called only for a picture.
    - `columns`: its data, under names with units: one table.
    - `folder`: where to.
    - `name`: of the files, without ending: NAME.csv, NAME.png and NAME.svg.
    - `beside`: more of its data, whose rows are other records: NAME_KEY.csv for each KEY.
    """
    write_csv(columns, folder / f"{name}.csv")
    for key, others in beside.items():
        write_csv(others, folder / f"{name}_{key}.csv")
    if folder.pictures:
        say(f"drawing {name}")
        style.write_picture(draw, folder / f"{name}.png", folder / f"{name}.svg")


def draw_modification(models: Mapping[str, PairModel], title: str, folder: Folder) -> None:
    """Draw the traces of the flanks of several models, until a search returns them as a dataset."""
    traces = modification_dataset(models).assign_attrs(title=title)
    for each in plot.pictures({"modification": traces}):
        save(each.draw, each.table, folder, each.name)
