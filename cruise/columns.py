"""What the columns of a file mean: which of them are time, input and output, names, units, and what can't be used.

A table has a time column and one column a signal. Where every signal comes at times of its own, as on a bus, `arranged`
follows the same rules.
"""

import difflib
import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np

from cruise.directions import along, falls, middle, unsigned
from cruise.grid import typical_step
from cruise.recording import MIN_SAMPLES, Readings, Recording, RecordingError, counted_from, listed, on_grid
from cruise.sampling import FloatArray
from cruise.signals import CONTEXT, INPUT, OUTPUT, SIGNALS
from cruise.times import (
    from_its_start,
    gap_notes,
    in_order,
    last_of_each,
    rate_notes,
    rising,
    rounded_notes,
    usable_rows,
)
from cruise.units import FULL_MA, MA_PER_UNIT, UNITS, InputUnit, apart, bracketed, entry, spelt

TIME: Final = "time_s"
TIMES: Final = re.compile(r"time|zeit|temps|tiempo|tijd", re.IGNORECASE)
SOUNDS: Final = re.compile(
    rf"{TIMES.pattern}|(?<![^\W_])(?:ms|us|sec|seconds)(?![^\W_])|^t([\W_]+s)?\W*$", re.IGNORECASE
)  # like a time
MOST_CODES: Final = 3  # "specific", "error" and "not available" of J1939-71; what is measured has more values
CODES_APART: Final = 0.25  # of a signal's range, by which they are apart from all that was measured
LARGEST: Final[dict[InputUnit, float]] = {
    "A or a share of all": 3.0,
    "V or tenths of all": 15.0,
    "per cent": 150.0,
    "mA": math.inf,
}
"""The largest input and what it is taken to be in: no pump's servo moves below 150 mA, and none takes 3 A.

Valves and small motors are driven by up to 10 or 12 V; per cent that go to 15 only say so in their name.
"""
TURNING: Final = ("wheel_speed_mps", "line_pressure_bar")
"""Signals that are below 0 while a machine goes backward, and that many a sensor shows without a sign."""


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
    input_rest_ma: float | None = None  # input at which the machine stands, taken as 0; default: as recordings show it

    def __post_init__(self) -> None:
        if self.input_rest_ma and self.active_when is not None:
            raise ValueError(
                "input_rest_ma beside active_when, which sets the input to 0: give an offset in columns instead"
            )


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
    said = list(notes)
    wanted = (time_of(raw, settings, said), settings.input, settings.output)
    time, current, speed = _roles(header, raw, settings, wanted, said)
    time_s = _scaled(raw[time], settings.columns.get(time) or _by_name(time, "s", said))
    order = in_order(time_s, said)
    raw, time_s = {name: values[order] for name, values in raw.items()}, from_its_start(time_s[order], said)
    keep = usable_rows(source, time, time_s, lambda row: place(int(order[row])), said)
    said += rounded_notes(time, time_s, raw[speed], keep)
    columns = {name: last_of_each(time_s, values, keep) for name, values in raw.items() if name != time}
    time_s = time_s[keep]
    signals = _signals(source, columns, current, speed, settings, said, ("rows", "cells hold no number, not measured"))
    unit = _in_ma(current, signals, settings, said)
    read = replace(on_grid(time_s, signals, dt_s, source, tuple(said)), input_unit=unit)
    return _directed(read, current, speed, settings)


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
    said = list(notes)
    current, speed = _roles(source, columns, settings, (settings.input, settings.output), said)
    columns = {name: rising(name, readings, said) for name, readings in columns.items()}
    signals = _signals(source, columns, current, speed, settings, said, ("readings", "values are no measurement"))
    unit = _in_ma(current, signals, settings, said)
    measured = {name: signals[name].time_s[~np.isnan(signals[name].values)] for name in (INPUT, OUTPUT)}
    few = min(measured, key=lambda name: len(measured[name]))
    if len(measured[few]) < MIN_SAMPLES:
        raise RecordingError(
            f"{source}: {few} has {len(measured[few])} readings, too few; a recording needs {MIN_SAMPLES} at least"
        )
    base_s = max(measured.values(), key=typical_step)
    read = replace(on_grid(base_s, signals, dt_s, source, tuple(said)), input_unit=unit)
    return _directed(read, current, speed, settings)


