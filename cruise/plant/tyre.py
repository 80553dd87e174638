"""The driven tyres: how much faster the wheels turn than the ground passes, for a traction.

    mu = 0.88 (1 - exp(-0.1 B)) (1 - exp(-7.5 s)),    B = 1 / (beta - 0.04), at most 80

mu traction over the load of the driven axle [-], s slip [-], v_wheel = v / (1 - s) while driving and the mirror image
while braking, B mobility number of the soil [-], beta rolling resistance coefficient [-], from which B is inferred.

Source: W.W. Brixius, Traction prediction equations for bias ply tires, ASAE paper 87-1622 (1987), with his classes of
soil: hard 80, firm 55, tilled 25, soft 15 to 20.
"""

from math import exp, log, sqrt

HARDEST_MOBILITY = 80.0  # concrete and road, Brixius' upper end
ROLLING_OF_THE_TYRE = 0.04  # part of Brixius' motion resistance that does not depend on the soil
SLIP_RATE = 7.5
FULL_USE = 0.95  # share of the greatest traction from where slip grows linearly: beyond, the wheels spin
STANDSTILL_MPS = 0.05  # slip is a share of the speed, which at standstill is at least this creep of the tread


def greatest_traction(rolling_resistance: float) -> float:
    """Traction [-] at large slip on a soil with a rolling resistance coefficient [-]."""
    soil_part = max(rolling_resistance - ROLLING_OF_THE_TYRE, 1.0 / HARDEST_MOBILITY)
    return 0.88 * (1.0 - exp(-0.1 / soil_part))


def slip_speed_mps(use: float, speed_mps: float) -> tuple[float, float, float]:
    """Wheel speed minus ground speed [m/s], and its derivatives to `use` and to the speed.

    `use` is the traction relative to the greatest one [-], + forward.
    """
    share = abs(use)
    over = max(share - FULL_USE, 0.0)
    share -= over
    slip = -log(1.0 - share) / SLIP_RATE
    slope = 1.0 / (SLIP_RATE * (1.0 - share))
    slope /= (1.0 - slip) ** 2
    slip = slip / (1.0 - slip) + slope * over
    speed_scale_mps = sqrt(speed_mps * speed_mps + STANDSTILL_MPS * STANDSTILL_MPS)
    signed_slip = slip if use >= 0.0 else -slip
    return signed_slip * speed_scale_mps, slope * speed_scale_mps, signed_slip * speed_mps / speed_scale_mps
