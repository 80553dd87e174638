"""The picture of a comparison: speeds, errors with the worst stretches, and the regimes that hold the error."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cruise.report.colours import BLUE, GREEN, GREY, ORANGE, RED
from cruise.validation.comparison import Comparison
from cruise.validation.noise_floor import NoiseFloor
from cruise.validation.regimes import HeatMap, Regimes, Table
from cruise.validation.worst_stretches import Stretch

MOST_SHOWN = 4  # recordings below each other; of more, the one that errs most
BINS = 1200  # of time over the width of a picture, about one a pixel
BARS = 3  # quantities beside the heat map
WITHIN = " - within noise"
LABELS = 56  # letters of all labels below the bars that stand side by side
LEAST_WRITTEN = 0.01  # share of time and error of a cell from which its figures are written into it


def draw(
    found: Comparison, floor: NoiseFloor, where: Regimes, stretches: Sequence[Stretch], name: str, path: Path
) -> Path:
    """Measured and predicted speed with the error below, heat map and shares at the bottom; returns the PNG's path."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    shown = _shown(found)
    figure = plt.figure(figsize=(13, 5.0 * len(shown) + 5.0), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=(5.0 * len(shown), 5.0))
    upper, lower = parts
    axes = upper.subplots(2 * len(shown), 1, height_ratios=(3, 2) * len(shown), squeeze=False)[:, 0]
    for place, number in enumerate(shown):
        mine = [one for one in stretches if one.recording == number]
        _one(axes[2 * place], axes[2 * place + 1], found, floor, number, mine, name if place == 0 else "")
    left, right = lower.subfigures(1, 2, width_ratios=(1.15, 1.0))
    if where.heat_map is None:
        left.text(0.5, 0.5, "fewer than two quantities move: no map of regimes", ha="center", color=GREY)
    else:
        told = [table.words for table, regime in zip(where.tables, where.regimes, strict=True) if regime.named]
        _map(left, where.heat_map, {where.heat_map.rows.words, where.heat_map.columns.words} <= set(told))
    _bars(right, where)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path


def extremes(time_s: np.ndarray, values: np.ndarray, bins: int = BINS) -> tuple[np.ndarray, np.ndarray]:
    """A curve (M,) that looks like `values` (N,): of every bin of time its least and greatest value, in their order.

    A bin that holds a hole keeps one, so that lines break where nothing was measured. Short curves stay as they are.
    """
    if len(values) <= 2 * bins:
        return time_s, values
    kept = []
    for part in np.array_split(np.arange(len(values)), bins):
        known = part[np.isfinite(values[part])]
        picked = {int(known[np.argmin(values[known])]), int(known[np.argmax(values[known])])} if len(known) else set()
        holes = part[~np.isfinite(values[part])]
        kept += sorted(picked | {int(hole) for hole in holes[:1]})
    return time_s[kept], values[kept]


def _shown(found: Comparison) -> list[int]:
    """The numbers of the recordings that are drawn."""
    count = len(found.recordings)
    if count <= MOST_SHOWN:
        return list(range(count))
    energy = [float(np.nansum(error**2)) for error in found.errors_mps]
    return [int(np.argmax(energy))]


