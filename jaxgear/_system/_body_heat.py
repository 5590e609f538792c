r"""What heat does to a condensed body in mesh: it moves the feet of teeth, loads seats and modes.

All of it is in proportion to the free strains $e = \alpha\Delta T$ of hub and rim, which may be
traced; temperatures count from that at which gears and centre distance are the nominal ones. The
teeth are as warm as the rim.
"""

from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

if TYPE_CHECKING:
    HeatedFeet = Array
    HeatedSeats = Array
    FreeStrains = Array
else:
    HeatedFeet = Float[Array, "period component cell part"]
    HeatedSeats = Float[Array, "seat_dof part"]
    FreeStrains = Float[Array, "part"]


class BodyHeat(eqx.Module):
    r"""Heat in a condensed body (theory 6.13).

    **Fields:**

    - `feet`: motion of the feet per free strain of hub and rim, the seats held, in the frame of
        each foot [m, rad].
    - `seats`: load on the seats per free strain [N, N m].
    - `strain`: $\alpha\Delta T$ of hub and rim [-].
    """

    feet: HeatedFeet
    seats: HeatedSeats
    strain: FreeStrains

    @property
    def growth(self) -> Float[Array, "period component cell"]:
        """Motion of the feet, the seats held [m, rad]."""
        return self.feet @ self.strain

    @property
    def seat_load(self) -> Float[Array, " seat_dof"]:
        """Load on the seats [N, N m]."""
        return self.seats @ self.strain

    @property
    def of_teeth(self) -> Float[Array, ""]:
        """Free strain of the teeth [-]."""
        return self.strain[1]


def no_strain() -> FreeStrains:
    """Of a body at the temperature of its nominal measures [-]."""
    return jnp.zeros(2)
