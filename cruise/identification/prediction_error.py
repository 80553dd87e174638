"""The search of a prediction-error method, from several starts, with an honest word about how it ended.

    theta = argmin sum_k e_k(theta)^2 ,    psi_k = - d e_k / d theta

e (N,) prediction error in m/s, psi (N, n). Solver: trust-region Gauss-Newton (scipy), which shortens a step to where
the error is not finite: that is how predictors stay stable. Source: L. Ljung, System Identification, 2nd ed. 1999,
sections 7.2 and 10.2.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import optimize

TOLERANCE: Final = 1e-9  # relative change of cost or parameters that ends the search, far below standard errors
MOST_STEPS: Final = 100  # evaluations a start; a well-posed search takes 5 to 20
SLOPE: Final = (
    1e-3  # cosine between error and gradient from which this is no minimum: 1e-3 standard errors times sqrt(N)
)
EXACT: Final = 1e-9  # of the target's RMS; an error below it is rounding and has no slope
SAME_MINIMUM: Final = 1e-3  # relative difference of RMS errors within which two starts ended in one minimum


@dataclass(frozen=True, eq=False)
class Found:
    """The best end of the search: theta (n,), error (N,) in m/s, gradient psi (N, n), and how it ended."""

    theta: np.ndarray
    error: np.ndarray
    gradient: np.ndarray
    converged: bool
    message: str


def search(
    starts: Sequence[tuple[str, np.ndarray]],
    error: Callable[[np.ndarray], np.ndarray],
    gradient: Callable[[np.ndarray], np.ndarray],
    size_mps: float,
) -> Found:
    """Minimise from every named start; `size_mps` is the RMS of the target. `error` is infinite where none is allowed.

    ValueError where not one start has a finite error.
    """
    ends = []
    for name, start in starts:
        if not np.isfinite(error(start)).all():
            continue
        found = optimize.least_squares(
            error,
            start,
            jac=lambda theta: -gradient(theta),  # type: ignore[arg-type]
            x_scale="jac",
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            gtol=TOLERANCE * size_mps**2,
            max_nfev=MOST_STEPS,
        )
        ends.append((float(found.cost), name, found))
    if not ends:
        raise ValueError("no start of the search has a finite error")
    cost, name, best = min(ends, key=lambda end: end[0])
    psi, left = -best.jac, best.fun
    rms = math.sqrt(2.0 * cost / len(left))
    lengths = np.linalg.norm(psi, axis=0) * np.linalg.norm(left)
    cosine = float(np.abs(psi.T @ left / np.where(lengths > 0.0, lengths, 1.0)).max())
    flat = rms <= EXACT * size_mps or cosine < SLOPE
    same = sum(math.sqrt(end[0] / cost) < 1.0 + SAME_MINIMUM if cost > 0.0 else True for end in ends)
    if best.status > 0 and flat:
        message = f"converged, {same} of {len(ends)} starts in this minimum (best from {name})"
    elif best.status > 0:
        message = f"not converged: stopped at the edge of what is stable, the error still falls (from {name})"
    else:
        message = f"not converged within {MOST_STEPS} evaluations (from {name})"
    return Found(best.x, left, psi, best.status > 0 and flat, message)


def inverse_of(gradient: np.ndarray) -> tuple[np.ndarray, float]:
    """(psi' psi)^-1 (n, n), pseudo where it is singular, and the condition number of the scaled psi."""
    scale = np.linalg.norm(gradient, axis=0)
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(gradient.T @ gradient / np.outer(scale, scale))
    kept = np.maximum(values, np.finfo(float).eps * values[-1])
    return (vectors / kept) @ vectors.T / np.outer(scale, scale), float(np.sqrt(values[-1] / kept[0]))


def reflected(polynomial: np.ndarray, largest: float = 0.98) -> np.ndarray:
    """A monic polynomial (n + 1,) in 1/z with every root inside the circle of radius `largest`, phase kept."""
    if len(polynomial) < 2:
        return polynomial
    roots = np.roots(polynomial)
    size = np.abs(roots)
    inside = np.where(size > 1.0, 1.0 / np.maximum(size, 1e-300), size)
    moved = roots / np.maximum(size, 1e-300) * np.minimum(inside, largest)
    return np.real(np.poly(moved))


def is_stable(polynomial: np.ndarray) -> bool:
    """Whether every root of a monic polynomial (n + 1,) in 1/z lies inside the unit circle."""
    return bool(np.isfinite(polynomial).all()) and bool(np.all(np.abs(np.roots(polynomial)) < 1.0))
