"""Two geared rotors in ROSS: their responses to unbalance and their critical speeds.

    pip install ross-rotordynamics "plotly<6"
    python benchmarks/judge_rotor.py [--record tests/data/ross/geared_rotors.json]

Wants no jaxgear, best in an environment of its own. The rotors are those of
`tests/rotor_cases.py`: Timoshenko shafts with discs on two bearings each, coupled by a mesh of one
stiffness (`MultiRotor`). ROSS has no damping in a mesh: that of Rayleigh is put into the matrix
that it asks for, from its own masses and stiffnesses. It turns the unbalance of its driven rotor
with the speed of the driving one, so that the rotor that is asked for is always the driving one
here, the other one's sense and flank mirrored. Takes half a minute.
"""

import argparse
import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import ross as rs
from scipy.optimize import brentq

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import rotor_cases as given


class Damped(rs.MultiRotor):
    """A pair of rotors with the damping of Rayleigh in all of it, the mesh as well."""

    def C(self, frequency):
        """Damping by mass and by stiffness."""
        return given.MASS_FACTOR * self.M() + given.STIFFNESS_FACTOR * self.K(frequency)


def rotor(case: given.Rotor, angle: float) -> rs.Rotor:
    """One rotor on its bearings, its pressure angle with the sign of the flank that carries."""
    shear = given.YOUNG / (2.0 * (1.0 + given.POISSON))
    steel = rs.Material("case", rho=given.DENSITY, E=given.YOUNG, G_s=shear)
    stations, ends = case.stations, np.cumsum([x[0] for x in case.segments])
    shaft = []
    for start, end in pairwise(stations):
        _, outer, inner = case.segments[int(np.searchsorted(ends, 0.5 * (start + end)))]
        part = (end - start) / given.DIVISIONS
        shaft += [
            rs.ShaftElement(part, inner, outer, material=steel) for _ in range(given.DIVISIONS)
        ]
    mass, polar, across = case.gear
    gear = rs.GearElement(
        n=node(case, case.gear_at),
        m=mass,
        Id=across,
        Ip=polar,
        n_teeth=case.teeth,
        pitch_diameter=given.MODULE * case.teeth,
        pr_angle=angle,
    )
    bearings = [
        rs.BearingElement(
            n=node(case, at), kxx=along_s, kyy=along_t, kzz=0.0 if i else case.axial, cxx=0.0
        )
        for i, (at, along_s, along_t) in enumerate(case.bearings)
    ]
    return rs.Rotor(shaft, [gear], bearings)


def node(case: given.Rotor, place: float) -> int:
    """Number of the node at a place of a shaft."""
    return given.DIVISIONS * int(np.argmin(np.abs(np.asarray(case.stations) - place)))


def pair(name: str, kind: type[rs.MultiRotor]) -> rs.MultiRotor:
    """The two rotors, the one that is asked for as the driving one.

    Seen from the wheel, the pinion lies the other way and the flank leans the other way.
    """
    own, other = given.ROTORS[name], given.ROTORS["wheel" if name == "pinion" else "pinion"]
    flip = name == "wheel"
    angle = -given.PRESSURE_ANGLE if flip else given.PRESSURE_ANGLE
    return kind(
        rotor(own, angle),
        rotor(other, angle),
        coupled_nodes=(node(own, own.gear_at), node(other, other.gear_at)),
        gear_mesh_stiffness=given.MESH,
        orientation_angle=np.pi if flip else 0.0,
    )


def response(name: str) -> dict:
    """Amplitudes at the stations of both shafts, in the axes of jaxgear.

    Shape `[speed, station, part, direction]`: real and imaginary part, along S and T [m] and about
    them [rad].
    """
    own, whole = given.ROTORS[name], pair(name, Damped)
    places, moments, angles = zip(*own.unbalance, strict=True)
    found = whole.run_unbalance_response(
        [node(own, place) for place in places], moments, angles, frequency=np.array(own.speeds)
    ).forced_resp
    # A mirror at the plane of S and Z: turning about S is about -S.
    mirror = np.array([1.0, -1.0, -1.0, 1.0] if name == "wheel" else [1.0] * 4)
    motion = found.reshape(-1, 6, len(own.speeds))[:, [0, 1, 3, 4]] * mirror[:, None]
    first = len(whole.rotors["driving"].nodes)
    shafts = {name: motion[:first], "wheel" if name == "pinion" else "pinion": motion[first:]}
    return {
        each: _parts(np.moveaxis(values[:: given.DIVISIONS], -1, 0))
        for each, values in shafts.items()
    }


def _parts(values: np.ndarray) -> list:
    rounded = np.stack([np.real(values), np.imag(values)], axis=-2)
    return [[[[float(f"{x:.9e}") for x in p] for p in s] for s in v] for v in rounded]


def critical(name: str, highest: float) -> list[float]:
    """Speeds of one rotor at which a mode of both has its frequency, undamped [rad/s]."""
    whole = pair(name, rs.MultiRotor)

    def natural(speed: float) -> np.ndarray:
        found = whole.run_modal(speed, num_modes=40).wn
        return np.sort(found[found > 1.0])[:10]

    speeds = np.linspace(50.0, highest, 80)
    over = np.array([natural(speed) for speed in speeds]) - speeds[:, None]
    met = np.argwhere(over[:-1] * over[1:] < 0.0)
    return sorted(
        float(f"{brentq(lambda s, i=i: natural(s)[i] - s, *speeds[k : k + 2], xtol=1e-9):.10e}")
        for k, i in met
    )


def main() -> None:
    """Run ROSS, print or record what it finds."""
    parser = argparse.ArgumentParser(description="Two geared rotors in ROSS.")
    parser.add_argument("--record", type=Path)
    chosen = parser.parse_args()
    answer = {"ross": rs.__version__} | {
        name: {"critical_rad_s": critical(name, 5000.0), "response": response(name)}
        for name in given.ROTORS
    }
    if chosen.record:
        chosen.record.parent.mkdir(parents=True, exist_ok=True)
        chosen.record.write_text(json.dumps(answer) + "\n")
    else:
        for name in given.ROTORS:
            sys.stdout.write(f"{name}: {answer[name]['critical_rad_s']}\n")


if __name__ == "__main__":
    main()
