"""Recovered stresses against the full finite elements, and against closed forms."""

import shutil
import subprocess

import numpy as np
import pytest
from fem_cases import (
    STEEL,
    answer,
    assert_near,
    block,
    boundary_rows,
    lattice,
    linear_field,
    on_springs,
    padded,
    shaken,
    small_wheel,
    springs_on,
    tooth_load,
    web_probe,
    wheel_body,
)
from helpers import quick

from fem_prep import (
    BodyError,
    condense,
    fixed_interface,
    nodal_stress,
    stress_matrix,
    stress_rows,
    swelling_stress,
    tensors,
    von_mises,
)
from fem_prep._assembly import assemble, conduction, swelling_load


def test_a_linear_field_has_one_stress_everywhere():
    grid = shaken(block(0.1, 0.08, 0.05, (2, 2, 2)), 2e-3)
    slopes = 1e-3 * np.random.default_rng(0).normal(size=(3, 3))
    found = nodal_stress(grid, STEEL, linear_field(grid, slopes).reshape(1, -1, 3))[0]
    strain = (slopes + slopes.T) / 2
    dilatation, shear = STEEL.lame
    stress = dilatation * np.trace(strain) * np.eye(3) + 2 * shear * strain
    assert_near(tensors(found), np.broadcast_to(stress, (len(grid.nodes), 3, 3)), 1e-12)


def test_equivalent_stress_by_hand():
    # Pure tension says itself, pure shear sqrt(3) of itself, pressure nothing.
    cases = np.array([[5.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0], [3.0, 3.0, 3.0, 0, 0, 0]])
    np.testing.assert_allclose(von_mises(cases), [5.0, 2.0 * np.sqrt(3.0), 0.0], atol=1e-12)


@pytest.mark.parametrize("method", quick(1, ["herting", "guyan"]))
@pytest.mark.parametrize("seats", ["ring", "both"])
def test_stress_of_a_loaded_turning_body_is_that_of_the_full_one(seats, method):
    full = wheel_body(small_wheel(), seats)
    held = fixed_interface(full)
    body = condense(full, method=method, modes=4, held=held)
    springs, load, speed = springs_on(full), 5e3 * tooth_load(full), 900.0
    nodes = np.array([web_probe(full.grid), int(full.grid.sets["bore"][3]), full.rim[5]])
    found = stress_rows(held, body, nodes)
    outer = padded(body, load) + speed**2 * body.centrifugal_load
    own = np.linalg.solve(body.stiffness + padded(body, springs), outer)
    shown = found.rows @ own + speed**2 * found.rotation
    whole = boundary_rows(full).T @ load + speed**2 * full.centrifugal_load
    motion = full.on_nodes(answer(on_springs(full, springs), whole)[:, None])
    wanted = nodal_stress(full.grid, STEEL, motion, nodes)[0]
    assert_near(shown, wanted, 1e-9)
    np.testing.assert_array_equal(found.places, full.grid.nodes[nodes])


def annulus(inner, outer, bricks, *, thickness=1e-3, end=0.05):
    """A sector of an annulus, held by its symmetry: grid and unknowns that are free."""

    def place(at):
        r, angle, z = at.T
        return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)

    radii = np.geomspace(inner, outer, bricks + 1)
    return lattice(radii, [0.0, end / 2, end], [0.0, thickness], place=place)


def in_sector(grid, load, end=0.05):
    """Answer of a sector to a load in the plane that is the same at all angles."""
    stiffness, _ = assemble(grid, STEEL)
    angle = np.arctan2(grid.nodes[:, 1], grid.nodes[:, 0])
    # Radial motion alone is free at both cuts, nothing moves along the axis at the foot.
    rows = np.arange(grid.nodes.size).reshape(-1, 3)
    penalty = np.zeros((len(grid.nodes), 3, 3))
    across = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    cut = (angle < 1e-9) | (angle > end - 1e-9)
    penalty[cut] += 1e6 * stiffness.max() * across[cut, :, None] * across[cut, None, :]
    foot = grid.nodes[:, 2] < 1e-12
    penalty[foot, 2, 2] += 1e6 * stiffness.max()
    whole = stiffness.tolil()
    for node in np.flatnonzero(cut | foot):
        whole[np.ix_(rows[node], rows[node])] += penalty[node]
    return answer(whole.tocsc(), load).reshape(1, -1, 3)


def in_cylinder(grid, stress):
    """Radial and tangential stress from those along x, y, z."""
    angle = np.arctan2(grid.nodes[:, 1], grid.nodes[:, 0])
    c, s = np.cos(angle), np.sin(angle)
    x, y, _, xy, _, _ = stress.T
    return c * c * x + s * s * y + 2 * c * s * xy, s * s * x + c * c * y - 2 * c * s * xy


def test_a_rotating_annulus():
    # Timoshenko, Goodier, section 32: thin, free at both edges.
    inner, outer, speed = 0.02, 0.08, 1000.0
    grid = annulus(inner, outer, 24)
    mass = assemble(grid, STEEL)[1]
    load = speed**2 * (mass @ (grid.nodes * [1.0, 1.0, 0.0]).ravel())
    stress = nodal_stress(grid, STEEL, in_sector(grid, load))[0]
    radial, hoop = in_cylinder(grid, stress)
    nu, r = STEEL.poisson, grid.radius
    scale = STEEL.density * speed**2 * (3 + nu) / 8
    ratio = inner**2 * outer**2 / r**2
    wanted = scale * (inner**2 + outer**2 + ratio - (1 + 3 * nu) / (3 + nu) * r**2)
    assert_near(hoop, wanted, 0.005)
    assert_near(radial, scale * (inner**2 + outer**2 - ratio - r**2), 0.005)


