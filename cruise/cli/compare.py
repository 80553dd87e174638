"""`cruise compare`: a model against measurements, how far it is from the noise floor, and where it fails."""

import json
import math
import textwrap
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cruise.cli import compare_picture
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
    destination,
    model_named,
    notes_of,
    prepared_by,
    tables,
)
from cruise.identification.accuracy import Accuracy
from cruise.identification.families import Linear
from cruise.identification.identify import Show
from cruise.identification.preparation import PreparationSettings
from cruise.identification.structures import Structure
from cruise.model import files
from cruise.recording import Recording
from cruise.validation import comparison
from cruise.validation.comparison import Comparison
from cruise.validation.failure_tree import FailureTree, failure_tree
from cruise.validation.noise_floor import Bound, NoiseFloor, causes_in, noise_floor
from cruise.validation.quantities import spoken
from cruise.validation.regimes import Regimes, regimes
from cruise.validation.regimes import Table as RegimeTable
from cruise.validation.signatures import Signature, Signatures, signatures
from cruise.validation.worst_stretches import Stretch, worst_stretches

WIDTH = 80
SHOWN = 5  # regimes and signatures in the text; --json has them all
LEAST_SHOWN_PCT = -999.9  # below it a prediction is nonsense, and its digits are noise


@dataclass(frozen=True, eq=False)
class Findings:
    """All that `cruise compare` found."""

    name: str  # of the model, as the user named it
    seen: tuple[str, ...]  # recordings that a model file was fitted to and is judged on
    comparison: Comparison
    floor: NoiseFloor
    regimes: Regimes
    tree: FailureTree
    stretches: tuple[Stretch, ...]
    signatures: Signatures


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
    destination("--picture", picture, PICTURES)
    read = tables(recordings, columns_of(columns, input_name, output_name, database))
    judged: Structure | tuple[Structure, Linear] = structure
    seen: tuple[str, ...] = ()
    if start is not None:
        file = files.read(model)
        judged = structure, comparison.of_parameters(structure.family, start, file.noise_parameters)
        seen = _seen(file.provenance.recordings, read)
    with Console(highlight=False, stderr=True).status("comparing") as status:
        found = examined(model, seen, judged, read, preparation, horizon, status.update)
    drawn = compare_picture.draw(found.comparison, found.floor, found.regimes, found.stretches, model, picture)
    if as_json:
        print(json.dumps({**report(found), "picture": str(drawn)}, indent=2))
    else:
        _print(found, drawn)


def examined(
    name: str,
    seen: tuple[str, ...],
    model: Structure | tuple[Structure, Linear],
    recordings: list[Recording],
    preparation: PreparationSettings,
    horizon_s: float,
    show: Show,
) -> Findings:
    """Compare, and ask everything of the errors. FitError where the model says nothing of these recordings."""
    found = comparison.compare(model, recordings, preparation, horizon_s, show)
    errors_mps = found.errors_mps
    show("looking for the noise floor")
    floor = noise_floor(found.native, found.recordings, found.ahead_mps, found.horizon)
    show("looking where it fails")
    return Findings(
        name=name,
        seen=seen,
        comparison=found,
        floor=floor,
        regimes=regimes(found.recordings, errors_mps, found.horizon),
        tree=failure_tree(found.recordings, errors_mps, found.horizon),
        stretches=worst_stretches(found.recordings, errors_mps),
        signatures=signatures(found),
    )


def _seen(fitted_to: tuple[str, ...], recordings: list[Recording]) -> tuple[str, ...]:
    """The recordings whose file names stand in the model's provenance ("one.csv, 0 to 119.8 s")."""
    known = {Path(text.rpartition(", ")[0] or text).name for text in fitted_to}
    return tuple(one.source for one in recordings if Path(one.source).name in known)


