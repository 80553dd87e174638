"""How good a prediction is, in the four figures that together hide nothing.

    explained = 1 - var(e) / var(y),   NRMSE = 1 - rms(e) / std(y),   RMSE = rms(e),   mean error = mean(e)

e = y - y_hat, y measured and y_hat predicted speed in m/s. The variance explained is blind to a bias, the mean error
shows it. Source: section IV.B.1 of Coen et al. 2005 ("percentage of variation in the data that is explained");
L. Ljung, System Identification, 2nd ed. 1999, section 16.4.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cruise.model.prediction import lagged


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Figures of a prediction over all samples that have one; NaN where there are none, or the speed never moves."""

    explained_pct: float
    nrmse_pct: float
    rmse_mps: float
    mean_error_mps: float
    samples: int


def accuracy(measured_mps: Sequence[np.ndarray], predicted_mps: Sequence[np.ndarray]) -> Accuracy:
    """Figures over several recordings, one array (N,) each; the variance is that about each recording's own mean."""
    errors, speeds = [], []
    for measured, predicted in zip(measured_mps, predicted_mps, strict=True):
        known = np.isfinite(measured) & np.isfinite(predicted)
        if known.any():
            errors.append(measured[known] - predicted[known])
            speeds.append(measured[known] - measured[known].mean())
    if not errors:
        return Accuracy(np.nan, np.nan, np.nan, np.nan, 0)
    error, speed = np.concatenate(errors), np.concatenate(speeds)
    spread = float(np.mean(speed**2))
    unexplained = float(np.mean(np.concatenate([part - part.mean() for part in errors]) ** 2))
    rmse = float(np.sqrt(np.mean(error**2)))
    moving = spread > 0.0
    return Accuracy(
        explained_pct=100.0 * (1.0 - unexplained / spread) if moving else np.nan,
        nrmse_pct=100.0 * (1.0 - rmse / np.sqrt(spread)) if moving else np.nan,
        rmse_mps=rmse,
        mean_error_mps=float(np.mean(error)),
        samples=len(error),
    )


def persistence(measured_mps: Sequence[np.ndarray], predicted_mps: Sequence[np.ndarray], horizon: int) -> Accuracy:
    """What the simplest predictor reaches on the samples that were predicted: the speed is that of `horizon` ago."""
    same = [np.where(np.isfinite(said), y, np.nan) for y, said in zip(measured_mps, predicted_mps, strict=True)]
    return accuracy(same, [lagged(y, horizon) for y in measured_mps])
