"""Natural modes of a scene: where their energy is, and at which speeds the mesh excites them."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxgear._checks import require
from jaxgear._dynamics._modes import Modes, critical_speeds, rotating_frequencies
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import Dynamics, damping_summary, solve_dynamics, speeds_of
from jaxgear.study._head import head, study
from jaxgear.study._progress import built_scene, narration
from jaxgear.study._result import Result, Summary, titled
from jaxgear.study._results import Entry
from jaxgear.study._turning import (
    BodyWaves,
    alone_dataset,
    body_waves,
    critical_dataset,
    require_retained,
    turning_dataset,
    wave_entries,
    waves_summary,
)

_PARTS = ("mesh", "pinion", "wheel", "bearings")
# Speeds over which the modes of rigid gears are found.
_SPEEDS = 121


@study
def modes(scene: Scene) -> Result:
    """Natural frequencies with the mean mesh stiffness, strain energy, critical speeds.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    Datasets `modes` and `campbell`, of condensed bodies also `critical` and `alone_GEAR`, and the
    summary.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    scene = built_scene(scene, moving=True)
    with narration("modes"):
        dynamics = solve_dynamics(scene)
        require_retained(scene, dynamics.pair)
        count = modes_shown(scene, np.asarray(dynamics.modes.frequency))
        highest = _highest_speed(scene, dynamics, count)
        found = {"modes": _modes_dataset(dynamics, count)}
        summary = _modes_summary(scene, dynamics, count)
        if dynamics.pair.bodies:
            waves = body_waves(scene, dynamics.pair, dynamics.modes, highest, count)
            of_bodies, more = _of_bodies(scene, waves)
            found = {"modes": found["modes"].assign(wave_entries(waves)), **of_bodies}
            summary |= more
        else:
            found["campbell"] = _campbell_dataset(scene, dynamics, count, highest)
    summary = head(scene, dynamics.statics) | {
        "damping": damping_summary(scene, dynamics),
        "modes": summary,
    }
    return Result(scene, summary, {name: titled(each, scene) for name, each in found.items()})


def _of_bodies(scene: Scene, waves: BodyWaves) -> tuple[Mapping[str, xr.Dataset], Summary]:
    """What there is of condensed bodies only: datasets by group, and their part of the summary."""
    critical = critical_dataset(waves)
    alone = {gear: alone_dataset(waves, gear) for gear in waves.alone}
    found = {
        "campbell": turning_dataset(waves, scene.modes.harmonics),
        "critical": critical,
        **{f"alone_{gear}": each for gear, each in alone.items()},
    }
    return found, waves_summary(waves, critical, alone)


def _highest_speed(scene: Scene, dynamics: Dynamics, count: int) -> float:
    """Up to which speed of the pinion modes are shown [rad/s]."""
    if scene.has_table("sweep"):
        return float(speeds_of(scene.sweep)[-1])
    # Up to where the mesh frequency itself meets the last of these modes.
    last = float(dynamics.modes.frequency[count - 1])
    return 1.05 * 2.0 * np.pi * last / dynamics.statics.model.pair.pinion.teeth


def modes_shown(scene: Scene, frequency: np.ndarray) -> int:
    """Number of modes that a scene wants to see, at least one.

    **Arguments:**

    - `scene`: with or without a table [modes].
    - `frequency`: natural frequencies of all modes [Hz].

    **Raises:**

    - `InputError` if none is as low as wanted.
    """
    highest, count = scene.modes.highest_Hz, scene.modes.count
    below = frequency.size
    if highest is not None:
        below = int(np.searchsorted(frequency, highest, side="right"))
        require(
            below > 0,
            "no mode has a natural frequency up to modes.highest_Hz, {got:g} Hz: the first has "
            "{first:.5g} Hz. Raise it, or leave it out.",
            got=highest,
            first=float(frequency[0]),
        )
    # The first of a thin wheel are but its lowest waves.
    default = (40 if scene.condensed else 12) if highest is None else below
    return min(below, default if count is None else count)


