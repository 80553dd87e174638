"""The curve from a verdict's margin to its confidence that blind trials ask for, by maximum likelihood.

    c(m) = 1 / (1 + (M/m)^k),   maximise  sum log c(m) over right answers + sum log(1 - c(m)) over wrong ones

m margin of a verdict, M the margin at which it is as often right as wrong, k how steeply that changes. In log m this is
logistic regression: D. R. Cox, J. R. Stat. Soc. B 20 (1958) 215.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from scipy.optimize import minimize

from .score import Line, brier_score

LEAST_MARGIN: Final = 1e-9  # that of the program itself: no confidence without a margin
STEEPEST: Final = 20.0  # where right and wrong don't overlap the likelihood has no end
FLATTEST: Final = 0.05


@dataclass(frozen=True, slots=True)
class Curve:
    """M and k, and the Brier scores of the confidence as it was stated and as the curve would state it."""

    half_margin: float
    steepness: float
    answers: int
    brier_before: float
    brier_after: float

    def confidence(self, margin: float) -> float:
        """Of a verdict with this margin."""
        return confidence(margin, self.half_margin, self.steepness)

    def restated(self, lines: Sequence[Line]) -> list[Line]:
        """The lines, their confidence by this curve."""
        return [msgspec.structs.replace(line, confidence=self.confidence(line.margin)) for line in lines]


def confidence(margin: float, half_margin: float, steepness: float) -> float:
    """The curve, without overflow far below the half margin."""
    return float(0.5 * (1.0 + np.tanh(0.5 * steepness * math.log(max(margin, LEAST_MARGIN) / half_margin))))


def calibrated(lines: Sequence[Line]) -> Curve:
    """The curve of these answers. ValueError where all are right or all are wrong: then it could be any."""
    ran = [line for line in lines if not line.failed]
    right = np.array([line.right for line in ran])
    if not (right.any() and not right.all()):
        raise ValueError(f"{int(right.sum())} of {len(ran)} answers are right: there is nothing to calibrate by")
    x = np.log(np.maximum([line.margin for line in ran], LEAST_MARGIN))
    sign = np.where(right, -1.0, 1.0)
    middle = float(np.median(x))

    def surprise(shape: np.ndarray) -> float:
        log_half, log_steepness = shape
        return float(np.logaddexp(0.0, sign * math.exp(log_steepness) * (x - log_half)).mean())

    bounds = [(float(x.min()) - 5.0, float(x.max()) + 5.0), (math.log(FLATTEST), math.log(STEEPEST))]
    starts = [(middle - far, math.log(steepness)) for far in (0.0, 2.0) for steepness in (0.5, 1.5, 4.0)]
    best = min((minimize(surprise, start, bounds=bounds) for start in starts), key=lambda one: one.fun)
    half, steepness = math.exp(best.x[0]), math.exp(best.x[1])
    after = [confidence(line.margin, half, steepness) for line in ran]
    return Curve(half, steepness, len(ran), brier_score(ran), float(np.mean((np.array(after) - right) ** 2)))
