"""Speed droop: the faster the machine goes, the less each further milliampere gives.

    g(v) = 1 - delta |v_(k-1)|^e,   v in m/s

v ground speed one sample ago, delta share of the drive that is lost at 1 m/s, e exponent: 1 for what rises with the
speed (back-EMF, viscous drag of rotors), 2 for what rises with its square (flow through ports and valves, churning).
With e = 1 a drive that gives v_0 without droop settles at v = v_0 / (1 + delta v_0). Where g < 0 the drive brakes, as a
motor above its no-load speed.

Source: R. Isermann, Mechatronic Systems (2005), ch. 5 (DC drive: torque falls linearly with speed by back-EMF); H.E.
Merritt, Hydraulic Control Systems (1967), ch. 4 (losses of pumps and motors that grow with speed).
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class SpeedDroop(Effect):
    """g = 1 - droop_per_mps |v_(k-1)|^exponent, v in m/s."""

    name = "speed_droop"
    stage = Stage.GAIN
    needs = ()
    reads_speed = True
    parameters: ClassVar = {
        "droop_per_mps": Parameter("s/m", 0.0, 0.5, 0.0, "share of the drive that is lost at 1 m/s"),
        "exponent": Parameter("-", 0.8, 2.5, 1.0, "power of the speed; 1 back-EMF and drag, 2 ports and churning"),
    }
    about: ClassVar = About(
        physics="The torque of a motor falls with its speed: in an electric drive the back-EMF takes voltage away, in "
        "a hydraulic one churning and flow losses take pressure and the charge pump must fill more. The same current "
        "gives full force at standstill and little near the top speed. So the machine reaches less than its gain at "
        "low speed promises, and it gets there sooner, because the droop is a feedback that moves the pole with the "
        "current.",
        equation="g = 1 - delta |v_(k-1)|^e",
        source="Isermann 2005, ch. 5 (DC drive); Merritt 1967, ch. 4 (losses of pumps and motors)",
        signature="the residual is proportional to minus current times speed, or a power of it; the time constant "
        "shortens as the current rises",
        look_alikes=("quadratic_gain", "saturation", "engine_droop", "power_limit", "leakage"),
        experiment="from standstill and from cruising speed, steps to the same two levels of current, 500 and 1000 mA: "
        "with droop the first second after the step depends on the speed at which it was given, with a curved or "
        "saturating characteristic of the current it does not",
    )

    droop_per_mps: float = 0.0
    exponent: float = 1.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, less what the speed takes away."""
        return value * (1.0 - self.droop_per_mps * abs(past_speed) ** self.exponent), state
