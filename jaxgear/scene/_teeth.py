"""The teeth of a gear in its transverse section: their outline, and what they weigh."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import jaxgear as jg
from jaxgear._kept_programs import called


@dataclasses.dataclass(frozen=True)
class ToothFacts:
    """What all teeth of a gear weigh above the root circle, and how they stand on it.

    **Fields:**

    - `mass`: of all [kg].
    - `polar_inertia`: of all, about the gear's axis [kg m2].
    - `root_thickness`: of one, along the root circle [m].
    """

    mass: float
    polar_inertia: float
    root_thickness: float


def tooth_outline(pair: jg.GearPair, body: int) -> tuple[np.ndarray, np.ndarray]:
    """Flank of one tooth in the transverse plane, from the root circle to the tip.

    Half thickness and height above the gear's centre, along the tooth's centreline [m].
    """
    x, y = map(np.asarray, called(_half_teeth, pair)[body])
    return x, y


def _half_teeth(pair: jg.GearPair) -> list[tuple[Array, Array]]:
    """Half thickness and height of a tooth of each gear, from root circle to tip [m]."""
    return [_half_tooth(pair, body) for body in (0, 1)]


def _half_tooth(pair: jg.GearPair, body: int) -> tuple[Array, Array]:
    section = _transverse_section(pair, body)
    x, y = section.fillet(jnp.linspace(0.5 * jnp.pi, section.pressure_angle, 25))
    tip = pair.tip_roll[body] / section.base_radius
    u, v = section.flank(jnp.linspace(section.form_roll_angle, tip, 101))
    return jnp.concatenate([x, u[1:]]), jnp.concatenate([y, v[1:]])


def _transverse_section(pair: jg.GearPair, body: int) -> jg.ToothSection:
    """The tooth that the rack's transverse section cuts.

    Exact for spur gears. The tip radius of a helical gear's rack is an ellipse there; a circle of
    the same depth stands for it, which touches the fillet only.
    """
    gear = (pair.pinion, pair.wheel)[body]
    to_transverse = jnp.cos(pair.helix_angle)
    return jg.ToothSection(
        teeth=pair.teeth[body],
        module=pair.transverse_module,
        pressure_angle=pair.transverse_pressure_angle,
        profile_shift=gear.profile_shift * to_transverse,
        dedendum=gear.dedendum * to_transverse,
        fillet_radius=gear.fillet_radius * to_transverse,
    )


def facts_of_teeth(pair: jg.GearPair, body: int) -> ToothFacts:
    r"""What the teeth of one gear weigh.

    $m = \rho b z \int \theta r \, dr$ and $I = \rho b z \int \theta r^3 \, dr$, with the angle
    $\theta$ that a tooth fills at radius $r$, by the trapezoidal rule along the flank.
    """
    gear = (pair.pinion, pair.wheel)[body]
    x, y = tooth_outline(pair, body)
    radius, angle = np.hypot(x, y), 2.0 * np.arctan2(x, y)
    line = float(gear.material.density) * float(gear.face_width) * gear.teeth
    mass, inertia = (line * float(np.trapezoid(angle * radius**n, radius)) for n in (1, 3))
    return ToothFacts(mass, inertia, float(angle[0] * radius[0]))
