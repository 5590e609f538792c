"""Derivatives of what moves: natural modes, and responses of a sweep, by what varies of a design.

Modes are differentiated as a whole. A response of a sweep is found once more on the branch where
the sweep has it, by harmonic balance with the same contact, harmonics and time steps; its
derivative is that of the balance at its root. One that did not settle, that repeats only after
several cycles, or that harmonic balance does not find again has none: NaN.
"""

import dataclasses
import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._dynamics._harmonic import (
    HarmonicBalance,
    fourier_coefficients,
    harmonic_balance_problem,
)
from jaxgear._dynamics._modes import Modes, critical_speeds, pair_modes
from jaxgear._dynamics._sweep_types import SweepPoint, Ways
from jaxgear._geometry._lines import MeshGrid
from jaxgear._response._measured import measured
from jaxgear._system._model import PairModel
from jaxgear._types import Reals
from jaxgear._units import um
from jaxgear.scene._build import law_of
from jaxgear.scene._tables import SweepKeys
from jaxgear.study._built import BuiltScene
from jaxgear.study._derivatives import Keys, linearised
from jaxgear.study._dynamics import (
    directions_of,
    settings_of,
    size_of,
    speeds_of,
)
from jaxgear.study._steady import builder, moved_pair, numbers_of

# Numbers that have derivatives, by command.
_OF_MODES = re.compile(
    r"modes\.(?:(frequency_Hz|damping_ratio|energy\.mesh)"
    r"|critical_speed_rad_s\.mesh_harmonic_(\d+))\[(\d+)\]"
)
_OF_SWEEPS = re.compile(r"sweep\.(dynamic_ratio|pair_ratio|te_rms_um)_(up|down|cold)\[(\d+)\]")
KNOWN: Mapping[str, re.Pattern[str]] = {"modes": _OF_MODES, "sweep": _OF_SWEEPS}
# In words, for those who ask for others.
KNOWN_WORDS: Mapping[str, str] = {
    "modes": "modes.frequency_Hz[0], modes.damping_ratio[0], modes.energy.mesh[0], "
    "modes.critical_speed_rad_s.mesh_harmonic_1[0] and the like",
    "sweep": "sweep.dynamic_ratio_up[0], sweep.pair_ratio_up[0] and sweep.te_rms_um_up[0], "
    "at a speed by its place",
}
# A response that is found again has the numbers that it had.
_SAME = 1e-6

# Of a response: direction, and place among the speeds.
_At = tuple[str, int]


@dataclasses.dataclass(frozen=True)
class SeenResponses:
    """Keeps of a sweep the responses whose numbers are differentiated.

    **Fields:**

    - `places`: direction and place among the speeds of those.
    - `speeds`: of the pinion, rising [rad/s].
    - `points`: those that have come by.
    """

    places: frozenset[_At]
    speeds: np.ndarray
    points: dict[_At, SweepPoint]

    def __call__(self, ways: Ways, point: SweepPoint, ratio: float) -> None:
        """Look at a response."""
        del ratio
        place = int(np.argmin(np.abs(self.speeds - float(point.orbit.speed))))
        for at in ((way, place) for way in ways):
            if at in self.places:
                self.points[at] = point


def seen_of(asked: SweepKeys, names: Sequence[str]) -> SeenResponses:
    """What looks for the responses of some numbers in a sweep."""
    found = [_OF_SWEEPS.fullmatch(name) for name in names]
    places = frozenset((each[2], int(each[3])) for each in found if each is not None)
    return SeenResponses(places, speeds_of(asked), {})


