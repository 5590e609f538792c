"""Scene files: read with all mistakes at once, changed, written, and turned into SI models."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
