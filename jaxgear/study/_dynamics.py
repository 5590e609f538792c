"""A scene in time: its speeds, damping and method, what a sweep found, and what that means.

From the file's units to SI on the way in, back to them in the datasets on the way out.
"""

import concurrent.futures
import dataclasses
import functools
import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

import jaxgear as jg
from jaxgear._checks import require
from jaxgear._dynamics._continuation import Curve, continuation
from jaxgear._dynamics._damping import AbstractDamping, ModalDamping, RayleighDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching
from jaxgear._dynamics._modes import Modes, critical_speeds, pair_modes, rotating_frequencies
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Newmark
from jaxgear._dynamics._sweep import Direction, Finder, SweepPoint, SweepSettings
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._response._dynamic import (
    bearing_loads,
    contact_force,
    dynamic_response,
    dynamic_transmission_error,
    order_amplitudes,
    pair_forces,
)
from jaxgear._response._transmission import transmission_error
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft
from jaxgear._types import Reals
from jaxgear.plot._dynamic_tables import _FEW, _leaps
from jaxgear.scene._build import grid_of, law_of, model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._results import Entry
from jaxgear.study._running import timed
from jaxgear.study._statics import (
    SolverFailure,
    Statics,
    require_solved,
    settled_statics,
    solve_statics,
)
from jaxgear.study._turning import BodyWaves, body_waves, wave_variables, waves_summary

Summary = dict[str, Any]

# A harmonic balance of more unknowns takes longer than a march.
MOST_UNKNOWNS = 600


# --- From the scene to the library


def speeds_of(scene: Scene) -> np.ndarray:
    """Speeds of the pinion that a scene sweeps over, rising, each once [rad/s]."""
    key = "sweep.pinion_speed_rad_s"
    if scene.get(f"{key}.points") is not None:
        ends = scene[f"{key}.from"], scene[f"{key}.to"]
        return np.linspace(*ends, scene[f"{key}.points"])
    return np.unique(np.asarray(scene[key], dtype=float))


def directions_of(scene: Scene) -> tuple[Direction, ...]:
    """Directions in which a scene is swept."""
    chosen = scene["sweep.direction"]
    return ("up", "down") if chosen == "both" else (chosen,)


def damping_of(scene: Scene) -> AbstractDamping:
    """The damping of a scene; its values may be traced."""
    real = lambda key: scene[f"damping.{key}"]
    if scene["damping.kind"] == "rayleigh":
        return RayleighDamping(mass_factor=real("a_R_1_s"), stiffness_factor=real("b_R_s"))
    return ModalDamping(mesh=real("mesh"), structure=real("structure"))


def dynamic_grid_of(scene: Scene, model: PairModel) -> MeshGrid:
    """Choose the grid of a scene in time: as `grid_of`, with the time steps of [sweep]."""
    return grid_of(scene.replace({"mesh.phases": scene["sweep.steps"]}), model)


def dynamics_of(scene: Scene, model: PairModel, grid: MeshGrid | None = None) -> PairDynamics:
    """Set a scene's pair in motion.

    **Arguments:**

    - `scene`: checked against the schema; its real values may be traced, if a grid is given.
    - `model`: of the scene.
    - `grid`: its time steps; from `dynamic_grid_of` without it.

    **Returns:**

    The pair, in SI; look at `cycle.converged`.
    """
    grid = dynamic_grid_of(scene, model) if grid is None else grid
    damping, wanted = _wanted_of(scene)
    return pair_dynamics(model, grid, damping, **dict(wanted.named))


class _Wanted(eqx.Module):
    """What of a pair's motion is looked at.

    **Fields:**

    - `named`: each choice under the name that `pair_dynamics` has for it.
    """

    named: tuple[tuple[str, Any], ...] = eqx.field(static=True)


def _wanted_of(scene: Scene) -> tuple[AbstractDamping, _Wanted]:
    named = (
        ("gyroscopic", scene["model.gyroscopic"]),
        ("active_mesh_damping", scene["damping.active_mesh"]),
        ("centrifugal", scene["sweep.centrifugal"]),
        ("mesh_coordinates", scene.get("model.mesh_coordinates", 12)),
    )
    return damping_of(scene), _Wanted(named)


def _with_modes(
    model: PairModel, grid: MeshGrid, damping: AbstractDamping, wanted: _Wanted
) -> tuple[PairDynamics, Modes]:
    """A pair in motion, and its natural modes."""
    pair = pair_dynamics(model, grid, damping, **dict(wanted.named))
    return pair, pair_modes(pair)


class Size(NamedTuple):
    """What the method of a sweep is chosen by: mesh coordinates, and mesh periods in the cycle."""

    coordinates: int
    periods: int


def size_of(dynamics: PairDynamics) -> Size:
    """The size of a pair's cycle."""
    return Size(dynamics.system.vectors.shape[1], dynamics.system.table.periods)


def unknowns_of(scene: Scene, size: Size) -> int:
    """Number of unknowns of harmonic balance."""
    return size.coordinates * (2 * scene["sweep.harmonics"] * size.periods + 1)


def method_name(scene: Scene, size: Size) -> str:
    """The method of a sweep: what the scene says, or what it leaves to the program."""
    chosen = scene["sweep.method"]
    if chosen != "auto":
        return chosen
    return "harmonic" if unknowns_of(scene, size) <= MOST_UNKNOWNS else "newmark"


