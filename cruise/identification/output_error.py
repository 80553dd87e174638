"""Output error: the error of a simulation that never sees the measured speed.

    w_k = x_k(w) . theta ,    e_k = y_k - w_k

w simulated speed in m/s, x_k (n,) the model's regression with simulated in place of measured speeds: y = B/F u + e,
with F of order `na`. The simulation begins at the measured speeds of every stretch of a recording. Where no effect
reads the speed and neither gear nor stroke moves the poles, the gradient is the columns filtered by 1/F; else forward
differences of models that are simulated side by side: right, but sample by sample. Equation 5 of Coen et al. 2005; L.
Ljung, System Identification, 2nd ed. 1999, sections 4.2 and 10.2; starts: K. Steiglitz, L. E. McBride, IEEE Trans.
Automatic Control 10 (1965) 461.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import signal

from cruise.identification.arx import condition_in_words
from cruise.identification.covariance import standard_errors
from cruise.identification.families import Linear
from cruise.identification.least_squares import fit, fitted, fitted_values, solve_rows, spread_mps
from cruise.identification.prediction_error import Found, inverse_of, is_stable, reflected, search
from cruise.identification.regressors import Rows, Smooth, checked_signals, model_rows, rows_over, state_over
from cruise.model import prediction
from cruise.model.model import Model
from cruise.recording import Recording

TIME_CONSTANTS_S: Final = (0.3, 1.0, 3.0)  # s, slowest pole of three starts: a pump servo to a loaded machine
REFINEMENTS: Final = 10  # rounds of Steiglitz and McBride, which settle in three to five where they settle
STARTS: Final = 3  # of all starts, those of least error are searched from
DIFFERENCE: Final = 1e-6  # relative step of a forward difference, the root of what rounding leaves


@dataclass(frozen=True)
class OutputError(Linear):
    """A fitted output error model. Its prediction, however far ahead, is the free run: it uses no measured speed."""

    def ahead(self, recording: Recording, horizon: int, smooth: Smooth | None = None) -> np.ndarray:
        """The free run (N,) in m/s, the same for every horizon."""
        return self.free_run(recording, smooth)


def fit_output_error(model: Model, recordings: Sequence[Recording], smooth: Smooth | None = None) -> OutputError:
    """The model of this structure that simulates all recordings best; `model.na` is the order of F. Raises FitError."""
    if model.stroke_share:  # columns and the first sample of a simulation go by pole and gain
        model = fit(model, recordings, smooth)
    rows = model_rows(model, recordings, smooth)
    if model.na == 0 and _simple(model, recordings):  # no recursion: simulation and regression are the same
        plain = solve_rows(rows, smooth)
        return OutputError(fitted(model, rows, plain), "least squares" + condition_in_words(plain.condition))
    if _simple(model, recordings):
        found, pieces = _search_filtered(model, rows), rows.pieces
    else:
        found, pieces = _search_stepwise(model, recordings, rows, smooth)
    inverse, condition = inverse_of(found.gradient)
    std = standard_errors(found.gradient, found.error, inverse, pieces)
    core = fitted_values(model, found.theta, std, spread_mps(found.error, len(found.theta)))
    return OutputError(core, found.message + condition_in_words(condition), found.converged)


def _simple(model: Model, recordings: Sequence[Recording]) -> bool:
    """Whether the simulation is a filter: poles that stay, and effects that don't read the speed."""
    if model.reads_speed or model.stroke_share:
        return False
    for recording in recordings:
        pace = np.asarray(state_over(model, recording).pace)
        if np.any(np.abs(pace - 1.0) > 0.0):  # NaN is a hole, not another pace
            return False
    return True


def _search_filtered(model: Model, rows: Rows) -> Found:
    """The search with the analytic gradient."""
    na, forced = model.na, rows.matrix.T[model.na :]

    def simulated(theta: np.ndarray) -> np.ndarray:
        denominator = np.array([1.0, *-theta[:na]])
        drive, result = theta[na:] @ forced, np.empty(len(rows.target))
        for piece in rows.pieces:
            memory = signal.lfiltic([1.0], denominator, rows.matrix[piece.start, :na])
            result[piece], _ = signal.lfilter([1.0], denominator, drive[piece], zi=memory)
        return result

    def error(theta: np.ndarray) -> np.ndarray:
        if not is_stable(np.array([1.0, *-theta[:na]])):
            return np.full(len(rows.target), np.inf)
        return rows.target - simulated(theta)

    def gradient(theta: np.ndarray) -> np.ndarray:
        columns, speed = rows.matrix.T.copy(), simulated(theta)
        for piece in rows.pieces:
            known = np.concatenate([rows.matrix[piece.start, :na][::-1], speed[piece]])
            for i in range(na):
                columns[i, piece] = known[na - 1 - i : len(known) - 1 - i]
            columns[:, piece] = signal.lfilter([1.0], [1.0, *-theta[:na]], columns[:, piece], axis=-1)
        return columns.T

    def with_poles(a: np.ndarray) -> np.ndarray:
        """theta (n,) with these a and the drive parameters that simulate best: they are linear."""
        silent = np.concatenate([a, np.zeros(len(forced))])
        columns = gradient(silent)[:, na:]
        return np.concatenate([a, _least_squares(columns, error(silent))])

    def refined(theta: np.ndarray) -> list[np.ndarray]:
        """Steiglitz and McBride: least squares on data filtered by the last 1/F."""
        found = []
        for _ in range(REFINEMENTS):
            both = np.vstack([rows.matrix.T, rows.target])
            for piece in rows.pieces:
                both[:, piece] = signal.lfilter([1.0], [1.0, *-theta[:na]], both[:, piece], axis=-1)
            theta = with_poles(_stable(_least_squares(both[:-1].T, both[-1])[:na]))
            found.append(theta)
        return found

    plain = with_poles(_stable(_least_squares(rows.matrix, rows.target)[:na]))
    starts = [("least squares", plain)]
    starts += [(f"time constant {tau_s:g} s", with_poles(a)) for tau_s, a in _real_poles(model)]
    starts.append(("Steiglitz and McBride", min(refined(plain), key=lambda theta: _power(error(theta)))))
    starts.sort(key=lambda start: _power(error(start[1])))
    return search(starts[:STARTS], error, gradient, float(np.sqrt(np.mean(rows.target**2))))


