"""A model against measurements: `horizon_s` ahead and in free run, beside persistence, on the same samples.

    e_k = y_k - p_k ,    p^(h)_k the speed as predicted h samples before,   p_k the model's own speed in free run

y measured speed in m/s. A model that has parameters is taken as it is. A structure that has none is fitted to the
recordings, and every sample is then judged by a fit that has not seen it: figures, regimes and pictures are all of
those predictions. Source: C. Bergmeir, J. M. Benitez, Information Sciences 191 (2012) 192-213 (blocked validation).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.identification.accuracy import Accuracy, accuracy, persistence
from cruise.identification.armax import Armax
from cruise.identification.arx import Arx
from cruise.identification.families import Identified, Linear
from cruise.identification.held_out import folds
from cruise.identification.identify import Show, fit_family, validation_filter, with_shapes
from cruise.identification.narx import Narx
from cruise.identification.output_error import OutputError
from cruise.identification.preparation import PreparationSettings, at_period, smoother
from cruise.identification.regressors import SAME_PERIOD, FitError, Smooth, checked_signals
from cruise.identification.shapes import HORIZON_S
from cruise.identification.structures import Family, Structure
from cruise.model.model import Model
from cruise.recording import Recording

TAKEN: Final = "taken as it is, nothing was fitted"
HELD_OUT: Final = "fitted to these recordings; every sample judged by a fit that had not seen it"
NOT_HELD_OUT: Final = "fitted to these recordings and judged on them"


@dataclass(frozen=True, eq=False)
class Comparison:
    """What a model says of recordings: speeds (N,) in m/s per recording, NaN where there is none, and figures."""

    structure: Structure
    fitted: Identified  # with held-out judgement: the fit to all, which made none of the predictions below
    how: str  # TAKEN, HELD_OUT, or NOT_HELD_OUT with the reason
    recordings: tuple[Recording, ...]  # at the model's period
    native: tuple[Recording, ...]  # as they were measured
    horizon_s: float
    smooth: Smooth | None  # what the model's input was filtered with
    ahead_mps: tuple[np.ndarray, ...]
    free_run_mps: tuple[np.ndarray, ...]
    ahead: Accuracy
    free_run: Accuracy
    persistence: Accuracy  # on the samples of `ahead`

    @property
    def horizon(self) -> int:
        """The horizon in samples."""
        return round(self.horizon_s / self.fitted.period_s)

    @property
    def errors_mps(self) -> tuple[np.ndarray, ...]:
        """Measured minus predicted `horizon_s` ahead, (N,) per recording."""
        return tuple(one.output - speed for one, speed in zip(self.recordings, self.ahead_mps, strict=True))


def of_parameters(family: Family, model: Model, noise: Sequence[float] = ()) -> Linear:
    """The predictor of a model that has its parameters; `noise` is c_1 .. of an ARMAX model."""
    match family:
        case Family.ARX:
            return Arx(model, "")
        case Family.ARMAX:
            return Armax(model, "", noise=tuple(noise), noise_std=(np.nan,) * len(noise))
        case Family.OUTPUT_ERROR:
            return OutputError(model, "")
        case Family.NARX:
            raise FitError("polynomials are not kept in files: give the structure, it is fitted to the recordings")


def compare(
    model: Structure | tuple[Structure, Linear],
    recordings: Sequence[Recording],
    preparation: PreparationSettings,
    horizon_s: float = HORIZON_S,
    show: Show | None = None,
) -> Comparison:
    """Judge a model with parameters, or a structure that is fitted first. FitError where a signal is lacking."""
    period_s = preparation.period_s
    prepared = tuple(at_period(recordings, period_s))
    smooth = smoother(preparation, period_s)
    horizon = max(round(horizon_s / period_s), 1)
    if isinstance(model, Structure):
        structure = model
        fitted, how, ahead, free = _fitted_here(structure, prepared, period_s, smooth, horizon, show)
        validation = validation_filter(fitted_core(fitted), smooth)
    else:
        structure, fitted = model
        if abs(fitted.period_s - period_s) > SAME_PERIOD * period_s:
            raise FitError(
                f"the model runs every {fitted.period_s:g} s, not every {period_s:g} s: leave out --period, or fit "
                "the structure anew at that period"
            )
        for one in prepared:
            checked_signals(fitted.model, one)
        _refuse_unstable(fitted)
        validation, how = validation_filter(fitted.model, smooth), TAKEN
        ahead = [fitted.ahead(one, horizon, validation) for one in prepared]
        free = [fitted.free_run(one, validation) for one in prepared]
    measured = [one.output for one in prepared]
    judged = accuracy(measured, ahead)
    if not judged.samples:
        raise FitError(
            f"no sample has {horizon_s:g} s of whole recording before it: record for longer, or look less far"
        )
    return Comparison(
        structure=structure,
        fitted=fitted,
        how=how,
        recordings=prepared,
        native=tuple(recordings),
        horizon_s=horizon * period_s,
        smooth=validation,
        ahead_mps=tuple(ahead),
        free_run_mps=tuple(free),
        ahead=judged,
        free_run=accuracy(measured, free),
        persistence=persistence(measured, ahead, horizon),
    )


def fitted_core(fitted: Identified) -> Model:
    """Orders, delay and effects of a fitted model of any family; the parameters of a NARX model say nothing."""
    if isinstance(fitted, Narx):
        return fitted.structure
    assert isinstance(fitted, Linear)
    return fitted.model


def _refuse_unstable(fitted: Identified) -> None:
    if fitted.unstable:
        raise FitError(f"unstable predictor, {fitted.unstable}: no figure of it means anything; fit another structure")


def _fitted_here(
    structure: Structure,
    recordings: Sequence[Recording],
    period_s: float,
    smooth: Smooth | None,
    horizon: int,
    show: Show | None,
) -> tuple[Identified, str, list[np.ndarray], list[np.ndarray]]:
    """The fit to all recordings, how it is judged, and the predictions ahead and in free run that judge it."""
    if show is not None:
        show(f"fitting {structure}")
    shaped = with_shapes(structure.model(period_s), recordings, smooth, show)
    fitted = fit_family(structure, shaped, recordings, smooth)
    _refuse_unstable(fitted)
    validation = validation_filter(shaped, smooth)
    ahead = [np.full(len(one), np.nan) for one in recordings]
    free = [np.full(len(one), np.nan) for one in recordings]
    try:
        for i, fold in enumerate(folds(recordings)):
            if show is not None:
                show(f"judging on held-out part {i + 1}")
            part = fit_family(structure, with_shapes(shaped, fold.training, smooth), fold.training, smooth)
            _refuse_unstable(part)
            for k, (one, unseen) in enumerate(zip(recordings, fold.unseen, strict=True)):
                if unseen.stop > unseen.start:
                    ahead[k][unseen] = part.ahead(one, horizon, validation)[unseen]
                    free[k][unseen] = part.free_run(one, validation)[unseen]
    except FitError as error:  # what is left without the held-out samples can't be fitted; the figures on all stand
        ahead = [fitted.ahead(one, horizon, validation) for one in recordings]
        free = [fitted.free_run(one, validation) for one in recordings]
        return fitted, f"{NOT_HELD_OUT}: {error}", ahead, free
    return fitted, HELD_OUT, ahead, free
