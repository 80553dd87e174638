"""`cruise identify`: a model from recordings, with what it is worth."""

import json
import math
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cruise.cli import identify_picture
from cruise.cli.console import FIGURES, bold, printer, working
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
from cruise.effects import Parameter
from cruise.identification.accuracy import Accuracy
from cruise.identification.armax import Armax
from cruise.identification.doubts import REMEDY, at_bound, doubts
from cruise.identification.identify import Identification
from cruise.identification.identify import identify as fit
from cruise.identification.named import model_named
from cruise.identification.preparation import PreparationSettings, filter_in_words
from cruise.identification.regressors import FitError
from cruise.model import files
from cruise.model.files import Provenance
from cruise.recording import input_rest_of, input_unit_of, notes_of
from cruise.report.plain import plain

LEAST_SHOWN_PCT = -999.9  # below it a prediction is nonsense, and its digits are noise


def identify(
    recordings: Recordings,
    model: Annotated[str, typer.Option(help="Name (arx1 .. narx2), structure written out, or model file.")] = "arx10B",
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Model file to write.")] = None,
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    database: Database = None,
    period: ModelPeriod = None,
    cutoff: Cutoff = 1.0,
    horizon: Horizon = 3.0,
    picture: Annotated[Path, typer.Option(help="Where the picture goes.")] = OUT / "identify.png",
    as_json: AsJson = False,
) -> None:
    """Fit a model to recordings and judge it 3 s ahead on parts of them that the fit had not seen."""
    structure, start = model_named(model)
    if out is not None and structure.family == "narx":
        raise FitError(f"{model}: polynomials can't drive, so that there is no model file for them; leave out -o")
    if out is not None and structure.nb == 0:
        raise FitError(f"{model}: a model without the current can't drive; leave out -o, or give nb=1 or more")
    preparation = prepared_by(period, cutoff, start)
    above_zero("--horizon", horizon)
    writable("--picture", picture, PICTURES)
    if out is not None:
        writable("--out", out)
    read = tables(recordings, columns_of(columns, input_name, output_name, database), model=model)
    with working("reading") as show:
        found = fit(structure, read, preparation, start, horizon, show)
    drawn = identify_picture.draw(found, picture)
    if out is not None:
        _save(out, found, preparation)
    if as_json:
        said = {**report(found, preparation), "picture": str(drawn), "model_file": str(out) if out else None}
        print(json.dumps(said, indent=2))
    else:
        _print(found, preparation, drawn, out)


def report(found: Identification, preparation: PreparationSettings) -> dict[str, Any]:
    """All figures under stable names; what is no number is null, so that it is JSON."""
    fitted = found.fitted
    return {
        "model": found.structure.name or str(found.structure),
        "structure": str(found.structure),
        "period_s": fitted.period_s,
        "delay_s": round(found.structure.delay(fitted.period_s) * fitted.period_s, 9),
        "training_data": filter_in_words(preparation),
        "recordings": [one.source for one in found.recordings],
        "samples": sum(len(one) for one in found.recordings),
        "notes": notes_of(found.recordings),
        "parameters": {
            name: {"value": value, "standard_error": plain(error)}
            for name, value, error in zip(fitted.parameter_names, fitted.theta, fitted.theta_std, strict=True)
        },
        "effects": _shapes(found),
        "time_constants_s": plain(time_constants_s(found)),
        "unstable": fitted.unstable,
        "converged": fitted.converged,
        "message": fitted.message,
        "horizon_s": found.horizon_s,
        "input_filtered_for_validation": found.filtered,
        "held_out": _figures(found.held_out, fitted.unstable),
        "held_out_refused": found.refused,
        "doubts": doubts(found),
        "training": _figures(found.training, fitted.unstable),
        "free_run": _figures(found.free_run, fitted.unstable),
        "persistence": _figures(found.persistence, ""),
        "residuals": {
            "largest_autocorrelation": plain(found.whiteness.largest),
            "outside_95_pct": plain(found.whiteness.outside_pct),
            "ljung_box_p": plain(found.whiteness.p_value),
        },
    }


def time_constants_s(found: Identification) -> list[float]:
    """Time constants in s of the poles that decay without a sign change, the slowest first."""
    poles = [pole for pole in found.fitted.poles if abs(pole.imag) < 1e-9 and 0.0 < pole.real < 1.0]
    return sorted((-found.fitted.period_s / math.log(pole.real) for pole in poles), reverse=True)


def _shapes(found: Identification) -> dict[str, dict[str, float]]:
    return {one.name: {name: float(getattr(one, name)) for name in one.parameters} for one in found.effects}


def _figures(judged: Accuracy | None, unstable: str) -> dict[str, Any] | None:
    """Figures of a prediction; none where the predictor is unstable, whatever the numbers happen to be."""
    return None if judged is None or unstable else plain(asdict(judged))


