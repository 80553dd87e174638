"""What the times of readings are worth: a clock's, out of order, twice, with gaps, at another rate, or too rare."""

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from cruise.grid import SAME_STEP, other_rates, typical_step
from cruise.recording import MIN_SAMPLES, Readings, RecordingError
from cruise.sampling import FloatArray, stale_after
from cruise.units import entry, spelt

MAX_STEP_S: Final = 3.0  # no prediction that is judged 3 s ahead can be made from rarer readings
SLOW_STEP_S: Final = 0.5  # no machine's own rate; more may be ms
MAX_GAP_NOTES: Final = 5
MOST_PARTS: Final = 10  # drives that anyone would put into one file; time goes back oftener where rows are out of order
FEW_ROWS: Final = 5.0  # typical steps; a clock that is set goes back further
ROUNDED_SHARE: Final = 0.25  # of the values; more do not share their time by chance
CLOCK_DIGITS: Final = 6  # of s: seconds since 1970 hold no more
CLOCK_S: Final = 1e8  # s, three years: times beyond are those of a clock, and no drive's own


def from_its_start(time_s: FloatArray, notes: list[str]) -> FloatArray:
    """Return the times; those of a clock, since 1970, counted from the whole second of the first, and a note on it."""
    known = time_s[~np.isnan(time_s)]
    if not len(known) or known[0] < CLOCK_S:
        return time_s
    start_s = math.floor(known[0])
    notes.append(f"times count from {np.datetime64(start_s, 's')}, {start_s} s since 1970")
    return np.round(time_s - start_s, CLOCK_DIGITS)


def rising(name: str, readings: Readings, notes: list[str]) -> Readings:
    """Return the readings that are newer than all before them, or older than all behind them where these are more.

    So one that is far ahead costs itself alone. Of those with one time the last one holds.
    """
    time_s = readings.time_s
    if np.all(np.diff(time_s) > 0.0):
        return readings
    newest_s, oldest_s = np.fmax.accumulate(time_s), np.fmin.accumulate(time_s[::-1])[::-1]
    risen = np.flatnonzero(time_s >= newest_s), np.flatnonzero(time_s <= oldest_s)  # false for a time that is no number
    kept = max(risen, key=len)
    kept = kept[np.append(np.diff(time_s[kept]) > 0.0, True)[: len(kept)]]
    notes.append(f"{name}: {len(time_s) - len(kept)} of {len(time_s)} readings out of order or repeated, left out")
    return Readings(time_s[kept], readings.values[kept])


def in_order(time_s: FloatArray, notes: list[str]) -> npt.NDArray[np.intp]:
    """Return the indices of the rows (N,) by time, where they are the newest first, or some a few steps out of order.

    Any others stay as they are: time that goes back further is a clock that was set, or another drive.
    """
    rows = np.arange(len(time_s))
    timed = np.flatnonzero(~np.isnan(time_s))
    steps = np.diff(time_s[timed])
    back, forward = -steps[steps < 0.0], steps[steps > 0.0]
    if not len(back):
        return rows
    newest_first = not len(forward)
    if not newest_first and back.max() > FEW_ROWS * float(np.median(forward)):
        return rows
    rows[timed] = timed[::-1] if newest_first else timed[np.argsort(time_s[timed], kind="stable")]
    notes.append(
        "the newest row comes first, turned round" if newest_first else f"{len(back)} rows out of order, sorted"
    )
    return rows


def usable_rows(
    source: str, time: str, time_s: FloatArray, place: Callable[[int], str], notes: list[str]
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
        sort = "sort the rows by time; or, if the clock was set, " if np.sum(steps < 0.0) > MOST_PARTS else ""
        raise RecordingError(
            f"{place(int(timed[at + 1]))}: time runs backwards, from {before:.10g} s to {after:.10g} s; "
            f"{sort}split the file there: each part is a recording of its own"
        )
    kept = timed[np.append(steps > 0.0, True)[: len(timed)]]  # of rows with one time, the last number of each column
    if len(kept) < len(timed):
        notes.append(f"{len(timed) - len(kept)} rows have the time of the next one: they count as one with it")
    if len(kept) == 1 and len(timed) >= MIN_SAMPLES:
        raise RecordingError(
            f"{source}: all {len(timed)} rows have one time, {time_s[kept[0]]:.10g} s; let {time} hold that of each row"
        )
    if len(kept) < MIN_SAMPLES:
        raise RecordingError(f"{source}: {len(kept)} usable rows are too few; a recording needs {MIN_SAMPLES} at least")
    step_s = typical_step(time_s[kept])
    in_ms = "" if spelt(time, "s") else f"{entry(time, 0.001)} reads it so"
    if step_s > MAX_STEP_S:
        remedy = f"if {time} is in ms, {in_ms}" if in_ms else "record it more often"
        raise RecordingError(f"{source}: one row every {step_s:.4g} s is too few to see a drive move; {remedy}")
    if step_s > (1.0 + SAME_STEP) * SLOW_STEP_S:
        notes.append(f"{time}: one row every {step_s:.4g} s" + (f"; if it is in ms, {in_ms}" if in_ms else ""))
    return kept


def rounded_notes(time: str, time_s: FloatArray, values: FloatArray, kept: npt.NDArray[np.intp]) -> list[str]:
    """Return a note where many rows with a value of their own share their time with others: its stamps were rounded."""
    measured = int(np.count_nonzero(~np.isnan(values) & ~np.isnan(time_s)))
    lost = measured - len(kept)
    if lost <= ROUNDED_SHARE * measured:
        return []
    return [f"{time}: {lost} of {measured} values are lost, as its stamps lack decimals; write it with all its digits"]


def last_of_each(time_s: FloatArray, values: FloatArray, kept: npt.NDArray[np.intp]) -> Readings:
    """Return one column at the rows `kept`, the last ones of their times: there or before, its last number counts."""
    found = values[kept]
    begins = np.concatenate([[0], kept[:-1] + 1])
    for at in np.flatnonzero(np.isnan(found) & (kept > begins)):
        rows = np.arange(begins[at], kept[at])
        known = rows[(time_s[rows] == time_s[kept[at]]) & ~np.isnan(values[rows])]
        if len(known):
            found[at] = values[known[-1]]
    return Readings(time_s[kept], found)


def gap_notes(name: str, time_s: FloatArray) -> list[str]:
    """Return notes on the gaps of a signal, the first ones each."""
    steps = np.diff(time_s)
    gaps = np.flatnonzero(steps > stale_after(typical_step(time_s)))
    notes = [f"{name}: gap of {steps[at]:.3g} s at t={time_s[at]:.10g} s" for at in gaps[:MAX_GAP_NOTES]]
    return notes + [f"{name}: {len(gaps) - MAX_GAP_NOTES} gaps more"] * (len(gaps) > MAX_GAP_NOTES)


def rate_notes(name: str, time_s: FloatArray) -> list[str]:
    """Return a note on a signal that comes at more than one rate."""
    from_s, steps = other_rates(time_s)
    other = np.isfinite(steps)
    if not other.any():
        return []
    first, typical_s = int(np.argmax(other)), typical_step(time_s)
    return [
        f"{name}: comes every {steps[first]:.3g} s instead of {typical_s:.3g} s from t={from_s[first]:.10g} s on, "
        f"{100.0 * other.mean():.0f} % of it at another rate"
    ]