def _one(
    speed: Any, error: Any, found: Comparison, floor: NoiseFloor, number: int, stretches: Sequence[Stretch], name: str
) -> None:
    recording, e = found.recordings[number], found.errors_mps[number]
    time_s = recording.time_s
    ahead = f"model {found.horizon_s:g} s ahead"
    speed.plot(*extremes(time_s, recording.output), color=GREY, lw=1.8, label="measured")
    speed.plot(*extremes(time_s, found.free_run_mps[number]), color=GREEN, lw=0.9, alpha=0.9, label="model, free run")
    speed.plot(*extremes(time_s, found.ahead_mps[number]), color=BLUE, lw=1.1, label=ahead)
    speed.set_ylabel("speed (m/s)")
    few = len(found.recordings) <= MOST_SHOWN
    which = Path(recording.source).name + ("" if few else f", the worst of {len(found.recordings)} recordings")
    speed.set_title(f"{name} - {which}" if name else which, loc="left", parse_math=False)
    speed.legend(loc="upper left", ncols=3, fontsize="small", framealpha=0.6)
    low, high = speed.get_ylim()
    speed.set_ylim(low, high + 0.15 * (high - low))  # room for the legend
    error.plot(*extremes(time_s, e), color=RED, lw=0.9)
    error.axhline(0.0, color=GREY, lw=0.8)
    bound = floor.reached or floor.white
    if bound is not None:
        label = f"floor: ±2 · {bound.value_mps:.3f} m/s"
        error.axhspan(-2 * bound.value_mps, 2 * bound.value_mps, color=GREEN, alpha=0.15, lw=0, label=label)
    top = max(float(np.nanmax(np.abs(e), initial=0.0)), 1e-6)
    error.set_ylim(-1.25 * top, 1.25 * top)
    for axis in (speed, error):
        for one in stretches:
            axis.axvspan(one.start_s, one.end_s, color=ORANGE, alpha=0.25, lw=0)
        axis.set_xlim(time_s[0], time_s[-1])
        axis.grid(alpha=0.3)
    for one in stretches:
        middle = 0.5 * (one.start_s + one.end_s)
        error.text(middle, 1.2 * top, f"{100 * one.error_share:.0f} %", ha="center", va="top", fontsize="small")
    error.set_ylabel("error (m/s)")
    error.set_xlabel("time (s); shaded: the worst stretches, with their share of the squared error")
    if bound is not None:
        error.legend(loc="lower right", fontsize="small")


def _map(figure: Any, found: HeatMap, named: bool) -> None:
    axis = figure.subplots()
    with np.errstate(invalid="ignore"):
        shown = np.where(found.time_share > 0.0, found.rmse_mps, np.nan)
    image = axis.imshow(shown, origin="lower", aspect="auto", cmap="viridis", vmin=0.0)
    middle = 0.5 * float(np.nanmax(shown))
    for i, j in np.ndindex(shown.shape):
        if max(found.time_share[i, j], found.error_share[i, j]) >= LEAST_WRITTEN:
            text = f"{100 * found.error_share[i, j]:.0f} %\nin {100 * found.time_share[i, j]:.0f} %"
            color = "black" if shown[i, j] > middle else "white"
            axis.text(j, i, text, ha="center", va="center", color=color, fontsize="small")
    axis.set_xticks(range(len(found.columns.labels)), found.columns.labels, fontsize="small")
    rows = [textwrap.fill(one, 8, break_long_words=False) for one in found.rows.labels]
    axis.set_yticks(range(len(rows)), rows, fontsize="small")
    axis.set_xlabel(_heading(found.columns))
    axis.set_ylabel(_heading(found.rows))
    axis.set_title("share of the squared error, in share of the time" + WITHIN * (not named), loc="left")
    figure.colorbar(image, ax=axis, label="RMSE (m/s)")


def _bars(figure: Any, where: Regimes) -> None:
    shown = [(table, regime.named) for table, regime in zip(where.tables, where.regimes, strict=True)][:BARS]
    if not shown:
        return
    for number, (axis, (table, named)) in enumerate(
        zip(figure.subplots(len(shown), 1, squeeze=False)[:, 0], shown, strict=True)
    ):
        place = np.arange(len(table.labels))
        axis.bar(place - 0.2, 100 * table.error_share, 0.4, color=RED, label="of the squared error")
        axis.bar(place + 0.2, 100 * table.time_share, 0.4, color=GREY, label="of the time")
        axis.set_xticks(place, [textwrap.fill(label, LABELS // len(place)) for label in table.labels], fontsize="small")
        axis.set_ylabel("share (%)")
        axis.set_title(_heading(table) + WITHIN * (not named), loc="left", fontsize="medium")
        axis.grid(alpha=0.3, axis="y")
        if number == 0:
            figure.legend(*axis.get_legend_handles_labels(), loc="outside lower right", ncols=2, fontsize="small")


def _heading(table: Table) -> str:
    return f"{table.words} ({table.unit})" if table.unit else table.words
