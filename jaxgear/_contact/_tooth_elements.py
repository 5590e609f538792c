r"""Teeth of finite elements in mesh.

Both gears bring a compliance between loads on their flanks that is smooth: finite elements less a
half-space under the same loads. Under the true width of contact that half-space comes back, so that
nothing depends on the size of elements. The contact itself is split in two. What falls with the
load of a cell is its own spring,
$\frac{2}{\pi E^*}\ln(h_0/h)$, with $h = e a_H/4$ the half width of an even pressure that lowers its
mean as far as Hertz's lowers its middle; all the rest, up to the wider strip $h_0$, couples the
cells of a line, and is symmetric and positive.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from jaxgear._contact._compliance import AbstractCompliance, SharedBody
from jaxgear._contact._half_space import cells_on_half_space
from jaxgear._contact._hertz import hertz_contact
from jaxgear._contact._tooth import contact_modulus
from jaxgear._geometry._gear import Gear
from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._types import DenseCouplingGrid, Reals, Scalar, as_scalar


class ToothTables(eqx.Module):
    r"""Condensed teeth of one gear, see `fem_prep.ToothElements`.

    They hold for the gear they were made for, and are no functions of its geometry; Young's modulus
    scales them.

    **Fields:**

    - `compliance`: of rows and waves, of the loaded tooth and of those that follow it [m2/N].
    - `places`: squares of the roll lengths of the rows' middles [m2].
    - `pieces`: of the cubic splines that are 1 on one row and 0 on the others, by powers of the
        square of the roll length, the highest first [-, 1/m2, 1/m4, 1/m6].
    - `face_width`: of the gear [m].
    - `young`: that they were made with [Pa].
    """

    compliance: Float[Array, "tooth row wave row wave"]
    places: Float[Array, " row"]
    pieces: Float[Array, "power piece row"]
    face_width: Scalar = eqx.field(converter=as_scalar)
    young: Scalar = eqx.field(converter=as_scalar)

    def row_weights(self, roll: Reals) -> Array:
        """How much each row counts at places on the flank.

        **Arguments:**

        - `roll`: roll lengths on this gear [m].

        **Returns:**

        Weights that add up to 1, shape `[..., row]` [-].
        """
        square = roll**2
        inner = self.places[1:-1].reshape((1,) * roll.ndim + (-1,))
        piece = jnp.sum(jax.lax.stop_gradient(square)[..., None] >= inner, axis=-1)
        step = (square - self.places[piece])[..., None]
        result = jnp.zeros(())
        for power in self.pieces:
            result = result * step + power[piece]
        return result


def tooth_tables(
    compliance: np.ndarray, roll: np.ndarray, face_width: float, young: float
) -> ToothTables:
    """Tables of one gear from what `fem_prep.condense_teeth` gives (theory 4.6).

    **Arguments:**

    - `compliance`: of rows and waves [m2/N].
    - `roll`: roll lengths of the ends of the rows [m].
    - `face_width`: of the gear [m].
    - `young`: of the elements [Pa].

    **Returns:**

    The tables.
    """
    places = 0.5 * (roll[1:] ** 2 + roll[:-1] ** 2)
    spline = CubicSpline(places, np.eye(len(places)))
    return ToothTables(
        compliance=jnp.asarray(compliance),
        places=jnp.asarray(places),
        pieces=jnp.asarray(spline.c),
        face_width=face_width,
        young=young,
    )


class ElementTeeth(AbstractCompliance):
    """Teeth of finite elements on rings that are held at their bores, or on condensed bodies.

    **Fields:**

    - `pinion`: its condensed teeth.
    - `wheel`: its condensed teeth.
    - `load_updates`: how often the contact term is taken anew at the line loads found, instead
        of at the nominal one [-].
    """

    pinion: ToothTables  # ty: ignore[invalid-dataclass-field-order]
    wheel: ToothTables  # ty: ignore[invalid-dataclass-field-order]
    load_updates: int = eqx.field(static=True, default=0)

    # Slices across the face for what a pair gives that is loaded evenly and alone.
    _SLICES: ClassVar[int] = 20

    def local(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate what of the contact falls with a cell's load; see the base class."""
        even = _even_half_width(pair, roll, line_load)
        modulus = contact_modulus(pair.pinion.material, pair.wheel.material)
        return 2.0 / (jnp.pi * modulus) * jnp.log(_strip(pair, line_load) / even)

    def bodies(self, pair: GearPair, neighbours: int) -> tuple[SharedBody, ...]:
        """Return none: the compliance between cells has them in it; see the base class."""
        del pair, neighbours
        return ()

    def log_slope(self, pair: GearPair) -> Scalar:
        r"""Return $1/(\pi E^*)$, as the half width grows with the root of the load."""
        return 1.0 / (jnp.pi * contact_modulus(pair.pinion.material, pair.wheel.material))

    def alone(self, pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
        """Evaluate what the pair gives besides `local`, evenly loaded; see the base class."""
        return self._between(pair, roll, roll, 0) + _evenly(
            pair, _contact_between(pair, self._SLICES, line_load)
        )

    def felt(self, pair: GearPair, roll: Reals) -> Reals:
        """Evaluate what a pair gives by an even load on the pair behind it; see the base class."""
        if self.pinion.compliance.shape[0] < 2 or self.wheel.compliance.shape[0] < 2:
            return jnp.zeros_like(roll)
        return self._between(pair, roll + pair.transverse_base_pitch, roll, 1)

    def _between(self, pair: GearPair, first: Reals, last: Reals, ahead: int) -> Reals:
        """Even motion of the line at `first` by an even load on that at `last` [m2/N]."""
        total = jnp.zeros_like(first)
        half = 0.5 * pair.face_width
        middles = half * (2.0 * (jnp.arange(float(self._SLICES)) + 0.5) / self._SLICES - 1.0)
        for index, tables, gear in self._gears(pair):
            waves = slice_waves(tables, middles, 2.0 * half / self._SLICES)
            even = jnp.mean(waves, axis=0)
            plane = jnp.einsum("m,imjn,n->ij", even, _scaled(tables, gear)[ahead], even)
            ends = [_own_roll(pair, index, roll) for roll in (first, last)]
            if index == 1:
                # Further along the path is behind on the wheel.
                ends.reverse()
            rows = [tables.row_weights(roll) for roll in ends]
            total += jnp.einsum("...i,ij,...j->...", rows[0], plane, rows[1])
        return total * pair.face_width / jnp.cos(pair.base_helix_angle)

    def between_cells(
        self, pair: GearPair, lines: ContactLines, line_load: Scalar
    ) -> DenseCouplingGrid:
        """Compliance between all cells besides their own springs; see the base class."""
        phases, count, slices = lines.roll.shape
        on_path = jnp.clip(lines.roll, pair.path_start, pair.path_end)
        width = lines.length * jnp.cos(pair.base_helix_angle)
        blocks = [[jnp.zeros((phases, slices, slices))] * count for _ in range(count)]
        for index, tables, gear in self._gears(pair):
            waves = slice_waves(tables, lines.face_position, width)
            plane = jnp.einsum(
                "km,dimjn,ln->dikjl", waves, _scaled(tables, gear), waves, optimize=True
            )
            rows = tables.row_weights(_own_roll(pair, index, on_path))
            for ahead in range(min(count, plane.shape[0])):
                for first in range(count - ahead):
                    # The tooth that is further against the clock moves, the other one is loaded.
                    low, high = first, first + ahead
                    moved, loaded = (high, low) if index == 0 else (low, high)
                    block = jnp.einsum(
                        "pki,ikjl,plj->pkl", rows[:, moved], plane[ahead], rows[:, loaded]
                    )
                    blocks[moved][loaded] = blocks[moved][loaded] + block
                    if ahead:
                        turned = jnp.swapaxes(block, 1, 2)
                        blocks[loaded][moved] = blocks[loaded][moved] + turned
        contact = _contact_between(pair, slices, line_load)
        for line in range(count):
            blocks[line][line] = blocks[line][line] + contact[None]
        whole = jnp.concatenate([jnp.concatenate(row, axis=2) for row in blocks], axis=1)
        return _where_in_contact(lines, whole)

    def _gears(self, pair: GearPair) -> tuple[tuple[int, ToothTables, Gear], ...]:
        return (0, self.pinion, pair.pinion), (1, self.wheel, pair.wheel)


def _own_roll(pair: GearPair, index: int, roll: Reals) -> Reals:
    return roll if index == 0 else pair.tangent_length - roll


def _scaled(tables: ToothTables, gear: Gear) -> Array:
    return tables.compliance * (tables.young / gear.material.young)


def _where_in_contact(lines: ContactLines, whole: Array) -> DenseCouplingGrid:
    """Between cells in contact: of two, the shorter contact lies within the longer one."""
    fraction = lines.fraction.reshape(lines.phase.size, -1)
    in_mesh = fraction > 0.0
    share = jnp.where(in_mesh, fraction, 1.0)
    longer = jnp.maximum(share[:, :, None], share[:, None, :])
    return jnp.where(in_mesh[:, :, None] & in_mesh[:, None, :], whole / longer, 0.0)


def slice_waves(tables: ToothTables, middles: Reals, width: Scalar) -> Array:
    """Means of the waves of condensed teeth over slices of a face.

    **Arguments:**

    - `tables`: of the teeth.
    - `middles`: of the slices, from mid-face [m].
    - `width`: of a slice [m].

    **Returns:**

    Shape `[slice, wave]` [1/sqrt(m)].
    """
    count = tables.compliance.shape[2]
    points, weights = np.polynomial.legendre.leggauss(3 + count // middles.size)
    x = 2.0 * (middles[:, None] + 0.5 * width * jnp.asarray(points)[None, :]) / tables.face_width
    values = [jnp.ones_like(x), x]
    for m in range(2, count):
        values.append(((2 * m - 1) * x * values[m - 1] - (m - 1) * values[m - 2]) / m)
    means = jnp.einsum("mkp,p->km", jnp.stack(values[:count]), 0.5 * jnp.asarray(weights))
    return means * jnp.sqrt(jnp.arange(1.0, 2.0 * count, 2.0) / tables.face_width)[None, :]


# --- Contact

# The strip h_0 over the even half width at the pitch point: the spring stays positive up to ten
# times the nominal line load.
_WIDER = 4.0
# Of the largest correction that leaves the coupling of a line positive.
_MOST = 0.9


def _even_half_width(pair: GearPair, roll: Reals, line_load: Scalar) -> Reals:
    """Half width of an even pressure that gives as Hertz's does in its middle [m]."""
    return 0.25 * jnp.e * hertz_contact(pair, roll).half_width(line_load)


def _strip(pair: GearPair, line_load: Scalar) -> Scalar:
    return _WIDER * _even_half_width(pair, pair.pitch_point, line_load)


def _contact_between(pair: GearPair, slices: int, line_load: Scalar) -> Float[Array, "slice slice"]:
    r"""Compliance of one line's contact between its cells, without their own springs.

    As if pressed over the strip $h_0$; and, as far as what is left stays positive, corrected for
    contact that is narrower: a spring of each cell knows nothing of those beside it.
    """
    helix = jnp.cos(pair.base_helix_angle)
    length = pair.face_width / helix / slices
    place = length * (jnp.arange(float(slices)) + 0.5 - 0.5 * slices)
    strip, even = _strip(pair, line_load), _even_half_width(pair, pair.pitch_point, line_load)

    def pressed(half_width: Scalar) -> Array:
        total = jnp.zeros((slices, slices))
        for gear in (pair.pinion, pair.wheel):
            end = 0.5 * gear.face_width / helix
            total += cells_on_half_space(gear.material, half_width, length, place, (-end, end))
        return total

    wide, narrow = pressed(strip), pressed(even)
    modulus = contact_modulus(pair.pinion.material, pair.wheel.material)
    spring = 2.0 / (jnp.pi * modulus) * jnp.log(strip / even) / length
    missing = narrow - wide - spring * jnp.eye(slices)
    root = jnp.linalg.inv(jnp.linalg.cholesky(jax.lax.stop_gradient(wide)))
    most = jnp.linalg.eigvalsh(-root @ jax.lax.stop_gradient(missing) @ root.T)[-1]
    return wide + jnp.minimum(1.0, _MOST / jnp.maximum(most, 1e-9)) * missing


def _evenly(pair: GearPair, between: Array) -> Scalar:
    """Mean motion by an even load per length of line [m2/N]."""
    slices = between.shape[0]
    length = pair.face_width / jnp.cos(pair.base_helix_angle) / slices
    return length * jnp.sum(between) / slices
