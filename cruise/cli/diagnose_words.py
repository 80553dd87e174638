"""A diagnosis as it is printed: the verdict, the physics, the numbers, what else it could be, and what to do next."""

import math
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from cruise.cli.add import floor_in_words
from cruise.cli.console import bold, printer
from cruise.cli.reading import NOTES_SHOWN, count_of
from cruise.effects import EFFECTS
from cruise.recording import Recording, notes_of
from cruise.report import evidence
from cruise.report.curve import curve
from cruise.report.diagnosis import (
    confidence,
    discounted,
    experiments,
    figure,
    forces,
    hidden,
    look_alikes,
    of_the_core,
    sentence,
    span,
)
from cruise.report.effect import physics, what
from cruise.report.evidence import SURE, Number
from cruise.report.mapping import hints
from cruise.report.own_terms import own_terms
from cruise.signals import INPUT
from cruise.units import MA_PER_UNIT
from cruise.validation.candidates import UNNAMED, Refused
from cruise.validation.curves import LEAST_CURVED, PLAINLY_CURVED
from cruise.validation.diagnose import SEED, Diagnosis, Verdict
from cruise.validation.judged import Judged
from cruise.validation.left_over import DELAY
from cruise.validation.noise_floor import NoiseFloor
from cruise.validation.numbers import BOUND, NOT_TOLD, numbers
from cruise.validation.simulation import JUDGED_S, paced
from cruise.validation.tried import ENOUGH, FEW, LEAST_GAIN, MUCH, RESISTS, Tried, asked

WIDTH: Final = 80
LINES: Final = 8  # of the ranking; --json has them all
RECORDINGS_SHOWN: Final = 4  # in a command; more are left to the user
CURVE_SHOWN: Final = 5  # points of a curve
NAME_WIDTH: Final = 18  # of the longest name of an effect
STALE: Final = 1.3  # times the error of the refitted model, from which a file's own parameters are worth a word
MOST: Final = 0.9  # of the samples, that are usually judged: else it is said how many


@dataclass(frozen=True, slots=True)
class Own:
    """RMS in m/s of a model with the parameters of its file, and with such as are fitted to the recordings."""

    given_mps: float = math.nan
    refitted_mps: float = math.nan
    refused: str = ""  # why there are none

    @property
    def figures(self) -> dict[str, float | str]:
        """For JSON."""
        if self.refused:
            return {"refused": self.refused}
        return {"error_mps": self.given_mps, "refitted_error_mps": self.refitted_mps}

    @property
    def stale(self) -> bool:
        """Whether its parameters are worth fitting anew."""
        return self.given_mps > STALE * self.refitted_mps


def say(
    found: Diagnosis,
    floor: NoiseFloor,
    model: str,
    recordings: Sequence[str],
    options: Sequence[str],
    picture: str,
    own: Own | None = None,
    called: Mapping[str, str] | None = None,
) -> None:
    """Print everything, the verdict first. `recordings` and `options` are the words of the command line, quoted.

    `own` says how well the parameters of a model file fit where nothing is missing, `called` how the recordings call
    the input and the output.
    """
    console, study = printer(WIDTH), found.study
    _print(console, sentence(found), 0, bold=True)
    samples, judged = sum(len(one) for one in study.recordings), int(study.search.scene.judged.sum())
    _print(console, f"{model}, refitted; seed {SEED}", 0)
    if own is not None and own.refused:
        _print(console, f"how well its own parameters fit can't be said: {own.refused}", 0)
    if own is not None and own.stale:
        _print(
            console,
            f"as it is, it errs by {figure(own.given_mps)} m/s, and fitted to these recordings by "
            f"{figure(own.refitted_mps)}: its parameters are wrong here, no effect is missing",
            0,
        )
    for line in (_called(called or {}, study.recordings[0]), *hints(found), *of_the_core(found)):
        if line:
            _print(console, line, 0)
    few = (
        f", {judged} of them {study.horizon_s:g} s or more behind a hole and judged" if judged < MOST * samples else ""
    )
    _print(
        console, f"{count_of(len(study.recordings), 'recording')}, {samples} samples of {study.period_s:g} s{few}", 0
    )
    _print(console, f"noise floor {study.horizon_s:g} s ahead: {floor_in_words(floor)}", 0)
    notes = notes_of(study.recordings)
    for note in notes[:NOTES_SHOWN]:
        _print(console, f"note: {note}", 0)
    if len(notes) > NOTES_SHOWN:
        _print(console, f"and {count_of(len(notes) - NOTES_SHOWN, 'note')} more (--json has them all)", 0)
    for name, judged in _fits(found):
        _physics(console, name)
        _parameters(console, evidence.numbers_of(name, numbers(found.study, judged)))
    _dependences(console, found)
    _moved(console, found)
    _steps(console, found)
    _ranking(console, found)
    _list(console, "what the forces say", forces(found))
    _list(console, "look-alikes", look_alikes(found))
    _list(console, "next experiment", experiments(found))
    _list(console, "what these recordings can't speak of", [_refusal(one) for one in found.refused])
    _list(console, "to go on", _commands(found, model, recordings, options, own is not None and own.stale))
    console.print(f"\npicture: {picture}", soft_wrap=True)


