"""Critical speeds, growth and waves of turning wheels."""

import math

import numpy as np

from .finding import Finding
from .motion import FAST, SLOW, rigid
from .stiffened import stiffened
from .travelling import WHEELS, Wave, record


def critical_speeds() -> Finding:
    """Fig. III-12 and III-23: flexible bodies and the main critical speed."""
    found = Finding(
        "Speed of the highest peak above 700 rad/s (Fig. III-12, III-23)",
        "the rigid model leads to higher tooth critical speeds; main peaks are moved to lower "
        "speeds by flexible webs",
        ["wheel", "peak rad/s", "ratio there", "over the rigid pair's", "over rigidified"],
    )
    pace: dict[str, float] = {}
    curves = {name: rigid(name) for name in ("accessory", "power")}
    curves |= {f"{name}, H1 rigidified": stiffened(f"{name} H1")[0] for name in curves}
    for label, curve in (curves | {label: record(label).curve for label in WHEELS}).items():
        pace[label] = curve.main
        name, fast = label.partition(",")[0], curve.speed > SLOW
        peak = float(np.nanmax(curve.ratio[fast]))
        bases = (name, f"{name}, H1 rigidified")
        over = [curve.main / pace[base] if base in pace else None for base in bases]
        found.rows.append([label, curve.main, peak, *over])
    beside = {"rigid pair, a solid disc": "", "rigidified wheel, as heavy": ", H1 rigidified"}
    webs = [pace[x] for t in (5, 3, 2) if (x := f"accessory, {t} mm") in pace]
    found.holds = {
        **{
            f"{name}: every flexible wheel peaks at a lower speed than the {what}": all(
                pace[label] < pace[name + base] for label in WHEELS if label.startswith(name)
            )
            for name in ("accessory", "power")
            for what, base in beside.items()
        },
        "H2 lies lower than H1": pace["accessory, H2"] < pace["accessory, 3 mm"],
    }
    if len(webs) > 1:
        found.holds["the thinner the web, the lower"] = bool(np.all(np.diff(webs) < 0.0))
    return found


def growth() -> Finding:
    """Fig. III-24: the dynamic ratio at high speed, with and without centrifugal load."""
    found = Finding(
        "Mesh force and line load, over the largest static ones, with centrifugal load and without "
        "(Fig. III-24)",
        "at high speeds the tooth dynamic loading increases continuously with centrifugal effects, "
        "and not without",
        [
            "wheel",
            "of",
            "with: to 2000 rad/s",
            "from 2500",
            "without: to 2000",
            "from 2500",
            "more at 1500",
            "at 3000",
        ],
    )
    rises: dict[str, tuple[float, float]] = {}
    for label in WHEELS:
        own = record(label)
        pairs = {"force": (own.spinning, own.still), "line load": (own.lines, own.still_lines)}
        for what, (spinning, still) in pairs.items():
            if spinning is None or still is None:
                continue
            means = [
                float(np.nanmean(values[part]))
                for values in (spinning, still)
                for part in (FAST <= 2000.0, FAST >= 2500.0)
            ]
            more = spinning - still
            rises[f"{label}: {what}"] = means[1] - means[0], means[3] - means[2]
            found.rows.append([label, what, *means, float(more[0]), float(more[-1])])
    for name in ("power", "accessory"):
        for what in ("force", "line load"):
            own = [x for key, x in rises.items() if key.startswith(name) and key.endswith(what)]
            found.holds[f"{name}: the {what} rises from up to 2000 to over 2500 rad/s"] = all(
                with_it > 0.02 for with_it, _ in own
            )
            found.holds[f"{name}: the {what} rises by less than half of it without"] = all(
                with_it > 0.02 and without < 0.5 * with_it for with_it, without in own
            )
    return found


# A peak lies at a critical speed if it is no further off, over it.
_NEAR = 0.015