def time_of(raw: Mapping[str, FloatArray], settings: RecordingSettings, notes: list[str]) -> str:
    """Return the name of the time: where nobody has said it and there is no time_s, the one column that sounds so.

    Of several it is the one that rises with every row.
    """
    if settings.time != TIME or TIME in raw or any(one.signal == TIME for one in settings.columns.values()):
        return settings.time
    sounding = [name for name in raw if SOUNDS.search(name) and name not in (settings.input, settings.output)]
    rising = [name for name in sounding if np.all(np.diff(raw[name]) > 0.0)]
    found = rising if len(rising) == 1 else [name for name in sounding if TIMES.search(name)]
    if len(found) != 1:
        return settings.time
    notes.append(f"{found[0]}: taken as the time; time: NAME in the file of --columns takes another column")
    return found[0]


def _roles(
    where: str, names: Collection[str], settings: RecordingSettings, wanted: tuple[str, ...], notes: list[str]
) -> tuple[str, ...]:
    """Return the columns that are (time,) input and output, each named by itself or by the mapping.

    Another column of the mapping may lack: one file says what the columns of many recordings mean.
    """
    roles = ("time", "input", "output")[-len(wanted) :]
    found = [column_of(name, names, settings) for name in wanted]
    for role, name in zip(roles, found, strict=True):
        _require(role, name, where, names)
    if len(set(found)) < len(found):
        raise RecordingError(f"{where}: one column cannot be both input and output, or time; choose three")
    if "time" in roles and found[0] in _gate_columns(settings):
        raise RecordingError(f"{where}: active_when: {found[0]!r} is the time, and no flag; choose another column")
    for name in _gate_columns(settings):
        _require("active_when", name, where, names)
    for name in (name for name in settings.columns if name not in names):
        if _meant_by(name, [other for other in names if other not in settings.columns]):
            _require("columns", name, where, names)
        notes.append(f"{name}: named in the file of --columns, and not in this recording")
    return tuple(found)


def _unknown_notes(settings: RecordingSettings) -> list[str]:
    """Return a note on each signal that columns are said to be and that there is none of."""
    said = ((column, one.signal) for column, one in settings.columns.items() if one.signal is not None)
    unknown = [(column, signal) for column, signal in said if signal not in SIGNALS]
    return [
        f"{column}: {signal!r} is no signal that cruise knows, so that no effect can use it; {_meant(signal)}"
        for column, signal in unknown
    ]


def _meant(signal: str) -> str:
    near = difflib.get_close_matches(signal, CONTEXT, n=1)
    return f"did you mean {near[0]}?" if near else f"known are {', '.join(CONTEXT)}"


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
    notes.extend(_unknown_notes(settings))
    signals: dict[str, Readings] = {}
    for name, readings in columns.items():
        signal = INPUT if name == current else OUTPUT if name == speed else _signal_of(name, settings)
        if signal in signals:
            raise RecordingError(
                f"{source}: two columns would be {signal}; one of them is {name!r}; rename one in columns"
            )
        meant = settings.columns.get(name)
        if meant is None and name in (current, speed):
            meant = _by_name(name, SIGNALS[signal].unit, notes)
        values, codes = _without_codes(signal, _scaled(readings.values, meant))
        if len(codes):
            said = " and ".join(f"{code:g}" for code in codes)
            there = int(np.isnan(values).sum() - np.isnan(readings.values).sum())
            notes.append(f"{name}: {said}, {there} times, is nothing that {signal} can be: not measured")
        missing, count = int(np.isnan(readings.values).sum()), len(readings.values)
        if missing == count and name not in (current, speed):
            notes.append(f"{name}: holds no number, left out")
            continue
        if missing:
            notes.append(f"{name}: {missing} of {count} {not_measured}")
        signals[signal] = Readings(readings.time_s, values)
    if settings.active_when is not None:
        gate = settings.active_when
        signals[INPUT], off = _gated(signals[INPUT], columns[gate.column], gate.above)
        all_of_it = f"{len(signals[INPUT].values)} {of_what}"
        notes.append(f"input set to 0 in {off} of {all_of_it}: {gate.column} is not above {gate.above:g}")
    for name in (INPUT, OUTPUT):
        measured_s = signals[name].time_s[~np.isnan(signals[name].values)]
        notes.extend(gap_notes(name, measured_s) + rate_notes(name, measured_s))
    return signals


