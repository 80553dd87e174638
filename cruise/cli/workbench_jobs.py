"""What the page asks the command line for: the functions of the verbs, and their findings as the page shows them."""

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import structs

from cruise import settings
from cruise.cli import compare as comparing
from cruise.cli import compare_picture, diagnose_evidence, diagnose_picture, diagnose_words
from cruise.cli import diagnose as diagnosing
from cruise.cli.add import model_file
from cruise.cli.diagnose_curve import curve
from cruise.cli.diagnose_words import SENTENCES, SPLIT, figure
from cruise.cli.effects import headline
from cruise.cli.reading import model_named, notes_of, prepared_by, tables
from cruise.effects import EFFECTS, Custom
from cruise.identification.accuracy import Accuracy
from cruise.identification.regressors import FitError
from cruise.model import files
from cruise.model.files import CustomTerm
from cruise.model.history import history_of
from cruise.recording import Recording
from cruise.validation import comparison, ladder
from cruise.validation.comparison import Comparison
from cruise.validation.diagnose import UNNAMED, Diagnosis, Tried, Verdict
from cruise.validation.diagnose import diagnose as search
from cruise.validation.failure_tree import failure_tree
from cruise.validation.noise_floor import NoiseFloor, noise_floor
from cruise.validation.quantities import quantities
from cruise.validation.regimes import HeatMap, _binned, _cells, regimes
from cruise.validation.signatures import signatures
from cruise.validation.worst_stretches import worst_stretches
from cruise.workbench.by_hand import changed
from cruise.workbench.found import (
    Added,
    Card,
    Cells,
    Compared,
    Curve,
    Diagnosed,
    Figures,
    Minute,
    Number,
    Opened,
    Predicted,
    Question,
    Regime,
    Show,
    Signature,
    Source,
)

CARDS: Final = 6  # candidates that are shown with their evidence
UNFILTERED_HZ: Final = 0.0  # the search weighs frequencies itself
CUTOFF_HZ: Final = 1.0  # of the training data, the default of the verbs
DRIVEN_BINS: Final = 48
CAUSES: Final = {
    "ahead": "How far the prediction is off {horizon:g} s ahead, from every sample on, on data that the fit has not "
    "seen where the model was fitted here. This is what the controller lives on.",
    "free": "The model on its own from the first sample: it never sees the measured speed again. Slow drifts and "
    "offsets show here.",
    "persistence": "The simplest prediction there is: the speed stays as it was {horizon:g} s ago. A model that does "
    "not beat it is worth nothing.",
    "most": "What a flexible statistical model reaches on these signals, out of fold. A good physical model comes near "
    "it or below.",
    "least": "The white part of the measured speed: sensor noise that no model can predict.",
}


def opened(source: Source, show: Show) -> Opened:
    """The recordings of a source, as every verb reads them."""
    show("reading")
    found = tables(list(source.paths), source.reading)
    return Opened(source, tuple(found), tuple(notes_of(found)))


def compared(recordings: Sequence[Recording], question: Question, show: Show) -> Compared:
    """`cruise compare`: the curves are handed over before floor and regimes are known."""
    structure, start = model_named(question.model)
    judged = structure
    if start is not None:
        file = files.read(question.model)
        judged = structure, comparison.of_parameters(structure.family, start, file.noise_parameters)
    preparation = prepared_by(question.period_s, CUTOFF_HZ, start)
    found = comparison.compare(judged, recordings, preparation, question.horizon_s, lambda text: show(text))
    curves = Predicted(found.recordings, found.ahead_mps, found.free_run_mps)
    show("looking for the noise floor", curves)
    floor = noise_floor(found.native, found.recordings, found.ahead_mps, found.horizon)
    show("looking where it fails")
    findings = comparing.Findings(
        name=question.model,
        seen=(),
        comparison=found,
        floor=floor,
        regimes=regimes(found.recordings, found.errors_mps, found.horizon),
        tree=failure_tree(found.recordings, found.errors_mps, found.horizon),
        stretches=worst_stretches(found.recordings, found.errors_mps),
        signatures=signatures(found),
    )
    where = findings.regimes
    result = Compared(
        question=question,
        how=found.how,
        predicted=curves,
        figures=_figures(found, floor),
        floor_mps=_between(floor),
        floor_words=tuple(comparing.floor_in_words(floor, found)),
        regimes=tuple(Regime(one.sentence, one.time_share, one.error_share, one.named) for one in where.regimes),
        leaves=tuple(leaf.sentence for leaf in findings.tree.leaves if len(leaf.keys) > 1),
        stretches=findings.stretches,
        cells=_located(where.heat_map, found) if where.heat_map else None,
        said=comparing.report(findings),
        picture=b"",
    )
    show("drawing", result)
    name = structure.name or str(structure)
    picture = _drawn(lambda path: compare_picture.draw(found, floor, where, findings.stretches, name, path))
    return replace(result, picture=picture)


