r"""Transients by adaptive integration: speed and torque change as they are told to.

A second implementation beside time stepping, by other authors' integrators: it shares the
table of the mesh and nothing of the steppers. Rotation about the axes follows the prescribed speed,
so the bodies' own rotational inertia asks for no torque: what accelerates a drive is part of the
torque that the mesh carries, or is left out.

Motions are counted along axes that are orthonormal in the mass matrix, without those that nothing
holds. Mesh stiffness is constant within a step of the table and jumps between steps: an integrator
that steps over a jump loses its order, so that every step ends at the next jump at the latest.
"""

from typing import TYPE_CHECKING, Any, cast

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxgear._checks import require, require_float64
from jaxgear._compiled import any_traced
from jaxgear._dynamics._schedule import Schedule, as_profile
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._transient_motion import TransientChoices, motion_of, slope_of
from jaxgear._dynamics._transient_result import DenseMotion, Transient, observed_at, reached_only
from jaxgear._dynamics._transient_stops import EPSILON, StopAtJumps, Stops, Within
from jaxgear._dynamics._types import Start
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._types import Flag, Scalar

if TYPE_CHECKING:
    Times = Array
else:
    Times = Float[Array, "time"]


class TransientError(RuntimeError):
    """An integration stopped before its end; the message says where, and what to do."""


# --- The integration


def transient(
    system: DynamicSystem,
    speed: Schedule | float | Scalar,
    torque_ratio: Schedule | float | Scalar,
    start: Start,
    times: Times,
    *,
    law: AbstractContactLaw,
    rtol: float | Scalar,
    atol: float | Scalar,
    solver: str | diffrax.AbstractSolver = "tsit5",
    below: float | None = None,
    most_steps: int = 1_000_000,
    dense: bool = False,
    progress: bool = False,
    throw: bool = True,
    adjoint: diffrax.AbstractAdjoint = diffrax.RecursiveCheckpointAdjoint(),
) -> Transient:
    r"""Integrate a gear pair in time while its speed and its torque change.

    Gears turn at the prescribed speed, whatever the torque; the mesh starts at phase zero. The load
    is `torque_ratio` times that of the system: torques and their reaction scale together, and so
    do outside loads on shafts, which the system does not tell apart.

    Gradients go through every step, and are NaN beyond what was reached. In a long transient
    of a motion that jumps or is chaotic they grow without bounds, as they should; those of a
    settled response come from its periodic orbit.

    **Arguments:**

    - `system`: what moves.
    - `speed`: of the pinion over time, or a constant; not negative [rad/s].
    - `torque_ratio`: load over that of the system, over time, or a constant [-].
    - `start`: motion and velocity at the first time [m, rad; m/s, rad/s].
    - `times`: of the output; the first is the start, the last the end [s].
    - `law`: of contact. Smooth contact keeps the order of the integrator; exact contact costs more
        steps.
    - `rtol`: error of a step over the motion [-].
    - `atol`: error of a step over the static deflection of the mesh [-].
    - `solver`: explicit `"tsit5"`; implicit `"kvaerno5"`, for modes far above what is excited; or
        any solver of diffrax with an error estimate.
    - `below`: natural frequency above which modes follow without inertia [rad/s]; by default all
        have theirs. Derivatives then need modes of different frequencies, and a system that is
        not being traced.
    - `most_steps`: of the integrator, accepted or not.
    - `dense`: whether `Transient.at` can evaluate any time; holds `most_steps` steps in memory.
    - `progress`: whether a meter is shown.
    - `throw`: whether an integration that does not reach its end raises; if not, look at
        `complete`. Inside `jit`, `vmap` or `grad` it never raises.
    - `adjoint`: how derivatives are found; `diffrax.ForwardMode()` for forward mode.

    **Returns:**

    The motion at `times`.

    **Raises:**

    - `ValueError` in single precision, for speeds, torques or times that cannot be, or for
        `below` with condensed bodies.
    - `TransientError` if the end was not reached and `throw` is true.
    """
    require_float64()
    require(
        system.turning is None or below is None,
        "The modes of condensed bodies change with the speed, and all have their inertia: leave "
        '`below` out, and where steps are short integrate implicitly (`solver="kvaerno5"`).',
    )
    speed, torque_ratio = as_profile(speed), as_profile(torque_ratio)
    start, times = jnp.asarray(start, dtype=float), jnp.asarray(times, dtype=float)
    _check(system, speed, torque_ratio, start, times, most_steps)
    kept = None if below is None else _modes_below(system, below)
    choices = TransientChoices(kept=kept, dense=dense, progress=progress, most_steps=most_steps)
    tolerance = (jnp.asarray(rtol, dtype=float), jnp.asarray(atol, dtype=float))
    integrator = _solver(solver)
    found, sound = _integrate(
        system, speed, torque_ratio, start, times, law, tolerance, integrator, adjoint, choices
    )
    if throw and not isinstance(found.complete, Tracer) and not bool(found.complete):
        raise TransientError(_what_happened(found, bool(sound), most_steps, times))
    return found


