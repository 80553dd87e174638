"""The trend of what is measured: how fast gain and loads move the speed, so that a plan can meet them on time.

    rate = (x - m) / tau,   m_(k+1) = m_k + (T / tau) (x - m_k),   x = ln g and x = l
    believed: x - (1 - c^2) e,   c rate + (1 - c) (1 - e / (x - M)) rate,   e = min(x - M, D)

g gain without unit, l loads in m/s of steady speed, tau time over which the trend is seen in s, T frame in s: on a
ramp, x runs ahead of its lag m by tau times its slope. A dead time of half a second would cost 4 cm/s while the
throttle moves by 100 rpm/s. A jump, a gear that was changed, is no trend.

While the machine speeds up the engine dips, and some of the acceleration shows as slope: that goes as it came, and a
command which made up for it would act a dead time later, when it is over. c, 1 at rest and less while the drive moves
(`observer.py`), says how much of what has just come a plan may count on; M is a lag of x with 4 s. What raises the gain
by more than D is no engine that comes back from a dip: a throttle was pushed, and a plan that did not believe it would
wait for the machine to slow down by itself. What lowers it by more may be a drum that plugs, and come back at once.
"""

import math

LASTS_S = 4.0  # s, after which what came while the drive moved has come to stay
JUMP = 0.1  # of ln g within a frame: a gear, nothing that goes on
MOST = (0.05, math.inf)  # D: governors let an engine dip by 0 to 5 %; a slope may be all acceleration


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
        log_gain, load_mps = (
            now - (1.0 - calm**2) * doubted for now, doubted in zip(self.now, self._doubted(), strict=True)
        )
        return math.exp(log_gain), load_mps

    def rate_mps2(self, speed_mps: float, calm: float = 1.0) -> float:
        """At which rate in m/s2 of steady speed the machine is being moved by what is measured, as far as believed."""
        gain_rate, load_rate = (
            rate * (1.0 - (1.0 - calm) * (doubted / (now - lag) if now != lag else 1.0))
            for rate, doubted, now, lag in zip(self.rates, self._doubted(), self.now, self.lasting, strict=True)
        )
        rate = gain_rate * speed_mps + load_rate
        return rate if math.isfinite(rate) else 0.0

    def _doubted(self) -> tuple[float, ...]:
        """e, what of gain and load may go as it came."""
        return tuple(min(now - lag, most) for now, lag, most in zip(self.now, self.lasting, MOST, strict=True))
