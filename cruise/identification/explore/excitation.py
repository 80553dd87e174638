"""What the input can teach: its spectrum, its amplitudes, and of which order it is persistently exciting.

    R_n = (1 / N) sum_k p_k p_k',    p_k = (u_k, u_(k-1), ..., u_(k-n+1)),    order = largest n: cond(R_n) <= 10^4

u current without its mean [mA], R_n (n, n) [mA^2]. Ljung asks for R_n > 0; any noise grants that, so that the condition
is asked to be low enough for use: at 10^4 the worst combination of n parameters is known 100 times less well than the
best. A sum of m sinusoids is of order 2 m. Noise of the current's sensor counts as excitation; it can't be told apart.

Source: L. Ljung, System Identification, 2nd ed. 1999, definition 13.2 and section 13.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal

from cruise.identification.explore.pieces import CONSTANT, NotPossible, centred, pieces
from cruise.recording import Recording
from cruise.sampling import FloatArray

SEGMENT_S: Final = 20.0  # s, as for the frequency response
BAND_HZ: Final = 1.0  # Hz, up to which the paper wants the model to hold
LARGEST_CONDITION: Final = 1e4
LARGEST_ORDER: Final = 50  # more than any model of the drive has parameters
SAME_LEVEL: Final = 0.02  # of the range: levels nearer than that, or a signal that moves less in a sample, are one
BINS: Final = 40


@dataclass(frozen=True, eq=False)
class Excitation:
    """Spectrum at `frequency_hz` (M,), amplitudes between `edges_ma` (B + 1,), and what they come to."""

    frequency_hz: FloatArray
    spectrum_ma2_per_hz: FloatArray
    edges_ma: FloatArray
    counts: FloatArray
    mean_ma: float
    std_ma: float
    low_ma: float
    high_ma: float
    share_below_1hz: float
    persistent_order: int
    order_limit: int
    levels: int

    def words(self) -> list[str]:
        """Return what the input can teach, in sentences."""
        order = (
            f"{self.persistent_order}" if self.persistent_order < self.order_limit else f"{self.order_limit} or more"
        )
        said = [
            f"current {self.low_ma:.0f} to {self.high_ma:.0f} mA, mean {self.mean_ma:.0f}, standard deviation "
            f"{self.std_ma:.0f} mA, {self.levels} distinct levels; {100.0 * self.share_below_1hz:.0f} % of its "
            "variance lies below 1 Hz",
            f"it excites persistently of order {order}: so many parameters of the input can be told apart",
        ]
        if self.levels == 2:
            said.append("two levels can't show a curve: drive more of them for dead zone, curvature or saturation")
        return said


def excitation(recordings: Sequence[Recording]) -> Excitation | NotPossible:
    """Look at the input of all recordings."""
    whole = pieces(recordings)
    if not whole:
        return NotPossible("no sample has both current and speed: record both")
    joined = np.concatenate([piece.current_ma for piece in whole])
    range_ma = float(np.ptp(joined))
    if range_ma <= CONSTANT * float(np.max(np.abs(joined))):
        return NotPossible(
            "the current is constant and teaches nothing: drive `cruise experiment white_noise`, or steps"
        )
    dt_s, longest = whole[0].dt_s, max(len(piece) for piece in whole)
    size = min(round(SEGMENT_S / dt_s), longest)
    frequency_hz, density, weight = np.fft.rfftfreq(size, dt_s), np.zeros(size // 2 + 1), 0
    below, total = 0.0, 0.0
    parts = centred([piece.current_ma for piece in whole])
    for part in parts:
        power = np.abs(np.fft.rfft(part)) ** 2
        # Parseval's theorem: all bins but the first and, for an even length, the last stand for two.
        power[1 : len(power) - (1 - len(part) % 2)] *= 2.0
        total += float(np.sum(power)) / len(part)
        below += float(np.sum(power[np.fft.rfftfreq(len(part), dt_s) < BAND_HZ])) / len(part)
        if len(part) >= size:
            density += len(part) * signal.welch(part, 1.0 / dt_s, "hann", size)[1]
            weight += len(part)
    counts, edges_ma = np.histogram(joined, BINS)
    limit = min(LARGEST_ORDER, longest // 3)
    return Excitation(
        frequency_hz=frequency_hz[1:],
        spectrum_ma2_per_hz=density[1:] / weight,
        edges_ma=edges_ma,
        counts=counts.astype(float),
        mean_ma=float(np.mean(joined)),
        std_ma=float(np.std(joined)),
        low_ma=float(np.min(joined)),
        high_ma=float(np.max(joined)),
        share_below_1hz=below / total if total > 0.0 else 1.0,
        persistent_order=_order(parts, limit),
        order_limit=limit,
        levels=_levels([piece.current_ma for piece in whole], range_ma),
    )


def _order(parts: Sequence[FloatArray], limit: int) -> int:
    """Return the largest order n up to `limit` for which R_n is well conditioned."""
    if limit < 1:
        return 0
    rows = np.concatenate(
        [np.lib.stride_tricks.sliding_window_view(part, limit) for part in parts if len(part) >= limit]
    )
    covariance = rows.T @ rows / len(rows)
    # R_n is the leading block; its condition can only grow with n, so that the largest n is found by halving.
    low, high = 0, limit
    while low < high:
        middle = (low + high + 1) // 2
        eigenvalues = np.linalg.eigvalsh(covariance[:middle, :middle])
        if eigenvalues[0] * LARGEST_CONDITION >= eigenvalues[-1] > 0.0:
            low = middle
        else:
            high = middle - 1
    return low


def _levels(currents_ma: Sequence[FloatArray], range_ma: float) -> int:
    """Return how many intervals of SAME_LEVEL the currents fill at which the input rests, or all if it never does."""
    width_ma = SAME_LEVEL * range_ma
    resting = np.concatenate([part[1:][np.abs(np.diff(part)) <= width_ma] for part in currents_ma])
    values = np.sort(resting if len(resting) else np.concatenate(currents_ma))
    levels, at = 0, 0
    while at < len(values):
        levels += 1
        at = int(np.searchsorted(values, values[at] + width_ma, side="right"))
    return levels
