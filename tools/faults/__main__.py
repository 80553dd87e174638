"""`tools/fault_trials`: every fault many times, each figure beside its target."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from rich.console import Console
from rich.table import Table

from tools.benchmarks.figures import Part, show

from . import clean, picture, scores
from .table import FAULTS
from .trial import Outcome, Plan, run

PAPER = 150  # characters
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
Task = TypeVar("Task")
Done = TypeVar("Done")


@app.command()
def trials(
    count: Annotated[int, typer.Option(min=0, help="Trials, spread evenly over the faults.")] = 3000,
    seed: Annotated[int, typer.Option(min=0, help="First of the seeds, one for each round over all faults.")] = 1,
    chosen: Annotated[str, typer.Option("--faults", help="Some, joined by commas; default: all. See --list.")] = "",
    clean_hours: Annotated[float, typer.Option(min=0.0, help="Simulated hours without any fault.")] = 0.0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    listed: Annotated[bool, typer.Option("--list", help="Say what there is, and which redundancy reveals it.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    drawn: Annotated[Path | None, typer.Option("--picture", help="Draw what became of every fault (.png).")] = None,
) -> None:
    """Let faults happen and print what became of them."""
    console = Console(width=None if sys.stdout.isatty() else PAPER, highlight=False)
    if listed:
        _list(console)
        return
    names = [name.strip() for name in chosen.split(",")] if chosen else list(FAULTS)
    unknown = [name for name in names if name not in FAULTS]
    if unknown:
        raise typer.BadParameter(f"no {', '.join(unknown)}; see --list", param_hint="--faults")
    outcomes = list(_all(run, plans(names, count, seed), jobs, "trial"))
    seeds = range(seed, seed + round(clean_hours * 3600.0 / clean.DRIVE_S))
    drives = list(_all(clean.drive, seeds, jobs, "drive without fault"))
    figures = [*(scores.figures(outcomes) if outcomes else ()), *(clean.figures(drives) if drives else ())]
    part = Part(tuple(figures), (seed,), tuple(_notes(outcomes, drives)))
    if as_json:
        data = {"trials": [one.as_json() for one in outcomes], "clean": [asdict(one) for one in drives]}
        typer.echo(json.dumps(part.as_json() | data, indent=1))
    else:
        _table(console, outcomes)
        show("fault trials", part, console)
    if drawn is not None:
        picture.draw(outcomes, drawn)
    if any(one.failed for one in outcomes) or any(one.how for one in drives):
        raise typer.Exit(1)


def plans(names: Sequence[str], count: int, seed: int) -> list[Plan]:
    """Round by round over the faults, each round with a seed of its own."""
    return [Plan.of(FAULTS[names[i % len(names)]], seed + i // len(names)) for i in range(count)]


def _all(work: Callable[[Task], Done], tasks: Sequence[Task], jobs: int, what: str) -> Iterator[Done]:
    with Console(stderr=True).status("begin") as status:
        if jobs == 1:
            found = map(work, tasks)
            yield from _told(found, len(tasks), what, status.update)
            return
        with ProcessPoolExecutor(jobs) as pool:
            yield from _told(pool.map(work, tasks, chunksize=8), len(tasks), what, status.update)


def _told(found: Iterator[Done], count: int, what: str, tell: Callable[[str], None]) -> Iterator[Done]:
    for i, one in enumerate(found, 1):
        tell(f"{what} {i} of {count}")
        yield one


def _notes(outcomes: Sequence[Outcome], drives: Sequence[clean.Clean]) -> list[str]:
    failed = [
        f"FAILED: {one.fault}, seed {one.seed}, from {one.from_s:.2f} s: {one.verdict}, {one.how}; "
        f"overspeed {one.overspeed_mps:.2f} m/s, acceleration {one.accel_mps2:.2f} m/s2"
        for one in islice((one for one in outcomes if one.failed), 40)
    ]
    return failed + [f"FALSE EXIT: seed {one.seed} after {one.hours:.3f} h: {one.how}" for one in drives if one.how]


def _table(console: Console, outcomes: Sequence[Outcome]) -> None:
    if not outcomes:
        return
    shown = Table(title="faults", title_justify="left", title_style="bold")
    for heading in ("fault", "could be revealed by", "verdicts", "mostly by", "latest, s", "overspeed", "acceleration"):
        shown.add_column(heading)
    for score in scores.by_fault(outcomes):
        verdicts = ", ".join(f"{count} {name}" for name, count in score.verdicts.most_common())
        how = score.how.most_common(1)[0][0] if score.how else "-"
        worst = (f"{value:.2f}" for value in (score.latest_s, score.overspeed_mps, score.accel_mps2))
        shown.add_row(score.fault, score.redundancy, verdicts, how[:40], *worst)
    console.print(shown)


def _list(console: Console) -> None:
    shown = Table(title=f"{len(FAULTS)} faults", title_justify="left", title_style="bold")
    for heading in ("fault", "what it does", "redundancy that could reveal it"):
        shown.add_column(heading)
    for row in FAULTS.values():
        shown.add_row(row.name, row.does, row.redundancy)
    console.print(shown)


if __name__ == "__main__":
    app()
