"""The pull of the slope, as a pitch sensor that takes a part of the acceleration for slope shows it.

    p_k = S_k - r A_(k-1)
    S_k = S_(k-1) + l (g_n sin(alpha_k) - S_(k-1)),   V_k = V_(k-1) + l (v_k - V_(k-1)),   A_k = (V_k - V_(k-1)) / T

alpha pitch in degrees (+ uphill), g_n = 9.81 m/s2, v measured ground speed in m/s, of the samples before only, S and A
slope and acceleration in m/s2 seen through the same low-pass, l = 1 - exp(-T / tau), r share of the acceleration that
is taken off. Source: specific force on an accelerometer, any textbook of inertial navigation.
"""

import math

import numpy as np

from cruise.effects.effect import GRAVITY_MPS2, State, Value, where
from cruise.effects.low_pass import followed, share
from cruise.signals import OUTPUT, Signals


def unknown(like: Value) -> State:
    """Low-passed slope in m/s2, low-passed speed in m/s and its rate in m/s2: not known yet."""
    return like * math.nan, like * math.nan, like * 0.0


def pull(
    signals: Signals, state: State, acceleration_share: Value, filter_s: Value, dt_s: float
) -> tuple[Value, State]:
    """p in m/s2 and the state after this sample. A hole in the speed is no acceleration."""
    pitch_deg = signals["pitch_deg"]
    sine = np.sin(np.radians(pitch_deg)) if isinstance(pitch_deg, np.ndarray) else math.sin(math.radians(pitch_deg))
    slope_mps2, speed_mps, accel_mps2 = state
    moved = share(filter_s, dt_s)
    seen_mps2 = GRAVITY_MPS2 * sine
    slope_mps2 = followed(slope_mps2, seen_mps2, moved)
    pull_mps2 = slope_mps2 - acceleration_share * accel_mps2
    measured_mps = signals.get(OUTPUT, math.nan)
    measured_mps = where(measured_mps == measured_mps, measured_mps, speed_mps)
    speed_mps = where(speed_mps == speed_mps, speed_mps, measured_mps)
    followed_mps = speed_mps + moved * (measured_mps - speed_mps)
    accel_mps2 = where(followed_mps == followed_mps, (followed_mps - speed_mps) / dt_s, 0.0)
    return pull_mps2, (slope_mps2, followed_mps, accel_mps2)
