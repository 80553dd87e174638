"""Known drives: a lag behind a delay, a resonance, a play in front of a curve, and recordings of them."""

import numpy as np
from scipy import signal

from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

DT_S = 0.05


def recording(current_ma: np.ndarray, speed_mps: np.ndarray, dt_s: float = DT_S, source: str = "a.csv") -> Recording:
    columns = {INPUT: np.asarray(current_ma, float), OUTPUT: np.asarray(speed_mps, float)}
    return Recording(dt_s * np.arange(len(current_ma)), columns, dt_s, source)


def white(samples: int, seed: int, std_ma: float = 120.0) -> np.ndarray:
    return 700.0 + std_ma * np.random.default_rng(seed).standard_normal(samples)


def steps(samples: int, seed: int, hold: int = 40) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(450.0, 1000.0, samples // hold + 1), hold)[:samples]


def noise(samples: int, seed: int, std_mps: float = 0.05) -> np.ndarray:
    return std_mps * np.random.default_rng(10_000 + seed).standard_normal(samples)


def through(b: np.ndarray, a: np.ndarray, delay: int, current_ma: np.ndarray) -> np.ndarray:
    """The filter b / a behind a delay in samples, at rest at the first value."""
    late = np.concatenate([np.full(delay, current_ma[0]), current_ma])[: len(current_ma)]
    rest = signal.lfilter_zi(b, a) * late[0]
    return signal.lfilter(b, a, late, zi=rest)[0]


def lag(cutoff_hz: float, dt_s: float = DT_S, gain: float = 0.003) -> tuple[np.ndarray, np.ndarray]:
    """y_k = a y_(k-1) + gain (1 - a) u_(k-1), a = exp(-2 pi f T)."""
    a = np.exp(-2.0 * np.pi * cutoff_hz * dt_s)
    return np.array([0.0, gain * (1.0 - a)]), np.array([1.0, -a])


def play(current_ma: np.ndarray, width_ma: float) -> np.ndarray:
    """The play operator: the output stays until the input has moved by the width."""
    out, state = np.empty_like(current_ma), current_ma[0]
    for k, current in enumerate(current_ma):
        state = min(max(state, current - 0.5 * width_ma), current + 0.5 * width_ma)
        out[k] = state
    return out


def up_and_down(rate_ma_per_s: float, low_ma: float = 300.0, high_ma: float = 1200.0) -> np.ndarray:
    up = np.linspace(low_ma, high_ma, round((high_ma - low_ma) / rate_ma_per_s / DT_S))
    return np.concatenate([np.full(100, low_ma), up, np.full(100, high_ma), up[::-1], np.full(100, low_ma)])
