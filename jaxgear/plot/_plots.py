"""The modules of pictures, each imported when it draws: matplotlib costs half a second."""

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxgear.plot import _axes_pictures as axes_pictures
    from jaxgear.plot import _body_pictures as body_pictures
    from jaxgear.plot import _campbell_pictures as campbell_pictures
    from jaxgear.plot import _compare_pictures as compare_pictures
    from jaxgear.plot import _curve_pictures as curve_pictures
    from jaxgear.plot import _dynamic_pictures as dynamic_pictures
    from jaxgear.plot import _flank_pictures as flank_pictures
    from jaxgear.plot import _hybrid_pictures as hybrid_pictures
    from jaxgear.plot import _modification_pictures as modification_pictures
    from jaxgear.plot import _pictures as pictures
    from jaxgear.plot import _robust_pictures as robust_pictures
    from jaxgear.plot import _sensitivity_pictures as sensitivity_pictures
    from jaxgear.plot import _sliding_pictures as sliding_pictures
    from jaxgear.plot import _style as style
    from jaxgear.plot import _wave_pictures as wave_pictures
else:

    class _Later:
        """Functions of a module that is imported when one of them is called."""

        def __init__(self, module: str):
            self._module = module

        def __getattr__(self, name: str) -> Callable[..., Any]:
            def called(*arguments, **options):
                module = importlib.import_module(f"jaxgear.plot.{self._module}")
                return getattr(module, name)(*arguments, **options)

            return called

    axes_pictures = _Later("_axes_pictures")
    body_pictures = _Later("_body_pictures")
    campbell_pictures = _Later("_campbell_pictures")
    compare_pictures = _Later("_compare_pictures")
    curve_pictures = _Later("_curve_pictures")
    dynamic_pictures = _Later("_dynamic_pictures")
    flank_pictures = _Later("_flank_pictures")
    hybrid_pictures = _Later("_hybrid_pictures")
    modification_pictures = _Later("_modification_pictures")
    pictures = _Later("_pictures")
    robust_pictures = _Later("_robust_pictures")
    sensitivity_pictures = _Later("_sensitivity_pictures")
    sliding_pictures = _Later("_sliding_pictures")
    style = _Later("_style")
    wave_pictures = _Later("_wave_pictures")
