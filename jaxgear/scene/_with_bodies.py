"""Condensed bodies for scenes that name some; for others no finite elements are imported."""

from collections.abc import Callable

from jaxgear.scene._scene import Scene


def with_bodies(
    scene: Scene, tell: Callable[[str], None] = lambda step: None, *, moving: bool = False
) -> Scene:
    """A scene with the condensed bodies that it names, from the cache where they are known.

    **Arguments:**

    - `scene`: checked against the schema.
    - `tell`: told what begins.
    - `moving`: whether they are to vibrate: modes are found, and cost some seconds.

    **Returns:**

    The scene, of which a model can be made; the same if no body is condensed.

    **Raises:**

    - `ValueError` if a body cannot be, or not carry its teeth.
    """
    if scene.mesh.tooth == "elements":
        from jaxgear.scene._mesh_teeth import teeth_in_mesh

        # They are kept for the models to come.
        teeth_in_mesh(scene).in_mesh(scene.mesh.line_load_updates, tell)
    if not scene.condensed:
        return scene
    from jaxgear.scene import _mesh_bodies

    return _mesh_bodies.with_bodies(scene, tell, moving=moving)
