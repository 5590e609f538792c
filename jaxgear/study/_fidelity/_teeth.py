"""Models of the teeth at rest, judged by whole teeth of finite elements."""

from collections.abc import Mapping, Sequence
from typing import Any

from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import STATIC_RESPONSES
from jaxgear.study._fidelity._choice import worst
from jaxgear.study._fidelity._level import RESPONSES, Level
from jaxgear.study._fidelity._models import differing
from jaxgear.study._fidelity._statics import StaticProblem, Work
from jaxgear.study._result import Summary

_APART, _COUPLED, _ELEMENTS = "slices apart", "slices coupled", "elements"
_JUDGED = (*STATIC_RESPONSES, "face_load_factor")


class TeethProblem(StaticProblem):
    """Slices apart, slices that are coupled, and elements, which judge both."""

    shares = ()

    def __init__(self, scene: Scene, *, work: Work = "run"):
        """Cycles for some work."""
        sliced = lambda coupling: {"mesh.tooth": "sliced", "mesh.face_coupling": coupling}
        changes: Mapping[str, Mapping[str, Any]] = {
            _APART: sliced("none"),
            _COUPLED: sliced("coupled"),
            _ELEMENTS: {"mesh.tooth": "elements"},
        }
        levels = [Level(name, "teeth", changes=differing(scene, x)) for name, x in changes.items()]
        super().__init__(scene, work=work, levels=levels)
        self.finest = {
            "mesh.slices": scene.mesh.slices,
            "mesh.phases": scene.mesh.phases,
            "mesh.contact": "exact",
            "mesh.tooth": "elements",
        }

    def remark(self, lines: Sequence[Summary], responses: Sequence[str]) -> str:
        """For what slices apart suffice, and what coupled ones are off by."""
        rows = {line["name"]: line for line in lines}
        apart, coupled = (self._errors(rows[name]) for name in (_APART, _COUPLED))
        told = lambda names: ", ".join(
            f"the {RESPONSES[name].words} ({100 * apart[name]:.2g}, coupled "
            f"{100 * coupled[name]:.2g} %)"
            for name in names
        )
        good = [name for name in apart if apart[name] <= self.scene.compare.tolerance]
        rest = [name for name in apart if name not in good]
        enough = f'mesh.face_coupling = "none" suffices for {told(good)}' if good else ""
        short = f"it does not for {told(rest)}" if rest else ""
        if not good:
            short = f'mesh.face_coupling = "none" suffices for nothing here: {told(rest)}'
        return f" Beside elements {'; '.join(filter(None, (enough, short)))}."

    def _errors(self, line: Summary) -> dict[str, float]:
        """Largest errors at all points."""
        names = [name for name in _JUDGED if name in (*self.names, "face_load_factor")]
        return {
            name: max(worst({name: each.get(name, 0.0)}, (name,)) for each in
                      (line["error"], line["held_out"]))
            for name in names
        }  # fmt: skip

    def about(self) -> Summary:
        """The reference, its points and what errors are relative to."""
        return super().about() | {
            "name": f"teeth of finite elements, {self.scene.mesh.slices} slices, "
            f"{self.scene.mesh.phases} phases, exact contact"
        }
