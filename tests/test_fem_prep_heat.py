"""Heat in condensed bodies, against closed forms and the full finite elements."""

import numpy as np
import pytest
from fem_cases import (
    STEEL,
    answer,
    assert_near,
    boundary_rows,
    on_springs,
    padded,
    ring,
    small_wheel,
    springs_on,
    web_probe,
    wheel_body,
)
from helpers import quick

from fem_prep import (
    BodyError,
    condense,
    fixed_interface,
    heat_stress,
    heated_body,
    inertia_relief,
    nodal_stress,
    rigid_motions,
    stress_rows,
    swelling_load,
    swelling_stress,
)

HUB = 25e-3


@pytest.mark.parametrize("method", quick(1, ["herting", "guyan"]))
@pytest.mark.parametrize("seats", ["ring", "mean", "both"])
def test_a_free_body_as_warm_everywhere_grows_and_has_no_stress(seats, method):
    strain, full = 5e-4, wheel_body(small_wheel(), seats)
    held = fixed_interface(full)
    body = condense(full, method=method, modes=4, held=held)
    heated = heated_body(held, body, HUB)
    load = strain * heated.load.sum(axis=0)
    motion = inertia_relief(body, load)
    rim = motion[: 3 * len(full.rim)].reshape(-1, 3)
    wanted = strain * body.rim_nodes
    # But for where it floats.
    rigid = rigid_motions(body.rim_nodes)
    off = (rim - wanted).ravel()
    off -= rigid @ np.linalg.lstsq(rigid, off, rcond=None)[0]
    assert np.abs(off).max() < 1e-8 * np.abs(wanted).max()
    nodes = np.array([web_probe(full.grid), int(full.grid.sets["bore"][3]), full.rim[5]])
    rows = stress_rows(held, body, nodes)
    stress = rows.rows @ motion + strain * heat_stress(heated, body, STEEL, rows).sum(axis=0)
    assert np.abs(stress).max() < 1e-6 * STEEL.young * strain


@pytest.mark.slow
def test_an_annulus_hotter_inside_grows_and_is_stressed_as_in_closed_form():
    # Timoshenko, Goodier, section 151: thin, heat flows from bore to rim.
    inner, outer, strain = 0.02, 0.08, 1e-3
    grid = ring(np.geomspace(inner, outer, 18), 48, [-5e-4, 5e-4])
    full = wheel_body(grid, "mean")
    held = fixed_interface(full)
    body = condense(full, method="guyan", held=held)
    heated = heated_body(held, body, inner)
    r, log = grid.radius, np.log(outer / inner)
    assert_near(heated.strain[0], np.log(outer / r) / log, 1e-4)
    assert_near(heated.strain.sum(axis=0), np.ones(len(r)), 1e-12)
    motion = inertia_relief(body, strain * heated.load[0])
    rim = motion[: 3 * len(full.rim)].reshape(-1, 3)
    radial = np.sum(rim * body.rim_nodes, axis=1) / outer
    share = inner**2 / (outer**2 - inner**2)
    # Free edges grow by the mean free strain over the area.
    assert_near(radial, np.full(len(radial), strain * outer * (0.5 / log - share)), 0.005)
    nodes = np.flatnonzero((grid.nodes[:, 0] > 0) & (np.abs(grid.nodes[:, 1]) < 1e-9))
    rows = stress_rows(held, body, nodes)
    stress = rows.rows @ motion + strain * heat_stress(heated, body, STEEL, rows)[0]
    x, y = grid.nodes[nodes, :2].T / r[nodes]
    found = x * x * stress[:, 0] + y * y * stress[:, 1] + 2 * x * y * stress[:, 3]
    hoop = y * y * stress[:, 0] + x * x * stress[:, 1] - 2 * x * y * stress[:, 3]
    scale, ln = STEEL.young * strain / (2 * log), np.log(outer / r[nodes])
    ratio = outer**2 / r[nodes] ** 2
    wanted = scale * (1 - ln - share * (1 + ratio) * log)
    assert_near(hoop, wanted, 0.005)
    assert np.abs(found - scale * (-ln - share * (1 - ratio) * log)).max() < 0.005 * abs(wanted[0])


@pytest.mark.slow
@pytest.mark.parametrize("method", quick(1, ["herting", "guyan"]))
def test_a_heated_body_on_springs_moves_and_is_stressed_as_the_full_one(method):
    strain = np.array([8e-4, 2e-4])
    full = wheel_body(small_wheel(), "mean")
    held = fixed_interface(full)
    body = condense(full, method=method, modes=4, held=held)
    heated, springs = heated_body(held, body, HUB), springs_on(full)
    own = np.linalg.solve(body.stiffness + padded(body, springs), strain @ heated.load)
    field = strain @ heated.strain
    whole = full.spread.T @ swelling_load(full.grid, STEEL, field)
    motion = full.on_nodes(answer(on_springs(full, springs), whole)[:, None])
    outer = own[: body.boundary_dofs]
    assert_near(outer, boundary_rows(full) @ full.spread.T @ motion.ravel(), 1e-9)
    found = full.on_nodes(held.followed(outer[:, None]))[0]
    found += np.tensordot(strain, heated.inside, axes=1)
    assert_near(found, motion[0], 1e-9)
    nodes = np.array([web_probe(full.grid), int(full.grid.sets["bore"][3]), full.rim[5]])
    rows = stress_rows(held, body, nodes)
    more = np.tensordot(strain, heat_stress(heated, body, STEEL, rows), axes=1)
    wanted = nodal_stress(full.grid, STEEL, motion, nodes)[0]
    wanted += swelling_stress(full.grid, STEEL, field, nodes)
    assert_near(rows.rows @ own + more, wanted, 1e-9)


@pytest.mark.parametrize("radius", [0.01, 0.07])
def test_a_hub_that_holds_nothing_or_all_is_refused(radius):
    full = wheel_body(small_wheel(), "mean")
    held = fixed_interface(full)
    body = condense(full, method="guyan", held=held)
    with pytest.raises(BodyError, match="hub must reach beyond"):
        heated_body(held, body, radius)
