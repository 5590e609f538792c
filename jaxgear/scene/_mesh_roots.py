"""What loads do to the roots of a scene's teeth: solved where the scene asks for root stresses."""

from collections.abc import Callable

from jaxgear._contact._root_influence import Influences, nearby_influences, root_influences
from jaxgear._geometry._pair import GearPair
from jaxgear.scene._scene import Scene

# Under this name it is minimised, traded and compared.
_RESPONSE = "max_root_stress"


def influences_of(scene: Scene, pair: GearPair) -> Influences | None:
    """The influences of a scene's teeth, which depend on nothing but their shapes.

    **Arguments:**

    - `scene`: checked against the schema.
    - `pair`: its gears.

    **Returns:**

    The influences; `None` where nothing in the scene asks for root stresses.
    """
    return _solved(scene, pair) if asks_for_roots(scene) else None


def _solved(scene: Scene, pair: GearPair) -> Influences:
    plane = root_influences(pair)
    if scene.mesh.tooth != "elements":
        return plane
    # For other scenes no finite elements are imported.
    from jaxgear.scene._element_roots import element_roots

    return element_roots(scene, plane)


def influences_near(scene: Scene, pair: GearPair) -> Callable[[GearPair], Influences | None]:
    """The same, for derivatives: a function of a pair that has moved from the scene's own.

    **Arguments:**

    - `scene`: checked against the schema.
    - `pair`: its gears.

    **Returns:**

    The function.
    """
    if not asks_for_roots(scene):
        return lambda moved: None
    if scene.mesh.tooth != "elements":
        return nearby_influences(pair).at
    # Condensed teeth follow no key.
    found = _solved(scene, pair)
    return lambda moved: found


def asks_for_roots(scene: Scene) -> bool:
    """Whether anything in a scene asks for root stresses.

    **Arguments:**

    - `scene`: checked against the schema.
    """
    if scene.mesh.root_stress or _RESPONSE in (scene.compare.responses or ()):
        return True
    asked = scene.optimise
    if not scene.optimise.is_given:
        return False
    named = (*asked.weights, asked.pareto.against)
    return _RESPONSE in named or asked.limits.max_root_stress_MPa is not None
