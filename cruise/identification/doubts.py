"""Why a fitted model is not to be driven with yet, in words."""

import math
from collections.abc import Iterable
from typing import Final

from cruise.effects import Parameter
from cruise.identification.accuracy import Accuracy
from cruise.identification.identify import Identification

FAR_WORSE: Final = 3.0  # times the training error: chance does not do that to some minutes
REMEDY: Final = "drive some minutes, with steps of different size over the whole range, and identify again"


def doubts(found: Identification) -> list[str]:
    """What speaks against driving with the model, a line each; none where it predicts what it had not seen."""
    if found.fitted.unstable:
        return [f"its predictor is unstable: {found.fitted.unstable}"]
    return [*_unseen(found.held_out, found.training, found.persistence), *_at_bounds(found)]


def at_bound(value: float, bound: Parameter) -> bool:
    """Whether a shape was pushed against the end of its range."""
    return value != bound.neutral and value in (bound.low, bound.high)


def _unseen(held_out: Accuracy | None, training: Accuracy, held: Accuracy) -> Iterable[str]:
    """What the error on data that the fit had not seen says; `held` is that of persistence."""
    if held_out is None or not math.isfinite(held_out.rmse_mps):
        yield "nothing shows how well it predicts what it had not seen"
        return
    if held_out.rmse_mps > held.rmse_mps:
        yield f"held out, it errs by {held_out.rmse_mps:.3g} m/s; persistence errs by {held.rmse_mps:.3g} m/s"
    if held_out.rmse_mps > FAR_WORSE * training.rmse_mps:
        yield f"held out, it errs {held_out.rmse_mps / training.rmse_mps:.2g} times as much as in training"


def _at_bounds(found: Identification) -> Iterable[str]:
    for effect in found.effects:
        for name, bound in effect.parameters.items():
            sought = (effect.name, name) in found.looked_for
            if sought and at_bound(float(getattr(effect, name)), bound):
                yield f"{effect.name}.{name} is at its bound: these recordings don't show it"
