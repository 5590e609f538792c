"""Holes in the web of the power pair's wheel, at rest and in motion."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
from jaxgear._dynamics._march import TimeStepping
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._steady_state import steady_states
from jaxgear._dynamics._steppers import Exponential
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._response._loads import hertz_pressure, line_load
from jaxgear._system._body_tables import teeth_on_lines

from .finding import Finding
from .motion import QUICK, moving
from .statics import LAW, MPa, Solved, mm, solved, web
from .travelling import at_crossing, crossings, record, rim_of

HOLES = {
    "B": [],
    "A": web(hole_diameter_mm=29.0, hole_circle_mm=100.0),
    "C": web(second_holes=6, second_hole_diameter_mm=18.0, second_hole_circle_mm=88.0),
}


def holes(cases: Sequence[str] = ("B", "A", "C")) -> Finding:
    """Fig. IV-28 to IV-32: teeth above a hole and between holes."""
    found = Finding(
        "Teeth above a hole and between holes (Fig. IV-28 to IV-32)",
        "contact pressures above a hole are slightly better distributed; no real influence of the "
        "holes on tooth loading; the holes' passing shows at 6/68 of the mesh, most in case B",
        [
            "case",
            "speed rad/s",
            "tooth",
            "largest N/mm",
            "largest MPa",
            "largest/mean",
            "TE mean um",
            "TE RMS um",
            "passing um",
        ],
    )
    spread, passing, differs = {}, {}, []
    for case in cases:
        for speed in (0.0, 3000.0):
            settings = [*HOLES[case], f"mesh.pinion_speed_rad_s={speed:g}"]
            each = solved("power-holes", *settings)
            amplitude = passing[case, speed] = holes_passing(each)
            rows = tooth_rows(each)
            for where, row in rows.items():
                found.rows.append([case, speed, where, *row, each.mean, each.rms, amplitude])
            spread[case, speed] = rows["above"][2] - rows["between"][2]
            differs.append(abs(rows["above"][1] / rows["between"][1] - 1.0))
    found.holds = {
        "pressures of the two differ by less than 10 %": max(differs) < 0.1,
        "at rest the load is more even above a hole": all(
            value < 0.0 for (_, speed), value in spread.items() if speed == 0.0
        ),
        "at 3000 rad/s too": all(
            value < 0.0 for (_, speed), value in spread.items() if speed > 0.0
        ),
    }
    if "B" in cases:
        rms = found.values("TE RMS um", "B", 0.0)[0]
        shows = "at rest the holes' passing shows: over 1 % of the RMS of TE"
        found.holds[shows] = passing["B", 0.0] > 0.01 * rms
    if {"A", "B"} <= set(cases):
        found.holds["the holes' passing shows more in case B than in A"] = (
            passing["B", 0.0] > passing["A", 0.0]
        )
    if {"B", "C"} <= set(cases):
        found.holds["... and less in case C than in B"] = passing["C", 0.0] < passing["B", 0.0]
    return found


def holes_passing(each: Solved) -> float:
    """Amplitude of transmission error at the passing of six holes [um]."""
    lines, teeth = each.cycle.cells.lines, each.model.pair.wheel.teeth
    phase, weight = np.asarray(lines.phase), np.asarray(lines.weight)
    turned = np.exp(-2j * np.pi * 6 / teeth * phase)
    return 2.0 * float(np.abs(np.sum(weight * each.error * turned)))


def tooth_rows(each: Solved) -> dict[str, list[float]]:
    """`above_and_between` of a solved pair."""
    load = np.asarray(jax.jit(line_load)(each.cycle, LAW)) * mm
    pressure = np.asarray(jax.jit(hertz_pressure)(each.model.pair, each.cycle, LAW)) / MPa
    force = np.asarray(each.cycle.force).reshape(load.shape)
    lines, teeth = each.cycle.cells.lines, each.model.pair.wheel.teeth
    return above_and_between(each.grid, lines.periods, teeth, (load, pressure, force))


def above_and_between(
    grid: jg.MeshGrid, periods: int, teeth: int, cells: tuple[np.ndarray, ...]
) -> dict[str, list[float]]:
    """Of the wheel's teeth above a hole and between holes: largest line load and pressure.

    **Arguments:**

    - `grid`, `periods`, `teeth`: of a wheel with six holes, one above tooth 0, over at least half a
        revolution.
    - `cells`: line load [N/mm], pressure [MPa] and force [N] by phase, line and slice.

    **Returns:**

    Largest line load [N/mm] and pressure [MPa] on its way through the mesh, and the largest over
    the mean load across its face [-].
    """
    tooth = teeth_on_lines(1, grid, periods) % periods
    split = lambda x: x.reshape(periods, -1, *x.shape[1:])
    load, pressure, force = map(split, cells)
    # Where a tooth stands between two holes: 0 above one, 30 between two.
    turn = np.arange(periods) * 360.0 / teeth
    apart = np.abs((turn + 30.0) % 60.0 - 30.0)
    rows = {}
    for where, chosen in (("above", apart < 6.0), ("between", apart > 24.0)):
        values = []
        for number in np.flatnonzero(chosen):
            period, line = np.nonzero(tooth == number)
            own = [x[period, :, line] for x in (load, pressure, force)]
            across = own[2].sum(axis=(0, 1))
            values.append([own[0].max(), own[1].max(), across.max() / across.mean()])
        rows[where] = [float(x) for x in np.mean(values, axis=0)]
    return rows


# Marches over whole revolutions take several times as long on the default shapes.
_MODES = "model.shapes=natural", "model.coordinates=60"
HOLED = (*_MODES, "sweep.steps=16", "mesh.slices=8", *(f"wheel.body.{x}" for x in QUICK))
marched = eqx.filter_jit(steady_states)


def force_orders(system: DynamicSystem, orbit: Orbit) -> dict[int, float]:
    """Amplitudes of the mesh force over the static one, by multiples of the cycle's frequency."""
    force = np.asarray(orbit.load)[:, 0] / float(system.force)
    table = system.table
    middles, lengths = np.asarray(table.middles), np.asarray(table.lengths)
    size = {}
    for k in range(1, 2 * table.periods):
        turned = np.exp(-2j * np.pi * k * middles / table.periods)
        size[k] = 2.0 * abs(complex(np.sum(lengths * force * turned))) / table.periods
    return size


