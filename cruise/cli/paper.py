"""`cruise paper`: the publication's tables and figures on the virtual combine, ours beside the published."""

import json
import math
import os
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from cruise.cli import paper_picture
from cruise.cli.console import FIGURES, printer
from cruise.cli.places import CONFIG, OUT
from cruise.cli.reading import PICTURES, AsJson, writable
from cruise.paper import published as printed
from cruise.paper import records
from cruise.paper.reproduce import Reproduction, Row, reproduce
from cruise.report.plain import plain

TITLES = {
    "I": "Table I: ARX",
    "II": "Table II: output error",
    "III": "Table III: ARX on the transformed current",
    "IV": "Table IV: nonlinear ARX",
    "V": "Table V: steps",
    "VI": "Table VI: gain relative to level ground and 15700 kg",
}


def paper(
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds; each drives all experiments.")] = 20,
    folder: Annotated[Path, typer.Option(help="Folder of combine.yaml, experiments.yaml and published.yaml.")] = CONFIG
    / "paper",
    processes: Annotated[int, typer.Option(min=1, help="Seeds side by side.")] = os.cpu_count() or 1,
    picture: Annotated[Path, typer.Option(help="Where the picture goes.")] = OUT / "paper.png",
    as_json: AsJson = False,
) -> None:
    """Redo the paper: explained 3 s ahead in percent, ours over all seeds beside every published number."""
    writable("--picture", picture, PICTURES)
    setting, published = records.load(folder), printed.load(folder / "published.yaml")
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("seeds", total=seeds)
        found = reproduce(setting, published, range(seeds), processes, lambda done: bar.update(task, completed=done))
    drawn = paper_picture.draw(found, published, picture)
    if as_json:
        print(json.dumps({**report(found), "picture": str(drawn)}, indent=2))
    else:
        _print(found, drawn)


def report(found: Reproduction) -> dict[str, Any]:
    """Every cell and statement, and the figures by which the whole is judged."""
    return {
        "seeds": list(found.seeds),
        "cells": [
            {
                "table": row.table,
                "model": row.model,
                "rate_hz": row.rate_hz,
                "published": row.published,
                "ours": row.ours,
                "difference": row.difference,
                "spread": row.spread,
                "unstable_pct": row.unstable_pct,
            }
            for row in found.rows
        ],
        "statements": [
            {
                "figure": one.figure,
                "about": one.about,
                "published": one.published,
                "ours": plain(one.ours),
                "spread": one.spread,
                "unit": one.unit,
                "agrees_pct": one.agrees_pct,
            }
            for one in found.statements
        ],
        "mean_absolute_difference": float(np.mean(np.abs(found.differences))),
        "largest_absolute_difference": float(np.max(np.abs(found.differences))),
        "stability_differs": [f"{row.table} {row.model} {row.rate_hz:g} Hz" for row in found.stability_differs],
        "arx10B_ahead_on_steps": plain(found.steps_margin),
        "largest_absolute_difference_table_6": max(
            abs(row.difference) for row in found.rows if row.table == "VI" and row.difference is not None
        ),
    }


def _print(found: Reproduction, drawn: Path) -> None:
    console = printer(least=FIGURES)
    count = len(found.seeds)
    console.print(f"{count} seeds, {found.seeds[0]} to {found.seeds[-1]}; explained 3 s ahead in %, mean +- spread")
    for name, title in TITLES.items():
        console.print(_table(title, [row for row in found.rows if row.table == name]))
    table = Table(box=box.SIMPLE_HEAD, title="What the text states", title_justify="left")
    for heading in ("fig.", "", "published", "ours", "agrees"):
        table.add_column(heading, justify="left" if heading in ("fig.", "", "published") else "right")
    for one in found.statements:
        value = f"{one.ours:.3g} +- {one.spread:.1g} {one.unit}" if math.isfinite(one.ours) else "not found"
        agrees = "" if one.agrees_pct is None else f"{one.agrees_pct:.0f} %"
        table.add_row(one.figure, one.about, one.published, value.removesuffix(" -"), agrees)
    console.print(table)
    away = np.abs(found.differences)
    console.print(
        f"Tables I to V: {len(away)} numbers, mean absolute difference {away.mean():.1f} points, "
        f"largest {away.max():.1f}, {int((away > 10.0).sum())} above 10"
    )
    for row in found.stability_differs:
        mine, theirs = ("unstable", "stable") if row.ours is None else ("stable", "unstable")
        console.print(f"{row.model} at {row.rate_hz:g} Hz (Table {row.table}): ours {mine}, published {theirs}")
    console.print(f"arx10B on steps: {found.steps_margin:+.1f} points on the next best")
    console.print(f"picture: {drawn}")


def _table(title: str, rows: list[Row]) -> Table:
    """One row a model, one block of columns a rate."""
    rates_hz = sorted({row.rate_hz for row in rows}, reverse=True)
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left")
    table.add_column("")
    for rate_hz in rates_hz:
        for heading in (f"{rate_hz:g} Hz paper", "ours", "off"):
            table.add_column(heading, justify="right", no_wrap=heading != f"{rate_hz:g} Hz paper")
    for model in dict.fromkeys(row.model for row in rows):
        texts = []
        for rate_hz in rates_hz:
            row = next(one for one in rows if one.model == model and one.rate_hz == rate_hz)
            texts += [_number(row.published), _ours(row), "" if row.difference is None else f"{row.difference:+.1f}"]
        table.add_row(model, *texts)
    return table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _ours(row: Row) -> str:
    if row.ours is None:
        return f"- in {row.unstable_pct:.0f}%"
    some = f" (- in {row.unstable_pct:.0f}%)" if row.unstable_pct else ""
    return f"{row.ours:.1f}±{row.spread:.1f}{some}"
