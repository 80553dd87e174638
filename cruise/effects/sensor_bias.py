"""Sensor bias: the speed sensor shows a constant, or slowly drifting, amount too much or too little.

    phi_k = B_(k-1),   B_k = B_(k-1) + s_k ((v_g - v_w)_k - B_(k-1)),   s_k = max(1 / (n + 1), 1 - exp(-T / tau))

v_g measured ground speed and v_w wheel speed in m/s, n samples seen so far, tau = 30 s, T period in s: B is a mean over
the first half minute, then forgets with tau. It is known before sample k, so that the noise of a sample can't explain
itself; the very first sample, before which nothing is known, uses its own. Source: an additive sensor fault, Isermann,
Fault-Diagnosis Systems, Springer 2006; the filter is a choice of this program.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import About, Effect, Stage, State, Value, where
from cruise.signals import OUTPUT, Signals

TAU_S: Final = 30.0  # s, much longer than a manoeuvre, shorter than a sensor's drift


@dataclass(frozen=True, slots=True)
class SensorBias(Effect):
    """phi = what ground speed and wheel speed have differed by over the last half minute, in m/s."""

    name = "sensor_bias"
    stage = Stage.SENSOR
    acts_as = Stage.LOAD
    needs = ("wheel_speed_mps", OUTPUT)
    parameters: ClassVar = {}
    about: ClassVar = About(
        physics="A radar that is mounted at another angle than assumed, or a converter with an offset, shows a speed "
        "that is not that of the machine. One sensor can't know: its bias is the constant of the model. A second "
        "speed, that of the wheels, can: their slow difference, at rest and in reverse too, is the bias of one of "
        "them. Two speeds don't say which of the two is wrong; standstill does.",
        equation="phi_k = mean over the past 30 s of (ground speed - wheel speed), before sample k",
        source="Isermann, Fault-Diagnosis Systems, Springer 2006 (additive fault); the filter is a choice",
        signature="the residual is a constant that drifts, with the same sign forward, in reverse and at rest",
        look_alikes=("wheel_slip", "grade", "coulomb_friction", "rolling_resistance"),
        experiment="30 s at rest, 30 s forward and 30 s in reverse at the same magnitude of current on level ground: "
        "a bias keeps its sign and size throughout, slip grows with the speed, friction changes its sign",
    )

    def start(self, like: Value) -> State:
        """Mean difference in m/s and samples seen so far."""
        return like * 0.0, like * 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The difference as known from the samples before this one."""
        bias_mps, seen = state
        difference_mps = signals[OUTPUT] - signals["wheel_speed_mps"]
        known = difference_mps == difference_mps
        shown_mps = where(seen > 0.0, bias_mps, difference_mps)
        averaging, forgetting = 1.0 / (seen + 1.0), 1.0 - math.exp(-dt_s / TAU_S)
        share = where(averaging > forgetting, averaging, forgetting)
        updated_mps = where(known, bias_mps + share * (difference_mps - bias_mps), bias_mps)
        return where(known, shown_mps, math.nan), (updated_mps, where(known, seen + 1.0, seen))
