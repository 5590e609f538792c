"""Chapter IV: influence of flexibility, the power pair."""

from .row import Row

TITLE = "Chapter IV: flexibility of the power pair"

_FAST = "power-h1, webs O, D, E, 3000 rad/s"
_HOLES = "power-holes, cases A, B, C, at rest and at 3000 rad/s"
_PEAK, _FORCE = "peak of the wave, rad/s", "mesh force at 1100 rad/s, %"

ROWS = (
    Row("Tab. IV-1 to IV-3", "critical speeds 410, 840, 900 to 1000, 1780 rad/s and their modes"),
    Row("Fig. IV-17", "spectrum of the dynamic ratio at three speeds"),
    Row(
        "Fig. IV-18, IV-19",
        "a node of the web at the 2ND resonance: orders 66 and 70",
        "seven wheels, n = 2, 3, 4, both ways",
        "wheels.waves",
        ("a node answers at Z - n or Z + n at least ten times as much as at Z",),
        lambda f: f"order Z - n or Z + n {min(f.values('side/Z')):.0f} times above Z, at least",
    ),
    Row("Fig. IV-20", "a pinion mode shows 67 and 69; nothing off resonance"),
    Row("Fig. IV-21 to IV-23", "three nodes out of phase; band-stop"),
    Row("Fig. IV-24, IV-25", "3ND; 2ND and 4ND at one speed; shapes"),
    Row(
        "Fig. IV-26",
        "Campbell diagram in both frames, zero-speed frequency",
        test="tests/dynamics/test_campbell.py"
        "::test_waves_from_space_are_those_on_the_wheel_and_its_turning",
        shows="waves of both frames apart by n times the speed",
    ),
    Row(
        "Fig. IV-28, IV-29, Tab. IV-5",
        "hollow webs A, B, C: mass -6.5, -6, -8.5 %",
        "power-holes",
        test="tests/verification/test_thesis_rows.py"
        "::test_holes_lighten_the_wheel_as_much_as_in_the_thesis",
        shows="within 0.4 points",
    ),
    Row(
        "Tab. IV-6",
        "holes lower the critical speed of 410 rad/s to 380, 380, 370",
        "power-holes, case B, 68 mesh periods, by marching",
        "holes.holes_in_motion",
        (
            "the backward critical speed of two diameters is lower with holes",
            "the forward one too",
        ),
        lambda f: (
            "waves of two diameters, backward and forward: "
            + f.listed("value", *(("without", _PEAK, x) for x in ("-2", "+2")), form=".0f")
            + " to "
            + f.listed("value", *(("six holes", _PEAK, x) for x in ("-2", "+2")), form=".0f")
            + " rad/s"
        ),
    ),
    Row("Fig. IV-30", "spectra at the wheel's resonance, O, A, B, C"),
    Row(
        "Fig. IV-31 (a)",
        "holes show at order 6/68 and beside the mesh order",
        "power-holes, case B, 68 mesh periods, 1100 rad/s",
        "holes.holes_in_motion",
        ("it settled", "a peak at 6/68 of the mesh", "sidebands at 1 - 6/68 and 1 + 6/68"),
        lambda f: (
            "of the static force: "
            + ", ".join(
                f"{f.listed('value', ('six holes', _FORCE, at), form='.2g')} % at {at}"
                for at in ("1", "1 - 6/68", "1 + 6/68", "6/68", "12/68")
            )
            + "; largest others "
            + f.listed(
                "value",
                *(
                    ("six holes", "largest of all others, %", x)
                    for x in ("below 0.25", "0.75 to 1.25")
                ),
                form=".2g",
            )
            + " %"
        ),
    ),
    Row("Fig. IV-31 (b)", "A, B, C compared in motion"),
    Row(
        "Tab. IV-7, Fig. IV-32",
        "holes hardly matter to pressure",
        _HOLES,
        "holes.holes",
        ("pressures of the two differ by less than 10 %",),
        lambda f: (
            f"largest pressure above holes and between them {_apart(f)[0]:.1f} to "
            f"{_apart(f)[1]:.1f} % apart"
        ),
    ),
    Row(
        "Fig. IV-32, more even",
        "above a hole the load is more even",
        _HOLES,
        "holes.holes",
        ("at rest the load is more even above a hole", "at 3000 rad/s too"),
        lambda f: "at rest, but not at 3000 rad/s with holes close to the rim",
        reason="There the rim grows unevenly around. The thesis says nothing about 3000 rad/s "
        "beyond 'positive'",
    ),
    Row(
        "Fig. IV-34",
        "10 um of linear relief over 0.4 of the face at the loaded end centre the load",
        "power-h1, webs leaning left and right, 3000 rad/s",
        "face.rotation",
        ("5 or 10 um of end relief bring the centre nearer to mid-face",),
        lambda f: (
            "load at the edge away from the web over the mean "
            + f.listed(
                "right edge",
                *(("leaning left", 3000.0, x) for x in ("none", "end 10 um, right")),
            )
            + " plain and with 10 um"
        ),
    ),
    Row("Fig. IV-36", "a webbed pinion moves the load at rest, to about 30 of 40 mm"),
    Row("Fig. IV-37", "pinion alone beside the stage"),
    Row("Fig. IV-38", "dynamic ratio with solid and webbed pinion"),
    Row("Tab. IV-8, solid", "energy at 410 rad/s: wheel 83, mesh 11, bearings 5, pinion 0 %"),
    Row("Tab. IV-8, webbed", "webbed pinion: mesh 11 to 6 %, wheel 83 to 65, bearings 5 to 17"),
    Row("Fig. IV-39", "webbed pinion at 3000 rad/s: overload at both edges"),
    Row("Fig. IV-40", "growth of the webbed pinion: 30 um at both edges of its rim"),
    Row("Tab. IV-9", "web 24, 48 % thinner: mass -6, -12 %"),
    Row("Fig. IV-41, IV-42", "modes O, D, E: O always highest, up to 20 % apart"),
    Row("Fig. IV-42, 0-circle", "modes without nodal circles are almost equal for O, D, E"),
    Row("Fig. IV-43", "webbed pinion, at rest: the thinner the web, the more centred and even"),
    Row(
        "Fig. IV-43, H1",
        "at rest: the thinner the web, the more centred and even (webbed pinion)",
        "power-h1, webs O, D, E, solid pinion",
        "crowning.webs",
        (
            "at rest the load is more even, the thinner the web",
            "at rest the pressure is more centred, the thinner the web",
        ),
        lambda f: (
            f"offset of the pressure over half the face {f.listed('offset', *_still(f))}, "
            f"largest {f.listed('largest', *_still(f))} MPa"
        ),
        reason="The thesis asks it of a webbed pinion",
    ),
    *(
        Row(
            f"Fig. IV-44, IV-45, H1{hand}",
            "at 3000 rad/s: peaks at the ends, the largest on the other side than at rest, E most "
            "(webbed pinion)",
            f"power-h1{hand}, webs O, D, E, solid pinion",
            f"crowning.{experiment}",
            (
                "the largest pressure is on the other side at speed",
                "at speed it is at an end of the face",
                "E is changed most by rotation",
            ),
            lambda f: (
                "largest pressure, at rest and at speed, over half the face at "
                + ", ".join(f"{row[6]:+.1f}" for row in f.rows)
                + " (O, O, D, D, E, E)"
            ),
            reason="The thesis asks it of a webbed pinion",
        )
        for hand, experiment in (("", "webs"), (", left-handed", "webs_left"))
    ),
    Row("Fig. IV-44, IV-45", "webbed pinion at 3000 rad/s: peaks at both edges, E most"),
    Row(
        "Fig. IV-46 to IV-50, H1",
        "about 10 um of crowning centre the pressure",
        _FAST + ", optima by gradient, judged with exact contact",
        "crowning.shapes",
        (
            "the crowning of least pressure lies between 7.5 and 12.5 um",
            "crowning alone centres the pressure to 1 % of half the face",
        ),
        lambda f: (
            "of least pressure are "
            f"{f.listed('crowning um', *((w, 'crowning, even') for w in 'ODE'))} um: "
            f"{f.listed('largest MPa', *((w, 'crowning, even') for w in 'ODE'))} MPa for "
            f"{f.listed('largest MPa', *((w, 'plain') for w in 'ODE'))}; the centre moves little"
        ),
        reason="Crowning is symmetric. End relief on one side centres; a slope with some crowning "
        "centres and lowers the pressure by 18 %. The thesis's case has a webbed pinion and "
        "overload at both edges, and its measure is where the largest pressure is (next rows)",
    ),
    Row("Fig. IV-47, IV-50", "webbed pinion: crowning brings the largest pressure to mid-face"),
    Row("Fig. IV-47, IV-50, edges", "webbed pinion: above 10 um edges unload, 20 um loses contact"),
    Row("Fig. IV-48", "webbed pinion: more crowning, more mesh force oscillation"),
    Row(
        "Fig. IV-48, H1",
        "more crowning, more dynamic force",
        _FAST + ", in motion",
        "crowning.crowning",
        ("the dynamic ratio grows from no crowning on",),
        lambda f: (
            "dynamic ratio of web O at 0, 5, 10, 20 um: "
            f"{f.listed('dynamic ratio', *(('O', x) for x in (0.0, 5.0, 10.0, 20.0)), form='.3f')}"
        ),
        reason="Only above 10 um; a slope even lowers it, 1.09 to 1.03",
    ),
    Row("Fig. IV-49", "webbed pinion: the crowning at which an edge loses contact differs per web"),
    Row(
        "Fig. IV-49, pressure",
        "an optimum cannot be carried from one web to another",
        _FAST + ", the optimum of each web on the others",
        "crowning.transfer",
        tuple(
            f"{what}: another web's optimum costs more than 2 % of pressure somewhere"
            for what in ("crowning, even", "slope + crowning, even")
        ),
        lambda f: (
            "another web's optimum costs at most "
            f"{max(f.values('over its own %', 'crowning, even')):.1f} % (crowning), "
            f"{max(f.values('over its own %', 'slope + crowning, even')):.1f} % (slope, crowning)"
        ),
        reason="Of crowning alone it can. Of end relief it cannot: the centre is off by up to 6 % "
        "of half the face",
    ),
    Row(
        "text p. 167",
        "a compromise between pressure and dynamic force, at about 10 um",
        "power-h1, web O, 3000 rad/s, slope and crowning, Pareto front by gradient",
        "crowning.front",
        ("pressure and dynamic ratio are at odds: the front spans more than 1 % of both",),
        lambda f: (
            f"the front runs from {f.rows[0][3]:.0f} MPa at {f.rows[0][4]:.3f} to "
            f"{f.rows[6][3]:.0f} MPa at {f.rows[6][4]:.3f}"
        ),
        reason="Every design on it beats 10 um of crowning in both",
    ),
    Row(
        "text 3.2.2, coupled",
        "(none: the thesis has slices apart)",
        "power-h1, web O, 3000 rad/s, `mesh.face_coupling=coupled`",
        "crowning.coupling",
        ("flanks stay in the same order",),
        lambda f: (
            "largest pressure plain and with 10 um of crowning "
            f"{f.listed('largest MPa', ('O', 'plain'), ('O', '10 um of crowning'))} MPa apart, "
            + f.listed("largest MPa", ("O, coupled", "plain"), ("O, coupled", "10 um of crowning"))
            + " coupled"
        ),
    ),
    Row(
        "text 3.2.2",
        "elliptical, or linear with parabolic, might be better than crowning",
        _FAST + ", optima by gradient",
        "crowning.shapes",
        (
            "linear + parabolic has a lower pressure than crowning alone",
            "elliptical has a lower pressure than parabolic crowning",
        ),
        lambda f: (
            "web O: "
            + f.listed(
                "largest MPa",
                *(("O", f"{x}, even") for x in ("crowning", "elliptical", "slope + crowning")),
            )
            + " MPa with crowning, ellipse, slope and crowning"
        ),
        reason="Elliptical no, linear with parabolic yes",
    ),
)


def _apart(found):
    """Least and largest difference of the pressure above holes and between them [%]."""
    pairs = {(row[0], row[1]) for row in found.rows}
    one = lambda pair, tooth: found.values("largest MPa", *pair, tooth)[0]
    off = [100.0 * abs(one(pair, "above") / one(pair, "between") - 1.0) for pair in pairs]
    return min(off), max(off)


def _still(found):
    """The rows at rest."""
    return [(row[0], row[1]) for row in found.rows if row[1] == 0.0]
