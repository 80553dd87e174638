"""Logs of the bus as recordings: every frame decoded through the DBC file, every signal with times of its own.

The columns are the signals of the vocabulary, and all signals of messages that are not the program's own. Where
several messages hold one signal, the drive's own message counts, else the one that comes most often: the others are
columns `Message.signal`, for whoever asks for them by that name. Of a log of several buses the one counts that has most
of input and output, and the others with what it has not. The input is the measured current; only where a log has none,
the commanded one while it was active.
"""

import math
from array import array
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from cruise.can.decoder import Decoder
from cruise.can.frame import Frame, FrameFault
from cruise.can.log import BrokenLogError, read_log
from cruise.can.messages import FAST_MESSAGE
from cruise.columns import RecordingSettings, arranged, column_of
from cruise.recording import Readings, Recording, RecordingError, listed
from cruise.service.recordings.settings import ReadingSettings
from cruise.signals import INPUT, SIGNALS

COMMAND: Final = ("PumpCurrentCommand", "pump_current_command_ma", "command_active")
PAUSE_S: Final = 5.0  # s; a longer step of time is a clock that was set, or a recorder that was off
BACK_S: Final = 1.0  # s, frames of several controllers may be that much out of order; more is a clock that was set
DIGITS: Final = 6  # of s; seconds since 1970 hold no more
SHOWN: Final = 5  # identifiers or signals in a note

Series = dict[tuple[str, str], Readings]
"""By message and signal."""


@dataclass(slots=True)
class Collected:
    """What the frames of a log say: times and values by bus, message and signal, and what was not taken."""

    times_s: dict[tuple[str, str, str], array] = field(default_factory=lambda: defaultdict(lambda: array("d")))
    values: dict[tuple[str, str, str], array] = field(default_factory=lambda: defaultdict(lambda: array("d")))
    faults: Counter[tuple[str, FrameFault]] = field(default_factory=Counter)
    unknown: Counter[tuple[int, bool]] = field(default_factory=Counter)
    frames: int = 0


def read_bus_log(path: str | Path, settings: ReadingSettings, dt_s: float | None = None) -> Recording:
    """Read a log of the bus onto a uniform grid of `dt_s`; times from the whole second before its first frame.

    Raises LogError for a log that can't be read, SettingsError for a DBC file that can't, RecordingError for the rest.
    """
    if settings.database is None:
        raise RecordingError(f"{path}: a log of the bus needs its database; give the DBC file with --database")
    decoder = Decoder.load(settings.database, settings.can)
    notes = [f"{problem}; read as the database describes it" for problem in decoder.problems]
    collected = collect(frames_of_log(path, notes), decoder)
    notes += _losses(collected)
    if not collected.values:
        raise RecordingError(
            f"{path}: by {settings.database} none of its {collected.frames} frames can be taken; give the machine's "
            f"own database with --database, or its addresses and PGNs under can: in --columns; {'; '.join(notes)}"
        )
    columns = _columns(collected, settings, decoder, notes)
    try:
        return arranged(str(path), columns, settings, dt_s, tuple(notes))
    except RecordingError as error:
        lost = _losses(collected)
        raise RecordingError("; ".join((str(error), *lost))) from error


def collect(frames: Iterable[Frame], decoder: Decoder) -> Collected:
    """Return the readings of all frames, in the order of the frames."""
    collected = Collected()
    times_s, values = collected.times_s, collected.values
    for frame in frames:
        collected.frames += 1
        decoded = decoder.decode(frame)
        if decoded.fault is FrameFault.UNKNOWN:
            collected.unknown[frame.arbitration_id, frame.is_extended_id] += 1
        elif decoded.fault is not None:
            collected.faults[decoded.message or "", decoded.fault] += 1
        channel, message = str(frame.channel), decoded.message or ""
        for reading in decoded.readings:
            place = channel, message, reading.name
            times_s[place].append(reading.time_s)
            values[place].append(reading.value)
    return collected


