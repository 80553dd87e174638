"""Blocks of time, the units in which correlated errors are drawn anew.

Blocks are contiguous, whole within one recording, and several times as long as errors are correlated: twice the horizon
of the prediction, whose errors overlap, and 10 s of soil. Source: H. R. Kuensch, Annals of Statistics 17 (1989) 1217.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.recording import Recording

BLOCK_S: Final = 10.0  # s; soil and slopes are correlated over some seconds at driving speed
HORIZONS: Final = 2.0  # a block is this many horizons at least
DRAWS: Final = 500
SEED: Final = 1


def block_numbers(recordings: Sequence[Recording], horizon: int) -> np.ndarray:
    """The number of the block (N,) of every sample of all recordings, one after the other."""
    numbers, first = [], 0
    for one in recordings:
        length = max(round(BLOCK_S / one.dt_s), round(HORIZONS * horizon), 1)
        count = max(round(len(one) / length), 1)
        own = np.arange(len(one)) * count // max(len(one), 1)
        numbers.append(first + own)
        first += count
    return np.concatenate(numbers)


def bootstrap(values: np.ndarray, blocks: np.ndarray, draws: int = DRAWS) -> np.ndarray:
    """Means (draws,) or (draws, m) of `values` (N,) or (N, m) with the blocks drawn anew."""
    sums, counts = block_sums(values, blocks)
    weights = drawn(len(counts), draws)
    total = (weights @ counts).astype(float)
    return (weights @ sums) / (total if sums.ndim == 1 else total[:, None])


def block_sums(values: np.ndarray, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum of `values` (N,) or (N, m) over every block, and the samples in it; blocks without a sample are left out."""
    _, own = np.unique(blocks, return_inverse=True)
    counts = np.bincount(own)
    if values.ndim == 1:
        return np.bincount(own, values), counts
    return np.column_stack([np.bincount(own, column) for column in values.T]), counts


def drawn(blocks: int, draws: int = DRAWS) -> np.ndarray:
    """How often every block is drawn, (draws, blocks)."""
    rng = np.random.default_rng(SEED)
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=draws)
