"""Bodies of the power pair alone: mass, growth, free modes."""

import dataclasses

import numpy as np

from jaxgear.scene._bodies import body_plan
from jaxgear.scene._body_build import built_body
from jaxgear.scene._scene import Scene, example_scene

from .finding import Finding
from .leads import SPEED, WEBS
from .statics import web

# Free modes looked at: nodal diameters of the figures.
_DIAMETERS = range(2, 8)


def health(scene: Scene, gear: str):
    """What is known of a body, its mass without teeth as the thesis has it."""
    plan = dataclasses.replace(body_plan(scene, gear), compares_seats=False)
    return built_body(plan, lambda step: None).health


def _growth(health, speed: float) -> list[float]:
    """Of the rim at a speed: mean, left and right edge [um]."""
    grown = []
    for place in ("", "_left", "_right"):
        known = {
            float(x): each for x, each in health[f"centrifugal_growth{place}_um_at_rad_s"].items()
        }
        most = max(known)
        grown.append(known[most] * (speed / most) ** 2)
    return grown


def webs() -> Finding:
    """Tab. IV-9, Fig. III-26, IV-41, IV-42: mass, growth and free modes of webs O, D, E."""
    found = Finding(
        "Webs O, D, E of the power wheel, and the webbed pinion",
        "webs 24 and 48 % thinner: mass -6, -12 %; modes of O always highest, up to 20 %, almost "
        "identical without nodal circles; growth 80 um, of the pinion 30 um at both edges",
        [
            "body",
            "mass %",
            "mean um",
            "left um",
            "right um",
            *(f"{n}ND Hz" for n in _DIAMETERS),
            *(f"{n}ND over O" for n in _DIAMETERS),
        ],
    )
    lowest: dict[str, np.ndarray] = {}
    grown: dict[str, list[float]] = {}
    first = 0.0
    cases = {label: ("power-h1", "wheel", web(web_thickness_mm=x)) for label, x in WEBS.items()}
    cases["pinion"] = ("power-webbed-pinion", "pinion", [])
    for label, (scene, gear, settings) in cases.items():
        own = health(example_scene(scene, settings), gear)
        mass = float(own["solid_mass_kg"])
        first = first or mass
        grown[label] = _growth(own, SPEED * (35.0 / 68.0 if gear == "wheel" else 1.0))
        hertz, diameter = (np.asarray(own[key]) for key in ("free_frequency_Hz", "nodal_diameter"))
        of = [hertz[diameter == n].min(initial=np.inf) for n in _DIAMETERS]
        lowest[label] = np.asarray(of)
        told = [x if np.isfinite(x) else None for x in of]
        lighter = 100.0 * (mass / first - 1.0) if gear == "wheel" else None
        found.rows.append([label, lighter, *grown[label], *told])
        with np.errstate(invalid="ignore"):
            over = lowest[label] / lowest["O"]
        found.rows[-1] += [float(x) if np.isfinite(x) else None for x in over]
    fall = {label: lowest[label] / lowest["O"] - 1.0 for label in ("D", "E")}
    seen = {label: each[np.isfinite(each)] for label, each in fall.items()}
    mass = {row[0]: row[1] for row in found.rows}
    found.holds = {
        "D is lighter by 6 %, E by 12 % (to 0.5 points)": abs(mass["D"] + 6.0) < 0.5
        and abs(mass["E"] + 12.0) < 0.5,
        "O has the highest frequencies, from two diameters on": all(
            np.all(each < 0.0) for each in seen.values()
        ),
        "the lowest of each number of diameters are within 20 %": all(
            np.all(each > -0.2) for each in seen.values()
        ),
        "... within 3 %": all(np.all(each > -0.03) for each in seen.values()),
        "the lowest mode of two diameters of O has 2250 Hz (to 5 %)": abs(
            lowest["O"][0] / 2250.0 - 1.0
        )
        < 0.05,
        "the wheel grows most at its right edge, away from the web": grown["O"][2] > grown["O"][1],
        "... by 80 um (to 5 %)": abs(max(grown["O"][1:]) / 80.0 - 1.0) < 0.05,
        "both edges of the pinion grow alike (to 5 %)": abs(
            grown["pinion"][1] / grown["pinion"][2] - 1.0
        )
        < 0.05,
        "... by 30 um (to 10 %)": abs(grown["pinion"][1] / 30.0 - 1.0) < 0.1,
    }
    return found
