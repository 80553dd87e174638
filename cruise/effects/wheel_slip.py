"""Wheel slip: the wheels turn faster than the ground goes by, so that some of the drive is lost in the soil.

    phi_k = -K_(k-1) / (1 - K_(k-1)) v_(k-1)
    K_k = K_(k-1) + (1 - exp(-T / tau)) (kappa_k - K_(k-1)) where |v_w| > 0.3 m/s,   kappa = 1 - v_g / v_w in -0.5..0.5

v speed one sample ago, v_g measured ground speed and v_w wheel speed in m/s, kappa slip, K its low-pass with tau from
the samples before k, T period in s: phi is what the ground lags behind the wheels, v - v / (1 - K). The oil of the
drive turns the wheels: in T_v dv/dt = K_0 u - v_w - F / stiffness their speed v_w = v - phi stands where that of the
machine would stand without slip, so that slip adds to the load, with the coefficient 1 where the speed is that of the
ground, and shortens the time constant. Source: slip as defined in Wong, Theory of Ground Vehicles, Wiley; the filter is
a choice of this program.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip, where
from cruise.effects.low_pass import followed_over
from cruise.signals import OUTPUT, Signals

SLOWEST_MPS: Final = 0.3  # m/s: below it the noise of both sensors is more than the slip
LEAST, GREATEST = -0.5, 0.5  # of a braked and of a spinning wheel; beyond them a wheel digs itself in


@dataclass(frozen=True, slots=True)
class WheelSlip(Effect):
    """phi = -K / (1 - K) v in m/s; K the slip of the last samples, held while the wheels turn slower than 0.3 m/s."""

    name = "wheel_slip"
    stage = Stage.SENSOR
    acts_as = Stage.LOAD
    needs = ("wheel_speed_mps", OUTPUT)
    reads_speed = True
    parameters: ClassVar = {
        "filter_s": Parameter("s", 0.05, 2.0, 0.6, "time constant over which the slip is averaged"),
    }
    about: ClassVar = About(
        physics="A tyre transmits a force only while it slips: on concrete by 2 %, on wet stubble by 20 % and more. "
        "The drive sets the speed of the wheels, the ground sees what is left of it. Where the modelled speed is that "
        "of the ground, all of the slip is missing and the coefficient is 1; where it is counted at the wheels, "
        "nothing is missing and it is 0. Slip is computed from the very speed that is predicted, therefore from past "
        "samples only.",
        equation="phi = -K / (1 - K) v,  K = low-passed (1 - v_g / v_w) of the samples before, in -0.5..0.5",
        source="Wong, Theory of Ground Vehicles, Wiley (slip); the filter is a choice",
        signature="the residual is proportional to the speed times the slip: it grows where the soil is soft or the "
        "slope steep, and vanishes at rest",
        look_alikes=("sensor_bias", "rolling_resistance", "grade", "leakage"),
        experiment="constant current at 1.5 m/s from firm ground on to soft or wet ground and back, 20 s each, level: "
        "the wheels keep their speed and the ground speed falls; a bias would not change and leakage would slow the "
        "wheels too",
    )

    filter_s: float = 0.6  # a quarter turn of a wheel of 0.9 m radius at 2.5 m/s

    def start(self, like: Value) -> State:
        """Low-passed slip: none so far."""
        return like * 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """What slips at the last speed; the slip as known from the samples before this one."""
        wheel_mps, ground_mps = signals["wheel_speed_mps"], signals[OUTPUT]
        turning = (abs(wheel_mps) > SLOWEST_MPS) & (ground_mps == ground_mps)  # False for NaN
        slip = clip(1.0 - ground_mps / where(turning, wheel_mps, 1.0), LEAST, GREATEST)
        followed = state - np.expm1(-dt_s / self.filter_s) * (slip - state)
        measured = 1.0 + 0.0 * (wheel_mps + ground_mps)  # NaN where one of them is
        return -state / (1.0 - state) * past_speed * measured, where(turning, followed, state)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once: while the wheels don't turn, the slip stays as it was."""
        wheel_mps, ground_mps = signals["wheel_speed_mps"], signals[OUTPUT]
        turning = (np.abs(wheel_mps) > SLOWEST_MPS) & np.isfinite(ground_mps)
        slips = np.clip(1.0 - ground_mps[turning] / wheel_mps[turning], LEAST, GREATEST)
        known = followed_over(np.concatenate([[0.0], slips]), self.filter_s, dt_s)[np.cumsum(turning)]
        before, after = np.concatenate([[0.0], known[:-1]]), known
        measured = 1.0 + 0.0 * (wheel_mps + ground_mps)  # NaN where one of them is
        return -before / (1.0 - before) * past_speeds * measured, after
