"""Recordings: measured signals on one uniform time grid, from readings that may jitter and have gaps.

Reading puts them on the grid t_0 + k T. Where the grid is coarser than the data, a sample is the mean over one period,
taken by the very class that takes them online (`sampling.Stream`); else it is the straight line between two readings,
or the last value of a held signal. NaN means "not measured", and what was lost or mended is in the recording's notes,
in words.

A table has a time column and one column a signal. Where every signal comes at times of its own, as on a bus, `arranged`
follows the same rules.
"""

import difflib
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt

from cruise.grid import SAME_STEP, between, sensible_step, snapped, typical_step
from cruise.sampling import FloatArray, Kind, kind_of, means, stale_after
from cruise.signals import INPUT, OUTPUT, SIGNALS

TIME: Final = "time_s"
MIN_SAMPLES: Final = 10  # fewer cannot hold even the shortest model's past and a 3 s horizon at 5 Hz
MAX_SAMPLES: Final = 5_000_000  # 14 h at 100 Hz, 40 MB a signal
COARSER: Final = 1.2  # grid step over data step from which samples are means; below it nothing much can alias
EARLY: Final = 0.1  # of a grid step: a held value stamped this little late is taken as in time; DART jitters by 0.095
MAX_STEP_S: Final = 3.0  # no prediction that is judged 3 s ahead can be made from rarer readings
MAX_GAP_NOTES: Final = 5
FULL_MA: Final = 1000.0  # mA, what an input that is a share of all is taken to be of
SHARES: Final = ((1.5, "a share of all", FULL_MA), (150.0, "per cent", 0.01 * FULL_MA))
"""The largest input that is none in mA, what it is, and mA per unit of it: no pump's servo moves below 150 mA."""


class RecordingError(ValueError):
    """A recording that cannot be used; the message names file, line or column, and what to do."""


class ColumnSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What one column of a file means: signal value = scale * cell + offset."""

    signal: str | None = None  # the signal's name in this project; default: the column's own name
    scale: float = 1.0  # in the signal's unit per unit of the cell, e.g. 0.001 for mm/s, 0.277778 for km/h
    offset: float = 0.0  # in the signal's unit


class ActiveWhen(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The input acts only while the cell of `column` is above `above` (both in the file's unit), and is 0 otherwise."""

    column: str
    above: float = 0.5  # the middle of a 0/1 flag


class RecordingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which columns of a file are what; names are the file's own, or what `columns` calls them."""

    time: str = TIME  # of tables; logs and measurements have stamps of their own
    input: str = INPUT
    output: str = OUTPUT
    columns: dict[str, ColumnSettings] = {}
    active_when: ActiveWhen | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """One column as it was measured: `time_s` (N,), `values` (N,), NaN for not measured."""

    time_s: FloatArray
    values: FloatArray


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals on a uniform grid: `time_s` (N,) with step `dt_s`, `columns` name to values (N,), NaN for not measured.

    A sample is the reading at its time, or where `averaged` the mean over the period that ends there.
    `source` says where it comes from, `notes` what was lost or mended, `stamps_s` (M,) the time stamps as they were
    before the grid, where known. The arrays are read-only. Raises RecordingError for a grid that is not uniform,
    columns of another length, or no input or output.
    """

    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    dt_s: float
    source: str
    notes: tuple[str, ...] = ()
    stamps_s: FloatArray | None = None
    averaged: bool = False

    def __post_init__(self) -> None:
        for name in (INPUT, OUTPUT):
            if name not in self.columns:
                raise RecordingError(f"{self.source}: no signal {name}; it has {listed(self.columns)}")
        for name, values in self.columns.items():
            if np.shape(values) != np.shape(self.time_s) or np.ndim(values) != 1:
                raise RecordingError(
                    f"{self.source}: {name} has shape {np.shape(values)}, time_s has {np.shape(self.time_s)}"
                )
        steps = np.diff(self.time_s)
        if not self.dt_s > 0.0 or not np.allclose(steps, self.dt_s, rtol=SAME_STEP, atol=2e-6):  # atol: epoch stamps
            raise RecordingError(f"{self.source}: time_s does not rise in steps of {self.dt_s} s")
        object.__setattr__(self, "time_s", _read_only(self.time_s))
        object.__setattr__(self, "columns", {name: _read_only(values) for name, values in self.columns.items()})
        if self.stamps_s is not None:
            object.__setattr__(self, "stamps_s", _read_only(self.stamps_s))

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, samples: slice) -> "Recording":
        """Return the part `start:stop` of the recording."""
        if samples.step not in (None, 1):
            raise RecordingError(f"{self.source}: a part has to keep every sample; use resample for a coarser grid")
        columns = {name: values[samples] for name, values in self.columns.items()}
        return replace(self, time_s=self.time_s[samples], columns=columns, stamps_s=None)

    @property
    def since_s(self) -> FloatArray:
        """From when on every sample (N,) counts: a current is held from its reading, a mean is that of the past."""
        return self.time_s - self.dt_s if self.averaged else self.time_s

    @property
    def input(self) -> FloatArray:
        """The pump current in mA (N,), or what was chosen as input."""
        return self.columns[INPUT]

    @property
    def output(self) -> FloatArray:
        """The ground speed in m/s (N,), or what was chosen as output."""
        return self.columns[OUTPUT]

    def context(self) -> dict[str, FloatArray]:
        """Return the further columns that are signals of this project, by name."""
        return {name: self.columns[name] for name in SIGNALS if name in self.columns and name not in (INPUT, OUTPUT)}


def tabulated(
    source: str,
    raw: Mapping[str, FloatArray],
    settings: RecordingSettings,
    dt_s: float | None,
    place: Callable[[int], str],
    header: str,
    notes: tuple[str, ...] = (),
) -> Recording:
    """Return the recording that a table is: `raw` column to cells (N,), NaN where a cell holds no number.

    `place` names a row (from 0), `header` where the columns have their names, for the RecordingError of a table that
    can't be used.
    """
    time, current, speed = _roles(header, raw, settings, (settings.time, settings.input, settings.output))
    said = list(notes)
    time_s = _scaled(raw[time], settings.columns.get(time))
    keep = _usable_rows(source, time_s, place, said)
    time_s = time_s[keep]
    columns = {name: Readings(time_s, values[keep]) for name, values in raw.items() if name != time}
    signals = _signals(source, columns, current, speed, settings, said, ("rows", "cells hold no number, not measured"))
    if current not in settings.columns:
        signals[INPUT] = _in_ma(current, signals[INPUT], said)
    return _on_grid(time_s, signals, dt_s, source, tuple(said))


def arranged(
    source: str,
    columns: Mapping[str, Readings],
    settings: RecordingSettings,
    dt_s: float | None,
    notes: tuple[str, ...] = (),
) -> Recording:
    """Return the recording that columns with times of their own are under `settings`, on a grid of `dt_s`.

    The grid follows the readings of the slower one of input and output; their step is the default of `dt_s`. Raises
    RecordingError for columns that are missing, named twice or empty, and for times that give no grid.
    """
    current, speed = _roles(source, columns, settings, (settings.input, settings.output))
    said = list(notes)
    columns = {name: _rising(name, readings, said) for name, readings in columns.items()}
    signals = _signals(source, columns, current, speed, settings, said, ("readings", "values are no measurement"))
    measured = {name: signals[name].time_s[~np.isnan(signals[name].values)] for name in (INPUT, OUTPUT)}
    few = min(measured, key=lambda name: len(measured[name]))
    if len(measured[few]) < MIN_SAMPLES:
        raise RecordingError(
            f"{source}: {few} has {len(measured[few])} readings, too few; a recording needs {MIN_SAMPLES} at least"
        )
    return _on_grid(max(measured.values(), key=typical_step), signals, dt_s, source, tuple(said))


def _rising(name: str, readings: Readings, notes: list[str]) -> Readings:
    """Return the readings that are newer than all before them; of those with one time the last one holds."""
    time_s = readings.time_s
    if np.all(np.diff(time_s) > 0.0):
        return readings
    newest_s = np.fmax.accumulate(time_s) if len(time_s) else time_s
    kept = np.flatnonzero(time_s >= newest_s)  # false for a time that is no number
    kept = kept[np.append(np.diff(time_s[kept]) > 0.0, True)[: len(kept)]]
    notes.append(f"{name}: {len(time_s) - len(kept)} of {len(time_s)} readings out of order or repeated, left out")
    return Readings(time_s[kept], readings.values[kept])


def _roles(where: str, names: Collection[str], settings: RecordingSettings, wanted: tuple[str, ...]) -> tuple[str, ...]:
    """Return the columns that are (time,) input and output, each named by itself or by the mapping."""
    roles = ("time", "input", "output")[-len(wanted) :]
    found = [column_of(name, names, settings) for name in wanted]
    for role, name in zip(roles, found, strict=True):
        _require(role, name, where, names)
    if len(set(found)) < len(found):
        raise RecordingError(f"{where}: one column cannot be both input and output, or time; choose three")
    for role, others in (("columns", settings.columns), ("active_when", _gate_columns(settings))):
        for name in others:
            _require(role, name, where, names)
    return tuple(found)


def _signals(
    source: str,
    columns: Mapping[str, Readings],
    current: str,
    speed: str,
    settings: RecordingSettings,
    notes: list[str],
    words: tuple[str, str],
) -> dict[str, Readings]:
    """Return the columns under the names and in the units of this project, the input gated."""
    of_what, not_measured = words
    signals: dict[str, Readings] = {}
    for name, readings in columns.items():
        signal = INPUT if name == current else OUTPUT if name == speed else _signal_of(name, settings)
        if signal in signals:
            raise RecordingError(
                f"{source}: two columns would be {signal}; one of them is {name!r}; rename one in columns"
            )
        missing, count = int(np.isnan(readings.values).sum()), len(readings.values)
        if missing == count and name not in (current, speed):
            notes.append(f"{name}: holds no number, left out")
            continue
        if missing:
            notes.append(f"{name}: {missing} of {count} {not_measured}")
        signals[signal] = Readings(readings.time_s, _scaled(readings.values, settings.columns.get(name)))
    if settings.active_when is not None:
        gate = settings.active_when
        signals[INPUT], off = _gated(signals[INPUT], columns[gate.column], gate.above)
        all_of_it = f"{len(signals[INPUT].values)} {of_what}"
        notes.append(f"input set to 0 in {off} of {all_of_it}: {gate.column} is not above {gate.above:g}")
    for name in (INPUT, OUTPUT):
        notes.extend(_gap_notes(name, signals[name].time_s[~np.isnan(signals[name].values)]))
    return signals


def _in_ma(name: str, current: Readings, notes: list[str]) -> Readings:
    """Return an input too small for a pump's current as a share of FULL_MA; where its name says mA, say so only."""
    known = np.abs(current.values[~np.isnan(current.values)])
    most = float(np.percentile(known, 99)) if len(known) else 0.0
    unit, scale = next(((unit, scale) for most_of, unit, scale in SHARES if 0.0 < most <= most_of), ("", 1.0))
    if not unit:
        return current
    small, in_file = f"{name}: {most:.3g} at most, no current in mA moves a machine", "in the file of --columns"
    if name == INPUT:
        notes.append(f"{small}; if it is {unit}, columns: {{{name}: {{scale: {scale:g}}}}} {in_file} reads it so")
        return current
    notes.append(
        f"{small}; read as {unit}, all of it as {FULL_MA:g} mA; "
        f"columns: {{{name}: {{scale: 1}}}} {in_file} takes it as it is"
    )
    return Readings(current.time_s, scale * current.values)


