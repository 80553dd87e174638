"""The picture of a search over orders and delay."""

from pathlib import Path

import numpy as np

from cruise.identification.orders import Search
from cruise.report.colours import BLUE, GREY, ORANGE, RED


def draw(found: Search, path: Path) -> Path:
    """Error against the number of parameters, and the best error at every delay; returns where the PNG went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib import ticker

    usable = [one for one in found.candidates if not one.refused]
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout="constrained", sharey=True)
    left.scatter(
        [one.parameters for one in usable], [one.rmse_mps for one in usable], s=14, color=GREY, label="structure"
    )
    front = [one.parameters for one in found.front], [one.rmse_mps for one in found.front]
    left.plot(*front, color=BLUE, marker="o", ms=5, label="no simpler one is better")
    wise = found.recommended
    named = f"recommended: na = {wise.na}, nb = {wise.nb}, delay {wise.delay * found.period_s:g} s"
    left.plot(wise.parameters, wise.rmse_mps, "D", color=RED, ms=9, mfc="none", mew=2, ls="none", label=named)
    left.set_xlabel("parameters (-)")
    left.xaxis.set_major_locator(ticker.MaxNLocator(integer=True))
    left.set_ylabel(f"held-out error {found.horizon_s:g} s ahead (RMSE, m/s)")
    orders = sorted({one.na for one in usable})
    for na, colour in zip(orders, (BLUE, ORANGE, RED, GREY, *["black"] * len(orders)), strict=False):
        delays = sorted({one.delay for one in usable if one.na == na})
        least = [min(one.rmse_mps for one in usable if one.na == na and one.delay == delay) for delay in delays]
        style = ("-", "--", "-.", ":")[na % 4]
        right.plot(found.period_s * np.array(delays), least, style, color=colour, marker=".", label=f"na = {na}")
    right.set_xlabel("delay (s)")
    right.legend(title="best nb at", fontsize="small")
    least = min(one.rmse_mps for one in usable)
    median = float(np.median([one.rmse_mps for one in usable]))
    left.set_ylim(least - 0.08 * (median - least), least + 2.5 * (median - least) if median > least else None)
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize="small", frameon=False)
    for axis in (left, right):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
