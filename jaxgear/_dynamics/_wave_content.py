"""Which waves of which body a motion is made of, by its energy."""

import math
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from jaxgear._dynamics._system import PairDynamics

if TYPE_CHECKING:
    ModeIntegers = np.ndarray
    ModeReals = np.ndarray
else:
    ModeIntegers = Int[np.ndarray, "mode"]
    ModeReals = Float[np.ndarray, "mode"]

# Of the energy of a wave: a larger share in one direction makes it one that runs there.
_RUNS = 0.6


class Wave(NamedTuple):
    """Degrees of freedom of one gear that move with one number of nodal diameters.

    **Fields:**

    - `gear`: 0 for the pinion, 1 for the wheel.
    - `diameters`: $n$.
    - `dofs`: all of them, among those that move.
    - `pairs`: first and second of each pair that a turn of the gear mixes, as places in `dofs`.
    - `number`: with which the pairs turn, $n$ as far as the sectors of the body tell it apart.
    - `forward`: 1 if waves that run about +Z run with the gear, else -1.
    - `turned`: -1 if the sectors show the wave as running the other way, else 1.
    - `speed`: of the gear about +Z over the pinion's.
    """

    gear: int
    diameters: int
    dofs: np.ndarray
    pairs: np.ndarray
    number: int
    forward: int
    turned: int
    speed: float


class WaveContent(eqx.Module):
    """Which waves modes are made of, by kinetic energy.

    **Fields:**

    - `gear`: that which has the leading wave: 0 the pinion, 1 the wheel [-].
    - `diameters`: nodal diameters of the leading wave [-].
    - `share`: of the leading wave in the energy [-].
    - `own`: share of the leading wave's gear [-].
    - `forward`: of the leading wave's energy, what runs forward less what runs backward [-].
    - `mesh`: share of the mean mesh in the strain energy [-].
    """

    gear: ModeIntegers
    diameters: ModeIntegers
    share: ModeReals
    own: ModeReals
    forward: ModeReals
    mesh: ModeReals


def wave_content(
    dynamics: PairDynamics, shapes: np.ndarray, sectors: tuple[int, int] = (0, 0)
) -> WaveContent:
    """Find nodal diameters of modes.

    **Arguments:**

    - `dynamics`: the pair.
    - `shapes`: of its degrees of freedom, as columns; complex ones are motions that rotate in
        time as $e^{i\\omega t}$.
    - `sectors`: of both bodies, which show $n$ as `sectors` less $n$; 0: not known.

    **Returns:**

    The leading wave of each mode, bodies of which only a rigid motion is known included: they
    have 0 or 1 nodal diameters.
    """
    waves, system = waves_of(dynamics, sectors), dynamics.system
    mass = np.asarray(system.mass)
    energy = np.stack([_energy(mass, wave.dofs, shapes) for wave in waves])
    lead = np.argmax(energy, axis=0)
    gear = np.array([wave.gear for wave in waves])
    every = np.arange(shapes.shape[1])
    total = energy.sum(axis=0)
    own = np.where(gear[:, None] == gear[lead][None, :], energy, 0.0).sum(axis=0)
    runs = np.stack([_runs(mass, wave, shapes) for wave in waves])
    strain = _form(np.asarray(system.whole_stiffness), shapes)
    return WaveContent(
        gear=gear[lead],
        diameters=np.array([wave.diameters for wave in waves])[lead],
        share=energy[lead, every] / total,
        own=own / total,
        forward=runs[lead, every],
        mesh=np.clip(_form(np.asarray(system.teeth_stiffness), shapes) / strain, 0.0, 1.0),
    )


# --- Waves


def gear_of(dynamics: PairDynamics) -> np.ndarray:
    """0 for degrees of freedom of the pinion, 1 for those of the wheel."""
    mapped = dynamics.cycle.system.structure.map
    numbers = np.asarray(dynamics.dofs)
    gear = (numbers >= mapped.sizes[0]).astype(int)
    for body in dynamics.bodies:
        gear[np.isin(numbers, np.r_[body.mode_dofs, body.residual_dofs])] = body.index
    return gear


# Nodal diameters of displacements and rotations of a node along S, T, Z.
_NODE = np.array([1, 1, 0, 1, 1, 0])

_NO_WAVE = -1


