"""Holes A, B, C in the power wheel's web in motion; dynamic beside static loads."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._dynamics._march import TimeStepping
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._steppers import Exponential
from jaxgear._response._dynamic import pressed_cells
from jaxgear._response._dynamic_loads import dynamic_line_load, dynamic_pressure
from jaxgear._response._loads import line_load
from jaxgear.scene._build import grid_of

from .finding import Finding
from .holes import HOLED, HOLES, above_and_between, force_orders, marched
from .motion import Moving, moving, sweep
from .statics import LAW, MPa, mm, solved
from .travelling import crossings

# Off resonance, and the thesis's highest speed [rad/s of the pinion].
_RESTING, _FAST = 1100.0, 3000.0
_LETTERS = "A", "B", "C"


class Pierced(NamedTuple):
    """Sizes of the mesh force by multiples of the cycle, of one case.

    `resting` at 1100 rad/s; `critical` where the mesh meets the backward wave of two diameters, at
    `speed` [rad/s]; `mesh` the number of the mesh's own frequency; `teeth` loads off resonance, as
    of `above_and_between`.
    """

    resting: dict[int, float]
    critical: dict[int, float]
    speed: float
    mesh: int
    teeth: dict[str, list[float]]

    @property
    def step(self) -> int:
        """Multiples of the cycle from one hole's passing to the next."""
        return 6 * self.mesh // 68

    def passing(self) -> float:
        """Off resonance: of the holes' first orders and the first sidebands of the mesh, RMS."""
        numbers = self.step, 2 * self.step, self.mesh - self.step, self.mesh + self.step
        return float(np.sqrt(np.mean([self.resting[k] ** 2 for k in numbers])))

    def sidebands(self) -> float:
        """At the critical speed: the four beside the mesh over the mesh's own."""
        sides = [self.critical[self.mesh + i * self.step] for i in (-2, -1, 1, 2)]
        return float(np.linalg.norm(sides) / self.critical[self.mesh])


def _settled(each: Moving, speed: float, cycles: int) -> Orbit:
    method = TimeStepping(stepper=Exponential(), cycles=cycles)
    found = jax.tree.map(lambda x: x[0], marched(each.system, jnp.asarray([speed]), method))
    assert bool(found.settled), f"{speed} rad/s did not settle in {cycles} cycles"
    return found


@functools.cache
def _case(letter: str) -> Pierced:
    each = moving("power-holes", *HOLED, *HOLES[letter])
    back = next(row for row in crossings(each, 500.0, 20) if row.diameters == 2)
    orbit = _settled(each, _RESTING, 90)
    cells = (
        np.asarray(dynamic_line_load(each.dynamics, orbit, LAW)) * mm,
        np.asarray(dynamic_pressure(each.dynamics, orbit, LAW)) / MPa,
    )
    force = np.asarray(pressed_cells(each.system, orbit, LAW, 0.5).force)
    shape = cells[0].shape
    force = force[:, : shape[1] * shape[2]].reshape(shape)
    grid = grid_of(each.scene, each.model, each.scene.sweep.steps)
    periods = each.system.table.periods
    return Pierced(
        resting=force_orders(each.system, orbit),
        critical=force_orders(each.system, _settled(each, back.speed, 60)),
        speed=back.speed,
        mesh=periods,
        teeth=above_and_between(grid, periods, each.model.pair.wheel.teeth, (*cells, force)),
    )


def cases() -> Finding:
    """Fig. III-34 (b), IV-30 and IV-31 (b): cases A, B, C at their critical speeds and at 1100."""
    found = Finding(
        "Holes A, B, C in motion: mesh force at the critical speed of n = 2 and at 1100 rad/s "
        "(Fig. IV-30, IV-31, III-34)",
        "A and B alike, B and C with richer sidebands; off resonance all have the same new peaks, "
        "larger in B than in A and C; loads above a hole and between as large",
        [
            "case",
            "critical rad/s",
            "mesh there, %",
            "sidebands over it",
            "holes' orders at 1100, %",
            "N/mm above",
            "between",
            "MPa above",
            "MPa between",
        ],
    )
    own = {letter: _case(letter) for letter in _LETTERS}
    for letter, each in own.items():
        above, between = each.teeth["above"], each.teeth["between"]
        row = [letter, each.speed, 100.0 * each.critical[each.mesh], each.sidebands()]
        loads = [above[0], between[0], above[1], between[1]]
        found.rows.append([*row, 100.0 * each.passing(), *map(float, loads)])
    apart = [
        abs(each.teeth["above"][i] / each.teeth["between"][i] - 1.0)
        for each in own.values()
        for i in (0, 1)
    ]
    found.holds = {
        "case B has larger sidebands at its critical speed than A": own["B"].sidebands()
        > own["A"].sidebands(),
        "case C too": own["C"].sidebands() > own["A"].sidebands(),
        "the holes' orders are larger in case B than in A": own["B"].passing() > own["A"].passing(),
        "... and than in C": own["B"].passing() > own["C"].passing(),
        "line loads and pressures above a hole and between are within 5 % in motion": max(apart)
        < 0.05,
    }
    return found


def dynamic_and_static() -> Finding:
    """Fig. III-34 (a): loads of the flank in motion beside those at the same growth by rotation."""
    found = Finding(
        "Line loads of power-h1 in motion and quasi-static, with the same growth (Fig. III-34)",
        "dynamic pressures are similar to the quasi-static ones, more evenly distributed over the "
        "flank; far more sensitive to centrifugal effects than to vibration",
        ["rad/s", "static N/mm", "dynamic N/mm", "static largest/mean", "dynamic largest/mean"],
    )
    each = moving("power-h1", "wheel.body.compare_seats=false")
    largest, spread = {}, {}
    for speed in (_RESTING, _FAST):
        static = solved("power-h1", "mesh.slices=10", f"mesh.pinion_speed_rad_s={speed}")
        still = np.asarray(jax.jit(line_load)(static.cycle, LAW)) * mm
        orbit = jax.tree.map(lambda x: x[0], sweep(each.system, np.asarray([speed]))[1])
        moved = np.asarray(dynamic_line_load(each.dynamics, orbit, LAW)) * mm
        both = [x.max(axis=(0, 1)) for x in (still, moved)]
        largest[speed] = [float(x.max()) for x in both]
        spread[speed] = [float(x.max() / x.mean()) for x in both]
        found.rows.append([speed, *largest[speed], *spread[speed]])
    found.holds = {
        "largest loads within 15 % of the quasi-static ones": all(
            abs(moved / still - 1.0) < 0.15 for still, moved in largest.values()
        ),
        "across the face they are more even in motion": all(
            moved < still for still, moved in spread.values()
        ),
    }
    return found
