"""A scene in time: its speeds, damping and method, and its pair in motion.

From the file's units to SI; what a sweep does is in `_sweeping`.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxgear._checks import require
from jaxgear._dynamics._damping import AbstractDamping, ModalDamping, RayleighDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._harmonic_problem import is_long
from jaxgear._dynamics._march import TimeStepping
from jaxgear._dynamics._modes import Modes, pair_modes
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Newmark
from jaxgear._dynamics._sweep_types import SweepSettings, Ways
from jaxgear._dynamics._system import PairDynamics
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._system._model import PairModel
from jaxgear.scene._scene import Scene
from jaxgear.scene._tables import DampingKeys, SweepKeys
from jaxgear.study._built import BuiltScene
from jaxgear.study._result import Summary
from jaxgear.study._running import timed
from jaxgear.study._statics import Statics, require_solved, settled_statics, solve_statics

# A harmonic balance of more is not taken unasked: iteration keeps 200 directions, of 0.2 GB.
MOST_ITERATED = 100_000


def speeds_of(asked: SweepKeys) -> np.ndarray:
    """Speeds of the pinion that are swept over, rising, each once [rad/s]."""
    given = asked.pinion_speed_rad_s
    if isinstance(given, list):
        return np.unique(np.asarray(given, dtype=float))
    return np.linspace(given.from_, given.to, given.points)


def fastest(asked: SweepKeys) -> float:
    """The highest speed of the pinion that a scene is swept to; 0 if it is not [rad/s]."""
    return float(speeds_of(asked)[-1]) if asked.is_given else 0.0


def directions_of(asked: SweepKeys) -> Ways:
    """Directions of a sweep."""
    return ("up", "down") if asked.direction == "both" else (asked.direction,)


def damping_of(damping: DampingKeys) -> AbstractDamping:
    """The damping of a scene; its values may be traced."""
    if damping.kind == "rayleigh":
        return RayleighDamping(mass_factor=damping.a_R_1_s, stiffness_factor=damping.b_R_s)
    return ModalDamping(mesh=damping.mesh, structure=damping.structure)


def dynamics_of(model: PairModel, grid: MeshGrid, scene: Scene) -> PairDynamics:
    """Set a scene's pair in motion; look at `cycle.converged`.

    Real values of the model and of the damping may be traced.
    """
    return pair_dynamics(model, grid, damping_of(scene.damping), **vars(_wanted_of(scene)))


class _Wanted(eqx.Module):
    """What of a pair's motion is looked at, under the names that `pair_dynamics` has for it.

    **Fields:**

    - `gyroscopic`, `active_mesh_damping`, `centrifugal`: whether these are [-].
    - `mesh_coordinates`: number of them [-].
    """

    gyroscopic: bool = eqx.field(static=True)
    active_mesh_damping: bool = eqx.field(static=True)
    centrifugal: bool = eqx.field(static=True)
    mesh_coordinates: int = eqx.field(static=True)


def _wanted_of(scene: Scene) -> _Wanted:
    return _Wanted(
        gyroscopic=scene.model.gyroscopic,
        active_mesh_damping=scene.damping.active_mesh,
        centrifugal=scene.sweep.centrifugal,
        mesh_coordinates=scene.at_mesh,
    )


def _with_modes(
    model: PairModel, grid: MeshGrid, damping: AbstractDamping, choices: _Wanted
) -> tuple[PairDynamics, Modes]:
    """A pair in motion, and its natural modes."""
    pair = pair_dynamics(model, grid, damping, **vars(choices))
    return pair, pair_modes(pair)


def pair_in_motion(built: BuiltScene) -> PairDynamics:
    """A scene's pair in motion, without its natural modes.

    **Raises:**

    - `SolverFailure` if the quasi-static cycle was not solved.
    """
    scene, damping = built.scene, damping_of(built.scene.damping)
    wanted = _wanted_of(scene)
    pair = timed(_pair_of, built.model, built.grid_in_motion, damping, wanted, options=QUICKLY)
    require_solved(pair.cycle.converged)
    return pair


def _pair_of(
    model: PairModel, grid: MeshGrid, damping: AbstractDamping, choices: _Wanted
) -> PairDynamics:
    """A pair in motion."""
    return pair_dynamics(model, grid, damping, **vars(choices))


class Size(NamedTuple):
    """What the method of a sweep is chosen by: mesh coordinates, and mesh periods in the cycle."""

    coordinates: int
    periods: int


def size_of(dynamics: PairDynamics) -> Size:
    """The size of a pair's cycle."""
    return Size(dynamics.system.vectors.shape[1], dynamics.system.table.periods)


def unknowns_of(asked: SweepKeys, size: Size) -> int:
    """Number of unknowns of harmonic balance."""
    return size.coordinates * (2 * asked.harmonics * size.periods + 1)


def is_too_large(asked: SweepKeys, size: Size) -> bool:
    """Whether a branch, or derivatives, have too many unknowns to be looked for unasked."""
    return is_long(unknowns_of(asked, size))


def is_followed(asked: SweepKeys, size: Size) -> bool:
    """Whether the branch is followed round its folds: as the scene says, or with both directions.

    A matrix of all unknowns is solved at each of its points.
    """
    if asked.continuation is not None:
        return asked.continuation
    return asked.direction == "both" and not is_too_large(asked, size)


def method_name(asked: SweepKeys, size: Size) -> str:
    """The method of a sweep: what the scene says, or what it leaves to the program."""
    if asked.method != "auto":
        return asked.method
    return "newmark" if unknowns_of(asked, size) > MOST_ITERATED else "harmonic"


def settings_of(law: AbstractContactLaw, asked: SweepKeys, size: Size) -> SweepSettings:
    """How a scene is swept: by harmonic balance as long as a cycle is not too long for it."""
    cycles = max(4, -(-asked.cycles // size.periods))
    method: HarmonicBalance | Shooting | TimeStepping
    match method_name(asked, size):
        case "newmark":
            method = TimeStepping(stepper=Newmark(), law=law, cycles=cycles)
        case "shooting":
            method = Shooting(law=law)
        case _:
            method = HarmonicBalance(law=law, harmonics=asked.harmonics)
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


def solve_dynamics(built: BuiltScene) -> Dynamics:
    """Solve the quasi-static cycle of a scene, and find what its dynamics are made of."""
    scene, model, grid = built.scene, built.model, built.grid_in_motion
    wanted = _wanted_of(scene)
    pair, modes = timed(
        _with_modes, model, grid, damping_of(scene.damping), wanted, options=QUICKLY
    )
    require_solved(pair.cycle.converged)
    if scene.mesh.contact == "exact" and not scene.mesh.pinion_speed_rad_s:
        statics = settled_statics(model, grid, ExactContact(), pair.cycle, built.influences)
    else:
        # The dynamics are built on the exact cycle at vanishing speed; what is reported is the one
        # asked for.
        statics = solve_statics(built)
    return Dynamics(pair=pair, modes=modes, statics=statics)


def require_damped(damping: DampingKeys, dynamics: Dynamics) -> None:
    """Refuse to sweep through the resonance of a mode that the mesh excites and nothing damps."""
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
        key="mesh" if damping.kind == "modal" else "b_R_s",
    )


def damping_summary(damping: DampingKeys, dynamics: Dynamics) -> Summary:
    """Kind of damping, and what it makes of the first modes."""
    count = min(12, dynamics.damping_ratio.size)
    return {
        "kind": damping.kind,
        "active_mesh": damping.active_mesh,
        "frequency_Hz": np.asarray(dynamics.modes.frequency)[:count],
        "ratios": dynamics.damping_ratio[:count],
    }
