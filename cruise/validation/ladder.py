"""Add an effect to a model: refit everything, and say what the error was and what it is."""

from dataclasses import dataclass

from cruise.identification.regressors import FitError
from cruise.model.model import Model
from cruise.validation.candidates import candidates
from cruise.validation.search import Judged
from cruise.validation.study import Show, Study, candidate, discrete


@dataclass(frozen=True, eq=False)
class Added:
    """A model with one effect more, and the held-out RMS `horizon_s` ahead before and after."""

    effect: str
    model: Model
    before: Judged
    after: Judged
    error_before_mps: float
    error_after_mps: float


def add(study: Study, effect: str, show: Show = lambda text: None) -> Added:
    """The study's model with the effect, everything refitted jointly. FitError says why an effect can't be added."""
    base, search = study.base, study.search
    if effect in base.explanation.names:
        raise FitError(f"the model has {effect} already: name another effect, or take it out with --undo")
    _, refused = candidates(study.recordings, base.explanation)
    for one in refused:
        if one.effect == effect:
            raise FitError(f"{effect} can't be added: {one.reason}; record a drive in which it is measured and moves")
    show(f"fitting with {effect}")
    after = search.judged(effect, search.grown(base.explanation, candidate(effect)))
    before_mps, after_mps = (search.ahead_rms_mps(one, study.horizon_s) for one in (base, after))
    return Added(effect, discrete(study, after), base, after, before_mps, after_mps)
