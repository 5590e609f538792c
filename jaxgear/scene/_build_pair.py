"""Flanks and gears of a scene in SI."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxgear._flank._deviations import (
    AbstractFlankDeviation,
    Bias,
    Crowning,
    EllipticalCrowning,
    EndRelief,
    Flanks,
    HelixSlope,
    ProfileCrowning,
    ProfileSlope,
    RootRelief,
    Superposed,
    TipRelief,
)
from jaxgear._flank._indexing import Indexing
from jaxgear._flank._tolerances import GradeWaveform, deviation_of_grade, pitch_error_of_grade
from jaxgear._geometry._backlash import check_backlash
from jaxgear._geometry._gear import Gear, Material
from jaxgear._geometry._pair import GearPair
from jaxgear._units import GPa, deg, mm, um
from jaxgear.scene._files import check_covers, deviation_of_table, read_profile, read_topography
from jaxgear.scene._gear_tables import FlankKeys, GearKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._sizes import of_material
from jaxgear.scene._tables import AbstractTables

_EXPONENT = {"linear": 1, "parabolic": 2}


def si(value: Any, unit: float | None = None) -> Any:
    """A number of a scene in SI; `None` stays what it is.

    In NumPy, whose arithmetic is not compiled, unless JAX traces it.
    """
    if value is None:
        return None
    number = value if isinstance(value, Tracer | jax.Array) else np.float64(value)
    return number if unit is None else number * unit


def pair_of(scene: Scene) -> GearPair:
    """The gears of a scene, mirrored where their coast flanks carry.

    **Raises:**

    - `ValueError` if the gears are impossible.
    """
    pair = GearPair(
        **{
            name: _gear(scene.gear(name), scene.plain.gear(name), material_of(scene, name))
            for name in GEARS
        },
        normal_module=si(scene.pair.module_mm, mm),
        pressure_angle=si(scene.pair.pressure_angle_deg, deg),
        helix_angle=scene.plain.pair.sense * si(scene.pair.helix_angle_deg, deg),
        centre_distance=si(scene.pair.centre_distance_mm, mm),
    )
    check_backlash(pair)
    return pair


def _gear(gear: GearKeys, plain: GearKeys, material: Material) -> Gear:
    return Gear(
        teeth=gear.teeth,
        face_width=si(gear.face_width_mm, mm),
        profile_shift=si(gear.profile_shift),
        addendum=si(gear.addendum_coeff),
        dedendum=si(gear.dedendum_coeff),
        fillet_radius=si(gear.fillet_radius_coeff),
        tip_shortening=si(gear.tip_shortening_coeff),
        # A bore of zero is none, which is a matter of the program and not of its numbers.
        bore=None if plain.bore_mm == 0.0 else si(gear.bore_mm, mm),
        material=material,
        thickness_allowance=si(gear.thickness_allowance_um, um),
        tip_corner_radius=si(gear.tip_corner_radius_mm, mm),
    )


def material_of(tables: AbstractTables, name: str) -> Material:
    """The material of a gear: its own, or that of both."""
    keys = ("young_GPa", "poisson", "density_kg_m3")
    young, poisson, density = (si(of_material(tables, name, key)) for key in keys)
    return Material(young=young * GPa, poisson=poisson, density=density)


def flanks_of(scene: Scene, pair: GearPair) -> Flanks:
    """The flank deviations of a scene.

    **Raises:**

    - `ValueError` if a file of measured deviations is unreadable or does not cover its flank.
    """
    parts, indexing = {}, {}
    for index, name in enumerate(GEARS):
        flank = scene.flank.gear(name, scene.plain.pair.sense)
        measured = _measured(flank, pair, index, scene.path.parent)
        parts[name] = Superposed(parts=(*_modified(flank), *measured, *_graded(flank, pair, index)))
        # A grade's pitch errors are a wave over the revolution: one mesh period sees nothing of it.
        graded = flank.accuracy_grade is not None and scene.mesh.periods > 1
        keys = ("pitch_error_um", "eccentricity_um", "eccentricity_angle_deg")
        said = graded or bool(flank.written(*keys))
        indexing[f"{name}_indexing"] = _indexing(flank, pair, index, graded) if said else None
    return Flanks(**parts, **indexing)


def _modified(flank: FlankKeys) -> tuple[AbstractFlankDeviation, ...]:
    """Modifications that the flank is to have."""
    tip, root, end = flank.tip_relief, flank.root_relief, flank.end_relief
    relief = lambda it: (si(it.depth_um, um), si(it.extent), _EXPONENT[it.shape])
    return (
        TipRelief(*relief(tip)),
        RootRelief(*relief(root)),
        EndRelief(*relief(end), left=end.side != "right", right=end.side != "left"),
        Crowning(si(flank.crowning_um, um)),
        EllipticalCrowning(si(flank.elliptical_crowning_um, um)),
        ProfileCrowning(si(flank.profile_crowning_um, um)),
        HelixSlope(si(flank.helix_slope_um, um)),
        ProfileSlope(si(flank.profile_slope_um, um)),
        Bias(si(flank.bias_um, um)),
    )


def _measured(
    flank: FlankKeys, pair: GearPair, index: int, folder: Path
) -> Iterator[AbstractFlankDeviation]:
    """Deviations that are given as files."""
    files = {read_profile: flank.profile_deviation_csv, read_topography: flank.topography_csv}
    for read, file in files.items():
        if file is not None:
            table = read(file, folder)
            check_covers(table, pair, index)
            yield deviation_of_table(table, pair, index)


def _graded(flank: FlankKeys, pair: GearPair, index: int) -> Iterator[AbstractFlankDeviation]:
    """Deviations that are given as a tolerance grade."""
    if flank.accuracy_grade is not None:
        grade = si(flank.accuracy_grade)
        yield deviation_of_grade(pair, index, grade, _waveform(flank, index))


def _waveform(flank: FlankKeys, index: int) -> GradeWaveform:
    slope = 1.0 if flank.accuracy_slopes else 0.0
    # Equal profile slopes cancel in mesh, for a pinion's tip meets the wheel's root; these add up.
    towards = -1.0 if index else 1.0
    waves = float(flank.accuracy_waves)
    return GradeWaveform(waves=waves, profile_slope=towards * slope, helix_slope=slope)


def _indexing(flank: FlankKeys, pair: GearPair, index: int, graded: bool) -> Indexing:
    """Pitch errors, with those of a grade or without, and eccentricity."""
    error = jnp.stack([jnp.asarray(x, dtype=float) for x in flank.pitch_error_um]) * um
    if graded:
        grade, waveform = si(flank.accuracy_grade), _waveform(flank, index)
        error = error + pitch_error_of_grade(pair, index, grade, waveform)
    return Indexing(
        pitch_error=error,
        eccentricity=si(flank.eccentricity_um, um),
        eccentricity_angle=si(flank.eccentricity_angle_deg, deg),
    )