def resample(recording: Recording, dt_s: float) -> Recording:
    """Return `recording` on a grid of `dt_s`, by the same rules as a file is read with; means are held over theirs."""
    columns = {name: Readings(recording.since_s, values) for name, values in recording.columns.items()}
    resampled = _on_grid(recording.since_s, columns, dt_s, recording.source, recording.notes, held=recording.averaged)
    return replace(resampled, stamps_s=recording.stamps_s)


def notes_of(recordings: Sequence[Recording]) -> list[str]:
    """Return what was lost or mended in the recordings, under the names of their files."""
    return [f"{Path(one.source).name}: {note}" for one in recordings for note in one.notes]


def column_of(name: str, names: Collection[str], settings: RecordingSettings) -> str:
    """Return the column that has this name in the file, else the one that the mapping gives it, else the name."""
    mapped = (column for column, one in settings.columns.items() if one.signal == name and column in names)
    return name if name in names else next(mapped, name)


def _require(role: str, name: str, where: str, names: Collection[str]) -> None:
    if name in names:
        return
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    in_file = "in the file of --columns"
    if role in ("input", "output"):
        remedy = f"choose with --{role} NAME, or {role}: NAME {in_file}"
    else:
        remedy = f"choose with {role}: NAME {in_file}" if role == "time" else f"correct it {in_file}"
    raise RecordingError(f"{where}: no column {name!r} for {role}; {hint}it has {listed(names)}; {remedy}")


