"""Recordings: measured signals on one uniform time grid, read from and written to CSV files.

A CSV file has one header line, a time column and one column a signal. Its times may jitter and have gaps; reading puts
them on the grid t_0 + k T. Where the grid is coarser than the data, a sample is the mean over one period, taken by the
very class that takes them online (`sampling.Stream`); else it is the straight line between two readings, or the last
value of a held signal. NaN means "not measured", and what was lost or mended is in the recording's notes, in words.
"""

import csv
import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt

from cruise.sampling import FloatArray, Kind, kind_of, means, stale_after
from cruise.signals import INPUT, OUTPUT, SIGNALS

TIME: Final = "time_s"
MIN_SAMPLES: Final = 10  # fewer cannot hold even the shortest model's past and a 3 s horizon at 5 Hz
MAX_SAMPLES: Final = 5_000_000  # 14 h at 100 Hz, 40 MB a signal
COARSER: Final = 1.2  # grid step over data step from which samples are means; below it nothing much can alias
SAME_STEP: Final = 1e-3  # relative; steps that differ less are one step, written with few digits
ROUNDING: Final = 1e-6  # of a grid step; what number formats do to time stamps over a whole file
NEAR_STEP: Final = 0.02  # relative; a clock and jitter of this size hide the rate that was meant
EARLY: Final = 0.1  # of a grid step: a held value stamped this little late is taken as in time; DART jitters by 0.095
MAX_GAP_NOTES: Final = 5


class RecordingError(ValueError):
    """A recording that cannot be used; the message names file, line or column, and what to do."""


class ColumnSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What one column of a file means: signal value = scale * cell + offset."""

    signal: str | None = None  # the signal's name in this project; default: the column's own name
    scale: float = 1.0  # in the signal's unit per unit of the cell, e.g. 0.001 for mm/s
    offset: float = 0.0  # in the signal's unit


class ActiveWhen(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The input acts only while the cell of `column` is above `above` (both in the file's unit), and is 0 otherwise."""

    column: str
    above: float = 0.5  # the middle of a 0/1 flag


class RecordingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which columns of a CSV file are what; names are those of the header line."""

    time: str = TIME
    input: str = INPUT
    output: str = OUTPUT
    columns: dict[str, ColumnSettings] = {}
    active_when: ActiveWhen | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals on a uniform grid: `time_s` (N,) with step `dt_s`, `columns` name to values (N,), NaN for not measured.

    `source` says where it comes from, `notes` what was lost or mended. The arrays are read-only. Raises RecordingError
    for a grid that is not uniform, columns of another length, or no input or output.
    """

    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    dt_s: float
    source: str
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in (INPUT, OUTPUT):
            if name not in self.columns:
                raise RecordingError(f"{self.source}: no signal {name}; it has {_listed(self.columns)}")
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

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, samples: slice) -> "Recording":
        """Return the part `start:stop` of the recording."""
        if samples.step not in (None, 1):
            raise RecordingError(f"{self.source}: a part has to keep every sample; use resample for a coarser grid")
        columns = {name: values[samples] for name, values in self.columns.items()}
        return Recording(self.time_s[samples], columns, self.dt_s, self.source, self.notes)

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


def read_csv(path: str | Path, settings: RecordingSettings, dt_s: float | None = None) -> Recording:
    """Read a CSV file onto a uniform grid of `dt_s` (default: the file's own step, rounded to a sensible number).

    Raises RecordingError with file, line or column and what to do.
    """
    if dt_s is not None and not 0.0 < dt_s < math.inf:
        raise RecordingError(f"{path}: a sampling period of {dt_s} s is impossible; give one above 0, such as 0.05")
    header, rows = _read_rows(path)
    notes: list[str] = []
    for role, name in (("time", settings.time), ("input", settings.input), ("output", settings.output)):
        _require(path, header, role, name)
    if len({settings.time, settings.input, settings.output}) < 3:
        raise RecordingError(f"{path}: one column cannot be both input and output, or time; choose three")
    for role, names in (("columns", settings.columns), ("active_when", _gate_columns(settings))):
        for name in names:
            _require(path, header, role, name)

    cells = {name: [row[index] for _, row in rows] for index, name in enumerate(header)}
    raw = {name: _numbers(texts) for name, texts in cells.items()}
    time_s = _scaled(raw[settings.time], settings.columns.get(settings.time))
    keep = _usable_rows(path, time_s, [line for line, _ in rows], notes)

    columns: dict[str, FloatArray] = {}
    for name, values in raw.items():
        if name == settings.time:
            continue
        signal = _signal_of(name, settings)
        if signal in columns:
            raise RecordingError(
                f"{path}: two columns would be {signal}; one of them is {name!r}; rename one in columns"
            )
        missing = int(np.isnan(values[keep]).sum())
        if missing == len(keep) and name not in (settings.input, settings.output):
            notes.append(f"{name}: holds no number, left out")
            continue
        if missing:
            notes.append(f"{name}: {missing} of {len(keep)} cells hold no number, not measured")
        columns[signal] = _scaled(values, settings.columns.get(name))[keep]
    if settings.active_when is not None:
        _gate(columns, raw[settings.active_when.column][keep], settings.active_when, notes)
    time_s = time_s[keep]
    for signal in (INPUT, OUTPUT):
        notes.extend(_gap_notes(signal, time_s[~np.isnan(columns[signal])]))
    return _on_grid(time_s, columns, dt_s, str(path), tuple(notes))


