"""The ladder: add an effect to a model, refit everything, and say what the error was and what it is.

Both errors are of the discrete models that drive, held out, on the same samples; the floor below them is that of
`noise_floor`. What was added before is fitted anew with every further effect: the core's own effects and terms of the
user's own too. An effect that scales the drive brings the dead zone along where the drive begins at a current of its
own and was never driven below it: nothing showed that before.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from cruise.effects import EFFECTS, Custom, Stage
from cruise.effects.dead_zone import DeadZone
from cruise.identification.regressors import FitError
from cruise.identification.structures import Structure
from cruise.model.files import PhysicalCore
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.validation.candidates import Candidate, with_effect, without
from cruise.validation.explanation import Explanation
from cruise.validation.judged import Judged
from cruise.validation.noise_floor import NoiseFloor, noise_floor
from cruise.validation.numbers import numbers
from cruise.validation.search import STROKE_GAIN, Search
from cruise.validation.simulation import WARM_UP_S
from cruise.validation.study import Show, Study, candidate, discrete, study
from cruise.validation.terms import check_term, defined, term_candidate
from cruise.validation.unnamed import rest_of


@dataclass(frozen=True)
class Parameter:
    """One fitted number before and after; `std` of the value after, infinite if not told. None: it was not there."""

    name: str
    unit: str
    before: float | None
    after: float
    std: float
    remark: str


@dataclass(frozen=True, eq=False)
class Added:
    """A model with one effect more, and the held-out RMS `horizon_s` ahead before and after, on `samples` samples."""

    effect: str
    model: Model
    before: Judged
    after: Judged
    error_before_mps: float
    error_after_mps: float
    samples: int
    predicted_mps: np.ndarray  # (N,) by the model with the effect, held out, NaN where there is no prediction

    @property
    def brought_along(self) -> tuple[str, ...]:
        """What else the model has now that it had not."""
        before = {self.effect, *self.before.explanation.names}
        return tuple(name for name in self.after.explanation.names if name not in before)


def begin(
    recordings: Sequence[Recording],
    structure: Structure,
    file: Model | None,
    core: PhysicalCore | None,
    period_s: float,
    horizon_s: float = WARM_UP_S,
    show: Show = lambda text: None,
    at_their_rate: bool = False,
    wanted: str | Custom = "",
) -> Study:
    """The study of a model, with all that it holds: terms of the user's own, and what lives in its core.

    `wanted` is the effect that is to be added, where that is known: its signals count even where they have holes.
    Without `at_their_rate` it is fitted as the discrete model that drives: from means over the period.
    """
    further: list[Candidate] = []
    own = [*structure.custom, *([wanted] if isinstance(wanted, Custom) else [EFFECTS[wanted]] if wanted else [])]
    needed = {name for effect in own for name in effect.needs}
    if file is not None:
        for term in structure.custom:
            check_term(term, recordings)
        begun = study(recordings, structure, file, period_s, horizon_s, show, at_their_rate, needed)
    else:  # a term that was never fitted has no shape to begin from
        terms = {term.name for term in structure.custom}
        bare = replace(structure, effects=tuple(name for name in structure.effects if name not in terms), custom=())
        begun = study(recordings, bare, None, period_s, horizon_s, show, at_their_rate, needed)
        further = [term_candidate(term, begun.recordings) for term in structure.custom]
    further += [candidate(name, begun.recordings) for name in (core.effects if core else ())]
    for one in further:
        show(f"fitting with {one.name}")
        grown = begun.search.grown(begun.base.explanation, one)
        begun = replace(begun, base=begun.search.judged("", grown))
    return begun


def add(study: Study, effect: str | Custom, show: Show = lambda text: None) -> Added:
    """The study's model with the effect, everything refitted jointly. FitError says why an effect can't be added."""
    base, search = study.base, study.search
    name = effect if isinstance(effect, str) else effect.name
    if name in base.explanation.names:
        raise FitError(f"the model has {name} already: name another effect, or take it out with cruise ladder --undo")
    if isinstance(effect, Custom):
        known: Candidate = term_candidate(effect, study.recordings)
    else:
        known = candidate(effect, study.recordings)
    show(f"fitting with {name}")
    grown = search.freed(search.grown(base.explanation, known), name)
    alone = search.judged(name, search.settled(grown))
    after = _drivable(search, search.sufficient(search.grounded(search.all_freed(alone)), STROKE_GAIN))
    terms = [one for one in after.explanation.effects if isinstance(one, Custom)]
    undefined = [one.name for one in terms if not defined(one, study.recordings)]
    if undefined:
        raise FitError(
            f"{undefined[0]} was fitted to where it is not a number in every sample; give it narrower bounds"
        )
    show("judging")
    without_mps, with_mps = (search.unseen_ahead_mps(one, study.horizon) for one in (base, after))
    measured = search.scene.speed_mps
    errors = np.array([measured - without_mps, measured - with_mps])
    both = np.isfinite(errors).all(axis=0)
    rms_mps = np.sqrt(np.mean(errors[:, both] ** 2, axis=1)) if both.any() else np.full(2, math.nan)
    if not np.isfinite(rms_mps).all():
        raise FitError(f"with {name} there is no prediction {study.horizon_s:g} s ahead that could be judged")
    before, later = rms_mps.tolist()
    return Added(name, discrete(study, after), base, after, before, later, int(both.sum()), with_mps)


def floor(study: Study, native: Sequence[Recording], added: Added) -> NoiseFloor:
    """The noise floor of the recordings, `native` as they were measured, seen from the model with the effect."""
    predicted = [added.predicted_mps[part] for part in study.search.scene.parts]
    return noise_floor(native, study.recordings, predicted, study.horizon)


def physical(explanation: Explanation) -> PhysicalCore:
    """The core as it stands in a model file."""
    core = explanation.core
    own = {one.name: getattr(core, one.name) for one in fields(core) if getattr(core, one.name) != one.default}
    loads = (explanation.effects[i].name for i in explanation.at(Stage.LOAD))
    return PhysicalCore(
        **own,
        loads_mps=dict(zip(loads, explanation.loads, strict=True)),
        offset_mps=explanation.offset_mps,
        effects=tuple(sorted(explanation.structural)),
    )


def parameters(study: Study, added: Added) -> list[Parameter]:
    """Everything that was fitted, in physical terms."""
    before = {(one.owner, one.name): one.value for one in numbers(study, added.before)}
    return [
        Parameter(
            one.name if one.owner in ("core", "resonance") else f"{one.owner}.{one.name}",
            one.unit,
            before.get((one.owner, one.name)),
            one.value,
            one.std,
            one.remark,
        )
        for one in numbers(study, added.after)
    ]


def _drivable(search: Search, found: Judged) -> Judged:
    """The same with a dead zone in the place of the current about which a gain turns the drive, where that is less.

    No effect of a model file is such a current; a pump that begins there is.
    """
    rest = rest_of(found.explanation.effects)
    if rest is None:
        return found
    bare = without(found.explanation, rest.name)
    ways = [bare]
    if rest.rest_ma > 0.0:
        ways.append(with_effect(bare, DeadZone(min(rest.rest_ma, DeadZone.parameters["threshold_ma"].high))))
    return min((search.judged(found.candidate, search.settled(search.fitted(one))) for one in ways), key=_loss)


def _loss(one: Judged) -> float:
    return one.loss
