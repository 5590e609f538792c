"""The accessory pair's tip relief beside errors of its profiles, at rest and in motion."""

import functools
from dataclasses import replace

import numpy as np

import jaxgear as jg
from jaxgear import grid_of, load_sharing, model_of

from .damped import DAMPINGS
from .drawn_errors import PLACES, profile_error
from .finding import Finding
from .motion import Curve, moving, set_going, sweep
from .statics import Solved, scene_of, solved_model, um

# Of the relief on both gears.
DEPTH, EXTENT = 15.0 * um, 0.25
# Of the profile errors, from valley to peak: ISO grades 5/6 and 7.
ERRORS = {"8 um": 8.0 * um, "13 um": 13.0 * um}
# Several are drawn.
SEEDS = tuple(range(6))


def flanks(order: int | None, peak_to_peak: float = 0.0, seed: int = 0) -> jg.Flanks:
    """Flanks with a relief on both gears and an error of the pinion's profile.

    **Arguments:**

    - `order`: 1: linear relief, 2: parabolic, `None`: none.
    - `peak_to_peak`: of the error [m].
    - `seed`: of the error.
    """
    relief = jg.TipRelief(0.0 if order is None else DEPTH, EXTENT, order or 1)
    error = jg.MeasuredProfile(PLACES, profile_error(peak_to_peak, seed))
    return jg.Flanks(jg.Superposed((relief, error)), relief)


@functools.cache
def _pair(name: str):
    scene = scene_of(name)
    model = model_of(scene)
    return model, grid_of(scene, model)


def _with(name: str, own: jg.Flanks) -> Solved:
    model, grid = _pair(name)
    return solved_model(replace(model, flanks=own), grid)


# Of a base pitch: over so much of its way the rise of a load is looked at.
_WINDOW = 1.0 / 16.0


def steepest(each: Solved) -> float:
    """Largest change of a tooth pair's load over a sixteenth of a base pitch, over all load [-]."""
    pitch = float(each.model.pair.transverse_base_pitch)
    place = np.asarray(each.cycle.cells.lines.roll)[..., 0].ravel() / pitch
    share = np.asarray(load_sharing(each.cycle)).ravel()
    order = np.argsort(place)
    at = np.arange(place.min() - _WINDOW, place.max() + _WINDOW, _WINDOW / 16.0)
    way = np.interp(at, place[order], share[order], left=0.0, right=0.0)
    return float(np.abs(way[16:] - way[:-16]).max())


def loads() -> Finding:
    """Fig. IV-3, IV-7, IV-10 and IV-11: the load on its way, by relief and error."""
    found = Finding(
        "Load of a tooth pair on its way, flexible wheel (Fig. IV-3, IV-7, IV-10, IV-11)",
        "relief on the Master Curve, 15 um over 0.25, smooths the load; errors of 13 um nearly "
        "cancel that, those of 8 um do not; parabolic relief changes almost nothing at rest",
        ["flanks", "steepest", "RMS um", "largest N/mm"],
    )
    cases = {"plain": (None, 0.0), "linear": (1, 0.0), "parabolic": (2, 0.0)}
    cases |= {
        f"{shape}, {size}": (order, error)
        for shape, order in (("linear", 1), ("parabolic", 2))
        for size, error in ERRORS.items()
    }
    mean = {}
    for label, (order, error) in cases.items():
        seeds = SEEDS if error else SEEDS[:1]
        each = [_with("accessory-h1", flanks(order, error, seed)) for seed in seeds]
        mean[label] = np.mean([[steepest(x), x.rms, x.crest.max()] for x in each], axis=0)
        found.rows.append([label, *map(float, mean[label])])
    steep = {label: float(values[0]) for label, values in mean.items()}
    lost = lambda size: (
        (steep[f"linear, {size}"] - steep["linear"]) / (steep["plain"] - steep["linear"])
    )
    found.holds = {
        "relief makes the load's rise less steep by a third or more": steep["linear"]
        < steep["plain"] / 1.5,
        "the larger error is the steeper": steep["linear, 13 um"] > steep["linear, 8 um"],
        "errors of 8 um cost less than half of what relief gained": lost("8 um") < 0.5,
        "errors of 13 um cost more than half of it": lost("13 um") > 0.5,
        "with errors parabolic relief changes RMS and steepness by less than a quarter": all(
            abs(mean[f"parabolic, {size}"][i] / mean[f"linear, {size}"][i] - 1.0) < 0.25
            for size in ERRORS
            for i in (0, 1)
        ),
    }
    return found


SPEEDS = np.arange(200.0, 2001.0, 50.0)


def _response(damping: str, own: jg.Flanks) -> Curve:
    """The pair with a flexible wheel in motion, with flanks of its own."""
    base = moving("accessory-h1", *DAMPINGS[damping])
    return sweep(set_going(base.scene, replace(base.model, flanks=own)).system, SPEEDS)[0]


def in_motion() -> Finding:
    """Fig. IV-4 and IV-8: the dynamic ratio by relief and error, with either damping."""
    found = Finding(
        "Dynamic ratio by relief and error, flexible wheel (Fig. IV-4, IV-8)",
        "relief on the Master Curve lowers the dynamic ratio from 0 to 2000 rad/s with either "
        "damping; errors cancel that, the largest error is the worst",
        ["damping", "flanks", "largest", "mean", "not found"],
    )
    cases = {"plain": (None, 0.0, 0), "relief": (1, 0.0, 0)}
    cases |= {
        f"relief, {size}, {seed}": (1, error, seed)
        for size, error in ERRORS.items()
        for seed in SEEDS[:3]
    }
    means: dict[tuple[str, str], list[float]] = {}
    largest: dict[tuple[str, str], list[float]] = {}
    for damping in DAMPINGS:
        for label, case in cases.items():
            ratio = _response(damping, flanks(*case)).ratio
            kind = damping, label.rpartition(",")[0] or label
            means.setdefault(kind, []).append(float(np.nanmean(ratio)))
            largest.setdefault(kind, []).append(float(np.nanmax(ratio)))
            missed = int(np.isnan(ratio).sum())
            found.rows.append([damping, label, largest[kind][-1], means[kind][-1], missed])
    mean = {kind: float(np.mean(values)) for kind, values in means.items()}
    top = {kind: float(np.mean(values)) for kind, values in largest.items()}
    for damping in DAMPINGS:
        plain, relief, small, large = (
            mean[damping, x] for x in ("plain", "relief", "relief, 8 um", "relief, 13 um")
        )
        found.holds |= {
            f"{damping}: relief lowers the largest ratio": top[damping, "relief"]
            < top[damping, "plain"],
            f"{damping}: relief lowers the mean over speed": relief < plain,
            f"{damping}: errors cost some of that, larger ones more": relief < small < large,
            f"{damping}: errors of 13 um cost all of it": large >= plain,
        }
    return found