def report(found: Findings) -> dict[str, Any]:
    """All figures under stable names; what is no number is null, so that it is JSON."""
    compared, floor = found.comparison, found.floor
    heat_map = found.regimes.heat_map
    return _plain(
        {
            "model": found.name,
            "structure": str(compared.structure),
            "how": compared.how,
            "fitted_to_some_of_these": list(found.seen),
            "recordings": [one.source for one in compared.recordings],
            "samples": sum(len(one) for one in compared.recordings),
            "period_s": compared.fitted.period_s,
            "notes": notes_of(compared.recordings),
            "horizon_s": compared.horizon_s,
            "input_filtered_for_validation": compared.smooth is not None,
            "ahead": asdict(compared.ahead),
            "free_run": asdict(compared.free_run),
            "persistence": asdict(compared.persistence),
            "noise_floor": {
                "white": floor.white and asdict(floor.white),
                "white_at_most_mps": floor.white_at_most_mps,
                "from_hz": floor.from_hz,
                "to_hz": floor.to_hz,
                "reached": floor.reached and asdict(floor.reached),
                "between_mps": floor.between_mps,
                "signals": list(causes_in(compared.recordings)),
            },
            "regimes": [
                {**asdict(one), "sentence": one.sentence, "bins": _bins(table)}
                for one, table in zip(found.regimes.regimes, found.regimes.tables, strict=True)
            ],
            "heat_map": heat_map
            and {
                "rows": heat_map.rows.key,
                "row_labels": heat_map.rows.labels,
                "columns": heat_map.columns.key,
                "column_labels": heat_map.columns.labels,
                "time_share": heat_map.time_share,
                "error_share": heat_map.error_share,
                "rmse_mps": heat_map.rmse_mps,
                "excess": heat_map.excess,
                "excess_low": heat_map.excess_low,
                "excess_high": heat_map.excess_high,
            },
            "tree": {
                "leaves": [{**asdict(leaf), "sentence": leaf.sentence} for leaf in found.tree.leaves],
                "explained": found.tree.explained,
                "offered": found.tree.shown,
            },
            "worst_stretches": [
                {**asdict(one), "source": compared.recordings[one.recording].source} for one in found.stretches
            ],
            "signatures": [{**asdict(one), "found": one.found} for one in found.signatures.tests],
            "standard_test": asdict(found.signatures.standard),
        }
    )


def _bins(table: RegimeTable) -> list[dict[str, Any]]:
    return [
        {
            "label": label,
            "time_share": float(table.time_share[i]),
            "error_share": float(table.error_share[i]),
            "rmse_mps": float(table.rmse_mps[i]),
            "mean_error_mps": float(table.mean_error_mps[i]),
        }
        for i, label in enumerate(table.labels)
    ]


def _plain(value: Any) -> Any:
    """`value` with what JSON does not know as what it knows."""
    match value:
        case dict():
            return {key: _plain(one) for key, one in value.items()}
        case list() | tuple():
            return [_plain(one) for one in value]
        case np.ndarray() | np.generic():
            return _plain(value.tolist())
        case float() if not math.isfinite(value):
            return None
    return value


