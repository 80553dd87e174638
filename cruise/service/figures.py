"""The figures of a drive: how well the speed was kept, and what the command contained."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy import signal

SETTLE_S: Final = 8.0  # s after a change of the setpoint that don't count as keeping the speed
WINDOW_S: Final = 20.0  # s, of which the mean of the command is removed
SMALLEST_STEP_MPS: Final = 0.1  # m/s, changes of the setpoint below have no overshoot worth a percentage


def drive_figures(columns: Mapping[str, np.ndarray], frame_s: float, current_range_ma: float) -> dict[str, float]:
    """Figures over the engaged time from the columns of a trace, one row per `frame_s`.

    Errors are of the true speed against the raw setpoint. rms_error_mps and steady_error_mps (its mean) leave out
    SETTLE_S after each change; overshoot_pct is the largest of all changes in percent of the change. NaN where there
    is nothing to measure.
    """
    engaged = columns["engaged"] > 0.5
    setpoint, speed = columns["setpoint_mps"], columns["true_speed_mps"]
    changes = np.flatnonzero(engaged & (np.diff(setpoint, prepend=np.nan) != 0.0))
    since_s = np.full(len(setpoint), np.inf)
    for start in changes:
        since_s[start:] = np.arange(len(setpoint) - start) * frame_s
    error = (speed - setpoint)[engaged & (since_s > SETTLE_S)]
    accel = np.abs(columns["true_accel_mps2"][engaged])
    command = columns["command_ma"][engaged]
    nothing = float("nan")
    return {
        "rms_error_mps": float(np.sqrt(np.mean(error**2))) if len(error) else nothing,
        "steady_error_mps": float(np.mean(error)) if len(error) else nothing,
        "overshoot_pct": _overshoot_pct(setpoint, speed, changes, frame_s),
        "command_above_1hz_rms_pct": 100.0 * above_1hz_rms(command, frame_s) / current_range_ma,
        "accel_max_mps2": float(accel.max()) if len(accel) else nothing,
        "engaged_s": float(engaged.sum() * frame_s),
        "setpoint_changes": len(changes),
    }


def above_1hz_rms(values: np.ndarray, dt_s: float) -> float:
    """RMS of the content above 1 Hz: Welch's spectrum in Hann windows of 20 s with their mean removed."""
    count = round(WINDOW_S / dt_s)
    if len(values) < count:
        return float("nan")
    frequency_hz, density = signal.welch(values, 1.0 / dt_s, "hann", count, detrend="constant")
    return float(np.sqrt(np.sum(density[frequency_hz > 1.0]) * frequency_hz[1]))


def _overshoot_pct(setpoint: np.ndarray, speed: np.ndarray, changes: np.ndarray, frame_s: float) -> float:
    worst = float("nan")
    for start in changes:
        known = start > 0 and np.isfinite(setpoint[start - 1])
        size = setpoint[start] - (setpoint[start - 1] if known else speed[start])
        if abs(size) < SMALLEST_STEP_MPS:
            continue
        later = changes[changes > start]
        end = min(start + round(SETTLE_S / frame_s), later[0] if len(later) else len(speed))
        held = setpoint[start:end] == setpoint[start]  # not once a person drives again
        beyond = np.sign(size) * (speed[start:end] - setpoint[start])[held]
        worst = max(float(100.0 * np.max(beyond) / abs(size)), 0.0 if np.isnan(worst) else worst)
    return worst
