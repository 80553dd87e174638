"""The slope behind a pitch sensor that takes acceleration for slope.

    g_n sin(shown) = g_n sin(slope) + r dv/dt

r share of the acceleration in the sensor's reading, 0 for a compensated one, found from pitch and speed alone: left to
a fit of the speed, measured acceleration would explain anything. Source: specific force on an accelerometer, any
textbook of inertial navigation; 1 m/s2 looks like 5.8 degrees.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.effects.effect import GRAVITY_MPS2
from cruise.recording import Recording

PITCH: Final = "pitch_deg"
SLOPE: Final = "slope_deg"
SMOOTHING_S: Final = 1.0  # s over which speed and pitch are compared: a speed sensor's noise is no acceleration then


def pitch_share(recordings: Sequence[Recording]) -> float:
    """r, 0..1: the regression of the pitch, as an acceleration, on the rate of the speed."""
    products = squares = 0.0
    for one in recordings:
        accel, pull = accel_and_pull(one)
        known = np.isfinite(accel) & np.isfinite(pull)
        if known.any():
            products += float(accel[known] @ (pull[known] - pull[known].mean()))
            squares += float(accel[known] @ accel[known])
    return min(max(products / squares, 0.0), 1.0) if squares > 0.0 else 0.0


def slope_deg(one: Recording, share: float) -> np.ndarray:
    """The slope (N,) in degrees that is left of the pitch without acceleration, smoothed; NaN in holes."""
    accel, pull = accel_and_pull(one)
    return np.degrees(np.arcsin(np.clip((pull - share * accel) / GRAVITY_MPS2, -1.0, 1.0)))


def accel_and_pull(one: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Rate of the speed and pitch as an acceleration (N,) in m/s2, both means over the same window."""
    half = max(round(0.5 * SMOOTHING_S / one.dt_s), 1)
    speed = np.pad(one.output, half, mode="edge")
    accel = (speed[2 * half :] - speed[: -2 * half]) / (2 * half * one.dt_s)
    pull = GRAVITY_MPS2 * np.sin(np.radians(np.pad(one.columns[PITCH], half, mode="edge")))
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(pull))])
    holes = np.concatenate([[0], np.cumsum(np.isnan(pull))])
    width = 2 * half + 1
    mean = (total[width:] - total[:-width]) / width
    return accel, np.where(holes[width:] == holes[:-width], mean, np.nan)
