"""What a signal is on average where another has a value: means over bins that hold equally many samples."""

from typing import Final

import numpy as np

BINS: Final = 12


def bin_of(values: np.ndarray) -> np.ndarray:
    """The bin (N,) of every value, 0 to BINS - 1; fewer where many values are the same."""
    return np.searchsorted(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)[1:-1]), values)


def mean_there(cell: np.ndarray, values: np.ndarray, seen: np.ndarray | None = None) -> np.ndarray:
    """The mean (N,) of the values in the cell of every sample, over those `seen` (default: all); of all, if of none."""
    mine = np.ones(len(values)) if seen is None else seen.astype(float)
    count, whole = np.bincount(cell, mine), np.bincount(cell, mine * values)
    everywhere = float(mine @ values) / max(float(mine.sum()), 1.0)
    return np.where(count > 0.0, whole / np.maximum(count, 1.0), everywhere)[cell]
