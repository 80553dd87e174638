"""Oil temperature: hot oil is thin and leaks back through pump and motor, cold oil is thick and slows the servo down.

    g(T) = max(0, 1 - lambda (exp((T - 50 degC) / 33 K) - 1))        alpha(T) = min(exp(e (T - 50 degC) / 33 K), 2)

T oil temperature in degC, lambda share of the flow that leaks at 50 degC: laminar leakage is inverse to viscosity,
which falls by 3 % per kelvin: the line of Walther (ASTM D341) through ISO VG 46 of viscosity index 100 (46 and
6.8 mm2/s at 40 and 100 degC) falls by 4.0 %/K at 50 degC, 2.7 %/K at 80 degC, 3.1 %/K in the mean from 50 to 90 degC.
alpha pace of the poles (y_k = alpha f(u, y) + (1 - alpha) y_(k-1)), e power of the fluidity by which they are quicker:
0 where orifices are sharp and turbulent, 1 where all of it is laminar.

Source: H.E. Merritt, Hydraulic Control Systems (1967), ch. 2 to 4 (viscosity; flow through orifices; laminar leakage of
pumps and motors).
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip
from cruise.signals import Signals

REFERENCE_C: Final = 50.0  # degC, at which makers state volumetric efficiencies; here g = 1
THINNING_K: Final = 33.0  # K in which VG 46 thins by the factor e, mean of 40 to 105 degC; VG 32: 34, VG 68: 30
QUICKEST: Final = 2.0  # pace of hot oil over that at 50 degC


@dataclass(frozen=True, slots=True)
class OilTemperature(Effect):
    """g = max(0, 1 - loss_share (exp((oil_temperature_c - 50) / 33) - 1)); a pace that grows with the fluidity."""

    name = "oil_temperature"
    stage = Stage.GAIN
    needs = ("oil_temperature_c",)
    instead = ("pace_exponent",)
    parameters: ClassVar = {
        "loss_share": Parameter("-", -0.05, 0.4, 0.0, "share of the flow that leaks at 50 degC"),
        "pace_exponent": Parameter("-", 0.0, 1.5, 0.0, "power of the fluidity by which hot oil is quicker; 0 none"),
    }
    about: ClassVar = About(
        physics="The viscosity of hydraulic oil falls exponentially with temperature, by about 3 % per kelvin. The "
        "gaps at pistons, slippers and valve plate leak in inverse proportion to it, so that the machine is slower "
        "with hot oil at the same current. A new pump loses 2 to 5 % at 50 degC, a worn one three times that; "
        "slightly negative is a drive whose gain is governed by drag in cold oil. Thick oil also passes the narrow "
        "orifices that feed the servo slowly, so that a cold machine answers late, and at its own pace once it is "
        "warm.",
        equation="g = max(0, 1 - lambda (exp((T - 50 degC) / 33 K) - 1)),  alpha = min(exp(e (T - 50 degC) / 33 K), 2)",
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

    @property
    def idle(self) -> frozenset[str]:
        """The pace where it does not change."""
        return frozenset({"pace_exponent"} if self.pace_exponent == 0.0 else ())

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, less the leakage beyond that at 50 degC."""
        thinner = _fluidity(signals["oil_temperature_c"])
        return value * clip(1.0 - self.loss_share * (thinner - 1.0), 0.0, math.inf), state

    def pace(self, signals: Signals, state: State) -> Value:
        """alpha: less than 1 in cold oil."""
        return clip(_fluidity(signals["oil_temperature_c"], self.pace_exponent), 0.0, QUICKEST)


def _fluidity(oil_temperature_c: Value, power: float = 1.0) -> Value:
    """Fluidity of the oil over that at 50 degC, to a power."""
    warmth = power * (oil_temperature_c - REFERENCE_C) / THINNING_K
    return np.exp(warmth) if isinstance(warmth, np.ndarray) else math.exp(warmth)