def waves_of(dynamics: PairDynamics, sectors: tuple[int, int]) -> list[Wave]:
    """All groups of degrees of freedom of one gear and one number of nodal diameters."""
    numbers, gears = np.asarray(dynamics.dofs), gear_of(dynamics)
    mapped = dynamics.cycle.system.structure.map
    rigid = numbers < mapped.size
    # Residual shapes are of many waves, and count with none.
    diameters = np.where(rigid, _NODE[numbers % 6], _NO_WAVE)
    # Of pairs the wave number, positive for the first and negative for the second.
    number = np.where(rigid & (_NODE[numbers % 6] == 1), np.where(numbers % 3 == 0, 1, -1), 0)
    teeth = dynamics.cycle.system.pair.teeth
    speed = [1.0, -teeth[0] / teeth[1]]
    for body in dynamics.bodies:
        own = np.isin(numbers, body.mode_dofs)
        diameters[own], number[own] = body.diameters, body.waves
    found = []
    for gear, n in sorted(set(zip(gears.tolist(), diameters.tolist(), strict=True))):
        if n == _NO_WAVE:
            continue
        dofs = np.flatnonzero((gears == gear) & (diameters == n))
        signs = number[dofs]
        first = np.flatnonzero((signs[:-1] > 0) & (signs[1:] == -signs[:-1]))
        k = int(np.max(signs, initial=0)) if first.size else 0
        found.append(
            Wave(
                gear=gear,
                diameters=n,
                dofs=dofs,
                pairs=np.stack([first, first + 1], axis=1),
                number=k,
                forward=1 if speed[gear] > 0.0 else -1,
                turned=_turned(n, k, sectors[gear]),
                speed=speed[gear],
            )
        )
    return found


def _turned(diameters: int, number: int, sectors: int) -> int:
    """-1 if sectors show so many diameters as a wave that runs the other way."""
    if diameters == number or number == 0:
        return 1
    return 1 if sectors and (diameters - number) % sectors == 0 else -1


def _form(matrix: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Of each shape its value of a quadratic form."""
    return np.real(np.sum(shapes.conj() * (matrix @ shapes), axis=0))


def _energy(mass: np.ndarray, dofs: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    return np.clip(_form(mass[np.ix_(dofs, dofs)], shapes[dofs]), 0.0, None)


def _runs(mass: np.ndarray, wave: Wave, shapes: np.ndarray) -> np.ndarray:
    """Energy that runs with the gear less that which runs against it, over that of pairs."""
    if not len(wave.pairs):
        return np.zeros(shapes.shape[1])
    first, second = wave.dofs[wave.pairs.T]
    energies = []
    for way in (1.0, -1.0):
        # Of a motion exp(i omega t), the part (1, -i) of a pair turns about +Z.
        amplitude = 0.5 * (shapes[first] + 1j * way * shapes[second])
        part = np.zeros(shapes.shape, dtype=complex)
        part[first], part[second] = amplitude, -1j * way * amplitude
        energies.append(_energy(mass, wave.dofs, part))
    total = energies[0] + energies[1]
    balance = (energies[0] - energies[1]) / np.where(total > 0.0, total, 1.0)
    return wave.forward * wave.turned * balance


def content_of(
    waves: list[Wave], content: WaveContent, omega: np.ndarray, speed: float
) -> tuple[np.ndarray, ...]:
    """Frequencies from space and on the gear, leading waves, directions, and two shares."""
    by_name = {(wave.gear, wave.diameters): wave for wave in waves}
    rows = []
    leads = zip(content.gear.tolist(), content.diameters.tolist(), strict=True)
    for lead, forward, value in zip(leads, content.forward, omega, strict=True):
        wave = by_name[lead]
        turn, n, k = abs(wave.speed) * speed, wave.diameters, wave.number
        if n == 0:
            rows.append((value, value, 0))
        elif k == 0:
            rows.append((value, value, 2))
        elif abs(forward) < 2.0 * _RUNS - 1.0:
            rows.append((value, math.nan, 0))
        else:
            way = 1 if forward > 0.0 else -1
            body = value - way * wave.turned * k * turn
            rows.append((body + way * n * turn, body, way))
    space, body, direction = (np.array(column) for column in zip(*rows, strict=True))
    hertz = 2.0 * np.pi
    found = (space / hertz, body / hertz, content.gear, content.diameters, direction)
    return (*found, content.share, content.mesh)
