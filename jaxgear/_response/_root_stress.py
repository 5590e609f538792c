r"""Stress at the roots of the teeth: the largest along the fillets, over the face and the cycle.

Each slice of a tooth is in plane strain under its own load and those of its neighbours; along the
face loads reach each other's roots by `face_operator`, applied twice with the decay length of
`RootInfluence.decay`. Loads are those that the slices carry, whatever couples their deflections.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._compiled import compiled
from jaxgear._contact._root_influence import AbstractRootInfluence, Influences
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._smooth import smooth_maximum
from jaxgear._solve._cycle import MeshCycle
from jaxgear._types import Bodies, LineGrid, Scalar

Stresses = Float[Array, "phase line slice gear"]


class RootStress(eqx.Module):
    r"""The largest stress of the fillets, along the surface and across the tooth.

    **Fields:**

    - `drive`: largest tensile stress on the fillet of the loaded flank [Pa].
    - `coast`: largest compressive stress on the other fillet, negative [Pa].
    - `height`: place of `drive`: from the root circle, along the tooth's centreline [m].
    """

    drive: Stresses
    coast: Stresses
    height: Stresses

    @property
    def largest(self) -> Bodies:
        """Largest tensile stress of each gear over face and cycle [Pa]."""
        return jnp.max(self.drive, axis=(0, 1, 2))


class LargestStress(NamedTuple):
    """The largest tensile stress of one gear's roots, and where it is.

    **Fields:**

    - `stress`: the stress [Pa].
    - `phase`: position in the cycle [-].
    - `face`: from mid-face [m].
    - `height`: above the root circle [m].
    """

    stress: Scalar
    phase: Scalar
    face: Scalar
    height: Scalar


@compiled
def root_stress(
    pair: GearPair, influences: Influences, lines: ContactLines, load: LineGrid
) -> RootStress:
    """Largest stresses of the fillets under given loads (theory 3.12).

    **Arguments:**

    - `pair`: the gears.
    - `influences`: from `root_influences`.
    - `lines`: where the slices are.
    - `load`: load of each slice over its length along the contact line, e.g. `slice_load` [N/m].

    **Returns:**

    The stresses, the last axis pinion and wheel.
    """
    found = [_of_gear(pair, each, lines, load, gear) for gear, each in enumerate(influences)]
    return RootStress(*(jnp.stack(each, axis=-1) for each in zip(*found, strict=True)))


def _of_gear(
    pair: GearPair, influence: AbstractRootInfluence, lines: ContactLines, load: LineGrid, gear: int
) -> tuple[LineGrid, LineGrid, LineGrid]:
    stress = influence.along_fillets(pair, lines, load, gear)
    drive, coast = stress[..., 0, :], stress[..., 1, :]
    at = influence.height[jnp.argmax(drive, axis=-1)]
    return jnp.max(drive, axis=-1), jnp.min(coast, axis=-1), at


@compiled
def slice_load(cycle: MeshCycle) -> LineGrid:
    """Force of each slice over its whole length, in contact or not [N/m]."""
    lines = cycle.cells.lines
    return cycle.force.reshape(lines.roll.shape) / lines.length


@compiled
def smooth_root_stress(stress: RootStress, width: Scalar) -> Scalar:
    """Differentiable largest tensile stress of both gears; too large by `width` log(number).

    **Arguments:**

    - `stress`: of both gears.
    - `width`: of the smoothing [Pa].

    **Returns:**

    The stress [Pa].
    """
    return smooth_maximum(stress.drive, width)


def largest_root_stress(
    stress: RootStress, lines: ContactLines
) -> tuple[LargestStress, LargestStress]:
    """The largest tensile stress of each gear, and where it is.

    **Arguments:**

    - `stress`: over a cycle.
    - `lines`: where its slices are.

    **Returns:**

    Pinion, wheel.
    """
    pinion, wheel = (_largest(stress, lines, gear) for gear in (0, 1))
    return pinion, wheel


def _largest(stress: RootStress, lines: ContactLines, gear: int) -> LargestStress:
    own = stress.drive[..., gear]
    phase, line, piece = jnp.unravel_index(jnp.argmax(own), own.shape)
    return LargestStress(
        stress=own[phase, line, piece],
        phase=lines.phase[phase],
        face=lines.face_position[piece],
        height=stress.height[phase, line, piece, gear],
    )
