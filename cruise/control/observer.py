"""The disturbance observer: what the model doesn't explain, as one slowly moving number.

    x_k = [y_k, y_(k-1) .., d_k]
    y_(k+1) = sum_i a_i y_(k+1-i) + w_k + d_k,    d_(k+1) = d_k + noise,    measured: y_k + noise

w known part (drive and offset) of the model's next speed in m/s, d disturbance in m/s per sample. A Kalman filter
(filterpy); with d in the prediction the controller has no steady-state error (Muske and Badgwell, "Disturbance
modeling for offset-free linear model predictive control", J. Process Control 12 (2002)).
"""

import msgspec
import numpy as np
from filterpy.kalman import KalmanFilter

from cruise.model.model import DriveResponse
from cruise.settings import Positive


class ObserverSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the observer trusts sensor and model, as standard deviations per second."""

    speed_noise_mps: Positive = 0.006  # m/s, of one mean over a model period
    model_noise_mps: Positive = 0.010  # m/s after 1 s, random part of the model's error
    disturbance_mps: Positive = 0.10  # m/s per sample after 1 s, how fast hills and soil may come


class DisturbanceObserver:
    """Kalman filter on speeds and disturbance; `speed_mps` and `disturbance_mps` are its estimate."""

    def __init__(self, order: int, period_s: float, settings: ObserverSettings) -> None:
        self.order = max(order, 1)
        size = self.order + 1
        self.filter = KalmanFilter(dim_x=size, dim_z=1, dim_u=1)
        self.filter.H = np.eye(1, size)
        self.filter.R *= settings.speed_noise_mps**2
        self.input = np.eye(size, 1)
        self.filter.Q = np.zeros((size, size))
        self.filter.Q[0, 0] = settings.model_noise_mps**2 * period_s
        self.filter.Q[-1, -1] = settings.disturbance_mps**2 * period_s
        self.settings = settings

    def reset(self, speed_mps: float) -> None:
        """Begin at a measured speed, with no disturbance known."""
        self.filter.x = np.full((self.order + 1, 1), speed_mps)
        self.filter.x[-1] = 0.0
        self.filter.P = np.diag([self.settings.speed_noise_mps**2] * self.order + [0.05**2])

    def step(self, response: DriveResponse, known_mps: float, speed_mps: float) -> None:
        """One sample on: predict with the model and what is known of it, correct with the measured speed."""
        transition = np.zeros((self.order + 1, self.order + 1))
        transition[0, : len(response.speed_coefficients)] = response.speed_coefficients
        transition[0, -1] = 1.0
        transition[range(1, self.order), range(self.order - 1)] = 1.0
        transition[-1, -1] = 1.0
        self.filter.F = transition
        self.filter.predict(u=np.array([[known_mps]]), B=self.input)
        self.filter.update(np.array([[speed_mps]]))

    def shift(self, disturbance_mps: float) -> None:
        """Move the disturbance by what a change of the model explains differently, so that the change makes no bump."""
        self.filter.x[-1, 0] += disturbance_mps

    @property
    def speeds_mps(self) -> tuple[float, ...]:
        """Filtered y_k, y_(k-1) ..."""
        return tuple(float(value) for value in self.filter.x[:-1, 0])

    @property
    def disturbance_mps(self) -> float:
        """Estimate of d_k."""
        return float(self.filter.x[-1, 0])
