"""What the opened answers say about the program: how often it was right, and whether it knew when.

    Brier score  B = mean (c - o)^2,   skill = 1 - B / (p (1 - p)),   interval (Wilson, z = 1.96):

    (p + z^2/2n +- z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n)

c stated confidence that the verdict is right, o 1 where it is and 0 elsewhere, p share of right ones of n. Sources:
G. W. Brier, Monthly Weather Review 78 (1950) 1; E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from cruise.effects import EFFECTS as TABLE
from cruise.signals import OUTPUT

from .effects import UNLISTED
from .plan import Task
from .trial import Trial

Z: Final = 1.96  # standard deviations: 95 % intervals
MOST_ALIKE: Final = 2  # effects in an ambiguous verdict that still says something
TENTHS: Final = 10
NOT_DECIDED: Final = "ambiguous"
NEVER: Final = "no drive excites it so much"
OTHER_SIGNAL: Final = "unlisted, other signal"


class Line(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One trial, sealed answer and verdict; errors are held-out RMS at least 3 s ahead."""

    task: Task
    trial: Trial | None = None
    misses: tuple[str, ...] = ()  # drives before this one on which the effect could not be made so large
    failed: str = ""  # what went wrong; then there is no verdict
    verdict: str = ""
    effects: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()
    resolved: tuple[str, ...] = ()  # named once the experiments of an ambiguous verdict are driven too
    beside: tuple[str, ...] = ()  # dependences without a name that stand in the model beside the effects
    ranking: tuple[str, ...] = ()  # the five best
    confidence: float = 0.0
    margin: float = 0.0
    base_mps: float = 0.0
    final_mps: float = 0.0
    true_mps: float = 0.0  # of the model with the true structure
    diagnosis_s: float = 0.0  # CPU
    trial_s: float = 0.0  # CPU, for size, recording and true structure

    @property
    def held(self) -> bool:
        """Whether there was a recording: what no drive shows asks the program nothing."""
        return self.failed != NEVER

    @property
    def right(self) -> bool:
        """Whether the verdict is right as it stands, extras and all."""
        true, kind = set(self.task.effects), self.task.kind
        if self.failed:
            return False
        if kind == "nothing":
            return self.verdict == "nothing"
        if kind == "unlisted":
            wanted = wanted_signals(self.task.effects[0])
            return self.verdict == "unlisted" and (not wanted or bool(wanted & set(self.signals)))
        if kind == "single" and self.verdict == "ambiguous":
            return len(self.effects) <= MOST_ALIKE and true <= set(self.effects) and set(self.resolved) == true
        return self.verdict == "missing" and set(self.effects) == true

    @property
    def first(self) -> bool:
        """Whether the effect of a single one is named first; a false extra behind it doesn't count here."""
        return self.right or (not self.failed and self.verdict == "missing" and self.effects[:1] == self.task.effects)

    @property
    def said(self) -> str:
        """The column of the confusion matrix."""
        if self.failed:
            return "failed"
        if self.verdict == "ambiguous":
            return self.task.effects[0] if self.right else NOT_DECIDED
        if self.task.kind == self.verdict == "unlisted" and not self.right:
            return OTHER_SIGNAL
        return self.effects[0] if self.verdict == "missing" else self.verdict

    @property
    def truth(self) -> str:
        """The row of the confusion matrix."""
        return self.task.effects[0] if self.task.kind == "single" else self.task.kind


def wanted_signals(name: str) -> frozenset[str]:
    """Signals one of which an unlisted verdict has to name; none where only current and speed show the effect."""
    if name in UNLISTED:
        return frozenset(UNLISTED[name].signals)
    return frozenset(need for need in TABLE[name].needs if need != OUTPUT)


@dataclass(frozen=True, slots=True)
class Share:
    """So many of so many, with the interval in which the true share lies."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """The share; NaN of none."""
        return self.hits / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval; everything of none."""
        if not self.of:
            return 0.0, 1.0
        n, p, z2 = self.of, self.value, Z**2
        middle = p + z2 / (2 * n)
        half = Z * math.sqrt(p * (1.0 - p) / n + z2 / (4 * n**2))
        return max((middle - half) / (1.0 + z2 / n), 0.0), min((middle + half) / (1.0 + z2 / n), 1.0)


def share(lines: Iterable[Line], hit: Callable[[Line], bool]) -> Share:
    """How many of the lines are a hit."""
    hits = [hit(line) for line in lines]
    return Share(sum(hits), len(hits))


