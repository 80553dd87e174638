"""How far wheel and radar are from the drive's speed beyond what is usual: a sensor that changed shows there.

    e = s - (1 + k) v,   k = sum c v (s - v) / (P + sum c v^2),   c = 1 / (1 + (v' / R)^2)
    allowed: |e| <= e_0 + |v'| tau + |v| k_0 sqrt(P / (P + sum c v^2))

s speed by wheel or radar, v that of the drive, as late as theirs, in m/s; k share by which the other usually is ahead:
radius of a tyre, angle of a radar and slip are shares of the speed, k_0 of what size before anything is known. The sums
fade, as soil and temperature change. While the speed changes, at a rate v' in m/s2, what comes tau later differs, and
teaches little. P is one second at 1 m/s. Least squares through the origin, with the prior k_0 as doubt.

What teaches has to have been undisputed for a while: a fault is no habit before anybody has said so, and stays none.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

FADES_S: Final = 60.0  # s, time constant of the sums
CALM_MPS2: Final = 0.3  # R, m/s2
PRIOR_M2_PER_S: Final = 1.0  # P
HELD_S: Final = 1.0  # s without dispute before something teaches
LATE_S: Final = 0.1  # s by which a mean over 0.1 s, and its frame, come later than the drive's own; tau likewise
RATE_S: Final = 0.2  # s over which the rate is taken


@dataclass(slots=True)
class Share:
    """Of one other sensor: the two sums."""

    product_m2_per_s: float = 0.0
    square_m2_per_s: float = 0.0

    def usual_mps(self, speed_mps: float) -> float:
        """k v."""
        return speed_mps * self.product_m2_per_s / (PRIOR_M2_PER_S + self.square_m2_per_s)

    @property
    def doubt(self) -> float:
        """Standard deviation of the share over that before anything was known."""
        return math.sqrt(PRIOR_M2_PER_S / (PRIOR_M2_PER_S + self.square_m2_per_s))


@dataclass(frozen=True, slots=True)
class Lesson:
    """What one frame would teach."""

    weight_s: float  # c times the frame
    speed_mps: float
    ahead_mps: tuple[float, float]  # wheel and radar, NaN where there is none


@dataclass(slots=True)
class UsualShares:
    """Wheel and radar beside the drive, frame by frame; `used` is the share of what is allowed, NaN for no other."""

    frame_s: float
    shares: tuple[Share, Share] = field(default_factory=lambda: (Share(), Share()))
    past: deque[float] = field(default_factory=deque)  # the drive's speed
    lessons: deque[Lesson] = field(default_factory=deque)
    used: float = math.nan

    def take(self, speed_mps: float, others_mps: tuple[float, float], allowed_mps: float, doubted: float) -> None:
        """One frame on, with e_0 and k_0."""
        if not math.isfinite(speed_mps):
            self.past.clear()
            self.lessons.clear()
            self.used = math.nan
            return
        self.past.append(speed_mps)
        while len(self.past) > round(RATE_S / self.frame_s) + 1:
            self.past.popleft()
        passed_s = (len(self.past) - 1) * self.frame_s
        rate_mps2 = abs(speed_mps - self.past[0]) / passed_s if passed_s else 0.0
        late_mps = self.past[-1 - min(round(LATE_S / self.frame_s), len(self.past) - 1)]
        wheel, radar = (other_mps - late_mps for other_mps in others_mps)
        away = [
            abs(ahead_mps - share.usual_mps(late_mps))
            / (allowed_mps + LATE_S * rate_mps2 + doubted * share.doubt * abs(late_mps))
            for share, ahead_mps in zip(self.shares, (wheel, radar), strict=True)
            if math.isfinite(ahead_mps)
        ]
        self.used = min(away, default=math.nan)
        if self.used > 1.0:
            self.lessons.clear()
        else:
            weight_s = self.frame_s / (1.0 + (rate_mps2 / CALM_MPS2) ** 2)
            self.lessons.append(Lesson(weight_s, late_mps, (wheel, radar)))
        self._learn()

    def _learn(self) -> None:
        """The lesson that has been undisputed for long enough."""
        held = len(self.lessons) > round(HELD_S / self.frame_s)
        lesson = self.lessons.popleft() if held else Lesson(0.0, 0.0, (0.0, 0.0))
        kept = math.exp(-self.frame_s / FADES_S)
        for share, ahead_mps in zip(self.shares, lesson.ahead_mps, strict=True):
            weight_s = lesson.weight_s if math.isfinite(ahead_mps) else 0.0
            product_m2_per_s = weight_s * lesson.speed_mps * ahead_mps if weight_s else 0.0
            share.product_m2_per_s = kept * share.product_m2_per_s + product_m2_per_s
            share.square_m2_per_s = kept * share.square_m2_per_s + weight_s * lesson.speed_mps**2
