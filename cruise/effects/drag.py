"""What two edges drag along: x_k = min(max(x_(k-1), low_k), high_k), over a whole recording.

Each sample clips what was there before, and clips one after the other are one clip: so the stretches that the recording
is cut into are walked side by side, once for the clip that each is, and once from where each begins.
Source: M. Brokate, J. Sprekels, Hysteresis and Phase Transitions (1996), ch. 2 (the play operator).
"""

from typing import Final

import numpy as np

STRETCH: Final = 64  # samples: with 10^4 to 10^5 of them about as many steps as stretches


def dragged(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """x (N,) between the edges low <= high (N,); NaN where they are, and begun anew after that.

    Where it begins, the edges have to be one.
    """
    known = np.isfinite(low)
    lows, highs = (_side_by_side(np.where(known, edge, 0.0)) for edge in (low, high))
    least, most = lows[0], highs[0]
    for below, above in zip(lows[1:], highs[1:], strict=True):
        least, most = (np.minimum(np.maximum(edge, below), above) for edge in (least, most))
    stands, begins = 0.0, []
    for below, above in zip(least.tolist(), most.tolist(), strict=True):
        begins.append(stands)
        stands = min(max(stands, below), above)
    held, place = np.empty_like(lows), np.array(begins)
    for row, below, above in zip(held, lows, highs, strict=True):
        place = np.minimum(np.maximum(place, below), above, out=row)
    return np.where(known, held.T.ravel()[: len(known)], np.nan)


def begins(known: np.ndarray) -> np.ndarray:
    """Where (N,) what was not known before is known."""
    return known & ~np.concatenate([[False], known[:-1]])[: len(known)]


def _side_by_side(values: np.ndarray) -> np.ndarray:
    """Stretches of values (N,) as columns (STRETCH, -1), the last one filled up with zeros."""
    filled = np.zeros(max(-(-len(values) // STRETCH), 1) * STRETCH)
    filled[: len(values)] = values
    return filled.reshape(-1, STRETCH).T.copy()