def _by_name(name: str, unit: str, notes: list[str]) -> ColumnSettings | None:
    """Return what the unit means that a name says, and a note on it; of a current only in brackets: its size tells."""
    said = spelt(name, unit)
    if said in ("", unit) or (unit == "mA" and not bracketed(name)):
        return None
    notes.append(f"{name}: read as {said}; {entry(name, 1.0)} takes it as {unit}")
    scale, offset = UNITS[unit][said]
    return ColumnSettings(scale=scale, offset=offset)


def _in_ma(name: str, signals: dict[str, Readings], settings: RecordingSettings, notes: list[str]) -> InputUnit:
    """Read an input too small for a pump's current as a share of FULL_MA; where its name says mA, say so only.

    Returns what unit its size tells; nothing where the settings or the name say it, or the input never moves.
    """
    current = signals[INPUT]
    known = np.abs(current.values[~np.isnan(current.values)])
    most = float(np.percentile(known, 99)) if len(known) else 0.0
    said = spelt(name, "mA")
    if name in settings.columns or not most or (said not in ("", "mA") and bracketed(name)):
        return ""
    unit: InputUnit = next(unit for unit, most_of in LARGEST.items() if most <= most_of)
    if unit == "V or tenths of all" and said == "%":
        unit = "per cent"
    scale = MA_PER_UNIT[unit]
    if unit == "mA":
        return "" if said == "mA" else unit
    small = f"{name}: 99 % of it is {most:.3g} at most, no current in mA moves a machine"
    if said == "mA":
        notes.append(f"{small}; if it is {unit}, {entry(name, scale)} reads it so")
        return ""
    notes.append(f"{small}; read as {unit}, all of it as {FULL_MA:g} mA; {entry(name, 1.0)} takes it as it is")
    signals[INPUT] = Readings(current.time_s, scale * current.values)
    return unit


def _directed(read: Recording, current: str, speed: str, settings: RecordingSettings) -> Recording:
    """Return the recording with its input counted from where the machine stands, and notes on that.

    Where its speed falls as its input rises a note says so. What shows only its size gets the sign of the motion.
    """
    read = _signed(read)
    if settings.input_rest_ma is not None:
        read = counted_from(read, settings.input_rest_ma)
    known = np.isfinite(read.input) & np.isfinite(read.output)
    if falls(read.input[known], read.output[known]):
        name, unit = (current, "mA") if np.median(read.input[known]) < 0.0 else (speed, "m/s")
        scale, offset = _read_by(name, unit, read, current, settings)
        turned = entry(name, -scale, -offset)
        note = f"the speed falls as the input rises: if the sign of {name} is reversed, {turned} turns it"
        return replace(read, notes=(*read.notes, note))
    if settings.input_rest_ma is not None:
        return read
    rest_ma = float(f"{middle(read.input, read.output, read.dt_s):.3g}")
    if not rest_ma:
        return read
    note = f"the machine goes both ways and {current} has one sign: it stands at about {rest_ma:g} mA"
    if settings.active_when is not None:  # which set it to 0 elsewhere
        scale, offset = _read_by(current, "mA", read, current, settings)
        note += f"; {entry(current, scale, offset - rest_ma)} takes that as 0"
        return replace(read, notes=(*read.notes, note))
    note += ", which is 0 unless the model's file, or input_rest_ma in that of --columns (0: as it is), says otherwise"
    return counted_from(replace(read, notes=(*read.notes, note)), rest_ma)


