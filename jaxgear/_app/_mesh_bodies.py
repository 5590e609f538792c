"""The condensed bodies of a scene, built and put in mesh."""

import dataclasses
from collections.abc import Callable
from types import MappingProxyType

import jax.numpy as jnp

from jaxgear._app._bodies import BodyPlan, body_plan
from jaxgear._app._body_build import BuiltBody, built_body
from jaxgear._app._body_words import in_keys
from jaxgear._app._model import pair_grid, pair_of
from jaxgear._app._root_correction import root_correction
from jaxgear._app._scene import Scene
from jaxgear._app._schema import GEARS
from jaxgear._app._statics import couples_on_pinion
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_modes import BodyBasis, body_basis
from jaxgear._system._flexible import FlexibleBody, flexible_body


@dataclasses.dataclass(frozen=True)
class MeshBody:
    """A condensed body, and what of it the mesh sees.

    **Fields:**

    - `built`: the body and how it came about.
    - `flexible`: its tables, for the slices and contact lines of the scene.
    - `basis`: motions on which it vibrates, or `None`: it is for statics.
    """

    built: BuiltBody
    flexible: FlexibleBody
    basis: BodyBasis | None


def with_bodies(
    scene: Scene, tell: Callable[[str], None] = lambda step: None, *, moving: bool = False
) -> Scene:
    """A scene with the condensed bodies that it names, from the cache where they are known.

    **Arguments:**

    - `scene`: checked against the schema.
    - `tell`: told what begins.
    - `moving`: whether they are to vibrate.

    **Returns:**

    The scene, of which a model can be made.

    **Raises:**

    - `ValueError` if a body cannot be, or not carry its teeth.
    """
    pair = pair_of(scene)
    torque = jnp.asarray(scene["pair.torque_pinion_Nm"] + couples_on_pinion(scene))
    grid = pair_grid(scene, pair, torque)
    # All plans before any long work: a mistake in the second costs no wait.
    plans = [body_plan(scene, gear) for gear in scene.condensed]
    bodies = {plan.gear: _in_mesh(scene, plan, pair, grid, tell, moving) for plan in plans}
    return dataclasses.replace(scene, bodies=MappingProxyType(bodies))


def _in_mesh(
    scene: Scene,
    plan: BodyPlan,
    pair: GearPair,
    grid: MeshGrid,
    tell: Callable[[str], None],
    moving: bool,
) -> MeshBody:
    built = built_body(plan, lambda step: tell(f"{plan.gear}: {step}"))
    basis = None
    if moving:
        tell(f"{plan.gear}: modes with its seats held")
        with in_keys(plan.gear):
            basis = body_basis(built.body, scene.get("model.coordinates", 100))
    tell(f"{plan.gear}: teeth on the rim")
    index = GEARS.index(plan.gear)
    points, axial = scene["mesh.root_points"], scene["mesh.connection"]
    with in_keys(plan.gear):
        local = None
        if scene["mesh.root_correction"]:
            local = root_correction(
                built.body, plan.material, pair, index, grid, points=points, axial=axial
            )
        flexible = flexible_body(
            built.body,
            pair,
            index,
            grid,
            gear_seat=plan.torque_seat or None,
            points=points,
            axial=axial,
            local=local,
            basis=basis,
        )
    return MeshBody(built, flexible, basis)
