"""Whether residuals are white: the sum of their squared autocorrelations against what chance gives.

    Q = N (N + 2) sum_(m=1..M) r_m^2 / (N - m),    Q ~ chi^2(M - p) for white residuals

r_m autocorrelation at lag m, N samples, p parameters that act on past speeds. Beside the test stands the share of the
lags outside +-1.96 / sqrt(N), 5 % of which chance explains: with thousands of samples the test finds any trifle.
Source: G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297-303.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

LAGS: Final = 25  # as many as system identification toolboxes show


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Autocorrelations (LAGS,) of lags 1.., the 95 % bound, and the test. NaN where there are too few samples."""

    autocorrelation: np.ndarray
    bound: float
    outside_pct: float
    q: float
    p_value: float

    @property
    def largest(self) -> float:
        """The greatest autocorrelation by size: 0 is white, 1 is not at all."""
        return float(np.max(np.abs(self.autocorrelation)))


def whiteness(residuals: Sequence[np.ndarray], fed_back: int = 0) -> Whiteness:
    """Test residuals, one array (N,) in m/s a recording, never joined; `fed_back` parameters act on past speeds."""
    products, count = np.zeros(LAGS + 1), 0
    for residual in residuals:
        known = np.isfinite(residual)
        if not known.any():
            continue
        centred = np.where(known, residual - residual[known].mean(), 0.0)
        count += int(known.sum())
        products += [
            float(centred[: len(centred) - m] @ centred[m:]) if m < len(centred) else 0.0 for m in range(LAGS + 1)
        ]
    if count <= 2 * LAGS or products[0] == 0.0:
        return Whiteness(np.full(LAGS, np.nan), np.nan, np.nan, np.nan, np.nan)
    r = products[1:] / products[0]
    bound = float(stats.norm.ppf(0.975) / np.sqrt(count))
    q = float(count * (count + 2) * np.sum(r**2 / (count - np.arange(1, LAGS + 1))))
    freedom = max(LAGS - fed_back, 1)
    return Whiteness(r, bound, 100.0 * float(np.mean(np.abs(r) > bound)), q, float(stats.chi2.sf(q, freedom)))
