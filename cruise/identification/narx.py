"""NARX: speeds fed back, and Hermite polynomials of the drive signal, regularised by ridge.

    y_k = sum_i a_i y_(k-i) + g_k sum_n sum_j b_(n,j) H_n(z_(k-d-j)) + c_0 + e_k ,    z = (f(u) - centre) / scale
    theta = (A' A / N + gamma I)^-1 A' B / N

f(u) drive signal in mA, g what gain effects do, H_n physicists' Hermite polynomial of degree n, A the columns scaled to
unit RMS, B the target in m/s; c_0 is not penalised. H_n are orthogonal for a density exp(-z^2), a normal one of
variance 1/2: the scale is sqrt(2) standard deviations of the drive. gamma, per sample (equation 7 of the paper divided
by N), is the one of a grid that predicts best 3 s ahead on the last quarter of every recording, fitted to the rest:
generalised cross-validation takes residuals for white, which filtered ones are not, and regularises too little.
Section IV.D, equations 6 and 7 of Coen et al. 2005; G. Golub, C. Van Loan, Matrix Computations, 1989, section 12.1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.polynomial import hermite

from cruise.identification.covariance import standard_errors
from cruise.identification.families import why_unstable
from cruise.identification.least_squares import spread_mps
from cruise.identification.regressors import (
    FitError,
    Rows,
    Smooth,
    check_excitation,
    checked_signals,
    rows_over,
    smoothed_runs,
    state_over,
)
from cruise.model import prediction
from cruise.model.model import Model, ModelState
from cruise.model.prediction import Driven
from cruise.recording import Recording

GAMMAS: Final = (0.0, *np.logspace(-10.0, 0.0, 11).tolist())  # from none to as heavy as the columns themselves
HELD_OUT: Final = 0.25  # last part of every recording, on which gamma is judged
JUDGED_AHEAD_S: Final = 3.0  # s, the paper's horizon
LEAST_PIVOT: Final = 1e-14  # relative eigenvalue of A'A below which only rounding is left; keeps gamma = 0 finite


@dataclass(frozen=True)
class Narx:
    """A fitted NARX model. `structure` holds orders, delay and effects; its own parameters say nothing."""

    structure: Model
    degree: int
    centre_ma: float
    scale_ma: float
    theta: tuple[float, ...]  # a_1.., b of degree 1, of degree 2.., load effects, c_0
    theta_std: tuple[float, ...]  # spread about what ridge expects; its bias is not in it
    residual_std_mps: float
    gamma: float
    message: str
    converged: bool = True  # the equation is solved, not searched

    @property
    def period_s(self) -> float:
        """The sampling period of the model."""
        return self.structure.period_s

    @property
    def needs(self) -> tuple[str, ...]:
        """The signals beside current and speed that a recording must hold."""
        return self.structure.needs

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `theta`."""
        return _names(self.structure, self.degree)

    @property
    def poles(self) -> np.ndarray:
        """Poles of the predictor in the z plane: the polynomials don't move them."""
        a = self.theta[: self.structure.na]
        return np.roots([1.0, *(-value for value in a)]) if a else np.zeros(0)

    @property
    def unstable(self) -> str:
        """Which poles make predictions run away; empty where none does."""
        return why_unstable(self.poles)

    def ahead(self, recording: Recording, horizon: int, smooth: Smooth | None = None) -> np.ndarray:
        """The speed (N,) in m/s at every sample as predicted `horizon` samples before."""
        with np.errstate(over="ignore", invalid="ignore"):
            return prediction.ahead_driven(self._split(recording, smooth), recording.output, horizon)

    def free_run(self, recording: Recording, smooth: Smooth | None = None) -> np.ndarray:
        """The model's own speeds (N,) in m/s from the first samples on."""
        with np.errstate(over="ignore", invalid="ignore"):
            return prediction.run_driven(self._split(recording, smooth), recording.output)

    def _split(self, recording: Recording, smooth: Smooth | None) -> Driven:
        """What past speeds do and what the rest does: the structure's part for past speeds, the polynomials' beside."""
        na, state = self.structure.na, state_over(self.structure, recording)
        speeds = (*self.theta[:na], *(0.0,) * (len(self.structure.theta) - na))
        feedback = prediction.driven(self.structure.with_theta(speeds), state, len(recording)).feedback
        silent = state._replace(speeds=(0.0,) * len(state.speeds))
        columns = _columns(self.structure, silent, self.degree, self.centre_ma, self.scale_ma)
        forced = np.zeros(len(recording))
        for value, column in zip(self.theta[na:], columns[na:], strict=True):
            forced += value * column
        return Driven(feedback, forced if smooth is None else smoothed_runs(forced, smooth))


def fit_narx(
    model: Model,
    degree: int,
    recordings: Sequence[Recording],
    smooth: Smooth | None = None,
    gamma: float | None = None,
) -> Narx:
    """The NARX model with the orders, delay and effects of `model`. Raises FitError.

    `gamma` per sample; None: the one that predicts best on held-out data.
    """
    if degree < 1 or model.nb < 1:
        raise FitError(f"degree={degree}, nb={model.nb}: a NARX model needs both to be 1 or more")
    if gamma is not None and not gamma >= 0.0:
        raise FitError(f"gamma={gamma}: a penalty is 0 or more")
    for recording in recordings:
        checked_signals(model, recording)
    if model.reads_speed:
        raise FitError("an effect of this structure reads the speed: NARX models can't have one, leave it out")
    centre_ma, scale_ma = _centre_and_scale(model, recordings)
    empty = Narx(model, degree, centre_ma, scale_ma, (), (), math.nan, math.nan, "")
    chosen = "given" if gamma is not None else "best of a grid, 3 s ahead on the last quarter of the recordings"
    gamma = _best_gamma(empty, recordings, smooth) if gamma is None else gamma
    return _ridge(empty, _rows(empty, recordings, smooth), gamma, f"ridge, gamma {gamma:.1g}: {chosen}")


