"""`cruise add`: a physical effect more in a model, everything refitted, and what that was worth."""

import difflib
import json
import math
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.table import Table

from cruise import settings
from cruise.cli.console import FIGURES, bold, printer, working
from cruise.cli.reading import (
    NOTES_SHOWN,
    AsJson,
    Columns,
    Database,
    Horizon,
    InputName,
    ModelPeriod,
    OutputName,
    Recordings,
    above_zero,
    columns_of,
    count_of,
    prepared_by,
    tables,
    writable,
)
from cruise.effects import EFFECTS, Custom
from cruise.effects.custom import output_in_words
from cruise.effects.expression import ExpressionError
from cruise.identification.named import model_named
from cruise.model import files
from cruise.model.history import history_of
from cruise.recording import notes_of
from cruise.report.added import doubts, less
from cruise.report.model_file import model_file
from cruise.report.plain import plain
from cruise.settings import SettingsError
from cruise.validation import ladder
from cruise.validation.ladder import Added, Parameter
from cruise.validation.noise_floor import NoiseFloor
from cruise.validation.numbers import BOUND, NO_SIGN, NOT_TOLD
from cruise.validation.study import Study


def add(
    effect: Annotated[str, typer.Argument(help="Effect of cruise effects, or custom(NAME, STAGE, EXPRESSION).")],
    recordings: Recordings,
    model: Annotated[str, typer.Option(help="Name (arx1 .. oe8), structure written out, or model file.")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Model file to write.")] = None,
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    database: Database = None,
    period: ModelPeriod = None,
    horizon: Horizon = 3.0,
    as_json: AsJson = False,
) -> None:
    """Add an effect to a model: refit all of it, and compare the error on data that neither fit had seen."""
    read_as = columns_of(columns, input_name, output_name, database)
    wanted = _wanted(effect, read_as.output)
    structure, start = model_named(model)
    file = files.read(model) if start is not None else None
    earlier = history_of(model, file) if file is not None else ()
    period_s = prepared_by(period, 0.0, start).period_s
    above_zero("--horizon", horizon)
    if out is not None:
        writable("--out", out)
    read = tables(recordings, read_as, model=model)
    with working("reading") as show:
        core = file.core if file is not None else None
        study = ladder.begin(read, structure, start, core, period_s, horizon, show, wanted=wanted)
        added = ladder.add(study, wanted, show)
        show("looking for the noise floor")
        floor = ladder.floor(study, read, added)
    if out is not None:
        made_on = datetime.now(UTC).date().isoformat()
        settings.save(out, model_file(model, structure, file, earlier, study, added, floor, made_on))
    fitted = ladder.parameters(study, added)
    if as_json:
        said = report(model, study, added, floor, fitted) | {"model_file": str(out) if out else None}
        print(json.dumps(plain(said), indent=2))
    else:
        _print(model, study, added, floor, fitted, out)


def report(model: str, study: Study, added: Added, floor: NoiseFloor, fitted: list[Parameter]) -> dict[str, Any]:
    """All figures under stable names; what is not known is null."""
    return {
        "effect": added.effect,
        "brought_along": list(added.brought_along),
        "model": model,
        "recordings": [one.source for one in study.recordings],
        "samples": sum(len(one) for one in study.recordings),
        "period_s": study.period_s,
        "notes": notes_of(study.recordings),
        "horizon_s": study.horizon_s,
        "error_before_mps": added.error_before_mps,
        "error_after_mps": added.error_after_mps,
        "judged_samples": added.samples,
        "noise_floor": {
            "at_least_mps": float(floor.white.value_mps) if floor.white else None,
            "at_most_mps": float(floor.reached.value_mps) if floor.reached else None,
        },
        "parameters": {one.name: {k: v for k, v in asdict(one).items() if k != "name"} for one in fitted},
    }


def _wanted(text: str, output: str) -> str | Custom:
    """The effect that a word means, or the term that is written out; `output` is how the recordings call the speed."""
    if text.startswith("custom"):
        try:
            term = Custom.written(text)
        except ExpressionError as error:
            raise SettingsError(str(error)) from error
        if term.name in EFFECTS:
            raise SettingsError(f"{text}: {term.name} is an effect already; give the term another name")
        if output in term.needs:
            raise SettingsError(output_in_words(output))
        return term
    if text not in EFFECTS:
        near = difflib.get_close_matches(text.lower().replace("-", "_"), EFFECTS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(EFFECTS)}, custom(...)"
        raise SettingsError(f"no effect is called {text}; {hint}")
    return text


def _print(
    model: str, study: Study, added: Added, floor: NoiseFloor, fitted: list[Parameter], out: Path | None
) -> None:
    console = printer(least=FIGURES)
    samples = sum(len(one) for one in study.recordings)
    along = f", and with it {', '.join(added.brought_along)}" if added.brought_along else ""
    console.print(bold(added.effect, f" added to {model}{along}"))
    console.print(f"{count_of(len(study.recordings), 'recording')}, {samples} samples of {study.period_s:g} s")
    notes = notes_of(study.recordings)
    for note in notes[:NOTES_SHOWN]:
        console.print(f"note: {note}")
    if len(notes) > NOTES_SHOWN:
        console.print(f"and {count_of(len(notes) - NOTES_SHOWN, 'note')} more (--json has them all)")
    fell = f"{added.error_before_mps:.4f} -> {added.error_after_mps:.4f} m/s"
    console.print()
    console.print(f"held-out error {study.horizon_s:g} s ahead:", bold(fell, f", {_change(less(added))}"))
    console.print(f"noise floor: {floor_in_words(floor)}")
    doubtful = doubts(added, fitted)
    for sentence in doubtful:
        console.print(sentence)
    console.print(_table(fitted))
    for remark in (NOT_TOLD, BOUND, NO_SIGN):
        names = [one.name for one in fitted if one.remark == remark]
        if names:
            console.print(f"{remark}: {', '.join(names)}")
    if out is None:
        console.print("nothing was written; -o FILE.yaml keeps the model")
    elif doubtful:
        console.print(f"model: {out}; cruise ladder {out} --undo takes {added.effect} out again")
    else:
        console.print(f"model: {out}; next: cruise ladder {out}, or cruise run with it")


def _change(less: float) -> str:
    """How much of the error went, or came, in words."""
    percent = round(100 * less)
    if percent == 0:
        return "as much as before"
    if percent <= -100:
        return f"{1.0 - less:.2g} times as much"
    return f"{abs(percent)} % {'less' if percent > 0 else 'more'}"


def floor_in_words(floor: NoiseFloor) -> str:
    """Between what the error of the best model lies; what a flexible model reaches may be less than what a straight one
    takes for noise."""
    said = []
    if floor.white is not None and floor.reached is not None and floor.reached.value_mps < floor.white.value_mps:
        return f"{floor.reached.value_mps:.4f} to {floor.white.value_mps:.4f} m/s"
    if floor.white is not None:
        said.append(f"at least {floor.white.value_mps:.4f} m/s")
    if floor.reached is not None:
        said.append(f"at most {floor.reached.value_mps:.4f} m/s")
    return ", ".join(said) or "not known, the recordings are too short for it"


def _table(fitted: list[Parameter]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("parameter", "unit", "before", "after", "+-"):
        words = heading in ("parameter", "unit")
        table.add_column(heading, justify="left" if words else "right", no_wrap=heading == "parameter")
    for one in fitted:
        before = f"{one.before:.4g}" if one.before is not None else ""
        error = f"{one.std:.2g}" if math.isfinite(one.std) else "-"
        table.add_row(one.name, one.unit, before, f"{one.after:.4g}", error)
    return table
