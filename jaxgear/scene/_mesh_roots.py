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
    return root_influences(pair) if asks_for_roots(scene) else None


def influences_near(scene: Scene, pair: GearPair) -> Callable[[GearPair], Influences | None]:
    """The same, for derivatives: a function of a pair that has moved from the scene's own.

    **Arguments:**

    - `scene`: checked against the schema.
    - `pair`: its gears.

    **Returns:**

    The function.
    """
    return nearby_influences(pair).at if asks_for_roots(scene) else lambda moved: None


def asks_for_roots(scene: Scene) -> bool:
    """Whether anything in a scene asks for root stresses.

    **Arguments:**

    - `scene`: checked against the schema.
    """
    if scene.mesh.root_stress or _RESPONSE in (scene.compare.responses or ()):
        return True
    asked = scene.optimise
    if not scene.has_table("optimise"):
        return False
    named = (*asked.weights, asked.pareto.against)
    return _RESPONSE in named or asked.limits.max_root_stress_MPa is not None
