"""Recordings: measured signals on one uniform time grid, from readings that may jitter and have gaps.

Reading puts them on the grid t_0 + k T. Where the grid is coarser than the data, a sample is the mean over one period,
taken by the rules of those that are taken online (`sampling`); else it is the straight line between two readings, or
the last value of a held signal. NaN means "not measured", and what was lost or mended is in the recording's notes, in
words.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from cruise.grid import SAME_STEP, between, denser, sensible_step, snapped, typical_step
from cruise.sampling import FloatArray, Kind, kind_of, means, stale_after
from cruise.signals import INPUT, OUTPUT, SIGNALS
from cruise.units import InputUnit

MIN_SAMPLES: Final = 10  # fewer cannot hold even the shortest model's past and a 3 s horizon at 5 Hz
MAX_SAMPLES: Final = 5_000_000  # 14 h at 100 Hz, 40 MB a signal
COARSER: Final = 1.2  # grid step over data step from which samples are means; below it nothing much can alias
SLOWER: Final = 1.001  # times a period, from which on a step is longer
EARLY: Final = 0.1  # of a grid step: a held value stamped this little late is taken as in time; DART jitters by 0.095


class RecordingError(ValueError):
    """A recording that cannot be used; the message names file, line or column, and what to do."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """One column as it was measured: `time_s` (N,), `values` (N,), NaN for not measured."""

    time_s: FloatArray
    values: FloatArray


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals on a uniform grid: `time_s` (N,) with step `dt_s`, `columns` name to values (N,), NaN for not measured.

    A sample is the reading at its time, of a current the one that holds from there on, or where `averaged` the mean
    over the period that ends there.
    `source` says where it comes from, `notes` what was lost or mended, `stamps_s` (M,) the time stamps as they were
    before the grid, where known, `input_unit` what the size of the input was taken to tell of its unit, `input_rest_ma`
    the input of the file, in mA, that is 0 here. The arrays are read-only. Raises RecordingError for a grid that is not
    uniform, columns of another length, or no input or output.
    """

    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    dt_s: float
    source: str
    notes: tuple[str, ...] = ()
    stamps_s: FloatArray | None = None
    averaged: bool = False
    input_unit: InputUnit = ""
    input_rest_ma: float = 0.0

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


def resample(recording: Recording, dt_s: float) -> Recording:
    """Return `recording` on a grid of `dt_s`, by the same rules as a file is read with; means are held over theirs."""
    columns = {
        name: Readings(recording.time_s if kind_of(name) is Kind.STATE else recording.since_s, values)
        for name, values in recording.columns.items()
    }
    resampled = on_grid(recording.since_s, columns, dt_s, recording.source, recording.notes, held=recording.averaged)
    return replace(
        resampled,
        stamps_s=recording.stamps_s,
        input_unit=recording.input_unit,
        input_rest_ma=recording.input_rest_ma,
    )


def counted_from(recording: Recording, rest_ma: float) -> Recording:
    """Return `recording` with the input that was `rest_ma` in its file as 0."""
    columns = {**recording.columns, INPUT: recording.input + (recording.input_rest_ma - rest_ma)}
    return replace(recording, columns=columns, input_rest_ma=rest_ma)


def too_slow(dt_s: float, period_s: float, what: str = "a model") -> str:
    """In words, where steps are longer than a period, so that nothing is there for each of it; else empty."""
    return f"sampled every {dt_s:g} s, too slowly for {what} of {period_s:g} s" if dt_s > SLOWER * period_s else ""


def notes_of(recordings: Sequence[Recording]) -> list[str]:
    """Return what was lost or mended in the recordings, under the names of their files; once what is said of all."""
    shared = set.intersection(*(set(one.notes) for one in recordings)) if len(recordings) > 1 else set()
    of_all = [f"all recordings: {note}" for note in recordings[0].notes if note in shared] if shared else []
    return of_all + [
        f"{Path(one.source).name}: {note}" for one in recordings for note in one.notes if note not in shared
    ]


def input_unit_of(recordings: Sequence[Recording]) -> InputUnit:
    """Return what the size of their inputs was taken to tell of the unit, which is one for all of them."""
    told: list[InputUnit] = [one.input_unit for one in recordings if one.input_unit]
    return told[0] if told else ""


def input_rest_of(recordings: Sequence[Recording]) -> float:
    """Return the input of their files, in mA, that is 0 in all of them."""
    return next((one.input_rest_ma for one in recordings if one.input_rest_ma), 0.0)


def on_grid(
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
        step_s, kind = typical_step(times), kind_of(name)
        if held and kind is not Kind.STATE:
            kind = Kind.HELD
        if averaged:
            gridded[name] = means(times, known, grid_s, dt_s, kind, stale_after(step_s))
            continue
        values = between(times, known, grid_s, EARLY * dt_s, kind, stale_after(step_s))
        fast = np.full(len(grid_s), dt_s > COARSER * step_s) | denser(times, grid_s, dt_s, COARSER)
        if kind is not Kind.STATE and fast.any():
            # Faster than the grid: what is taken at the instant is a mean around it, what is held acts from it on.
            until_s = grid_s[fast] + (dt_s if kind is Kind.HELD else 0.5 * dt_s)
            values[fast] = means(times, known, until_s, dt_s, kind, stale_after(step_s))
        gridded[name] = values
    return Recording(grid_s, gridded, dt_s, source, notes, base_s, averaged)


def _read_only(values: Any) -> FloatArray:
    view = np.asarray(values, dtype=float).view()
    view.flags.writeable = False
    return view


def listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
