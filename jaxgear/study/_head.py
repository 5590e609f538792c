"""What every summary begins and ends with, and what all studies have in common."""

import dataclasses
import functools
import importlib.metadata
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Concatenate, ParamSpec

from jaxgear._kept_programs import keeping_verbs
from jaxgear._process import peak_memory
from jaxgear._units import deg
from jaxgear.scene._assumed import assumed
from jaxgear.scene._gear_tables import GearKeys, PairKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._slips import odd
from jaxgear.scene._tables import MeshKeys, SweepKeys
from jaxgear.study._built import BuiltScene
from jaxgear.study._coast import as_coast, no_mirror_image
from jaxgear.study._drawing import drawing_summary
from jaxgear.study._notes import notes
from jaxgear.study._ranks import Doubtful, worst_first
from jaxgear.study._result import Result, Summary
from jaxgear.study._running import Clock, clock, stopwatch
from jaxgear.study._statics import Statics
from jaxgear.study._statics_summary import geometry_summary, mounts_summary


def names_of(name: str, cite: str) -> Summary:
    """What every summary begins with."""
    packages = ("jaxgear", "jax", "jaxlib", "equinox", "optax", "numpy", "scipy")
    versions = {each: importlib.metadata.version(each) for each in packages}
    return {"name": name, "cite": cite, "versions": versions}


def head(built: BuiltScene, statics: Statics) -> Summary:
    """Names, model, geometry and statics."""
    scene, known = built.scene, notes(built, statics)
    # What sliding leaves of the power, and what was assumed.
    friction = scene.mesh.friction_coefficient
    efficiency = 1.0 - friction * float(statics.numbers["mesh_loss_factor"])
    # Modes with which condensed bodies vibrate; none in statics.
    bases = [body.basis for body in scene.bodies.values() if body.basis is not None]
    modes = sum(len(basis.square) for basis in bases)
    return {
        **names_of(scene.name, scene.cite),
        "model": {
            "pinion": scene.pinion.body.kind,
            "wheel": scene.wheel.body.kind,
            "stiffness": scene.mesh.stiffness,
            "foundation": foundation_of(scene.mesh, scene.gears, scene.bodies),
            "contact": scene.mesh.contact,
            "slices": scene.mesh.slices,
            # Time steps, where statics are those that the dynamics begin with.
            "phases": statics.grid.phases,
            # Both gears' rotations are one coordinate: the drive.
            "dofs": len(statics.cycle.system.structure.map.free) - 1 + modes,
        },
        "geometry": geometry_summary(statics.model.pair)
        # Thesis eq. 3.3: what a growth of both base radii, by centrifugal load say, does.
        | {"pressure_angle_change_deg_per_permille_base_radius": float(statics.angle_change) / deg}
        | drawing_summary(scene.gears, statics.model.pair),
        "iso6336": {key: float(value) for key, value in statics.standard.items()},
        "static": {
            **{key: float(value) for key, value in statics.numbers.items()},
            "friction_coefficient": friction,
            "mesh_efficiency": efficiency,
            **mounts_summary(statics),
        },
        "notes": known,
        **_told_bodies(scene.bodies, scene.gears, scene.sweep, known),
    }


def foundation_of(mesh: MeshKeys, gears: Mapping[str, GearKeys], bodies: Collection[str]) -> str:
    """What gives under the teeth of either gear, one with a body of its own or not; or of both."""
    if not bodies and not any(each.foundation for each in gears.values()):
        return mesh.foundation
    return ", ".join(
        f"{gear} "
        + ("its condensed body" if gear in bodies else each.foundation or mesh.foundation)
        for gear, each in gears.items()
    )


def _told_bodies(
    bodies: Mapping[str, Any], gears: Mapping[str, GearKeys], asked: SweepKeys, known: list[str]
) -> Summary:
    """What the condensed bodies are, as `condense` says it, and all notes; empty without them."""
    if not bodies:
        return {}
    from jaxgear.study._condense import body_remarks, body_summary, fastest_of

    rows, said = [], []
    for gear, found in ((gear, each.built) for gear, each in bodies.items()):
        rows.append(body_summary(found, fastest_of(asked, gears, gear)))
        said += [*found.warnings, *body_remarks(gears[gear], found)]
    return {"bodies": rows, "notes": known + said}


def finished(summary: Summary, said: Sequence[str], spent: Clock) -> Summary:
    """A summary with what is said of its scene and its other remarks, the worst first; its cost."""
    compiling, running = spent.read()
    summary["cost"] = {
        "compile_s": compiling,
        "run_s": running,
        "peak_memory_MB": peak_memory(),
    }
    if said or "notes" in summary:
        summary["notes"] = worst_first([*said, *summary.get("notes", ())])
    return summary


_More = ParamSpec("_More")
# Studies that have a meaning at torque 0.
_WITHOUT_LOAD = ("run", "statics", "condense")


def without_load(pair: PairKeys, *, what: str) -> Iterator[tuple[str, str]]:
    """Torque 0, if it is, as the mistake of a scene for what has no meaning without load."""
    if pair.torque_pinion_Nm == 0.0:
        yield (
            "pair.torque_pinion_Nm",
            f"got 0: {what.replace('_', ' ')} has no meaning without load. Give a torque, or let "
            "`jaxgear run` find the transmission error of rigid gears",
        )


def study(
    found: Callable[Concatenate[Scene, _More], Result],
) -> Callable[Concatenate[Scene, _More], Result]:
    """A study as users call it: timed, its remarks in order, its cost in the summary."""

    @functools.wraps(found)
    def studied(scene: Scene, *more: _More.args, **named: _More.kwargs) -> Result:
        pair = scene.plain.pair
        if studied.__name__ not in _WITHOUT_LOAD:
            scene.refuse(without_load(pair, what=studied.__name__))
        if pair.sense < 0:
            of = pair, scene.gears, scene.flank, scene.optimise
            periods, what = scene.mesh.periods, studied.__name__
            scene.refuse(no_mirror_image(*of, periods=periods, what=what))
        with stopwatch(), keeping_verbs(), clock() as spent:
            result = found(scene, *more, **named)
            if pair.sense < 0:
                result = as_coast(result)
            said = [*map(Doubtful, odd(scene)), *assumed(scene)]
            return dataclasses.replace(result, summary=finished(result.summary, said, spent))

    return studied
