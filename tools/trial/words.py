"""A score in words, beside what it has to be, and as JSON."""

import math
import sys
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from .score import Score, Share

PAPER: Final = 140  # characters, width of the tables in a file


def show(score: Score) -> None:
    """Print it."""
    console = Console(width=None if sys.stdout.isatty() else PAPER, highlight=False)
    never = f", {score.never} more that no drive shows so large" if score.never else ""
    console.print(f"{score.trials} trials, {score.failed} failed, {score.misses} drives drawn anew{never}")
    table = Table("", "share", "of", "95 % interval", title="right", title_justify="left")
    for name, share in shares(score).items():
        low, high = share.interval
        if share.of:
            table.add_row(name, f"{100 * share.value:.1f} %", str(share.of), f"{100 * low:.1f} .. {100 * high:.1f} %")
    console.print(table)
    skill = f", skill {score.skill:.2f}" if math.isfinite(score.skill) else ""
    console.print(f"Brier {score.brier:.3f}{skill}, base rate {score.base_rate:.3f}")
    table = Table("stated", "mean", "right", "of", "95 % interval", title="reliability", title_justify="left")
    for tenth in score.reliability:
        low, high = tenth.right.interval
        bounds = f"{100 * low:.0f} .. {100 * high:.0f} %"
        of = str(tenth.right.of)
        table.add_row(f"{tenth.low:.1f} ..", f"{tenth.stated:.3f}", f"{tenth.right.value:.3f}", of, bounds)
    console.print(table)
    table = Table("it was", "it said", "times", title="confused", title_justify="left")
    for (truth, said), times in sorted(score.confusion.items(), key=lambda item: (-item[1], item[0])):
        if truth != said:
            table.add_row(truth, said, str(times))
    console.print(table if table.row_count else "nothing was confused")
    if score.fell:
        ratios = ", ".join(f"{name} {value:.3f}" for name, value in score.fell.items())
        console.print(f"error over that of the true structure, where the effect is right: {ratios}")
    console.print("CPU of a diagnosis: " + ", ".join(f"{k} {v:.1f} s" for k, v in score.diagnosis_s.items()))


def shares(score: Score) -> dict[str, Share]:
    """Every share by what it is of."""
    return {
        **{f"right first, {size}": share for size, share in score.first.items()},
        **{f"exact, {size}": share for size, share in score.exact.items()},
        "false extras among right first": score.extras,
        "false alarms on nothing": score.false_alarms,
        **{f"unlisted, {name}": share for name, share in score.unlisted.items()},
        "two found exactly": score.two,
        "three found exactly": score.three,
        "ambiguous verdicts": score.ambiguous,
        "of one effect, resolved by the experiments": score.resolved,
    }


def as_json(score: Score) -> dict[str, Any]:
    """Everything; what is no number is null."""
    return {
        "trials": score.trials,
        "failed": score.failed,
        "misses": score.misses,
        "never": score.never,
        "shares": {name: _share(share) for name, share in shares(score).items()},
        "brier": _number(score.brier),
        "base_rate": _number(score.base_rate),
        "skill": _number(score.skill),
        "reliability": [{"low": one.low, "stated": one.stated, **_share(one.right)} for one in score.reliability],
        "confusion": [
            {"truth": truth, "said": said, "times": times} for (truth, said), times in sorted(score.confusion.items())
        ],
        "error_over_true": dict(score.fell),
        "diagnosis_cpu_s": dict(score.diagnosis_s),
    }


def _share(share: Share) -> dict[str, Any]:
    low, high = share.interval
    return {"hits": share.hits, "of": share.of, "share": _number(share.value), "low": low, "high": high}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
