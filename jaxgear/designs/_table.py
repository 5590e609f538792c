"""The designs of a study: one row each, a column for each key that varies."""

import dataclasses
import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.special

from jaxgear._checks import InputError
from jaxgear.designs._asked import Study, read_value, varied_of
from jaxgear.scene._csv import read_cells
from jaxgear.scene._schema import KEYS, key_at

# No machine keeps more rows [-].
_MOST = 10_000_000
_TORQUE = "pair.torque_pinion_Nm"
# How far a scattered key is moved alone, in standard deviations.
_REACH = 2.0


@dataclasses.dataclass(frozen=True)
class DesignTable:
    """All designs of a study, in the units of their keys.

    **Fields:**

    - `keys`: of the scene, that vary.
    - `rows`: of each design its values [-].
    - `lines`: where each design stands, of those of a file.
    """

    keys: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    lines: tuple[str, ...] = ()

    def at(self, design: int) -> dict[str, Any]:
        """The values of a design by their keys."""
        return dict(zip(self.keys, self.rows[design], strict=True))


def design_table(study: Study) -> DesignTable:
    """The designs that a study asks for: the same ones wherever and whenever it is asked.

    **Arguments:**

    - `study`: from `read_study`.

    **Raises:**

    - `InputError` if a file of designs is not one, or there are too many.
    """
    design = study.asked.design
    if design.csv is not None:
        path = study.path.parent / design.csv
        if not path.exists():
            raise InputError(
                f"{study.where('design.csv')}: design.csv: there is no file {path}. A relative "
                "path is relative to the folder of the study."
            )
        return _of_file(path, study.scene.real_keys(), study.scene.values)
    varied = varied_of(study.values)
    keys, spans = tuple(each.key for each in varied), [_Span.of(study, *each) for each in varied]
    match design.kind:
        case "grid":
            levels = [span.levels(design.points or 3) for span in spans]
            count = int(np.prod([float(len(each)) for each in levels]))
            if count > _MOST:
                raise InputError(
                    f"{study.where('design.points')}: the grid has {count:,} designs, more than "
                    f'{_MOST:,}. Take fewer values, or kind = "sobol".'
                )
            rows = tuple(itertools.product(*levels))
        case "one-at-a-time":
            middle = tuple(span.middle for span in spans)
            moved = (
                (*middle[:place], value, *middle[place + 1 :])
                for place, span in enumerate(spans)
                for value in span.levels(design.points or 2)
                if value != span.middle
            )
            rows = (middle, *moved)
        case kind:
            assert design.points is not None
            unit = _unit(kind, len(keys), design.points, design.seed)
            columns = [span.drawn(unit[:, place]) for place, span in enumerate(spans)]
            rows = tuple(zip(*columns, strict=True))
    return DesignTable(keys, rows)


def _unit(kind: str, columns: int, count: int, seed: int) -> np.ndarray:
    """Places in the unit cube `[design, key]`."""
    # It costs half a second, which only who draws designs pays.
    from scipy.stats import qmc

    if kind == "random":
        return np.random.default_rng(seed).random((count, columns))
    if kind == "lhs":
        return qmc.LatinHypercube(columns, rng=np.random.default_rng(seed)).random(count)
    sampler = qmc.Sobol(columns, rng=np.random.default_rng(seed))
    # Of a power of two Sobol's points are balanced; the first of these are what is asked for.
    return sampler.random_base2(max(count - 1, 0).bit_length())[:count]


@dataclasses.dataclass(frozen=True)
class _Span:
    """What one key may be: between bounds, in a list, or scattered about its value.

    **Fields:**

    - `is_count`: whether it is an integer.
    - `low`, `high`: bounds; of a scattered one as far as it is moved alone, in its unit.
    - `values`: that are listed.
    - `deviation`: standard deviation, in its unit, where it scatters normally.
    - `middle`: its value in the scene, or half-way between its bounds.
    """

    is_count: bool
    low: float
    high: float
    values: tuple[Any, ...]
    deviation: float
    middle: Any

    @classmethod
    def of(cls, study: Study, key: str, table: str) -> "_Span":
        asked, rule = study.values[f"{table}.{key}"], key_at(key)
        assert rule is not None
        own, is_count = study.scene.value(key), rule.kind == "int"
        match table.rpartition(".")[2]:
            case "values":
                given = own if own is not None else asked[0]
                return cls(is_count, 0.0, 0.0, tuple(asked), 0.0, given)
            case "between":
                low, high = asked
                middle = 0.5 * (low + high) if own is None else own
                return cls(is_count, float(low), float(high), (), 0.0, middle)
            case "scatter":
                reach = _REACH * asked
                return cls(is_count, own - reach, own + reach, (), float(asked), own)
            case _:
                return cls(is_count, float(own - asked), float(own + asked), (), 0.0, own)

    def drawn(self, unit: np.ndarray) -> list[Any]:
        """Values at places from 0 to 1."""
        if self.values:
            places = np.minimum((unit * len(self.values)).astype(int), len(self.values) - 1)
            return [self.values[place] for place in places.tolist()]
        if self.deviation:
            normal = scipy.special.ndtri(np.clip(unit, 1e-12, 1.0 - 1e-12))
            return (self.middle + self.deviation * normal).tolist()
        if self.is_count:
            # Each as likely as the others, the ends too.
            steps = np.floor(unit * (self.high - self.low + 1.0))
            return [int(x) for x in np.minimum(self.low + steps, self.high)]
        return (self.low + unit * (self.high - self.low)).tolist()

    def levels(self, count: int) -> list[Any]:
        """Values from the lowest to the highest."""
        if self.values:
            return list(self.values)
        spread = np.linspace(self.low, self.high, count)
        return (
            list(dict.fromkeys(int(x) for x in np.rint(spread)))
            if self.is_count
            else (spread.tolist())
        )


def _of_file(path: Path, real: Iterable[str], values: Mapping[str, Any]) -> DesignTable:
    """Designs of a CSV file of numbers, whose columns are keys of the scene.

    Columns may be its real keys, entries of lists among them, other numbers among its `values`, and
    numbers that it leaves out.
    """
    plain = {key for key, value in values.items() if isinstance(value, int | float)}
    optional = {key for key, each in KEYS.items() if each.kind in ("int", "float")}
    columns = {*real, *plain, *(key for key in optional if "[]" not in key)}
    cells = read_cells(path, sorted(columns), ())
    if not cells.lines:
        raise InputError(f"{path}: there are no designs under the header. Add a line for each.")
    rules = map(key_at, cells.names)
    whole = [rule is not None and rule.kind == "int" for rule in rules]
    typed = lambda row: tuple(
        int(x) if count and x == int(x) else x for x, count in zip(row, whole, strict=True)
    )
    lines = tuple(f"{path}:{line}" for line in cells.lines)
    return DesignTable(tuple(cells.names), tuple(map(typed, cells.numbers.tolist())), lines)


def unfit(values: Mapping[str, Any], torque: float) -> str:
    """What is wrong with the values of a design, beside the scene's torque; empty if nothing is."""
    found = []
    for name, value in values.items():
        try:
            read_value(name, value)
        except ValueError as error:
            found.append(f"{name}: {error}")
    own = values.get(_TORQUE, torque)
    if not found and own != torque and own * torque <= 0.0:
        found.append(
            f"{_TORQUE}: got {own:g}, must have the sign of the scene's, {torque:g}: other flanks "
            "carry. Study each side by itself"
        )
    return "; ".join(found)
