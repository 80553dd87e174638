"""What is lost at a great stroke of the pump beyond what is lost at a small one.

    factor  1 + q (|v| / v_0 - 1)

v speed in m/s as measured a sample ago (v_0 where it is not), v_0 = 1.5 m/s, that of a harvest, q share of the loss
that grows with the speed. Leakage costs the same at any stroke; a pump whose swash plate nothing holds gives up a part
of the stroke that it has, so that a force takes a part of the gain. Source: Coen et al. 2005, Table VI: +3.3 degrees
leave 90 % of the DC gain.
"""

from typing import Final

from cruise.effects.effect import Parameter, Value, where

USUAL_MPS: Final = 1.5  # m/s, v_0
STROKE_SHARE: Final = Parameter("-", 0.0, 1.0, 0.0, "how far the loss grows with the speed; 1 is in proportion")


def factor(share: Value, speed_mps: Value) -> Value:
    """By how much the loss is more than at the usual speed; 1 where the speed is NaN."""
    known_mps = where(speed_mps == speed_mps, abs(speed_mps), USUAL_MPS)
    return 1.0 + share * (known_mps / USUAL_MPS - 1.0)
