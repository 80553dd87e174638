"""Quadratic gain: the pump's stroke grows faster, or slower, than the current.

    f(u) = u (1 + q |u| / u_ref)

u current beyond the dead zone in mA, u_ref = 1000 mA, q curvature without unit. Source: section IV.C of Coen et al.
2005 ("in between there seems to be a quadratic relationship between input current and ground speed").
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value
from cruise.signals import Signals

REFERENCE_MA: Final = 1000.0  # mA, makes the curvature a number of order one


@dataclass(frozen=True, slots=True)
class QuadraticGain(Effect):
    """f(u) = u (1 + curvature |u| / 1000 mA), in mA; odd, so that it serves both directions of travel."""

    name = "quadratic_gain"
    stage = Stage.COMMAND
    needs = ()
    parameters: ClassVar = {
        "curvature": Parameter("-", -0.4, 5.0, 0.0, "relative growth of the gain from zero to 1000 mA"),
    }
    about: ClassVar = About(
        physics="Spool geometry, the spring's characteristic and the flow forces make the servo's stroke a curved "
        "function of the current. The same step of current gives more speed at a high current than at a low one.",
        equation="f(u) = u (1 + q |u| / 1000 mA)",
        source="Coen et al. 2005, section IV.C, Fig. 4, Table III",
        signature="the residual correlates with u^2 once the linear part is taken away",
        look_alikes=("dead_zone", "saturation", "speed_droop"),
        experiment="small steps about three levels of current: low, middle, high",
    )

    curvature: float = 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The curved characteristic."""
        return value * (1.0 + self.curvature / REFERENCE_MA * abs(value)), state

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The root of the quadratic equation on the rising branch; refused beyond its vertex."""
        q = self.curvature / REFERENCE_MA
        discriminant = 1.0 + 4.0 * q * abs(value)
        if discriminant < 0.0:
            return Inverse(math.nan, math.nan, refused=f"no current gives {value:.0f} mA of drive: beyond the vertex")
        # The form 2 v / (1 + sqrt(...)) of the root has no cancellation for small q and gives u = v for q = 0.
        current_ma = 2.0 * value / (1.0 + math.sqrt(discriminant))
        return Inverse(current_ma, current_ma)
