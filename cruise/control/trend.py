"""The trend of what is measured: how fast gain and loads move the speed, so that a plan can meet them on time.

    rate = (x - m) / tau,   m_(k+1) = m_k + (T / tau) (x - m_k),   x = ln g and x = l
    believed: M + c^2 (x - M),   M a lag of x with 4 s

g gain without unit, l loads in m/s of steady speed, tau time over which the trend is seen in s, T frame in s: on a
ramp, x runs ahead of its lag m by tau times its slope. A dead time of half a second would cost 4 cm/s while the
throttle moves by 100 rpm/s. A jump, a gear that was changed, is no trend.

While the machine speeds up the engine dips, and some of the acceleration shows as slope: that goes as it came, and a
command which made up for it would act a dead time later, when it is over. c, 1 at rest and less while the drive moves
(`observer.py`), says how much of what has just come a plan may count on.
"""

import math

LASTS_S = 4.0  # s, after which what came while the drive moved has come to stay
JUMP = 0.1  # of ln g within a frame: a gear, nothing that goes on


class Trend:
    """`lags` are m, of the gain's logarithm and of the load in m/s; NaN before the first sample."""

    def __init__(self, time_s: float, frame_s: float) -> None:
        self.time_s = time_s
        self.lasting_share = 1.0 - math.exp(-frame_s / LASTS_S)
        self.share = 1.0 - math.exp(-frame_s / time_s)
        self.restart()

    def restart(self) -> None:
        """Nothing is known."""
        self.lags = [math.nan, math.nan]
        self.lasting = [math.nan, math.nan]
        self.rates = [0.0, 0.0]
        self.last = math.nan
        self.now = (math.nan, math.nan)

    def step(self, gain: float, load_mps: float) -> None:
        """One frame on."""
        log_gain = math.log(gain) if gain > 0.0 else math.nan
        if not abs(log_gain - self.last) < JUMP:
            self.lags = [log_gain, load_mps]
            self.lasting = [log_gain, load_mps]
        self.last = log_gain
        self.now = (log_gain, load_mps)
        for i, value in enumerate((log_gain, load_mps)):
            self.lasting[i] += self.lasting_share * (value - self.lasting[i])
            self.rates[i] = (value - self.lags[i]) / self.time_s
            self.lags[i] += self.share * (value - self.lags[i])

    def believed(self, calm: float) -> tuple[float, float]:
        """Gain and loads as a plan may count on them; `calm` is c."""
        log_gain, load_mps = (lag + calm**2 * (now - lag) for lag, now in zip(self.lasting, self.now, strict=True))
        return math.exp(log_gain), load_mps

    def rate_mps2(self, speed_mps: float) -> float:
        """At which rate in m/s2 of steady speed the machine is being moved by what is measured."""
        rate = self.rates[0] * speed_mps + self.rates[1]
        return rate if math.isfinite(rate) else 0.0
