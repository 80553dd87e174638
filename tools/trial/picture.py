"""The picture of a score: who was taken for whom, and whether the stated confidence came true."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from cruise.report.colours import BLUE, GREY

from .effects import EFFECTS
from .score import NOT_DECIDED, Score

NONE: Final = ("nothing", "unlisted")
MANY: Final = 30  # answers in a tenth, from which its point is judged
CLOSE: Final = 0.05


def draw(score: Score, title: str, path: Path) -> Path:
    """Confusion matrix in percent of each row, and reliability curve; returns where the picture went."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(17, 9.5), width_ratios=(1.7, 1.0), layout="constrained")
    _confusion(axes[0], score)
    _reliability(axes[1], score)
    figure.suptitle(title, x=0.01, ha="left")
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path


def _confusion(axis: Any, score: Score) -> None:
    known = [*EFFECTS, *NONE]
    truths = [name for name in known if any(truth == name for truth, _ in score.confusion)]
    others = {said for _, said in score.confusion if said not in truths}
    answers = [*truths, *sorted(others - {NOT_DECIDED, "failed"}), *sorted(others & {NOT_DECIDED, "failed"})]
    counts = np.array([[score.confusion.get((truth, said), 0) for said in answers] for truth in truths], float)
    shares = 100.0 * counts / counts.sum(axis=1, keepdims=True) if len(truths) else np.zeros((0, 0))
    axis.imshow(shares, cmap="Blues", vmin=0.0, vmax=100.0, aspect="auto")
    for (i, k), value in np.ndenumerate(shares):
        if value:
            axis.text(k, i, f"{value:.0f}", ha="center", va="center", color="white" if value > 55.0 else "black")
    axis.set_xticks(range(len(answers)), answers, rotation=60, ha="right", rotation_mode="anchor")
    rows = [f"{truth} ({int(total)})" for truth, total in zip(truths, counts.sum(axis=1), strict=True)]
    axis.set_yticks(range(len(truths)), rows)
    axis.set_xlabel("what the program named first")
    axis.set_ylabel("what was missing (trials)")
    axis.set_title("confusion, % of each row", loc="left")
    axis.set_xticks(np.arange(len(answers)) - 0.5, minor=True)
    axis.set_yticks(np.arange(len(truths)) - 0.5, minor=True)
    axis.grid(which="minor", color="#dddddd", lw=0.6)
    axis.tick_params(which="minor", length=0)


def _reliability(axis: Any, score: Score) -> None:
    axis.plot((0.0, 1.0), (0.0, 1.0), color=GREY, lw=0.9, ls="--", label="as it should be")
    axis.fill_between((0.0, 1.0), (-CLOSE, 1.0 - CLOSE), (CLOSE, 1.0 + CLOSE), color=GREY, alpha=0.15, lw=0)
    for one in score.reliability:
        low, high = one.right.interval
        many = one.right.of >= MANY
        axis.plot((one.stated, one.stated), (low, high), color=BLUE, lw=1.3, alpha=1.0 if many else 0.4)
        axis.plot(one.stated, one.right.value, "o", ms=8, color=BLUE, mfc=BLUE if many else "white")
        near_top = one.right.value > 0.9
        axis.annotate(
            str(one.right.of),
            (one.stated, one.right.value),
            (7, -4 if near_top else 4),
            textcoords="offset points",
            va="top" if near_top else "bottom",
        )
    axis.plot([], [], "o", color=BLUE, label=f"trials of a tenth, {MANY} or more")
    axis.plot([], [], "o", color=BLUE, mfc="white", label="fewer")
    axis.set(xlim=(0.0, 1.03), ylim=(0.0, 1.03), xlabel="stated confidence", ylabel="share that was right, 95 %")
    axis.set_aspect("equal")
    axis.grid(alpha=0.3)
    axis.legend(loc="lower right")
    axis.set_title(f"reliability, Brier score {score.brier:.3f}", loc="left")
