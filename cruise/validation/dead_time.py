"""A dead time that changes: the drive answers now earlier and now later than the model's constant delay has it.

    e = -theta(t) dv/dt,   theta(t) = -sum_w e dv/dt / (sum_w (dv/dt)^2 + lambda)
    share  1 - sum (e + theta dv/dt)^2 / sum e^2

e error in m/s, v speed of the model in m/s, theta delay beyond the model's in s, w the 10 s before and after t without
the 3 s next to it, so that no error foretells itself; lambda a tenth of what a window holds on average: where the speed
stands still, nothing is said. Noise and soil have no share in the change of speed that lasts so long, and a wrong but
constant delay is the fit's to mend. Source: first-order term of v(t - theta); C. H. Knapp, G. C. Carter, IEEE Trans.
Acoustics, Speech, and Signal Processing 24 (1976) 320-327, on delays by correlation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.validation.means import sums_beside

HALF_S: Final = 10.0  # s of a window before and after,
GAP_S: Final = 3.0  # s of it left out on either side: errors are like those beside them
LEAST_MOVED: Final = 0.1  # of the mean square change of speed, lambda
SHARE: Final = 0.15  # of the squared error: where it changed 0.36 to 0.82 in six drives of seven, else at most 0.03
RANGE_PCT: Final = (5.0, 95.0)  # percentiles between which theta is said to lie, by what the change of speed says of it


@dataclass(frozen=True)
class DeadTime:
    """The share of the squared error, and how much earlier (negative) and later in s the answer comes."""

    share: float = 0.0
    early_s: float = math.nan
    late_s: float = math.nan

    @property
    def much(self) -> float:
        """How much it is, over what a dead time that changes must explain."""
        return self.share / SHARE


def dead_time(error_mps: np.ndarray, modelled_mps: np.ndarray, parts: Sequence[slice], period_s: float) -> DeadTime:
    """How the dead time changes within recordings `parts` by error (N,) and speed of the model (N,), holes NaN."""
    errors, changes, shifts = [], [], []
    for part in parts:
        if part.stop - part.start < 2:
            continue
        change = np.gradient(modelled_mps[part]) / period_s
        known = np.isfinite(error_mps[part]) & np.isfinite(change)
        error, change = np.where(known, error_mps[part], 0.0), np.where(known, change, 0.0)
        errors.append(error)
        changes.append(change)
        shifts.append(_beside(error, change, period_s))
    if not errors:
        return DeadTime()
    error, change, shift = (np.concatenate(each) for each in (errors, changes, shifts))
    whole = float(error @ error)
    if whole == 0.0 or not change.any():
        return DeadTime()
    share = 1.0 - float(np.sum((error + shift * change) ** 2)) / whole
    early_s, late_s = np.percentile(shift, RANGE_PCT, weights=change**2, method="inverted_cdf")
    return DeadTime(share, float(early_s), float(late_s))


def _beside(error_mps: np.ndarray, change_mps2: np.ndarray, period_s: float) -> np.ndarray:
    """theta (N,) in s, from what lies beside each moment."""
    half, gap = round(HALF_S / period_s), round(GAP_S / period_s)
    products, squares = (sums_beside(one, half, gap) for one in (error_mps * change_mps2, change_mps2**2))
    least = LEAST_MOVED * 2 * (half - gap) * float(np.mean(change_mps2**2))
    return -products / np.maximum(squares + least, 1e-300)
