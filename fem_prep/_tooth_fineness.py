"""How finely teeth of finite elements are divided: as finely as their unknowns allow."""

from ._checks import require
from ._tooth_compliance import MOST_UNKNOWNS, unknowns_of
from ._tooth_section import ToothSizing
from ._tooth_shape import ToothedGear

# From fine to coarse. What a tooth gives to an even load is within ERRORS of the first.
_SIZES = (
    ToothSizing(),
    ToothSizing(flank=7, across=4, gap=6, ring=6, margin=1, waves=6),
    ToothSizing(flank=6, across=4, gap=4, ring=6, margin=1, waves=6),
    ToothSizing(flank=5, across=4, gap=4, ring=4, margin=1, waves=4),
    ToothSizing(flank=4, across=2, gap=4, ring=4, margin=1, waves=2),
)


def fitting_sizing(gear: ToothedGear, teeth: int) -> ToothSizing:
    """The finest sizing of a gear's teeth whose unknowns can be factorised.

    Spur teeth have two halves that keep apart. Helical ones have not: they begin one size coarser.

    **Arguments:**

    - `gear`: its teeth and its ring.
    - `teeth`: that can be in mesh at once.

    **Returns:**

    The sizing.

    **Raises:**

    - `BodyError` if even the coarsest has too many unknowns.
    """
    sizes = _SIZES if gear.twist == 0.0 else _SIZES[1:]
    for sizing in sizes:
        unknowns = unknowns_of(gear, teeth, sizing)
        if unknowns <= MOST_UNKNOWNS:
            return sizing
    require(
        False,
        "Teeth of finite elements may have {most:,} unknowns, which take some 4 GB; even divided "
        "coarsely these have {got:,}: a face of {face:.3g} modules, {teeth} teeth in mesh. Make "
        'the face narrower or the helix smaller, or write mesh.tooth = "sliced".',
        most=MOST_UNKNOWNS,
        got=unknowns,
        face=gear.face_width / gear.module,
        teeth=teeth,
    )
    return sizes[-1]
