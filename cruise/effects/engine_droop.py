"""Engine droop: the diesel gives way under load, and the pump's flow with it, where its speed is not recorded.

    g(L) = 1 - delta L / 100

L engine torque in percent of the torque available at this speed, delta share of the speed that is lost at full load.
Source: ISO 3046-4 (speed droop of a governed engine); SAE J1939-71, SPN 92 (the signal). Electronic governors hold 0 to
5 %, mechanical ones up to 8 %; more is an engine that is lugged down its full-load curve.
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Parameter, Stage, State, Value
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class EngineDroop(Effect):
    """g = 1 - droop_share engine_load_pct / 100."""

    name = "engine_droop"
    stage = Stage.GAIN
    needs = ("engine_load_pct",)
    parameters: ClassVar = {
        "droop_share": Parameter("-", 0.0, 0.4, 0.0, "share of the engine speed that is lost at full load"),
    }
    about: ClassVar = About(
        physics="A governor with droop lets the engine settle at a lower speed the more torque is asked of it, and an "
        "engine at its limit falls down its full-load curve. The pump turns with the crankshaft, so that the machine "
        "slows down by the same share, whatever took the torque: crop in the threshing drum, a slope, the drive "
        "itself. Once the engine speed is recorded, engine_speed says the same from the cause itself.",
        equation="g = 1 - delta L / 100 %",
        source="ISO 3046-4 (speed droop); SAE J1939-71, SPN 92",
        signature="the residual is proportional to minus speed times engine load, at standstill there is none",
        look_alikes=("engine_speed", "power_limit", "crop_load", "speed_droop", "grade"),
        experiment="constant current at 1.5 m/s on level ground, the unloading auger or the threshing unit engaged for "
        "30 s and disengaged again, then the same at 0.5 m/s: the loss of speed falls to a third with droop and stays "
        "with a load force. The drive must not move the load itself, so no step of current meanwhile",
    )

    droop_share: float = 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, less what the engine has given way."""
        return value * (1.0 - 0.01 * self.droop_share * signals["engine_load_pct"]), state