def _called(called: Mapping[str, str], read: Recording) -> str:
    """What the recordings call the current and the speed, where they have names of their own; else empty."""
    words = {name: f"{name} is `{theirs}`" for name, theirs in called.items() if theirs != name}
    if INPUT in words and read.input_unit:
        words[INPUT] += f", 1 of it {MA_PER_UNIT[read.input_unit]:g} mA"
    if INPUT in words and read.input_rest_ma:
        words[INPUT] += f", counted from {read.input_rest_ma:g} mA"
    return f"as the recordings have it, {'; '.join(words.values())}" if words else ""


def _physics(console: Console, name: str) -> None:
    effect = EFFECTS[name]()
    console.print(bold(f"\n{name}"))
    _print(console, f"{what(effect)} {physics(effect)}", flush=True)
    _print(console, effect.about.equation, 6)


def _parameters(console: Console, fitted: Sequence[Number]) -> None:
    table = _table("", "parameter", "value", "±", "unit", "plausible range", "")
    for one in fitted:
        error = figure(one.std) if one.std > 0.0 else "-"
        table.add_row(one.name, figure(one.value), error, one.unit, span(one), evidence.remark(one))
    console.print(table)
    bound = [one.name for one in fitted if one.remark == BOUND]
    if bound:
        _print(console, f"{BOUND}: {', '.join(bound)}; what the recordings ask for lies beyond what is plausible")


def _fits(found: Diagnosis) -> list[tuple[str, Judged]]:
    """Every effect of the verdict with the fit that holds it."""
    if found.verdict is Verdict.AMBIGUOUS:
        trials = [(name, evidence.first_tried(found, name)) for name in found.effects]
        return [(name, one.judged) for name, one in trials if one is not None]
    return [(name, found.final) for name in found.effects]


def _dependences(console: Console, found: Diagnosis) -> None:
    """The curves of what no effect describes."""
    names = [name for name in evidence.members(found.final.explanation) if name.startswith(UNNAMED)]
    for name in names:
        drawn = curve(found.study, found.base, found.final, name)
        beside = " beside it" if found.effects else ""
        table = _table(f"what depends on {evidence.signal_of(name)}{beside}", drawn.x_name, drawn.y_words, "± std.")
        for i in np.linspace(0, len(drawn.x) - 1, CURVE_SHOWN).round().astype(int):
            std = figure(float(drawn.std[i])) if drawn.std is not None else "-"
            table.add_row(f"{drawn.x[i]:.4g}", f"{drawn.y[i]:+.3g}", std)
        console.print()
        console.print(table)


