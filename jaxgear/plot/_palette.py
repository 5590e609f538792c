"""Colours of the pictures."""

# Okabe and Ito's palette, told apart by colour-blind readers too.
BLUE, ORANGE, GREEN, RED, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9"

GREY, PINK = "#6b6b6b", "#ff6f91"

# Of pinion and wheel.
GEAR_COLOURS = (BLUE, ORANGE)

# Names of files that are still to be converted.
_BLUE, _ORANGE, _GREEN, _RED, _SKY = BLUE, ORANGE, GREEN, RED, SKY
_GREY, _PINK = GREY, PINK
