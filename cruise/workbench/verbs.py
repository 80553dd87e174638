"""What the page asks for: the functions behind the verbs, and their findings as the page shows them.

Each runs in a process of its own and says on the way what it does.
"""

import math
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import structs

from cruise import settings
from cruise.can.bus import BusLostError
from cruise.can.log import LogError
from cruise.effects import EFFECTS, Custom
from cruise.effects.expression import ExpressionError
from cruise.identification.accuracy import Accuracy
from cruise.identification.named import model_named
from cruise.identification.preparation import PreparationSettings
from cruise.identification.regressors import FitError
from cruise.identification.structures import Structure
from cruise.model import files
from cruise.model.files import CustomTerm
from cruise.model.history import history_of
from cruise.model.model import Model
from cruise.recording import Recording, RecordingError, notes_of
from cruise.report import comparison as comparing
from cruise.report import comparison_picture, diagnosis, diagnosis_picture, evidence, mapping
from cruise.report.added import doubts
from cruise.report.model_file import model_file
from cruise.service.recordings import read_recordings
from cruise.service.recordings.names import names_in
from cruise.settings import SettingsError
from cruise.validation import comparison, ladder
from cruise.validation.candidates import UNNAMED
from cruise.validation.comparison import Comparison
from cruise.validation.diagnose import diagnose as search
from cruise.validation.noise_floor import NoiseFloor
from cruise.validation.regimes import HeatMap
from cruise.workbench import cards
from cruise.workbench.by_hand import begun_anew, changed, settings_of
from cruise.workbench.found import (
    Added,
    Asked,
    Cells,
    Compared,
    Diagnosed,
    Figures,
    Opened,
    Predicted,
    Question,
    Regime,
    Show,
    Source,
)

EXPECTED: Final = (SettingsError, RecordingError, LogError, FitError, ExpressionError, BusLostError, OSError)
"""Errors that are the user's, with a message for the user."""
CUTOFF_HZ: Final = 1.0  # of the training data, the default of the verbs
CAUSES: Final = {
    "ahead": "How far the prediction is off {horizon:g} s ahead, from every sample on, on data that the fit has not "
    "seen unless it is said. This is what the controller lives on.",
    "free": "The model on its own from the first sample: it never sees the measured speed again. Slow drifts and "
    "offsets show here.",
    "persistence": "The simplest prediction there is: the speed stays as it was {horizon:g} s ago. A model that does "
    "not beat it is worth nothing.",
    "most": "What a flexible statistical model reaches on these signals, out of fold. A good physical model comes near "
    "it or below.",
    "least": "The white part of the measured speed: sensor noise that no model can predict.",
}


def opened(source: Source, show: Show) -> Opened:
    """The recordings of a source, as every verb reads them; where they can't be, what would have to be said of them."""
    show("reading")
    try:
        found = read_recordings(source.paths, source.reading)
    except RecordingError:
        with suppress(*EXPECTED):  # the first reason is the better one
            show("looking at the columns", asked(source, show))
        raise
    return Opened(source, tuple(found), tuple(notes_of(found)))


def asked(source: Source, show: Show) -> Asked:
    """The names of the columns of a source."""
    show("looking at the columns")
    return Asked(source.paths, source.reading, tuple(names_in(source.paths[0], source.reading)))


def compared(recordings: Sequence[Recording], question: Question, show: Show) -> Compared:
    """`cruise compare`: the curves are handed over before floor and regimes are known."""
    structure, start = meant(question)
    judged, fitted_to = structure, ()
    if start is not None:
        file = files.read(question.model)
        fitted_to = file.provenance.recordings
        judged = structure, comparison.of_parameters(structure.family, start, file.noise_parameters)
    prepared = PreparationSettings(period_s=_period_s(start), cutoff_hz=CUTOFF_HZ)
    found = comparison.compare(judged, recordings, prepared, question.horizon_s, lambda text: show(text))
    curves = Predicted(found.recordings, found.horizon_s, found.ahead_mps, found.free_run_mps)
    show("judging", curves)
    findings = comparing.examined(question.model, fitted_to, found, lambda text: show(text))
    where = findings.regimes
    result = Compared(
        how=found.how,
        not_held_out=findings.not_held_out,
        predicted=curves,
        figures=_figures(found, findings.floor),
        floor_mps=_between(findings.floor),
        floor_words=tuple(comparing.floor_in_words(findings.floor, found)),
        regimes=tuple(Regime(one.sentence, one.time_share, one.error_share, one.named) for one in where.regimes),
        leaves=tuple(leaf.sentence for leaf in findings.tree.leaves if len(leaf.keys) > 1),
        stretches=findings.stretches,
        cells=_located(where.heat_map, found) if where.heat_map else None,
        picture=b"",
    )
    show("drawing", result)
    name = structure.name or str(structure)
    picture = _drawn(lambda path: comparison_picture.draw(found, findings.floor, where, findings.stretches, name, path))
    return replace(result, picture=picture)