def _print(found: Findings, drawn: Path) -> None:
    console, compared = Console(highlight=False, width=WIDTH), found.comparison
    samples = sum(len(one) for one in compared.recordings)
    structure = str(compared.structure)
    console.print(found.name if structure == found.name else f"[bold]{found.name}[/bold] {structure}")
    filtered = "input filtered" if compared.smooth is not None else "input as it was"
    console.print(
        f"{count_of(len(compared.recordings), 'recording')}, {samples} samples of {compared.fitted.period_s:g} s, "
        f"{filtered}"
    )
    _say(console, f"the model was {compared.how}", 0)
    if found.seen:
        _say(console, f"it had been fitted to {', '.join(found.seen)}: what follows is not held out", 0)
    notes = notes_of(compared.recordings)
    for note in notes[:NOTES_SHOWN]:
        console.print(f"note: {note}", markup=False)
    if len(notes) > NOTES_SHOWN:
        console.print(f"and {count_of(len(notes) - NOTES_SHOWN, 'note')} more (--json has them all)")
    console.print(_accuracy_table(found))
    for sentence in floor_in_words(found.floor, compared):
        _say(console, sentence, 0)

    console.print("\n[bold]where it fails[/bold]")
    named = found.regimes.named
    for one in named[:SHOWN]:
        _say(console, one.sentence + _side(one.mean_error_mps, compared.ahead.rmse_mps))
    if not named:
        _say(console, "no regime holds more of the error than noise would give it")
    for leaf in found.tree.leaves[:SHOWN]:
        if len(leaf.keys) > 1 or not any(one.key in leaf.keys for one in named):
            _say(console, f"found by the tree: {leaf.sentence}{_side(leaf.mean_error_mps, compared.ahead.rmse_mps)}")

    console.print("\n[bold]worst stretches[/bold]")
    for one in found.stretches:
        where = f" of {Path(compared.recordings[one.recording].source).name}" if len(compared.recordings) > 1 else ""
        times = f"{one.start_s:.0f} to {one.end_s:.0f} s{where}"
        _say(console, f"{100 * one.error_share:4.1f} % in {times}: {one.sentence}")
    if not found.stretches:
        _say(console, "none: the error is spread evenly")

    _print_signatures(console, found.signatures, compared)
    console.print(f"\npicture: {drawn}", markup=False)


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


def floor_in_words(floor: NoiseFloor, compared: Comparison) -> list[str]:
    """What was taken as the floor, on what assumption, and what could be gained."""
    said = []
    if floor.white is not None:
        white = floor.white
        said.append(
            f"No model errs by less than {_interval(white)} m/s: that much of the measured speed is white, judged by "
            f"its spectrum from {floor.from_hz:.2g} to {floor.to_hz:.2g} Hz, where the current explains nothing."
        )
    elif math.isfinite(floor.white_at_most_mps):
        said.append(
            "The spectrum of the speed falls up to its highest frequency: white noise is at most "
            f"{floor.white_at_most_mps:.4f} m/s, and there is no floor from below (the sensor filters, perhaps)."
        )
    if floor.reached is None:
        return [*said, "The recordings are too short for a floor from above."]
    names = ", ".join(("current", "speed", *(spoken(name)[0] for name in causes_in(compared.recordings))))
    said.append(
        f"{_interval(floor.reached)} m/s are reached {compared.horizon_s:g} s ahead by ridge regression and "
        f"gradient boosting over {names} and past errors, out of fold."
    )
    if math.isfinite(floor.between_mps):
        said.append(
            f"Between the two lie {floor.between_mps:.4f} m/s of slow disturbance that nothing recorded announces, or "
            "of a dependence that boosting did not find."
        )
    gain = 1.0 - (floor.reached.value_mps / compared.ahead.rmse_mps) ** 2
    enough = floor.reached.high_mps < compared.ahead.rmse_mps
    said.append(
        f"So {100 * gain:.0f} % of the squared error of this model, at least, is not noise."
        if enough
        else "So there is no sign that another model of these signals would be better."
    )
    return said


def _interval(bound: Bound) -> str:
    return f"{bound.value_mps:.4f} ({bound.low_mps:.4f} to {bound.high_mps:.4f})"


def _side(mean_error_mps: float, rmse_mps: float) -> str:
    """To which side the model errs there, where it does."""
    if abs(mean_error_mps) < 0.5 * rmse_mps:
        return ""
    return f" ({abs(mean_error_mps):.2g} m/s {'faster' if mean_error_mps > 0 else 'slower'} than predicted)"


def _print_signatures(console: Console, found: Signatures, compared: Comparison) -> None:
    telling = [one for one in found.tests if one.found]
    if not telling:
        console.print(f"\n[bold]signatures[/bold]\n  the residual depends on none of {len(found.tests)} regressors")
        return
    table = Table(
        box=box.SIMPLE_HEAD,
        title=f"[bold]signatures[/bold] of what the model lacks, {compared.horizon_s:g} s ahead",
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
    console.print(text, markup=False, soft_wrap=True)
