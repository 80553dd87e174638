"""Standard errors that hold for coloured residuals: the sandwich with an automatic, flat-topped lag window.

    std_j^2 = sum_l w(l) sum_k q_(j,k) q_(j,k-l) ,    q_k = (G' G)^-1 g_k e_k / (1 - h_k) ,    h_k = g_k' (G' G)^-1 g_k

G (N, n) the gradient of the prediction (the columns, in linear least squares), e (N,) the residual in m/s, q_k what row
k moves theta by; its leverage h_k tells how much smaller than the noise its residual is (rows at the ends of filtered
stretches have much). It is the diagonal of (G' G)^-1 S (G' G)^-1 with S the long-run covariance of the scores g_k e_k,
summed a parameter at a time, so that nearly collinear columns cancel before the sum and not in it. w(l) = 1 up to lag
m, falling to 0 at 2 m: a correlation that reaches as far as m counts in full. m is the last lag at which a correlation
of q stands out of what chance gives, with chance after Bartlett:

    |r(l)| > c sqrt(log10 N / N (1 + 2 sum_(i<l) r(i)^2))

Filtered data make the correction for small samples large: what counts are not N rows but the independent ones among
them, N_e = N / (1 + 2 sum_l r_e(l)^2). Sources: W. K. Newey, K. D. West, Econometrica 55 (1987) 703; J. G. MacKinnon,
H. White, J. Econometrics 29 (1985) 305 (leverage); D. N. Politis, J. P. Romano, J. Time Series Analysis 16 (1995) 67
(flat top); D. N. Politis, Econometric Reviews 22 (2003) 73 (rule for m); M. S. Bartlett, J. Royal Statistical Society
B 8 (1946) 27; E. Parzen, Ann. Math. Statistics 32 (1961) 951.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

LOUD: Final = 2.0  # c for the first correlation that stands out (Politis 2003): white scores keep their plain errors
GOES_ON: Final = 1.4  # c once one did: measured with AR(1) noise of pole 0.8 to 0.97, where 2 cuts the tail off
QUIET_LAGS: Final = 5  # so many lags in a row within chance end the search (Politis 2003), and half of m at least
GREATEST_LEVERAGE: Final = 0.95  # a row that decides a parameter alone says nothing of its own noise
LONGEST_SHARE: Final = 8  # lags beyond N / 8 are known from too few independent pairs
LEAST_FACTOR: Final = 0.5  # floor of a small-sample denominator: beyond it the record is too short for any correction


def standard_errors(
    gradient: np.ndarray, residual: np.ndarray, inverse: np.ndarray, pieces: Sequence[slice] = ()
) -> np.ndarray:
    """The standard errors (n,) of the parameters; `inverse` is (G' G)^-1, `pieces` the stretches never joined."""
    count, size = gradient.shape
    influence = inverse @ gradient.T
    leverage = np.einsum("nk,kn->k", influence, gradient)
    influence *= residual / (1.0 - np.minimum(leverage, GREATEST_LEVERAGE))
    apart = _piece_of(pieces, count)
    sums = [np.einsum("nk,nk->n", influence, influence)]
    reach = _reach(sums, influence, apart)
    flat = _flat_top(reach)
    _extend(sums, len(flat), influence, apart)
    variance = _windowed(sums, flat)
    if np.any(variance <= 0.0) and reach:  # a flat top can turn out negative, Parzen's window can't
        window = _parzen(2 * reach)
        _extend(sums, len(window), influence, apart)
        variance = np.where(variance > 0.0, variance, _windowed(sums, window))
    energy = float(residual @ residual) or 1.0
    pairs = (_products(residual, lag, apart) for lag in range(1, len(flat)))
    independent = count / (1.0 + 2.0 * sum((float(late @ early) / energy) ** 2 for late, early in pairs))
    covered = 2.0 * float(np.sum(flat * (1.0 - np.arange(len(flat)) / count))) - 1.0  # q sums to 0: what w takes away
    correction = max(1.0 - size / independent, LEAST_FACTOR) * max(1.0 - covered / count, LEAST_FACTOR)
    return np.sqrt(variance / correction)


def _piece_of(pieces: Sequence[slice], count: int) -> np.ndarray | None:
    """The number of the stretch that each row belongs to, None where there is one only."""
    if len(pieces) < 2:
        return None
    number = np.empty(count, dtype=np.int32)
    for i, piece in enumerate(pieces):
        number[piece] = i
    return number


def _products(values: np.ndarray, lag: int, apart: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """values_k and values_(k-lag) (..., M); pairs from two stretches count as zero."""
    late, early = values[..., lag:], values[..., : values.shape[-1] - lag]
    if apart is not None and lag:
        late = late * (apart[lag:] == apart[:-lag])
    return late, early


def _extend(sums: list[np.ndarray], count: int, influence: np.ndarray, apart: np.ndarray | None) -> None:
    """Append sum_k q_k q_(k-l) (n,) of further lags l until `count` are there."""
    lags = range(len(sums), count)
    sums.extend(np.einsum("nk,nk->n", *_products(influence, lag, apart)) for lag in lags)


def _reach(sums: list[np.ndarray], influence: np.ndarray, apart: np.ndarray | None) -> int:
    """The last lag m at which a parameter's influences are correlated; `sums` grows as far as the search goes."""
    count = influence.shape[1]
    chance = np.log10(count) / count
    power = np.where(sums[0] > 0.0, sums[0], 1.0)
    spread, reach, quiet, lag = np.ones(len(influence)), 0, 0, 0
    while quiet < max(QUIET_LAGS, reach // 2) and lag < count // LONGEST_SHARE:
        lag += 1
        _extend(sums, lag + 1, influence, apart)
        squared = (sums[lag] / power) ** 2
        factor = GOES_ON if reach else LOUD
        if np.any(squared > factor**2 * chance * spread):
            reach, quiet = lag, 0
        else:
            quiet += 1
        spread += 2.0 * squared
    return reach


def _windowed(sums: Sequence[np.ndarray], weights: np.ndarray) -> np.ndarray:
    """sum over all lags, also the negative ones, of weight and sum (n,)."""
    return 2.0 * (weights @ np.array(sums[: len(weights)])) - sums[0]


def _flat_top(reach: int) -> np.ndarray:
    """Weights of the lags 0 to 2 m - 1: one up to m, then falling."""
    lags = np.arange(max(2 * reach, 1))
    return np.clip(2.0 - lags / max(reach, 1), 0.0, 1.0)


def _parzen(half: int) -> np.ndarray:
    """Parzen's window out to lag 2 `half`, whose spectrum is nowhere negative."""
    x = np.arange(2 * half) / (2 * half)
    return np.where(x <= 0.5, 1.0 - 6.0 * x**2 + 6.0 * x**3, 2.0 * (1.0 - x) ** 3)
