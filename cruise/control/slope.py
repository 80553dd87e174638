"""The slope of the ground, from an inclinometer that takes the machine's own acceleration for slope.

    x = [v, a, S, R]'
    v' = a,   a' = noise,   S' = R,   R' = -R / tau + alpha_g noise
    measured: v + noise,   g_n sin(alpha) = S + r a + noise

v ground speed in m/s, a acceleration in m/s2, S pull of the slope in m/s2 and R its rate in m/s3, alpha pitch as the
sensor shows it, g_n = 9.81 m/s2, r share of the acceleration that the sensor takes for slope, tau time for which a
slope goes on changing, alpha_g pace by which the gear slows the drive, at most 1. Speed and pitch tell a and S apart by
themselves. The speed is the disturbance observer's of the frame before: it knows the commands, and what of a ripple it
does not believe is no slope either. A Kalman filter (filterpy) in its steady state, found once for each gear.

Where r = 1 the sensor feels the force of the drive: whatever the slope takes away, the machine loses in acceleration.
A slope shows once the drive has answered, 1 / alpha_g as late in a fast gear. Looked for as briskly there as in a slow
one, the noise of speed and pitch would be a slope of a tenth of a degree for seconds, and the machine, which keeps an
acceleration for 1 / alpha_g as long, would swing by 3 cm/s.
"""

import math
from typing import Final

import numpy as np
from filterpy.kalman import KalmanFilter

from cruise.control.steady_gain import steady_gain
from cruise.effects.effect import GRAVITY_MPS2

PITCH_NOISE_MPS2: Final = 0.020  # m/s2, 0.11 degrees: of one mean over a frame, on a shaking chassis
ACCEL_MPS2: Final = 1.5  # m/s2 after 1 s, how fast acceleration may come: the law allows 2 m/s3
RATE_MPS3: Final = 0.1  # m/s3 after 1 s, 0.6 degrees per second: with more the pitch's noise moves the spool
PACE_STEPS: Final = 20.0  # per factor e, of the pace: gears that differ by less share a filter
LASTING_S: Final = 0.7  # tau, 1 m at a usual speed: waves shorter than the wheelbase are straddled


class SlopeObserver:
    """`pull_mps2` is the pull of the slope; NaN before the first sample."""

    def __init__(self, acceleration_share: float, frame_s: float, speed_noise_mps: float) -> None:
        """`speed_noise_mps`: of one mean over a frame."""
        self.acceleration_share = acceleration_share
        self.frame_s = frame_s
        self.speed_noise_mps = speed_noise_mps
        self._filters: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self.restart()

    def restart(self) -> None:
        """Nothing is known."""
        self.state = np.full(4, math.nan)

    @property
    def pull_mps2(self) -> float:
        """S, in m/s2, + uphill."""
        return float(self.state[2])

    def step(self, pitch_deg: float, speed_mps: float, pace: float = 1.0) -> float:
        """One frame on: the slope in degrees, + uphill, for what sensor and speed show; `pace` is alpha_g."""
        seen_mps2 = GRAVITY_MPS2 * math.sin(math.radians(pitch_deg))
        if math.isnan(self.pull_mps2):
            self.state = np.array([speed_mps, 0.0, seen_mps2, 0.0])
        forward, gain = self._usual(pace)
        self.state = forward @ self.state + gain @ (speed_mps, seen_mps2)
        return math.degrees(math.asin(min(max(self.pull_mps2 / GRAVITY_MPS2, -1.0), 1.0)))

    def _usual(self, pace: float) -> tuple[np.ndarray, np.ndarray]:
        """The filter of a gear, made when it is met first."""
        key = round(PACE_STEPS * math.log(min(pace, 1.0)))
        found = self._filters.get(key)
        if found is None:
            found = self._filters[key] = self._filter(math.exp(key / PACE_STEPS))
        return found

    def _filter(self, pace: float) -> tuple[np.ndarray, np.ndarray]:
        """(I - K H) F and K."""
        lasts = math.exp(-self.frame_s / LASTING_S)
        found = KalmanFilter(dim_x=4, dim_z=2)
        found.F = np.array(
            [
                [1.0, self.frame_s, 0.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, LASTING_S * (1.0 - lasts)],
                [0.0, 0.0, 0.0, lasts],
            ]
        )
        found.H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, self.acceleration_share, 1.0, 0.0]])
        found.R = np.diag([self.speed_noise_mps, PITCH_NOISE_MPS2]) ** 2
        found.Q = np.diag([0.0, ACCEL_MPS2, 0.0, pace * RATE_MPS3]) ** 2 * self.frame_s
        gain = steady_gain(found)
        return (np.eye(4) - gain @ found.H) @ found.F, gain
