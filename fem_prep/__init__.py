"""Condensed models of flexible gear bodies, prepared offline.

From a grid of 20-node bricks, made here or brought along, to a small set of matrices on the rim
and the seats of the bearings, in one file. NumPy, SciPy and scikit-fem; everything is SI and
radians. The names stand in `__init__.pyi`; each is imported when it is first asked for.
"""

import warnings

import lazy_loader

# What names of before version 0.16 are called; the old ones go with 0.17.
_RENAMED = {
    "Fineness": "MeshSizing",
    "Give": "Compliance",
    "Held": "FixedInterface",
    "LEAST_RIM": "MIN_RIM",
    "balanced": "self_equilibrated",
    "floating": "inertia_relief",
    "hold": "fixed_interface",
    "modes_told": "reported_mode_count",
    "read_give": "read_compliance",
    "recovered": "recovered_displacements",
    "write_give": "write_compliance",
}

_named, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    if name not in _RENAMED:
        return _named(name)
    new = _RENAMED[name]
    words = (
        f"{__name__}.{name} is called {__name__}.{new} now: the old name goes with version 0.17."
    )
    warnings.warn(words, DeprecationWarning, stacklevel=2)
    return _named(new)
