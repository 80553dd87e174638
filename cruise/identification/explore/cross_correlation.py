"""Cross-correlation of speed with current, its confidence bound and the delay it implies.

    r(l) = sum_k u_k y_(k+l) / sqrt(sum u^2 sum y^2),    bound = z sqrt( sum_v r_uu(v) r_yy(v) / N )

l lag [s], positive where speed follows current, u and y current and speed without mean, N samples, r_uu and r_yy their
autocorrelations [-], z quantile of the normal distribution: Bartlett's variance for two signals that have nothing to
do with each other. Where the current is not white (Ljung-Box), both first go through the autoregressive filter that
whitens it: r is then proportional to the impulse response of the drive.

Source: G.E.P. Box, G.M. Jenkins, Time Series Analysis, 5th ed. 2015, sections 8.2.1 (Ljung-Box), 12.1.3 (Bartlett) and
12.2.1 (prewhitening).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import linalg, signal, stats

from cruise.identification.explore.pieces import NotPossible, centred, pieces, unmoved
from cruise.recording import Recording
from cruise.sampling import FloatArray

LONGEST_LAG_S: Final = 5.0  # s, several delays and time constants of the drive
FEWEST_SAMPLES: Final = 50
FEWEST_LAGS: Final = 5
WHITE_LAGS: Final = 20  # lags of the Ljung-Box test (Box & Jenkins: about 20)
WHITE_P: Final = 0.01
LONGEST_FILTER_S: Final = 2.0  # s, memory of the whitening filter
LARGEST_ORDER: Final = 40
CONFIDENCE: Final = 0.95


@dataclass(frozen=True, eq=False)
class CrossCorrelation:
    """Correlation at `lag_s` (2 L + 1,), of whitened signals where `whitening_order` is above 0.

    `bound`: 95 % of the lags of unrelated signals stay below it in magnitude; `peak_bound`: 95 % of the largest of all
    causal lags do. Peak and delay are interpolated, `delay_s` is None where the peak does not stand out.
    """

    lag_s: FloatArray
    correlation: FloatArray
    bound: float
    peak_bound: float
    whitening_order: int
    peak_lag_s: float
    peak: float
    delay_s: float | None
    samples: int

    def words(self) -> list[str]:
        """Return what the correlation says, in sentences."""
        what = f"whitened by an AR({self.whitening_order}) filter" if self.whitening_order else "white as it is"
        if self.delay_s is None:
            return [
                f"speed follows current at no lag (input {what}): largest correlation {self.peak:.2f}, by chance up to "
                f"{self.peak_bound:.2f}"
            ]
        return [
            f"speed follows current by {self.peak_lag_s:.2f} s (peak {self.peak:.2f}, 95 % bound {self.bound:.2f}; "
            f"input {what}) and begins to after {self.delay_s:.2f} s"
        ]

    @property
    def before(self) -> FloatArray:
        """The correlations at negative lags: of the current with earlier speeds."""
        return self.correlation[self.lag_s < 0.0]


def cross_correlation(recordings: Sequence[Recording], whiten: bool | None = None) -> CrossCorrelation | NotPossible:
    """Correlate speed with current over all recordings; `whiten` None whitens where the current is not white."""
    whole = pieces(recordings)
    nothing = unmoved(whole)
    if nothing is not None:
        return nothing
    dt_s, longest = whole[0].dt_s, max(len(piece) for piece in whole)
    lags = min(round(LONGEST_LAG_S / dt_s), longest // 3)
    u, y = centred([p.current_ma for p in whole]), centred([p.speed_mps for p in whole])
    samples = sum(len(part) for part in u)
    if samples < FEWEST_SAMPLES or lags < FEWEST_LAGS:
        return NotPossible(
            f"too short for a cross-correlation: {samples} samples, {FEWEST_SAMPLES} are needed; "
            "drive `cruise experiment white_noise` for minutes"
        )
    order = 0
    if whiten or (whiten is None and not _is_white(u)):
        largest = min(round(LONGEST_FILTER_S / dt_s), LARGEST_ORDER, samples // 20, longest // 3)
        u, y = ([part for part in parts if len(part) > 2 * largest] for parts in (u, y))  # shorter ones have no middle
        coefficients = _whitening(u, largest)
        order = len(coefficients) - 1
        u, y = (centred([np.convolve(coefficients, p, "valid") for p in parts]) for parts in (u, y))
        samples = sum(len(part) for part in u)
    correlation = _correlation(u, y, lags)
    tested = round(min(4.0 * lags, samples / 4.0))
    taper = 1.0 - np.abs(np.arange(-tested, tested + 1)) / (tested + 1.0)
    # Tapered, since the far lags of both estimates are noise; never below what two white signals would have.
    spread = float(np.sum(taper * _correlation(u, u, tested) * _correlation(y, y, tested)))
    std = math.sqrt(max(spread, 1.0) / samples)
    causal = correlation[lags:]
    peak_at = int(np.argmax(np.abs(causal)))
    peak_bound = float(stats.norm.ppf(0.5 + CONFIDENCE ** (1.0 / len(causal)) / 2.0)) * std
    bound = float(stats.norm.ppf(0.5 + CONFIDENCE / 2.0)) * std
    stands_out = abs(causal[peak_at]) > peak_bound
    return CrossCorrelation(
        lag_s=dt_s * np.arange(-lags, lags + 1),
        correlation=correlation,
        bound=bound,
        peak_bound=peak_bound,
        whitening_order=order,
        peak_lag_s=dt_s * _top(np.abs(correlation), lags + peak_at) - dt_s * lags,
        peak=float(causal[peak_at]),
        delay_s=dt_s * _onset(causal * np.sign(causal[peak_at]), bound, peak_bound) if stands_out else None,
        samples=samples,
    )


def _correlation(x: Sequence[FloatArray], y: Sequence[FloatArray], lags: int) -> FloatArray:
    """Return the correlation (2 lags + 1,) of y with earlier x over all pieces, none joined to another."""
    total = np.zeros(2 * lags + 1)
    for one, other in zip(x, y, strict=True):
        if not len(one):
            continue
        reach = min(lags, len(one) - 1)
        full = signal.correlate(other, one, "full")
        total[lags - reach : lags + reach + 1] += full[len(one) - 1 - reach : len(one) + reach]
    energy = math.sqrt(sum(float(p @ p) for p in x) * sum(float(p @ p) for p in y))
    return total / energy if energy > 0.0 else total


def _is_white(u: Sequence[FloatArray]) -> bool:
    count = sum(len(part) for part in u)
    lags = min(WHITE_LAGS, count // 10)
    r = _correlation(u, u, lags)[lags + 1 :]
    statistic = count * (count + 2.0) * float(np.sum(r**2 / (count - np.arange(1, lags + 1))))
    return float(stats.chi2.sf(statistic, lags)) > WHITE_P


def _whitening(u: Sequence[FloatArray], largest: int) -> FloatArray:
    """Return the prediction error filter (order + 1,) of the Yule-Walker order with the smallest BIC."""
    count = sum(len(part) for part in u)
    r = _correlation(u, u, max(largest, 1))[max(largest, 1) :]
    best, best_bic = np.ones(1), count * math.log(r[0])
    for order in range(1, max(largest, 1) + 1):
        a = linalg.solve_toeplitz(r[:order] * (1.0 + 1e-9 * (np.arange(order) == 0)), r[1 : order + 1])
        left = max(float(r[0] - a @ r[1 : order + 1]), 1e-12)
        bic = count * math.log(left) + order * math.log(count)
        if bic < best_bic:
            best, best_bic = np.concatenate([[1.0], -a]), bic
    return best


def _top(values: FloatArray, at: int) -> float:
    """Return the place of the maximum near `at` in samples, by the parabola through three of them."""
    if not 0 < at < len(values) - 1:
        return float(at)
    before, here, after = values[at - 1 : at + 2]
    bend = before - 2.0 * here + after
    return at + float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0.0 else float(at)


def _onset(causal: FloatArray, bound: float, peak_bound: float) -> float:
    """Return where the first run above the bound begins that reaches what no lag does by chance, in samples.

    Its first lag, less what the line through it and the next needs to come down to 0, one sample at most.
    """
    reached = first = int(np.argmax(causal > peak_bound))
    while first > 0 and causal[first - 1] > bound:
        first -= 1
    rise = causal[first + 1] - causal[first] if first < reached else 0.0
    return first - (min(float(causal[first] / rise), 1.0) if rise > 0.0 and first > 0 else 0.0)
