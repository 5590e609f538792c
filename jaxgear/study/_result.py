"""What a study found, as values: datasets, a summary, and files that no dataset can hold."""

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from jaxgear.scene._scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Summary = dict[str, Any]
Datasets = Mapping[str, xr.Dataset]


@dataclasses.dataclass(frozen=True)
class Result:
    """What a study of a scene found.

    **Fields:**

    - `scene`: that was studied, with the bodies that were condensed for it.
    - `summary`: numbers and words by name, units included; `notes` among them.
    - `datasets`: what was computed, by group; the empty name is the first. Each variable has its
        `units` and its `long_name`; pictures and their tables are made of nothing else.
    - `files`: what no dataset can hold: functions that write one to a path, by name.
    - `scenes`: that were improved: by name of their files, the keys that are others, and these.
    """

    scene: Scene
    summary: Summary
    datasets: Datasets = dataclasses.field(default_factory=dict)
    files: Mapping[str, Callable[[Path], None]] = dataclasses.field(default_factory=dict)
    scenes: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)

    @property
    def dataset(self) -> xr.Dataset:
        """The first dataset: that of the mesh cycle, or of the only group."""
        return self.datasets[""] if "" in self.datasets else next(iter(self.datasets.values()))

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks that a reader of the numbers should not miss, the worst first."""
        return tuple(self.summary.get("notes", ()))

    def plot(self) -> dict[str, "Figure"]:
        """Draw all pictures: figures by name."""
        # Pictures are made of datasets and know no study, so a study asks for them by name.
        atlas = importlib.import_module("jaxgear.plot")
        return {each.name: each.draw() for each in atlas.pictures(self.datasets)}


def titled(dataset: xr.Dataset, title: str) -> xr.Dataset:
    """The dataset with the title that its pictures are headed by, in its attributes."""
    return dataset.assign_attrs(title=title)


def together(first: Result, second: Result) -> Result:
    """Two results of one scene, that of the first, as one; remarks stay in their order."""
    summary = {**first.summary, **second.summary, "notes": [*first.notes, *second.notes]}
    joined = [
        {**getattr(first, name), **getattr(second, name)}
        for name in ("datasets", "files", "scenes")
    ]
    return Result(first.scene, summary, *joined)
