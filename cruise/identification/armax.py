"""ARMAX: an equation error that is itself a moving average of white noise.

    y_k = x_k . theta + e_k + sum_i c_i e_(k-i)        e = C^-1 (y - x . theta),  C = 1 + c_1 q^-1 + ...

x_k (n,) the model's regression of sample k, c (nc,) the noise model, e innovation in m/s, zero before every stretch of
a recording. The columns are measured, so the gradient is the columns and past innovations, filtered by 1/C. Predictions
take the innovations up to their start and none beyond. Equation 4 of Coen et al. 2005; L. Ljung, System Identification,
2nd ed. 1999, sections 4.2 and 10.2; start: E. J. Hannan, J. Rissanen, Biometrika 69 (1982) 81.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal

from cruise.identification import families
from cruise.identification.arx import condition_in_words
from cruise.identification.covariance import standard_errors
from cruise.identification.families import Linear
from cruise.identification.least_squares import fitted_values, solve_rows, spread_mps, until_it_stays
from cruise.identification.prediction_error import inverse_of, is_stable, reflected, search
from cruise.identification.regressors import FitError, Rows, Smooth, model_rows
from cruise.model.model import Model
from cruise.model.prediction import lagged, runs
from cruise.recording import Recording

LONG_ORDER: Final = 10  # lags of the long autoregression that estimates the innovations for the start, at least
EDGE: Final = 0.97  # size of a root of C from which innovations take more than 30 samples to settle


@dataclass(frozen=True)
class Armax(Linear):
    """A fitted ARMAX model: the core and the noise model."""

    noise: tuple[float, ...] = ()  # c_1 ..
    noise_std: tuple[float, ...] = ()  # their standard errors

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The core's, then noise_1 .. for c_1 .."""
        return (*self.model.parameter_names, *(f"noise_{i + 1}" for i in range(len(self.noise))))

    @property
    def theta(self) -> tuple[float, ...]:
        """The core's parameters, then c_1 .."""
        return (*self.model.theta, *self.noise)

    @property
    def theta_std(self) -> tuple[float, ...]:
        """Their standard errors."""
        return (*self.model.theta_std, *self.noise_std)

    def ahead(self, recording: Recording, horizon: int, smooth: Smooth | None = None) -> np.ndarray:
        """The speed (N,) in m/s at every sample as predicted `horizon` samples before."""
        innovation = np.nan_to_num(self.innovations(recording, smooth))
        parts = [c * np.nan_to_num(lagged(innovation, i)) for i, c in enumerate(self.noise, 1)]
        noise = [np.sum(parts[step:], axis=0) for step in range(min(len(parts), horizon))]
        return families.ahead(self.model, recording, horizon, smooth, noise)

    def innovations(self, recording: Recording, smooth: Smooth | None = None) -> np.ndarray:
        """e (N,) in m/s, begun with zero after every hole, NaN in it."""
        equation_error = recording.output - families.ahead(self.model, recording, 1, smooth)
        result = np.full(len(recording), np.nan)
        for run in runs(np.isfinite(equation_error)):
            result[run] = signal.lfilter([1.0], [1.0, *self.noise], equation_error[run])
        return result


def fit_armax(model: Model, nc: int, recordings: Sequence[Recording], smooth: Smooth | None = None) -> Armax:
    """The ARMAX model with `nc` noise parameters that fits all recordings best. Raises FitError."""
    if nc < 1:
        raise FitError(f"nc={nc}: an ARMAX model without a noise model is an ARX model, fit that")

    def once(begun: Model) -> tuple[Model, Armax]:
        found = _once(begun, nc, recordings, smooth)
        return found.model, found

    return until_it_stays(model, once)[1]


def _once(model: Model, nc: int, recordings: Sequence[Recording], smooth: Smooth | None) -> Armax:
    """The fit with columns as this model makes them."""
    rows = model_rows(model, recordings, smooth)
    size = rows.matrix.shape[1]
    count = len(rows.target)

    def error(theta: np.ndarray) -> np.ndarray:
        c = np.array([1.0, *theta[size:]])
        if not is_stable(c):
            return np.full(count, np.inf)
        return _filtered(c, rows.target - rows.matrix @ theta[:size], rows.pieces)

    def gradient(theta: np.ndarray) -> np.ndarray:
        c = np.array([1.0, *theta[size:]])
        psi = np.empty((size + nc, count))
        psi[:size] = _filtered(c, rows.matrix.T, rows.pieces)
        past = _filtered(c, _filtered(c, rows.target - rows.matrix @ theta[:size], rows.pieces), rows.pieces)
        for i in range(1, nc + 1):
            psi[size + i - 1] = _lagged(past, i, rows.pieces)
        return psi.T

    plain = solve_rows(rows, smooth)
    starts = [("least squares", np.concatenate([plain.theta, np.zeros(nc)]))]
    starts += [("Hannan and Rissanen", start) for start in _two_stage(rows, model.na, nc)]
    found = search(starts, error, gradient, float(np.sqrt(np.mean(rows.target**2))))
    inverse, condition = inverse_of(found.gradient)
    std = standard_errors(found.gradient, found.error, inverse, rows.pieces)
    core = fitted_values(model, found.theta[:size], std[:size], spread_mps(found.error, size + nc))
    noise = found.theta[size:]
    message = found.message + condition_in_words(condition)
    if np.abs(np.roots([1.0, *noise])).max() > EDGE:
        message += "; C is at the edge of what can be inverted: the data hold no white noise (filtered, perhaps)"
    return Armax(core, message, found.converged, tuple(noise.tolist()), tuple(std[size:].tolist()))


def _filtered(denominator: np.ndarray, values: np.ndarray, pieces: Sequence[slice]) -> np.ndarray:
    """`values` (..., N) through 1 / denominator, from rest in every stretch."""
    result = np.empty_like(values)
    for piece in pieces:
        result[..., piece] = signal.lfilter([1.0], denominator, values[..., piece], axis=-1)
    return result


def _lagged(values: np.ndarray, lag: int, pieces: Sequence[slice]) -> np.ndarray:
    """values_(k-lag) (N,), zero before every stretch."""
    result = np.zeros_like(values)
    for piece in pieces:
        result[piece.start + lag : piece.stop] = values[piece.start : max(piece.stop - lag, piece.start)]
    return result


def _two_stage(rows: Rows, na: int, nc: int) -> list[np.ndarray]:
    """A start (n + nc,) from innovations that a long autoregression estimates; none where rows are too few for it.

    1/C (y - x theta) as a long series: past targets and drives beside the columns.
    """
    order = max(LONG_ORDER, 3 * (na + nc))
    size = rows.matrix.shape[1]
    sources = [rows.target, *rows.matrix.T[na : size - 1][-1:]]
    extra = [_lagged(source, i, rows.pieces) for source in sources for i in range(1, order + 1)]
    long = np.column_stack([rows.matrix, *extra])
    if len(rows.target) < 3 * long.shape[1]:
        return []
    scale = np.linalg.norm(long, axis=0)
    long /= np.where(scale > 0.0, scale, 1.0)
    innovation = rows.target - long @ np.linalg.lstsq(long, rows.target)[0]
    both = np.column_stack([rows.matrix, *(_lagged(innovation, i, rows.pieces) for i in range(1, nc + 1))])
    scale = np.linalg.norm(both, axis=0)
    scale[scale == 0.0] = 1.0
    theta = np.linalg.lstsq(both / scale, rows.target)[0] / scale
    return [np.concatenate([theta[:size], reflected(np.array([1.0, *theta[size:]]))[1:]])]
