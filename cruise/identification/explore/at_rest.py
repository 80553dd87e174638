"""Level and lag of a measured frequency response at frequency 0, by the low-order drive that follows it.

    H(s) = K exp(-s T) / ((1 + tau s) (1 + 2 zeta s / w + s^2 / w^2)),    L = log K,    lag = T + tau + 2 zeta / w

K gain [m/s per mA], T dead time that is left after the alignment [s], tau a lag [s], w natural frequency [rad/s], zeta
damping [-]. A slow drive's gain and phase are curved at the lowest frequencies that a window resolves, so that the mean
gain and the slope of the phase there are neither the level nor the lag of slow changes: for one lag of 0.5 s behind
windows of 20 s they are 6 % and 0.06 s too small. Fitted as complex numbers, so that no phase has to be
unwrapped; bins above twice the fitted drive's own cut-off are left out, where other dynamics rule.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, section 9.2
(weighted least squares of a rational function on a measured response, and its covariance).
"""

import math
from typing import Final

import numpy as np
from scipy import optimize

from cruise.identification.explore.pieces import Estimate
from cruise.sampling import FloatArray

STARTS_HZ: Final = (0.1, 0.3, 1.0)  # cut-offs that the search begins from
BAND: Final = 2.0  # times the cut-off of what was fitted: up to there a drive of third order describes it
FEWEST: Final = 6  # bins for five parameters: each has a gain and a phase
LEAST_STD: Final = 0.01  # relative: what a drive of third order is, at best
BOUNDS: Final = (
    (-math.inf, -3.0, math.log(0.005), math.log(0.2), math.log(0.1)),
    (math.inf, 3.0, math.log(20.0), math.log(300.0), math.log(5.0)),
)


def at_rest(
    frequency_hz: FloatArray, response: np.ndarray, std: FloatArray, correlated: float
) -> tuple[Estimate, Estimate] | None:
    """Log of the gain, and the lag in s, at frequency 0; None where the bins are too few or no fit is found.

    `response` (M,) complex, its sign so that the gain is positive; `std` (M,) of it, relative; `correlated` is the
    variance of a mean over neighbouring bins, times their number, over that of one.
    """
    scale = np.abs(response) * np.maximum(std, LEAST_STD)
    use = np.ones(len(frequency_hz), dtype=bool)
    best = None
    for _ in range(3):
        if use.sum() < FEWEST:
            return None
        starts = [best.x] if best is not None else [_start(response, hz) for hz in STARTS_HZ]
        found = [
            optimize.least_squares(_misfit, start, bounds=BOUNDS, args=(frequency_hz, response, scale, use))
            for start in starts
        ]
        best = min(found, key=lambda one: one.cost)
        use = frequency_hz <= max(BAND * _cutoff_hz(best.x), frequency_hz[FEWEST - 1])
    assert best is not None
    return _estimates(best, correlated)


def _start(response: np.ndarray, cutoff_hz: float) -> FloatArray:
    omega = 2.0 * math.pi * cutoff_hz
    return np.array([math.log(abs(response[0])), 0.0, -math.log(omega), math.log(5.0 * omega), 0.0])


def _drive(p: FloatArray, frequency_hz: FloatArray) -> np.ndarray:
    log_gain, dead_s, log_tau, log_w, log_zeta = p
    s = 2j * math.pi * frequency_hz
    ratio = s * math.exp(-log_w)
    return np.exp(log_gain - s * dead_s) / (
        (1.0 + s * math.exp(log_tau)) * (1.0 + 2.0 * math.exp(log_zeta) * ratio + ratio**2)
    )


def _misfit(
    p: FloatArray, frequency_hz: FloatArray, response: np.ndarray, scale: FloatArray, use: np.ndarray
) -> FloatArray:
    left = (response[use] - _drive(p, frequency_hz[use])) / scale[use]
    return np.concatenate([left.real, left.imag])


def _cutoff_hz(p: FloatArray) -> float:
    frequency_hz = np.geomspace(1e-3, 50.0, 400)
    gain = np.abs(_drive(p, frequency_hz)) / math.exp(p[0])
    return float(frequency_hz[-1 if np.all(gain >= math.sqrt(0.5)) else np.argmax(gain < math.sqrt(0.5))])


def _estimates(found: optimize.OptimizeResult, correlated: float) -> tuple[Estimate, Estimate]:
    log_gain, dead_s, log_tau, log_w, log_zeta = found.x
    tau_s, ring_s = math.exp(log_tau), 2.0 * math.exp(log_zeta - log_w)
    freedom = max(len(found.fun) - len(found.x), 1)
    spread = correlated * max(2.0 * found.cost / freedom, 1.0)
    covariance = spread * np.linalg.pinv(found.jac.T @ found.jac)
    slope = np.array([0.0, 1.0, tau_s, -ring_s, ring_s])
    return (
        Estimate(float(log_gain), math.sqrt(covariance[0, 0])),
        Estimate(float(dead_s) + tau_s + ring_s, math.sqrt(slope @ covariance @ slope)),
    )
