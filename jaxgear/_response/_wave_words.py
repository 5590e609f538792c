"""Waves around a gear in words."""

# Waves of fewer nodal diameters are mostly motions of the gear as a whole.
BENT = 2


def wave_words(diameters: int) -> str:
    """A signed number of nodal diameters in words: forward positive."""
    if diameters == 0:
        return "no nodal diameter"
    plural = "s" if abs(diameters) > 1 else ""
    sense = "forward" if diameters > 0 else "backward"
    return f"{abs(diameters)} nodal diameter{plural}, {sense}"
