"""Shape parameters of the effects, found offline by what they do to the prediction 3 s ahead.

    minimise over the shapes  RMS_h( fit(shapes) ),   fit: batch least squares of a, b, c, c_0 for these shapes

Separable least squares (Golub and Pereyra, SIAM J. Numerical Analysis 10 (1973)) with the multi-step error outside:
one step ahead, a wrong shape hides behind the last measured speed. Solver: Nelder and Mead within the effects'
bounds.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize

from cruise.identification.least_squares import FitError, fit
from cruise.model.model import Model
from cruise.model.prediction import ahead
from cruise.recording import Recording


def ahead_rms_mps(model: Model, recordings: Sequence[Recording], horizon_s: float) -> float:
    """RMS in m/s of the prediction error `horizon_s` ahead, from every sample of every recording."""
    horizon = max(round(horizon_s / model.period_s), 1)
    errors = []
    for recording in recordings:
        signals = {name: recording.columns[name] for name in model.needs}
        predicted = ahead(model, recording.input, recording.output, signals, horizon)
        errors.append(predicted - recording.output)
    joined = np.concatenate(errors)
    joined = joined[np.isfinite(joined)]
    if not len(joined):
        raise FitError(f"no sample has {horizon_s:g} s of whole recording before it: record for longer")
    return float(np.sqrt(np.mean(joined**2)))


def fit_shapes(
    model: Model, recordings: Sequence[Recording], shapes: Sequence[tuple[str, str]], horizon_s: float = 3.0
) -> Model:
    """Fit the named shape parameters, pairs of effect and parameter, together with the linear ones."""
    effects = {effect.name: effect for effect in model.effects}
    bounds = [
        (effects[name].parameters[parameter].low, effects[name].parameters[parameter].high)
        for name, parameter in shapes
    ]
    size = np.array([high - low for low, high in bounds])
    start = np.array([getattr(effects[name], parameter) for name, parameter in shapes]) / size

    def shaped(values: np.ndarray) -> Model:
        new = dict(effects)
        for (name, parameter), value in zip(shapes, values * size, strict=True):
            new[name] = new[name].reshaped(**{parameter: float(value)})
        return fit(replace(model, effects=tuple(new.values())), recordings)

    def error_mps(values: np.ndarray) -> float:
        try:
            candidate = shaped(values)
        except FitError:  # a dead zone wider than every current, say: the search goes elsewhere
            return math.inf
        return ahead_rms_mps(candidate, recordings, horizon_s)

    shaped(start)  # recordings that can't determine the model at all are refused here, with the reason
    found = optimize.minimize(
        error_mps,
        start,
        method="Nelder-Mead",
        bounds=[(low / span, high / span) for (low, high), span in zip(bounds, size, strict=True)],
        options={"xatol": 1e-4, "fatol": 1e-6, "maxiter": 400},
    )
    return shaped(found.x)
