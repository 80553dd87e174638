"""Does the program get its turn when it should? The times of its ticks, as the program's own clock shows them.

    p_k = p_(k-1) + s (t_k - t_(k-1) - p_(k-1))

p running mean of the time between two ticks in s, s share of the newest one. After a pause the drive may have gone to
neutral by itself, and a clock that runs back makes old readings look new: both are the end of a drive.
"""

import math
from typing import Final

PAUSE_S: Final = 0.15  # s between two ticks, beyond which the drive may have gone to neutral
PERIODS: Final = 3.0  # or so many of the program's own
SHARE: Final = 0.1  # half a second at 20 Hz


class Pace:
    """`last_s`, `mean_s` and `passed_s`, the time between the last two ticks, are all its state."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.last_s = self.passed_s = math.nan
        self.mean_s = period_s

    def tick(self, now_s: float) -> bool:
        """One tick; whether it comes when it may."""
        passed_s, self.last_s = now_s - self.last_s, now_s
        self.passed_s = passed_s
        if math.isnan(passed_s):
            return True
        self.mean_s += SHARE * (passed_s - self.mean_s)
        return 0.0 < passed_s <= max(PAUSE_S, PERIODS * self.period_s)

    @property
    def words(self) -> str:
        """What a tick that did not come when it may says."""
        return f"no turn for {self.passed_s:.2f} s" if self.passed_s > 0.0 else "the clock ran back"

    def restart(self) -> None:
        """Begin anew after a pause of the program's own."""
        self.last_s = math.nan

    @property
    def slowness(self) -> float:
        """Mean time between two ticks over the period."""
        return self.mean_s / self.period_s
