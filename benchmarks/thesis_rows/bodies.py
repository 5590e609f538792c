"""Mean and RMS of the transmission error, rigidified bodies, best relief: bodies at rest."""

import numpy as np

from jaxgear import example_scene, grid_of, model_of

from .finding import Finding
from .statics import (
    STIFF_GPA,
    THESIS,
    WEBBED,
    best_depth,
    helical,
    only_pair,
    rigid_body,
    scene_of,
    solved,
    solved_model,
    web,
    with_rigid_shaft,
)


def transmission() -> Finding:
    """Tab. III-4: mean and RMS of the transmission error."""
    found = Finding(
        "Transmission error of the accessory pair (Tab. III-4, Fig. III-8)",
        "RMS 2.92 um initial; H1 2.36 rigid, 2.33 flexible; H2 1.79 rigid, 1.80 flexible; "
        "mean from 19 to 41 um",
        ["model", "mean um", "RMS um", "peak to peak um", "RMS over initial"],
    )
    none = "wheel.foundation=none"
    cases = {
        "rigid bodies, own foundations": ("accessory",),
        "  without the wheel's": ("accessory", none),
        "  without both": ("accessory", "mesh.foundation=none"),
        "H1 rigidified": ("accessory-h1", rigid_body("wheel")),
        "H1, web 5 mm": ("accessory-h1", *web(web_thickness_mm=5.0)),
        "H1, web 3 mm": ("accessory-h1",),
        "H1, web 2 mm": ("accessory-h1", *web(web_thickness_mm=2.0)),
        "H2 rigidified": ("accessory-h2", rigid_body("pinion"), rigid_body("wheel")),
        "H2, solid pinion": ("accessory-h2",),
        "H2, webbed pinion": ("accessory-h2", *WEBBED),
    }
    all_of = {name: solved(*case) for name, case in cases.items()}
    initial = all_of["rigid bodies, own foundations"]
    for name, each in all_of.items():
        peak = each.numbers["te_peak_to_peak_um"]
        found.rows.append([name, each.mean, each.rms, peak, each.rms / initial.rms])
    h1 = [all_of[f"H1, web {t} mm"] for t in (5, 3, 2)]
    h2 = all_of["H2, solid pinion"]
    bare, barer = all_of["  without the wheel's"], all_of["  without both"]
    found.holds = {
        "a flexible wheel raises the mean over the rigid pair with its foundations": all(
            each.mean > initial.mean for each in h1
        ),
        "... and more, the thinner its web": h1[0].mean < h1[1].mean < h1[2].mean,
        "a flexible pinion as well raises it further": h2.mean > h1[1].mean,
        "a webbed pinion raises it further": all_of["H2, webbed pinion"].mean > h2.mean,
        "RMS falls from the initial model to H1 flexible": h1[1].rms < initial.rms,
        "RMS falls from H1 to H2, both flexible": h2.rms < h1[1].rms,
        "RMS of H1 hardly depends on the web (within 5 %)": np.ptp([x.rms for x in h1])
        < 0.05 * h1[1].rms,
        "RMS of H1: flexible within 2 % of rigidified, as the thesis has it": abs(
            h1[1].rms / all_of["H1 rigidified"].rms - 1.0
        )
        < 0.02,
        "RMS of H1 flexible lies above the rigid pair without the wheel's foundation": h1[1].rms
        > bare.rms,
        "RMS of H2 flexible lies above the rigid pair without foundations": h2.rms > barer.rms,
    }
    return found


