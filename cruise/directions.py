"""Which way a machine goes by its input, as a recording shows it: a sign that is turned, a middle that is not zero.

    backward: u_(k-d) < u_0,   forward: u_(k-d) > u_0

u input, d dead time in samples, u_0 the input at which the machine stands. A pump that reverses is steered by a current
of either sign, a lever or a valve driver by one that has its middle at half of all. Dead zone, stop and hysteresis are
counted from there, so that an input whose middle is elsewhere hides them. A gauge behind a shuttle valve and a sensor
at a toothed wheel show the size of a pressure and a speed, whichever way the machine goes.
"""

import math
from typing import Final

import numpy as np

from cruise.sampling import FloatArray

FALLS: Final = -0.5  # correlation of input and speed below which one of them has the wrong sign
FAST: Final = 0.1  # of the greatest speed, from which a machine goes somewhere,
SLOW: Final = 0.02  # and below which it stands
OFTEN: Final = 0.02  # of the time, that it goes either way, and that it stands for its input then to be the middle
LONGEST_S: Final = 2.0  # s from an input to the speed
STEP_S: Final = 0.1  # s between dead times that are tried
WRONG: Final = 0.05  # of the time that it goes one way, in which the input may say the other
FOLLOWS: Final = 0.3  # correlation of input and speed while it goes backward: one that rolls back down has none
MEAN_S: Final = 0.5  # s over which a speed has no noise to speak of
PLACES: Final = 200  # of the range of the input, at which its middle is looked for


def falls(inputs: FloatArray, speeds_mps: FloatArray) -> bool:
    """Whether the speed falls as the input rises, by the straight line between them; both (N,) without holes.

    Where both have one sign all the same, a controller holds a speed: it gives more where the machine is slower.
    """
    if len(inputs) == 0 or not np.ptp(inputs) or not np.ptp(speeds_mps) or np.dot(inputs, speeds_mps) >= 0.0:
        return False
    return bool(np.corrcoef(inputs, speeds_mps)[0, 1] < FALLS)


def middle(inputs: FloatArray, speeds_mps: FloatArray, dt_s: float) -> float:
    """The input (N,) of one sign at which a machine stands that goes both ways, NaN in holes; 0 where it is zero.

    Zero is the middle of an input that has both signs, and of a machine that goes one way, or back by itself only.
    """
    known = np.isfinite(inputs) & np.isfinite(speeds_mps)
    if not known.any() or np.percentile(inputs[known], 1) < 0.0 < np.percentile(inputs[known], 99):
        return 0.0
    fast_mps = FAST * _greatest(speeds_mps[known])
    found = (_parted(inputs, speeds_mps, fast_mps, lag) for lag in _lags(len(inputs), dt_s))
    wrong, place, at_mps = min(found, key=lambda one: one[0])
    if not wrong <= WRONG:
        return 0.0
    slow = np.abs(speeds_mps) < SLOW / FAST * fast_mps
    stands = at_mps[slow & np.isfinite(at_mps)]
    return float(np.median(stands)) if len(stands) >= OFTEN * known.sum() else place


def unsigned(values: FloatArray, speeds_mps: FloatArray) -> bool:
    """Whether a column (N,) that turns with the motion shows only its size, NaN in holes: a machine goes both ways."""
    ways = _ways(values, speeds_mps, FAST * _greatest(speeds_mps))
    if not ways:
        return False
    return bool(np.median(values[ways[1]]) > 0.0) and all(np.mean(values[way] < 0.0) <= OFTEN for way in ways)


def along(values: FloatArray, speeds_mps: FloatArray, dt_s: float) -> FloatArray:
    """A column (N,) with the sign of the motion, its mean over half a second, and while it stands of that before."""
    size = 2 * round(0.5 * MEAN_S / dt_s) + 1
    means_mps = np.convolve(np.nan_to_num(speeds_mps), np.full(size, 1.0 / size), "same")[: len(values)]
    moves = np.abs(means_mps) > SLOW * _greatest(speeds_mps)
    latest = np.maximum.accumulate(np.where(moves, np.arange(len(values)), 0))
    return np.where(means_mps[latest] < 0.0, -values, values)


def _ways(values: FloatArray, speeds_mps: FloatArray, fast_mps: float) -> tuple[np.ndarray, ...]:
    """Where (N,) a column is known and the machine goes forward, and backward; nothing where it goes one way only."""
    known = np.isfinite(values) & np.isfinite(speeds_mps)
    ways = known & (speeds_mps > fast_mps), known & (speeds_mps < -fast_mps)
    return ways if min(way.sum() for way in ways) > OFTEN * known.sum() else ()


def _greatest(speeds_mps: FloatArray) -> float:
    """The size of the speed, in m/s, without what is rare; infinite where none is known."""
    known_mps = np.abs(speeds_mps[np.isfinite(speeds_mps)])
    return float(np.percentile(known_mps, 99)) if len(known_mps) else math.inf


def _lags(count: int, dt_s: float) -> range:
    return range(0, min(round(LONGEST_S / dt_s), count // 2) + 1, max(round(STEP_S / dt_s), 1))


def _parted(inputs: FloatArray, speeds_mps: FloatArray, fast_mps: float, lag: int) -> tuple[float, float, FloatArray]:
    """The share of the time that a speed is on the wrong side of an input `lag` samples before, that input, all such.

    Infinite where the machine doesn't go both ways, or its speed doesn't follow the input backward.
    """
    before = np.concatenate([np.full(lag, math.nan), inputs[: len(inputs) - lag]])
    ways = _ways(before, speeds_mps, fast_mps)
    if not ways or not _follows(before[ways[1]], speeds_mps[ways[1]]):
        return math.inf, 0.0, before
    known, (ahead, back) = np.isfinite(before) & np.isfinite(speeds_mps), ways
    forward, backward = np.sort(before[ahead]), np.sort(before[back])
    places = np.linspace(before[known].min(), before[known].max(), PLACES)
    early = np.searchsorted(forward, places) / len(forward)
    late = 1.0 - np.searchsorted(backward, places) / len(backward)
    wrong = np.maximum(early, late)
    best = np.flatnonzero(wrong == wrong.min())
    return float(wrong.min()), float(places[best].mean()), before


def _follows(inputs: FloatArray, speeds_mps: FloatArray) -> bool:
    if not np.ptp(inputs) or not np.ptp(speeds_mps):
        return False
    return bool(np.corrcoef(inputs, speeds_mps)[0, 1] >= FOLLOWS)
