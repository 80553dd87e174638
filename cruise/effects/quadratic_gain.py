"""Quadratic gain: the pump's stroke grows faster, or slower, than the current.

    f(u) = v (1 + q s) / (1 + r s^2),   s = |v| / u_ref,   v = u [((u / u_ref)^2 + e^2) / (1 + e^2)]^((n - 1) / 2)

u current beyond the dead zone in mA, u_ref = 1000 mA, v the current to the power of n and s = |v| / u_ref, q curvature
and r bend, both without unit: r = 0 is the parabola of section IV.C of Coen et al. 2005 ("in between there seems to be
a quadratic relationship between input current and ground speed"). A servo that is metered by a half bridge follows x^2
/ (1 + x^2), x its opening over that of the fixed orifice: a parabola that bends back as x nears 1, which is f for a
large q, with r = x^2 at u_ref. n power of the current, 1 for none: notches of a spool open by a power of their own,
less than 1 where most is there at once and hardly more, as a high power would be a dead zone; e = 0.01, below which it
is a straight line. Source: M. Jelali, A. Kroll, Hydraulic Servo-systems (2003), ch. 4.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final

from cruise.effects.effect import About, Effect, Inverse, Parameter, Stage, State, Value
from cruise.signals import Signals

REFERENCE_MA: Final = 1000.0  # mA, makes the curvature a number of order one
EDGE: Final = 0.01  # e: 10 mA, an infinite slope at no current is no machine's
NEWTON: Final = 8  # steps of the inverse of the power, each of which doubles the digits
SMALLEST_MA: Final = 1e-100  # no logarithm of less is sure to be one


@dataclass(frozen=True, slots=True)
class QuadraticGain(Effect):
    """f(u) = v (1 + curvature s) / (1 + bend s^2) in mA, s = |v| / 1000 mA, v a power of u; odd, for both ways."""

    name = "quadratic_gain"
    stage = Stage.COMMAND
    needs = ()
    spare = ("exponent",)
    parameters: ClassVar = {
        "curvature": Parameter(
            "-", -0.4, 10.0, 0.0, "growth of the gain with the current, per 1000 mA, at low currents"
        ),
        "bend": Parameter("-", 0.0, 4.0, 0.0, "how soon the curve bends back; 0 is a parabola"),
        "exponent": Parameter("-", 0.5, 1.2, 1.0, "power of the current that is curved so; 1 is the current itself"),
    }
    about: ClassVar = About(
        physics="Spool geometry, the spring's characteristic and the flow forces make the servo's stroke a curved "
        "function of the current, which begins as a parabola and bends back as the spool opens. The same step of "
        "current gives more speed at a medium current than at a low one.",
        equation="f(u) = v (1 + q s) / (1 + r s^2),  s = |v| / 1000 mA,  v = u (|u| / 1000 mA)^(n - 1)",
        source="Coen et al. 2005, section IV.C, Fig. 4, Table III; Jelali and Kroll 2003, ch. 4 (half bridge)",
        signature="the residual correlates with u^2 once the linear part is taken away",
        look_alikes=("dead_zone", "saturation", "speed_droop"),
        experiment="small steps about three levels of current: low, middle, high",
    )

    curvature: float = 0.0
    bend: float = 0.0
    exponent: float = 1.0

    def step(self, value: Value, past_speed: Value, signals: Signals, state: State, dt_s: float) -> tuple[Value, State]:
        """The curved characteristic."""
        value = self._powered(value)
        share = abs(value) / REFERENCE_MA
        return value * (1.0 + self.curvature * share) / (1.0 + self.bend * share * share), state

    def _powered(self, value: Value) -> Value:
        """v, in mA."""
        if isinstance(self.exponent, float) and self.exponent == 1.0:
            return value
        share = value / REFERENCE_MA
        return value * ((share * share + EDGE**2) / (1.0 + EDGE**2)) ** (0.5 * (self.exponent - 1.0))

    def _rooted(self, value: float) -> float:
        """u for v, by Newton's method in the logarithms of both, in which v is nearly a straight line of u."""
        if self.exponent == 1.0 or abs(value) < SMALLEST_MA:
            return value
        wanted, share = abs(value) / REFERENCE_MA, (abs(value) / REFERENCE_MA) ** (1.0 / max(self.exponent, 1.0))
        for _ in range(NEWTON):
            found = self._powered(share * REFERENCE_MA) / REFERENCE_MA
            slope = 1.0 + (self.exponent - 1.0) * share * share / (share * share + EDGE**2)
            share *= math.exp((math.log(wanted) - math.log(found)) / slope)
        return math.copysign(share * REFERENCE_MA, value)

    def inverse(self, value: float, signals: Signals, state: State) -> Inverse:
        """The root of the quadratic equation on the rising branch; refused beyond its vertex."""
        # s + q s^2 = w (1 + r s^2) is (q - r w) s^2 + s - w = 0, with w = |v| in units of the reference.
        wanted = abs(value) / REFERENCE_MA
        discriminant = 1.0 + 4.0 * (self.curvature - self.bend * wanted) * wanted
        if discriminant < 0.0:
            return Inverse(math.nan, math.nan, refused=f"no current gives {value:.0f} mA of drive: beyond the vertex")
        # This form of the root has no cancellation for small q and gives u = v for q = r = 0.
        current_ma = self._rooted(2.0 * value / (1.0 + math.sqrt(discriminant)))
        return Inverse(current_ma, current_ma)
