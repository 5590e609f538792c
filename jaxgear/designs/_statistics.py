"""What many designs say together: shares of what varies in what is found, and quantiles."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from jaxgear.study._results import dataset_of, told

# Shares of designs that stay below a quantile, and how sure its bounds are.
SHARES, CONFIDENCE = (0.05, 0.5, 0.95, 0.99), 0.95
# Designs for each term of a polynomial, at least.
_ROWS = 2


def quantiles_dataset(designs: xr.Dataset, names: Sequence[str]) -> xr.Dataset:
    """Quantiles of numbers, and bounds between which they are with 95 % confidence.

    Bounds are order statistics, whatever the distribution: how many of independent values are below
    a quantile is binomial (David and Nagaraja, Order Statistics, 3rd ed., section 7.1). Those of a
    Sobol sequence or a Latin hypercube scatter less: for them the bounds are wider than need be.
    NaN where there are too few values to bound a quantile.

    **Arguments:**

    - `designs`: those with results; what one of them lacks is left out.
    - `names`: of the numbers.

    **Returns:**

    `value`, `low`, `high` over `number` and `share`, in the units of the numbers.
    """
    every = [np.sort(x[np.isfinite(x)]) for x in (designs[name].values for name in names)]
    value, low, high = (np.full((len(names), len(SHARES)), np.nan) for _ in range(3))
    for row, ordered in enumerate(every):
        if len(ordered):
            places = np.asarray([_bounds(len(ordered), share) for share in SHARES])
            value[row] = np.quantile(ordered, SHARES)
            low[row], high[row] = np.pad(ordered, 1, constant_values=np.nan)[places.T]
    mean, deviation = (
        np.asarray([of(x) if len(x) else np.nan for x in every]) for of in (np.mean, np.std)
    )
    return dataset_of(
        told(
            "number share",
            value=(value, "value that a share of the designs stays below"),
            low=(low, "lower bound of it"),
            high=(high, "upper bound of it"),
        )
        | told("number", mean=(mean, "mean"), deviation=(deviation, "standard deviation")),
        **told("number", number=(list(names), "number, in the unit of its name")),
        **told("share", share=(list(SHARES), "share of the designs")),
    )


def _bounds(count: int, share: float) -> tuple[int, int]:
    """Ranks, from 1, of the values around a quantile; 0 and one more than all are none."""
    from scipy.stats import binom

    tail = 0.5 * (1.0 - CONFIDENCE)
    # Between values of ranks r and s: P(r <= B < s) of a binomial B.
    low, high = (int(x) for x in binom.ppf([tail, 1.0 - tail], count, share))
    return low, min(high + 1, count + 1)


def effects_dataset(
    designs: xr.Dataset, keys: Sequence[str], names: Sequence[str]
) -> xr.Dataset | None:
    """Shares of the variance of numbers that keys have, alone and in pairs.

    A polynomial of second order is fitted: the squares of its coefficients on orthonormal terms are
    Sobol's indices, as far as it goes (Sudret, Reliability Engineering and System Safety 93, 2008).
    What it leaves out is `rest`.

    **Arguments:**

    - `designs`: those with results; a number is fitted to those that have it.
    - `keys`: that vary, numbers.
    - `names`: of the numbers.

    **Returns:**

    `share` over `number`, `first` and `second` key, on the diagonal of a key alone, NaN of a number
    that too few designs have; `None` if all are such, or nothing varies.
    """
    chosen = [key for key in keys if _unit(designs[key].values.astype(float)).any()]
    share, rest = np.full((len(names), *2 * [len(chosen)]), np.nan), np.full(len(names), np.nan)
    for number, name in enumerate(names):
        own = np.flatnonzero(np.isfinite(designs[name].values))
        if len(own) < 2 * _ROWS:
            continue
        terms = _terms({key: designs[key].values[own].astype(float) for key in chosen})
        if not terms or len(own) < _ROWS * (len(terms) + 1):
            continue
        share[number], matrix = 0.0, np.stack([x for *_, x in terms], axis=1)
        values = _unit(designs[name].values[own])
        found = np.linalg.lstsq(matrix, values, rcond=None)[0]
        rest[number] = np.var(values - matrix @ found)
        for (first, second, _), size in zip(terms, found.tolist(), strict=True):
            share[number, chosen.index(first), chosen.index(second)] += size**2
    if np.isnan(rest).all():
        return None
    return dataset_of(
        told("number first second", share=(share, "share of the variance"))
        | told("number", rest=(rest, "share that no polynomial of second order has")),
        **told("number", number=(list(names), "number, in the unit of its name")),
        **told("first", first=(chosen, "key")),
        **told("second", second=(chosen, "key together with it")),
    )


def _terms(values: Mapping[str, np.ndarray]) -> list[tuple[str, str, np.ndarray]]:
    """What a polynomial of second order is made of: both keys of a term, and its values."""
    columns = {key: _unit(x) for key, x in values.items()}
    terms = [(key, key, x) for key, x in columns.items()]
    terms += [(key, key, _unit(_less(x**2, x))) for key, x in columns.items()]
    products = [(a, b, columns[a] * columns[b]) for a, b in itertools.combinations(columns, 2)]
    terms += [(a, b, _unit(_less(x, columns[a], columns[b]))) for a, b, x in products]
    return [each for each in terms if each[2].any()]


def _unit(values: np.ndarray) -> np.ndarray:
    """Values less their mean, over their standard deviation; nothing of what does not vary."""
    off, size = values - values.mean(), values.std()
    return off / size if size > 1e-12 * max(abs(values.mean()), 1e-300) else np.zeros_like(off)


def _less(values: np.ndarray, *others: np.ndarray) -> np.ndarray:
    """What of values is none of others, which are in units."""
    basis = np.stack([np.ones_like(values), *others], axis=1)
    return values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
