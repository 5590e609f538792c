"""What a sweep shows of condensed bodies: waves, flanks and shapes as datasets, and a summary."""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from jaxgear._response._spectrum import Spectrum
from jaxgear._response._wave_words import wave_words
from jaxgear._response._waves import DIRECTIONS, BodyMotion
from jaxgear._units import deg, mm, um
from jaxgear.study._body_shapes import shape_dataset, write_shapes
from jaxgear.study._body_waves import Looked, MainWave, Seen, WaveWatch
from jaxgear.study._flank_dataset import flanks_dataset, largest_loads, loads_summary
from jaxgear.study._gauges import moving_gauges_dataset
from jaxgear.study._progress import say
from jaxgear.study._result import Summary, titled
from jaxgear.study._results import Entry, dataset_of, entries_over
from jaxgear.study._sweeping import Sweep

# Waves below this part of the largest are not written down.
_SMALL = 1e-4
_PLACE = ("direction", "speed")


class WavesSeen(NamedTuple):
    """What was seen of condensed bodies over a sweep.

    **Fields:**

    - `summary`: `sweep.waves` of the summary, a row for each body.
    - `datasets`: `waves`, `flanks` and, of each gear, `shape_GEAR`.
    - `files`: of bodies with a grid, for ParaView, with what writes each.
    """

    summary: list[Summary]
    datasets: dict[str, xr.Dataset]
    files: Mapping[str, Callable[[Path], None]]


def waves_seen(title: str, watch: WaveWatch, sweep: Sweep) -> WavesSeen:
    """What a sweep has shown of condensed bodies, as datasets under a title, and a summary."""
    peak = watch.peak[sweep.main]
    waves = waves_dataset(watch, sweep)
    datasets = {
        "waves": titled(waves, title),
        "flanks": titled(flanks_dataset(watch, watch.flanks(sweep.main)), title),
    }
    gauges = {gear: each.gauges for gear, each in watch.looked.items()}
    if any(gauges.values()):
        datasets["gauges_moving"] = titled(
            moving_gauges_dataset(gauges, peak.motions),
            f"{title}, pinion at {peak.speed:.5g} rad/s",
        )
    files, summary = {}, []
    for gear, each in watch.looked.items():
        main = each.main_wave(peak.motions[gear])
        say(f"{gear}: its shape at order {main.order:g}")
        shape = each.body.shape(peak.motions[gear], main.order)
        at_peak = f", pinion at {peak.speed:.5g} rad/s: {gear}"
        datasets[f"shape_{gear}"] = titled(shape_dataset(each.body, shape, main), title + at_peak)
        if each.body.has_grid:
            write = functools.partial(write_shapes, body=each.body, shape=shape)
            files[f"{gear}_shape/{gear}_shape.vtu.series"] = write
        summary.append(_body_summary(each, peak.motions[gear], main, waves))
    return WavesSeen(summary, datasets, files)


# --- Waves and probes


def waves_dataset(watch: WaveWatch, sweep: Sweep) -> xr.Dataset:
    """What was seen over a sweep, by its direction and speed, and all orders at its highest peak.

    Waves are signed: forward positive, backward negative, as seen from the body.
    """
    peak = watch.peak[sweep.main]
    seen = [[watch.seen[way][speed] for speed in sweep.speeds] for way in sweep.responses]
    entries: dict[str, Entry] = {
        "speed": Entry(("speed",), sweep.speeds, "rad/s", "speed of the pinion"),
        "component": Entry(("component",), list(DIRECTIONS), "1", "direction on the body"),
        "direction": Entry(("direction",), list(sweep.responses), "1", "of the sweep"),
    }
    for gear, each in watch.looked.items():
        entries |= _over_speeds(gear, each, seen)
        entries |= _at_peak(gear, each, peak.motions[gear], peak.probes[gear])
    entries |= largest_loads(seen)
    return dataset_of(entries).assign_attrs(
        peak_speed_rad_s=peak.speed,
        peak_direction=sweep.main,
        **{f"teeth_{gear}": each.body.teeth for gear, each in watch.looked.items()},
    )


