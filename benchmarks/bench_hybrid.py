"""What hybrid models cost and how they converge: a condensed wheel in mesh.

    python benchmarks/bench_hybrid.py [--all] [--out DIR]

The accessory pair with a rigid pinion and a condensed wheel (`accessory-h1`): a mesh cycle, its
gradient, a Master Curve map, and the same statics the thesis's way, with all displacements of the
rim as unknowns and a dense matrix built anew at every step. `--all` adds convergence in slices,
phases, elements of the rim, points across a root and modes, which builds several bodies. Machines
differ and are noisy: compare ratios within one table. Writes `hybrid.json`.
"""

import argparse
import json
import statistics
import time
from pathlib import Path
from typing import Any

from timing import begin, line, peak, timed

MM, UM = 1e-3, 1e-6


def main() -> None:
    """Run all and print the tables."""
    parser = argparse.ArgumentParser(description="What hybrid models cost and how they converge.")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--all", action="store_true", help="convergence too: several bodies")
    options = parser.parse_args()
    begin(options.out)
    report: dict[str, Any] = {"thesis": thesis_way(), "cycle": cycle_and_gradient()}
    if options.all:
        report["convergence"] = convergence()
    report["peak_memory_MB"] = peak()
    print(f"{'peak memory':<58} {report['peak_memory_MB']:8.0f} MB")
    (options.out / "hybrid.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"\nwritten to {options.out}")


def hybrid(*overrides: str):
    """Model and grid of `accessory-h1`."""
    import jaxgear as jg

    # As the thesis has its rigid pinion.
    settings = ["mesh.foundation=weber", *overrides]
    scene = jg.with_bodies(jg.example_scene("accessory-h1", settings))
    model = jg.model_of(scene)
    return scene, model, jg.grid_of(scene, model)


def with_relief(model, depth, extent, crowning):
    """The model with the same corrections on both flanks."""
    import equinox as eqx

    import jaxgear as jg

    pinion, wheel = (
        jg.Superposed((jg.TipRelief(depth[i], extent[i]), jg.Crowning(crowning[i])))
        for i in range(2)
    )
    return eqx.tree_at(lambda m: m.flanks, model, jg.Flanks(pinion, wheel))


def cycle_and_gradient() -> dict[str, float]:
    """A cycle of 64 phases and 20 slices, its gradient in 6 parameters, and a map."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    import jaxgear as jg

    start = time.perf_counter()
    _, model, grid = hybrid()
    report = {"bodies_s": time.perf_counter() - start}
    compiling, preparing, prepared = timed(lambda m: jg.prepare_mesh(m, grid), model)
    line("preparing: cells and their compliance, once", compiling, preparing)
    report["prepare_ms"] = 1e3 * preparing

    def variance(x, prepared, law):
        relieved = with_relief(model, x[:2] * UM, x[2:4], x[4:] * UM)
        cycle = jg.corrected_cycle(prepared, relieved, law=law)
        return jg.cycle_variance(cycle, jg.transmission_error(model.pair, cycle)) / UM**2

    x = jnp.asarray([12.0, 12.0, 0.25, 0.25, 3.0, 3.0])
    for name, law in {"exact": jg.ExactContact(), "smooth": jg.SmoothContact(0.5 * UM)}.items():
        value = lambda x, p, law=law: variance(x, p, law)
        compiling, alone, _ = timed(value, x, prepared, repeats=40)
        compiling_too, both, _ = timed(jax.value_and_grad(value), x, prepared, repeats=40)
        line(f"mesh cycle, {name} contact", compiling, alone)
        line("  with its gradient in 6 parameters", compiling_too, both, f"{both / alone:.2f} x")
        report |= {f"cycle_ms_{name}": 1e3 * alone, f"gradient_over_cycle_{name}": both / alone}

    depth, extent = np.meshgrid(np.linspace(0.0, 40.0, 30) * UM, np.linspace(0.02, 0.5, 30))
    both = jnp.asarray(depth.ravel()), jnp.asarray(extent.ravel())

    def rms(pair):
        depth, extent = (jnp.stack([each, each]) for each in pair)
        relieved = with_relief(model, depth, extent, jnp.zeros(2))
        cycle = jg.corrected_cycle(prepared, relieved)
        return jg.cycle_rms(cycle, jg.transmission_error(model.pair, cycle)) / UM

    compiling, seconds, _ = timed(lambda pairs: jax.lax.map(rms, pairs), both, repeats=1)
    line("Master Curve map 30 x 30", compiling, seconds)
    return report | {"map_s": seconds}


# --- The thesis's way


def thesis_way(phases: tuple[int, ...] = (3, 40)) -> dict[str, float]:
    """Some phases with all displacements of the rim as unknowns, and the fast way beside them."""
    import jax
    import numpy as np

    import jaxgear as jg

    scene, model, grid = hybrid()
    model = with_relief(model, np.full(2, 12.0 * UM), np.full(2, 0.25), np.full(2, 3.0 * UM))
    cycle = jax.jit(lambda m: jg.mesh_cycle(m, grid, throw=False))(model)
    answers = {phase: full_statics(scene, model, grid, phase) for phase in phases}
    each = statistics.mean(seconds for _, _, seconds in answers.values())
    difference = max(
        max(
            abs(float(approach / cycle.approach[phase]) - 1.0),
            float(np.abs(force - np.asarray(cycle.force[phase])).max() / force.max()),
        )
        for phase, (approach, force, _) in answers.items()
    )
    print(f"{'the thesis way, for each of 64 phases':<58} {1e3 * each:8.0f} ms", flush=True)
    print(f"{'  largest relative difference of approach and forces':<58} {difference:8.1e}")
    return {"phase_ms": 1e3 * each, "difference": difference}


def full_statics(scene, model, grid, phase: int):
    """Contact at one phase, with the stiffness of contact in the matrix of all unknowns.

    Exact root corrections are give between cells, not stiffness of single cells: they are left to
    a dense block of the cells in contact, as everything is here. Gives the approach [m], the
    cells' forces [N] and the seconds of the steps alone, without what is prepared once.
    """
    import jax
    import numpy as np
    import scipy.linalg

    import jaxgear as jg
    from jaxgear import RimSurface, interface_map, mesh_gap, pair_system
    from jaxgear._system._body_tables import root_patches, teeth_on_lines
    from jaxgear._system._foot_tables import foot_weights

    body, pair = scene.bodies["wheel"].built.body, model.pair
    tables = scene.bodies["wheel"].flexible
    prepared = jax.jit(lambda m: jg.prepare_mesh(m, grid))(model)
    cells = prepared.cells
    # The pinion alone, on a wheel that is rigid: its own structure, and its arms.
    rigid = jax.jit(lambda m: pair_system(m.pair, m.torque, m.pinion_support, m.wheel_support))(
        model
    )
    size = rigid.structure.map.sizes[0]
    gear = np.asarray(rigid.structure.map.gear_dofs)[:6]
    arm = np.asarray(cells.arm[phase])
    arms = np.stack([np.ones_like(arm), arm], axis=1) @ np.asarray(rigid.vectors).T
    pinion = np.zeros((len(arms), size))
    pinion[:, gear] = arms[:, :6]
    # The wheel's rim, in the frame of the body, which may turn: its bearings are isotropic.
    teeth = teeth_on_lines(1, grid, 1)[0]
    options = {"points": scene.value("mesh.root_points"), "axial": scene.value("mesh.connection")}
    found = interface_map(
        RimSurface(body.rim_nodes, body.rim_faces),
        root_patches(pair, 1, grid, teeth, **options),
    )
    weights, _ = jax.jit(lambda t, r, z: foot_weights(pair, 1, t, r, z))(
        tables.centres[0], cells.lines.roll[phase][None], cells.lines.face_position
    )
    weights = np.stack([np.asarray(each)[0] for each in weights], axis=1)
    rows = found.rows.toarray().reshape(len(arms), 6, -1)
    wheel = np.zeros((len(arms), len(body.stiffness)))
    wheel[:, : rows.shape[2]] = np.einsum("ca,cad->cd", weights, rows)
    vectors = np.concatenate([pinion, wheel], axis=1)
    own_stiffness = np.asarray(rigid.structure.stiffness)[:size, :size]
    stiffness = np.asarray(scipy.linalg.block_diag(own_stiffness, body.stiffness))
    load = np.zeros(len(stiffness))
    load[:size] = np.asarray(rigid.structure.load)[:size]
    for number, bearing in enumerate(model.wheel_support.bearings):
        first = size + body.seat_dofs(f"bearing[{number}]").start
        along = np.concatenate([np.asarray(bearing.translation), np.asarray(bearing.tilt), [0.0]])
        rows_of = first + np.arange(6)
        stiffness[rows_of, rows_of] += along
    held = size + body.seat_dofs("torque").start + 5
    free = np.delete(np.arange(len(stiffness)), held)
    gap = np.asarray(mesh_gap(pair, cells.lines, model.flanks, model.misalignment)[phase])
    own = np.asarray(cells.stiffness[phase])
    # What teeth give beside the rim's unknowns: their own stiffness, the root correction and the
    # other gear's foundation, between the cells in contact.
    beside = np.asarray(cells.coupling[phase]) - _resolved(body, wheel)
    closed = own > 0.0
    start = time.perf_counter()
    for _ in range(50):
        active = np.flatnonzero(closed)
        series = np.linalg.inv(np.diag(1.0 / own[active]) + beside[np.ix_(active, active)])
        whole = stiffness + vectors[active].T @ series @ vectors[active]
        pulled = load + vectors[active].T @ (series @ gap[active])
        motion = np.zeros(len(stiffness))
        motion[free] = scipy.linalg.solve(whole[np.ix_(free, free)], pulled[free], assume_a="pos")
        force = np.zeros(len(own))
        force[active] = series @ (vectors[active] @ motion - gap[active])
        place = vectors @ motion - gap - beside @ force
        now = np.where(closed, force > 0.0, place > 0.0) & (own > 0.0)
        if np.array_equal(now, closed):
            break
        closed = now
    seconds = time.perf_counter() - start
    turn = motion[gear[5]] * float(pair.base_radius[0] * np.cos(float(pair.base_helix_angle)))
    return turn, force, seconds


def _resolved(body, wheel):
    """Compliance between cells that the condensed body itself has, its seats held."""
    import numpy as np
    import scipy.linalg

    seats = np.arange(3 * len(body.rim_nodes), body.boundary_dofs)
    inner = np.setdiff1d(np.arange(len(body.stiffness)), seats)
    factor = scipy.linalg.cho_factor(body.stiffness[np.ix_(inner, inner)], lower=True)
    return wheel[:, inner] @ scipy.linalg.cho_solve(factor, wheel[:, inner].T)


# --- Convergence


def convergence() -> list[dict[str, Any]]:
    """TE and load distribution against finer models, flanks with crowning only.

    Statics does not know how many modes a body has: bodies here have none, which builds faster.
    """
    fine = "wheel.body.fineness"
    cases = {
        "default": (),
        "5 slices": ("mesh.slices=5",),
        "10 slices": ("mesh.slices=10",),
        "40 slices": ("mesh.slices=40",),
        "16 phases": ("mesh.phases=16",),
        "32 phases": ("mesh.phases=32",),
        "128 phases": ("mesh.phases=128",),
        "2 points across a root": ("mesh.root_points=2", "mesh.root_correction=false"),
        "12 points, no root correction": ("mesh.root_correction=false",),
        "collocation": ("mesh.connection=collocation",),
        "50 modes": ("wheel.body.interface=herting", "wheel.body.modes=50"),
        "6 elements across the rim": (f"{fine}.rim_across=6",),
        "8 elements across the rim": (f"{fine}.rim_across=8",),
        "4 elements deep in the rim": (f"{fine}.rim_deep=4",),
        "2 elements for each tooth": (f"{fine}.elements_per_tooth=2",),
        "2 elements, no root correction": (
            f"{fine}.elements_per_tooth=2",
            "mesh.root_correction=false",
        ),
    }
    crowned = [f"flank.{gear}.crowning_um=3" for gear in ("pinion", "wheel")]
    body = "wheel.body"
    quick = (f"{body}.interface=guyan", f"{body}.modes=0", f"{body}.compare_seats=false")
    rows: list[dict[str, Any]] = []
    print(f"{'':<34} {'mean TE':>9} {'RMS TE':>9} {'peak-peak':>9} {'line load':>9}")
    for name, overrides in cases.items():
        found = _numbers(*crowned, *quick, *overrides)
        first = rows[0]["numbers"] if rows else found
        change = {key: found[key] / first[key] - 1.0 for key in found}
        rows.append({"name": name, "numbers": found, "change": change})
        row = " ".join(f"{100.0 * each:8.2f}%" for each in change.values())
        print(f"{name:<34} {row}", flush=True)
    return rows


def _numbers(*overrides: str) -> dict[str, float]:
    import jax
    import numpy as np

    import jaxgear as jg

    _, model, grid = hybrid(*overrides)

    def numbers(model):
        cycle = jg.mesh_cycle(model, grid, throw=False)
        error = jg.transmission_error(model.pair, cycle) / UM
        load = jg.line_load(cycle, jg.ExactContact()) * MM
        return {
            "te_mean_um": jg.cycle_mean(cycle, error),
            "te_rms_um": jg.cycle_rms(cycle, error),
            "te_peak_to_peak_um": jg.peak_to_peak(error),
            "max_line_load_N_mm": load.max(),
        }

    found = jax.jit(numbers)(model)
    order = ("te_mean_um", "te_rms_um", "te_peak_to_peak_um", "max_line_load_N_mm")
    return {key: float(np.asarray(found[key])) for key in order}


if __name__ == "__main__":
    main()
