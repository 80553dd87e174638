"""`cruise compare`: a model against measurements, how far it is from the noise floor, and where it fails."""

import json
import math
import textwrap
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cruise.cli.console import bold, printer, working
from cruise.cli.places import OUT
from cruise.cli.reading import (
    NOTES_SHOWN,
    PICTURES,
    AsJson,
    Columns,
    Cutoff,
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
from cruise.identification.accuracy import Accuracy
from cruise.identification.families import Linear
from cruise.identification.named import model_named
from cruise.identification.structures import Structure
from cruise.model import files
from cruise.recording import notes_of
from cruise.report import comparison_picture
from cruise.report.comparison import Findings, examined, floor_in_words, report
from cruise.validation import comparison
from cruise.validation.comparison import Comparison
from cruise.validation.noise_floor import Bound
from cruise.validation.signatures import Signature, Signatures

WIDTH = 80
SHOWN = 5  # regimes and signatures in the text; --json has them all
LEAST_SHOWN_PCT = -999.9  # below it a prediction is nonsense, and its digits are noise


def compare(
    recordings: Recordings,
    model: Annotated[str, typer.Option(help="Name (arx1 .. narx2), structure written out, or model file.")],
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    database: Database = None,
    period: ModelPeriod = None,
    cutoff: Cutoff = 1.0,
    horizon: Horizon = 3.0,
    picture: Annotated[Path, typer.Option(help="Where the picture goes.")] = OUT / "compare.png",
    as_json: AsJson = False,
) -> None:
    """Compare a model with measurements: how good, how good at best, and where it fails."""
    structure, start = model_named(model)
    preparation = prepared_by(period, cutoff, start)
    above_zero("--horizon", horizon)
    writable("--picture", picture, PICTURES)
    read = tables(recordings, columns_of(columns, input_name, output_name, database), model=model)
    judged: Structure | tuple[Structure, Linear] = structure
    fitted_to: tuple[str, ...] = ()
    if start is not None:
        file = files.read(model)
        judged = structure, comparison.of_parameters(structure.family, start, file.noise_parameters)
        fitted_to = file.provenance.recordings
    with working("comparing") as show:
        compared = comparison.compare(judged, read, preparation, horizon, show)
        found = examined(model, fitted_to, compared, show)
    drawn = comparison_picture.draw(found.comparison, found.floor, found.regimes, found.stretches, model, picture)
    if as_json:
        print(json.dumps({**report(found), "picture": str(drawn)}, indent=2))
    else:
        _print(found, drawn)


def _print(found: Findings, drawn: Path) -> None:
    console, compared = printer(WIDTH), found.comparison
    samples = sum(len(one) for one in compared.recordings)
    structure = str(compared.structure)
    console.print(found.name if structure == found.name else bold(found.name, f" {structure}"))
    filtered = "input filtered" if compared.smooth is not None else "input as it was"
    console.print(
        f"{count_of(len(compared.recordings), 'recording')}, {samples} samples of {compared.fitted.period_s:g} s, "
        f"{filtered}"
    )
    _say(console, f"the model was {compared.how}", 0)
    if found.not_held_out:
        _say(console, found.not_held_out, 0)
    notes = notes_of(compared.recordings)
    for note in notes[:NOTES_SHOWN]:
        console.print(f"note: {note}")
    if len(notes) > NOTES_SHOWN:
        console.print(f"and {count_of(len(notes) - NOTES_SHOWN, 'note')} more (--json has them all)")
    console.print(_accuracy_table(found))
    for sentence in floor_in_words(found.floor, compared):
        _say(console, sentence, 0)

    console.print(bold("\nwhere it fails"))
    named = found.regimes.named
    for one in named[:SHOWN]:
        _say(console, one.sentence + _side(one.mean_error_mps, compared.ahead.rmse_mps))
    if not named:
        _say(console, "no regime holds more of the error than noise would give it")
    for leaf in found.tree.leaves[:SHOWN]:
        if len(leaf.keys) > 1 or not any(one.key in leaf.keys for one in named):
            _say(console, f"found by the tree: {leaf.sentence}{_side(leaf.mean_error_mps, compared.ahead.rmse_mps)}")

    console.print(bold("\nworst stretches"))
    for one in found.stretches:
        where = f" of {Path(compared.recordings[one.recording].source).name}" if len(compared.recordings) > 1 else ""
        times = f"{one.start_s:.0f} to {one.end_s:.0f} s{where}"
        _say(console, f"{100 * one.error_share:4.1f} % in {times}: {one.sentence}")
    if not found.stretches:
        _say(console, "none: the error is spread evenly")

    _print_signatures(console, found.signatures, compared)
    console.print(f"\npicture: {drawn}")


def _accuracy_table(found: Findings) -> Table:
    compared, floor = found.comparison, found.floor
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("", "explained %", "NRMSE %", "RMSE m/s", "mean error m/s", "samples"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    rows = {
        f"{compared.horizon_s:g} s ahead": compared.ahead,
        "free run": compared.free_run,
        "persistence": compared.persistence,
    }
    for name, judged in rows.items():
        table.add_row(name, *_figures(judged))
    spread = compared.ahead.rmse_mps / (1.0 - compared.ahead.nrmse_pct / 100.0)
    for name, bound in (("floor at most", floor.reached), ("floor at least", floor.white)):
        table.add_row(name, *_floor_figures(bound, spread))
    return table


def _figures(judged: Accuracy) -> tuple[str, ...]:
    return (
        _percent(judged.explained_pct),
        _percent(judged.nrmse_pct),
        f"{judged.rmse_mps:.4f}",
        f"{judged.mean_error_mps:+.4f}",
        str(judged.samples),
    )


def _floor_figures(bound: Bound | None, speed_std_mps: float) -> tuple[str, ...]:
    """What a prediction without a bias reaches that has this error."""
    if bound is None:
        return ("-",) * 5
    ratio = bound.value_mps / speed_std_mps
    return _percent(100.0 * (1.0 - ratio**2)), _percent(100.0 * (1.0 - ratio)), f"{bound.value_mps:.4f}", "", ""


def _side(mean_error_mps: float, rmse_mps: float) -> str:
    """To which side the model errs there, where it does."""
    if abs(mean_error_mps) < 0.5 * rmse_mps:
        return ""
    return f" ({abs(mean_error_mps):.2g} m/s {'faster' if mean_error_mps > 0 else 'slower'} than predicted)"


def _print_signatures(console: Console, found: Signatures, compared: Comparison) -> None:
    telling = [one for one in found.tests if one.found]
    if not telling:
        console.print(bold("\nsignatures", f"\n  the residual depends on none of {len(found.tests)} regressors"))
        return
    table = Table(
        box=box.SIMPLE_HEAD,
        title=bold("signatures", f" of what the model lacks, {compared.horizon_s:g} s ahead"),
        title_justify="left",
        title_style="",
    )
    for heading in ("residual against", "correlation", "share %", "t", "p, corrected"):
        table.add_column(heading, justify="left" if heading == "residual against" else "right")
    for one in telling[:SHOWN]:
        table.add_row(*_signature_row(one, one.regressor))
    if not found.standard.refused:
        table.add_row(*_signature_row(found.standard, "standard test: u, any lag"), style="dim")
    console.print()
    console.print(table)


def _signature_row(one: Signature, name: str) -> tuple[str, ...]:
    return (
        name,
        f"{one.correlation:+.2f}",
        f"{100 * one.share:.0f}",
        f"{one.t:+.1f}",
        "< 1e-6" if one.p_corrected < 1e-6 else f"{one.p_corrected:.2g}",
    )


def _percent(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.1f}" if not value < LEAST_SHOWN_PCT else f"< {LEAST_SHOWN_PCT:.0f}"


def _say(console: Console, sentence: str, indent: int = 2) -> None:
    """A sentence, its further lines indented."""
    text = textwrap.fill(
        sentence, WIDTH, initial_indent=" " * indent, subsequent_indent=" " * (indent + 2), break_on_hyphens=False
    )
    console.print(text, soft_wrap=True)
