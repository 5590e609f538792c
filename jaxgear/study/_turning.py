"""Modes of pairs with condensed bodies, for files and pictures: waves, speeds, critical speeds.

From the library's arrays in SI to datasets and tables in the units of files.
"""

import math
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
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._results import Entry

Summary = dict[str, Any]

# Speeds at which the modes are found; between them they are followed.
_SPEEDS = 61
DIRECTIONS = {1: "forward", -1: "backward", 0: "none", 2: "both"}


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
    scene: Scene, pair: PairDynamics, modes: Modes, highest: float, count: int, harmonics: int
) -> BodyWaves:
    """Find the waves of a scene's modes, and follow them over speed.

    **Arguments:**

    - `scene`: with its condensed bodies.
    - `pair`: of it.
    - `modes`: at rest.
    - `highest`: speed of the pinion [rad/s].
    - `count`: number of modes.
    - `harmonics`: of the mesh.

    **Returns:**

    The first modes at rest and over speed, and their critical speeds.
    """
    sectors = tuple(
        int(scene.bodies[gear].built.body.facts.get("sectors", 0)) if gear in scene.bodies else 0
        for gear in GEARS
    )
    both = sectors[0], sectors[1]
    speeds = np.linspace(0.0, highest, _SPEEDS)
    turning = turning_modes(pair, modes, speeds, both).first(count)
    return BodyWaves(
        content=wave_content(pair, np.asarray(modes.shape)[:, :count], both),
        turning=turning,
        critical=critical_crossings(turning, tuple(range(1, harmonics + 1))),
        alone={GEARS[body.index]: modes_alone(pair, modes, body.index) for body in pair.bodies},
        frequency=np.asarray(modes.frequency),
    )


def require_retained(scene: Scene, pair: PairDynamics) -> None:
    """Refuse to show modes of which the condensed bodies know nothing.

    **Arguments:**

    - `scene`: gives the highest frequency or the number of modes, if it wants one.
    - `pair`: of it.

    **Raises:**

    - `InputError` naming the gear whose modes end below it.
    """
    asked, count = scene.get("modes.highest_Hz"), scene.get("modes.count")
    if not pair.bodies or (asked is None and count is None):
        return
    ends = [float(np.sqrt(np.max(np.asarray(body.square)))) for body in pair.bodies]
    body, last = pair.bodies[int(np.argmin(ends))], min(ends) / (2.0 * np.pi)
    about = dict(
        gear=GEARS[body.index],
        last=last,
        modes=body.square.size,
        given=scene.get("model.coordinates", 100) or "all",
    )
    whose = (
        "but the {modes} modes that the {gear}'s condensed body has in motion, all seats held, end "
        "at {last:.5g} Hz"
    )
    remedy = (
        "beyond, the pair's would be wrong. Raise model.coordinates, of which it has {given}, and "
        "the {gear}'s body.modes if that is all that it has; or lower "
    )
    if asked is not None:
        message = "modes.highest_Hz is {asked:g} Hz, " + whose + ": " + remedy
        require(asked <= last, message + "modes.highest_Hz.", asked=asked, **about)
        return
    below = int(np.searchsorted(_natural(pair), last, side="right"))
    message = "modes.count is {count}, " + whose + ", and the pair has {below} below: " + remedy
    require(count <= below, message + "modes.count.", count=count, below=below, **about)


def _natural(pair: PairDynamics) -> np.ndarray:
    """Natural frequencies of a pair at rest, up to that of the spring that holds it [Hz]."""
    stiffness, mass = np.asarray(pair.system.whole_stiffness), np.asarray(pair.system.mass)
    size = 1.0 / np.sqrt(np.diagonal(mass))
    scaled = lambda matrix: size[:, None] * matrix * size
    square = scipy.linalg.eigvalsh(scaled(stiffness), scaled(mass))
    return np.sqrt(np.maximum(square, 0.0)) / (2.0 * np.pi)


# --- Datasets


def wave_variables(waves: BodyWaves) -> dict[str, xr.Variable]:
    """Nodal diameters of the modes at rest, over mode."""
    content = waves.content
    entries = {
        "gear": Entry(
            ("mode",), [GEARS[i] for i in content.gear], "", "gear with the leading wave"
        ),
        "nodal_diameter": Entry(("mode",), content.diameters, "1", "of the leading wave"),
        "wave_share": Entry(
            ("mode",), content.share, "1", "share of the leading wave in the kinetic energy"
        ),
    }
    return {name: entry.variable() for name, entry in entries.items()}


def turning_dataset(waves: BodyWaves, harmonics: int) -> xr.Dataset:
    """Modes over speed, with what they are at each speed.

    **Arguments:**

    - `waves`: of the modes.
    - `harmonics`: of the mesh.

    **Returns:**

    A dataset over speed and mode.
    """
    turning = waves.turning
    entries = {
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
    return xr.Dataset(
        {
            name: Entry(("speed", "mode"), values, unit, words).variable()
            for name, (values, unit, words) in entries.items()
        },
        {"speed": ("speed", turning.speeds, {"units": "rad/s", "long_name": "pinion speed"})},
        {
            "teeth_pinion": turning.teeth[0],
            "teeth_wheel": turning.teeth[1],
            "harmonics": harmonics,
        },
    )


# --- Summary


def waves_summary(waves: BodyWaves) -> Summary:
    """What the `modes` part of the summary has of condensed bodies."""
    content, most = waves.content, float(waves.frequency[waves.content.gear.size - 1])
    return {
        "gear": [GEARS[i] for i in content.gear],
        "nodal_diameter": content.diameters,
        "wave_share": content.share,
        "critical": [_critical_row(waves.turning, each) for each in waves.critical],
        "alone": [
            {"gear": gear} | _alone_columns(waves, alone, most)
            for gear, alone in waves.alone.items()
        ],
    }


def _critical_row(turning: TurningModes, each: CriticalSpeed) -> Summary:
    on_gear = math.isfinite(each.body)
    speed = float(turning.ratio[each.gear]) * each.speed
    return {
        "pinion_speed_rad_s": each.speed,
        "wheel_speed_rad_s": float(turning.ratio[1]) * each.speed,
        "harmonic": each.harmonic,
        "mode": each.mode + 1,
        "gear": GEARS[each.gear],
        "nodal_diameter": each.diameters,
        "direction": DIRECTIONS[each.direction],
        "frequency_space_Hz": each.space,
        "frequency_body_Hz": each.body if on_gear else None,
        "order_on_body": 2.0 * math.pi * each.body / speed if on_gear else None,
        "mesh_energy": each.mesh,
    }


def alone_rows(waves: BodyWaves, gear: str) -> dict[str, np.ndarray]:
    """Modes of one gear alone and in mesh, as far as the modes in mesh are shown."""
    most = float(waves.frequency[waves.content.gear.size - 1])
    return _alone_columns(waves, waves.alone[gear], most)


def _alone_columns(waves: BodyWaves, alone: AloneModes, most: float) -> dict[str, np.ndarray]:
    shown = alone.frequency <= most
    return {
        "nodal_diameter": alone.diameters[shown],
        "frequency_alone_Hz": alone.frequency[shown],
        "frequency_in_mesh_Hz": waves.frequency[alone.in_mesh[shown]],
        "mode_in_mesh": alone.in_mesh[shown] + 1,
        "likeness": alone.likeness[shown],
    }
