"""A diagnosis in words: the verdict, what else it could be, what could have hidden, and what to drive next."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cruise.effects import EFFECTS, Stage
from cruise.effects.stroke import USUAL_MPS
from cruise.report import evidence
from cruise.report.evidence import OWN_SPEED, SURE, Number, signal_of
from cruise.validation.candidates import MEDIATORS, UNNAMED
from cruise.validation.confidence import FEWEST, in_moments
from cruise.validation.dead_time import DeadTime
from cruise.validation.diagnose import SEED, Diagnosis, Verdict
from cruise.validation.explanation import CORE
from cruise.validation.judged import Judged, sureness
from cruise.validation.left_over import DELAY
from cruise.validation.numbers import numbers
from cruise.validation.tried import LEAST_GAIN, LOOSE, Tried, step_of, tried_in
from cruise.validation.unnamed import rest_of

DOUBTFUL: Final = 0.5  # confidence below which an effect may be missing, rather than is
FAR: Final = 2.5  # times the noise, from which an error is far above it
NEGLIGIBLE: Final = 1e-9  # in any unit that numbers are shown in
ANSWERS: Final = "for its signal answers to the drive itself, or its best fit has a shape that no such effect has"
QUICK: Final = 1.1  # of its lower bound, a time that wants to be shorter
COARSE: Final = 2.0  # periods, within which a quick drive answers
AT_REST: Final = frozenset({"dead_zone", "coulomb_friction"})  # look alike but for how the machine comes to rest
DISCOUNTED: Final = f"{ANSWERS}, or the line pressure speaks against it"
"""Why not all of an effect's evidence counts."""


