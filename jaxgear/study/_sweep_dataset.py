"""What a sweep found as datasets, in the units of files."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxgear._dynamics._sweep_types import Direction
from jaxgear._dynamics._system import PairDynamics
from jaxgear._response._sweep_features import WAYS
from jaxgear._response._transmission import transmission_error
from jaxgear._system._model import PairModel
from jaxgear._units import MPa
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import Dynamics
from jaxgear.study._results import Entries, Entry, dataset_of, over
from jaxgear.study._statics import ROOT_NUMBERS, SolverFailure
from jaxgear.study._statics_summary import bearings_of
from jaxgear.study._sweeping import Response, Sweep

# No multiplier is below zero in size: what has none is marked so.
_UNKNOWN = -1.0
# A map of the mesh force has so many phases at the most.
_MOST_PHASES = 512
# Of the numbers of a response.
_NUMBERS = {
    "dynamic_ratio": "largest total contact force over the static one",
    "pair_ratio": "largest force on a tooth pair over the static force",
    "line_load_ratio": "largest line load over the quasi-static one",
    "contact_loss": "share of the time in which no tooth touches",
    "te_mean_um": "mean of the dynamic transmission error",
    "te_rms_um": "RMS of the dynamic transmission error about its mean",
    "te_peak_to_peak_um": "range of the dynamic transmission error",
}


def sweep_dataset(dynamics: Dynamics, sweep: Sweep) -> xr.Dataset:
    """Everything that a sweep found, over direction and speed; refused where it is not finite."""
    model, pair = dynamics.statics.model, dynamics.pair
    entries = {
        "direction": Entry(("direction",), list(sweep.responses), "1", "of the sweep"),
        "speed": Entry(("speed",), sweep.speeds, "rad/s", "speed of the pinion"),
        **_over_speeds(sweep),
        **_over_orders(sweep, model),
        **_over_roots(dynamics, sweep),
        **_over_phase(pair, sweep),
        **_over_points(sweep),
        **_excited_modes(dynamics),
    }
    dataset = dataset_of(entries).assign_attrs(
        teeth_pinion=model.pair.pinion.teeth,
        teeth_wheel=model.pair.wheel.teeth,
        torque_pinion_Nm=float(model.torque),
        mesh_periods=pair.system.table.periods,
        static_mesh_force_N=float(pair.system.force),
        peak_direction=sweep.main,
    )
    dataset["multiplier"].encoding["_FillValue"] = _UNKNOWN
    for name, values in dataset.variables.items():
        if values.dtype.kind == "f" and not np.isfinite(values.values).all():
            raise SolverFailure(f"{name} of the sweep is not a finite number everywhere")
    return dataset


def _each(sweep: Sweep, value: Callable[[Response], Any]) -> np.ndarray:
    """A value of every response, direction and speed leading."""
    return np.asarray([[value(r) for r in own] for own in sweep.responses.values()])


def _over_speeds(sweep: Sweep) -> Entries:
    numbers = {
        name: (_each(sweep, lambda r, of=name.removesuffix("_um"): getattr(r.numbers, of)), words)
        for name, words in _NUMBERS.items()
    }
    own = {
        "settled": (lambda r: r.settled, "whether it repeats"),
        "stable": (lambda r: r.stable, "whether a machine stays on it"),
        "periods": (
            lambda r: r.periods if r.settled else 0,
            "mesh periods after which it repeats; 0: it does not",
        ),
        "residual": (lambda r: r.residual, "relative imbalance, or change over a cycle"),
        "multiplier": (
            lambda r: _UNKNOWN if r.multiplier is None else r.multiplier,
            "size of Floquet's largest multiplier; -1: not known",
        ),
    }
    more = {name: (_each(sweep, value), words) for name, (value, words) in own.items()}
    return over("direction speed", **numbers, **more)


def _orders(sweep: Sweep) -> np.ndarray:
    """Orders written down: the halves between them only where a response has some."""
    amplitudes = _each(sweep, lambda r: r.numbers.te_order)
    order = 0.5 * np.arange(1, amplitudes.shape[2] + 1)
    has_halves = np.max(amplitudes[..., ::2]) > 1e-6 * np.max(amplitudes)
    return order if has_halves else order[1::2]


def _over_orders(sweep: Sweep, model: PairModel) -> Entries:
    orders = _orders(sweep)
    kept = np.rint(2.0 * orders).astype(int) - 1
    error = _each(sweep, lambda r: r.numbers.te_order[kept])
    force = _each(sweep, lambda r: r.numbers.force_order[kept])
    found = over("order", order=(orders, "order of the mesh")) | over(
        "direction speed order",
        te_order_um=(error, "amplitude of the TE"),
        mesh_force_order_N=(force, "amplitude of the mesh force along the normal"),
    )
    if not (bearings := bearings_of(model)):
        return found
    load = _each(sweep, lambda r: r.numbers.bearing_order[kept][..., :3])
    # Direction, speed, order, bearing, axis.
    load = np.moveaxis(load, 2, -1)
    whole = np.sqrt(np.sum(load**2, axis=3))
    names = [f"{gear} {index}" for gear, index in bearings]
    return (
        found
        | over("bearing", bearing=(names, "gear and number of the bearing"))
        | over("axis", axis=(list("STZ"), "direction of a load"))
        | over(
            "direction speed bearing axis order",
            bearing_load_order_N=(load, "amplitude of a bearing's load"),
        )
        | over(
            "direction speed bearing order",
            bearing_force_order_N=(
                whole,
                "amplitude of a bearing's force: root of the sum of squares over S, T, Z",
            ),
        )
    )


def _over_roots(dynamics: Dynamics, sweep: Sweep) -> Entries:
    """Stresses at the roots, where they are asked for."""
    if dynamics.statics.influences is None:
        return {}
    tension = _each(sweep, lambda r: r.numbers.root_stress)
    compression = _each(sweep, lambda r: r.numbers.root_compression)
    static = [MPa * float(dynamics.statics.numbers[name]) for name in ROOT_NUMBERS]
    return (
        over("gear", gear=(list(GEARS), "gear"))
        | over("gear", static_root_stress_MPa=(static, "largest static root stress"))
        | over(
            "direction speed gear",
            root_stress_MPa=(tension, "largest tensile stress of the roots"),
            root_compression_MPa=(
                compression,
                "largest compressive stress of the roots, on the fillets behind",
            ),
        )
    )


def _middles(dynamics: PairDynamics, cycles: int) -> np.ndarray:
    """Middles of the time steps of so many cycles [mesh periods]."""
    table = dynamics.system.table
    middles = np.asarray(table.middles)
    return np.concatenate([middles + i * table.periods for i in range(cycles)])


def _over_phase(dynamics: PairDynamics, sweep: Sweep) -> Entries:
    """The last cycle of each response, or the last two where some need them."""
    table = dynamics.system.table
    longer = _each(sweep, lambda r: r.settled and r.periods > table.periods).any()
    phase = _middles(dynamics, 2 if longer else 1)
    stride = -(-phase.size // _MOST_PHASES)

    def last(values: np.ndarray) -> np.ndarray:
        return np.tile(values, -(-phase.size // values.size))[-phase.size :][::stride]

    force = _each(sweep, lambda r: last(r.numbers.force))
    pairs = _each(sweep, lambda r: last(r.numbers.pairs))
    where = "position in the cycle or cycles, in mesh periods"
    return over("phase", phase=(phase[::stride], where)) | over(
        "direction speed phase",
        mesh_force_ratio=(force, "mesh force over the static one"),
        tooth_pairs=(pairs, "number of tooth pairs that carry"),
    )


def _over_points(sweep: Sweep) -> Entries:
    """The branch that was followed, piece after piece."""
    if not sweep.curves:
        return {}
    join = lambda name: np.concatenate([getattr(piece, name) for piece in sweep.curves])
    piece = np.concatenate([np.full(x.speed.size, i) for i, x in enumerate(sweep.curves)])
    about = "speed of the pinion along the branch"
    return {"curve_speed": Entry(("point",), join("speed"), "rad/s", about)} | over(
        "point",
        curve_piece=(piece, "number of the piece"),
        curve_dynamic_ratio=(join("dynamic_ratio"), "dynamic ratio"),
        curve_te_rms_um=(join("te_rms"), "RMS of the dynamic TE"),
        curve_multiplier=(np.abs(join("multiplier")), "size of Floquet's largest multiplier"),
        curve_stable=(join("stable"), "whether a machine stays on it"),
    )


def _excited_modes(dynamics: Dynamics) -> Entries:
    """The few modes that the mesh shakes most, for pictures to mark."""
    share, frequency = (np.asarray(x) for x in (dynamics.modes.mesh, dynamics.modes.frequency))
    most = np.argsort(-share, kind="stable")[:3]
    chosen = sorted(int(i) for i in most if share[i] >= 0.05 or i == most[0])
    numbers = [i + 1 for i in chosen]
    return over(
        "excited_mode",
        excited_mode=(numbers, "number of a mode with much energy in the mesh"),
        excited_frequency_Hz=(frequency[chosen], "its natural frequency"),
    )


def orbit_dataset(dynamics: Dynamics, sweep: Sweep) -> xr.Dataset:
    """The responses at the speed of the highest peak, of each branch that was found there.

    A branch that repeats earlier than another ends with values that are not numbers.
    """
    _, place = sweep.highest(sweep.main)
    chosen: dict[Direction, Response] = {sweep.main: sweep.responses[sweep.main][place]}
    for way, own in sweep.responses.items():
        if way not in chosen and own[place].differs(chosen[sweep.main]):
            chosen[way] = own[place]
    system, each = dynamics.pair.system, chosen.values()
    cycles = max(r.periods for r in each) // system.table.periods
    phase = _middles(dynamics.pair, cycles)
    speed = float(sweep.speeds[place])
    seconds = float(system.mesh_period(jnp.asarray(speed)))
    rates = [
        _periodic_slope(
            phase[: r.numbers.error.size] * seconds, r.numbers.error, r.periods * seconds
        )
        for r in each
    ]
    static = jax.jit(transmission_error)(dynamics.statics.model.pair, dynamics.pair.cycle)
    padded = lambda x: np.append(x, np.full(phase.size - np.size(x), np.nan))
    rows = lambda values: np.stack([padded(x) for x in values])
    entries = (
        over(
            "branch",
            branch=([WAYS[way] for way in chosen], "how it was found"),
            settled=([r.settled for r in each], "whether it repeats"),
            stable=([r.stable for r in each], "whether a machine stays on it"),
        )
        | over(
            "phase",
            phase=(phase, "position in the cycles, in mesh periods"),
            te_static_um=(padded(static), "quasi-static TE"),
        )
        | over(
            "branch phase",
            mesh_force_ratio=(
                rows(r.numbers.force for r in each),
                "mesh force over the static one",
            ),
            te_um=(rows(r.numbers.error for r in each), "dynamic TE"),
            te_rate_mm_s=(rows(rates), "rate of the dynamic TE"),
        )
    )
    return dataset_of(entries).assign_attrs(speed_rad_s=speed)


def _periodic_slope(time: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Slope of what repeats after a period, by parabolas through neighbours."""
    around = np.concatenate([[time[-1] - period], time, [time[0] + period]])
    return np.gradient(np.concatenate([values[-1:], values, values[:1]]), around)[1:-1]
