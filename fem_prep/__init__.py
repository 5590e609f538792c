"""Condensed models of flexible gear bodies, prepared offline.

From a grid of 20-node bricks, made here or brought along, to a small set of matrices on the rim
and the seats of the bearings, in one file. NumPy, SciPy and scikit-fem; everything is SI and
radians. Names stand in the order in which data flows.
"""

