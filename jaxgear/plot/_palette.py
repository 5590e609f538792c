"""Colours of the pictures."""

# Okabe and Ito's palette, told apart by colour-blind readers too.
_BLUE, _ORANGE, _GREEN, _RED, _SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9"

_GREY, _PINK = "#6b6b6b", "#ff6f91"
# The seventh of them; on white their yellow is hard to see.
PURPLE = "#CC79A7"
SERIES = (_BLUE, _ORANGE, _GREEN, _RED, PURPLE, _SKY, "black")
