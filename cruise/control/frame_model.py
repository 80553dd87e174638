"""The learned model at the rate of the frames: the same machine, sampled more often.

    H(q) = B(q) / A(q),   kappa_1 = T (m_B - m_A),   kappa_2 = T^2 (s_B - s_A)
    m_P = sum_i i p_i / sum_i p_i,   s_P = sum_i i^2 p_i / sum_i p_i - m_P^2

Gain, mean delay kappa_1 in s and spread kappa_2 in s2 say how a response looks at low frequencies, ln H = ln H(0) - i
w kappa_1 - w^2 kappa_2 / 2 + O(w^3), whatever its period is: input and output are means over the same windows, which
cancel. A model that was learned at 5 Hz is driven with at 20 Hz by a physical core that has all three: the vehicle's
time constant from its slowest pole, the actuator's lag from the spread that is left, the rest is delay. Below 1 Hz,
where the commands are, the two models say the same. Source of the cumulants: A. Papoulis, The Fourier Integral and
its Applications, 1962, ch. 6.
"""

import math
from dataclasses import replace

import numpy as np

from cruise.effects.rate_limit import RateLimit
from cruise.model.core import Core
from cruise.model.model import Model

SHORTEST_S = 1e-3  # s, a time constant that is none
LONGEST_LAG_S = 1.0  # s, of an actuator; a spread beyond it is an error of the fit
LAGS = 1000  # between the two, among which the one with a spread is looked up


def cumulants_s(model: Model) -> tuple[float, float]:
    """Mean delay in s and spread in s2 of the response from drive to speed, in second gear."""
    a, b, *_ = model.split(model.theta)
    taps = np.array([0.0] * model.delay + list(b))
    mean, spread = _moments(taps)
    mean_a, spread_a = _moments(np.array([1.0, *(-value for value in a)]))
    return model.period_s * (mean - mean_a), model.period_s**2 * (spread - spread_a)


def slowest_pole(model: Model) -> float:
    """The slowest real pole of the model in second gear; 0 where it has none."""
    return max((pole.real for pole in model.poles if abs(pole.imag) < 1e-9 and pole.real > 0.0), default=0.0)


def core_of(model: Model, period_s: float) -> Core:
    """The physical core whose response, sampled every `period_s`, has gain, mean delay and spread of the model."""
    mean_s, spread_s2 = cumulants_s(model)
    slowest = slowest_pole(model)
    time_constant_s = -model.period_s / math.log(slowest) if slowest > 0.0 else SHORTEST_S
    vehicle = _pole_cumulants_s(time_constant_s, period_s)
    lag_s = _lag_with_spread(spread_s2 - vehicle[1], period_s)
    delay_s = mean_s - vehicle[0] - lag_s
    return Core(model.dc_gain_mps_per_ma, max(delay_s, 0.0), lag_s, time_constant_s)


def servo_of(model: Model) -> RateLimit:
    """The servo that the model knows beside its core: one that follows at once, where it knows none."""
    return next((effect for effect in model.effects if isinstance(effect, RateLimit)), RateLimit())


def at_period(model: Model, period_s: float) -> Model:
    """The model at another period: gain, mean delay, spread, loads and offset at rest are the same."""
    core = core_of(model, period_s)
    a, _, loads, c_0 = model.split(model.theta)
    rest = 1.0 - sum(a)
    pole = core.pole(period_s)
    delay, share = core.taps(period_s)
    b = (1.0 - pole) * core.gain_mps_per_ma * share
    moved = [(1.0 - pole) / rest * load for load in (*loads, c_0)]
    theta = (pole, *b.tolist(), *moved)
    return replace(model, period_s=period_s, na=1, nb=len(b), delay=delay, theta=theta, theta_std=())


def _moments(polynomial: np.ndarray) -> tuple[float, float]:
    places = np.arange(len(polynomial))
    total = float(polynomial.sum())
    mean = float(places @ polynomial) / total
    return mean, float(places**2 @ polynomial) / total - mean**2


def _pole_cumulants_s(time_constant_s: float, period_s: float) -> tuple[float, float]:
    """Mean delay in s and spread in s2 of y_k = q y_(k-1) + (1 - q) w_k: rho and rho (1 + rho) periods."""
    rho = 1.0 / math.expm1(period_s / max(time_constant_s, SHORTEST_S))
    return period_s * rho, period_s**2 * rho * (1.0 + rho)


def _lag_with_spread(spread_s2: float, period_s: float) -> float:
    """The lag in s whose means over a period have this spread, T^2 x (1 - x + 2 rho) with x = tau / T."""
    lags_s = np.linspace(SHORTEST_S, LONGEST_LAG_S, LAGS)
    x = lags_s / period_s
    return float(np.interp(spread_s2, period_s**2 * x * (1.0 - x + 2.0 / np.expm1(1.0 / x)), lags_s))
