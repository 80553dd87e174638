"""Oil temperature: hot oil is thin and leaks back through pump and motor, cold oil is thick and slows the servo down.

    g(T) = max(0, 1 - lambda (F - 1) - delta d),   d = 1 / F - 1, but no less than at T_w
    alpha(T) = min(F^e, 2),   F = exp((T - 50 degC) / 33 K)

T oil temperature in degC, F fluidity over that at 50 degC, lambda share of the flow that leaks there: laminar leakage
goes by F. d thickness over that at 50 degC less 1, delta share of the speed that the drag of thick oil takes at 50
degC, in gaps, lines and bearings: it goes by 1 / F, up to the temperature T_w from which it takes no more: until then,
say, the charge pump cannot fill the cylinders with oil so thick. alpha pace of the poles (y_k = alpha f(u, y) + (1 -
alpha) y_(k-1)), e power of the fluidity by which they are quicker: 0 where orifices are sharp and turbulent, 1 where
all of it is laminar.

Source: H.E. Merritt, Hydraulic Control Systems (1967), ch. 2 to 4 (viscosity; flow through orifices; laminar leakage of
pumps and motors).
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip, where
from cruise.effects.fluidity import fluidity
from cruise.signals import Signals

HOTTEST_C: Final = 110.0  # degC, above all that hydraulic oil stands
QUICKEST: Final = 2.0  # pace of hot oil over that at 50 degC


@dataclass(frozen=True, slots=True)
class OilTemperature(Effect):
    """g = 1 - loss_share (F - 1) - drag_share d, F = exp((T - 50 degC) / 33 K), d = 1 / F - 1; a pace by F."""

    name = "oil_temperature"
    stage = Stage.GAIN
    needs = ("oil_temperature_c",)
    instead = ("pace_exponent", "drag_share", "warm_c")
    spare = ("warm_c",)
    parameters: ClassVar = {
        "loss_share": Parameter("-", -0.05, 0.4, 0.0, "share of the flow that leaks at 50 degC"),
        "pace_exponent": Parameter("-", 0.0, 1.5, 0.0, "power of the fluidity by which hot oil is quicker; 0 none"),
        "drag_share": Parameter("-", 0.0, 0.3, 0.0, "share of the speed that drag takes at 50 degC; 0 none"),
        "warm_c": Parameter("degC", -20.0, HOTTEST_C, HOTTEST_C, "temperature from which drag takes no more"),
    }
    about: ClassVar = About(
        physics="The viscosity of hydraulic oil falls exponentially with temperature, by about 3 % per kelvin. The "
        "gaps at pistons, slippers and valve plate leak in inverse proportion to it, so that the machine is slower "
        "with hot oil at the same current. A new pump loses 2 to 5 % at 50 degC, a worn one three times that; "
        "slightly negative is a drive whose gain is governed by drag in cold oil. Where the drag of thick oil counts, "
        "a cold machine is slower, and the less so the warmer it gets. Thick oil also passes the narrow orifices that "
        "feed the servo slowly, so that a cold machine answers late, and at its own pace once it is warm.",
        equation="g = max(0, 1 - lambda (F - 1) - delta d),  d = 1 / F - 1 up to T_w,  alpha = min(F^e, 2),  "
        "F = exp((T - 50 degC) / 33 K)",
        source="Merritt 1967, ch. 2 and 4; ASTM D341 (Walther) with ISO VG 46",
        signature="the residual is proportional to speed and drifts over tens of minutes with the oil temperature, "
        "with nothing faster in it; where the pace changes, it stands after steps while the oil is cold, and nowhere "
        "else",
        look_alikes=("leakage", "engine_droop", "speed_droop", "sensor_bias"),
        experiment="the same course with the same currents at 30, 50 and 80 degC, on level ground and then on one "
        "slope: leakage by pressure alone is the same at every temperature, and whatever else drifts with the hours "
        "(a bin that fills) is undone by going back to cold oil with a full bin",
    )

    loss_share: float = 0.0
    pace_exponent: float = 0.0
    drag_share: float = 0.0
    warm_c: float = HOTTEST_C

    @property
    def idle(self) -> frozenset[str]:
        """The pace where it does not change, the drag where there is none, and how far it reaches."""
        idle = frozenset(name for name in ("pace_exponent", "drag_share") if getattr(self, name) == 0.0)
        everywhere = "drag_share" in idle or self.warm_c == HOTTEST_C
        return idle | {"warm_c"} if everywhere else idle

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, less leakage and drag beyond those at 50 degC."""
        thinner = fluidity(signals["oil_temperature_c"])
        thicker, warm = 1.0 / thinner, 1.0 / fluidity(self.warm_c)
        thicker = where(thicker < warm, warm, thicker)
        lost = self.loss_share * (thinner - 1.0) + self.drag_share * (thicker - 1.0)
        return value * clip(1.0 - lost, 0.0, math.inf), state

    def pace(self, signals: Signals, state: State) -> Value:
        """alpha: less than 1 in cold oil."""
        return clip(fluidity(signals["oil_temperature_c"], self.pace_exponent), 0.0, QUICKEST)
