"""Remarks on responses at speed: where a sweep is outgrown, or sees nothing."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import optimise
from jaxgear._system._body_modes import BodyBasis
from jaxgear._system._excited_shapes import natural_among
from jaxgear.scene._scene import Scene
from jaxgear.scene._tables import SweepKeys
from jaxgear.study._dynamics import Size, method_name, speeds_of
from jaxgear.study._ranks import Doubtful, Idle
from jaxgear.study._steady import SteadyPoint

# Fewer time steps in the period of a mode do not show it: its frequency is then off by 3 %.
STEPS_IN_PERIOD = 10


def sweep_notes(
    scene: Scene,
    unsettled: int,
    responses: int,
    lost: Sequence[str] = (),
    passed_over: Sequence[tuple[float, float]] = (),
) -> list[str]:
    """Remarks on a sweep: what does nothing, is out of reach, did not settle, or was lost.

    And ranges of speed that it passes over in which its branch is unstable [rad/s].
    """
    found: list[str] = []
    if scene.sweep.centrifugal and not scene.condensed:
        found.append(
            Idle("Rigid and beam bodies do not grow: sweep.centrifugal does nothing to them.")
        )
    if scene.model.coordinates and not scene.condensed:
        found.append(Idle("model.coordinates does nothing: all modes of these bodies are kept."))
    bodies = {gear: each for gear, each in scene.bodies.items() if each.basis is not None}
    asked = scene.model.coordinates if "coordinates" in scene.model.given else None
    found += _beyond_bodies(asked or 0, {gear: each.basis for gear, each in bodies.items()})
    if bodies and scene.sweep.is_given:
        # Approach and tilt stand beside the mesh coordinates.
        size = Size(2 + scene.at_mesh, scene.mesh.periods)
        natural = {gear: _natural(each) for gear, each in bodies.items()}
        found += _beyond_reach(scene.sweep, size, scene.pinion.teeth, natural)
    if unsettled:
        found.append(
            Doubtful(
                f"{unsettled} of {responses} responses did not converge: their numbers are those "
                "of the last time steps. Raise sweep.cycles; but where the amplitude beats, or "
                "motion is chaotic, there is nothing to converge to."
            )
        )
    found += [
        f"The branch was followed no further: {why}. What lies beyond is shown by the sweep alone."
        for why in lost
    ]
    if passed_over:
        ranges = ", ".join(f"{low:.6g} to {high:.6g}" for low, high in passed_over)
        found.append(
            Doubtful(
                f"Between the speeds of the sweep its branch is unstable: {ranges} rad/s. Add "
                "speeds there to sweep.pinion_speed_rad_s to see what a machine does instead."
            )
        )
    return found


def _natural(body: Any) -> BodyBasis:
    """The natural modes of a body in motion; of excited shapes they are the lowest."""
    basis: BodyBasis = body.basis
    count = len(basis.square)
    if body.made_of is not None:
        count = natural_among(count, basis.waves)
    return dataclasses.replace(
        basis, square=basis.square[:count], diameters=basis.diameters[:count]
    )


def _beyond_bodies(asked: int, bases: Mapping[str, BodyBasis]) -> list[str]:
    """More modes asked for than bodies have."""
    found = []
    for gear, basis in bases.items():
        has = len(basis.square)
        # The last pair is never parted.
        if asked > has + 1:
            found.append(
                f"model.coordinates asks for {asked} modes, but the {gear}'s condensed body has "
                f"{has}: all of them are kept. Raise {gear}.body.modes, or make its rim's elements "
                "smaller, for more."
            )
    return found


def _beyond_reach(
    asked: SweepKeys, size: Size, teeth: int, bases: Mapping[str, BodyBasis]
) -> list[str]:
    """The highest mode of a condensed body, where steps or harmonics are too few to follow it."""
    gear, basis = max(bases.items(), key=lambda each: float(each[1].square.max()))
    mode, speeds = int(np.argmax(basis.square)), speeds_of(asked)
    frequency = math.sqrt(float(basis.square[mode])) / (2.0 * math.pi)
    harmonic = method_name(asked, size) == "harmonic"
    key = "sweep.harmonics" if harmonic else "sweep.steps"
    given = asked.harmonics if harmonic else asked.steps
    # Up to which multiple of the mesh frequency a response is followed, and what that takes.
    per = 1.0 if harmonic else 1.0 / STEPS_IN_PERIOD
    order = lambda speed: 2.0 * math.pi * frequency / (teeth * speed)
    limit = order(1.0) / (per * given)
    if limit <= speeds[0]:
        return []
    need = lambda speed: math.ceil(order(speed) / per)
    where = (
        f"at all speeds up to {speeds[-1]:.5g} rad/s"
        if limit > speeds[-1]
        else f"below {limit:.5g} rad/s"
    )
    wants = f"{need(speeds[-1])} at {speeds[-1]:.5g} rad/s, {need(speeds[0])} at {speeds[0]:.5g}"
    beside = ", and more than twice as many sweep.steps" if harmonic else ""
    return [
        f"{key} = {given} reaches less far than mode {mode + 1} of the {gear}'s body, "
        f"{frequency:.5g} Hz with {int(basis.diameters[mode])} nodal diameters, its seats held, "
        f"{where}: there it follows its load, but does not vibrate. To see it vibrate, {key} must "
        f"be at least {wants} rad/s{beside}."
    ]


def steady_notes(points: Sequence[SteadyPoint]) -> list[str]:
    """Why steady responses were not differentiated."""
    found = []
    for point in points:
        at = f"With {point.contact} contact the response at {point.speed_rad_s:.6g} rad/s "
        match point.verdict:
            case "not converged":
                size = "not finite" if point.residual is None else f"{point.residual:.3g}"
                why = f"has not converged, imbalance {size}"
            case "near a fold":
                size = "not finite" if point.condition is None else f"{point.condition:.3g}"
                why = f"is at a fold, or close to one, condition {size}"
            case "too many unknowns":
                why = "is over too many mesh periods for a matrix of its harmonics"
            case _:
                continue
        found.append(
            f"{at}{why}: it has no derivatives here. The speed is the middle one of "
            "sweep.pinion_speed_rad_s; choose others."
        )
    return found


def left_out_notes(
    before: Sequence[tuple[float, optimise.SpeedResults]],
    after: Sequence[tuple[float, optimise.SpeedResults]],
) -> list[str]:
    """What a search over speeds does not cover, from what each speed contributes at its ends."""
    found: list[str] = []
    for when, judged in (("before", before), ("after", after)):
        for torque, each in judged:
            if speeds := [float(speed) for speed in each.left_out]:
                named = ", ".join(f"{speed:.5g}" for speed in speeds[:8])
                more = ", ..." if len(speeds) > 8 else ""
                found.append(
                    Doubtful(
                        f"{len(speeds)} of {each.speed.size} speeds were left out of what is taken "
                        f"over speeds {when} the search, at {torque:g} N m: responses there have "
                        f"not converged, or are close to a fold ({named}{more} rad/s)."
                    )
                )
    return found
