"""What the explorer's page asks of a scene, and the answers."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxgear._checks import InputError, require
from jaxgear._whole_file import write_text
from jaxgear.scene._json_schema import SCHEMA_LINE
from jaxgear.scene._rewriting import rewritten
from jaxgear.scene._scene import Scene
from jaxgear.study._dynamics import speeds_of
from jaxgear.study._live import RESPONSES, LiveScene
from jaxgear.study._optimising import optimise
from jaxgear.study._sweep import sweep

Asked = Mapping[str, Any]


class PageAnswers:
    """Answers to the page's questions, by their names.

    A question is a table with `values`: numbers by keys, in the units of the keys.
    """

    def __init__(self, live: LiveScene, target: Path):
        """Answer for a scene; `target` is the file into which it is written."""
        self._live, self._target = live, target
        self.by_name: Mapping[str, Callable[[Asked], Asked]] = {
            "start": self._start,
            "add": self._add,
            "cycle": self._cycle,
            "slopes": self._slopes,
            "curve": self._curve,
            "sweep": self._sweep,
            "optimise": self._optimise,
            "write": self._write,
        }

    def _start(self, asked: Asked) -> Asked:
        scene = self._live.scene
        return {
            "name": scene.name,
            "knobs": [knob._asdict() for knob in self._live.knobs],
            "others": self._live.others,
            "responses": RESPONSES,
            "sweeps": scene.sweep.is_given,
            "searches": scene.optimise.is_given,
            "file": self._target.name,
        }

    def _add(self, asked: Asked) -> Asked:
        """A slider more, of another real key."""
        self._live = self._live.with_key(str(asked.get("key")))
        return {"knobs": [knob._asdict() for knob in self._live.knobs], "others": self._live.others}

    def _cycle(self, asked: Asked) -> Asked:
        return self._live.cycle(self._values(asked))._asdict()

    def _slopes(self, asked: Asked) -> Asked:
        return self._live.slopes(self._values(asked), str(asked.get("response")))

    def _curve(self, asked: Asked) -> Asked:
        return dict(self._live.relief_curve(self._values(asked)))

    def _sweep(self, asked: Asked) -> Asked:
        """The dynamic ratio over the speeds of [sweep], as `jaxgear sweep` finds it."""
        scene = self._moved(asked)
        require(scene.sweep.is_given, "The scene has no [sweep]: add its speeds.")
        found = sweep(scene).summary["sweep"]
        way = next(key for key in found if key.startswith("dynamic_ratio"))
        return {"speed_rad_s": speeds_of(scene.sweep), "dynamic_ratio": found[way]}

    def _optimise(self, asked: Asked) -> Asked:
        """The values at which the search of [optimise] ends, from here."""
        scene = self._moved(asked)
        require(scene.optimise.is_given, "The scene has no [optimise]: say what to vary.")
        found = optimise(scene).summary["optimise"]
        known = {knob.key for knob in self._live.knobs}
        moved = {key: value for key, value in found["variables"].items() if key in known}
        return {"values": moved, "converged": found["converged"], "reason": found["reason"]}

    def _write(self, asked: Asked) -> Asked:
        """Write the scene with the values that differ from its own, comments and order kept."""
        scene = self._live.scene
        values = self._changes(asked)
        self._live.values(values)
        own = {knob.key: knob.value for knob in self._live.knobs}
        changed = {key: value for key, value in values.items() if value != own[key]}
        known = scene.overridden() | scene.files_from(self._target.parent)
        text = rewritten(scene.path, {**known, **changed})
        write_text(text.removeprefix(SCHEMA_LINE), self._target)
        return {"file": str(self._target), "changed": len(changed)}

    def _values(self, asked: Asked) -> np.ndarray:
        return self._live.values(self._changes(asked))

    def _moved(self, asked: Asked) -> Scene:
        changes = self._changes(asked)
        self._live.values(changes)
        return self._live.scene.replace(changes)

    @staticmethod
    def _changes(asked: Asked) -> dict[str, float]:
        values = asked.get("values", {})
        if not isinstance(values, dict):
            raise InputError("values must be a table of numbers by keys.")
        for key, value in values.items():
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not math.isfinite(value):
                raise InputError(f"{key} must be a finite number.")
        return {key: float(value) for key, value in values.items()}
