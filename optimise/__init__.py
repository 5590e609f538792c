"""Better flanks by gradient: objectives, searches within bounds, and the Master Curve.

Built on the public names of `jaxgear` alone. The names stand in `__init__.pyi`; each is imported
when it is first asked for.
"""

import warnings

import lazy_loader

# What names of before version 0.16 are called; the old ones go with 0.17.
_RENAMED = {
    "Judged": "SpeedResults",
    "Sloped": "ValueAndGradient",
    "measured": "population_statistics",
    "moved_alone": "one_at_a_time_sample",
    "scattered": "sample",
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