def holes_in_motion() -> Finding:
    """Fig. IV-30, IV-31 and Tab. IV-6: six holes under 68 teeth, case B."""
    found = Finding(
        "Six holes under 68 teeth: a response over 68 mesh periods (Fig. IV-31, Tab. IV-6)",
        "critical speed of the pair of two diameters 380 instead of 410 rad/s; a peak at 6/68 and "
        "sidebands of that distance about the mesh frequency; none without holes",
        ["wheel", "what", "at", "value", "predicted"],
    )
    each = moving("power-holes", *HOLED)
    method = lambda cycles: TimeStepping(stepper=Exponential(), cycles=cycles)
    responses = lambda speeds: marched(each.system, jnp.asarray(speeds), method(20))
    rim = rim_of(each)
    whole = {int(np.sign(row.diameters)): row for row in record("power, leaning").waves[:2]}
    back = next(row for row in crossings(each, 500.0, 20) if row.diameters == 2)
    # The forward wave is mixed with other motions, so that no crossing has its name: it is looked
    # for where it would be if it went down like the other.
    ahead = back.speed * whole[1].predicted / whole[-1].predicted
    pierced = {
        way: at_crossing(each, rim, back._replace(direction=way, speed=speed), responses, 9)
        for way, speed in ((-1, back.speed), (1, ahead))
    }
    for label, rows in (("without", whole), ("six holes", pierced)):
        for way, row in rows.items():
            found.rows.append([label, "peak of the wave, rad/s", f"{2 * way:+d}", row.found])
            found.rows[-1].append(row.predicted)
    slow = 1100.0
    # The faster, the less of a slow vibration dies away in a cycle.
    settled = marched(each.system, jnp.asarray([slow]), method(90))
    orbit = jax.tree.map(lambda x: x[0], settled)
    size, table = force_orders(each.system, orbit), each.system.table
    step = 6 * table.periods // 68
    mesh = table.periods
    named = {
        "6/68": step,
        "1 - 6/68": mesh - step,
        "1": mesh,
        "1 + 6/68": mesh + step,
        "12/68": 2 * step,
        "1 - 12/68": mesh - 2 * step,
        "1 + 12/68": mesh + 2 * step,
    }
    for what, k in named.items():
        found.rows.append(["six holes", f"mesh force at {slow:g} rad/s, %", what, 100 * size[k]])
        found.rows[-1].append(None)
    # Farther off are sidebands of other harmonics.
    rest = [k for k in range(-16, 17) if k % step]
    others = [max(size[k] for k in rest if k > 0), max(size[mesh + k] for k in rest)]
    for what, value in zip(("below 0.25", "0.75 to 1.25"), others, strict=True):
        found.rows.append(["six holes", "largest of all others, %", what, 100.0 * value, None])
    found.rows.append(["six holes", "residual of the march", "-", float(orbit.residual), None])
    found.holds = {
        "the response repeats after 68 mesh periods": mesh == 68,
        "it settled": bool(orbit.settled),
        "the backward critical speed of two diameters is lower with holes": pierced[-1].found
        < whole[-1].found,
        "the forward one too": pierced[1].found < whole[1].found,
        "a peak at 6/68 of the mesh": size[step] > 3.0 * others[0],
        "sidebands at 1 - 6/68 and 1 + 6/68": min(size[mesh - step], size[mesh + step])
        > 3.0 * others[1],
    }
    return found
