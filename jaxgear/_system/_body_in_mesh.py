"""A condensed body in mesh that is yet to be given the motions on which it vibrates.

There are thousands of these, of which a response takes a few hundred. What cells feel of some, and
their inertia, is found from the rim and from the body's own matrices, so that nothing need be made
for all of them.
"""

import dataclasses

import numpy as np
import scipy

from jaxgear._geometry._lines import ContactLines
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_modes import BodyBasis, BodyModes, wave_partners
from jaxgear._system._condensed import Condensed
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import foot_loads
from jaxgear._types import as_reals


@dataclasses.dataclass(frozen=True)
class BodyInMesh:
    """A condensed body, its tables for statics, and how its rim moves the feet of teeth.

    **Fields:**

    - `condensed`: the body.
    - `still`: its tables without modes.
    - `feet`: components of feet by the translations of the rim nodes, `[row, 3 rim]`.
    - `places`: rows that the components of the cells are, `[period, component, cell]`.
    - `heat`: load on its coordinates per free strain of hub and rim, `[2, dof]`, or `None`.
    """

    condensed: Condensed
    still: FlexibleBody
    feet: "scipy.sparse.csr_array"
    places: np.ndarray
    heat: np.ndarray | None

    def rows(self, motions: np.ndarray) -> np.ndarray:
        """Motion of the feet of the cells, in the frame of each.

        **Arguments:**

        - `motions`: of the body's coordinates, `[dof, motion]`.

        **Returns:**

        Shape `[period, component, cell, motion]`.
        """
        return (self.feet @ motions[: self.feet.shape[1]])[self.places]

    def moving(self, basis: BodyBasis) -> FlexibleBody:
        """The body, vibrating on some motions.

        **Arguments:**

        - `basis`: they, as they repeat under its teeth.

        **Returns:**

        Its tables.
        """
        shapes = basis.shapes
        modes = BodyModes(
            square=as_reals(basis.square),
            rows=as_reals(self.rows(shapes)),
            load=as_reals(shapes.T @ self.condensed.centrifugal_load),
            heat=None if self.heat is None else as_reals(shapes.T @ self.heat.T),
            **basis.matrices(self.condensed)._asdict(),
            waves=tuple(int(wave) for wave in basis.waves),
            diameters=tuple(int(number) for number in basis.diameters),
        )
        return dataclasses.replace(self.still, modes=modes)

    def loads(
        self, pair: GearPair, index: int, lines: ContactLines, basis: BodyBasis
    ) -> np.ndarray:
        """Loads on motions by loads along each contact line by itself, in coordinates of space.

        **Arguments:**

        - `pair`: the gears.
        - `index`: 0 for the pinion, 1 for the wheel.
        - `lines`: where the cells are.
        - `basis`: the motions.

        **Returns:**

        Shape `[load, motion]` [kg^-1/2].
        """
        on_feet, ahead = map(np.asarray, foot_loads(pair, index, self.still, lines))
        period = np.arange(len(ahead)) // (len(ahead) // lines.periods) % len(self.places)
        column = np.broadcast_to(self.places[period][:, None], on_feet.shape)
        count = on_feet.shape[0] * on_feet.shape[1]
        row = np.broadcast_to(np.arange(count).reshape(*on_feet.shape[:2], 1, 1), on_feet.shape)
        entries = on_feet.ravel(), (row.ravel(), column.ravel())
        gathered = scipy.sparse.coo_array(entries, (count, self.feet.shape[0])).tocsr()
        # Of lines that are not in contact, and of cells beyond their ends.
        gathered.eliminate_zeros()
        found = gathered @ (self.feet @ basis.shapes[: self.feet.shape[1]])
        partner, number = wave_partners(basis.waves)
        # In place, for there are thousands of loads over a long cycle. The first of a pair has a
        # positive number, the second the same negative.
        for turned, own in zip(np.outer(ahead, number), np.split(found, len(ahead)), strict=True):
            own[:] = np.cos(turned) * own - np.sin(turned) * own[:, partner]
        return found
