"""The accessory pair in motion, either damping: bodies rigidified, flexible, a webbed pinion."""

import functools
from collections.abc import Mapping

import numpy as np

from jaxgear import example_scene, model_of
from jaxgear.scene._schema import GEARS

from .finding import Finding
from .motion import COARSE, QUICK, SLOW, Curve, at_speeds, fine, moving, set_going, sweep
from .statics import THESIS, WEBBED, rigid_body, with_rigid_shaft
from .stiffened import as_rigid, carried

# Rayleigh damping of the thesis.
D1 = "damping.kind=rayleigh", "damping.a_R_1_s=25", "damping.b_R_s=2.5e-6"
D2 = "damping.kind=rayleigh", "damping.a_R_1_s=40", "damping.b_R_s=4e-6"
DAMPINGS = {"modal": (), "D1": D1}
_PAIRS: dict[str, tuple[str, tuple[str, ...]]] = {
    "rigid": ("accessory", ()),
    "H1": ("accessory-h1", ()),
    "H2": ("accessory-h2", ()),
    "H2, webbed pinion": ("accessory-h2", tuple(WEBBED)),
}


@functools.cache
def _curve(label: str, damping: str) -> Curve:
    name, settings = _PAIRS[label]
    return fine(moving(name, *settings, *DAMPINGS[damping]).system)


def _apart(one: Curve, other: Curve) -> float:
    """Mean over the common speeds of how far two ratios are apart, over the second."""
    speeds = np.intersect1d(one.speed, other.speed)
    each, beside = at_speeds(one, speeds), at_speeds(other, speeds)
    return float(np.nanmean(np.abs(each / beside - 1.0)))


def peaks() -> Finding:
    """Fig. III-12 and IV-14: critical speeds by flexible bodies, with either damping."""
    found = Finding(
        "Highest peak above 700 rad/s, with either damping (Fig. III-12, IV-14)",
        "H1 and H2 alike; flexible bodies lower the critical speeds of the teeth; a webbed pinion "
        "moves the peaks to lower speeds and does little else",
        ["pair", "damping", "peak rad/s", "ratio there", "mean apart from H1"],
    )
    for damping in DAMPINGS:
        for label in _PAIRS:
            own = _curve(label, damping)
            top = float(np.nanmax(own.ratio[own.speed > SLOW]))
            apart = _apart(own, _curve("H1", damping))
            found.rows.append([label, damping, own.main, top, apart])
    at = lambda label, damping: _curve(label, damping).main
    for damping in DAMPINGS:
        solid, webbed = (_curve(x, damping) for x in ("H2", "H2, webbed pinion"))
        found.holds |= {
            f"{damping}: flexible bodies peak at a lower speed than rigid ones": max(
                at("H1", damping), at("H2", damping)
            )
            < at("rigid", damping),
            f"{damping}: H1 and H2 are alike, within 10 % in the mean over speed": _apart(
                _curve("H2", damping), _curve("H1", damping)
            )
            < 0.1,
            f"{damping}: a webbed pinion lowers the peak's speed": webbed.main < solid.main,
            f"{damping}: and its height by less than a quarter either way": abs(
                np.nanmax(webbed.ratio) / np.nanmax(solid.ratio) - 1.0
            )
            < 0.25,
        }
    return found


def _stiff_and_initial(name: str, damping: tuple[str, ...]) -> tuple[Curve, Curve]:
    """The rigidified H2 of a pair, and its initial model."""
    hybrid = sweep(moving(*_stiff(name, damping)).system)[0]
    return hybrid, sweep(moving(name, "mesh.foundation=none", *damping).system)[0]


def _stiff(name: str, damping: tuple[str, ...]) -> tuple[str, ...]:
    """The rigidified H2 of a pair, by scene and settings."""
    quick = [f"{gear}.body.{each}" for gear in GEARS for each in QUICK]
    return f"{name}-h2", *(rigid_body(gear) for gear in GEARS), *quick, *damping


def _rigidified(name: str, figure: str, dampings: Mapping[str, tuple[str, ...]]) -> Finding:
    found = Finding(
        f"Rigidified H2 beside the rigid pair, by damping ({figure})",
        "more and other damping lets the deviations between both fade",
        ["damping", "mean apart", "largest apart", "peak rad/s", "its peak"],
    )
    for label, damping in dampings.items():
        hybrid, initial = _stiff_and_initial(name, damping)
        found.rows.append(_beside(label, hybrid, initial))
    return found


def _beside(label: str, hybrid: Curve, other: Curve) -> list:
    apart = np.abs(hybrid.ratio / other.ratio - 1.0)
    most = float(np.nanmax(apart))
    return [label, float(np.nanmean(apart)), most, hybrid.main, other.main]


STIFF, HEAVY, BOTH = "D1, stiff shafts", "D1, as heavy", "D1, as heavy, stiff shafts"


def _what_parts_them() -> list[list]:
    """The initial model with what the rigidified H2 has and it has not: either, and both."""
    own = moving(*_stiff("accessory", D1))
    hybrid = sweep(own.system)[0]
    masses = {
        gear: carried(own.scene, own.model, own.dynamics, index) for index, gear in enumerate(GEARS)
    }
    scene = example_scene("accessory", [*THESIS, *COARSE, "mesh.foundation=none", *D1])
    systems = {
        STIFF: set_going(scene, with_rigid_shaft(model_of(scene), *GEARS)).system,
        HEAVY: as_rigid("accessory", masses, *D1, stiff=False),
        BOTH: as_rigid("accessory", masses, *D1),
    }
    return [_beside(label, hybrid, sweep(each)[0]) for label, each in systems.items()]


def rigidified() -> Finding:
    """Fig. III-11: the rigidified H2 beside the initial model, by damping, and what parts them."""
    found = _rigidified("accessory", "Fig. III-11", {"modal": (), "D1": D1, "D2": D2})
    found.rows += _what_parts_them()
    mean = {row[0]: row[1] for row in found.rows}
    found.holds = {
        "in good agreement with D1: within 5 % in the mean over speed": mean["D1"] < 0.05,
        "the more damping, the less apart": mean["D2"] < mean["D1"] < mean["modal"],
        "with its masses and stiff shafts: within 0.2 % in the mean over speed": mean[BOTH] < 0.002,
        "with one of them alone: not": min(mean[STIFF], mean[HEAVY]) > 0.05,
    }
    return found


def rigidified_power() -> Finding:
    """Fig. III-15: the same of the power pair."""
    found = _rigidified("power", "Fig. III-15", DAMPINGS)
    found.holds = {
        "critical speeds alike: the highest peaks within 5 % of each other": all(
            abs(row[3] / row[4] - 1.0) < 0.05 for row in found.rows
        ),
        "amplitudes comparable: within 5 % in the mean over speed": all(
            row[1] < 0.05 for row in found.rows
        ),
    }
    return found
