"""Levels of the quasi-static cycle: bodies, slices, phases, foundation, line loads, contact."""

from collections.abc import Mapping, Sequence
from typing import Any

from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._fidelity._level import Level

_SLICES, _PHASES = (1, 5, 10, 20, 40), (16, 32, 64, 128)
# Positions in the period of the highest harmonic that a search looks at.
_IN_HARMONIC = 8


def static_levels(scene: Scene, *, few: bool = False) -> list[Level]:
    """Models of the quasi-static cycle: the scene itself first, then family by family.

    **Arguments:**

    - `scene`: checked against the schema.
    - `few`: whether only what can save time is wanted, and not more than is likely to.
    """
    own, phases = scene["mesh.slices"], scene["mesh.phases"]
    # What is finer than the scene itself can save nothing, and takes long with condensed bodies.
    coarser = few or bool(scene.condensed)
    counts = (() if needs_its_slices(scene) else (5,)) if few else _SLICES
    least = _IN_HARMONIC * max(scene.get("optimise.harmonics", (1.0,))) if few else 0
    levels = [Level("as given", "as given")]
    levels += [Level(name, "bodies", "bodies", x) for name, x in simpler_bodies(scene).items()]
    levels += [
        Level(f"{n} slice{'s' if n > 1 else ''}", "slices", "slices", {"mesh.slices": n})
        for n in counts
        if n < own or (n > own and not coarser)
    ]
    levels += [
        Level(f"{n} phases", "phases", "phases", {"mesh.phases": n})
        for n in ((16, 32) if few else _PHASES)
        if n >= least and (n < phases or (n > phases and not coarser))
    ]
    if scene["mesh.stiffness"] == "weber-banaschek":
        levels += _on_stiffness(scene, few)
    if not few:
        other = "smooth" if scene["mesh.contact"] == "exact" else "exact"
        levels.append(Level(f"{other} contact", "contact", "contact", {"mesh.contact": other}))
    return [level for level in levels if not takes_away(scene, level.changes)]


def simpler_bodies(scene: Scene) -> Mapping[str, Mapping[str, Any]]:
    """What makes the bodies of a scene simpler: changes of keys, by the name of the level.

    Condensed bodies and beams are made rigid, each alone and together, with and without a
    foundation; the pair without shafts and bearings only turns.
    """
    found: dict[str, Mapping[str, Any]] = {}
    elastic = [gear for gear in GEARS if scene[f"{gear}.body.kind"] != "rigid"]
    rigid = {f"{gear}.body.kind": "rigid" for gear in elastic}
    if len(elastic) == len(GEARS):
        found["rigid pinion"] = {"pinion.body.kind": "rigid"}
    if elastic:
        found["rigid bodies"] = rigid
    if scene.condensed:
        bare = {f"{gear}.foundation": "none" for gear in scene.condensed}
        found["rigid bodies, no foundation"] = rigid | bare
    mounts = [
        f"{gear}.{mount}"
        for gear in GEARS
        for mount in ("shaft", "support")
        if any(key.startswith(f"{gear}.{mount}.") for key in scene.values)
    ]
    loaded = any(scene.rows(f"{gear}.shaft.loads") for gear in GEARS)
    if mounts and not loaded and scene.get("housing.stiffness_csv") is None:
        found["torsional pair"] = rigid | dict.fromkeys(mounts)
    return found


def _on_stiffness(scene: Scene, few: bool) -> list[Level]:
    """Foundations and line loads: less than the scene has, and what lies beyond it."""
    key, updates = "mesh.line_load_updates", scene["mesh.line_load_updates"]
    found = []
    chosen = {
        gear: scene.get(f"{gear}.foundation", scene["mesh.foundation"])
        for gear in GEARS
        if gear not in scene.condensed
    }
    less = {f"{gear}.foundation": "weber" for gear, name in chosen.items() if name == "ring"}
    none = {f"{gear}.foundation": "none" for gear, name in chosen.items() if name != "none"}
    if less:
        found.append(Level("Weber foundation", "foundation", "foundation", less))
    if scene["mesh.face_coupling"] == "coupled":
        apart = {"mesh.face_coupling": "none"}
        found.append(Level("slices apart", "face coupling", "face coupling", apart))
    if updates:
        found.append(Level("nominal line load", "line loads", "line loads", {key: 0}))
    if none and not few:
        found.append(Level("no foundation", "foundation", "foundation", none))
    if not updates and not few:
        more = {key: 2}
        found.append(Level("2 line load updates", "beyond the scene", "", more, beyond=True))
    return found


def takes_away(scene: Scene, changes: Mapping[str, Any], more: Sequence[str] = ()) -> bool:
    """Whether changes of a scene take away what its search names, or one of `more` keys."""
    tables = [key for key, value in changes.items() if value is None]
    tables += [key.removesuffix(".kind") for key in changes if key.endswith(".body.kind")]
    named = [*_named(scene), *more]
    return any(key.startswith(f"{table}.") for key in named for table in tables)


def _named(scene: Scene) -> list[str]:
    """Keys that a search varies, ties, lets scatter or looks at."""
    if not scene.has_table("optimise"):
        return []
    small = scene.get("optimise.minimise"), scene.get("optimise.pareto.against")
    forces = "bearing_force" in small or scene.get("optimise.minimise.bearing_force") is not None
    bearings = [f"{gear}.shaft.bearings" for gear in GEARS] if forces else []
    tables = ("optimise.ties.", "robust.scatter.", "robust.even.")
    others = [key.removeprefix(table) for table in tables for key in scene.values
              if key.startswith(table)]  # fmt: skip
    return [*scene["optimise.vary"], *others, *bearings]


def needs_its_slices(scene: Scene) -> bool:
    """Whether a search limits the load of the last slices, which other slices have not."""
    limited = scene.get("optimise.limits.edge_line_load_N_mm") is not None
    return limited and scene.has_table("optimise")
