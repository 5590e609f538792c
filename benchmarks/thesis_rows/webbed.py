"""The power pair with a webbed pinion, at rest and at 3000 rad/s: what its flanks carry."""

import dataclasses
import functools
from typing import NamedTuple

import jax.numpy as jnp

import jaxgear as jg
from jaxgear import grid_of, model_of

from .finding import Finding
from .leads import PLAIN, SPEED, WEBS, Across, only, prepared, seen_across
from .statics import scene_of, web

_FINE = ("mesh.slices=20", "mesh.phases=32", f"mesh.pinion_speed_rad_s={SPEED}")
_DEPTHS = 0.0, 5.0, 10.0, 15.0, 20.0
_COLUMNS = ["web", "rad/s", "crowning um", "left MPa", "mid", "right", "largest", "at", "offset"]


class _Pair(NamedTuple):
    """A pair and its meshes at speed and at rest."""

    model: jg.PairModel
    quick: jg.PreparedMesh
    still: jg.PreparedMesh


# Several bodies at once are more than a small machine holds.
@functools.lru_cache(maxsize=1)
def _pair(name: str, thickness: float) -> _Pair:
    scene = scene_of(name, *_FINE, *web(web_thickness_mm=thickness))
    model = model_of(scene)
    resting = dataclasses.replace(model, speed=jnp.zeros(()))
    grid = grid_of(scene, model)
    return _Pair(model, prepared(model, grid), prepared(resting, grid))


@functools.cache
def _asked(scene: str, label: str) -> dict[tuple[float, float], Across]:
    """A web at rest, and at speed with growing crowning of the pinion."""
    pair = _pair(scene, WEBS[label])
    found = {(0.0, 0.0): seen_across(pair.model, pair.still, PLAIN)}
    for depth in _DEPTHS:
        found[SPEED, depth] = seen_across(pair.model, pair.quick, only("crowning", depth))
    return found


def _tell(found: Finding, label: str, speed: float, depth: float, each: Across) -> None:
    middle = each.pressure[len(each.pressure) // 2]
    row = [each.pressure[0], middle, each.pressure[-1], each.highest, each.place(), each.offset]
    found.rows.append([label, speed, depth, *(float(x) for x in row)])


def flanks() -> Finding:
    """Fig. IV-36, IV-39, IV-43 to IV-50: webbed pinion, webs O, D, E."""
    found = Finding(
        "Pressure across the face with a webbed pinion (Fig. IV-36, IV-39, IV-43 to IV-50)",
        "at rest largest at about 30 of 40 mm, the thinner the web the more centred; at 3000 rad/s "
        "overload at both edges, E most; crowning brings the largest pressure to the middle, above "
        "10 um edges unload, 20 um loses contact there; the depth that does differs per web",
        _COLUMNS,
    )
    solid = _asked("power-h1", "O")
    _tell(found, "O, solid pinion", 0.0, 0.0, solid[0.0, 0.0])
    every = {label: _asked("power-webbed-pinion", label) for label in WEBS}
    for label, own in every.items():
        for (speed, depth), each in own.items():
            _tell(found, label, speed, depth, each)
    rest = [own[0.0, 0.0] for own in every.values()]
    fast = [own[SPEED, 0.0] for own in every.values()]
    first = every["O"]
    edges = lambda each: (float(each.pressure[0]), float(each.pressure[-1]))
    overloaded = [min(edges(each)) > float(each.pressure[len(each.pressure) // 2]) for each in fast]
    lost = {label: min(edges(own[SPEED, 15.0])) for label, own in every.items()}
    found.holds = {
        "at rest the webbed pinion moves the largest pressure inwards": abs(rest[0].place())
        < abs(solid[0.0, 0.0].place()),
        "... to 30 of 40 mm (to 3 mm)": abs(abs(rest[0].place()) * 20.0 - 10.0) < 3.0,
        "at rest the pressure is more centred, the thinner the web": abs(rest[0].offset)
        > abs(rest[1].offset)
        > abs(rest[2].offset),
        "at rest the largest pressure falls, the thinner the web": rest[0].highest
        > rest[1].highest
        > rest[2].highest,
        "web O at speed: both edges carry more than the middle": overloaded[0],
        "at speed both edges carry more than the middle": all(overloaded),
        "the largest pressure is on the other side at speed": all(
            a.place() * b.place() < 0.0 for a, b in zip(rest, fast, strict=True)
        ),
        "at speed E has the largest pressure": fast[2].highest
        == max(each.highest for each in fast),
        "10 um bring the largest pressure within half of the face about its middle": abs(
            first[SPEED, 10.0].place()
        )
        < 0.5,
        "15 and 20 um bring it within a fifth": max(
            abs(first[SPEED, depth].place()) for depth in (15.0, 20.0)
        )
        < 0.2,
        "above 10 um both edges are less loaded, the more": all(
            edges(first[SPEED, 20.0])[i]
            < edges(first[SPEED, 15.0])[i]
            < edges(first[SPEED, 10.0])[i]
            for i in (0, 1)
        ),
        "20 um loses contact at an edge": min(edges(first[SPEED, 20.0])) < 1.0,
        "at 15 um an edge has lost contact with one web, and not with another": min(lost.values())
        < 1.0
        < max(lost.values()),
    }
    return found
