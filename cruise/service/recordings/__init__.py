"""Any recording, opened by what it is: tables, measurements, and logs of the bus through the DBC file.

| ending | what it is |
|---|---|
| .csv .parquet | a table: a time column, one column a signal |
| .mf4 | a measurement with one channel a signal, or a log of the bus |
| .log .asc .blf .trc .db, also with .gz | a log of the bus |

All follow the same column rules (`RecordingSettings`): names of the columns are the header's, the channels' or the
signals' of the DBC file.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import msgspec

from cruise.columns import ColumnSettings, RecordingSettings
from cruise.csv_file import read_csv
from cruise.recording import Recording, RecordingError
from cruise.service.recordings.bus_log import frames_of_log, read_bus_log
from cruise.service.recordings.measurement import has_channels, read_measurement
from cruise.service.recordings.parquet import read_parquet
from cruise.service.recordings.settings import ReadingSettings
from cruise.units import MA_PER_UNIT, InputUnit, entry

TABLES: Final = (".csv", ".parquet")
MEASUREMENT: Final = ".mf4"
LOGS: Final = (".log", ".asc", ".blf", ".trc", ".db")

__all__ = [
    "LOGS",
    "MEASUREMENT",
    "TABLES",
    "ReadingSettings",
    "frames_of_log",
    "is_log",
    "read_recording",
    "read_recordings",
    "read_table",
]


def read_recordings(
    paths: Sequence[str | Path],
    settings: ReadingSettings,
    dt_s: float | None = None,
    told: tuple[InputUnit, str] | None = None,
) -> list[Recording]:
    """Return the recordings at `paths` as `read_recording` does, the input of all in one unit.

    Where its size alone tells the unit, it is that of the greatest numbers: what can't be per cent in one of the
    recordings is none in the others. `told` is what unit it is instead, and the name of the model that says so.
    """
    found = [read_recording(path, settings, dt_s) for path in paths]
    telling: list[tuple[InputUnit, str]] = [
        (unit, Path(one.source).name) for unit in MA_PER_UNIT for one in found if one.input_unit == unit
    ]
    if not telling:
        return found
    unit, source = told or telling[0]
    return [
        one if one.input_unit == unit else _reread(path, one, unit, f"that of {source}", settings, dt_s)
        for path, one in zip(paths, found, strict=True)
    ]


def _reread(
    path: str | Path, alone: Recording, unit: InputUnit, like: str, settings: ReadingSettings, dt_s: float | None
) -> Recording:
    """Return a recording with its input in another unit than its size alone tells, and a note on it."""
    name = settings.input
    meant = ColumnSettings(scale=MA_PER_UNIT[unit])
    read = read_recording(path, msgspec.structs.replace(settings, columns={**settings.columns, name: meant}), dt_s)
    note = f"{name}: read as {unit} like {like}"
    if alone.input_unit:
        note += f"; alone it would be {alone.input_unit}, as {entry(name, MA_PER_UNIT[alone.input_unit])} reads all"
    return replace(read, notes=(note, *read.notes), input_unit=unit)


def read_recording(path: str | Path, settings: ReadingSettings, dt_s: float | None = None) -> Recording:
    """Return the recording at `path` on a grid of `dt_s` (default: the data's own step); times of a log from zero.

    Raises RecordingError, LogError or SettingsError, with what is wrong where, and what to do.
    """
    if is_log(path, settings):
        return read_bus_log(path, settings, dt_s)
    return read_table(path, settings, dt_s)


def read_table(path: str | Path, settings: RecordingSettings, dt_s: float | None = None) -> Recording:
    """Return the recording at `path`, which is no log of the bus. Raises RecordingError."""
    kind = Path(path).suffix.lower()
    read = read_csv if kind == ".csv" else read_parquet if kind == ".parquet" else read_measurement
    return read(path, settings, dt_s)


def is_log(path: str | Path, settings: RecordingSettings) -> bool:
    """Return whether the file holds frames; raises RecordingError for an ending that nothing here reads.

    A measurement whose channels are input and output is no log, whatever frames it holds besides.
    """
    file = Path(path)
    endings = [ending.lower() for ending in file.suffixes[-2:]]
    kind = endings[-1] if endings else ""
    if kind in TABLES:
        return False
    if kind == MEASUREMENT:
        return not has_channels(path, settings)
    if kind in LOGS or (kind == ".gz" and endings[0] in LOGS):
        return True
    raise RecordingError(
        f"{path}: recordings end in {' '.join((*TABLES, *LOGS, MEASUREMENT))}; "
        "save it as one of these, a table best as .csv with a header line"
    )
