"""Better flanks by gradient: objectives, searches within bounds, and the Master Curve.

Built on the public names of `jaxgear` alone. The names stand in `__init__.pyi`; each is imported
when it is first asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
