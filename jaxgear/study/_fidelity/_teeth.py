"""Models of the teeth at rest, judged by whole teeth of finite elements."""

from collections.abc import Mapping
from typing import Any

from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import STATIC_RESPONSES
from jaxgear.study._fidelity._choice import worst
from jaxgear.study._fidelity._engine import Comparison, compared
from jaxgear.study._fidelity._level import RESPONSES, Level
from jaxgear.study._fidelity._statics import StaticProblem, Work
from jaxgear.study._result import Summary

_APART, _COUPLED = "slices apart", "slices coupled"
_JUDGED = (*STATIC_RESPONSES, "face_load_factor")


def compared_teeth(scene: Scene, work: Work) -> Comparison:
    """Slices apart, slices that are coupled, and elements, which judge both.

    **Arguments:**

    - `scene`: at rest.
    - `work`: whose torques and flanks are looked at.

    **Returns:**

    The comparison; its words say what slices apart suffice for.

    **Raises:**

    - `InputError` if the scene's teeth cannot be finite elements.
    - `SolverFailure` if elements were not solved.
    """
    sliced = lambda coupling: {"mesh.tooth": "sliced", "mesh.face_coupling": coupling}
    whole = {"mesh.tooth": "elements"}
    changes: Mapping[str, Mapping[str, Any]] = {
        _APART: sliced("none"),
        _COUPLED: sliced("coupled"),
        "elements": whole,
    }
    levels = [Level(name, "teeth", changes=scene.differing(x)) for name, x in changes.items()]
    found = compared(StaticProblem(scene, work=work, levels=levels, judge=whole), "compare teeth")
    rows = {line["name"]: line for line in found.summary["rungs"]}
    said = words_of_teeth(rows, float(scene.compare.tolerance))
    words = f"{found.summary['words']} {said}"
    return found._replace(summary=found.summary | {"words": words})


def words_of_teeth(rows: Mapping[str, Summary], tolerance: float) -> str:
    """For what slices apart suffice, and what coupled ones are off by.

    **Arguments:**

    - `rows`: lines of both, by name.
    - `tolerance`: relative error that is good enough [-].
    """
    # The largest errors at all points.
    parts = {name: (rows[name]["error"], rows[name]["held_out"]) for name in (_APART, _COUPLED)}
    apart, coupled = (
        {
            name: max(worst(each, (name,)) for each in both if name in each)
            for name in _JUDGED
            if any(name in each for each in both)
        }
        for both in parts.values()
    )

    def told(names: list[str]) -> str:
        """Errors of some responses, of slices apart and coupled."""
        percent = lambda name: f"{100 * apart[name]:.2g}, coupled {100 * coupled[name]:.2g} %"
        return ", ".join(f"the {RESPONSES[name].words} ({percent(name)})" for name in names)

    good = [name for name in apart if apart[name] <= tolerance]
    rest = [name for name in apart if name not in good]
    start = f'Beside elements mesh.face_coupling = "none" suffices for {told(good) or "nothing"}'
    return f"{start}; not for {told(rest)}." if rest else f"{start}."
