"""Public names of `jaxgear.scene`, in the order of the flow."""

from ._build import grid_of as grid_of
from ._build import law_of as law_of
from ._build import model_of as model_of
from ._rewriting import rewrite_scene as rewrite_scene
from ._rewriting import write_scene as write_scene
from ._scene import Scene as Scene
from ._scene import SceneError as SceneError
from ._scene import example_scene as example_scene
from ._scene import read_scene as read_scene
from ._unbalance import unbalances_of as unbalances_of
from ._with_bodies import with_bodies as with_bodies
