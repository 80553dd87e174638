"""Running means and sums over what was measured."""

import numpy as np


def trailing_mean(values: np.ndarray, count: int) -> np.ndarray:
    """Mean (N,) of the last `count` samples that were measured, fewer at the start; NaN where there are none."""
    count = max(count, 1)
    measured = np.isfinite(values)
    sums = np.concatenate([[0.0], np.cumsum(np.where(measured, values, 0.0))])
    numbers = np.concatenate([[0], np.cumsum(measured)])
    first = np.maximum(np.arange(len(values)) + 1 - count, 0)
    total, number = sums[1:] - sums[first], numbers[1:] - numbers[first]
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def sums_beside(values: np.ndarray, half: int, gap: int) -> np.ndarray:
    """Sum (N,) of the `half` samples before and after each, without the `gap` next to it and without itself."""
    window = np.ones(2 * half + 1)
    window[half - gap : half + gap + 1] = 0.0
    return np.convolve(values, window)[half:][: len(values)]