def rigidified() -> Finding:
    """Rigidified hybrids against rigid bodies without foundations, on stiff shafts."""
    found = Finding(
        "Rigidified bodies against rigid ones without their foundation, on as stiff shafts",
        "all models give similar results; largest difference of the line load 3.5 %",
        ["pair", "young GPa", "mean um", "mean %", "RMS %", "load %", "bearings %"],
    )
    cases = [
        ("accessory", "h1", ("wheel",), STIFF_GPA),
        ("accessory", "h1", ("wheel",), 10.0 * STIFF_GPA),
        ("accessory", "h2", ("pinion", "wheel"), STIFF_GPA),
        ("power", "h1", ("wheel",), STIFF_GPA),
        ("power", "h2", ("pinion", "wheel"), STIFF_GPA),
    ]
    within: dict[tuple[str, str, float], float] = {}
    for name, kind, gears, young in cases:
        stiff = [f"{gear}.body.young_GPa={young:g}" for gear in gears]
        hybrid = solved(f"{name}-{kind}", *stiff)
        scene = example_scene(name, [*THESIS, *(f"{gear}.foundation=none" for gear in gears)])
        model = with_rigid_shaft(model_of(scene), *gears)
        rigid = solved_model(model, grid_of(scene, model))
        off = [
            hybrid.mean / rigid.mean - 1.0,
            hybrid.rms / rigid.rms - 1.0,
            np.abs(hybrid.crest - rigid.crest).max() / rigid.crest.max(),
            np.abs(hybrid.bearings - rigid.bearings).max() / np.abs(rigid.bearings).max(),
        ]
        within[name, kind, young] = float(np.abs(off).max())
        label = f"{name} {kind.upper()}"
        found.rows.append([label, young, hybrid.mean, *(100.0 * float(each) for each in off)])
    for (name, kind, young), worst in within.items():
        if young == STIFF_GPA:
            found.holds[f"{name} {kind.upper()} within 1 %"] = worst < 0.01
    return found


def master_curve() -> Finding:
    """Fig. III-9, IV-2 and IV-16: where the best relief lies."""
    found = Finding(
        "Depth of the best symmetric tip relief at given extents (Fig. III-9, IV-2, IV-16)",
        "stays on the rigid pair's Master Curve with a centred straight web and spur teeth; moves "
        "to deeper relief with helical teeth, and with a webbed pinion",
        ["pair", "extent", "rigid um", "flexible um", "ratio", "RMS least", "RMS plain"],
    )
    spur = {
        "spur, web 5 mm": ("accessory-h1", web(web_thickness_mm=5.0)),
        "spur, web 3 mm": ("accessory-h1", []),
        "spur, web 2 mm": ("accessory-h1", web(web_thickness_mm=2.0)),
    }
    others = {
        "spur, H2": ("accessory-h2", []),
        "spur, H2, webbed pinion": ("accessory-h2", WEBBED),
        "base helix 10 deg": ("accessory-h1", helical(10.0)),
        "base helix 20 deg": ("accessory-h1", helical(20.0)),
    }
    ratios: dict[str, list[float]] = {}
    for label, (name, settings) in (spur | others).items():
        scene = scene_of(name, *settings)
        rigid = example_scene("accessory", [*THESIS, *only_pair(settings)])
        for extent in (0.2, 0.25, 0.29):
            own = best_depth(rigid, extent, 60.0)
            depth, least, plain = best_depth(scene, extent, 60.0)
            ratios.setdefault(label, []).append(depth / own[0])
            found.rows.append([label, extent, own[0], depth, depth / own[0], least, plain])
    least_of = lambda x: found.values("RMS least", f"base helix {x} deg")
    stays = all(abs(ratio - 1.0) < 0.1 for label in spur for ratio in ratios[label])
    found.holds = {
        "spur, centred straight web: the depth stays within 10 % of the rigid pair's": stays,
        **{
            f"{label}: deeper than the rigid pair's at every extent": min(ratios[label]) > 1.0
            for label in others
            if label != "spur, H2"
        },
        "the least RMS is larger at 20 degrees of base helix than at 10": all(
            a > b for a, b in zip(least_of(20), least_of(10), strict=True)
        ),
        "webbed pinion: deeper than with a solid one": all(
            a > b
            for a, b in zip(ratios["spur, H2, webbed pinion"], ratios["spur, H2"], strict=True)
        ),
    }
    return found