def diagnosed(recordings: Sequence[Recording], question: Question, show: Show) -> Diagnosed:
    """`cruise diagnose`, with the evidence of every candidate that is shown."""
    structure, start = model_named(question.model)
    if structure.nb == 0:
        raise FitError(
            f"{question.model}: a model without the current has nothing that an effect could act on; give nb=1 or more"
        )
    core = files.read(question.model).core if start is not None else None
    period_s = prepared_by(question.period_s, UNFILTERED_HZ, start).period_s
    begun = ladder.begin(
        recordings, structure, start, core, period_s, question.horizon_s, lambda text: show(text), at_their_rate=True
    )
    found = search(begun, lambda text: show(text))
    show("weighing the evidence")
    said = diagnosing.report(found, question.model, str(structure))
    show("looking for the noise floor")
    floor = diagnose_evidence.floor_of(found, recordings)
    show("drawing")
    first = found.steps[0].tried
    shown = _shown(found)
    final = found.final if found.verdict is not Verdict.NOTHING else (first[0].judged if first else found.final)
    before = diagnose_evidence.error_mps(found.base)
    return Diagnosed(
        question=question,
        verdict=found.verdict.value,
        effects=found.effects,
        signals=found.signals,
        sentence=diagnose_words.sentence(found).replace("`", ""),
        next_experiment=tuple(one.replace("`", "") for one in _experiments(found)),
        hidden_mps=math.sqrt(diagnose_words.hidden_share(found)) * before,
        cards=tuple(_card(found, one) for one in shown),
        others=tuple(
            (one.name, diagnose_evidence.error_mps(one.judged), one.gain)
            for one in first
            if one not in shown and not one.name.startswith(UNNAMED)
        ),
        refused=tuple((one.effect, one.reason) for one in found.refused),
        error_before_mps=before,
        error_after_mps=diagnose_evidence.error_mps(final),
        floor_mps=_between(floor),
        minute=_minute(found, final),
        said=said,
        picture=_drawn(lambda path: diagnose_picture.draw(found, floor, path)),
    )


def added(
    recordings: Sequence[Recording], question: Question, effect: str | CustomTerm, path: Path, show: Show
) -> Added:
    """`cruise add`: the better model written to `path`, and what `cruise compare` says of that file."""
    structure, start = model_named(question.model)
    file = files.read(question.model) if start is not None else None
    earlier = history_of(question.model, file) if file is not None else ()
    period_s = prepared_by(question.period_s, UNFILTERED_HZ, start).period_s
    core = file.core if file is not None else None
    study = ladder.begin(recordings, structure, start, core, period_s, question.horizon_s, lambda text: show(text))
    one = ladder.add(study, effect if isinstance(effect, str) else term(effect), lambda text: show(text))
    show("looking for the noise floor")
    floor = ladder.floor(study, recordings, one)
    better = model_file(question.model, structure, file, earlier, study, one, floor)
    settings.save(path, better)
    return Added(
        effect=one.effect,
        file=better,
        path=path,
        error_before_mps=one.error_before_mps,
        error_after_mps=one.error_after_mps,
        floor_mps=_between(floor),
        parameters=tuple(ladder.parameters(study, one)),
        by_hand=False,
        compared=compared(recordings, replace(question, model=str(path)), show),
    )


def term(written: CustomTerm) -> Custom:
    """A term of the user's own. ExpressionError where it can't be."""
    bounds = tuple((name, low, high) for name, (low, high) in written.bounds.items())
    return Custom(written.name, written.stage, written.expression, bounds)


