"""The picture of a model's history: the error as stairs down to the noise floor."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cruise.report.colours import BLUE, GREEN, GREY, ORANGE

if TYPE_CHECKING:
    from cruise.cli.ladder import Rung

LOGARITHMIC = 4.0  # ratio of the greatest error to the least from which on the last steps could not be seen otherwise


def draw(rungs: "Sequence[Rung]", name: str, path: Path) -> Path:
    """One level a model, one fall an effect; returns where the picture went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib import ticker

    steps = [one.step for one in rungs]
    first = steps[0].error_before_mps
    levels = [] if first is None else [("before,\nrefitted", first)]
    levels += [(one.name, one.step.error_after_mps) for one in rungs]
    figure, axis = plt.subplots(figsize=(max(6.0, 1.6 * len(levels) + 2.5), 5.0), layout="constrained")
    for k, (_, error_mps) in enumerate(levels):
        axis.plot((k - 0.5, k + 0.5), (error_mps, error_mps), color=BLUE, lw=2.5, solid_capstyle="butt")
        axis.annotate(f"{error_mps:.4f}", (k, error_mps), (0, 5), textcoords="offset points", ha="center")
    offset = len(levels) - len(steps)
    for k, step in enumerate(steps, offset):
        if step.error_before_mps is None:
            continue
        axis.annotate(
            "",
            (k - 0.5, step.error_after_mps),
            (k - 0.5, step.error_before_mps),
            arrowprops={"arrowstyle": "-|>", "color": ORANGE, "lw": 1.8, "shrinkA": 0, "shrinkB": 0},
        )
        if step.error_before_mps > 0.0:
            change_pct = 100.0 * (step.error_after_mps / step.error_before_mps - 1.0)
            clear, edge = (5, "bottom") if change_pct <= 0.0 else (-5, "top")  # of the level that it leads to
            at = k - 0.5, step.error_after_mps
            axis.annotate(f"{change_pct:+.0f} %", at, (6, clear), textcoords="offset points", va=edge)
    last = steps[-1]
    least, most = last.floor_at_least_mps, last.floor_at_most_mps
    bounds = [one for one in (least, most) if one is not None]
    if least is not None and most is not None and most > least:
        axis.axhspan(least, most, color=GREEN, alpha=0.2, lw=0, label=f"noise floor, {least:.4f} to {most:.4f} m/s")
    elif bounds:
        axis.axhline(bounds[0], color=GREEN, lw=1.2, ls="--", label=f"noise floor, {bounds[0]:.4f} m/s")
    errors = [error_mps for _, error_mps in levels]
    low, high = min(errors + bounds), max(errors)
    if high > LOGARITHMIC * low > 0.0:
        axis.set_yscale("log")
        axis.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter(ticker.FormatStrFormatter("%g"))
        axis.yaxis.set_minor_formatter(ticker.NullFormatter())
        axis.set_ylim(0.75 * low, 1.4 * high)
    else:
        axis.set_ylim(0.0, 1.15 * high)
    axis.set_xticks(range(len(levels)), [label for label, _ in levels])
    axis.set_xlim(-0.7, len(levels) - 0.3)
    axis.set_ylabel(f"held-out error {last.horizon_s:g} s ahead (RMS, m/s)")
    axis.grid(axis="y", alpha=0.3, which="both")
    if bounds:
        axis.legend(loc="upper right", fontsize="small")
    axis.set_title(f"cruise ladder {name}", loc="left", color=GREY, parse_math=False)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
