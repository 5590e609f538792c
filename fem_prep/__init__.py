"""Condensed models of flexible gear bodies, prepared offline.

From a grid of 20-node bricks, made here or brought along, to a small set of matrices on the rim
and the seats of the bearings, in one file. NumPy, SciPy and scikit-fem; everything is SI and
radians. The names stand in `__init__.pyi`; each is imported when it is first asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
