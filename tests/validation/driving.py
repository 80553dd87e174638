"""A short drive by numbers of one's own, without the code under test: delay, two lags, vehicle, what is hidden.

    w_1' = (f(u(t - T_d)) - w_1) / tau_1 ,   w_2' = (w_1 - w_2) / tau_2 ,   T_v v' = K g(t) w_2 + l(t) + c_0 - v

Where a pair is given, w_2 passes it: w_3'' = omega^2 (w_2 - w_3) - 2 zeta omega w_3'.

u current in mA that is held over every sample, v speed in m/s at the end of a sample, y = v + white noise. Each lag is
exact over steps of 10 ms at whose ends its input is known.
"""

from collections.abc import Callable, Mapping

import numpy as np
from scipy import signal

from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT

FINE_S = 0.01
DELAY_S, LAG_S, SECOND_LAG_S, VEHICLE_S = 0.3, 0.15, 0.05, 0.6
GAIN, OFFSET_MPS = 2.5e-3, 0.1  # m/s per mA, m/s
GRAVITY_MPS2 = 9.81


def levels(samples: int, dt_s: float, seed: int, low_ma: float = 250.0, high_ma: float = 900.0) -> np.ndarray:
    """Random currents, each held 1 to 6 s."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(round(1.0 / dt_s), round(6.0 / dt_s), samples)
    return np.repeat(rng.uniform(low_ma, high_ma, samples), lengths)[:samples]


def wander(samples: int, dt_s: float, seed: int, std: float, time_constant_s: float) -> np.ndarray:
    """A process of second order with this standard deviation: no faster than a hill or a thermometer."""
    pole = np.exp(-dt_s / time_constant_s)
    white = np.random.default_rng(9000 + seed).standard_normal(samples + round(20 * time_constant_s / dt_s))
    smooth = np.asarray(signal.lfilter([1.0], [1.0, -2.0 * pole, pole**2], white))[-samples:]
    return std * (smooth - smooth.mean()) / smooth.std()


def lagged(values: np.ndarray, time_constant_s: float) -> np.ndarray:
    """The exact lag of values that are held over FINE_S, at rest before."""
    rest = np.exp(-FINE_S / time_constant_s)
    return np.asarray(signal.lfilter([1.0 - rest], [1.0, -rest], values, zi=[rest * values[0]])[0])


def through_pair(values: np.ndarray, frequency_hz: float, damping: float) -> np.ndarray:
    """What a pair of poles makes of values that are held over FINE_S, at rest before; stepped by Euler."""
    omega, place, rate, places = 2.0 * np.pi * frequency_hz, float(values[0]), 0.0, []
    for value in values.tolist():
        rate += FINE_S * (omega**2 * (value - place) - 2.0 * damping * omega * rate)
        place += FINE_S * rate
        places.append(place)
    return np.array(places)


def drive(
    seconds: float = 160.0,
    seed: int = 0,
    dt_s: float = 0.1,
    noise_mps: float = 0.02,
    command: Callable[[np.ndarray], np.ndarray] = lambda current_ma: current_ma,
    gain: np.ndarray | float = 1.0,
    load_mps: np.ndarray | float = 0.0,
    columns: Mapping[str, np.ndarray] | None = None,
    source: str = "drive.csv",
    pair: tuple[float, float] | None = None,
    vehicle_s: float = VEHICLE_S,
    current_ma: np.ndarray | None = None,
) -> Recording:
    """A recording; `gain` and `load_mps` (N,) are g and l of every sample, `columns` what else was recorded.

    `current_ma` (N,) are random levels where none are given. `pair` are frequency in Hz and damping of two more poles,
    `vehicle_s` is T_v.
    """
    samples = round(seconds / dt_s)
    each = round(dt_s / FINE_S)
    current = levels(samples, dt_s, seed) if current_ma is None else current_ma
    asked = np.repeat(command(current), each)
    late = np.concatenate([np.full(round(DELAY_S / FINE_S), asked[0]), asked])[: len(asked)]
    felt = lagged(lagged(late, LAG_S), SECOND_LAG_S)
    if pair is not None:
        felt = through_pair(felt, *pair)
    force = GAIN * np.repeat(np.broadcast_to(gain, samples), each) * felt
    force = force + np.repeat(np.broadcast_to(load_mps, samples), each) + OFFSET_MPS
    speed = lagged(force, vehicle_s)[each - 1 :: each]
    noise = noise_mps * np.random.default_rng(500 + seed).standard_normal(samples)
    held = {INPUT: current, OUTPUT: speed + noise, **(columns or {})}
    return Recording(dt_s * np.arange(1, samples + 1), held, dt_s, source)
