"""Rows of numbers over time, collected in columns that grow."""
from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fastbeam.interface.synonyms import known

Rows = Mapping[str, Any]


class RowBuffer:
    """Columns that grow geometrically, so that appending costs O(1) per row.

    shapes: name -> shape of one row.
    dtypes: name -> type, float64 where absent.
    capacity: rows allocated at first.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], dtypes: Mapping[str, type] | None = None,
                 capacity: int = 64) -> None:
        dtypes = dtypes or {}
        self.n_rows = 0
        self._capacity = max(1, int(capacity))
        self._data = {name: np.empty((self._capacity, *shape), dtype=dtypes.get(name, np.float64))
                      for name, shape in shapes.items()}

    def __len__(self) -> int:
        return self.n_rows

    def append(self, rows: Rows, n: int | None = None) -> None:
        """Add one row (n None) or a block of n rows (every array with first axis n). Raises ValueError: the names are not those
        of the buffer, or a value has the wrong shape. The buffer is then unchanged."""
        if rows.keys() != self._data.keys():
            raise ValueError(_name_mismatch(rows.keys(), self._data.keys()))
        first, last = self.n_rows, self.n_rows + (1 if n is None else n)
        if last > self._capacity:
            self._grow(last)
        for name, column in self._data.items():
            value = np.asarray(rows[name])
            expected = column.shape[1:] if n is None else (n, *column.shape[1:])
            if value.shape != expected:
                raise ValueError(f"series '{name}': expected shape {expected}, got {value.shape}")
            column[first:last] = value
        # counted last: a refused row leaves nothing behind
        self.n_rows = last

    def views(self) -> dict[str, np.ndarray]:
        """Return a mapping of names to arrays [n_rows, ...] without copying; later growth does not change them."""
        return {name: column[: self.n_rows] for name, column in self._data.items()}

    def _grow(self, needed: int) -> None:
        capacity = max(needed, 2 * self._capacity)
        grown = {name: np.empty((capacity, *old.shape[1:]), dtype=old.dtype) for name, old in self._data.items()}
        for name, old in self._data.items():
            grown[name][: self.n_rows] = old[: self.n_rows]
        # an interrupt finds all columns grown or none
        self._data, self._capacity = grown, capacity


def _name_mismatch(got: Iterable[str], expected: Iterable[str]) -> str:
    missing, extra = set(expected) - set(got), set(got) - set(expected)
    parts = [f"missing {known(sorted(missing))}"] * bool(missing) + [f"not in the header {known(sorted(extra))}"] * bool(extra)
    return "rows do not match the header: " + "; ".join(parts)
