"""Low-pass of first order, exact for what is held over each sample, step by step or over a whole recording.

    z_k = z_(k-1) + l (x_k - z_(k-1)),   l = 1 - exp(-T / tau),   z_0 = x_0

tau time constant in s, 0 for none, T period in s. Source: any textbook of sampled systems (zero-order hold).
"""

import math
from typing import Final

import numpy as np
import scipy  # its signal part, slow to load, is loaded where it is first used: the service does without

from cruise.effects.effect import Value, clip, where

AT_ONCE_S: Final = 1e-9  # s, a low-pass that is none at any period


def share(time_constant_s: Value, dt_s: float) -> Value:
    """l, by which the low-pass moves towards its input within a sample."""
    return -np.expm1(-dt_s / clip(time_constant_s, AT_ONCE_S, math.inf))


def followed(before: Value, now: Value, moved: Value) -> Value:
    """z after this sample, moved by the share l; NaN `before` is not known yet, NaN `now` is a hole and gives one."""
    return where(before == before, before + moved * (now - before), now)


def held_over(values: np.ndarray) -> np.ndarray:
    """The value (N,) that was known last; NaN before the first one."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last >= 0, values[last], np.nan)


def followed_across(values: np.ndarray, time_constant_s: float, dt_s: float) -> np.ndarray:
    """z (N,) of values (N,); in a hole NaN, after it on from where it was."""
    known = np.isfinite(values)
    result = np.full(len(values), np.nan)
    result[known] = followed_over(values[known], time_constant_s, dt_s)
    return result


def followed_over(values: np.ndarray, time_constant_s: float, dt_s: float) -> np.ndarray:
    """z (N,) of values (N,); NaN in a hole, and begun anew after it."""
    rest = math.exp(-dt_s / max(time_constant_s, AT_ONCE_S))
    result = np.full(len(values), np.nan)
    known = np.isfinite(values)
    whole = known.all() and len(values)
    ends = [0, len(values)] if whole else np.flatnonzero(np.diff(known, prepend=False, append=False))
    for first, end in np.reshape(ends, (-1, 2)).tolist():
        begun = [rest * values[first]]
        result[first:end] = scipy.signal.lfilter([1.0 - rest], [1.0, -rest], values[first:end], zi=begun)[0]
    return result
