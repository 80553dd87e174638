"""Batch least squares for the ARX family with effects.

    theta = argmin sum_k (y_k - offset_k - x_k . theta)^2 ,    cov(theta) = s^2 (X' X)^-1

x_k (n,) and offset_k are the model's own regression of sample k, so that what is fitted is what estimator and
controller use. Ljung, System Identification, 2nd ed. 1999, section 7.3. The covariance is the one for white
residuals.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cruise.model.model import Model
from cruise.model.prediction import states_over
from cruise.recording import Recording


class FitError(ValueError):
    """The recording can't determine the parameters; the message says why and what to do."""


def regression_over(model: Model, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Columns (N, n) and target (N,) of the samples that can be used; holes and the start are left out."""
    absent = model.missing(recording.columns)
    if absent:
        raise FitError(f"{recording.source}: the model needs {', '.join(absent)}, which the recording does not hold")
    signals = {name: recording.columns[name] for name in model.needs}
    state = states_over(model, recording.input, recording.output, signals)
    columns, offset = model.regression(state)
    count = len(recording.output)
    matrix = np.column_stack([np.broadcast_to(np.asarray(column, float), count) for column in columns])
    target = recording.output - offset
    usable = np.isfinite(target) & np.isfinite(matrix).all(axis=1)
    return matrix[usable], target[usable]


def fit(model: Model, recordings: Sequence[Recording]) -> Model:
    """The same structure with the parameters that fit all recordings best, their standard errors and the residual's."""
    if not recordings:
        raise FitError("no recording to fit: give one or more")
    for recording in recordings:
        if not np.isclose(recording.dt_s, model.period_s):
            raise FitError(
                f"{recording.source} is sampled every {recording.dt_s:g} s, the model runs every {model.period_s:g} s: "
                "resample the recording to the model's period"
            )
    parts = [regression_over(model, recording) for recording in recordings]
    matrix = np.vstack([part[0] for part in parts])
    target = np.concatenate([part[1] for part in parts])
    count, size = matrix.shape
    if count < 3 * size:
        raise FitError(f"{count} usable samples for {size} parameters: record for longer")
    scale = np.sqrt(np.mean(matrix**2, axis=0))
    scale[scale == 0.0] = 1.0
    theta, _, rank, _ = np.linalg.lstsq(matrix / scale, target, rcond=1e-10)
    if rank < size:
        raise FitError(
            f"only {rank} of {size} parameters can be told apart: the input does not excite the drive enough; "
            "drive steps of different size, or fit fewer parameters"
        )
    residual = target - (matrix / scale) @ theta
    variance = float(residual @ residual) / (count - size)
    covariance = variance * np.linalg.inv((matrix / scale).T @ (matrix / scale))
    return replace(
        model,
        theta=tuple(float(value) for value in theta / scale),
        theta_std=tuple(float(value) for value in np.sqrt(np.diag(covariance)) / scale),
        residual_std_mps=float(np.sqrt(variance)),
    )
