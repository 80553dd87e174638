"""The curves from a verdict's margin to its confidence that blind trials ask for, by maximum likelihood.

    c(m) = 1 / (1 + (M/m)^k),   maximise  sum log c(m) over right answers + sum log(1 - c(m)) over wrong ones

m margin of a verdict, M the margin at which it is as often right as wrong, k how steeply that changes. In log m this is
logistic regression: D. R. Cox, J. R. Stat. Soc. B 20 (1958) 215.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from scipy.optimize import minimize

from cruise.validation.confidence import LEAST_MARGIN, answer_of

from .score import Line, brier_score

STEEPEST: Final = 4.0  # where right and wrong don't overlap the likelihood has no end
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


def confidence(margin: float, half_margin: float, steepness: float) -> float:
    """The curve, without overflow far below the half margin."""
    return float(0.5 * (1.0 + np.tanh(0.5 * steepness * math.log(max(margin, LEAST_MARGIN) / half_margin))))


def by_answer(lines: Sequence[Line]) -> dict[str, Curve]:
    """The curve of every kind of answer that was given."""
    kinds: dict[str, list[Line]] = {}
    for line in lines:
        if not line.failed:
            kinds.setdefault(answer_of(line.verdict, line.effects), []).append(line)
    return {kind: calibrated(kinds[kind]) for kind in sorted(kinds)}


def restated(lines: Sequence[Line], curves: Mapping[str, Curve]) -> list[Line]:
    """The lines, their confidence by the curves of their answers."""
    ran = [line for line in lines if not line.failed]
    named = [(line, curves[answer_of(line.verdict, line.effects)]) for line in ran]
    return [msgspec.structs.replace(line, confidence=curve.confidence(line.margin)) for line, curve in named]


def calibrated(lines: Sequence[Line]) -> Curve:
    """The curve of these answers and of one half right and half wrong among them: a few tell no certainty."""
    right = np.array([line.right for line in lines], float)
    x = np.log(np.maximum([line.margin for line in lines], LEAST_MARGIN))
    middle = float(np.median(x))
    margins, hits = np.append(x, [middle, middle]), np.append(right, [1.0, 0.0])
    weight = np.append(np.ones(len(lines)), [0.5, 0.5])

    def surprise(shape: np.ndarray) -> float:
        log_half, log_steepness = shape
        over = math.exp(log_steepness) * (margins - log_half)
        return float(np.sum(weight * (hits * np.logaddexp(0.0, -over) + (1.0 - hits) * np.logaddexp(0.0, over))))

    bounds = [(float(x.min()) - 5.0, float(x.max()) + 5.0), (math.log(FLATTEST), math.log(STEEPEST))]
    starts = [(middle - far, math.log(steepness)) for far in (0.0, 2.0) for steepness in (0.5, 1.5, 4.0)]
    best = min((minimize(surprise, start, bounds=bounds) for start in starts), key=lambda one: one.fun)
    half, steepness = math.exp(best.x[0]), math.exp(best.x[1])
    after = [confidence(line.margin, half, steepness) for line in lines]
    return Curve(half, steepness, len(lines), brier_score(lines), float(np.mean((np.array(after) - right) ** 2)))
