"""What every table that the program writes must be, read back as a user reads it."""

import csv
import re
from pathlib import Path

import pandas as pd

from jaxgear.scene._schema import KEYS, general

# Units as they stand at the end of names.
_UNITS = (
    *("um", "um2", "mm", "mm2", "m", "rad", "deg", "urad", "s", "Hz", "kg", "N", "MPa", "GPa"),
    *("Nm", "N_mm", "N_um", "N_m", "W", "rad_s", "mm_s", "m_s", "MB", "K"),
)
_WITH_UNIT = re.compile(rf".*_({'|'.join(_UNITS)})")

# Shares, ratios and errors relative to something, wherever they are.
_RATIO = re.compile(r"(.*_)?(ratio|share|relative|factor)(_.*)?")
_OF_RUNGS = re.compile(r"(error|error_95|held_out)_\w+")

# Names, numbers of something, places in units of the gears' own, and flags.
_NO_UNIT = {
    *("gear", "body", "bearing", "probe", "gauge", "axis", "index", "element", "flank"),
    *("mode", "harmonic", "order", "branch", "piece", "label", "direction", "periods"),
    *("kind", "family", "nodal_diameter", "nodal_diameters", "nodal_circle", "likeness"),
    *("share_of_nodal_diameter", "mode_in_mesh", "mesh_energy"),
    *("phase", "passage", "line", "tooth_pair", "tooth_pairs", "profile_position", "extent"),
    *("load_sharing", "share_of_mesh_force", "load_over_mean", "above_a_hole"),
    *("contact_loss", "settled", "stable", "max_line_load_passage", "te_rms_per_depth"),
    *("design", "method", "evaluation", "rank", "rank_by_pressure", "quantity", "moved"),
    *("allowed", "kept", "dominated", "name", "dofs", "slices", "phases", "steps", "beyond"),
    *("speeds", "modes", "weighted"),
    *("arrow", "along_S", "along_T", "along_Z", "state", "trace"),
    *("specific_sliding_pinion", "specific_sliding_wheel", "sliding_over_pitch_line_speed"),
    # The response and the key of the row say the unit.
    *("response", "key", "measure", "value", "sensitivity", "contact", "verdict"),
    *("forward", "reverse", "difference", "error"),
    # An objective or a response without a unit, or a weighted sum.
    *("objective", "objective_weighted", "nominal_less", "nominal_without_deviations"),
    *("nominal_more", "robust_less", "robust_without_deviations", "robust_more"),
}


def is_told(name: str) -> bool:
    """Whether a column's name says its unit, or that of something without one."""
    if name in _NO_UNIT or name.startswith("energy_"):
        return True
    if (key := general(name)) in KEYS:
        return KEYS[key].unit in ("-", "") or _WITH_UNIT.fullmatch(name) is not None
    return any(form.fullmatch(name) for form in (_WITH_UNIT, _RATIO, _OF_RUNGS))


def assert_table(path: Path) -> pd.DataFrame:
    """Read a table back: rectangular, no row empty, no column both text and numbers, all told."""
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert len(set(head)) == len(head), (path, head)
    assert {len(row) for row in rows} <= {len(head)}, path
    cells = {cell for row in rows for cell in row}
    assert not {"nan", "inf", "-inf"} & {cell.lower() for cell in cells}, path
    assert "None" not in cells, path
    table = pd.read_csv(path)
    assert table.shape == (len(rows), len(head)), path
    assert not table.isna().all(axis=1).any(), path
    for place, name in enumerate(head):
        assert is_told(name), f"{path.name}: what unit has {name}?"
        assert len({_is_number(row[place]) for row in rows if row[place]}) <= 1, (path, name)
    return table


def _is_number(cell: str) -> bool:
    try:
        return float(cell) is not None
    except ValueError:
        return False


def assert_tables(folder: Path) -> list[str]:
    """Check all tables of a folder, those below it too, and return their names."""
    paths = sorted(folder.rglob("*.csv"))
    for path in paths:
        assert_table(path)
    return [str(path.relative_to(folder)) for path in paths]
