"""Scenes, good as they are, that do not go with a command: refused before anything heavy."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from jaxgear._checks import InputError
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._motion import motion_mistakes
from jaxgear.scene._scene import Scene
from jaxgear.scene._tables import DampingKeys, SweepKeys


def refuse_unfit(command: str, scene: Scene) -> None:
    """Refuse a good scene that does not go with the command.

    **Raises:**

    - `InputError` or `SceneError` if it does not.
    """
    condensed = scene.condensed
    if command == "condense" and not condensed:
        raise InputError(_nothing_to_condense(scene.path, scene.gears))
    if condensed and command != "condense" and scene.mesh.stiffness == "iso6336":
        words = (
            'got "iso6336", whose stiffness includes the gear body, and a condensed body brings '
            'its own. Write "weber-banaschek"'
        )
        scene.refuse([("mesh.stiffness", words)])
    if command == "sweep" and not scene.sweep.is_given:
        raise InputError(
            f"{scene.path}: the scene does not say which speeds to sweep. Add these lines:\n\n"
            "[sweep]\n"
            "pinion_speed_rad_s = { from = 50.0, to = 3000.0, points = 300 }    # or a list\n"
            'direction = "both"                    # up | down | both | cold\n',
        )
    if command == "sweep" or (command == "run" and scene.sweep.is_given):
        scene.refuse(_sweep_mistakes(scene.damping, scene.sweep))
    if command in ("compare", "sensitivity", "check-grad") and scene.sweep.is_given:
        scene.refuse(motion_mistakes(scene.damping, scene.sweep, harmonic=True))
    if command == "optimise" and not scene.optimise.is_given:
        raise InputError(
            f"{scene.path}: the scene does not say what to optimise. Add a table [optimise] with "
            'vary = ["flank.pinion.tip_relief.depth_um"], or more keys.',
        )


def _nothing_to_condense(path: Path, gears: Mapping[str, GearKeys]) -> str:
    """Say what a condensed body would be, or which key keeps it from being one."""
    for gear, body in ((gear, each.body) for gear, each in gears.items()):
        for source in ("web", "grid", "superelement"):
            if source in body.given:
                return (
                    f"{path}: no gear body of the scene is condensed: {gear}.body has "
                    f'{source}, but its kind is "{body.kind}". Write kind = "condensed" in '
                    f"[{gear}.body], or --set {gear}.body.kind=condensed."
                )
    return (
        f"{path}: no gear body of the scene is condensed. Write, for instance,\n\n"
        '[wheel.body]\nkind = "condensed"\n'
        "web = { hub_outer_mm = 50.0, web_thickness_mm = 4.0, rim_inner_mm = 118.0 }\n\n"
        "or leave web out for a solid body."
    )


def _sweep_mistakes(damping: DampingKeys, sweep: SweepKeys) -> Iterator[tuple[str, str]]:
    """What is wrong with a scene, good as it is for all else, if it is to be swept."""
    method = sweep.method
    yield from motion_mistakes(damping, sweep, harmonic=method in ("auto", "harmonic"))
    if sweep.continuation and method in ("newmark", "shooting"):
        words = f'got true, which needs harmonic balance, but sweep.method is "{method}". Keep one'
        yield "sweep.continuation", words
