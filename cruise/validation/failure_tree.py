"""Regimes that nobody named: a shallow tree over all recorded signals, judged on data that did not grow it.

A regression tree of the squared error (CART) is grown on every other stretch of time; its depth is the one that
predicts best between halves of these. The stretches between say how much error stands in each leaf, so that a leaf
which noise made holds no more than its share of time there. A leaf is reported where its excess,

    sum_(k in leaf) e_k^2 / sum_k e_k^2  -  share of time,

has an interval (block bootstrap, corrected for the number of leaves) above zero, and was met in several blocks.
Sources: L. Breiman et al., Classification and Regression Trees, 1984; S. Athey, G. Imbens, Proc. National Academy of
Sciences 113 (2016) 7353 (honest trees).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from sklearn.tree import DecisionTreeRegressor

from cruise.recording import Recording
from cruise.validation.blocks import block_numbers, block_sums, drawn
from cruise.validation.quantities import BRAKING, TURNS, Quantity, quantities
from cruise.validation.regimes import FEWEST_BLOCKS, LEVEL, in_words

DEEPEST: Final = 3  # splits one after the other: more than three conditions are no regime anyone can drive
LEAST_TIME: Final = 0.03  # share of time of a leaf
STRETCH: Final = 2  # blocks that stay together in one half: fewer edges between the halves
CLIPPED: Final = 0.99  # quantile of squared errors beyond which they count no more: one spike is no regime
SEED: Final = 3


@dataclass(frozen=True, slots=True)
class Leaf:
    """A regime in words, and its shares of time and squared error in data that the tree had not seen."""

    where: str
    keys: tuple[str, ...]  # the quantities that it is about
    time_share: float
    error_share: float
    excess_low: float  # bounds of error_share - time_share, corrected for the number of leaves
    excess_high: float
    mean_error_mps: float

    @property
    def sentence(self) -> str:
        """As an engineer would say it."""
        return (
            f"{100 * self.error_share:.0f} % of the squared error stands in {100 * self.time_share:.0f} % of the time: "
            f"{self.where}"
        )


@dataclass(frozen=True, slots=True)
class FailureTree:
    """The leaves that hold more error than time, the greatest excess first; none where the tree found nothing.

    `explained` is the share of the variance of the squared error that the tree explains on unseen data.
    """

    leaves: tuple[Leaf, ...]
    explained: float
    shown: tuple[str, ...]  # the quantities that it could choose from


def failure_tree(recordings: Sequence[Recording], errors_mps: Sequence[np.ndarray], horizon: int) -> FailureTree:
    """Grow and judge the tree on errors (N,) per recording; `horizon` in samples."""
    error = np.concatenate(errors_mps)
    known = np.isfinite(error)
    error, squared = error[known], error[known] ** 2
    offered = [one for one in quantities(recordings) if one.key not in (TURNS, BRAKING)]  # signs of what is there
    blocks = block_numbers(recordings, horizon)[known]
    half = blocks // STRETCH % 2 == 1
    shown = tuple(one.words for one in offered)
    if not offered or half.all() or not half.any() or not squared.sum() > 0.0:
        return FailureTree((), 0.0, shown)
    matrix = np.column_stack([one.values[known] for one in offered])
    target = np.minimum(squared, np.quantile(squared, CLIPPED))
    grow, judge = ~half, half
    depth = _depth(matrix[grow], target[grow], blocks[grow])
    if depth == 0:
        return FailureTree((), 0.0, shown)
    tree = _grown(depth, matrix[grow], target[grow])
    predicted = tree.predict(matrix[judge])
    left = float(np.mean((target[judge] - predicted) ** 2) / np.mean((target[judge] - target[grow].mean()) ** 2))
    at = tree.apply(matrix[judge])
    numbers = np.unique(at)
    inside = (at[:, None] == numbers).astype(float)
    columns = np.column_stack([squared[judge], inside, inside * squared[judge][:, None]])
    sums, counts = block_sums(columns, blocks[judge])
    weights = drawn(len(counts))
    totals = weights @ sums
    size = len(numbers)
    excess = totals[:, 1 + size :] / totals[:, :1] - totals[:, 1 : 1 + size] / (weights @ counts)[:, None]
    tail = 0.5 * LEVEL / size
    lows, highs = np.quantile(excess, (tail, 1.0 - tail), axis=0)
    leaves = []
    for i, number in enumerate(numbers.tolist()):
        met = int(np.sum(sums[:, 1 + i] > 0.0))
        if lows[i] > 0.0 and met >= FEWEST_BLOCKS:
            conditions = _path(tree, number)
            mine = at == number
            lacking = {k: float(np.mean(~np.isfinite(matrix[judge][mine, k]))) for k in conditions}
            leaves.append(
                Leaf(
                    where=", ".join(_said(offered[k], *ends, lacking[k]) for k, ends in conditions.items()),
                    keys=tuple(offered[k].key for k in conditions),
                    time_share=float(mine.mean()),
                    error_share=float(squared[judge][mine].sum() / squared[judge].sum()),
                    excess_low=float(lows[i]),
                    excess_high=float(highs[i]),
                    mean_error_mps=float(error[judge][mine].mean()),
                )
            )
    leaves.sort(key=lambda leaf: leaf.time_share - leaf.error_share)
    return FailureTree(tuple(leaves), 1.0 - left, shown)


def _grown(depth: int, matrix: np.ndarray, target: np.ndarray) -> DecisionTreeRegressor:
    least = max(int(LEAST_TIME * len(target)), 1)
    return DecisionTreeRegressor(max_depth=depth, min_samples_leaf=least, random_state=SEED).fit(matrix, target)


def _depth(matrix: np.ndarray, target: np.ndarray, blocks: np.ndarray) -> int:
    """The depth, 0 for no split, that predicts one half of the stretches best from the other."""
    half = blocks // (2 * STRETCH) % 2 == 1
    if half.all() or not half.any():
        return 0
    missed = np.zeros(DEEPEST + 1)
    for train, test in ((half, ~half), (~half, half)):
        missed[0] += np.sum((target[test] - target[train].mean()) ** 2)
        for depth in range(1, DEEPEST + 1):
            tree = _grown(depth, matrix[train], target[train])
            missed[depth] += np.sum((target[test] - tree.predict(matrix[test])) ** 2)
    return int(np.argmin(missed))


def _path(tree: DecisionTreeRegressor, leaf: int) -> dict[int, tuple[float | None, float | None]]:
    """The range of every quantity (by its number) on the way to a leaf, None for an open end."""
    parts = tree.tree_
    ranges: dict[int, tuple[float | None, float | None]] = {}
    node = leaf
    while node:
        parent = int(np.flatnonzero((parts.children_left == node) | (parts.children_right == node))[0])
        quantity, threshold = int(parts.feature[parent]), float(parts.threshold[parent])
        low, high = ranges.get(quantity, (None, None))
        if parts.children_left[parent] == node:
            ranges[quantity] = (low, threshold if high is None else min(high, threshold))
        else:
            ranges[quantity] = (threshold if low is None else max(low, threshold), high)
        node = parent
    return dict(reversed(ranges.items()))


def _said(quantity: Quantity, low: float | None, high: float | None, lacking: float) -> str:
    """What the samples of a leaf have in common, where a share of them is `lacking` the quantity.

    An end at infinity parts them by whether it was measured at all.
    """
    if lacking == 1.0:
        return f"{quantity.words} not measured"
    if low is None and high == np.inf:
        return f"{quantity.words} measured"
    said = _range_in_words(quantity, low, None if high == np.inf else high)
    return f"{said} or not measured" if lacking >= LEAST_TIME else said


def _range_in_words(quantity: Quantity, low: float | None, high: float | None) -> str:
    """The range in words, its ends as short as the spread of the quantity allows."""
    if quantity.states:
        kept = [
            words
            for value, words in quantity.states
            if (low is None or value > low) and (high is None or value <= high)
        ]
        return " or ".join(kept)
    spread = float(np.ptp(np.nanquantile(quantity.values, (0.02, 0.98))))
    digits = 1 - int(np.floor(np.log10(spread))) if spread > 0.0 else 3

    def short(value: float | None) -> float | None:
        return None if value is None else round(value, digits) + 0.0

    return in_words(quantity.key, quantity.words, quantity.unit, short(low), short(high))
