"""How much more quickly the speed changes than just before, though no command did it: a force that came at once.

    S(x) = sum_i i (n + 1 - i) (x_(k-n+i) - x_(k-2n+i)) 6 / ((n + 1) (n + 2)),   i = 1 ... n,   T = n frames

x change of the speed within a frame, in m/s. S is the slope of the least-squares line through the speed of the last T
less that of the T before, times T: in m/s, what a new force of S / T in m/s2 adds within T. Of x only what no command
explains counts, beside what the drive itself does meanwhile and, by the currents on their way, is about to do: a model
that errs in how much or when errs by a share of that. With a line through every reading noise moves S by less than the
difference of three readings would.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

OVER_S: Final = 0.4  # T, s: a force comes within less, a hill within some seconds


class Suddenness:
    """`more_mps` is |S| of what no command explains, `own_mps` the greatest |S| of the rest within the last 2 T.

    `same_mps` is the greatest of the rest in the same direction as the first. Both count what is still to come, too.
    """

    def __init__(self, frame_s: float) -> None:
        n = max(round(OVER_S / frame_s), 1)
        i = np.arange(1, n + 1)
        weights = i * (n + 1 - i) * 6.0 / ((n + 1) * (n + 2))
        self._weights = np.concatenate([-weights, weights])
        self.unexpected: deque[float] = deque([0.0] * 2 * n, maxlen=2 * n)
        self.expected: deque[float] = deque([0.0] * 2 * n, maxlen=2 * n)
        self.own: deque[float] = deque([0.0] * 2 * n, maxlen=2 * n)
        self.more_mps = self.own_mps = self.same_mps = 0.0

    def take(self, expected_mps: float, unexpected_mps: float, coming_mps: Sequence[float] = ()) -> None:
        """One frame on, with the two parts of the change of the speed in it; what is not known was none.

        `coming_mps` is what the first will be in the frames to come.
        """
        known = math.isfinite(expected_mps) and math.isfinite(unexpected_mps)
        self.expected.append(expected_mps if known else 0.0)
        self.unexpected.append(unexpected_mps if known else 0.0)
        more_mps = float(self._weights @ self.unexpected)
        moved = np.correlate([*self.expected, *coming_mps], self._weights)
        self.own.append(float(moved[0]))
        own = (*self.own, *moved.tolist())
        self.more_mps, self.own_mps = abs(more_mps), max(map(abs, own))
        self.same_mps = max(0.0, max(own) if more_mps > 0.0 else -min(own))