def _gate_columns(settings: RecordingSettings) -> list[str]:
    return [settings.active_when.column] if settings.active_when else []


def _signal_of(column: str, settings: RecordingSettings) -> str:
    """Return the name that a column gets in the recording, where it is neither time nor input nor output."""
    chosen = settings.columns.get(column, ColumnSettings()).signal
    name = column if chosen is None else chosen
    roles = {TIME: settings.time, INPUT: settings.input, OUTPUT: settings.output}
    # What has the name of the input or output but was not chosen as such stays, under another name.
    return f"recorded_{name}" if name in roles and (chosen is None or roles[name] != name) else name


def _scaled(values: FloatArray, settings: ColumnSettings | None) -> FloatArray:
    return values if settings is None else settings.scale * values + settings.offset


def _usable_rows(
    source: str, time_s: FloatArray, place: Callable[[int], str], notes: list[str]
) -> npt.NDArray[np.intp]:
    """Return the indices of the rows that have a time of their own; raise where time runs backwards."""
    timed = np.flatnonzero(~np.isnan(time_s))
    if len(time_s) and not len(timed):
        raise RecordingError(
            f"{place(0)}: no row has a time; let the time column hold seconds, or stamps such as 2026-08-01T09:00:00.05"
        )
    if len(timed) < len(time_s):
        notes.append(f"{len(time_s) - len(timed)} rows have no time, left out")
    steps = np.diff(time_s[timed])
    if np.any(steps < 0.0):
        at = int(np.argmax(steps < 0.0))
        before, after = time_s[timed[at]], time_s[timed[at + 1]]
        raise RecordingError(
            f"{place(int(timed[at + 1]))}: time runs backwards, from {before:.10g} s to {after:.10g} s; "
            "split the file there: each part is a recording of its own"
        )
    kept = timed[np.append(steps > 0.0, True)[: len(timed)]]  # of rows with one time, the last one holds
    if len(kept) < len(timed):
        notes.append(f"{len(timed) - len(kept)} rows repeat the time of the next one, left out")
    if len(kept) < MIN_SAMPLES:
        raise RecordingError(f"{source}: {len(kept)} usable rows are too few; a recording needs {MIN_SAMPLES} at least")
    step_s = typical_step(time_s[kept])
    if step_s > MAX_STEP_S:
        raise RecordingError(
            f"{source}: one row every {step_s:.4g} s is too few to see a drive move; times in ms get a scale in the "
            "file of --columns, under the column's own name: columns: {time_s: {scale: 0.001}}"
        )
    return kept


