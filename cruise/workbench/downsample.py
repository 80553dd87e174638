"""A curve as few points that look like all of them: of every bucket of time its least and its greatest value."""

import numpy as np


def extremes(time_s: np.ndarray, values: np.ndarray, buckets: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and values (M,), M about 2 `buckets`, of `values` (N,): no spike is lost, and a hole in it stays one.

    A bucket that holds a hole ends with it. Short curves stay as they are.
    """
    count = len(values)
    width = -(-count // buckets)
    if width <= 2:
        return time_s, values
    padded = np.full(width * -(-count // width), np.nan)
    padded[:count] = values
    table = padded.reshape(-1, width)
    holes = ~np.isfinite(table)
    first = np.arange(len(table)) * width
    low = first + np.where(holes, np.inf, table).argmin(axis=1)
    high = first + np.where(holes, -np.inf, table).argmax(axis=1)
    # The padding of the last bucket is no hole of the recording.
    hole = np.where(holes.any(axis=1), first + width - 1 - holes[:, ::-1].argmax(axis=1), low)
    kept = np.unique(np.concatenate([low, high, hole]))
    kept = kept[kept < count]
    return time_s[kept], values[kept]


def window(time_s: np.ndarray, low_s: float, high_s: float) -> slice:
    """The samples from the last one before `low_s` to the first one after `high_s`."""
    start, stop = np.searchsorted(time_s, (low_s, high_s))
    return slice(max(int(start) - 1, 0), int(stop) + 1)
