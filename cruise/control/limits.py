"""The last word on every current that leaves: range, rate, and nothing that is not a number.

It knows nothing of model, setpoint or engagement. Python on Linux is not the safety layer of a machine; this is the
last layer of this program.
"""

import math
from typing import Annotated

import msgspec

Current = Annotated[float, msgspec.Meta(ge=100, le=2000)]  # mA; no coil of this class takes more, and 1.2 is in A
Rate = Annotated[float, msgspec.Meta(gt=0, le=2400)]  # mA/s; full stroke in half a second


class LimitSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the pump may be asked for."""

    current_min_ma: float = 0.0  # mA, the cruise control never reverses
    current_max_ma: Current = 1200.0  # mA, the solenoid's rating (12 V proportional control)
    rate_max_ma_per_s: Rate = 600.0  # mA/s, full stroke in 2 s

    def __post_init__(self) -> None:
        if not 0.0 <= self.current_min_ma < self.current_max_ma:
            raise ValueError("current_min_ma has to be at least 0 and below current_max_ma")


class Limits:
    """`last_ma` is all its state: what was sent last."""

    def __init__(self, settings: LimitSettings) -> None:
        self.settings = settings
        self.last_ma = 0.0

    def neutral(self) -> float:
        """Neutral, at once: an exit is never slowed down here."""
        self.last_ma = 0.0
        return 0.0

    def take_over(self, current_ma: float) -> None:
        """The current that flows when the controller takes over, from which the rate counts."""
        self.last_ma = self._inside(current_ma)

    def step(self, wanted_ma: float, dt_s: float) -> float:
        """The current that may be sent now. What is not a number, or a time that runs back, gives neutral."""
        if not (math.isfinite(wanted_ma) and math.isfinite(dt_s) and dt_s >= 0.0):
            return self.neutral()
        reach, last_ma = self.settings.rate_max_ma_per_s * dt_s, self._inside(self.last_ma)
        self.last_ma = self._inside(min(max(wanted_ma, last_ma - reach), last_ma + reach))
        return self.last_ma

    def _inside(self, current_ma: float) -> float:
        if not math.isfinite(current_ma):
            return 0.0
        return min(max(current_ma, self.settings.current_min_ma), self.settings.current_max_ma)
