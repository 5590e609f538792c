"""A table of results: columns of one length under names with units, as pictures and CSV have it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np


class Table(Mapping[str, np.ndarray]):
    """Columns of one length, by name, in order; a row for each record."""

    def __init__(self, columns: Mapping[str, Any]):
        """Take columns, numbers or texts.

        **Arguments:**

        - `columns`: by name, units included.

        **Raises:**

        - `ValueError` if a column is not one-dimensional, or not as long as the others.
        """
        self._columns = {name: np.asarray(values) for name, values in columns.items()}
        shapes = {name: each.shape for name, each in self._columns.items()}
        if any(len(shape) != 1 for shape in shapes.values()) or len({*shapes.values()}) > 1:
            raise ValueError(f"The columns of a table must have one length, got shapes {shapes}.")

    def __getitem__(self, name: str) -> np.ndarray:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __or__(self, more: Mapping[str, Any]) -> "Table":
        """With more columns, or others in place of some."""
        return Table({**self, **more})

    def __repr__(self) -> str:
        return f"Table({self._columns!r})"

    def known(self, name: str) -> "Table":
        """The rows in which a column has a value."""
        return self.rows(np.isfinite(self[name]))

    def rows(self, which: np.ndarray) -> "Table":
        """Some of the rows: their places, or a flag for each."""
        return Table({name: values[which] for name, values in self.items()})

    @classmethod
    def joined(cls, tables: Sequence[Mapping[str, Any]]) -> "Table":
        """Tables with the same columns, one under the other.

        **Arguments:**

        - `tables`: at least one; those of the first are the columns.
        """
        return cls({name: np.concatenate([each[name] for each in tables]) for name in tables[0]})
