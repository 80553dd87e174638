"""The gain in which a Kalman filter (filterpy) comes to rest, so that a frame costs two products only."""

from typing import Final

import numpy as np
from filterpy.kalman import KalmanFilter

SETTLED: Final = 1e-7  # change of the gain at which it has converged
MOST_STEPS: Final = 2000


def steady_gain(found: KalmanFilter) -> np.ndarray:
    """K (states, measurements) of a filter with constant F, H, Q and R; it is stepped until K stands still."""
    gain = np.zeros((found.dim_x, found.dim_z))
    for _ in range(MOST_STEPS):
        found.predict()
        found.update(np.zeros(found.dim_z))
        if np.abs(found.K - gain).max() < SETTLED:
            break
        gain = found.K
    return found.K
