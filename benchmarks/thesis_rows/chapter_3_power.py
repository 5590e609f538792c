"""Chapter III: the power pair, waves of wheels."""

import math

from .row import Row

TITLE = "Chapter III: the power pair, and waves of wheels"

_SPEEDS = 0.0, 1100.0, 3000.0
_FAST = "power-h1, webs leaning left, right and straight, 0, 1100, 3000 rad/s"
_WHEELS = "seven wheels of the accessory and the power pair, 200 to 3000 rad/s"
_WAVES = "n = 2, 3, 4 both ways, seven wheels, about the speeds of the Campbell diagram"

ROWS = (
    Row(
        "Tab. III-6, III-7, initial",
        "bearing loads of the power pair",
        "power",
        test="tests/app/test_commands.py::test_bearing_loads_of_the_power_pair",
        shows="all ten within 0.5 %, with shafts chosen to that end",
    ),
    Row(
        "Tab. III-6, III-7, H2",
        "pinion's bearings hardly feel a condensed pinion: S -2015, -1510, T -3374, -3449 N, "
        "within 2 % of the initial model's but for one (5 %)",
        "power-h2 rigidified, beside power",
        "face.bearing_loads",
        ("H2 rigidified: both bearings of the pinion within 5 % of the rigid pair's",),
        lambda f: (
            "pinion's bearings "
            + "; ".join(
                f"{f.listed(x, 'rigid bodies', form='.0f')} rigid, "
                f"{f.listed(x, 'H2 rigidified', form='.0f')} N H2 rigidified"
                for x in ("pinion B1", "B2")
            )
        ),
    ),
    Row(
        "Fig. III-15",
        "rigidified H2 beside the initial model: critical speeds alike, amplitudes comparable",
        "power-h2 rigidified, power without foundations, 200 to 3000 rad/s, modal damping and D1",
        "damped.rigidified_power",
        (
            "critical speeds alike: the highest peaks within 5 % of each other",
            "amplitudes comparable: within 5 % in the mean over speed",
        ),
        lambda f: "; ".join(
            f"{row[0]}: {100.0 * row[1]:.1f} % apart in the mean, peaks at {row[3]:.0f} and "
            f"{row[4]:.0f} rad/s"
            for row in f.rows
        ),
        reason="Of peaks of about one height another is the highest; curves are 3 % apart",
    ),
    Row(
        "Tab. III-8",
        "the bearing close to the web takes more, the end of the shaft less: +12 %, -32 %",
        "power-h1, webs leaning left, right and straight, beside a rigidified one",
        "face.bearing_loads",
        (
            "web leaning left: B2 takes more than with a rigid body",
            "web leaning left: B3, at the end, takes less",
            "... with straight webs too",
        ),
        lambda f: (
            f"{_more(f, 2):+.0f} % (B2) and {_more(f, 3):+.0f} % (B3); of the pinion "
            f"{f.listed('pinion B1', 'H1 rigidified', 'H1, leaning left', form='.0f')} N"
        ),
    ),
    Row(
        "Fig. III-17",
        "the line load is largest above the junction of web and rim",
        "power and accessory, ten and two webs, both hands",
        "face.web_junction",
        (
            "power: the maximum lies within 0.15 faces of the junction",
            "accessory: the maximum lies there",
            "the maximum is higher than with rigid bodies",
        ),
        lambda f: (
            "power pair: at the end of the face that thrust presses on with "
            f"{10 - _above(f)} of ten webs, above the junction with {_above(f)}"
        ),
        reason="Always larger than with rigid bodies. The web's shape is a guess",
    ),
    Row(
        "Fig. III-19, without shaft",
        "modes of the isolated wheel and of the stage correspond by n; n = 0 and 1 deviate more; "
        "the stage has more modes",
        "power-h1's wheel without its shaft, free, beside power-h1 in mesh, below 16.7 kHz",
        "alone.wheel_without_shaft",
        (
            "modes of two diameters and more lie within 5 % of one of the stage, in the mean",
            "those of none and one deviate at least twice as much",
            "the stage has more modes",
        ),
        lambda f: (
            f"off by {f.values('nearest in the stage, off by %', '2 to 5')[0]:.1f} % in the mean "
            f"for n = 2 to 5, by {f.values('nearest in the stage, off by %', '0, 1')[0]:.0f} % for "
            f"n = 0 and 1; {f.values('alone Hz', 'all')[0]:.0f} modes alone, "
            f"{f.values('in stage', 'all')[0]:.0f} in the stage"
        ),
    ),
    Row(
        "Fig. III-19, on its shaft",
        "mesh moves modes of no or one diameter, those of two and more hardly",
        "seven wheels on their shafts and bearings, with and without mesh, to 12 kHz",
        "wheels.in_mesh",
        ("n >= 2: the other one too", "n = 0 or 1 moves more than all others"),
        lambda f: (
            "of each pair the more moved wave by "
            + ", ".join(
                f"{max(x for row in f.rows if row[1] == 'more moved' and (x := row[2 + n])):.2g}"
                for n in (2, 3, 4)
            )
            + " % at most (n = 2, 3, 4)"
        ),
        reason="That wave has its antinode under the load. "
        "The thesis takes the wheel's shaft away as well (row above)",
    ),
    Row(
        "text, 2250 Hz",
        "the mode of two diameters has 2250 Hz",
        "power-h1, free with its shaft",
        "free.webs",
        ("the lowest mode of two diameters of O has 2250 Hz (to 5 %)",),
        lambda f: f"{f.listed('2ND Hz', 'O', form='.0f')} Hz",
        reason="The web's sizes are guesses",
    ),
    Row(
        "Fig. III-20",
        "families of modes by nodal circles, as those of a plain disc",
        "power-h1's wheel with its shaft, free, axial modes",
        "alone.families",
        (
            "in every family the frequency rises with the diameters",
            "with more circles it is higher at the same diameters",
        ),
        lambda f: "; ".join(
            f"{row[0]:.0f} circles: {', '.join(f'{x:.0f}' for x in row[1:-1] if x)} Hz from n = 2"
            for row in f.rows
        ),
    ),
    Row(
        "Fig. III-21, III-22",
        "n = 0 and 1 load the shaft, others do not",
        "a body's interface forces by wave",
        test="tests/test_fem_prep_waves.py::test_matrices_do_not_mix_waves",
        shows="waves do not mix; motions of a shaft are of n = 0 and 1",
    ),
    Row(
        "Fig. III-23, highest peak",
        "power H2: main resonances move down",
        _WHEELS,
        "wheels.critical_speeds",
        ("power: every flexible wheel peaks at a lower speed than the rigid pair, a solid disc",),
        lambda f: (
            f"{f.listed('peak rad/s', 'power', 'power, leaning', 'power, straight', form='.0f')} "
            "rad/s rigid, with a leaning and a straight web"
        ),
        reason="Helical teeth hardly excite the pair: the highest of several low peaks is no "
        "measure of it. The mesh's energy over modes is (next row)",
    ),
    Row(
        "Fig. III-23, mesh energy",
        "tooth critical speeds of the power pair are lower with webs",
        "power, power-h1, power-webbed-pinion, modes in mesh to 12 kHz",
        "energy.mesh_energy",
        ("webs lower the centre of mesh energy below that of rigid gears",),
        lambda f: (
            "centre of mesh energy "
            + ", ".join(
                f"{f.values('rad/s', x, 'centre of mesh energy')[0]:.0f}"
                for x in ("rigid", "H1", "webbed pinion")
            )
            + " rad/s rigid, H1, webbed pinion"
        ),
    ),
    Row(
        "Fig. III-24, power",
        "the dynamic ratio rises at high speed with centrifugal load only",
        "power-h1, webs leaning and straight, 1500 to 3000 rad/s",
        "wheels.growth",
        (
            "power: the force rises from up to 2000 to over 2500 rad/s",
            "power: the force rises by less than half of it without",
        ),
        lambda f: _growth(f, "power, leaning"),
        reason="With the straight web the force rises by 0.01 only. The line load of the leaning "
        "one, over the static one, rises from 0.97 to 1.17, without from 0.91 to 0.92",
    ),
    Row(
        "Fig. III-24, accessory",
        "",
        "accessory-h1, -h2, 1500 to 3000 rad/s",
        "wheels.growth",
        ("accessory: the force rises from up to 2000 to over 2500 rad/s",),
        lambda f: _growth(f, "accessory, 3 mm"),
        reason="A centred web grows evenly: the gears turn on a little",
    ),
    Row(
        "Fig. III-25, III-26",
        "rotation overloads the side away from the web",
        _FAST,
        "face.rotation",
        (
            "web leaning left: rotation moves the load to the right, away from the web",
            "web leaning right: to the left",
            "the overload grows with the speed",
        ),
        lambda f: (
            "load at the edge away from the web over the mean, 0, 1100, 3000 rad/s: "
            + ", ".join(
                f"{f.values('right edge', 'leaning left', v, 'none')[0]:.2f}" for v in _SPEEDS
            )
        ),
    ),
    Row(
        "Fig. III-25, centred web",
        "",
        _FAST,
        "face.rotation",
        ("straight centred web: hardly (less than a fifth of that)",),
        lambda f: (
            "load at the right edge over the mean, 0, 1100, 3000 rad/s: "
            + ", ".join(
                f"{f.values('right edge', 'straight, centred', v, 'none')[0]:.2f}" for v in _SPEEDS
            )
        ),
        reason="A centred web is not spared: its rim grows at both edges, which the pressed one "
        "feels",
    ),
    Row(
        "Fig. III-26, growth",
        "80 um at 3000 rad/s, on the side away from the web",
        "power-h1, 3000 rad/s of the pinion",
        "free.webs",
        (
            "the wheel grows most at its right edge, away from the web",
            "... by 80 um (to 5 %)",
        ),
        lambda f: (
            f"left {f.listed('left um', 'O')}, mean {f.listed('mean um', 'O')}, right "
            f"{f.listed('right um', 'O')} um"
        ),
        reason="The web's sizes are guesses",
    ),
    Row(
        "Fig. III-27",
        "growth of 0.1 % changes base radius and pressure angle: -0.473 %",
        test="tests/response/test_factors.py::test_pressure_angle_to_the_leading_order",
        shows="-0.473 % for 0.1 %",
    ),
    Row(
        "Fig. III-34 (a)",
        "dynamic pressures similar to quasi-static ones, more even over the flank",
        "power-h1, 1100 and 3000 rad/s, line loads",
        "pierced.dynamic_and_static",
        (
            "largest loads within 15 % of the quasi-static ones",
            "across the face they are more even in motion",
        ),
        lambda f: "; ".join(
            f"{row[0]:.0f} rad/s: largest {row[2]:.0f} N/mm, static {row[1]:.0f}; over the mean "
            f"{row[4]:.3f}, static {row[3]:.3f}"
            for row in f.rows
        ),
        reason="The thesis asks it of the industrial pair, whose waves take many more modes",
    ),
    Row(
        "Fig. III-34 (b)",
        "above a hole: no real influence on tooth loading, in motion",
        "power-holes, cases A, B, C, 68 mesh periods, 1100 rad/s",
        "pierced.cases",
        ("line loads and pressures above a hole and between are within 5 % in motion",),
        lambda f: (
            "above and between: "
            + "; ".join(f"{row[0]} {row[5]:.0f}, {row[6]:.0f} N/mm" for row in f.rows)
        ),
    ),
    Row(
        "Fig. III-37, Tab. III-11",
        "on the wheel a wave of n diameters answers at Z - n or Z + n, in space at Z",
        "waves on circles",
        test="tests/response/test_waves.py::test_a_wave_is_at_one_order_of_the_body_and_at_the_teeth_in_space",
        shows="both orders to rounding, forward and backward",
    ),
    Row(
        "Fig. III-40, backward first",
        "of two waves the backward one is met first",
        _WAVES,
        "wheels.run_up",
        tuple(f"n = {n}: backward first" for n in (2, 3, 4)),
        lambda f: (
            f"{sum(row[4] < row[5] for row in _with_peaks(f))} of the {len(_with_peaks(f))} pairs "
            f"of which both waves have a peak, of {len(f.rows)} in all"
        ),
    ),
    Row(
        "eq. 3.10 to 3.14, Fig. III-41",
        "Rayleigh coefficients from half-power widths",
        test="tests/response/test_half_power.py::test_a_pair_gives_back_its_rayleigh_coefficients",
        shows="found again to 0.5 %",
    ),
    Row(
        "Fig. III-42 to III-45",
        "a node of the rim answers at Z - n or Z + n and not at Z",
        _WAVES,
        "wheels.waves",
        (
            "a node answers at Z - n or Z + n at least ten times as much as at Z",
            "a probe that stands still answers most at Z",
            "most of that order is the wave that runs the right way",
        ),
        lambda f: (
            f"{min(f.values('side/Z')):.0f} to {max(f.values('side/Z')):.0f} times above Z on the "
            "wheel, each wave running the right way"
        ),
        reason="Under ten times are four diameters of the power pair's straight web and of the "
        "accessory pair's of 2 mm, which the mesh hardly excites",
    ),
    Row(
        "Fig. III-46 to III-49",
        "peaks are where the Campbell diagram has them",
        _WAVES,
        "wheels.waves",
        (
            "all waves of two to four diameters have a peak within 6 % of the prediction",
            "all peaks lie within 1.5 % of the predicted speeds",
        ),
        lambda f: (
            f"of {len(f.rows)} waves (n = 2, 3, 4, both ways) {len(_with_peaks(f))} have a peak, "
            f"within {max(abs(row[5]) for row in _with_peaks(f)):.1f} %"
        ),
        reason="Of the accessory pair's web of 2 mm the wave -3 moves the rim by 0.05 um: it is no "
        "peak beside that of +3",
    ),
    Row(
        "Fig. III-46 to III-50, between",
        "between two close resonances both waves show, off resonance several; the sum of a node's "
        "orders has the peaks of a probe that stands still",
        "power-h1, 300 to 3000 rad/s, a node of the rim and a probe beside it",
        "spectra.webs_at_speed",
        (
            "between two close resonances both waves are the largest",
            "off resonance several waves show",
            "three of four peaks of a probe that stands still are peaks of the sum of the orders",
        ),
        lambda f: (
            f"{f.values('rad/s', '... of the sum of orders too')[0]:.0f} of "
            f"{f.values('rad/s', 'peaks of a probe')[0]:.0f} peaks; "
            + ", ".join(
                f"at {row[1]:.0f} rad/s {row[2]} {row[3]:.2f} um and {row[4]} {row[5]:.2f} um"
                for row in f.rows
                if row[0] in ("between -2 and +2", "off resonance")
            )
        ),
        reason="The thesis's n = 8 to 10 are of the industrial wheel, below",
    ),
)


def _growth(found, label):
    """Means of the force over the static one, of a wheel."""
    row = next(row for row in found.rows if row[:2] == [label, "force"])
    return (
        f"means to 2000 and from 2500 rad/s {row[2]:.3f}, {row[3]:.3f} with, {row[4]:.3f}, "
        f"{row[5]:.3f} without centrifugal load"
    )


def _with_peaks(found):
    """Rows whose waves all have a peak of their own: none of their numbers is missing."""
    return [row for row in found.rows if all(x == x for x in row)]


def _above(found):
    """With how many webs the power pair's line load is largest within 6 mm of the junction, and not
    at an end of its 40 mm."""
    rows = [row for row in found.rows if row[0].startswith("power")]
    return sum(abs(row[3] - row[1]) < 6.0 and abs(row[3]) < 18.0 for row in rows)


def _more(found, bearing):
    """How much more a bearing takes with the web leaning left than with a rigid body [%]."""
    stiff, flexible = (
        math.hypot(*(found.values(f"B{bearing} {axis}", label)[0] for axis in "ST"))
        for label in ("H1 rigidified", "H1, leaning left")
    )
    return 100.0 * (flexible / stiff - 1.0)
