"""The paper over many seeds: every number of ours as a mean with its spread, beside the published one."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from cruise.paper.figures import Pictures, Statement, pictures_and_statements
from cruise.paper.published import Published
from cruise.paper.records import Records, Setting, drive
from cruise.paper.tables import RATES_HZ, Cell, cells, fit_all, static_effects

WITHIN: Final = ("I", "II", "III", "IV", "V")  # tables whose cells are held against the published ones
DELAY_GUESS_S: Final = 0.75  # of the ramp's slow curve: the published peak of the cross-correlation


@dataclass(frozen=True, eq=False)
class Run:
    """One seed."""

    seed: int
    cells: tuple[Cell, ...]
    statements: tuple[Statement, ...]


@dataclass(frozen=True, eq=False)
class Shown:
    """What the pictures are drawn from: everything of the first seed."""

    run: Run
    records: Records
    pictures: Pictures


@dataclass(frozen=True, slots=True)
class Row:
    """One published number beside ours over all seeds; None is the paper's "-", or ours in most of the seeds."""

    table: str
    model: str
    rate_hz: float
    published: float | None
    ours: float | None  # mean over the seeds that have a number
    spread: float  # standard deviation over them
    unstable_pct: float  # of the seeds

    @property
    def difference(self) -> float | None:
        """Ours minus published; None where either is unstable."""
        return None if self.published is None or self.ours is None else self.ours - self.published


@dataclass(frozen=True, slots=True)
class Stated:
    """One statement of the text beside ours over all seeds."""

    figure: str
    about: str
    published: str
    ours: float
    spread: float
    unit: str
    agrees_pct: float | None  # of the seeds


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The whole comparison."""

    seeds: tuple[int, ...]
    rows: tuple[Row, ...]
    statements: tuple[Stated, ...]
    shown: Shown

    @property
    def differences(self) -> np.ndarray:
        """Ours minus published (M,) in points for every cell of Tables I to V in which both have a number."""
        return np.array([row.difference for row in self.rows if row.table in WITHIN and row.difference is not None])

    @property
    def stability_differs(self) -> tuple[Row, ...]:
        """The cells of Tables I to V in which only one of the two is unstable."""
        return tuple(row for row in self.rows if row.table in WITHIN and (row.published is None) != (row.ours is None))

    @property
    def steps_margin(self) -> float:
        """Points by which arx10B is ahead of the next best model on steps; NaN if it is unstable."""
        steps = {row.model: row.ours for row in self.rows if row.table == "V"}
        best = steps.pop("arx10B")
        others = [value for value in steps.values() if value is not None]
        return float("nan") if best is None or not others else best - max(others)


def run_seed(setting: Setting, published: Published, seed: int) -> Shown:
    """Drive, fit and judge with one seed."""
    records = drive(setting, published, seed)
    effects = static_effects(records.ramp, DELAY_GUESS_S)
    fitted = {rate_hz: fit_all(records, rate_hz, effects) for rate_hz in RATES_HZ}
    found = tuple(cells(records, fitted, published))
    pictures, statements = pictures_and_statements(records, fitted, setting.plant.engine)
    return Shown(Run(seed, found, tuple(statements)), records, pictures)


def reproduce(
    setting: Setting,
    published: Published,
    seeds: Sequence[int],
    processes: int = 1,
    show: Callable[[int], None] | None = None,
) -> Reproduction:
    """All seeds, in `processes` side by side; `show` is told how many are done."""
    shown = run_seed(setting, published, seeds[0])
    runs = [shown.run]
    if show is not None:
        show(1)
    if len(seeds) > 1:
        with ProcessPoolExecutor(max_workers=processes) as pool:
            waiting = [pool.submit(_only_run, setting, published, seed) for seed in seeds[1:]]
            for done, one in enumerate(waiting, 2):
                runs.append(one.result())
                if show is not None:
                    show(done)
    return Reproduction(tuple(seeds), _rows(runs), _stated(runs), shown)


def _only_run(setting: Setting, published: Published, seed: int) -> Run:
    """Without what only pictures need, which is much to send between processes."""
    return run_seed(setting, published, seed).run


def _rows(runs: Sequence[Run]) -> tuple[Row, ...]:
    groups: dict[tuple[str, str, float], list[Cell]] = defaultdict(list)
    for run in runs:
        for cell in run.cells:
            groups[cell.key].append(cell)
    rows = []
    for group in groups.values():
        values = np.array([cell.ours for cell in group if cell.ours is not None])
        unstable_pct = 100.0 * (1.0 - len(values) / len(group))
        first = group[0]
        usable = unstable_pct <= 50.0
        rows.append(
            Row(
                table=first.table,
                model=first.model,
                rate_hz=first.rate_hz,
                published=first.published,
                ours=float(values.mean()) if usable else None,
                spread=float(values.std(ddof=1)) if usable and len(values) > 1 else 0.0,
                unstable_pct=unstable_pct,
            )
        )
    return tuple(rows)


def _stated(runs: Sequence[Run]) -> tuple[Stated, ...]:
    result = []
    for group in zip(*(run.statements for run in runs), strict=True):
        values = np.array([one.ours for one in group])
        known = values[np.isfinite(values)]
        first = group[0]
        agrees = None if first.agrees is None else 100.0 * float(np.mean([bool(one.agrees) for one in group]))
        result.append(
            Stated(
                figure=first.figure,
                about=first.about,
                published=first.published,
                ours=float(known.mean()) if len(known) else float("nan"),
                spread=float(known.std(ddof=1)) if len(known) > 1 else 0.0,
                unit=first.unit,
                agrees_pct=agrees,
            )
        )
    return tuple(result)
