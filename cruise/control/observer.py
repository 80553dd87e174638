"""The disturbance observer: what the model doesn't explain, as one slowly moving number.

    x_k = [y_k, d_k]'
    y_(k+1) = A y_k + (1 - A) (s_k + d_k) + noise,    d_(k+1) = d_k + noise,    measured: y_k + noise

y speed in m/s, A pole of the vehicle over a frame, s steady speed in m/s that drive and loads give by the model, d
disturbance in m/s of steady speed. A Kalman filter (filterpy) in its steady state: its gain is found once for each A.
With d in the prediction the controller has no steady-state error (Muske and Badgwell, "Disturbance modeling for
offset-free linear model predictive control", J. Process Control 12 (2002)).
"""

import msgspec
import numpy as np
from filterpy.kalman import KalmanFilter

from cruise.settings import Positive

SETTLED = 1e-7  # relative change of the gain at which it has converged
MOST_STEPS = 2000


class ObserverSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the observer trusts sensor and model."""

    speed_noise_mps: Positive = 0.010  # m/s, of one mean over a frame
    model_noise_mps: Positive = 0.15  # m/s after 1 s, what the model errs by while the speed changes
    disturbance_mps: Positive = 0.07  # m/s after 1 s, how fast hills and soil may come


class DisturbanceObserver:
    """`speed_mps` and `disturbance_mps` are all its state; `innovation_mps` is what the last frame did not fit by."""

    def __init__(self, frame_s: float, settings: ObserverSettings) -> None:
        self.frame_s = frame_s
        self.settings = settings
        self.speed_mps = 0.0
        self.disturbance_mps = 0.0
        self.innovation_mps = 0.0
        self._gains: dict[float, tuple[float, float]] = {}
        self._keep()

    def reset(self, speed_mps: float) -> None:
        """Begin at a measured speed, with no disturbance known."""
        self.speed_mps, self.disturbance_mps, self.innovation_mps = speed_mps, 0.0, 0.0
        self._keep()

    @property
    def upset(self) -> bool:
        """Whether the state is no longer what was kept of it: nothing in the program did that."""
        return self._kept != (self.speed_mps, self.disturbance_mps)

    def step(self, pole: float, steady_mps: float, speed_mps: float) -> float:
        """One frame on: predict with the model, correct with the measured speed; returns the innovation in m/s.

        A state that was upset stays so.
        """
        upset = self.upset
        gains = self._gains.get(pole)
        if gains is None:
            gains = self._gains[pole] = self.gains(pole)
        expected_mps = pole * self.speed_mps + (1.0 - pole) * (steady_mps + self.disturbance_mps)
        self.innovation_mps = speed_mps - expected_mps
        self.speed_mps = expected_mps + gains[0] * self.innovation_mps
        self.disturbance_mps += gains[1] * self.innovation_mps
        if not upset:
            self._keep()
        return self.innovation_mps

    def gains(self, pole: float) -> tuple[float, float]:
        """The steady Kalman gain for speed and disturbance."""
        settings, found = self.settings, KalmanFilter(dim_x=2, dim_z=1)
        found.F = np.array([[pole, 1.0 - pole], [0.0, 1.0]])
        found.H = np.array([[1.0, 0.0]])
        found.R *= settings.speed_noise_mps**2
        found.Q = np.diag([settings.model_noise_mps**2, settings.disturbance_mps**2]) * self.frame_s
        gain = np.zeros((2, 1))
        for _ in range(MOST_STEPS):
            found.predict()
            found.update(np.zeros((1, 1)))
            if np.abs(found.K - gain).max() < SETTLED:
                break
            gain = found.K
        return float(found.K[0, 0]), float(found.K[1, 0])

    def shift(self, disturbance_mps: float) -> None:
        """Move the disturbance by what a change of the model explains differently, so that the change makes no bump."""
        upset = self.upset
        self.disturbance_mps += disturbance_mps
        if not upset:
            self._keep()

    def _keep(self) -> None:
        """Note the state a second time, as IEC 61508 asks for what safety depends on."""
        self._kept = (self.speed_mps, self.disturbance_mps)
