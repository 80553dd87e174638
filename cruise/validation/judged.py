"""A fit with its held-out errors, and by how much one errs less than another.

    gain of a candidate  G = 1 - sqrt((L_c / L) (W_c / W))

L mean squared held-out error at least 3 s ahead, W that of what an autoregression leaves of it (`disturbance.py`), with
the candidate (c) and without.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.validation.explanation import Explanation
from cruise.validation.fitting import Fit

FEW_BLOCKS: Final = 3  # of which a spread says nothing,
USUAL_BLOCKS: Final = 8  # and from which on what is sure was found to be so as often as it should
BOOTSTRAPS: Final = 400


@dataclass(frozen=True, eq=False)
class Judged:
    """A fit with its held-out errors: mean squares in every block of time (B,), raw and whitened."""

    candidate: str
    fit: Fit
    folds: tuple[np.ndarray, ...]  # the parameters that each fold's training part wants
    error_mps: np.ndarray  # (N,), held out, NaN where nothing is judged
    raw: np.ndarray
    white: np.ndarray
    weight: np.ndarray  # (B,) judged samples of each block

    @property
    def explanation(self) -> Explanation:
        return self.fit.explanation

    @property
    def loss(self) -> float:
        """Mean squared held-out error in m2/s2."""
        return float(np.average(self.raw, weights=self.weight))

    @property
    def white_loss(self) -> float:
        return float(np.average(self.white, weights=self.weight))


def gain(without: Judged, with_it: Judged) -> float:
    """G, from the raw and the whitened error in equal parts: slow evidence counts, but not as if it were much."""
    raw = with_it.loss / without.loss
    white = with_it.white_loss / without.white_loss
    return 1.0 - float(np.sqrt(raw * white))


def noise_in(loss: float, white_mps: float) -> float:
    """The white part of the measured speed, in m2/s2, within a loss that nobody can take away.

    None where there is more of it than that: what errs less shows that it is the drive's own motion, and no floor.
    """
    return white_mps**2 if white_mps**2 < loss else 0.0


def sureness(without: Judged, with_it: Judged, rng: np.random.Generator) -> float:
    """How many standard errors the log ratio of the losses lies below zero: bootstrap over the blocks of time."""
    both = (without.weight > 0) & (with_it.weight > 0)
    if not both.any():
        return 0.0
    weight = without.weight[both]
    picks = rng.integers(0, len(weight), (BOOTSTRAPS, len(weight)))
    ratios = []
    for one, other in ((without.raw, with_it.raw), (without.white, with_it.white)):
        first = (one[both] * weight)[picks].sum(axis=1)
        second = (other[both] * weight)[picks].sum(axis=1)
        ratios.append(np.log(second / first))
    mean = 0.5 * (ratios[0] + ratios[1])
    spread = float(mean.std()) * max(few(len(weight)) / few(USUAL_BLOCKS), 1.0)
    return float(-mean.mean() / spread) if spread > 0 else 0.0


def few(blocks: int) -> float:
    """By how much a standard error over so few blocks has to be larger: as Student's t is spread, at worst infinite."""
    return math.sqrt((blocks - 1) / (blocks - FEW_BLOCKS)) if blocks > FEW_BLOCKS else math.inf
