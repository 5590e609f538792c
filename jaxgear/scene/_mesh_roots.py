"""What loads do to the roots of a scene's teeth: solved where the scene asks for root stresses."""

from jaxgear._contact._root_influence import Influences, root_influences
from jaxgear._geometry._pair import GearPair
from jaxgear.scene._scene import Scene
from jaxgear.scene._study_tables import CompareKeys, OptimiseKeys
from jaxgear.scene._tables import MeshKeys

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
    if not asks_for_roots(scene.mesh, scene.compare, scene.optimise):
        return None
    plane = root_influences(pair)
    if scene.mesh.tooth != "elements":
        return plane
    # For other scenes no finite elements are imported.
    from jaxgear.scene._element_roots import element_roots
    from jaxgear.scene._mesh_teeth import teeth_in_mesh

    return element_roots(teeth_in_mesh(scene).condensed(), plane)


def asks_for_roots(mesh: MeshKeys, compare: CompareKeys, asked: OptimiseKeys) -> bool:
    """Whether a run, a comparison or a search of a scene asks for root stresses.

    **Arguments:**

    - `mesh`, `compare`, `asked`: the tables of the three.
    """
    if mesh.root_stress or _RESPONSE in (compare.responses or ()):
        return True
    if not asked.is_given:
        return False
    named = (*asked.weights, asked.pareto.against)
    return _RESPONSE in named or asked.limits.max_root_stress_MPa is not None
