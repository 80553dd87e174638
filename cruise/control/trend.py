"""The trend of what is measured: how fast gain and loads move the speed, so that a plan can meet them on time.

    rate = (x - m) / tau,   m_(k+1) = m_k + (T / tau) (x - m_k),   x = ln g and x = l

g gain without unit, l loads in m/s of steady speed, tau time over which the trend is seen in s, T frame in s: on a
ramp, x runs ahead of its lag m by tau times its slope. A dead time of half a second would cost 4 cm/s while the
throttle moves by 100 rpm/s. A jump, a gear that was changed, is no trend.
"""

import math

JUMP = 0.1  # of ln g within a frame: a gear, nothing that goes on


class Trend:
    """`gain` and `load_mps` are the lags m; NaN before the first sample."""

    def __init__(self, time_s: float, frame_s: float) -> None:
        self.time_s = time_s
        self.share = 1.0 - math.exp(-frame_s / time_s)
        self.restart()

    def restart(self) -> None:
        """Nothing is known."""
        self.lags = [math.nan, math.nan]
        self.rates = [0.0, 0.0]
        self.last = math.nan

    def step(self, gain: float, load_mps: float) -> None:
        """One frame on."""
        log_gain = math.log(gain) if gain > 0.0 else math.nan
        if not abs(log_gain - self.last) < JUMP:
            self.lags = [log_gain, load_mps]
        self.last = log_gain
        for i, value in enumerate((log_gain, load_mps)):
            self.rates[i] = (value - self.lags[i]) / self.time_s
            self.lags[i] += self.share * (value - self.lags[i])

    def rate_mps2(self, speed_mps: float) -> float:
        """At which rate in m/s2 of steady speed the machine is being moved by what is measured."""
        rate = self.rates[0] * speed_mps + self.rates[1]
        return rate if math.isfinite(rate) else 0.0
