"""All chunks of a study together: the table, its quantiles, and its best designs."""

import dataclasses
import importlib
import importlib.metadata
import os
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from jaxgear._checks import InputError
from jaxgear.designs._datasets import columns_of, together
from jaxgear.designs._table import DesignTable
from jaxgear.designs._work import Job, Status, job_of, status_of
from jaxgear.scene._scene import Scene
from jaxgear.study._head import names_of
from jaxgear.study._result import Summary, titled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Shares of designs that stay below a quantile, and how sure its bounds are.
SHARES, CONFIDENCE = (0.05, 0.5, 0.95, 0.99), 0.95
# Reasons that a summary tells.
_TOLD = 5


@dataclasses.dataclass(frozen=True)
class Collected:
    """The results of a study.

    **Fields:**

    - `scene`: that it is about.
    - `designs`: a variable for each column, `gradient`, arrays, and `reason` why a design has no
        results, over the coordinate `design`.
    - `status`: how much of it is there.
    - `summary`: counts, quantiles and best designs.
    - `best`: keys of the best designs and their values, the best first.
    """

    scene: Scene
    designs: xr.Dataset
    status: Status
    summary: Summary
    best: tuple[dict[str, Any], ...]

    @property
    def table(self) -> dict[str, np.ndarray]:
        """Columns by name, units included: keys, numbers, derivatives, reason."""
        return columns_of(self.designs)

    def plot(self) -> dict[str, "Figure"]:
        """Draw all pictures: figures by name."""
        atlas = importlib.import_module("jaxgear.plot")
        return {each.name: each.draw() for each in atlas.pictures({"designs": self.designs})}


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
    order = good[np.argsort(designs[minimise[0]].values[good], kind="stable")]
    scattered = bool(asked.design.scatter or asked.design.even)
    # Of gears that scatter none can be chosen.
    count = 0 if scattered and not asked.design.between else asked.keep.best
    best = designs["design"].values[order[:count]].tolist()
    reasons = Counter(x for x in designs["reason"].values.tolist() if x)
    designs = designs.assign_attrs(
        minimise=minimise,
        study=job.study.path.read_text(encoding="utf-8"),
        scene=scene.path.read_text(encoding="utf-8"),
        scene_set=list(asked.set),
        seed=asked.design.seed,
        jaxgear=importlib.metadata.version("jaxgear"),
        scattered=int(scattered),
    )
    summary = names_of(job.study.name, scene.cite) | {
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
        "notes": list(_notes(status, reasons)),
    }
    if scattered and len(good):
        summary["study"]["quantiles"] = {
            name: quantiles(designs[name].values[good]) for name in asked.keep.numbers
        }
    return Collected(scene, designs, status, summary, tuple(map(job.table.at, best)))


def _row(designs: xr.Dataset, design: int, names: list[str], table: DesignTable) -> Summary:
    own = designs.sel(design=design)
    return {"design": design, **table.at(design), **{name: float(own[name]) for name in names}}


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


def quantiles(values: np.ndarray) -> Summary:
    """Quantiles of a sample, and bounds between which they are with 95 % confidence.

    Bounds are order statistics whatever the distribution: the number of `n` independent values
    below the true quantile of share `p` is binomial (David and Nagaraja, Order Statistics, 3rd ed.,
    section 7.1). Values of Sobol's sequence scatter less, so for them bounds are wider than need be.
    NaN where the sample is too small to bound a quantile.

    **Arguments:**

    - `values`: of the sample, in any unit.

    **Returns:**

    Mean, standard deviation, and by name of each quantile its value and bounds.
    """
    from scipy.stats import binom

    ordered, count = np.sort(values), len(values)
    found: Summary = {"mean": float(ordered.mean()), "standard_deviation": float(ordered.std())}
    padded = np.concatenate([[np.nan], ordered, [np.nan]])
    for share in SHARES:
        # With r below and s at or above: P(x_r <= q < x_s) = P(r <= B <= s - 1).
        tail = 0.5 * (1.0 - CONFIDENCE)
        low = int(binom.ppf(tail, count, share))
        high = int(binom.ppf(1.0 - tail, count, share)) + 1
        found[f"share_{100 * share:g}_%"] = {
            "value": float(np.quantile(ordered, share)),
            "low": float(padded[low]),
            "high": float(padded[high]) if high <= count else float("nan"),
        }
    return found