class Slopes:
    """Finds derivatives of numbers by keys; designs that are alike share a program."""

    def __init__(self, names: Sequence[str], keys: Sequence[str]):
        """Keep what is differentiated."""
        self._names, self._keys = tuple(names), tuple(keys)
        self._programs: dict[Hashable, Any] = {}

    def of_modes(self, built: BuiltScene, others: Hashable) -> np.ndarray:
        """Of natural modes, in the units of the names, shape `[number, key]`.

        **Arguments:**

        - `built`: the design, with its condensed bodies.
        - `others`: what it has in common with all whose program it may have.
        """
        program, values = self._program(built, others, self._modes)
        return np.asarray(program(values, jnp.eye(len(values)), None)[2]).T

    def of_sweep(
        self, design: BuiltScene, others: Hashable, seen: SeenResponses, numbers: Sequence[float]
    ) -> np.ndarray:
        """Of responses at speeds, in the units of the names, shape `[number, key]`.

        **Arguments:**

        - `design`: with its condensed bodies.
        - `others`: what it has in common with all whose program it may have.
        - `seen`: its responses.
        - `numbers`: that the sweep found, in the units of the names.
        """
        (build, respond), values = self._program(design, others, _built_and_answered)
        # The speed is one more number, which stays.
        tangents = jnp.eye(len(values), len(values) + 1)
        found = np.full((len(self._names), len(values)), np.nan)
        built = build(jnp.append(values, 0.0), tangents, None)
        for at, point in seen.points.items():
            if not point.settled or point.multiple != 1:
                continue
            own = built[0].at[-1].set(point.orbit.speed)
            answered = respond(own, built[2], None, built[1], point.orbit.place)
            answers, settled, columns, _ = answered
            for place, name in enumerate(self._names):
                quantity, way, index = _parts(name)
                if at == (way, index) and bool(settled):
                    row, known = _ANSWERS.index(quantity), numbers[place]
                    if abs(float(answers[row]) - known) <= _SAME * abs(known):
                        found[place] = np.asarray(columns)[:, row]
        return found

    def _program(
        self, design: BuiltScene, others: Hashable, make: Callable[[Keys, MeshGrid], Any]
    ) -> tuple[Any, Reals]:
        """The program of a design's shape, and the values of its keys."""
        grid, keys = design.grid_in_motion, Keys(design.scene, self._keys)
        kind = others, grid, jax.tree.structure(design.model)
        if kind not in self._programs:
            self._programs[kind] = make(keys, grid)
        return self._programs[kind], jnp.asarray(keys.centre)

    def _modes(self, keys: Keys, grid: MeshGrid) -> Callable:
        build = builder(keys, grid)

        def numbers(values: Reals) -> tuple[Reals, None]:
            model, pair = build(values)
            modes = pair_modes(pair)
            return jnp.stack([_of_mode(name, model, modes, pair) for name in self._names]), None

        return eqx.filter_jit(linearised(numbers))


def _of_mode(name: str, model: PairModel, modes: Modes, pair: Any) -> Any:
    """A number of the summary of modes."""
    found = _OF_MODES.fullmatch(name)
    assert found is not None
    quantity, harmonic, place = found[1], found[2], int(found[3])
    if harmonic is not None:
        return critical_speeds(modes.frequency, model.pair.pinion.teeth, (int(harmonic),))[place, 0]
    if quantity == "frequency_Hz":
        return modes.frequency[place]
    if quantity == "energy.mesh":
        return modes.mesh[place]
    assert modes.damping_ratio is not None
    cells = pair.system.cell_damping
    more = 0.0 if cells is None else jnp.pi * cells * modes.frequency[place] * modes.mesh[place]
    return modes.damping_ratio[place] + more


# Of a response, in the units of their names.
_ANSWERS = ("dynamic_ratio", "pair_ratio", "te_rms_um")


def _parts(name: str) -> tuple[str, str, int]:
    """Quantity, direction and place of a number of a sweep."""
    found = _OF_SWEEPS.fullmatch(name)
    assert found is not None
    return found[1], found[2], int(found[3])


def _built_and_answered(keys: Keys, grid: MeshGrid) -> tuple[Callable, Callable]:
    """Programs for what is built of keys, and for the response of that."""
    scene, law = keys.scene, law_of(keys.scene.mesh)

    def respond(numbers: Reals, dynamics: Any, places: Reals) -> tuple[Reals, Any]:
        moved = moved_pair(dynamics, numbers[:-1])
        method = settings_of(law, scene.sweep, size_of(dynamics)).method
        assert isinstance(method, HarmonicBalance)
        balance = harmonic_balance_problem(method, moved.system)
        near = jax.lax.stop_gradient(fourier_coefficients(balance, places))
        orbit, _ = method.solve(balance, numbers[-1], near)
        found = measured(moved, orbit, law, 1)
        lengths = {name: getattr(found, name.removesuffix("_um")) for name in _ANSWERS}
        values = [x / um if name.endswith("_um") else x for name, x in lengths.items()]
        return jnp.stack(values), orbit.settled

    return eqx.filter_jit(linearised(numbers_of(builder(keys, grid)))), eqx.filter_jit(
        linearised(respond)
    )


def reason_against(
    asked: SweepKeys, command: str, names: Sequence[str], *, in_pairs: bool = False
) -> str:
    """Why some numbers have no derivatives; empty if they have.

    **Arguments:**

    - `asked`: the sweep of the scene whose they are.
    - `command`: `modes` or `sweep`.
    - `names`: of the numbers.
    - `in_pairs`: whether modes of a body come in pairs that meet, and share unequal damping.
    """
    for name in names:
        if KNOWN[command].fullmatch(name) is None:
            return f"{name} has none. Those that have: {KNOWN_WORDS[command]}"
    if command == "sweep":
        ways, count = directions_of(asked), len(speeds_of(asked))
        for name in names:
            _, way, place = _parts(name)
            if way not in ways or place >= count:
                return f"{name} is not of this sweep: {count} speeds, {', '.join(ways)}"
        if asked.method not in ("auto", "harmonic"):
            return f'a sweep by "{asked.method}" has none. Write sweep.method = "harmonic"'
        if in_pairs:
            return (
                "beside a condensed body a response has none: modes of the body come in pairs that "
                "meet, and how these share the damping of the mesh has no derivative. Write "
                'damping.mesh = the value of damping.structure, or damping.kind = "rayleigh"'
            )
    return ""
