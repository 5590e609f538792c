"""The health report of a condensed body: what it is, how far it is from the full one."""

from collections.abc import Sequence

import numpy as np

from ._answers import (
    FreeModes,
    Report,
    Solid,
    brick_report,
    conditioning,
    counts,
    described_modes,
    mass_properties,
    modes_report,
    reported_mode_count,
    rigid_energies,
    rim_report,
)
from ._artefact import ReducedBody
from ._boundary import FullBody
from ._checks import Progress, require, silent
from ._compared import compared, free_error
from ._hold import FixedInterface, fixed_interface
from ._static_answers import (
    Springs,
    growth,
    growth_report,
    tooth_deflection,
    tooth_report,
    tooth_row,
)
from ._verdicts import verdicts


def health_report(
    full: FullBody | None,
    held: FixedInterface | None,
    reduced: ReducedBody,
    *,
    exact: Solid | None = None,
    modes: FreeModes | None = None,
    free_frequency: Sequence[float] | np.ndarray | None = None,
    root_thickness: float | None = None,
    springs: Springs | None = None,
    torque_seat: str | None = None,
    speeds: Sequence[float] = (500.0, 1000.0, 1500.0),
    couplings: bool = False,
    progress: Progress = silent,
) -> Report:
    """What a condensed body is, how far it is from the full one, and what is wrong with it.

    **Arguments:**

    - `full`: the body in all its unknowns; None, as for matrices from elsewhere: nothing is
        compared.
    - `held`: the same with its boundary held, as it was condensed; None: it is held again.
    - `reduced`: the condensed body.
    - `exact`: what its mass should be, if known.
    - `modes`: of the condensed body, if known.
    - `free_frequency`: elastic ones of the full body, rising, if known [Hz]. Without them those
        among the facts of the condensed body are taken, or they are sought, which takes long.
    - `root_thickness`: of a tooth, along the rim [m].
    - `springs`: on which the body is compared.
    - `torque_seat`: name of the seat where the torque of a tooth load leaves; the first one
        without it.
    - `speeds`: at which the growth of the rim is told [rad/s].
    - `couplings`: also compare rigid and averaging seats, which takes another factor.
    - `progress`: told what begins.

    **Returns:**

    Numbers, texts, and lists and mappings of them, by name; a unit is part of the name. The last
    one, `warnings`, says in sentences what is not as it should be.

    **Raises:**

    - `BodyError` if the condensed body has no mass, or no such seat.
    """
    require(
        reduced.mass.any(),
        "{name} must have a mass for its health to be told, and has none: matrices taken over for "
        "statics alone are not judged.",
        name=reduced.name,
    )
    springs = Springs() if springs is None else springs
    if modes is None:
        if full is not None and held is None:
            held = fixed_interface(full, progress=progress)
        modes = described_modes(
            reduced, held, count=reported_mode_count(reduced), progress=progress
        )
    report = counts(full, reduced) | mass_properties(full, reduced, exact)
    report |= rigid_energies(full, reduced) | modes_report(modes)
    with progress("centrifugal growth and a tooth load"):
        grown = growth(reduced)
        report |= growth_report(reduced, grown, speeds)
        row = tooth_row(reduced, springs.line_of_action, root_thickness)
        bent = tooth_deflection(reduced, row, springs, torque_seat)
        if bent is not None:
            report |= tooth_report(reduced, bent, row, springs, torque_seat)
    with progress("largest frequency"):
        report |= conditioning(reduced)
    if full is not None:
        free = reduced.facts.get("free_frequency_Hz") if free_frequency is None else free_frequency
        report |= free_error(full, modes, free, progress)
        report |= compared(
            full, reduced, grown, bent, row, springs, torque_seat, couplings, progress
        )
        report |= brick_report(full)
    report |= rim_report(reduced, root_thickness)
    return report | {"warnings": verdicts(report)}
