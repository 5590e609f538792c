"""Studies of many designs of a scene: a table of designs in, a table of results out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
