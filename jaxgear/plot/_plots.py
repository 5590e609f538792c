"""The modules of pictures, each imported when it draws: matplotlib costs half a second."""

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxgear.plot import _axes_pictures as axes_pictures
    from jaxgear.plot import _body_pictures as body_pictures
    from jaxgear.plot import _campbell_pictures as campbell_pictures
    from jaxgear.plot import _compare_pictures as compare_pictures
    from jaxgear.plot import _contact_pictures as contact_pictures
    from jaxgear.plot import _cycle_pictures as cycle_pictures
    from jaxgear.plot import _flank_pictures as flank_pictures
    from jaxgear.plot import _hybrid_pictures as hybrid_pictures
    from jaxgear.plot import _mode_pictures as mode_pictures
    from jaxgear.plot import _modification_pictures as modification_pictures
    from jaxgear.plot import _order_pictures as order_pictures
    from jaxgear.plot import _pair_pictures as pair_pictures
    from jaxgear.plot import _relief_pictures as relief_pictures
    from jaxgear.plot import _root_pictures as root_pictures
    from jaxgear.plot import _search_pictures as search_pictures
    from jaxgear.plot import _sensitivity_pictures as sensitivity_pictures
    from jaxgear.plot import _shafts_pictures as shafts_pictures
    from jaxgear.plot import _shape_pictures as shape_pictures
    from jaxgear.plot import _sizing_pictures as sizing_pictures
    from jaxgear.plot import _sliding_pictures as sliding_pictures
    from jaxgear.plot import _style as style
    from jaxgear.plot import _sweep_pictures as sweep_pictures
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
    cycle_pictures = _Later("_cycle_pictures")
    pair_pictures = _Later("_pair_pictures")
    shafts_pictures = _Later("_shafts_pictures")
    sizing_pictures = _Later("_sizing_pictures")
    contact_pictures = _Later("_contact_pictures")
    flank_pictures = _Later("_flank_pictures")
    hybrid_pictures = _Later("_hybrid_pictures")
    mode_pictures = _Later("_mode_pictures")
    modification_pictures = _Later("_modification_pictures")
    order_pictures = _Later("_order_pictures")
    relief_pictures = _Later("_relief_pictures")
    root_pictures = _Later("_root_pictures")
    search_pictures = _Later("_search_pictures")
    sensitivity_pictures = _Later("_sensitivity_pictures")
    shape_pictures = _Later("_shape_pictures")
    sliding_pictures = _Later("_sliding_pictures")
    style = _Later("_style")
    sweep_pictures = _Later("_sweep_pictures")
    wave_pictures = _Later("_wave_pictures")
