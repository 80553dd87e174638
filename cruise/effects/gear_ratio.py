"""Gear ratio: the engaged gear sets the top speed, and in the high gears the inertia that the drive feels.

    g(i) = v_max,i / v_max,2        alpha(i) = min(1, (v_max,2 / v_max,i)^e)

v_max,i top speed in gear i in m/s at rated engine speed; alpha slows the poles (y_k = alpha f(u, y) + (1 - alpha)
y_(k-1)), e the power by which it does: preservation of power gives 2 for gears 3 and 4, and first gear reaches its top
speed in the same time as second, which is alpha = 1. How much of the inertia lies before the gearbox the data say: e =
0 is a machine that is as quick in every gear. A gearbox that shifts under way interrupts the traction: with the shift g
loses a share q, and comes from there to the next ratio through a low-pass of tau. Where a model has the lags of its
servo apart from how the drive yields, g^e is how much more it yields than in second gear, in every gear: a force at the
wheels is g times as much at the motor, and what the motor loses g times as much at the wheels. Source: equations 10 to
12 of Coen et al. 2005.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, where
from cruise.effects.low_pass import followed, held_over, share
from cruise.signals import Signals

_TOP = Parameter("m/s", 0.3, 15.0, 2.5, "top speed in this gear at rated engine speed")
_PACE = Parameter("-", 0.0, 3.0, 0.0, "power by which a gear above second is slower; 2 is preservation of power")


@dataclass(frozen=True, slots=True)
class GearRatio(Effect):
    """g = v_max,i / v_max,2, by and by after a shift, alpha = min(1, g^-pace_exponent); no drive outside gears 1..4."""

    name = "gear_ratio"
    stage = Stage.GAIN
    needs = ("gear",)
    spare = ("shift_s",)
    parameters: ClassVar = {
        **{f"gear_{i}_mps": _TOP for i in (1, 2, 3, 4)},
        "pace_exponent": _PACE,
        "shift_s": Parameter("s", 0.0, 3.0, 0.0, "time constant in which the next ratio acts after a shift; 0 at once"),
        "shift_loss": Parameter("-", 0.0, 1.0, 0.3, "share of the drive that is interrupted at first by a shift"),
    }
    about: ClassVar = About(
        physics="The mechanical transmission multiplies the motor's speed and divides its torque. A higher gear is "
        "faster for the same current, and the same mass weighs more at the motor, so it also responds more slowly.",
        equation="g = v_max,i / v_max,2, after a shift from (1 - q) g on through a low-pass of tau;  "
        "y_k = alpha f(u, y) + (1 - alpha) y_(k-1),  alpha = min(1, g^-e)",
        source="Coen et al. 2005, section V.C, equations 10 to 12",
        signature="gain and time constant of the residual change with the gear and with nothing else",
        look_alikes=("engine_speed",),
        experiment="the same step of current in two gears",
    )

    gear_1_mps: float = 2.5
    gear_2_mps: float = 2.5
    gear_3_mps: float = 2.5
    gear_4_mps: float = 2.5
    pace_exponent: float = 2.0
    shift_s: float = 0.0
    shift_loss: float = 0.3

    @property
    def idle(self) -> frozenset[str]:
        """How a shift goes, where it takes no time."""
        return frozenset({"shift_s", "shift_loss"}) if self.shift_s == 0.0 else frozenset()

    def start(self, like: Value) -> State:
        """Ratio of the gear so far, and g: not known yet."""
        return like * math.nan, like * math.nan

    def ratio(self, gear: Value) -> Value:
        """v_max,i / v_max,2 for each gear; 0 in neutral and for gears that the machine does not have, NaN unknown."""
        tops = (0.0, self.gear_1_mps, self.gear_2_mps, self.gear_3_mps, self.gear_4_mps)
        if isinstance(gear, float | int):
            if gear != gear:
                return gear
            return tops[int(gear)] / self.gear_2_mps if 0 < gear < 5 else 0.0
        gear = np.asarray(gear, float)
        known = np.isfinite(gear)
        index = np.where(known & (gear > 0) & (gear < 5), gear, 0).astype(int)
        top_mps = sum(np.where(index == i, top, 0.0) for i, top in enumerate(tops))
        return np.where(known, top_mps / self.gear_2_mps, np.nan)

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, scaled to the engaged gear."""
        before, shown = state
        now = self.ratio(signals["gear"])
        known, shifted = now == now, (before == before) * (now != before)
        shown = where(known * shifted, shown * (1.0 - self.shift_loss), shown)
        shown = where(known, followed(shown, now, share(self.shift_s, dt_s)), shown)
        gain = where(known * (now != 0.0) * (self.shift_s > 0.0), shown, now)
        return value * gain, (where(known, now, before), where(known, gain, shown))

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording, one stretch in a gear after the other."""
        now = self.ratio(signals["gear"])
        known = np.flatnonzero(np.isfinite(now))
        gains = now[known]
        if self.shift_s > 0.0:
            rest = 1.0 - share(self.shift_s, dt_s)
            shifts = np.flatnonzero(np.diff(gains)) + 1
            for first, end in pairwise([0, *shifts.tolist(), len(gains)]):
                if first and gains[first] != 0.0:
                    begun, ratio = gains[first - 1] * (1.0 - self.shift_loss), gains[first]
                    gains[first:end] = ratio + (begun - ratio) * rest ** np.arange(1, end - first + 1)
        shown = np.full(len(now), np.nan)
        shown[known] = gains
        return values * shown, (held_over(now), held_over(shown))

    def yielding(self, signals: Signals) -> Value:
        """g^e, 1 where nothing is driven."""
        ratio = self.ratio(signals["gear"])
        if isinstance(ratio, float):
            return ratio**self.pace_exponent if ratio > 0.0 else ratio * 0.0 + 1.0
        return np.where(ratio > 0.0, ratio, ratio * 0.0 + 1.0) ** self.pace_exponent

    def pace(self, signals: Signals, state: State) -> Value:
        """alpha of equation 12: less than 1 where the gear is higher than second."""
        ratio = self.ratio(signals["gear"])
        if isinstance(ratio, float):
            return ratio**-self.pace_exponent if ratio > 1.0 else ratio * 0.0 + 1.0
        return np.where(ratio > 1.0, np.maximum(ratio, 1.0) ** -self.pace_exponent, ratio * 0.0 + 1.0)
