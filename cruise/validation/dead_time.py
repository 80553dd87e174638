"""A dead time that changes: the drive answers now earlier and now later than the model's constant delay has it.

    e = -theta(t) dv/dt,   theta(t) = -sum_w e dv/dt / (sum_w (dv/dt)^2 + lambda)   or   theta = a + b s
    share  1 - sum (e + theta dv/dt)^2 / sum e^2

e error in m/s, v speed of the model in m/s, theta delay beyond the model's in s, w the 10 s before and after t without
the 3 s next to it, so that no error foretells itself; lambda a tenth of what a window holds on average: where the speed
stands still, nothing is said. s a recorded signal that the drive itself does not move, such as the engine's speed, a
and b by least squares over the other blocks of time: it names what the dead time changes with, and may change quicker
than the windows see. Noise and soil have no share in the change of speed that lasts so long, and a wrong but constant
delay is the fit's to mend; one that changes by hundredths of a second is another shape of step than the model's.
Source: first-order term of v(t - theta); C. H. Knapp, G. C. Carter, IEEE Trans. Acoustics, Speech, and Signal
Processing 24 (1976) 320-327, on delays by correlation.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from cruise.validation.means import sums_beside

HALF_S: Final = 10.0  # s of a window before and after,
GAP_S: Final = 3.0  # s of it left out on either side: errors are like those beside them
LEAST_MOVED: Final = 0.1  # of the mean square change of speed, lambda
SHARE: Final = 0.15  # of the squared error: where it changed 0.36 to 0.82 in six drives of seven, else at most 0.03
BY_SIGNAL: Final = 0.3  # likewise, by a signal, beyond a constant: 0.69 to 0.88 in three, else at most 0.12 in 60
RESOLVED: Final = 0.25  # of a sample's period: what changes by less may be the shape of a step as well
FOLDS: Final = 5  # of the blocks of time
NO_BLOCKS: Final = np.zeros(0, dtype=int)
RANGE_PCT: Final = (5.0, 95.0)  # percentiles between which theta is said to lie, by what the change of speed says of it


@dataclass(frozen=True)
class DeadTime:
    """The share of the squared error, and how much earlier (negative) and later in s the answer comes."""

    share: float = 0.0
    early_s: float = math.nan
    late_s: float = math.nan
    signal: str = ""  # with which it changes, if that is recorded

    @property
    def much(self) -> float:
        """How much it is, over what a dead time that changes must explain."""
        return self.share / SHARE


def dead_time(
    error_mps: np.ndarray,
    modelled_mps: np.ndarray,
    parts: Sequence[slice],
    period_s: float,
    signals: Mapping[str, np.ndarray] = MappingProxyType({}),
    blocks: np.ndarray = NO_BLOCKS,
) -> DeadTime:
    """How the dead time changes within recordings `parts` by error (N,) and speed of the model (N,), holes NaN.

    `signals` (N,) by name, with which it may change; `blocks` (N,) of time, across which that is judged.
    """
    errors, changes, shifts = [], [], []
    for part in parts:
        change = np.gradient(modelled_mps[part]) / period_s if part.stop - part.start > 1 else np.zeros(1)
        known = np.isfinite(error_mps[part]) & np.isfinite(change)
        error, change = np.where(known, error_mps[part], 0.0), np.where(known, change, 0.0)
        errors.append(error)
        changes.append(change)
        shifts.append(_beside(error, change, period_s))
    error, change, shift = (np.concatenate(each) for each in (errors, changes, shifts))
    whole = float(error @ error)
    if whole == 0.0 or not change.any():
        return DeadTime()
    share = 1.0 - float(np.sum((error + shift * change) ** 2)) / whole
    found = DeadTime(share, *_range(shift, change))
    told = [_by_signal(name, one, error, change, blocks % FOLDS) for name, one in signals.items()]
    best = max(told, key=lambda one: one.share, default=found)
    if best.share >= BY_SIGNAL:
        found = best if best.share >= found.share else replace(found, signal=best.signal)
    return found if found.late_s - found.early_s >= RESOLVED * period_s else DeadTime()


def _range(shift_s: np.ndarray, change_mps2: np.ndarray) -> tuple[float, float]:
    early_s, late_s = np.percentile(shift_s, RANGE_PCT, weights=change_mps2**2, method="inverted_cdf")
    return float(early_s), float(late_s)


def _by_signal(
    name: str, signal: np.ndarray, error_mps: np.ndarray, change_mps2: np.ndarray, folds: np.ndarray
) -> DeadTime:
    """How the dead time changes with one signal (N,): what it tells of blocks of time that have not been looked at."""
    known = np.isfinite(signal)
    spread = float(np.std(signal[known])) if known.any() else 0.0
    if spread == 0.0:
        return DeadTime()
    moved = np.where(known, (signal - np.mean(signal[known])) / spread, 0.0)
    columns = change_mps2[:, None] * np.column_stack([np.ones(len(moved)), moved])
    left, constant, shift_s = 0.0, 0.0, np.zeros(len(moved))
    for fold in range(FOLDS):
        shown, unseen = folds != fold, folds == fold
        squares = columns[shown].T @ columns[shown] + 1e-12 * np.eye(2)
        products = columns[shown].T @ error_mps[shown]
        pulled = np.linalg.solve(squares, products)
        shift_s[unseen] = -(pulled[0] + pulled[1] * moved[unseen])
        left += float(np.sum((error_mps[unseen] - columns[unseen] @ pulled) ** 2))
        constant += float(np.sum((error_mps[unseen] - columns[unseen, 0] * products[0] / squares[0, 0]) ** 2))
    return DeadTime((constant - left) / float(error_mps @ error_mps), *_range(shift_s, change_mps2), name)


def _beside(error_mps: np.ndarray, change_mps2: np.ndarray, period_s: float) -> np.ndarray:
    """theta (N,) in s, from what lies beside each moment."""
    half, gap = round(HALF_S / period_s), round(GAP_S / period_s)
    products, squares = (sums_beside(one, half, gap) for one in (error_mps * change_mps2, change_mps2**2))
    least = LEAST_MOVED * 2 * (half - gap) * float(np.mean(change_mps2**2))
    return -products / np.maximum(squares + least, 1e-300)
