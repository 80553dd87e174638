"""A diagnosis in words: the verdict, the physics, the numbers, what else it could be, and what to do next."""

import math
import re
import textwrap
from collections.abc import Sequence
from typing import Final

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from cruise.cli import diagnose_evidence as evidence
from cruise.cli.add import floor_in_words
from cruise.cli.diagnose_curve import curve
from cruise.cli.diagnose_evidence import SURE, Number
from cruise.cli.effects import headline
from cruise.cli.reading import NOTES_SHOWN, count_of, notes_of
from cruise.effects import EFFECTS
from cruise.validation.diagnose import ENOUGH, LEAST_GAIN, SEED, UNNAMED, Diagnosis, Tried, Verdict
from cruise.validation.noise_floor import NoiseFloor
from cruise.validation.search import Judged, sureness

WIDTH: Final = 80
LINES: Final = 8  # of the ranking; --json has them all
RECORDINGS_SHOWN: Final = 4  # in a command; more are left to the user
CURVE_SHOWN: Final = 5  # points of a curve
NAME_WIDTH: Final = 18  # of the longest name of an effect
SENTENCES: Final = 2  # of the physics; `cruise effects NAME` has them all
SPLIT: Final = re.compile(r"(?<=[a-z)][.]) +(?=[A-Z])")


def say(
    found: Diagnosis, floor: NoiseFloor, model: str, recordings: Sequence[str], options: Sequence[str], picture: str
) -> None:
    """Print everything, the verdict first. `recordings` and `options` are the words of the command line, quoted."""
    console, study = Console(highlight=False, width=WIDTH), found.study
    _print(console, sentence(found), 0, bold=True)
    samples = sum(len(one) for one in study.recordings)
    _print(console, f"{model}, refitted; seed {SEED}", 0)
    _print(console, f"{count_of(len(study.recordings), 'recording')}, {samples} samples of {study.period_s:g} s", 0)
    _print(console, f"noise floor {study.horizon_s:g} s ahead: {floor_in_words(floor)}", 0)
    notes = notes_of(study.recordings)
    for note in notes[:NOTES_SHOWN]:
        _print(console, f"note: {note}", 0)
    if len(notes) > NOTES_SHOWN:
        _print(console, f"and {count_of(len(notes) - NOTES_SHOWN, 'note')} more (--json has them all)", 0)
    for name, judged in _fits(found):
        _physics(console, name)
        _parameters(console, evidence.numbers_of(name, evidence.numbers(found.study, judged)))
    _dependences(console, found)
    _moved(console, found)
    _steps(console, found)
    _ranking(console, found)
    _list(console, "look-alikes", look_alikes(found))
    _list(console, "next experiment", _experiments(found))
    _list(console, "what these recordings can't speak of", [_refusal(one.effect, one.reason) for one in found.refused])
    _list(console, "to go on", _commands(found, model, recordings, options))
    console.print(f"\npicture: {picture}", markup=False, soft_wrap=True)