def _moved(console: Console, found: Diagnosis) -> None:
    study = found.study
    if not evidence.rungs(found):
        return
    changed = evidence.moved(numbers(study, found.base), numbers(study, found.final))
    which = f" with {found.effects[0]}" if found.verdict is Verdict.AMBIGUOUS else ""
    table = _table(f"what moved in the rest of the model{which}", "parameter", "before", "±", "after", "±", "unit")
    for one in changed:
        place = "" if one.before.owner == "core" else f"{one.before.owner}."
        before, after = one.before, one.after
        table.add_row(
            f"{place}{before.name}", figure(before.value), figure(before.std), figure(after.value), figure(after.std),
            before.unit,
        )  # fmt: skip
    console.print()
    console.print(table)
    untold = [one.before.name for one in changed if not (one.before.told and one.after.told)]
    far = [f"{one.before.name} {100 * one.share:+.0f} %" for one in changed if one.far]
    told = (
        f"moved by more than {SURE:g} standard errors: {', '.join(far)}" if far else "nothing moved beyond its errors"
    )
    _print(console, told)
    if untold:
        _print(console, f"{NOT_TOLD}, before or after: {', '.join(untold)}")


def _steps(console: Console, found: Diagnosis) -> None:
    ladder = evidence.rungs(found)
    if len(ladder) < 2:
        return
    title = f"how the error {found.study.horizon_s:g} s ahead fell, held out"
    table = _table(title, "step", "error m/s", "explained of the squared error")
    first = ladder[0].error_before_mps
    table.add_row("the model", figure(first), "")
    for one in ladder:
        words = [f"+ {_plain(name)}" for name in one.added] + [f"- {_plain(name)}" for name in one.dropped]
        share = 1.0 - (one.error_after_mps / first) ** 2
        table.add_row(", ".join(words), figure(one.error_after_mps), f"{round(100 * share)} %")
    console.print()
    console.print(table)
    if found.worth_adding != found.effects:
        _print(console, f"without {DELAY}: it changes, and a constant one lowers the error by little")


def _ranking(console: Console, found: Diagnosis) -> None:
    study = found.study
    before = found.ranking[0].error_before_mps if found.ranking else math.nan
    title = f"each effect alone beside the model, {study.horizon_s:g} s ahead, held out; without: {figure(before)} m/s"
    table = _table(title, "effect", "error m/s", "less %", "t", "evidence", "confidence", "")
    tried = {one.name: one for one in found.steps[0].tried}
    for one in found.ranking[:LINES]:
        trial = tried[one.effect]
        step = found.worth_adding.index(one.effect) + 1 if one.effect in found.worth_adding else 1
        later = f"step {step}" if step > 1 and found.verdict is Verdict.MISSING else ""
        table.add_row(
            one.effect, figure(one.error_after_mps), f"{round(100 * trial.gain)}", f"{trial.sureness:.1f}",
            _counted(trial), confidence(one.confidence), later,
        )  # fmt: skip
    unnamed = evidence.best_unnamed(found)
    if unnamed is not None:
        name = f"any curve of {evidence.signal_of(unnamed.name)}"
        table.add_row(
            name, figure(evidence.error_mps(unnamed.judged)), f"{round(100 * unnamed.gain)}",
            f"{unnamed.sureness:.1f}", _counted(unnamed), "", "", style="dim",
        )  # fmt: skip
    console.print()
    console.print(table)
    horizon_s = found.study.horizon_s
    span_s = f"{horizon_s:g} to {horizon_s + paced(JUDGED_S, horizon_s):.3g} s"
    _print(
        console,
        f"error: of predictions of {span_s}; less %: by which the squared error fell, raw and whitened in equal parts; "
        "t: the same in standard errors, over blocks of time",
    )
    _print(
        console,
        f"evidence: beside a little of every other effect; {ENOUGH:g} is enough for a name, {asked(MUCH):g} for one "
        f"that takes {100 * MUCH:.0f} % or more of the squared error, {asked(LEAST_GAIN):g} below {100 * FEW:.0f} % "
        f"({RESISTS * asked(LEAST_GAIN):g} for friction alone, which soil looks like)",
    )
    if unnamed is not None and unnamed.gain >= LEAST_GAIN and not (found.effects or found.signals):
        least, evidence_of, sure = PLAINLY_CURVED
        _print(
            console,
            f"any curve: bends as it likes, so that it is believed only where it leaves clearly less than every effect "
            f"and takes {100 * LEAST_CURVED:.0f} % or more, or {100 * least:.0f} % with an evidence of "
            f"{evidence_of:g} and a t of {sure:g}",
        )
    if found.steps[0].forces is not None:
        _print(console, "t and evidence: as weighed where every force is known")
    shown = [*(tried[one.effect] for one in found.ranking[:LINES]), *([unnamed] if unnamed is not None else [])]
    if any(one.credit < 1.0 for one in shown):
        _print(console, f"*: only what counts of it, {discounted(found)}")
    rest = len(found.ranking) - LINES
    if rest > 0:
        _print(console, f"and {count_of(rest, 'effect')} more, with no more evidence (--json has them all)")
    if found.verdict is Verdict.NOTHING:
        _list(console, "what could have hidden", hidden(found))


