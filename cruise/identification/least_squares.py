"""Batch least squares for everything that is linear in its parameters.

    theta = argmin sum_k (t_k - x_k . theta)^2 ,    X' X theta = X' t

X (N, n) columns of unit RMS, t (N,) target in m/s. The normal equations, refined once, as long as the condition of X is
below 1e5 (they square it); else QR with the singular values of R. Columns that are the same up to a factor are refused
by name. Filtering makes neighbouring columns nearly alike without taking away what tells them apart in principle; such
a fit goes through, and its condition is reported. Where a drive yields with its stroke, the columns go by the pole and
gain that are looked for: they are made again with those that were found, until they stay. Sources: L. Ljung, System
Identification, 2nd ed. 1999, sections 7.3 and 10.1; N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd
ed. 2002, section 20.4.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeVar

import numpy as np

from cruise.identification.covariance import standard_errors
from cruise.identification.regressors import FitError, Rows, Smooth, model_columns, model_rows
from cruise.model.model import Model
from cruise.recording import Recording

GRAM_RECIPROCAL: Final = 1e-10  # reciprocal condition of X' X down to which the normal equations lose nothing
COLLINEAR: Final = 1e-10  # relative singular value of measured columns below which they are one and the same
FILTERED: Final = 1e-13  # the same of filtered columns: below it only rounding tells them apart
ROUNDS: Final = 50  # of least squares, at most, until what a drive yields by with its stroke stays the same,
SETTLED: Final = 1e-6  # relative to it
IN_COMBINATION: Final = 0.2  # weight, relative to the largest, from which a column belongs to a named combination

Beside = TypeVar("Beside")


@dataclass(frozen=True, eq=False)
class Solution:
    """Least squares: theta (n,), residual (N,) in m/s, inverse (n, n) of X' X, condition number of the scaled X."""

    theta: np.ndarray
    residual: np.ndarray
    inverse: np.ndarray
    condition: float


def solve(matrix: np.ndarray, target: np.ndarray, names: Sequence[str], collinear: float = COLLINEAR) -> Solution:
    """Solve matrix (N, n) . theta = target (N,). FitError names columns that can't be told apart."""
    gram = matrix.T @ matrix
    size = np.sqrt(np.diag(gram) / len(target))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    if values[0] < GRAM_RECIPROCAL * values[-1]:
        return _solve_by_qr(matrix, target, names, scale, collinear)
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    theta = inverse @ (matrix.T @ target)
    theta = theta + inverse @ (matrix.T @ (target - matrix @ theta))
    return Solution(theta, target - matrix @ theta, inverse, float(np.sqrt(values[-1] / values[0])))


def _solve_by_qr(
    matrix: np.ndarray, target: np.ndarray, names: Sequence[str], scale: np.ndarray, collinear: float
) -> Solution:
    q, r = np.linalg.qr(matrix / scale)
    u, values, v = np.linalg.svd(r)
    if values[-1] <= collinear * values[0]:
        raise FitError(_collinear(names, v[values <= collinear * values[0]]))
    theta = v.T @ ((u.T @ (q.T @ target)) / values) / scale
    inverse = (v.T / values**2) @ v / np.outer(scale, scale)
    return Solution(theta, target - matrix @ theta, inverse, float(values[0] / values[-1]))


def _collinear(names: Sequence[str], directions: np.ndarray) -> str:
    """What can't be told apart, in words; `directions` (m, n) leave the prediction as it is."""
    size, kept = len(names), len(names) - len(directions)
    weight = np.abs(directions).max(axis=0)
    involved = [name for name, value in zip(names, weight, strict=True) if value > IN_COMBINATION * weight.max()]
    if len(involved) == 1:
        what = f"{involved[0]} has no effect on the prediction"
    else:
        what = f"{', '.join(involved[:-1])} and {involved[-1]} can replace each other"
    return (
        f"only {kept} of {size} parameters can be told apart ({what}): the input does not excite the drive enough; "
        "drive steps of different size, or fit fewer parameters"
    )


def solve_rows(rows: Rows, smooth: Smooth | None = None) -> Solution:
    """Least squares over rows that may have been filtered."""
    return solve(rows.matrix, rows.target, rows.names, COLLINEAR if smooth is None else FILTERED)


def spread_mps(residual: np.ndarray, parameters: int) -> float:
    """Standard deviation in m/s of the residual (N,) left by so many parameters."""
    return float(np.sqrt(residual @ residual / (len(residual) - parameters)))


def regression_over(model: Model, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Columns (N, n) and target (N,) of the samples that can be used; holes and the start are left out."""
    matrix, target = model_columns(model, recording)
    usable = np.isfinite(target) & np.isfinite(matrix).all(axis=0)
    return matrix.T[usable], target[usable]


def fitted_values(model: Model, theta: np.ndarray, std: np.ndarray, residual_std_mps: float) -> Model:
    """The model with these parameters (n,), standard errors (n,) and standard deviation of its residual."""
    return replace(model, theta=tuple(theta.tolist()), theta_std=tuple(std.tolist()), residual_std_mps=residual_std_mps)


def fitted(model: Model, rows: Rows, found: Solution) -> Model:
    """The model with what least squares found, and sandwich standard errors."""
    std = standard_errors(rows.matrix, found.residual, found.inverse, rows.pieces)
    std_mps = spread_mps(found.residual, len(found.theta))
    return fitted_values(model, found.theta, std, std_mps)


def fit(model: Model, recordings: Sequence[Recording], smooth: Smooth | None = None) -> Model:
    """The same structure with the parameters that fit all recordings best, their standard errors and the residual's."""
    return fit_and_solution(model, recordings, smooth)[0]


def fit_and_solution(
    model: Model, recordings: Sequence[Recording], smooth: Smooth | None = None
) -> tuple[Model, Solution]:
    """The same with the solution of its last round."""
    return until_it_stays(model, lambda begun: _once(begun, recordings, smooth))


def until_it_stays(model: Model, once: Callable[[Model], tuple[Model, Beside]]) -> tuple[Model, Beside]:
    """What a fit finds, and what it gives beside that; in rounds where its columns go by pole and gain themselves."""
    found, beside = once(model)
    for _ in range(ROUNDS if model.stroke_share else 0):
        before, (found, beside) = found, once(found)
        if np.allclose(found.theta, before.theta, rtol=SETTLED, atol=0.0):
            break
    return found, beside


def _once(model: Model, recordings: Sequence[Recording], smooth: Smooth | None) -> tuple[Model, Solution]:
    rows = model_rows(model, recordings, smooth)
    solution = solve_rows(rows, smooth)
    return fitted(model, rows, solution), solution
