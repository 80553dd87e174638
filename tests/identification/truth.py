"""A known truth, simulated by hand: an ARX drive behind dead zone and curve, on an engine that changes its speed."""

import numpy as np

from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

PERIOD_S = 0.2
THRESHOLD_MA, CURVATURE = 400.0, 0.6
EFFECTS = (DeadZone(THRESHOLD_MA), QuadraticGain(CURVATURE), EngineSpeed(1.0), GearRatio(1.4, 2.5, 4.4, 7.8))
THETA = (0.7, 3e-4, 4e-4, -0.04)  # a_1, b_0, b_1, c_0
MODEL = Model(PERIOD_S, 1, 2, 2, EFFECTS, THETA)
HIGH_GEAR, ALPHA = 4.4 / 2.5, (2.5 / 4.4) ** 2


def currents(samples: int, seed: int, low=450.0, high=1000.0, hold=8) -> np.ndarray:
    """Random steps of current in mA."""
    levels = np.random.default_rng(seed).uniform(low, high, samples // hold + 1)
    return np.repeat(levels, hold)[:samples]


def recording(samples: int = 600, seed: int = 0, noise_mps: float = 0.02, current_ma=None, a: float = 0.7) -> Recording:
    """y_k = alpha (a y_(k-1) + r n/2100 sum_j b_j v_(k-2-j) + c) + (1 - alpha) y_(k-1) + e_k, third gear at the end.

    v = x (1 + 0.6 x / 1000), x = max(u - 400, 0); e white.
    """
    rng = np.random.default_rng(1000 + seed)
    current_ma = currents(samples, seed) if current_ma is None else current_ma
    beyond = np.maximum(current_ma - THRESHOLD_MA, 0.0)
    v = beyond * (1.0 + CURVATURE * beyond / 1000.0)
    rpm = 1950.0 + 150.0 * np.sin(np.arange(samples) / 40.0)
    gear = np.where(np.arange(samples) < 0.7 * samples, 2.0, 3.0)
    noise = noise_mps * rng.standard_normal(samples)
    _, b_0, b_1, c_0 = THETA
    y = np.zeros(samples)
    for k in range(3, samples):
        ratio, alpha = (HIGH_GEAR, ALPHA) if gear[k] == 3.0 else (1.0, 1.0)
        drive = ratio * rpm[k] / 2100.0 * (b_0 * v[k - 2] + b_1 * v[k - 3])
        y[k] = alpha * (a * y[k - 1] + drive + c_0) + noise[k] + (1.0 - alpha) * y[k - 1]
    columns = {INPUT: current_ma, OUTPUT: y, "engine_speed_rpm": rpm, "gear": gear}
    return Recording(PERIOD_S * np.arange(samples), columns, PERIOD_S, "truth.csv")


STROKE_SHARE, STROKED = 0.6, (0.7, 9e-4, -0.3)  # a_1, b_0, c_0 of a drive that yields with its stroke
STROKED_MODEL = Model(PERIOD_S, 1, 1, 1, (), STROKED, stroke_share=STROKE_SHARE)


def stroked(samples: int = 1500, noise_mps: float = 0.0) -> Recording:
    """l = 1 - s + s K v_(k-1) / 1.5 m/s, K = b / (1 - a), y_k = alpha (a y + b v + c) + (1 - alpha) y_(k-1).

    The noise is in what is measured, the drive does not feel it.
    """
    a, b_0, c_0 = STROKED
    current_ma, speed_mps = currents(samples, 3), np.zeros(samples)
    for k in range(1, samples):
        before_mps = speed_mps[k - 1]
        felt = 1.0 + STROKE_SHARE * (b_0 * current_ma[k - 1] / (1.0 - a) / 1.5 - 1.0)
        alpha = (1.0 - a ** (1.0 / felt)) / (1.0 - a)
        speed_mps[k] = alpha * (a * before_mps + b_0 * current_ma[k - 1] + c_0) + (1.0 - alpha) * before_mps
    speed_mps += noise_mps * np.random.default_rng(4).standard_normal(samples)
    return Recording(PERIOD_S * np.arange(samples), {INPUT: current_ma, OUTPUT: speed_mps}, PERIOD_S, "stroke.csv")
