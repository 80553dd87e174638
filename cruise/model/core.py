"""The drive's linear core in physical terms, and the discrete parameters that follow from it.

    w = S_2 S_1 v(t - T_d),   S_i lags of tau_i        T_v l dy/dt = K g w + l sum_m c_m phi_m + c_0 - y
    l = i (1 + s (K |w| / v_0 - 1)),   v_0 = 1.5 m/s

v drive signal f(u) in mA, T_d delay in s, tau_1 and tau_2 lags of servo and solenoid in s, T_v time constant of the
vehicle in s (its inertia over the stiffness of the drive, viscous friction included), K gain in m/s per mA, c_m and c_0
what loads and rolling friction take, in m/s at rest. l is how far the drive yields at its stroke: a force, that of a
slope or of the mass which is accelerated, takes pressure, and pressure takes speed: by leakage the same at any stroke,
but from a pump whose swash plate nothing holds a part of the stroke that there is. s is the share of this at v_0, i
what the gear does to it (`Effect.yielding`); without s, l = 1, and gears slow the drive by equation 12 of the paper.
Over samples of T, which are means over one period,

    y_k = a y_(k-1) + (1 - a) [ K g sum_j h_j v_(k-j) + l sum_m c_m phi_m + c_0 ],   a = exp(-T / (T_v l))
    h = d * s_1 * s_2,   d_n = 1 - f, d_(n+1) = f for T_d = (n + f) T
    s_i,0 = 1 - (1 - q_i) tau_i / T,   s_i,j = (1 - q_i)^2 q_i^(j-1) tau_i / T,   q_i = exp(-T / tau_i)

sum h_j = 1. s_i are the means over each period of what a lag makes of a signal that is held over each, so that
sum j T s_i,j = tau_i: the drive comes as late at any period. In series with the lags stand pairs of poles
omega^2 / (p^2 + 2 zeta omega p + omega^2), taken in the same way, where there are such: the servo's own, which does
not ring, where two lags are too few; and a resonance, which v passes with the share 1 - r as it is and with the share r
through the pair: 0 < r of a drive train that is elastic, r < 0 of a mass that swings on the machine and lags behind it,
or of a body whose swinging carries the sensor along: (1 + c p^2 / (p^2 + ..)) is (1 + c) - c omega^2 / (p^2 + ..) for
little damping, r = -c. Source: K. J. Astrom, B. Wittenmark, Computer-Controlled Systems, 3rd ed. 1997,
section 2.3.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its signal part, slow to load, is loaded where it is first used: the service does without

from cruise.effects import Effect
from cruise.model.model import Model

TAIL: Final = 0.005  # share of the response that the last taps may leave out
WHOLE_DIGITS: Final = 9  # to which a delay in periods is taken for a whole number of them


@dataclass(frozen=True, slots=True)
class Core:
    """Gain, delay, lag and time constant of the drive; a pair where its frequency or its share is not zero."""

    gain_mps_per_ma: float
    delay_s: float
    lag_s: float
    time_constant_s: float
    second_lag_s: float = 0.0
    resonance_share: float = 0.0
    resonance_hz: float = 1.0
    damping: float = 0.3
    servo_hz: float = 0.0
    servo_damping: float = 0.8
    stroke_share: float = 0.0

    def pole(self, period_s: float) -> float:
        """a = exp(-T / T_v), at the stroke for v_0."""
        return math.exp(-period_s / self.time_constant_s)

    def felt(self, drive_ma: np.ndarray, period_s: float) -> np.ndarray:
        """w (..., N) in mA: drives (..., N) as the vehicle feels them; before its first sample each was the same."""
        whole, share = _periods(self.delay_s, period_s)
        held = np.concatenate([np.repeat(drive_ma[..., :1], whole + 1, axis=-1), drive_ma], axis=-1)
        count = drive_ma.shape[-1]
        felt = (1.0 - share) * held[..., 1 : count + 1] + share * held[..., :count]
        numerator, denominator = np.ones(1), np.ones(1)
        for lag_s in (self.lag_s, self.second_lag_s):
            if lag_s > 0.0:
                now, before, rest = _lag(lag_s, period_s)
                numerator, denominator = np.convolve(numerator, [now, before]), np.convolve(denominator, [1.0, -rest])
        felt = _filtered(felt, numerator, denominator)
        if self.servo_hz:
            felt = _filtered(felt, *_pair(self.servo_hz, self.servo_damping, period_s))
        if self.resonance_share == 0.0:
            return felt
        ringing = _filtered(felt, *_pair(self.resonance_hz, self.damping, period_s))
        return (1.0 - self.resonance_share) * felt + self.resonance_share * ringing

    def response(self, period_s: float, count: int) -> np.ndarray:
        """h_0 .. h_(count-1), shape (count,), without unit; what lies beyond the last is left out."""
        if self.resonance_share or self.servo_hz:
            pulse = np.zeros(count + 1)
            pulse[1] = 1.0
            return self.felt(pulse, period_s)[1:]
        whole, share = _periods(self.delay_s, period_s)
        felt = np.zeros(whole + 2 + count)
        felt[whole : whole + 2] = 1.0 - share, share
        for lag_s in (self.lag_s, self.second_lag_s):
            if lag_s > 0.0:
                now, before, rest = _lag(lag_s, period_s)
                later = (before + rest * now) * rest ** np.arange(count - 1)
                felt = np.convolve(felt[:count], np.concatenate([[now], later]))
        return felt[:count]

    @property
    def answers_s(self) -> float:
        """How much later the speed moves than the dead time alone has it: the mean of what each part adds."""
        servo_s = self.servo_damping / (math.pi * self.servo_hz) if self.servo_hz else 0.0
        return self.lag_s + self.second_lag_s + servo_s + self.time_constant_s

    @property
    def behind_s(self) -> float:
        """How much later than the current the speed moves."""
        return self.delay_s + self.answers_s

    @property
    def memory_s(self) -> float:
        """How far back the drive matters to what the vehicle feels now: all but TAIL of the response."""
        ringing_s = 1.0 / (2.0 * math.pi * self.resonance_hz * self.damping) if self.resonance_share else 0.0
        servo_s = 1.0 / (2.0 * math.pi * self.servo_hz * self.servo_damping) if self.servo_hz else 0.0
        return self.delay_s + max(self.lag_s + self.second_lag_s + servo_s, ringing_s) * math.log(1.0 / TAIL)

    def taps(self, period_s: float) -> tuple[int, np.ndarray]:
        """The delay in samples and the h_j from there on (nb,) that matter, scaled to a sum of 1."""
        share = self.response(period_s, math.ceil(self.memory_s / period_s) + 2)
        delay, _ = _periods(self.delay_s, period_s)
        return delay, share[delay:] / share[delay:].sum()


def _periods(delay_s: float, period_s: float) -> tuple[int, float]:
    """The whole periods in a delay, and what is left as a share of one: 0.6 s are 3 of 0.2 s, and nothing."""
    periods = round(delay_s / period_s, WHOLE_DIGITS)
    return int(periods), periods % 1.0


def _lag(lag_s: float, period_s: float) -> tuple[float, float, float]:
    """w_k = rest w_(k-1) + now v_k + before v_(k-1): the means of a lag's output over the periods that v is held."""
    rest = math.exp(-period_s / lag_s)
    spent = lag_s / period_s * (1.0 - rest)
    return 1.0 - spent, spent - rest, rest


def _pair(frequency_hz: float, damping: float, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of the means of a pair's output over the periods that its input is held."""
    omega = 2.0 * math.pi * frequency_hz
    pole = complex(-damping * omega, omega * math.sqrt(1.0 - damping**2))  # 1/s
    swing = complex(1.0, pole.real / pole.imag) / pole
    ends = np.arange(4) * period_s
    step = np.diff(ends - (swing * np.exp(pole * ends)).real) / period_s  # means of 1 - Re (1 - i r) e^(p t)
    shrink = math.exp(pole.real * period_s)
    denominator = np.array([1.0, -2.0 * shrink * math.cos(pole.imag * period_s), shrink * shrink])
    return np.convolve(np.diff(step, prepend=0.0), denominator)[:3], denominator


def _filtered(values: np.ndarray, numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Values (..., N) through a filter of gain 1 that has settled at their first one."""
    settled = np.cumsum((numerator - denominator)[:0:-1])[::-1]  # what it holds for a value of 1 that stays
    return scipy.signal.lfilter(numerator, denominator, values, zi=settled * values[..., :1])[0]


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
    return Model(period_s, 1, len(b), delay, effects, theta, stroke_share=core.stroke_share)
