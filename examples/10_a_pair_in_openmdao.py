"""A gear pair as a component of OpenMDAO, with exact derivatives: `pip install openmdao`.

Tip relief of both gears and the torque go in; transmission error and pressure come out. The
component's derivatives are those of jaxgear, by JAX; OpenMDAO compares them with central
differences and then looks for the relief that is best under two torques at once.

Run with `python examples/10_a_pair_in_openmdao.py`; takes a minute or two.
"""

from typing import Any

import jax
import jax.numpy as jnp
import openmdao.api as om

import jaxgear as jg

jax.config.update("jax_enable_x64", True)

GEAR: dict[str, Any] = dict(addendum=0.9447, dedendum=1.1933, fillet_radius=0.25)
PAIR = jg.GearPair(
    pinion=jg.Gear(45, 11.5 * jg.mm, profile_shift=0.341, bore=30.0 * jg.mm, **GEAR),
    wheel=jg.Gear(86, 9.5 * jg.mm, profile_shift=0.481, bore=40.0 * jg.mm, **GEAR),
    normal_module=1.5 * jg.mm,
    pressure_angle=25.0 * jg.deg,
)
GRID = jg.mesh_grid(PAIR, phases=16, slices=2)
# Smooth contact: an optimiser meets no corner where a tooth just touches.
LAW = jg.SmoothContact(width=0.05 * jg.um)


class PairInMesh(om.JaxExplicitComponent):
    """Mean square of the transmission error's fluctuation, and the largest pressure."""

    def setup(self):
        """Name what goes in and out, with units."""
        self.add_input("depth", shape=1, val=10.0, units="um")
        self.add_input("extent", shape=1, val=0.25)
        self.add_input("torque", shape=1, val=80.0, units="N*m")
        self.add_output("te_variance", shape=1, units="um**2")
        self.add_output("max_pressure", shape=1, units="MPa")

    def compute_primal(self, depth, extent, torque):
        """The mesh cycle; every operation of it can be differentiated."""
        relief = jg.Superposed((jg.TipRelief(jnp.squeeze(depth) * jg.um, jnp.squeeze(extent)),))
        model = jg.PairModel(PAIR, torque=jnp.squeeze(torque), flanks=jg.Flanks(relief, relief))
        cycle = jg.mesh_cycle(model, GRID, law=LAW)
        error = jg.cycle_variance(cycle, jg.transmission_error(PAIR, cycle)) / jg.um**2
        pressure = jnp.max(jg.hertz_pressure(PAIR, cycle, LAW)) / jg.MPa
        return jnp.reshape(error, (1,)), jnp.reshape(pressure, (1,))


def two_torques() -> om.Problem:
    """The pair under 60 and 100 N m; the sum of both variances is to be least."""
    problem = om.Problem(reports=False)
    model = problem.model
    for name in ("light", "heavy"):
        model.add_subsystem(name, PairInMesh(), promotes_inputs=["depth", "extent"])
    total = om.ExecComp("total = a + b", units="um**2")
    model.add_subsystem("both", total, promotes_outputs=["total"])
    model.connect("light.te_variance", "both.a")
    model.connect("heavy.te_variance", "both.b")
    model.set_input_defaults("depth", 10.0, units="um")
    model.set_input_defaults("extent", 0.25)
    model.add_design_var("depth", lower=0.0, upper=30.0, ref=10.0, units="um")
    model.add_design_var("extent", lower=0.05, upper=0.5, ref=0.25)
    model.add_constraint("heavy.max_pressure", upper=1500.0, ref=1000.0, units="MPa")
    model.add_objective("total")
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-7, disp=False)
    problem.setup()
    problem.set_val("light.torque", 60.0)
    problem.set_val("heavy.torque", 100.0)
    return problem


def worst_derivative(problem: om.Problem) -> float:
    """Largest difference between exact derivatives and central differences, per cent per cent.

    Of the output for one of the input: pressure does not react to relief where one pair carries
    all, and nothing can be relative to a derivative of zero.
    """
    problem.run_model()
    found = problem.check_partials(
        includes=["light", "heavy"],
        method="fd",
        form="central",
        step_calc="rel_avg",
        step=1e-4,
        out_stream=None,
    )
    value = lambda *names: abs(problem.get_val(".".join(names)).item())
    errors = [
        # OpenMDAO chooses the way, and keeps none of what it found not to depend.
        abs((each.get("J_fwd", each.get("J_rev", 0.0)) - each["J_fd"]).item())
        * value(name, wrt)
        / value(name, of)
        for name, partials in found.items()
        for (of, wrt), each in partials.items()
    ]
    return max(errors)


if __name__ == "__main__":
    problem = two_torques()
    print(f"derivatives against central differences: {worst_derivative(problem):.1e}")
    before = problem.get_val("total").item()
    problem.run_driver()
    after, depth, extent = (problem.get_val(name).item() for name in ("total", "depth", "extent"))
    print(f"sum of variances {before:.4f} um^2, at the optimum {after:.4f} um^2")
    print(f"depth {depth:.2f} um, extent {extent:.3f}")
    print(f"pressure at 100 N m {problem.get_val('heavy.max_pressure').item():.0f} MPa")