@dataclass(frozen=True, slots=True)
class Tenth:
    """One tenth of the reliability curve."""

    low: float
    stated: float  # mean confidence
    right: Share


@dataclass(frozen=True)
class Score:
    """Everything that is counted."""

    trials: int
    failed: int
    misses: int  # drives that were drawn anew
    never: int  # trials that could not be held, as no drive shows so much of the effect; they count nowhere else
    first: Mapping[str, Share]  # by size
    exact: Mapping[str, Share]
    extras: Share  # among those whose first effect is right
    false_alarms: Share
    unlisted: Mapping[str, Share]  # "never in it" and "left out"
    two: Share
    three: Share
    ambiguous: Share  # of all verdicts
    resolved: Share  # of ambiguous verdicts on one effect: two members with the true one, told apart by the experiments
    brier: float
    base_rate: float
    skill: float
    reliability: tuple[Tenth, ...]
    confusion: Mapping[tuple[str, str], int]  # truth and what was said
    fell: Mapping[str, float]  # median, 90 % and worst of final over true error, where the verdict is right
    diagnosis_s: Mapping[str, float]  # median and worst


def score(drawn: Sequence[Line]) -> Score:
    """Count."""
    lines = [line for line in drawn if line.held]
    of = {kind: [line for line in lines if line.task.kind == kind] for kind in ("single", "nothing", "two", "three")}
    unlisted = [line for line in lines if line.task.kind == "unlisted"]
    sizes = [size for size in ("small", "medium", "large") if any(one.task.size == size for one in of["single"])]
    sized = {size: [line for line in of["single"] if line.task.size == size] for size in sizes}
    ran = [line for line in lines if not line.failed]
    base_rate = share(ran, lambda line: line.right).value
    brier = brier_score(ran)
    return Score(
        trials=len(lines),
        failed=len(lines) - len(ran),
        misses=sum(len(line.misses) for line in drawn),
        never=len(drawn) - len(lines),
        first={size: share(sized[size], lambda line: line.first) for size in sizes},
        exact={size: share(sized[size], lambda line: line.right) for size in sizes},
        extras=share([line for line in of["single"] if line.first], lambda line: not line.right),
        false_alarms=share(of["nothing"], lambda line: not line.right),
        unlisted={
            "never in it": share([one for one in unlisted if one.task.effects[0] in UNLISTED], lambda line: line.right),
            "left out": share([one for one in unlisted if one.task.effects[0] in TABLE], lambda line: line.right),
        },
        two=share(of["two"], lambda line: line.right),
        three=share(of["three"], lambda line: line.right),
        ambiguous=share(ran, lambda line: line.verdict == "ambiguous"),
        resolved=share(
            [line for line in of["single"] if line.verdict == "ambiguous" and not line.failed], lambda line: line.right
        ),
        brier=brier,
        base_rate=base_rate,
        skill=1.0 - brier / (base_rate * (1.0 - base_rate)) if 0.0 < base_rate < 1.0 else math.nan,
        reliability=reliability(ran),
        confusion=Counter((line.truth, line.said) for line in lines if line.task.kind not in ("two", "three")),
        fell=_fell([line for line in of["single"] if line.first]),
        diagnosis_s=_times(ran),
    )


def brier_score(lines: Sequence[Line]) -> float:
    """Mean squared distance of the stated confidence from what came out; NaN of none."""
    return float(np.mean([(line.confidence - line.right) ** 2 for line in lines])) if lines else math.nan


def reliability(lines: Sequence[Line]) -> tuple[Tenth, ...]:
    """Stated confidence and hit rate in every tenth that holds an answer."""
    held: dict[int, list[Line]] = {}
    for line in lines:
        held.setdefault(min(int(TENTHS * line.confidence), TENTHS - 1), []).append(line)
    return tuple(
        Tenth(n / TENTHS, float(np.mean([one.confidence for one in some])), share(some, lambda line: line.right))
        for n, some in sorted(held.items())
    )


def _fell(lines: Sequence[Line]) -> dict[str, float]:
    ratios = [line.final_mps / line.true_mps for line in lines]
    if not ratios:
        return {}
    return {
        "median": float(np.median(ratios)),
        "90 %": float(np.quantile(ratios, 0.9)),
        "worst": max(ratios),
    }


def _times(lines: Sequence[Line]) -> dict[str, float]:
    times = [line.diagnosis_s for line in lines]
    return {"median": float(np.median(times)), "worst": max(times)} if times else {}
