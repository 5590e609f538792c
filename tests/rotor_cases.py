"""Two geared rotors that another rotor program was given too, as plain numbers in SI.

`benchmarks/judge_rotor.py` builds them without jaxgear, `tests/verification/test_rotor_program.py`
with it.
"""

from typing import NamedTuple

YOUNG, POISSON, DENSITY = 206e9, 0.3, 7850.0
MODULE, PRESSURE_ANGLE = 3e-3, 0.3490658503988659
MESH = 2e8
# Of Rayleigh: C = a M + b K.
MASS_FACTOR, STIFFNESS_FACTOR = 8.0, 4e-6
# Elements between two stations.
DIVISIONS = 2


class Rotor(NamedTuple):
    """A shaft, its gear and its unbalance.

    **Fields:**

    - `segments`: length, outer and inner diameter of each [m].
    - `bearings`: place on the shaft [m], stiffness along S and T [N/m].
    - `axial`: stiffness of the first bearing [N/m].
    - `gear_at`: place of the gear [m].
    - `teeth`: of the gear [-].
    - `gear`: its mass [kg], polar and transverse moment of inertia [kg m2].
    - `unbalance`: place [m], moment [kg m] and angle [rad] of each.
    - `speeds`: of this shaft, through its first critical ones [rad/s].
    """

    segments: tuple[tuple[float, float, float], ...]
    bearings: tuple[tuple[float, float, float], ...]
    axial: float
    gear_at: float
    teeth: int
    gear: tuple[float, float, float]
    unbalance: tuple[tuple[float, float, float], ...]
    speeds: tuple[float, ...]

    @property
    def stations(self) -> list[float]:
        """Places along the shaft that have a node, rising [m]."""
        ends = [sum(x[0] for x in self.segments[:i]) for i in range(len(self.segments) + 1)]
        places = [*ends, self.gear_at, *(x[0] for x in self.bearings + self.unbalance)]
        return sorted({round(place, 9) for place in places})


# A thick disc overhangs the left bearing, so that gyroscopic terms part the whirls.
PINION = Rotor(
    segments=((0.020, 0.160, 0.0), (0.220, 0.032, 0.0), (0.120, 0.038, 0.012)),
    bearings=((0.080, 4e7, 2.5e7), (0.340, 6e7, 6e7)),
    axial=1e7,
    gear_at=0.200,
    teeth=24,
    gear=(1.2, 1.1e-3, 7e-4),
    unbalance=((0.020, 4e-5, 0.5), (0.200, 2e-5, -1.1)),
    speeds=(200.0, 500.0, 700.0, 850.0, 1000.0, 1300.0, 1600.0, 2000.0, 2500.0, 3200.0, 4000.0),
)
WHEEL = Rotor(
    segments=((0.300, 0.036, 0.0), (0.100, 0.045, 0.020)),
    bearings=((0.020, 3e7, 5e7), (0.380, 4e7, 4e7)),
    axial=1e7,
    gear_at=0.140,
    teeth=40,
    gear=(4.0, 9e-3, 5e-3),
    unbalance=((0.140, 6e-5, 0.3), (0.300, 3e-5, 2.0)),
    speeds=(200.0, 500.0, 700.0, 850.0, 1000.0, 1300.0, 1600.0, 2000.0, 2500.0, 3200.0, 4000.0),
)
ROTORS = {"pinion": PINION, "wheel": WHEEL}
