"""A drive simulated by hand, without the model: delay, servo lag, inertia, and what the tests let it lack or have.

    m v' = k (w(t) - v) - g sin(slope) + soil ,    w' = (gain f(u(t - 0.3 s)) - w) / 0.15 s ,    y = v + noise

v true speed in m/s, w what the pump asks for, u current in mA; 20 Hz, one Euler step of 5 ms ten times a sample.
"""

import numpy as np
from scipy import signal

from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

DT_S, STEP_S = 0.05, 0.005
DELAY_S, SERVO_S, DRIVE_S = 0.3, 0.15, 0.5
GAIN = 2.5e-3  # m/s per mA


def steps(samples: int, seed: int, low_ma: float = 300.0, high_ma: float = 900.0) -> np.ndarray:
    """Random levels, held 1 to 6 s."""
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.uniform(low_ma, high_ma, samples), rng.integers(20, 120, samples))
    return held[:samples]


def slow(samples: int, seed: int, std: float, time_constant_s: float) -> np.ndarray:
    """A first-order process of this standard deviation."""
    pole = np.exp(-DT_S / time_constant_s)
    white = np.random.default_rng(7000 + seed).standard_normal(samples + round(10 * time_constant_s / DT_S))
    return std * np.sqrt(1.0 - pole**2) * np.asarray(signal.lfilter([1.0], [1.0, -pole], white))[-samples:]


def hills(samples: int, seed: int) -> np.ndarray:
    """Slopes in degrees: level ground, and now and then a ramp of 3 to 6 degrees for 15 to 30 s."""
    rng = np.random.default_rng(300 + seed)
    slope = np.zeros(samples)
    at = 400
    while at < samples:
        length = int(rng.integers(300, 600))
        slope[at : at + length] = rng.uniform(3.0, 6.0)
        at += length + int(rng.integers(1200, 2400))
    return np.asarray(signal.sosfilt(signal.butter(2, 0.3, fs=1.0 / DT_S, output="sos"), slope))


def record(
    seed: int = 0,
    seconds: float = 600.0,
    noise_mps: float = 0.01,
    grade_mps_per_deg: float = 0.0,
    soil_mps: float = 0.0,
    curvature: float = 0.0,
    source: str = "machine.csv",
) -> Recording:
    """A recording at 20 Hz with context that moves; `grade`, `soil` and `curvature` are what they take off the speed.

    `curvature`: f(u) = u (1 + curvature (u - 600) / 600).
    """
    samples = round(seconds / DT_S)
    current, slope = steps(samples, seed), hills(samples, seed)
    soil = slow(samples, seed, soil_mps, 5.0)
    asked = GAIN * current * (1.0 + curvature * (current - 600.0) / 600.0)
    late = np.concatenate([np.full(round(DELAY_S / DT_S), asked[0]), asked])[:samples]
    pushed = np.repeat(late, round(DT_S / STEP_S))
    pull = np.repeat(soil - grade_mps_per_deg * slope, round(DT_S / STEP_S))
    w = np.asarray(signal.lfilter([STEP_S / SERVO_S], [1.0, STEP_S / SERVO_S - 1.0], pushed))
    v = np.asarray(signal.lfilter([STEP_S / DRIVE_S], [1.0, STEP_S / DRIVE_S - 1.0], w + pull))
    speed = v.reshape(samples, -1).mean(axis=1)
    rng = np.random.default_rng(500 + seed)
    time_s = DT_S * np.arange(samples)
    columns = {
        INPUT: current,
        OUTPUT: speed + noise_mps * rng.standard_normal(samples),
        "pitch_deg": slope + 0.2 * rng.standard_normal(samples),
        "engine_speed_rpm": 2050.0 + slow(samples, 1000 + seed, 40.0, 20.0),
        "machine_mass_kg": 15000.0 + 6.0 * time_s,
        "header_height": 300.0 + slow(samples, 2000 + seed, 80.0, 15.0),
    }
    return Recording(time_s, columns, DT_S, source)
