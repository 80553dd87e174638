"""The candidates of a diagnosis as cards, each with its evidence, and the minute that tells most."""

import math
from typing import Final

import numpy as np

from cruise.effects import EFFECTS
from cruise.report import diagnosis, diagnosis_picture, evidence
from cruise.report.curve import curve
from cruise.report.diagnosis import figure
from cruise.report.effect import physics, what
from cruise.validation.candidates import UNNAMED
from cruise.validation.diagnose import Diagnosis, Verdict
from cruise.validation.judged import Judged
from cruise.validation.numbers import numbers
from cruise.validation.tried import Tried, step_of, tried_in
from cruise.workbench.found import Card, Curve, Minute, Number, Signature

CARDS: Final = 6  # candidates that are shown with their evidence
DRIVEN_BINS: Final = 48
NO_PHYSICS: Final = (
    "A smooth curve without any physics, fitted to see whether the signal matters. It says that something is missing "
    "and where it shows, not what it is."
)


def shown(found: Diagnosis) -> list[Tried]:
    """The candidates with a card: what was named first, then the best of the rest, a curve without physics last."""
    first = found.steps[0].tried
    of_verdict = [tried_in(step_of(found.steps, name), name) for name in found.effects]
    rest = [one for one in first if one.name not in found.effects and not one.name.startswith(UNNAMED)]
    chosen = [one for one in of_verdict if one is not None]
    if found.verdict is Verdict.UNLISTED:
        chosen = [one for one in first if one.name.removeprefix(UNNAMED) in found.signals]
    return [*chosen, *rest][: max(CARDS, len(chosen))]


def card(found: Diagnosis, tried: Tried) -> Card:
    """One candidate as it was tried."""
    name, listed = tried.name, not tried.name.startswith(UNNAMED)
    signal = name.removeprefix(UNNAMED)
    step = next((step for step in found.steps if tried in step.tried), found.steps[0])
    before, after = step.before, tried.judged
    confidence = next((one.confidence for one in found.ranking if one.effect == name), math.nan)
    if not listed:
        confidence = found.confidence
    about = EFFECTS[name].about if listed else None
    chosen = name in found.effects or signal in found.signals
    fit = evidence.fit_of(found, name, after)
    fitted = evidence.numbers_of(name, numbers(found.study, fit))
    one_of_several = len(found.effects) > 1 and name in found.effects and fit is found.final
    alike = [one.replace("`", "") for one in diagnosis.look_alikes(found) if one.startswith(f"`{name}`")]
    return Card(
        effect=name if listed else f"a curve of {signal}",
        headline=what(EFFECTS[name]()) if listed else f"The speed depends on {signal}.",
        physics=physics(EFFECTS[name]()) if listed else NO_PHYSICS,
        equation=about.equation if about else "",
        confidence_words=diagnosis.confidence(confidence),
        error_before_mps=evidence.error_mps(before),
        error_after_mps=evidence.error_mps(after),
        gain=tried.gain,
        sureness=tried.sureness,
        counts=tried.credit,
        step=found.effects.index(name) + 1 if one_of_several else 0,
        chosen=chosen,
        worth_adding=name in found.worth_adding,
        listed=listed,
        numbers=tuple(_number(one) for one in fitted),
        look_alikes=tuple(alike),
        experiment=about.experiment if about else " ".join(diagnosis.experiments(found)).replace("`", ""),
        signature=_signature(before.error_mps, after.error_mps),
        curve=_curve(found, before, fit, name),
    )


def _number(one: evidence.Number) -> Number:
    error = figure(one.std) if one.std > 0.0 else "-"
    return Number(one.name, figure(one.value), error, one.unit, diagnosis.span(one), one.remark)


def _signature(before: np.ndarray, after: np.ndarray) -> Signature:
    change = before - after
    known = np.isfinite(change)
    return Signature(
        diagnosis_picture.binned(change[known], before[known]), diagnosis_picture.binned(change[known], after[known])
    )


def _curve(found: Diagnosis, before: Judged, fit: Judged, name: str) -> Curve:
    drawn = curve(found.study, before, fit, name)
    driven = None
    if drawn.driven is not None:
        values = drawn.driven[np.isfinite(drawn.driven)]
        counts, edges = np.histogram(values, DRIVEN_BINS, (float(drawn.x.min()), float(drawn.x.max())))
        driven = 0.5 * (edges[1:] + edges[:-1]), counts
    x_words = f"{drawn.x_name} ({drawn.x_unit})" if drawn.x_unit else drawn.x_name
    return Curve(drawn.x, drawn.y, drawn.bands, drawn.limits, drawn.without, x_words, drawn.y_words, driven)


def minute(found: Diagnosis, final: Judged) -> Minute:
    """The minute in which `final` is better than the model by most."""
    scene = found.study.search.scene
    number, stretch = diagnosis_picture.telling_stretch(found, final)
    recording, first = scene.recordings[number], scene.parts[number].start
    measured = scene.speed_mps[stretch]
    named = {
        Verdict.MISSING: " and ".join(found.worth_adding),
        Verdict.AMBIGUOUS: found.effects[0] if found.effects else "",
    }
    tried = found.steps[0].tried
    best = ", ".join(found.signals) or (tried[0].name.removeprefix(UNNAMED) if tried else "")
    return Minute(
        time_s=recording.time_s[stretch.start - first : stretch.stop - first],
        measured_mps=measured,
        before_mps=measured - found.base.error_mps[stretch],
        after_mps=measured - final.error_mps[stretch],
        label=named.get(found.verdict) or f"a curve of {best}" if found.explained else f"{best}, not believed",
    )
