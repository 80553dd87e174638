"""Measurements in MDF 4 files (ASAM): one channel a signal, each with times of its own.

asammdf reads them; it is an extra, because it brings pandas, and a machine that drives has no use for either. Values
are physical ones, after the file's own conversions; a channel that spells out states as text gives their numbers.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cruise.columns import RecordingSettings, arranged
from cruise.recording import Readings, Recording, RecordingError
from cruise.signals import SIGNALS

if TYPE_CHECKING:
    from asammdf import MDF, Signal

INSTALL: Final = "install it: pip install asammdf, or this project with its extra [mdf]"
FURTHER_CHANNELS: Final = 200  # more that nobody named are not read: an hour of each at 20 Hz takes 0.6 MB
BUS_EVENT: Final = 2  # flag of a channel group that holds frames (ASAM MDF 4.1, cg_flags bit 1)


def has_channels(path: str | Path, settings: RecordingSettings) -> bool:
    """Return whether input and output, as the settings name them, are channels of the file, or it holds no frames."""
    with _opened(path) as file:
        names, renamed = _channels(file), {one.signal for one in settings.columns.values()}
        frames = any(_holds_frames(group) for group in file.groups)
        return not frames or all(name in names or name in renamed for name in (settings.input, settings.output))


def channels_of(path: str | Path) -> list[str]:
    """The names of the file's channels, none for a log of the bus. Raises RecordingError."""
    with _opened(path) as file:
        return list(_channels(file))


def read_measurement(path: str | Path, settings: RecordingSettings, dt_s: float | None = None) -> Recording:
    """Read the channels of an MDF file onto a uniform grid of `dt_s`; times as in the file, from its start.

    Raises RecordingError with file, channel and what to do.
    """
    notes: list[str] = []
    columns: dict[str, Readings] = {}
    with _opened(path) as file:
        channels = _channels(file)
        gate = [settings.active_when.column] if settings.active_when else []
        named = {settings.input, settings.output, *settings.columns, *gate, *SIGNALS}
        further = [name for name in channels if name not in named]
        if len(further) > FURTHER_CHANNELS:
            notes.append(
                f"{len(further)} channels that nobody named are left out, such as {', '.join(further[:3])}; "
                "name in columns those that may matter"
            )
            channels = {name: where for name, where in channels.items() if name in named}
        places = [(name, *place) for name, found in channels.items() for place in found]
        signals = file.select(places, ignore_value2text_conversions=True, validate=True, copy_master=False)
    for name, found in channels.items():
        read, signals = signals[: len(found)], signals[len(found) :]
        best = max((_readings(signal) for signal in read), key=lambda one: len(one.values))
        if not len(best.values):
            notes.append(f"{name}: holds no numbers, left out")
            continue
        if len(found) > 1:
            notes.append(f"{name}: in {len(found)} groups of the file, taken where it has most readings")
        columns[name] = best
    return arranged(str(path), columns, settings, dt_s, tuple(notes))


@contextmanager
def _opened(path: str | Path) -> Iterator["MDF"]:
    try:
        from asammdf import MDF
        from asammdf.blocks.utils import MdfException
    except ImportError as error:
        raise RecordingError(f"{path}: MDF files need asammdf; {INSTALL}") from error
    if not Path(path).is_file():
        raise RecordingError(f"{path}: no such file")
    try:
        with MDF(path) as file:
            yield file
    except RecordingError:
        raise
    except (MdfException, ValueError, LookupError, TypeError, OSError, EOFError) as error:
        raise RecordingError(f"{path}: cannot be read: {error}; is it an MDF file?") from error


def _channels(file: "MDF") -> dict[str, list[tuple[int, int]]]:
    """Return every channel that is neither a time nor part of a frame, with its places: group and index."""
    found: dict[str, list[tuple[int, int]]] = {}
    for number, group in enumerate(file.groups):
        if _holds_frames(group):
            continue
        for index, channel in enumerate(group.channels):
            if index != file.masters_db.get(number):
                found.setdefault(channel.name, []).append((number, index))
    return found


def _holds_frames(group: Any) -> bool:
    return bool(getattr(group.channel_group, "flags", 0) & BUS_EVENT)


def _readings(signal: "Signal") -> Readings:
    """Return the channel's readings; none where it doesn't hold one number a time."""
    values, time_s = signal.samples, signal.timestamps
    if values.dtype.kind not in "biuf" or values.ndim != 1:
        return Readings(np.zeros(0), np.zeros(0))
    values = values.astype(float)
    values[~np.isfinite(values)] = np.nan
    return Readings(time_s, values)
