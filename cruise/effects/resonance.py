"""Resonance: something elastic between pump and ground lets the speed swing after every change.

    G(s) = w^2 / (s^2 + 2 z w s + w^2)     so that     na + 2

G(s) from the drive to the speed, w natural frequency in rad/s, z damping ratio. It is an effect of *structure*: two
more coefficients a_i hold the pair of complex poles, `restructured` gives the orders of the model that has it. Source:
Merritt, Hydraulic Control Systems, Wiley 1967, chapter 6 (oil column against inertia).
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Stage, State, Value
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class Resonance(Effect):
    """The order of the model grows by two; the drive signal passes unchanged."""

    name = "resonance"
    stage = Stage.DYNAMICS
    needs = ()
    parameters: ClassVar = {}
    about: ClassVar = About(
        physics="The oil in the lines is a spring, the tyres are springs, and so is the mast that carries a sensor; "
        "against the machine's mass each makes an oscillator, of a tenth of a hertz to some hertz. A step of current "
        "then rings before the speed settles. What swings in the drive train comes after the drive; what swings beside "
        "it, a load on springs or a body whose lower end carries the radar, lets the sensor go ahead at first. This is "
        "a matter of structure: adding it gives the model a pair of complex poles, two more coefficients a_i, and no "
        "term of its own. Frequency and damping follow from the fitted poles. What rings faster than half the sampling "
        "rate can't be seen.",
        equation="G(s) = w^2 / (s^2 + 2 z w s + w^2): na + 2",
        source="Merritt, Hydraulic Control Systems, Wiley 1967, chapter 6",
        signature="the residual's autocorrelation swings and decays with one period; its spectrum has one peak, at the "
        "same frequency after every step, whatever the speed",
        look_alikes=("transport_delay", "active_braking", "hysteresis"),
        experiment="a sine sweep of current of 50 mA about 1 m/s from 0.1 to 3 Hz in 60 s, then single steps of "
        "50 and of 200 mA: a resonance has one peak of the gain with a fall of phase by 180 degrees, and rings with "
        "the same period after small and large steps",
    )

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The drive as it is: the poles are in the model's structure."""
        return value, state

    def restructured(self, na: int, nb: int, delay: int, period_s: float) -> tuple[int, int, int]:
        """Two poles more."""
        return na + 2, nb, delay
