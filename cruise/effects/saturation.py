"""Saturation: above a current the pump stands at its stop and gives no more oil.

    f(u) = sign(u) min(|u|, u_1)

u solenoid current in mA, u_1 current of full stroke in mA. Source: section IV.C and Fig. 4 of Coen et al. 2005 ("a dead
zone visible for small and large currents"); proportional pump controls of this class reach full stroke at about nine
tenths of full current.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value, clip
from cruise.signals import Signals

GREATEST_MA: Final = 2000.0  # mA, more than any coil of this class takes


@dataclass(frozen=True, slots=True)
class Saturation(Effect):
    """f(u) = sign(u) min(|u|, full_stroke_ma), in mA."""

    name = "saturation"
    stage = Stage.COMMAND
    needs = ()
    parameters: ClassVar = {
        "full_stroke_ma": Parameter("mA", 200.0, GREATEST_MA, GREATEST_MA, "current at which the swash plate stops"),
    }
    about: ClassVar = About(
        physics="The swash plate meets its mechanical stop, or the servo's spool is fully open. More current gives no "
        "more oil, so that the machine runs at its top speed whatever is asked of it.",
        equation="f(u) = sign(u) min(|u|, u_1)",
        source="Coen et al. 2005, section IV.C, Fig. 4",
        signature="the residual is negative at the highest currents only and grows with the current there",
        look_alikes=("quadratic_gain", "speed_droop", "power_limit"),
        experiment="a slow ramp up to full current and back, on level ground with little load",
    )

    full_stroke_ma: float = GREATEST_MA

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The current up to full stroke."""
        return clip(value, -self.full_stroke_ma, self.full_stroke_ma), state

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The value itself; everything beyond full stroke at full stroke; refused for more."""
        if abs(value) > self.full_stroke_ma:
            stop_ma = self.full_stroke_ma
            return Inverse(math.nan, math.nan, refused=f"{value:.0f} mA is beyond the stop at {stop_ma:.0f} mA")
        if abs(value) < self.full_stroke_ma:
            return Inverse(value, value)
        return Inverse(value, GREATEST_MA) if value > 0.0 else Inverse(-GREATEST_MA, value)
