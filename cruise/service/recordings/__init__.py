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
from typing import Final, NamedTuple

import msgspec

from cruise.can.log import MEASUREMENT
from cruise.columns import ColumnSettings, RecordingSettings
from cruise.csv_file import read_csv
from cruise.recording import Recording, RecordingError, counted_from
from cruise.service.recordings.bus_log import frames_of_log, read_bus_log
from cruise.service.recordings.measurement import has_channels, read_measurement
from cruise.service.recordings.parquet import read_parquet
from cruise.service.recordings.settings import ReadingSettings
from cruise.units import MA_PER_UNIT, InputUnit, entry

TABLES: Final = (".csv", ".parquet")
LOGS: Final = (".log", ".asc", ".blf", ".trc", ".db")

__all__ = [
    "LOGS",
    "MEASUREMENT",
    "TABLES",
    "ReadingSettings",
    "Told",
    "frames_of_log",
    "is_log",
    "read_recording",
    "read_recordings",
    "read_table",
]


class Told(NamedTuple):
    """How the input of recordings is read: in which unit, empty where nobody knows, from where, and who says so."""

    unit: InputUnit
    rest_ma: float
    source: str


def read_recordings(
    paths: Sequence[str | Path], settings: ReadingSettings, dt_s: float | None = None, told: Told | None = None
) -> list[Recording]:
    """Return the recordings at `paths` as `read_recording` does, the input of all in one unit, counted from one place.

    Where its size alone tells the unit, it is that of the greatest numbers: what can't be per cent in one of the
    recordings is none in the others. Where one of them shows at which input the machine stands, all are counted from
    there. `told` is what it is instead; the settings have the word before that, and so has a flag that sets it to 0.
    """
    found = [read_recording(path, settings, dt_s) for path in paths]
    telling: list[tuple[InputUnit, str]] = [
        (unit, one.source) for unit in MA_PER_UNIT for one in found if one.input_unit == unit
    ]
    if telling:
        unit, source = (told.unit, told.source) if told is not None and told.unit else telling[0]
        like = f"that of {Path(source).name}"
        found = [
            one if one.input_unit == unit else _reread(path, one, unit, like, settings, dt_s)
            for path, one in zip(paths, found, strict=True)
        ]
    resting = [(one.input_rest_ma, one.source) for one in found if one.input_rest_ma]
    said = settings.input_rest_ma is not None or settings.active_when is not None
    if said or (told is None and not resting):
        return found
    rest_ma, source = (told.rest_ma, told.source) if told is not None else resting[0]
    return [one if one.input_rest_ma == rest_ma else _counted(one, rest_ma, source, settings) for one in found]


def _counted(alone: Recording, rest_ma: float, source: str, settings: ReadingSettings) -> Recording:
    """Return a recording with its input counted from elsewhere than it alone tells, and a note on it."""
    note = f"{settings.input}: counted from {rest_ma:g} mA like that of {Path(source).name}"
    if alone.input_rest_ma:
        note += f", and not from {alone.input_rest_ma:g}, as input_rest_ma: {alone.input_rest_ma:g} does"
    read = counted_from(alone, rest_ma)
    return replace(read, notes=(note, *read.notes))


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