def waves() -> Finding:
    """Fig. III-44 to III-49 and IV-19: waves at critical speeds."""
    found = Finding(
        "Waves of the wheel where the mesh meets them (Fig. III-44 to III-49, IV-19)",
        "a node of the rim answers at Z - n or Z + n and not at Z; what stands still in space sees "
        "Z; forward waves at Z - n",
        [
            "wheel",
            "wave",
            "on body Hz",
            "predicted rad/s",
            "peak rad/s",
            "off %",
            "side/Z",
            "of its wave",
            "probe at/Z",
            "RMS um",
            "in mesh",
        ],
    )
    every: list[Wave] = []
    for label in WHEELS:
        for row in record(label).waves:
            every.append(row)
            off = 100.0 * (row.found / row.predicted - 1.0)
            right = row.share if row.sense == np.sign(row.diameters) else -row.share
            speeds = [row.predicted, row.found, off]
            seen = [row.gauge, right, row.probe, 1e6 * row.size, row.mesh]
            found.rows.append([label, f"{row.diameters:+d}", row.frequency, *speeds, *seen])
    peaks = [row for row in every if math.isfinite(row.found)]
    found.holds = {
        "all waves of two to four diameters have a peak within 6 % of the prediction": len(peaks)
        == len(every),
        "all peaks lie within 1.5 % of the predicted speeds": all(
            abs(row.found / row.predicted - 1.0) < _NEAR for row in peaks
        ),
        "a node answers at Z - n or Z + n at least ten times as much as at Z": all(
            row.gauge > 10.0 for row in every
        ),
        "... so of two diameters": all(
            row.gauge > 10.0 for row in every if abs(row.diameters) == 2
        ),
        "... more than at Z": all(row.gauge > 1.0 for row in every),
        "a probe that stands still answers most at Z": all(
            abs(row.probe - 1.0) < 1e-9 for row in every
        ),
        "most of that order is the wave that runs the right way": all(
            row.sense == np.sign(row.diameters) and row.share > 0.5 for row in every
        ),
    }
    return found


def run_up() -> Finding:
    """The pair of two nodal diameters in a run-up."""
    found = Finding(
        "Critical speeds of the two waves of a pair (Tab. III-12, IV-2)",
        "the backward resonance comes first in a run-up",
        ["wheel", "n", "backward rad/s", "forward rad/s", "backward peak", "forward peak"],
    )
    first: dict[int, list[bool]] = {}
    for label in WHEELS:
        by = {row.diameters: row for row in record(label).waves}
        for n in (2, 3, 4):
            if n not in by or -n not in by:
                continue
            back, forward = by[-n], by[n]
            found.rows.append(
                [label, n, back.predicted, forward.predicted, back.found, forward.found]
            )
            # Without a peak of its own a wave is met nowhere.
            if math.isfinite(back.found) and math.isfinite(forward.found):
                first.setdefault(n, []).append(back.found < forward.found)
    found.holds = {f"n = {n}: backward first": all(ok) for n, ok in first.items()}
    return found


def in_mesh() -> Finding:
    """Fig. III-19: the wheel alone and in mesh."""
    found = Finding(
        "How far the mesh moves modes of the wheel up to 12 kHz, % (Fig. III-19)",
        "modes with zero or one nodal diameter deviate more than those with more diameters, which "
        "correspond well",
        ["wheel", "of a pair", *(f"n = {n}" for n in range(6))],
    )
    one, other = {}, {}
    for label in WHEELS:
        alone = record(label).alone
        for which, rows in ((0, one), (1, other)):
            rows[label] = {n: 100.0 * shift[which] for n, shift in alone.items()}
            name = ("less moved", "more moved")[which]
            found.rows.append([label, name, *(rows[label].get(n) for n in range(6))])
    found.holds = {
        "n >= 2: one of each pair is moved by less than 0.5 %": all(
            shift < 0.5 for row in one.values() for n, shift in row.items() if n >= 2
        ),
        "n >= 2: the other one too": all(
            shift < 0.5 for row in other.values() for n, shift in row.items() if n >= 2
        ),
        "n >= 3: the other one by less than 5 %": all(
            shift < 5.0 for row in other.values() for n, shift in row.items() if n >= 3
        ),
        "from two on, the more diameters the less": all(
            row[n] > row[n + 1]
            for row in other.values()
            for n in range(2, 5)
            if n in row and n + 1 in row
        ),
        "n = 0 or 1 moves more than all others": all(
            max(row.get(0, 0.0), row.get(1, 0.0)) > max(shift for n, shift in row.items() if n >= 2)
            for row in other.values()
        ),
    }
    return found