def _search_stepwise(
    model: Model, recordings: Sequence[Recording], rows: Rows, smooth: Smooth | None
) -> tuple[Found, tuple[slice, ...]]:
    """The search with forward differences; the filter acts on the simulated and the measured speed."""
    size = len(model.theta)
    typical = np.sqrt(np.mean(rows.target**2)) / np.sqrt(np.mean(rows.matrix**2, axis=0))

    def simulated(candidates: np.ndarray) -> Rows:
        """Simulated speeds (N, copies) of candidates (n, copies), beside the measured ones."""
        several = replace(model, theta=tuple(candidates))

        def columns(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
            signals, state = checked_signals(model, recording), state_over(model, recording)
            with np.errstate(over="ignore", invalid="ignore"):
                speeds = prediction.run_stepwise(
                    several, state, recording.input, recording.output, signals, candidates.shape[1]
                )
            return speeds.T, recording.output

        return rows_over(model.parameter_names, columns, recordings, smooth)

    start = np.concatenate([_stable(_least_squares(rows.matrix, rows.target)[: model.na]), np.zeros(size - model.na)])
    count, pieces = len(simulated(start[:, None]).target), simulated(start[:, None]).pieces

    def error(theta: np.ndarray) -> np.ndarray:
        if not is_stable(np.array([1.0, *-theta[: model.na]])):
            return np.full(count, np.inf)
        found = simulated(theta[:, None])
        return found.target - found.matrix[:, 0] if len(found.target) == count else np.full(count, np.inf)

    def gradient(theta: np.ndarray) -> np.ndarray:
        steps = DIFFERENCE * np.maximum(np.abs(theta), typical)
        found = simulated(np.column_stack([theta, theta[:, None] + np.diag(steps)])).matrix
        return np.asfortranarray((found[:, 1:] - found[:, :1]) / steps)

    def with_poles(a: np.ndarray) -> np.ndarray:
        """theta (n,) with these a and the drive parameters that fit best one step ahead."""
        rest = _least_squares(rows.matrix[:, model.na :], rows.target - rows.matrix[:, : model.na] @ a)
        return np.concatenate([a, rest])

    starts = [("least squares", with_poles(start[: model.na]))]
    starts += [(f"time constant {tau_s:g} s", with_poles(a)) for tau_s, a in _real_poles(model) if model.na]
    starts.sort(key=lambda entry: _power(error(entry[1])))
    found = search(starts[:2], error, gradient, float(np.sqrt(np.mean(rows.target**2))))
    return found, pieces


def _real_poles(model: Model) -> list[tuple[float, np.ndarray]]:
    """Starts for a (na,): real poles, the slowest with a plausible time constant, the others 2, 3.. times as fast."""
    speeds = np.arange(1, model.na + 1)
    polynomials = [np.atleast_1d(np.poly(np.exp(-model.period_s / tau_s * speeds))) for tau_s in TIME_CONSTANTS_S]
    return [(tau_s, -one[1:]) for tau_s, one in zip(TIME_CONSTANTS_S, polynomials, strict=True)]


def _stable(a: np.ndarray) -> np.ndarray:
    """a (na,) with poles outside the unit circle reflected into it."""
    return -reflected(np.array([1.0, *-a]))[1:]


def _least_squares(matrix: np.ndarray, target: np.ndarray) -> np.ndarray:
    """A start (n,) for a search: least squares of scaled columns, which need not tell everything apart."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0.0] = 1.0
    return np.linalg.lstsq(matrix / scale, target)[0] / scale


def _power(error: np.ndarray) -> float:
    """Mean square, infinite where the error is."""
    with np.errstate(over="ignore"):
        return float(np.mean(error**2))
