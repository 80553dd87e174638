"""From recordings to a model that was judged on what it had not seen.

The recordings are brought to the model's period, the shapes of its effects are looked for, the family's fit finds the
linear parameters with their standard errors, and folds of the recordings that the fit had not seen tell how good it is.
The validation input is filtered like the training input, the measured speed is not: the paper's tables can't be reached
otherwise (three taps, fitted to data below 1 Hz, make nothing but noise of what lies above). Source: sections II and IV
of Coen et al. 2005.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cruise.identification.accuracy import Accuracy, accuracy, persistence
from cruise.identification.armax import fit_armax
from cruise.identification.arx import fit_arx
from cruise.identification.families import Identified
from cruise.identification.held_out import Fold, folds
from cruise.identification.narx import fit_narx
from cruise.identification.output_error import fit_output_error
from cruise.identification.preparation import PreparationSettings, at_period, smoother
from cruise.identification.regressors import FitError, Smooth
from cruise.identification.shapes import HORIZON_S, excited_shapes, fit_shapes
from cruise.identification.structures import Family, Structure
from cruise.identification.whiteness import Whiteness, whiteness
from cruise.model.model import Model
from cruise.recording import Recording

Show = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Identification:
    """A fitted model, and how good it is `horizon_s` ahead. `held_out` is None where the recordings are too short."""

    structure: Structure
    fitted: Identified
    recordings: tuple[Recording, ...]
    horizon_s: float
    filtered: bool  # whether the input of the predictions below was filtered like the training data
    training: Accuracy
    held_out: Accuracy | None
    free_run: Accuracy
    persistence: Accuracy
    whiteness: Whiteness  # of the one-step residuals on the training data
    predicted_mps: tuple[np.ndarray, ...]  # (N,) per recording, `horizon_s` ahead

    @property
    def model(self) -> Model | None:
        """The core that can be saved and driven with; None for NARX, which has none."""
        return getattr(self.fitted, "model", None)


def fit_family(
    structure: Structure, model: Model, recordings: Sequence[Recording], smooth: Smooth | None = None
) -> Identified:
    """The structure's family fitted with the effects of `model`, whose linear parameters say nothing yet."""
    match structure.family:
        case Family.ARX:
            return fit_arx(model, recordings, smooth)
        case Family.ARMAX:
            return fit_armax(model, structure.nc, recordings, smooth)
        case Family.OUTPUT_ERROR:
            return fit_output_error(model, recordings, smooth)
        case Family.NARX:
            return fit_narx(model, structure.degree, recordings, smooth)


def with_shapes(
    model: Model, recordings: Sequence[Recording], smooth: Smooth | None = None, show: Show | None = None
) -> Model:
    """`model` with the shapes of its effects found from the recordings; those that nothing moves stay as they are."""
    shapes = excited_shapes(model, recordings)
    return fit_shapes(model, recordings, shapes, HORIZON_S, smooth, show) if shapes else model


def identify(
    structure: Structure,
    recordings: Sequence[Recording],
    preparation: PreparationSettings,
    start: Model | None = None,
    horizon_s: float = HORIZON_S,
    show: Show | None = None,
) -> Identification:
    """Fit and judge. `start`: a model whose effects' shapes are where the search begins. Raises FitError."""
    tell = show or (lambda _: None)
    period_s = preparation.period_s
    prepared = at_period(recordings, period_s)
    smooth = smoother(preparation, period_s)
    empty = structure.model(period_s)
    if start is not None:
        empty = replace(empty, effects=start.effects)
    tell(f"fitting {structure}")
    shaped = with_shapes(empty, prepared, smooth, show)
    fitted = fit_family(structure, shaped, prepared, smooth)
    horizon = max(round(horizon_s / period_s), 1)
    validation = _usable(fitted, prepared[0], smooth)
    measured = [one.output for one in prepared]
    predicted = [fitted.ahead(one, horizon, validation) for one in prepared]
    one_ahead = [fitted.ahead(one, 1, validation) for one in prepared]
    judged = None
    try:
        errors = []
        for i, fold in enumerate(folds(prepared)):
            tell(f"judging on held-out block {i + 1}")
            errors.append(_unseen(structure, shaped, fold, smooth, validation, horizon))
    except FitError:  # the parts are too short to fit or to judge; the figures on the whole stand
        pass
    else:
        judged = accuracy([one for seen, _ in errors for one in seen], [one for _, said in errors for one in said])
    return Identification(
        structure=structure,
        fitted=fitted,
        recordings=tuple(prepared),
        horizon_s=horizon * period_s,
        filtered=validation is not None,
        training=accuracy(measured, predicted),
        held_out=judged,
        free_run=accuracy(measured, [fitted.free_run(one, validation) for one in prepared]),
        persistence=persistence(prepared, horizon_s),
        whiteness=whiteness([y - p for y, p in zip(measured, one_ahead, strict=True)], structure.na),
        predicted_mps=tuple(predicted),
    )


def _usable(fitted: Identified, recording: Recording, smooth: Smooth | None) -> Smooth | None:
    """The filter, unless an effect reads the speed: then nothing can be filtered before the prediction."""
    if smooth is None:
        return None
    try:
        fitted.ahead(recording, 1, smooth)
    except ValueError:
        return None
    return smooth


def _unseen(
    structure: Structure, shaped: Model, fold: Fold, smooth: Smooth | None, validation: Smooth | None, horizon: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Measured and predicted speeds of the fold's unseen blocks."""
    fitted = fit_family(structure, shaped, fold.training, smooth)
    return [one.output for one in fold.unseen], [fitted.ahead(one, horizon, validation) for one in fold.unseen]
