"""Engine speed: the pump is driven by the diesel, so that its flow follows the crankshaft.

    g(n) = (min(n, n_f) / n_r)^e

n engine speed in rpm, n_r = 2100 rpm, e exponent: 1 where flow is displacement times shaft speed, n_f engine speed from
which on more of it drives the machine no faster, as under a control that takes the plate back below it only. Source:
section V.A of Coen et al. 2005, which scales the predicted speed with the engine's relative power instead; the exponent
lets the data choose.
"""

from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import RATED_RPM, About, Effect, Parameter, Stage, State, Value, clip
from cruise.signals import Signals

NEVER_RPM: Final = 3000.0  # rpm, above what a diesel of this class turns


@dataclass(frozen=True, slots=True)
class EngineSpeed(Effect):
    """g = (engine_speed_rpm / 2100 rpm)^exponent, up to full_rpm."""

    name = "engine_speed"
    stage = Stage.GAIN
    needs = ("engine_speed_rpm",)
    spare = ("full_rpm",)
    parameters: ClassVar = {
        "exponent": Parameter("-", 0.0, 2.0, 0.0, "power of the relative engine speed; 1 is displacement times speed"),
        "full_rpm": Parameter(
            "rpm", 1000.0, NEVER_RPM, NEVER_RPM, "engine speed beyond which nothing is gained; 3000 none"
        ),
    }
    about: ClassVar = About(
        physics="A hydrostatic pump delivers its displacement once a revolution. With the swash plate held, the "
        "machine slows down with the engine. Controls that follow the engine, so as not to stall it, take the plate "
        "back below a certain speed and leave it alone above.",
        equation="g = (min(n, n_f) / 2100 rpm)^e",
        source="Coen et al. 2005, section V.A, Fig. 6",
        signature="the residual is proportional to speed times the deviation of the engine speed",
        look_alikes=("engine_droop", "power_limit", "leakage"),
        experiment="constant current, the throttle lowered from 2100 to 1500 rpm and raised again",
    )

    exponent: float = 1.0
    full_rpm: float = NEVER_RPM

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The gain so far, scaled by the present shaft speed."""
        driving_rpm = clip(signals["engine_speed_rpm"], 0.0, self.full_rpm)  # no diesel turns backward
        return value * (driving_rpm / RATED_RPM) ** self.exponent, state
