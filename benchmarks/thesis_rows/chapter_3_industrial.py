"""Chapter III: the industrial pair, whose sizes are guesses."""

from .row import Row

TITLE = "Chapter III: the industrial pair"

ROWS = (
    Row(
        "Fig. III-28 to III-31, Tab. III-9",
        "industrial pair, 28 and 127 teeth: tubular pinion, intermediate shaft of wheel and next "
        "pinion, condensed",
        "industrial",
        test="tests/verification/test_industrial.py",
        shows="an example scene: a beam pinion, a condensed wheel with a conical web, and the "
        "forces and couples of the next stage on its shaft",
        reason="Torque, helix, face, web, shafts and bearings are not in the text and assumed. Its "
        "wheel has holes, which the scene knows and leaves out: 127 is prime, so that the mesh "
        "repeats after a whole revolution only, which is too long for motion",
    ),
    Row(
        "Fig. III-32, III-33",
        "with the centrifugal load of 8820 rpm one side of the face is overloaded, the other is "
        "almost free",
        "industrial, quasi-static, with 12 holes of 20 mm",
        "industrial.face",
        (
            "with holes and growth an end carries over 1.5 times the mean",
            "... and more than any at rest",
            "the other end carries less than a quarter",
        ),
        lambda f: (
            "; ".join(f"{row[0]}: left {row[1]:.2f}, right {row[2]:.2f}" for row in f.rows)
            + " of the mean"
        ),
        reason="Most of it is there at rest, where thrust tilts the rim; how much hangs on a web, "
        "holes (those of the scene's comments) and a torque that are guesses. The thesis compares "
        "with full finite elements",
    ),
    Row(
        "Tab. III-10",
        "bearing loads within 14 % of full finite elements",
        cannot="the loads themselves are not in the text. The scene's are those of statics: "
        "`tests/verification/test_industrial.py`",
    ),
    Row(
        "Tab. III-10, wrench",
        "",
        "industrial, with and without the next stage's forces and couples",
        "industrial.face",
        (
            "the wrench changes the largest bearing load by more than half",
            "rotation changes no bearing by more than 2 % of the largest",
        ),
        lambda f: "; ".join(
            f"{row[0]}: {row[3]:.0f}, {row[4]:.0f} and {row[5]:.0f}, {row[6]:.0f} N (S, T)"
            for row in f.rows
        ),
    ),
    Row(
        "Fig. III-35, III-36",
        "modes against interferometry, a rim mode of nine diameters",
        cannot="the measured frequencies are not in the text",
    ),
    Row(
        "Fig. III-40, Tab. III-12",
        "resonances of +8, -9, -10, +9 diameters at 8650, 8930, 10190, 10273 rpm",
        "industrial, harmonic balance about the speeds of the Campbell diagram",
        "industrial.waves",
        (
            "peaks of +8, -9, -10 and +9 lie within 3 % of the measured speeds",
            "they come in the measured order",
        ),
        lambda f: ", ".join(f"{row[0]} {row[3]:.0f} ({row[4]:+.1f} %)" for row in f.rows) + " rpm",
        reason="-10 and +9, 0.8 % apart on the test bench, come the other way about. The rim is as "
        "thick as nine diameters want it; eight and ten come out by themselves",
    ),
    Row(
        "Fig. III-44 to III-49, n = 8 to 10",
        "a node of the rim answers at Z - n or Z + n and not at Z",
        "industrial, harmonic balance about the speeds of the Campbell diagram",
        "industrial.waves",
        (
            "a node answers at Z - n or Z + n at least ten times as much as at Z",
            "most of that order is the wave that runs the right way",
        ),
        lambda f: f"{min(f.values('side/Z')):.0f} to {max(f.values('side/Z')):.0f} times above Z",
    ),
)
