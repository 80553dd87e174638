"""Wheel slip: the wheels turn faster than the ground goes by, so that some of the drive is lost in the soil.

    g_k = 1 - s K_(k-1),   K_k = K_(k-1) + (1 - exp(-T / tau)) (kappa_k - K_(k-1)) where |v_w| > 0.3 m/s
    kappa = min(max(1 - v_g / v_w, -0.5), 0.9)

v_g measured ground speed and v_w wheel speed in m/s, kappa slip, K its low-pass with tau from the samples before
k, s share without unit (1: all of the slip is missing at the ground), T period in s. Source: slip as defined in
Wong, Theory of Ground Vehicles, Wiley; the filter is a choice of this program.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip, where
from cruise.signals import OUTPUT, Signals

SLOWEST_MPS: Final = 0.3  # m/s: below it the noise of both sensors is more than the slip
LEAST, GREATEST = -0.5, 0.9  # of a braked and of a spinning wheel; beyond them a sensor is wrong


@dataclass(frozen=True, slots=True)
class WheelSlip(Effect):
    """g = 1 - share K; K the slip of the last samples, held while the wheels turn slower than 0.3 m/s."""

    name = "wheel_slip"
    stage = Stage.SENSOR
    acts_as = Stage.GAIN
    needs = ("wheel_speed_mps", OUTPUT)
    parameters: ClassVar = {
        "share": Parameter("-", 0.0, 1.5, 0.0, "part of the slip that the speed lacks; 1 for a true ground speed"),
        "filter_s": Parameter("s", 0.1, 2.0, 0.6, "time constant over which the slip is averaged"),
    }
    about: ClassVar = About(
        physics="A tyre transmits a force only while it slips: on concrete by 2 %, on wet stubble by 20 % and more. "
        "The drive sets the speed of the wheels, the ground sees what is left of it. Where the modelled speed is that "
        "of the ground, the gain falls with the slip; where it is counted at the wheels, nothing is missing and the "
        "share is 0. Slip is computed from the very speed that is predicted, therefore from past samples only.",
        equation="g = 1 - s K,  K = low-passed (1 - v_g / v_w) of the samples before",
        source="Wong, Theory of Ground Vehicles, Wiley (slip); the filter is a choice",
        signature="the residual is proportional to the speed times the slip: it grows where the soil is soft or the "
        "slope steep, and vanishes at rest",
        look_alikes=("sensor_bias", "rolling_resistance", "grade", "leakage"),
        experiment="constant current at 1.5 m/s from firm ground on to soft or wet ground and back, 20 s each, level: "
        "the wheels keep their speed and the ground speed falls; a bias would not change and leakage would slow the "
        "wheels too",
    )

    share: float = 1.0
    filter_s: float = 0.6  # a quarter turn of a wheel of 0.9 m radius at 2.5 m/s

    def start(self, like: Value) -> State:
        """Low-passed slip: none so far."""
        return like * 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, less what slips; the slip as known from the samples before this one."""
        wheel_mps, ground_mps = signals["wheel_speed_mps"], signals[OUTPUT]
        turning = (abs(wheel_mps) > SLOWEST_MPS) & (ground_mps == ground_mps)  # False for NaN
        slip = clip(1.0 - ground_mps / where(turning, wheel_mps, 1.0), LEAST, GREATEST)
        followed = state + (1.0 - np.exp(-dt_s / self.filter_s)) * (slip - state)
        measured = 1.0 + 0.0 * (wheel_mps + ground_mps)  # NaN where one of them is
        return value * (1.0 - self.share * state) * measured, where(turning, followed, state)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording in one narrow loop: the shape is looked for in recordings of 10^5 samples."""
        wheel_mps, ground_mps = signals["wheel_speed_mps"], signals[OUTPUT]
        turning = (np.abs(wheel_mps) > SLOWEST_MPS) & np.isfinite(ground_mps)
        slips = np.clip(1.0 - ground_mps / np.where(turning, wheel_mps, 1.0), LEAST, GREATEST)
        share, followed, before, after = -math.expm1(-dt_s / self.filter_s), 0.0, [], []
        for turns, slip in zip(turning.tolist(), slips.tolist(), strict=True):
            before.append(followed)
            if turns:
                followed += share * (slip - followed)
            after.append(followed)
        measured = 1.0 + 0.0 * (wheel_mps + ground_mps)  # NaN where one of them is
        return values * (1.0 - self.share * np.array(before)) * measured, np.array(after)