def _signed(read: Recording) -> Recording:
    """Return the recording with the sign of the motion in what turns with it and was recorded without one."""
    sizes = [name for name in TURNING if name in read.columns and unsigned(read.columns[name], read.output)]
    signed = {name: along(read.columns[name], read.output, read.dt_s) for name in sizes}
    notes = (
        f"{name}: above 0 while the machine goes backward, too: taken as a size and given the sign of the motion; "
        f"`cruise run` takes it as the bus has it"
        for name in sizes
    )
    return replace(read, columns={**read.columns, **signed}, notes=(*read.notes, *notes))


def _read_by(name: str, unit: str, read: Recording, current: str, settings: RecordingSettings) -> tuple[float, float]:
    """Return the scale and offset by which a column was read."""
    meant = settings.columns.get(name) or _by_name(name, unit, []) or ColumnSettings()
    scale = MA_PER_UNIT[read.input_unit] if name == current and read.input_unit else meant.scale
    return scale, meant.offset


def column_of(name: str, names: Collection[str], settings: RecordingSettings) -> str:
    """Return the column that has this name in the file, else the one that the mapping gives it, else the name.

    Of a column with a unit in brackets the name without them is enough, where it is the only one.
    """
    mapped = (column for column, one in settings.columns.items() if one.signal == name and column in names)
    bare = [column for column in names if bracketed(column) and apart(column)[0] == name]
    return name if name in names else next(mapped, bare[0] if len(bare) == 1 else name)


def _require(role: str, name: str, where: str, names: Collection[str]) -> None:
    if name in names:
        return
    near = _meant_by(name, names)
    hint = f"did you mean {near!r}? " if near else ""
    in_file = "in the file of --columns"
    if role in ("input", "output"):
        remedy = f"choose with --{role} NAME, or {role}: NAME {in_file}"
    else:
        remedy = f"choose with {role}: NAME {in_file}" if role == "time" else f"correct it {in_file}"
    raise RecordingError(f"{where}: no column {name!r} for {role}; {hint}it has {listed(names)}; {remedy}")


def _meant_by(name: str, names: Collection[str]) -> str:
    """Return the name that is nearly the same, or none."""
    return next(iter(difflib.get_close_matches(name, names, n=1)), "")


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


def _without_codes(signal: str, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the values without those of "error" and "not available", and these: few, far beyond the others."""
    if signal not in SIGNALS:
        return values, np.zeros(0)
    low, high = SIGNALS[signal].low, SIGNALS[signal].high
    inside = (values >= low) & (values <= high)
    beyond = ~inside & ~np.isnan(values)
    codes = np.unique(values[beyond])
    if not inside.any() or not 0 < len(codes) <= MOST_CODES:
        return values, np.zeros(0)
    least, most = values[inside].min(), values[inside].max()
    apart = np.where(codes > high, codes - most, least - codes) > CODES_APART * (high - low)
    return (np.where(beyond, np.nan, values), codes) if apart.all() else (values, np.zeros(0))


def _gated(current: Readings, flag: Readings, above: float) -> tuple[Readings, int]:
    """Return the input, 0 where the flag's last reading is not above its limit and not measured where there is none.

    Beside it how often it is 0 for that.
    """
    last = np.searchsorted(flag.time_s, current.time_s, side="right") - 1
    flags = np.where(last >= 0, flag.values[np.maximum(last, 0)], np.nan)
    off = flags <= above
    values = np.where(np.isnan(flags), np.nan, np.where(off, 0.0, current.values))
    return Readings(current.time_s, values), int(off.sum())
