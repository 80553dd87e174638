"""The engine speed by its readings, at whatever rate they come: how quickly it changes, and whether it is believed.

    r = |n_k - n_j| / max(t_k - t_j, 0.1 s),   n_k is believed while |n_k - n_b| <= r_max max(t_k - t_(k-1), T)

n readings in 1/min at t in s, j the newest one that is 0.1 s older than k, b the last one believed, T period of the
frames: readings that were held up come at once. One that has jumped is not believed until it is back, or the engine
stands, whoever drives.
"""

import math
from collections import deque
from typing import Final

RATE_S: Final = 0.1  # s over which a rate is taken
STANDING_RPM: Final = 400.0  # 1/min, below which an engine stands, whatever was believed of it before
IDLING_RPM: Final = 1000.0  # 1/min, up to which it may start at once


class EngineJump:
    """`rate_rpm_per_s` and `jumped` are the answers."""

    def __init__(self, most_rpm_per_s: float, frame_s: float) -> None:
        self.most_rpm_per_s, self.frame_s = most_rpm_per_s, frame_s
        self.believed_rpm = math.nan
        self.readings: deque[tuple[float, float]] = deque()  # time and engine speed, back to one that is RATE_S old

    def take(self, time_s: float, engine_rpm: float) -> None:
        """One reading."""
        if math.isnan(engine_rpm):
            return
        passed_s = time_s - self.readings[-1][0] if self.readings else math.inf
        jumps = abs(engine_rpm - self.believed_rpm) > self.most_rpm_per_s * max(passed_s, self.frame_s)
        if not jumps or engine_rpm < STANDING_RPM or self.believed_rpm < IDLING_RPM:
            self.believed_rpm = engine_rpm
        self.readings.append((time_s, engine_rpm))
        while len(self.readings) > 1 and time_s - self.readings[1][0] > RATE_S - 1e-6:
            self.readings.popleft()

    @property
    def rate_rpm_per_s(self) -> float:
        """How quickly it changes."""
        if not self.readings:
            return math.nan
        (first_s, first_rpm), (last_s, last_rpm) = self.readings[0], self.readings[-1]
        return abs(last_rpm - first_rpm) / max(last_s - first_s, RATE_S)

    @property
    def jumped(self) -> bool:
        """Whether the last reading is not believed."""
        return bool(self.readings) and self.readings[-1][1] != self.believed_rpm
