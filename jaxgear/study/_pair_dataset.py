"""A pair of gears as datasets: outlines, circles, axes and forces, sliding, modifications.

Axes: S from the pinion's centre to the wheel's, Z along the axes, T = Z x S. The pinion turns
about +Z and drives. A right-hand tooth turns with the fingers of a right hand whose thumb runs
along Z.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from jaxgear._flank._deviations import AbstractFlankDeviation, Flanks, ProfileWaviness, Superposed
from jaxgear._flank._measured import (
    MeasuredProfile,
    MeasuredTopography,
    diameter_of_profile_place,
    roll_angle_of_profile_place,
)
from jaxgear._geometry._pair import GearPair, pair_facts
from jaxgear._geometry._pair_facts import PairFacts
from jaxgear._geometry._sliding import sliding_speed, specific_sliding
from jaxgear._kept_programs import called
from jaxgear._types import as_scalar
from jaxgear._units import deg, mm, um
from jaxgear.scene._schema import GEARS
from jaxgear.scene._teeth import tooth_outline
from jaxgear.study._results import dataset_of, over, told

_TEETH_SHOWN = 7
# Of the pair, of both gears.
_LENGTHS = (
    *("working_centre_distance", "transverse_base_pitch", "pitch_point", "path_start", "path_end"),
    *("tangent_length", "face_width"),
)
_RADII = ("tip_radius", "root_radius", "base_radius", "reference_radius", "working_pitch_radius")
_GEAR = over("gear", gear=(list(GEARS), "gear"))


def pair_dataset(pair: GearPair) -> xr.Dataset:
    """Circles and lengths of a pair, and the outline of several teeth of each gear."""
    facts = jax.tree.map(np.asarray, pair_facts(pair))
    outlines = [_outline(pair, body, facts) for body in (0, 1)]
    # A gear of few teeth has a shorter outline.
    points = max(each.shape[1] for each in outlines)
    drawn = np.full((2, 2, points), np.nan)
    for body, each in enumerate(outlines):
        drawn[body, :, : each.shape[1]] = each
    half, height = tooth_outline(pair, 0)
    named = lambda names: {
        f"{name}_mm": (getattr(facts, name), name.replace("_", " ")) for name in names
    }
    return dataset_of(
        over(
            "",
            **named(_LENGTHS),
            working_pressure_angle_deg=(facts.working_pressure_angle, "working pressure angle"),
            helix_angle_deg=(pair.helix_angle, "helix angle, right hand positive"),
            profile_contact_ratio=(facts.profile_contact_ratio, "profile contact ratio"),
        )
        | over(
            "gear",
            **named(_RADII),
            teeth=([pair.pinion.teeth, pair.wheel.teeth], "teeth"),
            gear_width_mm=(
                [float(gear.face_width) for gear in (pair.pinion, pair.wheel)],
                "face width of the gear",
            ),
        )
        | over(
            "gear point",
            S_mm=(drawn[:, 0], "outline of teeth along S"),
            T_mm=(drawn[:, 1], "outline of teeth along T"),
        )
        | over(
            "place",
            tooth_x_mm=(half, "half thickness of a pinion's tooth"),
            tooth_y_mm=(height, "height above the pinion's centre"),
        ),
        **_GEAR,
    )


def _outline(pair: GearPair, body: int, facts: PairFacts) -> np.ndarray:
    """Outline of several teeth around the mesh, S and T [m]."""
    count = (pair.pinion, pair.wheel)[body].teeth
    x, y = tooth_outline(pair, body)
    radius, half = np.hypot(x, y), np.arctan2(x, y)
    space = np.linspace(np.pi / count, half[0], 7)[:-1]
    land = np.linspace(half[-1], 0.0, 7)[1:]
    radius = np.concatenate([np.full(6, radius[0]), radius, np.full(6, radius[-1])])
    half = np.concatenate([space, half, land])
    # The loaded flank, which leads anticlockwise on either gear, passes through the pitch point.
    pitch_point = facts.pitch_point
    roll = (pitch_point, facts.tangent_length - pitch_point)[body]
    turned = roll / facts.base_radius[body] - facts.half_thickness_at_base[body]
    centreline = np.pi * body - facts.working_pressure_angle + turned
    shown = min(_TEETH_SHOWN, count)
    teeth = centreline + 2.0 * np.pi / count * (np.arange(shown) - shown // 2)
    angle = (teeth[:, None] + np.concatenate([-half, half[::-1]])).ravel()
    distance = np.tile(np.concatenate([radius, radius[::-1]]), len(teeth))
    centre = np.asarray([float(facts.working_centre_distance) * body, 0.0])
    return centre[:, None] + distance * np.stack([np.cos(angle), np.sin(angle)])


def axes_dataset(pair: GearPair) -> xr.Dataset:
    """Axes, hand of the helix, senses of rotation and forces, as places and unit vectors.

    Tooth traces are those on the side of +T, torques what drive and load put on the gears, forces
    what the mesh puts on them.
    """
    facts = jax.tree.map(np.asarray, pair_facts(pair))
    angle, base_helix = (
        float(getattr(facts, x)) for x in ("working_pressure_angle", "base_helix_angle")
    )
    helix, distance = float(pair.helix_angle), float(facts.working_centre_distance)
    radii = facts.reference_radius
    along = np.array([np.sin(angle), np.cos(angle), 0.0])
    normal = np.cos(base_helix) * along - [0.0, 0.0, np.sin(base_helix)]
    pitch_point = np.array([float(facts.working_pitch_radius[0]), 0.0, 0.0])
    middle, other, up = np.zeros(3), np.array([distance, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    side = np.array([0.0, 1.0, 0.0])
    # On the pinion's side of +T a tooth that turns about +Z with Z moves towards -S.
    trace = np.array([-np.sin(helix), 0.0, np.cos(helix)])
    rows = {
        "rotation of the pinion": (middle, up),
        "rotation of the wheel": (other, -up),
        "torque on the pinion": (middle, up),
        "torque on the wheel": (other, up),
        "tooth trace of the pinion": (middle + radii[0] * side, trace),
        "tooth trace of the wheel": (other + radii[1] * side, trace * [-1.0, 1.0, 1.0]),
        "path of contact": (pitch_point, along),
        "force on the pinion": (pitch_point, -normal),
        "force on the wheel": (pitch_point, normal),
    }
    places, directions = (np.stack(each) for each in zip(*rows.values(), strict=True))
    named = list(zip("STZ", places.T, directions.T, strict=True))
    return dataset_of(
        over("arrow", **{f"{x}_mm": (at, f"place of the arrow along {x}") for x, at, _ in named})
        | over(
            "arrow", **{f"along_{x}": (to, f"part of its direction on {x}") for x, _, to in named}
        ),
        **over("arrow", arrow=(list(rows), "what the arrow shows")),
    )


# --- Sliding

_PLACES = 101


def sliding_dataset(
    pair: GearPair, efficiency: float, friction: float, pinion_speed: float | None = None
) -> xr.Dataset:
    """How the flanks slide along the path of contact, at a speed of the pinion [rad/s]."""
    slid = jax.tree.map(np.asarray, called(_slid, pair))
    about = "sliding over rolling speed of the {}'s flank"
    speed = np.nan if pinion_speed is None else pinion_speed
    return dataset_of(
        told(
            "place",
            roll_mm=(slid.roll, "roll length from the pinion's base tangent point"),
            diameter_pinion_mm=(slid.diameter[0], "diameter at which the pinion touches"),
            diameter_wheel_mm=(slid.diameter[1], "diameter at which the wheel touches"),
            specific_sliding_pinion=(slid.specific[0], about.format("pinion")),
            specific_sliding_wheel=(slid.specific[1], about.format("wheel")),
            sliding_over_pitch_line_speed=(slid.over_pitch_line, "sliding over pitch line speed"),
            sliding_speed_per_pinion_speed_mm=(slid.speed, "sliding speed over that of the pinion"),
        )
        | over(
            "",
            mesh_efficiency=(efficiency, "efficiency of the mesh"),
            friction_coefficient=(friction, "coefficient of friction"),
            pinion_speed_rad_s=(speed, "highest speed of the pinion"),
        )
    )


class _Slid(NamedTuple):
    """Sliding at places of the path: roll length, diameters and speed in mm, and without a unit."""

    roll: Array
    diameter: Array
    specific: Array
    speed: Array
    over_pitch_line: Array


def _slid(pair: GearPair) -> _Slid:
    roll = jnp.linspace(pair.path_start, pair.path_end, _PLACES)
    slides, specific = sliding_speed(pair, roll, as_scalar(1.0)), specific_sliding(pair, roll)
    rolls = jnp.stack([roll, pair.tangent_length - roll])
    diameter = 2.0 * jnp.hypot(pair.base_radius[:, None], rolls)
    over_pitch_line = slides / pair.working_pitch_radius[0]
    return _Slid(roll / mm, diameter / mm, specific, slides / mm, over_pitch_line)


# --- Modifications

_TRACES = ("profile left", "profile", "profile right", "lead")
# Points of a trace: corners of reliefs lie within a two-hundredth of it.
_POINTS = 201
# Parts of a flank that no drawing asks for. Those of a tolerance grade come superposed.
_MADE = (MeasuredProfile, MeasuredTopography, ProfileWaviness, Superposed)


def modification_dataset(flanks: Mapping[str, tuple[GearPair, Flanks]]) -> xr.Dataset:
    """Traces of both flanks as a gear checker takes them: profile at three places, lead at one.

    `designed_um` is the drawing's: reliefs, crownings and slopes; `made_um` adds what was measured
    and what a tolerance grade stands for.
    """
    found = [called(_traced, *each) for each in flanks.values()]
    roll, diameter, face, designed, made = (np.stack(each) for each in zip(*found, strict=True))
    return dataset_of(
        told(
            "state gear trace point",
            roll_angle_deg=(roll, "roll angle"),
            diameter_mm=(diameter, "diameter"),
            face_position_mm=(face, "position from mid-face, left (-Z) to right"),
            designed_um=(designed, "material added as designed"),
            made_um=(made, "material added as made"),
        ),
        **over("state", state=(list(flanks), "which flanks")),
        **_GEAR,
        **over("trace", trace=(list(_TRACES), "where the flank is traced")),
    )


def _traced(pair: GearPair, flanks: Flanks) -> tuple[Array, ...]:
    """Roll angle, diameter, place on the face, and both deviations, in units of files.

    Shape `[body, trace, point]`.
    """
    along, ends = jnp.linspace(0.0, 1.0, _POINTS), jnp.linspace(-1.0, 1.0, _POINTS)
    profile = jnp.stack([along, along, along, jnp.full(_POINTS, 0.5)])
    face = jnp.stack([*(jnp.full(_POINTS, end) for end in (-1.0, 0.0, 1.0)), ends])
    found = [
        (
            roll_angle_of_profile_place(pair, body, profile) / deg,
            diameter_of_profile_place(pair, body, profile) / mm,
            0.5 * face * pair.of_bodies("face_width")[body] / mm,
            _designed(flank)(profile, face) / um,
            flank(profile, face) / um,
        )
        for body, flank in enumerate((flanks.pinion, flanks.wheel))
    ]
    return tuple(map(jnp.stack, zip(*found, strict=True)))


def _designed(flank: AbstractFlankDeviation) -> AbstractFlankDeviation:
    """What the drawing asks for; of a flank that is no sum, all of it."""
    if not isinstance(flank, Superposed):
        return flank
    return Superposed(tuple(part for part in flank.parts if not isinstance(part, _MADE)))
