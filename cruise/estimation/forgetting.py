"""How fast to forget: slowly while the innovations are noise, quickly while they say that the machine has changed.

    q = E_fast[e^2] / E_slow[e^2],   M = max(longest / (1 + (q / q_0)^p), shortest),   lambda = 1 - T / M

e innovation of a sample that teaches, E running means, T period. A variable forgetting factor in the spirit of
Fortescue, Kershenbaum and Ydstie, Automatica 17 (1981), and Paleologu et al., IEEE Signal Processing Letters 15
(2008); the slow mean falls quickly and rises slowly, so that a change does not pass for noise.
"""

import msgspec

from cruise.settings import Positive


class ForgettingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Memories are counted in samples that teach."""

    longest_s: Positive = 120.0  # s, while nothing changes: soil and oil change over minutes
    shortest_s: Positive = 4.0  # s, while the machine changes: a few of its own time constants
    fast_s: Positive = 4.0  # s, time constant of the fast mean
    fall_s: Positive = 15.0  # s, time constant of the slow mean downwards: less noise is believed at once
    rise_s: Positive = 300.0  # s, and upwards: more error is a changed machine first, and noise only if it stays
    suspicious: Positive = 2.0  # q_0, ratio of the means at which half the memory is left
    steepness: Positive = 4.0  # p
    outlier: Positive = 9.0  # e^2 relative to the slow mean, beyond which it counts as that: three sigma


class Forgetting:
    """`fast` and `slow`, means of squares in (m/s)^2, are all its state."""

    def __init__(self, settings: ForgettingSettings, period_s: float, noise_variance: float) -> None:
        self.settings = settings
        self.period_s = period_s
        self.fast = self.slow = noise_variance

    def step(self, innovation_mps: float) -> float:
        """The forgetting factor lambda for this sample."""
        settings, square = self.settings, innovation_mps**2
        self.fast += min(self.period_s / settings.fast_s, 1.0) * (square - self.fast)
        bounded = min(square, settings.outlier * self.slow)
        slow_s = settings.rise_s if self.fast > self.slow else settings.fall_s
        self.slow += min(self.period_s / slow_s, 1.0) * (bounded - self.slow)
        suspicion = (self.fast / self.slow / settings.suspicious) ** settings.steepness
        memory_s = max(settings.longest_s / (1.0 + suspicion), settings.shortest_s)
        return 1.0 - min(self.period_s / memory_s, 0.5)
