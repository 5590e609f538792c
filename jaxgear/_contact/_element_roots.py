"""Stress along the fillets of teeth of finite elements, by the loads on their flanks.

Elements say what a load does to its own tooth and to those that follow against the clock, with the
free faces of the gear. What a load behind does to a tooth is taken from plane strain: it reaches
across a gap, and hardly varies along the face.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from jaxgear._contact._root_influence import AbstractRootInfluence, FilletStress, RootInfluence
from jaxgear._contact._tooth_elements import ToothTables, slice_waves
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._types import LineGrid

# Points of a fillet among which places are looked for.
FILLET_POINTS = 801


class ElementRootInfluence(AbstractRootInfluence):
    """Stress along the fillets of condensed teeth of one gear.

    **Fields:**

    - `stress`: waves of the stress by waves of the load on a row, of the loaded tooth and of those
        that follow it, on the fillet of the loaded flank and on the other [1/m].
    - `tables`: rows and waves of the teeth.
    - `behind`: plane strain, by loads on the tooth behind alone.
    - `point`, `flank`: in the transverse section; as of the base class [m].
    """

    stress: Float[Array, "tooth 2 point wave row wave"]
    tables: ToothTables
    behind: RootInfluence
    point: Float[Array, "point 2"]
    flank: Float[Array, "flank_point 2"]

    def along_fillets(
        self, pair: GearPair, lines: ContactLines, load: LineGrid, gear: int
    ) -> FilletStress:
        """Stress as the elements have it, means over slices; see the base class."""
        on_path = jnp.clip(lines.roll, pair.path_start, pair.path_end)
        rows = self.tables.row_weights(on_path if gear == 0 else pair.tangent_length - on_path)
        width = lines.length * jnp.cos(pair.base_helix_angle)
        waves = slice_waves(self.tables, lines.face_position, width)
        loaded = jnp.einsum("pls,plsj,sn->pljn", load * lines.length, rows, waves)
        by_waves = jnp.einsum("km,dsomjn->dksojn", waves, self.stress)
        total, count = self.behind.along_fillets(pair, lines, load, gear), load.shape[1]
        for ahead, own in enumerate(by_waves[:count]):
            found = jnp.einsum("ksojn,pljn->plkso", own, loaded)
            # The tooth that is further against the clock is the one that feels the other.
            if gear == 0:
                total = total.at[:, ahead:].add(found[:, : count - ahead])
            else:
                total = total.at[:, : count - ahead].add(found[:, ahead:])
        return total


def element_root_influence(
    stress: np.ndarray,
    places: np.ndarray,
    outline: tuple[np.ndarray, np.ndarray],
    tables: ToothTables,
    plane: RootInfluence,
) -> ElementRootInfluence:
    """The influence of condensed teeth, at as many points as that of plane strain.

    **Arguments:**

    - `stress`: of `fem_prep.condense_teeth` [1/m].
    - `places`: where it is, on the loaded tooth, half thickness and height, `[2, place, 2]` [m].
    - `outline`: half thickness and height from the involute to the root circle and on to the middle
        of the gap, the first `FILLET_POINTS` by even steps of the rack's normal; and up the flank,
        `[point, 2]` [m].
    - `tables`: of the teeth.
    - `plane`: the influence of the same teeth in plane strain.

    **Returns:**

    The influence.
    """
    fillet, flank = outline
    steps = np.linalg.norm(np.diff(fillet, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = plane.point.shape[0]
    wanted = np.linspace(FILLET_POINTS - 1, 0, count).round().astype(int)
    found = []
    for side in (0, 1):
        apart = np.linalg.norm(places[side][:, None] - fillet[None], axis=-1)
        at = along[np.argmin(apart, axis=1)]
        order = np.argsort(at)
        spline = CubicSpline(at[order], np.eye(len(at))[order])
        found.append(np.einsum("og,dgmjn->domjn", spline(along[wanted]), stress[:, side]))
    # Of neighbours only the one behind: the elements know the others.
    behind = eqx.tree_at(lambda each: each.terms, plane, plane.terms.at[1:].set(0.0))
    return ElementRootInfluence(
        stress=jnp.asarray(np.stack(found, axis=1)),
        tables=tables,
        behind=behind,
        point=jnp.asarray(fillet[wanted]),
        flank=jnp.asarray(flank),
    )