def _over_speeds(gear: str, each: Looked, seen: list[list[Seen]]) -> Mapping[str, Entry]:
    number, above = np.arange(-each.most, each.most + 1), "orders above half the number of teeth"
    waves = np.asarray([[x.waves[gear] for x in own] for own in seen]) / um
    probes = np.asarray([[x.probes[gear] for x in own] for own in seen]) / um
    wave, probe = f"{gear}_diameters", f"{gear}_probe"
    turns = [p.turns for p in each.probes]
    around = f"RMS of waves around the rim of the {gear}, {above}"
    return {
        wave: Entry((wave,), number, "1", "nodal diameters; forward positive"),
        f"{gear}_wave_rms_um": Entry((*_PLACE, wave, "component"), waves, "um", around),
        probe: Entry((probe,), [p.name for p in each.probes], "1", "probe"),
        f"{probe}_turns": Entry((probe,), turns, "1", "whether the probe turns with the body"),
        f"{probe}_rms_um": Entry((*_PLACE, probe), probes, "um", f"RMS of a probe, {above}"),
    }


def _at_peak(
    gear: str, each: Looked, motion: BodyMotion, spectra: Sequence[Spectrum]
) -> Mapping[str, Entry]:
    order = np.unique(np.concatenate([spectrum.order for spectrum in spectra]))
    shown = np.zeros((len(spectra), len(order)))
    for row, spectrum in zip(shown, spectra, strict=True):
        row[np.searchsorted(order, spectrum.order)] = spectrum.size
    waves = each.waves(motion)
    large = waves.size.max(axis=1) > _SMALL * waves.size[waves.order > each.low].max()
    travel = np.where(waves.diameters[large] == 0, 0.0, waves.travel[large])
    of_probes = "amplitude that a probe shows at the highest peak; order 0: the mean"
    of_waves = "its amplitude at the highest peak, RMS over the width of the rim"
    around = "speed around the body; forward positive; 0: none"
    wave, over, probe = f"{gear}_wave", f"{gear}_order", f"{gear}_probe"
    rows = {
        f"{wave}_order": (waves.order[large], "1", f"order of a wave, by the {gear}'s rotation"),
        f"{wave}_diameters": (waves.diameters[large], "1", "its nodal diameters; forward positive"),
        f"{wave}_travel_rad_s": (travel, "rad/s", around),
    }
    size = waves.size[large] / um
    return {
        over: Entry((over,), order, "1", f"order of the {gear}'s rotation"),
        f"{probe}_amplitude_um": Entry((probe, over), shown / um, "um", of_probes),
        **entries_over((wave,), rows),
        f"{wave}_amplitude_um": Entry((wave, "component"), size, "um", of_waves),
    }


def _body_summary(each: Looked, motion: BodyMotion, main: MainWave, dataset: xr.Dataset) -> Summary:
    """What `sweep.waves` of the summary says of one body."""
    gear, own = each.body.gear, abs(motion.speed)
    order = dataset[f"{gear}_order"].values
    high, tooth = order > each.low, np.abs(order - each.body.teeth) < 1e-6
    probes = []
    for probe in each.probes:
        row = dataset[f"{gear}_probe_amplitude_um"].sel({f"{gear}_probe": probe.name}).values
        probes.append(
            {
                "name": probe.name,
                "frame": "rotating" if probe.turns else "fixed",
                "radius_mm": probe.place[0] / mm,
                "angle_deg": probe.place[1] / deg,
                "height_mm": probe.place[2] / mm,
                "strongest_order": float(order[high][np.argmax(row[high])]),
                "amplitude_um": float(row[high].max()),
                "amplitude_at_teeth_um": float(row[tooth].sum()),
            }
        )
    return {
        "gear": gear,
        "pinion_speed_rad_s": dataset.attrs["peak_speed_rad_s"],
        "speed_rad_s": own,
        "order": main.order,
        "frequency_Hz": main.order * own / (2.0 * np.pi),
        "nodal_diameters": main.diameters,
        "wave": wave_words(main.diameters),
        "share": main.share,
        "travel_rad_s": main.travel,
        "amplitude_um": dict(zip(DIRECTIONS, map(float, main.amplitude / um), strict=True)),
        "probes": probes,
        "largest": _largest_waves(dataset, gear),
        "flank": loads_summary(dataset),
    }


def _largest_waves(dataset: xr.Dataset, gear: str) -> list[Summary]:
    """Where each wave is largest over all speeds."""
    total = np.sqrt(np.sum(dataset[f"{gear}_wave_rms_um"].values ** 2, axis=-1))
    found = []
    for wave, number in enumerate(dataset[f"{gear}_diameters"].values):
        own = total[:, :, wave]
        # Rounding must not choose between directions that found the same.
        largest = own >= (1.0 - 1e-9) * own.max()
        way, place = np.unravel_index(int(np.argmax(largest)), own.shape)
        found.append(
            {
                "nodal_diameters": int(number),
                "pinion_speed_rad_s": float(dataset["speed"].values[place]),
                "direction": str(dataset["direction"].values[way]),
                "rms_um": float(own[way, place]),
            }
        )
    return found