def _names(model: Model, degree: int) -> tuple[str, ...]:
    a, rest = model.parameter_names[: model.na], model.parameter_names[model.na + model.nb :]
    b = [f"h{n}_{j}_mps" for n in range(1, degree + 1) for j in range(model.nb)]
    return (*a, *b, *rest)


def _columns(
    model: Model, state: ModelState, degree: int, centre_ma: float, scale_ma: float
) -> tuple[np.ndarray | float, ...]:
    """The regression of a model whose drives are, one after the other, the polynomials of its drive signal."""
    na, nb = model.na, model.nb
    scaled = [(drive - centre_ma) / scale_ma for drive in state.drives]
    b: list[np.ndarray | float] = []
    for n in range(1, degree + 1):
        drives = tuple(hermite.hermval(z, [*(0.0,) * n, 1.0]) for z in scaled)
        b += model.regression(state._replace(drives=drives)).columns[na : na + nb]
    columns = model.regression(state).columns
    return (*columns[:na], *b, *columns[na + nb :])


def _centre_and_scale(model: Model, recordings: Sequence[Recording]) -> tuple[float, float]:
    """Mean and sqrt(2) standard deviations in mA of the drive signal over all recordings."""
    if not recordings:
        raise FitError("no recording is long enough: record for longer")
    drives = np.concatenate([np.asarray(state_over(model, recording).drives[0]) for recording in recordings])
    drives = drives[np.isfinite(drives)]
    check_excitation(recordings, drives[:, None])
    return float(drives.mean()), math.sqrt(2.0) * float(drives.std())


def _rows(narx: Narx, recordings: Sequence[Recording], smooth: Smooth | None) -> Rows:
    def columns(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
        state = state_over(narx.structure, recording)
        found = _columns(narx.structure, state, narx.degree, narx.centre_ma, narx.scale_ma)
        stacked = np.array([np.broadcast_to(column, len(recording)) for column in found])
        return stacked, recording.output - narx.structure.regression(state).offset

    return rows_over(narx.parameter_names, columns, recordings, smooth)


def _ridge(narx: Narx, rows: Rows, gamma: float, message: str) -> Narx:
    """Equation 7 with the last column, that of the constant, taken out of columns and target first."""
    constant = rows.matrix[:, -1]
    weights = constant / (constant @ constant)
    inner = rows.matrix[:, :-1] - np.outer(constant, weights @ rows.matrix[:, :-1])
    target = rows.target - constant * (weights @ rows.target)
    scale = np.sqrt(np.mean(inner**2, axis=0))
    scale[scale == 0.0] = 1.0
    count = len(target)
    values, vectors = np.linalg.eigh(inner.T @ inner / np.outer(scale, scale) / count)
    kept = np.maximum(values + gamma, LEAST_PIVOT * values[-1])
    inverse = (vectors / kept) @ vectors.T / np.outer(scale, scale) / count
    theta = inverse @ (inner.T @ target)
    theta = np.append(theta, weights @ (rows.target - rows.matrix[:, :-1] @ theta))
    residual = rows.target - rows.matrix @ theta
    back = weights @ rows.matrix[:, :-1]  # c_0 = weights (target - columns theta): its gradient
    full = np.zeros((len(theta), len(theta)))
    full[:-1, :-1] = inverse
    full[-1, :-1] = full[:-1, -1] = -inverse @ back
    full[-1, -1] = 1.0 / (constant @ constant) + back @ inverse @ back
    std = standard_errors(rows.matrix, residual, full, rows.pieces)
    return replace(
        narx,
        theta=tuple(theta.tolist()),
        theta_std=tuple(std.tolist()),
        residual_std_mps=spread_mps(residual, len(theta)),
        gamma=gamma,
        message=message,
    )


def _best_gamma(narx: Narx, recordings: Sequence[Recording], smooth: Smooth | None) -> float:
    """The penalty with the least squared error 3 s ahead on what was held out."""
    cuts = [round((1.0 - HELD_OUT) * len(recording)) for recording in recordings]
    rows = _rows(narx, [recording[:cut] for recording, cut in zip(recordings, cuts, strict=True)], smooth)
    unseen = [recording[cut:] for recording, cut in zip(recordings, cuts, strict=True)]
    horizon = max(round(JUDGED_AHEAD_S / narx.period_s), 1)

    def power(gamma: float) -> float:
        candidate = _ridge(narx, rows, gamma, "")
        errors = np.concatenate([candidate.ahead(part, horizon) - part.output for part in unseen])
        usable = errors[np.isfinite(errors)]
        if not len(usable):
            raise FitError(f"no {JUDGED_AHEAD_S:g} s of recording to judge gamma on: record for longer, or give gamma")
        with np.errstate(over="ignore"):
            return float(np.mean(usable**2)) if not candidate.unstable else math.inf

    return min(GAMMAS[::-1], key=power)
