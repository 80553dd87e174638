"""The uniform time grid of a recording: which step was meant, and the values of one signal on it."""

from typing import Final

import numpy as np
import numpy.typing as npt

from cruise.sampling import FloatArray, Kind

SAME_STEP: Final = 1e-3  # relative; steps that differ less are one step, written with few digits
ROUNDING: Final = 1e-6  # of a grid step; what number formats do to time stamps over a whole file
NEAR_STEP: Final = 0.02  # relative; a clock and jitter of this size hide the rate that was meant
OTHER_STEP: Final = 0.5 + SAME_STEP  # relative; a step that differs more is a gap, or one at another rate
BLOCK: Final = 20  # steps in a row that are at another rate, where their median is
AROUND: Final = 5.0  # grid steps before and behind an instant in which readings are counted


def typical_step(time_s: FloatArray) -> float:
    """Return the mean step in s at the commonest rate: unlike the median it sees through time stamps of few digits."""
    steps = np.diff(time_s)
    median = np.median(steps) if len(steps) else 0.0
    return float(np.mean(steps[np.abs(steps - median) <= OTHER_STEP * median])) if len(steps) else 0.0


def other_rates(time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return when and in which steps in s readings come at another rate than most, a block of them each; NaN: not."""
    steps, typical_s = np.diff(time_s), typical_step(time_s)
    whole = len(steps) // BLOCK * BLOCK
    blocks = np.median(steps[:whole].reshape(-1, BLOCK), axis=1)
    return time_s[:whole:BLOCK], np.where(np.abs(blocks - typical_s) > OTHER_STEP * typical_s, blocks, np.nan)


def denser(time_s: FloatArray, grid_s: FloatArray, dt_s: float, coarser: float) -> npt.NDArray[np.bool_]:
    """Return where on the grid (N,) readings come so fast that `dt_s` is more than `coarser` times their step."""
    before, behind = (np.searchsorted(time_s, grid_s + side * AROUND * dt_s) for side in (-1.0, 1.0))
    return behind - before > 2.0 * AROUND * coarser


def sensible_step(time_s: FloatArray, step_s: float) -> float:
    """Return `step_s` where all steps equal it, else one digit of it or a whole number of Hz where that is near."""
    if np.all(np.abs(np.diff(time_s) - step_s) <= SAME_STEP * step_s):
        shorter = (float(f"{step_s:.{digits}g}") for digits in (3, 6, 9, 12))
        drift_free = 0.5 * ROUNDING * step_s / len(time_s)
        return next((short_s for short_s in shorter if abs(short_s - step_s) <= drift_free), step_s)
    for round_s in (float(f"{step_s:.1g}"), 1.0 / max(round(1.0 / step_s), 1)):
        if abs(round_s - step_s) <= NEAR_STEP * step_s:
            return round_s
    return float(f"{step_s:.2g}")


def snapped(time_s: FloatArray, start_s: float, dt_s: float) -> FloatArray:
    """Return the times with those on the grid that number formats put just before or behind it."""
    nearest_s = start_s + dt_s * np.rint((time_s - start_s) / dt_s)
    rounding_s = ROUNDING * dt_s + 4.0 * np.spacing(np.max(np.abs(time_s)))
    return np.where(np.abs(time_s - nearest_s) <= rounding_s, nearest_s, time_s)


def between(
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
