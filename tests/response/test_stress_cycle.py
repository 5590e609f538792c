"""Stresses over a revolution, by hand."""

import numpy as np
import pytest

from jaxgear._response._stress_cycle import along_cylinder, images_of, stress_range

_ANGLES = np.arange(6) * np.pi / 3 + 0.2
_NODES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES), 0.0 * _ANGLES], axis=1)


def test_stresses_along_the_cylinder_turn_with_it():
    # One pull along x seen at six angles.
    stress = np.tile([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], (6, 1))
    found = along_cylinder(_NODES, stress)
    c, s = np.cos(_ANGLES), np.sin(_ANGLES)
    wanted = np.stack([c * c, s * s, 0 * c, -c * s, 0 * c, 0 * c], axis=1)
    np.testing.assert_allclose(found, wanted, atol=1e-15)


def test_what_one_node_feels_while_another_is_loaded():
    stress = np.zeros((2, 6, 6))
    # A pull and a push in different planes, at different times and nodes.
    stress[0, 1, 0], stress[1, 4, 3] = 100.0, 40.0
    images = images_of(_NODES, 6)
    assert images.shape == (1, 6)
    assert sorted(images[0]) == list(range(6))
    found = stress_range(stress, images)
    np.testing.assert_allclose(found.principal, 100.0)
    np.testing.assert_allclose(found.equivalent, 100.0)
    # Of the difference: 100 pulled and 40 sheared at once.
    np.testing.assert_allclose(found.alternating, 0.5 * np.hypot(100.0, np.sqrt(3.0) * 40.0))
    alone = stress_range(stress, images_of(_NODES, 1))
    np.testing.assert_allclose(alone.alternating[[0, 1]], [0.0, 50.0])


def test_alternating_stress_is_the_largest_of_all_pairs_of_times():
    stress = np.random.default_rng(0).normal(size=(40, 1, 6))
    own = stress[:, 0]
    apart = own[:, None] - own
    normal = apart[..., :3] - apart[..., :3].mean(axis=-1, keepdims=True)
    square = 1.5 * ((normal**2).sum(-1) + 2.0 * (apart[..., 3:] ** 2).sum(-1))
    found = stress_range(stress, np.zeros((1, 1), dtype=int)).alternating
    np.testing.assert_allclose(found, 0.5 * np.sqrt(square.max()), rtol=1e-12)


def test_nodes_that_do_not_repeat_are_refused():
    with pytest.raises(ValueError, match="the same after each of 5 parts"):
        images_of(_NODES, 5)
