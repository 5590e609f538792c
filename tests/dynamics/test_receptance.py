"""What a structure answers to the mesh: by poles, by natural modes and by solving, one number."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases
from fem_cases import assert_near
from helpers import quick

from jaxgear._dynamics import _receptance
from jaxgear._dynamics._receptance import AbstractAnswers, PoleAnswers, answers_of
from jaxgear._dynamics._system import DynamicSystem, modal_basis

SPEED = jnp.asarray(0.7)
FREQUENCY = jnp.asarray([0.05, 0.4, 0.9, 1.0, 1.3, 7.0])


def _system(damping_ratio: float = 0.02) -> DynamicSystem:
    """A structure of two bodies alike, their modes in pairs, that turn."""
    rng = np.random.default_rng(5)
    size = 8
    square = np.repeat(np.linspace(0.5, 2.0, size // 2), 2) ** 2
    shape = np.linalg.inv(rng.normal(size=(size, size)) + 3.0 * np.eye(size))
    # With these as natural modes, the mean mesh in the stiffness.
    back = np.linalg.inv(shape)
    vectors = rng.normal(size=(size, 2))
    mean = np.asarray([[0.02, 0.005], [0.005, 0.03]])
    whole = back.T @ np.diag(square) @ back
    turned = rng.normal(size=(size, size))
    return dataclasses.replace(
        cases.two_dof(steps=16),
        mass=jnp.asarray(back.T @ back),
        damping=jnp.asarray(2.0 * damping_ratio * back.T @ np.diag(np.sqrt(square)) @ back),
        stiffness=jnp.asarray(whole - vectors @ mean @ vectors.T),
        gyroscopic=jnp.asarray(0.3 * (turned - turned.T)),
        vectors=jnp.asarray(vectors),
        mean=jnp.asarray(mean),
        load=jnp.ones(size),
        transmission=jnp.ones(size),
        free=jnp.zeros((size, 0)),
    )


def _answers(system: DynamicSystem, beside: jax.Array | None = None) -> AbstractAnswers:
    mean = jnp.linalg.solve(system.stiffness_at(SPEED), system.vectors)
    return answers_of(system, modal_basis(system), FREQUENCY, SPEED, mean, beside)


def _numbers(system: DynamicSystem) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Receptance in two parts, and a motion."""
    answers = _answers(system)
    load = jnp.sin(jnp.arange(1.0, 4.0 * FREQUENCY.size + 3.0)).reshape(-1, 2)
    found = answers.receptance()
    return jnp.real(found), jnp.imag(found), answers.motion(load)


def _both(system, monkeypatch, work):
    """By solving, and by poles."""
    solved = jax.jit(lambda system: work(system))(system)
    monkeypatch.setattr(_receptance, "MOST_SOLVED", 0)
    return solved, jax.jit(lambda system: work(system))(system)


# Of critical damping poles meet, and their vectors too: the structure is solved for then.
@pytest.mark.parametrize(("damping_ratio", "apart"), [(0.02, True), (0.5, True), (1.0, False)])
def test_poles_answer_as_solving_does(damping_ratio, apart, monkeypatch):
    system = _system(damping_ratio)
    if not apart:
        system = dataclasses.replace(system, gyroscopic=jnp.zeros_like(system.mass))
    solved, by_poles = _both(system, monkeypatch, _numbers)
    for one, other in zip(by_poles, solved, strict=True):
        assert_near(np.asarray(one), np.asarray(other), 1e-12)
    answers = _answers(system)
    assert isinstance(answers, PoleAnswers)
    assert bool(answers.poles.apart) is apart


def test_motion_is_that_of_the_equation_of_motion(monkeypatch):
    """M q'' + (C + G) q' + K q = V f at any time, from the cosines and sines that come back."""
    system = _system()
    monkeypatch.setattr(_receptance, "MOST_SOLVED", 0)
    load = np.random.default_rng(2).normal(size=(2 * FREQUENCY.size + 1, 2))
    motion = np.asarray(jax.jit(lambda s: _answers(s).motion(jnp.asarray(load)))(system))
    angle = 0.3 * np.asarray(FREQUENCY)
    rate = np.asarray(FREQUENCY)
    values = np.concatenate([[1.0], np.cos(angle), np.sin(angle)])
    first = np.concatenate([[0.0], -rate * np.sin(angle), rate * np.cos(angle)])
    second = np.concatenate([[0.0], -(rate**2) * np.cos(angle), -(rate**2) * np.sin(angle)])
    forces = np.asarray(system.mass) @ (second @ motion)
    forces += np.asarray(system.rates_at(SPEED)) @ (first @ motion)
    forces += np.asarray(system.stiffness_at(SPEED)) @ (values @ motion)
    assert_near(forces, np.asarray(system.vectors) @ (values @ load), 1e-11)


@pytest.mark.parametrize("turning", [True, False])
def test_other_loads_move_all_of_the_structure(turning, monkeypatch):
    """Each frequency by itself in NumPy; by poles, by solving, and by natural modes."""
    system = _system() if turning else dataclasses.replace(_system(), gyroscopic=None)
    drawn = np.random.default_rng(8).normal(size=(2, FREQUENCY.size, 8))
    load = jnp.asarray(drawn[0] + 1j * drawn[1])
    mass, rates, stiffness = (
        np.asarray(x) for x in (system.mass, system.rates_at(SPEED), system.stiffness_at(SPEED))
    )
    wanted = [
        np.linalg.solve(stiffness + 1j * w * rates - w**2 * mass, own)
        for w, own in zip(np.asarray(FREQUENCY), np.asarray(load), strict=True)
    ]
    work = lambda system: _answers(system, load).beside
    for found in _both(system, monkeypatch, work):
        assert_near(np.asarray(found), np.asarray(wanted), 1e-11)


def test_without_gyroscopic_terms_natural_modes_do_the_same(monkeypatch):
    system = _system()
    system = dataclasses.replace(system, gyroscopic=jnp.zeros_like(system.mass))
    plain = dataclasses.replace(system, gyroscopic=None)
    by_modes = jax.jit(_numbers)(plain)
    for found in _both(system, monkeypatch, _numbers):
        for one, other in zip(found, by_modes, strict=True):
            assert_near(np.asarray(one), np.asarray(other), 1e-12)


@pytest.mark.parametrize("name", quick(1, ["gyroscopic", "damping", "mass", "vectors"]))
def test_derivatives_are_those_of_the_solution(name, monkeypatch):
    """Forward and in reverse; of gyroscopic terms too that split the poles that have met."""
    system = _system()
    along = jnp.cos(jnp.arange(getattr(system, name).size, dtype=float))
    along = along.reshape(getattr(system, name).shape)
    along = along - along.T if name == "gyroscopic" else along

    def slopes(system):
        moved = lambda x: _numbers(
            dataclasses.replace(system, **{name: getattr(system, name) + x * along})
        )
        ahead = jax.jvp(moved, (jnp.zeros(()),), (jnp.ones(()),))[1]
        total = lambda x: sum(jnp.sum(jnp.cos(each) * each) for each in moved(x))
        return *ahead, jax.grad(total)(jnp.zeros(()))

    for one, other in zip(*_both(system, monkeypatch, slopes), strict=True):
        assert_near(np.asarray(one), np.asarray(other), 1e-10)
