"""The disturbance observer: what the model doesn't explain, as one slowly moving number, and how fast the drive is now.

    x_k = [y_k, d_k]'
    y_(k+1) = y_k + p_k (1 - A) (s_k + d_k - y_k) + noise,   d_(k+1) = d_k + sqrt(alpha) noise,   measured: y_k + noise
    d_k = d_(k|k-1) + K_d e_k / (1 + (s'_k / R)^2)
    ln p_(k+1) = exp(-T / tau) ln p_k + noise,   standard deviation of ln p where nothing is known: kappa |ln alpha|

y speed in m/s, A pole of the vehicle over a frame and alpha the pace by which a gear slows it down, s steady speed in
m/s that drive and loads give by the model, d disturbance in m/s of steady speed, e innovation. A Kalman filter
(filterpy) in its steady state: its gain is found once for each gear. While s changes at a rate s', a model that answers
some hundredths of a second too early or late, or with a pole that is wrong, errs by that rate times its error in time:
what doesn't fit is then no disturbance, and would be an overshoot if it were taken for one. With d in the prediction
the controller has no steady-state error (Muske and Badgwell, "Disturbance modeling for offset-free linear model
predictive control", J. Process Control 12 (2002)).

p is the pace of the drive over the one that equation 12 gives the gear. The time constant of a hydrostatic drive is the
mass times its compliance, leakage and a pump that the pressure destrokes: i^2 (a + b stroke) in a gear of ratio i,
where the equation has i^2 alone. So p is 1 where the model was learned, alpha = 1, and known the less the more a gear
slows the drive. It shows wherever the speed is on its way to where the drive leads; at rest it does not, and the filter
is the linear one. A second stage beside the filter: x moves by what another p would have moved it by (B. Friedland,
"Treatment of bias in recursive filtering", IEEE TAC 14 (1969)).
"""

import math

import msgspec
import numpy as np
from filterpy.kalman import KalmanFilter

from cruise.control.steady_gain import steady_gain
from cruise.settings import Positive


class ObserverSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the observer trusts sensor and model."""

    speed_noise_mps: Positive = 0.010  # m/s, of one mean over a frame
    model_noise_mps: Positive = 0.15  # m/s after 1 s, what the model errs by while the speed changes
    disturbance_mps: Positive = 0.10  # m/s after 1 s, how fast hills and soil may come
    brisk_mps2: Positive = 0.4  # R, m/s2: at this rate of s half of an innovation is believed; hills stay below it
    brisk_s: Positive = 0.5  # s over which the rate is seen
    pace_share: Positive = 0.25  # kappa: fourth gear is slowed to a seventh, give or take a factor of 1.6
    pace_s: Positive = 5.0  # tau, s: a stroke is kept for about as long


class DisturbanceObserver:
    """`speed_mps`, `disturbance_mps`, `steady_mps`, `log_pace` with its variance and `moved` are all its state.

    `innovation_mps` is what the last frame did not fit by.
    """

    def __init__(self, frame_s: float, settings: ObserverSettings) -> None:
        self.frame_s = frame_s
        self.settings = settings
        self.calm = 1.0  # share of what is seen that the drive has not moved itself
        self._rate_share = -math.expm1(-frame_s / settings.brisk_s)
        self._kept_share = math.exp(-frame_s / settings.pace_s)
        self._gains: dict[tuple[float, float], tuple[float, float]] = {}
        self.reset(0.0)

    def reset(self, speed_mps: float) -> None:
        """Begin at a measured speed, with nothing known beside it."""
        self.speed_mps, self.disturbance_mps, self.innovation_mps = speed_mps, 0.0, 0.0
        self.steady_mps = math.nan  # s through a lag of brisk_s
        self.log_pace, self.log_pace_variance = 0.0, 0.0
        self.moved = (0.0, 0.0)  # speed and disturbance for a change of ln p
        self._keep()

    @property
    def upset(self) -> bool:
        """Whether the state is no longer what was kept of it: nothing in the program did that."""
        return self._kept != self._state()

    def pole(self, pole: float) -> float:
        """That of the drive as it is now, for the one that the model gives the gear."""
        return 1.0 - min(math.exp(self.log_pace) * (1.0 - pole), 1.0)

    def step(self, pole: float, steady_mps: float, speed_mps: float, pace: float = 1.0) -> float:
        """One frame on: predict with the model, correct with the measured speed; returns the innovation in m/s.

        A state that was upset stays so.
        """
        upset = self.upset
        gains = self._gains.get((pole, pace))
        if gains is None:
            gains = self._gains[pole, pace] = self.gains(pole, pace)
        share = 1.0 - self.pole(pole)
        ahead_mps = share * (steady_mps + self.disturbance_mps - self.speed_mps)
        by_speed, by_disturbance = self.moved
        by_speed += ahead_mps + share * (by_disturbance - by_speed)
        expected_mps = self.speed_mps + ahead_mps
        self.innovation_mps = speed_mps - expected_mps
        self.calm = 1.0 / (1.0 + (self._rate_mps2(steady_mps) / self.settings.brisk_mps2) ** 2)
        to_speed, to_disturbance = gains[0], gains[1] * self.calm
        self.moved = by_speed - to_speed * by_speed, by_disturbance - to_disturbance * by_speed
        more = self._learn(by_speed, self.settings.speed_noise_mps**2 / (1.0 - to_speed), pace)
        self.speed_mps = expected_mps + to_speed * self.innovation_mps + self.moved[0] * more
        self.disturbance_mps += to_disturbance * self.innovation_mps + self.moved[1] * more
        if not upset:
            self._keep()
        return self.innovation_mps

    def _learn(self, by_speed: float, variance_mps2: float, pace: float) -> float:
        """By how much ln p moves for the innovation, of this variance where p is known."""
        std = self.settings.pace_share * abs(math.log(pace))
        kept = self._kept_share
        variance = kept**2 * self.log_pace_variance + (1.0 - kept**2) * std**2
        gain = variance * by_speed / (variance_mps2 + variance * by_speed**2)
        before = kept * self.log_pace
        self.log_pace = min(max(before + gain * self.innovation_mps, -2.0 * std), 2.0 * std)
        self.log_pace_variance = variance * (1.0 - gain * by_speed)
        return self.log_pace - before

    def _rate_mps2(self, steady_mps: float) -> float:
        """How fast drive and loads move the steady speed, through a lag."""
        if math.isnan(self.steady_mps):
            self.steady_mps = steady_mps
        ahead_mps = steady_mps - self.steady_mps
        self.steady_mps += self._rate_share * ahead_mps
        return ahead_mps / self.settings.brisk_s

    def gains(self, pole: float, pace: float = 1.0) -> tuple[float, float]:
        """The steady Kalman gain for speed and disturbance."""
        settings, found = self.settings, KalmanFilter(dim_x=2, dim_z=1)
        found.F = np.array([[pole, 1.0 - pole], [0.0, 1.0]])
        found.H = np.array([[1.0, 0.0]])
        found.R *= settings.speed_noise_mps**2
        found.Q = np.diag([settings.model_noise_mps, math.sqrt(pace) * settings.disturbance_mps]) ** 2 * self.frame_s
        speed, disturbance = steady_gain(found)[:, 0].tolist()
        return speed, disturbance

    def shift(self, disturbance_mps: float) -> None:
        """Move the disturbance by what a change of the model explains differently, so that the change makes no bump."""
        upset = self.upset
        self.disturbance_mps += disturbance_mps
        self.steady_mps -= disturbance_mps
        if not upset:
            self._keep()

    def _state(self) -> tuple[float, float, float]:
        return self.speed_mps, self.disturbance_mps, self.log_pace

    def _keep(self) -> None:
        """Note the state a second time, as IEC 61508 asks for what safety depends on."""
        self._kept = self._state()