def test_an_annulus_hotter_inside():
    # Timoshenko, Goodier, section 151: thin, heat flows from bore to rim.
    inner, outer, swelling = 0.02, 0.08, 1e-3
    grid = annulus(inner, outer, 32)
    flow, r = conduction(grid), grid.radius
    edge = (r < inner + 1e-9) | (r > outer - 1e-9)
    field = np.where(r < inner + 1e-9, swelling, 0.0)
    free = ~edge
    field[free] = answer(flow[free][:, free].tocsc(), -(flow[free][:, edge] @ field[edge]))
    assert_near(field, swelling * np.log(outer / r) / np.log(outer / inner), 1e-4)
    motion = in_sector(grid, swelling_load(grid, STEEL, field))
    nodes = np.arange(len(r))
    stress = nodal_stress(grid, STEEL, motion)[0] + swelling_stress(grid, STEEL, field, nodes)
    radial, hoop = in_cylinder(grid, stress)
    log, share = np.log(outer / inner), inner**2 / (outer**2 - inner**2)
    scale, ln, ratio = STEEL.young * swelling / (2 * log), np.log(outer / r), outer**2 / r**2
    assert_near(hoop, scale * (1 - ln - share * (1 + ratio) * log), 0.005)
    assert_near(radial, scale * (-ln - share * (1 - ratio) * log), 0.005)


def test_what_swells_freely_has_no_stress():
    grid = shaken(block(0.1, 0.08, 0.05, (2, 2, 2)), 2e-3)
    field = 1e-3 + 2e-3 * grid.nodes[:, 0]
    free = 1e-3 * grid.nodes
    nodes = np.arange(len(grid.nodes))
    even = swelling_stress(grid, STEEL, np.full(len(field), 1e-3), nodes)
    assert np.abs(nodal_stress(grid, STEEL, free[None])[0] + even).max() < 1e-6 * STEEL.young
    # Of a linear field: what it is at the nodes.
    push = -STEEL.young / (1 - 2 * STEEL.poisson) * field
    assert_near(swelling_stress(grid, STEEL, field, nodes)[:, 0], push, 1e-12)


@pytest.mark.parametrize("nodes", [[-1], [10**6], [3, 3]])
def test_points_that_cannot_be_are_refused(nodes):
    with pytest.raises(BodyError, match="node"):
        stress_matrix(block(1.0, 1.0, 1.0, (1, 1, 1)), STEEL, np.array(nodes))


# --- Another program


def _deck(full, load, speed) -> str:
    """A wheel held at its bore, loaded at a tooth and turning, for CalculiX."""
    grid = full.grid
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(grid.nodes, 1)]
    # Its reduced integration gives stresses at the same eight points.
    lines.append("*ELEMENT, TYPE=C3D20R, ELSET=BODY")
    for i, brick in enumerate((grid.bricks + 1).tolist(), 1):
        lines += [f"{i}, {', '.join(map(str, brick[:15]))},", ", ".join(map(str, brick[15:]))]
    lines += ["*NSET, NSET=BORE", *(f"{node + 1}," for node in grid.sets["bore"])]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{STEEL.young}, {STEEL.poisson}", "*DENSITY"]
    lines += [f"{STEEL.density}", "*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL", "*BOUNDARY"]
    lines += ["BORE, 1, 3", "*STEP", "*STATIC", "*CLOAD"]
    for node, force in zip(full.rim, load.reshape(-1, 3), strict=True):
        lines += [f"{node + 1}, {k + 1}, {force[k]:.12e}" for k in range(3) if force[k]]
    lines += ["*DLOAD", f"BODY, CENTRIF, {speed**2:.1f}, 0., 0., 0., 0., 0., 1."]
    return "\n".join([*lines, "*NODE FILE", "U", "*EL FILE", "S", "*END STEP", ""])


def _results(path, name: str, count: int) -> np.ndarray:
    """Values at the nodes, in their order, from a text file of CalculiX."""
    rows, inside = [], False
    for line in path.read_text().splitlines():
        if line.startswith(" -4"):
            inside = name in line
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            rows.append([float(line[13 + 12 * k : 25 + 12 * k]) for k in range(count)])
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_finds_the_same_stresses(tmp_path):
    full, speed = wheel_body(small_wheel(48, 10)), 900.0
    load = 5e3 * tooth_load(full)[: 3 * len(full.rim)]
    (tmp_path / "wheel.inp").write_text(_deck(full, load, speed))
    subprocess.run(["ccx", "-i", "wheel"], cwd=tmp_path, check=True, capture_output=True)
    held = fixed_interface(full)
    body = condense(full, method="guyan", held=held)
    rim = slice(0, len(load))
    motion = np.zeros(body.dofs)
    right = load + speed**2 * body.centrifugal_load[rim]
    motion[rim] = np.linalg.solve(body.stiffness[rim, rim], right)
    # In the web, away from the sharp corners of hub and rim.
    radius = full.grid.radius
    nodes = np.flatnonzero((radius > 27e-3) & (radius < 57e-3))
    found = stress_rows(held, body, nodes[::7])
    own = found.rows @ motion + speed**2 * found.rotation
    wanted = _results(tmp_path / "wheel.frd", "STRESS", 6)[nodes[::7]]
    assert_near(own, wanted, 0.01)
    assert_near(von_mises(own), von_mises(wanted), 0.005)
