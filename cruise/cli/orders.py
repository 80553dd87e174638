"""`cruise orders`: which orders and which delay, judged on what the fit had not seen."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from cruise.cli import orders_picture
from cruise.cli.console import FIGURES, printer
from cruise.cli.places import OUT
from cruise.cli.reading import (
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
from cruise.identification.identify import validation_filter, with_shapes
from cruise.identification.named import model_named
from cruise.identification.orders import Candidate, Search, search
from cruise.identification.preparation import at_period, smoother
from cruise.identification.regressors import FitError
from cruise.identification.structures import Family
from cruise.report.plain import plain

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
    database: Database = None,
    period: ModelPeriod = None,
    cutoff: Cutoff = 1.0,
    horizon: Horizon = 3.0,
    picture: Annotated[Path, typer.Option(help="Where the picture goes.")] = OUT / "orders.png",
    as_json: AsJson = False,
) -> None:
    """Search over orders and delay, ranked by the held-out error 3 s ahead against the number of parameters."""
    structure, start = model_named(model)
    if structure.family is not Family.ARX:
        raise FitError(f"{model}: the search is over ARX structures; name one, such as arx10B, for its effects")
    preparation = prepared_by(period, cutoff, start)
    above_zero("--horizon", horizon)
    writable("--picture", picture, PICTURES)
    period_s = preparation.period_s
    read = tables(recordings, columns_of(columns, input_name, output_name, database), model=model)
    prepared = at_period(read, period_s)
    smooth = smoother(preparation, period_s)
    empty = structure.model(period_s)
    base = replace(empty, effects=start.effects) if start is not None else with_shapes(empty, prepared, smooth)
    terminal = Console(stderr=True)
    with Progress(console=terminal, transient=True, disable=not terminal.is_terminal) as bar:
        task = bar.add_task("structures")
        found = search(
            base,
            prepared,
            range(na_max + 1),
            range(1, nb_max + 1),
            range(round(delay_max / period_s) + 1),
            horizon,
            smooth,
            validation_filter(base, smooth),
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
        "not_held_out": [f"shapes of {name}" for name in found.effects],
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
        "explained_pct": plain(one.explained_pct),
        "rmse_mps": plain(one.rmse_mps),
        "on_front": one in found.front,
        "refused": one.refused,
    }


def written(found: Search, one: Candidate) -> str:
    """The structure as --model takes it."""
    orders = f"arx:na={one.na},nb={one.nb},delay_s={round(one.delay * found.period_s, 9):g}"
    return "+".join((orders, *found.effects))


def _print(found: Search, drawn: Path) -> None:
    console = printer(least=FIGURES)
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
    if found.effects:
        console.print(f"the shapes of {', '.join(found.effects)} were found on all of it, for every structure alike")
    refused = sum(bool(one.refused) for one in found.candidates)
    if refused:
        console.print(f"left out: {count_of(refused, 'structure')}, unstable or not to be fitted (--json says why)")
    console.print("recommended, the fewest parameters within one standard error of the best:")
    console.print(f"  {written(found, found.recommended)}", soft_wrap=True)
    console.print(f"picture: {drawn}")
