"""What nobody recorded: an autoregression on the residual, by which errors are whitened before they are compared.

    e_k = sum_i f_i e_(k-i) + n_k,   whitened: n_k = e_k - sum_i f_i e_(k-i)

Soil, wind and a wandering sensor leave errors that last; a slow effect that happens to wander with them would look like
their cause. Whitened, every sample brings evidence of its own. Source: D. Cochrane, G. H. Orcutt, J. American
Statistical Association 44 (1949) 32-61; L. Ljung, System Identification, 2nd ed., section 7.5.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.model.prediction import lagged

ORDER: Final = 4  # a slow wander, a faster one and white noise on top


@dataclass(frozen=True)
class Disturbance:
    """Coefficients of the autoregression; none: the error is white. `starts` are the first samples of recordings."""

    coefficients: tuple[float, ...] = ()
    starts: tuple[int, ...] = ()

    def whiten(self, errors: np.ndarray) -> np.ndarray:
        """Errors (P, N) or (N,) without what their past foretells; NaN where the past is not known."""
        if not self.coefficients:
            return errors
        rows = np.atleast_2d(errors)
        result = rows.copy()
        for lag, coefficient in enumerate(self.coefficients, 1):
            result[:, lag:] -= coefficient * rows[:, :-lag]
        for start in self.starts:
            result[:, start : start + len(self.coefficients)] = np.nan
        return result.reshape(np.shape(errors))


def disturbance_of(residual: np.ndarray, starts: tuple[int, ...], order: int = ORDER) -> Disturbance:
    """The autoregression of a residual (N,) with NaN in holes, by least squares."""
    past = np.column_stack([lagged(residual, lag) for lag in range(1, order + 1)])
    for start in starts:
        past[start : start + order] = np.nan
    known = np.isfinite(residual) & np.isfinite(past).all(axis=1)
    if known.sum() < 20 * order:
        return Disturbance((), starts)
    coefficients, *_ = np.linalg.lstsq(past[known], residual[known], rcond=None)
    return Disturbance(tuple(coefficients.tolist()), starts)
