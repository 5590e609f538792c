"""A gear body between the teeth in mesh, as their contact lines see it."""

import equinox as eqx
from jaxtyping import Array

from jaxgear._contact._ring import give_alone, root_resultants
from jaxgear._geometry._profile import ToothSection
from jaxgear._types import Influence, Reals, Scalar


class SharedBody(eqx.Module):
    r"""A gear body that couples the teeth in mesh (theory 3.6).

    **Fields:**

    - `section`: of its teeth.
    - `influence`: of one root on itself and on the next ones, see `AbstractFoundation` [m2/N].
    - `roll_start`: roll length of the gear at $T_1$ [m].
    - `roll_sign`: whether the gear's roll length grows along the path: 1 pinion, -1 wheel [-].
    - `to_normal`: normal roll length per transverse one [-].
    """

    section: ToothSection
    influence: Influence
    roll_start: Scalar
    roll_sign: int = eqx.field(static=True)
    to_normal: Scalar

    @property
    def gear(self) -> int:
        """0 for the pinion, 1 for the wheel."""
        return 0 if self.roll_sign > 0 else 1

    def resultants(self, roll: Reals) -> Array:
        """Resultants N, Q, M/r_f at the root per normal line load, at places on the path [-]."""
        own = self.roll_start + self.roll_sign * roll
        return root_resultants(self.section, own * self.to_normal / self.section.base_radius)

    def at_roots(self, ahead: int) -> Array:
        """Motion of a root by loads at another, `ahead` lines further along the path [m2/N]."""
        # Angles count in the sense in which the mesh pushes the tooth: a tooth further along the
        # path lies ahead on the wheel, behind on the pinion. What turning round the ring does
        # to a load, it does to the motion: B(-a) = B(a)^T.
        towards = self.roll_sign * ahead
        influence = self.influence[abs(ahead)]
        return influence if towards >= 0 else influence.T

    def compliance(self, roll: Reals) -> Reals:
        """Give of a tooth loaded alone [m2/N]."""
        return give_alone(self.influence[0], self.resultants(roll))
