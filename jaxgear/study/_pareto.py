"""What [optimise.pareto] asks for: one number of a design against another."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._types import Reals
from jaxgear.plot._plots import curve_pictures
from jaxgear.plot._search_tables import with_unit
from jaxgear.scene._build import smooth_law_of
from jaxgear.study._design import (
    DesignSpace,
    front_objectives,
    limits_objectives,
    limits_of,
    looks_at_speeds,
    smallest_width,
)
from jaxgear.study._statics import torques_of


def front_of(
    space: DesignSpace,
    grid: MeshGrid,
    prepared: PreparedMesh | None,
    start: np.ndarray,
    done: Callable[[int], None],
) -> optimise.ParetoFront:
    """The front that a scene asks for, found with smooth contact and re-checked exactly.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `prepared`: the meshes, where the variables leave them as they are.
    - `start`: first design, in the units of the keys.
    - `done`: told how many more designs are finished.

    **Returns:**

    The designs.
    """
    scene = space.scene
    both = [objective for objective, _, _ in front_objectives(scene, grid)]

    def responses(law: AbstractContactLaw, *judges: optimise.AbstractObjective):
        return _over_torques(space, grid, prepared, law, judges)

    law = smooth_law_of(scene)
    smooth = responses(law, *both, *limits_objectives(scene, law))
    exact = jax.jit(responses(ExactContact(), *map(smallest_width, both)))
    return optimise.pareto_front(
        smooth,
        start,
        space.box,
        points=scene["optimise.pareto.points"],
        limits=limits_of(scene),
        exact=lambda point: np.asarray(exact(jnp.asarray(point))),
        most_evaluations=scene["optimise.max_evaluations"],
        done=done,
    )


def _over_torques(
    space: DesignSpace,
    grid: MeshGrid,
    prepared: PreparedMesh | None,
    law: AbstractContactLaw,
    judges: tuple[optimise.AbstractObjective, ...],
) -> Callable[[Reals], Reals]:
    scene = space.scene
    return optimise.responses_over_torques(
        space.model,
        judges[0],
        judges[1:],
        jnp.asarray(torques_of(scene, "optimise.torques_Nm")),
        grid=grid,
        law=law,
        worst=scene["optimise.over"] == "worst",
        prepared=prepared,
        batched=not looks_at_speeds(scene),
    )


def draw_front(
    space: DesignSpace, front: optimise.ParetoFront, title: str, folder: Folder
) -> dict[str, Any]:
    """Draw a front, and describe it for the summary.

    **Arguments:**

    - `space`: variables of the scene.
    - `front`: of `front_of`.
    - `title`: the case.
    - `folder`: for `pareto.png`, `.svg` and `.csv`.

    **Returns:**

    Part of the summary.
    """
    names = [(name, unit) for _, name, unit in front_objectives(space.scene)]
    # The offset is made small as its square, and told as such.
    told = [("pressure_offset_squared" if n == "pressure_offset" else n, u) for n, u in names]
    labelled = [with_unit(name, unit) for name, unit in told]
    columns = {name: front.value[:, i] for i, name in enumerate(labelled)}
    columns |= {
        "allowed": front.allowed,
        "kept": front.kept,
        "settled": front.settled,
        "dominated": front.dominated,
    }
    columns |= {key: front.point[:, i] for i, key in enumerate(space.keys)}
    figure = partial(curve_pictures.pareto, front, names, title)
    save(figure, columns, folder, "pareto")
    rows = [
        {name: column[i] for name, column in columns.items()} | {"reason": front.reason[i]}
        for i in range(len(front.point))
    ]
    return {
        "minimise": labelled[0],
        "against": labelled[1],
        "evaluations": front.evaluations,
        "designs": rows,
    }


def front_remarks(front: optimise.ParetoFront) -> list[str]:
    """What a user must hear of designs that were not found.

    **Arguments:**

    - `front`: of `front_of`.

    **Returns:**

    Sentences; none where every design was found.
    """
    found = []
    lost = np.flatnonzero(~front.kept)
    if lost.size:
        told = "; ".join(f"number {i + 1}: {front.reason[i]}" for i in lost)
        found.append(
            f"optimise.pareto: {lost.size} of {len(front.point)} designs are not within what they "
            f"were allowed, and do not count: {told}"
        )
    early = np.flatnonzero(front.kept & ~front.settled)
    if early.size:
        found.append(
            f"optimise.pareto: the searches of {early.size} of {len(front.point)} designs did not "
            "settle; there may be better ones. Raise optimise.max_evaluations."
        )
    unknown = np.flatnonzero(front.kept & np.isnan(front.value).any(axis=1))
    if unknown.size:
        found.append(
            f"optimise.pareto: the contact of {unknown.size} of {len(front.point)} designs was not "
            "solved exactly; they do not count."
        )
    if len(front.front) == 1:
        found.append(
            "optimise.pareto: one design is best in both numbers; there is nothing to trade."
        )
    return found


def is_asked_for(space: DesignSpace) -> bool:
    """Whether a scene asks for a front."""
    return space.scene.get("optimise.pareto.against") is not None
