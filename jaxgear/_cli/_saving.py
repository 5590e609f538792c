"""Pictures and their data on their way into the results folder."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jaxgear._cli._folder import Folder
from jaxgear._whole_file import write_csv
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
        # Matplotlib costs half a second.
        from jaxgear.plot._style import write_picture

        say(f"drawing {name}")
        write_picture(draw, folder / f"{name}.png", folder / f"{name}.svg")
