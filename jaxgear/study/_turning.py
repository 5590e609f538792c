"""Modes of pairs with condensed bodies: waves, modes over speed, critical speeds, gears alone.

From the library's arrays in SI to datasets in the units of files.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy
import xarray as xr

from jaxgear._checks import require
from jaxgear._dynamics._campbell import (
    AloneModes,
    CriticalSpeed,
    TurningModes,
    critical_crossings,
    modes_alone,
    turning_modes,
)
from jaxgear._dynamics._modes import Modes
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._wave_content import WaveContent, wave_content
from jaxgear.scene._schema import GEARS
from jaxgear.scene._tables import ModesKeys
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry, dataset_of, entries_over

# Speeds at which the modes are found; between them they are followed.
_SPEEDS = 61
_DIRECTIONS = {1: "forward", -1: "backward", 0: "none", 2: "both"}


class BodyWaves(NamedTuple):
    """What the modes of a pair with condensed bodies are.

    **Fields:**

    - `content`: leading waves of the modes at rest.
    - `turning`: modes over speed.
    - `critical`: crossings with mesh harmonics.
    - `alone`: of each condensed gear, its modes on its bearings without mesh.
    - `frequency`: natural frequencies at rest [Hz].
    """

    content: WaveContent
    turning: TurningModes
    critical: tuple[CriticalSpeed, ...]
    alone: dict[str, AloneModes]
    frequency: np.ndarray


def body_waves(
    bodies: Mapping[str, Any],
    pair: PairDynamics,
    modes: Modes,
    *,
    harmonics: int,
    highest: float,
    count: int,
) -> BodyWaves:
    """Waves of the first modes of a pair with condensed bodies, at rest and over speed.

    Up to the highest speed of the pinion [rad/s]; and their critical speeds, with so many
    harmonics of the mesh.
    """
    facts = [bodies[gear].built.body.facts if gear in bodies else {} for gear in GEARS]
    both = int(facts[0].get("sectors", 0)), int(facts[1].get("sectors", 0))
    speeds = np.linspace(0.0, highest, _SPEEDS)
    turning = turning_modes(pair, modes, speeds, both).first(count)
    return BodyWaves(
        content=wave_content(pair, np.asarray(modes.shape)[:, :count], both),
        turning=turning,
        critical=critical_crossings(turning, tuple(range(1, harmonics + 1))),
        alone={GEARS[body.index]: modes_alone(pair, modes, body.index) for body in pair.bodies},
        frequency=np.asarray(modes.frequency),
    )


def require_retained(asked: ModesKeys, kept: int, pair: PairDynamics) -> None:
    """Refuse to show modes of which the condensed bodies know nothing, with so many modes kept.

    **Raises:**

    - `InputError` naming the gear whose modes end below what [modes] asks for.
    """
    highest, count = asked.highest_Hz, asked.count
    if not pair.bodies or (highest is None and count is None):
        return
    ends = [float(np.sqrt(np.max(np.asarray(body.square)))) for body in pair.bodies]
    body, last = pair.bodies[int(np.argmin(ends))], min(ends) / (2.0 * np.pi)
    if highest is not None:
        key, given, holds, more = "modes.highest_Hz", f"{highest:g} Hz", highest <= last, ""
    else:
        below = int(np.searchsorted(_natural(pair), last, side="right"))
        key, given, holds = "modes.count", f"{count}", count is None or count <= below
        more = f", and the pair has {below} below"
    require(
        holds,
        "{key} is {given}, but the {modes} modes that the {gear}'s condensed body has in motion, "
        "all seats held, end at {last:.5g} Hz{more}: beyond, the pair's would be wrong. Raise "
        "model.coordinates, of which it has {retained}, and the {gear}'s body.modes if that is all "
        "that it has; or lower {key}.",
        key=key,
        given=given,
        modes=body.square.size,
        gear=GEARS[body.index],
        last=last,
        more=more,
        retained=kept or "all",
    )


def _natural(pair: PairDynamics) -> np.ndarray:
    """Natural frequencies of a pair at rest, up to that of the spring that holds it [Hz]."""
    stiffness, mass = np.asarray(pair.system.whole_stiffness), np.asarray(pair.system.mass)
    size = 1.0 / np.sqrt(np.diagonal(mass))
    scaled = lambda matrix: size[:, None] * matrix * size
    square = scipy.linalg.eigvalsh(scaled(stiffness), scaled(mass))
    return np.sqrt(np.maximum(square, 0.0)) / (2.0 * np.pi)


# --- Datasets


def wave_entries(waves: BodyWaves) -> Mapping[str, xr.Variable]:
    """Leading waves of the modes at rest, over mode."""
    content = waves.content
    rows = {
        "gear": ([GEARS[i] for i in content.gear], "", "gear with the leading wave"),
        "nodal_diameter": (content.diameters, "1", "of the leading wave"),
        "wave_share": (content.share, "1", "share of the leading wave in the kinetic energy"),
    }
    return {name: entry.variable() for name, entry in entries_over(("mode",), rows).items()}


def turning_dataset(waves: BodyWaves, harmonics: int) -> xr.Dataset:
    """Modes over speed, with what they are at each; pictures show so many harmonics of the mesh."""
    turning = waves.turning
    rows = {
        "frequency_Hz": (turning.space, "Hz", "natural frequency seen from space"),
        "frequency_body_Hz": (turning.body, "Hz", "natural frequency on the leading gear"),
        "gear": (turning.gear, "", "gear with the leading wave: 0 pinion, 1 wheel"),
        "nodal_diameter": (turning.diameters, "1", "of the leading wave"),
        "direction": (
            turning.direction,
            "",
            "1 with the gear, -1 against it, 0 none, 2 both: it stands still on the gear",
        ),
        "wave_share": (turning.share, "1", "share of the leading wave in the kinetic energy"),
        "mesh_energy": (turning.mesh, "1", "share of the mesh in the strain energy"),
        "likeness": (turning.likeness, "1", "squared overlap with the mode at the speed before"),
    }
    number = np.arange(1, turning.space.shape[1] + 1)
    entries = {
        **entries_over(("speed", "mode"), rows),
        "speed": Entry(("speed",), turning.speeds, "rad/s", "pinion speed"),
        "mode": Entry(("mode",), number, "1", "number of the mode"),
    }
    teeth = dict(zip(("teeth_pinion", "teeth_wheel"), turning.teeth, strict=True))
    return dataset_of(entries).assign_attrs(**teeth, harmonics=harmonics)


def critical_dataset(waves: BodyWaves) -> xr.Dataset:
    """Crossings: speeds at which a harmonic of the mesh meets a mode.

    On a gear whose leading wave the mode is not, it has no frequency.
    """
    rows, turning = waves.critical, waves.turning
    of = lambda name: np.array([getattr(each, name) for each in rows])
    speed, gear, body = of("speed"), np.array([each.gear for each in rows], int), of("body")
    own = np.asarray(turning.ratio)[gear] * speed
    columns = {
        "pinion_speed_rad_s": (speed, "rad/s", "critical speed of the pinion"),
        "wheel_speed_rad_s": (float(turning.ratio[1]) * speed, "rad/s", "that of the wheel"),
        "harmonic": (of("harmonic"), "1", "of the mesh frequency"),
        "mode": (np.array([each.mode + 1 for each in rows], int), "1", "number of the mode"),
        "gear": ([GEARS[i] for i in gear], "", "gear with the leading wave"),
        "nodal_diameter": (of("diameters"), "1", "of the leading wave"),
        "direction": (
            [_DIRECTIONS[each.direction] for each in rows],
            "",
            "in which that wave runs on the gear",
        ),
        "frequency_space_Hz": (of("space"), "Hz", "natural frequency seen from space"),
        "frequency_body_Hz": (body, "Hz", "natural frequency on that gear"),
        "order_on_body": (2.0 * np.pi * body / own, "1", "order of that gear's rotation"),
        "mesh_energy": (of("mesh"), "1", "share of the mesh in the strain energy"),
    }
    return dataset_of(entries_over(("crossing",), columns))


def alone_dataset(waves: BodyWaves, gear: str) -> xr.Dataset:
    """Modes of one gear alone and in mesh, as far as the modes in mesh are shown."""
    alone = waves.alone[gear]
    shown = alone.frequency <= float(waves.frequency[waves.content.gear.size - 1])
    mesh = alone.in_mesh[shown]
    columns = {
        "nodal_diameter": (alone.diameters[shown], "1", "of the mode"),
        "frequency_alone_Hz": (alone.frequency[shown], "Hz", f"of the {gear} on its bearings"),
        "frequency_in_mesh_Hz": (waves.frequency[mesh], "Hz", "of the mode in mesh most like it"),
        "mode_in_mesh": (mesh + 1, "1", "number of that mode"),
        "likeness": (alone.likeness[shown], "1", "squared overlap of both"),
    }
    return dataset_of(entries_over(("alone",), columns))


# --- Summary


def waves_summary(
    waves: BodyWaves, critical: xr.Dataset, alone: Mapping[str, xr.Dataset]
) -> Summary:
    """What the `modes` part of the summary has of condensed bodies, from their datasets."""
    rows = []
    for place in range(critical.sizes["crossing"]):
        row = {str(name): each.values[place].item() for name, each in critical.items()}
        if not np.isfinite(row["frequency_body_Hz"]):
            row |= {"frequency_body_Hz": None, "order_on_body": None}
        rows.append(row)
    content = waves.content
    return {
        "gear": [GEARS[i] for i in content.gear],
        "nodal_diameter": content.diameters,
        "wave_share": content.share,
        "critical": rows,
        "alone": [
            {"gear": gear} | {str(name): values.values for name, values in each.items()}
            for gear, each in alone.items()
        ],
    }
