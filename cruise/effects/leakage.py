"""Leakage: oil that slips back through the gaps of pump and motor does not turn the wheels.

    phi = -dp / 100 bar

dp pressure difference of the lines in bar (+ driving forward). Source: laminar leakage Q_l = C dp of hydrostatic
machines, Merritt, Hydraulic Control Systems, Wiley 1967, chapter 4.
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Stage, State, Value
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class Leakage(Effect):
    """phi = -line_pressure_bar / 100, without unit: the speed that 100 bar cost is the fitted coefficient."""

    name = "leakage"
    stage = Stage.LOAD
    needs = ("line_pressure_bar",)
    parameters: ClassVar = {}
    about: ClassVar = About(
        physics="Between pistons, valve plates and housings stand gaps of some micrometres, through which oil flows "
        "from the high to the low pressure line in proportion to the pressure difference. What leaks does not reach "
        "the motor: the wheels turn slower under load, and faster while the machine is pushed. The pressure itself "
        "rises with every acceleration and every hill, so that it is a consequence of the motion as well: pressure "
        "that lasts is evidence, its peaks during a step of current are not.",
        equation="phi = -dp / 100 bar",
        source="Merritt, Hydraulic Control Systems, Wiley 1967, chapter 4 (laminar leakage)",
        signature="the residual follows minus the line pressure, with the same factor uphill, in deep soil and with a "
        "full bin",
        look_alikes=("grade", "rolling_resistance", "oil_temperature", "crop_load", "engine_droop"),
        experiment="constant current and engine speed at 1 m/s on level ground, the brake pedal pressed lightly three "
        "times for 10 s: pressure without slope, mass or crop; again with the oil 20 degC warmer, which multiplies "
        "leakage and leaves the others",
    )

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The present pressure difference."""
        return -0.01 * signals["line_pressure_bar"], state
