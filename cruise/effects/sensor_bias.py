"""Sensor bias: the speed sensor shows a constant, or slowly drifting, amount too much or too little.

    phi_k = m_k B_(k-1),   B_k = B_(k-1) + s_k m_k ((v_g - v_w)_k - m_k B_(k-1)),   m = r + (1 - r) tanh(|v_w| / v_m)
    s_k = max(1 / (n + 1), 1 - exp(-T / tau))

v_g measured ground speed and v_w wheel speed in m/s, n sum of m^2 over the samples so far, tau the time in s for which
a zero is taken to stay, T period in s: B is a mean over the first tau, then forgets with it; r what of it is there at
rest, where a radar shows nothing, v_m = 0.15 m/s from which on a radar shows anything. It is known before sample k, so
that the noise of a sample can't explain itself; the very first sample, before which nothing is known, uses its own.
Source: an additive sensor fault, Isermann, Fault-Diagnosis Systems, Springer 2006; the filter is a choice of this
program, its time is found from the data: a zero wanders with the temperature within minutes and jumps where a mount
gives way.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, tanh, where
from cruise.effects.low_pass import followed_over
from cruise.signals import OUTPUT, Signals

SHOWS_MPS: Final = 0.15  # m/s, below which a radar shows nothing, or little


@dataclass(frozen=True, slots=True)
class SensorBias(Effect):
    """phi = what ground speed and wheel speed have differed by over the last filter_s, in m/s; at rest a share."""

    name = "sensor_bias"
    stage = Stage.SENSOR
    acts_as = Stage.LOAD
    needs = ("wheel_speed_mps", OUTPUT)
    spare = ("rest_share",)
    parameters: ClassVar = {
        "filter_s": Parameter("s", 1.0, 30.0, 30.0, "time over which the difference is averaged: how soon it shifts"),
        "rest_share": Parameter(
            "-", 0.0, 1.0, 1.0, "what of it shows at rest; 0 for a radar, which shows nothing there"
        ),
    }
    about: ClassVar = About(
        physics="A radar that is mounted at another angle than assumed, or a converter with an offset, shows a speed "
        "that is not that of the machine. One sensor can't know: its bias is the constant of the model. A second "
        "speed, that of the wheels, can: their slow difference, at rest and in reverse too, is the bias of one of "
        "them. Two speeds don't say which of the two is wrong; standstill does, unless the sensor shows nothing there, "
        "as a radar.",
        equation="phi_k = m B_(k-1),  B = mean of (v_g - v_w) / m so far, forgetting with tau,  m = 1, at rest r",
        source="Isermann, Fault-Diagnosis Systems, Springer 2006 (additive fault); the filter is a choice",
        signature="the residual is a constant that drifts, with the same sign forward, in reverse and at rest",
        look_alikes=("wheel_slip", "grade", "coulomb_friction", "rolling_resistance"),
        experiment="30 s at rest, 30 s forward and 30 s in reverse at the same magnitude of current on level ground: "
        "a bias keeps its sign and size throughout, slip grows with the speed, friction changes its sign",
    )

    filter_s: float = 30.0
    rest_share: float = 1.0

    def start(self, like: Value) -> State:
        """Mean difference in m/s, and n."""
        return like * 0.0, like * 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The difference as known from the samples before this one."""
        bias_mps, seen = state
        shows = self._shows(signals["wheel_speed_mps"])
        difference_mps = signals[OUTPUT] - signals["wheel_speed_mps"]
        known = difference_mps == difference_mps
        shown_mps = shows * where(seen > 0.0, bias_mps, difference_mps)
        averaging, forgetting = 1.0 / (seen + 1.0), -np.expm1(-dt_s / self.filter_s)
        share = shows * where(averaging > forgetting, averaging, forgetting)
        updated_mps = where(known, bias_mps + share * (difference_mps - shows * bias_mps), bias_mps)
        return where(known, shown_mps, math.nan), (updated_mps, where(known, seen + shows**2, seen))

    def _shows(self, wheel_speed_mps: Value) -> Value:
        """m: how much of the bias a sensor shows at this speed, all of it once the machine moves."""
        if isinstance(self.rest_share, float) and self.rest_share == 1.0:
            return 1.0
        return self.rest_share + (1.0 - self.rest_share) * tanh(abs(wheel_speed_mps) / SHOWS_MPS)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once: a mean at first, then a lag; over holes it stays as it is."""
        if self.rest_share != 1.0:
            return Effect.over(self, values, past_speeds, signals, dt_s)
        differences_mps = signals[OUTPUT] - signals["wheel_speed_mps"]
        known = np.isfinite(differences_mps)
        given_mps, counts = differences_mps[known], np.cumsum(known)
        at_first = min(math.floor(-1.0 / math.expm1(-dt_s / self.filter_s)), len(given_mps))
        means_mps = np.cumsum(given_mps[:at_first]) / np.arange(1, at_first + 1)
        later_mps = followed_over(np.concatenate([means_mps[-1:], given_mps[at_first:]]), self.filter_s, dt_s)[1:]
        biases_mps = np.concatenate([[0.0], means_mps, later_mps])
        before_mps = np.concatenate([given_mps[:1], biases_mps[1:-1], [math.nan]])[counts - 1]
        return np.where(known, before_mps, math.nan), (biases_mps[counts], counts.astype(float))