def _save(path: Path, found: Identification, preparation: PreparationSettings) -> None:
    model, unstable = found.model, found.fitted.unstable
    assert model is not None
    runs_away = f"; unstable predictor: {unstable}" if unstable else ""
    provenance = Provenance(
        recordings=tuple(f"{one.source}, {one.time_s[0]:g} to {one.time_s[-1]:g} s" for one in found.recordings),
        samples=sum(len(one) for one in found.recordings),
        made_by=f"cruise identify --model {found.structure.name or found.structure}",
        made_on=datetime.now(UTC).date().isoformat(),
        error_ahead_mps=plain(found.held_out.rmse_mps) if found.held_out and not unstable else None,
        horizon_s=found.horizon_s,
        input_unit=input_unit_of(found.recordings),
        input_rest_ma=input_rest_of(found.recordings),
        note=f"training data {filter_in_words(preparation)}; {found.fitted.message}{runs_away}",
    )
    noise = found.fitted.noise if isinstance(found.fitted, Armax) else ()
    files.save(path, model, provenance, found.structure.family.value, noise)  # pyright: ignore[reportArgumentType]


def _print(found: Identification, preparation: PreparationSettings, drawn: Path, out: Path | None) -> None:
    console, fitted = printer(least=FIGURES), found.fitted
    samples = sum(len(one) for one in found.recordings)
    delay = found.structure.delay(fitted.period_s)
    name = f"{found.structure.name} " if found.structure.name else ""
    console.print(bold(name, str(found.structure)))
    console.print(
        f"{count_of(len(found.recordings), 'recording')}, {samples} samples of {fitted.period_s:g} s, "
        f"{filter_in_words(preparation)}; delay {delay * fitted.period_s:g} s"
    )
    notes = notes_of(found.recordings)
    for note in notes[:NOTES_SHOWN]:
        console.print(f"note: {note}")
    if len(notes) > NOTES_SHOWN:
        console.print(f"and {count_of(len(notes) - NOTES_SHOWN, 'note')} more (--json has them all)")
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("parameter", "value", "standard error"):
        table.add_column(heading, justify="left" if heading == "parameter" else "right")
    for name, value, error in zip(fitted.parameter_names, fitted.theta, fitted.theta_std, strict=True):
        table.add_row(name, f"{value:.5g}", f"{error:.2g}")
    for effect in found.effects:
        for name, bound in effect.parameters.items():
            value = float(getattr(effect, name))
            remark = _remark(value, bound) if (effect.name, name) in found.looked_for else "not looked for"
            table.add_row(f"{effect.name}.{name}", f"{value:.5g}", remark)
    console.print(table)
    slow = ", ".join(f"{value:.2f} s" for value in time_constants_s(found))
    console.print(f"time constants: {slow}" if slow else "no pole: what happened longer ago than the taps is forgotten")
    console.print(fitted.message if fitted.converged else bold("did not converge:", f" {fitted.message}"))
    if fitted.unstable:
        console.print(bold("unstable predictor", f": {fitted.unstable}; no figure of it means anything"))
    console.print(_accuracy_table(found))
    if found.refused:
        console.print(f"nothing held out: {found.refused}")
    console.print(_residuals(found))
    console.print(f"picture: {drawn}")
    _print_worth(console, doubts(found), out)


def _print_worth(console: Console, doubtful: list[str], out: Path | None) -> None:
    """What to do next: with the model file, or where something speaks against the model, about that."""
    if not doubtful:
        if out is not None:
            console.print(f"model: {out}; next: cruise run with it, or cruise compare")
        return
    if out is not None:
        console.print(f"model: {out}")
    console.print(bold("don't drive with this model:"))
    for one in doubtful:
        console.print(f"  {one}")
    console.print(f"next: {REMEDY}")


def _remark(value: float, bound: Parameter) -> str:
    """What has to be known of a shape that was not found between its bounds."""
    if value == bound.neutral:
        return "no sign of it"
    return "at its bound" if at_bound(value, bound) else ""


def _residuals(found: Identification) -> str:
    white = found.whiteness
    if not math.isfinite(white.q):
        return "residuals one step ahead: too few to say whether they are white"
    return (
        f"residuals one step ahead: {white.outside_pct:.0f} % of the autocorrelations are outside the\n"
        f"95 % bound (5 % by chance), the largest is {white.largest:.2f}"
    )


def _accuracy_table(found: Identification) -> Table:
    input_told = "input filtered alike" if found.filtered else "input as it was"
    table = Table(
        box=box.SIMPLE_HEAD,
        title=f"{found.horizon_s:g} s ahead of the unfiltered speed, {input_told}",
        title_justify="left",
    )
    for heading in ("", "explained %", "NRMSE %", "RMSE m/s", "mean error m/s", "samples"):
        table.add_column(heading, justify="left" if not heading else "right")
    rows = {
        "held out": found.held_out,
        "training": found.training,
        "free run": found.free_run,
        "persistence": found.persistence,
    }
    for name, judged in rows.items():
        if judged is None or (found.fitted.unstable and name != "persistence"):
            table.add_row(name, *["-"] * 5)
        else:
            table.add_row(
                name,
                _percent(judged.explained_pct),
                _percent(judged.nrmse_pct),
                f"{judged.rmse_mps:.4f}",
                f"{judged.mean_error_mps:+.4f}",
                str(judged.samples),
            )
    return table


def _percent(value: float) -> str:
    return f"{value:.1f}" if not value < LEAST_SHOWN_PCT else f"< {LEAST_SHOWN_PCT:.0f}"
