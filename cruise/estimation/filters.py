"""The filter for learning: on finished regressor columns and target alike, never on what the controller uses.

    low = B(q) x,   band = low - m,   m_(k+1) = m_k + (T / tau) (low_k - m_k)

B Butterworth low-pass (the model is valid up to 1 Hz, Coen et al. 2005, section II.B), tau time constant of the
running mean m that band leaves out, T period. Filtering x and y of a linear regression alike leaves its parameters
(Ljung 1999, section 7.2); it doesn't commute with the command effects, hence the finished columns.
"""

from typing import cast

import numpy as np
from scipy import signal


class LearningFilter:
    """Low-pass and band-pass of a row of m values at once; `memory` (order + 1, m) is all its state."""

    def __init__(self, width: int, period_s: float, cutoff_hz: float, mean_s: float, order: int = 2) -> None:
        nyquist_hz = 0.5 / period_s
        if cutoff_hz < nyquist_hz:
            a, b, c, d = signal.tf2ss(*cast("tuple", signal.butter(order, cutoff_hz / nyquist_hz)))
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
