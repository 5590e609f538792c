"""Scenes and models of fidelity levels: what is changed, and bodies that are built once."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from jaxgear._system._model import PairModel
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._with_bodies import with_bodies
from jaxgear.study._fidelity._level import NOTHING, Changes
from jaxgear.study._progress import say


class Models:
    """Scene and model of changes: condensed bodies are built once for each number of slices.

    The `scene` is that of them all, without bodies. Bodies that vibrate get the natural modes or
    the excited shapes of the changed scene.
    """

    def __init__(self, scene: Scene, *, moving: bool):
        self.scene = dataclasses.replace(scene, bodies=NOTHING)
        self.moving = moving
        self.built: dict[int, Mapping[str, Any]] = {}
        self.shaped: dict[Any, Mapping[str, Any]] = {}

    def __call__(self, changes: Changes) -> tuple[Scene, PairModel]:
        scene = self.scene.changed(changes)
        if scene.condensed:
            bodies = self._shaped(scene) if self.moving else self._bodies(scene.mesh.slices)
            own = {gear: bodies[gear] for gear in scene.condensed}
            scene = dataclasses.replace(scene, bodies=MappingProxyType(own))
        return scene, model_of(scene)

    def _shaped(self, scene: Scene) -> Mapping[str, Any]:
        """The bodies on the shapes that a scene asks for."""
        from jaxgear.scene._mesh_bodies import with_shapes_of

        key = scene.mesh.slices, scene.model.shapes, scene.shape_count
        if key not in self.shaped:
            bodies = self._bodies(scene.mesh.slices)
            self.shaped[key] = {gear: with_shapes_of(scene, bodies[gear]) for gear in bodies}
        return self.shaped[key]

    def _bodies(self, slices: int) -> Mapping[str, Any]:
        """The bodies on so many slices, whose natural modes excited shapes ask for, all of them."""
        if slices not in self.built:
            wanted = self.scene.replace({"mesh.slices": slices})
            if self.moving:
                wanted = wanted.replace({"model.shapes": "excited"})
            self.built[slices] = with_bodies(wanted, say, moving=self.moving).bodies
        return self.built[slices]