def _counted(one: Tried) -> str:
    """The evidence that counts, with a mark where that is not all of it."""
    return f"{round(one.counted)}{'*' if one.credit < 1.0 else ''}"


def _refusal(one: Refused) -> str:
    return f"`{one.effect}`: {one.reason} - " + ("not excited, not absent" if one.still else "it can't be blamed")


def _commands(
    found: Diagnosis, model: str, recordings: Sequence[str], options: Sequence[str], stale: bool
) -> list[str]:
    """What adds the effects, one after the other; what asks again with the recording that decides between two.

    Where nothing is missing, what fits a stale model anew; where no effect is, terms of the signal that is.
    """
    files = " ".join(recordings if len(recordings) <= RECORDINGS_SHOWN else ["RECORDING..."])
    tail = "".join(f" {word}" for word in options)
    if found.verdict is Verdict.AMBIGUOUS:
        return [f"cruise diagnose {files} NEW.csv --model {shlex.quote(model)}{tail}"]
    lines, base = [], shlex.quote(model)
    for i, name in enumerate(found.worth_adding):
        out = "better.yaml" if i == 0 else f"better_{i + 1}.yaml"
        lines.append(f"cruise add {name} --model {base} {files}{tail} -o {out}")
        base = out
    own = [
        f"cruise add {shlex.quote(str(one))} --model {base} {files}{tail} -o by_{one.stage}.yaml"
        for one in own_terms(found)
    ]
    if own:
        return [*own, "a straight line to begin with: bend it as its physics does, and keep what errs least"]
    if stale:
        lines.append(f"cruise identify {files}{tail} --model {base} -o refitted.yaml")
    elif lines:
        lines.append("add judges the discrete model that drives: its errors are a little other than these")
    return lines


def _plain(name: str) -> str:
    return f"a curve of {evidence.signal_of(name)}" if name.startswith(UNNAMED) else name


def _table(title: str, *headings: str) -> Table:
    heading = bold(title) if title else None
    table = Table(box=box.SIMPLE_HEAD, title=heading, title_justify="left", title_style="", pad_edge=False)
    left = {"effect", "parameter", "step", "unit", ""}
    for heading in headings:
        name = heading == "effect"
        table.add_column(
            heading, justify="left" if heading in left else "right", min_width=NAME_WIDTH if name else None
        )
    return table


def _list(console: Console, title: str, entries: Sequence[str]) -> None:
    if entries:
        console.print(bold(f"\n{title}"))
    for entry in entries:
        _print(console, entry)


def _print(console: Console, text: str, indent: int = 2, bold: bool = False, flush: bool = False) -> None:
    """A sentence, its further lines indented unless they are flush; a command stays on one line."""
    whole = text.startswith("cruise ")
    further = indent if flush or not indent else indent + 2
    wrapped = textwrap.fill(
        text,
        max(WIDTH, len(text) + indent) if whole else WIDTH,
        initial_indent=" " * indent,
        subsequent_indent=" " * further,
        break_on_hyphens=False,
        break_long_words=False,
    )
    console.print(wrapped, soft_wrap=True, style="bold" if bold else None)
