"""Scenes, good as they are, that do not go with a command: refused before anything heavy."""

from jaxgear._checks import InputError
from jaxgear.scene._motion import motion_mistakes
from jaxgear.scene._scene import Mistake, Scene, SceneError
from jaxgear.scene._schema import GEARS


def refuse_unfit(command: str, scene: Scene) -> None:
    """Refuse a good scene that does not go with the command.

    **Raises:**

    - `InputError` or `SceneError` if it does not.
    """
    condensed = scene.condensed
    if command == "condense" and not condensed:
        raise InputError(_nothing_to_condense(scene))
    if condensed and command != "condense" and scene.mesh.stiffness == "iso6336":
        words = (
            'got "iso6336", whose stiffness includes the gear body, and a condensed body brings '
            'its own. Write "weber-banaschek"'
        )
        raise SceneError([Mistake(scene.where("mesh.stiffness"), "mesh.stiffness", words)])
    if command == "sweep" and not scene.has_table("sweep"):
        raise InputError(
            f"{scene.path}: the scene does not say which speeds to sweep. Add these lines:\n\n"
            "[sweep]\n"
            "pinion_speed_rad_s = { from = 50.0, to = 3000.0, points = 300 }    # or a list\n"
            'direction = "both"                    # up | down | both | cold\n',
        )
    if command == "sweep" or (command == "run" and scene.has_table("sweep")):
        if mistakes := _sweep_mistakes(scene):
            raise SceneError(mistakes)
    if command in ("compare", "sensitivity", "check-grad") and scene.has_table("sweep"):
        if mistakes := motion_mistakes(scene, harmonic=True):
            raise SceneError(mistakes)
    if command == "optimise" and not scene.has_table("optimise"):
        raise InputError(
            f"{scene.path}: the scene does not say what to optimise. Add a table [optimise] with "
            'vary = ["flank.pinion.tip_relief.depth_um"], or more keys.',
        )


def _nothing_to_condense(scene: Scene) -> str:
    """Say what a condensed body would be, or which key keeps it from being one."""
    for gear in GEARS:
        for source in ("web", "grid", "superelement"):
            if scene.has_table(f"{gear}.body.{source}"):
                kind = scene.gear(gear).body.kind
                return (
                    f"{scene.path}: no gear body of the scene is condensed: {gear}.body has "
                    f'{source}, but its kind is "{kind}". Write kind = "condensed" in '
                    f"[{gear}.body], or --set {gear}.body.kind=condensed."
                )
    return (
        f"{scene.path}: no gear body of the scene is condensed. Write, for instance,\n\n"
        '[wheel.body]\nkind = "condensed"\n'
        "web = { hub_outer_mm = 50.0, web_thickness_mm = 4.0, rim_inner_mm = 118.0 }\n\n"
        "or leave web out for a solid body."
    )


def _sweep_mistakes(scene: Scene) -> list[Mistake]:
    """What is wrong with a scene, good as it is for all else, if it is to be swept."""
    method = scene.sweep.method
    found = motion_mistakes(scene, harmonic=method in ("auto", "harmonic"))
    if scene.sweep.continuation and method in ("newmark", "shooting"):
        key = "sweep.continuation"
        words = f'got true, which needs harmonic balance, but sweep.method is "{method}". Keep one'
        found.append(Mistake(scene.where(key), key, words))
    return found
