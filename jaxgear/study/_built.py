"""A scene as studies see it: with its condensed bodies, and what is made of it once for all."""

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

from jaxgear._contact._root_influence import Influences, nearby_influences
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._system._model import PairModel
from jaxgear.scene._build import grid_of, law_of, model_of
from jaxgear.scene._mesh_roots import asks_for_roots, influences_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._with_bodies import with_bodies
from jaxgear.study._progress import narration

if TYPE_CHECKING:
    from jaxgear.scene._mesh_teeth import TeethInMesh


@dataclasses.dataclass(frozen=True)
class BuiltScene:
    """A scene whose condensed bodies are built; what else is made of it is made where asked for.

    **Fields:**

    - `scene`: with its bodies.
    """

    scene: Scene

    @cached_property
    def model(self) -> PairModel:
        """Its model."""
        return model_of(self.scene)

    @cached_property
    def grid(self) -> MeshGrid:
        """Phases, lines and slices of its mesh cycle."""
        return grid_of(self.scene, self.model)

    @cached_property
    def grid_in_motion(self) -> MeshGrid:
        """The same with the time steps of [sweep] for phases."""
        return grid_of(self.scene, self.model, self.scene.sweep.steps)

    @cached_property
    def law(self) -> AbstractContactLaw:
        """The contact law that it asks for."""
        return law_of(self.scene.mesh)

    @cached_property
    def influences(self) -> Influences | None:
        """Influences of loads on the roots; `None` where nothing asks for root stresses [-]."""
        return influences_of(self.scene, self.model.pair)

    def influences_near(self) -> Callable[[GearPair], Influences | None]:
        """The same of a pair that has moved from the scene's own, for derivatives."""
        mesh = self.scene.mesh
        asked = asks_for_roots(mesh, self.scene.compare, self.scene.optimise)
        if asked and mesh.tooth != "elements":
            return nearby_influences(self.model.pair).at
        # Condensed teeth follow no key.
        return lambda moved: self.influences

    @cached_property
    def teeth(self) -> "TeethInMesh | None":
        """What its teeth are made from where they are finite elements; for others none."""
        if self.scene.mesh.tooth != "elements":
            return None
        # For other scenes no finite elements are imported.
        from jaxgear.scene._mesh_teeth import teeth_in_mesh

        return teeth_in_mesh(self.scene)


def built_scene(scene: Scene, *, moving: bool = False) -> BuiltScene:
    """The scene with its condensed bodies; where it has none, nothing is imported for them.

    **Arguments:**

    - `scene`: checked against the schema.
    - `moving`: whether bodies are to vibrate also where the scene has no table [sweep].
    """
    if not scene.condensed and scene.mesh.tooth == "sliced":
        return BuiltScene(scene)
    with narration("bodies") as tell:
        return BuiltScene(with_bodies(scene, tell, moving=moving or scene.sweep.is_given))
