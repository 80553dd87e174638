"""The picture of a run: what became of every fault, and how long it took to notice it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from .scores import by_fault
from .trial import Outcome

COLOURS: Final = {
    "detected": "#2a6fbb",
    "refused": "#8fb8de",
    "harmless": "#b5b5b5",
    "bounded": "#dd8452",
    "silent": "#c44e52",
    "void": "#8c564b",
}


def draw(outcomes: Sequence[Outcome], path: Path) -> Path:
    """Shares by fault beside the times to the exit; returns the path."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    scores = by_fault(outcomes)
    names = [score.fault for score in scores]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(13, 1.2 + 0.2 * len(names)), sharey=True, layout="constrained", width_ratios=(2, 3)
    )
    begun = np.zeros(len(names))
    for verdict, colour in COLOURS.items():
        shares = np.array([100.0 * score.verdicts[verdict] / score.verdicts.total() for score in scores])
        left.barh(names, shares, left=begun, color=colour, label=verdict)
        begun += shares
    left.invert_yaxis()
    left.set_xlabel("trials, %")
    left.tick_params(axis="y", labelsize=7)
    left.legend(ncols=5, fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    for place, name in enumerate(names):
        times = [one.after_s for one in outcomes if one.fault == name and one.verdict == "detected"]
        right.plot(np.maximum(times, 0.01), [place] * len(times), ".", color=COLOURS["detected"], ms=3)
    right.set_xscale("log")
    right.axvline(0.3, color="black", lw=0.6)
    right.set_xlabel("from the fault to the exit, s")
    right.grid(axis="x", lw=0.3)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path
