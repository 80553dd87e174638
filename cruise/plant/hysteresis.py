"""Static hysteresis of the control spool: Bouc-Wen friction, driven by the current instead of by time.

    u_effective = u - w z,    w dz/du = A (1 - |z| (beta sign(z du) + 1 - beta)),    A = 1 / (2 beta),    |z| <= 1

u current [mA], w half width of the loop [mA], z friction's share of its limit [-], beta shape [-]: 1 - beta is the
part of the friction that does not depend on the direction. A stiffness [-]: the greatest with which friction holds a
spool where it is when the current turns around, dz/du = 1 / w at |z| = 1, and never moves it against the current.
Independent of rate, hence static. The equation is linear in z between sign changes of z and du, so that a step of any
size is solved exactly.

Source: Y.K. Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249-263, with n = 1; hysteresis of proportional valves without
position feedback 3 to 8 % of the range (data sheets; the paper, section I.A, names a static hysteresis).
"""

from math import copysign, exp, log
from typing import Annotated

from msgspec import Meta, Struct

from cruise.plant.bounds import NotNegative


class HysteresisSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Size and shape of the loop."""

    half_width_ma: NotNegative = 18.0  # loop of 36 mA, 4.6 % of 375..1150 mA; proportional valves: 10..40
    shape: Annotated[float, Meta(ge=0.5, le=1)] = 0.7  # beta: 0.5 round reversals, 1 the Dahl form; 0.5..1


def advance(settings: HysteresisSettings, friction: float, change_ma: float) -> float:
    """Friction z [-] after the current moved monotonously by `change_ma`."""
    width_ma = settings.half_width_ma
    if change_ma == 0.0 or width_ma == 0.0:
        return friction
    direction = copysign(1.0, change_ma)
    travel = abs(change_ma) / (2.0 * settings.shape * width_ma)
    z = friction * direction
    if z < 0.0:
        slope = 2.0 * settings.shape - 1.0
        to_zero = log(1.0 - slope * z) / slope if slope else -z
        if travel < to_zero:
            z = (z - 1.0 / slope) * exp(-slope * travel) + 1.0 / slope if slope else z + travel
            return z * direction
        travel -= to_zero
        z = 0.0
    return direction * (1.0 - (1.0 - z) * exp(-travel))
