"""Chapter IV: the power pair: speeds, holes, webbed pinion."""

from .row import Row

TITLE = "Chapter IV: the power pair, speeds, holes, webbed pinion"

_HOLES = "power-holes, cases A, B, C, at rest and at 3000 rad/s"
_WEBBED = "power-webbed-pinion, webs O, D, E, at rest and at 3000 rad/s, 20 slices"
_FREE = "power-h1, webs O, D, E, with their shaft"
_PIERCED = "power-holes, cases A, B, C, 68 mesh periods, by marching"
_OVER = "power-h1, 300 to 3000 rad/s, a node of the rim"
_PEAK, _FORCE = "peak of the wave, rad/s", "mesh force at 1100 rad/s, %"

ROWS = (
    Row(
        "Tab. IV-1 to IV-3",
        "critical speeds 410, 840, 900 to 1000, 1780 rad/s and their modes",
        "power-h1, modes in mesh",
        "energy.mesh_energy",
        ("a mode with much energy in the mesh within 10 % of each of 410, 840, 950, 1780",),
        lambda f: (
            f"{f.values('rad/s', 'H1', 'about 410 rad/s')[0]:.0f}; most energy in "
            "the mesh: "
            + ", ".join(f"{x:.0f}" for x in f.values("rad/s", "H1", "much in the mesh"))
            + " rad/s"
        ),
    ),
    Row(
        "Fig. IV-17",
        "dynamic ratio at 410 and 840 rad/s: most at the mesh's frequency and twice it; far lower "
        "at 1100, off resonance",
        _OVER,
        "spectra.orders",
        (
            "the force is largest at the mesh's frequency or twice it",
            "without a resonance it is less than half of that",
        ),
        lambda f: "; ".join(
            f"{row[1]:.0f} rad/s: {', '.join(f'{x:.1f}' for x in row[2:6])} %" for row in f.rows
        ),
        reason="Here the tooth's own resonance is near 1080 rad/s: 1100 is no quiet speed, and the "
        "wheel's mode moves the rim much and the mesh little",
    ),
    Row(
        "Fig. IV-18, IV-19",
        "a node of the web at the 2ND resonance: orders 66 and 70",
        "seven wheels, n = 2, 3, 4, both ways",
        "wheels.waves",
        ("... so of two diameters",),
        lambda f: (
            "order Z - n or Z + n at least "
            f"{min(row[6] for row in f.rows if abs(float(row[1])) == 2):.0f} times above Z with "
            f"two diameters, {min(f.values('side/Z')):.0f} with up to four"
        ),
    ),
    Row(
        "Fig. IV-20",
        "a mode of the pinion shows 67 and 69; both that and a speed off resonance move the web "
        "far less",
        _OVER,
        "spectra.orders",
        (
            "orders 67 and 69 are the largest at the pinion's mode",
            "the node moves less than a fifth of it at the pinion's mode",
            "... and off resonance",
        ),
        lambda f: "; ".join(
            f"{row[1]:.0f} rad/s: orders {row[6]}, {row[7]:.2f} um" for row in f.rows
        ),
        reason="67 is among the three largest; 65, from the wheel's resonance of +3 at 773 rad/s, "
        "stands above it: the web's sizes are guesses",
    ),
    Row(
        "Fig. IV-21 to IV-23",
        "three nodes around the rim are out of phase, also in the band about Z",
        "power-h1 at the wheel's resonance, orders 60 to 76 of three nodes",
        "spectra.three_nodes",
        (
            "the band that is left shows the same amplitude at all three",
            "their phases are a third of a turn apart",
            "so their signals are not alike",
        ),
        lambda f: (
            f"order {f.rows[0][1]:.0f}: {f.listed(f.columns[2], '1', '2', '3', form='.2f')} um, "
            f"phases {f.listed(f.columns[3], '1', '2', '3', form='.0f')} degrees"
        ),
    ),
    Row(
        "Fig. IV-24, IV-25",
        "+3 diameters alone at 1780 rad/s; two and four at once at 2490",
        _OVER,
        "spectra.webs_at_speed",
        (
            "+3 stands alone: all others are less than half",
            "2 and 4 diameters both show at one speed, the lesser over half of all",
        ),
        lambda f: "; ".join(
            f"{row[1]:.0f} rad/s: {row[2]} {row[3]:.2f}, {row[4]} {row[5]:.2f} um"
            for row in f.rows[:2]
        ),
    ),
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
    Row(
        "Fig. IV-30",
        "at each case's critical speed B and C have richer sidebands than A",
        _PIERCED,
        "pierced.cases",
        ("case B has larger sidebands at its critical speed than A", "case C too"),
        lambda f: "; ".join(
            f"{row[0]}: {row[1]:.0f} rad/s, sidebands {row[3]:.2f} of the mesh's order"
            for row in f.rows
        ),
        reason="Case B has them, case C has those of A",
    ),
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
    Row(
        "Fig. IV-31 (b)",
        "off resonance all cases show the same additional peaks, larger in B than in A and in C",
        _PIERCED,
        "pierced.cases",
        ("the holes' orders are larger in case B than in A", "... and than in C"),
        lambda f: (
            "holes' orders about the mesh's, of the static force: "
            + "; ".join(f"{row[0]} {row[4]:.2g} %" for row in f.rows)
        ),
        reason="Larger in B than in A, largest in C: all below 1 % of the load",
    ),
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
    Row(
        "Fig. IV-36",
        "a webbed pinion moves the load at rest, to about 30 of 40 mm",
        _WEBBED,
        "webbed.flanks",
        (
            "at rest the webbed pinion moves the largest pressure inwards",
            "... to 30 of 40 mm (to 3 mm)",
        ),
        lambda f: (
            f"largest at {20.0 + 20.0 * f.values('at', 'O, solid pinion')[0]:.0f} mm with a "
            f"solid, at {20.0 + 20.0 * f.values('at', 'O', 0.0)[0]:.0f} mm with a webbed pinion; "
            f"{f.listed('largest', 'O, solid pinion', ('O', 0.0))} MPa"
        ),
    ),
    Row(
        "Fig. IV-37",
        "webbed pinion alone and the stage agree well; the stage has more modes, most at low "
        "frequencies",
        "power-webbed-pinion's pinion with its shaft, free, beside the stage, below 16.7 kHz",
        "alone.pinion_alone",
        (
            "modes of two diameters and more lie within 5 % of one of the stage",
            "the stage has more modes below 5 kHz",
        ),
        lambda f: (
            f"{f.values('alone Hz', 'all below 5 kHz')[0]:.0f} of "
            f"{f.values('in stage', 'all below 5 kHz')[0]:.0f} modes below 5 kHz are the pinion's, "
            f"{f.values('alone Hz', 'all below 16.7 kHz')[0]:.0f} of "
            f"{f.values('in stage', 'all below 16.7 kHz')[0]:.0f} below 16.7 kHz"
        ),
    ),
    Row(
        "Fig. IV-38",
        "webbed pinion: most major peaks conserved, slightly shifted; a higher ratio at high speed",
        "power-h1, power-webbed-pinion, 200 to 3000 rad/s",
        "webbed_motion.solid_and_webbed",
        (
            "three of the five highest peaks of the rigid pinion are there again within 5 %",
            "above 2000 rad/s the ratio is higher with the webbed than with the rigid pinion",
        ),
        lambda f: (
            "; ".join(f"{row[0]}: {row[1]} rad/s" for row in f.rows)
            + "; mean above 2000 rad/s "
            + f.listed("mean above 2000 rad/s", "rigid", "webbed")
        ),
        reason="Peaks are there again; above 2000 rad/s they are no higher. The webs are guesses",
    ),
    Row(
        "Tab. IV-8, solid",
        "energy at 410 rad/s: wheel 83, mesh 11, bearings 5, pinion 0 %",
        "power-h1, modes in mesh",
        "energy.mesh_energy",
        (
            "about 410 rad/s most energy is in the wheel, least in the pinion",
            "... within 5 points of 83, 11, 5, 0 %",
        ),
        lambda f: _shares(f, "H1"),
        reason="The stiffness of the bearings is a guess",
    ),
    Row(
        "Tab. IV-8, webbed",
        "webbed pinion: mesh 11 to 6 %, wheel 83 to 65, bearings 5 to 17",
        "power-h1, power-webbed-pinion, modes in mesh",
        "energy.mesh_energy",
        ("a webbed pinion takes energy from mesh and wheel to the bearings",),
        lambda f: _shares(f, "webbed pinion"),
    ),
    Row(
        "Fig. IV-39",
        "webbed pinion at 3000 rad/s: overload at both edges (web O)",
        _WEBBED,
        "webbed.flanks",
        ("web O at speed: both edges carry more than the middle",),
        lambda f: (
            "left, middle, right "
            + "; ".join(
                ", ".join(f.listed(x, (w, 3000.0, 0.0)) for x in ("left MPa", "mid", "right"))
                for w in "ODE"
            )
            + " MPa with O, D, E"
        ),
    ),
    Row(
        "Fig. IV-40",
        "growth of the webbed pinion: 30 um at both edges of its rim",
        "power-webbed-pinion, 3000 rad/s",
        "free.webs",
        (
            "both edges of the pinion grow alike (to 5 %)",
            "... by 30 um (to 10 %)",
        ),
        lambda f: f"{f.listed('left um', 'pinion')} and {f.listed('right um', 'pinion')} um",
        reason="Sizes of its web are guesses",
    ),
    Row(
        "Tab. IV-9",
        "web 24, 48 % thinner: mass -6, -12 %",
        _FREE,
        "free.webs",
        ("D is lighter by 6 %, E by 12 % (to 0.5 points)",),
        lambda f: f"{f.listed('mass %', 'D', 'E')} %",
    ),
    Row(
        "Fig. IV-41, IV-42",
        "modes O, D, E: O always highest, up to 20 % apart",
        "power-h1, webs O, D, E, free with their shaft, lowest mode of each n",
        "free.webs",
        (
            "O has the highest frequencies, from two diameters on",
            "the lowest of each number of diameters are within 20 %",
        ),
        lambda f: (
            "; ".join(f"n = {n}: {f.listed(f'{n}ND Hz', *'ODE', form='.0f')}" for n in (2, 3, 4, 5))
            + " Hz"
        ),
    ),
    Row(
        "Fig. IV-42, 0-circle",
        "modes without nodal circles are almost equal for O, D, E",
        "power-h1, webs O, D, E, free with their shaft, lowest mode of each n",
        "free.webs",
        ("... within 3 %",),
        lambda f: (
            "lowest modes of D, E over those of O: "
            + "; ".join(
                f"n = {n}: {f.listed(f'{n}ND over O', *'DE', form='.2f')}" for n in (2, 3, 4, 5)
            )
        ),
    ),
)


def _apart(found):
    """Least and largest difference of the pressure above holes and between them [%]."""
    pairs = {(row[0], row[1]) for row in found.rows}
    one = lambda pair, tooth: found.values("largest MPa", *pair, tooth)[0]
    off = [100.0 * abs(one(pair, "above") / one(pair, "between") - 1.0) for pair in pairs]
    return min(off), max(off)


def _shares(found, pair):
    """Where the energy of the mode about 410 rad/s is."""
    at = (pair, "about 410 rad/s")
    parts = ("wheel", "mesh", "bearings", "pinion")
    return ", ".join(f"{part} {found.listed(f'{part} %', at, form='.0f')}" for part in parts) + (
        f" % at {found.listed('rad/s', at, form='.0f')} rad/s"
    )
