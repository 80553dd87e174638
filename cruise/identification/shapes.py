"""Shape parameters of the effects, found offline by what they do to the prediction 3 s ahead.

    minimise over the shapes  RMS_h( fit(shapes) ),   fit: batch least squares of a, b, c, c_0 for these shapes

Separable least squares (Golub and Pereyra, SIAM J. Numerical Analysis 10 (1973)) with the multi-step error outside:
one step ahead, a wrong shape hides behind the last measured speed. A shape that stands at its neutral value is looked
for on a grid over its bounds first, one after the other; then all are refined together by Nelder and Mead. What the
recordings say nothing about, a saturation above every current, goes back to its neutral value.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy import optimize

from cruise.effects import Effect
from cruise.identification.families import ahead
from cruise.identification.least_squares import fit
from cruise.identification.regressors import FitError, Smooth
from cruise.model.model import Model
from cruise.recording import Recording

Shape = tuple[str, str]
"""Names of an effect and of its parameter."""

HORIZON_S: Final = 3.0  # s, the paper's (section II.B)
NO_DIFFERENCE: Final = 1e-9  # relative, of the error: rounding
SWEEPS: Final = 2  # over all that are looked for, before they are refined together
GRID: Final = 17  # points over the bounds of a parameter: closer than half the width of the valleys met so far


def ahead_rms_mps(
    model: Model, recordings: Sequence[Recording], horizon_s: float, smooth: Smooth | None = None
) -> float:
    """RMS in m/s of the prediction error `horizon_s` ahead, from every sample of every recording.

    `smooth` filters what drives the model, not the measured speeds.
    """
    horizon = max(round(horizon_s / model.period_s), 1)
    errors = [ahead(model, recording, horizon, smooth) - recording.output for recording in recordings]
    joined = np.concatenate(errors)
    joined = joined[np.isfinite(joined)]
    if not len(joined):
        raise FitError(f"no sample has {horizon_s:g} s of whole recording before it: record for longer")
    return float(np.sqrt(np.mean(joined**2)))


def excited_shapes(model: Model, recordings: Sequence[Recording]) -> list[Shape]:
    """The shape parameters that these recordings can say something about: those of effects whose signals move.

    Of which kind an effect is, is left as it is given, and so is what is idle; of one that is not there at all, the
    first of its parameters is what it begins with.
    """
    moved = [one for one in model.effects if all(_moves(name, recordings) for name in one.needs)]
    return [(effect.name, parameter) for effect in moved for parameter in _looked_for(effect)]


def _looked_for(effect: Effect) -> list[str]:
    shapes = [name for name in effect.parameters if name != effect.kind]
    return [name for name in shapes if name not in effect.idle] or shapes[:1]


def _moves(name: str, recordings: Sequence[Recording]) -> bool:
    known = [column[np.isfinite(column)] for one in recordings if (column := one.columns.get(name)) is not None]
    return bool(known) and float(np.ptp(np.concatenate(known))) > 0.0


def fit_shapes(
    model: Model,
    recordings: Sequence[Recording],
    shapes: Sequence[Shape],
    horizon_s: float = HORIZON_S,
    smooth: Smooth | None = None,
    show: Callable[[str], None] | None = None,
) -> Model:
    """Fit the named shape parameters together with the linear ones; `show` is told what is being looked for."""
    judged_by = None if model.reads_speed else smooth  # what reads the speed can't be filtered before the prediction
    effects = {effect.name: effect for effect in model.effects}
    bounds = [effects[name].parameters[parameter] for name, parameter in shapes]
    size = np.array([bound.high - bound.low for bound in bounds])
    start = np.array([getattr(effects[name], parameter) for name, parameter in shapes]) / size

    def shaped(values: np.ndarray) -> Model:
        new = dict(effects)
        for (name, parameter), value in zip(shapes, values * size, strict=True):
            new[name] = new[name].reshaped(**{parameter: float(value)})
        return fit(replace(model, effects=tuple(new.values())), recordings, smooth)

    def error_mps(values: np.ndarray) -> float:
        try:
            error = ahead_rms_mps(shaped(values), recordings, horizon_s, judged_by)
        except FitError:  # a dead zone wider than every current, say: the search goes elsewhere
            return math.inf
        return error if math.isfinite(error) else math.inf

    shaped(start)  # recordings that can't determine the model at all are refused here, with the reason
    unknown = [i for i, bound in enumerate(bounds) if start[i] * size[i] == bound.neutral]
    for i in unknown * SWEEPS:  # again: a saturation shows only once the dead zone is there
        name, parameter = shapes[i]
        if show is not None:
            show(f"looking for {parameter} of {name}")
        trials = [start.copy() for _ in range(GRID + 1)]
        for trial, value in zip(trials[1:], np.linspace(bounds[i].low, bounds[i].high, GRID), strict=True):
            trial[i] = value / size[i]
        start = min(trials, key=error_mps)
    if show is not None:
        show("refining " + ", ".join(f"{parameter} of {name}" for name, parameter in shapes))
    found = optimize.minimize(
        error_mps,
        start,
        method="Nelder-Mead",
        bounds=[(bound.low / span, bound.high / span) for bound, span in zip(bounds, size, strict=True)],
        options={"xatol": 1e-4, "fatol": 1e-6, "maxiter": 400, "initial_simplex": _simplex(start, bounds, size)},
    )
    return shaped(_neutral_where_equal(found.x, [bound.neutral for bound in bounds] / size, error_mps))


def _neutral_where_equal(
    values: np.ndarray, neutral: np.ndarray, error_mps: Callable[[np.ndarray], float]
) -> np.ndarray:
    """`values` (n,), those neutral that make no difference to the error."""
    least = error_mps(values)
    for i in range(len(values)):
        trial = values.copy()
        trial[i] = neutral[i]
        if error_mps(trial) <= (1.0 + NO_DIFFERENCE) * least:
            values = trial
    return values


def _simplex(start: np.ndarray, bounds: Sequence, size: np.ndarray) -> np.ndarray:
    """The first simplex: half a grid step along each parameter, inwards."""
    corners = np.tile(start, (len(start) + 1, 1))
    for i, (bound, span) in enumerate(zip(bounds, size, strict=True)):
        half = 0.5 / (GRID - 1)
        corners[i + 1, i] += half if start[i] + half <= bound.high / span else -half
    return corners
