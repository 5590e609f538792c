"""Natural modes of a scene: where their energy is, and at which speeds the mesh excites them."""

import numpy as np

from jaxgear.scene._scene import Scene
from jaxgear.study._dynamics import (
    campbell_dataset,
    damping_summary,
    modes_dataset,
    modes_shown,
    modes_summary,
    solve_dynamics,
    waves_of,
)
from jaxgear.study._head import head, study
from jaxgear.study._progress import built_scene, narration
from jaxgear.study._result import Result, titled
from jaxgear.study._turning import require_retained, turning_dataset


@study
def modes(scene: Scene) -> Result:
    """Natural frequencies with the mean mesh stiffness, strain energy, critical speeds.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    Datasets `modes` and `campbell`, and the summary.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    scene = built_scene(scene, moving=True)
    with narration("modes"):
        dynamics = solve_dynamics(scene)
        teeth, harmonics = dynamics.statics.model.pair.pinion.teeth, scene["modes.harmonics"]
        require_retained(scene, dynamics.pair)
        count = modes_shown(scene, np.asarray(dynamics.modes.frequency))
        waves = waves_of(scene, dynamics, teeth, count, harmonics)
        found = modes_dataset(dynamics, count, waves)
        if waves is None:
            turning = campbell_dataset(scene, dynamics, teeth, count, harmonics)
            turning = turning.assign_attrs(harmonics=harmonics)
        else:
            turning = turning_dataset(waves, harmonics)
    summary = head(scene, dynamics.statics) | {
        "damping": damping_summary(scene, dynamics),
        "modes": modes_summary(scene, dynamics, teeth, count, waves),
    }
    datasets = {"modes": titled(found, scene), "campbell": titled(turning, scene)}
    return Result(scene, summary, datasets)
