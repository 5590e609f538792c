"""Colours of the pictures."""

# Okabe and Ito's palette, told apart by colour-blind readers too.
BLUE, ORANGE, GREEN, RED, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9"
# Its seventh; on white their yellow is hard to see.
PURPLE = "#CC79A7"
GREY, PINK = "#6b6b6b", "#ff6f91"

# Of pinion and wheel.
GEAR_COLOURS = (BLUE, ORANGE)
SERIES = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, "black")
# Of teeth and what is measured at them.
TEETH_SERIES = (BLUE, ORANGE, GREEN, RED, SKY, GREY)
# Of what lies over an area, and of what goes either way.
SURFACE, EITHER_WAY = "viridis", "RdBu_r"
