"""Natural modes of a scene: where their energy is, and at which speeds the mesh excites them."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxgear._checks import require
from jaxgear._dynamics._modes import Modes, critical_speeds, rotating_frequencies
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._tables import ModesKeys
from jaxgear.study._built import built_scene
from jaxgear.study._dynamics import Dynamics, damping_summary, fastest, solve_dynamics
from jaxgear.study._head import head, study
from jaxgear.study._progress import narration
from jaxgear.study._result import Datasets, Result, Summary, titled
from jaxgear.study._results import Entry, dataset_of, entries_over
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
    # Natural frequencies are asked for: shapes that the mesh excites are made for responses.
    built = built_scene(scene.replace({"model.shapes": "natural"}), moving=True)
    scene = built.scene
    with narration("modes"):
        dynamics = solve_dynamics(built)
        require_retained(scene.modes, scene.shape_count, dynamics.pair)
        # The first of a thin wheel are but its lowest waves.
        usual = 40 if scene.condensed else 12
        count = modes_shown(scene.modes, np.asarray(dynamics.modes.frequency), usual)
        highest = fastest(scene.sweep) or _where_last(dynamics, count)
        found = {"modes": _modes_dataset(dynamics, count)}
        summary = _modes_summary(dynamics, scene.modes.harmonics, count)
        if dynamics.pair.bodies:
            waves = body_waves(
                scene.bodies,
                dynamics.pair,
                dynamics.modes,
                harmonics=scene.modes.harmonics,
                highest=highest,
                count=count,
            )
            of_bodies, more = _of_bodies(waves, scene.modes.harmonics)
            found = {"modes": found["modes"].assign(wave_entries(waves)), **of_bodies}
            summary |= more
        else:
            found["campbell"] = _campbell_dataset(dynamics, scene.modes.harmonics, count, highest)
    summary = head(built, dynamics.statics) | {
        "damping": damping_summary(scene.damping, dynamics),
        "modes": summary,
    }
    return Result(scene, summary, {name: titled(each, scene.title) for name, each in found.items()})


def _of_bodies(waves: BodyWaves, harmonics: int) -> tuple[Datasets, Summary]:
    """What there is of condensed bodies only: datasets by group, and their part of the summary."""
    critical = critical_dataset(waves)
    alone = {gear: alone_dataset(waves, gear) for gear in waves.alone}
    found = {
        "campbell": turning_dataset(waves, harmonics),
        "critical": critical,
        **{f"alone_{gear}": each for gear, each in alone.items()},
    }
    return found, waves_summary(waves, critical, alone)


def _where_last(dynamics: Dynamics, count: int) -> float:
    """Up to where the mesh frequency itself meets the last of so many modes [rad/s]."""
    last = float(np.asarray(dynamics.modes.frequency)[count - 1])
    return 1.05 * 2.0 * np.pi * last / dynamics.statics.model.pair.pinion.teeth


def modes_shown(asked: ModesKeys, frequency: np.ndarray, usual: int) -> int:
    """Number of modes to show, of those with some frequencies [Hz]: at least one.

    As a scene asks for, or so many as is usual.

    **Raises:**

    - `InputError` if none is as low as wanted.
    """
    highest, count = asked.highest_Hz, asked.count
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
    wanted = (usual if highest is None else below) if count is None else count
    return min(below, wanted)


def _modes_dataset(dynamics: Dynamics, count: int) -> xr.Dataset:
    """The first modes, and where their energy is."""
    energy = {name: values[:count] for name, values in _energies(dynamics.modes).items()}
    shown = [name for name in _PARTS if name == "mesh" or np.max(energy[name]) > 0.0]
    shares = np.stack([energy[name] for name in shown], axis=1)
    frequency, damping = np.asarray(dynamics.modes.frequency), dynamics.damping_ratio
    rows = {
        "mode": (np.arange(1, count + 1), "1", "number of the mode"),
        "frequency_Hz": (frequency[:count], "Hz", "natural frequency"),
        "damping_ratio": (damping[:count], "1", "ratio to critical damping"),
    }
    return dataset_of(
        {
            **entries_over(("mode",), rows),
            "part": Entry(("part",), shown, "1", "part of the pair that stores energy"),
            "energy": Entry(("mode", "part"), shares, "1", "share of the strain energy"),
        }
    )


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


def _campbell_dataset(dynamics: Dynamics, harmonics: int, count: int, highest: float) -> xr.Dataset:
    """Natural frequencies over speed, split by gyroscopic moments where the scene has them."""
    frequency = np.asarray(dynamics.modes.frequency)[:count]
    speeds, system = np.linspace(0.0, highest, _SPEEDS), dynamics.pair.system
    over = lambda values: np.tile(values, (speeds.size, 1))
    rows: dict[str, tuple[np.ndarray, str, str]] = {}
    if system.gyroscopic is None:
        energy = over(_energies(dynamics.modes)["mesh"][:count])
        rows["mesh_energy"] = energy, "1", "share of the mesh in the strain energy"
        turning = over(frequency)
    else:
        # Turning, modes mix, and the shares at rest are theirs no longer.
        matrices = system.mass, system.whole_stiffness, system.gyroscopic, system.free
        turning = np.asarray(rotating_frequencies(*matrices, jnp.asarray(speeds)))[:, :count]
    rows["frequency_Hz"] = turning, "Hz", "natural frequency"
    return dataset_of(
        {
            "speed": Entry(("speed",), speeds, "rad/s", "speed of the pinion"),
            "mode": Entry(("mode",), np.arange(1, count + 1), "1", "number of the mode"),
            **entries_over(("speed", "mode"), rows),
        }
    ).assign_attrs(teeth_pinion=dynamics.statics.model.pair.pinion.teeth, harmonics=harmonics)


def _modes_summary(dynamics: Dynamics, harmonics: int, count: int) -> Summary:
    """The `modes` part of the summary."""
    frequency, teeth = dynamics.modes.frequency[:count], dynamics.statics.model.pair.pinion.teeth
    orders = range(1, harmonics + 1)
    critical = np.asarray(critical_speeds(frequency, teeth, tuple(orders)))
    return {
        "frequency_Hz": np.asarray(frequency),
        "damping_ratio": dynamics.damping_ratio[:count],
        "energy": {name: values[:count] for name, values in _energies(dynamics.modes).items()},
        "critical_speed_rad_s": {f"mesh_harmonic_{h}": critical[:, h - 1] for h in orders},
        "crossing": np.asarray(dynamics.modes.crossing)[:count],
        "total": int(dynamics.modes.frequency.size),
    }
