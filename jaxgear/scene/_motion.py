"""What a scene needs to be set in motion: checked before anything heavy is imported."""

from jaxgear.scene._scene import Mistake, Scene


def motion_mistakes(scene: Scene, *, harmonic: bool) -> list[Mistake]:
    """What keeps a scene, good as it is for all else, from having steady responses."""
    found = []

    def mistake(key: str, message: str) -> None:
        found.append(Mistake(scene.where(key), key, message))

    modal = scene.damping.kind == "modal"
    damped = ("mesh", "structure") if modal else ("a_R_1_s", "b_R_s")
    if not any(getattr(scene.damping, key) for key in damped):
        mistake(
            f"damping.{damped[0]}",
            f"no damping: at a resonance there is no steady response. Give damping.{damped[0]} or "
            f"damping.{damped[1]} a value > 0; `jaxgear modes` does without",
        )
    if scene.damping.active_mesh and not modal:
        mistake(
            "damping.active_mesh",
            "got true, which needs a damping ratio of the mesh: Rayleigh damping has none. Write "
            'damping.kind = "modal"',
        )
    steps, harmonics = scene.sweep.steps, scene.sweep.harmonics
    if harmonic and 2 * harmonics >= steps:
        mistake(
            "sweep.harmonics",
            f"got {harmonics}, must be less than half of sweep.steps, {steps}: there are no more "
            "harmonics in so few time steps",
        )
    return found
