"""`cruise orders`: which orders and which delay, judged on what the fit had not seen."""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from cruise.cli import orders_picture
from cruise.cli.places import OUT
from cruise.cli.reading import AsJson, Columns, InputName, OutputName, Recordings, columns_of, model_named, tables
from cruise.identification.identify import with_shapes
from cruise.identification.orders import Candidate, Search, search
from cruise.identification.preparation import PreparationSettings, at_period, smoother

SHOWN = 15  # rows of the table


def orders(
    recordings: Recordings,
    model: Annotated[str, typer.Option(help="Structure or model file whose effects all candidates have.")] = "arx10",
    na_max: Annotated[int, typer.Option(min=0, max=20, help="Greatest order of the output.")] = 3,
    nb_max: Annotated[int, typer.Option(min=1, max=20, help="Greatest order of the input.")] = 5,
    delay_max: Annotated[float, typer.Option(min=0, max=10, help="Longest delay in s.")] = 1.0,
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    period: Annotated[float, typer.Option(help="Sampling period of the models in s.")] = 0.2,
    cutoff: Annotated[float, typer.Option(help="Filter of the training data in Hz; 0: none.")] = 1.0,
    horizon: Annotated[float, typer.Option(help="How far ahead predictions are judged, in s.")] = 3.0,
    picture: Annotated[Path, typer.Option(help="Where the picture goes.")] = OUT / "orders.png",
    as_json: AsJson = False,
) -> None:
    """Search over orders and delay, ranked by the held-out error 3 s ahead against the number of parameters."""
    structure, start = model_named(model)
    preparation = PreparationSettings(period_s=period, cutoff_hz=cutoff)
    prepared = at_period(tables(recordings, columns_of(columns, input_name, output_name)), period)
    smooth = smoother(preparation, period)
    base = start if start is not None else with_shapes(structure.model(period), prepared, smooth)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("structures")
        found = search(
            base,
            prepared,
            range(na_max + 1),
            range(1, nb_max + 1),
            range(round(delay_max / period) + 1),
            horizon,
            smooth,
            smooth,
            lambda done, total: bar.update(task, completed=done, total=total),
        )
    drawn = orders_picture.draw(found, picture)
    if as_json:
        print(json.dumps({**report(found), "picture": str(drawn)}, indent=2))
    else:
        _print(found, drawn)


def report(found: Search) -> dict[str, Any]:
    """All candidates, best first, and the recommended one."""
    return {
        "period_s": found.period_s,
        "horizon_s": found.horizon_s,
        "recommended": _row(found, found.recommended),
        "candidates": [_row(found, one) for one in found.candidates],
    }


def _row(found: Search, one: Candidate) -> dict[str, Any]:
    return {
        "model": written(found, one),
        "na": one.na,
        "nb": one.nb,
        "delay_s": round(one.delay * found.period_s, 9),
        "parameters": one.parameters,
        "explained_pct": one.explained_pct if math.isfinite(one.explained_pct) else None,
        "rmse_mps": one.rmse_mps if math.isfinite(one.rmse_mps) else None,
        "on_front": one in found.front,
        "refused": one.refused,
    }


def written(found: Search, one: Candidate) -> str:
    """The structure as --model takes it."""
    return f"arx:na={one.na},nb={one.nb},delay_s={round(one.delay * found.period_s, 9):g}"


def _print(found: Search, drawn: Path) -> None:
    console = Console(highlight=False)
    table = Table(
        box=box.SIMPLE_HEAD,
        title=f"{len(found.candidates)} structures, {found.horizon_s:g} s ahead, held out; * none simpler is better",
        title_justify="left",
    )
    for heading in ("na", "nb", "delay s", "parameters", "explained %", "RMSE m/s", ""):
        table.add_column(heading, justify="right")
    best = [one for one in found.candidates if not one.refused][:SHOWN]
    for one in [*best, *sorted(set(found.front) - set(best), key=lambda one: one.rmse_mps)]:
        mark = ("*" if one in found.front else "") + (" recommended" if one is found.recommended else "")
        table.add_row(
            str(one.na),
            str(one.nb),
            f"{one.delay * found.period_s:g}",
            str(one.parameters),
            f"{one.explained_pct:.1f}",
            f"{one.rmse_mps:.4f}",
            mark,
        )
    console.print(table)
    refused = sum(bool(one.refused) for one in found.candidates)
    if refused:
        console.print(f"{refused} structures are unstable predictors or can't be fitted (--json says why)")
    console.print(
        f"recommended: {written(found, found.recommended)}, the fewest parameters within one standard error of the best"
    )
    console.print(f"picture: {drawn}", markup=False)
