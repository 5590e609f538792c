"""Chapter IV: flanks of the power pair, per web."""

from .row import Row

TITLE = "Chapter IV: flanks of the power pair, per web"

_FAST = "power-h1, webs O, D, E, 3000 rad/s"
_WEBBED = "power-webbed-pinion, webs O, D, E, at rest and at 3000 rad/s, 20 slices"
_DEPTHS = 0.0, 5.0, 10.0, 15.0, 20.0

ROWS = (
    Row(
        "Fig. IV-43",
        "webbed pinion, at rest: the thinner the web, the more centred and even",
        _WEBBED,
        "webbed.flanks",
        (
            "at rest the pressure is more centred, the thinner the web",
            "at rest the largest pressure falls, the thinner the web",
        ),
        lambda f: (
            f"offset over half the face {f.listed('offset', *((w, 0.0) for w in 'ODE'))}, largest "
            f"{f.listed('largest', *((w, 0.0) for w in 'ODE'))} MPa"
        ),
        reason="The shape of the wheel's web is a guess",
    ),
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
    Row(
        "Fig. IV-44, IV-45",
        "webbed pinion at 3000 rad/s: peaks at both edges, the largest on the "
        "other side than at rest, E most",
        _WEBBED,
        "webbed.flanks",
        (
            "at speed both edges carry more than the middle",
            "the largest pressure is on the other side at speed",
            "at speed E has the largest pressure",
        ),
        lambda f: (
            f"largest {f.listed('largest', *((w, 3000.0, 0.0) for w in 'ODE'))} MPa at "
            f"{f.listed('at', *((w, 3000.0, 0.0) for w in 'ODE'))} of half the face, at rest at "
            f"{f.listed('at', *((w, 0.0) for w in 'ODE'))}"
        ),
        reason="The shape of the wheel's web is a guess",
    ),
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
        reason="End relief on one side centres; a slope with some crowning "
        "centres and lowers the pressure by 18 %. The thesis's case has a webbed pinion and "
        "overload at both edges, and its measure is where the largest pressure is (next rows)",
    ),
    Row(
        "Fig. IV-47, IV-50",
        "webbed pinion: crowning brings the largest pressure to mid-face",
        _WEBBED,
        "webbed.flanks",
        (
            "10 um bring the largest pressure within half of the face about its middle",
            "15 and 20 um bring it within a fifth",
        ),
        lambda f: (
            f"at {f.listed('at', *(('O', 3000.0, x) for x in _DEPTHS))} of half the face with 0, "
            f"5, 10, 15, 20 um; {f.listed('largest', *(('O', 3000.0, x) for x in _DEPTHS))} MPa"
        ),
        reason="The centre of all the pressure moves little: crowning is symmetric",
    ),
    Row(
        "Fig. IV-47, IV-50, edges",
        "webbed pinion: above 10 um edges unload, 20 um loses contact",
        _WEBBED,
        "webbed.flanks",
        (
            "above 10 um both edges are less loaded, the more",
            "20 um loses contact at an edge",
        ),
        lambda f: (
            f"left edge {f.listed('left MPa', *(('O', 3000.0, x) for x in _DEPTHS))}, right edge "
            f"{f.listed('right', *(('O', 3000.0, x) for x in _DEPTHS))} MPa with 0, 5, 10, "
            "15, 20 um"
        ),
    ),
    Row(
        "Fig. IV-48",
        "webbed pinion: the more crowning, the more the mesh force oscillates",
        "power-webbed-pinion, web O, 3000 rad/s, crowning of the pinion 0 to 20 um",
        "webbed_motion.crowned",
        ("at any depth",),
        lambda f: (
            "dynamic ratio "
            + ", ".join(f"{x:.3f}" for x in f.rows[0][1:])
            + " with 0, 5, 10, 15, 20 um"
        ),
        reason="From 10 um on it rises as there; before that it falls. The webs are guesses",
    ),
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
        reason="It does above 10 um; a slope even lowers it, 1.09 to 1.03",
    ),
    Row(
        "Fig. IV-49",
        "webbed pinion: the crowning at which an edge loses contact differs per web",
        _WEBBED,
        "webbed.flanks",
        ("at 15 um an edge has lost contact with one web, and not with another",),
        lambda f: (
            "left edge at 15 um: "
            f"{f.listed('left MPa', *((w, 3000.0, 15.0) for w in 'ODE'))} MPa with O, D, E"
        ),
    ),
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
        reason="Of end relief it cannot either: the centre is off by up to 6 % of half the face",
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
        "",
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


def _still(found):
    """The rows at rest."""
    return [(row[0], row[1]) for row in found.rows if row[1] == 0.0]