def sentence(found: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    horizon = f"{found.study.horizon_s:g} s ahead"
    before = _error(found.base)
    sure = f"(confidence {confidence(found.confidence)})"
    match found.verdict:
        case Verdict.MISSING:
            names, one = _all(found.effects), len(found.effects) == 1
            are = "may be" if found.confidence < DOUBTFUL else "is" if one else "are"
            after = _error(found.final)
            late = found.left.dead_time
            if late is not None and DELAY in found.effects:
                return _changing(found, late, sure)
            return (
                f"{names} {are} missing: with {'it' if one else 'them'} the error {horizon} falls "
                f"from {before} to {after} m/s on data that the fit has not seen {sure}.{_rest(found)}{_later(late)}"
                f"{_beside(found)}"
            )
        case Verdict.NOTHING:
            share = hidden_share(found)
            return (
                f"Nothing is missing: no effect that these recordings can speak of lowers the error {horizon}, "
                f"{before} m/s, by as much as {math.ceil(100 * (1 - math.sqrt(1 - share)))} % {sure}."
            )
        case Verdict.UNLISTED:
            best = evidence.best_named(found)
            rival = f"; the likeliest effect, `{best.name}`, leaves {_error(best.judged)} m/s" if best else ""
            if found.untold:
                noise_mps = math.sqrt(found.steps[0].background.noise)
                far = "far " if math.sqrt(found.base.loss) > FAR * noise_mps else ""
                partly = found.steps[0].taken
                explained = "known effects explain less than half of that" if partly else "no known effect explains it"
                great = f"is {far}above the noise of {figure(noise_mps)} m/s"
                what = "that nobody recorded"
                if not math.isnan(found.left.swing_s):
                    great, what = f"swings with a period of {found.left.swing_s:.1f} s", f"{what} and that swings"
                elif found.momentary:
                    there = in_moments(found.final.fit.error_mps, found.study.period_s)
                    great = f"has {100 * there:.0f} % of its square in {100 * FEWEST:.0f} % of the time"
                    what = "that acts in few moments"
                return (
                    f"Something is missing {what}: the error {horizon}, {before} m/s, {great}, {explained}, and "
                    f"nothing that is recorded foretells it, for sure{rival} {sure}."
                )
            if not found.explained:
                by = f"most of it by {_all(found.signals)}" if found.signals else "by no one signal"
                return (
                    f"Something is missing that is none of the effects that cruise knows: the recordings foretell "
                    f"{figure(math.sqrt(found.left.hidden.loss))} m/s RMS of the error {horizon}, {before} m/s, with a "
                    f"little of every known effect beside it, {by}{rival} {sure}."
                )
            if found.unrecorded:
                return (
                    f"Something is missing that is none of the effects that cruise knows: a force that nobody "
                    f"recorded. It shows in {_all(found.signals)}: a loss of speed with it lowers the error {horizon} "
                    f"from {before} to {_error(found.final)} m/s on data that the fit has not seen, and nothing else "
                    f"that is recorded foretells it{rival} {sure}."
                )
            return (
                f"Something is missing that is none of the effects that cruise knows: a free curve of "
                f"{_all(found.signals)} lowers the error {horizon} from {before} to "
                f"{_error(found.final)} m/s on data that the fit has not seen{rival} {sure}."
            )
    trials = [evidence.first_tried(found, name) for name in found.effects]
    after = " or ".join(_error(one.judged) for one in trials if one is not None)
    return (
        f"{_all(found.effects, 'or')} is missing, and these recordings can't tell which: the error {horizon} falls "
        f"from {before} to {after} m/s on data that the fit has not seen {sure}.{_beside(found)}"
    )


def _rest(found: Diagnosis) -> str:
    """From which current the gains act, where that is none of the current."""
    rest = rest_of(found.final.explanation.effects)
    if rest is None or rest.rest_ma <= 0.0:
        return ""
    return (
        f" What scales the drive acts on the current beyond {rest.rest_ma:.0f} mA, where the drive seems to begin: "
        f"`cruise add` brings a dead zone along."
    )


def _beside(found: Diagnosis) -> str:
    """What else is missing beside effects that are needed."""
    if not found.beside:
        return ""
    beside = f" Beside {'it' if len(found.effects) == 1 else 'them'} something is missing"
    through = [name for name in MEDIATORS if found.beside in EFFECTS[name].needs]
    if through:
        return (
            f"{beside} that {signal_of(found.beside)} shows and nothing else that is recorded: a force, or what acts "
            f"through it as {_all(through)} does, which takes most of what is left."
        )
    return (
        f"{beside} that is none of the effects that cruise knows: most of what is left depends on "
        f"{signal_of(found.beside)}."
    )


def _later(one: DeadTime | None) -> str:
    """That the dead time changes with the signal of what was found, too."""
    if one is None:
        return ""
    return (
        f" The drive answers earlier ({one.early_s:+.2f} s) and later ({one.late_s:+.2f} s) with {one.signal}, too: "
        f"{100 * one.share:.0f} % of the squared error that is left, which no model here takes away."
    )


def _changing(found: Diagnosis, one: DeadTime, sure: str) -> str:
    """A dead time that changes, alone or beside other effects."""
    *others, delay = found.effects
    horizon = f"{found.study.horizon_s:g} s ahead"
    before, after = _error(found.base), _error(found.final)
    first = f"with {_all(others)} the error {horizon} falls from {before} to {after} m/s, and " if others else ""
    share = f"{100 * one.share:.0f} % of the squared error"
    by = f", as {one.signal} has it" if one.signal else ""
    left = f"{share} that is left" if others else f"{share} {horizon}, {before} m/s,"
    return (
        f"{_all(found.effects)} {'are' if others else 'is'} missing: {first}{left} is that of a drive that answers "
        f"now earlier ({one.early_s:+.2f} s) and now later ({one.late_s:+.2f} s) than the model{by}. No constant delay "
        f"is a model of that: adding {_all([delay])} brings little {sure}."
    )


def confidence(value: float) -> str:
    """Two digits, and never 1 or 0."""
    if value > 0.99:
        return "> 0.99"
    return "< 0.01" if value < 0.01 else f"{value:.2f}"


def hidden_share(found: Diagnosis) -> float:
    """The share of the squared error that an effect could explain without being named."""
    gains = (one.gain for one in found.steps[0].tried if not one.name.startswith(UNNAMED))
    return max([LEAST_GAIN, *gains])


def look_alikes(found: Diagnosis) -> list[str]:
    """What could be taken for the verdict, and why it lost or can't be told apart."""
    told = []
    for name in found.worth_adding:
        apart = next((alike[1:] for alike in found.look_alikes if alike[0] == name), ())
        mine = _step_of(found, name)
        others = dict.fromkeys((*apart, *_runner_up(found, name), *EFFECTS[name].about.look_alikes))
        for other in others:
            if other in found.effects and other not in apart:
                continue
            told.append(f"`{name}` or `{other}`: {_against(found, mine, other, other in apart)}")
    return told


def forces(found: Diagnosis) -> list[str]:
    """What the signal that shows every force says, step by step; empty where none is recorded or it shows nothing."""
    told = []
    shown = _all([signal for name in MEDIATORS for signal in EFFECTS[name].needs])
    for step in found.steps:
        taken = tried_in(step, step.taken)
        if step.forces is not None and taken is not None:
            told.append(
                f"{shown} shows every force that the drive feels. With all of them known the error is "
                f"{_error(step.forces)} m/s, and {_error(taken.compared)} with `{taken.name}`, so that no force can "
                f"take its place. That is where the effects were weighed against each other."
            )
        elif step.refuted and taken is not None:
            told.append(
                f"{shown} shows it: beside every force that the drive feels, nothing that acts on the command, the "
                f"gain or a sensor is needed. So it is a force: `{taken.name}`."
            )
        elif step.unrecorded and found.effects:
            told.append(f"What is left beside {_all(found.effects)} shows in {shown}: a force that nobody recorded.")
    return told + _instead(found)


def _instead(found: Diagnosis) -> list[str]:
    """The effect through whose signal every force acts, where it alone leaves hardly more than the forces named."""
    if not found.effects or any(EFFECTS[name].stage is not Stage.LOAD for name in found.effects):
        return []
    alone = [one for one in found.steps[0].tried if one.name in MEDIATORS and one.name not in found.effects]
    return [
        f"`{one.name}` alone leaves {_error(one.judged)} m/s, {_all(found.effects)} {_error(found.final)} m/s: it "
        f"stands for every force that the drive feels, so that these recordings can't say whether "
        f"{'that force slows' if len(found.effects) == 1 else 'those forces slow'} the machine through it. To tell: "
        f"{EFFECTS[one.name].about.experiment}."
        for one in alone
        if one.judged.loss < LOOSE * found.final.loss
    ]


def _step_of(found: Diagnosis, name: str) -> dict[str, Tried]:
    """Everything that was tried in the step at which an effect was found."""
    tried = {one.name: one for one in step_of(found.steps, name).tried}
    return tried | {"": tried[name]}


def _runner_up(found: Diagnosis, name: str) -> list[str]:
    tried = [one for one in _step_of(found, name) if one and one != name and one not in found.effects]
    return [one for one in tried if not one.startswith(UNNAMED)][:1]


def _against(found: Diagnosis, tried: dict[str, Tried], other: str, alike: bool) -> str:
    if other not in tried:
        reasons = {one.effect: one.reason for one in found.refused}
        return f"not ruled out, {reasons[other]}" if other in reasons else "the model has it already"
    mine, its = tried[""], tried[other]
    errors = f"{_error(its.compared)} m/s against {_error(mine.compared)}"
    if mine.compared is not mine.judged:
        errors += " with every force known"
    if alike:
        return f"can't be told apart, {errors}"
    apart = sureness(its.compared, mine.compared, np.random.default_rng(SEED))
    moved = f"; it counts for {100 * its.credit:.0f} %, {discounted(found)}" if its.credit < 1.0 else ""
    if abs(apart) < SURE:
        return f"leaves {errors}, too close for the errors to decide ({apart:+.1f} standard errors){moved}"
    return f"leaves {errors}, {abs(apart):.1f} standard errors {'more' if apart > 0.0 else 'less'}{moved}"


def discounted(found: Diagnosis) -> str:
    """Why not all of an effect's evidence counts, where a pressure can speak only if it was recorded."""
    shown = {signal for name in MEDIATORS for signal in EFFECTS[name].needs}
    recorded = all(shown <= set(one.columns) for one in found.study.recordings)
    return DISCOUNTED if recorded else ANSWERS


def _error(judged: Judged) -> str:
    return figure(evidence.error_mps(judged))


def figure(value: float) -> str:
    """Three digits, all of them where there are more: 0.00680, 161, 1250; a dash for what is no number.

    What a fit leaves of a zero is zero.
    """
    if not math.isfinite(value):
        return "-"
    value = 0.0 if abs(value) < NEGLIGIBLE else value
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:#.3g}".rstrip(".")


def span(one: Number) -> str:
    """The plausible range of a number."""
    if math.isfinite(one.high - one.low):
        return f"{one.low:g} to {one.high:g}"
    return "above 0" if one.low == 0.0 else "any"


def _all(names: Sequence[str], word: str = "and") -> str:
    quoted = [name if name == OWN_SPEED else f"`{name}`" for name in map(signal_of, names)]
    return f" {word} ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(quoted) > 1 else "".join(quoted)


def of_the_core(found: Diagnosis) -> list[str]:
    """What the core holds that is no effect, and what to think of a drive that is very late, or very quick."""
    return [line for line in (_yields(found), _late(found), _coarse(found)) if line]


def _yields(found: Diagnosis) -> str:
    share = found.final.explanation.core.stroke_share
    if not share:
        return ""
    return (
        f"the drive gives way to forces by its stroke, {100.0 * share:.0f} % of how far it does at {USUAL_MPS:g} m/s: "
        "the further its pump is out, the slower it answers and the more a slope takes. The model holds that "
        "(stroke_share), and nothing is missing by it"
    )


def _late(found: Diagnosis) -> str:
    core = found.base.explanation.core
    quickest_s = {name: QUICK * CORE[name].low for name in ("lag_s", "second_lag_s", "time_constant_s")}
    if all(getattr(core, name) < low_s for name, low_s in quickest_s.items()):
        return (
            f"the drive answers within {core.answers_s:.2g} s, as quickly as a core may be here: what is found beside "
            "it may be no more than that it is quicker still"
        )
    found_s, given_s, period_s = found.final.explanation.core.delay_s, found.study.delay_s, found.study.period_s
    periods = round((found_s - given_s) / period_s)
    if "transport_delay" in found.effects or periods < 1:
        return ""
    return (
        f"the dead time is {found_s:.2f} s, and the model's is {given_s:g} s: its taps can hold the rest; compare "
        f"says whether delay_s={given_s + period_s * periods:.3g} errs less"
    )


def _coarse(found: Diagnosis) -> str:
    """Friction acts against the speed of one sample ago: of a drive that is as quick as that, it is late."""
    core, period_s = found.base.explanation.core, found.study.period_s
    if core.answers_s >= COARSE * period_s or AT_REST.isdisjoint(found.effects):
        return ""
    return (
        f"the drive answers within {core.answers_s:.2g} s, hardly two samples of {period_s:g} s: `--period "
        f"{0.5 * period_s:g}` tells {_all(sorted(AT_REST))} apart better"
    )


def hidden(found: Diagnosis) -> list[str]:
    """What could be there without having been named, and how large the best candidates are at their best fit."""
    share, before = hidden_share(found), evidence.error_mps(found.base)
    said = [
        f"an effect that moves the speed {found.study.horizon_s:g} s ahead by less than "
        f"{figure(math.sqrt(share) * before)} m/s RMS would not have been named"
    ]
    for one in found.ranking[:3]:
        trial = evidence.first_tried(found, one.effect)
        if trial is None:
            continue
        size = float(np.sqrt(np.nanmean((found.base.fit.error_mps - trial.judged.fit.error_mps) ** 2)))
        fitted = evidence.numbers_of(one.effect, numbers(found.study, trial.judged))
        shape = ", ".join(map(_with_error, fitted))
        said.append(f"`{one.effect}` at its best fit moves it by {figure(size)} m/s ({shape})")
    return said


def _with_error(one: Number) -> str:
    unit = "" if one.unit == "-" else f" {one.unit}"
    told = f"{figure(one.value)} ± {figure(one.std)}{unit}" if math.isfinite(one.std) else one.remark
    return f"{one.name} {told}"


def experiments(found: Diagnosis) -> list[str]:
    """The drives that would tell what is still open."""
    if found.verdict is Verdict.AMBIGUOUS:
        drives = [f"`{name}`: {EFFECTS[name].about.experiment}" for name in found.effects]
        return [*drives, "afterwards `cruise diagnose` with these recordings and the new ones together"]
    return [found.next_experiment] if found.next_experiment else []