def _solver(given: str | diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """An integrator of diffrax by its name, or as it is."""
    if isinstance(given, diffrax.AbstractSolver):
        return given
    solvers = {"tsit5": diffrax.Tsit5, "kvaerno5": diffrax.Kvaerno5}
    require(
        given in solvers,
        '`solver` must be "tsit5", "kvaerno5" or a solver of diffrax, got {given!r}.',
        given=given,
    )
    return solvers[given]()


@eqx.filter_jit
def _integrate(
    system: DynamicSystem,
    speed: Schedule,
    ratio: Schedule,
    start: Start,
    times: Times,
    law: AbstractContactLaw,
    tolerance: tuple[Scalar, Scalar],
    solver: diffrax.AbstractSolver,
    adjoint: diffrax.AbstractAdjoint,
    choices: TransientChoices,
) -> tuple[Transient, Flag]:
    """The transient, and whether the forces where it ended are numbers."""
    begin = times[0]
    since = times - begin
    motion = motion_of(system, law, speed, ratio, begin, choices)
    along = (start @ system.mass) @ motion.axes.shape
    first = along / jnp.stack([motion.length, motion.length * motion.rate])[:, None]
    steps = diffrax.PIDController(rtol=tolerance[0], atol=tolerance[1])
    meter = diffrax.TqdmProgressMeter() if choices.progress else diffrax.NoProgressMeter()
    samples, end = diffrax.SubSaveAt(ts=since), diffrax.SubSaveAt(t1=True)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(slope_of),
        Within(solver),
        t0=since[0],
        t1=since[-1],
        dt0=None,
        y0=first,
        args=(motion, since[0]),
        saveat=diffrax.SaveAt(subs=(samples, end), dense=choices.dense),
        stepsize_controller=StopAtJumps(steps, Stops(motion)),
        adjoint=adjoint,
        max_steps=choices.most_steps,
        progress_meter=meter,
        throw=False,
    )
    (_, ended), (states, last) = cast(Any, solution.ts), cast(Any, solution.ys)
    states = reached_only(states, since <= ended[0], (motion, first))
    stats = solution.stats
    found = Transient(
        times=times,
        complete=solution.result == diffrax.RESULTS.successful,
        reached=begin + ended[0],
        steps=jnp.asarray(stats["num_accepted_steps"]),
        rejected=jnp.asarray(stats["num_rejected_steps"]),
        dense=None
        if solution.interpolation is None
        else DenseMotion(motion, solution.interpolation, begin, system.transmission),
        **observed_at(motion, system.transmission, since, states)._asdict(),
    )
    return found, jnp.all(jnp.isfinite(motion.slope(ended[0], last[0])))


def _modes_below(system: DynamicSystem, below: float) -> int:
    """Number of natural modes below a frequency, at least one."""
    whole = system.whole_stiffness
    require(
        not isinstance(whole, Tracer),
        "`below` chooses how many modes there are, which cannot be traced: leave it out inside "
        "`jit`, `vmap` and `grad` over masses or stiffness.",
    )
    require(below > 0.0, "`below` must be positive, got {got:.6g} rad/s.", got=below)
    square = scipy.linalg.eigvalsh(np.asarray(whole), np.asarray(system.mass))
    # Free motions have a frequency that means nothing.
    held = np.asarray(system.mass @ system.free)
    shapes = scipy.linalg.eigh(np.asarray(whole), np.asarray(system.mass))[1]
    free = np.sum((shapes.T @ held) ** 2, axis=1) > 0.5
    return max(1, int(np.sum((square < below**2) & ~free)))


