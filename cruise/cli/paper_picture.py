"""The picture of the paper redone: its figures from our machine, and every number of ours beside the published one."""

from pathlib import Path

import numpy as np

from cruise.identification.explore import CrossCorrelation, FrequencyResponse, StaticCurve
from cruise.paper.published import Published
from cruise.paper.records import GEARS
from cruise.paper.reproduce import WITHIN, Reproduction
from cruise.report.colours import BLUE, GREEN, GREY, ORANGE, RED

TICKS_HZ = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
SHOWN_S = 60.0  # s of the steps
STYLES = {"arx7": (BLUE, "-"), "arx10": (GREEN, "-"), "arx7B": (BLUE, "-"), "arx10B": (GREEN, "-")}


def draw(found: Reproduction, published: Published, path: Path) -> Path:
    """Figures 2 to 5 and 7 with the published statements marked, and all cells; returns where the PNG went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure = plt.figure(figsize=(15, 15), layout="constrained")
    grid = figure.add_gridspec(4, 6, height_ratios=(2.2, 2.2, 2.2, 3.4))
    _response(figure.add_subplot(grid[0, 0:2]), found, published)
    _correlation(figure.add_subplot(grid[0, 2:4]), found, published)
    _curve(figure.add_subplot(grid[0, 4:6]), found)
    _steps(figure.add_subplot(grid[1, 0:3]), found, ("arx7", "arx10"))
    _steps(figure.add_subplot(grid[1, 3:6]), found, ("arx7B", "arx10B"))
    gears = grid[2, :].subgridspec(1, len(GEARS))
    for i, gear in enumerate(GEARS):
        _gear(figure.add_subplot(gears[0, i]), found, gear)
    _cells(figure.add_subplot(grid[3, :]), found)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path


def _response(axis, found: Reproduction, published: Published) -> None:
    response = found.shown.pictures.response
    axis.set_title("Fig. 2: frequency response", loc="left")
    if isinstance(response, FrequencyResponse):
        axis.fill_between(
            response.frequency_hz, response.gain_low_db, response.gain_high_db, color=BLUE, alpha=0.25, lw=0
        )
        axis.plot(response.frequency_hz, response.gain_db, color=BLUE, lw=1.3, label="ours, 95 % band")
    axis.axvline(published.cutoff_hz, color=RED, ls="--", label="published cut-off")
    axis.axvspan(*published.bump_hz, color=ORANGE, alpha=0.2, lw=0, label="published bump")
    axis.axhline(-3.0, color=GREY, lw=0.8)
    axis.set(xscale="log", xlim=(0.1, 6.0), ylim=(-40.0, 6.0), xlabel="frequency (Hz)", ylabel="gain (dB)")
    axis.set_xticks(TICKS_HZ, [f"{tick:g}" for tick in TICKS_HZ])
    axis.set_xticks([], minor=True)
    axis.legend(fontsize="small", loc="lower left")
    axis.grid(alpha=0.3, which="both")


def _correlation(axis, found: Reproduction, published: Published) -> None:
    correlation = found.shown.pictures.correlation
    axis.set_title("Fig. 3: cross-correlation", loc="left")
    if isinstance(correlation, CrossCorrelation):
        axis.plot(correlation.lag_s, correlation.correlation, color=BLUE, lw=1.3, label="ours")
        bound = np.broadcast_to(correlation.bound, np.shape(correlation.lag_s))
        axis.fill_between(correlation.lag_s, -bound, bound, color=GREY, alpha=0.25, lw=0, label="95 % bound")
    axis.axvline(published.correlation_peak_s, color=RED, ls="--", label="published peak")
    axis.set(xlim=(-2.0, 4.0), xlabel="lag of the speed (s)", ylabel="correlation (-)")
    axis.legend(fontsize="small", loc="upper right")
    axis.grid(alpha=0.3)


def _curve(axis, found: Reproduction) -> None:
    curve = found.shown.pictures.curve
    axis.set_title("Fig. 4: slow ramp", loc="left")
    if isinstance(curve, StaticCurve):
        axis.plot(curve.current_ma, curve.rising_speed_mps, color=BLUE, lw=1.5, label="rising")
        axis.plot(curve.current_ma, curve.falling_speed_mps, color=ORANGE, lw=1.5, ls="--", label="falling")
        axis.legend(fontsize="small", loc="upper left")
    axis.set(xlabel="pump current (mA)", ylabel="ground speed (m/s)")
    axis.grid(alpha=0.3)


def _steps(axis, found: Reproduction, names: tuple[str, ...]) -> None:
    steps = found.shown.records.steps
    part = slice(0, round(SHOWN_S / steps.dt_s))
    axis.set_title(f"Fig. 5: steps, 3 s ahead, {' and '.join(names)}", loc="left")
    axis.plot(steps.time_s[part], steps.output[part], color="black", ls="--", lw=1.3, label="measured")
    for name in names:
        colour, style = STYLES[name]
        axis.plot(
            steps.time_s[part], found.shown.pictures.steps_mps[name][part], color=colour, ls=style, lw=1.1, label=name
        )
    low, high = float(np.nanmin(steps.output)), float(np.nanmax(steps.output))
    axis.set(xlabel="time (s)", ylabel="ground speed (m/s)", ylim=(low - 0.4 * (high - low), high + 0.4 * (high - low)))
    axis.legend(fontsize="small", loc="upper right", ncols=3)
    axis.grid(alpha=0.3)


def _gear(axis, found: Reproduction, gear: int) -> None:
    record = found.shown.records.gears[gear]
    scaled, paced = found.shown.pictures.gears_mps[gear]
    axis.set_title(f"Fig. 7: gear {gear}", loc="left")
    axis.plot(record.time_s, record.output, color="black", ls="--", lw=1.3, label="measured")
    axis.plot(record.time_s, scaled, color=GREEN, lw=1.1, label="rescaled arx10B")
    axis.plot(record.time_s, paced, color=RED, lw=1.1, label="acceleration too")
    axis.set(xlabel="time (s)", ylabel="ground speed (m/s)" if gear == GEARS[0] else "", xlim=(0.0, SHOWN_S))
    if gear == GEARS[0]:
        axis.set_ylim(top=1.6 * float(np.nanmax(record.output)))  # room for the legend above the curves
        axis.legend(fontsize="small", loc="upper left")
    axis.grid(alpha=0.3)


def _cells(axis, found: Reproduction) -> None:
    rows = [row for row in found.rows if row.table in WITHIN]
    names = [f"{row.table} {row.model} {row.rate_hz:g} Hz" for row in rows]
    places = np.arange(len(rows))
    for place, row in zip(places, rows, strict=True):
        if row.ours is not None and row.published is not None:
            axis.plot([place, place], [row.published, row.ours], color=GREY, lw=1.0, zorder=1)
    values = np.array([np.nan if row.ours is None else row.ours for row in rows])
    printed = np.array([np.nan if row.published is None else row.published for row in rows])
    axis.errorbar(
        places,
        values,
        yerr=[row.spread for row in rows],
        fmt="o",
        ms=4,
        color=BLUE,
        lw=1.0,
        label="ours, spread of the seeds",
    )
    axis.plot(places, printed, "D", ms=5, color=RED, mfc="none", label="published")
    axis.plot(places[np.isnan(values)], np.zeros(int(np.isnan(values).sum())), "o", ms=4, color=BLUE)
    axis.plot(places[np.isnan(printed)], np.zeros(int(np.isnan(printed).sum())), "D", ms=7, color=RED, mfc="none")
    away = np.abs(found.differences)
    axis.set_title(
        f"Tables I to V: mean absolute difference {away.mean():.1f} points, largest {away.max():.1f} (at 0: unstable)",
        loc="left",
    )
    axis.set_xticks(places, names, rotation=90, fontsize="x-small")
    axis.set(ylabel="explained 3 s ahead (%)", xlim=(-1, len(rows)), ylim=(-4, 104))
    axis.legend(fontsize="small", loc="lower right")
    axis.grid(alpha=0.3)
