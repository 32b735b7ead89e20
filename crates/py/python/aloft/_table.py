"""Tables: shared with Arrow, polars and pandas, and series for numpy."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _aloft

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow

    Array = np.ndarray[Any, np.dtype[Any]]


class Table:
    """A table whose columns are numpy arrays, shared with other libraries without a copy.

    `table["name"]` is a read-only array on the table's own memory. The table implements the Arrow
    PyCapsule interface (`__arrow_c_stream__`): `polars.DataFrame(table)`, `pyarrow.table(table)`,
    DuckDB and others take it as it is, and share the memory of its numbers.

    Three kinds of columns are converted, because the layouts differ: text (to Python strings for
    numpy, to `large_utf8` for Arrow), truth values for numpy (Arrow packs eight into a byte), and for
    numpy whole numbers of which some are missing (to floating point with NaN).

    A missing value is NaN in a series, null in a table made from records.
    """

    def __init__(self, native: _aloft.NativeTable) -> None:
        self._native = native

    @classmethod
    def of_records(cls, records: Sequence[Mapping[str, Any]]) -> Table:
        """A table with one row a record of an answer.

        An interval `[low, high]` becomes two columns `.low` and `.high`, a vector of three numbers
        `.x`, `.y`, `.z`; a record within a record becomes columns `outer.inner`. What is none of
        these (a list of any length) is kept as JSON text.
        """
        columns: dict[str, list[Any]] = {}
        for row, record in enumerate(records):
            for name, value in _flat("", record):
                columns.setdefault(name, [None] * row).append(value)
            for values in columns.values():
                if len(values) == row:
                    values.append(None)
        return cls(_aloft.NativeTable.of([(name, *_kind(values)) for name, values in columns.items()]))

    @property
    def names(self) -> list[str]:
        """Names of the columns, in order."""
        return self._native.names

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self._native), len(self.names)

    def __getitem__(self, name: str) -> Array:
        text = self._native.texts(name)
        if text is not None:
            return np.array(text, dtype=object)
        return np.asarray(self._native.numbers(name))

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        """The number of rows."""
        return len(self._native)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __arrow_c_schema__(self) -> object:
        return self._native.__arrow_c_schema__()

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self._native.__arrow_c_stream__(requested_schema)

    def to_numpy(self, *names: str) -> Array:
        """The columns (all if none is named) side by side, (rows, columns). This copies."""
        return np.column_stack([self[name] for name in names or self.names])

    def to_arrow(self) -> pyarrow.Table:
        """A `pyarrow.Table` on the same memory."""
        import pyarrow

        return pyarrow.table(self)

    def to_polars(self) -> polars.DataFrame:
        """A `polars.DataFrame` on the same memory."""
        import polars

        return polars.DataFrame(self)

    def to_pandas(self) -> pandas.DataFrame:
        """A `pandas.DataFrame` whose columns of numbers lie on the same memory (read-only)."""
        import pandas

        return pandas.DataFrame({name: pandas.Series(self[name], copy=False) for name in self.names}, copy=False)

    def __repr__(self) -> str:
        rows, _ = self.shape
        return f"<aloft.Table of {rows} rows: {', '.join(self.names[:8])}{', …' if len(self.names) > 8 else ''}>"

    def _repr_html_(self) -> str:
        shown = min(self.shape[0], 10)
        names = self.names[:12]
        cells = [[_cell(v) for v in self[name][:shown]] for name in names]
        head = "".join(f"<th>{_escape(name)}</th>" for name in names)
        rows = "".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in zip(*cells))
        size = f"{self.shape[0]} rows, {self.shape[1]} columns"
        return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table><p>{size}</p>"


def _flat(prefix: str, record: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in record.items():
        name = prefix + key
        if isinstance(value, Mapping):
            yield from _flat(name + ".", value)
        elif isinstance(value, list) and _numbers(value) and len(value) in (2, 3):
            ends = ("low", "high") if len(value) == 2 else ("x", "y", "z")
            yield from ((f"{name}.{end}", v) for end, v in zip(ends, value))
        elif isinstance(value, list):
            yield name, json.dumps(value, ensure_ascii=False)
        else:
            yield name, value


def _numbers(values: list[Any]) -> bool:
    return all(v is None or (isinstance(v, (int, float)) and not isinstance(v, bool)) for v in values)


def _kind(values: list[Any]) -> tuple[str, list[Any]]:
    kinds = {type(v) for v in values if v is not None}
    for kind in (bool, int, str):
        if kinds == {kind}:
            return kind.__name__, values
    if kinds <= {int, float}:
        return "float", values
    return "str", [v if v is None or isinstance(v, str) else json.dumps(v) for v in values]


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else _escape(str(value))


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