def _check(
    system: DynamicSystem,
    speed: Schedule,
    ratio: Schedule,
    start: Start,
    times: Times,
    most_steps: int,
) -> None:
    """Refuse what cannot be integrated."""
    dofs = system.mass.shape[0]
    require(
        times.ndim == 1 and times.size > 1,
        "`times` must be a row of two times or more, the first and the last being start and end, "
        "got an array of shape {shape}.",
        shape=times.shape,
    )
    require(
        jnp.all(jnp.diff(times) > 0.0) & jnp.all(jnp.isfinite(times)),
        "`times` must rise from the start to the end, got {first:.6g} s to {last:.6g} s with a "
        "smallest difference of {least:.6g} s.",
        first=times[0],
        last=times[-1],
        least=jnp.min(jnp.diff(times)),
    )
    require(
        start.shape == (2, dofs),
        "`start` must hold motion and velocity of {dofs} degrees of freedom, got an array of "
        "shape {shape}. `at_rest` and `quasi_static_start` make one.",
        dofs=dofs,
        shape=start.shape,
    )
    require(
        jnp.all(speed.values >= 0.0),
        "`speed` must not be negative, got {got:.6g} rad/s. For the other sense of rotation, "
        "mirror the scene: exchange left and right flanks.",
        got=jnp.min(speed.values),
    )
    require(most_steps > 0, "`most_steps` must be positive, got {got}.", got=most_steps)
    if not any_traced(system, ratio) and bool(jnp.any(ratio.values < 0.0)):
        require(
            _has_back_flank(system),
            "`torque_ratio` must not be negative without back flanks to carry it, got {got:.6g}: "
            "the gears would part for good. Give the pair backlash, or keep the torque's sign.",
            got=jnp.min(ratio.values),
        )


def _has_back_flank(system: DynamicSystem) -> bool:
    """Whether the load opens some cell of the mesh."""
    push = system.vectors.T @ jnp.linalg.solve(system.mass, system.load)
    closing = np.asarray(system.table.arms @ push)
    return bool(np.any((closing < 0.0) & (np.asarray(system.table.stiffness) > 0.0)))


def _what_happened(found: Transient, sound: bool, most_steps: int, times: Times) -> str:
    """Where an integration stopped, and what to do."""
    reached, steps = float(found.reached), int(found.steps)
    speeds = np.asarray(found.speed)
    known = np.isfinite(np.asarray(found.transmission_error))
    speed = float(speeds[np.flatnonzero(known)[-1]]) if known.any() else float(speeds[0])
    where = (
        f"The transient stopped at {reached:.6g} s, on its way from {float(times[0]):.6g} s to "
        f"{float(times[-1]):.6g} s, with the pinion near {speed:.6g} rad/s"
    )
    if not sound:
        return (
            f"{where}: forces or motions there are not numbers. Look for NaN or infinity in "
            "`start`, in the profiles of speed and torque and in the table of the mesh; check the "
            "units of masses and stiffness."
        )
    if steps + int(found.rejected) >= most_steps:
        pace = (reached - float(times[0])) / max(steps, 1)
        return (
            f"{where}, after `most_steps` = {most_steps} steps of {pace:.3g} s on average. Raise "
            "`most_steps`, or shorten the run. If fast modes ask for such steps, let them follow "
            'without inertia (`below`) or integrate implicitly (`solver="kvaerno5"`); if not, '
            "loosen `rtol` and `atol`."
        )
    return (
        f"{where}: no step is short enough for the tolerances. Loosen `rtol` and `atol`, which "
        f"rounding does not let fall below about {EPSILON:.0e}; with `ExactContact`, or a "
        "`SmoothContact.width` far below the static deflection, widen the contact; check that "
        "damping is not negative."
    )
