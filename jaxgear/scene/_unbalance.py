"""The unbalance of a scene's shafts, in SI."""

from jaxgear._response._unbalance import Unbalance
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft, drawn_heights
from jaxgear._units import deg, g_mm
from jaxgear.scene._build_pair import si
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS


def unbalances_of(scene: Scene, model: PairModel) -> dict[str, tuple[Unbalance, ...]]:
    """The unbalance of each shaft of a scene that has some, for `jaxgear.unbalance_response`.

    **Arguments:**

    - `scene`: what is moved of it may be traced by JAX.
    - `model`: of the scene as it is moved.

    **Returns:**

    Unbalances by gear, in the order of the file.
    """
    mounts, found = (model.pinion_support, model.wheel_support), {}
    for gear, mount, body in zip(GEARS, mounts, model.bodies, strict=True):
        shaft = scene.gear(gear).shaft
        if not shaft.unbalance or not isinstance(mount, Shaft):
            continue
        if isinstance(body, FlexibleBody):
            above = body.nodes(mount).offsets
        else:
            # One that shares its node with a bearing still moves away from it.
            heights, nodes = drawn_heights(mount, body), mount.layout.nodes
            above = [x.at - heights[nodes[f"load {i}"]] for i, x in enumerate(mount.loads)]
        # Their nodes are behind those of the loads.
        found[gear] = tuple(
            Unbalance(
                si(row.moment_gmm, g_mm), si(row.angle_deg, deg), above[i], f"{gear} load {i}"
            )
            for i, row in enumerate(shaft.unbalance, start=len(shaft.loads))
        )
    return found
