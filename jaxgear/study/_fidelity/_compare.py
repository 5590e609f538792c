"""One scene by many models and methods: error against time, and which suffices."""

from jaxgear._checks import require
from jaxgear.scene._scene import Scene
from jaxgear.study._built import built_scene
from jaxgear.study._fidelity._engine import compared
from jaxgear.study._fidelity._moving import BodiesProblem, MethodsProblem
from jaxgear.study._fidelity._statics import StaticProblem
from jaxgear.study._fidelity._teeth import compared_teeth
from jaxgear.study._head import names_of, study
from jaxgear.study._result import Result, titled

# Mesh periods of a cycle, at the most: the methods of short cycles are compared.
PERIODS = 4


@study
def compare(scene: Scene) -> Result:
    """One scene by many models and methods: error against time, and which suffices.

    Of a scene without [sweep] the quasi-static cycle is compared. With [sweep] it stands beside the
    responses in motion.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    A dataset `compare` over the fidelity levels, of a sweep `compare_statics` besides, and the
    summary. With `compare.teeth = "elements"` and no sweep, `compare_teeth` besides.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if the mesh cycle or the reference was not solved at most speeds.
    """
    moving = scene.sweep.is_given
    if moving:
        scene = built_scene(scene, moving=True).scene
    require(
        scene.mesh.periods <= PERIODS,
        "`compare` takes cycles of up to {most} mesh periods, got mesh.periods = {got}. "
        "Compare the scene with fewer: what is found of models and methods holds for long cycles "
        "too.",
        most=PERIODS,
        got=scene.mesh.periods,
    )
    work = "optimise" if scene.optimise.is_given else "run"
    problem = StaticProblem(scene, work=work)
    if not moving:
        problem.require_responses()
    at_rest = compared(problem, "compare statics")
    static = titled(at_rest.dataset, scene.title + ", quasi-static cycle")
    if not moving:
        summary = names_of(scene.name, scene.cite) | {"compare": at_rest.summary}
        datasets = {"compare": static}
        if scene.compare.teeth == "elements":
            teeth = compared_teeth(scene, work)
            summary["compare"]["teeth"] = teeth.summary
            datasets["compare_teeth"] = titled(teeth.dataset, scene.title + ", judged by elements")
        return Result(scene, summary, datasets)
    found = compared((BodiesProblem if scene.condensed else MethodsProblem)(scene), "compare")
    count = len(found.summary["reference"]["speeds_rad_s"])
    datasets = {"compare": titled(found.dataset, scene.title + f", {count} speeds")}
    summary = names_of(scene.name, scene.cite) | {
        "compare": found.summary | {"statics": at_rest.summary}
    }
    return Result(scene, summary, datasets | {"compare_statics": static})
