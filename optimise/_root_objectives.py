"""What the roots of the teeth carry."""

import equinox as eqx
from jaxtyping import Array, Float

import jaxgear as jg
from optimise._objectives import AbstractObjective, as_scalar

Influences = tuple[jg.AbstractRootInfluence, jg.AbstractRootInfluence]


class LargestRootStress(AbstractObjective):
    """Largest tensile stress of the fillets of both gears, in MPa, smoothed.

    **Fields:**

    - `width`: of the smooth maximum [Pa].
    - `influences`: of the gears' teeth, from `jaxgear.root_influences`, where what is varied leaves
        the teeth as they are; from `jaxgear.nearby_influences` where it hardly changes them;
        `None`: solved anew for each cycle [-].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=2.0 * jg.MPa)
    influences: Influences | jg.NearbyInfluences | None = None

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the stress [MPa]."""
        del law
        influences = self.influences
        if influences is None:
            influences = jg.root_influences(model.pair)
        elif isinstance(influences, jg.NearbyInfluences):
            influences = influences.at(model.pair)
        stress = jg.root_stress(model.pair, influences, cycle.cells.lines, jg.slice_load(cycle))
        return jg.smooth_root_stress(stress, self.width) / jg.MPa
