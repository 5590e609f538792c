"""A condensed wheel on its own turning frame repeats, turned, after each mesh period.

The library looks at wheels from space, where a response that is the same under each tooth repeats
with the mesh. Judge is plain NumPy on the turning body: it knows of no such thing, and marches over
whole revolutions.
"""

import functools
import math

import equinox as eqx
import hybrid_cases
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from fem_cases import assert_near
from helpers import observed_order
from hybrid_cases import APART, PAIRS, ROUND, TEETH, Turning, _pressed, relieved, vibrating

import jaxgear as jg
from jaxgear._contact._cells import mesh_gap
from jaxgear._dynamics._damping import RayleighDamping
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import steady_state
from jaxgear._dynamics._steppers import Midpoint
from jaxgear._dynamics._system import PairDynamics
from jaxgear._system._model import PairModel

# All terms of rotation, and modes that are slow enough for the time steps; damped well, to settle
# within a few revolutions.
WHEEL, MODES, COORDINATES, RATE = {"modes": 8, "rotating": True}, 6, 6, 9000.0
SPEED = 3900.0

_made = eqx.filter_jit(
    lambda model, grid, damping: pair_dynamics(
        model, grid, damping, gyroscopic=True, mesh_coordinates=COORDINATES
    )
)
_steady = eqx.filter_jit(steady_state)


@functools.cache
def _grid(phases: int) -> jg.MeshGrid:
    return jg.mesh_grid(PAIRS["spur"](), phases=phases, slices=2)


@functools.cache
def _model(phases: int) -> PairModel:
    body = vibrating("spur", 1, _grid(phases), MODES, **WHEEL)
    return PairModel(
        PAIRS["spur"](),
        20.0,
        flanks=relieved(),
        compliance=APART,
        pinion_support=ROUND,
        wheel_support=ROUND,
        wheel_body=body,
    )


@functools.cache
def _pair(phases: int) -> PairDynamics:
    return _made(_model(phases), _grid(phases), RayleighDamping(RATE, 0.0))


class _Revolving(Turning):
    """The wheel on its own frame, over whole revolutions."""

    def revolve(self, speed: float, revolutions: int) -> tuple[np.ndarray, np.ndarray]:
        """States where each mesh period ends, `[period, place and rate]`, and forces in it.

        Steps as in `march`; the cells are those of the revolution before.
        """
        own = -speed * TEETH[0] / TEETH[1]
        stiffness = self.stiffness + own**2 * self.softening + own * self.carried
        rates = self.damping + speed * self.pinion_gyroscopic + own * self.coriolis
        load = self.load + own**2 * self.centrifugal
        cells, model = self.dynamics.cycle.cells, self.model
        springs = np.asarray(cells.stiffness)
        gap = np.asarray(mesh_gap(model.pair, cells.lines, model.flanks, model.misalignment))
        period = 2.0 * math.pi / (TEETH[0] * speed)
        halves = 0.5 * period * np.asarray(self.dynamics.system.table.lengths)
        answers = {
            half: np.linalg.inv(self.mass / half**2 + rates / half + stiffness)
            for half in np.unique(halves)
        }
        radius = [float(x) for x in model.pair.base_radius]
        free = np.concatenate([np.zeros(6), -self.onto[:, 5] / radius[1]])
        free[5] = 1.0 / radius[0]
        momentum = self.mass @ free / (free @ self.mass @ free)
        place, rate = self._start(own)
        states, forces = [], []
        for number in range(revolutions * TEETH[1]):
            for step, half in enumerate(halves):
                answer = answers[half]
                across, give, grown = self._cells(number % TEETH[1], step)
                right = load + self.mass @ (place / half**2 + rate / half)
                right += rates @ (place / half)
                overlap = across @ (answer @ right) + own**2 * grown - gap[step]
                force = _pressed(overlap, across @ answer @ across.T + give, springs[step])
                middle = answer @ (right - across.T @ force)
                velocity = (middle - place) / half
                place, rate = 2.0 * middle - place, 2.0 * velocity - rate
                forces.append(force.sum())
            # Both gears turn on together as they may: this is no part of the response.
            held = place - free * (momentum @ place)
            states.append(np.concatenate([held, period * rate]))
        return np.array(states), np.array(forces).reshape(-1, len(halves))


@functools.cache
def _revolved(phases: int, revolutions: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States and forces of the judge, and what a tooth's turn makes of a state."""
    basis = hybrid_cases.basis_of("spur", 1, MODES, **WHEEL)
    body = hybrid_cases.body("spur", 1, **WHEEL)
    judge = _Revolving(_model(phases), _grid(phases), _pair(phases), body, basis, damping=RATE)
    states, forces = judge.revolve(SPEED, revolutions)
    # The wheel turns against Z: what stands still in space goes forward on it.
    turn = scipy.linalg.expm(2.0 * math.pi / TEETH[1] * basis.turning)
    one = scipy.linalg.block_diag(np.eye(6), turn)
    return states, forces, np.asarray(scipy.linalg.block_diag(one, one))


@pytest.mark.slow
def test_a_wheel_repeats_turned_after_each_period_and_as_it_was_after_a_revolution():
    states, forces, turn = _revolved(16, 8)
    last = states[-TEETH[1] - 1 :]
    assert_near(last[1:], last[:-1] @ turn.T, 1e-9)
    assert_near(last[-1], last[0], 1e-9)
    # Not as it was: a period that is not turned has another response.
    seat = last[:, 6:8]
    assert np.abs(seat[1] - seat[0]).max() > 0.1 * np.abs(seat).max()
    assert_near(forces[-1], forces[-TEETH[1]], 1e-9)
    assert np.ptp(forces[-1]) > 0.1 * forces[-1].mean()


@pytest.mark.slow
def test_one_period_in_space_is_a_revolution_on_the_body():
    """To the order of the midpoint rule, which each has in its own frame."""
    off = []
    for phases in (8, 16, 32):
        own = _steady(_pair(phases).system, jnp.asarray(SPEED), Shooting(stepper=Midpoint()))
        assert bool(own.settled)
        forces = _revolved(phases, 8)[1][-1]
        apart = np.asarray(own.load)[:, 0] - forces
        off.append(float(np.sqrt(np.mean(apart**2)) / np.ptp(forces)))
    assert off[-1] < 1e-3
    assert observed_order([1.0 / 8, 1.0 / 16, 1.0 / 32], off) == pytest.approx(2.0, abs=0.2)