def by_hand(
    recordings: Sequence[Recording],
    question: Question,
    before: Added,
    values: dict[str, float],
    name: str,
    path: Path,
    show: Show,
) -> Added:
    """A model whose parameters were set by hand, written to `path`, and what `cruise compare` says of that file."""
    core, model = changed(before.file, values)
    made = structs.replace(
        before.file.provenance, made_by="cruise workbench, parameters set by hand", error_ahead_mps=None
    )
    better = files.file_of(path, model, made, core=core, history=before.file.history)
    settings.save(path, better)
    judged = compared(recordings, replace(question, model=str(path)), show)
    return replace(
        before,
        effect=name,
        file=better,
        path=path,
        error_before_mps=before.compared.error_mps,
        error_after_mps=judged.error_mps,
        parameters=(),
        by_hand=True,
        compared=judged,
    )


def _figures(found: Comparison, floor: NoiseFloor) -> tuple[Figures, ...]:
    rows = [
        (f"{found.horizon_s:g} s ahead", found.ahead, "ahead"),
        ("free run", found.free_run, "free"),
        ("persistence", found.persistence, "persistence"),
    ]
    spread_mps = found.ahead.rmse_mps / (1.0 - found.ahead.nrmse_pct / 100.0)
    for name, bound, key in (("floor at most", floor.reached, "most"), ("floor at least", floor.white, "least")):
        if bound is not None:
            ratio = bound.value_mps / spread_mps
            reached = Accuracy(100.0 * (1.0 - ratio**2), 100.0 * (1.0 - ratio), bound.value_mps, math.nan, 0)
            rows.append((name, reached, key))
    return tuple(
        Figures(
            name,
            one.explained_pct,
            one.nrmse_pct,
            float(one.rmse_mps),
            one.mean_error_mps,
            CAUSES[key].format(horizon=found.horizon_s),
        )
        for name, one, key in rows
    )


def _between(floor: NoiseFloor) -> tuple[float, float]:
    least, most = (float(one.value_mps) if one else math.nan for one in (floor.white, floor.reached))
    return least, most


def _located(found: HeatMap, of: Comparison) -> Cells:
    """The heat map with the cell of every sample."""
    known = np.isfinite(np.concatenate(of.errors_mps))
    every = {one.key: one for one in quantities(of.recordings)}
    rows, columns = (_binned(every[table.key], known) for table in (found.rows, found.columns))
    number = np.full(len(known), -1)
    number[known] = _cells(rows, columns)
    ends = np.cumsum([len(one) for one in of.recordings])[:-1]
    return Cells(
        rows=(found.rows.words, found.rows.unit),
        row_labels=found.rows.labels,
        columns=(found.columns.words, found.columns.unit),
        column_labels=found.columns.labels,
        time_share=found.time_share,
        error_share=found.error_share,
        rmse_mps=found.rmse_mps,
        number=tuple(np.split(number, ends)),
    )


def _shown(found: Diagnosis) -> list[Tried]:
    """The candidates with a card: what was named first, then the best of the rest, a curve without physics last."""
    first = found.steps[0].tried
    of_verdict = [_step_of(found, name) for name in found.effects]
    rest = [one for one in first if one.name not in found.effects and not one.name.startswith(UNNAMED)]
    shown = [one for one in of_verdict if one is not None]
    if found.verdict is Verdict.UNLISTED:
        shown = [one for one in first if one.name.removeprefix(UNNAMED) in found.signals]
    return [*shown, *rest][: max(CARDS, len(shown))]


def _step_of(found: Diagnosis, name: str) -> Tried | None:
    """An effect as it was tried in the step in which it was chosen, else in the first."""
    step = next((step for step in found.steps if step.tried and step.tried[0].name == name), found.steps[0])
    return next((one for one in step.tried if one.name == name), None)