def _gated(current: Readings, flag: Readings, above: float) -> tuple[Readings, int]:
    """Return the input, 0 where the flag's last reading is not above its limit and not measured where there is none.

    Beside it how often it is 0 for that.
    """
    last = np.searchsorted(flag.time_s, current.time_s, side="right") - 1
    flags = np.where(last >= 0, flag.values[np.maximum(last, 0)], np.nan)
    off = flags <= above
    values = np.where(np.isnan(flags), np.nan, np.where(off, 0.0, current.values))
    return Readings(current.time_s, values), int(off.sum())


def _on_grid(
    base_s: FloatArray,
    columns: Mapping[str, Readings],
    dt_s: float | None,
    source: str,
    notes: tuple[str, ...],
    *,
    held: bool = False,
) -> Recording:
    if dt_s is not None and not 0.0 < dt_s < math.inf:
        raise RecordingError(f"{source}: a sampling period of {dt_s} s is impossible; give one above 0, such as 0.05")
    data_step_s = typical_step(base_s)
    dt_s = dt_s or sensible_step(base_s, data_step_s)
    averaged = dt_s > COARSER * data_step_s
    start_s, end_s = float(base_s[0]), float(base_s[-1])
    count = math.floor((end_s - start_s) / dt_s + SAME_STEP) + 1
    if count > MAX_SAMPLES:
        at = int(np.argmax(np.diff(base_s)))
        raise RecordingError(
            f"{source}: from {start_s:.10g} s to {end_s:.10g} s are {count} samples of {dt_s:g} s, too many; "
            f"the longest step is at {base_s[at]:.10g} s; correct the time stamps or choose a longer period"
        )
    if count < MIN_SAMPLES:
        raise RecordingError(f"{source}: {count} samples of {dt_s:g} s are too few; choose a shorter period")
    grid_s = start_s + dt_s * np.arange(count)
    grid_s = grid_s[int(averaged) :]  # the first mean ends one period after the first reading

    gridded: dict[str, FloatArray] = {}
    for name, readings in columns.items():
        measured = ~np.isnan(readings.values)
        if not measured.any():
            if name in (INPUT, OUTPUT):
                raise RecordingError(
                    f"{source}: {name} holds no number at all; choose another column as input or output"
                )
            gridded[name] = np.full(len(grid_s), np.nan)
            continue
        times, known = snapped(readings.time_s[measured], start_s, dt_s), readings.values[measured]
        step_s, kind = typical_step(times), Kind.HELD if held else kind_of(name)
        if averaged:
            gridded[name] = means(times, known, grid_s, dt_s, kind, stale_after(step_s))
        elif dt_s > COARSER * step_s and kind is not Kind.STATE:
            # Faster than input and output, which are taken at the instant: a mean around it, or they don't align.
            gridded[name] = means(times, known, grid_s + 0.5 * dt_s, dt_s, kind, stale_after(step_s))
        else:
            gridded[name] = between(times, known, grid_s, EARLY * dt_s, kind, stale_after(step_s))
    return Recording(grid_s, gridded, dt_s, source, notes, base_s, averaged)


def _gap_notes(name: str, time_s: FloatArray) -> list[str]:
    steps = np.diff(time_s)
    gaps = np.flatnonzero(steps > stale_after(typical_step(time_s)))
    notes = [f"{name}: gap of {steps[at]:.3g} s at t={time_s[at]:.10g} s" for at in gaps[:MAX_GAP_NOTES]]
    return notes + [f"{name}: {len(gaps) - MAX_GAP_NOTES} gaps more"] * (len(gaps) > MAX_GAP_NOTES)


def _read_only(values: Any) -> FloatArray:
    view = np.asarray(values, dtype=float).view()
    view.flags.writeable = False
    return view


def listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
