"""Fidelity levels: what one changes of a scene, what it answers, and how far off that is."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxgear._dynamics._orbit import AbstractMethod

# New values of a scene's keys, or `None` for a table that is taken out.
Changes = Mapping[str, Any]
NOTHING: Changes = MappingProxyType({})
# The axes along which models of a scene differ, in the order in which changes of several are named.
# Along that of methods the last one counts.
AXES = (
    "bodies", "modes", "mesh coordinates", "slices", "phases", "foundation",
    "face coupling", "line loads", "contact", "method",
)  # fmt: skip
# A fluctuation is compared with this share of what the mesh deflects by, where it is less: nobody
# needs two per cent of nothing [-].
FLOOR = 0.01


class Compared(NamedTuple):
    """What can be compared: in words, its key in summaries, whether it may vanish under load."""

    words: str
    key: str
    fluctuates: bool = False


RESPONSES = {
    "dynamic_ratio": Compared("largest mesh force", "dynamic_ratio"),
    "te_mean": Compared("mean transmission error", "te_mean_um"),
    "te_rms": Compared("RMS of transmission error", "te_rms_um", True),
    "te_peak_to_peak": Compared("peak to peak of transmission error", "te_peak_to_peak_um", True),
    "max_line_load": Compared("largest line load", "max_line_load_N_mm"),
    "max_pressure": Compared("largest pressure", "max_pressure_MPa"),
    "mesh_stiffness_mean": Compared("mean mesh stiffness", "mesh_stiffness_mean_N_um"),
    "max_root_stress": Compared("largest root stress", "max_root_stress_MPa"),
    "face_load_factor": Compared("face load factor", "face_load_factor"),
    "transverse_load_factor": Compared("transverse load factor", "transverse_load_factor"),
    "te_harmonic_1": Compared("mesh harmonic of transmission error", "te_harmonic_1_um", True),
}


class Level(NamedTuple):
    """A fidelity level: a model of a scene, and how it is solved.

    **Fields:**

    - `name`: its own.
    - `family`: of levels that are joined in a chart.
    - `axis`: one of `AXES`, along which it differs from the scene; empty for none.
    - `changes`: of the scene.
    - `method`: of steady responses; harmonic balance as the keys have it without one.
    - `beyond`: whether it is another physical model than the one asked for.
    - `batched`: whether all speeds are solved at once, also where one by one is faster.
    - `thinned`: every so many of the speeds are solved, and the time is scaled.
    """

    name: str
    family: str
    axis: str = ""
    changes: Changes = NOTHING
    method: AbstractMethod | None = None
    beyond: bool = False
    batched: bool = False
    thinned: int = 1


def own_of(levels: Sequence[Level]) -> Level:
    """The level of the scene itself; the first, where it is not among them."""
    as_given = (level for level in levels if not level.changes and level.method is None)
    return next(as_given, levels[0])


class Answers(NamedTuple):
    """What a level says at some points.

    **Fields:**

    - `values`: a row for each response, then others, a column for each point [um, MPa, N/mm, -].
    - `solved`: of each point, whether its problem was [-].
    """

    values: jax.Array
    solved: jax.Array


class Reference(NamedTuple):
    """Answers that others are compared with.

    **Fields:**

    - `values`: a row for each response, a column for each point, in the units of summaries.
    - `good`: of each point, whether it may be compared with.
    - `deflection`: of the mesh at each point, or at all of them [um].
    - `time_s`: that it took [s].
    """

    values: np.ndarray
    good: np.ndarray
    deflection: np.ndarray
    time_s: float


def scales_of(names: Sequence[str], reference: Reference) -> np.ndarray:
    """What errors are relative to: the reference, of fluctuations at least a part of deflection."""
    values = np.abs(reference.values[: len(names)])
    floors = FLOOR * np.asarray([RESPONSES[name].fluctuates for name in names])
    return np.maximum(values, floors[:, None] * np.abs(reference.deflection))


def errors_of(
    names: Sequence[str], answers: Answers, reference: Reference, at: Any = slice(None)
) -> np.ndarray:
    """Relative errors of answers `at` some points of a reference, shape `[response, point]` [-]."""
    off = np.asarray(answers.values)[: len(names)] - reference.values[: len(names), at]
    return np.abs(off) / scales_of(names, reference)[:, at]
