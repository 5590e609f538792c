"""How finely teeth of finite elements are divided: as finely as their unknowns allow."""

import functools

from ._checks import BodyError
from ._tooth_compliance import MOST_UNKNOWNS, unknowns_of
from ._tooth_section import ToothSizing
from ._tooth_shape import ToothedGear

# From fine to coarse, with what deflections under any wave of load are off by from the first, of
# that by an even load: of a pinion of 45 teeth, 7.7 modules wide, on a ring of 9 modules [-].
_SIZES = (
    (ToothSizing(), 0.0),
    (ToothSizing(flank=7, across=4, gap=6, ring=6, margin=1, waves=6), 0.012),
    (ToothSizing(flank=6, across=4, gap=4, ring=6, margin=1, waves=2), 0.012),
    (ToothSizing(flank=6, across=4, gap=4, ring=5, margin=0, waves=2), 0.02),
    (ToothSizing(flank=4, across=2, gap=4, ring=4, margin=1, waves=2), 0.05),
)


# Asked for each model of a scene.
@functools.lru_cache(maxsize=16)
def fitting_sizing(gear: ToothedGear, teeth: int) -> tuple[ToothSizing, float]:
    """The finest sizing of a gear's teeth whose unknowns can be factorised.

    Spur teeth have two halves that keep apart. Helical ones have not: they begin one size coarser.

    **Arguments:**

    - `gear`: its teeth and its ring.
    - `teeth`: that can be in mesh at once.

    **Returns:**

    The sizing, and how far deflections are off the finest one's [-].

    **Raises:**

    - `BodyError` if even the coarsest has too many unknowns.
    """
    sizes = _SIZES if gear.twist == 0.0 else _SIZES[1:]
    least = 0
    for sizing, error in sizes:
        least = unknowns_of(gear, teeth, sizing)
        if least <= MOST_UNKNOWNS:
            return sizing, error
    raise BodyError(
        "Teeth of finite elements may have {most:,} unknowns, which take some 4 GB; even divided "
        "coarsely these have {got:,}: the face is {face:.3g} modules wide, and up to {teeth} teeth "
        'are in mesh. Make the face narrower or the helix smaller, or write mesh.tooth = "sliced".',
        {
            "most": MOST_UNKNOWNS,
            "got": least,
            "face": gear.face_width / gear.module,
            "teeth": teeth,
        },
    )
