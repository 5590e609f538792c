"""Sizes that follow from a scene's keys, in the units of the file, where these are right."""

import math

from jaxgear.scene._tables import AbstractTables


def reference_diameter(tables: AbstractTables, gear: str) -> float | None:
    """Reference diameter of a gear, if all that it takes is right [mm]."""
    module, helix, teeth = (
        tables.pair.module_mm,
        tables.pair.helix_angle_deg,
        tables.gear(gear).teeth,
    )
    if None in (module, helix, teeth):
        return None
    return module * teeth / math.cos(math.radians(helix))


def root_diameter(tables: AbstractTables, gear: str) -> float | None:
    """Diameter of the root circle of a gear, if all that it takes is right [mm]."""
    diameter, of = reference_diameter(tables, gear), tables.gear(gear)
    if diameter is None or None in (of.dedendum_coeff, of.profile_shift):
        return None
    return diameter - 2.0 * tables.pair.module_mm * (of.dedendum_coeff - of.profile_shift)


def of_material(tables: AbstractTables, gear: str, key: str) -> float | None:
    """A number of the material of a gear: its own, or that of both."""
    own = getattr(tables.gear(gear).material, key)
    return getattr(tables.material, key) if own is None else own