def frames_of_log(path: str | Path, notes: list[str]) -> Iterator[Frame]:
    """Yield the frames of a log, times from zero; a clock that was set in the middle of it becomes a pause, noted.

    A log that breaks off, as one does when the power goes, ends there, noted too.
    """
    origin_s, last_s = math.nan, 0.0
    try:
        for frame in read_log(path):
            if math.isnan(origin_s):
                origin_s = math.floor(frame.timestamp)  # whole seconds: where a tick fell, it falls again
            step_s = frame.timestamp - origin_s - last_s
            if step_s > PAUSE_S or step_s < -BACK_S:
                notes.append(f"time steps by {step_s:.1f} s at t={last_s:.1f} s; taken as a pause of {PAUSE_S:g} s")
                origin_s += step_s - PAUSE_S
            frame.timestamp -= origin_s
            last_s = max(frame.timestamp, last_s)
            yield frame
    except BrokenLogError as broken:
        notes.append(f"ends broken at t={last_s:.1f} s: {broken.reason}")


def _losses(collected: Collected) -> list[str]:
    said = []
    for (message, fault), count in sorted(collected.faults.items()):
        reason = str(fault).replace("_", " ")
        jumped = fault is FrameFault.COUNTER_JUMPED
        done = "taken though some before them are missing" if jumped else "dropped"
        said.append(f"{message}: {count} frames {done}, {reason}" if message else f"{count} frames: {reason}")
    if collected.unknown:
        ids = [
            f"0x{number:0{8 if extended else 3}X} ({count})"
            for (number, extended), count in collected.unknown.most_common()
        ]
        said.append(
            f"{sum(collected.unknown.values())} frames of identifiers that the database does not describe: {_some(ids)}"
        )
    return said


def _joined(collected: Collected, settings: RecordingSettings, asked: Collection[str], notes: list[str]) -> Series:
    """Return what the bus with most of input and output says, and what the others have beside it."""
    buses: dict[str, Series] = defaultdict(dict)
    for place, values in collected.values.items():
        channel, message, name = place
        time_s = np.round(np.frombuffer(collected.times_s[place]), DIGITS)
        buses[channel][message, name] = Readings(time_s, np.frombuffer(values))
    main = max(buses, key=lambda channel: _of_both(buses[channel], settings))
    joined = dict(buses.pop(main))
    for channel, series in buses.items():
        there = {place for place, readings in joined.items() if _measured(readings)}
        names = {name for _, name in there}
        taken = {
            place: readings
            for place, readings in series.items()
            if place not in there and (place[1] not in names or ".".join(place) in asked)
        }
        joined |= taken
        notes.append(
            f"several buses: input and output are looked for on channel {main} first; of {channel} are taken: "
            f"{_some(list(map('.'.join, taken)))}; left out, there already: "
            f"{_some(['.'.join(place) for place in series if place not in taken])}"
        )
    return joined


def _of_both(series: Series, settings: RecordingSettings) -> tuple[int, int]:
    """Return how many of input and output a bus has, and how many readings of them."""
    counts: Counter[str] = Counter()
    for place, readings in series.items():
        for name in (place[1], ".".join(place)):
            counts[name] = max(counts[name], _measured(readings))
    both = [counts[column_of(name, counts, settings)] for name in (settings.input, settings.output)]
    return sum(count > 0 for count in both), sum(both)


def _measured(readings: Readings) -> int:
    return int(np.isfinite(readings.values).sum())


def _some(names: Sequence[str]) -> str:
    return listed(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")


def _columns(
    collected: Collected, settings: RecordingSettings, decoder: Decoder, notes: list[str]
) -> dict[str, Readings]:
    gate = [settings.active_when.column] if settings.active_when else []
    asked = {settings.input, settings.output, *settings.columns, *gate}
    series = _joined(collected, settings, asked, notes)
    measured = {place: _measured(readings) for place, readings in series.items()}
    columns: dict[str, Readings] = {}
    aside = []
    for name in dict.fromkeys(name for _, name in series):
        places = [place for place in series if place[1] == name]
        best = max(places, key=lambda place: (measured[place] > 0, place[0] == FAST_MESSAGE, measured[place]))
        if name in SIGNALS or name in asked or best[0] not in decoder.ours:
            columns[name] = series[best]
        for place in places:
            qualified = ".".join(place)
            if qualified in asked:
                columns[qualified] = series[place]
            elif place != best:
                aside.append(qualified)
    if aside:
        notes.append(f"second sources of a signal, left out unless named: {_some(aside)}")
    message, command, active = COMMAND
    if settings.input == INPUT and not any(measured[place] for place in series if place[1] == INPUT):
        flags, commands = series.get((message, active)), series.get((message, command))
        if flags is not None and commands is not None:
            notes.append(f"no measured current in the log: {command} is the input, while it was active")
            columns[INPUT] = Readings(commands.time_s, np.where(flags.values == 1.0, commands.values, np.nan))
    return columns