def diagnosed(recordings: Sequence[Recording], question: Question, show: Show) -> Diagnosed:
    """`cruise diagnose`, with the evidence of every candidate that is shown."""
    structure, start = meant(question)
    if structure.nb == 0:
        raise FitError(
            f"{question.model}: a model without the current has nothing that an effect could act on; give nb=1 or more"
        )
    core = files.read(question.model).core if start is not None else None
    period_s = _period_s(start)
    begun = ladder.begin(
        recordings, structure, start, core, period_s, question.horizon_s, lambda text: show(text), at_their_rate=True
    )
    found = search(begun, lambda text: show(text))
    show("looking for the noise floor")
    floor = evidence.floor_of(found, recordings)
    show("drawing")
    first = found.steps[0].tried
    shown = cards.shown(found)
    final = found.final if found.explained else (first[0].judged if first else found.final)
    before = evidence.error_mps(found.base)
    return Diagnosed(
        horizon_s=begun.horizon_s,
        verdict=found.verdict.value,
        explained=found.explained,
        effects=found.effects,
        signals=found.signals,
        sentence=diagnosis.sentence(found).replace("`", ""),
        next_experiment=tuple(one.replace("`", "") for one in diagnosis.experiments(found)),
        hints=tuple(one.replace("`", "") for one in mapping.hints(found)),
        discounted=diagnosis.discounted(found),
        core=tuple(diagnosis.of_the_core(found)),
        hidden_mps=math.sqrt(diagnosis.hidden_share(found)) * before,
        cards=tuple(cards.card(found, one) for one in shown),
        others=tuple(
            (one.name, evidence.error_mps(one.judged), one.gain)
            for one in first
            if one not in shown and not one.name.startswith(UNNAMED)
        ),
        refused=tuple((one.effect, one.reason) for one in found.refused),
        error_before_mps=before,
        error_after_mps=evidence.error_mps(final),
        floor_mps=_between(floor),
        minute=cards.minute(found, final),
        picture=_drawn(lambda path: diagnosis_picture.draw(found, floor, path)),
    )


def added(
    recordings: Sequence[Recording], question: Question, effect: str | CustomTerm, path: Path, show: Show
) -> Added:
    """`cruise add`: the better model written to `path`, and what `cruise compare` says of that file."""
    structure, start = meant(question)
    file = files.read(question.model) if start is not None else None
    earlier = history_of(question.model, file) if file is not None else ()
    period_s = _period_s(start)
    core = file.core if file is not None else None
    wanted = effect if isinstance(effect, str) else term(effect)
    study = ladder.begin(
        recordings, structure, start, core, period_s, question.horizon_s, lambda text: show(text), wanted=wanted
    )
    one = ladder.add(study, wanted, lambda text: show(text))
    show("looking for the noise floor")
    floor = ladder.floor(study, recordings, one)
    made_on = datetime.now(UTC).date().isoformat()
    better = model_file(question.model, structure, file, earlier, study, one, floor, made_on)
    settings.save(path, better)
    fitted = ladder.parameters(study, one)
    return Added(
        effect=one.effect,
        file=better,
        path=path,
        error_before_mps=one.error_before_mps,
        error_after_mps=one.error_after_mps,
        floor_mps=_between(floor),
        parameters=tuple(fitted),
        by_hand=False,
        compared=compared(recordings, replace(question, model=str(path)), show),
        doubts=tuple(doubts(one, fitted)),
    )


def meant(question: Question) -> tuple[Structure, Model | None]:
    """The model that is asked about, as `model_named` has it. SettingsError where it is to look no time ahead."""
    if not 0.0 < question.horizon_s < math.inf:
        raise SettingsError(f"judged {question.horizon_s:g} s ahead: give a time in s above 0")
    return model_named(question.model)


def _period_s(start: Model | None) -> float:
    """The model file's period, else the usual one."""
    return PreparationSettings().period_s if start is None else start.period_s


def term(written: CustomTerm) -> Custom:
    """A term of the user's own. ExpressionError where it can't be."""
    if written.name in EFFECTS:
        raise ExpressionError(f"{written.name} is an effect already; give the term another name")
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
    moved = [one for one in settings_of(before.file) if values.get(one.name, one.value) != one.value]
    made = structs.replace(
        before.file.provenance,
        made_by="cruise workbench, parameters set by hand",
        made_on=datetime.now(UTC).date().isoformat(),
        error_ahead_mps=None,
        note="set by hand: " + ", ".join(f"{one.name} from {one.value:.5g} to {values[one.name]:.5g}" for one in moved),
    )
    better = files.file_of(path, model, made, core=core)
    settings.save(path, better)
    judged = compared(recordings, replace(question, model=str(path)), show)
    better = structs.replace(better, history=(begun_anew(better, before.floor_mps, judged),))
    settings.save(path, better)
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
    number = np.full(len(known), -1)
    number[known] = found.cell
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


def _drawn(draw: Callable[[Path], object]) -> bytes:
    """The PNG that a verb's own picture is."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        draw(path)
        return path.read_bytes()
