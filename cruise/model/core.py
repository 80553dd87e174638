"""The drive's linear core in physical terms, and the discrete parameters that follow from it.

    w(t) = [S(t) v](t - T_d),   S a lag of tau        T_v dy/dt = K g w + sum_m c_m phi_m + c_0 - y

v drive signal f(u) in mA, T_d delay in s, tau lag of the actuator in s, T_v time constant of the vehicle in s (its
inertia over the stiffness of the drive, viscous friction included), K gain in m/s per mA, c_m and c_0 what loads and
rolling friction take, in m/s at rest. Over samples of T, which are means over one period,

    y_k = a y_(k-1) + (1 - a) [ K g sum_j h_j v_(k-j) + sum_m c_m phi_m + c_0 ],   a = exp(-T / T_v)
    h_j = [ G(t_(j+1)) - 2 G(t_j) + G(t_(j-1)) ] / T,   G(t) = t' - tau (1 - exp(-t' / tau)),  t' = max(t - T_d, 0)

A resonance of the drive train, where there is one, stands in series with the lag: v passes with the share 1 - s as it
is and with the share s through omega^2 / (p^2 + 2 zeta omega p + omega^2), and h_j is convolved with its response.

h_j is the share of the lagged and delayed drive that falls on sample j, means taken on both sides: sum h_j = 1,
T sum j h_j = T_d + tau. Source: K. J. Astrom, B. Wittenmark, Computer-Controlled Systems, 3rd ed. 1997, section 2.3.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.effects import Effect
from cruise.model.model import Model

TAIL: Final = 0.005  # share of the response that the last taps may leave out


@dataclass(frozen=True, slots=True)
class Core:
    """Gain, delay, lag and time constant of the drive; a resonance where its share is not zero."""

    gain_mps_per_ma: float
    delay_s: float
    lag_s: float
    time_constant_s: float
    resonance_share: float = 0.0
    resonance_hz: float = 1.0
    damping: float = 0.3

    def pole(self, period_s: float) -> float:
        """a = exp(-T / T_v)."""
        return math.exp(-period_s / self.time_constant_s)

    def response(self, period_s: float, count: int) -> np.ndarray:
        """h_0 .. h_(count-1), shape (count,), without unit; what lies beyond the last is left out."""
        after_s = np.maximum(np.arange(-1, count + 1) * period_s - self.delay_s, 0.0)
        area_s = after_s + self.lag_s * np.expm1(-after_s / self.lag_s)
        share = np.diff(area_s, 2) / period_s
        if self.resonance_share == 0.0:
            return share
        ringing = self._ringing(period_s, count)
        return (1.0 - self.resonance_share) * share + self.resonance_share * np.convolve(share, ringing)[:count]

    def _ringing(self, period_s: float, count: int) -> np.ndarray:
        """Response of the resonance to one sample of drive, held over a period: differences of its step response."""
        omega = 2.0 * math.pi * self.resonance_hz
        damped = omega * math.sqrt(1.0 - self.damping**2)
        t_s = np.arange(count + 1) * period_s
        swing = np.cos(damped * t_s) + self.damping * omega / damped * np.sin(damped * t_s)
        return np.diff(1.0 - np.exp(-self.damping * omega * t_s) * swing)

    @property
    def memory_s(self) -> float:
        """How far back the drive matters to what the vehicle feels now: all but TAIL of the response."""
        ringing_s = 1.0 / (2.0 * math.pi * self.resonance_hz * self.damping) if self.resonance_share else 0.0
        return self.delay_s + max(self.lag_s, ringing_s) * math.log(1.0 / TAIL)

    def taps(self, period_s: float) -> tuple[int, np.ndarray]:
        """The delay in samples and the h_j from there on (nb,) that matter, scaled to a sum of 1."""
        share = self.response(period_s, math.ceil(self.memory_s / period_s) + 2)
        delay = int(self.delay_s / period_s)
        return delay, share[delay:] / share[delay:].sum()


def discretised(
    core: Core,
    effects: tuple[Effect, ...],
    loads: Sequence[float],
    offset_mps: float,
    period_s: float,
    like: Model | None = None,
) -> Model:
    """The model that estimator and controller run: a_1 = a, b_j = (1 - a) K h_j, c_m and c_0 times (1 - a).

    `loads` and `offset_mps` in m/s at rest, in the order of the effects. It equals the core up to the last taps' tail.
    `like` fixes its delay and number of taps, to compare parameters of cores that differ by little.
    """
    a = core.pole(period_s)
    delay, share = core.taps(period_s)
    if like is not None:
        delay, share = like.delay, core.response(period_s, like.delay + like.nb)[like.delay :]
    b = (1.0 - a) * core.gain_mps_per_ma * share
    c = [(1.0 - a) * load for load in loads]
    theta = (a, *b.tolist(), *c, (1.0 - a) * offset_mps)
    return Model(period_s, 1, len(b), delay, effects, theta)
