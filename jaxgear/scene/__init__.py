"""Scene files: read with all mistakes at once, changed, written, and turned into SI models."""

import warnings

import lazy_loader

# What names of before version 0.16 are called; the old ones go with 0.17.
_RENAMED = {
    "ready_scene": "example_scene",
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
