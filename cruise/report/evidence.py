"""What `cruise diagnose` shows beside the verdict: the steps that led to it, fitted numbers with their uncertainty."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from cruise.recording import Recording
from cruise.validation.candidates import UNNAMED, owner
from cruise.validation.diagnose import Diagnosis, Verdict
from cruise.validation.explanation import Explanation
from cruise.validation.judged import Judged
from cruise.validation.noise_floor import NoiseFloor, noise_floor
from cruise.validation.numbers import PLAUSIBLE, Number
from cruise.validation.tried import Tried, tried_in
from cruise.validation.unnamed import SPEED, RestCurrent

SURE: Final = 2.0  # standard errors
LITTLE: Final = 0.01  # relative change that matters to nobody
MUCH: Final = 0.1  # of a plausible range, that a standard error covers where it is larger than the number
HARDLY_TOLD: Final = "hardly told"
OWN_SPEED: Final = "the model's own speed"


@dataclass(frozen=True, eq=False)
class Rung:
    """One step of the search: what came in and went out, and the fits before and after with their errors in m/s."""

    added: tuple[str, ...]
    dropped: tuple[str, ...]
    before: Judged
    after: Judged
    error_before_mps: float
    error_after_mps: float


def rungs(found: Diagnosis) -> list[Rung]:
    """The steps that were taken, none where nothing was added. Errors are held out, `horizon_s` ahead."""
    stops = [*(step.before for step in found.steps), found.final]
    return [rung(found, *pair) for pair in pairwise(stops) if pair[0] is not pair[1]]


def rung(found: Diagnosis, before: Judged, after: Judged) -> Rung:
    """The step from one fit to another, taken or not."""
    old, new = members(before.explanation), members(after.explanation)
    return Rung(
        added=tuple(name for name in new if name not in old),
        dropped=tuple(name for name in old if name not in new),
        before=before,
        after=after,
        error_before_mps=error_mps(before),
        error_after_mps=error_mps(after),
    )


def error_mps(judged: Judged) -> float:
    """Held-out RMS in m/s, at least the horizon ahead."""
    return math.sqrt(judged.loss)


def members(explanation: Explanation) -> tuple[str, ...]:
    """Names of the effects in an explanation; all parts of an unnamed dependence are one, a current at rest is none."""
    effects = [effect for effect in explanation.effects if effect.name != RestCurrent.name]
    return (*dict.fromkeys(owner(effect) for effect in effects), *sorted(explanation.structural))


def signal_of(name: str) -> str:
    """The signal of a curve without physics, or a signal itself, as it is spoken of: the model's speed is no column."""
    signal = name.removeprefix(UNNAMED)
    return OWN_SPEED if signal == SPEED else signal


def first_tried(found: Diagnosis, name: str) -> Tried | None:
    """An effect beside the model as it was given; None where it was not tried."""
    return tried_in(found.steps[0], name)


def fit_of(found: Diagnosis, name: str, tried: Judged) -> Judged:
    """The fit that says what an effect does: the final one if it holds it; of look-alikes each as it was tried."""
    holds = found.verdict is not Verdict.AMBIGUOUS and name in members(found.final.explanation)
    return found.final if holds else tried


def best_named(found: Diagnosis) -> Tried | None:
    """The effect for which there is most evidence beside the model as it was given; another may leave less."""
    return next((one for one in found.steps[0].tried if not one.name.startswith(UNNAMED)), None)


def best_unnamed(found: Diagnosis) -> Tried | None:
    """The curve without physics for which there is most evidence there."""
    return next((one for one in found.steps[0].tried if one.name.startswith(UNNAMED)), None)


def floor_of(found: Diagnosis, native: Sequence[Recording]) -> NoiseFloor:
    """The noise floor `horizon_s` ahead, from the recordings as measured and what the best fit predicts, held out."""
    study, scene = found.study, found.study.search.scene
    predicted_mps = scene.speed_mps - found.final.error_mps
    return noise_floor(native, study.recordings, [predicted_mps[part] for part in scene.parts], study.horizon)


def numbers_of(name: str, all_numbers: Sequence[Number]) -> list[Number]:
    """Those of one effect; a transport delay is the core's."""
    if name == "transport_delay":
        return [one for one in all_numbers if one.owner == "core" and one.name == "delay_s"]
    return [one for one in all_numbers if one.owner == name]


def remark(one: Number) -> str:
    """What to think of a number: that it is plausible says little where its error is larger, and much of its range."""
    span = one.high - one.low
    wide = one.std > abs(one.value) and (math.isinf(span) or one.std > MUCH * span)
    return HARDLY_TOLD if one.remark == PLAUSIBLE and wide else one.remark


@dataclass(frozen=True)
class Moved:
    """A number that was there before, and what became of it."""

    before: Number
    after: Number

    @property
    def share(self) -> float:
        """Relative change; NaN where there was nothing."""
        return self.after.value / self.before.value - 1.0 if self.before.value else np.nan

    @property
    def far(self) -> bool:
        """Whether it moved by more than its standard errors, taken as independent, let it."""
        change = abs(self.after.value - self.before.value)
        return bool(change > SURE * np.hypot(self.before.std, self.after.std) and abs(self.share) > LITTLE)


def moved(before: Sequence[Number], after: Sequence[Number]) -> list[Moved]:
    """The core, and the effects that the model had."""
    new = {(one.owner, one.name): one for one in after}
    return [Moved(one, new[one.owner, one.name]) for one in before if (one.owner, one.name) in new]
