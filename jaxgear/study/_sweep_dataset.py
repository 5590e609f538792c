"""What a sweep found as datasets, in the units of files."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxgear._dynamics._sweep import Direction
from jaxgear._dynamics._system import PairDynamics
from jaxgear._response._sweep_features import WAYS
from jaxgear._response._transmission import transmission_error
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft
from jaxgear._units import mm, um
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import Dynamics
from jaxgear.study._results import Entry
from jaxgear.study._statics import SolverFailure
from jaxgear.study._sweeping import Response, Sweep

# No multiplier is below zero in size: what has none is marked so.
_UNKNOWN = -1.0
_PLACE = ("direction", "speed")
# A map of the mesh force has so many phases at the most.
_MOST_PHASES = 512


def sweep_dataset(dynamics: Dynamics, sweep: Sweep) -> xr.Dataset:
    """Everything that a sweep found, over direction and speed; refused where it is not finite."""
    model, pair = dynamics.statics.model, dynamics.pair
    teeth = model.pair.pinion.teeth
    entries = {
        "direction": Entry(("direction",), list(sweep.responses), "1", "of the sweep"),
        "speed": Entry(("speed",), sweep.speeds, "rad/s", "speed of the pinion"),
        "order": Entry(("order",), _orders(sweep), "1", "order of the mesh"),
        **_over_speeds(sweep),
        **_over_orders(sweep, model),
        **_over_phase(pair, sweep),
        **_over_points(sweep),
        **_excited_modes(dynamics),
    }
    dataset = xr.Dataset(
        {name: entry.variable() for name, entry in entries.items()},
        attrs={
            "teeth_pinion": teeth,
            "teeth_wheel": model.pair.wheel.teeth,
            "torque_pinion_Nm": float(model.torque),
            "mesh_periods": pair.system.table.periods,
            "static_mesh_force_N": float(pair.system.force),
            "peak_direction": sweep.main,
        },
    )
    dataset["multiplier"].encoding["_FillValue"] = _UNKNOWN
    for name, values in dataset.variables.items():
        if values.dtype.kind == "f" and not np.isfinite(values.values).all():
            raise SolverFailure(f"{name} of the sweep is not a finite number everywhere")
    return dataset


def _each(sweep: Sweep, value: Callable[[Response], Any]) -> np.ndarray:
    """A value of every response, direction and speed leading."""
    return np.asarray([[value(r) for r in own] for own in sweep.responses.values()])


# Of a response: scale, unit and words.
_NUMBERS = {
    "dynamic_ratio": (1.0, "1", "largest total contact force over the static one"),
    "pair_ratio": (1.0, "1", "largest force on a tooth pair over the static force"),
    "line_load_ratio": (1.0, "1", "largest line load over the quasi-static one"),
    "contact_loss": (1.0, "1", "share of the time in which no tooth touches"),
    "te_mean_um": (um, "um", "mean of the dynamic transmission error"),
    "te_rms_um": (um, "um", "RMS of the dynamic transmission error about its mean"),
    "te_peak_to_peak_um": (um, "um", "range of the dynamic transmission error"),
}


def _over_speeds(sweep: Sweep) -> Mapping[str, Entry]:
    found = {}
    for name, (scale, unit, words) in _NUMBERS.items():
        values = _each(sweep, lambda r, of=name.removesuffix("_um"): getattr(r.numbers, of))
        found[name] = Entry(_PLACE, values / scale, unit, words)
    periods = _each(sweep, lambda r: r.periods if r.settled else 0)
    multiplier = _each(sweep, lambda r: _UNKNOWN if r.multiplier is None else r.multiplier)
    rows = {
        "settled": (_each(sweep, lambda r: r.settled), "whether it repeats"),
        "stable": (_each(sweep, lambda r: r.stable), "whether a machine stays on it"),
        "periods": (periods, "mesh periods after which it repeats; 0: it does not"),
        "residual": (
            _each(sweep, lambda r: r.residual),
            "relative imbalance, or change over a cycle",
        ),
        "multiplier": (multiplier, "size of Floquet's largest multiplier; -1: not known"),
    }
    return found | {name: Entry(_PLACE, each, "1", words) for name, (each, words) in rows.items()}


def _orders(sweep: Sweep) -> np.ndarray:
    """Orders written down: the halves between them only where a response has some."""
    amplitudes = _each(sweep, lambda r: r.numbers.te_order)
    order = 0.5 * np.arange(1, amplitudes.shape[2] + 1)
    has_halves = np.max(amplitudes[..., ::2]) > 1e-6 * np.max(amplitudes)
    return order if has_halves else order[1::2]


def _over_orders(sweep: Sweep, model: PairModel) -> Mapping[str, Entry]:
    kept = np.rint(2.0 * _orders(sweep)).astype(int) - 1
    dims = (*_PLACE, "order")
    error = _each(sweep, lambda r: r.numbers.te_order[kept]) / um
    force = _each(sweep, lambda r: r.numbers.force_order[kept])
    found = {
        "te_order_um": Entry(dims, error, "um", "amplitude of the TE"),
        "mesh_force_order_N": Entry(
            dims, force, "N", "amplitude of the mesh force along the normal"
        ),
    }
    if not (names := _bearing_names(model)):
        return found
    load = _each(sweep, lambda r: r.numbers.bearing_order[kept][..., :3])
    # Direction, speed, order, bearing, axis.
    load = np.moveaxis(load, 2, -1)
    return found | {
        "bearing": Entry(("bearing",), names, "1", "gear and number of the bearing"),
        "axis": Entry(("axis",), list("STZ"), "1", "direction of a load"),
        "bearing_load_order_N": Entry(
            (*_PLACE, "bearing", "axis", "order"), load, "N", "amplitude of a bearing's load"
        ),
        "bearing_force_order_N": Entry(
            (*_PLACE, "bearing", "order"),
            np.sqrt(np.sum(load**2, axis=3)),
            "N",
            "amplitude of a bearing's force: root of the sum of squares over S, T, Z",
        ),
    }


def _bearing_names(model: PairModel) -> list[str]:
    """Names of the bearings in the order of the scene, the pinion's first."""
    mounts = zip(GEARS, (model.pinion_support, model.wheel_support), strict=True)
    return [
        f"{gear} {index}"
        for gear, mount in mounts
        if isinstance(mount, Shaft)
        for index in range(len(mount.bearings))
    ]


