"""How late the measured current is behind its command, while that moves: too late shows in the current alone.

    J_l = mean (i_k - <i> - (c_(k-l) - <c_l>))^2 over the last N frames,   late by sqrt(min J_near) - sqrt(min J_far)

i measured current, c command l frames ago, in mA, <> their means over the N frames: what the output stage is off by
drops out. `near` are the delays that a drive may have, `far` those beyond. The answer is by how many mA RMS the best
delay beyond explains the current better; a command that stands still makes it 0, whatever the delay.
"""

import math
from collections import deque
from typing import Final

import numpy as np

OVER_S: Final = 1.0  # s of current that are compared
FAR_S: Final = 0.8  # s, the longest delay that is tried: beyond, the current does not follow at all


class Lateness:
    """`late_ma` is the answer, NaN while there is not enough of the past."""

    def __init__(self, frame_s: float, allowed_s: float) -> None:
        self.over, self.far = round(OVER_S / frame_s), round(FAR_S / frame_s)
        self.near = round(allowed_s / frame_s)
        self.commands: deque[float] = deque(maxlen=self.over + self.far)
        self.currents: deque[float] = deque(maxlen=self.over)
        self.late_ma = math.nan

    def take(self, commanded_ma: float, current_ma: float) -> None:
        """One frame on; the past ends where nothing is commanded or measured."""
        self.late_ma = math.nan
        if not (math.isfinite(commanded_ma) and math.isfinite(current_ma)):
            self.commands.clear()
            self.currents.clear()
            return
        self.commands.append(commanded_ma)
        self.currents.append(current_ma)
        if len(self.commands) == self.commands.maxlen:
            self.late_ma = self._late_ma()

    def _late_ma(self) -> float:
        sent = np.lib.stride_tricks.sliding_window_view(np.array(self.commands), self.over)[::-1]  # by l
        current = np.array(self.currents)
        off = (current - current.mean()) - (sent - sent.mean(axis=1, keepdims=True))
        rms_ma = np.sqrt((off**2).mean(axis=1))
        return float(rms_ma[: self.near + 1].min() - rms_ma[self.near + 1 :].min())
