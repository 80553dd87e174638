"""Quadratic gain: the pump's stroke grows faster, or slower, than the current.

    f(u) = u (1 + q s) / (1 + r s^2),   s = |u| / u_ref

u current beyond the dead zone in mA, u_ref = 1000 mA, q curvature and r bend, both without unit: r = 0 is the
parabola of section IV.C of Coen et al. 2005 ("in between there seems to be a quadratic relationship between input
current and ground speed"). A servo that is metered by a half bridge follows x^2 / (1 + x^2), x its opening over that
of the fixed orifice: a parabola that bends back as x nears 1, which is f for a large q, with r = x^2 at u_ref. Source:
M. Jelali, A. Kroll, Hydraulic Servo-systems (2003), ch. 4.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value
from cruise.signals import Signals

REFERENCE_MA: Final = 1000.0  # mA, makes the curvature a number of order one


@dataclass(frozen=True, slots=True)
class QuadraticGain(Effect):
    """f(u) = u (1 + curvature s) / (1 + bend s^2) in mA, s = |u| / 1000 mA; odd, for both directions."""

    name = "quadratic_gain"
    stage = Stage.COMMAND
    needs = ()
    parameters: ClassVar = {
        "curvature": Parameter(
            "-", -0.4, 10.0, 0.0, "growth of the gain with the current, per 1000 mA, at low currents"
        ),
        "bend": Parameter("-", 0.0, 4.0, 0.0, "how soon the curve bends back; 0 is a parabola"),
    }
    about: ClassVar = About(
        physics="Spool geometry, the spring's characteristic and the flow forces make the servo's stroke a curved "
        "function of the current, which begins as a parabola and bends back as the spool opens. The same step of "
        "current gives more speed at a medium current than at a low one.",
        equation="f(u) = u (1 + q s) / (1 + r s^2),  s = |u| / 1000 mA",
        source="Coen et al. 2005, section IV.C, Fig. 4, Table III; Jelali and Kroll 2003, ch. 4 (half bridge)",
        signature="the residual correlates with u^2 once the linear part is taken away",
        look_alikes=("dead_zone", "saturation", "speed_droop"),
        experiment="small steps about three levels of current: low, middle, high",
    )

    curvature: float = 0.0
    bend: float = 0.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The curved characteristic."""
        share = abs(value) / REFERENCE_MA
        return value * (1.0 + self.curvature * share) / (1.0 + self.bend * share * share), state

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The root of the quadratic equation on the rising branch; refused beyond its vertex."""
        # s + q s^2 = w (1 + r s^2) is (q - r w) s^2 + s - w = 0, with w = |v| in units of the reference.
        wanted = abs(value) / REFERENCE_MA
        discriminant = 1.0 + 4.0 * (self.curvature - self.bend * wanted) * wanted
        if discriminant < 0.0:
            return Inverse(math.nan, math.nan, refused=f"no current gives {value:.0f} mA of drive: beyond the vertex")
        # This form of the root has no cancellation for small q and gives u = v for q = r = 0.
        current_ma = 2.0 * value / (1.0 + math.sqrt(discriminant))
        return Inverse(current_ma, current_ma)
