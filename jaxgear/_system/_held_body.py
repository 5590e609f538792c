"""A condensed body whose seats are held: what feet of its teeth give, and what the seats feel."""

from dataclasses import dataclass

import numpy as np
import scipy

from jaxgear._interface._roots import InterfaceMap, RootPatches
from jaxgear._system._condensed import Condensed
from jaxgear._system._even_seats import along_axis, same_all_round


@dataclass(frozen=True)
class HeldBody:
    """A body with its seats held, and what the seats feel of it.

    **Fields:**

    - `feet`: their components by the translations of the rim nodes, `[row, 3 rim]`.
    - `of_rim`: motion of the rim by loads on them, `[3 rim, row]`.
    - `known`: what the feet's components give, if known from elsewhere, `[row, row]`.
    - `from_seats`: `[row, 6 seat]`, both in the frame of each foot.
    - `growth`: of the feet by rotation `[row]`.
    - `warm`: of the feet by heat, `[row, part]`.
    - `seat_stiffness`, `seat_load`: of the seats, the same in every direction.
    - `seat_heat`: load on them by heat, `[seat_dof, part]`.
    """

    feet: "scipy.sparse.csr_array"
    of_rim: np.ndarray
    known: np.ndarray | None
    from_seats: np.ndarray
    growth: np.ndarray
    seat_stiffness: np.ndarray
    seat_load: np.ndarray
    warm: np.ndarray
    seat_heat: np.ndarray

    def flexibility(self, rows: np.ndarray) -> np.ndarray:
        """What some of the feet's components give by each other's loads, `[row, row]`."""
        if self.known is not None:
            return self.known[np.ix_(rows, rows)]
        return self.feet[rows] @ self.of_rim[:, rows]


def held_answers(body: Condensed, loads: np.ndarray) -> np.ndarray:
    """Static answers of a body to loads on its coordinates, its seats held.

    **Arguments:**

    - `body`: the condensed body.
    - `loads`: shape `[load, dof]`.

    **Returns:**

    Its coordinates under each, shape `[load, dof]`.
    """
    first = 3 * len(body.rim_nodes)
    seat = np.arange(first, first + 6 * len(body.seats))
    inner, found = np.setdiff1d(np.arange(len(body.stiffness)), seat), np.zeros(loads.shape)
    stiffness, load = body.stiffness[np.ix_(inner, inner)], loads[:, inner].T
    found[:, inner] = scipy.linalg.solve(stiffness, load, assume_a="pos", check_finite=False).T
    return found


def held_body(
    body: Condensed,
    found: InterfaceMap,
    patches: RootPatches,
    components: tuple[int, ...],
    heat: np.ndarray | None,
    give: np.ndarray | None,
) -> HeldBody:
    """Hold the seats of a body, and move them and load its feet one by one.

    **Arguments:**

    - `body`: the condensed body.
    - `found`: rows of its feet.
    - `patches`: where they are.
    - `components`: of their motion that teeth load.
    - `heat`: load on its coordinates per free strain of hub and rim, or `None`.
    - `give`: of all components of the feet, `[6 foot, 6 foot]`, if it is known from elsewhere.

    **Returns:**

    What it gives.
    """
    rim, count = 3 * len(body.rim_nodes), len(body.seats)
    seat = np.arange(rim, rim + 6 * count)
    inner = np.setdiff1d(np.arange(len(body.stiffness)), seat)
    joined = body.stiffness[np.ix_(inner, seat)]
    angles = patches.angles.ravel()
    kept = (6 * np.arange(len(angles))[:, None] + np.array(components)).ravel()
    rows = found.rows[kept]
    whole = np.stack([body.centrifugal_load, *([] if heat is None else heat)], axis=1)
    # Feet of many teeth are more than the rim has motions: then these are loaded one by one.
    loads = scipy.sparse.eye_array(rim) if len(kept) > rim else rows.T
    # Unit motions of the seats, loads on the feet, rotation, heat: all in one solution.
    seats, feet = joined.shape[1], joined.shape[1] + loads.shape[1]
    right = np.zeros((len(inner), feet + whole.shape[1]), order="F")
    right[:, :seats] = joined
    right[:rim, seats:feet] = loads.toarray()
    right[:, feet:] = whole[inner]
    inside = body.stiffness[np.ix_(inner, inner)]
    factor = scipy.linalg.cho_factor(inside, lower=True, overwrite_a=True, check_finite=False)
    solved = scipy.linalg.cho_solve(factor, right, overwrite_b=True, check_finite=False)
    of_rim, by_seats = solved[:rim, seats:feet], solved[:, :seats]
    on_seats = along_axis(whole[seat] - joined.T @ solved[:, feet:])
    stiffness = body.stiffness[np.ix_(seat, seat)]
    alone = rows @ solved[:rim, feet:]
    return HeldBody(
        feet=rows,
        of_rim=(rows @ of_rim.T).T if len(kept) > rim else of_rim,
        known=None if give is None else give[np.ix_(kept, kept)],
        from_seats=-_turned(rows @ by_seats[:rim], angles),
        growth=alone[:, 0],
        warm=alone[:, 1:],
        seat_stiffness=same_all_round(stiffness - joined.T @ by_seats, stiffness, body),
        seat_load=on_seats[:, 0],
        seat_heat=on_seats[:, 1:],
    )


def _turned(rows: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Rows of each foot per motion of the seats in the body's frame: now in the foot's."""
    apart = rows.reshape(len(angles), len(rows) // len(angles), -1, 3)
    cosine, sine = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    x, y, z = np.moveaxis(apart, 3, 0)
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=3).reshape(rows.shape)