def _middles(dynamics: PairDynamics, cycles: int) -> np.ndarray:
    """Middles of the time steps of so many cycles [mesh periods]."""
    table = dynamics.system.table
    middles = np.asarray(table.middles)
    return np.concatenate([middles + i * table.periods for i in range(cycles)])


def _over_phase(dynamics: PairDynamics, sweep: Sweep) -> Mapping[str, Entry]:
    """The last cycle of each response, or the last two where some need them."""
    table = dynamics.system.table
    longer = _each(sweep, lambda r: r.settled and r.periods > table.periods).any()
    phase = _middles(dynamics, 2 if longer else 1)
    stride = -(-phase.size // _MOST_PHASES)

    def last(values: np.ndarray) -> np.ndarray:
        return np.tile(values, -(-phase.size // values.size))[-phase.size :][::stride]

    dims = (*_PLACE, "phase")
    force = _each(sweep, lambda r: last(r.numbers.force))
    pairs = _each(sweep, lambda r: last(r.numbers.pairs))
    return {
        "phase": Entry(
            ("phase",), phase[::stride], "1", "position in the cycle or cycles, in mesh periods"
        ),
        "mesh_force_ratio": Entry(dims, force, "1", "mesh force over the static one"),
        "tooth_pairs": Entry(dims, pairs, "1", "number of tooth pairs that carry"),
    }


def _over_points(sweep: Sweep) -> Mapping[str, Entry]:
    """The branch that was followed, piece after piece."""
    if not sweep.curves:
        return {}
    join = lambda name: np.concatenate([getattr(piece, name) for piece in sweep.curves])
    piece = np.concatenate([np.full(x.speed.size, i) for i, x in enumerate(sweep.curves)])
    rows = {
        "curve_piece": (piece, "1", "number of the piece"),
        "curve_speed": (join("speed"), "rad/s", "speed of the pinion along the branch"),
        "curve_dynamic_ratio": (join("dynamic_ratio"), "1", "dynamic ratio"),
        "curve_te_rms_um": (join("te_rms") / um, "um", "RMS of the dynamic TE"),
        "curve_multiplier": (
            np.abs(join("multiplier")),
            "1",
            "size of Floquet's largest multiplier",
        ),
        "curve_stable": (join("stable"), "1", "whether a machine stays on it"),
    }
    return {name: Entry(("point",), *row) for name, row in rows.items()}


def _excited_modes(dynamics: Dynamics) -> Mapping[str, Entry]:
    """The few modes that the mesh shakes most, for pictures to mark."""
    share, frequency = (np.asarray(x) for x in (dynamics.modes.mesh, dynamics.modes.frequency))
    most = np.argsort(-share, kind="stable")[:3]
    chosen = sorted(int(i) for i in most if share[i] >= 0.05 or i == most[0])
    dims = ("excited_mode",)
    return {
        "excited_mode": Entry(
            dims, [i + 1 for i in chosen], "1", "number of a mode with much energy in the mesh"
        ),
        "excited_frequency_Hz": Entry(dims, frequency[chosen], "Hz", "its natural frequency"),
    }


def orbit_dataset(dynamics: Dynamics, sweep: Sweep) -> xr.Dataset:
    """The responses at the speed of the highest peak, of each branch that was found there.

    A branch that repeats earlier than another ends with values that are not numbers.
    """
    _, place = sweep.highest(sweep.main)
    chosen: dict[Direction, Response] = {sweep.main: sweep.responses[sweep.main][place]}
    for way, own in sweep.responses.items():
        if way not in chosen and own[place].differs(chosen[sweep.main]):
            chosen[way] = own[place]
    system = dynamics.pair.system
    cycles = max(r.periods for r in chosen.values()) // system.table.periods
    phase = _middles(dynamics.pair, cycles)
    speed = float(sweep.speeds[place])
    seconds = float(system.mesh_period(jnp.asarray(speed)))
    rates = [
        _periodic_slope(
            phase[: r.numbers.error.size] * seconds, r.numbers.error, r.periods * seconds
        )
        for r in chosen.values()
    ]
    static = jax.jit(transmission_error)(dynamics.statics.model.pair, dynamics.pair.cycle)
    padded = lambda x: np.append(x, np.full(phase.size - np.size(x), np.nan))
    rows = lambda each: np.stack([padded(x) for x in each])
    numbers = [r.numbers for r in chosen.values()]
    both, branch = ("branch", "phase"), ("branch",)
    entries = {
        "branch": Entry(branch, [WAYS[way] for way in chosen], "1", "how it was found"),
        "phase": Entry(("phase",), phase, "1", "position in the cycles, in mesh periods"),
        "mesh_force_ratio": Entry(
            both, rows(x.force for x in numbers), "1", "mesh force over the static one"
        ),
        "te_um": Entry(both, rows(x.error for x in numbers) / um, "um", "dynamic TE"),
        "te_rate_mm_s": Entry(both, rows(rates) / mm, "mm/s", "rate of the dynamic TE"),
        "te_static_um": Entry(("phase",), padded(static) / um, "um", "quasi-static TE"),
        "settled": Entry(branch, [r.settled for r in chosen.values()], "1", "whether it repeats"),
        "stable": Entry(
            branch, [r.stable for r in chosen.values()], "1", "whether a machine stays on it"
        ),
    }
    return xr.Dataset(
        {name: entry.variable() for name, entry in entries.items()}, attrs={"speed_rad_s": speed}
    )


def _periodic_slope(time: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Slope of what repeats after a period, by parabolas through neighbours."""
    around = np.concatenate([[time[-1] - period], time, [time[0] + period]])
    return np.gradient(np.concatenate([values[-1:], values, values[:1]]), around)[1:-1]
