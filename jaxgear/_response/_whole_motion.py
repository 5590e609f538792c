r"""What all of a condensed body does in a response, of which its shapes are a part.

A response is found on few shapes, loaded by few mesh coordinates. Once the forces of the cells are
known, all of the body follows from them (theory 11.8):

$$u = T s + K_s^{-1}f + X(z - \omega^{-2}f_z) + (K_s^{-1} - X\omega^{-2}X^T)f_i$$

with the seats $s$, the forces $f$ on the feet and $f_z = X^Tf$, and modes $z$ that answer to these
and not to the mesh coordinates' alone; $f_i = -(M\ddot u + \Omega G\dot u + \Omega^2 S u)$ is the
inertia of the motion that the shapes have, which the modes left out follow too (mode acceleration,
Craig and Kurdila 2006). Here are all terms but the second, which is that of statics.
"""

import dataclasses

import numpy as np

from jaxgear._dynamics._bodies import LEAST_TURNING, BodyPlace
from jaxgear._dynamics._damping import without_hold
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import DynamicSystem, PairDynamics
from jaxgear._response._body_motion import (
    BodyMotion,
    beyond_rest,
    body_motion,
    phases_of_waves,
)
from jaxgear._response._spectrum import fitted_harmonics
from jaxgear._system._body_modes import BodyBasis
from jaxgear._system._condensed import Condensed


def whole_motion(
    dynamics: PairDynamics,
    orbit: Orbit,
    index: int,
    load: np.ndarray,
    harmonics: int,
    *,
    angle: float,
    rotating: bool,
) -> BodyMotion:
    r"""Seats, shapes beyond rest, and the inertia of both, in a steady response.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response at one speed.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `load`: on the modes by all cells, from `mode_loads`, shape `[step, mode]` [N kg^-1/2].
    - `harmonics`: of the mesh that are considered.
    - `angle`: `start_angle` of that gear [rad].
    - `rotating`: whether the body was set in motion with its terms of rotation.

    **Returns:**

    Motions side by side, whose rows are those of `whole_rows`: seats and shapes beyond rest; then,
    as inertia has them on the body, $-\ddot x$ of all, and with `rotating` $-\Omega\dot x$ and
    $-\Omega^2x$.
    """
    (place,) = (each for each in dynamics.bodies if each.index == index)
    motion = body_motion(dynamics, orbit, index, angle=angle)
    periods, seats, modes = motion.periods, len(place.seats), len(place.waves)
    kept = min(len(motion.amplitudes), harmonics * periods + 1)
    own = np.flatnonzero(np.isin(dynamics.dofs, place.mode_dofs))
    lengths = dynamics.system.table.period_lengths
    less = load + np.asarray(orbit.load) @ np.asarray(dynamics.system.vectors)[own].T
    loads = fitted_harmonics(np.concatenate([load, less], axis=1), lengths, None)[:kept]
    pressed, beside = np.split(loads, 2, axis=1)
    frequency = np.arange(kept) * motion.teeth / periods * abs(motion.speed)
    shapes = slice(seats, seats + modes)
    whole = motion.amplitudes[:kept].copy()
    whole[:, shapes] += _answered(dynamics.system, orbit, place, own, beside, frequency)
    beyond = whole.copy()
    beyond[:, shapes] -= pressed / np.asarray(place.square)
    if place.residual.size:
        # Slower than they are, residual shapes are a part of what follows at once, and by their
        # inertia the body does all that they do of it; above that series does not converge.
        slow = (frequency < float(np.sqrt(np.min(place.residual))))[:, None]
        rest = body_motion(dynamics, beyond_rest(dynamics, orbit), index, angle=angle).amplitudes
        beyond[:, seats + modes :] = np.where(slow, 0.0, rest[:kept, seats + modes :])
        whole[:, seats + modes :] *= slow
    parts = _inertia(dataclasses.replace(motion, amplitudes=whole), place, rotating=rotating)
    return dataclasses.replace(motion, amplitudes=np.concatenate([beyond, *parts], axis=1))