def _modes_dataset(dynamics: Dynamics, count: int) -> xr.Dataset:
    """The first modes, and where their energy is."""
    energy = {name: values[:count] for name, values in _energies(dynamics.modes).items()}
    shown = [name for name in _PARTS if name == "mesh" or np.max(energy[name]) > 0.0]
    frequency, damping = np.asarray(dynamics.modes.frequency), dynamics.damping_ratio
    entries = {
        "mode": Entry(("mode",), np.arange(1, count + 1), "1", "number of the mode"),
        "part": Entry(("part",), shown, "1", "part of the pair that stores energy"),
        "frequency_Hz": Entry(("mode",), frequency[:count], "Hz", "natural frequency"),
        "energy": Entry(
            ("mode", "part"),
            np.stack([energy[name] for name in shown], axis=1),
            "1",
            "share of the strain energy",
        ),
        "damping_ratio": Entry(("mode",), damping[:count], "1", "ratio to critical damping"),
    }
    return xr.Dataset({name: entry.variable() for name, entry in entries.items()})


def _energies(modes: Modes) -> Mapping[str, np.ndarray]:
    """Shares of the strain energy: mesh, each gear with its shaft, bearings; the last also apart.

    They are without rounding below zero.
    """
    share = lambda name: np.clip(np.asarray(modes.share(name)), 0.0, 1.0)
    bearings = {f"{gear}_bearings": share(f"{gear} bearings") for gear in GEARS}
    return {
        "mesh": share("mesh"),
        **{gear: share(f"{gear} shaft") for gear in GEARS},
        "bearings": sum(bearings.values(), np.zeros(())),
        **bearings,
    }


def _campbell_dataset(scene: Scene, dynamics: Dynamics, count: int, highest: float) -> xr.Dataset:
    """Natural frequencies over speed, split by gyroscopic moments where the scene has them."""
    frequency = np.asarray(dynamics.modes.frequency)[:count]
    speeds, system = np.linspace(0.0, highest, _SPEEDS), dynamics.pair.system
    over = lambda values: np.tile(values, (speeds.size, 1))
    both = ("speed", "mode")
    entries = {
        "speed": Entry(("speed",), speeds, "rad/s", "speed of the pinion"),
        "mode": Entry(("mode",), np.arange(1, count + 1), "1", "number of the mode"),
    }
    if system.gyroscopic is None:
        energy = over(_energies(dynamics.modes)["mesh"][:count])
        entries["mesh_energy"] = Entry(both, energy, "1", "share of the mesh in the strain energy")
        turning = over(frequency)
    else:
        # Turning, modes mix, and the shares at rest are theirs no longer.
        turning = rotating_frequencies(
            system.mass,
            system.whole_stiffness,
            system.gyroscopic,
            system.free,
            jnp.asarray(speeds),
        )[:, :count]
    entries["frequency_Hz"] = Entry(both, turning, "Hz", "natural frequency")
    return xr.Dataset(
        {name: entry.variable() for name, entry in entries.items()},
        attrs={
            "teeth_pinion": dynamics.statics.model.pair.pinion.teeth,
            "harmonics": scene.modes.harmonics,
        },
    )


def _modes_summary(scene: Scene, dynamics: Dynamics, count: int) -> Summary:
    """The `modes` part of the summary."""
    frequency, teeth = dynamics.modes.frequency[:count], dynamics.statics.model.pair.pinion.teeth
    harmonics = range(1, scene.modes.harmonics + 1)
    critical = np.asarray(critical_speeds(frequency, teeth, tuple(harmonics)))
    return {
        "frequency_Hz": np.asarray(frequency),
        "damping_ratio": dynamics.damping_ratio[:count],
        "energy": {name: values[:count] for name, values in _energies(dynamics.modes).items()},
        "critical_speed_rad_s": {f"mesh_harmonic_{h}": critical[:, h - 1] for h in harmonics},
        "crossing": np.asarray(dynamics.modes.crossing)[:count],
        "total": int(dynamics.modes.frequency.size),
    }