def resample(recording: Recording, dt_s: float) -> Recording:
    """Return `recording` on a grid of `dt_s`, by the same rules as a file is read with."""
    return _on_grid(recording.time_s, recording.columns, dt_s, recording.source, recording.notes)


def write_csv(recording: Recording, path: str | Path) -> None:
    """Write a recording as CSV, in full precision; a value that was not measured is an empty cell."""
    names = list(recording.columns)
    table = np.column_stack([recording.time_s, *(recording.columns[name] for name in names)]).tolist()
    with Path(path).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([TIME, *names])
        writer.writerows([["" if value != value else value for value in row] for row in table])


def _read_rows(path: str | Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header and the rows with their line numbers, each as long as the header."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise RecordingError(f"{path}: no such file") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not UTF-8 text at byte {error.start}; is it a CSV file?") from error
    first = text.partition("\n")[0]
    reader = csv.reader(text.splitlines(), delimiter=max(",;\t", key=first.count), skipinitialspace=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        header = [name.strip() for name in next(reader, [])]
        for row in reader:
            if len(row) > len(header):
                raise RecordingError(
                    f"{path}:{reader.line_num}: {len(row)} cells, but the header names {len(header)} columns"
                )
            if any(row):
                rows.append((reader.line_num, row + [""] * (len(header) - len(row))))
    except csv.Error as error:
        raise RecordingError(f"{path}:{reader.line_num}: {error}; is it a CSV file?") from error
    if not any(header) or all(not math.isnan(_number(name)) for name in header):
        raise RecordingError(f"{path}:1: no header line; the first line has to name the columns")
    twice = {name for name in header if header.count(name) > 1}
    if twice:
        raise RecordingError(f"{path}:1: several columns are named {_listed(sorted(twice))}; rename them")
    return header, rows


def _require(path: str | Path, header: list[str], role: str, name: str) -> None:
    if name in header:
        return
    near = difflib.get_close_matches(name, header, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    choose = f"--{role} NAME, or {role}: in the settings" if role in ("input", "output") else f"{role}: in the settings"
    raise RecordingError(
        f"{path}:1: no column {name!r} for {role}; {hint}it has {_listed(header)}; choose with {choose}"
    )


def _gate_columns(settings: RecordingSettings) -> list[str]:
    return [settings.active_when.column] if settings.active_when else []


def _signal_of(column: str, settings: RecordingSettings) -> str:
    """Return the name that a column gets in the recording."""
    if column == settings.input:
        return INPUT
    if column == settings.output:
        return OUTPUT
    chosen = settings.columns.get(column, ColumnSettings()).signal
    if chosen is not None:
        return chosen
    # a column that has the name of the input or output but was not chosen as such stays, under another name
    return f"recorded_{column}" if column in (INPUT, OUTPUT, TIME) else column


def _numbers(texts: list[str]) -> FloatArray:
    try:
        values = np.array(texts, dtype=float)
    except ValueError:  # some cell is empty or text: the slow way
        values = np.array([_number(text) for text in texts])
    return np.where(np.isfinite(values), values, np.nan)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _scaled(values: FloatArray, settings: ColumnSettings | None) -> FloatArray:
    return values if settings is None else settings.scale * values + settings.offset


def _usable_rows(path: str | Path, time_s: FloatArray, lines: list[int], notes: list[str]) -> npt.NDArray[np.intp]:
    """Return the indices of the rows that have a time of their own; raise where time runs backwards."""
    timed = np.flatnonzero(~np.isnan(time_s))
    if len(timed) < len(time_s):
        notes.append(f"{len(time_s) - len(timed)} rows have no time, left out")
    steps = np.diff(time_s[timed])
    if np.any(steps < 0.0):
        at = int(np.argmax(steps < 0.0))
        before, after = time_s[timed[at]], time_s[timed[at + 1]]
        raise RecordingError(
            f"{path}:{lines[timed[at + 1]]}: time runs backwards, from {before:.10g} s to {after:.10g} s; "
            "split the file there: each part is a recording of its own"
        )
    kept = timed[np.append(steps > 0.0, True)[: len(timed)]]  # of rows with one time, the last one holds
    if len(kept) < len(timed):
        notes.append(f"{len(timed) - len(kept)} rows repeat the time of the next one, left out")
    if len(kept) < MIN_SAMPLES:
        raise RecordingError(f"{path}: {len(kept)} usable rows are too few; a recording needs {MIN_SAMPLES} at least")
    return kept


def _gate(columns: dict[str, FloatArray], flag: FloatArray, gate: ActiveWhen, notes: list[str]) -> None:
    off = flag <= gate.above
    notes.append(f"input set to 0 in {int(off.sum())} of {len(off)} rows: {gate.column} is not above {gate.above:g}")
    columns[INPUT] = np.where(np.isnan(flag), np.nan, np.where(off, 0.0, columns[INPUT]))


def _on_grid(
    time_s: FloatArray, columns: Mapping[str, FloatArray], dt_s: float | None, source: str, notes: tuple[str, ...]
) -> Recording:
    data_step_s = _typical_step(time_s)
    dt_s = dt_s or _sensible_step(time_s, data_step_s)
    averaged = dt_s > COARSER * data_step_s
    count = math.floor((time_s[-1] - time_s[0]) / dt_s + SAME_STEP) + 1
    if count > MAX_SAMPLES:
        at = int(np.argmax(np.diff(time_s)))
        raise RecordingError(
            f"{source}: from {time_s[0]:.10g} s to {time_s[-1]:.10g} s are {count} samples of {dt_s:g} s, too many; "
            f"the longest step is at {time_s[at]:.10g} s; correct the time stamps or choose a longer period"
        )
    if count < MIN_SAMPLES:
        raise RecordingError(f"{source}: {count} samples of {dt_s:g} s are too few; choose a shorter period")
    grid_s = time_s[0] + dt_s * np.arange(count)
    nearest_s = time_s[0] + dt_s * np.rint((time_s - time_s[0]) / dt_s)
    rounding_s = ROUNDING * dt_s + 4.0 * np.spacing(np.max(np.abs(time_s)))
    time_s = np.where(np.abs(time_s - nearest_s) <= rounding_s, nearest_s, time_s)  # on the grid, not just before it
    grid_s = grid_s[int(averaged) :]  # the first mean ends one period after the first reading

    gridded: dict[str, FloatArray] = {}
    for name, values in columns.items():
        measured = ~np.isnan(values)
        if not measured.any():
            if name in (INPUT, OUTPUT):
                raise RecordingError(
                    f"{source}: {name} holds no number at all; choose another column as input or output"
                )
            gridded[name] = np.full(len(grid_s), np.nan)
            continue
        times, known = time_s[measured], values[measured]
        stale_s = stale_after(_typical_step(times))
        if averaged:
            gridded[name] = means(times, known, grid_s, dt_s, kind_of(name), stale_s)
        else:
            gridded[name] = _between(times, known, grid_s, EARLY * dt_s, kind_of(name), stale_s)
    return Recording(grid_s, gridded, dt_s, source, notes)


def _between(
    time_s: FloatArray, values: FloatArray, grid_s: FloatArray, early_s: float, kind: Kind, stale_s: float
) -> FloatArray:
    """Return the values (M,) at `grid_s` of one signal measured at `time_s` (N,): linear or held, NaN in gaps."""
    early_s = 0.0 if kind is Kind.CONTINUOUS else early_s
    index = np.searchsorted(time_s, grid_s + early_s, side="right") - 1
    last, follower = np.maximum(index, 0), np.minimum(index + 1, len(time_s) - 1)
    age_s, span_s = grid_s - time_s[last], time_s[follower] - time_s[last]
    if kind is Kind.CONTINUOUS:
        rise = (values[follower] - values[last]) * age_s / np.where(span_s > 0.0, span_s, 1.0)
        in_gap = (span_s > stale_s) & (age_s > 0.0)
        result = values[last] + rise
    else:
        in_gap = np.zeros(len(grid_s), dtype=bool)
        result = values[last]
    return np.where(in_gap | (index < 0) | (age_s > stale_s), np.nan, result)


def _typical_step(time_s: FloatArray) -> float:
    """Return the mean step in s without gaps: unlike the median it sees through time stamps of few digits."""
    steps = np.diff(time_s)
    return float(np.mean(steps[steps <= 1.5 * np.median(steps)])) if len(steps) else 0.0


def _sensible_step(time_s: FloatArray, step_s: float) -> float:
    """Return `step_s` where all steps equal it, else one digit of it or a whole number of Hz where that is near."""
    if np.all(np.abs(np.diff(time_s) - step_s) <= SAME_STEP * step_s):
        shorter = (float(f"{step_s:.{digits}g}") for digits in (3, 6, 9, 12))
        drift_free = 0.5 * ROUNDING * step_s / len(time_s)
        return next((short_s for short_s in shorter if abs(short_s - step_s) <= drift_free), step_s)
    for round_s in (float(f"{step_s:.1g}"), 1.0 / max(round(1.0 / step_s), 1)):
        if abs(round_s - step_s) <= NEAR_STEP * step_s:
            return round_s
    return float(f"{step_s:.2g}")


def _gap_notes(name: str, time_s: FloatArray) -> list[str]:
    steps = np.diff(time_s)
    gaps = np.flatnonzero(steps > stale_after(_typical_step(time_s)))
    notes = [f"{name}: gap of {steps[at]:.3g} s at t={time_s[at]:.10g} s" for at in gaps[:MAX_GAP_NOTES]]
    return notes + [f"{name}: {len(gaps) - MAX_GAP_NOTES} gaps more"] * (len(gaps) > MAX_GAP_NOTES)


def _read_only(values: Any) -> FloatArray:
    view = np.asarray(values, dtype=float).view()
    view.flags.writeable = False
    return view


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
