"""All chunks of a study together: the table, its quantiles, and its best designs."""

import dataclasses
import importlib
import os
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from jaxgear._checks import InputError
from jaxgear._columns import Table
from jaxgear.designs._datasets import columns_of, together
from jaxgear.designs._statistics import effects_dataset, quantiles_dataset
from jaxgear.designs._table import DesignTable
from jaxgear.designs._work import Job, Status, job_of, status_of
from jaxgear.scene._scene import Scene
from jaxgear.study._head import names_of
from jaxgear.study._result import Datasets, Summary, titled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Reasons that a summary tells.
_TOLD = 5


@dataclasses.dataclass(frozen=True)
class Collected:
    """The results of a study.

    **Fields:**

    - `scene`: that it is about.
    - `datasets`: `designs`, of which `effects` and `quantiles` are made.
    - `status`: how much of it is there.
    - `summary`: counts, quantiles and best designs.
    - `best`: keys of the best designs and their values, the best first.
    """

    scene: Scene
    datasets: Datasets
    status: Status
    summary: Summary
    best: tuple[dict[str, Any], ...]

    @property
    def designs(self) -> xr.Dataset:
        """All designs: a variable for each column, `gradient`, arrays, `reason` of a failure."""
        return self.datasets["designs"]

    @property
    def table(self) -> Table:
        """Columns by name, units included: keys, numbers, derivatives, reason."""
        return columns_of(self.designs)

    def plot(self) -> dict[str, "Figure"]:
        """Draw all pictures: figures by name."""
        atlas = importlib.import_module("jaxgear.plot")
        return {each.name: each.draw() for each in atlas.pictures(self.datasets)}


def collect(
    path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None
) -> Collected:
    """Collect the results of a study that are there, computing nothing.

    **Arguments:**

    - `path`, `folder`: as of `run`.

    **Returns:**

    What is there; its `status` says how much is missing.

    **Raises:**

    - `InputError` if nothing is there.
    - `SceneError` as of `run`.
    """
    return collected(job_of(path, folder))


def collected(job: Job) -> Collected:
    """Collect what is there of a study."""
    there = [file for chunk in job.chunks if (file := job.file(chunk)).exists()]
    if not there:
        raise InputError(
            f"{job.folder}: no chunk of the study is finished, so there is nothing to collect. "
            f"Compute it first: jaxgear study {job.study.path}."
        )
    asked, scene, status = job.study.asked, job.study.scene, status_of(job)
    minimise = asked.keep.minimise or asked.keep.numbers[:1]
    designs = titled(together(there), f"{job.study.name}, {status.done_designs} designs")
    good = np.flatnonzero(designs["reason"].values == "")
    known = good[np.isfinite(designs[minimise[0]].values[good])]
    order = known[np.argsort(designs[minimise[0]].values[known], kind="stable")]
    scattered = bool(asked.design.scatter or asked.design.even)
    # Of gears that scatter none can be chosen.
    count = 0 if scattered and not asked.design.between else asked.keep.best
    best = designs["design"].values[order[:count]].tolist()
    reasons = Counter(x for x in designs["reason"].values.tolist() if x)
    names = names_of(job.study.name, scene.cite)
    designs = designs.assign_attrs(
        minimise=minimise,
        study=job.study.path.read_text(encoding="utf-8"),
        scene=scene.path.read_text(encoding="utf-8"),
        scene_set=list(asked.set),
        seed=asked.design.seed,
        versions=[f"{name} {version}" for name, version in names["versions"].items()],
        scattered=int(scattered),
    )
    summary: dict[str, Any] = names | {
        "study": {
            "scene": scene.name,
            "command": asked.command,
            "designs": status.designs,
            "computed": status.done_designs,
            "failed": sum(reasons.values()),
            "reasons": dict(reasons.most_common(_TOLD)),
            "seed": asked.design.seed,
            "best": [_row(designs, design, asked.keep.numbers, job.table) for design in best],
        },
        "notes": _notes(status, reasons) + _lacking(designs.isel(design=good), asked.keep.numbers),
    }
    datasets = {"designs": designs}
    solved, title = designs.isel(design=good), designs.attrs["title"]
    keys = [key for key in job.table.keys if designs[key].dtype.kind in "if"]
    if len(good) and (effects := effects_dataset(solved, keys, asked.keep.numbers)) is not None:
        datasets["effects"] = titled(effects, title)
    if scattered and len(good):
        datasets["quantiles"] = titled(quantiles_dataset(solved, asked.keep.numbers), title)
        summary["study"]["quantiles"] = _quantiles(datasets["quantiles"])
    return Collected(scene, datasets, status, summary, tuple(map(job.table.at, best)))


def _quantiles(found: xr.Dataset) -> Summary:
    """Quantiles of each number by their shares, each with its bounds."""
    return {
        name: {
            "mean": float(own["mean"]),
            "deviation": float(own["deviation"]),
            **{
                f"{100.0 * share:g} %": [float(at[x]) for x in ("value", "low", "high")]
                for share in found["share"].values.tolist()
                for at in [own.sel(share=share)]
            },
        }
        for name in found["number"].values.tolist()
        for own in [found.sel(number=name)]
    }


def _row(designs: xr.Dataset, design: int, names: list[str], table: DesignTable) -> Summary:
    own = designs.sel(design=design)
    numbers = {name: float(own[name]) for name in names}
    known = {name: x if np.isfinite(x) else None for name, x in numbers.items()}
    return {"design": design, **table.at(design), **known}


def _lacking(solved: xr.Dataset, names: list[str]) -> list[str]:
    """Numbers that designs with results lack."""
    every, found = solved.sizes["design"], []
    for name in names:
        known = np.isfinite(solved[name].values)
        if lacking := every - int(known.sum()):
            which = "All" if lacking == every else f"{lacking} of {every}"
            found.append(f"{which} designs have no {name}, or none that is finite: empty places.")
        # Of a number that is there.
        if "gradient" in solved:
            slopes = solved["gradient"].sel(number=name).values
            if lacking := int((np.isnan(slopes).any(axis=1) & known).sum()):
                found.append(f"{lacking} of {every} designs lack a derivative of {name}.")
    return found


def _notes(status: Status, reasons: Counter[str]) -> list[str]:
    found = []
    if missing := status.designs - status.done_designs:
        found.append(
            f"{missing} of {status.designs} designs are not computed yet, and not in the table."
        )
    if reasons:
        first, count = reasons.most_common(1)[0]
        found.append(
            f"{sum(reasons.values())} of {status.done_designs} designs have no results, {count} of "
            f"them since: {first}"
        )
    return found
