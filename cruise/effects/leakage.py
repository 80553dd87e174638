"""Leakage: oil that slips back through the gaps of pump and motor does not turn the wheels.

    phi = -dp / 100 bar (1 + q (|v| / v_0 - 1))

dp pressure difference of the lines in bar (+ driving forward), the last factor as in `stroke`. Source: laminar leakage
Q_l = C dp of hydrostatic machines, Merritt, Hydraulic Control Systems, Wiley 1967, chapter 4.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cruise.effects.effect import About, Effect, Stage, State, Value, where
from cruise.effects.stroke import STROKE_SHARE, factor
from cruise.signals import OUTPUT, Signals


@dataclass(frozen=True, slots=True)
class Leakage(Effect):
    """phi = -line_pressure_bar / 100 (1 + stroke_share (|v| / 1.5 m/s - 1)), without unit.

    The speed that 100 bar cost is the fitted coefficient.
    """

    name = "leakage"
    stage = Stage.LOAD
    needs = ("line_pressure_bar",)
    helps = (OUTPUT,)
    spare = "stroke_share"
    parameters: ClassVar = {"stroke_share": STROKE_SHARE}
    about: ClassVar = About(
        physics="Between pistons, valve plates and housings stand gaps of some micrometres, through which oil flows "
        "from the high to the low pressure line in proportion to the pressure difference. What leaks does not reach "
        "the motor: the wheels turn slower under load, and faster while the machine is pushed. Where nothing holds the "
        "swash plate, the pressure pushes it back as well, the further the more it is out. The pressure itself "
        "rises with every acceleration and every hill, so that it is a consequence of the motion as well: pressure "
        "that lasts is evidence, its peaks during a step of current are not.",
        equation="phi = -dp / 100 bar (1 + q (|v| / 1.5 m/s - 1))",
        source="Merritt, Hydraulic Control Systems, Wiley 1967, chapter 4 (laminar leakage)",
        signature="the residual follows minus the line pressure, with the same factor uphill, in deep soil and with a "
        "full bin",
        look_alikes=("grade", "rolling_resistance", "oil_temperature", "crop_load", "engine_droop"),
        experiment="constant current and engine speed at 1 m/s on level ground, the brake pedal pressed lightly three "
        "times for 10 s: pressure without slope, mass or crop; again with the oil 20 degC warmer, which multiplies "
        "leakage and leaves the others",
    )

    stroke_share: float = 0.0

    def start(self, like: Value) -> State:
        """The speed in m/s that was measured last: not known yet."""
        return like * math.nan

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The present pressure difference, at the speed that was measured before."""
        phi = -0.01 * signals["line_pressure_bar"] * factor(self.stroke_share, state)
        measured_mps = signals.get(OUTPUT, math.nan)
        return phi, where(measured_mps == measured_mps, measured_mps, state)

    def over(
        self, values: Value, past_speeds: np.ndarray, signals: Mapping[str, np.ndarray], dt_s: float
    ) -> tuple[Value, State]:
        """The whole recording at once, where the speed has no hole."""
        measured_mps = signals.get(OUTPUT)
        if measured_mps is None or not np.isfinite(measured_mps).all():
            return Effect.over(self, values, past_speeds, signals, dt_s)
        before_mps = np.concatenate([[np.nan], measured_mps[:-1]])
        return -0.01 * signals["line_pressure_bar"] * factor(self.stroke_share, before_mps), measured_mps