def _card(found: Diagnosis, tried: Tried) -> Card:
    name, listed = tried.name, not tried.name.startswith(UNNAMED)
    signal = name.removeprefix(UNNAMED)
    step = next((step for step in found.steps if tried in step.tried), found.steps[0])
    before, after = step.before, tried.judged
    confidence = next((one.confidence for one in found.ranking if one.effect == name), math.nan)
    if not listed:
        confidence = found.confidence
    about = EFFECTS[name].about if listed else None
    chosen = name in found.effects or signal in found.signals
    fitted = diagnose_evidence.numbers_of(name, diagnose_evidence.numbers(found.study, after))
    alike = [one.replace("`", "") for one in diagnose_words.look_alikes(found) if one.startswith(f"`{name}`")]
    return Card(
        effect=name if listed else f"a curve of {signal}",
        headline=headline(EFFECTS[name]()).partition(": ")[2] if listed else f"The speed depends on {signal}.",
        physics=" ".join(SPLIT.split(about.physics)[:SENTENCES])
        if about
        else "A smooth curve without any physics, fitted to see whether the signal matters. It says that something is "
        "missing and where it shows, not what it is.",
        equation=about.equation if about else "",
        confidence=confidence,
        confidence_words=diagnose_words.confidence(confidence),
        error_before_mps=diagnose_evidence.error_mps(before),
        error_after_mps=diagnose_evidence.error_mps(after),
        gain=tried.gain,
        sureness=tried.sureness,
        counts=tried.credit,
        chosen=chosen,
        listed=listed,
        numbers=tuple(_number(one) for one in fitted),
        look_alikes=tuple(alike),
        experiment=about.experiment if about else " ".join(_experiments(found)),
        signature=_signature(before.error_mps, after.error_mps),
        curve=_curve(found, tried),
    )


def _number(one: diagnose_evidence.Number) -> Number:
    bounded = math.isfinite(one.high - one.low)
    span = f"{one.low:g} to {one.high:g}" if bounded else ("above 0" if one.low == 0.0 else "any")
    return Number(one.name, figure(one.value), figure(one.std) if one.std > 0.0 else "-", one.unit, span, one.remark)


def _signature(before: np.ndarray, after: np.ndarray) -> Signature:
    change = before - after
    known = np.isfinite(change)
    return Signature(
        diagnose_picture.binned(change[known], before[known]), diagnose_picture.binned(change[known], after[known])
    )


def _curve(found: Diagnosis, tried: Tried) -> Curve:
    step = next((step for step in found.steps if tried in step.tried), found.steps[0])
    drawn = curve(found.study, step.before, tried.judged, tried.name)
    driven = None
    if drawn.driven is not None:
        values = drawn.driven[np.isfinite(drawn.driven)]
        counts, edges = np.histogram(values, DRIVEN_BINS, (float(drawn.x.min()), float(drawn.x.max())))
        driven = 0.5 * (edges[1:] + edges[:-1]), counts
    x_words = f"{drawn.x_name} ({drawn.x_unit})" if drawn.x_unit else drawn.x_name
    return Curve(drawn.x, drawn.y, drawn.std, drawn.without, x_words, drawn.y_words, driven)


def _minute(found: Diagnosis, final: diagnose_picture.Judged) -> Minute:
    scene = found.study.search.scene
    number, stretch = diagnose_picture.telling_stretch(found, final)
    recording, first = scene.recordings[number], scene.parts[number].start
    measured = scene.speed_mps[stretch]
    named = {Verdict.MISSING: " and ".join(found.effects), Verdict.AMBIGUOUS: found.effects[0] if found.effects else ""}
    best = found.steps[0].tried[0].name.removeprefix(UNNAMED) if found.steps[0].tried else ""
    return Minute(
        time_s=recording.time_s[stretch.start - first : stretch.stop - first],
        measured_mps=measured,
        before_mps=measured - found.base.error_mps[stretch],
        after_mps=measured - final.error_mps[stretch],
        label=named.get(found.verdict) or f"a curve of {best}"
        if found.verdict is not Verdict.NOTHING
        else f"{best}, not believed",
    )


def _experiments(found: Diagnosis) -> list[str]:
    if found.verdict is Verdict.AMBIGUOUS:
        return [f"{name}: {EFFECTS[name].about.experiment}" for name in found.effects]
    return [found.next_experiment] if found.next_experiment else []


def _drawn(draw: Callable[[Path], object]) -> bytes:
    """The PNG that a verb's own picture is."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        draw(path)
        return path.read_bytes()
