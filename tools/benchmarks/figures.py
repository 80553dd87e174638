"""A measured figure beside its target; a target that is missed is said to be."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console
from rich.table import Table

WIDTH = 8  # characters of a number in a series


@dataclass(frozen=True, slots=True)
class Figure:
    """One number. `value` NaN: it could not be measured. Without a bound it is for information."""

    key: str
    value: float
    unit: str
    meaning: str
    at_most: float | None = None
    at_least: float | None = None

    @property
    def target(self) -> str:
        """The bound as text, empty where there is none."""
        if self.at_most is not None:
            return f"<= {self.at_most:g}"
        return f">= {self.at_least:g}" if self.at_least is not None else ""

    @property
    def verdict(self) -> str:
        """ "met" or "missed", empty without a target."""
        if not self.target:
            return ""
        low = -math.inf if self.at_least is None else self.at_least
        high = math.inf if self.at_most is None else self.at_most
        return "met" if low <= self.value <= high else "missed"

    @property
    def missed(self) -> bool:
        """Whether there is a target and this is not it."""
        return self.verdict == "missed"

    def as_json(self) -> dict[str, Any]:
        """Value, unit, target and verdict; a NaN becomes None."""
        value = self.value if math.isfinite(self.value) else None
        return {"value": value, "unit": self.unit, "target": self.target, "verdict": self.verdict}


@dataclass(frozen=True, slots=True)
class Part:
    """What one part measured: its figures, the seeds that it used, and what has to be known to read them."""

    figures: tuple[Figure, ...]
    seeds: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    series: Mapping[str, list[float]] = field(default_factory=dict)  # columns over time or cases, for whoever draws

    def as_json(self) -> dict[str, Any]:
        """The figures by key, with seeds, notes and series; a NaN becomes None."""
        series = {
            name: [value if math.isfinite(value) else None for value in values] for name, values in self.series.items()
        }
        return {
            "figures": {figure.key: figure.as_json() for figure in self.figures},
            "seeds": list(self.seeds),
            "notes": list(self.notes),
            "series": series,
        }


def show(name: str, part: Part, console: Console) -> None:
    """Print a part as a table."""
    seeds = f", seeds {' '.join(map(str, part.seeds))}" if part.seeds else ""
    table = Table(title=f"{name}{seeds}", title_justify="left", title_style="bold")
    for heading in ("figure", "value", "unit", "target", ""):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for figure in part.figures:
        style = {"met": "green", "missed": "bold red"}.get(figure.verdict, "")
        value = "-" if math.isnan(figure.value) else f"{figure.value:.4g}"
        table.add_row(figure.meaning, value, figure.unit, figure.target, figure.verdict, style=style)
    console.print(table)
    if part.series:
        columns = Table(box=None, padding=(0, 1))
        for heading in part.series:
            columns.add_column(heading, justify="right", min_width=WIDTH)
        for row in zip(*part.series.values(), strict=True):
            columns.add_row(*(f"{value:.3g}" for value in row))
        console.print(columns)
    for note in part.notes:
        console.print(f"  {note}", highlight=False, soft_wrap=True)
    console.print()
