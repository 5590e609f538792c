"""Gear dynamics that can be differentiated.

Everything inside is SI and radians; JAX must be in double precision. The names stand in
`__init__.pyi`; each is imported when it is first asked for, so that what is not used costs nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
