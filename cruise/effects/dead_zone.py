"""Dead zone: below a threshold current the pump's servo does not move and no oil flows.

    f(u) = sign(u) max(|u| - u_0, 0)

u solenoid current in mA, u_0 threshold in mA. Source: section IV.C and Fig. 4 of Coen et al. 2005 ("a dead zone visible
for small and large currents"); proportional pump controls of this class start at about a third of full current.
"""

from dataclasses import dataclass
from typing import ClassVar

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value, clip
from cruise.signals import Signals


@dataclass(frozen=True, slots=True)
class DeadZone(Effect):
    """f(u) = sign(u) max(|u| - threshold_ma, 0), in mA."""

    name = "dead_zone"
    stage = Stage.COMMAND
    needs = ()
    parameters: ClassVar = {
        "threshold_ma": Parameter("mA", 0.0, 800.0, 0.0, "current at which the servo begins to move"),
    }
    about: ClassVar = About(
        physics="The spool's overlap and the centring springs of the servo must be overcome before the swash plate "
        "leaves its middle. Below the threshold the machine stands, whatever the current.",
        equation="f(u) = sign(u) max(|u| - u_0, 0)",
        source="Coen et al. 2005, section IV.C, Fig. 4",
        signature="the residual depends on |u| with a kink, and vanishes at high current once the gain is refitted",
        look_alikes=("coulomb_friction", "quadratic_gain", "hysteresis"),
        experiment="a slow ramp from zero through the threshold and back, in both directions of travel",
    )

    threshold_ma: float = 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """What is left of the current beyond the threshold."""
        return value - clip(value, -self.threshold_ma, self.threshold_ma), state

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The threshold on top of the value; the whole dead zone for zero."""
        if value == 0.0:
            return Inverse(-self.threshold_ma, self.threshold_ma)
        current_ma = value + (self.threshold_ma if value > 0 else -self.threshold_ma)
        return Inverse(current_ma, current_ma)
