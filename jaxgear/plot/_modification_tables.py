"""Traces of both flanks as a gear checker takes them: profile at three places, lead at one.

A row of the table is a point of a trace. `designed_um` is the drawing's: reliefs, crownings and
slopes; `made_um` adds what was measured and what a tolerance grade stands for.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._flank._deviations import AbstractFlankDeviation, Flanks, ProfileWaviness, Superposed
from jaxgear._flank._measured import (
    MeasuredProfile,
    MeasuredTopography,
    diameter_of_profile_place,
    roll_angle_of_profile_place,
)
from jaxgear._geometry._pair import GearPair
from jaxgear._kept_programs import called
from jaxgear._system._model import PairModel
from jaxgear._types import Reals
from jaxgear._units import deg, mm, um
from jaxgear.plot._plots import modification_pictures
from jaxgear.plot._tables import Columns, joined
from jaxgear.study._results import BODIES

TRACES = ("profile left", "profile", "profile right", "lead")
# Points of a trace: corners of reliefs lie within a two-hundredth of it.
_POINTS = 201
# Parts of a flank that no drawing asks for. Those of a tolerance grade come superposed.
_MADE = (MeasuredProfile, MeasuredTopography, ProfileWaviness, Superposed)


def modification_columns(models: Mapping[str, PairModel]) -> Columns:
    """The data of `modification`, a row for each point of each trace.

    **Arguments:**

    - `models`: with the flanks, under what they are: `start` and `optimised`, say.
    """
    rows = []
    for state, model in models.items():
        found = {
            name: np.asarray(x) for name, x in called(_traced, model.pair, model.flanks).items()
        }
        for body, gear in enumerate(BODIES):
            for number, trace in enumerate(TRACES):
                own = {name: values[body, number] for name, values in found.items()}
                names = {"state": state, "gear": gear, "trace": trace}
                rows.append({key: np.full(_POINTS, name) for key, name in names.items()} | own)
    return joined(rows)


def draw_modification(models: Mapping[str, PairModel], title: str, folder: Folder) -> None:
    """Draw the traces of the flanks of one or two models.

    **Arguments:**

    - `models`: as for `modification_columns`.
    - `title`: the case.
    - `folder`: where to.
    """
    data = modification_columns(models)
    save(partial(modification_pictures.modification, data, title), data, folder, "modification")


def _traced(pair: GearPair, flanks: Flanks) -> dict[str, Array]:
    """Places and deviations of all traces, shape `[body, trace, point]`, in units of files."""
    along, ends = jnp.linspace(0.0, 1.0, _POINTS), jnp.linspace(-1.0, 1.0, _POINTS)
    profile = jnp.stack([along, along, along, jnp.full(_POINTS, 0.5)])
    face = jnp.stack([*(jnp.full(_POINTS, end) for end in (-1.0, 0.0, 1.0)), ends])
    found = [
        _traces_of(pair, body, flank, profile, face)
        for body, flank in enumerate((flanks.pinion, flanks.wheel))
    ]
    return {name: jnp.stack([each[name] for each in found]) for name in found[0]}


def _traces_of(
    pair: GearPair, body: int, flank: AbstractFlankDeviation, profile: Reals, face: Reals
) -> dict[str, Any]:
    return {
        "roll_angle_deg": roll_angle_of_profile_place(pair, body, profile) / deg,
        "diameter_mm": diameter_of_profile_place(pair, body, profile) / mm,
        "face_position_mm": 0.5 * face * pair.of_bodies("face_width")[body] / mm,
        "designed_um": _designed(flank)(profile, face) / um,
        "made_um": flank(profile, face) / um,
    }


def _designed(flank: AbstractFlankDeviation) -> AbstractFlankDeviation:
    """What the drawing asks for; of a flank that is no sum, all of it."""
    if not isinstance(flank, Superposed):
        return flank
    return Superposed(tuple(part for part in flank.parts if not isinstance(part, _MADE)))
