"""How much more quickly the speed changes than just before, though no command did it: a force that came at once.

    S(x) = sum_i i (n + 1 - i) (x_(k-n+i) - x_(k-2n+i)) 6 / ((n + 1) (n + 2)),   i = 1 ... n,   T = n frames

x change of the speed within a frame, in m/s. S is the slope of the least-squares line through the speed of the last T
less that of the T before, times T: in m/s, what a new force of S / T in m/s2 adds within T. Of x only what no command
explains counts, beside what the drive itself does meanwhile: a model that errs in how much or when errs by a share of
that. With a line through every reading noise moves S by less than the difference of three readings would.
"""

import math
from collections import deque
from typing import Final

import numpy as np

OVER_S: Final = 0.4  # T, s: a force comes within less, a hill within some seconds


class Suddenness:
    """`more_mps` is |S| of what no command explains, `own_mps` the greatest |S| of the rest within the last 2 T."""

    def __init__(self, frame_s: float) -> None:
        n = max(round(OVER_S / frame_s), 1)
        i = np.arange(1, n + 1)
        weights = i * (n + 1 - i) * 6.0 / ((n + 1) * (n + 2))
        self._weights = np.concatenate([-weights, weights])
        self.unexpected: deque[float] = deque([0.0] * 2 * n, maxlen=2 * n)
        self.expected: deque[float] = deque([0.0] * 2 * n, maxlen=2 * n)
        self.own: deque[float] = deque([0.0] * 2 * n, maxlen=2 * n)
        self.more_mps = 0.0

    @property
    def own_mps(self) -> float:
        """What the drive itself does, by the model."""
        return max(self.own)

    def take(self, expected_mps: float, unexpected_mps: float) -> None:
        """One frame on, with the two parts of the change of the speed in it; what is not known was none."""
        known = math.isfinite(expected_mps) and math.isfinite(unexpected_mps)
        self.expected.append(expected_mps if known else 0.0)
        self.unexpected.append(unexpected_mps if known else 0.0)
        self.more_mps, own_mps = (abs(float(self._weights @ one)) for one in (self.unexpected, self.expected))
        self.own.append(own_mps)
