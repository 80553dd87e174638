"""The filter for learning: on finished regressor columns and target alike, never on what the controller uses.

    low = B(q) x,   band = low - m,   m_(k+1) = m_k + (T / tau) (low_k - m_k)

B Butterworth low-pass (the model is valid up to 1 Hz, Coen et al. 2005, section II.B), tau time constant of the
running mean m that band leaves out, T period. Filtering x and y of a linear regression alike leaves its parameters
(Ljung 1999, section 7.2); it doesn't commute with the command effects, hence the finished columns.
"""

import math

import numpy as np


class LearningFilter:
    """Low-pass of order 2 and band-pass of a row of m values at once; `memory` (order + 1, m) is all its state."""

    def __init__(self, width: int, period_s: float, cutoff_hz: float, mean_s: float) -> None:
        nyquist_hz = 0.5 / period_s
        if cutoff_hz < nyquist_hz:
            order, a, b, c, d = 2, *_butterworth(cutoff_hz / nyquist_hz)
        else:  # a slow recording carries nothing above the cut-off anyway
            order, a, b, c, d = 0, np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
        low = np.hstack([d, c, np.zeros((1, 1))])
        band = low - np.eye(1, order + 2, order + 1)
        inner = np.hstack([b, a, np.zeros((order, 1))])
        mean = np.eye(1, order + 2, order + 1) + min(period_s / mean_s, 1.0) * band
        self._step = np.vstack([low, band, inner, mean])
        self._settled = np.vstack([np.linalg.solve(np.eye(order) - a, b), np.ones((1, 1))])
        self._now = np.zeros((order + 2, width))  # the row given and the memory before it
        self.memory = self._now[1:]

    def settle(self, row: np.ndarray) -> None:
        """Set the memory as if `row` (m,) had been there forever."""
        self.memory[:] = self._settled * row

    def __call__(self, row: np.ndarray) -> np.ndarray:
        """One row (m,) on: returns (2, m), low-passed and band-passed."""
        self._now[0] = row
        result = self._step.dot(self._now)
        self.memory[:] = result[2:]
        return result[:2]


def _butterworth(share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a, b, c, d of the low-pass of order 2 with its cut-off at `share` of the Nyquist frequency.

    H(p) = 1 / (p^2 + sqrt(2) p + 1) under p = (1/w) (q - 1) / (q + 1), w = tan(pi share / 2). Written out, and held
    equal to scipy's by a test: scipy.signal takes as long to load as all the rest of the service.
    """
    w = math.tan(0.5 * math.pi * share)
    scale = 1.0 / (1.0 + math.sqrt(2.0) * w + w * w)
    a_1, a_2 = 2.0 * (w * w - 1.0) * scale, (1.0 - math.sqrt(2.0) * w + w * w) * scale
    d = w * w * scale
    c = d * np.array([[2.0 - a_1, 1.0 - a_2]])
    return np.array([[-a_1, -a_2], [1.0, 0.0]]), np.array([[1.0], [0.0]]), c, np.array([[d]])
