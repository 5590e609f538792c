"""Scenes and models of fidelity levels: what is changed, and bodies that are built once."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from jaxgear._checks import InputError
from jaxgear._system._fewer_modes import fewer_modes
from jaxgear._system._model import PairModel
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._with_bodies import with_bodies
from jaxgear.study._fidelity._level import NOTHING, Changes
from jaxgear.study._progress import say


class Models:
    """Scene and model of changes: condensed bodies are built once for each number of slices.

    The `scene` is that of them all, without bodies. Bodies that vibrate are built with so many
    `coordinates` where the slices are the scene's own, and cut to those of the changed scene.
    """

    def __init__(self, scene: Scene, *, moving: bool, coordinates: int | None = None):
        if moving and scene.condensed and scene.model.shapes != "natural":
            raise InputError(
                f'model.shapes = "{scene.model.shapes}": levels of fidelity are counted in natural '
                'modes. Write model.shapes = "natural" to compare them, and model.fidelity = "as '
                'given" for responses with other shapes.'
            )
        self.scene = dataclasses.replace(scene, bodies=NOTHING)
        self.moving = moving
        self.richest = {} if coordinates is None else {"model.coordinates": coordinates}
        self.built: dict[int, Mapping[str, Any]] = {}

    def __call__(self, changes: Changes) -> tuple[Scene, PairModel]:
        scene = self.scene.changed(changes)
        if scene.condensed:
            bodies = self._bodies(scene.mesh.slices)
            own = {gear: bodies[gear] for gear in scene.condensed}
            if self.moving:
                cut = lambda body: fewer_modes(body.flexible, scene.model.modes)
                own = {gear: dataclasses.replace(x, flexible=cut(x)) for gear, x in own.items()}
            scene = dataclasses.replace(scene, bodies=MappingProxyType(own))
        return scene, model_of(scene)

    def _bodies(self, slices: int) -> Mapping[str, Any]:
        if slices not in self.built:
            richest = self.richest if slices == self.scene.mesh.slices else {}
            wanted = self.scene.replace({"mesh.slices": slices, **richest})
            self.built[slices] = with_bodies(wanted, say, moving=self.moving).bodies
        return self.built[slices]
