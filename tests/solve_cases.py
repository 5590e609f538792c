"""Pairs for the tests of interface, system, solve, response and search, with plain arithmetic.

Every expected number here is computed with `math` from the drawing, never by the library.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
from scipy.optimize import minimize_scalar, root_scalar

import jaxgear as jg
from jaxgear import deg, mm

# One for all files: what one of them has compiled the next one uses.
run_cycle = eqx.filter_jit(jg.mesh_cycle)


def zero(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function changes sign, as closely as doubles allow."""
    found: Any = root_scalar(function, bracket=(low, high), xtol=1e-300, rtol=1e-15)
    return float(found.root)


def lowest(
    function: Callable[[float], float], low: float, high: float, *, within: float
) -> tuple[float, float]:
    """Where a function of one dip is least, and its value there."""
    options = {"xatol": within}
    found: Any = minimize_scalar(function, bounds=(low, high), method="bounded", options=options)
    return float(found.x), float(found.fun)


@dataclass(frozen=True)
class Drawing:
    """What a designer writes down: lengths in metres, angles in radians."""

    teeth: tuple[int, int]
    module: float
    pressure_angle: float = math.radians(20.0)
    helix_angle: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    addendum: tuple[float, float] = (1.0, 1.0)
    dedendum: tuple[float, float] = (1.25, 1.25)
    fillet: float = 0.25
    face_width: tuple[float, float] = (0.02, 0.02)

    @property
    def transverse_angle(self) -> float:
        return math.atan(math.tan(self.pressure_angle) / math.cos(self.helix_angle))

    @property
    def base_helix(self) -> float:
        return math.asin(math.sin(self.helix_angle) * math.cos(self.pressure_angle))

    @property
    def reference_radius(self) -> list[float]:
        return [0.5 * self.module * z / math.cos(self.helix_angle) for z in self.teeth]

    @property
    def base_radius(self) -> list[float]:
        return [r * math.cos(self.transverse_angle) for r in self.reference_radius]

    @property
    def tip_radius(self) -> list[float]:
        pairs = zip(self.reference_radius, self.addendum, self.shift, strict=True)
        return [r + self.module * (h + x) for r, h, x in pairs]

    @property
    def base_pitch(self) -> float:
        return 2.0 * math.pi * self.base_radius[0] / self.teeth[0]

    @property
    def working_angle(self) -> float:
        """From the profile shifts, without backlash."""
        target = math.tan(self.transverse_angle) - self.transverse_angle
        target += 2.0 * sum(self.shift) * math.tan(self.pressure_angle) / sum(self.teeth)
        return zero(lambda a: math.tan(a) - a - target, 0.05, 1.0)

    @property
    def centre_distance(self) -> float:
        return sum(self.base_radius) / math.cos(self.working_angle)

    @property
    def contact_ratio(self) -> float:
        tips = zip(self.tip_radius, self.base_radius, strict=True)
        ends = sum(math.sqrt(a**2 - b**2) for a, b in tips)
        return (ends - self.centre_distance * math.sin(self.working_angle)) / self.base_pitch

    @property
    def common_width(self) -> float:
        return min(self.face_width)

    @property
    def overlap_ratio(self) -> float:
        return self.common_width * math.tan(self.base_helix) / self.base_pitch

    def force(self, torque: float) -> float:
        """Normal mesh force."""
        return torque / (self.base_radius[0] * math.cos(self.base_helix))

    def pair(self) -> jg.GearPair:
        gears = [
            jg.Gear(
                self.teeth[i],
                self.face_width[i],
                self.shift[i],
                addendum=self.addendum[i],
                dedendum=self.dedendum[i],
                fillet_radius=self.fillet,
            )
            for i in range(2)
        ]
        return jg.GearPair(
            *gears,
            normal_module=self.module,
            pressure_angle=self.pressure_angle,
            helix_angle=self.helix_angle,
        )


ACCESSORY = Drawing(
    teeth=(45, 86),
    module=1.5 * mm,
    pressure_angle=25.0 * deg,
    shift=(0.341, 0.481),
    addendum=(0.9447, 0.9447),
    dedendum=(1.1933, 1.1933),
    face_width=(11.5 * mm, 9.5 * mm),
)
POWER = Drawing(
    teeth=(35, 68),
    module=2.5 * mm,
    pressure_angle=25.0 * deg,
    helix_angle=12.0 * deg,
    shift=(0.275, 0.317),
    addendum=(0.976, 0.970),
    dedendum=(1.262, 1.268),
    face_width=(40.0 * mm, 40.0 * mm),
)
FZG_C14 = Drawing(
    teeth=(16, 24), module=4.5 * mm, shift=(0.1817, 0.1715), face_width=(14.0 * mm, 14.0 * mm)
)
FZG_H501 = Drawing(
    teeth=(20, 30),
    module=3.5 * mm,
    helix_angle=15.0 * deg,
    shift=(0.1809, 0.0891),
    face_width=(23.0 * mm, 23.0 * mm),
)


def with_contact_ratio(
    ratio: float, *, helix_angle: float = 0.0, face_width: float = 20.0 * mm
) -> Drawing:
    """Unshifted gears of 60 and 80 teeth whose addendum is cut for a profile contact ratio."""

    def drawing(addendum: float) -> Drawing:
        return Drawing(
            teeth=(60, 80),
            module=2.0 * mm,
            helix_angle=helix_angle,
            addendum=(addendum, addendum),
            dedendum=(1.7, 1.7),
            fillet=0.1,
            face_width=(face_width, face_width),
        )

    return drawing(zero(lambda h: drawing(h).contact_ratio - ratio, 0.3, 1.6))


def symmetric_relief(depth, extent) -> jg.Flanks:
    """The same linear tip relief on both gears."""
    relief = jg.TipRelief(depth, extent)
    return jg.Flanks(pinion=relief, wheel=relief)


def spread(cycle: jg.MeshCycle, values) -> float:
    """RMS about the weighted mean, in NumPy."""
    weight, values = np.asarray(cycle.cells.lines.weight), np.asarray(values)
    mean = np.sum(weight * values)
    return float(np.sqrt(np.sum(weight * (values - mean) ** 2)))
