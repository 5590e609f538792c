"""Gear dynamics that can be differentiated.

Everything inside is SI and radians; JAX must be in double precision. The names stand in
`__init__.pyi`; each is imported when it is first asked for, so that what is not used costs nothing.
"""

import warnings

import lazy_loader

# What names of before version 0.16 are called; the old ones go with 0.17.
_RENAMED = {
    "History": "TimeHistory",
    "Marching": "TimeStepping",
    "Profile": "Schedule",
    "balance_of": "harmonic_balance_problem",
    "condition": "distance_to_fold",
    "doubled": "period_doubled_branch",
    "feet": "interface_map",
    "fold_near": "refine_fold",
    "march": "time_history",
    "multipliers": "floquet_multipliers",
    "ready_scene": "example_scene",
    "terms_of": "fourier_coefficients",
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