def sentence(found: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    horizon = f"{found.study.horizon_s:g} s ahead"
    before = _error(found, found.base)
    sure = f"(confidence {confidence(found.confidence)})"
    match found.verdict:
        case Verdict.MISSING:
            names, one = _all(found.effects), len(found.effects) == 1
            after = _error(found, evidence.known(found))
            return (
                f"{names} {'is' if one else 'are'} missing: with {'it' if one else 'them'} the error {horizon} falls "
                f"from {before} to {after} m/s on data that the fit has not seen {sure}."
            )
        case Verdict.NOTHING:
            share = hidden_share(found)
            return (
                f"Nothing is missing: no effect that these recordings can speak of lowers the error {horizon}, "
                f"{before} m/s, by as much as {100 * (1 - math.sqrt(1 - share)):.0f} % {sure}."
            )
        case Verdict.UNLISTED:
            best = evidence.best_named(found)
            rival = f"; the best effect, `{best.name}`, leaves {_error(found, best.judged)}" if best else ""
            return (
                f"Something is missing that is none of the effects that cruise knows: a free curve of "
                f"{_all(found.signals)} lowers the error {horizon} from {before} to "
                f"{_error(found, found.final)} m/s on data that the fit has not seen{rival} {sure}."
            )
    trials = [evidence.first_tried(found, name) for name in found.effects]
    after = " or ".join(_error(found, one.judged) for one in trials if one is not None)
    return (
        f"{_all(found.effects, 'or')} is missing, and these recordings can't tell which: the error {horizon} falls "
        f"from {before} to {after} m/s on data that the fit has not seen {sure}."
    )


def confidence(value: float) -> str:
    """Two digits, and never 1 or 0."""
    if value > 0.99:
        return "> 0.99"
    return "< 0.01" if value < 0.01 else f"{value:.2f}"


def hidden_share(found: Diagnosis) -> float:
    """The share of the squared error that an effect could explain without being named."""
    best = found.steps[0].tried[0].gain if found.steps[0].tried else 0.0
    return max(LEAST_GAIN, min(best, 1.0))


def look_alikes(found: Diagnosis) -> list[str]:
    """What could be taken for the verdict, and why it lost or can't be told apart."""
    if not found.effects:
        return []
    told = []
    for name in found.effects:
        apart = next((alike[1:] for alike in found.look_alikes if alike[0] == name), ())
        mine = _step_of(found, name)
        others = dict.fromkeys((*apart, *_runner_up(found, name), *EFFECTS[name].about.look_alikes))
        for other in others:
            if other in found.effects and other not in apart:
                continue
            told.append(f"`{name}` or `{other}`: {_against(found, mine, other, other in apart)}")
    return told


def _step_of(found: Diagnosis, name: str) -> dict[str, Tried]:
    """Everything that was tried in the step at which an effect was found."""
    steps = [step for step in found.steps if step.tried and step.tried[0].name == name]
    return {one.name: one for one in (steps or found.steps)[0].tried} | {"": _mine(found, name)}


def _mine(found: Diagnosis, name: str) -> Tried:
    steps = [step for step in found.steps if step.tried and step.tried[0].name == name]
    return next(one for one in (steps or found.steps)[0].tried if one.name == name)


def _runner_up(found: Diagnosis, name: str) -> list[str]:
    tried = [one for one in _step_of(found, name) if one and one != name and one not in found.effects]
    return [one for one in tried if not one.startswith(UNNAMED)][:1]


def _against(found: Diagnosis, tried: dict[str, Tried], other: str, alike: bool) -> str:
    if other not in tried:
        reasons = {one.effect: one.reason for one in found.refused}
        return f"not ruled out, {reasons[other]}" if other in reasons else "the model has it already"
    mine, its = tried[""], tried[other]
    errors = f"{_error(found, its.judged)} m/s against {_error(found, mine.judged)}"
    if alike:
        return f"can't be told apart, {errors}"
    apart = sureness(its.judged, mine.judged, np.random.default_rng(SEED))
    moved = f"; it answers to the drive itself and counts for {100 * its.credit:.0f} %" if its.credit < 1.0 else ""
    if apart < SURE:
        return f"leaves {errors}, too close for the errors to decide ({apart:+.1f} standard errors){moved}"
    return f"leaves {errors}, {apart:.1f} standard errors apart{moved}"


def _error(found: Diagnosis, judged: Judged) -> str:
    return figure(evidence.error_mps(judged))


def figure(value: float) -> str:
    """Three digits, all of them where there are more: 0.00680, 161, 1250; a dash for what is no number."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:#.3g}".rstrip(".")


def _all(names: Sequence[str], word: str = "and") -> str:
    quoted = [f"`{name}`" for name in names]
    return f" {word} ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(quoted) > 1 else "".join(quoted)


def _physics(console: Console, name: str) -> None:
    about = EFFECTS[name].about
    console.print(f"\n[bold]{name}[/bold]")
    what = headline(EFFECTS[name]()).partition(": ")[2]
    _print(console, " ".join([what[:1].upper() + what[1:], *SPLIT.split(about.physics)[:SENTENCES]]), flush=True)
    _print(console, about.equation, 6)


def _parameters(console: Console, fitted: Sequence[Number]) -> None:
    table = _table("", "parameter", "value", "±", "unit", "plausible range", "")
    for one in fitted:
        bounded = math.isfinite(one.high - one.low)
        span = f"{one.low:g} to {one.high:g}" if bounded else ("above 0" if one.low == 0.0 else "any")
        error = figure(one.std) if one.std > 0.0 else "-"
        table.add_row(one.name, figure(one.value), error, one.unit, span, one.remark)
    console.print(table)


def _fits(found: Diagnosis) -> list[tuple[str, Judged]]:
    """Every effect of the verdict with the fit that holds it."""
    if found.verdict is Verdict.AMBIGUOUS:
        trials = [(name, evidence.first_tried(found, name)) for name in found.effects]
        return [(name, one.judged) for name, one in trials if one is not None]
    return [(name, evidence.known(found)) for name in found.effects]


def _dependences(console: Console, found: Diagnosis) -> None:
    """The curves of what no effect describes."""
    names = [name for name in evidence.members(found.final.explanation) if name.startswith(UNNAMED)]
    for name in names:
        drawn = curve(found.study, found.base, found.final, name)
        beside = " beside it" if found.effects else ""
        table = _table(f"what depends on {name.removeprefix(UNNAMED)}{beside}", drawn.x_name, drawn.y_words, "± std.")
        for i in np.linspace(0, len(drawn.x) - 1, CURVE_SHOWN).round().astype(int):
            std = figure(float(drawn.std[i])) if drawn.std is not None else "-"
            table.add_row(f"{drawn.x[i]:.4g}", f"{drawn.y[i]:+.3g}", std)
        console.print()
        console.print(table)


def _moved(console: Console, found: Diagnosis) -> None:
    study = found.study
    if not evidence.rungs(found):
        return
    changed = evidence.moved(evidence.numbers(study, found.base), evidence.numbers(study, found.final))
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
    far = [f"{one.before.name} {100 * one.share:+.0f} %" for one in changed if one.far]
    told = (
        f"moved by more than {SURE:g} standard errors: {', '.join(far)}" if far else "nothing moved beyond its errors"
    )
    _print(console, told)


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
        table.add_row(", ".join(words), figure(one.error_after_mps), f"{100 * share:.0f} %")
    console.print()
    console.print(table)


def _ranking(console: Console, found: Diagnosis) -> None:
    study = found.study
    before = found.ranking[0].error_before_mps if found.ranking else math.nan
    title = f"each effect alone beside the model, {study.horizon_s:g} s ahead, held out; without: {figure(before)} m/s"
    table = _table(title, "effect", "error m/s", "less %", "t", "evidence", "confidence", "")
    tried = {one.name: one for one in found.steps[0].tried}
    for one in found.ranking[:LINES]:
        trial = tried[one.effect]
        step = found.effects.index(one.effect) + 1 if one.effect in found.effects else 1
        later = f"step {step}" if step > 1 and found.verdict is Verdict.MISSING else ""
        table.add_row(
            one.effect, figure(one.error_after_mps), f"{round(100 * trial.gain)}", f"{trial.sureness:.1f}",
            f"{trial.counted:.0f}{'*' if trial.credit < 1.0 else ''}", confidence(one.confidence), later,
        )  # fmt: skip
    unnamed = evidence.best_unnamed(found)
    if unnamed is not None:
        name = f"any curve of {unnamed.name.removeprefix(UNNAMED)}"
        table.add_row(
            name, _error(found, unnamed.judged), f"{round(100 * unnamed.gain)}",
            f"{unnamed.sureness:.1f}", f"{unnamed.evidence:.0f}", "", "", style="dim",
        )  # fmt: skip
    console.print()
    console.print(table)
    _print(console, "less %: by which the squared error fell; t: the same in standard errors, over blocks of time")
    _print(console, f"evidence: beside a little of every other effect; {ENOUGH:g} is enough for a name")
    if any(one.credit < 1.0 for one in tried.values()):
        _print(console, "*: only what counts of it, for its signal answers to the drive itself")
    rest = len(found.ranking) - LINES
    if rest > 0:
        _print(console, f"and {count_of(rest, 'effect')} more that explain less (--json has them all)")
    if found.verdict is Verdict.NOTHING:
        _list(console, "what could have hidden", _hidden(found))


def _hidden(found: Diagnosis) -> list[str]:
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
        fitted = evidence.numbers_of(one.effect, evidence.numbers(found.study, trial.judged))
        shape = ", ".join(f"{n.name} {figure(n.value)} ± {figure(n.std)} {n.unit}".rstrip(" -") for n in fitted)
        said.append(f"`{one.effect}` at its best fit moves it by {figure(size)} m/s ({shape})")
    return said


def _experiments(found: Diagnosis) -> list[str]:
    if found.verdict is Verdict.AMBIGUOUS:
        return [f"`{name}`: {EFFECTS[name].about.experiment}" for name in found.effects]
    return [found.next_experiment] if found.next_experiment else []


def _refusal(effect: str, reason: str) -> str:
    return f"`{effect}`: {reason} - " + ("not excited, not absent" if "never moves" in reason else "it can't be blamed")


def _commands(found: Diagnosis, model: str, recordings: Sequence[str], options: Sequence[str]) -> list[str]:
    """What adds the effects, one after the other."""
    if not found.effects or found.verdict is Verdict.AMBIGUOUS:
        return []
    files = " ".join(recordings if len(recordings) <= RECORDINGS_SHOWN else ["RECORDING..."])
    tail = "".join(f" {word}" for word in options)
    lines, base = [], model
    for i, name in enumerate(found.effects):
        out = "better.yaml" if i == 0 else f"better_{i + 1}.yaml"
        lines.append(f"cruise add {name} --model {base} {files}{tail} -o {out}")
        base = out
    return lines


def _plain(name: str) -> str:
    return f"a curve of {name.removeprefix(UNNAMED)}" if name.startswith(UNNAMED) else name


def _table(title: str, *headings: str) -> Table:
    heading = f"[bold]{title}[/bold]" if title else None
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
        console.print(f"\n[bold]{title}[/bold]")
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
    console.print(wrapped, markup=False, soft_wrap=True, style="bold" if bold else None)
