"""Leakage: oil that slips back through the gaps of pump and motor does not turn the wheels.

    phi = -p / 100 bar P^(e - 1) F^h (1 + q (|v| / v_0 - 1)),   P^2 = (p^2 + p_0^2) / ((100 bar)^2 + p_0^2)
    p = sign(dp) max(|dp| - p_s, 0)

dp pressure difference of the lines in bar (+ driving forward), p what of it leaks and P its size over 100 bar, e its
power: 1/2 through sharp orifices, 1 through narrow gaps, more where the pressure widens them; p_0 = 20 bar rounds the
root at no pressure; p_s pressure in bar below which nothing leaks, as through a relief valve that weeps. F = exp((T -
50 degC) / 33 K) fluidity of the oil at its temperature T, h its power: 1 in narrow gaps, 0 where orifices are sharp, or
T is not recorded or stays. q how far the loss grows with the speed (`stroke`), v measured speed in m/s, v_0 = 1.5 m/s.
Source: leakage of hydrostatic machines, Merritt, Hydraulic Control Systems, Wiley 1967, chapters 2 (orifices) and 4
(Q_l = C dp, laminar).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value, clip, sign, where
from cruise.effects.fluidity import REFERENCE_C, fluidity
from cruise.effects.low_pass import held_over
from cruise.effects.stroke import STROKE_SHARE, factor
from cruise.signals import OUTPUT, Signals

USUAL_BAR: Final = 100.0  # bar
ROUND_BAR: Final = 20.0  # bar, p_0


@dataclass(frozen=True, slots=True)
class Leakage(Effect):
    """phi = -line_pressure_bar / 100, its size beyond onset_bar to the power `exponent`, times what stroke and oil add.

    It has no unit; the speed that 100 bar cost is the fitted coefficient.
    """

    name = "leakage"
    stage = Stage.LOAD
    needs = ("line_pressure_bar",)
    helps = (OUTPUT, "oil_temperature_c")
    spare = ("stroke_share", "onset_bar", "thinning")
    parameters: ClassVar = {
        "exponent": Parameter("-", 0.5, 1.6, 1.0, "power of the pressure; 0.5 orifices, 1 gaps, more if they widen"),
        "stroke_share": STROKE_SHARE,
        "onset_bar": Parameter("bar", 0.0, 200.0, 0.0, "pressure below which nothing leaks; a relief valve that weeps"),
        "thinning": Parameter("-", 0.0, 1.5, 0.0, "power of the oil's fluidity by which warm oil leaks more; 0 none"),
    }
    about: ClassVar = About(
        physics="Between pistons, valve plates and housings stand gaps of some micrometres, through which oil flows "
        "from the high to the low pressure line in proportion to the pressure difference, or to a power of it near "
        "one; a relief valve that does not close any more weeps from a pressure on. What leaks does not reach the "
        "motor: the wheels turn slower under load, and faster while the machine is pushed. Where nothing holds the "
        "swash plate, the pressure pushes it back as well, the further the more it is out. The pressure itself "
        "rises with every acceleration and every hill, so that it is a consequence of the motion as well: pressure "
        "that lasts is evidence, its peaks during a step of current are not.",
        equation="phi = -sign(dp) (max(|dp| - p_s, 0) / 100 bar)^e F^h (1 + q (|v| / 1.5 m/s - 1))",
        source="Merritt, Hydraulic Control Systems, Wiley 1967, chapters 2 and 4 (orifices, laminar leakage)",
        signature="the residual follows minus the line pressure, with the same factor uphill, in deep soil and with a "
        "full bin",
        look_alikes=("grade", "rolling_resistance", "oil_temperature", "crop_load", "engine_droop"),
        experiment="constant current and engine speed at 1 m/s on level ground, the brake pedal pressed lightly three "
        "times for 10 s: pressure without slope, mass or crop; again with the oil 20 degC warmer, which multiplies "
        "leakage and leaves the others",
    )

    exponent: float = 1.0
    stroke_share: float = 0.0
    onset_bar: float = 0.0
    thinning: float = 0.0

    def start(self, like: Value) -> State:
        """The speed in m/s that was measured last: not known yet."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The present pressure difference, at the speed that was measured before."""
        phi = self._leaked(signals) * factor(self.stroke_share, state)
        measured_mps = signals.get(OUTPUT, math.nan)
        return phi, where(measured_mps == measured_mps, measured_mps, state)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once."""
        measured_mps = held_over(np.asarray(signals.get(OUTPUT, np.full(len(past_speeds), np.nan)), float))
        before_mps = np.concatenate([[np.nan], measured_mps[:-1]])
        return self._leaked(signals) * factor(self.stroke_share, before_mps), measured_mps

    def _leaked(self, signals: Signals) -> Value:
        """phi at the usual stroke."""
        pressure_bar = signals["line_pressure_bar"]
        pressure_bar = sign(pressure_bar) * clip(abs(pressure_bar) - self.onset_bar, 0.0, math.inf)
        square = (pressure_bar**2 + ROUND_BAR**2) / (USUAL_BAR**2 + ROUND_BAR**2)
        oil_c = signals.get("oil_temperature_c", REFERENCE_C)
        thinner = fluidity(where(oil_c == oil_c, oil_c, REFERENCE_C), self.thinning)  # NaN: not measured
        return -pressure_bar / USUAL_BAR * square ** (0.5 * (self.exponent - 1.0)) * thinner