def settings_of(scene: Scene, size: Size) -> SweepSettings:
    """How a scene is swept.

    **Arguments:**

    - `scene`: checked against the schema.
    - `size`: of its cycle.

    **Returns:**

    The method, by harmonic balance as long as a cycle is not too long for it.
    """
    law = law_of(scene)
    cycles = max(4, -(-scene["sweep.cycles"] // size.periods))
    method: HarmonicBalance | Shooting | Marching
    match method_name(scene, size):
        case "newmark":
            method = Marching(stepper=Newmark(), law=law, cycles=cycles)
        case "shooting":
            method = Shooting(law=law)
        case _:
            method = HarmonicBalance(law=law, harmonics=scene["sweep.harmonics"])
    shooting = Shooting(law=law, warm_up=0, most_steps=10)
    return SweepSettings(method, shooting, cycles, kept=max(1, 10 // size.periods))


class Dynamics(eqx.Module):
    """A scene's pair in time.

    **Fields:**

    - `pair`: what moves, and its quasi-static cycle.
    - `modes`: natural modes with the mean mesh stiffness.
    - `statics`: the quasi-static cycle with its numbers.
    """

    pair: PairDynamics
    modes: Modes
    statics: Statics

    @property
    def damping_ratio(self) -> np.ndarray:
        """Of each mode, that of the cells in contact included [-]."""
        assert self.modes.damping_ratio is not None
        own, cells = np.asarray(self.modes.damping_ratio), self.pair.system.cell_damping
        if cells is None:
            return own
        omega = 2.0 * np.pi * np.asarray(self.modes.frequency)
        return own + 0.5 * float(cells) * omega * np.asarray(self.modes.mesh)


def solve_dynamics(scene: Scene) -> Dynamics:
    """Solve the quasi-static cycle of a scene, and find what its dynamics are made of.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    Pair, modes and statics.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a phase was not solved.
    """
    model = model_of(scene)
    grid = dynamic_grid_of(scene, model)
    pair, modes = timed(_with_modes, model, grid, *_wanted_of(scene), options=QUICKLY)
    require_solved(pair.cycle.converged)
    if scene["mesh.contact"] == "exact" and not scene.get("mesh.pinion_speed_rad_s"):
        statics = settled_statics(model, grid, ExactContact(), pair.cycle)
    else:
        # The dynamics are built on the exact cycle at vanishing speed; what is reported is the one
        # asked for.
        statics = solve_statics(scene)
    return Dynamics(pair=pair, modes=modes, statics=statics)


def require_damped(scene: Scene, dynamics: Dynamics) -> None:
    """Refuse to sweep through the resonance of a mode that the mesh excites and nothing damps.

    **Arguments:**

    - `scene`: that is swept.
    - `dynamics`: its pair.

    **Raises:**

    - `InputError` naming the mode.
    """
    excited = np.asarray(dynamics.modes.mesh) > 1e-3
    bare = np.nonzero(excited & (dynamics.damping_ratio < 1e-9))[0]
    which = int(bare[0]) if bare.size else 0
    require(
        not bare.size,
        "no damping: at a resonance there is no steady response, and nothing damps mode {mode} at "
        "{frequency:.4g} Hz, which has {share:.3g} of its energy in the mesh. Raise damping.{key}.",
        mode=which + 1,
        frequency=float(dynamics.modes.frequency[which]),
        share=float(dynamics.modes.mesh[which]),
        key="mesh" if scene["damping.kind"] == "modal" else "b_R_s",
    )


# --- What one response is


@dataclasses.dataclass(frozen=True)
class Response:
    """A response at one speed, and the point of the sweep in numbers.

    `numbers` are those of `_measure`, in SI; `periods` is the length of the series in mesh
    periods, after which the response repeats if it has settled. `multiplier` is the largest
    of Floquet's, or `None` where none is known.
    """

    speed: float
    settled: bool
    stable: bool
    periods: int
    residual: float
    multiplier: float | None
    numbers: dict[str, np.ndarray]


# A tooth pair carries from this share of the static force on: a pair that only just enters has
# cells of hardly any length.
_CARRIES = 1e-6


def _measure(
    dynamics: PairDynamics, orbit: Orbit, law: AbstractContactLaw, orders: int
) -> dict[str, Array]:
    """The numbers of a response, in SI; traceable by JAX."""
    system = dynamics.system
    found = dynamic_response(dynamics, orbit, 1, law)
    force, error = contact_force(system, orbit), dynamic_transmission_error(system, orbit)
    series = {"te_order": error, "force_order": force}
    series["bearing_order"] = bearing_loads(dynamics, orbit)
    carrying = pair_forces(dynamics, orbit, law) > _CARRIES * system.force
    return {
        "dynamic_ratio": found.dynamic_ratio,
        "pair_ratio": found.pair_ratio,
        "line_load_ratio": found.line_load_ratio,
        "te_mean": found.te_mean,
        "te_rms": found.te_rms,
        "te_peak_to_peak": found.te_peak_to_peak,
        "contact_loss": found.contact_loss,
        "force": force / system.force,
        "error": error,
        "pairs": jnp.sum(carrying, axis=1, dtype=int),
        **{name: _half_orders(dynamics, values, orders) for name, values in series.items()},
    }


def _half_orders(dynamics: PairDynamics, values: Reals, count: int) -> Reals:
    """Amplitudes at half orders of the mesh frequency; zero where the response has none."""
    system = dynamics.system
    periods = values.shape[0] // len(system.table.kinds) * system.table.periods
    if periods % 2 == 0:
        return order_amplitudes(system, values, 2 * count, first=0.5)
    whole = order_amplitudes(system, values, count)
    return jnp.zeros((2 * count, *whole.shape[1:])).at[1::2].set(whole)


_measured = jax.jit(_measure, static_argnums=3)


def swept(
    scene: Scene,
    dynamics: PairDynamics,
    speeds: np.ndarray,
    direction: Direction,
    done: Callable[[int], None],
    watch: "Watch | None" = None,
) -> tuple[Response, ...]:
    """Sweep in one direction, and keep of each response what is shown of it.

    **Arguments:**

    - `scene`: that is swept.
    - `dynamics`: its pair.
    - `speeds`: of the pinion, rising [rad/s].
    - `direction`: which way.
    - `done`: told how many more speeds are finished.
    - `watch`: sees each response whole, and adds to its numbers.

    **Returns:**

    A response for each of `speeds`.

    **Raises:**

    - `SolverFailure` if one is not a finite number.
    """
    # Responses of many mesh periods are too long to keep them all until the end.
    finder = Finder(dynamics.system, settings_of(scene, size_of(dynamics)))
    found: list[Response] = []
    last = None
    for speed in speeds[::-1] if direction == "down" else speeds:
        point = finder.next(jnp.asarray(float(speed)), last)
        response = _response(scene, dynamics, float(speed), point)
        if watch is not None:
            more = watch(direction, point, float(response.numbers["dynamic_ratio"]))
            response = dataclasses.replace(response, numbers=response.numbers | more)
        found.append(response)
        last = None if direction == "cold" else point
        done(1)
    return tuple(found[::-1] if direction == "down" else found)


def _response(scene: Scene, dynamics: PairDynamics, speed: float, point: SweepPoint) -> Response:
    numbers = jax.device_get(_measured(dynamics, point.orbit, law_of(scene), scene["sweep.orders"]))
    residual = float(point.orbit.residual)
    if not all(np.isfinite(x).all() for x in (residual, *numbers.values())):
        other = "shooting" if scene["sweep.method"] == "newmark" else "newmark"
        raise SolverFailure(
            f"the response at {speed:.6g} rad/s is not a finite number. Raise sweep.steps, write "
            f'sweep.method = "{other}", or leave this speed out.'
        )
    sizes = np.abs(point.multipliers)
    return Response(
        speed=speed,
        settled=point.settled,
        stable=point.stable,
        periods=point.multiple * dynamics.system.table.periods,
        residual=residual,
        multiplier=float(sizes.max()) if sizes.size else None,
        numbers=numbers,
    )


# Direction, response and dynamic ratio to further numbers, in SI.
Watch = Callable[[Direction, SweepPoint, float], dict[str, np.ndarray]]

_WAYS: dict[Direction, str] = {
    "up": "speed rising",
    "down": "speed falling",
    "cold": "each speed by itself",
}


@dataclasses.dataclass(frozen=True)
class Sweep:
    """All that a sweep found: responses of each direction over the same rising `speeds`.

    `curves` are pieces of the branch that was followed round its folds; `seconds` is what each
    part took, compilation included.
    """

    speeds: np.ndarray
    responses: dict[Direction, tuple[Response, ...]]
    curves: tuple[Curve, ...]
    seconds: dict[str, float]

    @property
    def main(self) -> Direction:
        """The direction with the highest peak, of settled responses if there are any."""
        # Rounding must not choose between directions that found the same.
        rank = lambda way: (self.highest(way)[0][0], round(self.highest(way)[0][1], 3))
        return max(self.responses, key=rank)

    def highest(self, way: Direction) -> tuple[tuple[bool, float], int]:
        """Whether it settled, dynamic ratio, and place of the highest response of a direction."""
        each = [(r.settled, float(r.numbers["dynamic_ratio"])) for r in self.responses[way]]
        best = max(range(len(each)), key=each.__getitem__)
        return each[best], best

    @property
    def unsettled(self) -> int:
        """Number of responses that did not settle."""
        return sum(not r.settled for own in self.responses.values() for r in own)


def branches(
    scene: Scene, dynamics: PairDynamics, speeds: np.ndarray, done: Callable[[int], None]
) -> tuple[Curve, ...]:
    """Follow the branch of responses from the lowest speed to the highest, round its folds.

    Where it is lost on the way, what can be reached from the other end is a second piece.

    **Arguments:**

    - `scene`: that is swept.
    - `dynamics`: its pair.
    - `speeds`: of the pinion [rad/s].
    - `done`: told how many more points are found.

    **Returns:**

    The pieces; none where no response is found to begin with.
    """
    method = settings_of(scene, size_of(dynamics)).method
    assert isinstance(method, HarmonicBalance)
    follow = lambda start, stop: continuation(
        dynamics.system, start, stop, method=method, done=done
    )
    low, high = float(speeds[0]), float(speeds[-1])
    pieces = [follow(low, high)]
    if not pieces[0].speed.size or pieces[0].ends[1] not in ("left", "most points"):
        pieces.append(follow(high, low))
    return tuple(piece for piece in pieces if piece.speed.size)


def continued(scene: Scene, dynamics: PairDynamics) -> bool:
    """Whether the branch is followed round its folds."""
    asked = scene.get("sweep.continuation", scene["sweep.direction"] == "both")
    return (
        asked and method_name(scene, size_of(dynamics)) == "harmonic" and len(speeds_of(scene)) > 1
    )


def sweep_of(
    scene: Scene,
    dynamics: PairDynamics,
    done: Callable[[int], None],
    watch: Watch | None = None,
) -> Sweep:
    """Sweep a scene in all its directions, and follow its branch.

    **Arguments:**

    - `scene`: with a table [sweep].
    - `dynamics`: its pair.
    - `done`: told how many more speeds are finished.
    - `watch`: sees each response whole, and adds to its numbers.

    **Returns:**

    What was found.

    **Raises:**

    - `SolverFailure` if a response is not a finite number.
    """
    speeds, seconds = speeds_of(scene), {}
    responses: dict[Direction, tuple[Response, ...]] = {}
    stopped = False

    def going_on(count: int) -> None:
        del count
        if stopped:
            raise InterruptedError

    def timed(name: str, work: Callable[[], Any]) -> Any:
        start = time.perf_counter()
        found = work()
        seconds[name] = time.perf_counter() - start
        return found

    # Most of the time goes into compiling, and both have programs of their own.
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        follow = lambda: branches(scene, dynamics, speeds, going_on)
        curves = pool.submit(timed, "continuation", follow) if continued(scene, dynamics) else None
        try:
            for way in directions_of(scene):
                responses[way] = timed(
                    way, functools.partial(swept, scene, dynamics, speeds, way, done, watch)
                )
        except BaseException:
            stopped = True
            raise
    return Sweep(speeds, responses, curves.result() if curves else (), seconds)


# --- Datasets


def sweep_dataset(dynamics: PairDynamics, model: PairModel, sweep: Sweep) -> xr.Dataset:
    """Collect everything that a sweep found.

    **Arguments:**

    - `dynamics`: the pair.
    - `model`: that it was built from.
    - `sweep`: what was found.

    **Returns:**

    A dataset over direction and speed, in the units of files.
    """
    variables = _over_speeds(sweep) | _over_orders(sweep, model) | _over_phase(dynamics, sweep)
    variables |= _over_points(sweep)
    about = {"units": "rad/s", "long_name": "speed of the pinion"}
    coords: dict[str, Any] = {
        "direction": list(sweep.responses),
        "speed": ("speed", sweep.speeds, about),
        "order": ("order", _orders(sweep), {"units": "1", "long_name": "order of the mesh"}),
        "phase": (
            "phase",
            _phases(dynamics, sweep),
            {"units": "1", "long_name": "position in the cycle or cycles, in mesh periods"},
        ),
    }
    if "bearing_force_order_N" in variables:
        coords |= {"bearing": bearing_names(model), "axis": list("STZ")}
    dataset = xr.Dataset(
        {name: entry.variable() for name, entry in variables.items()},
        coords=coords,
        attrs={
            "teeth_pinion": model.pair.pinion.teeth,
            "teeth_wheel": model.pair.wheel.teeth,
            "torque_pinion_Nm": float(model.torque),
            "mesh_periods": dynamics.system.table.periods,
            "static_mesh_force_N": float(dynamics.system.force),
        },
    )
    # No multiplier is below zero in size: what has none is marked so.
    dataset["multiplier"].encoding["_FillValue"] = _UNKNOWN
    for name, values in dataset.variables.items():
        if values.dtype.kind == "f" and not np.isfinite(values.values).all():
            raise SolverFailure(f"{name} of the sweep is not a finite number everywhere")
    return dataset


_UNKNOWN = -1.0
_PLACE = ("direction", "speed")


def _each(sweep: Sweep, value: Callable[[Response], Any]) -> np.ndarray:
    """A value of every response, direction and speed leading."""
    return np.asarray([[value(r) for r in own] for own in sweep.responses.values()])


def _over_speeds(sweep: Sweep) -> dict[str, Entry]:
    about = {
        "dynamic_ratio": ("dynamic_ratio", "1", "largest total contact force over the static one"),
        "pair_ratio": ("pair_ratio", "1", "largest force on a tooth pair over the static force"),
        "line_load_ratio": ("line_load_ratio", "1", "largest line load over the quasi-static one"),
        "contact_loss": ("contact_loss", "1", "share of the time in which no tooth touches"),
        "te_mean_um": ("te_mean", "um", "mean of the dynamic transmission error"),
        "te_rms_um": ("te_rms", "um", "RMS of the dynamic transmission error about its mean"),
        "te_peak_to_peak_um": ("te_peak_to_peak", "um", "range of the dynamic transmission error"),
    }
    found = {}
    for name, (key, unit, words) in about.items():
        scale = jg.um if unit == "um" else 1.0
        values = _each(sweep, lambda r, key=key: r.numbers[key]) / scale
        found[name] = Entry(_PLACE, values, unit, words)
    multiplier = _each(sweep, lambda r: _UNKNOWN if r.multiplier is None else r.multiplier)
    periods = _each(sweep, lambda r: r.periods if r.settled else 0)
    return found | {
        "settled": Entry(_PLACE, _each(sweep, lambda r: r.settled), "1", "whether it repeats"),
        "stable": Entry(
            _PLACE, _each(sweep, lambda r: r.stable), "1", "whether a machine stays on it"
        ),
        "periods": Entry(
            _PLACE, periods, "1", "mesh periods after which it repeats; 0: it does not"
        ),
        "residual": Entry(
            _PLACE,
            _each(sweep, lambda r: r.residual),
            "1",
            "relative imbalance, or change over a cycle",
        ),
        "multiplier": Entry(
            _PLACE, multiplier, "1", "size of Floquet's largest multiplier; -1: not known"
        ),
    }


def _orders(sweep: Sweep) -> np.ndarray:
    """Orders written down: the halves between them only where a response has some."""
    count = next(iter(sweep.responses.values()))[0].numbers["te_order"].shape[0]
    order = 0.5 * np.arange(1, count + 1)
    amplitudes = _each(sweep, lambda r: r.numbers["te_order"])
    has_halves = np.max(amplitudes[..., ::2]) > 1e-6 * np.max(amplitudes)
    return order if has_halves else order[1::2]


def _over_orders(sweep: Sweep, model: PairModel) -> dict[str, Entry]:
    kept = np.rint(2.0 * _orders(sweep)).astype(int) - 1
    dims = (*_PLACE, "order")
    take = lambda name: _each(sweep, lambda r: r.numbers[name][kept])
    found = {
        "te_order_um": Entry(dims, take("te_order") / jg.um, "um", "amplitude of the TE"),
        "mesh_force_order_N": Entry(
            dims, take("force_order"), "N", "amplitude of the mesh force along the normal"
        ),
    }
    if bearing_names(model):
        # Direction, speed, order, bearing, axis.
        load = np.moveaxis(take("bearing_order")[..., :3], 2, -1)
        found["bearing_load_order_N"] = Entry(
            (*_PLACE, "bearing", "axis", "order"), load, "N", "amplitude of a bearing's load"
        )
        found["bearing_force_order_N"] = Entry(
            (*_PLACE, "bearing", "order"),
            np.sqrt(np.sum(load**2, axis=3)),
            "N",
            "amplitude of a bearing's force: root of the sum of squares over S, T, Z",
        )
    return found


def bearing_names(model: PairModel) -> list[str]:
    """Names of the bearings in the order of the scene, the pinion's first."""
    mounts = zip(GEARS, (model.pinion_support, model.wheel_support), strict=True)
    return [
        f"{gear} {index}"
        for gear, mount in mounts
        if isinstance(mount, Shaft)
        for index in range(len(mount.bearings))
    ]


# A map of the mesh force has so many phases at the most.
_MOST_PHASES = 512


def _cycles(dynamics: PairDynamics, sweep: Sweep) -> tuple[int, int]:
    """Number of cycles that a map of the mesh force shows, and of steps from column to column."""
    table = dynamics.system.table
    long = any(
        r.settled and r.periods > table.periods for own in sweep.responses.values() for r in own
    )
    cycles = 2 if long else 1
    return cycles, -(-cycles * len(table.kinds) // _MOST_PHASES)


def _phases(dynamics: PairDynamics, sweep: Sweep) -> np.ndarray:
    """Middles of the steps that a map of the mesh force shows [mesh periods]."""
    cycles, stride = _cycles(dynamics, sweep)
    table = dynamics.system.table
    middles = np.asarray(table.middles)
    return np.concatenate([middles + i * table.periods for i in range(cycles)])[::stride]


def _over_phase(dynamics: PairDynamics, sweep: Sweep) -> dict[str, Entry]:
    """The last cycle of each response, or the last two where some need them."""
    cycles, stride = _cycles(dynamics, sweep)
    steps = cycles * len(dynamics.system.table.kinds)
    dims = (*_PLACE, "phase")

    def last(name: str) -> np.ndarray:
        of = lambda values: np.tile(values, -(-steps // values.size))[-steps:][::stride]
        return _each(sweep, lambda r: of(r.numbers[name]))

    return {
        "mesh_force_ratio": Entry(dims, last("force"), "1", "mesh force over the static one"),
        "tooth_pairs": Entry(dims, last("pairs"), "1", "number of tooth pairs that carry"),
    }


def _over_points(sweep: Sweep) -> dict[str, Entry]:
    """The branch that was followed, piece after piece."""
    if not sweep.curves:
        return {}
    join = lambda name: np.concatenate([getattr(piece, name) for piece in sweep.curves])
    piece = np.concatenate([np.full(x.speed.size, i) for i, x in enumerate(sweep.curves)])
    dims = ("point",)
    return {
        "curve_piece": Entry(dims, piece, "1", "number of the piece"),
        "curve_speed": Entry(dims, join("speed"), "rad/s", "speed of the pinion along the branch"),
        "curve_dynamic_ratio": Entry(dims, join("dynamic_ratio"), "1", "dynamic ratio"),
        "curve_te_rms_um": Entry(dims, join("te_rms") / jg.um, "um", "RMS of the dynamic TE"),
        "curve_multiplier": Entry(
            dims, np.abs(join("multiplier")), "1", "size of Floquet's largest multiplier"
        ),
        "curve_stable": Entry(dims, join("stable"), "1", "whether a machine stays on it"),
    }


def drawn_sweep(dataset: xr.Dataset) -> xr.Dataset:
    """A sweep as its picture wants it: pieces of the branch parted by points that are no numbers.

    **Arguments:**

    - `dataset`: from `sweep_dataset`.

    **Returns:**

    The variables over direction, speed and point. Cycles of several mesh periods count as one
    period, or each response would be marked as of many.
    """
    found = dataset.drop_dims(["order", "phase", "bearing", "axis"], errors="ignore")
    found["periods"] = found["periods"].where(found["periods"] != dataset.attrs["mesh_periods"], 1)
    if "curve_piece" not in found:
        return found
    names = [str(name) for name, values in found.items() if "point" in values.dims]
    curve = found[names]
    parts = []
    for which in np.unique(curve["curve_piece"].values):
        part = curve.isel(point=curve["curve_piece"].values == which)
        gap = part.isel(point=[-1]).copy(deep=True)
        for number in ("speed", "dynamic_ratio", "te_rms_um"):
            gap[f"curve_{number}"][:] = np.nan
        parts += [part, gap]
    joined = xr.concat(parts[:-1], "point")
    return found.drop_dims("point").assign({name: joined[name] for name in names})


def orbit_dataset(dynamics: PairDynamics, model: PairModel, sweep: Sweep) -> xr.Dataset:
    """The responses at the speed of the highest peak, of each branch that was found there.

    **Arguments:**

    - `dynamics`: the pair.
    - `model`: that it was built from.
    - `sweep`: what was found.

    **Returns:**

    A dataset over branch and phase, as the picture of orbits wants it.
    """
    _, place = sweep.highest(sweep.main)
    chosen: dict[Direction, Response] = {sweep.main: sweep.responses[sweep.main][place]}
    for way, own in sweep.responses.items():
        if way not in chosen and _differ(own[place], chosen[sweep.main]):
            chosen[way] = own[place]
    table = dynamics.system.table
    longest = max(r.periods for r in chosen.values()) // table.periods
    middles = np.asarray(table.middles)
    phase = np.concatenate([middles + i * table.periods for i in range(longest)])
    rows = {name: [] for name in ("mesh_force_ratio", "te_um", "te_rate_mm_s")}
    for r in chosen.values():
        force, error = r.numbers["force"], r.numbers["error"]
        seconds = float(dynamics.system.mesh_period(jnp.asarray(r.speed)))
        rate = _periodic_slope(phase[: error.size] * seconds, error, r.periods * seconds)
        values = force, error / jg.um, rate / jg.mm
        for name, series in zip(rows, values, strict=True):
            rows[name].append(np.append(series, np.full(phase.size - series.size, np.nan)))
    static = np.asarray(jax.jit(transmission_error)(model.pair, dynamics.cycle)) / jg.um
    variables: dict[str, Any] = {
        name: (("branch", "phase"), np.stack(x)) for name, x in rows.items()
    }
    variables |= {
        "te_static_um": ("phase", np.append(static, np.full(phase.size - static.size, np.nan))),
        "settled": ("branch", [r.settled for r in chosen.values()]),
        "stable": ("branch", [r.stable for r in chosen.values()]),
    }
    return xr.Dataset(variables, {"branch": [_WAYS[way] for way in chosen], "phase": phase})


def _periodic_slope(time: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Slope of what repeats after a period, by parabolas through neighbours."""
    around = np.concatenate([[time[-1] - period], time, [time[0] + period]])
    return np.gradient(np.concatenate([values[-1:], values, values[:1]]), around)[1:-1]


def modes_dataset(dynamics: Dynamics, count: int, waves: BodyWaves | None = None) -> xr.Dataset:
    """The first modes, and where their energy is.

    **Arguments:**

    - `dynamics`: the pair.
    - `count`: number of modes.
    - `waves`: of its condensed bodies, or `None`: it has none.

    **Returns:**

    A dataset over mode and part, in the units of files.
    """
    energy = {name: values[:count] for name, values in energies(dynamics.modes).items()}
    shown = [name for name in _PARTS if name == "mesh" or np.max(energy[name]) > 0.0]
    entries = {
        "frequency_Hz": Entry(
            ("mode",), np.asarray(dynamics.modes.frequency)[:count], "Hz", "natural frequency"
        ),
        "energy": Entry(
            ("mode", "part"),
            np.stack([energy[name] for name in shown], axis=1),
            "1",
            "share of the strain energy",
        ),
        "damping_ratio": Entry(
            ("mode",), dynamics.damping_ratio[:count], "1", "ratio to critical damping"
        ),
    }
    variables = {name: entry.variable() for name, entry in entries.items()}
    if waves is not None:
        variables |= wave_variables(waves)
    return xr.Dataset(variables, coords={"part": shown})


_PARTS = ("mesh", "pinion", "wheel", "bearings")


def energies(modes: Modes) -> dict[str, np.ndarray]:
    """Shares of the strain energy: mesh, each gear with its shaft, bearings; the last also apart.

    **Arguments:**

    - `modes`: of a pair.

    **Returns:**

    Shares of each mode, without rounding below zero [-].
    """
    share = lambda name: np.clip(np.asarray(modes.share(name)), 0.0, 1.0)
    bearings = {f"{gear}_bearings": share(f"{gear} bearings") for gear in GEARS}
    return {
        "mesh": share("mesh"),
        **{gear: share(f"{gear} shaft") for gear in GEARS},
        "bearings": sum(bearings.values(), np.zeros(())),
        **bearings,
    }


def highest_speed(scene: Scene, frequency: np.ndarray, teeth: int) -> float:
    """Up to which speed of the pinion modes are shown [rad/s].

    **Arguments:**

    - `scene`: gives the speeds, if it has any.
    - `frequency`: natural frequencies that are shown [Hz].
    - `teeth`: of the pinion.
    """
    if scene.has_table("sweep"):
        return float(speeds_of(scene)[-1])
    # Up to where the mesh frequency itself meets the last of these modes.
    return 1.05 * 2.0 * np.pi * float(frequency[-1]) / teeth


def waves_of(
    scene: Scene, dynamics: Dynamics, teeth: int, count: int, harmonics: int
) -> BodyWaves | None:
    """Waves of a scene's condensed bodies, at rest and over speed, or `None`: it has none.

    Arguments as for `campbell_dataset`.
    """
    if not dynamics.pair.bodies:
        return None
    highest = highest_speed(scene, np.asarray(dynamics.modes.frequency)[:count], teeth)
    return body_waves(scene, dynamics.pair, dynamics.modes, highest, count, harmonics)


def campbell_dataset(
    scene: Scene, dynamics: Dynamics, teeth: int, count: int, harmonics: int
) -> xr.Dataset:
    """Natural frequencies over speed, split by gyroscopic moments where the scene has them.

    Those of condensed bodies are in `waves_of`.

    **Arguments:**

    - `scene`: gives the speeds, if it has any.
    - `dynamics`: the pair.
    - `teeth`: of the pinion.
    - `count`: number of modes.
    - `harmonics`: of the mesh frequency.

    **Returns:**

    A dataset over speed and mode, as the picture wants it.
    """
    frequency = np.asarray(dynamics.modes.frequency)[:count]
    highest = highest_speed(scene, frequency, teeth)
    speeds, system = np.linspace(0.0, highest, 121), dynamics.pair.system
    data: dict[str, Any] = {}
    if system.gyroscopic is None:
        data["frequency_Hz"] = np.tile(frequency, (speeds.size, 1))
        # Turning, modes mix, and these are the shares at rest.
        data["mesh_energy"] = np.tile(energies(dynamics.modes)["mesh"][:count], (speeds.size, 1))
    else:
        data["frequency_Hz"] = rotating_frequencies(
            system.mass,
            system.whole_stiffness,
            system.gyroscopic,
            system.free,
            jnp.asarray(speeds),
        )[:, :count]
    return xr.Dataset(
        {name: (("speed", "mode"), values) for name, values in data.items()},
        {"speed": ("speed", speeds, {"units": "rad/s", "long_name": "speed of the pinion"})},
        {"teeth_pinion": teeth, "harmonics": harmonics},
    )


# --- What a reader wants to know


def modes_shown(scene: Scene, frequency: np.ndarray) -> int:
    """Number of modes that a scene wants to see, at least one."""
    highest, count = scene.get("modes.highest_Hz"), scene.get("modes.count")
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


def modes_summary(
    scene: Scene, dynamics: Dynamics, teeth: int, count: int, waves: BodyWaves | None = None
) -> Summary:
    """The `modes` part of the summary."""
    frequency = dynamics.modes.frequency[:count]
    harmonics = range(1, scene["modes.harmonics"] + 1)
    critical = np.asarray(critical_speeds(frequency, teeth, tuple(harmonics)))
    return {
        "frequency_Hz": np.asarray(frequency),
        "damping_ratio": dynamics.damping_ratio[:count],
        "energy": {name: values[:count] for name, values in energies(dynamics.modes).items()},
        "critical_speed_rad_s": {f"mesh_harmonic_{h}": critical[:, h - 1] for h in harmonics},
        "crossing": np.asarray(dynamics.modes.crossing)[:count],
        "total": int(dynamics.modes.frequency.size),
    } | ({} if waves is None else waves_summary(waves))


def damping_summary(scene: Scene, dynamics: Dynamics) -> Summary:
    """Kind of damping, and what it makes of the first modes."""
    count = min(12, dynamics.damping_ratio.size)
    return {
        "kind": scene["damping.kind"],
        "active_mesh": scene["damping.active_mesh"],
        "frequency_Hz": np.asarray(dynamics.modes.frequency)[:count],
        "ratios": dynamics.damping_ratio[:count],
    }


def sweep_summary(scene: Scene, dynamics: Dynamics, sweep: Sweep, dataset: xr.Dataset) -> Summary:
    """The `sweep` part of the summary.

    **Arguments:**

    - `scene`: that was swept.
    - `dynamics`: its pair.
    - `sweep`: what was found.
    - `dataset`: of the sweep.

    **Returns:**

    Numbers and lists, with units in their keys; lists are over `pinion_speed_rad_s`.
    """
    found: Summary = {"pinion_speed_rad_s": sweep.speeds}
    columns = {
        "dynamic_ratio": "dynamic_ratio",
        "te_rms_um": "te_rms_um",
        "pair_ratio": "pair_ratio",
        "contact_loss": "contact_loss",
        "settled": "settled",
        "stable": "stable",
        "periods": "periods",
    }
    for way in sweep.responses:
        own = dataset.sel(direction=way)
        found |= {f"{key}_{way}": own[name].values for key, name in columns.items()}
    special = lambda name: sorted(
        point.speed for piece in sweep.curves for point in getattr(piece, name)
    )
    pair = dynamics.pair
    return found | {
        "peaks": peaks(dynamics, sweep, dataset),
        "jumps": jumps(dataset),
        "bistable": bistable(dataset),
        "folds_rad_s": special("folds"),
        "doublings_rad_s": special("doublings"),
        "tori_rad_s": special("tori"),
        "unsettled_count": sweep.unsettled,
        "method": method_name(scene, size_of(pair)),
        "steps": scene["sweep.steps"],
        "unknowns": unknowns_of(scene, size_of(pair)),
        "seconds_with_compiling": sweep.seconds,
    }


# A peak stands out by this much of the static force.
_PROMINENCE = 0.05


def peaks(dynamics: Dynamics, sweep: Sweep, dataset: xr.Dataset) -> list[Summary]:
    """Peaks of the dynamic ratio, the highest first, with the mesh order that is strongest there.

    A peak that rising and falling speeds share has the direction "both".

    **Arguments:**

    - `dynamics`: the pair.
    - `sweep`: what was found.
    - `dataset`: of the sweep.

    **Returns:**

    One table each.
    """
    natural = _excited(dynamics, 0.01)
    teeth = int(dataset.attrs["teeth_pinion"])
    found: list[Summary] = []
    for way in sweep.responses:
        own = dataset.sel(direction=way)
        own = own.isel(speed=own["settled"].values)
        ratio = own["dynamic_ratio"].values
        for place in prominent(ratio, _PROMINENCE):
            here = own.isel(speed=int(place))
            speed, high = float(here["speed"]), float(ratio[place])
            twin = [row for row in found if row["speed_rad_s"] == speed]
            if twin and _alike(twin[0]["dynamic_ratio"], high):
                twin[0]["direction"] = "both"
                continue
            strongest = int(np.argmax(here["mesh_force_order_N"].values))
            order = float(here["order"][strongest])
            frequency = order * teeth * speed / (2.0 * np.pi)
            nearest = natural[np.argmin(np.abs(natural - frequency))]
            found.append(
                {
                    "speed_rad_s": speed,
                    "dynamic_ratio": high,
                    "direction": str(way),
                    "frequency_Hz": frequency,
                    "nearest_mode_Hz": float(nearest),
                    "mesh_order": order,
                }
            )
    return sorted(found, key=lambda row: -row["dynamic_ratio"])


def prominent(values: np.ndarray, least: float) -> list[int]:
    """Inner maxima that stand so high above the higher of the lowest values on their two sides.

    A side ends where something is higher. `scipy.signal.find_peaks` takes a second to import.

    **Arguments:**

    - `values`: shape `[place]`.
    - `least`: prominence, in the unit of the values.

    **Returns:**

    Their places; of equal values side by side the first.
    """

    def lowest(side: np.ndarray, top: float) -> float:
        higher = np.flatnonzero(side > top)
        return float(np.min(side[: higher[0]] if higher.size else side))

    return [
        place
        for place, top in enumerate(values[1:-1], start=1)
        if values[place - 1] < top >= values[place + 1]
        and top - max(lowest(values[place::-1], top), lowest(values[place:], top)) >= least
    ]


def _excited(dynamics: Dynamics, least: float) -> np.ndarray:
    """Natural frequencies of the modes with so much energy in the mesh, or of that with most."""
    share = np.asarray(dynamics.modes.mesh)
    return np.asarray(dynamics.modes.frequency)[share >= min(least, float(share.max()))]


def jumps(dataset: xr.Dataset) -> list[Summary]:
    """Where a direction leaps from one settled response to the next.

    **Arguments:**

    - `dataset`: of a sweep.

    **Returns:**

    One table each; none in sweeps of so few speeds that each is shown.
    """
    found = []
    for way in ("up", "down") if dataset.sizes["speed"] > _FEW else ():
        if way not in dataset["direction"].values:
            continue
        own = dataset.sel(direction=way)
        own = own.isel(speed=own["settled"].values)
        speed, ratio = own["speed"].values, own["dynamic_ratio"].values
        leaps = _leaps(ratio, np.ones(ratio.size, bool), float(np.max(ratio, initial=0.0)))
        for place in np.sort(leaps):
            ends = [int(place), int(place) + 1][:: -1 if way == "down" else 1]
            found.append(
                {
                    "direction": way,
                    "from_rad_s": float(speed[ends[0]]),
                    "to_rad_s": float(speed[ends[1]]),
                    "dynamic_ratio_before": float(ratio[ends[0]]),
                    "dynamic_ratio_after": float(ratio[ends[1]]),
                }
            )
    return found


# Settled responses whose dynamic ratios differ by more than this, relative to them, are two.
_SAME = 1e-3


def _differ(first: Response, second: Response) -> bool:
    a, b = (float(r.numbers["dynamic_ratio"]) for r in (first, second))
    return first.settled and second.settled and not _alike(a, b)


def _alike(first: float, second: float) -> bool:
    return abs(first - second) <= _SAME * max(first, second)


def bistable(dataset: xr.Dataset) -> list[Summary]:
    """Ranges of speed with two stable responses: one rising, another falling.

    **Arguments:**

    - `dataset`: of a sweep.

    **Returns:**

    First and last speed of each range.
    """
    if set(dataset["direction"].values) != {"up", "down"}:
        return []
    up, down = (dataset["dynamic_ratio"].sel(direction=way).values for way in ("up", "down"))
    apart = dataset["settled"].values.all(axis=0) & (
        np.abs(up - down) > _SAME * np.maximum(up, down)
    )
    speed, found = dataset["speed"].values, []
    for two, places in itertools.groupby(range(len(speed)), key=lambda i: bool(apart[i])):
        own = list(places)
        if two:
            found.append({"from_rad_s": float(speed[own[0]]), "to_rad_s": float(speed[own[-1]])})
    return found


def marked(
    dynamics: Dynamics, teeth: int
) -> tuple[list[tuple[float, str]], list[tuple[float, str]]]:
    """What pictures of a sweep mark: critical speeds and natural frequencies.

    **Arguments:**

    - `dynamics`: the pair.
    - `teeth`: of the pinion.

    **Returns:**

    Speeds [rad/s] and frequencies [Hz] with their names, of the few modes that the mesh shakes
    most; speeds for the first three harmonics of the mesh frequency.
    """
    share, frequency = (np.asarray(x) for x in (dynamics.modes.mesh, dynamics.modes.frequency))
    most = np.argsort(-share, kind="stable")[:3]
    chosen = sorted(int(i) for i in most if share[i] >= 0.05 or i == most[0])
    natural = [(float(frequency[i]), f"mode {i + 1}") for i in chosen]
    critical = [
        (2.0 * np.pi * f / (teeth * h), name if h == 1 else f"{name} / {h}")
        for (f, name), h in itertools.product(natural, (1, 2, 3))
    ]
    return critical, natural


def way_of(sweep: Sweep) -> str:
    """The words for the direction with the highest peak; empty where there is but one."""
    return f", {_WAYS[sweep.main]}" if len(sweep.responses) > 1 else ""


def pieces_lost(sweep: Sweep) -> Iterator[str]:
    """Why a branch could not be followed to its end, if it could not."""
    for piece in sweep.curves:
        if piece.ends[1] in ("lost", "most points"):
            yield f"{piece.ends[1]} at {piece.speed[-1]:.5g} rad/s"
