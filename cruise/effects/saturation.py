"""Saturation: above a current the pump stands at its stop and gives no more oil.

    f(u) = sign(u) [ |u| - s ln(1 + exp((|u| - u_1) / s)) + s ln(1 + exp(-u_1 / s)) ],   s -> 0: sign(u) min(|u|, u_1)

u solenoid current and f what acts in mA, u_1 current of full stroke in mA, s width of the knee in mA: the servo's
spring and the flow forces soften the stop. At no current nothing acts. Source: section IV.C and Fig. 4 of Coen et al.
2005 ("a dead zone visible for small and large currents"); proportional pump controls of this class reach full stroke at
about nine tenths of full current.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value, clip, sign, softplus, where
from cruise.signals import Signals

GREATEST_MA: Final = 2000.0  # mA, more than any coil of this class takes
SHARP_MA: Final = 0.5  # mA, a knee below which it is a corner
ROUNDED_MA: Final = 1e-9  # mA, a difference that rounding makes


@dataclass(frozen=True, slots=True)
class Saturation(Effect):
    """f(u) = sign(u) min(|u|, full_stroke_ma) in mA, with a knee knee_ma wide."""

    name = "saturation"
    stage = Stage.COMMAND
    needs = ()
    parameters: ClassVar = {
        "full_stroke_ma": Parameter("mA", 200.0, GREATEST_MA, GREATEST_MA, "current at which the swash plate stops"),
        "knee_ma": Parameter("mA", 0.0, 150.0, 0.0, "width over which it comes to its stop"),
    }
    about: ClassVar = About(
        physics="The swash plate meets its mechanical stop, or the servo's spool is fully open. More current gives no "
        "more oil, so that the machine runs at its top speed whatever is asked of it.",
        equation="f(u) = sign(u) min(|u|, u_1), the corner rounded over s",
        source="Coen et al. 2005, section IV.C, Fig. 4",
        signature="the residual is negative at the highest currents only and grows with the current there",
        look_alikes=("quadratic_gain", "speed_droop", "power_limit"),
        experiment="a slow ramp up to full current and back, on level ground with little load",
    )

    full_stroke_ma: float = GREATEST_MA
    knee_ma: float = 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The current up to full stroke."""
        sharp = clip(value, -self.full_stroke_ma, self.full_stroke_ma)
        width_ma = clip(self.knee_ma, SHARP_MA, math.inf)
        lost_ma = softplus(abs(value) - self.full_stroke_ma, width_ma)
        rest_ma = softplus(-self.full_stroke_ma, width_ma)  # nothing is lost at no current
        soft = value - sign(value) * (lost_ma - rest_ma)
        return where((self.knee_ma < SHARP_MA) | (self.full_stroke_ma >= GREATEST_MA), sharp, soft), state

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The current that gives the value; everything beyond full stroke at full stroke; refused for more."""
        soft = self.full_stroke_ma < GREATEST_MA and self.knee_ma >= SHARP_MA
        stop_ma = self.full_stroke_ma + (softplus(-self.full_stroke_ma, self.knee_ma) if soft else 0.0)
        short_ma = stop_ma - abs(value)
        if short_ma < -ROUNDED_MA:
            return Inverse(math.nan, math.nan, refused=f"{value:.0f} mA is beyond the stop at {stop_ma:.0f} mA")
        low_ma = abs(value)
        if soft:
            short_ma = max(short_ma, ROUNDED_MA)
            knee_ma = self.knee_ma * math.log(-math.expm1(-short_ma / self.knee_ma))
            low_ma = min(self.full_stroke_ma - short_ma - knee_ma, GREATEST_MA)
        high_ma = GREATEST_MA if short_ma <= ROUNDED_MA else low_ma
        return Inverse(low_ma, high_ma) if value > 0.0 else Inverse(-high_ma, -low_ma)
