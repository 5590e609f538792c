"""What a scene needs to be set in motion: checked before anything heavy is imported."""

from collections.abc import Iterator

from jaxgear.scene._tables import DampingKeys, SweepKeys


def motion_mistakes(
    damping: DampingKeys, sweep: SweepKeys, *, harmonic: bool
) -> Iterator[tuple[str, str]]:
    """Keys that keep a scene, good as it is for all else, from having steady responses, and why."""
    modal = damping.kind == "modal"
    damped = ("mesh", "structure") if modal else ("a_R_1_s", "b_R_s")
    if not any(getattr(damping, key) for key in damped):
        yield (
            f"damping.{damped[0]}",
            f"no damping: at a resonance there is no steady response. Give damping.{damped[0]} or "
            f"damping.{damped[1]} a value > 0; `jaxgear modes` does without",
        )
    if damping.active_mesh and not modal:
        yield (
            "damping.active_mesh",
            "got true, which needs a damping ratio of the mesh: Rayleigh damping has none. Write "
            'damping.kind = "modal"',
        )
    if harmonic and 2 * sweep.harmonics >= sweep.steps:
        yield (
            "sweep.harmonics",
            f"got {sweep.harmonics}, must be less than half of sweep.steps, {sweep.steps}: there "
            "are no more harmonics in so few time steps",
        )
