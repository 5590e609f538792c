"""What gauges on condensed bodies read over a revolution, quasi-static with the mesh."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

import jaxgear as jg
from optimise._objectives import AbstractObjective, as_scalar

# Of each place: six components of the stress, then the normal stress along the gauge.
_SIX, _READ = 6, 7
_ROWS = ((0, 3, 5), (3, 1, 4), (5, 4, 2))


class _AbstractOverGauges(AbstractObjective):
    """A stress at gauges, smoothed.

    **Fields:**

    - `gauges`: of each body: per gauge xx, yy, zz, xy, yz, zx of the stress, then the normal
        stress along it [Pa].
    - `width`: of the smooth extremes [Pa].
    """

    gauges: tuple[jg.GaugeInfluences, ...]
    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=0.5 * jg.MPa)


class GaugeStress(_AbstractOverGauges):
    """Largest principal stress at some gauges over a revolution of their bodies, in MPa, smoothed.

    It is one of all principal stresses of all gauges and phases.

    **Fields:**

    - `gauges`: of each body: per gauge xx, yy, zz, xy, yz, zx of the stress, then the normal
        stress along it [Pa].
    - `width`: of the smooth maximum [Pa].
    """

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the stress [MPa]."""
        del law
        six = [_readings(each, model, cycle)[..., :_SIX] for each in self.gauges]
        tensors = [each[..., jnp.asarray(_ROWS)] for each in six]
        found = jnp.concatenate([jnp.linalg.eigvalsh(each).ravel() for each in tensors])
        return jg.smooth_maximum(found, self.width) / jg.MPa


class GaugeStressAmplitude(_AbstractOverGauges):
    """Half the range of the normal stress along some gauges over a revolution, in MPa, smoothed.

    The largest of all gauges.

    **Fields:**

    - `gauges`: as of `GaugeStress` [Pa].
    - `width`: of the smooth extremes [Pa].
    """

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the amplitude [MPa]."""
        del law
        halves = []
        for each in self.gauges:
            for along in _readings(each, model, cycle)[..., _SIX].T:
                most, least = (jg.smooth_maximum(x, self.width) for x in (along, -along))
                halves.append(0.5 * (most + least))
        return jg.smooth_maximum(jnp.stack(halves), self.width) / jg.MPa


def _readings(
    gauges: jg.GaugeInfluences, model: jg.PairModel, cycle: jg.MeshCycle
) -> Float[Array, "phase gauge 7"]:
    body = model.bodies[gauges.index]
    assert isinstance(body, jg.FlexibleBody)
    strain = None if body.heat is None else body.heat.strain
    found, _ = jg.gauge_readings(gauges, model.pair, cycle, model.speed, strain)
    return found.reshape(len(found), -1, _READ)