def whole_rows(
    body: Condensed,
    basis: BodyBasis,
    motions: np.ndarray,
    rows: np.ndarray,
    answers: np.ndarray,
    *,
    rotating: bool,
) -> np.ndarray:
    """What is read of a body per coordinate of a `whole_motion` of it.

    **Arguments:**

    - `body`: the body.
    - `basis`: its seats and modes in that motion.
    - `motions`: of its coordinates per coordinate of a `BodyMotion`, residual shapes too, shape
        `[dof, coordinate]`.
    - `rows`: what is read per coordinate of the body, shape `[reading, dof]` [any unit].
    - `answers`: of the body to these as loads, the seats held, shape `[reading, dof]`.
    - `rotating`: as of `whole_motion`.

    **Returns:**

    Shape `[reading, coordinate]`.
    """
    left = basis.left_out(answers, rows)
    forces = [body.mass]
    if rotating:
        assert body.coriolis is not None
        assert body.stress_stiffening is not None
        assert body.spin_softening is not None
        forces += [body.coriolis, body.stress_stiffening - body.spin_softening]
    return np.concatenate([rows @ motions, *((left @ x) @ motions for x in forces)], axis=1)


# Entries of the matrices that are solved with at once: they stay in the processor's cache.
_AT_ONCE = 20_000


def _answered(
    system: DynamicSystem,
    orbit: Orbit,
    place: BodyPlace,
    own: np.ndarray,
    load: np.ndarray,
    frequency: np.ndarray,
) -> np.ndarray:
    """Motion of a body's modes, all else held, under loads on them, `[harmonic, mode]`.

    As the body is the same after each turn by a sector, waves that turn by different phases have
    nothing to do with each other.
    """
    at, turning = np.ix_(own, own), system.turning
    assert turning is not None
    stiffness = np.diag(place.square) + np.asarray(turning.stiffness_at(orbit.speed))[at]
    # What holds the free rotation of the pair would hold the modes, of which it is a part.
    rates = np.asarray(without_hold(system.damping, system.free))[at]
    if system.gyroscopic is not None:
        rates = rates + np.asarray(orbit.speed * system.gyroscopic)[at]
    matrices = stiffness, rates, np.asarray(system.mass)[at]
    waves, vectors = phases_of_waves(np.asarray(place.waves))
    turned = [(vectors.conj().T @ each) @ vectors for each in matrices]
    loaded, moved = load @ vectors.conj(), np.zeros(load.shape, dtype=complex)
    for wave in np.unique(waves):
        alike = np.flatnonzero(waves == wave)
        still, rates, mass = (each[np.ix_(alike, alike)] for each in turned)
        parts = max(1, min(len(load), len(load) * alike.size**2 // _AT_ONCE))
        for some in np.array_split(np.arange(len(load)), parts):
            s, at = 1j * frequency[some, None, None], np.ix_(some, alike)
            matrix = still + s * rates + s**2 * mass
            moved[at] = np.linalg.solve(matrix, loaded[at][:, :, None])[:, :, 0]
    return moved @ vectors.T


def _inertia(motion: BodyMotion, place: BodyPlace, *, rotating: bool) -> list[np.ndarray]:
    r"""Amplitudes on the body: $-\ddot x$; with `rotating` $-\Omega\dot x$ and $-\Omega^2x$ too."""
    waves, vectors, own = motion.turned
    turns = np.full(len(motion.waves), True)
    if not rotating:
        seats = len(place.seats)
        turns[:seats] = False
        turns[seats:][: len(place.waves)] = np.asarray(place.diameters) >= LEAST_TURNING
    turned = np.where(abs(vectors).T @ turns > 0.0, waves, 0)
    rate = 1j * motion.numbers(turned[:, None]).T / motion.periods * abs(motion.speed)
    forward, speed = np.exp(1j * waves * motion.angle), motion.speed
    in_space = lambda own: (own * forward) @ vectors.T
    if not rotating:
        return [in_space(-(rate**2) * own)]
    return [
        in_space(-(rate**2) * own),
        in_space(-speed * rate * own),
        -(speed**2) * motion.amplitudes,
    ]
