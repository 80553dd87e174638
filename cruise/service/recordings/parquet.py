"""Tables in Parquet files: the columns of the file, by the rules of a CSV file.

Numbers, booleans, decimals and times (in s, time stamps since 1970) are taken as they are, text as the number that it
spells. pyarrow reads them; it is an extra, because a machine that drives has no use for it.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from cruise.columns import RecordingSettings, tabulated
from cruise.csv_file import numbers
from cruise.recording import Recording, RecordingError
from cruise.sampling import FloatArray

if TYPE_CHECKING:
    import pyarrow as pa

INSTALL: Final = "install it: pip install pyarrow, or this project with its extra [parquet]"
PANDAS_INDEX: Final = "__index_level_"  # what pandas writes for the labels of its rows: no measurement
TIME_INDEX: Final = "time index"  # what labels that are times are called, where no column is one


def read_parquet(path: str | Path, settings: RecordingSettings, dt_s: float | None = None) -> Recording:
    """Read a Parquet file onto a uniform grid of `dt_s`, as `csv_file.read_csv` does.

    Raises RecordingError with file, row or column and what to do.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise RecordingError(f"{path}: Parquet files need pyarrow; {INSTALL}") from error
    if not Path(path).is_file():
        raise RecordingError(f"{path}: no such file")
    notes: list[str] = []
    raw: dict[str, FloatArray] = {}
    try:
        with parquet.ParquetFile(path) as file:  # a file, never a folder of them
            table = file.read()
        for name, column in zip(_names(table.schema), table.columns, strict=True):
            cells = _cells(column)
            if name.startswith(PANDAS_INDEX) or cells is None:
                notes.append(f"{name}: holds {column.type}, no measurement, left out")
                continue
            if name in raw:
                raise RecordingError(f"{path}: several columns are named {name}; rename them")
            raw[name] = cells
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise RecordingError(f"{path}: cannot be read: {reason}; is it a Parquet file?") from error
    return tabulated(str(path), raw, settings, dt_s, lambda row: f"{path}, row {row + 1}", str(path), tuple(notes))


def columns_of(path: str | Path) -> list[str]:
    """The names of a Parquet file's columns. Raises RecordingError where it has none that could be read."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise RecordingError(f"{path}: Parquet files need pyarrow; {INSTALL}") from error
    try:
        names = _names(parquet.read_schema(path))
    except (pa.ArrowException, OSError) as error:
        raise RecordingError(f"{path}: cannot be read: {error}; is it a Parquet file?") from error
    return [name for name in names if not name.startswith(PANDAS_INDEX)]


def _names(schema: "pa.Schema") -> list[str]:
    """Return the columns' names, with that of the labels where they alone are times."""
    from pyarrow import types

    if any("time" in name.lower() for name in schema.names):
        return schema.names
    timed = [types.is_timestamp(kind) or types.is_duration(kind) for kind in schema.types]
    return [
        TIME_INDEX if is_time and name.startswith(PANDAS_INDEX) else name
        for name, is_time in zip(schema.names, timed, strict=True)
    ]


def _cells(column: "pa.ChunkedArray") -> FloatArray | None:
    """Return the cells (N,) as numbers, NaN for none; None for a column of lists, bytes and the like."""
    import pyarrow as pa
    from pyarrow import types

    kind = column.type
    if types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if types.is_string(kind) or types.is_large_string(kind):
        return numbers([text or "" for text in column.to_pylist()])
    if types.is_timestamp(kind) or types.is_duration(kind):
        nanoseconds = pa.timestamp("ns") if types.is_timestamp(kind) else pa.duration("ns")
        return 1e-9 * _floats(column.cast(nanoseconds).cast(pa.int64()))
    if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind):
        return _floats(column)
    return None


def _floats(column: "pa.ChunkedArray") -> FloatArray:
    import pyarrow as pa

    values = column.cast(pa.float64(), safe=False).to_numpy()
    return np.where(np.isfinite(values), values, np.nan)
